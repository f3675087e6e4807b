"""MAVLink FTP: the payload of FILE_TRANSFER_PROTOCOL, its operations and errors.

A payload is little-endian: sequence number (16 bits), session, operation, size of the data, operation that is answered, whether a
burst is complete, padding, offset (32 bits), up to 239 bytes of data. An answer has the request's sequence number plus one.
"""

import math
import struct
import zlib
from collections import OrderedDict
from dataclasses import dataclass
from enum import Enum, IntEnum

from mission_io.errors import FormatError, MisuseError
from mission_io.protocol.timing import FILES, RoundTrip

DATA_BYTES = 239
PAYLOAD_BYTES = 251
_HEAD = struct.Struct("<HBBBBBxI")


class FtpOperation(IntEnum):
    """Requested operation, or one of the two kinds of answers."""

    TERMINATE_SESSION = 1
    RESET_SESSIONS = 2
    LIST_DIRECTORY = 3
    OPEN_FILE_RO = 4
    READ_FILE = 5
    CREATE_FILE = 6
    WRITE_FILE = 7
    REMOVE_FILE = 8
    CREATE_DIRECTORY = 9
    REMOVE_DIRECTORY = 10
    OPEN_FILE_WO = 11
    TRUNCATE_FILE = 12
    RENAME = 13
    CALC_FILE_CRC32 = 14
    BURST_READ_FILE = 15
    ACK = 128
    NAK = 129


class FtpError(IntEnum):
    """Reason of a refusal."""

    FAIL = 1
    FAIL_ERRNO = 2
    INVALID_DATA_SIZE = 3
    INVALID_SESSION = 4
    NO_SESSIONS_AVAILABLE = 5
    END_OF_FILE = 6
    UNKNOWN_COMMAND = 7
    FILE_EXISTS = 8
    FILE_PROTECTED = 9
    FILE_NOT_FOUND = 10


@dataclass(frozen=True, slots=True)
class FtpMessage:
    """One request or answer."""

    seq: int  # sequence number, 0 to 65535
    operation: int  # the request, or ACK or NAK; a number that is no operation stays a number
    session: int = 0  # the open file that is meant
    offset: int = 0  # where in the file, in bytes; in a directory, the entry
    data: bytes = b""  # up to 239 bytes; of a NAK, the error and perhaps the errno
    # what the size field says; None is the size of the data. Reading says by it how much is wanted.
    size: int | None = None
    answers: int = 0  # the operation that an answer is for
    burst_complete: bool = False  # whether this is the last answer of a burst

    def encoded(self) -> bytes:
        """The payload, 251 bytes.

        Raises:
            MisuseError: more data than there is room for, or a number that does not fit.
        """
        if len(self.data) > DATA_BYTES:
            raise MisuseError(f"{len(self.data)} bytes of data exceed the MAVLink FTP limit of {DATA_BYTES}")
        size = len(self.data) if self.size is None else self.size
        try:
            head = _HEAD.pack(
                self.seq, self.session, self.operation, size, self.answers, int(self.burst_complete), self.offset
            )
        except struct.error as error:
            raise MisuseError(f"{self} is not an FTP request: {error}") from None
        return (head + self.data).ljust(PAYLOAD_BYTES, b"\0")

    @classmethod
    def decoded(cls, payload: bytes) -> "FtpMessage":
        """From a payload. Raises FormatError: it says that it has more data than there is room for."""
        seq, session, operation, size, answers, complete, offset = _HEAD.unpack(payload[: _HEAD.size])
        data = payload[_HEAD.size :]
        if size > DATA_BYTES:
            raise FormatError(f"an FTP payload announces {size} bytes of data, but the limit is {DATA_BYTES}")
        return cls(seq, operation, session, offset, data[:size], size, answers, bool(complete))

    @classmethod
    def answer(cls, payload: bytes) -> "FtpMessage | None":
        """The ACK or NAK in a payload; None for anything else, and for a payload that cannot be."""
        try:
            message = cls.decoded(payload)
        except FormatError:
            return None
        return message if message.operation in (FtpOperation.ACK, FtpOperation.NAK) else None

    @property
    def error(self) -> int | None:
        """Reason of the refusal; None unless it is a NAK."""
        if self.operation != FtpOperation.NAK:
            return None
        return self.data[0] if self.data else FtpError.FAIL

    @property
    def error_text(self) -> str:
        """The error for people."""
        error = self.error
        if error is None:
            return "no error"
        name = FtpError(error).name if error in FtpError._value2member_map_ else f"error {error}"
        return f"{name} (errno {self.data[1]})" if error == FtpError.FAIL_ERRNO and len(self.data) > 1 else name


def crc32(content: bytes) -> int:
    """The CRC-32 that autopilots reckon: from 0 and without the inversion of other programs."""
    return zlib.crc32(content, 0xFFFFFFFF) ^ 0xFFFFFFFF


def path_bytes(path: str) -> bytes:
    """A path for the wire. Raises MisuseError: it is empty, too long, or holds what a path cannot hold."""
    data = path.encode("utf-8")
    if not data or len(data) >= DATA_BYTES or b"\0" in data:
        raise MisuseError(f"{path!r} is not a vehicle path; use 1 to {DATA_BYTES - 1} bytes without a zero byte")
    return data


# Requests of MAVLink FTP under way: their timeouts, their losses, and the retries of questions.


class FtpWaits:
    """Timeout of an answer, learnt from earlier ones."""

    def __init__(self) -> None:
        self._round_trip: RoundTrip | None = None
        self._shortest_s = math.inf

    def measure(self, sample_s: float) -> None:
        """Learn from the delay of an answer."""
        self._shortest_s = min(self._shortest_s, sample_s)
        first = self._round_trip is None
        self._round_trip = (
            RoundTrip.first(sample_s) if first or self._round_trip is None else self._round_trip.updated(sample_s)
        )

    def alone_s(self, tries: int) -> float:
        """Before a question is asked again when nothing else is on the way.

        An answer is given again for a repeated number: a longer timeout would only cost time.
        """
        if self._round_trip is None:
            return FILES.first_wait_s
        slow_tries = max(0, tries - FILES.hasty_tries)
        shortest = max(FILES.least_control_wait_s, 1.5 * self._shortest_s)
        return min(FILES.most_wait_s, shortest * 2.0 ** min(slow_tries, 10))

    @property
    def among_others_s(self) -> float:
        """Before a request of several is taken for lost."""
        if self._round_trip is None:
            return FILES.first_wait_s
        waits = 2.0 * self._round_trip.smoothed_s + 4.0 * self._round_trip.variation_s
        return min(FILES.most_wait_s, max(FILES.least_wait_s, waits))


class FtpQuestion:
    """One request with nothing else on the way, repeated until it is answered."""

    def __init__(self, request: FtpMessage, waits: FtpWaits) -> None:
        self.request = request
        self._waits, self._asked_at_s, self._tries = waits, -math.inf, 0

    @property
    def next_timer(self) -> float:
        """When it is asked again."""
        return self._asked_at_s + self._waits.alone_s(self._tries)

    def messages_to_send(self, now: float) -> list[FtpMessage]:
        """The request, when it is due."""
        if now < self.next_timer:
            return []
        self._asked_at_s, self._tries = now, self._tries + 1
        return [self.request]

    def is_answered_by(self, answer: FtpMessage, now: float) -> bool:
        """Whether this is its answer."""
        if (answer.seq - 1) % 65536 != self.request.seq or answer.answers != self.request.operation:
            return False
        if self._tries == 1:
            self._waits.measure(now - self._asked_at_s)
        return True


@dataclass(slots=True)
class _Sent:
    """A request under way: its piece, its number, its time, and the count of later answered ones."""

    piece: int
    at_s: float
    number: int
    later: int = 0


class FtpWindow:
    """Requests for pieces of a file, several on their way at once."""

    def __init__(self, waits: FtpWaits) -> None:
        self._waits = waits
        self._sent: OrderedDict[int, _Sent] = OrderedDict()
        self._late: dict[int, _Sent] = {}
        self._count = 0

    def __len__(self) -> int:
        """Number of requests under way."""
        return len(self._sent)

    def add(self, seq: int, piece: int, now: float) -> None:
        """A request was sent."""
        self._sent[seq] = _Sent(piece, now, self._count)
        self._count += 1

    def take(self, seq: int, now: float) -> int | None:
        """The piece of the request that was answered, one that was taken for lost included; None for an unknown one."""
        sent = self._sent.pop(seq, None)
        if sent is None:
            sent = self._late.pop(seq, None)
            if sent is None:
                return None
        else:
            for other in self._sent.values():
                if other.number > sent.number:
                    break
                other.later += 1
        self._waits.measure(now - sent.at_s)
        return sent.piece

    def lost(self, now: float) -> list[int]:
        """The pieces of requests that are taken for lost from now on."""
        lost = [
            seq
            for seq, sent in self._sent.items()
            if sent.later >= FILES.overtaking_answers or now >= sent.at_s + self._waits.among_others_s
        ]
        self._late |= {seq: self._sent.pop(seq) for seq in lost}
        return [self._late[seq].piece for seq in lost]

    def next_timer(self) -> float | None:
        """When the oldest is taken for lost; None when none is on the way."""
        oldest = next(iter(self._sent.values()), None)
        return None if oldest is None else oldest.at_s + self._waits.among_others_s

    def clear(self) -> None:
        """Forget all of them."""
        self._sent.clear()
        self._late.clear()


class FtpState(Enum):
    """Where a transfer is; a list of a folder is either opening or at an end."""

    OPENING = "opening"
    BURSTS = "reading in bursts"
    GAPS = "reading what is missing"
    WRITING = "writing"
    PROBING = "finding out what is missing"
    CLOSING = "closing"
    CHECKING = "comparing the CRC"
    DONE = "done"
    REFUSED = "refused"
    DIFFERS = "the data arrived with a different CRC"
    SILENT = "silent"


_ENDS = (FtpState.DONE, FtpState.REFUSED, FtpState.DIFFERS, FtpState.SILENT)


class FtpTransfer:
    """The common part of uploads, downloads and lists of folders; sans-IO.

    One question at a time (opening, closing, comparing) is repeated until it is answered; in between, the file's pieces travel.

    Attributes:
        why: The reason of the state, at the end.
    """

    silence = "no answer"

    def __init__(self, path: str, *, now: float, silent_s: float) -> None:
        self.path, self.silent_s = path, silent_s
        self.state, self.why = FtpState.OPENING, ""
        self._path = path_bytes(path)
        # A server answers a repeated number as it did before, and an earlier transfer may have ended with any.
        self._session, self._seq = 0, round(now * 1000.0) % 65536
        self._waits = FtpWaits()
        self._question: tuple[FtpQuestion, FtpState] | None = None
        self._heard_at_s = now
        self._crc_tries = 0

    @property
    def finished(self) -> bool:
        """Whether it has ended, well or not."""
        return self.state in _ENDS

    def messages_to_send(self, now: float) -> list[FtpMessage]:
        """Messages to send at ``now``."""
        if self.finished:
            return []
        if now >= self._heard_at_s + self.silent_s:
            self.state, self.why = FtpState.SILENT, f"{self.silence} for {self.silent_s:g} s"
            return []
        return self._piece_requests(now) if self._question is None else self._question[0].messages_to_send(now)

    def next_timer(self) -> float | None:
        """When it wants to be asked again; None when it has ended."""
        if self.finished:
            return None
        silent_at_s = self._heard_at_s + self.silent_s
        due_at_s = self._pieces_due_at_s() if self._question is None else self._question[0].next_timer
        return silent_at_s if due_at_s is None else min(silent_at_s, due_at_s)

    def receive(self, payload: bytes, now: float) -> None:
        """Take the payload of an answer."""
        answer = FtpMessage.answer(payload)
        if self.finished or answer is None:
            return
        if self._question is None:
            self._take_answer(answer, now)
            return
        question, then = self._question
        if question.is_answered_by(answer, now):
            self._question, self._heard_at_s = None, now
            self._take_control(answer, FtpOperation(question.request.operation), then, now)

    # What the pieces of the file need; a list of a folder has none.

    def _piece_requests(self, now: float) -> list[FtpMessage]:
        del now
        return []

    def _pieces_due_at_s(self) -> float | None:
        return None

    def _take_answer(self, answer: FtpMessage, now: float) -> None:
        """Take an answer while no question is open."""

    # Questions.

    def _ask(
        self, operation: FtpOperation, then: FtpState, *, session: int = 0, offset: int = 0, step: int = 1
    ) -> None:
        """Ask about the file, or about a session; in state ``then`` it goes on."""
        about_file = operation not in (FtpOperation.TERMINATE_SESSION, FtpOperation.RESET_SESSIONS)
        request = FtpMessage(self._next_seq(step), operation, session, offset, self._path if about_file else b"")
        self._question = FtpQuestion(request, self._waits), then

    def _next_seq(self, step: int = 1) -> int:
        self._seq = (self._seq + step) % 65536
        return self._seq

    def _refuse(self, why: str) -> None:
        self.state, self.why = FtpState.REFUSED, why

    def _take_control(self, answer: FtpMessage, operation: FtpOperation, then: FtpState, now: float) -> None:
        """Take the answer to a question."""
        if operation in (FtpOperation.TERMINATE_SESSION, FtpOperation.RESET_SESSIONS):
            self._go(then)
        elif answer.error is None:
            self._take_success(answer, operation, then, now)
        elif answer.error in (FtpError.FAIL, FtpError.NO_SESSIONS_AVAILABLE) and not self.why:
            self.why = "a file was open"  # perhaps ours, from before
            self._ask(FtpOperation.RESET_SESSIONS, self.state)
        else:
            self._refuse(f"{operation.name}: {answer.error_text}")

    def _go(self, then: FtpState) -> None:
        """Go on after a session was closed."""

    def _take_success(self, answer: FtpMessage, operation: FtpOperation, then: FtpState, now: float) -> None:
        """Take the answer to a question that was not refused."""

    def _ends_equal(self, arrived: int, sent: int, advice: str = "") -> bool:
        """Whether two CRCs end the transfer: they are equal, or differ once too often."""
        self._crc_tries += 1
        if arrived == sent:
            self.state = FtpState.DONE
        elif self._crc_tries >= FILES.tries_of_crc:
            self.state = FtpState.DIFFERS
            self.why = f"CRC {arrived:08x} instead of {sent:08x} after {self._crc_tries} tries{advice}"
        return self.finished


# The list of a folder by MAVLink FTP: page after page, until the vehicle reports its end.

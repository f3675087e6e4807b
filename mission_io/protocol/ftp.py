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
from mission_io.protocol.timing import RoundTrip
from mission_io.protocol.tuning import FILES

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
            raise MisuseError(f"{len(self.data)} bytes of data; the limit of MAVLink FTP is {DATA_BYTES}")
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
            raise FormatError(f"an FTP payload announces {size} bytes of data; the limit is {DATA_BYTES}")
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
        raise MisuseError(f"{path!r} is not a path for a vehicle; use 1 to {DATA_BYTES - 1} bytes without a zero byte")
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


# The list of a folder by MAVLink FTP: page after page, until the vehicle reports its end.


@dataclass(frozen=True, slots=True)
class FtpEntry:
    """A file or a folder in a folder."""

    name: str  # without the folder
    size_bytes: int | None  # of a file; None for a folder, and where the vehicle says none
    is_folder: bool  # whether it is a folder


class FtpListingState(Enum):
    """Where a listing is."""

    ASKING = "asking"
    DONE = "done"
    REFUSED = "refused"
    SILENT = "silent"


class FtpListing:
    """One folder; sans-IO.

    Args:
        path: The folder.
        now: The present time in seconds.
        silent_s: Silence after which it gives up.
    """

    def __init__(self, path: str, *, now: float, silent_s: float = 30.0) -> None:
        self.path, self.silent_s = path, silent_s
        self.state, self.why = FtpListingState.ASKING, ""
        self._path = path_bytes(path if path == "/" else path.rstrip("/"))
        self._entries: dict[str, FtpEntry] = {}
        self._offset, self._heard_at_s = 0, now
        # a server answers a repeated number as it did before, and an earlier transfer may have ended with any.
        self._seq = round(now * 1000.0) % 65536
        self._waits = FtpWaits()
        self._question = self._next_question()

    @property
    def finished(self) -> bool:
        """Whether it has ended, well or not."""
        return self.state is not FtpListingState.ASKING

    @property
    def entries(self) -> list[FtpEntry]:
        """Known entries of the folder: folders first, by name."""
        return sorted(self._entries.values(), key=lambda entry: (not entry.is_folder, entry.name))

    def messages_to_send(self, now: float) -> list[FtpMessage]:
        """Messages to send at ``now``."""
        if self.finished:
            return []
        if now >= self._heard_at_s + self.silent_s:
            self.state, self.why = FtpListingState.SILENT, f"no answer for {self.silent_s:g} s"
            return []
        return self._question.messages_to_send(now)

    def next_timer(self) -> float | None:
        """When it wants to be asked again; None when it has ended."""
        return None if self.finished else min(self._heard_at_s + self.silent_s, self._question.next_timer)

    def receive(self, payload: bytes, now: float) -> None:
        """Take the payload of an answer."""
        answer = FtpMessage.answer(payload)
        if self.finished or answer is None:
            return
        if not self._question.is_answered_by(answer, now):
            return
        self._heard_at_s = now
        if answer.error == FtpError.END_OF_FILE:
            self.state = FtpListingState.DONE
        elif answer.error is not None:
            self._refuse(f"LIST_DIRECTORY: {answer.error_text}")
        else:
            self._take_page(answer.data)

    def _next_question(self) -> FtpQuestion:
        self._seq = (self._seq + 1) % 65536
        request = FtpMessage(self._seq, FtpOperation.LIST_DIRECTORY, offset=self._offset, data=self._path)
        return FtpQuestion(request, self._waits)

    def _refuse(self, why: str) -> None:
        self.state, self.why = FtpListingState.REFUSED, why

    def _take_page(self, data: bytes) -> None:
        lines = [line for line in data.split(b"\0") if line]
        if not lines:
            self.state = FtpListingState.DONE
            return
        self._offset += len(lines)
        try:
            page = [_entry(line) for line in lines if line[:1] != b"S" and line not in (b"D.", b"D..")]  # S: skipped
        except FormatError as error:
            self._refuse(str(error))
            return
        again = next((entry.name for entry in page if entry.name in self._entries), None)
        self._entries |= {entry.name: entry for entry in page}
        if again is not None:
            self._refuse(f"the vehicle lists {again!r} repeatedly, or the folder is changing")
        elif self._offset > FILES.most_entries:
            self._refuse(f"the vehicle lists more than {FILES.most_entries} entries")
        else:
            self._question = self._next_question()


def _entry(line: bytes) -> FtpEntry:
    """From ``Dname`` or ``Fname<tab>size``."""
    text = line.decode("utf-8", errors="backslashreplace")
    kind, (name, _, size) = text[0], text[1:].partition("\t")
    if kind not in "DF" or not name or not ((size.isascii() and size.isdigit()) or not size):
        raise FormatError(f"{text!r} is not an entry of a folder")
    return FtpEntry(name, int(size) if size and kind == "F" else None, kind == "D")

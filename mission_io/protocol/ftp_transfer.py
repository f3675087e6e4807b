"""Exchanges by MAVLink FTP: timeouts, losses and retries of requests, what all transfers share, and lists of folders."""

import math
from collections import OrderedDict
from dataclasses import dataclass
from enum import Enum

from mission_io.errors import FormatError
from mission_io.protocol.ftp import FtpError, FtpMessage, FtpOperation, path_bytes
from mission_io.protocol.timing import FILES, RoundTrip

# Requests of MAVLink FTP under way: their timeouts, their losses, and the retries of questions.


class FtpWaits:
    """Timeout of an answer, learnt from earlier ones."""

    def __init__(self) -> None:
        self._round_trip: RoundTrip | None = None
        self._shortest_s = math.inf

    def measure(self, sample_s: float) -> None:
        """Learn from the delay of an answer."""
        self._shortest_s = min(self._shortest_s, sample_s)
        known = self._round_trip
        self._round_trip = RoundTrip.first(sample_s) if known is None else known.updated(sample_s)

    def alone_s(self, tries: int) -> float:
        """Timeout of the only pending question.

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
        self._waits, self._requested_at_s, self._tries = waits, -math.inf, 0

    @property
    def next_timer(self) -> float:
        """When it is asked again."""
        return self._requested_at_s + self._waits.alone_s(self._tries)

    def messages_to_send(self, now: float) -> list[FtpMessage]:
        """The request, when it is due."""
        if now < self.next_timer:
            return []
        self._requested_at_s, self._tries = now, self._tries + 1
        return [self.request]

    def is_answered_by(self, answer: FtpMessage, now: float) -> bool:
        """Whether this is its answer."""
        if (answer.seq - 1) % 65536 != self.request.seq or answer.answers != self.request.operation:
            return False
        if self._tries == 1:
            self._waits.measure(now - self._requested_at_s)
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
        """Time of the next call without a message; None if it needs none."""
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


@dataclass(frozen=True, slots=True)
class FtpEntry:
    """A file or a folder in a folder."""

    name: str  # without the folder
    size_bytes: int | None  # of a file; None for a folder, and where the vehicle says none
    is_folder: bool  # whether it is a folder


class FtpListing(FtpTransfer):
    """One folder.

    Args:
        path: The folder.
        now: The present time in seconds.
        silent_s: Silence after which it gives up.
    """

    def __init__(self, path: str, *, now: float, silent_s: float = 30.0) -> None:
        super().__init__(path if path == "/" else path.rstrip("/"), now=now, silent_s=silent_s)
        self._entries: dict[str, FtpEntry] = {}
        self._offset = 0
        self._ask(FtpOperation.LIST_DIRECTORY, FtpState.OPENING)

    @property
    def entries(self) -> list[FtpEntry]:
        """Known entries of the folder: folders first, by name."""
        return sorted(self._entries.values(), key=lambda entry: (not entry.is_folder, entry.name))

    def _take_control(self, answer: FtpMessage, operation: FtpOperation, then: FtpState, now: float) -> None:
        del then, now
        if answer.error == FtpError.END_OF_FILE:
            self.state = FtpState.DONE
        elif answer.error is not None:
            self._refuse(f"{operation.name}: {answer.error_text}")
        else:
            self._take_page(answer.data)

    def _take_page(self, data: bytes) -> None:
        lines = [line for line in data.split(b"\0") if line]
        if not lines:
            self.state = FtpState.DONE
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
            self._refuse(f"the vehicle lists {again!r} repeatedly; the folder may be changing")
        elif self._offset > FILES.most_entries:
            self._refuse(f"the vehicle lists more than {FILES.most_entries} entries")
        else:
            self._ask(FtpOperation.LIST_DIRECTORY, FtpState.OPENING, offset=self._offset)


def _entry(line: bytes) -> FtpEntry:
    """From ``Dname`` or ``Fname<tab>size``."""
    text = line.decode("utf-8", errors="backslashreplace")
    kind, (name, _, size) = text[0], text[1:].partition("\t")
    if kind not in "DF" or not name or not ((size.isascii() and size.isdigit()) or not size):
        raise FormatError(f"{text!r} is not a valid folder entry")
    return FtpEntry(name, int(size) if size and kind == "F" else None, kind == "D")

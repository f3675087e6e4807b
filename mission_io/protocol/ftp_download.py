"""Download of a file by MAVLink FTP: bursts from the beginning to the end, then single reads of the gaps.

A burst costs one request for hundreds of pieces. The next one begins where it ended, without waiting for what was lost. The
gaps are read one by one, several requests on the way at once. The announced size bounds what is kept; a file may end before it
(ArduPilot announces 1 MB for a mission). The CRC of the whole file decides at the end. After a pause of the link, or a restart
of the vehicle, it goes on where it was.
"""

import math
from collections import deque
from enum import Enum

from mission_io.protocol.ftp import DATA_BYTES, FtpError, FtpMessage, FtpOperation, crc32, path_bytes
from mission_io.protocol.ftp_window import FtpQuestion, FtpWaits, FtpWindow
from mission_io.protocol.tuning import FILES

MOST_BYTES = 1 << 30
"""A file that is announced larger is refused: sooner nonsense than a file."""


class FtpDownloadState(Enum):
    """Where a download is."""

    OPENING = "opening"
    BURSTS = "reading in bursts"
    GAPS = "reading what is missing"
    CLOSING = "closing"
    CHECKING = "comparing the CRC"
    DONE = "done"
    REFUSED = "refused"
    DIFFERS = "arrived with a different CRC"
    SILENT = "silent"


class FtpDownload:
    """One file on its way from a vehicle; sans-IO.

    Args:
        path: Where the vehicle keeps it.
        now: The present time in seconds.
        window: Single reads on the way at once. ArduPilot queues five, and drops what comes beyond.
        silent_s: Time without new data after which it gives up; a new download with ``resume`` goes on.
        most_bytes: A file that is announced larger is refused.
        resume: A download of the same path that gave up: what it has is not read again while the announced size is the same.
    """

    def __init__(
        self, path: str, *, now: float, window: int = 5, silent_s: float = 30.0, most_bytes: int = MOST_BYTES,
        resume: "FtpDownload | None" = None,
    ) -> None:  # fmt: skip
        self.path, self.window, self.silent_s, self.most_bytes = path, max(1, window), silent_s, most_bytes
        self.state = FtpDownloadState.OPENING
        self.why = ""
        goes_on = resume is not None and resume.path == path
        self._size: int | None = resume._size if goes_on and resume is not None else None
        self._pieces: dict[int, bytes] = dict(resume._pieces) if goes_on and resume is not None else {}
        self._end: int | None = None
        self.across_bytes = sum(map(len, self._pieces.values()))
        """Bytes that are here."""
        self._path = path_bytes(path)
        # A server answers a repeated number as it did before, and an earlier transfer may have ended with any.
        self._session, self._seq = 0, round(now * 1000.0) % 65536
        self._waits = FtpWaits()
        self._question: tuple[FtpQuestion, FtpDownloadState] | None = None
        self._bursts, self._reads = FtpWindow(self._waits), FtpWindow(self._waits)
        self._todo: deque[int] = deque()
        self._reach = 0
        self._burst_seq: int | None = None
        self._burst_heard_at_s, self._burst_gap_s, self._deaf_bursts = now, FILES.first_gap_s, 0
        self._has_bursts = True
        self._new_at_s = now
        self._failures = self._crc_tries = self._most_across_bytes = 0
        self._ask(FtpMessage(self._next_seq(), FtpOperation.OPEN_FILE_RO, data=self._path), FtpDownloadState.BURSTS)

    @property
    def finished(self) -> bool:
        """Whether it has ended, well or not."""
        return self.state in (
            FtpDownloadState.DONE, FtpDownloadState.REFUSED, FtpDownloadState.DIFFERS, FtpDownloadState.SILENT,
        )  # fmt: skip

    @property
    def content(self) -> bytes:
        """Bytes received so far, in order; the file when it is DONE."""
        return b"".join(self._pieces[piece] for piece in sorted(self._pieces))

    @property
    def total_bytes(self) -> int:
        """Size of the file by the vehicle's messages; 0 before the first one."""
        return (self._size or 0) if self._end is None else self._end

    def messages_to_send(self, now: float) -> list[FtpMessage]:
        """Messages to send at ``now``."""
        if self.finished:
            return []
        if now >= self._new_at_s + self.silent_s:
            self.state, self.why = FtpDownloadState.SILENT, f"nothing new for {self.silent_s:g} s"
            return []
        if self._question is not None:
            return self._question[0].messages_to_send(now)
        return self._burst(now) if self.state is FtpDownloadState.BURSTS else self._single_reads(now)

    def next_timer(self) -> float | None:
        """When it wants to be asked again; None when it has ended."""
        if self.finished:
            return None
        if self._question is not None:
            due_at_s: float | None = self._question[0].next_timer
        elif self.state is FtpDownloadState.BURSTS:
            due_at_s = self._burst_heard_at_s + (0.0 if self._burst_seq is None else self._burst_wait_s)
        else:
            due_at_s = self._reads.next_timer()
        silent_at_s = self._new_at_s + self.silent_s
        return silent_at_s if due_at_s is None else min(silent_at_s, due_at_s)

    def receive(self, payload: bytes, now: float) -> None:
        """Take the payload of an answer."""
        answer = FtpMessage.answer(payload)
        if self.finished or answer is None:
            return
        if self._question is not None:
            question, then = self._question
            if question.is_answered_by(answer, now):
                self._question, self._new_at_s = None, now
                self._take_control(answer, question.request, then, now)
        elif answer.session != self._session:
            return
        elif answer.answers == FtpOperation.BURST_READ_FILE:
            if (self._seq + FILES.beyond_a_burst - answer.seq) % 65536 < FILES.recent_answers:
                self._take_burst(answer, now)
        elif answer.answers == FtpOperation.READ_FILE:
            piece = self._reads.take((answer.seq - 1) % 65536, now)
            if piece is not None:
                self._take_read(answer, piece, now)

    # Opening, closing, comparing: one request at a time, until it is answered.

    def _ask(self, request: FtpMessage, then: FtpDownloadState) -> None:
        self._question = FtpQuestion(request, self._waits), then

    def _next_seq(self, step: int = 1) -> int:
        self._seq = (self._seq + step) % 65536
        return self._seq

    def _refuse(self, why: str) -> None:
        self.state, self.why = FtpDownloadState.REFUSED, why

    def _fail(self, why: str) -> bool:
        """Count a repaired gap; False after too many of them without new data."""
        self._failures += 1
        if self._failures > FILES.most_failures:
            self._refuse(f"{why}, {self._failures} times")
        return not self.finished

    def _take_control(self, answer: FtpMessage, request: FtpMessage, then: FtpDownloadState, now: float) -> None:
        error, operation = answer.error, FtpOperation(request.operation)
        if operation in (FtpOperation.TERMINATE_SESSION, FtpOperation.RESET_SESSIONS):
            self.state = then
            checks = then is FtpDownloadState.CHECKING
            operation = FtpOperation.CALC_FILE_CRC32 if checks else FtpOperation.OPEN_FILE_RO
            self._ask(
                FtpMessage(self._next_seq(), operation, data=self._path), then if checks else FtpDownloadState.BURSTS
            )
        elif error is None and len(answer.data) < 4:
            self._refuse(f"{operation.name}: an answer of {len(answer.data)} bytes instead of 4")
        elif error is None and operation is FtpOperation.CALC_FILE_CRC32:
            self._compare(int.from_bytes(answer.data[:4], "little"))
        elif error is None:
            self._begin(answer.session, int.from_bytes(answer.data[:4], "little"), now)
        elif error in (FtpError.FAIL, FtpError.NO_SESSIONS_AVAILABLE) and not self.why:
            self.why = "a file was open"  # perhaps ours, from before
            self._ask(FtpMessage(self._next_seq(), FtpOperation.RESET_SESSIONS), self.state)
        else:
            self._refuse(f"{operation.name}: {answer.error_text}")

    def _begin(self, session: int, size: int, now: float) -> None:
        if size > self.most_bytes:
            self._refuse(f"the vehicle announces {size} bytes, more than the limit of {self.most_bytes}")
            return
        if size != self._size:
            self._forget()
        self._size, self._session, self.why = size, session, ""
        self._reach = max(self._pieces, default=-1) + 1
        self.state, self._burst_seq, self._deaf_bursts = FtpDownloadState.BURSTS, None, 0
        self._burst_heard_at_s = now

    def _close(self, then: FtpDownloadState) -> None:
        self._bursts.clear()
        self._reads.clear()
        self.state = FtpDownloadState.CLOSING
        request = FtpMessage(self._next_seq(FILES.beyond_a_burst), FtpOperation.TERMINATE_SESSION, self._session)
        self._ask(request, then)

    def _compare(self, found: int) -> None:
        here = crc32(self.content)
        if found == here:
            self.state = FtpDownloadState.DONE
            return
        self._crc_tries += 1
        if self._crc_tries >= FILES.tries_of_crc:
            self.state = FtpDownloadState.DIFFERS
            self.why = f"CRC {here:08x} instead of {found:08x} after {self._crc_tries} tries; it may be changing"
            return
        self._forget()
        self._close(FtpDownloadState.OPENING)

    def _forget(self) -> None:
        self._pieces.clear()
        self._end, self._reach, self.across_bytes = None, 0, 0

    # Bursts.

    @property
    def _burst_wait_s(self) -> float:
        pause_s = max(self._waits.among_others_s, FILES.gaps_of_silence * self._burst_gap_s)
        return min(FILES.burst_most_wait_s, pause_s * 2.0 ** min(max(0, self._deaf_bursts - FILES.hasty_bursts), 10))

    def _burst(self, now: float) -> list[FtpMessage]:
        if self._is_reached:
            return self._look_for_gaps(now)
        if self._burst_seq is not None and now < self._burst_heard_at_s + self._burst_wait_s:
            return []
        self._burst_seq = self._next_seq(FILES.beyond_a_burst)
        self._burst_heard_at_s = now
        self._deaf_bursts += 1
        self._bursts.add(self._burst_seq, self._reach, now)
        return [
            FtpMessage(
                self._burst_seq, FtpOperation.BURST_READ_FILE, self._session, self._reach * DATA_BYTES, size=DATA_BYTES
            )
        ]

    @property
    def _is_reached(self) -> bool:
        return self._reach >= math.ceil(self.total_bytes / DATA_BYTES)

    def _take_burst(self, answer: FtpMessage, now: float) -> None:
        latest = self._burst_seq is not None and (answer.seq - self._burst_seq) % 65536 < 32768
        error = answer.error
        if error is None:
            self._bursts.take((answer.seq - 1) % 65536, now)
            if latest and self._deaf_bursts == 0:
                self._burst_gap_s = max(now - self._burst_heard_at_s, 0.9 * self._burst_gap_s)
            if latest:
                self._burst_heard_at_s, self._deaf_bursts = now, 0
            self._keep(answer.offset, answer.data, now)
            if latest and answer.burst_complete:
                self._burst_seq = None
        elif not latest or self.state is not FtpDownloadState.BURSTS:
            return
        elif error in (FtpError.FILE_NOT_FOUND, FtpError.INVALID_SESSION):
            self._open_again(answer)
        elif error in (FtpError.END_OF_FILE, FtpError.UNKNOWN_COMMAND):
            # Where the file ends a burst does not tell: what came before may be lost. A single read does.
            self._has_bursts = error == FtpError.END_OF_FILE
            self.state, self._todo = FtpDownloadState.GAPS, deque([*self._missing(), self._reach])
        else:
            self._refuse(f"byte {self._reach * DATA_BYTES}: {answer.error_text}")

    def _keep(self, offset: int, data: bytes, now: float) -> None:
        """Keep a piece that belongs to the file, at its offset, within the announced size."""
        size = self._size or 0
        piece, data = offset // DATA_BYTES, data[: max(0, size - offset)]
        if offset % DATA_BYTES or not data or piece in self._pieces:
            return
        if self._end is not None and offset + len(data) > self._end:
            self._fail(f"there is data at byte {offset}, beyond the end at byte {self._end}")
            if self._end % DATA_BYTES:
                self.across_bytes -= len(self._pieces.pop(self._end // DATA_BYTES, b""))
            self._end = None
        if len(data) < min(DATA_BYTES, size - offset) and not self._end_at(offset + len(data)):
            return
        self._pieces[piece] = data
        self._reach = max(self._reach, piece + 1)
        self.across_bytes += len(data)
        self._new_at_s = now
        if self.across_bytes > self._most_across_bytes:
            self._most_across_bytes, self._failures = self.across_bytes, 0

    def _end_at(self, end: int) -> bool:
        """The file ends before the announced size; False when received data contradicts it."""
        if max(self._pieces, default=-1) >= math.ceil(end / DATA_BYTES):
            self._fail(f"the vehicle reports the end at byte {end}, but sent data beyond it")
            return False
        self._end = end if self._end is None else min(end, self._end)
        return True

    def _open_again(self, answer: FtpMessage) -> None:
        """The vehicle was restarted."""
        if self._fail(f"byte {self._reach * DATA_BYTES}: {answer.error_text}"):
            self._close(FtpDownloadState.OPENING)

    # Single reads: a window of them.

    def _missing(self) -> list[int]:
        """Pieces that are missing among those that were reached; among all for a vehicle without bursts."""
        count = math.ceil(self.total_bytes / DATA_BYTES)
        return [
            piece
            for piece in range(min(count, self._reach) if self._has_bursts else count)
            if piece not in self._pieces
        ]

    def _look_for_gaps(self, now: float) -> list[FtpMessage]:
        self._todo = deque(self._missing())
        if self._todo:
            self.state = FtpDownloadState.GAPS
        elif self._is_reached:
            self._close(FtpDownloadState.CHECKING)
        else:
            self.state, self._burst_seq = FtpDownloadState.BURSTS, None
        return self.messages_to_send(now)

    def _single_reads(self, now: float) -> list[FtpMessage]:
        self._todo.extend(self._reads.lost(now))
        out: list[FtpMessage] = []
        while len(self._reads) < self.window:
            if not self._todo:
                return out if self._reads or out else self._look_for_gaps(now)
            piece = self._todo.popleft()
            if piece in self._pieces:
                continue
            seq = self._next_seq()
            self._reads.add(seq, piece, now)
            out.append(FtpMessage(seq, FtpOperation.READ_FILE, self._session, piece * DATA_BYTES, size=DATA_BYTES))
        return out

    def _take_read(self, answer: FtpMessage, piece: int, now: float) -> None:
        error = answer.error
        if error is None and answer.offset == piece * DATA_BYTES:
            self._keep(answer.offset, answer.data, now)
        elif error == FtpError.END_OF_FILE:
            self._end_at(piece * DATA_BYTES)
        elif error in (FtpError.FILE_NOT_FOUND, FtpError.INVALID_SESSION):
            self._open_again(answer)
        elif error is not None:
            self._refuse(f"byte {piece * DATA_BYTES}: {answer.error_text}")

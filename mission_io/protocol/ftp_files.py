"""Files by MAVLink FTP: downloads and uploads with several requests on the way, resumed, and compared by their CRC.

The CRC of the whole file decides at the end. After a pause of the link, or a restart of the vehicle, a transfer continues where
it stopped.

A file is downloaded by bursts from the beginning to the end, then by single reads of the gaps. A burst costs one request for
hundreds of pieces. The next one begins where it ended, without waiting for what was lost. The gaps are read one by one, several
requests on the way at once. The announced size bounds what is kept; a file may end before it (ArduPilot announces 1 MB for a
mission).

In an upload, an answer that is lost says nothing of its piece. Sending every unanswered piece again would cost 1 / (1 - loss)²
of the line where 1 / (1 - loss) is needed. So pieces are sent in passes, each once; then the file is opened for reading, and for
each piece without an answer its last bytes are read, which costs a tenth of sending it. What is missing makes the next pass.
"""

import math
from collections import deque

from mission_io.protocol.ftp import DATA_BYTES, FtpError, FtpMessage, FtpOperation, crc32
from mission_io.protocol.ftp_transfer import FtpState, FtpTransfer, FtpWindow
from mission_io.protocol.timing import FILES

MOST_BYTES = 1 << 30
"""A file that is announced larger is refused: sooner nonsense than a file."""


class FtpDownload(FtpTransfer):
    """One file on its way from a vehicle.

    Args:
        path: Where the vehicle keeps it.
        now: The present time in seconds.
        window: Single reads on the way at once. ArduPilot queues five, and drops what comes beyond.
        silent_s: Time without new data after which it gives up; a new download with ``resume`` goes on.
        most_bytes: A file that is announced larger is refused.
        resume: A download of the same path that gave up: what it has is not read again while the announced size is the same.
    """

    silence = "no new data"

    def __init__(
        self, path: str, *, now: float, window: int = 5, silent_s: float = 30.0, most_bytes: int = MOST_BYTES,
        resume: "FtpDownload | None" = None,
    ) -> None:  # fmt: skip
        super().__init__(path, now=now, silent_s=silent_s)
        self.window, self.most_bytes = max(1, window), most_bytes
        goes_on = resume is not None and resume.path == path
        self._size: int | None = resume._size if goes_on and resume is not None else None
        self._pieces: dict[int, bytes] = dict(resume._pieces) if goes_on and resume is not None else {}
        self._end: int | None = None
        self.across_bytes = sum(map(len, self._pieces.values()))
        """Bytes that are here."""
        self._bursts, self._reads = FtpWindow(self._waits), FtpWindow(self._waits)
        self._todo: deque[int] = deque()
        self._reach = 0
        self._burst_seq: int | None = None
        self._burst_heard_at_s, self._burst_gap_s, self._deaf_bursts = now, FILES.first_gap_s, 0
        self._has_bursts = True
        self._failures = self._most_across_bytes = 0
        self._ask(FtpOperation.OPEN_FILE_RO, FtpState.BURSTS)

    @property
    def content(self) -> bytes:
        """Bytes received so far, in order; the file when it is DONE."""
        return b"".join(self._pieces[piece] for piece in sorted(self._pieces))

    @property
    def total_bytes(self) -> int:
        """Size of the file by the vehicle's messages; 0 before the first one."""
        return (self._size or 0) if self._end is None else self._end

    def _piece_requests(self, now: float) -> list[FtpMessage]:
        return self._burst(now) if self.state is FtpState.BURSTS else self._single_reads(now)

    def _pieces_due_at_s(self) -> float | None:
        if self.state is not FtpState.BURSTS:
            return self._reads.next_timer()
        return self._burst_heard_at_s + (0.0 if self._burst_seq is None else self._burst_wait_s)

    def _take_answer(self, answer: FtpMessage, now: float) -> None:
        if answer.session != self._session:
            return
        if answer.answers == FtpOperation.BURST_READ_FILE:
            if (self._seq + FILES.beyond_a_burst - answer.seq) % 65536 < FILES.recent_answers:
                self._take_burst(answer, now)
        elif answer.answers == FtpOperation.READ_FILE:
            piece = self._reads.take((answer.seq - 1) % 65536, now)
            if piece is not None:
                self._take_read(answer, piece, now)

    # Opening, closing, comparing.

    def _fail(self, why: str) -> bool:
        """Count a repaired gap; False after too many of them without new data."""
        self._failures += 1
        if self._failures > FILES.most_failures:
            self._refuse(f"{why}, {self._failures} times")
        return not self.finished

    def _go(self, then: FtpState) -> None:
        self.state = then
        if then is FtpState.CHECKING:
            self._ask(FtpOperation.CALC_FILE_CRC32, then)
        else:
            self._ask(FtpOperation.OPEN_FILE_RO, FtpState.BURSTS)

    def _take_success(self, answer: FtpMessage, operation: FtpOperation, then: FtpState, now: float) -> None:
        del then
        number = int.from_bytes(answer.data[:4], "little")
        if len(answer.data) < 4:
            self._refuse(f"{operation.name}: an answer of {len(answer.data)} bytes instead of 4")
        elif operation is not FtpOperation.CALC_FILE_CRC32:
            self._begin(answer.session, number, now)
        elif not self._ends_equal(crc32(self.content), number, "; the file may be changing"):
            self._forget()
            self._close(FtpState.OPENING)

    def _begin(self, session: int, size: int, now: float) -> None:
        if size > self.most_bytes:
            self._refuse(f"the vehicle announces {size} bytes, but the limit is {self.most_bytes}")
            return
        if size != self._size:
            self._forget()
        self._size, self._session, self.why = size, session, ""
        self._reach = max(self._pieces, default=-1) + 1
        self.state, self._burst_seq, self._deaf_bursts = FtpState.BURSTS, None, 0
        self._burst_heard_at_s = now

    def _close(self, then: FtpState) -> None:
        self._bursts.clear()
        self._reads.clear()
        self.state = FtpState.CLOSING
        self._ask(FtpOperation.TERMINATE_SESSION, then, session=self._session, step=FILES.beyond_a_burst)

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
        elif not latest or self.state is not FtpState.BURSTS:
            return
        elif error in (FtpError.FILE_NOT_FOUND, FtpError.INVALID_SESSION):
            self._open_again(answer)
        elif error in (FtpError.END_OF_FILE, FtpError.UNKNOWN_COMMAND):
            # A burst does not show the end of the file, because earlier pieces may be lost. A single read does.
            self._has_bursts = error == FtpError.END_OF_FILE
            self.state, self._todo = FtpState.GAPS, deque([*self._missing(), self._reach])
        else:
            self._refuse(f"byte {self._reach * DATA_BYTES}: {answer.error_text}")

    def _keep(self, offset: int, data: bytes, now: float) -> None:
        """Keep a piece that belongs to the file, at its offset, within the announced size."""
        size = self._size or 0
        piece, data = offset // DATA_BYTES, data[: max(0, size - offset)]
        if offset % DATA_BYTES or not data or piece in self._pieces:
            return
        if self._end is not None and offset + len(data) > self._end:
            self._fail(f"the vehicle sent data at byte {offset}, beyond the end at byte {self._end}")
            if self._end % DATA_BYTES:
                self.across_bytes -= len(self._pieces.pop(self._end // DATA_BYTES, b""))
            self._end = None
        if len(data) < min(DATA_BYTES, size - offset) and not self._end_at(offset + len(data)):
            return
        self._pieces[piece] = data
        self._reach = max(self._reach, piece + 1)
        self.across_bytes += len(data)
        self._heard_at_s = now
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
            self._close(FtpState.OPENING)

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
            self.state = FtpState.GAPS
        elif self._is_reached:
            self._close(FtpState.CHECKING)
        else:
            self.state, self._burst_seq = FtpState.BURSTS, None
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


class FtpUpload(FtpTransfer):
    """One file on its way to a vehicle.

    Args:
        path: Where the vehicle keeps it.
        content: Its bytes.
        now: The present time in seconds.
        window: Requests on the way at once. ArduPilot queues five, and drops what comes beyond.
        silent_s: Silence after which it gives up; a new upload with ``resume`` goes on.
        resume: An upload of the same content that gave up: what it got across is not sent again.
        readable: Whether what is written can be read, for questions and the CRC. ArduPilot's lists cannot: they are made of
            the file when it is closed. What was not answered is sent again then, and the caller has to compare.
    """

    def __init__(
        self, path: str, content: bytes, *, now: float, window: int = 5, silent_s: float = 30.0,
        resume: "FtpUpload | None" = None, readable: bool = True,
    ) -> None:  # fmt: skip
        super().__init__(path, now=now, silent_s=silent_s)
        self.content, self.window = content, max(1, window)
        self._readable = readable
        self._count = math.ceil(len(content) / DATA_BYTES)
        goes_on = resume is not None and (resume.path, resume.content) == (path, content)
        self._across: set[int] = set(resume._across) if goes_on and resume is not None else set()
        self._begun = bool(self._across)
        self._todo: deque[int] = deque(piece for piece in range(self._count) if piece not in self._across)
        self._unsure: set[int] = set()
        self._sent = FtpWindow(self._waits)
        self._open()

    @property
    def _end(self) -> FtpState:
        return FtpState.CHECKING if self._readable else FtpState.DONE

    @property
    def across_bytes(self) -> int:
        """Bytes that are known to be across."""
        return min(len(self.content), len(self._across) * DATA_BYTES)

    def _take_answer(self, answer: FtpMessage, now: float) -> None:
        wanted = FtpOperation.READ_FILE if self.state is FtpState.PROBING else FtpOperation.WRITE_FILE
        if answer.answers != wanted:
            return
        piece = self._sent.take((answer.seq - 1) % 65536, now)
        if piece is not None:
            self._heard_at_s = now
            self._take_piece(answer, piece)

    # Opening, closing, comparing.

    def _open(self) -> None:
        # The session may be open from an upload that gave up: it is closed first, see _take_control.
        self._ask(FtpOperation.OPEN_FILE_WO if self._begun else FtpOperation.CREATE_FILE, FtpState.WRITING)

    def _take_success(self, answer: FtpMessage, operation: FtpOperation, then: FtpState, now: float) -> None:
        del now
        if operation != FtpOperation.CALC_FILE_CRC32:
            self._session, self._begun = answer.session, True
            self.state = then
        elif not self._ends_equal(int.from_bytes(answer.data[:4], "little"), crc32(self.content)):
            self._across.clear()  # from the beginning: something that counted as across is not
            self._begun = False
            self._todo = deque(range(self._count))
            self._go(FtpState.WRITING)

    def _go(self, then: FtpState) -> None:
        self.state = then
        if then is FtpState.PROBING:
            self._ask(FtpOperation.OPEN_FILE_RO, then)
        elif then is FtpState.CHECKING:
            self._ask(FtpOperation.CALC_FILE_CRC32, then)
        elif then is not FtpState.DONE:
            self._open()

    def _close(self, then: FtpState) -> None:
        self._sent.clear()
        self.state = FtpState.CLOSING
        self._ask(FtpOperation.TERMINATE_SESSION, then, session=self._session)

    # Pieces and probes: a window of them.

    def _pieces_due_at_s(self) -> float | None:
        return self._sent.next_timer()

    def _piece_requests(self, now: float) -> list[FtpMessage]:
        for piece in self._sent.lost(now):  # a piece without an answer in time is unsure then, a probe is repeated
            if self.state is FtpState.PROBING:
                self._todo.append(piece)
            else:
                self._unsure.add(piece)
        out: list[FtpMessage] = []
        while len(self._sent) < self.window:
            if not self._todo:
                if self._sent:
                    break
                self._end_pass()
                if self.state not in (FtpState.WRITING, FtpState.PROBING):  # it closes the file first
                    return [*out, *self.messages_to_send(now)]
                continue
            piece = self._todo.popleft()
            if piece in self._across or (self.state is FtpState.PROBING and piece in self._unsure):
                continue
            seq = self._next_seq()
            self._sent.add(seq, piece, now)
            out.append(self._piece_request(seq, piece))
        return out

    def _piece_request(self, seq: int, piece: int) -> FtpMessage:
        start = piece * DATA_BYTES
        if self.state is FtpState.WRITING:
            data = self.content[start : start + DATA_BYTES]
            return FtpMessage(seq, FtpOperation.WRITE_FILE, self._session, start, data)
        at, proof = self._proof_of(piece)
        return FtpMessage(seq, FtpOperation.READ_FILE, self._session, start + at, size=len(proof))

    def _take_piece(self, answer: FtpMessage, piece: int) -> None:
        error = answer.error
        writing = answer.answers == FtpOperation.WRITE_FILE
        if error is None and writing:
            self._across.add(piece)
        elif error is None:
            (self._across if answer.data == self._proof_of(piece)[1] else self._unsure).add(piece)
        elif error == FtpError.END_OF_FILE and not writing:
            self._unsure.add(piece)
        elif error in (FtpError.FILE_NOT_FOUND, FtpError.INVALID_SESSION):  # the vehicle was restarted
            if not self._readable:  # nothing is kept of a list that was not closed
                self._across.clear()
                self._begun = False
            self._todo = deque(other for other in range(self._count) if other not in self._across)
            self._unsure.clear()
            self._close(FtpState.WRITING)
        else:
            self._refuse(f"byte {piece * DATA_BYTES}: {answer.error_text}")

    def _end_pass(self) -> None:
        unsure, self._unsure = sorted(self._unsure - self._across), set()
        if not unsure:
            done = len(self._across) == self._count
            self._todo = deque(piece for piece in range(self._count) if piece not in self._across)
            self._close(self._end if done else FtpState.WRITING)
        elif self.state is FtpState.PROBING:  # these are missing for certain
            self._todo = deque(piece for piece in range(self._count) if piece not in self._across)
            self._close(FtpState.WRITING)
        else:
            provable = [piece for piece in unsure if any(self._proof_of(piece)[1])]
            if not self._readable or len(provable) <= max(FILES.few_pieces, FILES.small_fraction * self._count):
                self._todo = deque(unsure)
            else:
                self._todo = deque(provable)
                self._close(FtpState.PROBING)

    def _proof_of(self, piece: int) -> tuple[int, bytes]:
        """Bytes that identify a piece, and their position in it: the last ones that are not all zero."""
        data = self.content[piece * DATA_BYTES : (piece + 1) * DATA_BYTES]
        end = len(data.rstrip(b"\0")) or len(data)
        start = max(0, end - FILES.proving_pieces)
        return start, data[start:end]

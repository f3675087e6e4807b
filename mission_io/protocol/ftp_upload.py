"""Upload of a file by MAVLink FTP: a window of pieces, and cheap questions instead of repetitions.

An answer that is lost says nothing of its piece. Sending every unanswered piece again would cost 1 / (1 - loss)² of the line
where 1 / (1 - loss) is needed. So pieces are sent in passes, each once; then the file is opened for reading, and for each piece
without an answer its last bytes are read, which costs a tenth of sending it. What is missing makes the next pass. The
CRC of the whole file decides at the end. After a pause of the link, or a restart of the vehicle, it goes on where it was.
"""

import math
from collections import deque

from mission_io.protocol.ftp import (
    DATA_BYTES,
    FtpError,
    FtpMessage,
    FtpOperation,
    FtpState,
    FtpTransfer,
    FtpWindow,
    crc32,
)
from mission_io.protocol.timing import FILES


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
            if not self._readable or len(provable) <= max(FILES.few_pieces, FILES.small_share * self._count):
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

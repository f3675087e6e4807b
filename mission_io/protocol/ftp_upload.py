"""Upload of a file by MAVLink FTP: a window of pieces, and cheap questions instead of repetitions.

An answer that is lost says nothing of its piece. Sending every unanswered piece again would cost 1 / (1 - loss)² of the line
where 1 / (1 - loss) is needed. So pieces are sent in passes, each once; then the file is opened for reading, and for each piece
without an answer its last bytes are read, which costs a tenth of sending it. What is missing makes the next pass. The
CRC of the whole file decides at the end. After a pause of the link, or a restart of the vehicle, it goes on where it was.
"""

import math
from collections import deque
from enum import Enum

from mission_io.protocol.ftp import DATA_BYTES, FtpError, FtpMessage, FtpOperation, crc32, path_bytes
from mission_io.protocol.ftp_window import FtpQuestion, FtpWaits, FtpWindow
from mission_io.protocol.tuning import FILES


class FtpUploadState(Enum):
    """Where an upload is."""

    OPENING = "opening"
    WRITING = "writing"
    PROBING = "finding out what is missing"
    CLOSING = "closing"
    CHECKING = "comparing the CRC"
    DONE = "done"
    REFUSED = "refused"
    DIFFERS = "arrived with a different CRC"
    SILENT = "silent"


class FtpUpload:
    """One file on its way to a vehicle; sans-IO.

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
        self.path, self.content, self.window, self.silent_s = path, content, max(1, window), silent_s
        self.state = FtpUploadState.OPENING
        self.why = ""
        self._readable = readable
        self._count = math.ceil(len(content) / DATA_BYTES)
        goes_on = resume is not None and (resume.path, resume.content) == (path, content)
        self._across: set[int] = set(resume._across) if goes_on and resume is not None else set()
        self._begun = bool(self._across)
        self._todo: deque[int] = deque(piece for piece in range(self._count) if piece not in self._across)
        self._unsure: set[int] = set()
        self._path = path_bytes(path)
        # A server answers a repeated number as it did before, and an earlier transfer may have ended with any.
        self._session, self._seq = 0, round(now * 1000.0) % 65536
        self._waits = FtpWaits()
        self._question: tuple[FtpQuestion, FtpUploadState] | None = None
        self._sent = FtpWindow(self._waits)
        self._heard_at_s = now
        self._crc_tries = 0
        self._after_close = FtpUploadState.WRITING
        self._ask(self._open_request(), FtpUploadState.WRITING)

    @property
    def finished(self) -> bool:
        """Whether it has ended, well or not."""
        return self.state in (
            FtpUploadState.DONE, FtpUploadState.REFUSED, FtpUploadState.DIFFERS, FtpUploadState.SILENT,
        )  # fmt: skip

    @property
    def _end(self) -> FtpUploadState:
        return FtpUploadState.CHECKING if self._readable else FtpUploadState.DONE

    @property
    def across_bytes(self) -> int:
        """Bytes that are known to be across."""
        return min(len(self.content), len(self._across) * DATA_BYTES)

    def messages_to_send(self, now: float) -> list[FtpMessage]:
        """Messages to send at ``now``."""
        if self.finished:
            return []
        if now >= self._heard_at_s + self.silent_s:
            self.state, self.why = FtpUploadState.SILENT, f"no answer for {self.silent_s:g} s"
            return []
        if self._question is not None:
            return self._question[0].messages_to_send(now)
        self._settle_late(now)
        return self._next_pieces(now)

    def next_timer(self) -> float | None:
        """When it wants to be asked again; None when it has ended."""
        if self.finished:
            return None
        silent_at_s = self._heard_at_s + self.silent_s
        due_at_s = self._sent.next_timer() if self._question is None else self._question[0].next_timer
        return silent_at_s if due_at_s is None else min(silent_at_s, due_at_s)

    def receive(self, payload: bytes, now: float) -> None:
        """Take the payload of an answer."""
        answer = FtpMessage.answer(payload)
        if self.finished or answer is None:
            return
        if self._question is not None:
            question, then = self._question
            if question.is_answered_by(answer, now):
                self._heard_at_s = now
                self._take_control(answer, question.request, then)
            return
        wanted = FtpOperation.READ_FILE if self.state is FtpUploadState.PROBING else FtpOperation.WRITE_FILE
        if answer.answers != wanted:
            return
        piece = self._sent.take((answer.seq - 1) % 65536, now)
        if piece is not None:
            self._heard_at_s = now
            self._take_piece(answer, piece)

    # Opening, closing, comparing: one request at a time, until it is answered.

    def _ask(self, request: FtpMessage, then: FtpUploadState) -> None:
        self._question = FtpQuestion(request, self._waits), then

    def _next_seq(self) -> int:
        self._seq = (self._seq + 1) % 65536
        return self._seq

    def _open_request(self) -> FtpMessage:
        # The session may be open from an upload that gave up: it is closed first, see _take_control.
        operation = FtpOperation.OPEN_FILE_WO if self._begun else FtpOperation.CREATE_FILE
        return FtpMessage(self._next_seq(), operation, data=self._path)

    def _take_control(self, answer: FtpMessage, request: FtpMessage, then: FtpUploadState) -> None:
        self._question = None
        error = answer.error
        if request.operation in (FtpOperation.TERMINATE_SESSION, FtpOperation.RESET_SESSIONS):
            self._go(then)
        elif error is None and request.operation == FtpOperation.CALC_FILE_CRC32:
            self._compare(int.from_bytes(answer.data[:4], "little"))
        elif error is None:
            self._session, self._begun = answer.session, True
            self.state = then
        elif error in (FtpError.FAIL, FtpError.NO_SESSIONS_AVAILABLE) and not self.why:
            self.why = "a file was open"  # perhaps ours, from before
            self._ask(FtpMessage(self._next_seq(), FtpOperation.RESET_SESSIONS), self.state)
        else:
            self.state, self.why = (
                FtpUploadState.REFUSED,
                f"{FtpOperation(request.operation).name}: {answer.error_text}",
            )

    def _go(self, then: FtpUploadState) -> None:
        self.state = then
        match then:
            case FtpUploadState.PROBING:
                self._ask(FtpMessage(self._next_seq(), FtpOperation.OPEN_FILE_RO, data=self._path), then)
            case FtpUploadState.DONE:
                pass
            case FtpUploadState.CHECKING:
                self._ask(FtpMessage(self._next_seq(), FtpOperation.CALC_FILE_CRC32, data=self._path), then)
            case _:
                self._ask(self._open_request(), FtpUploadState.WRITING)

    def _close(self, then: FtpUploadState) -> None:
        self._sent.clear()
        self.state = FtpUploadState.CLOSING
        self._ask(FtpMessage(self._next_seq(), FtpOperation.TERMINATE_SESSION, self._session), then)

    def _compare(self, found: int) -> None:
        if found == crc32(self.content):
            self.state = FtpUploadState.DONE
            return
        self._crc_tries += 1
        if self._crc_tries >= FILES.tries_of_crc:
            self.state = FtpUploadState.DIFFERS
            self.why = f"CRC {found:08x} instead of {crc32(self.content):08x} after {self._crc_tries} tries"
            return
        self._across.clear()  # from the beginning: something that counted as across is not
        self._begun = False
        self._todo = deque(range(self._count))
        self._go(FtpUploadState.WRITING)

    # Pieces and probes: a window of them.

    def _next_pieces(self, now: float) -> list[FtpMessage]:
        out: list[FtpMessage] = []
        while len(self._sent) < self.window:
            if not self._todo:
                if self._sent:
                    break
                self._end_pass()
                if self.state not in (FtpUploadState.WRITING, FtpUploadState.PROBING):  # it closes the file first
                    return [*out, *self.messages_to_send(now)]
                continue
            piece = self._todo.popleft()
            if piece in self._across or (self.state is FtpUploadState.PROBING and piece in self._unsure):
                continue
            seq = self._next_seq()
            self._sent.add(seq, piece, now)
            out.append(self._piece_request(seq, piece))
        return out

    def _piece_request(self, seq: int, piece: int) -> FtpMessage:
        start = piece * DATA_BYTES
        data = self.content[start : start + DATA_BYTES]
        if self.state is FtpUploadState.WRITING:
            return FtpMessage(seq, FtpOperation.WRITE_FILE, self._session, start, data)
        at, proof = _proof(data)
        return FtpMessage(seq, FtpOperation.READ_FILE, self._session, start + at, size=len(proof))

    def _take_piece(self, answer: FtpMessage, piece: int) -> None:
        error = answer.error
        writing = answer.answers == FtpOperation.WRITE_FILE
        if error is None and writing:
            self._across.add(piece)
        elif error is None:
            start = piece * DATA_BYTES
            _, proof = _proof(self.content[start : start + DATA_BYTES])
            if answer.data == proof:
                self._across.add(piece)
            else:
                self._unsure.add(piece)
        elif error == FtpError.END_OF_FILE and not writing:
            self._unsure.add(piece)
        elif error in (FtpError.FILE_NOT_FOUND, FtpError.INVALID_SESSION):  # the vehicle was restarted
            if not self._readable:  # nothing is kept of a list that was not closed
                self._across.clear()
                self._begun = False
            self._todo = deque(other for other in range(self._count) if other not in self._across)
            self._unsure.clear()
            self._close(FtpUploadState.WRITING)
        else:
            self.state, self.why = FtpUploadState.REFUSED, f"byte {piece * DATA_BYTES}: {answer.error_text}"

    def _settle_late(self, now: float) -> None:
        """Settle requests without an answer in time: a piece is unsure then, a probe is repeated."""
        for piece in self._sent.lost(now):
            if self.state is FtpUploadState.PROBING:
                self._todo.append(piece)
            else:
                self._unsure.add(piece)

    def _end_pass(self) -> None:
        unsure, self._unsure = sorted(self._unsure - self._across), set()
        if not unsure:
            done = len(self._across) == self._count
            self._todo = deque(piece for piece in range(self._count) if piece not in self._across)
            self._close(self._end if done else FtpUploadState.WRITING)
        elif self.state is FtpUploadState.PROBING:  # these are missing for certain
            self._todo = deque(piece for piece in range(self._count) if piece not in self._across)
            self._close(FtpUploadState.WRITING)
        else:
            provable = [piece for piece in unsure if any(self._proof_of(piece))]
            if not self._readable or len(provable) <= max(FILES.few_pieces, FILES.small_share * self._count):
                self._todo = deque(unsure)
            else:
                self._todo = deque(provable)
                self._close(FtpUploadState.PROBING)

    def _proof_of(self, piece: int) -> bytes:
        return _proof(self.content[piece * DATA_BYTES : (piece + 1) * DATA_BYTES])[1]


def _proof(data: bytes) -> tuple[int, bytes]:
    """Bytes that identify a piece, and their position in it: the last ones that are not all zero."""
    end = len(data.rstrip(b"\0")) or len(data)
    start = max(0, end - FILES.proving_pieces)
    return start, data[start:end]

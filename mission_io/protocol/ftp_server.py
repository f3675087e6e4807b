"""A vehicle's side of MAVLink FTP, with files in memory: one open file, as ArduPilot has it."""

import struct
from collections.abc import MutableMapping
from typing import Protocol

from mission_io.errors import FormatError
from mission_io.protocol.ftp import DATA_BYTES, FtpError, FtpMessage, FtpOperation, crc32
from mission_io.protocol.timing import FILES

MAX_FILE_BYTES = 64 * 1024 * 1024


class MadeFiles(Protocol):
    """Files that a vehicle makes when they are opened, and takes apart when they are closed."""

    def read(self, path: str) -> bytes | None:
        """Current content of a file; None for one that is on the card."""
        ...

    def written(self, path: str, content: bytes) -> None:
        """Take a file that was written and closed."""
        ...


class FtpServer:
    """Answers requests; lost answers are given again for a repeated sequence number."""

    def __init__(
        self,
        files: MutableMapping[str, bytearray] | None = None,  # content by path; paths begin as the reader writes them
        *,
        burst: int = FILES.burst,  # answers in a burst
        made: MadeFiles | None = None,  # files that are made when they are opened
    ) -> None:
        self._made = made
        self._burst_length = burst
        self.files: MutableMapping[str, bytearray] = {} if files is None else files
        self._open: str | None = None
        self._writes = False
        self._session = 0
        self._last: tuple[int, list[FtpMessage]] | None = None

    def answer(self, payload: bytes) -> list[bytes]:
        """The payloads that answer one; none for what is no request. Never raises on what a peer sent."""
        try:
            request = FtpMessage.decoded(payload)
        except FormatError:
            return []
        if request.operation in (FtpOperation.ACK, FtpOperation.NAK):
            return []
        if self._last is not None and self._last[0] == request.seq:
            return [answer.encoded() for answer in self._last[1]]
        answers = self._answers(request)
        self._last = request.seq, answers
        return [answer.encoded() for answer in answers]

    def restart(self) -> None:
        """Close what is open, as after a reboot; files stay."""
        self._open, self._last = None, None

    def _answers(self, request: FtpMessage) -> list[FtpMessage]:
        path = request.data.split(b"\0", 1)[0].decode("utf-8", errors="replace")
        match request.operation:
            case FtpOperation.TERMINATE_SESSION | FtpOperation.RESET_SESSIONS:
                self._close()
                return [self._ack(request)]
            case FtpOperation.OPEN_FILE_RO | FtpOperation.OPEN_FILE_WO | FtpOperation.CREATE_FILE:
                return [self._opened(request, path)]
            case FtpOperation.READ_FILE:
                return [self._read(request)]
            case FtpOperation.BURST_READ_FILE:
                return self._burst(request)
            case FtpOperation.WRITE_FILE:
                return [self._written(request)]
            case FtpOperation.REMOVE_FILE:
                if self.files.pop(path, None) is None:
                    return [self._nak(request, FtpError.FILE_NOT_FOUND)]
                return [self._ack(request)]
            case FtpOperation.CALC_FILE_CRC32:
                self._make(path)
                if path not in self.files:
                    return [self._nak(request, FtpError.FILE_NOT_FOUND)]
                return [self._ack(request, struct.pack("<I", crc32(bytes(self.files[path]))))]
            case FtpOperation.LIST_DIRECTORY:
                return [self._listed(request, path)]
            case FtpOperation.CREATE_DIRECTORY:
                return [self._ack(request)]
        return [self._nak(request, FtpError.UNKNOWN_COMMAND)]

    def _opened(self, request: FtpMessage, path: str) -> FtpMessage:
        if self._open is not None:
            return self._nak(request, FtpError.FAIL)
        if not path:
            return self._nak(request, FtpError.INVALID_DATA_SIZE)
        self._make(path)
        if request.operation == FtpOperation.CREATE_FILE:
            self.files[path] = bytearray()
        elif path not in self.files:
            return self._nak(request, FtpError.FILE_NOT_FOUND)
        self._open, self._session = path, request.session
        self._writes = request.operation != FtpOperation.OPEN_FILE_RO
        return self._ack(request, struct.pack("<I", len(self.files[path])))

    def _make(self, path: str) -> None:
        content = None if self._made is None else self._made.read(path)
        if content is not None:
            self.files[path] = bytearray(content)

    def _close(self) -> None:
        path, self._open = self._open, None
        if path is not None and self._writes and self._made is not None and path in self.files:
            self._made.written(path, bytes(self.files[path]))

    def _read(self, request: FtpMessage) -> FtpMessage:
        content = self._content(request, writing=False)
        if isinstance(content, FtpMessage):
            return content
        data = bytes(content[request.offset : request.offset + min(request.size or DATA_BYTES, DATA_BYTES)])
        return self._ack(request, data) if data else self._nak(request, FtpError.END_OF_FILE)

    def _burst(self, request: FtpMessage) -> list[FtpMessage]:
        content = self._content(request, writing=False)
        if isinstance(content, FtpMessage):
            return [content]
        step = request.size or DATA_BYTES
        starts = range(request.offset, min(len(content), request.offset + self._burst_length * step), step)
        if not starts:
            return [self._nak(request, FtpError.END_OF_FILE)]
        return [
            FtpMessage(
                (request.seq + 1 + number) % 65536, FtpOperation.ACK, request.session, start,
                bytes(content[start : start + step]), answers=request.operation, burst_complete=start == starts[-1],
            )
            for number, start in enumerate(starts)
        ]  # fmt: skip

    def _written(self, request: FtpMessage) -> FtpMessage:
        content = self._content(request, writing=True)
        if isinstance(content, FtpMessage):
            return content
        end = request.offset + len(request.data)
        if end > MAX_FILE_BYTES:
            return self._nak(request, FtpError.FAIL)
        content.extend(bytes(max(0, end - len(content))))
        content[request.offset : end] = request.data
        return self._ack(request)

    def _content(self, request: FtpMessage, *, writing: bool) -> "bytearray | FtpMessage":
        if self._open is None or self._open not in self.files:
            return self._nak(request, FtpError.FILE_NOT_FOUND)
        if request.session != self._session:
            return self._nak(request, FtpError.INVALID_SESSION)
        if writing != self._writes:
            return self._nak(request, FtpError.FAIL)
        return self.files[self._open]

    def _listed(self, request: FtpMessage, path: str) -> FtpMessage:
        folder = path.rstrip("/") + "/"
        inside = {name[len(folder) :] for name in self.files if name.startswith(folder)}
        if not inside and folder != "/":
            return self._nak(request, FtpError.FILE_NOT_FOUND)
        entries = sorted(
            {f"D{name.split('/')[0]}" for name in inside if "/" in name}
            | {f"F{name}\t{len(self.files[folder + name])}" for name in inside if "/" not in name}
        )
        data = b""
        for entry in entries[request.offset :]:
            if len(data) + len(entry.encode()) + 1 > DATA_BYTES:
                break
            data += entry.encode() + b"\0"
        return self._ack(request, data) if data else self._nak(request, FtpError.END_OF_FILE)

    def _ack(self, request: FtpMessage, data: bytes = b"") -> FtpMessage:
        seq = (request.seq + 1) % 65536
        return FtpMessage(
            seq, FtpOperation.ACK, request.session, request.offset, data, answers=request.operation
        )  # fmt: skip

    def _nak(self, request: FtpMessage, error: FtpError) -> FtpMessage:
        seq = (request.seq + 1) % 65536
        return FtpMessage(seq, FtpOperation.NAK, request.session, 0, bytes([error]), answers=request.operation)

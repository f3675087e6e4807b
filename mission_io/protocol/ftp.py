"""MAVLink FTP: the payload of FILE_TRANSFER_PROTOCOL, its operations and errors, and a vehicle's side of it.

A payload is little-endian: sequence number (16 bits), session, operation, size of the data, operation that is answered, whether a
burst is complete, padding, offset (32 bits), up to 239 bytes of data. An answer has the request's sequence number plus one.
"""

import struct
import zlib
from collections.abc import MutableMapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol

from mission_io.errors import FormatError, MisuseError
from mission_io.protocol.timing import FILES

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
    OPEN_FILE_WO = 11
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
        """The ACK or NAK in a payload; empty for anything else, and for a payload that cannot be."""
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
        """The error as text."""
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


# A vehicle's side of MAVLink FTP, with files in memory: one open file, as ArduPilot has it.

MAX_FILE_BYTES = 64 * 1024 * 1024


class MadeFiles(Protocol):
    """Files that a vehicle makes when they are opened, and takes apart when they are closed."""

    def read(self, path: str) -> bytes | None:
        """Current content of a file; None for one that is on the card."""

    def written(self, path: str, content: bytes) -> None:
        """Receive a file that was written and closed."""


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
        """The payloads that answer one; empty for what is no request. Never raises on what a peer sent."""
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

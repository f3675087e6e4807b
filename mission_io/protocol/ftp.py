"""MAVLink FTP: the payload of FILE_TRANSFER_PROTOCOL, its operations and errors.

A payload is little-endian: sequence number (16 bits), session, operation, size of the data, operation that is answered, whether a
burst is complete, padding, offset (32 bits), up to 239 bytes of data. An answer has the request's sequence number plus one.
"""

import struct
import zlib
from dataclasses import dataclass
from enum import IntEnum

from mission_io.errors import FormatError, MisuseError

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
    """One request or answer.

    Attributes:
        seq: Sequence number, 0 to 65535.
        operation: The request, or ACK or NAK; a number that is no operation stays a number.
        session: The open file that is meant.
        offset: Where in the file, in bytes; in a directory, the entry.
        data: Up to 239 bytes; of a NAK, the error and perhaps the errno.
        size: What the size field says; None is the size of the data. Reading says by it how much is wanted.
        answers: The operation that an answer is for.
        burst_complete: Whether this is the last answer of a burst.
    """

    seq: int
    operation: int
    session: int = 0
    offset: int = 0
    data: bytes = b""
    size: int | None = None
    answers: int = 0
    burst_complete: bool = False

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
        """From a payload.

        Raises:
            FormatError: it says that it has more data than there is room for.
        """
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
    """A path for the wire.

    Raises:
        MisuseError: it is empty, too long, or holds what a path cannot hold.
    """
    data = path.encode("utf-8")
    if not data or len(data) >= DATA_BYTES or b"\0" in data:
        raise MisuseError(f"{path!r} is not a path for a vehicle; use 1 to {DATA_BYTES - 1} bytes without a zero byte")
    return data

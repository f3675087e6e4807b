"""MAVLink 2 signing: only senders with a shared key are accepted on a link.

A signature is the first 48 bits of SHA-256 over key, frame, link id and a timestamp that only increases
(https://mavlink.io/en/guide/message_signing.html). Timestamps count 10 microseconds since 2015-01-01 UTC. Keys, and the
timestamps beside them, are kept in files that only their owner may read.
"""

import hashlib
import hmac
import os
import stat
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Final, Protocol, Self

from mission_io.errors import LinkError, MisuseError
from mission_io.wire.messages import WireFrame

TIMESTAMP_SUFFIX: Final = ".timestamp"


class UnixClock(Protocol):
    """The time of day, which users may set."""

    def unix_s(self) -> float:
        """Seconds since 1970-01-01 UTC."""


class SystemClock:
    """The operating system's time of day."""

    def unix_s(self) -> float:
        """Seconds since 1970-01-01 UTC."""
        return time.time()


def read_private(path: Path, *, what: str, largest: int) -> bytes:
    """The content of a file that only its owner may read.

    Raises:
        MisuseError: it cannot be read, is not a regular file, is too large, or its group or others may read or write it.
    """
    try:
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
    except OSError as error:
        raise MisuseError(f"cannot read the {what} {path}: {error.strerror}") from None
    try:
        status = os.fstat(handle)
        if not stat.S_ISREG(status.st_mode):
            raise MisuseError(f"cannot read the {what} {path}: this is not a file")
        mode = stat.S_IMODE(status.st_mode)
        if mode & 0o077:
            raise MisuseError(f"other users can access the {what} {path} (mode {mode:03o}); run: chmod 600 {path}")
        content = os.read(handle, largest + 1)
    finally:
        os.close(handle)
    if len(content) > largest:
        raise MisuseError(f"the {what} {path} has more than {largest} bytes; is it the right file?")
    return content


class TimestampFile:
    """Keeps a key's highest timestamp in a file beside it (``KEY.timestamp``), for all programs that use the key.

    Args:
        key_path: The file of the key; locked while the timestamp is changed.
    """

    def __init__(self, key_path: Path) -> None:
        self._key_path = key_path
        self.path = key_path.with_name(key_path.name + TIMESTAMP_SUFFIX)

    def read(self) -> int:
        """The timestamp; 0 without one yet.

        Raises:
            LinkError: the file is there and cannot be read, or holds no number.
        """
        try:
            text = self.path.read_text(encoding="ascii").strip()
        except FileNotFoundError:
            return 0
        except (OSError, UnicodeError) as error:
            raise LinkError(f"cannot read the signing timestamp {self.path}: {error}") from None
        if not (text.isdigit() and int(text) < 2**48):
            raise LinkError(
                f"{self.path} contains no signing timestamp; restore it from a copy, or delete it and create a new key"
            )
        return int(text)

    def raise_to(self, timestamp: int) -> None:
        """Store this timestamp unless a higher one is stored; it is on disk when this returns.

        Raises:
            LinkError: it cannot be written.
        """
        with self._locked():
            if timestamp > self.read():
                self._write(timestamp)

    def settle(self, reserved: int, used: int) -> None:
        """Replace ``reserved`` by ``used``, unless another program has raised it since."""
        with self._locked():
            if self.read() == reserved:
                self._write(used)

    @contextmanager
    def _locked(self) -> Iterator[None]:
        try:
            import fcntl
        except ImportError:  # Windows
            raise MisuseError("signing requires file locks, which this system does not provide") from None
        try:
            handle = os.open(self._key_path, os.O_RDONLY)
        except OSError as error:
            raise LinkError(f"cannot lock the signing key {self._key_path}: {error.strerror}") from None
        try:
            fcntl.flock(handle, fcntl.LOCK_EX)
            yield
        finally:
            os.close(handle)

    def _write(self, timestamp: int) -> None:
        temporary = None
        try:
            handle, temporary = tempfile.mkstemp(dir=self.path.parent, prefix=self.path.name + ".")
            with os.fdopen(handle, "w", encoding="ascii") as file:
                file.write(f"{timestamp}\n")
                file.flush()
                os.fsync(file.fileno())
            os.replace(temporary, self.path)
        except OSError as error:
            if temporary is not None:
                Path(temporary).unlink(missing_ok=True)
            raise LinkError(
                f"cannot write the signing timestamp {self.path}: {error.strerror}; signing requires a saved timestamp"
            ) from None


TICKS_PER_S: Final = 100_000
EPOCH_UNIX_S: Final = 1_420_070_400
"""2015-01-01 00:00 UTC, where timestamps begin, in seconds since 1970."""

NEW_STREAM_TICKS: Final = 60 * TICKS_PER_S
"""How far behind our own time a sender's first timestamp may be."""

UNSIGNED_ALLOWED: Final = frozenset({109, 166})
"""RADIO_STATUS and RADIO: inserted by telemetry radios, which have no key to sign them."""

_RESERVED_TICKS = 5 * TICKS_PER_S
_LATEST = 2**48 - 1
_KEY_SIZE, _DIGEST_SIZE = 32, 6


@dataclass(frozen=True, slots=True)
class SigningKey:
    """The 32-byte key shared by both ends of a signed link. Never shown in text."""

    secret: bytes  # the bytes
    # the file they came from, beside which the timestamps are kept; None for a key that was given otherwise
    path: Path | None = None

    def __post_init__(self) -> None:
        """Refuse a key of another length."""
        if len(self.secret) != _KEY_SIZE:
            raise MisuseError(f"a signing key has {_KEY_SIZE} bytes, but this one has {len(self.secret)}")

    def __repr__(self) -> str:
        return f"SigningKey(path={str(self.path) if self.path is not None else None!r})"

    @classmethod
    def from_passphrase(cls, passphrase: str) -> Self:
        """The key that Mission Planner and MAVProxy make of a passphrase: its SHA-256.

        Raises:
            MisuseError: an empty passphrase.
        """
        if not passphrase:
            raise MisuseError("the signing passphrase is empty")
        return cls(hashlib.sha256(passphrase.encode()).digest())

    @classmethod
    def from_file(cls, path: str | Path) -> Self:
        """Read a key from a file that only its owner may read.

        The file holds 64 hexadecimal digits (the key), or one line of other text (a passphrase), or 32 bytes that are
        no text (the key).

        Raises:
            MisuseError: there is no such file, others may read it, or it holds none of these; the line says what to do.
        """
        path = Path(path)
        content = read_private(path, what="signing key", largest=4096)
        return cls(_secret_in(content, path), path)


class TimestampStore(Protocol):
    """Persistent storage of the highest timestamp used with a key."""

    def read(self) -> int:
        """The timestamp; 0 without one yet."""

    def raise_to(self, timestamp: int) -> None:
        """Store this timestamp unless a higher one is stored."""

    def settle(self, reserved: int, used: int) -> None:
        """Replace ``reserved`` by ``used``, unless another program has raised it since."""


class UnsavedTimestamps:
    """Timestamps kept in memory: for tests, and for a key without a file on a machine with a clock."""

    def __init__(self) -> None:
        self._timestamp = 0

    def read(self) -> int:
        """The timestamp; 0 without one yet."""
        return self._timestamp

    def raise_to(self, timestamp: int) -> None:
        """Store this timestamp unless a higher one is stored."""
        self._timestamp = max(self._timestamp, timestamp)

    def settle(self, reserved: int, used: int) -> None:
        """Replace ``reserved`` by ``used``."""
        if self._timestamp == reserved:
            self._timestamp = used


class SignatureCheck(Enum):
    """Result of checking a frame's signature."""

    ACCEPTED = "accepted"
    UNSIGNED = "unsigned"
    FORGED = "forged"
    REPLAYED = "replayed"


class Signing:
    """Signs what one end of a link sends and checks what it receives.

    Timestamps never repeat, not even after a crash or when the clock goes back: they are reserved in the store some
    seconds ahead before they are used.

    Args:
        key: The shared key.
        clock: The time in seconds since 1970.
        store: Stores the timestamps.
        link_id: Tells apart the links of one sender, 0 to 255.
    """

    def __init__(self, key: SigningKey, *, clock: UnixClock, store: TimestampStore, link_id: int = 0) -> None:
        if not 0 <= link_id <= 255:
            raise MisuseError(f"link_id must be between 0 and 255, not {link_id}")
        self._secret, self._clock, self._store = key.secret, clock, store
        self._link_id = link_id
        self._used = self._reserved = store.read()
        self._heard: dict[tuple[int, int, int], int] = {}

    def signature(self, frame: bytes) -> bytes:
        """The 13 bytes that follow a frame with the signed flag.

        Raises:
            MisuseError: a holder of the key has used the last possible timestamp.
        """
        self._used = max(self._used + 1, self._now())
        if self._used > _LATEST:
            raise MisuseError("no signing timestamps are left for this key; create a new key for both ends")
        if self._used > self._reserved:
            self._reserved = min(self._used + _RESERVED_TICKS, _LATEST)
            self._store.raise_to(self._reserved)
        tail = bytes([self._link_id]) + self._used.to_bytes(6, "little")
        return tail + self._digest(frame + tail)

    def judge(self, frame: WireFrame) -> SignatureCheck:
        """Check a frame's signature; remembers its timestamp if accepted."""
        if not frame.signature:
            return SignatureCheck.ACCEPTED if frame.message_id in UNSIGNED_ALLOWED else SignatureCheck.UNSIGNED
        if not hmac.compare_digest(self._digest(frame.data[:-_DIGEST_SIZE]), frame.data[-_DIGEST_SIZE:]):
            return SignatureCheck.FORGED
        stream = (frame.system_id, frame.component_id, frame.signature[0])
        timestamp = int.from_bytes(frame.signature[1:7], "little")
        newest = self._heard.get(stream)
        oldest = max(self._used, self._now()) - NEW_STREAM_TICKS if newest is None else newest + 1
        if timestamp < oldest:
            return SignatureCheck.REPLAYED
        self._heard[stream] = timestamp
        self._used = max(self._used, timestamp)
        return SignatureCheck.ACCEPTED

    def close(self) -> None:
        """Give back the timestamps that were reserved and not used."""
        if self._reserved > self._used:
            self._store.settle(self._reserved, self._used)
            self._reserved = self._used

    def _now(self) -> int:
        return int((self._clock.unix_s() - EPOCH_UNIX_S) * TICKS_PER_S)

    def _digest(self, data: bytes) -> bytes:
        return hashlib.sha256(self._secret + data).digest()[:_DIGEST_SIZE]


def _secret_in(content: bytes, path: Path) -> bytes:
    """The key in a file's content."""
    try:
        text = content.decode()
    except UnicodeDecodeError:
        text = None
    printable = text is not None and text.rstrip("\r\n").isprintable()
    if text is None or not printable:
        if len(content) == _KEY_SIZE:
            return content
        raise MisuseError(
            f"{path}: it must have {_KEY_SIZE} bytes, {2 * _KEY_SIZE} hexadecimal digits, or a passphrase"
        )
    line = text.rstrip("\r\n")
    if len(content) == _KEY_SIZE:
        raise MisuseError(
            f"{path}: {_KEY_SIZE} letters can be a key or a passphrase; end a passphrase with a line break, or write "
            f"the key as {2 * _KEY_SIZE} hexadecimal digits"
        )
    if len(line) == 2 * _KEY_SIZE and all(letter in "0123456789abcdefABCDEF" for letter in line):
        return bytes.fromhex(line)
    if not line:
        raise MisuseError(f"{path}: the file is empty; write a passphrase or {2 * _KEY_SIZE} hexadecimal digits to it")
    return SigningKey.from_passphrase(line).secret

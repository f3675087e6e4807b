"""Files that are nobody else's business: signing keys, and the timestamps beside them."""

import os
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from mission_io.errors import LinkError, MisuseError

TIMESTAMP_SUFFIX: Final = ".timestamp"


def read_private(path: Path, *, what: str, largest: int) -> bytes:
    """The content of a file that only its owner may read.

    Args:
        path: The file.
        what: What it is, for the error.
        largest: More bytes than this are refused.

    Raises:
        MisuseError: it cannot be read, is no file, is too large, or its group or others may read or write it.
    """
    try:
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
    except OSError as error:
        raise MisuseError(f"cannot read the {what} {path}: {error.strerror}") from None
    try:
        status = os.fstat(handle)
        if not stat.S_ISREG(status.st_mode):
            raise MisuseError(f"cannot read the {what} {path}: it is no file")
        mode = stat.S_IMODE(status.st_mode)
        if mode & 0o077:
            raise MisuseError(f"others may read or write the {what} {path} (mode {mode:03o}); run: chmod 600 {path}")
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
        """The timestamp; 0 when there is none yet.

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
                f"{self.path} holds no signing timestamp; put it back from a copy, or delete it and make a new key"
            )
        return int(text)

    def raise_to(self, timestamp: int) -> None:
        """Keep this one unless a higher one is kept already; it is on the disk when this returns.

        Raises:
            LinkError: it cannot be written.
        """
        with self._locked():
            if timestamp > self.read():
                self._write(timestamp)

    def settle(self, reserved: int, used: int) -> None:
        """Keep ``used`` in the place of ``reserved``, unless another program has raised it since."""
        with self._locked():
            if self.read() == reserved:
                self._write(used)

    @contextmanager
    def _locked(self) -> Iterator[None]:
        try:
            import fcntl
        except ImportError:  # Windows
            raise MisuseError("signing needs file locks, which this system has not") from None
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
                f"cannot write the signing timestamp {self.path}: {error.strerror}; signing must remember it"
            ) from None

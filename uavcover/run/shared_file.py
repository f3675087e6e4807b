"""Input of all workers of this machine in one file that they map into memory: large arrays exist once.

The file has no name: it is gone with the command that wrote it, also when that is killed. Workers open it by the number that
it has in the command (Linux).
"""

import hashlib
import mmap
import os
import pickle
import struct
import sys
import tempfile
from dataclasses import dataclass
from typing import IO, Any

from uavcover.errors import UavcoverError

_LARGE_BYTES = 65_536
_ALIGNED = 64
_COUNT = struct.Struct("<Q")


@dataclass(frozen=True, slots=True)
class SharedFile:
    """A file with an object."""

    file: IO[bytes]  # open in this process; the object can be read while it is
    sha256: str  # of its content
    size: int  # in bytes

    @property
    def path(self) -> str:
        """By which other processes of this user open it."""
        return f"/proc/{os.getpid()}/fd/{self.file.fileno()}"


def can_share_files() -> bool:
    """Whether processes of this machine can open each other's files without a name."""
    return sys.platform == "linux" and os.path.isdir(f"/proc/{os.getpid()}/fd")


def share(value: object) -> SharedFile:
    """Write an object into a file without a name; close it after the last worker has opened it.

    Large read-only arrays lie in it as they are; each reader copies the others, and may change them.

    Raises:
        UavcoverError: there is no room for it.
    """
    large: list[memoryview] = []

    def is_copied(buffer: pickle.PickleBuffer) -> bool:
        raw = buffer.raw()
        if not raw.readonly or raw.nbytes < _LARGE_BYTES:
            return True
        large.append(raw)
        return False

    content = pickle.dumps(value, protocol=5, buffer_callback=is_copied)
    head = b"".join(_COUNT.pack(each) for each in (len(large), len(content), *(raw.nbytes for raw in large)))
    found, size = hashlib.sha256(), 0
    file = tempfile.TemporaryFile()  # noqa: SIM115, it outlives this function
    try:
        pieces: list[bytes | memoryview] = [head, content, *large]
        for piece in pieces:
            gap = bytes(-len(piece) % _ALIGNED)
            for part in (piece, gap):
                file.write(part)
                found.update(part)
            size += len(piece) + len(gap)
        file.flush()
    except OSError as error:
        file.close()
        raise UavcoverError(
            f"--scheduler: cannot write the data for the workers to {tempfile.gettempdir()} "
            f"({error.strerror}); free some space, or "
            "set TMPDIR to another folder"
        ) from error
    return SharedFile(file, found.hexdigest(), size)


def read_shared(path: str) -> Any:
    """Read the object; its large arrays are the file itself, mapped into memory, and read-only."""
    with open(path, "rb") as file:
        mapped = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
    count, length = (each for (each,) in _COUNT.iter_unpack(mapped[: 2 * _COUNT.size]))
    sizes = [each for (each,) in _COUNT.iter_unpack(mapped[2 * _COUNT.size : (2 + count) * _COUNT.size])]
    at = 0
    pieces = []
    for size in ((2 + count) * _COUNT.size, length, *sizes):
        pieces.append(mapped[at : at + size])
        at += size + -size % _ALIGNED
    return pickle.loads(pieces[1], buffers=pieces[2:])

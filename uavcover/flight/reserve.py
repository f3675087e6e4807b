"""Space on the disk that is kept free for the record of a flight, so that nothing else can take it meanwhile."""

import errno
import os
import shutil
import tempfile
from pathlib import Path
from typing import Final, Self

from uavcover.errors import OutputError

SAMPLE_BYTES: Final = 2000
"""What a sample takes in track, telemetry log and both recordings together: measured 1.4 kB at 7 samples a second."""
SAMPLES_PER_S: Final = 10.0
"""As often as positions are asked for."""
_LONGER, _SPARE_S = 2.0, 900.0
"""A flight may take longer than reckoned, and has ways there and home."""
_NO_ROOM = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})


def record_bytes(flight_time_s: float) -> int:
    """How much the record of a flight takes at most, in bytes, from the time that it is reckoned to take."""
    return int((_LONGER * flight_time_s + _SPARE_S) * SAMPLES_PER_S * SAMPLE_BYTES)


class SpaceReserve:
    """Space in a folder that belongs to nobody else until it is released. A context manager.

    It is a file without a name, so a program that is killed leaves nothing behind. Where the operating system cannot reserve,
    the free space is only looked at.

    Args:
        folder: where.
        size_bytes: how much.

    Raises:
        OutputError: there is not so much room.
    """

    def __init__(self, folder: Path, size_bytes: int) -> None:
        self._descriptor: int | None = None
        try:
            if hasattr(os, "posix_fallocate"):
                with tempfile.TemporaryFile(dir=folder) as file:
                    os.posix_fallocate(file.fileno(), 0, size_bytes)
                    self._descriptor = os.dup(file.fileno())
            elif shutil.disk_usage(folder).free < size_bytes:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        except OSError as error:
            if error.errno in _NO_ROOM:
                raise OutputError(
                    f"{folder}: no room for the record of the flight, which may take {size_bytes / 1e6:.0f} MB "
                    f"({error.strerror}); free some space or choose another folder; nothing was armed"
                ) from None
            if shutil.disk_usage(folder).free < size_bytes:
                raise OutputError(
                    f"{folder}: {size_bytes / 1e6:.0f} MB for the record of the flight cannot be reserved ({error.strerror})"
                ) from None

    @property
    def held(self) -> bool:
        """Whether it still keeps space free."""
        return self._descriptor is not None

    def release(self) -> None:
        """Give the space free; a second time is fine."""
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

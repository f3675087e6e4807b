"""Reads a log of other software, chosen by file suffix: a format is one module and one row of ``READERS``.

Our own ``.csv`` and ``.rrd`` are read by :func:`uavcover.verification.run_logs.read_log`.
"""

from collections.abc import Callable
from pathlib import Path

from uavcover.errors import InputError, TrackError
from uavcover.model.track import ReadTrack
from uavcover.plugins import load, registered
from uavcover.terrain.frames import LocalFrame
from uavcover.verification.track_logs.assembly import LoggedRows, assemble_track
from uavcover.verification.track_logs.dataflash import read_dataflash
from uavcover.verification.track_logs.gpx import read_gpx
from uavcover.verification.track_logs.telemetry import read_telemetry
from uavcover.verification.track_logs.ulog import read_ulog


def _of_plugin(name: str) -> Callable[[Path], LoggedRows]:
    """The reader of an installed package, loaded when its first log is read."""

    def read(path: Path) -> LoggedRows:
        try:
            rows: LoggedRows = load("uavcover.log_readers", name)(path)
        except InputError as error:
            raise TrackError(f"{path}: {error}") from error
        return rows

    return read


READERS: dict[str, Callable[[Path], LoggedRows]] = {
    **{f".{name}": _of_plugin(name) for name in registered("uavcover.log_readers")},
    ".bin": read_dataflash,
    ".tlog": read_telemetry,
    ".ulg": read_ulog,
    ".gpx": read_gpx,
}
"""By suffix; a package of a third party cannot replace a reader of ours."""


def read_foreign_log(path: Path, frame: LocalFrame, *, system: int | None = None) -> ReadTrack:
    """Read the track of a log in the local frame.

    The suffix, in upper or lower case, is one of READERS.

    Args:
        path: the log.
        frame: the local frame.
        system: whose track it is, where a telemetry log has several vehicles; none: the only one's.

    Raises:
        TrackError: another suffix, or a file that cannot be read, is no such log or has no positions.
    """
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise TrackError(
            f"{path}: {path.suffix or 'no ending'} is not a log that can be read; known: {', '.join(READERS)}"
        )
    try:
        rows = read_telemetry(path, system=system) if reader is read_telemetry else reader(path)
    except OSError as error:
        raise TrackError(f"{path}: cannot be read: {error.strerror}") from None
    return assemble_track(path, rows, frame)

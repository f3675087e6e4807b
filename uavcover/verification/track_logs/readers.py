"""Reads a log of other software, chosen by file suffix: a format is one module and one row of ``READERS``.

Our own ``.csv`` and ``.rrd`` are read by :func:`uavcover.verification.run_logs.read_log`.
"""

import datetime
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from uavcover.errors import InputError, TrackError
from uavcover.model.track import ReadTrack
from uavcover.plugins import load, registered
from uavcover.terrain.frames import LocalFrame
from uavcover.verification.track_logs.assembly import LoggedRows, assemble_track
from uavcover.verification.track_logs.mavlink_logs import read_dataflash, read_telemetry
from uavcover.verification.track_logs.ulog import read_ulog


def read_gpx(path: Path) -> LoggedRows:
    """Read the points of all tracks and segments of a GPX 1.0 or 1.1 file.

    Time counts from the first one.

    ``ele`` is a height above sea level by the standard; a warning says that this is assumed.

    Raises:
        TrackError: not such a file; a point has no height or time, or one that is not a number.
    """
    text = path.read_bytes()
    if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
        raise TrackError(f"{path}: a GPX file must not contain a document type or entities; remove them")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise TrackError(f"{path}: cannot read the file as GPX: {error}") from None
    if _name(root) != "gpx":
        raise TrackError(f"{path}: this is not a GPX file, because its root element is <{_name(root)}>")
    points = list(_points(path, root))
    if not points:
        raise TrackError(f"{path}: the file contains no track points")
    positions = np.array(points)
    clock = np.array([[0.0, positions[0, 0]]])
    positions[:, 0] -= positions[0, 0]
    warning = (
        f"{path}: uavcover interprets the heights as above sea level, as the GPX standard requires; some loggers "
        "write ellipsoid heights"
    )
    return LoggedRows(positions, np.empty((0, 4)), warnings=(warning,), clock=clock)


def _points(path: Path, root: ElementTree.Element) -> Iterator[tuple[float, float, float, float]]:
    number = 0
    for element in root.iter():
        if _name(element) != "trkpt":
            continue
        children = {_name(child): (child.text or "").strip() for child in element}
        values = {"lat": element.get("lat"), "lon": element.get("lon"), **children}
        lat, lon, alt = (_number(path, number, name, values.get(name)) for name in ("lat", "lon", "ele"))
        yield _time_s(path, number, values.get("time")), lat, lon, alt
        number += 1


def _name(element: ElementTree.Element) -> str:
    """The element's name without its namespace."""
    return element.tag.rpartition("}")[2]


def _number(path: Path, point: int, name: str, text: str | None) -> float:
    try:
        value = float(text) if text is not None else math.nan
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise TrackError(f"{path}: track point {point}: {name} must be a number, not {text!r}")
    return value


def _time_s(path: Path, point: int, text: str | None) -> float:
    try:
        moment = datetime.datetime.fromisoformat(text or "")
    except ValueError:
        raise TrackError(f"{path}: track point {point}: time must be a date and time, not {text!r}") from None
    # GPX times are UTC, also those without a zone.
    return (moment if moment.tzinfo else moment.replace(tzinfo=datetime.UTC)).timestamp()


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
            f"{path}: {path.suffix or 'no ending'} is not a supported log format; use {', '.join(READERS)}"
        )
    try:
        rows = read_telemetry(path, system=system) if reader is read_telemetry else reader(path)
    except OSError as error:
        raise TrackError(f"{path}: the file cannot be read: {error.strerror}") from None
    return assemble_track(path, rows, frame)

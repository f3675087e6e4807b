"""GPX tracks of loggers, watches and phones: positions, heights and times, no attitude."""

import datetime
import math
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from uavcover.errors import TrackError
from uavcover.verification.track_logs.assembly import LoggedRows


def read_gpx(path: Path) -> LoggedRows:
    """Read the points of all tracks and segments of a GPX 1.0 or 1.1 file.

    Time counts from the first one.

    ``ele`` is a height above sea level by the standard; a warning says that this is assumed.

    Raises:
        TrackError: not such a file; a point has no height or time, or one that is not a number.
    """
    text = path.read_bytes()
    if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
        raise TrackError(f"{path}: has a document type or entities, which no GPX file needs; it is not read")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise TrackError(f"{path}: is no GPX file: {error}") from None
    if _name(root) != "gpx":
        raise TrackError(f"{path}: is no GPX file but <{_name(root)}>")
    points = list(_points(path, root))
    if not points:
        raise TrackError(f"{path}: it contains no track points")
    positions = np.array(points)
    clock = np.array([[0.0, positions[0, 0]]])
    positions[:, 0] -= positions[0, 0]
    warning = f"{path}: its heights are taken as above sea level, as the GPX standard says; some loggers write ellipsoid heights"
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
        raise TrackError(f"{path}: track point {point}: {name} is {text!r}, not a number")
    return value


def _time_s(path: Path, point: int, text: str | None) -> float:
    try:
        moment = datetime.datetime.fromisoformat(text or "")
    except ValueError:
        raise TrackError(f"{path}: track point {point}: time is {text!r}, not a date and time") from None
    # GPX times are UTC, also those without a zone.
    return (moment if moment.tzinfo else moment.replace(tzinfo=datetime.UTC)).timestamp()

"""``.poly`` files of OpenStreetMap's tools (Osmosis, Geofabrik): sections of longitude and latitude, each ended by ``END``."""

import math

import shapely

from mission_io.errors import FormatError
from mission_io.formats.dialects import words_of
from uavcover.model.area import Ring
from uavcover.scenario.areas.features import AreaDocument, AreaFeature


def is_osmosis(text: str) -> bool:
    """Whether a ``.poly`` file is one of these: those of MAVProxy and Mission Planner have numbers alone."""
    return any(line.strip() == "END" for line in text.splitlines())


def read_osmosis(text: str, source: str) -> AreaDocument:
    """The polygons of a file, each with the holes (sections whose name begins with ``!``) that lie in it.

    Raises:
        FormatError: with the line, for a place that is none, a section without ``END``, and a hole in no polygon.
    """
    lines = [(number, line.strip()) for number, line in enumerate(text.splitlines(), start=1) if line.strip()]
    name = lines[0][1]
    outers: list[tuple[Ring, list[Ring]]] = []
    holes: list[tuple[int, Ring]] = []
    at = 1
    while at < len(lines) and lines[at][1] != "END":
        first, section = lines[at]
        ring, at = _section(lines, at + 1)
        if section.startswith("!"):
            holes.append((first, ring))
        else:
            outers.append((ring, []))
    for number, hole in holes:
        around = [inner for outer, inner in outers if shapely.Polygon(outer).intersects(shapely.Point(hole[0]))]
        if not around:
            raise FormatError("the hole does not lie in a polygon", where=f"line {number}", advice="remove it")
        around[0].append(hole)
    features = tuple(AreaFeature(((outer, *inner),), name) for outer, inner in outers)
    return AreaDocument(source, features, rings_may_be_open=True)


def _section(lines: list[tuple[int, str]], at: int) -> tuple[Ring, int]:
    """The ring that begins at a line, and the line behind its ``END``."""
    places: list[tuple[float, float]] = []
    for number, line in lines[at:]:
        at += 1
        if line == "END":
            if len(places) < 3:
                raise FormatError(
                    f"the section has {len(places)} positions",
                    where=f"line {number}",
                    advice="an area needs three or more",
                )
            return tuple(places), at
        try:
            lon, lat = (float(word) for word in words_of(line, 2).words)
        except (ValueError, FormatError):
            lon = lat = math.nan
        if not (abs(lon) <= 180.0 and abs(lat) <= 90.0):
            raise FormatError(
                f"{line[:40]!r} is not a position", where=f"line {number}", advice="write longitude, then latitude"
            )
        places.append((lon, lat))
    raise FormatError("the last section has no END", where=f"line {lines[-1][0]}", advice="download the file again")

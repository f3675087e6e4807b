"""``.poly`` and ``.fen`` files of MAVProxy and Mission Planner: one position a line, latitude and longitude.

A ``.poly`` file is an area. A ``.fen`` file is a fence of the old kind: the return point first, then one inclusion
polygon. Both begin with a comment and repeat the first corner at the end. MAVProxy's old rally points have a word and six
numbers a line.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from mission_io.errors import FormatError
from mission_io.formats.csv_tables import words_of
from mission_io.formats.drawings import DrawnArea, open_ring
from mission_io.formats.text import MissionFile, check_place, clean_text, degrees_text, finite_number
from mission_io.model.items import Fence, FencePolygon, Frame, FramedPoint, LatLon, RallyPoints

_HEADER = "#saved by mission_io"


@dataclass(frozen=True, slots=True)
class PolyFile:
    """The content of a ``.poly`` file, and the repairs needed to read it."""

    area: DrawnArea
    repairs: tuple[str, ...]


def read_area(text: str) -> PolyFile:
    """Read a ``.poly`` file.

    Raises:
        FormatError: with the line, for an invalid position, and for fewer than three corners.
    """
    places, repairs = _places(text)
    ring = open_ring(places, "the area", repairs)
    return PolyFile(DrawnArea(ring), tuple(repairs))


def read_fence(text: str) -> MissionFile:
    """Read a ``.fen`` file.

    The return point has no height in the file. It is set to 0 m above home, which autopilots take as "the height set in the
    parameters".

    Raises:
        FormatError: with the line, for an invalid position, and for fewer than a return point and three corners.
    """
    places, repairs = _places(text)
    if not places:
        raise FormatError("the file contains no positions", where="line 1", advice="begin with the return point")
    ring = open_ring(places[1:], "the fence", repairs)
    return_point = FramedPoint(places[0].lat_deg, places[0].lon_deg, 0.0, Frame.ABOVE_HOME)
    return MissionFile(fence=Fence((FencePolygon(ring),), (), return_point), repairs=tuple(repairs))


def write_area(area: DrawnArea) -> str:
    """Write an area as a ``.poly`` file.

    Raises:
        FormatError: an area with holes, which the format cannot hold, or an invalid corner.
    """
    if area.holes:
        raise FormatError(f".poly does not support holes ({len(area.holes)})", where="area", advice="use KML")
    return _text([*area.exterior, *area.exterior[:1]])


def write_fence(fence: Fence) -> str:
    """Write a fence as a ``.fen`` file.

    Raises:
        FormatError: anything but a return point and one inclusion polygon, a height of the return point, or an invalid
            corner.
    """
    whole = len(fence.polygons) == 1 and fence.polygons[0].inclusion and not fence.circles
    if not whole or fence.return_point is None:
        what = "the format requires one inclusion polygon and one return point"
        raise FormatError(what, where="fence", advice="write it as .waypoints")
    point, ring = fence.return_point, fence.polygons[0].vertices
    if point.alt_m != 0.0:
        what = f"the height is {point.alt_m:g} m, but this format has no heights"
        raise FormatError(what, where="return point", advice="set the height to 0, or write the fence as .waypoints")
    return _text([LatLon(point.lat_deg, point.lon_deg), *ring, *ring[:1]])


def _text(places: list[LatLon]) -> str:
    lines = [_HEADER]
    for number, place in enumerate(places):
        where = f"position {number}"
        lines.append(f"{degrees_text(place.lat_deg, where)} {degrees_text(place.lon_deg, where)}")
    return "\n".join(lines) + "\n"


def _contents(text: str) -> Iterator[tuple[str, str]]:
    """Each line that holds something beside a comment: where it is, and what it holds."""
    for number, line in enumerate(text.split("\n"), start=1):
        content = line.split("#", 1)[0].strip()
        if content:
            yield f"line {number}", content


def _places(text: str) -> tuple[list[LatLon], list[str]]:
    clean = clean_text(text)
    repairs = list(clean.repairs)
    places: list[LatLon] = []
    for where, content in _contents(clean.text):
        try:
            found = words_of(content, 2)
        except FormatError as error:
            what = error.what.replace("columns; expected 2", "numbers; a position has 2")
            raise FormatError(what, where=where, advice=error.advice or "latitude, then longitude") from None
        if found.changed:
            spaces = " to spaces" if found.has_other_separators else ""
            repairs.append(f"{where}: {found.changed}{spaces}")
        lat_deg, lon_deg = (finite_number(word, where) for word in found.words)
        check_place(lat_deg, lon_deg, where)
        places.append(LatLon(lat_deg, lon_deg))
    return places, repairs


_RALLY_ADVICE = "a rally point must consist of RALLY and 6 numbers"


def read_rally(text: str) -> MissionFile:
    """Read rally points, ``RALLY latitude longitude altitude break_altitude landing_direction flags`` a line.

    The altitude is in metres above home. Fields without a present equivalent are dropped, and listed where they are set.

    Raises:
        FormatError: with the line.
    """
    clean = clean_text(text)
    repairs = list(clean.repairs)
    points: list[FramedPoint] = []
    for where, content in _contents(clean.text):
        try:
            found = words_of(content, 7)
        except FormatError as error:
            what = f"the row has {len(content.split())} columns and begins with {content.split()[0][:20]!r}"
            raise FormatError(what, where=where, advice=error.advice or _RALLY_ADVICE) from None
        word, *columns = found.words
        if word != "RALLY":
            raise FormatError(f"7 columns beginning with {word[:20]!r}", where=where, advice=_RALLY_ADVICE)
        if found.changed:
            repairs.append(f"{where}: {found.changed}")
        lat_deg, lon_deg, alt_m, *dropped = (finite_number(column, where) for column in columns)
        check_place(lat_deg, lon_deg, where)
        if any(dropped):
            repairs.append(f"{where}: break altitude, landing direction and flags were dropped")
        points.append(FramedPoint(lat_deg, lon_deg, alt_m, Frame.ABOVE_HOME))
    return MissionFile(rally=RallyPoints(tuple(points)), repairs=tuple(repairs))

"""Drawings of map programs, as data: areas with holes, lines and spots, and fences made from them.

Also the positions of a mission in flying order, as the export formats draw them.
"""

from collections.abc import Iterable
from dataclasses import dataclass

from mission_io.errors import FormatError
from mission_io.formats.text import is_place
from mission_io.model.areas import Fence, FencePolygon, LatLon
from mission_io.model.items import Command, Frame, Mission, MissionItem


def place_of(lon_deg: float, lat_deg: float, where: str) -> LatLon:
    """A position of a format that writes the longitude first. Raises FormatError: it is none, with ``where``."""
    if not is_place(lat_deg, lon_deg):
        what = f"longitude {lon_deg:g}, latitude {lat_deg:g} is not a valid position"
        raise FormatError(what, where=where, advice="write longitude first")
    return LatLon(lat_deg, lon_deg)


@dataclass(frozen=True, slots=True)
class DrawnArea:
    """A polygon, possibly with holes. Its rings are not closed: no vertex is repeated."""

    exterior: tuple[LatLon, ...]  # the outer ring
    holes: tuple[tuple[LatLon, ...], ...] = ()  # the inner rings
    name: str = ""  # of its feature or placemark
    folder: str = ""  # the innermost folder that it is in, where a format has folders


@dataclass(frozen=True, slots=True)
class DrawnLine:
    """A line through positions."""

    points: tuple[LatLon, ...]
    name: str = ""


@dataclass(frozen=True, slots=True)
class Spot:
    """A single position."""

    point: LatLon
    name: str = ""


@dataclass(frozen=True, slots=True)
class Drawing:
    """The content of a drawing, each kind in the order of the file."""

    areas: tuple[DrawnArea, ...] = ()  # the polygons; a multipolygon is several
    lines: tuple[DrawnLine, ...] = ()  # the lines
    spots: tuple[Spot, ...] = ()  # the single positions
    repairs: tuple[str, ...] = ()  # what was repaired or dropped to read it, one line each
    unclosed: tuple[str, ...] = ()  # those of the repairs that are about rings that were not closed


def fence_from_areas(areas: Iterable[DrawnArea]) -> Fence:
    """A fence that includes the areas and excludes their holes.

    Autopilots require a position inside *every* inclusion polygon, so only one area makes sense for most of them.
    """
    polygons: list[FencePolygon] = []
    for area in areas:
        polygons.append(FencePolygon(area.exterior))
        polygons += [FencePolygon(hole, inclusion=False) for hole in area.holes]
    return Fence(tuple(polygons))


def open_ring(points: list[LatLon], where: str, repairs: list[str]) -> tuple[LatLon, ...]:
    """A closed ring, as files have it, without the repeated first point.

    Raises:
        FormatError: fewer than three different corners.
    """
    if len(points) > 1 and points[0] == points[-1]:
        points = points[:-1]
    elif points:
        repairs.append(f"{where}: the ring was not closed")
    if len(set(points)) < 3:
        raise FormatError(f"only {len(set(points))} different corners", where=where, advice="an area needs at least 3")
    return tuple(points)


_FLOWN_TO = frozenset({Command.NAV_WAYPOINT, Command.NAV_LOITER_TIME, Command.NAV_TAKEOFF, Command.NAV_LAND})


@dataclass(frozen=True, slots=True)
class RoutePoint:
    """A position of the route: the item's number (from 1) and the item, with the height in its own frame."""

    number: int
    item: MissionItem


def route_of(mission: Mission) -> tuple[RoutePoint, ...]:
    """The items with a position to fly to, in order, with their numbers in the mission (home is 0)."""
    return tuple(
        RoutePoint(number, item)
        for number, item in enumerate(mission.items, start=1)
        if item.has_position and item.command in _FLOWN_TO
    )


def alt_amsl_m(point: RoutePoint, mission: Mission) -> float:
    """The height of a point above mean sea level in metres.

    Raises:
        FormatError: heights above home in a mission without home, or heights above terrain, which is unknown here.
    """
    item = point.item
    if item.frame is Frame.AMSL:
        return item.alt_m
    where = f"item {point.number}"
    if item.frame is Frame.ABOVE_TERRAIN:
        raise FormatError("its height is above the terrain, which this conversion does not know", where=where)
    if mission.home is None:
        raise FormatError(
            "its height is above home, but the mission has no home", where=where, advice="specify the home"
        )
    return mission.home.alt_amsl_m + item.alt_m

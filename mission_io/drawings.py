"""What map programs draw: areas with holes, lines and spots, as data, and fences made of them."""

from collections.abc import Iterable
from dataclasses import dataclass

from mission_io.areas import Fence, FencePolygon, LatLon
from mission_io.errors import FormatError


@dataclass(frozen=True, slots=True)
class Area:
    """A polygon, possibly with holes. Its rings are not closed: no vertex is repeated."""

    exterior: tuple[LatLon, ...]
    holes: tuple[tuple[LatLon, ...], ...] = ()
    name: str = ""


@dataclass(frozen=True, slots=True)
class Line:
    """A line through places."""

    points: tuple[LatLon, ...]
    name: str = ""


@dataclass(frozen=True, slots=True)
class Spot:
    """A single place."""

    point: LatLon
    name: str = ""


@dataclass(frozen=True, slots=True)
class Drawing:
    """What a drawing holds, each kind in the order of the file.

    Attributes:
        areas: The polygons; a multipolygon is several.
        lines: The lines.
        spots: The single places.
        repairs: What had to be repaired or was left out to read it, one line each.
    """

    areas: tuple[Area, ...] = ()
    lines: tuple[Line, ...] = ()
    spots: tuple[Spot, ...] = ()
    repairs: tuple[str, ...] = ()


def fence_from_areas(areas: Iterable[Area]) -> Fence:
    """A fence to stay inside of the areas and out of their holes.

    Autopilots want to be inside *every* inclusion polygon, so only one area makes sense for most of them.
    """
    polygons: list[FencePolygon] = []
    for area in areas:
        polygons.append(FencePolygon(area.exterior))
        polygons += [FencePolygon(hole, inclusion=False) for hole in area.holes]
    return Fence(tuple(polygons))


def open_ring(points: list[LatLon], where: str, repairs: list[str]) -> tuple[LatLon, ...]:
    """A ring as files have it, first point repeated at the end, without that repetition.

    Raises:
        FormatError: fewer than three different corners.
    """
    if len(points) > 1 and points[0] == points[-1]:
        points = points[:-1]
    elif points:
        repairs.append(f"{where}: the ring was not closed")
    if len(set(points)) < 3:
        raise FormatError(f"a ring of {len(set(points))} corners", where=where, advice="an area needs 3 or more")
    return tuple(points)

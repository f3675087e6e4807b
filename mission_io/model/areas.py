"""Fences and rally points as data, and as the item lists in which vehicles and files keep them."""

from collections.abc import Iterable
from dataclasses import dataclass

from mission_io.errors import FormatError
from mission_io.model.items import Command, Frame, MissionItem


@dataclass(frozen=True, slots=True)
class LatLon:
    """A position without height: degrees, WGS 84."""

    lat_deg: float
    lon_deg: float


@dataclass(frozen=True, slots=True)
class FramedPoint:
    """A position with a height in metres above the reference of ``frame``."""

    lat_deg: float
    lon_deg: float
    alt_m: float
    frame: Frame = Frame.ABOVE_HOME


@dataclass(frozen=True, slots=True)
class FencePolygon:
    """A polygon to stay inside (``inclusion``) or outside. Its ring is open: no vertex is repeated."""

    vertices: tuple[LatLon, ...]
    inclusion: bool = True


@dataclass(frozen=True, slots=True)
class FenceCircle:
    """A circle to stay inside (``inclusion``) or outside."""

    center: LatLon
    radius_m: float
    inclusion: bool = True


@dataclass(frozen=True, slots=True)
class Fence:
    """A geofence; ``return_point``, if set, is the destination after a breach."""

    polygons: tuple[FencePolygon, ...] = ()
    circles: tuple[FenceCircle, ...] = ()
    return_point: FramedPoint | None = None


@dataclass(frozen=True, slots=True)
class RallyPoints:
    """Alternative return positions nearer than home."""

    points: tuple[FramedPoint, ...] = ()


_VERTEX = {True: Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION, False: Command.NAV_FENCE_POLYGON_VERTEX_EXCLUSION}
_CIRCLE = {True: Command.NAV_FENCE_CIRCLE_INCLUSION, False: Command.NAV_FENCE_CIRCLE_EXCLUSION}
_VERTEX_COMMANDS = {int(command): inclusion for inclusion, command in _VERTEX.items()}
_CIRCLE_COMMANDS = {int(command): inclusion for inclusion, command in _CIRCLE.items()}


def items_from_fence(fence: Fence) -> tuple[MissionItem, ...]:
    """The items of a fence: polygons, then circles, then the return point. Every vertex carries its polygon's size.

    Raises:
        FormatError: a polygon of fewer than three vertices, or a circle without a positive radius.
    """
    items: list[MissionItem] = []
    for number, polygon in enumerate(fence.polygons):
        size = len(polygon.vertices)
        if size < 3:
            raise FormatError(f"the polygon has {size} vertices, but needs at least 3", where=f"fence polygon {number}")
        items.extend(
            MissionItem(_VERTEX[polygon.inclusion], Frame.AMSL, (float(size), 0.0, 0.0, 0.0), v.lat_deg, v.lon_deg)
            for v in polygon.vertices
        )
    for number, circle in enumerate(fence.circles):
        if not circle.radius_m > 0:
            raise FormatError(f"the radius must be above 0, not {circle.radius_m} m", where=f"fence circle {number}")
        params = (circle.radius_m, 0.0, 0.0, 0.0)
        center = circle.center
        items.append(MissionItem(_CIRCLE[circle.inclusion], Frame.AMSL, params, center.lat_deg, center.lon_deg))
    if fence.return_point is not None:
        items.append(_item_from_point(Command.NAV_FENCE_RETURN_POINT, fence.return_point))
    return tuple(items)


def fence_from_items(items: Iterable[MissionItem]) -> Fence:
    """The fence that an item list describes.

    Raises:
        FormatError: with the number of the item (from 0) that does not belong in a fence, a polygon with another
            number of vertices than it announces, a radius that is not positive, or a second return point.
    """
    polygons: list[FencePolygon] = []
    circles: list[FenceCircle] = []
    return_point: FramedPoint | None = None
    ring: list[LatLon] = []
    ring_command, ring_size = 0, 0
    for number, item in enumerate(items):
        where = f"fence item {number}"
        if ring and (item.command, item.params[0]) != (ring_command, ring_size):
            raise FormatError(f"the preceding polygon has only {len(ring)} of its {ring_size:g} vertices", where=where)
        if item.command in _VERTEX_COMMANDS:
            ring_command, ring_size = item.command, _ring_size(item, where)
            ring.append(LatLon(item.lat_deg, item.lon_deg))
            if len(ring) == ring_size:
                polygons.append(FencePolygon(tuple(ring), _VERTEX_COMMANDS[item.command]))
                ring = []
        elif item.command in _CIRCLE_COMMANDS:
            if not item.params[0] > 0:
                raise FormatError(f"the radius must be above 0, not {item.params[0]} m", where=where)
            center = LatLon(item.lat_deg, item.lon_deg)
            circles.append(FenceCircle(center, item.params[0], _CIRCLE_COMMANDS[item.command]))
        elif item.command == Command.NAV_FENCE_RETURN_POINT:
            if return_point is not None:
                raise FormatError("this is a second return point", where=where, advice="keep only one of them")
            return_point = _point_from_item(item)
        else:
            raise FormatError(f"command {item.command} is not a fence item", where=where, advice="use 5000 to 5004")
    if ring:
        raise FormatError(f"the last polygon has only {len(ring)} of its {ring_size} vertices", where="fence")
    return Fence(tuple(polygons), tuple(circles), return_point)


def items_from_rally(rally: RallyPoints) -> tuple[MissionItem, ...]:
    """One item for each rally point, in order."""
    return tuple(_item_from_point(Command.NAV_RALLY_POINT, point) for point in rally.points)


def rally_from_items(items: Iterable[MissionItem]) -> RallyPoints:
    """The rally points that an item list describes.

    Raises:
        FormatError: with the number of the item (from 0) that is not a rally point.
    """
    points: list[FramedPoint] = []
    for number, item in enumerate(items):
        if item.command != Command.NAV_RALLY_POINT:
            raise FormatError(f"command {item.command} is not a rally point", where=f"rally item {number}")
        points.append(_point_from_item(item))
    return RallyPoints(tuple(points))


def _ring_size(item: MissionItem, where: str) -> int:
    size = item.params[0]
    if not (3 <= size <= 65535 and size == int(size)):
        raise FormatError(f"the polygon has {size:g} vertices", where=where, advice="a polygon needs at least 3")
    return int(size)


def _item_from_point(command: Command, point: FramedPoint) -> MissionItem:
    return MissionItem(command, point.frame, (0.0, 0.0, 0.0, 0.0), point.lat_deg, point.lon_deg, point.alt_m)


def _point_from_item(item: MissionItem) -> FramedPoint:
    return FramedPoint(item.lat_deg, item.lon_deg, item.alt_m, item.frame)

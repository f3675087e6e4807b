"""The parts ``geoFence`` and ``rallyPoints`` of a ``.plan`` file: version 2, which is written, and the older version 1.

Version 1 has one inclusion polygon, as a list of corners under ``polygon``, and a return point without a height. Some
programs write the lists of version 2 and call them version 1; these are read too.
"""

from collections.abc import Mapping
from typing import Any

from mission_io.errors import FormatError
from mission_io.formats.json_node import Node
from mission_io.model.areas import Fence, FenceCircle, FencePolygon, FramedPoint, LatLon, RallyPoints
from mission_io.model.items import Frame

_FENCE_ENTRIES = {"polygons": {"inclusion", "polygon", "version"}, "circles": {"inclusion", "circle", "version"}}


def fence_json(fence: Fence) -> dict[str, Any]:
    """The JSON of a fence, without its version.

    Raises:
        FormatError: a return point whose height is not above home.
    """
    document: dict[str, Any] = {
        "circles": [
            {
                "circle": {"center": [c.center.lat_deg, c.center.lon_deg], "radius": c.radius_m},
                "inclusion": c.inclusion,
                "version": 1,
            }
            for c in fence.circles
        ],
        "polygons": [
            {"inclusion": p.inclusion, "polygon": [[v.lat_deg, v.lon_deg] for v in p.vertices], "version": 1}
            for p in fence.polygons
        ],
    }
    if fence.return_point is not None:
        document["breachReturn"] = framed_json(fence.return_point, "geoFence.breachReturn")
    return document


def framed_json(point: FramedPoint, where: str) -> list[float]:
    """The JSON of a point with a height.

    Raises:
        FormatError: a height that is not above home.
    """
    if point.frame is not Frame.ABOVE_HOME:
        raise FormatError(
            f"the height is {point.frame.name}; this format supports only heights above home", where=where
        )
    return [point.lat_deg, point.lon_deg, point.alt_m]


def read_fence_part(node: Node, repairs: list[str]) -> Fence:
    """The fence of a plan's part, or of a file of QGroundControl that holds a fence alone.

    Raises:
        FormatError: with the place in the document.
    """
    for key, known in _FENCE_ENTRIES.items():
        for entry in _entries(node, key):
            others = sorted(set(entry.value) - known) if isinstance(entry.value, Mapping) else []
            repairs += [f"{entry.where}: ignored {other[:30]!r}" for other in others]
    polygons = [
        FencePolygon(_corners(p.get("polygon")), p.get("inclusion").truth()) for p in _entries(node, "polygons")
    ]
    circles = tuple(
        FenceCircle(
            _lat_lon(c.get("circle").get("center")),
            c.get("circle").get("radius").number(),
            c.get("inclusion").truth(),
        )
        for c in _entries(node, "circles")
    )
    if _is_old(node):
        nothing: tuple[LatLon, ...] = ()
        corners = node.optional("polygon", _corners, nothing)
        polygons += [FencePolygon(corners)] if corners else []
    none: FramedPoint | None = None
    read_return = _read_old_return if _is_old(node) else _read_point
    return Fence(tuple(polygons), circles, node.optional("breachReturn", read_return, none))


def read_rally_part(node: Node) -> RallyPoints:
    """The rally points of a plan's part, or of QGroundControl's file of rally points; the same errors."""
    points = _entries(node, "points") if _is_old(node) else node.get("points").nodes()
    return RallyPoints(tuple(map(_read_point, points)))


def _is_old(node: Node) -> bool:
    return node.optional("version", lambda entry: bool(entry.value == 1), default=False)


def _corners(node: Node) -> tuple[LatLon, ...]:
    return tuple(_lat_lon(corner) for corner in node.nodes())


def _lat_lon(node: Node) -> LatLon:
    return LatLon(*node.floats(2))


def _entries(node: Node, key: str) -> list[Node]:
    nothing: list[Node] = []
    return node.optional(key, Node.nodes, nothing)


def _read_point(node: Node) -> FramedPoint:
    lat_deg, lon_deg, alt_m = node.floats(3)
    return FramedPoint(lat_deg, lon_deg, alt_m, Frame.ABOVE_HOME)


def _read_old_return(node: Node) -> FramedPoint:
    """A return point of version 1: 0 m above home, which autopilots take as "the height set in the parameters"."""
    if len(node.nodes()) == 3:
        return _read_point(node)
    point = _lat_lon(node)
    return FramedPoint(point.lat_deg, point.lon_deg, 0.0, Frame.ABOVE_HOME)

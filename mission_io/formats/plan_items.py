"""The items of a ``.plan`` file: simple items, and the items that QGroundControl flies for its complex items.

A complex item is a definition from which QGroundControl generates items. Surveys and corridor scans store these items in the
file. Those of a landing pattern follow from a few numbers. Those of a structure scan cannot be derived from the file.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mission_io.autopilots.comparison import has_no_position
from mission_io.errors import FormatError
from mission_io.formats.text import Node
from mission_io.model.items import (
    Command,
    Fence,
    FenceCircle,
    FencePolygon,
    Frame,
    FramedPoint,
    LatLon,
    MissionItem,
    RallyPoints,
)

# The parts ``geoFence`` and ``rallyPoints`` of a ``.plan`` file: version 2, which is written, and the older version 1.
#
# Version 1 has one inclusion polygon, as a list of corners under ``polygon``, and a return point without a height. Some
# programs write the lists of version 2 and call them version 1; these are read too.

_FENCE_ENTRIES = {"polygons": {"inclusion", "polygon", "version"}, "circles": {"inclusion", "circle", "version"}}


def fence_json(fence: Fence) -> dict[str, Any]:
    """The JSON of a fence, without its version. Raises FormatError: a return point whose height is not above home."""
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
    """The JSON of a point with a height. Raises FormatError: a height that is not above home."""
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


_ALTITUDE_MODES = {Frame.ABOVE_HOME: 1, Frame.AMSL: 2, Frame.ABOVE_TERRAIN: 4}
_PARAMS = 7
_LARGEST = 1e300
_NUMBERS = frozenset({int, float})
_PLAIN_FRAMES = {int(frame): frame for frame in Frame}
_ABOVE_TERRAIN_AS_AMSL = 3
"""AltitudeMode of heights above the terrain that QGroundControl turned into heights above sea level."""
_MODE_FRAMES = {1: Frame.ABOVE_HOME, 2: Frame.AMSL, _ABOVE_TERRAIN_AS_AMSL: Frame.AMSL, 4: Frame.ABOVE_TERRAIN}
_NOTHING = (math.nan, math.nan, math.nan)


@dataclass(frozen=True, slots=True)
class PlanEntry:
    """An entry of a plan's item list, kept whole because it holds more than its items."""

    first: int  # position of its first item in the mission, from 0
    items: tuple[MissionItem, ...]  # the items that it flies
    document: Mapping[str, Any]  # its JSON, written back unchanged. Not to be modified.
    is_flyable: bool = True  # whether the file contains the items it flies

    @property
    def kind(self) -> str:
        """SimpleItem, or the type of the complex item, such as ``survey``."""
        return str(self.document.get("complexItemType", "SimpleItem"))[:30]


def simple_json(number: int, item: MissionItem) -> dict[str, Any]:
    """The JSON of a simple item, whose number counts from 1.

    Raises:
        FormatError: an infinite number, or a position that is not a number.
    """
    values = (*item.params, item.lat_deg, item.lon_deg, item.alt_m)
    if not all(map(math.isfinite, values)) and (
        any(math.isinf(value) for value in values) or any(math.isnan(value) for value in values[4:])
    ):
        raise FormatError("a value is not a finite number", where=f"mission item {number}")
    entry: dict[str, Any] = {
        "autoContinue": item.autocontinue,
        "command": int(item.command),
        "doJumpId": number,
        "frame": int(item.frame),
        "params": [None if value != value else value for value in values],
        "type": "SimpleItem",
    }
    if item.has_position:
        entry["Altitude"] = item.alt_m
        entry["AltitudeMode"] = _ALTITUDE_MODES[item.frame]
        entry["AMSLAltAboveTerrain"] = None
    return entry


def read_simple(node: Node) -> MissionItem:
    """The item of a simple entry. Raises FormatError: with the place in the document."""
    plain = _plain_item(node.value)
    if plain is not None:
        return plain
    p1, p2, p3, p4, lat, lon, alt = _params(node)
    frame_node, command = node.get("frame"), node.get("command").whole()
    if not 0 <= command <= 65535:
        raise FormatError(f"the command must be between 0 and 65535, not {command}", where=f"{node.where}.command")
    try:
        frame = Frame.from_mav_frame(frame_node.whole())
    except FormatError as error:
        raise FormatError(error.what, where=frame_node.where, advice=error.advice) from None
    if lat != lat or lon != lon or alt != alt:
        if frame is not Frame.COMMAND and not has_no_position(command):
            raise FormatError("latitude, longitude and height are required", where=f"{node.where}.params")
        lat, lon, alt = (0.0 if math.isnan(value) else value for value in (lat, lon, alt))
    autocontinue = node.optional("autoContinue", Node.truth, default=True)
    return MissionItem(command, frame, (p1, p2, p3, p4), lat, lon, alt, autocontinue)


def contradictions(node: Node, item: MissionItem) -> list[str]:
    """Contradictions inside an entry, one line each; ``frame`` and ``params`` are sent to vehicles."""
    entry, where = node.value, node.where
    mode, height, amsl = (entry.get(key) for key in ("AltitudeMode", "Altitude", "AMSLAltAboveTerrain"))
    found: list[str] = []
    if not item.has_position or isinstance(mode, bool) or not isinstance(mode, int):
        return found
    frame = _MODE_FRAMES.get(mode)
    if frame is not None and item.frame is not frame:
        found.append(f"{where}: AltitudeMode {mode} is {frame.name}, but its frame is {item.frame.name} (used)")
    stated = amsl if mode == _ABOVE_TERRAIN_AS_AMSL else height
    if isinstance(stated, int | float) and not isinstance(stated, bool) and abs(stated - item.alt_m) > 0.01:
        key = "AMSLAltAboveTerrain" if mode == _ABOVE_TERRAIN_AS_AMSL else "Altitude"
        found.append(f"{where}: {key} is {stated:g}, but params[6] is {item.alt_m:g}; {item.alt_m:g} m was used")
    return found


def read_complex(node: Node) -> tuple[MissionItem, ...] | None:
    """The items that a complex entry flies; None when the file does not contain them.

    Raises:
        FormatError: with the place in the document.
    """
    kind = node.get("complexItemType").text()
    transects = node.value.get("TransectStyleComplexItem")
    if isinstance(transects, Mapping) and "Items" in transects:
        entries = node.get("TransectStyleComplexItem").get("Items").nodes()
        return tuple(read_simple(_simple(entry)) for entry in entries)
    if kind in ("fwLandingPattern", "vtolLandingPattern"):
        land = Command.NAV_LAND if kind == "fwLandingPattern" else Command.NAV_VTOL_LAND
        return _landing(node, land)
    return None


def _simple(node: Node) -> Node:
    kind = node.get("type").value
    if kind != "SimpleItem":
        raise FormatError("nested complex items are not supported", where=node.where, advice="save the plan again")
    return node


def _plain_item(entry: Any) -> MissionItem | None:
    """The item of an entry that is complete and correctly typed; None leaves it to the careful reader."""
    if type(entry) is not dict:
        return None
    params, command, autocontinue = entry.get("params"), entry.get("command"), entry.get("autoContinue")
    number = entry.get("frame")
    frame = _PLAIN_FRAMES.get(number) if type(number) is int else None
    if frame is None or type(command) is not int or not 0 <= command <= 65535 or type(autocontinue) is not bool:
        return None
    if (
        type(params) is not list
        or len(params) != _PARAMS
        or not _NUMBERS.issuperset(map(type, params[:3] + params[4:]))
    ):
        return None
    p1, p2, p3, p4, lat, lon, alt = params
    if p4 is None:
        p4 = math.nan
    elif type(p4) not in _NUMBERS:
        return None
    if (
        max(map(abs, params[:3] + params[4:])) > _LARGEST or abs(p4) > _LARGEST
    ):  # no sum: an integer may be arbitrarily large
        return None
    yaw = float(p4)
    return MissionItem(
        command, frame, (float(p1), float(p2), float(p3), yaw), float(lat), float(lon), float(alt), autocontinue
    )


def _params(node: Node) -> list[float]:
    """The seven parameters; QGroundControl 3.0 to 3.2 wrote four, and the other three as ``coordinate``."""
    nodes = node.get("params").nodes()
    if len(nodes) == _PARAMS - 3 and "coordinate" in node.value:
        nodes += node.get("coordinate").nodes()
    if len(nodes) != _PARAMS:
        raise FormatError(f"expected {_PARAMS} numbers, not {len(nodes)}", where=f"{node.where}.params")
    return [math.nan if value.value is None else value.number() for value in nodes]


def _landing(node: Node, land: Command) -> tuple[MissionItem, ...]:
    """A landing pattern: start of landing, camera off, approach, landing, as QGroundControl sends it."""
    approach_key = "landingApproachCoordinate" if "landingApproachCoordinate" in node.value else "loiterCoordinate"
    approach_lat, approach_lon, approach_alt = node.get(approach_key).floats(3)
    land_lat, land_lon, land_alt = node.get("landCoordinate").floats(3)
    frame = Frame.ABOVE_HOME if _is_relative(node) else Frame.AMSL
    items = [MissionItem(Command.DO_LAND_START, Frame.COMMAND)]
    if node.optional("stopTakingPhotos", Node.truth, default=False):
        items.append(MissionItem(Command.DO_SET_CAM_TRIGG_DIST, Frame.COMMAND))
        items.append(MissionItem(Command.IMAGE_STOP_CAPTURE, Frame.COMMAND, (0.0, *_NOTHING)))
    if node.optional("stopVideoPhotos", Node.truth, default=False):
        items.append(MissionItem(Command.VIDEO_STOP_CAPTURE, Frame.COMMAND, (0.0, *_NOTHING)))
    if node.optional("useLoiterToAlt", Node.truth, default=True):
        radius_m = node.get("loiterRadius").number() * (1.0 if node.get("loiterClockwise").truth() else -1.0)
        command, params = Command.NAV_LOITER_TO_ALT, (1.0, radius_m, 0.0, 1.0)
    else:
        command, params = Command.NAV_WAYPOINT, (0.0, 0.0, 0.0, math.nan)
    items.append(MissionItem(command, frame, params, approach_lat, approach_lon, approach_alt))
    items.append(MissionItem(land, frame, (0.0, 0.0, 0.0, 0.0), land_lat, land_lon, land_alt))
    return tuple(items)


def _is_relative(node: Node) -> bool:
    if "altitudesAreRelative" in node.value:
        return node.get("altitudesAreRelative").truth()
    approach, land = node.get("loiterAltitudeRelative").truth(), node.get("landAltitudeRelative").truth()
    if approach != land:
        what = "the heights of approach and landing refer to different datums"
        raise FormatError(what, where=node.where, advice="set both above home, or both above sea level")
    return land

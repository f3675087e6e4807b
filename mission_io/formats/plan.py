"""``.plan`` files (QGroundControl's JSON): a mission of simple items, a geofence and rally points in one document."""

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from mission_io.areas import Fence, FenceCircle, FencePolygon, FramedPoint, LatLon, RallyPoints
from mission_io.enums import VehicleClass
from mission_io.errors import FormatError
from mission_io.items import Frame, GeoPoint, Mission, MissionItem

_ALTITUDE_MODES = {Frame.ABOVE_HOME: 1, Frame.AMSL: 2, Frame.ABOVE_TERRAIN: 4}
_PARAMS = 7

ResultT = TypeVar("ResultT")


@dataclass(frozen=True, slots=True)
class PlanFile:
    """What a ``.plan`` file holds.

    Attributes:
        mission: Its mission; home is the planned home position.
        fence: Its geofence, empty when it has none.
        rally: Its rally points, empty when it has none.
        mav_autopilot: The MAV_AUTOPILOT number it was planned for.
        vehicle_type: The MAV_TYPE number it was planned for.
        cruise_speed_m_s: The planner's cruise speed, for display only.
        hover_speed_m_s: The planner's hover speed, for display only.
    """

    mission: Mission
    fence: Fence
    rally: RallyPoints
    mav_autopilot: int
    vehicle_type: int = VehicleClass.QUADROTOR
    cruise_speed_m_s: float = 15.0
    hover_speed_m_s: float = 5.0


def write(plan: PlanFile) -> str:
    """A plan as text.

    Speeds are written in whole metres per second, because Mission Planner reads no others; they are for display.

    Raises:
        FormatError: no home, an infinite number, or a height that is not a number; with the item.
    """
    home = plan.mission.home
    if home is None:
        raise FormatError("the mission has no home", where="plannedHomePosition", advice="give where it starts")
    document = {
        "fileType": "Plan",
        "geoFence": _fence_json(plan.fence),
        "groundStation": "QGroundControl",
        "mission": {
            "cruiseSpeed": round(plan.cruise_speed_m_s),
            "firmwareType": int(plan.mav_autopilot),
            "globalPlanAltitudeMode": 0,
            "hoverSpeed": round(plan.hover_speed_m_s),
            "items": [_item_json(number, item) for number, item in enumerate(plan.mission.items, start=1)],
            "plannedHomePosition": [home.lat_deg, home.lon_deg, home.alt_amsl_m],
            "vehicleType": int(plan.vehicle_type),
            "version": 2,
        },
        "rallyPoints": {"points": [_point_json(n, point) for n, point in enumerate(plan.rally.points)], "version": 2},
        "version": 1,
    }
    try:
        return json.dumps(document, indent=4, allow_nan=False) + "\n"
    except ValueError:
        raise FormatError("a number is not finite", where="plan", advice="give finite places and speeds") from None


def _item_json(number: int, item: MissionItem) -> dict[str, Any]:
    values = [*item.params, item.lat_deg, item.lon_deg, item.alt_m]
    if any(math.isinf(value) for value in values) or any(math.isnan(value) for value in values[4:]):
        raise FormatError("a number is not finite", where=f"mission item {number}")
    entry: dict[str, Any] = {
        "autoContinue": item.autocontinue,
        "command": int(item.command),
        "doJumpId": number,
        "frame": int(item.frame),
        "params": [None if math.isnan(value) else value for value in values],
        "type": "SimpleItem",
    }
    if item.has_position:
        entry["Altitude"] = item.alt_m
        entry["AltitudeMode"] = _ALTITUDE_MODES[item.frame]
        entry["AMSLAltAboveTerrain"] = None
    return entry


def _fence_json(fence: Fence) -> dict[str, Any]:
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
        "version": 2,
    }
    if fence.return_point is not None:
        document["breachReturn"] = _framed_json(fence.return_point, "geoFence.breachReturn")
    return document


def _point_json(number: int, point: FramedPoint) -> list[float]:
    return _framed_json(point, f"rallyPoints.points[{number}]")


def _framed_json(point: FramedPoint, where: str) -> list[float]:
    if point.frame is not Frame.ABOVE_HOME:
        raise FormatError(f"a height {point.frame.name}; this format has them above home only", where=where)
    return [point.lat_deg, point.lon_deg, point.alt_m]


def read(text: str) -> PlanFile:
    """Read a ``.plan`` file.

    Raises:
        FormatError: with the place in the document, for what is missing, of another type, or not supported, such as
            surveys and other complex items.
    """
    try:
        document = json.loads(text.removeprefix("\ufeff"), parse_constant=_refuse_constant)
    except RecursionError:
        raise FormatError("nested too deeply", where="plan") from None
    except json.JSONDecodeError as error:
        raise FormatError(f"not JSON: {error.msg}", where=f"line {error.lineno}") from None
    except ValueError as error:
        raise FormatError(f"a number that cannot be read: {error}", where="plan") from None
    root = _Node(document, "plan")
    if root.get("fileType").value != "Plan":
        raise FormatError("not a plan", where="plan.fileType", advice="it has to be 'Plan'")
    mission = root.get("mission")
    home = mission.get("plannedHomePosition").floats(3)
    return PlanFile(
        Mission(GeoPoint(*home), tuple(_read_item(node) for node in mission.get("items").nodes())),
        root.optional("geoFence", _read_fence, Fence()),
        root.optional("rallyPoints", _read_rally, RallyPoints()),
        mav_autopilot=mission.get("firmwareType").whole(),
        vehicle_type=mission.optional("vehicleType", _Node.whole, int(VehicleClass.QUADROTOR)),
        cruise_speed_m_s=mission.optional("cruiseSpeed", _Node.number, 15.0),
        hover_speed_m_s=mission.optional("hoverSpeed", _Node.number, 5.0),
    )


def _refuse_constant(name: str) -> float:
    raise ValueError(name)


@dataclass(frozen=True, slots=True)
class _Node:
    """A value in the document and where it is."""

    value: Any
    where: str

    def get(self, key: str) -> "_Node":
        if not isinstance(self.value, Mapping):
            raise FormatError("an object is expected here", where=self.where)
        if key not in self.value:
            raise FormatError("is missing", where=f"{self.where}.{key}")
        return _Node(self.value[key], f"{self.where}.{key}")

    def optional(self, key: str, read_node: "Callable[[_Node], ResultT]", default: ResultT) -> ResultT:
        missing = isinstance(self.value, Mapping) and key not in self.value
        return default if missing else read_node(self.get(key))

    def nodes(self) -> list["_Node"]:
        if not isinstance(self.value, list):
            raise FormatError("a list is expected here", where=self.where)
        return [_Node(value, f"{self.where}[{index}]") for index, value in enumerate(self.value)]

    def number(self) -> float:
        if isinstance(self.value, bool) or not isinstance(self.value, int | float) or abs(self.value) > 1e300:
            raise FormatError(f"{str(self.value)[:20]!r} is not a number", where=self.where)
        return float(self.value)

    def whole(self) -> int:
        value = self.number()
        if value != int(value):
            raise FormatError(f"{value} is not a whole number", where=self.where)
        return int(value)

    def truth(self) -> bool:
        if not isinstance(self.value, bool):
            raise FormatError("true or false is expected here", where=self.where)
        return self.value

    def floats(self, size: int) -> list[float]:
        nodes = self.nodes()
        if len(nodes) != size:
            raise FormatError(f"{len(nodes)} numbers, {size} are expected", where=self.where)
        return [node.number() for node in nodes]


def _read_item(node: _Node) -> MissionItem:
    kind = node.get("type").value
    if kind != "SimpleItem":
        raise FormatError(
            f"{str(kind)[:30]!r} items cannot be read by this version", where=node.where, advice="only SimpleItem can"
        )
    params = node.get("params").nodes()
    if len(params) != _PARAMS:
        raise FormatError(f"{len(params)} numbers, {_PARAMS} are expected", where=f"{node.where}.params")
    values = [math.nan if param.value is None else param.number() for param in params]
    frame_node, command = node.get("frame"), node.get("command").whole()
    try:
        frame = Frame.from_mav_frame(frame_node.whole())
    except FormatError as error:
        raise FormatError(error.what, where=frame_node.where, advice=error.advice) from None
    if any(math.isnan(value) for value in values[4:]):
        if frame is not Frame.COMMAND:
            raise FormatError("latitude, longitude and height must be given", where=f"{node.where}.params")
        values[4:] = [0.0 if math.isnan(value) else value for value in values[4:]]
    p1, p2, p3, p4, lat, lon, alt = values
    autocontinue = node.optional("autoContinue", _Node.truth, default=True)
    return MissionItem(command, frame, (p1, p2, p3, p4), lat, lon, alt, autocontinue)


def _lat_lon(node: _Node) -> LatLon:
    return LatLon(*node.floats(2))


def _read_fence(node: _Node) -> Fence:
    polygons = tuple(
        FencePolygon(tuple(_lat_lon(v) for v in p.get("polygon").nodes()), p.get("inclusion").truth())
        for p in _entries(node, "polygons")
    )
    circles = tuple(
        FenceCircle(
            _lat_lon(c.get("circle").get("center")),
            c.get("circle").get("radius").number(),
            c.get("inclusion").truth(),
        )
        for c in _entries(node, "circles")
    )
    none: FramedPoint | None = None
    return Fence(polygons, circles, node.optional("breachReturn", _read_point, none))


def _entries(node: _Node, key: str) -> list[_Node]:
    nothing: list[_Node] = []
    return node.optional(key, _Node.nodes, nothing)


def _read_point(node: _Node) -> FramedPoint:
    lat_deg, lon_deg, alt_m = node.floats(3)
    return FramedPoint(lat_deg, lon_deg, alt_m, Frame.ABOVE_HOME)


def _read_rally(node: _Node) -> RallyPoints:
    return RallyPoints(tuple(_read_point(point) for point in node.get("points").nodes()))

"""``.plan`` files (QGroundControl's JSON): a mission, a geofence and rally points in one document.

Content beyond the model of ``mission_io`` is kept and written back: the definitions of surveys and other complex items,
heights above calculated terrain, keys of other programs.
"""

import dataclasses
import json
import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from mission_io.autopilots.comparison import diff_items
from mission_io.errors import FormatError
from mission_io.formats.plan_items import (
    PlanEntry,
    contradictions,
    fence_json,
    framed_json,
    read_complex,
    read_fence_part,
    read_rally_part,
    read_simple,
    simple_json,
)
from mission_io.formats.text import MissionFile, Node, clean_text, doubts_about, doubts_about_fence, parse_json
from mission_io.model.enums import VehicleClass
from mission_io.model.items import Command, Fence, GeoPoint, Mission, MissionItem, RallyPoints, same_item

_CONSTANTS: Mapping[str, Mapping[str, Any]] = {
    "": {"fileType": "Plan", "groundStation": "QGroundControl", "version": 1},
    "mission": {"globalPlanAltitudeMode": 0, "version": 2},
    "geoFence": {"version": 2},
    "rallyPoints": {"version": 2},
}
_MODELLED = {
    "": frozenset({"mission", "geoFence", "rallyPoints"}),
    "mission": frozenset({"cruiseSpeed", "firmwareType", "hoverSpeed", "items", "plannedHomePosition", "vehicleType"}),
    "geoFence": frozenset({"circles", "polygons", "breachReturn"}),
    "rallyPoints": frozenset({"points"}),
}
_OLD_KEYS = frozenset({"polygon", "version"})
"""Keys of version 1 that version 2 says in another way."""
_COMPACT = json.JSONEncoder(allow_nan=False)
_OLD_PARTS = ("geoFence", "rallyPoints")
"""Parts that are read in version 1 too."""
_HOME = "plannedHomePosition"


@dataclass(frozen=True, slots=True)
class PlanFile:
    """The content of a ``.plan`` file."""

    mission: Mission  # its mission with the items of complex items in their places; home is the planned home position
    fence: Fence  # its geofence, empty when it has none
    rally: RallyPoints  # its rally points, empty when it has none
    mav_autopilot: int  # the MAV_AUTOPILOT number it was planned for
    vehicle_type: int = VehicleClass.QUADROTOR  # the MAV_TYPE number it was planned for
    cruise_speed_m_s: float = 15.0  # the planner's cruise speed, for display only
    hover_speed_m_s: float = 5.0  # the planner's hover speed, for display only
    entries: tuple[PlanEntry, ...] = ()  # the entries of its item list that say more than the items they fly, in order
    # other keys of the document and of its parts ``mission``, ``geoFence`` and ``rallyPoints``
    extras: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    repairs: tuple[str, ...] = field(default=(), compare=False)  # what was missing or dropped to read it, one line each

    def doubts(self) -> tuple[str, ...]:
        """Probable mistakes, such as a route far from home; see ``formats.text.doubts_about``."""
        return (*doubts_about(self.mission), *doubts_about_fence(self.fence))

    def with_mission(self, mission: Mission) -> "PlanFile":
        """The same plan with another mission. Entries whose items were changed become simple items.

        Simple entries that moved are rewritten too, because jumps refer to their numbers.
        """
        kept: list[PlanEntry] = []
        edits = deque(diff_items(self.mission.items, mission.items))
        changed, shift = bool(edits), 0
        for entry in self.entries:
            end = entry.first + len(entry.items)
            while edits and edits[0].at + len(edits[0].removed) <= entry.first:
                edit = edits.popleft()
                shift += len(edit.inserted) - len(edit.removed)
            if edits and edits[0].at < end:
                continue
            renumbered = shift or (changed and entry.document.get("doJumpId") != entry.first + 1)
            if entry.kind == "SimpleItem" and renumbered:
                continue
            kept.append(dataclasses.replace(entry, first=entry.first + shift))
        return dataclasses.replace(self, mission=mission, entries=tuple(kept))


def write(plan: PlanFile) -> str:
    """Write a plan as text. Speeds are written in whole metres per second (see ``losses``).

    Raises:
        FormatError: no home, an infinite number, a height that is not a number, heights of rally points or of the
            return point that are not above home, or items that differ from what a kept entry flies.
    """
    if not math.isfinite(plan.cruise_speed_m_s) or not math.isfinite(plan.hover_speed_m_s):
        raise FormatError("a speed is not a finite number", where="mission.cruiseSpeed", advice="use finite speeds")
    mission = {
        "cruiseSpeed": round(plan.cruise_speed_m_s),
        "firmwareType": int(plan.mav_autopilot),
        "hoverSpeed": round(plan.hover_speed_m_s),
        "items": _items_json(plan),
        "plannedHomePosition": _home_json(plan),
        "vehicleType": int(plan.vehicle_type),
    }
    points = [framed_json(point, f"rallyPoints.points[{n}]") for n, point in enumerate(plan.rally.points)]
    parts = {"geoFence": fence_json(plan.fence), "mission": mission, "rallyPoints": {"points": points}}
    try:
        texts = {name: _part_text(plan, name, part, indent=8) for name, part in parts.items()}
        return _part_text(plan, "", texts, indent=4) + "\n"
    except ValueError:
        raise FormatError("a value is not a finite number", where="plan", advice="use finite numbers") from None
    except TypeError:
        raise FormatError("a key or value cannot be written as JSON", where="extras", advice="remove it") from None
    except RecursionError:
        raise FormatError("a kept entry is nested too deeply", where="plan") from None


def _home_json(plan: PlanFile) -> object:
    home = plan.mission.home
    if home is not None:
        return [home.lat_deg, home.lon_deg, home.alt_amsl_m]
    kept = plan.extras.get("mission", {}).get(_HOME)
    if kept is None:
        raise FormatError("the mission has no home", where=_HOME, advice="specify the start position")
    return kept


def _part_text(plan: PlanFile, name: str, part: Mapping[str, Any], *, indent: int) -> str:
    """A part of the document with its constants and other programs' keys, one line for each key and item."""
    lines = []
    for key, value in sorted({**_CONSTANTS[name], **plan.extras.get(name, {}), **part}.items()):
        if name == "" and key in part:
            text = value  # a part, which is text already
        elif name == "mission" and key == "items" and value:
            text = "[\n" + ",\n".join(" " * 12 + _COMPACT.encode(item) for item in value) + "\n" + " " * indent + "]"
        else:
            text = _COMPACT.encode(value)
        lines.append(f"{' ' * indent}{_COMPACT.encode(key)}: {text}")
    return "{\n" + ",\n".join(lines) + "\n" + " " * (indent - 4) + "}"


def losses(plan: PlanFile) -> tuple[str, ...]:
    """Values that ``write`` rounds, one line each: Mission Planner reads speeds only as whole numbers."""
    speeds = (("cruiseSpeed", plan.cruise_speed_m_s), ("hoverSpeed", plan.hover_speed_m_s))
    return tuple(f"mission.{key}: rounded {value} to {round(value)}" for key, value in speeds if value % 1.0)


def _items_json(plan: PlanFile) -> list[Mapping[str, Any]]:
    items = plan.mission.items
    _check_jumps(plan)
    found: list[Mapping[str, Any]] = []
    position = 0
    for entry in plan.entries:
        end = entry.first + len(entry.items)
        there = items[entry.first : end]
        same = len(there) == len(entry.items) and all(map(same_item, there, entry.items))
        if entry.first < position or not same:
            what = f"the {entry.kind} kept from the file no longer flies the mission's items from {entry.first + 1} on"
            raise FormatError(what, where="entries", advice="use PlanFile.with_mission to change a mission")
        found += [simple_json(number + 1, items[number]) for number in range(position, entry.first)]
        found.append(entry.document)
        position = end
    return found + [simple_json(number + 1, items[number]) for number in range(position, len(items))]


def _check_jumps(plan: PlanFile) -> None:
    """Require that every jump goes to the doJumpId of a simple item; no program reads another one."""
    complex_items = [entry for entry in plan.entries if entry.kind != "SimpleItem"]
    inside = {number for e in complex_items for number in range(e.first + 1, e.first + len(e.items) + 1)}
    for number, item in enumerate(plan.mission.items, start=1):
        if item.command != Command.DO_JUMP or number in inside:
            continue
        target = item.params[0]
        if target in inside or not (1 <= target <= len(plan.mission.items) and target == int(target)):
            raise FormatError(
                f"the jump leads to {target:g}, but no simple item has this number",
                where=f"mission item {number}, param 1",
                advice="change the jump, or write a .waypoints file",
            )


def read(text: str) -> PlanFile:
    """Read a ``.plan`` file whose mission can be flown.

    Raises:
        FormatError: with the place in the document, for a missing value, a wrong type or an unknown version, and for
            complex items whose items the file does not contain (``read_to_keep`` reads those too).
    """
    plan = read_to_keep(text)
    for entry in plan.entries:
        if not entry.is_flyable:
            raise FormatError(
                f"the file does not contain the items of a {entry.kind}",
                where=f"plan.mission.items, after mission item {entry.first}",
                advice="upload it with QGroundControl and download the mission",
            )
    return plan


def read_to_keep(text: str) -> PlanFile:
    """Read a ``.plan`` file to change other parts of it; its mission lacks what the file does not contain.

    Raises:
        FormatError: as ``read``, except for complex items.
    """
    clean = clean_text(text)
    root = parse_json(clean.text, "plan")
    if root.get("fileType").value != "Plan":
        raise FormatError("this is not a plan", where="plan.fileType", advice="it must be 'Plan'")
    repairs = list(clean.repairs)
    extras: dict[str, Mapping[str, Any]] = {}
    _read_part(root, "", repairs, extras)
    _read_part(root.get("mission"), "mission", repairs, extras)
    fence, rally = Fence(), RallyPoints()
    if _is_there(root, "geoFence", repairs):
        _read_part(root.get("geoFence"), "geoFence", repairs, extras)
        fence = read_fence_part(root.get("geoFence"), repairs)
    if _is_there(root, "rallyPoints", repairs):
        _read_part(root.get("rallyPoints"), "rallyPoints", repairs, extras)
        rally = read_rally_part(root.get("rallyPoints"))
    mission = root.get("mission")
    home = read_home(mission.get(_HOME), repairs, extras)
    items, entries = read_items(mission.get("items"), repairs)
    return PlanFile(
        Mission(home, items),
        fence,
        rally,
        mav_autopilot=mission.get("firmwareType").whole(),
        vehicle_type=mission.optional("vehicleType", Node.whole, int(VehicleClass.QUADROTOR)),
        cruise_speed_m_s=mission.optional("cruiseSpeed", Node.number, 15.0),
        hover_speed_m_s=mission.optional("hoverSpeed", Node.number, 5.0),
        entries=entries,
        extras=extras,
        repairs=tuple(repairs),
    )


def _is_there(root: Node, name: str, repairs: list[str]) -> bool:
    """Whether the plan has a fence or rally points."""
    if name in root.value:
        return True
    repairs.append(f"plan.{name} is missing; the plan was read without it")
    return False


def read_home(node: Node, repairs: list[str], extras: dict[str, Mapping[str, Any]]) -> GeoPoint | None:
    """The planned home. One without a height, as QGroundControl saves it without terrain data, is kept but not used."""
    entries = node.nodes()
    if len(entries) != 3 or entries[2].value is not None:
        return GeoPoint(*node.floats(3))
    for entry in entries[:2]:
        entry.number()
    repairs.append(f"{node.where}: the position has no height, so the mission has no home")
    extras["mission"] = {**extras.get("mission", {}), _HOME: node.value}
    return None


def _read_part(node: Node, name: str, repairs: list[str], extras: dict[str, Mapping[str, Any]]) -> None:
    """Check the version of a part of the document, and keep the keys that are not modelled."""
    version, known = _CONSTANTS[name]["version"], _MODELLED[name]
    found = node.optional("version", lambda entry: entry.value, None)
    if found is None:
        repairs.append(f"{node.where}.version: the key is missing; read as version {version}")
    elif name in _OLD_PARTS and found == 1 and found is not True:
        repairs.append(f"{node.where}: this is the old version 1; it will be written as version {version}")
        known = known | _OLD_KEYS
    elif found != version:
        what = f"unknown version {found!r:.20}"
        raise FormatError(
            what, where=f"{node.where}.version", advice=f"the version must be {version}; save the plan again"
        )
    constants = _CONSTANTS[name]
    others = {
        key: value
        for key, value in node.value.items()
        if key not in known and not (key in constants and constants[key] == value)
    }
    if others:
        extras[name] = others


def read_items(node: Node, repairs: list[str]) -> tuple[tuple[MissionItem, ...], tuple[PlanEntry, ...]]:
    """The items of a list in flying order, and its complex entries; contradictions are listed."""
    items: list[MissionItem] = []
    entries: list[PlanEntry] = []
    by_jump_id: dict[object, int] = {}
    jumps: list[tuple[int, Node]] = []
    for entry in node.nodes():
        first = len(items)
        kind = entry.get("type").value
        if kind == "ComplexItem":
            flown = read_complex(entry)
            items += flown or ()
            entries.append(PlanEntry(first, flown or (), entry.value, flown is not None))
            continue
        if kind != "SimpleItem":
            raise FormatError(f"{str(kind)[:30]!r} is neither SimpleItem nor ComplexItem", where=f"{entry.where}.type")
        item = read_simple(entry)
        repairs += contradictions(entry, item)
        items.append(item)
        by_jump_id.setdefault(entry.optional("doJumpId", Node.whole, first + 1), first + 1)
        if item.command == Command.DO_JUMP:
            jumps.append((first, entry))
        if entry.value != simple_json(first + 1, item):
            entries.append(PlanEntry(first, (item,), entry.value))
    for first, entry in jumps:
        target = by_jump_id.get(items[first].params[0])
        if target is None:
            what = f"the jump leads to {items[first].params[0]:g}, but no simple item has this doJumpId"
            raise FormatError(what, where=f"{entry.where}.params[0]")
        _, p2, p3, p4 = items[first].params
        items[first] = dataclasses.replace(items[first], params=(float(target), p2, p3, p4))
    kept = (dataclasses.replace(e, items=tuple(items[e.first : e.first + len(e.items)])) for e in entries)
    return tuple(items), tuple(kept)


# QGroundControl's JSON files from before ``.plan``: ``.mission`` of versions 1 and 2, ``.fence`` and ``.rally``.
#
# A ``.mission`` of version 1 has an item's parameters as ``param1`` to ``param4`` and a ``coordinate``, and home as such an
# item; one of version 2 is what a ``.plan`` has as its part ``mission``. They are read_old_json, and written as ``.plan``.

_VERSIONS_1 = (1, "1", "1.0")


def read_old_json(text: str) -> MissionFile:
    """Read a file of any of the three kinds, which its header names.

    Raises:
        FormatError: with the place in the document; also for surveys, whose items these files do not contain.
    """
    clean = clean_text(text)
    root = parse_json(clean.text, "file")
    repairs = [*clean.repairs, "this is a QGroundControl file older than .plan"]
    kind = root.optional("fileType", lambda node: node.value, None)
    if kind == "GeoFence":
        return MissionFile(fence=read_fence_part(root, repairs), repairs=tuple(repairs))
    if kind == "RallyPoints":
        return MissionFile(rally=read_rally_part(root), repairs=tuple(repairs))
    if kind not in (None, "Mission") or "items" not in root.value:
        raise FormatError("the JSON is not a mission", where="file", advice="choose a .plan or .mission file")
    version = root.optional("version", lambda node: node.value, 1)
    if version in _VERSIONS_1 and version is not True:
        return MissionFile(_mission_of_version_1(root, repairs), repairs=tuple(repairs))
    if version != 2:
        raise FormatError(f"unknown version {version!r:.20}", where="file.version", advice="the version must be 1 or 2")
    extras: dict[str, Mapping[str, Any]] = {}
    home = read_home(root.get("plannedHomePosition"), repairs, extras)
    items, entries = read_items(root.get("items"), repairs)
    _refuse_surveys(not all(entry.is_flyable for entry in entries))
    return MissionFile(Mission(home, items), repairs=tuple(repairs))


def _mission_of_version_1(root: Node, repairs: list[str]) -> Mission:
    nothing: list[Node] = []
    _refuse_surveys(bool(root.optional("complexItems", Node.nodes, nothing)))
    items: list[MissionItem] = []
    numbers: dict[int, int] = {}
    for number, node in enumerate(root.get("items").nodes(), start=1):
        items.append(_item(node))
        numbers.setdefault(node.optional("id", Node.whole, number), number)
    home: GeoPoint | None = None
    if "plannedHomePosition" in root.value:
        home = _home(root.get("plannedHomePosition"), repairs)
    return Mission(home, tuple(_jump_to(item, numbers) for item in items))


def _home(node: Node, repairs: list[str]) -> GeoPoint | None:
    extras: dict[str, Mapping[str, Any]] = {}
    position = node.get("coordinate") if isinstance(node.value, Mapping) else node
    return read_home(position, repairs, extras)


def _item(node: Node) -> MissionItem:
    """An item of version 1, put into the form of version 2."""
    names = ("param1", "param2", "param3", "param4")
    params = [node.get(name).value for name in names] + [one.value for one in node.get("coordinate").nodes()]
    return read_simple(Node({**node.value, "params": params}, node.where))


def _jump_to(item: MissionItem, numbers: Mapping[int, int]) -> MissionItem:
    """A jump goes to the ``id`` of an item, which need not be its number."""
    if item.command != Command.DO_JUMP:
        return item
    target, p2, p3, p4 = item.params
    if target not in numbers:
        what = f"the jump leads to {target:g}, but no item has this ID"
        raise FormatError(what, where="file.items", advice="change the jump")
    return dataclasses.replace(item, params=(float(numbers[int(target)]), p2, p3, p4))


def _refuse_surveys(there_are_some: bool) -> None:
    if there_are_some:
        what = "the file does not contain the items of the survey"
        raise FormatError(what, where="file", advice="upload it with QGroundControl and download the mission")

"""Items with implausible positions or values, and items that change the flight without a position.

What autopilots do with them is as in ArduPilot's AP_Mission.cpp, ModeAuto and ArduPlane's commands_logic.cpp, and in PX4's
navigator_main.cpp and FeasibilityChecker.cpp.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final

import numpy as np

from mission_io.formats.text import FAR_FROM_HOME_M
from mission_io.model.items import (
    LAST_NAVIGATION,
    Command,
    Frame,
    GeoPoint,
    Mission,
    MissionItem,
    SpeedType,
    ground_distance_m,
)
from uavcover.extras.check.findings import CheckFinding, Weight
from uavcover.extras.check.tuning import PATH
from uavcover.extras.check.world import Aircraft
from uavcover.kernels.arrays import FloatArray
from uavcover.model.vehicle import AutopilotName

Heights = Callable[[FloatArray, FloatArray], FloatArray]
"""Heights of the ground above sea level at latitudes and longitudes, NaN without one."""
Doubt = Callable[[float, float], str]
"""Reason to distrust the height at a latitude and longitude; empty if there is none."""

OTHER_DATA = (
    "use other elevation data, or mark its missing heights (gdal_edit.py -a_nodata); if the data is "
    "correct, add --trust-dem"
)
"""Remedy for heights that do not look like ground."""


@dataclass(frozen=True, slots=True)
class MissionPositions:
    """Positions of a mission."""

    home: GeoPoint | None  # on the ground; None if unknown, and nothing can be judged
    skipped: frozenset[int]  # numbers of items whose place cannot be meant
    findings: tuple[CheckFinding, ...]  # what is wrong with places


def believed(_lat_deg: float, _lon_deg: float) -> str:
    """Every height is believed."""
    return ""


def positions_of(
    mission: Mission,  # whose places
    heights: Heights,  # of the ground
    autopilot: AutopilotName,  # PX4 flies to 0, 0; ArduPilot stays where it is
    *,
    # latitude and longitude of the take-off position; None: the mission's, or its first place
    home: tuple[float, float] | None = None,
    doubt: Doubt = believed,  # why heights are missing that the elevation data has
) -> MissionPositions:
    """Check home and the positions of the items."""
    findings: list[CheckFinding] = []
    numbers = [
        n for n, item in enumerate(mission.items, 1) if item.has_position and _is_position(item.lat_deg, item.lon_deg)
    ]
    lat = np.array([mission.items[n - 1].lat_deg for n in numbers])
    lon = np.array([mission.items[n - 1].lon_deg for n in numbers])
    ground = _heights(heights, lat, lon)
    at = _home_position(mission, home, lat, lon, findings)
    if at is None:
        what, do = "no mission item has a position", "use a mission that contains waypoints"
        findings.append(CheckFinding(kind="place", weight="unknown", what=what, do=do))
        return MissionPositions(None, frozenset(), tuple(findings))
    height = float(_heights(heights, np.array([at[0]]), np.array([at[1]]))[0])
    if not math.isfinite(height) and (why := doubt(*at)):
        what = f"home, the reference of the heights, is on {why}"
        findings.append(_at("suspect-ground", "unknown", 0, at, what=what, do=OTHER_DATA))
        return MissionPositions(None, frozenset(), tuple(findings))
    if not math.isfinite(height):
        findings.append(_home_elsewhere(at, heights, known=bool(np.isfinite(ground).any())))
        return MissionPositions(None, frozenset(), tuple(findings))
    if home is None and mission.home is not None and at == (mission.home.lat_deg, mission.home.lon_deg):
        _compare_home(mission.home.alt_amsl_m, at, height, findings)
    skipped = _far_items(at, heights, dict(zip(numbers, zip(lat, lon, ground, strict=True), strict=True)), findings)
    _zeros(mission, autopilot, findings)
    return MissionPositions(GeoPoint(at[0], at[1], height), frozenset(skipped), tuple(findings))


def _at(
    kind: str, weight: Weight, number: int, lat_lon_deg: tuple[float, float], *, what: str, do: str
) -> CheckFinding:
    lat, lon = map(float, lat_lon_deg)
    return CheckFinding(kind=kind, weight=weight, items=(number, number), lat_deg=lat, lon_deg=lon, what=what, do=do)


def _is_position(lat_deg: float, lon_deg: float) -> bool:
    return math.isfinite(lat_deg) and math.isfinite(lon_deg) and (lat_deg, lon_deg) != (0.0, 0.0)


def _heights(heights: Heights, lat: FloatArray, lon: FloatArray) -> FloatArray:
    """Heights of places that may be anywhere; those that are no places on Earth have none."""
    out = np.full(len(lat), np.nan)
    real = (np.abs(lat) <= 90.0) & (np.abs(lon) <= 180.0)
    # Places near to each other at once: far ones in one window would read all between them.
    parts: dict[tuple[float, float], list[int]] = {}
    for k in np.flatnonzero(real).tolist():
        parts.setdefault((lat[k] // PATH.near_deg, lon[k] // PATH.near_deg), []).append(k)
    for numbers in parts.values():
        out[numbers] = heights(lat[numbers], lon[numbers])
    return out


def _home_position(
    mission: Mission, home: tuple[float, float] | None, lat: FloatArray, lon: FloatArray, findings: list[CheckFinding]
) -> tuple[float, float] | None:
    if home is not None:
        return home
    if mission.home is not None and _is_position(mission.home.lat_deg, mission.home.lon_deg):
        return mission.home.lat_deg, mission.home.lon_deg
    if not len(lat):
        return None
    what = "the mission has no home, so take-off was assumed below its first position"
    findings.append(_at("home", "look", 0, (lat[0], lon[0]), what=what, do="specify home with --home LAT,LON"))
    return float(lat[0]), float(lon[0])


def _home_elsewhere(at: tuple[float, float], heights: Heights, *, known: bool) -> CheckFinding:
    swapped = abs(at[1]) <= 90.0 and math.isfinite(float(_heights(heights, np.array([at[1]]), np.array([at[0]]))[0]))
    if swapped:
        what, do = "latitude and longitude of home seem to be swapped", "swap the two values"
    elif known:
        what = "home lies outside the elevation data, but the route lies inside"
        do = "specify the take-off position with --home LAT,LON"
    else:
        what, do = "the mission lies outside the elevation data", "use elevation data for its location"
    return _at("place", "breaks", 0, at, what=what, do=do)


def _compare_home(stated_m: float, at: tuple[float, float], height_m: float, findings: list[CheckFinding]) -> None:
    if math.isfinite(stated_m) and abs(stated_m - height_m) > PATH.home_difference_m:
        what = (
            f"home is {stated_m:.0f} m above sea level in the file, but the ground there is {height_m:.0f} m; "
            "heights above home were measured from the ground"
        )
        found = _at("home", "look", 0, at, what=what, do="compare the vertical datums, or move home")
        findings.append(replace(found, alt_amsl_m=stated_m, by=abs(stated_m - height_m), unit="m"))


def _far_items(
    at: tuple[float, float],
    heights: Heights,
    items: dict[int, tuple[float, float, float]],
    findings: list[CheckFinding],
) -> list[int]:
    skipped = []
    for number, (lat, lon, ground_m) in items.items():
        if math.isfinite(ground_m) and ground_distance_m(*at, lat, lon) <= FAR_FROM_HOME_M:
            continue
        swapped_m = _heights(heights, np.array([lon]), np.array([lat]))[0] if abs(lon) <= 90.0 else math.nan
        distance_m = ground_distance_m(*at, lat, lon)
        if math.isfinite(swapped_m):
            what, do = "latitude and longitude seem to be swapped", "swap the two values"
        elif distance_m > FAR_FROM_HOME_M:
            what, do = f"{distance_m / 1000.0:.0f} km from home", "correct its position"
        else:
            continue  # near, over unknown ground: the legs tell
        skipped.append(number)
        found = _at("place", "breaks", number, (lat, lon), what=what, do=f"{do}; this item was ignored")
        findings.append(replace(found, by=distance_m, unit="m"))
    return skipped


def _zeros(mission: Mission, autopilot: AutopilotName, findings: list[CheckFinding]) -> None:
    for number, item in enumerate(mission.items, 1):
        if item.has_position and item.lat_deg == 0.0 and item.lon_deg == 0.0 and item.command == Command.NAV_WAYPOINT:
            weight: Weight = "breaks" if autopilot == "px4" else "look"
            what = "this waypoint is at latitude 0, longitude 0"
            what += "" if autopilot == "px4" else ": ArduPilot holds its position"
            findings.append(
                _at("place", weight, number, (0.0, 0.0), what=what, do="specify its position, or remove it")
            )


_ARDUPILOT_TURNS, _ARDUPILOT_RADIUS_M, _ARDUPILOT_WAIT_S = 255.0, 2550.0, 65_535.0
"""ArduPilot keeps a circle in two bytes, and a time too."""
_TIMED: Final = (Command.NAV_WAYPOINT, Command.NAV_SPLINE_WAYPOINT, Command.NAV_LOITER_TIME)
_CIRCLES: Final = (Command.NAV_LOITER_UNLIM, Command.NAV_LOITER_TURNS, Command.NAV_LOITER_TIME)
_TAKEOFFS: Final = (Command.NAV_TAKEOFF, Command.NAV_VTOL_TAKEOFF)
_POSITIONS: Final = (
    *_CIRCLES, *_TAKEOFFS, Command.NAV_WAYPOINT, Command.NAV_SPLINE_WAYPOINT, Command.NAV_LOITER_TO_ALT, Command.NAV_LAND,
    Command.NAV_VTOL_LAND,
)  # fmt: skip
_WAITS: Final = {
    int(Command.NAV_WAYPOINT): "waits", int(Command.NAV_SPLINE_WAYPOINT): "waits", int(Command.NAV_LOITER_TIME): "circles",
    int(Command.NAV_DELAY): "waits", int(Command.CONDITION_DELAY): "delays the following items",
}  # fmt: skip
_Problem = tuple[Weight, str, str]
"""Weight, problem, remedy."""


def impossible_numbers(mission: Mission) -> list[CheckFinding]:
    """Numbers that no aircraft flies; nothing else of such a mission is judged."""
    found = []
    for number, item in enumerate(mission.items, 1):
        problems = []
        if item.has_position and abs(item.alt_m) > PATH.highest_m:
            problems.append(f"a height of {item.alt_m:g} m")
        if item.command in _CIRCLES and abs(item.params[2]) > PATH.widest_m:
            problems.append(f"a circle of {item.params[2]:g} m")
        if item.command == Command.NAV_LOITER_TURNS and abs(item.params[0]) > PATH.most_turns:
            problems.append(f"{item.params[0]:g} turns")
        if item.command == Command.DO_CHANGE_SPEED and item.params[1] > PATH.fastest_m_s:
            problems.append(f"a speed of {item.params[1]:g} m/s")
        if item.command in _WAITS and math.isinf(item.params[0]):
            problems.append(f"{item.params[0]:g} s of waiting time")
        do = "correct this value; no other checks were made"
        found += [
            CheckFinding(kind="number", weight="breaks", items=(number, number), what=what, do=do) for what in problems
        ]
    return found


def value_findings(mission: Mission, aircraft: Aircraft, home: GeoPoint | None) -> list[CheckFinding]:
    """Items whose values do nothing, or not what was meant, and items that change what is flown.

    Args:
        mission: whose items.
        aircraft: whose autopilot carries them out.
        home: the take-off position; None if unknown.
    """
    land_starts = 0
    found = []
    for number, item in enumerate(mission.items, 1):
        problems = [*_frames(item), *_waits(item, aircraft), *_circles(item, aircraft), *_taking_over(item)]
        if item.command == Command.DO_CHANGE_SPEED:
            problems += _speeds(item, aircraft)
        if item.command == Command.DO_SET_HOME:
            problems += _homes(item, home)
        if item.command == Command.DO_LAND_START:
            land_starts += 1
            if land_starts > 1 and aircraft.autopilot == "px4":
                problems.append(
                    ("breaks", "this is a second DO_LAND_START, which PX4 refuses", "keep only one of them")
                )
        if aircraft.autopilot == "px4" and not item.autocontinue and item.command in _POSITIONS:
            what = "the mission does not continue automatically after this item (autocontinue 0)"
            problems.append(("look", what, "set autocontinue to 1, or fly with a pilot at the controls"))
        found += [
            CheckFinding(kind="value", weight=weight, items=(number, number), what=what, do=do)
            for weight, what, do in problems
        ]
    return found


def _frames(item: MissionItem) -> Iterator[_Problem]:
    """A place in the frame of items without a place."""
    if item.frame is not Frame.COMMAND or item.command not in _POSITIONS:
        return
    if (item.lat_deg, item.lon_deg) != (0.0, 0.0) or (item.command in _TAKEOFFS and item.alt_m != 0.0):
        what = "frame 2 is for items without a position; ArduPilot interprets this height as above sea level"
        yield "breaks", what, "use frame 3 (above home), 0 (above sea level) or 10 (above the terrain)"


def _waits(item: MissionItem, aircraft: Aircraft) -> Iterator[_Problem]:
    if item.command not in _WAITS:
        return
    time_s = item.params[0]
    by_the_clock = item.command == Command.NAV_DELAY and any(part >= 0.0 for part in item.params[1:])
    if time_s < 0.0 and not (by_the_clock and time_s == -1.0):
        yield "look", f"{_WAITS[item.command]} for {time_s:g} s, which is not a valid time", "use 0 seconds or more"
    if time_s > _ARDUPILOT_WAIT_S and aircraft.autopilot == "ardupilot" and item.command in _TIMED:
        what = f"{_WAITS[item.command]} for {time_s:g} s, but ArduPilot keeps only {_ARDUPILOT_WAIT_S:g}"
        yield "breaks", what, "use a shorter time, or insert two items"


def _circles(item: MissionItem, aircraft: Aircraft) -> Iterator[_Problem]:
    if item.command != Command.NAV_LOITER_TURNS:
        return
    turns, radius_m = item.params[0], abs(item.params[2])
    if turns < 0.0:
        what = f"{turns:g} turns: the autopilot's behaviour is unknown"
        yield "breaks", what, "use a number of turns above 0; a negative radius circles to the left"
    elif turns == 0.0:
        yield (
            "look", "0 turns: the vehicle flies to the circle and continues",
            "specify the number of turns, or use a waypoint",
        )  # fmt: skip
    elif aircraft.autopilot == "ardupilot" and turns > _ARDUPILOT_TURNS:
        yield (
            "breaks",
            f"{turns:g} turns, but ArduPilot keeps only {_ARDUPILOT_TURNS:g}",
            "divide the turns between two items",
        )
    if aircraft.autopilot == "ardupilot" and radius_m > _ARDUPILOT_RADIUS_M:
        what = f"a circle of {radius_m:g} m, but ArduPilot keeps only {_ARDUPILOT_RADIUS_M:g} m"
        yield "breaks", what, "replace the circle with waypoints"


def _speeds(item: MissionItem, aircraft: Aircraft) -> Iterator[_Problem]:
    kind, speed, throttle = item.params[:3]
    if not (math.isfinite(kind) and math.isfinite(speed)):
        yield "unknown", "the item changes the speed, but states no speed", "specify the speed in m/s"
        return
    if kind not in tuple(each.value for each in SpeedType):
        yield "look", f"{kind:g} is not a speed type (0 air, 1 ground, 2 climb, 3 descent)", "use one of these types"
    if speed > 0.0 or (speed == -1.0 and throttle > 0.0) or speed == -2.0:
        return  # -1 leaves the speed alone, -2 takes the default
    if aircraft.autopilot == "px4":
        does = "resets the speed to the default"
    elif aircraft.autopilot == "ardupilot" and aircraft.has_wings and kind == SpeedType.GROUND.value:
        does = "is interpreted as the minimum ground speed, which is then zero"
    elif speed == -1.0:
        return
    else:
        does = "changes nothing"
    yield "look", f"a speed of {speed:g} m/s {does}", "specify the speed in m/s; -2 selects the default"


def _homes(item: MissionItem, home: GeoPoint | None) -> Iterator[_Problem]:
    """A home that is moved: heights above home and the return count from there on from another one."""
    moved = "moves home, which changes heights above home and the return; the mission was judged with the original home"
    if item.params[0] != 1.0 and home is not None and item.has_position:
        away_m = ground_distance_m(home.lat_deg, home.lon_deg, item.lat_deg, item.lon_deg)
        above_m = item.alt_m - (home.alt_amsl_m if item.frame is Frame.AMSL else 0.0)
        if away_m < PATH.same_home_m and abs(above_m) < PATH.same_home_m:
            return
    yield "unknown", moved, "remove this item, or check the mission in two parts (--home)"


def _taking_over(item: MissionItem) -> Iterator[_Problem]:
    row = _TAKE_OVER.get(item.command)
    if row is not None:
        weight, what, applies = row
        if applies(item.params):
            yield weight, what, "remove this item, or ignore the findings of later items"
    elif item.command > LAST_NAVIGATION and not any(item.command in numbers for numbers in DEFINED):
        what = f"MAVLink does not define what command {item.command} does; the mission was judged without it"
        yield "unknown", what, "remove this item, or check what the autopilot does at this item"


def _always(_: tuple[float, float, float, float]) -> bool:
    return True


_TAKE_OVER: Final[Mapping[int, tuple[Weight, str, Callable[[tuple[float, float, float, float]], bool]]]] = MappingProxyType(
    {
        113: ("unknown", "changes the height at a given rate; the mission was judged without this change", _always),
        int(Command.DO_SET_MODE): ("unknown", "changes the flight mode: the vehicle then leaves this mission", _always),
        185: ("breaks", "terminates the flight: motors off", lambda params: params[0] > 0.5),
        186: ("unknown", "changes the height; the mission was judged without this change", _always),
        191: ("unknown", "starts a go-around, whose path the autopilot determines", _always),
        int(Command.DO_REPOSITION): ("unknown", "sends the vehicle to another position; the mission was judged "
                                                "without this change", _always),
        int(Command.DO_PAUSE_CONTINUE): ("look", "holds until a command to continue", lambda params: params[0] == 0.0),
        194: ("unknown", "reverses the direction of travel; judged without this change", lambda params: params[0] == 1.0),
        207: ("look", "disables the fence: the vehicle can leave the area", lambda params: params[0] == 0.0),
        208: ("breaks", "releases the parachute", lambda params: params[0] == 2.0),
        209: ("unknown", "runs single motors, which autopilots refuse in flight", _always),
        223: ("breaks", "stops the engine", lambda params: params[0] == 0.0),
        int(Command.DO_SET_MISSION_CURRENT): ("unknown", "continues at another item; the mission was judged without this "
                                                         "change", _always),
        246: ("breaks", "restarts or stops the autopilot", lambda params: params[0] > 0.0),
        252: ("unknown", "holds, or leaves this mission for another position", _always),
        262: ("unknown", "changes the flight mode: the vehicle then leaves this mission", _always),
        30001: ("unknown", "flies to a position to drop its payload; the mission was judged without this change", _always),
        int(Command.COMPONENT_ARM_DISARM): ("breaks", "disarms: motors off", lambda params: params[0] == 0.0),
    }
)  # fmt: skip


DEFINED: Final = tuple(
    range(first, last + 1)
    for first, last in (
        (112, 115), (176, 198), (200, 218), (220, 224), (241, 243), (245, 246), (252, 252), (260, 262), (300, 300), (310, 311),
        (400, 410), (420, 420), (500, 534), (600, 611), (1000, 1001), (2000, 2021), (2500, 2511), (2520, 2520), (2600, 2600),
        (2800, 2800), (3000, 3001), (4000, 4001), (4501, 4501), (5000, 5005), (5100, 5100), (5200, 5200), (5300, 5300),
        (10001, 10001), (10151, 10151), (30001, 30002), (32000, 32000), (40001, 40002), (42000, 42007), (42424, 42429),
        (42501, 42505), (42600, 42600), (42650, 42651), (42700, 42703), (43000, 43005), (60002, 60072),
    )
)  # fmt: skip
"""The commands above the navigation items that MAVLink defines; it leaves 31000 to 31014 to the builder of a vehicle."""

_JUMP_TAG, _DO_JUMP_TAG = 600, 601


@dataclass(frozen=True, slots=True)
class ItemOrder:
    """Items in flying order."""

    numbers: tuple[int, ...]  # of the items, the first being 1, as often as each is flown
    findings: tuple[CheckFinding, ...]  # jumps that lead nowhere or have no end


def order_of(items: Sequence[MissionItem], autopilot: AutopilotName = "ardupilot") -> ItemOrder:
    """Follow the jumps of a mission.

    ArduPilot resets the count of a jump that has run its times (AP_Mission::get_next_cmd); PX4 does not repeat an inner loop.
    """
    taken: Counter[int] = Counter()
    order: list[int] = []
    findings: list[CheckFinding] = []

    def found(kind: str, weight: Weight, first: int, what: str, do: str) -> None:
        findings.append(CheckFinding(kind=kind, weight=weight, items=(first, at), what=what, do=do))

    at, steps = 1, 0
    while 1 <= at <= len(items):
        item, following = items[at - 1], at + 1
        if item.command not in (Command.DO_JUMP, _DO_JUMP_TAG):
            order.append(at)
        else:
            target, times = item.params[:2]
            leads = f"a jump to {'tag' if item.command == _DO_JUMP_TAG else 'item'} {target:g}, {times:g} times"
            there = f"the mission has items 1 to {len(items)}"
            if item.command == _DO_JUMP_TAG:
                tags = (n for n, one in enumerate(items, 1) if one.command == _JUMP_TAG and one.params[0] == target)
                target, there = next(tags, 0), "no item of the mission has this tag"
            if not (1 <= target <= len(items) and target == int(target) and math.isfinite(times)):
                found("jump", "breaks", at, f"{leads}; {there}", "jump to an item of the mission")
            elif (
                target <= at
                and times != 0
                and all(one.command > LAST_NAVIGATION for one in items[int(target) - 1 : at - 1])
            ):
                do = "jump to an item with a position, or remove the jump"
                found("jump", "breaks", int(target), f"{leads}: this is an endless loop without a position", do)
            else:
                if times < 0 and not taken[at]:
                    what = f"jumps back to item {target:g} without end; {PATH.endless_passes} repeats were judged"
                    found("endless", "look", at, what, "specify the number of repeats, or monitor the battery")
                if taken[at] < (PATH.endless_passes if times < 0 else times):
                    taken[at] += 1
                    following = int(target)
                elif times >= 0 and autopilot == "ardupilot":
                    del taken[at]
        at = following
        if (steps := steps + 1) >= PATH.max_steps:
            what = f"with its jumps, the mission has more than {PATH.max_steps} items; the rest was not judged"
            found("endless", "unknown", at, what, "reduce the number of repeats of the jumps")
            break
    return ItemOrder(tuple(order), tuple(findings))

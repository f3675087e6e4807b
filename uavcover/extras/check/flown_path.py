"""The path that an autopilot flies for a mission: every item by its meaning for that autopilot.

The meanings are listed, with their sources, in docs/reference/checked_missions.md.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Literal

import numpy as np

from mission_io.model.items import LAST_NAVIGATION, Command, Frame, Mission, MissionItem, SpeedType
from uavcover.extras.check.findings import CheckFinding, Deed, FlownPath, Phase, Segment
from uavcover.extras.check.item_checks import order_of
from uavcover.extras.check.return_checks import OwnReturn, mission_return
from uavcover.extras.check.tuning import PATH
from uavcover.extras.check.turns import circle, spline, straight
from uavcover.extras.check.world import Aircraft, LocalFence, World
from uavcover.kernels.arrays import FloatArray

_REGION_OF_INTEREST, _GUIDED_ENABLE = 80, 92
_CONDITIONS: Final = (Command.CONDITION_DELAY, Command.CONDITION_DISTANCE)
CONDITIONAL: Final = "a condition delays this item, or skips it where the leg ends first; it was judged as immediate"
DO_IT_AT_ONCE: Final = "remove the condition before it, or insert a waypoint"
_FREE_FLIGHT: Final = frozenset({42702, 42703})
"""ArduPilot's NAV_SCRIPT_TIME and NAV_ATTITUDE_TIME: a script, or angles, fly in place of the mission."""

_BY_DEFAULT, _NO_FENCE = OwnReturn(), LocalFence()


@dataclass(frozen=True, slots=True)
class _Position:
    """East, north, and a height above sea level, or above the terrain where ``over_terrain``."""

    east_m: float
    north_m: float
    height_m: float
    over_terrain: bool = False

    @property
    def array(self) -> FloatArray:
        return np.array([self.east_m, self.north_m, self.height_m])


def flown_path(
    mission: Mission, world: World, aircraft: Aircraft, own: OwnReturn = _BY_DEFAULT, fence: LocalFence = _NO_FENCE,
    *, skipped: frozenset[int] = frozenset(),
) -> FlownPath:  # fmt: skip
    """The path of a mission that begins on the ground at home.

    Args:
        mission: its items.
        world: where home and the ground are.
        aircraft: who flies it.
        own: where the autopilot returns to at a RETURN_TO_LAUNCH.
        fence: outside of which ArduPilot leaves out rally points.
        skipped: numbers of items that are omitted because their place is not one to fly to.
    """
    item_order = order_of(mission.items, aircraft.autopilot)
    flight = _Flight(mission, world, aircraft, own, fence)
    order = [number for number in item_order.numbers if number not in skipped]
    for k, number in enumerate(order):
        if not flight.has_ended or flight.begins_again(number):
            flight.fly(number, order[k + 1 :])
    flight.end(skipped)
    return FlownPath(tuple(flight.segments), (*item_order.findings, *flight.findings), tuple(flight.deeds))


class _Flight:
    """Flies items one after the other."""

    def __init__(self, mission: Mission, world: World, aircraft: Aircraft, own: OwnReturn, fence: LocalFence) -> None:
        self._items, self._world, self._aircraft = mission.items, world, aircraft
        self._own, self._fence = own, fence
        self._at = _Position(0.0, 0.0, world.home_alt_amsl_m)
        self._number = 0
        self._speed_m_s = aircraft.cruise_speed_m_s
        self._wait_s = 0.0
        self._vector_m: FloatArray | None = None
        """Along which the last leg arrived without a stop; ArduCopter's next spline begins with it."""
        self._then: list[int] = []
        self._is_up = False
        self._is_over = False
        self._is_conditional = False
        """Whether items that fly nowhere wait for a condition on the way to the next place."""
        self._flown: set[int] = set()
        self.segments: list[Segment] = []
        self.deeds: list[Deed] = []
        self.findings: list[CheckFinding] = []

    @property
    def has_ended(self) -> bool:
        """Whether it has landed or returned."""
        return self._is_over

    def begins_again(self, number: int) -> bool:
        """Whether an item is flown although the flight has ended before: a take-off, or a landing sequence of wings."""
        command = self._items[number - 1].command
        again = command in _TAKEOFFS or (command == Command.DO_LAND_START and self._aircraft.has_wings)
        self._is_over = not again
        return again

    def fly(self, number: int, then: list[int]) -> None:
        """Fly one item; ``then`` are the numbers of those that follow."""
        item = self._items[number - 1]
        command = _COMMANDS.get(item.command)
        self._flown.add(number)
        self._is_conditional &= item.command > LAST_NAVIGATION
        if command is not None:
            self._then = then
            command(self, number, item)
        elif item.command in _FREE_FLIGHT or (item.command == _GUIDED_ENABLE and item.params[0] != 0.0):
            self._look(number, "meaning", f"command {item.command} gives control to another controller, so the path is unknown",
                       "check this part separately", "unknown")  # fmt: skip
        elif item.command > LAST_NAVIGATION or item.command in (_REGION_OF_INTEREST, _GUIDED_ENABLE):
            self.deeds.append(Deed(number, len(self.segments), self._is_conditional))
            self._is_conditional |= item.command in _CONDITIONS and item.params[0] > 0.0
        elif item.has_position and self._has_position(item):
            self._look(number, "meaning", f"command {item.command} is judged as a straight path to its position",
                       "check what the autopilot does at this item", "unknown")  # fmt: skip
            self._go(number, self._target(item), doubt=f"command {item.command}")
        else:
            self._look(number, "meaning", f"command {item.command} has no position, so its path is unknown",
                       "check what the autopilot does at this item", "unknown")  # fmt: skip

    def end(self, skipped: frozenset[int]) -> None:
        """Note what a whole flight has and this one has not, and the items that it never comes to."""
        numbers = [
            n for n, item in enumerate(self._items, 1) if item.command in _COMMANDS and item.command <= LAST_NAVIGATION
        ]
        missed = [n for n in numbers if n not in self._flown and n not in skipped]
        if missed and self.segments:
            which = (
                f"item {missed[0]} is"
                if len(missed) == 1
                else f"{len(missed)} items from {missed[0]} to {missed[-1]} are"
            )
            found = CheckFinding(
                kind="order", weight="look", items=(missed[0], missed[-1]), what=f"{which} never flown",
                do="check the jumps, and the landing or return before it",
            )  # fmt: skip
            self.findings.append(found)
        if not self.segments:
            self.findings.append(
                CheckFinding(
                    kind="empty",
                    weight="unknown",
                    what="the mission contains no item with a position",
                    do="use a mission that contains waypoints",
                )
            )
        elif not self._is_over:
            self._look(
                self._number, "end", "the mission ends in the air", "end the mission with a landing or a return", "look"
            )

    # What the items do.

    def _waypoint(self, number: int, item: MissionItem) -> None:
        self._check_is_up(number)
        hold_s = item.params[0] if self._aircraft.autopilot == "px4" or not self._aircraft.has_wings else 0.0
        self._go(number, self._target(item), wait_s=_number(hold_s))

    def _spline(self, number: int, item: MissionItem) -> None:
        if self._aircraft.autopilot == "px4" or self._aircraft.has_wings:
            self._look(
                number, "meaning", "only ArduCopter flies splines; this leg is judged as straight",
                "use a normal waypoint instead", "look",
            )  # fmt: skip
            self._waypoint(number, item)
            return
        self._check_is_up(number)
        target = self._target(item)
        # ArduPilot, AC_WPNav::set_spline_destination: vectors count only between heights of one kind.
        same = self._at.over_terrain == target.over_terrain
        begin = self._in_kind(self._at, over_terrain=target.over_terrain)
        begin_vector = self._vector_m if same and self._vector_m is not None else np.zeros(3)
        end_vector = np.zeros(3)
        follower = next((n for n in self._then if self._items[n - 1].command <= LAST_NAVIGATION), None)
        if follower is not None and _number(item.params[0]) == 0.0:
            next_item = self._items[follower - 1]
            onward = self._target(next_item, after=target) if next_item.has_position else target
            if onward.over_terrain == target.over_terrain:
                is_spline = next_item.command == Command.NAV_SPLINE_WAYPOINT
                end_vector = onward.array - (begin.array if is_spline else target.array)
        points = spline(begin.array, target.array, begin_vector, end_vector, step_m=PATH.spline_step_m)
        self._add(number, self._enu(points, target.over_terrain), wait_s=_number(item.params[0]), is_straight=False)
        self._at = target
        self._vector_m = end_vector if np.any(end_vector) else None

    def _takeoff(self, number: int, item: MissionItem) -> None:
        target = self._target(item)
        top = _Position(self._at.east_m, self._at.north_m, target.height_m, target.over_terrain)
        rises = item.command == Command.NAV_VTOL_TAKEOFF or not self._aircraft.has_wings
        if rises:
            self._go(number, top, phase="take-off")
            if self._aircraft.autopilot == "px4" and self._has_position(item):
                self._go(number, target)
        elif self._has_position(item):
            self._go(number, target, phase="take-off")
        else:
            self._look(number, "meaning", "the mission does not define the direction of this take-off",
                       "check the terrain around the runway", "look")  # fmt: skip
            self._go(number, top, phase="take-off", doubt="direction of the take-off")
        self._is_up = True
        self._vector_m = None

    def _loiter_turns(self, number: int, item: MissionItem) -> None:
        self._circle(number, item, turns=max(_number(item.params[0]), 0.0), radius_m=_number(item.params[2]))

    def _loiter_time(self, number: int, item: MissionItem) -> None:
        wait_s = max(_number(item.params[0]), 0.0)
        if not self._aircraft.has_wings:
            self._go(number, self._target(item), wait_s=wait_s)
            self._vector_m = None
            return
        self._circle(number, item, turns=1.0, radius_m=_number(item.params[2]), wait_s=wait_s)

    def _loiter_unlimited(self, number: int, item: MissionItem) -> None:
        self._look(number, "endless", "the vehicle stays here until a new command; later items are judged as if the "
                                      "mission continued",
                   "specify a time or a number of turns, or monitor the battery", "look")  # fmt: skip
        if self._aircraft.has_wings:
            self._circle(number, item, turns=1.0, radius_m=_number(item.params[2]))
        else:
            self._go(number, self._target(item))
            self._vector_m = None

    def _loiter_to_alt(self, number: int, item: MissionItem) -> None:
        target = self._target(item)
        if self._aircraft.has_wings:
            over = self._in_kind(self._at, over_terrain=target.over_terrain, where=target)
            self._circle(number, item, turns=1.0, radius_m=_number(item.params[1]), begin_height_m=over.height_m)
            return
        self._go(number, self._in_kind(self._at, over_terrain=target.over_terrain, where=target))
        self._go(number, target)
        self._vector_m = None

    def _return(self, number: int, _: MissionItem) -> None:
        self._at = self._in_kind(self._at, over_terrain=False)
        back, settings = mission_return(self._at.array, self._world, self._aircraft, self._own, self._fence)
        kind = round(settings["return_type"]) if self._aircraft.autopilot == "px4" else 0
        lands = any(item.command in (*_LANDINGS, Command.DO_LAND_START) for item in self._items)
        if kind in (2, 4) or (kind in (1, 3) and lands):
            self._look(number, "meaning", f"RTL_TYPE {kind} returns along the mission or to its landing; "
                       "this return is judged as a straight path to home or a safe point",
                       "set RTL_TYPE to 0, or replace the item by waypoints and a landing", "unknown")  # fmt: skip
        for point, stage in zip(back.points_m[0, 1:], back.stages, strict=True):
            east, north, alt = map(float, point)
            to = _Position(east, north, alt)
            if to != self._at:
                self._go(number, to, phase="landing" if stage in ("descend", "land") else "return")
        self._is_over = True

    def _land(self, number: int, item: MissionItem) -> None:
        target = self._target(item)
        ground = float(self._world.alts_amsl_m(self._world.above_ground([[target.east_m, target.north_m]], 0.0))[0])
        if item.command == Command.NAV_VTOL_LAND or not self._aircraft.has_wings:
            over = self._in_kind(self._at, over_terrain=self._at.over_terrain, where=target)
            if (over.east_m, over.north_m) != (self._at.east_m, self._at.north_m):
                self._go(number, over)
            self._go(number, _Position(target.east_m, target.north_m, ground), phase="landing")
        else:
            self._go(number, target, phase="landing")
        self._is_over = True

    def _delay(self, number: int, item: MissionItem) -> None:
        if any(part >= 0.0 for part in item.params[1:]) and _number(item.params[0]) <= 0.0:
            limited = self._aircraft.endurance_s is not None
            self._look(number, "endless", "the item waits until a time of day, so its duration depends on the take-off time",
                       "specify seconds, or monitor the battery", "unknown" if limited else "look")  # fmt: skip
        if self._aircraft.autopilot == "px4" and not self._aircraft.has_wings:  # docs/results/safety.md
            self._look(number, "meaning", "PX4 1.17 descends at a DELAY; in simulation it flew the next leg up to 38 m too low",
                       "set the waiting time in the preceding waypoint (parameter 1)", "unknown")  # fmt: skip
        self._wait(max(_number(item.params[0]), 0.0))
        self._vector_m = None

    def _change_speed(self, number: int, item: MissionItem) -> None:
        if self._is_conditional:
            self._look(number, "meaning", CONDITIONAL, DO_IT_AT_ONCE, "unknown")
        kind, speed = item.params[:2]
        px4 = self._aircraft.autopilot == "px4"  # which takes any kind as the speed on the way, and none as the default
        if speed > 0.0 and math.isfinite(speed) and (px4 or kind in (SpeedType.AIRSPEED.value, SpeedType.GROUND.value)):
            self._speed_m_s = speed
        elif not speed > 0.0 and (px4 or (speed == -2.0 and self._aircraft.has_wings)):
            self._speed_m_s = self._aircraft.cruise_speed_m_s

    # How it is done.

    def _check_is_up(self, number: int) -> None:
        if not self._is_up:
            self._is_up = True
            self._look(
                number, "take-off", "the mission starts without a take-off", "insert a take-off as the first item",
                "look",
            )  # fmt: skip

    def _circle(
        self,
        number: int,
        item: MissionItem,
        *,
        turns: float,
        radius_m: float,
        wait_s: float = 0.0,
        begin_height_m: float | None = None,
    ) -> None:
        center = self._target(item)
        radius = abs(radius_m) or self._aircraft.loiter_radius_m
        away = np.array([self._at.east_m - center.east_m, self._at.north_m - center.north_m])
        distance = float(np.hypot(*away))
        edge = center.array[:2] + (away / distance if distance > 0.0 else np.array([0.0, 1.0])) * radius
        height = center.height_m if begin_height_m is None else begin_height_m
        self._go(number, _Position(float(edge[0]), float(edge[1]), height, center.over_terrain))
        points = circle(
            center.array, radius, self._at.array, turns=turns, end_height_m=center.height_m, clockwise=radius_m >= 0.0
        )
        self._add(number, self._enu(points, center.over_terrain), wait_s=wait_s, is_straight=False)
        east, north, height = (float(value) for value in points[-1])
        self._at, self._vector_m = _Position(east, north, height, center.over_terrain), None

    def _go(self, number: int, to: _Position, *, phase: Phase = "route", wait_s: float = 0.0, doubt: str = "") -> None:
        begin = self._in_kind(self._at, over_terrain=to.over_terrain)
        step_m = PATH.terrain_step_m if to.over_terrain else PATH.leg_step_m
        points = straight(begin.array, to.array, step_m=step_m)
        self._add(
            number, self._enu(points, to.over_terrain), phase=phase, wait_s=wait_s, doubt=doubt,
            is_straight=not to.over_terrain,
        )  # fmt: skip
        stops = wait_s > 0.0 or phase != "route" or self._at.over_terrain != to.over_terrain
        self._vector_m = None if stops else to.array - begin.array
        self._at = to

    def _add(
        self, number: int, enu_m: FloatArray, *, phase: Phase = "route", wait_s: float = 0.0, is_straight: bool = True,
        doubt: str = "",
    ) -> None:  # fmt: skip
        self.segments.append(
            Segment((self._number, number), phase, enu_m, self._speed_m_s, wait_s + self._wait_s, is_straight, doubt)
        )
        self._number, self._wait_s = number, 0.0

    def _wait(self, wait_s: float) -> None:
        self._wait_s += wait_s

    def _enu(self, points: FloatArray, over_terrain: bool) -> FloatArray:
        make = self._world.above_ground if over_terrain else self._world.at_alts
        return make(points[:, :2], points[:, 2])

    def _in_kind(self, position: _Position, *, over_terrain: bool, where: _Position | None = None) -> _Position:
        """A place with its height in another kind, and perhaps with the position of another one."""
        height = position.height_m
        if position.over_terrain != over_terrain:
            en = [[position.east_m, position.north_m]]
            if over_terrain:
                height = float(self._world.ground.heights_agl_m(self._world.at_alts(en, height))[0])
            else:
                height = float(self._world.alts_amsl_m(self._world.above_ground(en, height))[0])
        at = position if where is None else where
        return _Position(at.east_m, at.north_m, height, over_terrain)

    def _has_position(self, item: MissionItem) -> bool:
        finite = math.isfinite(item.lat_deg) and math.isfinite(item.lon_deg)
        return finite and not (item.lat_deg == 0.0 and item.lon_deg == 0.0)

    def _target(self, item: MissionItem, *, after: _Position | None = None) -> _Position:
        """Position of an item. Zeros and NaN mean what was there before (ArduPilot, ModeAuto::loc_from_cmd)."""
        before = self._at if after is None else after
        east, north = before.east_m, before.north_m
        if item.has_position and self._has_position(item):
            east, north = self._world.position(item.lat_deg, item.lon_deg)
        over_terrain = item.frame is Frame.ABOVE_TERRAIN
        keeps = math.isnan(item.alt_m) or not item.has_position
        keeps |= item.alt_m == 0.0 and self._aircraft.autopilot == "ardupilot" and item.command not in _LANDINGS
        if keeps:
            return self._in_kind(before, over_terrain=before.over_terrain, where=_Position(east, north, 0.0))
        base = self._world.home_alt_amsl_m if item.frame is Frame.ABOVE_HOME else 0.0
        return _Position(east, north, base + item.alt_m, over_terrain)

    def _look(self, number: int, kind: str, what: str, do: str, weight: Literal["look", "unknown"]) -> None:
        found = CheckFinding(kind=kind, weight=weight, items=(number, number), what=what, do=do)
        if found not in self.findings:
            self.findings.append(found)


def _number(value: float) -> float:
    """A parameter; NaN leaves it to the vehicle, as 0 does."""
    return 0.0 if math.isnan(value) else value


_TAKEOFFS: Final = frozenset({Command.NAV_TAKEOFF, Command.NAV_VTOL_TAKEOFF})
_LANDINGS: Final = frozenset({Command.NAV_LAND, Command.NAV_VTOL_LAND})
_COMMANDS: Final[Mapping[int, Callable[[_Flight, int, MissionItem], None]]] = MappingProxyType(
    {
        int(Command.NAV_WAYPOINT): _Flight._waypoint,
        int(Command.NAV_SPLINE_WAYPOINT): _Flight._spline,
        int(Command.NAV_TAKEOFF): _Flight._takeoff,
        int(Command.NAV_VTOL_TAKEOFF): _Flight._takeoff,
        int(Command.NAV_LOITER_TURNS): _Flight._loiter_turns,
        int(Command.NAV_LOITER_TIME): _Flight._loiter_time,
        int(Command.NAV_LOITER_UNLIM): _Flight._loiter_unlimited,
        int(Command.NAV_LOITER_TO_ALT): _Flight._loiter_to_alt,
        int(Command.NAV_RETURN_TO_LAUNCH): _Flight._return,
        int(Command.NAV_LAND): _Flight._land,
        int(Command.NAV_VTOL_LAND): _Flight._land,
        int(Command.NAV_DELAY): _Flight._delay,
        int(Command.DO_CHANGE_SPEED): _Flight._change_speed,
    }
)

"""Flights of the mock vehicle: along its mission, and home by ArduCopter's or PX4's return modes.

The returns follow the vehicle's parameters. They share no code with ``uavcover/missions/failsafe_path.py``, which predicts
returns: a flight on the mock tests the prediction.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

from mission_io.autopilots.autopilot import Mode
from mission_io.model.enums import MissionState, Severity
from mission_io.model.items import LAST_NAVIGATION, Command, Frame, MissionType
from mission_io.wire import messages as m
from uavcover.mock.behaviour import FLIGHT, Speeds
from uavcover.mock.body import SMART_RTL
from uavcover.mock.dynamics import Vector
from uavcover.mock.faults import FaultKind
from uavcover.mock.itinerary import Step, StepKind, halting_point, mission_steps
from uavcover.mock.state import MockState
from uavcover.mock.telemetry import tell

_TAKEOFFS = (Command.NAV_TAKEOFF, 24, 84)
"""MAV_CMD_NAV_TAKEOFF, NAV_TAKEOFF_LOCAL and NAV_VTOL_TAKEOFF."""


class MissionFlight:
    """Follows the mission of a vehicle; keeps ``mission_state`` and ``current_seq`` of its state.

    Attributes:
        heights_are_old: whether home has moved, so that the next item begins at other heights.
    """

    def __init__(self, state: MockState) -> None:
        self._state = state
        self.heights_are_old = False
        self._reached: int | None = None
        self._reports_due: list[float] = []

    @property
    def first_seq(self) -> int:
        """Wire number of the first item to fly."""
        return 1 if self._state.autopilot.home_in_item_0 else 0

    @property
    def there_is_one(self) -> bool:
        """Whether the vehicle holds a mission."""
        return len(self._state.mission_items) > self.first_seq

    @property
    def starts_with_takeoff(self) -> bool:
        """Whether the next item of ArduPilot's kind "nav" that is no delay is a take-off (AP_Mission::is_takeoff_next)."""
        items = self._state.mission_items[max(self.first_seq, self._state.current_seq) :]
        navigates = (
            item.command for item in items if item.command < LAST_NAVIGATION and item.command != Command.NAV_DELAY
        )
        return next(navigates, None) in _TAKEOFFS

    @property
    def needs_terrain(self) -> bool:
        """Whether an item is above terrain, and requested terrain is missing; ArduPilot waits for all of it."""
        feed = self._state.terrain
        if feed is None or feed.pending == 0:
            return False
        items = self._state.mission_items[self.first_seq :]
        return any(item.frame is Frame.ABOVE_TERRAIN and item.has_position for item in items)

    def reset(self) -> None:
        """Forget all progress, as after a reboot."""
        self._begin_at(0)

    def rewind(self) -> None:
        """Go back to before the first item."""
        self._begin_at(self.first_seq)

    def pause(self) -> None:
        """Interrupt the mission at its current item."""
        if self._state.mission_state is MissionState.ACTIVE:
            self._state.mission_state = MissionState.PAUSED

    def enter(self) -> None:
        """Continue it after another mode: PX4 first climbs on the spot to the next item's height (checkClimbRequired)."""
        state, here = self._state, self._state.body.believed.position_m
        ahead = [position[2] for seq, position in mission_positions(state).items() if seq >= state.current_seq]
        if state.is_ardupilot or not state.flying or not ahead or ahead[0] - here[2] <= FLIGHT.climb_from_m:
            self.start()
            return
        seq = max(state.current_seq, self.first_seq)
        top = Step(seq, StepKind.GO, state.speeds, (here[0], here[1], ahead[0]), FLIGHT.climb_from_m)
        self.start([top, Step(seq, StepKind.WAIT, state.speeds)])
        state.say(Severity.INFO, f"Climb to {ahead[0] - state.body.home_m[2]:.1f} meters above home")

    def start(self, before: Sequence[Step] = ()) -> None:
        """Fly the mission from its current item on."""
        state = self._state
        self.heights_are_old = False
        state.current_seq = max(state.current_seq, self.first_seq)
        steps = mission_steps(
            state.mission_items,
            state.current_seq,
            position=state.position,
            settings=state.settings,
            speeds=state.speeds,
            return_steps=lambda seq, begin, speeds: return_steps(state, speeds, seq=seq, begin=begin),
        )
        state.mission_state = MissionState.ACTIVE
        state.follow([*before, *steps])
        state.body.itinerary.stuck = state.faults.is_going_on(FaultKind.STUCK)
        tell(state, m.MissionCurrent)

    def go_to(self, seq: int) -> bool:
        """Make another item the current one; False for one that does not exist."""
        state = self._state
        if not self.first_seq <= seq < len(state.mission_items):
            return False
        state.current_seq = seq
        if state.mission_state is MissionState.COMPLETE:
            state.mission_state = MissionState.PAUSED
        return True

    def drop_reports(self) -> None:
        """Do not report items of the previous mission any more."""
        self._reached, self._reports_due = None, []

    def go_on(self, now: float) -> None:
        """Report the reached items, and the current one."""
        state = self._state
        if self._reports_due and now >= self._reports_due[0] and self._reached is not None:
            self._reports_due.pop(0)
            state.send(m.MissionItemReached(self._reached))
        if state.mission_state is not MissionState.ACTIVE:
            return
        itinerary = state.body.itinerary
        while itinerary.camera:
            state.send_all(state.camera.obey(itinerary.camera.pop(0), now))
        while itinerary.completed:
            self._item_reached(itinerary.completed.pop(0), now)
        step = itinerary.step
        if step is None:
            self._complete()
        elif step.seq is not None and step.seq != state.current_seq:
            state.current_seq = step.seq
            state.speeds = step.speeds
            if self.heights_are_old:
                self.start()
            else:
                tell(state, m.MissionCurrent)

    def landed(self, now: float) -> None:
        """Note the touchdown, which completes a mission that ends with a landing."""
        step = self._state.body.itinerary.step
        if self._state.mission_state is MissionState.ACTIVE and step is not None and step.seq is not None:
            self._item_reached(step.seq, now)
            self._complete()

    def _begin_at(self, seq: int) -> None:
        self._state.current_seq, self._state.mission_state = seq, MissionState.NOT_STARTED
        self.drop_reports()

    def _item_reached(self, seq: int, now: float) -> None:
        if self._state.is_ardupilot:
            self._state.send(m.MissionItemReached(seq))
            return
        # PX4 looks at intervals and repeats itself: items passed in between are never reported.
        self._reached = seq
        self._reports_due = [now + FLIGHT.report_s, now + FLIGHT.report_s + FLIGHT.repeat_s]

    def _complete(self) -> None:
        self._state.mission_state = MissionState.COMPLETE
        tell(self._state, m.MissionCurrent)


_PATTERN = (16, 17, 19, 21, 22, 31, 84, 85)
"""Commands whose items have a position for PX4: waypoint, loiter, land, take-off (MissionBlock::item_contains_position)."""
_LANDINGS, _PX4_TAKEOFFS = (21, 85), (22, 84)
_RALLY_FRAMES = {
    "ardupilot": (Frame.AMSL, Frame.ABOVE_HOME, Frame.ABOVE_TERRAIN),
    "px4": (Frame.AMSL, Frame.ABOVE_HOME),
}


def return_steps(
    state: MockState, speeds: Speeds, *, was: Mode = Mode.MISSION, seq: int | None = None, begin: Vector | None = None
) -> list[Step]:
    """The steps of a return.

    Args:
        state: of the vehicle.
        speeds: to fly at.
        was: the mode before: PX4 returns along its mission from another item where that was not its mission.
        seq: mission item that asks for it.
        begin: where it begins, at rest; None: here, at the present speed.
    """
    if state.is_ardupilot:
        if state.custom_mode == SMART_RTL and seq is None:
            return _smart_rtl(state, speeds)
        return _rtl(state, speeds, seq, begin)
    if state.parameters["RTL_TYPE"] in (2.0, 4.0):
        return _along_mission(state, speeds, was, seq, begin)
    return _return_mode(state, speeds, seq, begin)


def _smart_rtl(state: MockState, speeds: Speeds) -> list[Step]:
    """Back along the flown path to above where it was armed."""
    x, y, z = (back := state.trail.back())[-1]
    steps = [_brake(state, speeds, None)]
    steps += [Step(None, StepKind.GO, speeds, point) for point in (*back[:-1], (x, y, z + FLIGHT.above_start_m))]
    if (final_m := state.parameters["RTL_ALT_FINAL"] / 100.0) > 0.0:
        return [
            *steps,
            Step(None, StepKind.GO, speeds, (x, y, state.body.home_m[2] + final_m), FLIGHT.return_settled_m),
        ]
    return [*steps, Step(None, StepKind.DESCEND, speeds)]


def _rtl(state: MockState, speeds: Speeds, seq: int | None, begin: Vector | None) -> list[Step]:
    get, home = state.parameters, state.body.home_m
    here = state.body.believed.position_m if begin is None else begin
    rest = halting_point(state.body.believed) if begin is None else begin
    rally = _copters_rally_point(state, here)
    there = home if rally is None else rally
    above_home = here[2] - home[2]
    steps: list[Step] = []
    if begin is None:
        steps.append(_brake(state, speeds, seq))
    if get["RTL_SPEED"] > 0.0:
        speeds = Speeds(get["RTL_SPEED"] / 100.0, speeds.climb_m_s, speeds.descent_m_s)
    if get["RTL_ALT_TYPE"] == 1.0 and get["TERRAIN_ENABLE"]:
        steps += _over_terrain(state, speeds, seq, (here, rest, there))
    else:
        height = _rtl_height(state, above_home, there[2] - home[2], math.dist(rest[:2], there[:2]))
        height = max(min(height, state.fence.highest_m), above_home)
        top = (rest[0], rest[1], home[2] + height)
        steps.append(Step(seq, StepKind.CLIMB, speeds, top))
        steps.append(Step(seq, StepKind.LEVEL, speeds, (there[0], there[1], top[2])))
    steps.append(Step(seq, StepKind.WAIT, speeds, wait_s=get["RTL_LOIT_TIME"] / 1000.0))
    if get["RTL_ALT_FINAL"] > 0.0:  # above home, wherever the rally point is
        end = (there[0], there[1], home[2] + get["RTL_ALT_FINAL"] / 100.0)
        steps.append(Step(seq, StepKind.GO, speeds, end, FLIGHT.return_settled_m))
    else:
        steps.append(Step(seq, StepKind.DESCEND, speeds))
    return steps


def _rtl_height(state: MockState, now_m: float, end_m: float, away_m: float) -> float:
    """Height of a return, above home or the terrain, from the present height and that of its end."""
    get = state.parameters
    lowest = max(0.3, now_m + max(0.0, get["RTL_CLIMB_MIN"] / 100.0))
    height = max(end_m, get["RTL_ALT"] / 100.0, lowest)
    slope = get["RTL_CONE_SLOPE"]
    return min(height, max(away_m * slope, lowest)) if slope >= 0.5 else height


def _brake(state: MockState, speeds: Speeds, seq: int | None) -> Step:
    """Come to rest."""
    (vx, vy, _), pull = state.body.believed.velocity_m_s, state.body.point.airframe.max_acceleration_m_s2
    return Step(seq, StepKind.WAIT, speeds, wait_s=math.hypot(vx, vy) / pull)


def _over_terrain(state: MockState, speeds: Speeds, seq: int | None, path: tuple[Vector, Vector, Vector]) -> list[Step]:
    here, rest, there = path
    now_m, end_m = (position[2] - _ground_m(state, position[0], position[1]) for position in (here, there))
    length = math.dist(rest[:2], there[:2])
    wanted = _rtl_height(state, now_m, end_m, length)
    pieces = max(1, math.ceil(length / FLIGHT.terrain_step_m))
    steps = []
    for k in range(pieces + 1):
        east, north = (a + k / pieces * (b - a) for a, b in zip(rest[:2], there[:2], strict=True))
        up = _ground_m(state, east, north) + wanted
        steps.append(Step(seq, StepKind.GO, speeds, (east, north, up), 1.0))
    return steps


def _return_mode(state: MockState, speeds: Speeds, seq: int | None, begin: Vector | None) -> list[Step]:
    get = state.parameters
    here = state.body.believed.position_m if begin is None else begin
    there, is_landing = _safe_point(state, here)
    highest = there[2] + get["RTL_RETURN_ALT"]
    up = max(here[2], highest)
    if get["RTL_CONE_ANG"] > 0.0:
        up = max(here[2], min(highest, _cone_m(state, here, there)))
    steps = []
    if up > here[2]:
        steps.append(Step(seq, StepKind.GO, speeds, (here[0], here[1], up), FLIGHT.return_settled_m))
    elif begin is None:
        steps.append(_brake(state, speeds, seq))
    if is_landing:
        return steps + _onward(state, speeds, seq, _land_start(state))
    steps.append(Step(seq, StepKind.GO, speeds, (there[0], there[1], up)))
    if get["RTL_LAND_DELAY"] != 0.0:
        waits = min(there[2] + get["RTL_DESCEND_ALT"], up)
        steps.append(Step(seq, StepKind.GO, speeds, (there[0], there[1], waits), FLIGHT.return_settled_m))
        delay = get["RTL_LAND_DELAY"]
        steps.append(Step(seq, StepKind.WAIT, speeds, wait_s=delay if delay > 0.0 else math.inf))
    steps.append(Step(seq, StepKind.DESCEND, speeds))
    return steps


def _along_mission(state: MockState, speeds: Speeds, was: Mode, seq: int | None, begin: Vector | None) -> list[Step]:
    """PX4's RTL_TYPE 2 and 4: on to the mission's landing, or back to its first item and home."""
    positions, current = mission_positions(state), state.current_seq if seq is None else seq
    if not positions:
        return []
    here = halting_point(state.body.believed) if begin is None else begin
    start = _land_start(state)
    onward = start is not None
    if state.parameters["RTL_TYPE"] == 4.0 and start is not None:
        onward = start - current < current  # RTL::reverseIsFurther
    nearest = min(positions, key=lambda number: math.dist(positions[number], here))
    if onward:
        return _onward(state, speeds, seq, current if was is Mode.MISSION else nearest)
    first = max((number for number in positions if number < max(current, 1)), default=min(positions))
    steps = [] if begin is not None else [_brake(state, speeds, seq)]
    for number in sorted((n for n in positions if n <= (first if was is Mode.MISSION else nearest)), reverse=True):
        steps.append(Step(seq, StepKind.GO, speeds, positions[number], state.settings.acceptance_radius_m))
        if state.mission_items[number].command in _PX4_TAKEOFFS:
            break
    home = state.body.home_m
    return [*steps, Step(seq, StepKind.LEVEL, speeds, home), Step(seq, StepKind.DESCEND, speeds)]


def _onward(state: MockState, speeds: Speeds, seq: int | None, first: int | None) -> list[Step]:
    """The mission's items from one of them to its landing, without waits."""
    steps: list[Step] = []
    for number, point in mission_positions(state).items():
        if first is None or number < first:
            continue
        if state.mission_items[number].command in _LANDINGS:
            return [*steps, Step(seq, StepKind.LEVEL, speeds, point), Step(seq, StepKind.DESCEND, speeds)]
        steps.append(Step(seq, StepKind.GO, speeds, point, state.settings.acceptance_radius_m))
    return steps


def mission_positions(state: MockState) -> dict[int, Vector]:
    """The mission's positions by item number."""
    return {
        number: state.position(replace(item, command=Command.NAV_WAYPOINT))
        for number, item in enumerate(state.mission_items)
        if item.command in _PATTERN and item.has_position
    }


def _land_start(state: MockState) -> int | None:
    """Number of the item where the mission's landing begins; None without a landing."""
    commands = [int(item.command) for item in state.mission_items]
    landing = next((n for n, command in enumerate(commands) if command in _LANDINGS), None)
    if landing is None:
        return None
    return commands.index(Command.DO_LAND_START) if Command.DO_LAND_START in commands else landing


def _cone_m(state: MockState, here: Vector, there: Vector) -> float:
    """Up to where PX4's cone lets it climb."""
    get, away, accept = state.parameters, math.dist(here[:2], there[:2]), state.settings.acceptance_radius_m
    if away <= accept:
        return there[2] + 2.0 * away
    up = there[2] + get["RTL_RETURN_ALT"]
    if away <= get["RTL_MIN_DIST"]:
        up = min(up, there[2] + away / math.tan(math.radians(max(1.0, min(89.0, get["RTL_CONE_ANG"])))))
    return max(up, there[2] + 2.0 * accept)


def _rally_points(state: MockState) -> list[Vector]:
    frames = _RALLY_FRAMES["ardupilot" if state.is_ardupilot else "px4"]
    items = state.missions.items(MissionType.RALLY)
    return [
        state.position(item)
        for item in items
        if item.command == Command.NAV_RALLY_POINT
        and item.frame in frames
        and (item.lat_deg, item.lon_deg) != (0.0, 0.0)
    ]


def _copters_rally_point(state: MockState, here: Vector) -> Vector | None:
    """The nearest rally point inside its fence, unless it is too far, or home is as near."""
    get = state.parameters
    inside = [point for point in _rally_points(state) if state.fence.allows(point)]
    nearest = min(inside, key=lambda point: math.dist(point[:2], here[:2]), default=None)
    if nearest is None:
        return None
    away = math.dist(nearest[:2], here[:2])
    if 0.0 < get["RALLY_LIMIT_KM"] * 1000.0 < away:
        return None
    if get["RALLY_INCL_HOME"] and away >= math.dist(state.body.home_m[:2], here[:2]):
        return None
    return nearest


def _safe_point(state: MockState, here: Vector) -> tuple[Vector, bool]:
    """PX4's destination: home, or a safe point or the mission's landing that is nearer; whether it is the landing."""
    home, kind = state.body.home_m, state.parameters["RTL_TYPE"]
    best, is_landing = home, False
    least = math.inf if kind == 1.0 else math.dist(here[:2], home[:2])
    if kind in (1.0, 3.0) and _land_start(state) is not None:
        landing = next(
            point for n, point in mission_positions(state).items() if state.mission_items[n].command in _LANDINGS
        )
        if math.dist(here[:2], landing[:2]) + 2.0 < least:
            best, least, is_landing = landing, math.dist(here[:2], landing[:2]), True
    for point in _rally_points(state):
        away = math.dist(here[:2], point[:2])
        if math.dist(home[:2], point[:2]) > 10.0 and away + 2.0 < least:
            best, least, is_landing = point, away, False
    return best, is_landing


def _ground_m(state: MockState, east: float, north: float) -> float:
    at = state.body.geodetic_of((east, north, 0.0))
    return state.body.ground_alt_amsl_m(at.lat_deg, at.lon_deg) - state.body.frame.alt_amsl_m

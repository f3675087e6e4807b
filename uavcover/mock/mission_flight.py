"""The mission flight of the mock vehicle: its current item, its reached items, and their reports."""

from collections.abc import Sequence

from mission_io.model.enums import MissionState, Severity
from mission_io.model.items import LAST_NAVIGATION, Command, Frame
from mission_io.wire import messages as m
from uavcover.mock.faults import FaultKind
from uavcover.mock.itinerary import Step, StepKind, mission_steps
from uavcover.mock.state import MockState
from uavcover.mock.telemetry import tell
from uavcover.mock.tuning import FLIGHT
from uavcover.mock.way_home import mission_places, return_steps

_TAKEOFFS = (Command.NAV_TAKEOFF, 24, 84)
"""MAV_CMD_NAV_TAKEOFF, NAV_TAKEOFF_LOCAL and NAV_VTOL_TAKEOFF."""


class MissionFlight:
    """Follows the mission of a vehicle; keeps ``mission_state`` and ``current_seq`` of its state.

    Attributes:
        heights_are_old: whether home has moved, so that the next item begins with other heights than were laid out.
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
        """Fly it on after another mode: PX4 first climbs where it is to the next item's height (checkClimbRequired)."""
        state, here = self._state, self._state.body.believed.position_m
        ahead = [place[2] for seq, place in mission_places(state).items() if seq >= state.current_seq]
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
            place=state.place,
            settings=state.settings,
            speeds=state.speeds,
            way_home=lambda seq, begin, speeds: return_steps(state, speeds, seq=seq, begin=begin),
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

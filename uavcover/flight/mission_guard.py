"""Whether a vehicle in its mission still flies the mission that was planned, where it was planned."""

import math

from mission_io import messages as m
from mission_io.autopilots import wire_items
from mission_io.compare import compare_items, fault_text
from mission_io.errors import MissionIoError
from mission_io.items import MissionType
from uavcover.flight.conversation import Conversation, Timer
from uavcover.flight.events import EventKind
from uavcover.flight.flight_plan import FlightPlan
from uavcover.flight.outcome import Ending
from uavcover.flight.progress import Progress

_DOUBT_S = 3.0
_OFF_ROUTE_RADII = 10.0
_LEANS_DEG = 15.0


class MissionGuard:
    """Notices that another ground station changed the mission or the item that is flown, and that the vehicle drifts away.

    A sign of the first (another number of items, waypoints that are left out, going back) has the mission read back and
    compared. So has a place far off the planned leg, which else is the wind's doing when the vehicle leans hard against it.

    Args:
        conversation: with the vehicle.
        plan: what it is to fly.
        progress: along it.
    """

    def __init__(self, conversation: Conversation, plan: FlightPlan, progress: Progress) -> None:
        self._conversation, self._plan, self._progress = conversation, plan, progress
        self._total: int | None = None
        self._farthest = -1
        self._doubt: Timer | None = None
        self._off_route: Timer | None = None

    def look(self) -> None:
        """Look for signs; called while the vehicle is in its mission and in the air."""
        if self._conversation.watch.is_open(Ending.MISSION_CHANGED):
            return
        self._look_at_total()
        self._look_at_item()
        self._look_at_place()

    def _look_at_total(self) -> None:
        current = self._conversation.monitor.latest(m.MissionCurrent)
        if current is None or current.total is None:
            return
        if self._total is None:
            self._total = current.total
        if current.total != self._total:
            self._changed(
                f"the vehicle holds {current.total} items instead of {self._total}: somebody else changed the mission"
            )
            self._read_back()

    def _look_at_item(self) -> None:
        sign = self._wrong_item()
        if sign is None:
            self._doubt = None
        elif self._doubt is None:
            self._doubt = Timer(self._conversation, _DOUBT_S)
        elif self._doubt.over:
            self._doubt = None
            self._changed(f"{sign}: somebody else set the item that is flown, or changed the mission")
            self._read_back()

    def _wrong_item(self) -> str | None:
        current = self._conversation.monitor.latest(m.MissionCurrent)
        number, progress = self._progress.heading_for, self._progress
        if current is None:
            return None
        self._farthest = max(self._farthest, number)
        past = self._plan.is_past_waypoints(current.seq, self._conversation.autopilot) and not progress.all_reached
        if number > progress.reached_count + 1 or (past and progress.reached_count < self._plan.waypoint_count - 1):
            return f"the vehicle goes to item {current.seq} and leaves out waypoint {progress.reached_count}"
        if 0 <= number < self._farthest:
            return f"the vehicle goes back to waypoint {number} from {self._farthest}"
        return None

    def _look_at_place(self) -> None:
        conversation, off_m = self._conversation, self._progress.off_leg_m
        watch = conversation.watch
        if off_m <= _OFF_ROUTE_RADII * self._plan.acceptance_radius_m:
            self._off_route = None
            for kind in (Ending.OFF_ROUTE, Ending.WIND_ABOVE_LIMITS):
                watch.close(kind, "the vehicle is back near its planned leg")
        elif self._off_route is None:
            self._off_route = Timer(conversation, _DOUBT_S)
        elif self._off_route.over and not (watch.is_open(Ending.OFF_ROUTE) or watch.is_open(Ending.WIND_ABOVE_LIMITS)):
            text = f"the vehicle is {off_m:.0f} m off the planned leg to item {conversation.monitor.current_seq}"
            difference = self._difference()
            if difference is not None:
                self._changed(f"{text}: somebody else changed the mission; {difference}")
                return
            lean_deg = self._lean_deg()
            cause = watch.recent_cause(within_s=60.0)
            if lean_deg > _LEANS_DEG or (cause is not None and cause[0] is Ending.WIND_ABOVE_LIMITS):
                watch.open(
                    Ending.WIND_ABOVE_LIMITS,
                    f"{text} and leans by {lean_deg:.0f} degrees: the wind is above what it can fly against",
                )
            else:
                watch.open(Ending.OFF_ROUTE, f"{text}, although it holds the planned mission")

    def _lean_deg(self) -> float:
        attitude = self._conversation.monitor.latest(m.Attitude)
        if attitude is None:
            return 0.0
        return math.degrees(math.acos(math.cos(attitude.roll_rad) * math.cos(attitude.pitch_rad)))

    def _changed(self, text: str) -> None:
        self._conversation.watch.open(Ending.MISSION_CHANGED, text)

    def _read_back(self) -> None:
        """Tell how the mission that the vehicle holds differs from the planned one."""
        difference = self._difference()
        self._conversation.tell(EventKind.WARNING, difference or "the vehicle still holds the planned mission")

    def _difference(self) -> str | None:
        """How the mission that the vehicle holds differs from the planned one; None when it does not."""
        conversation = self._conversation
        autopilot = conversation.autopilot
        try:
            held = conversation.client.download(MissionType.MISSION)
        except MissionIoError as error:
            return f"its mission could not be read back: {error}"
        wrong = fault_text(compare_items(wire_items(self._plan.mission, autopilot), held, autopilot))
        return None if wrong is None else f"of its mission {wrong}"

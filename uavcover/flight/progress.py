"""How far along the planned waypoints a vehicle is, and whether it still flies the mission that was planned."""

import math

import numpy as np

from mission_io import messages as m
from mission_io.autopilots import wire_items
from mission_io.compare import compare_items
from mission_io.errors import MissionIoError
from mission_io.items import MissionType
from uavcover.flight.conversation import Conversation, Timer
from uavcover.flight.events import EventKind
from uavcover.flight.flight_plan import FlightPlan
from uavcover.flight.outcome import Ending
from uavcover.flight.passage import FloatArray, Passage

_UNSEEN_S = 1.0
_TRUST_S = 5.0
_DOUBT_S = 3.0
_OFF_ROUTE_RADII = 10.0


class Progress:
    """How far along the planned waypoints the vehicle is: by MISSION_CURRENT, MISSION_ITEM_REACHED and position together.

    What the vehicle says is not taken for more than it is: a jump over waypoints passes none of them, unless nobody could look
    because nothing was heard.

    Attributes:
        heading_for: number of the planned waypoint being flown to; -1 before the first and after the last.
    """

    def __init__(self, conversation: Conversation, plan: FlightPlan) -> None:
        self._conversation, self._plan = conversation, plan
        self._passage = Passage(plan.waypoints_m(), radius_m=plan.acceptance_radius_m)
        self._passage.believe(plan.passed_before)
        self._seen_s = -math.inf
        self._trust_until_s = -math.inf
        self.heading_for = -1

    @property
    def reached_count(self) -> int:
        """How many planned waypoints were passed, one after the other."""
        return self._passage.reached

    @property
    def all_reached(self) -> bool:
        """Whether the last planned waypoint was passed."""
        return self._passage.complete

    @property
    def off_route_m(self) -> float:
        """Distance from the leg that is flown; 0 where no planned leg is."""
        here = self._place_m()
        return 0.0 if here is None or self.heading_for < 1 else self._distance_to_leg_m(here, self.heading_for)

    def update(self) -> None:
        """Look at what the vehicle says, and tell when it goes on to another waypoint."""
        monitor, autopilot, plan = self._conversation.monitor, self._conversation.autopilot, self._plan
        here, passage = self._place_m(), self._passage
        if monitor.current_seq < 0 or here is None:
            return
        self._look_for_silence()
        number = plan.waypoint_of(monitor.current_seq, autopilot)
        was_last = passage.number == plan.waypoint_count - 1
        passage.take(number, here)
        told = plan.waypoint_of(monitor.reached, autopilot)
        if told == passage.reached and number in (told, told + 1, -1):
            passage.believe(told + 1)
        trusted = self._seen_s <= self._trust_until_s
        if trusted and number > passage.reached:
            passage.believe(number)
        past = plan.is_past_waypoints(monitor.current_seq, autopilot)
        complete = number == plan.waypoint_count - 1 == passage.reached and monitor.mission_complete
        if complete or (past and (was_last or trusted)):
            passage.believe(plan.waypoint_count)
        if number == self.heading_for:
            return
        self.heading_for = number
        if number >= 0:
            text = f"to waypoint {number} of {plan.waypoint_count}"
            self._conversation.tell(EventKind.WAYPOINT, text, waypoint=number)
        elif self.all_reached:
            self._conversation.tell(EventKind.STAGE, "all planned waypoints flown; on the way home")

    def _place_m(self) -> FloatArray | None:
        here = self._conversation.monitor.latest(m.GlobalPositionInt)
        if here is None:
            return None
        place_m: FloatArray = self._plan.frame.enu_from_geodetic(here.lat_deg, here.lon_deg, here.alt_amsl_m)[0]
        return place_m

    def _look_for_silence(self) -> None:
        """After positions were missing, believe for a moment which waypoint the vehicle says it flies to."""
        here = self._conversation.monitor.latest(m.GlobalPositionInt)
        if here is None:
            return
        if math.isfinite(self._seen_s) and here.time_boot_s - self._seen_s > _UNSEEN_S:
            self._trust_until_s = here.time_boot_s + _TRUST_S
        self._seen_s = here.time_boot_s

    def _distance_to_leg_m(self, here: FloatArray, number: int) -> float:
        begin, end = self._plan.waypoints_m()[number - 1 : number + 1]
        leg = end - begin
        length_2 = float(leg @ leg)
        share = 0.0 if length_2 == 0.0 else min(1.0, max(0.0, float((here - begin) @ leg) / length_2))
        return float(np.linalg.norm(here - begin - share * leg))


class MissionGuard:
    """Notices that another ground station changed the mission, or the item that is flown.

    A sign of it (another number of items, waypoints that are left out, going back, a place far off the planned leg) has the
    mission read back and compared.

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
        self._off_route_told = False

    def look(self) -> None:
        """Look for signs; called while the vehicle is in its mission."""
        if self._conversation.watch.is_open(Ending.MISSION_CHANGED):
            return
        sign = self._sign()
        if sign is None:
            self._doubt = None
        elif self._doubt is None:
            self._doubt = Timer(self._conversation, _DOUBT_S)
        elif self._doubt.over:
            self._doubt = None
            self._read_back(sign)

    def _sign(self) -> str | None:
        current = self._conversation.monitor.latest(m.MissionCurrent)
        number, progress = self._progress.heading_for, self._progress
        if current is None:
            return None
        if self._total is None:
            self._total = current.total
        if current.total is not None and self._total is not None and current.total != self._total:
            return f"the vehicle holds {current.total} items instead of {self._total}"
        self._farthest = max(self._farthest, number)
        if number > progress.reached_count + 1 or (
            not progress.all_reached and self._plan.is_past_waypoints(current.seq, self._conversation.autopilot)
        ):
            return f"the vehicle goes to item {current.seq} and leaves out waypoint {progress.reached_count}"
        if 0 <= number < self._farthest:
            return f"the vehicle goes back to waypoint {number} from {self._farthest}"
        off_m = progress.off_route_m
        if off_m > _OFF_ROUTE_RADII * self._plan.acceptance_radius_m and not self._off_route_told:
            return f"the vehicle is {off_m:.0f} m off the planned leg to waypoint {number}"
        return None

    def _read_back(self, sign: str) -> None:
        """Compare the mission that the vehicle holds with the planned one."""
        conversation = self._conversation
        autopilot = conversation.autopilot
        try:
            held = conversation.client.download(MissionType.MISSION)
        except MissionIoError as error:
            conversation.watch.open(Ending.MISSION_CHANGED, f"{sign}; its mission could not be read back: {error}")
            return
        wrong = [
            d for d in compare_items(wire_items(self._plan.mission, autopilot), held, autopilot) if not d.acceptable
        ]
        if wrong:
            where = "" if wrong[0].item is None else f" in item {wrong[0].item}"
            conversation.watch.open(
                Ending.MISSION_CHANGED,
                f"{sign}: somebody else changed the mission; {wrong[0].field}{where} is {wrong[0].received}, planned is "
                f"{wrong[0].sent}",
            )
        elif "off the planned leg" in sign:
            self._off_route_told = True
            conversation.tell(EventKind.WARNING, f"{sign}; it still holds the planned mission")
        else:
            conversation.watch.open(
                Ending.MISSION_CHANGED,
                f"{sign}: somebody else set the item that is flown; the mission is the planned one",
            )

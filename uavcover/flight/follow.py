"""Following a vehicle along its mission until it has landed and disarmed."""

import math

from mission_io import messages as m
from mission_io.items import Command
from uavcover.errors import VehicleError
from uavcover.flight.conversation import Conversation, Stopped, Timer
from uavcover.flight.events import EventKind
from uavcover.flight.flight_plan import FlightPlan
from uavcover.flight.modes import Mode, custom_mode

_MOVED_M = 2.0
_METRES_PER_DEGREE = 111_320.0


class Progress:
    """How far along the planned waypoints the vehicle is, by MISSION_CURRENT and MISSION_ITEM_REACHED together.

    Attributes:
        heading_for: number of the planned waypoint being flown to; -1 before the first and after the last.
        reached_count: how many planned waypoints were reached.
    """

    def __init__(self, conversation: Conversation, plan: FlightPlan) -> None:
        self._conversation, self._plan = conversation, plan
        self.heading_for, self.reached_count = -1, 0

    @property
    def all_reached(self) -> bool:
        """Whether the last planned waypoint was reached."""
        return self.reached_count >= self._plan.waypoint_count

    def update(self) -> None:
        """Look at what the vehicle says, and tell when it goes on to another waypoint."""
        monitor, autopilot, plan = self._conversation.monitor, self._conversation.autopilot, self._plan
        if monitor.current_seq < 0:
            return
        number = plan.waypoint_of(monitor.current_seq, autopilot)
        last_reached = plan.waypoint_of(monitor.reached, autopilot)
        self.reached_count = max(self.reached_count, number, last_reached + 1)
        at_the_end = number == plan.waypoint_count - 1 and monitor.mission_complete
        if at_the_end or plan.is_past_waypoints(monitor.current_seq, autopilot):
            self.reached_count = plan.waypoint_count
        if number == self.heading_for:
            return
        self.heading_for = number
        if number >= 0:
            text = f"to waypoint {number} of {plan.waypoint_count}"
            self._conversation.tell(EventKind.WAYPOINT, text, waypoint=number)
        elif self.all_reached:
            self._conversation.tell(EventKind.STAGE, "all planned waypoints flown; on the way home")


def follow(conversation: Conversation, *, progress: Progress | None, longest_wait_s: float, stops_before: int) -> None:
    """Listen until the vehicle has landed and disarmed.

    Args:
        conversation: with the vehicle.
        progress: along the planned waypoints; None on the way home after a stop.
        longest_wait_s: longest time that the mission itself lets the vehicle stay in one place.
        stops_before: how many stops of the user are known already.

    Raises:
        VehicleError: it is gone, stuck, or on the ground and does not disarm.
        Stopped: the user asked once more.
    """
    stillness = Stillness(conversation, conversation.patience.stuck_s + longest_wait_s)
    in_mission = True
    on_ground_timer: Timer | None = None
    told_to_disarm = False
    while conversation.client.vehicle.armed:
        if conversation.stop() > stops_before:
            raise Stopped
        conversation.pump()
        if progress is not None:
            progress.update()
        was_in_mission, in_mission = in_mission, _in_mission(conversation)
        if was_in_mission and not in_mission:
            conversation.tell(EventKind.WARNING, f"somebody else changed the vehicle to {conversation.mode_name}")
        if not conversation.monitor.on_ground:
            on_ground_timer = None
            if in_mission and stillness.too_long:
                raise VehicleError(
                    f"the vehicle is stuck: item {conversation.monitor.current_seq} since {stillness.patience_s:g} s "
                    f"without moving, in {conversation.mode_name}; it is still in the air{conversation.complaints}"
                )
        elif on_ground_timer is None:
            on_ground_timer = Timer(conversation, conversation.patience.disarm_s)
            conversation.tell(EventKind.STAGE, "on the ground")
        elif on_ground_timer.over:
            if told_to_disarm:
                raise VehicleError(f"the vehicle has landed but stays armed{conversation.complaints}")
            told_to_disarm = True
            conversation.client.command(Command.COMPONENT_ARM_DISARM, 0.0)
            on_ground_timer.restart()
    conversation.tell(EventKind.STAGE, "disarmed")


class Stillness:
    """Notices that a vehicle neither moves nor goes on to another item."""

    def __init__(self, conversation: Conversation, patience_s: float) -> None:
        self.patience_s = patience_s
        self._conversation = conversation
        self._timer = Timer(conversation, patience_s)
        self._seen: tuple[int, float, float, float] | None = None

    @property
    def too_long(self) -> bool:
        """Whether nothing changed for as long as the patience lasts."""
        monitor = self._conversation.monitor
        position = monitor.latest(m.GlobalPositionInt)
        if position is None:
            return self._timer.over
        north = position.lat_deg * _METRES_PER_DEGREE
        east = position.lon_deg * _METRES_PER_DEGREE * math.cos(math.radians(position.lat_deg))
        now = (monitor.current_seq, east, north, position.alt_amsl_m)
        if self._seen is None or self._seen[0] != now[0] or math.dist(self._seen[1:], now[1:]) > _MOVED_M:
            self._seen = now
            self._timer.restart()
        return self._timer.over


def longest_wait_s(plan: FlightPlan) -> float:
    """Longest time that an item of the mission lets the vehicle stay in one place."""
    waiting = (Command.NAV_WAYPOINT, Command.NAV_DELAY, Command.NAV_LOITER_TIME)
    return max((i.params[0] for i in plan.mission.items if i.command in waiting and i.params[0] > 0.0), default=0.0)


def _in_mission(conversation: Conversation) -> bool:
    return conversation.client.vehicle.custom_mode == custom_mode(conversation.autopilot, Mode.MISSION)

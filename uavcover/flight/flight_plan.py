"""What a flight needs to know of the plan, and how patient it is."""

from dataclasses import dataclass

from mission_io.autopilots import Autopilot
from mission_io.items import GeoPoint, Mission
from uavcover.frames import LocalFrame


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightPlan:
    """The mission that the vehicle is to hold, and where it belongs.

    Attributes:
        mission: the mission as it was uploaded; the vehicle's is compared with it before arming.
        first_waypoint_item: index in ``mission.items`` of the first planned waypoint.
        waypoint_count: how many planned waypoints follow each other from there, an item each.
        frame: the scenario's local frame, for the track.
        home: where the mission was planned to start.
        ground_alt_amsl_m: height of the terrain at ``home``, or none when there is no terrain.
        max_home_error_m: largest distance of the vehicle's home from the planned one, over ground and in height.
    """

    mission: Mission
    first_waypoint_item: int
    waypoint_count: int
    frame: LocalFrame
    home: GeoPoint
    ground_alt_amsl_m: float | None = None
    max_home_error_m: float = 10.0

    def waypoint_of(self, seq: int, autopilot: Autopilot) -> int:
        """Number of the planned waypoint that item ``seq`` on the wire is; -1 for the other items."""
        number = seq - self.first_waypoint_item - (1 if autopilot.home_in_item_0 else 0)
        return number if 0 <= number < self.waypoint_count else -1

    def is_past_waypoints(self, seq: int, autopilot: Autopilot) -> bool:
        """Whether item ``seq`` on the wire comes after the last planned waypoint."""
        first = self.first_waypoint_item + (1 if autopilot.home_in_item_0 else 0)
        return seq >= first + self.waypoint_count


@dataclass(frozen=True, slots=True, kw_only=True)
class Patience:
    """How long to wait for what, in seconds of vehicle time unless it says otherwise.

    Attributes:
        heartbeat_s: silence after which the heartbeat is lost, on the link's clock.
        ready_s: until the vehicle can be armed; ArduPilot needs about 41 s.
        arm_s: for how long a refused arming is tried again.
        start_s: from the start command until it leaves the ground.
        halt_s: until it has come to rest after it was told to hold.
        stuck_s: without getting on.
        disarm_s: from landing until it disarms itself.
        watchdog: on the link's clock, this many times as long as each of the above is always the end.
    """

    heartbeat_s: float = 5.0
    ready_s: float = 120.0
    arm_s: float = 10.0
    start_s: float = 30.0
    halt_s: float = 20.0
    stuck_s: float = 60.0
    disarm_s: float = 30.0
    watchdog: float = 10.0

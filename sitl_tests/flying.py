"""Steps of a flight that several capabilities share, on our own client's functions, and what a flown track must show."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache

import numpy as np

from mission_io.autopilots.mission_lists import mission_from_wire
from mission_io.model.items import Command, Frame, GeoPoint, Mission, MissionType, land, waypoint
from mission_io.wire import messages as m
from sitl_tests.case import Case, Station
from sitl_tests.errors import require
from sitl_tests.missions import FIRST_WAYPOINT_ITEM, route_mission
from uavcover.flight.arming import arm_and_start, request_telemetry, wait_until_ready
from uavcover.flight.fly import fly
from uavcover.flight.orders import FlightPlan, FlightTimeouts, OnBreach, Orders, Precautions
from uavcover.flight.session import first_seq
from uavcover.missions.mission_compiler import AUTOPILOTS
from uavcover.model.track import FlightEvent, FlightFailedError, FlightOutcome, TrackSample
from uavcover.terrain.frames import LocalFrame

PASSED_WITHIN_M = 4.0
"""A waypoint counts as flown when the track comes so near; both autopilots turn 2 m before it by default."""
LANDED_WITHIN_M = 3.0
FLIGHT_S = 600.0
_ITEM_S = 120.0
_ELSEWHERE_S = 60.0
"""A vehicle that a failsafe holds in the air is followed for so long; ``fly`` follows it for ever."""


@cache
def frame_at(home: GeoPoint) -> LocalFrame:
    """East, north and up from home."""
    return LocalFrame(home.lat_deg, home.lon_deg, home.alt_amsl_m)


@dataclass(slots=True)
class Path:
    """Where a vehicle was told to have been, in metres east, north and up from home.

    Attributes:
        home: the origin.
        times_s: of each position, vehicle time.
        enu_m: each position.
    """

    home: GeoPoint
    times_s: list[float] = field(default_factory=list)
    enu_m: list[tuple[float, float, float]] = field(default_factory=list)

    def take(self, position: m.GlobalPositionInt) -> None:
        """Add a position."""
        east, north, up = (
            frame_at(self.home).enu_from_geodetic(position.lat_deg, position.lon_deg, position.alt_amsl_m)[0].tolist()
        )
        self.times_s.append(position.time_boot_s)
        self.enu_m.append((east, north, up))

    def take_sample(self, sample: TrackSample) -> None:
        """Add a sample of a track whose frame begins at home."""
        self.times_s.append(sample.time_s)
        self.enu_m.append((sample.east_m, sample.north_m, sample.up_m))

    def moved_m(self, begin_s: float, end_s: float) -> float:
        """The farthest that it came in a stretch of time from where that began."""
        inside = [enu for time_s, enu in zip(self.times_s, self.enu_m, strict=True) if begin_s <= time_s <= end_s]
        require(len(inside) > 1, f"no positions between {begin_s:.1f} s and {end_s:.1f} s")
        return float(np.linalg.norm(np.array(inside) - np.array(inside[0]), axis=1).max())

    def nearest_m(self, point_m: tuple[float, float, float]) -> float:
        """How near it came to a point."""
        return float(np.linalg.norm(np.array(self.enu_m) - np.array(point_m), axis=1).min())

    @property
    def last_m(self) -> tuple[float, float, float]:
        """Where it ended."""
        return self.enu_m[-1]


def plan_of(mission: Mission, home: GeoPoint) -> FlightPlan:
    """What ``fly`` needs to know of a ``route_mission``."""
    return FlightPlan(
        mission=mission,
        first_waypoint_item=FIRST_WAYPOINT_ITEM,
        waypoint_count=len(mission.items) - FIRST_WAYPOINT_ITEM - 2,
        frame=frame_at(home),
        home=home,
    )


def waypoints_held(case: Case) -> list[tuple[float, float, float]]:
    """The waypoints of the mission that another station downloads from the vehicle, in metres from home."""
    held = mission_from_wire(case.held(MissionType.MISSION), AUTOPILOTS[case.autopilot])
    positions = []
    for item in held.items:
        if item.command == Command.NAV_WAYPOINT:
            above = case.vehicle.home.alt_amsl_m if item.frame is Frame.ABOVE_HOME else 0.0
            enu = frame_at(case.vehicle.home).enu_from_geodetic(item.lat_deg, item.lon_deg, above + item.alt_m)[0]
            positions.append((float(enu[0]), float(enu[1]), float(enu[2])))
    return positions


def require_flown(path: Path, waypoints_m: list[tuple[float, float, float]]) -> float:
    """Refuse a path that leaves out a waypoint or does not end at home; the largest miss in metres."""
    require(bool(waypoints_m), "the vehicle holds no waypoint")
    misses = [path.nearest_m(point) for point in waypoints_m]
    worst = max(misses)
    require(worst <= PASSED_WITHIN_M, f"waypoint {misses.index(worst)} was passed at {worst:.1f} m")
    require_at_home(path)
    return worst


def require_at_home(path: Path) -> None:
    """Refuse a path that does not end at home."""
    away_m = float(np.hypot(path.last_m[0], path.last_m[1]))
    require(away_m <= LANDED_WITHIN_M, f"it landed {away_m:.1f} m from home")


def fly_mission(
    case: Case,
    station: Station,
    mission: Mission,
    *,
    on_event: Callable[[FlightEvent], None] = lambda _: None,
    pause: Callable[[], bool] = lambda: False,
    stop: Callable[[], int] = lambda: 0,
    home: GeoPoint | None = None,
    upload: bool = True,
    on_breach: OnBreach = OnBreach.TELL,
    plan: Callable[[FlightPlan], FlightPlan] = lambda plan: plan,
) -> tuple[FlightOutcome, Path]:
    """Upload a ``route_mission`` and fly it by our own ``fly``; its outcome also when that is an error, and the path.

    Args:
        case: what for.
        station: flies it.
        mission: what to fly.
        on_event: is told what happens.
        pause: whether the vehicle is to wait where it is.
        stop: how often the user has asked to stop; once is home, by way of a point above it.
        home: where the plan begins; the vehicle's own by default.
        upload: whether to; otherwise the vehicle holds it already.
        on_breach: what is done about a breach.
        plan: changes the plan that it is flown by.
    """
    if upload:
        require(station.client.upload_and_verify(mission).passed, "the mission was read back changed")
    path = Path(case.vehicle.home)

    def take(event: FlightEvent) -> None:
        case.take_event(event)
        on_event(event)

    def return_mission(lat_deg: float, lon_deg: float, alt_amsl_m: float) -> Mission:
        return _return_mission(case.vehicle.home, lat_deg, lon_deg, alt_amsl_m)

    try:
        outcome = fly(
            station.client,
            station.monitor,
            plan(plan_of(mission, home or case.vehicle.home)),
            Orders(
                on_sample=path.take_sample,
                on_event=take,
                pause=pause,
                stop=stop,
                confirmed=True,
                timeouts=FlightTimeouts(override_s=_ELSEWHERE_S),
                precautions=Precautions(on_breach=on_breach),
            ),
            plan_return=return_mission,
        )
    except FlightFailedError as error:
        outcome = error.outcome
        case.events.append(f"fly ended with {outcome.ending.key}: {error}")
    return outcome, path


def _return_mission(home: GeoPoint, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> Mission:
    """From a place in the air to above home, and down: simulators have no terrain that such a leg could hit."""
    frame, height_m = Frame.ABOVE_HOME, alt_amsl_m - home.alt_amsl_m
    return Mission(
        home,
        (
            waypoint(lat_deg, lon_deg, height_m, frame=frame),
            waypoint(home.lat_deg, home.lon_deg, height_m, frame=frame),
            land(home.lat_deg, home.lon_deg, 0.0, frame=frame),
        ),
    )


def take_off(case: Case, station: Station, mission: Mission | None = None) -> Path:
    """Upload, wait until ready, arm, start; the path grows from then on."""
    mission = mission if mission is not None else route_mission(case.vehicle.home)
    path = Path(case.vehicle.home)
    require(station.client.upload_and_verify(mission).passed, "the mission was read back changed")
    request_telemetry(station.session)
    wait_until_ready(station.session)
    station.monitor.on_position = path.take
    arm_and_start(station.session)
    return path


def wait_for_waypoint(station: Station, number: int) -> None:
    """Listen until the vehicle flies to a waypoint of a ``route_mission``."""
    seq = first_seq(station.session) + FIRST_WAYPOINT_ITEM + number
    station.wait(
        lambda: station.monitor.current_seq >= seq, within_s=_ITEM_S, what=f"the vehicle does not go on to item {seq}"
    )


def wait_until_landed(station: Station) -> None:
    """Listen until the vehicle has landed and disarmed."""
    station.wait(
        lambda: not station.client.vehicle.armed, within_s=FLIGHT_S, what="the vehicle does not land and disarm"
    )

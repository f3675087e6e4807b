"""A small flight for the tests: a home, a mission around it, and a vehicle behind a simulated link."""

from collections.abc import Callable
from dataclasses import dataclass, field
from random import Random
from typing import Any

import numpy as np

from mission_io.autopilots.autopilot import ARDUPILOT, Autopilot
from mission_io.client.client import Client
from mission_io.links.simulated import Conditions
from mission_io.model.items import Frame, GeoPoint, Mission, change_speed, land, takeoff, waypoint
from tests.disturbances import DisturbedLink
from uavcover.flight.fly import fly
from uavcover.flight.monitor import Monitor, open_vehicle
from uavcover.flight.orders import FlightPlan, OnBreach, Orders, Precautions
from uavcover.mock.body import Ground
from uavcover.mock.server import InMemoryPeer
from uavcover.mock.state import OnTruth
from uavcover.mock.vehicle import MockConfig, MockVehicle
from uavcover.model.track import EventKind, FlightEvent, FlightOutcome, TrackSample
from uavcover.terrain.frames import LocalFrame

HOME = GeoPoint(36.51234567, -84.21234567, 312.5)
FRAME = LocalFrame(36.51, -84.21, 300.0)
ROUTE_ENU_M = [(0.0, 60.0, 60.0), (80.0, 60.0, 70.0), (80.0, 140.0, 55.0), (0.0, 140.0, 60.0)]
"""The planned waypoints, relative to home."""

_HOME_FRAME = LocalFrame(HOME.lat_deg, HOME.lon_deg, HOME.alt_amsl_m)


def geodetic(east_north_up: tuple[float, float, float]) -> GeoPoint:
    lat, lon, alt = _HOME_FRAME.geodetic_from_enu(east_north_up)
    return GeoPoint(float(lat[0]), float(lon[0]), float(alt[0]))


def above_home(east_north_up: tuple[float, float, float]) -> tuple[float, float, float]:
    position = geodetic(east_north_up)
    return (position.lat_deg, position.lon_deg, position.alt_amsl_m - HOME.alt_amsl_m)


def mission(route: list[tuple[float, float, float]] | None = None, speed_m_s: float = 8.0) -> Mission:
    relative = Frame.ABOVE_HOME
    items = [
        takeoff(HOME.lat_deg, HOME.lon_deg, 20.0, frame=relative),
        change_speed(speed_m_s),
        waypoint(*above_home((0.0, 10.0, 40.0)), frame=relative),
        *(waypoint(*above_home(point), frame=relative) for point in route or ROUTE_ENU_M),
        waypoint(*above_home((0.0, 0.0, 40.0)), frame=relative),
        land(HOME.lat_deg, HOME.lon_deg, 0.0, frame=relative),
    ]
    return Mission(HOME, tuple(items))


def plan_for(wanted: Mission, *, home: GeoPoint = HOME, **changes: Any) -> FlightPlan:
    count = len(wanted.items) - 5
    return FlightPlan(mission=wanted, first_waypoint_item=3, waypoint_count=count, frame=FRAME, home=home, **changes)


def return_mission(lat_deg: float, lon_deg: float, alt_amsl_m: float) -> Mission:
    relative = Frame.ABOVE_HOME
    return Mission(
        HOME,
        (
            waypoint(lat_deg, lon_deg, alt_amsl_m - HOME.alt_amsl_m + 10.0, frame=relative),
            waypoint(*above_home((0.0, 0.0, 30.0)), frame=relative),
            land(HOME.lat_deg, HOME.lon_deg, 0.0, frame=relative),
        ),
    )


@dataclass
class Scene:
    """A vehicle, a client that talks to it in simulated time, and what was recorded."""

    vehicle: MockVehicle
    client: Client
    monitor: Monitor
    link: DisturbedLink
    peer: InMemoryPeer
    samples: list[TrackSample] = field(default_factory=list)
    events: list[FlightEvent] = field(default_factory=list)

    def upload(self, wanted: Mission) -> None:
        self.client.wait_for_vehicle()
        assert self.client.upload_and_verify(wanted).passed

    def fly(self, wanted: Mission | None = None, **options: Any) -> FlightOutcome:
        wanted = mission() if wanted is None else wanted
        plan = options.pop("plan", None) or plan_for(wanted)
        plan_return = options.pop("plan_return", return_mission)
        return fly(self.client, self.monitor, plan, self.orders(**options), plan_return=plan_return)

    def orders(self, **options: Any) -> Orders:
        """Orders of a user who wants breaches reported only."""
        reported = {"on_sample": self.samples.append, "on_event": self.events.append}
        return Orders(**{**reported, "precautions": Precautions(on_breach=OnBreach.TELL), **options})

    def reported(self, kind: EventKind) -> list[str]:
        return [event.text for event in self.events if event.kind is kind]

    def track(self) -> np.ndarray:
        return np.array([(s.time_s, s.east_m, s.north_m, s.up_m) for s in self.samples])


def presses(scene: Scene, *times_s: float) -> Callable[[], int]:
    """A stop that is pressed at these vehicle times."""
    return lambda: sum((scene.monitor.time_s or 0.0) >= time_s for time_s in times_s)


def mock_vehicle(
    autopilot: Autopilot,
    home: GeoPoint = HOME,
    *,
    ground: Ground | None = None,
    rng: np.random.Generator | None = None,
    on_truth: OnTruth | None = None,
    **config: Any,
) -> MockVehicle:
    """A mock vehicle with these settings of its configuration."""
    return MockVehicle(autopilot, home, MockConfig(**config), ground=ground, rng=rng, on_truth=on_truth)


def make_scene(
    autopilot: Autopilot = ARDUPILOT,
    *,
    speed: float = 1.0,
    conditions: Conditions | None = None,
    seed: int = 1,
    make_peer: Callable[[MockVehicle, float], InMemoryPeer] | None = None,
    home: GeoPoint = HOME,
    **options: Any,
) -> Scene:
    vehicle = mock_vehicle(autopilot, home, speed=speed, rng=np.random.default_rng(seed), **options)
    peer = InMemoryPeer(vehicle, speed=speed) if make_peer is None else make_peer(vehicle, speed)
    link = DisturbedLink(
        peer, rng=Random(seed), conditions=conditions if conditions is not None else Conditions(delay_s=0.002)
    )
    client, monitor = open_vehicle(link)
    return Scene(vehicle, client, monitor, link, peer)

"""Tracks that were really flown: by the mock vehicle's dynamics, in wind, with errors of its positions, recorded at any rate."""

from dataclasses import dataclass
from random import Random

import numpy as np

from mission_io.links.simulated import Conditions, SimulatedLink
from uavcover.flight.compiled_flight import fly, upload
from uavcover.flight.connect import Connected, home_of
from uavcover.flight.monitor import open_vehicle
from uavcover.flight.orders import Orders
from uavcover.missions.mission_compiler import AUTOPILOTS, compile_mission
from uavcover.mock.behaviour import Settings
from uavcover.mock.body import GpsError
from uavcover.mock.dynamics import WindModel
from uavcover.mock.faults import parse_fault
from uavcover.mock.server import InMemoryPeer
from uavcover.mock.vehicle import MockConfig, MockVehicle
from uavcover.model.route import Route
from uavcover.model.track import Track, TrackSample
from uavcover.model.vehicle import AutopilotName
from uavcover.scenario.site import Site


@dataclass(frozen=True, kw_only=True)
class Weather:
    """What a flight has to stand."""

    wind_m_s: float = 0.0
    gust_m_s: float = 0.0
    gps_m: float = 0.0
    seed: int = 1
    faults: tuple[str, ...] = ()


def flown_by_the_mock(
    site: Site, route: Route, weather: Weather | None = None, *, autopilot: AutopilotName = "ardupilot"
) -> Track:
    """The track of a flight from take-off to landing, as ``fly`` records it."""
    weather = weather if weather is not None else Weather()
    home = home_of(site)
    assert home is not None
    rng = np.random.default_rng(weather.seed)
    vehicle = MockVehicle(
        AUTOPILOTS[autopilot],
        home,
        MockConfig(
            settings=Settings.for_vehicle(site.scenario.vehicle),
            wind=WindModel(
                speed_m_s=weather.wind_m_s, from_deg=float(rng.uniform(0.0, 360.0)), gust_m_s=weather.gust_m_s
            ),
            gps=GpsError(horizontal_m=weather.gps_m, vertical_m=1.5 * weather.gps_m),
            faults=[parse_fault(fault) for fault in weather.faults],
        ),
        rng=rng,
    )
    link = SimulatedLink(InMemoryPeer(vehicle), rng=Random(weather.seed), conditions=Conditions(delay_s=0.002))
    client, monitor = open_vehicle(link)
    monitor.listen_to(client.wait_for_vehicle().address)
    station = Connected(client, monitor, autopilot)
    compiled = compile_mission(site, route, autopilot=autopilot)
    upload(client, compiled)
    samples: list[TrackSample] = []
    fly(station, site, compiled, Orders(on_sample=samples.append, on_event=lambda _: None, stop=lambda: 0))
    return track_of_samples(samples)


def track_of_samples(samples: list[TrackSample]) -> Track:
    def columns(*names: str) -> np.ndarray:
        return np.array([[getattr(sample, name) for name in names] for sample in samples], dtype=float)

    return Track(
        time_s=columns("time_s")[:, 0],
        geodetic=columns("lat_deg", "lon_deg", "alt_amsl_m"),
        enu_m=columns("east_m", "north_m", "up_m"),
        attitude_deg=columns("roll_deg", "pitch_deg", "yaw_deg"),
        current_waypoint=np.array([sample.current_waypoint for sample in samples], dtype=np.int64),
        attitude_age_s=columns("attitude_age_s")[:, 0],
    )

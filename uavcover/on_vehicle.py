"""A site's vehicle: find it, check that it stands where the plan starts, fly the compiled mission."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from mission_io import SigningKey
from mission_io.client import Client
from mission_io.items import GeoPoint
from mission_io.protocol.exchange import Timing
from uavcover.errors import InputError
from uavcover.flight.conversation import Conversation
from uavcover.flight.events import FlightEvent
from uavcover.flight.flight_plan import FlightPlan, Patience
from uavcover.flight.fly import FlightOutcome
from uavcover.flight.fly import fly as fly_plan
from uavcover.flight.mock.server import register_mock
from uavcover.flight.mock.settings import Settings
from uavcover.flight.mock.vehicle import MockVehicle
from uavcover.flight.monitor import Monitor, open_vehicle
from uavcover.flight.readiness import check_home as check_home_of
from uavcover.mission_compiler import AUTOPILOTS, CompiledMission, compile_return
from uavcover.model.track import TrackSample
from uavcover.model.vehicle import AutopilotName
from uavcover.site import Site


@dataclass(frozen=True, slots=True, eq=False)
class Connected:
    """A vehicle that has been found.

    Attributes:
        client: talks to it.
        monitor: hears all that the client hears.
        autopilot: its name in scenarios.
    """

    client: Client
    monitor: Monitor
    autopilot: AutopilotName


@contextmanager
def connect(
    url: str,
    site: Site | None = None,
    *,
    home: GeoPoint | None = None,
    timeout_s: float = 10.0,
    mock_speed: float = 1.0,
    timing: Timing | None = None,
    signing_key: SigningKey | None = None,
) -> Iterator[Connected]:
    """Open a link and wait for a vehicle; a context manager that closes the link.

    Args:
        url: where it is; ``mock:`` starts a vehicle in this process.
        site: whose vehicle and home ``mock:`` takes.
        home: where ``mock:`` stands instead.
        timeout_s: how long to wait for the first heartbeat.
        mock_speed: how fast ``mock:`` flies, times real time.
        timing: how patient transfers are.
        signing_key: signs all that is sent; then nothing that is not signed with it is believed.

    Raises:
        InputError: a time or a speed that is not above 0.
        mission_io.errors.MissionIoError: the URL is not understood, or nobody is there.
    """
    for name, value in (("timeout", timeout_s), ("mock speed", mock_speed)):
        if not 0.0 < value < float("inf"):
            raise InputError(f"{name}: {value:g} is not a number above 0")
    place = home or (None if site is None else home_of(site)) or GeoPoint(0.0, 0.0, 0.0)
    name = "ardupilot" if site is None else site.scenario.vehicle.autopilot
    settings = Settings() if site is None else Settings.for_vehicle(site.scenario.vehicle)
    register_mock(lambda: MockVehicle(AUTOPILOTS[name], place, settings=settings, speed=mock_speed), speed=mock_speed)
    client, monitor = open_vehicle(url, timing=timing)
    with client:
        if signing_key is not None:
            client.sign_with(signing_key)
        vehicle = client.wait_for_vehicle(timeout_s)
        monitor.listen_to(vehicle.system_id)
        own: AutopilotName = "px4" if vehicle.autopilot is AUTOPILOTS["px4"] else "ardupilot"
        yield Connected(client, monitor, own)


def home_of(site: Site) -> GeoPoint | None:
    """Where a site's vehicle starts; none for a site without a place on Earth or without a home."""
    if site.frame is None or site.home_m is None:
        return None
    lat, lon, alt = site.frame.geodetic_from_enu(site.home_m)
    return GeoPoint(float(lat[0]), float(lon[0]), float(alt[0]))


def require_home(site: Site) -> GeoPoint:
    """Where a site's vehicle starts.

    Raises:
        InputError: the site has no place on Earth or no home, so there is nothing to fly.
    """
    home = home_of(site)
    if home is None:
        lacks = "place on Earth" if site.frame is None else "[home]"
        raise InputError(
            f"scenario {site.scenario.name}: has no {lacks}, so there is no mission to fly; give it an [origin] and a [home]"
        )
    return home


def flight_plan(site: Site, compiled: CompiledMission) -> FlightPlan:
    """What a flight needs to know of a compiled mission.

    Raises:
        InputError: the site has no place on Earth or no home.
    """
    home = require_home(site)
    if site.frame is None or site.home_m is None:
        raise InputError(f"scenario {site.scenario.name}: has no place on Earth")
    ground = float(site.ground.heights_m(site.home_m[:2])[0])
    point = np.array([site.home_m[0], site.home_m[1], ground])
    return FlightPlan(
        mission=compiled.mission,
        first_waypoint_item=compiled.first_waypoint_item,
        waypoint_count=compiled.waypoint_count,
        frame=site.frame,
        home=compiled.mission.home or home,
        ground_alt_amsl_m=float(site.alts_amsl_m(point)[0]),
        max_home_error_m=site.scenario.limits.max_home_error_m,
        acceptance_radius_m=site.scenario.vehicle.acceptance_radius_m,
    )


def check_home(vehicle: Connected, site: Site, compiled: CompiledMission) -> None:
    """Compare the vehicle's home with the planned one and the terrain there; heights above home would be wrong by it.

    Raises:
        VehicleError: it is farther away than the scenario allows.
    """
    conversation = Conversation(
        vehicle.client, vehicle.monitor, patience=Patience(), on_event=lambda _: None, stop=lambda: 0
    )
    check_home_of(conversation, flight_plan(site, compiled))


def fly(
    vehicle: Connected,
    site: Site,
    compiled: CompiledMission,
    *,
    on_sample: Callable[[TrackSample], None],
    on_event: Callable[[FlightEvent], None] = lambda _: None,
    stop: Callable[[], int] = lambda: 0,
    pause: Callable[[], bool] = lambda: False,
    confirmed: bool = False,
    patience: Patience | None = None,
) -> FlightOutcome:
    """Fly the mission that the vehicle holds: ready, check, arm, start, follow, land; see :mod:`uavcover.flight.fly`.

    Args:
        vehicle: connected.
        site: the scenario on its ground.
        compiled: what the vehicle is to hold.
        on_sample: takes every sample as it comes.
        on_event: is told what happens.
        stop: how often the user has asked to stop: once is home along checked legs, twice is hold.
        pause: whether the user wants the vehicle to wait where it is.
        confirmed: whether a vehicle that may be real may be armed.
        patience: how long to wait for what.

    Raises:
        FlightFailedError: the vehicle or the link failed, or the vehicle is not what was planned for; it carries the outcome.
    """
    return fly_plan(
        vehicle.client, vehicle.monitor, flight_plan(site, compiled),
        on_sample=on_sample, on_event=on_event, confirmed=confirmed, stop=stop, pause=pause, patience=patience,
        plan_return=lambda lat, lon, alt: compile_return(site, lat_deg=lat, lon_deg=lon, alt_amsl_m=alt),
    )  # fmt: skip

"""The vehicles of a command or a site: their addresses and links, where they stand, and the flight of a compiled mission."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal, NamedTuple

import numpy as np
import shapely

from mission_io import SigningKey
from mission_io.client.client import Client
from mission_io.errors import TransferSilentError, VehicleSilentError
from mission_io.links.opening import open_link
from mission_io.links.shared import SharedLink
from mission_io.links.telemetry_log import LoggedLink
from mission_io.model.items import GeoPoint
from mission_io.model.plain_text import counted
from mission_io.protocol.timing import Timing
from mission_io.wire.messages import ExtendedSysState, GlobalPositionInt
from uavcover.errors import InputError
from uavcover.flight.arming import check_home as check_home_of
from uavcover.flight.fly import fly as fly_plan
from uavcover.flight.follow import PlanReturn
from uavcover.flight.monitor import Monitor, open_vehicle
from uavcover.flight.orders import (
    FlightPlan,
    FlightTimeouts,
    OperatingVolume,
    Orders,
    PlanNeeds,
    require_answers,
    require_multirotor,
)
from uavcover.flight.session import Session
from uavcover.flight.vehicle_terrain import answer_from_site
from uavcover.missions.mission_compiler import AUTOPILOTS, CompiledMission, compile_return
from uavcover.missions.objectives import way_home
from uavcover.mock.behaviour import Settings
from uavcover.mock.dynamics import BatteryData
from uavcover.mock.server import mock_endpoint
from uavcover.mock.vehicle import MockConfig, MockVehicle
from uavcover.model.outcome import FlightOutcome
from uavcover.model.scenario import Scenario
from uavcover.model.vehicle import AutopilotName
from uavcover.plugins import load
from uavcover.run.folder import RunFolder
from uavcover.scenario.scenario_file import load_scenario
from uavcover.scenario.site import Site
from uavcover.scenario.vehicles import pace_of

_GROUND_S, _ASK_AGAIN_S = 4.0, 0.2
"""Timeout and interval of the question to an armed vehicle whether it stands on the ground."""

ClientName = Literal["native", "mavsdk"]
"""Who conducts transfers and commands."""


@dataclass(frozen=True, slots=True, eq=False)
class Connected:
    """A vehicle that has been found."""

    client: Client  # talks to it
    monitor: Monitor  # hears all that the client hears
    autopilot: AutopilotName  # its name in scenarios
    link: LoggedLink | None = None  # where a telemetry log can listen; none for a client that was made elsewhere
    url: str = ""  # where it is


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleLink:
    """A vehicle's address, its system id, and the link's parameters.

    Attributes:
        url: ``mock:`` starts a vehicle in this process.
        timeout_s: how long to wait for the first heartbeat.
        mock_speed: how fast ``mock:`` flies, times real time.
        timing: timeouts of transfers.
        signing_key: signs all that is sent; then nothing that is not signed with it is believed.
        client_name: which client speaks to it; MAVSDK's takes no ``timing`` and no ``signing_key``.
        system_id: which vehicle is meant, where several are on the link.
        component_id: which of its components is the autopilot, where that is not component 1.
        own_system: our own MAVLink system id.
        shared: the link, where several vehicles are on it at the same time; ``system_id`` is that of one of them.
    """

    url: str
    timeout_s: float = 10.0
    mock_speed: float = 1.0
    timing: Timing | None = None
    signing_key: SigningKey | None = None
    client_name: ClientName = "native"
    system_id: int | None = None
    component_id: int | None = None
    shared: SharedLink | None = None
    own_system: int = 255


def sharing_links(links: Sequence[VehicleLink]) -> list[VehicleLink]:
    """The same vehicles; those on one link share it, and it is opened once."""
    systems: dict[str, list[int]] = {}
    for link in links:
        if link.system_id is not None and not link.url.startswith("mock:"):
            systems.setdefault(link.url, []).append(link.system_id)
    shared = {url: SharedLink(partial(open_link, url), ids) for url, ids in systems.items() if len(ids) > 1}
    return [replace(link, shared=shared.get(link.url)) for link in links]


@contextmanager
def connect(to: str | VehicleLink, site: Site | None = None, *, home: GeoPoint | None = None) -> Iterator[Connected]:
    """Open a link and wait for a vehicle; a context manager that closes the link.

    With a site, the vehicle's requests for terrain heights are answered from its elevation data as long as the link is open.

    Args:
        to: where it is; a URL alone takes the defaults of :class:`VehicleLink`.
        site: whose vehicle and home ``mock:`` takes; given, other vehicles than multirotors are refused.
        home: where ``mock:`` stands instead.

    Raises:
        VehicleError: with a site: the vehicle is not a multirotor. An ArduPilot answers nothing that we send.
        mission_io.errors.AmbiguousVehicleError: several vehicles are on the link, and none was named.
        InputError: a time or a speed that is not above 0.
        mission_io.errors.MissionIoError: the URL is not understood, or no vehicle answers.
    """
    at = VehicleLink(url=to) if isinstance(to, str) else to
    for name, value in (("timeout", at.timeout_s), ("mock speed", at.mock_speed)):
        if not 0.0 < value < float("inf"):
            raise InputError(f"{name}: must be greater than 0, not {value:g}")
    place = home or (None if site is None else home_of(site)) or GeoPoint(0.0, 0.0, 0.0)
    name = "ardupilot" if site is None else site.scenario.vehicle.autopilot
    settings = Settings() if site is None else Settings.for_vehicle(site.scenario.vehicle)
    battery = BatteryData() if site is None else BatteryData.for_vehicle(site.scenario.vehicle)
    endpoint = mock_endpoint(
        lambda: MockVehicle(
            AUTOPILOTS[name], place, MockConfig(settings=settings, battery=battery, speed=at.mock_speed)
        ),
        speed=at.mock_speed,
    )
    share = None if at.shared is None or at.system_id is None else at.shared.share(at.system_id)
    link = LoggedLink(open_link(at.url, schemes={"mock": endpoint}) if share is None else share)
    if at.client_name != "native":
        client, monitor = load("uavcover.clients", at.client_name).open_client(link, own_system=at.own_system)
    else:
        client, monitor = open_vehicle(link, timing=at.timing, own_system=at.own_system)
    with client:
        if at.signing_key is not None:
            # Who receives them keeps the time of the last message for each link id: clients side by side need their own.
            client.sign_with(at.signing_key, link_id=0 if share is None or at.system_id is None else at.system_id)
        vehicle = client.wait_for_vehicle(at.timeout_s, system_id=at.system_id, component_id=at.component_id)
        if site is not None:
            require_multirotor(client)
            answer_from_site(client, site)
            require_answers(client)
        monitor.listen_to(vehicle.address)
        own: AutopilotName = "px4" if vehicle.autopilot is AUTOPILOTS["px4"] else "ardupilot"
        try:
            yield Connected(client, monitor, own, link, at.url)
        except (VehicleSilentError, TransferSilentError):
            require_answers(client)  # a vehicle that answers nothing at all has a reason of its own
            raise


def home_of(site: Site) -> GeoPoint | None:
    """Start position of a site's vehicle; none for a site without a position on Earth or without a home."""
    if site.frame is None or site.home_m is None:
        return None
    lat, lon, alt = site.frame.geodetic_from_enu(site.home_m)
    return GeoPoint(float(lat[0]), float(lon[0]), float(alt[0]))


def require_home(site: Site) -> GeoPoint:
    """Where a site's vehicle starts.

    Raises:
        InputError: the site has no position on Earth or no home, so there is nothing to fly.
    """
    home = home_of(site)
    if home is None:
        lacks = "position on Earth" if site.frame is None else "[home]"
        raise InputError(f"scenario {site.scenario.name} has no {lacks}; to fly it, add an [origin] and a [home]")
    return home


def flight_plan(site: Site, compiled: CompiledMission) -> FlightPlan:
    """The part of a compiled mission that a flight needs.

    Raises:
        InputError: the site has no position on Earth or no home.
    """
    home = require_home(site)
    if site.frame is None or site.home_m is None:
        raise InputError(f"scenario {site.scenario.name} has no position on Earth; add an [origin]")
    ground = float(site.bare_ground.heights_m(site.home_m[:2])[0])
    point = np.array([site.home_m[0], site.home_m[1], ground])
    return FlightPlan(
        mission=compiled.mission,
        first_waypoint_item=compiled.first_waypoint_item,
        waypoint_count=compiled.waypoint_count,
        items_per_waypoint=compiled.items_per_waypoint,
        frame=site.frame,
        home=compiled.mission.home or home,
        ground_alt_amsl_m=float(site.alts_amsl_m(point)[0]),
        ground_at=site.ground_alt_amsl_m,
        max_home_error_m=site.scenario.limits.max_home_error_m,
        acceptance_radius_m=site.scenario.vehicle.acceptance_radius_m,
        max_climb_m_s=site.scenario.vehicle.max_climb_m_s,
        max_descent_m_s=site.scenario.vehicle.max_descent_m_s,
        volume=_operating_volume(site, compiled),
        returns=compiled.own_returns,
        needs=PlanNeeds(
            pace=pace_of(site),
            return_height_m=compiled.return_advice.needed_height_m,
            fence=bool(compiled.fence.polygons or compiled.fence.circles),
            camera_turns=site.scenario.sensor.turns_with_vehicle,
            longest_flight_s=site.scenario.vehicle.longest_flight_s,
            vehicle=site.scenario.vehicle,
            way_home_s=lambda place_m: way_home(site, place_m)[1],
        ),
    )


def _operating_volume(site: Site, compiled: CompiledMission) -> OperatingVolume:
    """Volume for positions in flight: no-fly zones count as far as they are exclusions of the fence."""
    shapely.prepare(site.fence)

    def ground_up_m(east_m: float, north_m: float) -> float:
        return float(site.ground.heights_m(np.array([[east_m, north_m]]))[0])

    def outside_fence_m(east_m: float, north_m: float) -> float:
        outside_m = float(site.fence.distance(shapely.Point(east_m, north_m)))
        return max([outside_m, *(zone.depth_m(east_m, north_m) for zone in compiled.zones_in_fence)])

    limits = site.scenario.limits
    return OperatingVolume(
        ground_up_m=ground_up_m,
        outside_fence_m=outside_fence_m,
        min_height_agl_m=limits.min_height_agl_m,
        max_height_agl_m=limits.max_height_agl_m,
    )


def check_home(vehicle: Connected, site: Site, compiled: CompiledMission) -> None:
    """Compare the vehicle's home with the planned one and the terrain there; heights above home would be wrong by it.

    Raises:
        VehicleError: it is farther away than the scenario allows.
    """
    session = Session(
        vehicle.client, vehicle.monitor, timeouts=FlightTimeouts(), on_event=lambda _: None, stop=lambda: 0
    )
    check_home_of(session, flight_plan(site, compiled))


def fly(vehicle: Connected, site: Site, compiled: CompiledMission, orders: Orders) -> FlightOutcome:
    """Fly the mission that the vehicle holds: ready, check, arm, start, follow, land; see :mod:`uavcover.flight.fly`.

    Raises:
        FlightFailedError: the vehicle or the link failed, or the vehicle is not what was planned for; it carries the outcome.
    """
    return fly_plan(
        vehicle.client, vehicle.monitor, flight_plan(site, compiled),
        orders, plan_return=checked_return(site),
    )  # fmt: skip


def checked_return(site: Site) -> PlanReturn:
    """Plans the return to a site's home along checked legs."""
    return lambda lat, lon, alt: compile_return(site, lat_deg=lat, lon_deg=lon, alt_amsl_m=alt)


def is_in_the_air(vehicle: Connected) -> bool:
    """Whether the vehicle is armed and in the air; its landed state, height and motion must agree on the ground."""
    client, monitor = vehicle.client, vehicle.monitor
    client.poll(0.0)
    until_s = client.clock.now() + _GROUND_S
    while client.vehicle.armed and monitor.on_ground is None and client.clock.now() < until_s:
        client.request_message(ExtendedSysState)
        client.request_message(GlobalPositionInt)
        client.poll(_ASK_AGAIN_S)
    proved = monitor.on_ground
    return client.vehicle.armed and not (monitor.ground.says_landed if proved is None else proved)


# Addresses of the vehicles of a command: from its options, or from the vehicles' scenario.


class VehiclePlace(NamedTuple):
    """Where a vehicle is."""

    url: str  # its link
    system_id: int | None = None  # which one on it; none where it is the only one


def given_places(urls: Sequence[str] | None, systems: Sequence[int] | None) -> list[VehiclePlace]:
    """The vehicles that ``--to`` and ``--system`` name, vehicle 1 first; none where no ``--to`` is given.

    One link with several systems is that of all of them; one system is that of each link.

    Raises:
        InputError: there are other numbers of both, or one vehicle is named twice.
    """
    urls, systems = urls or (), systems or ()
    if urls and len(urls) != len(systems) and 1 not in (len(urls), len(systems)) and systems:
        raise InputError(
            f"--system is given {len(systems)} times, but --to {len(urls)} times; give one --system for each --to, "
            "or one --to for all"
        )
    if systems and not urls:
        if len(systems) > 1:
            raise InputError("--system selects a vehicle on a link; specify the link with --to")
        return []
    count = max(len(urls), len(systems))
    all_urls = [*urls] if len(urls) == count else [*urls] * count
    all_systems = [*systems] if len(systems) == count else [*systems, None][:1] * count
    places = [VehiclePlace(url, system) for url, system in zip(all_urls, all_systems, strict=True)]
    require_different(places)
    return places


def require_different(places: Sequence[VehiclePlace]) -> None:
    """Refuse two vehicles at one address; each ``mock:`` is a vehicle of its own.

    Raises:
        InputError: two have the same address, or share one link and one system id.
    """
    for number, (url, system_id) in enumerate(places):
        on_it = [] if url.startswith("mock:") else [place for place in places[:number] if place.url == url]
        if any(None in (system_id, place.system_id) for place in on_it):
            raise InputError(
                f"--to: {url} is used {1 + len(on_it)} times; each vehicle needs its own link, or its own --system on that link"
            )
        if VehiclePlace(url, system_id) in on_it:
            raise InputError(f"--system: {system_id} at {url} is used twice; each vehicle needs its own system ID")


def links_of_run(run: RunFolder, given: Sequence[VehiclePlace], *, sortie: int | None) -> list[VehiclePlace]:
    """The given addresses, or those that the scenario of a run names.

    Args:
        run: with a plan.
        given: by :func:`given_places`.
        sortie: number of the one that is meant; none: all of the run.

    Raises:
        InputError: none was given, and the scenario does not name those of all vehicles that fly.
    """
    if given:
        return list(given)
    folder = run if sortie is None else run.flight(sortie)
    scenario = load_scenario(folder.existing("scenario.toml", made_by="uavcover plan"))
    if folder.read_json("plan.json", made_by="uavcover plan").get("fleet") is not None:
        return _links_of(scenario)
    # One flight of a fleet: a sortie's scenario has its own vehicle, and what closes gaps is flown by vehicle 1.
    vehicle = (scenario.vehicles or (scenario.vehicle,))[0]
    if vehicle.link is None:
        raise InputError(f"--to is missing, and the vehicle of {folder} has no link in its scenario; specify --to")
    return [VehiclePlace(vehicle.link, vehicle.system_id)]


def links_of_scenario(source: str, given: Sequence[VehiclePlace], *, sortie: int | None) -> list[VehiclePlace]:
    """The same for a scenario that is not planned yet, a file or a bundled one.

    Raises:
        InputError: the same, or their number is not that of the vehicles.
    """
    scenario = load_scenario(source)
    if not given:
        return _links_of(scenario)
    if scenario.vehicles and len(given) != len(scenario.vehicles) and not (len(given) == 1 and sortie is not None):
        raise InputError(
            f"--to is given {counted(len(given), 'time')}, but {source} defines "
            f"{len(scenario.vehicles)} different vehicles; specify a link for each, vehicle 1 first"
        )
    return list(given)


def _links_of(scenario: Scenario) -> list[VehiclePlace]:
    """The links of the vehicles of a scenario, vehicle 1 first. Raises InputError: one is missing."""
    if not scenario.vehicles:
        if scenario.vehicle.link is None:
            raise InputError("--to is missing, and [vehicle] has no link; specify one of them")
        if scenario.fleet.vehicles > 1:
            raise InputError(
                f"--to is missing, and [vehicle] has one link for {scenario.fleet.vehicles} vehicles; use --to for "
                "each, or a [[vehicle]] with its own link for each"
            )
        return [VehiclePlace(scenario.vehicle.link, scenario.vehicle.system_id)]
    missing = [number for number, vehicle in enumerate(scenario.vehicles, start=1) if vehicle.link is None]
    if missing:
        raise InputError(
            f"--to is missing, and [[vehicle]] number {missing[0]} has no link; use --to for each vehicle, or add a "
            "link to each [[vehicle]]"
        )
    return [VehiclePlace(vehicle.link, vehicle.system_id) for vehicle in scenario.vehicles if vehicle.link is not None]

"""The vehicles of a command or a site: addresses, links, homes, and answers to their terrain requests."""

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal, NamedTuple

import numpy as np

from mission_io import SigningKey
from mission_io.client.client import Client, answer_terrain_requests
from mission_io.errors import TransferSilentError, VehicleSilentError
from mission_io.links.opening import LoggedLink, SharedLink, open_link
from mission_io.model.items import GeoPoint
from mission_io.model.plain_text import counted
from mission_io.protocol.terrain import Heights, Position, TerrainAnswers
from mission_io.protocol.timing import Timing
from mission_io.wire.messages import AutopilotVersion, ExtendedSysState, GlobalPositionInt
from uavcover.errors import InputError, TerrainError
from uavcover.flight.monitor import Monitor, open_vehicle
from uavcover.flight.orders import require_answers, require_multirotor, require_one_vehicle
from uavcover.missions.mission_compiler import AUTOPILOTS
from uavcover.mock.behaviour import Settings
from uavcover.mock.dynamics import BatteryData
from uavcover.mock.server import mock_endpoint
from uavcover.mock.vehicle import MockConfig, MockVehicle
from uavcover.model.area import RasterTerrain
from uavcover.model.scenario import Scenario
from uavcover.model.vehicle import AutopilotName
from uavcover.plugins import load
from uavcover.run.folder import RunFolder
from uavcover.scenario.scenario_file import load_scenario, surface_source, terrain_source
from uavcover.scenario.site import Site
from uavcover.terrain.elevation_file import read_heights_amsl_m
from uavcover.terrain.terrain_source import TerrainSource

_log = logging.getLogger(__name__)
_GROUND_S, _ASK_AGAIN_S = 4.0, 0.2
"""Timeout and interval of the question to an armed vehicle whether it stands on the ground."""
_SECOND_ANSWER_S = 0.2

ClientName = Literal["native", "mavsdk"]
"""The implementation of transfers and commands."""


@dataclass(frozen=True, slots=True, eq=False)
class Connected:
    """A vehicle that has been found."""

    client: Client  # talks to it
    monitor: Monitor  # hears all that the client hears
    autopilot: AutopilotName  # its name in scenarios
    link: LoggedLink | None = None  # source of the telemetry log; None for another client
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
    position = home or (None if site is None else home_of(site)) or GeoPoint(0.0, 0.0, 0.0)
    name = "ardupilot" if site is None else site.scenario.vehicle.autopilot
    settings = Settings() if site is None else Settings.for_vehicle(site.scenario.vehicle)
    battery = BatteryData() if site is None else BatteryData.for_vehicle(site.scenario.vehicle)
    endpoint = mock_endpoint(
        lambda: MockVehicle(
            AUTOPILOTS[name], position, MockConfig(settings=settings, battery=battery, speed=at.mock_speed)
        ),
        speed=at.mock_speed,
    )
    view = None if at.shared is None or at.system_id is None else at.shared.view(at.system_id)
    link = LoggedLink(open_link(at.url, schemes={"mock": endpoint}) if view is None else view)
    if at.client_name != "native":
        client, monitor = load("uavcover.clients", at.client_name).open_client(link, own_system=at.own_system)
    else:
        client, monitor = open_vehicle(link, timing=at.timing, own_system=at.own_system)
    with client:
        if at.signing_key is not None:
            # Who receives them keeps the time of the last message for each link id: clients in parallel need their own.
            client.sign_with(at.signing_key, link_id=0 if view is None or at.system_id is None else at.system_id)
        vehicle = client.wait_for_vehicle(at.timeout_s, system_id=at.system_id, component_id=at.component_id)
        monitor.listen_to(vehicle.address)
        if site is not None:
            require_multirotor(client)
            answer_from_site(client, site)
            require_answers(client)
            _ask_who_answers(client)
            require_one_vehicle(client, monitor)
        own: AutopilotName = "px4" if vehicle.autopilot is AUTOPILOTS["px4"] else "ardupilot"
        try:
            yield Connected(client, monitor, own, link, at.url)
        except (VehicleSilentError, TransferSilentError):
            require_answers(client)  # a vehicle that answers nothing at all has a reason of its own
            raise


def _ask_who_answers(client: Client) -> None:
    """Ask for the hardware number, and listen for a second answer; not every autopilot answers."""
    try:
        client.request_message(AutopilotVersion, timeout_s=_SECOND_ANSWER_S)
    except VehicleSilentError:
        return
    until_s = client.clock.now() + _SECOND_ANSWER_S
    while client.clock.now() < until_s:
        client.poll(_SECOND_ANSWER_S)


def home_of(site: Site) -> GeoPoint | None:
    """Start position of a site's vehicle; None without a position on Earth or without a home."""
    if site.frame is None or site.home_m is None:
        return None
    lat, lon, alt = site.frame.geodetic_from_enu(site.home_m)
    return GeoPoint(float(lat[0]), float(lon[0]), float(alt[0]))


def require_home(site: Site) -> GeoPoint:
    """Start position of a site's vehicle.

    Raises:
        InputError: the site has no position on Earth or no home, so there is nothing to fly.
    """
    home = home_of(site)
    if home is None:
        lacks = "position on Earth" if site.frame is None else "[home]"
        raise InputError(f"scenario {site.scenario.name} has no {lacks}; to fly it, add an [origin] and a [home]")
    return home


def heights_of_files(source: TerrainSource, vertical_datum: str, say: Callable[[str], None]) -> Heights:
    """The ground of elevation files; unknown without data there, or once the files are unreadable.

    Args:
        source: the files.
        vertical_datum: what their heights are above.
        say: receives the reason when the files are unreadable.
    """

    def heights_amsl_m(positions: Sequence[Position]) -> Sequence[float]:
        lat_deg, lon_deg = np.array(positions, dtype=float).reshape(-1, 2).T
        try:
            return [float(height) for height in read_heights_amsl_m(source, vertical_datum, lat_deg, lon_deg)]
        except TerrainError as error:
            say(f"cannot send terrain heights to the vehicle: {error}")
            return [float("nan")] * len(positions)

    return heights_amsl_m


def heights_of_site(site: Site, say: Callable[[str], None]) -> Heights | None:
    """Ground below a site's flights, within its elevation files; None without a position on Earth."""
    if site.frame is None:
        return None
    terrain = site.scenario.terrain
    if isinstance(terrain, RasterTerrain):
        ground = heights_of_files(terrain_source(terrain), terrain.vertical_datum, say)
        source = surface_source(terrain)
        if source is None:
            return ground
        return _higher(ground, heights_of_files(source, terrain.surface_vertical_datum or terrain.vertical_datum, say))

    def heights_amsl_m(positions: Sequence[Position]) -> Sequence[float]:
        heights = [site.ground_alt_amsl_m(*position) for position in positions]
        return [float("nan") if height is None else height for height in heights]

    return heights_amsl_m


def _higher(ground: Heights, surface: Heights) -> Heights:
    """The higher of both; unknown where the surface is."""

    def heights_amsl_m(positions: Sequence[Position]) -> Sequence[float]:
        low, high = np.array(ground(positions), dtype=float), np.array(surface(positions), dtype=float)
        return [float(height) for height in np.where(np.isfinite(low), np.maximum(low, high), high)]

    return heights_amsl_m


def answer_from_site(client: Client, site: Site) -> None:
    """Answer the vehicle's requests for terrain heights from a site's elevation data whenever the client waits."""
    heights = heights_of_site(site, _log.warning)
    if heights is not None:
        answer_terrain_requests(client, TerrainAnswers(heights, say=_log.warning))


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
    return client.vehicle.armed and not (monitor.ground.reports_landed if proved is None else proved)


# Addresses of the vehicles of a command: from its options, or from the vehicles' scenario.


class VehicleAddress(NamedTuple):
    """Where a vehicle is."""

    url: str  # its link
    system_id: int | None = None  # which one on it; None where it is the only one


def given_addresses(urls: Sequence[str] | None, systems: Sequence[int] | None) -> list[VehicleAddress]:
    """The vehicles that ``--to`` and ``--system`` name, vehicle 1 first; empty where no ``--to`` is given.

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
    addresses = [VehicleAddress(url, system) for url, system in zip(all_urls, all_systems, strict=True)]
    require_different(addresses)
    return addresses


def require_different(addresses: Sequence[VehicleAddress]) -> None:
    """Refuse two vehicles at one address; each ``mock:`` is a vehicle of its own.

    Raises:
        InputError: two have the same address, or share one link and one system id.
    """
    for number, (url, system_id) in enumerate(addresses):
        on_it = [] if url.startswith("mock:") else [address for address in addresses[:number] if address.url == url]
        if any(None in (system_id, address.system_id) for address in on_it):
            raise InputError(
                f"--to: {url} is used {1 + len(on_it)} times; each vehicle needs its own link, or its own --system on that link"
            )
        if VehicleAddress(url, system_id) in on_it:
            raise InputError(f"--system: {system_id} at {url} is used twice; each vehicle needs its own system ID")


def links_of_run(run: RunFolder, given: Sequence[VehicleAddress], *, sortie: int | None) -> list[VehicleAddress]:
    """The given addresses, or those that the scenario of a run names.

    Args:
        run: with a plan.
        given: by :func:`given_addresses`.
        sortie: number of the one that is meant; None: all of the run.

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
    return [VehicleAddress(vehicle.link, vehicle.system_id)]


def links_of_scenario(source: str, given: Sequence[VehicleAddress], *, sortie: int | None) -> list[VehicleAddress]:
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


def _links_of(scenario: Scenario) -> list[VehicleAddress]:
    """The links of the vehicles of a scenario, vehicle 1 first. Raises InputError: one is missing."""
    if not scenario.vehicles:
        if scenario.vehicle.link is None:
            raise InputError("--to is missing, and [vehicle] has no link; specify one of them")
        if scenario.fleet.vehicles > 1:
            raise InputError(
                f"--to is missing, and [vehicle] has one link for {scenario.fleet.vehicles} vehicles; use --to for "
                "each, or a [[vehicle]] with its own link for each"
            )
        return [VehicleAddress(scenario.vehicle.link, scenario.vehicle.system_id)]
    missing = [number for number, vehicle in enumerate(scenario.vehicles, start=1) if vehicle.link is None]
    if missing:
        raise InputError(
            f"--to is missing, and [[vehicle]] number {missing[0]} has no link; use --to for each vehicle, or add a "
            "link to each [[vehicle]]"
        )
    return [VehicleAddress(each.link, each.system_id) for each in scenario.vehicles if each.link is not None]

"""A site's vehicle: find it, check that it stands where the plan starts, fly the compiled mission."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Literal

import numpy as np
import shapely

from mission_io import SigningKey
from mission_io.autopilots.autopilot import wire_items
from mission_io.autopilots.comparison import compare_items, fault_text
from mission_io.client.client import Client
from mission_io.errors import TransferSilentError, VehicleSilentError
from mission_io.links.opening import open_link
from mission_io.links.shared import SharedLink
from mission_io.links.telemetry_log import LoggedLink
from mission_io.model.items import GeoPoint, MissionType
from mission_io.protocol.timing import Timing
from mission_io.wire.messages import ExtendedSysState, GlobalPositionInt
from uavcover.errors import InputError
from uavcover.flight.flight_plan import FlightPlan, FlightTimeouts, OperatingVolume, PlanNeeds
from uavcover.flight.fly import FlightOutcome, Orders
from uavcover.flight.fly import fly as fly_plan
from uavcover.flight.fly_on import Continuation, PlanContinuation
from uavcover.flight.fly_on import fly_on as fly_on_plan
from uavcover.flight.modes import require_multirotor
from uavcover.flight.monitor import Monitor, open_vehicle
from uavcover.flight.precautions import require_answers
from uavcover.flight.readiness import check_home as check_home_of
from uavcover.flight.resume import along_leg_m
from uavcover.flight.return_home import PlanReturn
from uavcover.flight.session import Session
from uavcover.flight.vehicle_terrain import answer_from_site
from uavcover.missions.flight_costs import way_home
from uavcover.missions.leg_checks import find_problems
from uavcover.missions.mission_compiler import AUTOPILOTS, CompiledMission, compile_continuation, compile_return
from uavcover.missions.mission_files import compile_plan
from uavcover.mock.behaviour import Settings
from uavcover.mock.dynamics import BatteryData
from uavcover.mock.server import mock_endpoint
from uavcover.mock.vehicle import MockConfig, MockVehicle
from uavcover.model.route import Route
from uavcover.model.vehicle import AutopilotName
from uavcover.plugins import load
from uavcover.scenario.site import Site
from uavcover.scenario.vehicles import pace_of

if TYPE_CHECKING:  # who sends a file has no plan
    from uavcover.flight.resume import Unfinished

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
        orders, plan_return=_plan_return(site),
    )  # fmt: skip


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


def fly_on(vehicle: Connected, site: Site, unfinished: "Unfinished", orders: Orders) -> FlightOutcome:
    """Take over a vehicle in the air, and fly what is left of a plan.

    A vehicle that still holds the mission and is where it left its route goes on with the item it was flying to. Any other is
    sent a mission that leads from where it is, along checked legs, to where the route was left.

    Raises:
        FlightFailedError: as ``fly``; also when there is no checked way on from where the vehicle is, which then holds there.
    """

    def plan_continuation(lat_deg: float, lon_deg: float, alt_amsl_m: float) -> Continuation:
        held = _held_onward(vehicle, site, unfinished, lat_deg=lat_deg, lon_deg=lon_deg, alt_amsl_m=alt_amsl_m)
        if held is not None:
            return held
        return _sent_onward(
            vehicle, site, unfinished.route, lat_deg, lon_deg, alt_amsl_m, up_since_s=float(unfinished.track.time_s[0])
        )

    return _take_over(vehicle, site, plan_continuation, orders)


def fly_from_the_air(
    vehicle: Connected, site: Site, route: Route, orders: Orders, *, up_since_s: float | None
) -> FlightOutcome:
    """Take over a vehicle in the air, and fly a whole route and home along checked legs.

    Args:
        vehicle: connected, in the air.
        site: the scenario on its ground.
        route: the planned route, such as the one that closes the gaps of the flight that the vehicle is still on.
        orders: the user's orders, and the receiver of messages.
        up_since_s: vehicle time at which it took off, which its endurance has to bear; none: since it was switched on.

    Raises:
        FlightFailedError: as ``fly``; also when there is no checked way to the route, and the vehicle then holds where it is.
    """

    def plan_continuation(lat_deg: float, lon_deg: float, alt_amsl_m: float) -> Continuation:
        return _sent_onward(vehicle, site, route, lat_deg, lon_deg, alt_amsl_m, up_since_s=up_since_s or 0.0)

    return _take_over(vehicle, site, plan_continuation, orders)


def _take_over(vehicle: Connected, site: Site, plan_continuation: PlanContinuation, orders: Orders) -> FlightOutcome:
    return fly_on_plan(
        vehicle.client, vehicle.monitor, plan_continuation,
        orders, plan_return=_plan_return(site),
    )  # fmt: skip


def _sent_onward(
    vehicle: Connected,
    site: Site,
    route: Route,
    lat_deg: float,
    lon_deg: float,
    alt_amsl_m: float,
    *,
    up_since_s: float,
) -> Continuation:
    """A mission from where the vehicle is, to be sent to it."""
    flown_s = (vehicle.monitor.time_s or 0.0) - up_since_s
    compiled = compile_continuation(
        site, route, lat_deg=lat_deg, lon_deg=lon_deg, alt_amsl_m=alt_amsl_m,
        flown_s=max(0.0, flown_s), autopilot=vehicle.autopilot,
    )  # fmt: skip
    return Continuation(flight_plan(site, compiled), upload=True, first_item=0)


def _held_onward(
    vehicle: Connected, site: Site, unfinished: "Unfinished", *, lat_deg: float, lon_deg: float, alt_amsl_m: float
) -> Continuation | None:
    """The continuation of the mission on the vehicle; none for another mission, or away from the route."""
    number, planned_m = unfinished.broken.waypoint, unfinished.planned.route.waypoints_m
    if site.frame is None or number == 0:
        return None
    here_m = site.frame.enu_from_geodetic(lat_deg, lon_deg, alt_amsl_m)[0]
    flown_m, aside_m = along_leg_m(here_m, planned_m[number - 1 : number + 1])
    near_m = site.scenario.vehicle.acceptance_radius_m
    limits = site.scenario.limits
    way = np.ascontiguousarray([here_m, planned_m[number]])
    if (
        aside_m > near_m
        or flown_m > unfinished.broken.flown_m + near_m
        or find_problems(site, way, lowest_agl_m=limits.min_height_agl_m, highest_agl_m=limits.max_height_agl_m)
    ):
        return None
    compiled = compile_plan(site, unfinished.planned.route, autopilot=vehicle.autopilot)
    autopilot = AUTOPILOTS[vehicle.autopilot]
    held = vehicle.client.download(MissionType.MISSION)
    if fault_text(compare_items(wire_items(compiled.mission, autopilot), held, autopilot)) is not None:
        return None
    # The numbers of the track are those of the route that is left: a route that begins on the leg has one more.
    passed = len(unfinished.route) - (len(planned_m) - number)
    each = compiled.items_per_waypoint
    plan = replace(
        flight_plan(site, compiled),
        first_waypoint_item=compiled.first_waypoint_item + each * (number - passed),
        waypoint_count=len(unfinished.route),
        passed_before=passed,
    )
    return Continuation(plan, upload=False, first_item=compiled.first_waypoint_item + each * number)


def _plan_return(site: Site) -> PlanReturn:
    return lambda lat, lon, alt: compile_return(site, lat_deg=lat, lon_deg=lon, alt_amsl_m=alt)

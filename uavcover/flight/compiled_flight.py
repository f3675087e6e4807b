"""A compiled mission on a connected vehicle: its upload and comparison, the check of home, and its flight."""

import dataclasses
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any

import numpy as np
import shapely

from mission_io.autopilots.comparison import faults
from mission_io.client.client import Client
from mission_io.client.commands import name_of
from mission_io.client.transfer_outcome import ReadBack
from mission_io.errors import TransferError, TransferInterrupted
from mission_io.model.plain_text import counted
from uavcover.errors import InputError
from uavcover.flight.arming import check_home as check_home_of
from uavcover.flight.connect import Connected, VehicleLink, connect, require_home
from uavcover.flight.fly import fly as fly_plan
from uavcover.flight.follow import PlanReturn
from uavcover.flight.limits import read_return_parameters, return_warnings
from uavcover.flight.orders import (
    PREPARATION,
    FlightPlan,
    FlightTimeouts,
    OperatingVolume,
    Orders,
    PlanNeeds,
    require_multirotor,
)
from uavcover.flight.session import Session
from uavcover.missions.mission_compiler import CompiledMission, compile_mission, compile_return
from uavcover.missions.objectives import return_path
from uavcover.model.route import Route
from uavcover.model.track import FlightOutcome
from uavcover.run.folder import SCHEMA_VERSION, RunFolder
from uavcover.run.provenance import note_files
from uavcover.run.user import User
from uavcover.scenario.site import Site
from uavcover.scenario.vehicles import pace_of


def upload(
    client: Client,
    compiled: CompiledMission,
    *,
    progress: Callable[[str, int, int], None] | None = None,
    in_flight: bool = False,
) -> list[ReadBack]:
    """Upload mission, fence and rally points, read each back and compare.

    Args:
        client: connected, with a vehicle found.
        compiled: what to send.
        progress: receives the list's name, items across and items in all.
        in_flight: whether an armed vehicle is meant.

    Raises:
        VehicleError: the vehicle is not a multirotor; nothing was sent.
        MissionIoError: the vehicle refused, or fell silent; says what it holds now.
    """
    require_multirotor(client)
    results = []
    for name, content in (("mission", compiled.mission), ("fence", compiled.fence), ("rally", compiled.rally)):
        results.append(
            client.upload_and_verify(
                content, progress=None if progress is None else partial(progress, name), in_flight=in_flight
            )
        )
    return results


def upload_document(site: Site, compiled: CompiledMission, url: str, results: Sequence[ReadBack]) -> dict[str, Any]:
    """``upload.json``: what was sent, what came back, every difference and why it is or is not acceptable."""
    limit = compiled.max_height_above_home_m + 10.0
    return {
        "schema_version": SCHEMA_VERSION,
        "name": site.scenario.name,
        "url": url,
        "passed": all(result.passed for result in results),
        "first_waypoint_item": compiled.first_waypoint_item,
        "waypoint_count": compiled.waypoint_count,
        "items_per_waypoint": compiled.items_per_waypoint,
        "return_advice": dataclasses.asdict(compiled.return_advice),
        "no_fly_in_fence": [zone.name for zone in compiled.zones_in_fence],
        "no_fly_not_in_fence": [zone.name for zone in compiled.zones_left_out],
        "autopilot_max_height_above_home_m": limit,
        "lists": [result.as_json() for result in results],
    }


UPLOAD_FILE = "upload.json"


def upload_run(
    run: RunFolder, site: Site, route: Route, to: VehicleLink, user: User, *, in_flight: bool = False
) -> dict[str, Any]:
    """Check every leg and the vehicle's home, upload, read back, compare; writes ``upload.json`` and returns it.

    The file describes the last upload only: the first message of an upload deletes it.
    """
    require_home(site)
    compile_mission(site, route)  # a bad leg is found before the vehicle is asked
    with (
        run.reserved((), force=True),
        connect(to, site) as vehicle,
    ):
        return send_and_compare(run, site, route, vehicle, user, in_flight=in_flight)


def send_and_compare(
    run: RunFolder, site: Site, route: Route, vehicle: Connected, user: User, *, in_flight: bool = False
) -> dict[str, Any]:
    """The same over a link that is open, into a run folder that is reserved."""
    user.say(f"vehicle {vehicle.client.vehicle.system_id} at {vehicle.url}: {vehicle.client.vehicle.described}")
    compiled = compile_mission(site, route, autopilot=vehicle.autopilot)
    check_home(vehicle, site, compiled)
    run.remove([UPLOAD_FILE])
    with telling_what_is_held(user), user.progress("uploading") as bar:
        results = upload(
            vehicle.client,
            compiled,
            progress=lambda name, done, total: bar.update(done, total=total, note=name),
            in_flight=in_flight,
        )
    document = upload_document(site, compiled, vehicle.url, results)
    run.write_json(UPLOAD_FILE, document)
    note_files(run, "upload", [UPLOAD_FILE], command=sys.argv)
    for result in results:
        print_comparison(user, result)
    for words in return_warnings(compiled.own_returns.advice(read_return_parameters(_silent_session(vehicle)))):
        user.warn(words)
    user.say(
        f"set the autopilot's maximum height to at least {document['autopilot_max_height_above_home_m']:.0f} m above "
        "home, because fence items contain no height"
    )
    return document


@contextmanager
def telling_what_is_held(user: User) -> Iterator[None]:
    """Report the lists on the vehicle when an upload fails or is interrupted."""
    try:
        yield
    except TransferInterrupted as interrupted:
        user.warn(str(interrupted.outcome))
        _print_items(interrupted.outcome, user)
        raise
    except TransferError as error:
        _print_items(error, user)
        raise


def _print_items(error: TransferError, user: User) -> None:
    if error.vehicle_holds == "unchanged" or not error.held_items:
        return
    for number, item in enumerate(error.held_items[: PREPARATION.shown_items]):
        position = (
            f" at {item.lat_deg:.7f}, {item.lon_deg:.7f}, {item.alt_m:g} m {item.frame.name}"
            if item.has_position
            else ""
        )
        user.warn(f"now on the vehicle: {number}: {name_of(item.command)}{position}")
    if len(error.held_items) > PREPARATION.shown_items:
        user.warn(
            f"also on the vehicle: {counted(len(error.held_items) - PREPARATION.shown_items, 'item')}; see download"
        )


def print_comparison(user: User, result: ReadBack) -> None:
    """Report the differences of the read-back, and warn of those that change the meaning."""
    name = result.mission_type.name.lower()
    if not result.differences:
        user.say(f"{name}: uploaded and verified ({counted(len(result.sent), 'item')})")
        return
    wrong = faults(result.differences)
    changed = f"and changed the meaning of {len(wrong)}" if wrong else ""
    normalised = len(result.differences) - len(wrong)
    items, fields = counted(len(result.sent), "item"), counted(normalised, "field")
    user.say(f"{name}: uploaded {items}; the autopilot normalised {fields}{changed}")
    for fault in wrong[:5]:
        user.warn(f"{name}: {fault}")


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
            return_s=lambda position_m: return_path(site, position_m)[1],
        ),
    )


def _operating_volume(site: Site, compiled: CompiledMission) -> OperatingVolume:
    """Volume for positions in flight: no-fly zones count as far as they are exclusions of the fence."""

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
    check_home_of(_silent_session(vehicle), flight_plan(site, compiled))


def _silent_session(vehicle: Connected) -> Session:
    """A session that asks the vehicle and reports no events."""
    return Session(vehicle.client, vehicle.monitor, timeouts=FlightTimeouts(), on_event=lambda _: None, stop=lambda: 0)


def fly(vehicle: Connected, site: Site, compiled: CompiledMission, orders: Orders) -> FlightOutcome:
    """Fly the mission that the vehicle holds: ready, check, arm, start, follow, land; see :mod:`uavcover.flight.fly`.

    Raises:
        FlightFailedError: the vehicle or the link failed, or the vehicle is not what was planned for; it carries the outcome.
    """
    return fly_plan(
        vehicle.client, vehicle.monitor, dataclasses.replace(flight_plan(site, compiled), lists=(compiled.fence, compiled.rally)),
        orders, plan_return=checked_return(site),
    )  # fmt: skip


def checked_return(site: Site) -> PlanReturn:
    """Plans the return to a site's home along checked legs."""
    return lambda lat, lon, alt: compile_return(site, lat_deg=lat, lon_deg=lon, alt_amsl_m=alt)

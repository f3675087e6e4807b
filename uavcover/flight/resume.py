"""Continue a flight that ended before its plan: its remaining route, from the ground or in the air."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mission_io.autopilots.autopilot import Mode
from mission_io.autopilots.comparison import compare_items, fault_text
from mission_io.autopilots.mission_lists import wire_items
from mission_io.client.client import Client
from mission_io.model.items import MissionType
from mission_io.wire import messages as m
from uavcover.errors import UavcoverError
from uavcover.flight.arming import check_home_position, check_telemetry, request_telemetry
from uavcover.flight.compiled_flight import checked_return, flight_plan
from uavcover.flight.connect import Connected
from uavcover.flight.fly import FlightRun
from uavcover.flight.follow import PlanReturn, follow_mission, hold
from uavcover.flight.monitor import Monitor
from uavcover.flight.orders import FlightPlan, Orders, custom_mode
from uavcover.flight.progress import RESUME, Passage
from uavcover.flight.session import Session, Stopped, TakenOverError, first_seq, fly_from_item, hold_mode
from uavcover.kernels.arrays import FloatArray
from uavcover.missions.leg_checks import find_problems
from uavcover.missions.mission_compiler import AUTOPILOTS, compile_continuation, compile_mission
from uavcover.missions.objectives import judge_member
from uavcover.model.route import Plan, Route
from uavcover.model.track import Ending, EventKind, FlightFaultError, FlightOutcome, Track
from uavcover.planner.plan_files import save_plan
from uavcover.run.documents import (
    LINK,
    TRACK,
    PlannedDocument,
    flights_of,
    next_folder,
    read_plan_document,
)
from uavcover.run.folder import RunFolder
from uavcover.run.provenance import note_in_run, read_record, sha256_of
from uavcover.run.track_file import read_track
from uavcover.scenario.site import Site
from uavcover.sensing.site_maps import judging_map


@dataclass(frozen=True, slots=True)
class ResumePoint:
    """The end of what was flown of a planned route."""

    waypoint: int  # number of the first planned waypoint that was not passed; the number of waypoints when all were
    flown_m: float  # distance flown along the leg to it before the vehicle left it; 0 when that leg was not begun


def find_resume_point(track: Track, waypoints_m: FloatArray, *, radius_m: float) -> ResumePoint:
    """Where a track left its route.

    The vehicle's own count is believed where it begins, where it goes on one by one, and over a time that was not recorded; a
    jump passes nothing (see :class:`Passage`).

    Args:
        track: the flown track; its waypoint numbers are those of the route.
        waypoints_m: (n, 3) ENU, the planned route.
        radius_m: the vehicle's acceptance radius.
    """
    passage = Passage(waypoints_m, radius_m=radius_m)
    numbers, begun, begun_at = track.current_waypoint.tolist(), False, 0
    gaps = np.diff(track.time_s, prepend=track.time_s[:1]) > RESUME.unobserved_s
    for row, (number, position_m) in enumerate(zip(numbers, track.enu_m, strict=True)):
        before = passage.reached
        if gaps[row] or (number >= 0 and not begun):
            passage.believe(number)
            begun = True
        passage.take(number, position_m)
        if passage.reached != before:
            begun_at = row
    flown_m = 0.0
    if 0 < passage.reached < len(waypoints_m):
        rows = slice(begun_at, None)
        leg = waypoints_m[passage.reached - 1 : passage.reached + 1]
        on_leg = (track.current_waypoint[rows] == passage.reached) & ~gaps[rows]
        flown_m = _along_m(track.enu_m[rows], on_leg, leg, corridor_m=RESUME.corridor_radii * radius_m)
    return ResumePoint(passage.reached, flown_m)


def remaining_route(
    waypoints_m: FloatArray, broken: ResumePoint, *, radius_m: float, observes_along_legs: bool
) -> FloatArray:
    """(k, 3) ENU: the rest of a planned route.

    A sensor that observes along the path must also fly the rest of the interrupted leg. The route begins on that leg, slightly
    before the interruption, because a vehicle cuts its first corner. Every part of a checked leg is checked.

    Args:
        waypoints_m: (n, 3) ENU, the planned route.
        broken: where it was interrupted.
        radius_m: the vehicle's acceptance radius.
        observes_along_legs: whether the sensor also observes between waypoints.
    """
    left = waypoints_m[broken.waypoint :]
    if not observes_along_legs or broken.waypoint == 0 or len(left) == 0:
        return left.copy()
    begin, end = waypoints_m[broken.waypoint - 1], waypoints_m[broken.waypoint]
    length_m = float(np.linalg.norm(end - begin))
    again_m = max(0.0, broken.flown_m - RESUME.overlap_radii * radius_m - RESUME.overlap_m)
    entry = begin if length_m == 0.0 else begin + min(1.0, again_m / length_m) * (end - begin)
    return np.vstack([entry, left])


def along_leg_m(position_m: FloatArray, leg_m: FloatArray) -> tuple[float, float]:
    """Distance of a (3,) position along a (2, 3) leg, and aside of it, in metres."""
    along = leg_m[1] - leg_m[0]
    length_m = float(np.linalg.norm(along))
    if length_m == 0.0:
        return 0.0, float(np.linalg.norm(position_m - leg_m[0]))
    flown_m = min(length_m, max(0.0, float((position_m - leg_m[0]) @ along) / length_m))
    return flown_m, float(np.linalg.norm(position_m - leg_m[0] - flown_m / length_m * along))


def _along_m(positions_m: FloatArray, on_leg: NDArray[np.bool_], leg_m: FloatArray, *, corridor_m: float) -> float:
    """Length of the leg that the positions follow without leaving it, from the first one on it."""
    flown_m, begun = 0.0, False
    for position_m, on in zip(positions_m, on_leg.tolist(), strict=True):
        along_m, aside_m = along_leg_m(position_m, leg_m)
        if not on or aside_m > corridor_m:
            if begun:
                break
            continue
        begun = True
        flown_m = max(flown_m, along_m)
    return flown_m


@dataclass(frozen=True, slots=True, eq=False)
class Unfinished:
    """A flight that left something of its plan."""

    flown: RunFolder  # folder of the latest flight: the run itself, or of a flight that resumed it
    planned: PlannedDocument  # what that flight was to fly
    track: Track  # what it flew
    broken: ResumePoint  # where it left its route
    route: Route  # what is left
    folder: RunFolder  # where the flight that goes on is kept

    @property
    def complete(self) -> bool:
        """Whether nothing is left."""
        return len(self.route) == 0


def find_unfinished(run: RunFolder, site: Site) -> Unfinished:
    """The unflown rest of a run's latest flight. Raises InputError: nothing was flown, or what was cannot be read."""
    run.existing(TRACK, made_by="uavcover fly (without --resume)")
    latest = flights_of(run)[-1]
    planned = read_plan_document(
        latest.read_json("plan.json", made_by="uavcover plan"), source=str(latest.file("plan.json"))
    )
    track = read_track(latest.file(TRACK))
    radius_m = site.scenario.vehicle.acceptance_radius_m
    broken = find_resume_point(track, planned.route.waypoints_m, radius_m=radius_m)
    left = remaining_route(
        planned.route.waypoints_m, broken, radius_m=radius_m,
        observes_along_legs=site.scenario.sensor.looks_along_path,
    )  # fmt: skip
    return Unfinished(latest, planned, track, broken, Route(left), next_folder(run))


def took_off_s(run: RunFolder) -> float | None:
    """Take-off in vehicle time of the flight whose gaps a run closes; None without such a flight.

    Raises:
        InputError: its track cannot be read.
    """
    before = RunFolder(run.path.resolve().parent)
    if not (before.file("plan.json").is_file() and before.file(TRACK).is_file()):
        return None
    return float(read_track(flights_of(before)[-1].file(TRACK)).time_s[0])


def save_rest(unfinished: Unfinished, site: Site, *, command: Sequence[str]) -> None:
    """Write the rest's plan and mission from home into its folder, and the flight that it continues.

    Raises:
        InfeasibleError: there is no checked way to it.
    """
    save_part(
        unfinished.folder, site, unfinished.route, "resumed", command=command,
        scenario_sha256=scenario_of_fleet(unfinished.flown),
    )  # fmt: skip
    note_in_run(unfinished.folder, LINK, {"track_sha256": sha256_of(unfinished.flown.file(TRACK))})


def save_part(
    folder: RunFolder, site: Site, route: Route, made_by: str, *, command: Sequence[str], scenario_sha256: str | None
) -> None:
    """Write the plan of a part of a route, with its mission from home, into a folder.

    Args:
        folder: where to.
        site: of the vehicle that flies it.
        route: the part.
        made_by: what its plan calls its algorithm.
        command: the command line.
        scenario_sha256: as :func:`scenario_of_fleet`.

    Raises:
        InfeasibleError: there is no checked way to it.
    """
    started = time.monotonic()
    compiled = compile_mission(site, route)
    member = judge_member(judging_map(site), route, made_by, margin_m=site.scenario.limits.height_margin_m)
    plan = Plan(
        chosen=member, members=(member,), baselines=(), rule=made_by, rule_met=True, algorithm=made_by,
        evaluations=0, wall_s=time.monotonic() - started,
    )  # fmt: skip
    save_plan(
        folder, site, plan, compiled=compiled, autopilot=site.scenario.vehicle.autopilot,
        seed=site.scenario.planner.seed, command=command, scenario_sha256=scenario_sha256,
    )  # fmt: skip


def scenario_of_fleet(sortie: RunFolder) -> str | None:
    """SHA-256 of the fleet's scenario, for a sortie of a different vehicle; None for other plans."""
    record = read_record(sortie)
    requested = None if record.inputs is None else record.inputs.get("scenario")
    return requested if requested != record.files.get("scenario.toml") else None


@dataclass(frozen=True, slots=True)
class Continuation:
    """Continuation of a vehicle in the air."""

    plan: FlightPlan  # what it flies from here
    upload: bool  # whether the mission must be uploaded; otherwise the vehicle holds it already
    first_item: int  # index in ``plan.mission.items`` of the first item to fly to


PlanContinuation = Callable[[float, float, float], Continuation]
"""Plans a checked continuation from latitude, longitude (degrees) and height above sea level (metres)."""


def take_over(
    client: Client,  # talks to the vehicle
    monitor: Monitor,  # receives everything that the client receives
    plan_continuation: PlanContinuation,  # plans the checked way on from where the vehicle holds
    orders: Orders,  # what the user wants, and who receives the events
    *,
    plan_return: PlanReturn,  # plans the checked return after a stop
) -> FlightOutcome:
    """Take control of a vehicle in the air and fly the rest of a plan.

    The vehicle is commanded to hold first. A vehicle that is neither in its mission nor holding is left alone: a pilot or a
    failsafe controls it.

    Raises:
        FlightFailedError: as for ``fly``.
    """
    flight = FlightRun(client, monitor, orders)
    return flight.ended(lambda: _from_the_air(flight, plan_continuation), plan_return)


def _from_the_air(flight: FlightRun, plan_continuation: PlanContinuation) -> None:
    session = flight.session
    flight.find(_refuse_taken)
    request_telemetry(session)
    check_telemetry(session)
    flight.orders.on_begin()
    hold(session, "commanding the vehicle to hold")
    flight.touched = True
    here = session.monitor.latest(m.GlobalPositionInt)
    if here is None:
        raise FlightFaultError(Ending.POSITION_LOST, "the vehicle does not report its position; it continues to hold")
    try:
        onward = plan_continuation(here.lat_deg, here.lon_deg, here.alt_amsl_m)
    except UavcoverError as error:
        raise FlightFaultError(
            Ending.FAILED,
            f"no checked route starts at the current position: {error}; the vehicle continues to hold",
        ) from error
    plan = onward.plan
    check_home_position(session, plan)
    flight.limits.look(plan)
    flight.watch_preconditions(plan)
    if onward.upload:
        session.tell(EventKind.STAGE, "uploading the remaining mission")
        client = session.client
        sent = session.steer(
            lambda: client.upload_and_verify(plan.mission, in_flight=True), while_in=[hold_mode(session)]
        )
        if not sent.passed:
            raise FlightFaultError(
                Ending.FAILED,
                "the mission read back from the vehicle differs from the remaining mission; the "
                "vehicle continues to hold",
            )
    if session.stop():
        raise Stopped
    session.monitor.forget(m.MissionCurrent)
    progress = flight.record(plan)
    try:
        fly_from_item(session, first_seq(session) + onward.first_item)
    except TakenOverError as error:
        session.alarm(str(error))  # and follow it to the ground
    session.watch.take_off()
    session.tell(EventKind.STAGE, "continuing the mission")
    follow_mission(session, plan, progress, flight.orders.clearance.must_go_home, flight.preconditions)


def _refuse_taken(session: Session) -> None:
    """Refuse a vehicle that is neither in its mission nor holding."""
    allowed = {custom_mode(session.autopilot, mode) for mode in (Mode.MISSION, Mode.HOLD, hold_mode(session))}
    if session.client.vehicle.custom_mode not in allowed:
        raise FlightFaultError(
            Ending.NOT_ARMED,
            f"vehicle {session.client.vehicle.system_id} is in the air in {session.mode_name}: a pilot or a failsafe "
            "controls it, so no command was sent; land it or switch it to hold, then use --resume",
        )


def fly_on(vehicle: Connected, site: Site, unfinished: Unfinished, orders: Orders) -> FlightOutcome:
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

    return take_over(vehicle.client, vehicle.monitor, plan_continuation, orders, plan_return=checked_return(site))


def fly_from_the_air(
    vehicle: Connected, site: Site, route: Route, orders: Orders, *, up_since_s: float | None
) -> FlightOutcome:
    """Take over a vehicle in the air, and fly a whole route and home along checked legs.

    Args:
        vehicle: connected, in the air.
        site: the scenario on its ground.
        route: the planned route, such as the one that closes the gaps of the flight that the vehicle is still on.
        orders: the user's orders, and the receiver of messages.
        up_since_s: vehicle time at which it took off, which its endurance has to bear; None: since it was switched on.

    Raises:
        FlightFailedError: as ``fly``; also when there is no checked way to the route, and the vehicle then holds where it is.
    """

    def plan_continuation(lat_deg: float, lon_deg: float, alt_amsl_m: float) -> Continuation:
        return _sent_onward(vehicle, site, route, lat_deg, lon_deg, alt_amsl_m, up_since_s=up_since_s or 0.0)

    return take_over(vehicle.client, vehicle.monitor, plan_continuation, orders, plan_return=checked_return(site))


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
    vehicle: Connected, site: Site, unfinished: Unfinished, *, lat_deg: float, lon_deg: float, alt_amsl_m: float
) -> Continuation | None:
    """The continuation of the mission on the vehicle; None for another mission, or away from the route."""
    number, planned_m = unfinished.broken.waypoint, unfinished.planned.route.waypoints_m
    if site.frame is None or number == 0:
        return None
    here_m = site.frame.enu_from_geodetic(lat_deg, lon_deg, alt_amsl_m)[0]
    flown_m, aside_m = along_leg_m(here_m, planned_m[number - 1 : number + 1])
    near_m = site.scenario.vehicle.acceptance_radius_m
    limits = site.scenario.limits
    path = np.ascontiguousarray([here_m, planned_m[number]])
    if (
        aside_m > near_m
        or flown_m > unfinished.broken.flown_m + near_m
        or find_problems(site, path, lowest_agl_m=limits.min_height_agl_m, highest_agl_m=limits.max_height_agl_m)
    ):
        return None
    compiled = compile_mission(site, unfinished.planned.route, autopilot=vehicle.autopilot)
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

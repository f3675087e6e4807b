"""Fly the mission of a run, or the rest of it, and keep the record."""

import math
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from mission_io.links.datagrams import MonotonicClock
from mission_io.model.plain_text import counted
from mission_io.wire.signing import SystemClock
from uavcover.errors import InputError, OutputError, UavcoverError
from uavcover.flight.compiled_flight import check_home, fly, upload, upload_document
from uavcover.flight.connect import Connected, VehicleLink, connect, is_in_the_air, require_home
from uavcover.flight.flight_log import FlightLog, live_recording
from uavcover.flight.orders import ALONE, USUAL, Clearance, FlightTimeouts, Orders, Precautions
from uavcover.flight.resume import Unfinished, find_unfinished, fly_from_the_air, fly_on, save_rest, took_off_s
from uavcover.missions.mission_compiler import compile_mission
from uavcover.model.route import Route
from uavcover.model.track import Ending, FlightFailedError, FlightOutcome, TrackSample
from uavcover.recording.writer import write_recording
from uavcover.run import provenance
from uavcover.run.documents import GAP_FOLDER, TRACK, flown_tracks, read_planned, whole_run
from uavcover.run.folder import FLIGHT_FILES, RunFolder
from uavcover.run.judged_inputs import was_flown
from uavcover.run.provenance import note_files, seal_flight
from uavcover.run.track_file import SpaceReserve, read_track, record_bytes
from uavcover.run.user import User, to_paste
from uavcover.scenario.site import Site
from uavcover.sensing.site_maps import judging_map
from uavcover.verification.flown_route import PlannedRoute
from uavcover.verification.verify import flown_coverage

_LEFT_SOMETHING = frozenset({Ending.RETURNED, Ending.LEFT_HOLDING, Ending.RESERVE_KEPT})
ENDED_BY_USER = frozenset({Ending.RETURNED, Ending.LEFT_HOLDING, Ending.NOT_FLOWN})

_FIRST_STOP = (
    "stopping: the vehicle holds its position, then returns along checked legs; press Ctrl-C again to keep it "
    "holding, and a third time to abort immediately"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightOptions:
    """Options of a flight.

    Attributes:
        confirmed: whether a vehicle that may be real may be armed.
        force: whether to replace the track, recording and verdict of an older flight.
        upload_first: whether to upload the mission first, as for a vehicle that starts with this process.
        viewer_url: of a rerun viewer that shows the flight live.
        timeouts: of the flight; None: the defaults.
        precautions: against breaches and wrong limits.
        clearance: permission to start, and to fly home, near other vehicles.
        on_sample: receives the vehicle's position, in addition to the record.
        utc_offset_s: from the link's clock to UTC; None: by the clock of this computer.
        took_off_s: vehicle time of the take-off of a vehicle in the air; None for one on the ground.
    """

    confirmed: bool = False
    force: bool = False
    upload_first: bool = False
    viewer_url: str | None = None
    timeouts: FlightTimeouts | None = None
    precautions: Precautions = USUAL
    clearance: Clearance = ALONE
    on_sample: Callable[[TrackSample], None] = lambda _: None
    utc_offset_s: float | None = None
    took_off_s: float | None = None


USUAL_FLIGHT = FlightOptions()


def fly_run(
    run: RunFolder, site: Site, route: Route, to: VehicleLink, user: User, options: FlightOptions = USUAL_FLIGHT
) -> tuple[FlightOutcome, dict[str, Any]]:
    """Fly the route of a run, and record the track.

    The recording grows with the flight, also in the viewer at ``viewer_url``. At the end, it is written again completely, and
    ``run.json`` has the outcome.

    Raises:
        FlightFailedError: the flight did not end as planned; the run folder still has the record.
    """
    require_home(site)
    compile_mission(site, route)  # find a bad leg before contacting the vehicle
    refuse_older_flight(run, options)
    with run.reserved(FLIGHT_FILES, force=options.force), connect(to, site) as vehicle:
        return fly_connected(run, site, route, vehicle, user, options)


def refuse_older_flight(run: RunFolder, options: FlightOptions) -> None:
    """Refuse to replace an older flight without ``--force``. Raises OutputError."""
    if run.file("track.csv").exists() and not options.force:
        raise OutputError(f"{run}: the run already has a flight; use --resume to continue it, or --force to replace it")


def fly_connected(
    run: RunFolder, site: Site, route: Route, vehicle: Connected, user: User, options: FlightOptions
) -> tuple[FlightOutcome, dict[str, Any]]:
    """The same with a vehicle that is connected, into a run folder that is reserved."""
    compiled = compile_mission(site, route, autopilot=vehicle.autopilot)
    if options.upload_first:
        check_home(vehicle, site, compiled)
        upload(vehicle.client, compiled)
    return record_flight(
        run, site, route, user, vehicle, lambda orders: fly(vehicle, site, compiled, orders), options=options
    )


def record_flight(
    run: RunFolder, site: Site, route: Route, user: User, vehicle: Connected, begin: Callable[[Orders], FlightOutcome],
    *, options: FlightOptions,
) -> tuple[FlightOutcome, dict[str, Any]]:  # fmt: skip
    """Let ``begin`` fly, and keep the record in the reserved run folder.

    Raises:
        FlightFailedError: the flight did not end as planned; the run folder still has the record.
    """
    with (
        SpaceReserve(run.path, record_bytes(route.length_m / site.scenario.vehicle.cruise_speed_m_s)) as reserve,
        user.stop_requests(_FIRST_STOP) as interrupts,
        user.pause_requests() as keys,
        user.progress("flying", total=len(route)) as bar,
    ):
        log = FlightLog(
            run, overwrite=options.force, user=user, bar=bar, site=site, route=route, reserve=reserve,
            vehicle=vehicle, took_off_s=options.took_off_s,
            live=live_recording(run, site, route, viewer_url=options.viewer_url),
        )  # fmt: skip

        def take_sample(sample: TrackSample) -> None:
            log.take_sample(sample)
            options.on_sample(sample)

        orders = Orders(
            on_sample=take_sample, on_event=log.take_event, on_begin=log.begin, stop=lambda: interrupts.count,
            pause=keys.paused, confirmed=options.confirmed, timeouts=options.timeouts, precautions=options.precautions,
            clearance=options.clearance,
            utc_offset_s=_utc_offset_s(vehicle) if options.utc_offset_s is None else options.utc_offset_s,
        )  # fmt: skip
        ended: FlightOutcome | None = None
        try:
            outcome = ended = begin(orders)
        except FlightFailedError as error:
            reserve.release()
            ended = error.outcome
            _print_incidents(error.outcome, log, user)
            if log.sample_count:
                user.say(
                    f"kept {counted(log.sample_count, 'sample')} in {run.file('track.csv')}; use fly --resume to continue"
                )
            raise
        except KeyboardInterrupt:
            user.warn("aborted: the vehicle may be armed and in the air; take manual control now")
            if log.begun:
                provenance.note_interrupted(run)
            raise
        finally:
            log.close()
            _seal(run, log, ended, options, user)
            _keep_recording(run, site, route, log, user)
    _print_incidents(outcome, log, user)
    if log.error is not None:
        raise log.error
    document = {
        "run": str(run),
        **outcome.as_json(),
        "track": str(run.file("track.csv")),
        "recording": str(run.file("flight.rrd")),
    }
    user.say(
        f"{outcome.ending.value}: {counted(outcome.sample_count, 'sample')} over {outcome.duration_s:.0f} s of flight"
    )
    return outcome, document


def _print_incidents(outcome: FlightOutcome, log: FlightLog, user: User) -> None:
    """Print every incident, also those without consequence, with its time since the take-off and its evidence."""
    for incident in outcome.incidents:
        begin_s, end_s = (None if at is None else log.flown_s(at) for at in (incident.begin_s, incident.end_s))
        begin = "before take-off" if begin_s is None else f"{begin_s:.0f} s"
        end = "to the end" if incident.end_s is None else f"to {end_s:.0f} s" if end_s is not None else ""
        evidence = "".join(f"; evidence: {sign}" for sign in incident.evidence if sign not in incident.text)
        user.say(f"incident, {begin} {end}: {incident.kind.key}: {incident.text}{evidence}")


def _utc_offset_s(vehicle: Connected) -> float:
    """From the link's clock to UTC; NaN for a clock that is simulated."""
    clock = vehicle.client.clock
    return SystemClock().unix_s() - clock.now() if isinstance(clock, MonotonicClock) else math.nan


def _seal(run: RunFolder, log: FlightLog, outcome: FlightOutcome | None, options: FlightOptions, user: User) -> None:
    """Record the end of the flight and the hash of the track; an error of the flight counts first."""
    if not log.begun:
        return
    more = {"photos_required": True} if options.precautions.photos_required else {}
    try:
        seal_flight(run, samples=log.sample_count, outcome=outcome, command=sys.argv, **more)
    except UavcoverError as error:
        user.warn(f"{error}; the end of this flight was not recorded, which verify will report")


def _keep_recording(run: RunFolder, site: Site, route: Route, log: FlightLog, user: User) -> None:
    """Write ``flight.rrd`` from ``track.csv``; an error of the flight itself takes precedence."""
    if log.sample_count < 2:
        return
    failed = sys.exception() is not None
    try:
        _write_recording(run, site, route, log, user)
    except UavcoverError as error:
        if log.error is None and not failed:
            log.error = OutputError(str(error))
        else:
            user.warn(str(error))


def _write_recording(run: RunFolder, site: Site, route: Route, log: FlightLog, user: User) -> None:
    started = time.monotonic()
    with user.progress("recording"):
        track = read_track(run.file("track.csv"))
        coverage = judging_map(site)
        flown = flown_coverage(coverage, track, PlannedRoute(route.waypoints_m, 0.0))
        write_recording(
            run.file("flight.rrd"), coverage=coverage, planned=route, track=track,
            first_observed_s=flown.first_observed_s,
            events=log.recorded_events, states=log.states,
        )  # fmt: skip
    note_files(run, "record", ["flight.rrd"], command=sys.argv)
    wall_s = time.monotonic() - started
    user.say(f"recorded {run.file('track.csv')} and {run.file('flight.rrd')} ({wall_s:.1f} s)")


def resume_run(
    run: RunFolder, to: VehicleLink, user: User, options: FlightOptions = USUAL_FLIGHT, *, command: Sequence[str]
) -> tuple[FlightOutcome | None, dict[str, Any]]:
    """Fly the rest of a run's latest flight, from the ground or from the vehicle's position in the air.

    It has its own folder inside the run's, with its plan, mission, track and recording. A run without a flight, such as one that
    closes gaps, is flown from the vehicle's position in the air.

    Returns:
        The outcome, None if nothing was left to fly; and the answer for programs.

    Raises:
        InputError: nothing was flown yet, and the vehicle is on the ground.
        InfeasibleError: no checked path leads to the rest.
        FlightFailedError: the flight did not end as planned.
    """
    with run.reserved((), force=True):
        site, planned = read_planned(run)
        require_home(site)
        if not run.file(TRACK).exists():
            with connect(to, site) as vehicle:
                if not is_in_the_air(vehicle):
                    raise InputError(
                        f"{run}: no part of the run was flown, and the vehicle is on the ground; run fly without --resume"
                    )
                user.say("the vehicle is in the air and will fly the whole run from its current position")
                up_since_s = took_off_s(run)
                return record_flight(
                    run, site, planned.route, user, vehicle,
                    lambda orders: fly_from_the_air(vehicle, site, planned.route, orders, up_since_s=up_since_s),
                    options=replace(options, force=False, took_off_s=up_since_s),
                )  # fmt: skip
        unfinished = find_unfinished(run, site)
        _print(unfinished, user)
        if unfinished.complete:
            return None, {"run": str(run), "ending": None, "waypoints_left": 0}
        folder, route = unfinished.folder, unfinished.route
        with folder.reserved((), force=True):
            save_rest(unfinished, site, command=command)
            with connect(to, site) as vehicle:
                if is_in_the_air(vehicle):
                    user.say("the vehicle is in the air and will continue from its current position")
                    options = replace(options, took_off_s=float(unfinished.track.time_s[0]))
                    begin = lambda orders: fly_on(vehicle, site, unfinished, orders)  # noqa: E731
                else:
                    compiled = compile_mission(site, route, autopilot=vehicle.autopilot)
                    check_home(vehicle, site, compiled)
                    results = upload(vehicle.client, compiled)
                    folder.write_json("upload.json", upload_document(site, compiled, to.url, results))
                    note_files(folder, "upload", ["upload.json"], command=command)
                    begin = lambda orders: fly(vehicle, site, compiled, orders)  # noqa: E731
                try:
                    outcome, document = record_flight(
                        folder, site, route, user, vehicle, begin,
                        options=replace(options, force=True),
                    )  # fmt: skip
                finally:
                    # the run lists its flights, so that it misses one that is removed later
                    if folder.file(TRACK).exists():
                        note_files(run, "fly --resume", [f"{folder.path.name}/{TRACK}"], command=command)
    return outcome, {**document, "resumed_at_waypoint": unfinished.broken.waypoint}


def commands_after_flight(run: RunFolder, ending: Ending, to: Sequence[object]) -> list[str]:
    """Commands to run after a flight, one per line; ``verify`` only after the last flight.

    Args:
        run: the flown run, sortie, or gap mission.
        ending: of the flight.
        to: the options with the vehicle's address.
    """
    if ending is Ending.NOT_FLOWN:
        return [to_paste("fly", run, *to, "--force")]
    if ending in _LEFT_SOMETHING:
        return [to_paste("fly", run, "--resume", *to), *_verify_command(run)]
    whole = whole_run(run)
    for number, sortie in enumerate(whole.sorties(), start=1):
        if not sortie.file(TRACK).is_file():
            words = (whole, "--sortie", number, *to)
            # that one gets its mission at its start
            upload = [] if "mock:" in to else [to_paste("plan-upload", *words)]
            return [*upload, to_paste("fly", *words)]
    return _verify_command(run)


def _verify_command(run: RunFolder) -> list[str]:
    """Command that verifies a flight, together with the others of its run or the flight whose gaps it closes."""
    of_gaps = run.path.name == GAP_FOLDER and RunFolder(run.path.parent).file("plan.json").is_file()
    if not of_gaps:
        return [to_paste("verify", whole_run(run))]
    flown = RunFolder(run.path.parent)
    if not was_flown(flown):
        return [to_paste("verify", run)]
    tracks = [*flown_tracks(flown), *flown_tracks(run)]
    return [to_paste("verify", flown, *(word for track in tracks for word in ("--log", track)))]


def _print(unfinished: Unfinished, user: User) -> None:
    count, number = len(unfinished.planned.route), unfinished.broken.waypoint
    if unfinished.complete:
        user.say(f"all {count} waypoints of {unfinished.flown} were flown; there is nothing to resume")
        return
    where = (
        f"; the flight ended {unfinished.broken.flown_m:.0f} m along the leg to it"
        if unfinished.broken.flown_m > 0.0
        else ""
    )
    user.say(f"{unfinished.flown}: the first waypoint that was not flown is {number} of {count}{where}")
    user.say(f"the remaining mission is in {unfinished.folder}")

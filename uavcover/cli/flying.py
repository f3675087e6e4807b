"""Flying a run's mission and keeping the record, as ``fly`` and ``demo`` do it."""

import sys
import time
from collections.abc import Callable
from typing import Any

from mission_io import SigningKey
from uavcover.cli.console import Console, Interrupts
from uavcover.cli.flight_log import FlightLog, live_recording
from uavcover.cli.pausing import PauseKey
from uavcover.errors import OutputError, UavcoverError
from uavcover.judging.phases import PlannedRoute
from uavcover.judging.verify import flown_coverage
from uavcover.model.route import Route
from uavcover.recording.writer import write_recording
from uavcover.run import files, flight_status
from uavcover.run.folder import RunFolder
from uavcover.run.mission import compile_plan
from uavcover.run.provenance import note_files, seal_flight
from uavcover.run.session import ClientName, Connected, Orders, check_home, connect, fly, require_home
from uavcover.run.upload import upload
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import judging_map
from uavcover.vehicle.flight_plan import Patience
from uavcover.vehicle.fly import Ending, FlightOutcome
from uavcover.vehicle.outcome import FlightFailedError
from uavcover.vehicle.precautions import USUAL, Precautions
from uavcover.vehicle.track_file import SpaceReserve, read_track, record_bytes

ENDED_BY_USER = frozenset({Ending.RETURNED, Ending.LEFT_HOLDING, Ending.NOT_FLOWN})

_FIRST_STOP = "stopping: hold, then home along checked legs; once more: hold and leave it; a third time: abort at once"


def fly_run(
    run: RunFolder, site: Site, route: Route, url: str, console: Console,
    *, timeout_s: float, confirmed: bool, force: bool, mock_speed: float = 20.0, upload_first: bool = False,
    viewer_url: str | None = None, signing_key: SigningKey | None = None, patience: Patience | None = None,
    precautions: Precautions = USUAL,
    client_name: ClientName = "native", system_id: int | None = None, component_id: int | None = None,
) -> tuple[FlightOutcome, dict[str, Any]]:  # fmt: skip
    """Fly the route of a run, recording the track as it comes.

    The recording grows with the flight, in the viewer at ``viewer_url`` too; whatever the end, then it is written anew, whole,
    and ``run.json`` has the outcome.

    Raises:
        FlightFailedError: the flight did not end as it should; the run folder has all the same what was recorded.
    """
    require_home(site)
    compile_plan(site, route)  # a bad leg is known before anybody is asked
    if run.file("track.csv").exists() and not force:
        raise OutputError(f"{run}: holds the track of a flight; go on with it by --resume, or replace it by --force")
    with (
        run.reserved(files.FLIGHT_FILES, force=force),
        connect(
            url, site, timeout_s=timeout_s, mock_speed=mock_speed, signing_key=signing_key, client_name=client_name,
            system_id=system_id, component_id=component_id,
        ) as vehicle,
    ):  # fmt: skip
        compiled = compile_plan(site, route, autopilot=vehicle.autopilot)
        if upload_first:
            check_home(vehicle, site, compiled)
            upload(vehicle.client, compiled)
        return record_flight(
            run, site, route, console, vehicle, lambda orders: fly(vehicle, site, compiled, orders),
            confirmed=confirmed, force=force, viewer_url=viewer_url, patience=patience, precautions=precautions,
        )  # fmt: skip


def record_flight(
    run: RunFolder, site: Site, route: Route, console: Console, vehicle: Connected, begin: Callable[[Orders], FlightOutcome],
    *, confirmed: bool, force: bool, viewer_url: str | None, patience: Patience | None,
    precautions: Precautions = USUAL,
) -> tuple[FlightOutcome, dict[str, Any]]:  # fmt: skip
    """Let ``begin`` fly, and keep the record in the run folder, which is reserved.

    Raises:
        FlightFailedError: the flight did not end as it should; the run folder has all the same what was recorded.
    """
    with (
        SpaceReserve(run.path, record_bytes(route.length_m / site.scenario.vehicle.cruise_speed_m_s)) as reserve,
        Interrupts(_FIRST_STOP) as interrupts,
        PauseKey(console) as keys,
        console.progress("flying", total=len(route)) as bar,
    ):
        log = FlightLog(
            run, overwrite=force, console=console, bar=bar, waypoint_count=len(route), reserve=reserve,
            vehicle=vehicle, live=live_recording(run, site, route, viewer_url=viewer_url),
        )  # fmt: skip
        orders = Orders(
            on_sample=log.take_sample, on_event=log.take_event, on_begin=log.begin, stop=lambda: interrupts.count,
            pause=keys.paused, confirmed=confirmed, patience=patience, precautions=precautions,
        )  # fmt: skip
        try:
            outcome = begin(orders)
        except FlightFailedError as error:
            reserve.release()
            if log.begun:
                _note_outcome(run, error.outcome, console)
            if log.sample_count:
                console.say(
                    f"kept: {log.sample_count} samples in {run.file('track.csv')}; fly --resume goes on with them"
                )
            raise
        except KeyboardInterrupt:
            console.warn("aborted: the vehicle was left as it is, maybe armed and in the air; take over from here")
            if log.begun:
                flight_status.note_interrupted(run)
            raise
        finally:
            log.close()
            _seal(run, log, console)
            _keep_recording(run, site, route, log, console)
    if log.begun:
        _note_outcome(run, outcome, console)
    if log.error is not None:
        raise log.error
    document = {
        "run": str(run),
        **outcome.as_json(),
        "track": str(run.file("track.csv")),
        "recording": str(run.file("flight.rrd")),
    }
    console.say(f"{outcome.ending.value}: {outcome.sample_count} samples over {outcome.duration_s:.0f} s of flight")
    return outcome, document


def _seal(run: RunFolder, log: FlightLog, console: Console) -> None:
    """The hash of the track, whatever the end; an error of the flight itself is the one that counts."""
    if not log.sample_count:
        return
    try:
        seal_flight(run, samples=log.sample_count, command=sys.argv)
    except UavcoverError as error:
        console.warn(f"{error}; verify will ask for --accept-changed record")


def _note_outcome(run: RunFolder, outcome: FlightOutcome, console: Console) -> None:
    """A disk that is full takes no outcome; the flight's own error is the one that counts then."""
    try:
        flight_status.note_outcome(run, outcome)
    except UavcoverError as error:
        console.warn(str(error))


def _keep_recording(run: RunFolder, site: Site, route: Route, log: FlightLog, console: Console) -> None:
    """``flight.rrd`` from ``track.csv``; an error of the flight itself is the one that counts."""
    if log.sample_count < 2:
        return
    failed = sys.exception() is not None
    try:
        _write_recording(run, site, route, log, console)
    except UavcoverError as error:
        if log.error is None and not failed:
            log.error = OutputError(str(error))
        else:
            console.warn(str(error))


def _write_recording(run: RunFolder, site: Site, route: Route, log: FlightLog, console: Console) -> None:
    started = time.monotonic()
    with console.progress("recording"):
        track = read_track(run.file("track.csv"))
        coverage = judging_map(site)
        flown = flown_coverage(coverage, track, PlannedRoute(route.waypoints_m, 0.0))
        write_recording(
            run.file("flight.rrd"), site=site, coverage=coverage, planned=route, track=track,
            first_seen_s=flown.first_seen_s,
            events=log.recorded_events, states=log.states,
        )  # fmt: skip
    note_files(run, "record", ["flight.rrd"], command=sys.argv)
    wall_s = time.monotonic() - started
    console.say(f"recorded: {run.file('track.csv')} and {run.file('flight.rrd')} ({wall_s:.1f} s)")

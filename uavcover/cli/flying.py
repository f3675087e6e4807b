"""Flying a run's mission and keeping the record, as ``fly`` and ``demo`` do it."""

import sys
import time
from typing import Any

from uavcover import pipeline
from uavcover.cli.console import Bar, Console, Interrupts
from uavcover.errors import OutputError, UavcoverError
from uavcover.flight.events import EventKind, FlightEvent
from uavcover.flight.fly import Ending, FlightOutcome
from uavcover.flight.track_file import TrackWriter, read_track
from uavcover.model.route import Route
from uavcover.model.track import TrackSample
from uavcover.on_vehicle import check_home, connect, fly, require_home
from uavcover.recording import flight as recorded
from uavcover.recording.writer import write_recording
from uavcover.run_folder import RunFolder
from uavcover.site import Site
from uavcover.verification.phases import PlannedRoute
from uavcover.verification.verify import flown_coverage

FLIGHT_FILES = ("track.csv", "flight.rrd")
ENDED_BY_USER = frozenset({Ending.RETURNED, Ending.LEFT_HOLDING, Ending.NOT_FLOWN})

_FIRST_STOP = "stopping: hold, then home along checked legs; once more: hold and leave it; a third time: abort at once"


class FlightLog:
    """The track and the events of a flight, kept as they come.

    ``track.csv`` begins with the first sample, so a flight that never began changes nothing in the run folder; then the
    recording and the verdict of an older flight are removed. When the file cannot be written any more, the vehicle is
    in the air: the flight is followed to its end, and the error comes after it.

    Args:
        run: where to.
        overwrite: whether a track that is there may be replaced.
        console: where events are told.
        bar: shows the waypoints.
        waypoint_count: of the planned route.
    """

    def __init__(self, run: RunFolder, *, overwrite: bool, console: Console, bar: Bar, waypoint_count: int) -> None:
        self.events: list[FlightEvent] = []
        self.error: OutputError | None = None
        self.sample_count = 0
        self._run, self._overwrite, self._console, self._bar = run, overwrite, console, bar
        self._waypoint_count = waypoint_count
        self._writer: TrackWriter | None = None

    def take_sample(self, sample: TrackSample) -> None:
        """Write a sample."""
        if self.error is not None:
            return
        try:
            if self._writer is None:
                self._run.remove([name for name in pipeline.AFTER_FLIGHT_FILES if name != "track.csv"])
                self._writer = TrackWriter(self._run.file("track.csv"), overwrite=self._overwrite)
            self._writer.write(sample)
            self.sample_count += 1
        except OutputError as error:
            self.error = error
            self._console.warn(f"{error}; the flight goes on without a record")

    def take_event(self, event: FlightEvent) -> None:
        """Tell an event."""
        self.events.append(event)
        if event.kind is EventKind.WAYPOINT and event.waypoint is not None:
            note = f"waypoint {event.waypoint} of {self._waypoint_count}"
            self._bar.update(event.waypoint, total=self._waypoint_count, note=note)
        elif event.kind is EventKind.WARNING:
            self._console.warn(event.text)
        else:
            self._console.say(f"  {'' if event.time_s is None else f'{event.time_s:.1f} s '}{event.text}")

    def close(self) -> None:
        """Close the track."""
        if self._writer is not None and self.error is None:
            self._writer.close()


def fly_run(
    run: RunFolder, site: Site, route: Route, url: str, console: Console,
    *, timeout_s: float, confirmed: bool, force: bool, mock_speed: float = 20.0, upload_first: bool = False,
) -> tuple[FlightOutcome, dict[str, Any]]:  # fmt: skip
    """Fly the route of a run, recording the track as it comes; the recording is written at the end, whatever the end."""
    require_home(site)
    pipeline.compile_plan(site, route)  # a bad leg is known before anybody is asked
    with (
        run.reserved(FLIGHT_FILES, force=force),
        connect(url, site, timeout_s=timeout_s, mock_speed=mock_speed) as vehicle,
        Interrupts(_FIRST_STOP) as interrupts,
    ):
        compiled = pipeline.compile_plan(site, route, autopilot=vehicle.autopilot)
        if upload_first:
            check_home(vehicle, site, compiled)
            pipeline.upload(vehicle.client, compiled)
        with console.progress("flying", total=len(route)) as bar:
            log = FlightLog(run, overwrite=force, console=console, bar=bar, waypoint_count=len(route))
            try:
                outcome = fly(
                    vehicle, site, compiled,
                    on_sample=log.take_sample, on_event=log.take_event, confirmed=confirmed, stop=lambda: interrupts.count,
                )  # fmt: skip
            except KeyboardInterrupt:
                console.warn("aborted: the vehicle was left as it is, maybe armed and in the air; take over from here")
                raise
            finally:
                log.close()
                _keep_recording(run, site, route, log, console)
    if log.error is not None:
        raise log.error
    document = {
        "run": str(run),
        "ending": outcome.ending.name.lower(),
        "waypoints_reached": outcome.waypoints_reached,
        "samples": outcome.sample_count,
        "duration_s": outcome.duration_s,
        "simulated_by": outcome.simulated_by,
        "track": str(run.file("track.csv")),
        "recording": str(run.file("flight.rrd")),
    }
    console.say(f"{outcome.ending.value}: {outcome.sample_count} samples over {outcome.duration_s:.0f} s of flight")
    return outcome, document


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
        coverage = pipeline.judging_map(site)
        flown = flown_coverage(coverage, track, PlannedRoute(route.waypoints_m, 0.0))
        write_recording(
            run.file("flight.rrd"), site=site, coverage=coverage, planned=route, track=track,
            first_seen_s=flown.first_seen_s,
            events=[
                recorded.FlightEvent(e.time_s, e.text, "WARN" if e.kind is EventKind.WARNING else "INFO")
                for e in log.events
                if e.time_s is not None
            ],
        )  # fmt: skip
    wall_s = time.monotonic() - started
    console.say(f"recorded: {run.file('track.csv')} and {run.file('flight.rrd')} ({wall_s:.1f} s)")

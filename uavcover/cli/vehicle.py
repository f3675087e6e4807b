"""Talking to a vehicle, as ``plan-upload``, ``fly`` and ``demo`` do it."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mission_io.client import Client
from mission_io.items import GeoPoint
from mission_io.verification import Verification
from uavcover import pipeline
from uavcover.cli.console import Console, Interrupts
from uavcover.documents import read_plan_document
from uavcover.errors import InputError
from uavcover.flight.conversation import Conversation
from uavcover.flight.events import EventKind, FlightEvent
from uavcover.flight.flight_plan import FlightPlan, Patience
from uavcover.flight.fly import Ending, FlightOutcome, fly
from uavcover.flight.mock_server import register_mock
from uavcover.flight.mock_settings import Settings
from uavcover.flight.mock_vehicle import MockVehicle
from uavcover.flight.monitor import Monitor, open_vehicle
from uavcover.flight.readiness import check_home
from uavcover.flight.track_file import TrackWriter, read_track
from uavcover.mission_compiler import AUTOPILOTS, CompiledMission, compile_return
from uavcover.model.route import Route
from uavcover.model.track import TrackSample
from uavcover.model.vehicle import AutopilotName
from uavcover.recording import flight as recorded
from uavcover.recording.writer import write_recording
from uavcover.run_folder import RunFolder
from uavcover.site import Site
from uavcover.verification.phases import PlannedRoute
from uavcover.verification.verify import flown_coverage


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
def connected(
    url: str, home: GeoPoint | None, site: Site | None, *, timeout_s: float, mock_speed: float = 1.0
) -> Iterator[Connected]:
    """Open a link and wait for a vehicle. ``mock:`` starts one in this process, at ``home`` and like the site's vehicle."""
    place = home if home is not None else GeoPoint(0.0, 0.0, 0.0)
    name = "ardupilot" if site is None else site.scenario.vehicle.autopilot
    settings = Settings() if site is None else Settings.for_vehicle(site.scenario.vehicle)
    register_mock(lambda: MockVehicle(AUTOPILOTS[name], place, settings=settings, speed=mock_speed), speed=mock_speed)
    client, monitor = open_vehicle(url)
    with client:
        vehicle = client.wait_for_vehicle(timeout_s)
        monitor.listen_to(vehicle.system_id)
        own: AutopilotName = "px4" if vehicle.autopilot is AUTOPILOTS["px4"] else "ardupilot"
        yield Connected(client, monitor, own)


def flight_plan(site: Site, compiled: CompiledMission) -> FlightPlan:
    """What a flight needs to know of a compiled mission."""
    home = compiled.mission.home
    if site.frame is None or site.home_m is None or home is None:
        raise InputError(f"scenario {site.scenario.name}: has no place on Earth or no home; there is nothing to fly")
    ground = float(site.ground.heights_m(site.home_m[:2])[0])
    point = np.array([site.home_m[0], site.home_m[1], ground])
    return FlightPlan(
        mission=compiled.mission,
        first_waypoint_item=compiled.first_waypoint_item,
        waypoint_count=compiled.waypoint_count,
        frame=site.frame,
        home=home,
        ground_alt_amsl_m=float(site.alts_amsl_m(point)[0]),
        max_home_error_m=site.scenario.limits.max_home_error_m,
    )


def upload_run(
    run: RunFolder, site: Site, route: Route, url: str, console: Console, *, timeout_s: float, in_flight: bool = False
) -> dict[str, Any]:
    """Check every leg and the vehicle's home, upload, read back, compare; writes ``upload.json`` and returns it."""
    first = pipeline.compile_plan(site, route)
    with connected(url, first.mission.home, site, timeout_s=timeout_s) as vehicle:
        console.say(f"vehicle {vehicle.client.vehicle.system_id} at {url}: {vehicle.client.vehicle.autopilot.name}")
        compiled = pipeline.compile_plan(site, route, autopilot=vehicle.autopilot)
        _check_home(vehicle, flight_plan(site, compiled))
        with console.progress("uploading") as bar:
            results = pipeline.upload(
                vehicle.client,
                compiled,
                progress=lambda name, done, total: bar.update(done, total=total, note=name),
                in_flight=in_flight,
            )
    document = pipeline.upload_document(site, compiled, url, results)
    run.write_json("upload.json", document)
    for result in results:
        say_comparison(console, result)
    console.say(
        f"set the autopilot's maximum height to at least {document['autopilot_max_height_above_home_m']:.0f} m above home "
        "(fence items carry no height)"
    )
    return document


def _check_home(vehicle: Connected, plan: FlightPlan) -> None:
    conversation = Conversation(
        vehicle.client, vehicle.monitor, patience=Patience(), on_event=lambda _: None, stop=lambda: 0
    )
    check_home(conversation, plan)


def say_comparison(console: Console, result: Verification) -> None:
    """Say what came back differently, and warn of what should not have."""
    name = result.mission_type.name.lower()
    if not result.differences:
        console.say(f"{name}: {len(result.sent)} items sent, read back equal")
        return
    faults = [difference for difference in result.differences if not difference.acceptable]
    console.say(
        f"{name}: {len(result.sent)} items sent, {len(result.differences)} fields came back changed, "
        f"{len(result.differences) - len(faults)} by the autopilot's design"
    )
    for fault in faults[:5]:
        console.warn(f"{name}: {fault}")


def fly_run(
    run: RunFolder, site: Site, route: Route, url: str, console: Console,
    *, timeout_s: float, confirmed: bool, force: bool, mock_speed: float = 20.0, upload_first: bool = False,
) -> tuple[FlightOutcome, dict[str, Any]]:  # fmt: skip
    """Fly the route of a run, recording the track as it comes; the recording is written at the end, whatever the end."""
    first = pipeline.compile_plan(site, route)
    run.prepare(pipeline.FLIGHT_FILES, force=force)
    events: list[FlightEvent] = []
    with (
        connected(url, first.mission.home, site, timeout_s=timeout_s, mock_speed=mock_speed) as vehicle,
        Interrupts() as interrupts,
        console.progress("flying", total=len(route)) as bar,
    ):
        compiled = pipeline.compile_plan(site, route, autopilot=vehicle.autopilot)
        if upload_first:
            _check_home(vehicle, flight_plan(site, compiled))
            pipeline.upload(vehicle.client, compiled)

        def note(event: FlightEvent) -> None:
            events.append(event)
            if event.kind is EventKind.WAYPOINT and event.waypoint is not None:
                bar.update(event.waypoint, total=len(route), note=f"waypoint {event.waypoint} of {len(route)}")
            elif event.kind is EventKind.WARNING:
                console.warn(event.text)
            else:
                console.say(f"  {'' if event.time_s is None else f'{event.time_s:.1f} s '}{event.text}")

        try:
            with TrackWriter(run.file("track.csv"), overwrite=force) as writer:

                def record(sample: TrackSample) -> None:
                    writer.write(sample)

                outcome = fly(
                    vehicle.client, vehicle.monitor, flight_plan(site, compiled),
                    on_sample=record, on_event=note, confirmed=confirmed, stop=lambda: interrupts.count,
                    plan_return=lambda lat, lon, alt: compile_return(site, lat_deg=lat, lon_deg=lon, alt_amsl_m=alt),
                )  # fmt: skip
        finally:
            _write_recording(run, site, route, events, console)
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


def _write_recording(run: RunFolder, site: Site, route: Route, events: list[FlightEvent], console: Console) -> None:
    """``flight.rrd`` from ``track.csv``; a flight that never began leaves neither."""
    path = run.file("track.csv")
    lines = 0
    if path.exists():
        with path.open(encoding="ascii") as file:
            lines = sum(1 for _ in zip(file, range(3), strict=False))
    if lines < 3:
        return
    started = time.monotonic()
    track = read_track(path)
    coverage = pipeline.judging_map(site)
    flown = flown_coverage(coverage, track, PlannedRoute(route.waypoints_m, 0.0))
    write_recording(
        run.file("flight.rrd"), site=site, coverage=coverage, planned=route, track=track, first_seen_s=flown.first_seen_s,
        events=[
            recorded.FlightEvent(e.time_s, e.text, "WARN" if e.kind is EventKind.WARNING else "INFO")
            for e in events
            if e.time_s is not None
        ],
    )  # fmt: skip
    console.say(f"recorded: {path} and {run.file('flight.rrd')} ({time.monotonic() - started:.1f} s)")


def planned_run(folder: Path) -> tuple[RunFolder, Site, Route]:
    """A run folder that has a plan, with its site and route."""
    run = RunFolder(folder)
    site = pipeline.load_site(run.existing("scenario.toml", made_by="uavcover plan"))
    document = run.read_json("plan.json", made_by="uavcover plan")
    return run, site, read_plan_document(document, source=str(run.file("plan.json"))).route


ENDED_BY_USER = frozenset({Ending.RETURNED, Ending.LEFT_HOLDING, Ending.NOT_FLOWN})

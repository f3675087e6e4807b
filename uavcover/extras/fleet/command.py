"""Upload the first sorties of a fleet's vehicles, and fly all vehicles of a plan at the same time."""

import threading
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from uavcover.errors import InputError, UavcoverError, VehicleError
from uavcover.extras.fleet.board import Board
from uavcover.extras.fleet.flight import FleetFlight, FleetOrders, Opening
from uavcover.extras.fleet.jobs import OnLoss, planned_jobs, require_at_once
from uavcover.extras.fleet.sortie import FleetClock, RealClock
from uavcover.extras.fleet.tuning import FLEET
from uavcover.flight.command import ENDED_BY_USER, FlightOptions, refuse_older_flight
from uavcover.flight.compiled_flight import check_home, send_and_compare
from uavcover.flight.connect import Connected, VehicleAddress, VehicleLink, connect, require_different, require_home
from uavcover.flight.orders import require_multirotor
from uavcover.kernels.arrays import FloatArray
from uavcover.missions.mission_compiler import compile_mission
from uavcover.planner.close_gaps import GapRequest, close_gaps
from uavcover.recording.writer import record_fleet
from uavcover.run.documents import TRACK, read_planned
from uavcover.run.folder import RunFolder
from uavcover.run.provenance import note_files
from uavcover.run.track_file import read_track
from uavcover.run.user import User, to_paste
from uavcover.sensing.site_maps import judging_map
from uavcover.verification.flown_route import PlannedRoute
from uavcover.verification.run_logs import shared_times
from uavcover.verification.verify import flown_coverage


@dataclass(frozen=True, slots=True)
class FirstSortie:
    """First flight of a vehicle of a fleet."""

    vehicle: int  # its number, from 1
    sortie: int  # the number of the sortie
    takeoff_s: float  # since the first take-off of all
    folder: RunFolder  # the sortie's run folder


def first_sorties(run: RunFolder, count: int) -> tuple[FirstSortie, ...]:
    """The first sorties of the first vehicles of a planned run.

    Args:
        run: with a plan.
        count: number of vehicles.

    Raises:
        InputError: the plan is for fewer vehicles, or cannot be read.
    """
    document = run.read_json("plan.json", made_by="uavcover plan")
    fleet, folders = document.get("fleet"), run.sorties()
    rows = fleet.get("by_vehicle", []) if isinstance(fleet, dict) else []
    require_at_once(fleet, run)
    if isinstance(fleet, dict) and not fleet.get("alike", True) and fleet.get("vehicles") != count:
        raise InputError(
            f"{run}: the {fleet.get('vehicles')} vehicles differ, but --to is given {count} times; specify a link for "
            "each vehicle, vehicle 1 first"
        )
    unlike = isinstance(fleet, dict) and not fleet.get("alike", True)
    if count == len(rows) == 1 and not folders:
        return (FirstSortie(1, 1, 0.0, run),)
    if (len(rows) < count and not unlike) or not folders:
        flying = len(rows) if folders else 1
        if isinstance(fleet, dict) and fleet.get("vehicles", 0) >= count:
            why = f"more vehicles would not finish sooner; use --to {'once' if flying == 1 else f'{flying} times'}"
        else:
            why = f"plan again with: uavcover plan SCENARIO --vehicles {count}"
        planned = "one vehicle" if flying <= 1 else f"{flying} vehicles"
        raise InputError(f"{run}: the plan is for {planned}, but --to is given {count} times; {why}")
    try:
        return tuple(
            FirstSortie(
                int(row["vehicle"]),
                int(row["sorties"][0]),
                float(row["takeoffs_s"][0]),
                run.flight(int(row["sorties"][0])),
            )
            for row in rows[:count]
        )
    except (KeyError, IndexError, TypeError, ValueError) as error:
        raise InputError(
            f"{run.file('plan.json')}: cannot read the key fleet ({type(error).__name__}: {error}); create the plan "
            "again with: uavcover plan"
        ) from error


def links_that_fly(run: RunFolder, links: Sequence[VehicleLink], user: User) -> list[VehicleLink]:
    """The links of the vehicles that a plan uses; messages name the others, which stay on the ground.

    Args:
        run: planned for the vehicles at these links.
        links: vehicle 1 first.
        user: receives messages.
    """
    fleet = run.read_json("plan.json", made_by="uavcover plan").get("fleet")
    rows = fleet.get("by_vehicle", []) if isinstance(fleet, dict) and fleet.get("alike", True) else []
    flying = len(rows) or len(links)
    if flying < len(links):
        user.warn(f"the plan does not use {', '.join(link.url for link in links[flying:])}; uploading nothing there")
    return list(links[:flying])


def upload_fleet(
    run: RunFolder, links: Sequence[VehicleLink], user: User, *, in_flight: bool = False
) -> list[dict[str, Any]]:
    """Upload its first sortie to each vehicle, read back, compare; vehicle k is at link k.

    Nothing is sent before every vehicle was found, has accepted kind and home, and every leg of its sortie is checked.

    Returns:
        what ``upload.json`` of each sortie says, with its vehicle, sortie and folder.

    Raises:
        InputError: the plan is for another number of vehicles.
        VehicleError: one is not a multirotor, is armed, or stands elsewhere; nothing was sent to any.
        MissionIoError: one does not answer, or an upload failed; messages name the vehicles that hold their sorties.
    """
    sorties = first_sorties(run, len(links))
    links = [links[sortie.vehicle - 1] for sortie in sorties]
    plans = [read_planned(sortie.folder) for sortie in sorties]
    for site, planned in plans:
        require_home(site)
        compile_mission(site, planned.route)
    documents: list[dict[str, Any]] = []
    with ExitStack() as opened:
        vehicles: list[Connected] = []
        for sortie, link, (site, planned) in zip(sorties, links, plans, strict=True):
            try:
                opened.enter_context(sortie.folder.reserved((), force=True))
                vehicle = opened.enter_context(connect(link, site))
                require_multirotor(vehicle.client)
                if vehicle.client.vehicle.armed and not in_flight:
                    raise VehicleError("the vehicle is armed; uploading to an armed vehicle requires --in-flight")
                check_home(vehicle, site, compile_mission(site, planned.route, autopilot=vehicle.autopilot))
            except Exception:
                user.warn(
                    f"vehicle {sortie.vehicle} at {link.url} is not ready; no mission was uploaded to any vehicle"
                )
                raise
            vehicles.append(vehicle)
        for sortie, vehicle, (site, planned) in zip(sorties, vehicles, plans, strict=True):
            user.say(f"uploading sortie {sortie.sortie} to vehicle {sortie.vehicle}")
            try:
                sent = send_and_compare(sortie.folder, site, planned.route, vehicle, user, in_flight=in_flight)
            except BaseException:
                held = ", ".join(str(document["vehicle"]) for document in documents) or "none"
                user.warn(f"vehicle {sortie.vehicle}: the upload failed; vehicles that have their sortie: {held}")
                raise
            documents.append(
                {"vehicle": sortie.vehicle, "sortie": sortie.sortie, "takeoff_s": sortie.takeoff_s}
                | {"run": str(sortie.folder), **sent}
            )
    for document in documents:
        verdict = "verified" if document["passed"] else "READ BACK DIFFERS"
        user.say(
            f"vehicle {document['vehicle']:<2} sortie {document['sortie']:<3} take-off at {document['takeoff_s']:.0f} s  "
            f"{document['url']}  {verdict}"
        )
    return documents


_FIRST_STOP = (
    "stopping: all vehicles hold their positions, then return along checked legs, one after the other; press Ctrl-C "
    "again to keep all of them holding, and a third time to abort immediately"
)


class FleetFailedError(VehicleError):
    """A vehicle of the fleet did not end as it should; the record of all is kept.

    Attributes:
        document: what happened, for programs.
    """

    def __init__(self, text: str, document: dict[str, Any]) -> None:
        self.document = document
        super().__init__(text)

    def details(self) -> dict[str, Any]:
        """The flight's events, for programs."""
        return self.document


@dataclass(frozen=True, slots=True, kw_only=True)
class FleetOptions:
    """Options of the flight of a fleet."""

    flight: FlightOptions  # of each vehicle
    on_loss: OnLoss = OnLoss.SHARE  # what becomes of what a lost vehicle was to see
    opening: Opening = connect  # opens the link to a vehicle
    # the shared clock, as each vehicle's thread sees it; none is the computer's
    clocks: Sequence[FleetClock] | None = None


def fly_fleet(
    run: RunFolder, links: Sequence[VehicleLink], user: User, options: FleetOptions, *, command: Sequence[str]
) -> tuple[bool, dict[str, Any]]:
    """Fly all sorties of a plan for several vehicles; vehicle k is at link k.

    All vehicles are found, checked and given their first sortie before one is armed. Each sortie has its record in its own
    folder, and ``fleet.rrd`` has all tracks on one clock.

    Returns:
        whether the user ended it, and the answer for ``--json``.

    Raises:
        InputError: the plan is for another number of vehicles, or a sortie was flown already.
        InfeasibleError: a leg exceeds a limit.
        FleetFailedError: a vehicle failed, or was lost.
    """
    require_different([VehicleAddress(link.url, link.system_id) for link in links])
    clocks = [RealClock(_speed(links))] * len(links) if options.clocks is None else options.clocks
    jobs = planned_jobs(run, len(links))
    for job in jobs:
        refuse_older_flight(job.folder, options.flight)
    board = Board(user, len(links))
    with (
        run.reserved((), force=True),
        user.stop_requests(_FIRST_STOP) as interrupts,
        user.pause_requests() as keys,
        user.progress("flying", total=sum(len(job.route) for job in jobs)) as bar,
    ):
        orders = FleetOrders(
            links=links, flight=options.flight, on_loss=options.on_loss, opening=options.opening, clocks=clocks,
            stops=lambda: interrupts.count, paused=keys.paused,
        )  # fmt: skip
        flight = FleetFlight(jobs, board, orders)
        threads = [
            threading.Thread(target=flight.follow, args=(k,), name=f"vehicle {k}", daemon=True)
            for k in range(1, len(links) + 1)
        ]
        for thread in threads:
            thread.start()
        shown_s = 0.0
        while any(thread.is_alive() for thread in threads):
            try:
                for thread in threads:
                    thread.join(FLEET.look_s / len(threads))
            except KeyboardInterrupt:
                flight.aborted = True
            since_s = flight.traffic.since_first_s(clocks[0].now())
            flown = sum(record.outcome.waypoints_reached for record in flight.flown if record.outcome is not None)
            bar.update(flown + sum(row.waypoint for row in board.rows.values() if row.late_s is not None))
            if since_s - shown_s >= FLEET.table_every_s:
                shown_s = since_s
                for line in board.lines(since_s):
                    board.say(line)
        if flight.aborted:
            user.warn("aborted: the vehicles may be armed and in the air; take manual control now")
        recorded = _record(run, flight, user, command)
    gaps = _close_gaps(run, flight, user, command)
    return _result(run, flight, user, {"recording": recorded, "gaps": gaps})


def _speed(links: Sequence[VehicleLink]) -> float:
    """Speed of the vehicles, times real time; only ``mock:`` can be fast.

    Raises:
        InputError: fast ones among others.
    """
    mocks = [link for link in links if link.url.startswith("mock:")]
    if len(mocks) == len(links):
        return links[0].mock_speed
    if any(link.mock_speed != 1.0 for link in mocks):
        raise InputError("--to: mock: can fly together with other vehicles only at --mock-speed 1")
    return 1.0


def _record(run: RunFolder, flight: FleetFlight, user: User, command: Sequence[str]) -> str | None:
    """The recording of all tracks; an error of the flight itself is the one that counts."""
    try:
        path = write_fleet_recording(run, [record.job.folder for record in flight.flown if record.began_s is not None])
        if path is not None:
            note_files(run, "fly", [FLEET_RECORDING], command=command)
            user.say(f"recorded: {path}")
    except UavcoverError as error:
        user.warn(str(error))
        return None
    return None if path is None else str(path)


def _close_gaps(run: RunFolder, flight: FleetFlight, user: User, command: Sequence[str]) -> dict[str, Any] | None:
    """The mission of the unobserved cells, where some are left."""
    if not flight.work.left or flight.called_off or flight.aborted:
        return None
    user.say("planning a gap mission for the remaining route of the lost vehicle:")
    try:
        _, document = close_gaps(run, user, GapRequest(force=True), command=command)
    except UavcoverError as error:
        user.warn(f"{error}; plan the gap mission with: {to_paste('gaps', run)}")
        return None
    return document


def _result(run: RunFolder, flight: FleetFlight, user: User, more: dict[str, Any]) -> tuple[bool, dict[str, Any]]:
    if flight.aborted:
        raise KeyboardInterrupt
    flown = sorted(flight.flown, key=lambda record: (record.vehicle, record.planned_s))
    document: dict[str, Any] = {
        "run": str(run),
        "sorties": [record.as_json() for record in flown],
        "left": flight.work.left,
        **more,
    }
    for line in flight.board.lines(0.0)[1:]:
        user.say(line.strip())
    for fault in flight.faults:
        if not isinstance(fault, UavcoverError):
            raise fault
    failed = [record for record in flown if record.error]
    texts = [f"vehicle {record.vehicle}, sortie {record.job.sortie}: {record.error}" for record in failed]
    texts += [str(fault) for fault in flight.faults]
    if texts:
        raise FleetFailedError("; ".join(texts), document)
    ended = {record.outcome.ending for record in flown if record.outcome is not None}
    return bool(ended & ENDED_BY_USER) or flight.orders.stops() > 0, document


FLEET_RECORDING = "fleet.rrd"


def write_fleet_recording(run: RunFolder, folders: Sequence[RunFolder]) -> Path | None:
    """Write ``fleet.rrd`` of all flights in these folders; None where nothing was recorded.

    Raises:
        InputError: a track does not tell when its positions arrived, or cannot be read.
        OutputError: the file cannot be written.
    """
    site, planned = read_planned(run)
    coverage = judging_map(site)
    shared: dict[str, tuple[FloatArray, FloatArray]] = {}
    first_observed: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    paces = []
    for folder in folders:
        if not folder.file(TRACK).exists():
            continue
        track = read_track(folder.file(TRACK))
        if len(track) < 2:
            continue
        times = shared_times(track)
        if times is None:
            raise InputError(
                f"{folder.file(TRACK)}: no {FLEET_RECORDING}, because the track lacks the arrival times of positions"
            )
        own, flown_plan = read_planned(folder)
        eyes = coverage if own.scenario.sensor == site.scenario.sensor else judging_map(own)
        flown = flown_coverage(eyes, track, PlannedRoute(flown_plan.route.waypoints_m, 0.0))
        name = str(folder.path.relative_to(run.path)).replace("/", ", ")
        shared[name] = (times.taken_utc_s, track.enu_m)
        first_observed.append((flown.first_observed_s, track.time_s, times.taken_utc_s))
        paces.append(times.pace)
    if not shared:
        return None
    begin, pace = min(float(t[0]) for t, _ in shared.values()), float(np.median(paces))

    def since_first_s(taken_utc_s: FloatArray) -> FloatArray:
        return (taken_utc_s - begin) / pace

    observed = np.full(coverage.grid.count, np.inf)
    for first_s, own_s, taken_utc_s in first_observed:
        on_shared = since_first_s(np.interp(first_s, own_s, taken_utc_s))
        observed = np.fmin(observed, np.where(np.isfinite(first_s), on_shared, np.inf))
    tracks = {}
    for name, (taken_utc_s, enu_m) in shared.items():
        time_s = since_first_s(taken_utc_s)
        kept = np.concatenate([[True], np.diff(time_s) > FLEET.least_step_s])
        tracks[name] = (time_s[kept], enu_m[kept])
    path = run.file(FLEET_RECORDING)
    record_fleet(path, coverage=coverage, planned=planned.route, tracks=tracks, first_observed_s=observed)
    return path

"""Going on with a flight that ended before its plan: what is left of it, and where its flights are kept."""

import hashlib
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from uavcover.errors import InputError
from uavcover.model.route import Plan, Route
from uavcover.model.track import Track
from uavcover.routes.objectives import judge_member
from uavcover.run.documents import PlannedDocument, read_plan_document
from uavcover.run.folder import RunFolder
from uavcover.run.mission import compile_plan
from uavcover.run.plan_files import save_plan
from uavcover.run.provenance import note_in_run
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import judging_map
from uavcover.vehicle.resume_point import ResumePoint, find_resume_point, remaining_route
from uavcover.vehicle.track_file import read_track

TRACK = "track.csv"
_FOLDER = "resumed"
_LINK = "resumes"


@dataclass(frozen=True, slots=True, eq=False)
class Unfinished:
    """A flight that left something of its plan.

    Attributes:
        flown: folder of the latest flight: the run itself, or of a flight that resumed it.
        planned: what that flight was to fly.
        track: what it flew.
        broken: where it left its route.
        route: what is left.
        folder: where the flight that goes on is kept.
    """

    flown: RunFolder
    planned: PlannedDocument
    track: Track
    broken: ResumePoint
    route: Route
    folder: RunFolder

    @property
    def complete(self) -> bool:
        """Whether nothing is left."""
        return len(self.route) == 0


def flights_of(run: RunFolder) -> list[RunFolder]:
    """The run and the flights that resumed it, in their order; one that belongs to an older flight ends the list."""
    flights = [run]
    while True:
        folder = RunFolder(run.file(f"{_FOLDER}-{len(flights)}"))
        if not folder.file(TRACK).is_file() or not continues(folder, flights[-1]):
            return flights
        flights.append(folder)


def flown_tracks(run: RunFolder) -> list[Path]:
    """The tracks that count together: the run's, or those of its sorties, each with the flights that resumed it.

    Raises:
        InputError: nothing was flown.
    """
    if sorties := run.sorties():
        flown = [sortie for sortie in sorties if sortie.file(TRACK).is_file()]
        if not flown:
            run.existing(TRACK, made_by="uavcover fly --sortie 1")
        return [track for sortie in flown for track in flown_tracks(sortie)]
    run.existing(TRACK, made_by="uavcover fly")
    return [folder.file(TRACK) for folder in flights_of(run)]


def find_unfinished(run: RunFolder, site: Site) -> Unfinished:
    """What the latest flight of a run has left.

    Raises:
        InputError: nothing was flown, or what was cannot be read.
    """
    run.existing(TRACK, made_by="uavcover fly (without --resume)")
    flights = flights_of(run)
    latest = flights[-1]
    planned = read_plan_document(
        latest.read_json("plan.json", made_by="uavcover plan"), source=str(latest.file("plan.json"))
    )
    track = read_track(latest.file(TRACK))
    radius_m = site.scenario.vehicle.acceptance_radius_m
    broken = find_resume_point(track, planned.route.waypoints_m, radius_m=radius_m)
    left = remaining_route(
        planned.route.waypoints_m, broken, radius_m=radius_m,
        sees_along_legs=site.scenario.sensor.sensing == "along-path",
    )  # fmt: skip
    folder = RunFolder(run.file(f"{_FOLDER}-{len(flights)}"))
    return Unfinished(latest, planned, track, broken, Route(left), folder)


def took_off_s(run: RunFolder) -> float | None:
    """When the vehicle took off for the flight whose gaps a run closes, vehicle time; none when there is no such flight.

    Raises:
        InputError: its track cannot be read.
    """
    before = RunFolder(run.path.resolve().parent)
    if not (before.file("plan.json").is_file() and before.file(TRACK).is_file()):
        return None
    return float(read_track(flights_of(before)[-1].file(TRACK)).time_s[0])


def save_rest(unfinished: Unfinished, site: Site, *, command: Sequence[str]) -> None:
    """Write the plan of what is left, with its mission from home, into its folder, and which flight it goes on with.

    Raises:
        InfeasibleError: there is no checked way to it.
    """
    started = time.monotonic()
    route = unfinished.route
    compiled = compile_plan(site, route)
    member = judge_member(judging_map(site), route, "resumed", margin_m=site.scenario.limits.height_margin_m)
    plan = Plan(
        chosen=member, members=(member,), baselines=(), rule="resumed", rule_met=True, algorithm="resumed",
        evaluations=0, wall_s=time.monotonic() - started,
    )  # fmt: skip
    save_plan(
        unfinished.folder, site, plan, compiled=compiled, autopilot=site.scenario.vehicle.autopilot,
        seed=site.scenario.planner.seed, command=command,
    )  # fmt: skip
    note_in_run(unfinished.folder, _LINK, {"track_sha256": _sha256(unfinished.flown.file(TRACK))})


def continues(folder: RunFolder, before: RunFolder) -> bool:
    """Whether a flight goes on with the one before it as it is there now."""
    try:
        link = folder.read_json("run.json", made_by="uavcover fly --resume").get(_LINK)
    except InputError:
        return False
    return isinstance(link, dict) and link.get("track_sha256") == _sha256(before.file(TRACK))


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()

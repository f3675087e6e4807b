"""Going on with a flight that ended before its plan: what is left of it."""

import time
from collections.abc import Sequence
from dataclasses import dataclass

from uavcover.flight.resume_point import ResumePoint, find_resume_point, remaining_route
from uavcover.missions.mission_files import compile_plan
from uavcover.missions.objectives import judge_member
from uavcover.model.route import Plan, Route
from uavcover.model.track import Track
from uavcover.planner.plan_files import save_plan
from uavcover.run.documents import PlannedDocument, read_plan_document
from uavcover.run.flight_folders import LINK, TRACK, flights_of, next_folder, track_sha256
from uavcover.run.folder import RunFolder
from uavcover.run.provenance import note_in_run, read_record
from uavcover.run.track_file import read_track
from uavcover.scenario.site import Site
from uavcover.sensing.site_maps import judging_map


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
    """The unflown rest of a run's latest flight.

    Raises:
        InputError: nothing was flown, or what was cannot be read.
    """
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
        sees_along_legs=site.scenario.sensor.looks_along_path,
    )  # fmt: skip
    return Unfinished(latest, planned, track, broken, Route(left), next_folder(run))


def took_off_s(run: RunFolder) -> float | None:
    """Take-off in vehicle time of the flight whose gaps a run closes; none without such a flight.

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
    note_in_run(unfinished.folder, LINK, {"track_sha256": track_sha256(unfinished.flown.file(TRACK))})


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
    compiled = compile_plan(site, route)
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
    """SHA-256 of the fleet's scenario, for a sortie of a vehicle unlike the others; none for other plans."""
    record = read_record(sortie)
    asked = None if record.inputs is None else record.inputs.get("scenario")
    return asked if asked != record.files.get("scenario.toml") else None

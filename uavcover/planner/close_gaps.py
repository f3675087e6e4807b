"""Find and close the gaps of a run (``gaps``)."""

import math
import time
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from uavcover.errors import InfeasibleError, InputError
from uavcover.kernels.arrays import FloatArray
from uavcover.missions.flights import mission_texts
from uavcover.missions.mission_compiler import CompiledMission, compile_continuation, compile_mission
from uavcover.missions.objectives import judge_member
from uavcover.model.route import Plan, Route
from uavcover.model.track import Track
from uavcover.model.verdict import VerificationReport
from uavcover.planner.gap_route import GapRoute, plan_gap_route
from uavcover.planner.plan_files import save_plan
from uavcover.run.documents import GAP_FOLDER, flown_tracks
from uavcover.run.folder import OF_A_PLAN, PLAN_FILES, RunFolder
from uavcover.run.judged_inputs import check_accepted, logs_of_the_verdict
from uavcover.run.provenance import note_files, sha256_of_content
from uavcover.run.user import User, percent, to_paste
from uavcover.scenario.scenario_file import dump_scenario
from uavcover.scenario.site import Site
from uavcover.scenario.vehicles import own_sensors, vehicle_sites
from uavcover.sensing.site_maps import map_for
from uavcover.verification.command import judge_run, print_inputs
from uavcover.verification.gaps import gaps_geojson
from uavcover.verification.run_logs import read_log
from uavcover.verification.verify import Verdict

GAP_FILES = ("gaps.geojson", "gap_mission.waypoints")


class GapStart(StrEnum):
    """Start of a gap mission."""

    HOME = "home"
    LAST = "last"


@dataclass(frozen=True, slots=True, kw_only=True)
class GapRequest:
    """Request of a gap mission."""

    logs: Sequence[Path] = ()  # of the flight; empty: those that its verdict judged
    target: float | None = None  # required fraction of the visible ground; None: all of it
    min_area_m2: float = 0.0  # smaller gaps stay open
    start: GapStart = GapStart.HOME  # where the mission begins
    force: bool = False  # whether to replace an older gap mission and its flight
    accepted: Sequence[str] = ()  # changes since planning that are accepted
    system: int | None = None  # the vehicle of telemetry logs that have several; None: the only one


@dataclass(frozen=True, slots=True, eq=False)
class GapMission:
    """A mission that observes what a flight has missed."""

    repair: GapRoute  # the route, and what it observes of the gaps
    compiled: CompiledMission  # the mission, from take-off at home to landing there
    # the same route from the current position of a vehicle in the air; None without such a vehicle
    continuation: CompiledMission | None
    plan: Plan  # the same as a plan of its own, for its run folder
    coverage_after: float  # fraction of the visible ground that is observed after it, together with the flight

    @property
    def wanted(self) -> CompiledMission:
        """The requested mission."""
        return self.compiled if self.continuation is None else self.continuation


def close_gaps(
    run: RunFolder, user: User, request: GapRequest, *, command: Sequence[str]
) -> tuple[GapMission | None, dict[str, Any]]:
    """Write the gaps of a run and a mission that closes them, and print a summary.

    Without logs, use the logs that the verdict in the folder judged.

    Returns:
        The mission, None if there is nothing to close; and the answer for ``--json``.
    """
    target, min_area_m2, start = request.target, request.min_area_m2, request.start
    check_gap_request(min_area_m2=min_area_m2, target=target)
    check_accepted(request.accepted)
    run.existing("scenario.toml", made_by="uavcover plan")
    judged = list(request.logs) or logs_of_the_verdict(run)
    run.remove(GAP_FILES)
    site, verdict, sources, inputs = judge_run(run, user, logs=judged, accepted=request.accepted, system=request.system)
    report = verdict.report
    print_inputs(user, inputs)
    _print_gaps(user, report)
    document: dict[str, Any] = {
        "run": str(run),
        "tracks": sources,
        "inputs": inputs.hashes,
        "accepted_changes": [asdict(change) for change in inputs.changes],
        "gaps": len(report.gaps),
        "coverage_of_coverable": report.coverage_of_coverable,
        "verdict": report.verdict,
        "mission": None,
        "target_met": True,
    }
    save_gaps(run, verdict, command=command)
    wanted = [gap for gap in report.gaps if gap.coverable and gap.area_m2 >= min_area_m2]
    if not wanted or (target is not None and report.coverage_of_coverable >= target):
        user.say(f"no gaps to close; wrote {run.file('gaps.geojson')}")
        if (older := RunFolder(run.file(GAP_FOLDER))).file("mission.waypoints").is_file():
            user.say(f"{older} contains the mission for earlier gaps; do not fly it again")
        return None, document
    with user.progress("planning the gap mission"):
        own_logs = list(request.logs) or flown_tracks(run)
        in_the_air = read_log(own_logs[-1], site, system=request.system).track if start is GapStart.LAST else None
        first = vehicle_sites(site)[0] if own_sensors(site.scenario) else site
        mission = plan_gap_mission(first, verdict, min_area_m2=min_area_m2, target=target, in_the_air=in_the_air)
    whole_sha256 = None if first is site else sha256_of_content(dump_scenario(site.scenario))
    folder = save_gap_mission(run, first, mission, command=command, force=request.force, scenario_sha256=whole_sha256)
    path = mission.wanted.path_m
    length_m = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    document |= {
        "mission": str(run.file("gap_mission.waypoints")),
        "folder": str(folder),
        "start": start.value,
        "waypoint_count": len(mission.repair.route),
        "path_length_m": length_m,
        "flight_time_s": mission.wanted.flight_time_s,
        "coverage_after": mission.coverage_after,
        "target_met": mission.plan.rule_met,
    }
    user.say(
        f"gap mission       {len(mission.repair.route)} waypoints, {length_m:.0f} m and "
        f"{mission.wanted.flight_time_s:.0f} s including transits; coverage afterwards: "
        f"{percent(mission.coverage_after)} of the visible ground"
    )
    if mission.repair.observed_m2 < mission.repair.wanted_m2 and target is None:
        left_m2 = mission.repair.wanted_m2 - mission.repair.observed_m2
        user.warn(f"{left_m2:.0f} square metres of the gaps remain open: no leg within the limits observes them")
    if not mission.plan.rule_met and target is not None:
        user.warn(f"no gap mission reaches {percent(target)}; the best one was written")
    user.say(f"wrote {run.file('gaps.geojson')}, {run.file('gap_mission.waypoints')}")
    return mission, document


def commands_after_gaps(run: RunFolder, request: GapRequest) -> list[str]:
    """Commands to fly and verify the mission that :func:`close_gaps` has written, one a line."""
    folder = RunFolder(run.file(GAP_FOLDER))
    commands = [to_paste("plan-upload", folder, "--to", "URL"), to_paste("fly", folder, "--to", "URL")]
    if request.start is GapStart.LAST:
        resume = to_paste("fly", folder, "--resume", "--to", "URL")
        upload = to_paste("upload", run.file("gap_mission.waypoints"), "--to", "URL", "--in-flight")
        commands = [
            f"{resume}  # if the vehicle is holding in the air: starts at its position",
            f"{upload}  # with a ground station, from the first item: starts where the last log ends",
            f"{commands[0]}  # if the vehicle has landed: starts at home",
            commands[1],
        ]
    logs = (*(request.logs or flown_tracks(run)), folder.file("track.csv"))
    return [*commands, to_paste("verify", run, *(word for path in logs for word in ("--log", path)))]


def _print_gaps(user: User, report: VerificationReport) -> None:
    areas: dict[str, float] = defaultdict(float)
    for gap in report.gaps:
        areas[gap.reason] += gap.area_m2
    user.say(
        f"coverage flown    {percent(report.coverage_fraction)} of the area, "
        f"{percent(report.coverage_of_coverable)} of the visible ground"
    )
    if not report.passed:
        user.say(f"verdict           {report.verdict.upper()} (run uavcover verify for the reasons)")
    user.say(f"gaps              {len(report.gaps)}, {sum(areas.values()):.0f} square metres in total")
    for name, area_m2 in sorted(areas.items(), key=lambda item: -item[1]):
        user.say(f"                  {name}: {area_m2:.0f} square metres")


def check_gap_request(*, min_area_m2: float, target: float | None) -> None:
    """Check the arguments of a gap mission.

    Raises:
        InputError: an area below 0, or a target outside 0..1.
    """
    if not min_area_m2 >= 0.0 or not math.isfinite(min_area_m2):
        raise InputError(f"min area: must not be negative, not {min_area_m2} square metres")
    if target is not None and not 0.0 < target <= 1.0:
        raise InputError(f"target: must be a fraction of the visible ground above 0 and at most 1, not {target}")


def plan_gap_mission(
    site: Site,  # the scenario on its ground; of vehicles with sensors of their own, the site of the one that flies it
    verdict: Verdict,  # on what was flown
    *,
    min_area_m2: float = 0.0,  # smaller gaps remain open
    target: float | None = None,  # fraction of the visible ground that is enough, 0..1; default: everything
    # of a vehicle that has not landed: the mission begins at the last sample; default: take-off at home
    in_the_air: Track | None = None,
) -> GapMission:
    """The mission that closes the coverable gaps of a flight and lands at home.

    Raises:
        InputError: an argument is out of range, or the site has no home.
        InfeasibleError: there is nothing to close, or no checked mission for it.
    """
    check_gap_request(min_area_m2=min_area_m2, target=target)
    if site.home_m is None:
        raise InputError(f"scenario {site.scenario.name} has no [home], where a mission takes off and lands")
    started = time.monotonic()
    coverage, observed = verdict.coverage, verdict.flown.observed
    missing = np.zeros(coverage.grid.count, dtype=bool)
    for region in verdict.gaps:
        if region.gap.coverable and region.gap.area_m2 >= min_area_m2:
            missing[region.cells] = True
    own_eyes = site.scenario.sensor != coverage.site.scenario.sensor or own_sensors(coverage.site.scenario)
    eyes = map_for(coverage.site, site) if own_eyes else coverage
    missing &= eyes.coverable
    if not missing.any():
        raise InfeasibleError("there are no gaps to close: none is visible and large enough")
    needed_m2 = None
    if target is not None:
        lacking = target - coverage.fraction_of_coverable(observed)
        if lacking <= 0.0:
            raise InfeasibleError(f"there are no gaps to close: the flight already reached {100 * target:g} %")
        needed_m2 = lacking * float(coverage.grid.weight_m2[coverage.coverable].sum())
    start_m = site.home_m if in_the_air is None else _last_position_m(site, in_the_air)
    repair = plan_gap_route(eyes, missing, start_m=start_m, end_m=site.home_m, needed_m2=needed_m2)
    compiled = compile_mission(site, repair.route)
    continuation = None if in_the_air is None else _continuation(site, repair.route, in_the_air)
    route = repair.route
    member = judge_member(eyes, route, "gap-closing", margin_m=site.scenario.limits.height_margin_m)
    after = coverage.fraction_of_coverable(observed | eyes.observed(route.waypoints_m))
    plan = Plan(
        chosen=member, members=(member,), baselines=(), rule="gaps", rule_met=target is None or after >= target,
        algorithm="gap-closing", evaluations=0, wall_s=time.monotonic() - started,
    )  # fmt: skip
    return GapMission(repair, compiled, continuation, plan, after)


def _last_position_m(site: Site, track: Track) -> FloatArray:
    """(3,) ENU of the last sample, by its geodetic columns.

    Raises:
        InputError: the scenario has no position on Earth.
    """
    if site.frame is None:
        raise InputError(f"scenario {site.scenario.name} has no position on Earth; add an [origin]")
    lat_deg, lon_deg, alt_amsl_m = track.geodetic[-1].tolist()
    position_m: FloatArray = site.frame.enu_from_geodetic(lat_deg, lon_deg, alt_amsl_m)[0]
    return position_m


def _continuation(site: Site, route: Route, track: Track) -> CompiledMission:
    lat_deg, lon_deg, alt_amsl_m = track.geodetic[-1].tolist()
    return compile_continuation(
        site, route, lat_deg=lat_deg, lon_deg=lon_deg, alt_amsl_m=alt_amsl_m,
        flown_s=float(track.time_s[-1] - track.time_s[0]), autopilot=site.scenario.vehicle.autopilot,
    )  # fmt: skip


def save_gaps(run: RunFolder, verdict: Verdict, *, command: Sequence[str]) -> None:
    """Write ``gaps.geojson``.

    Raises:
        InputError: the scenario has no position on Earth.
    """
    run.write_json("gaps.geojson", gaps_geojson(verdict.coverage, verdict.gaps))
    note_files(run, "gaps", ["gaps.geojson"], command=command)


def save_gap_mission(
    run: RunFolder,
    site: Site,
    mission: GapMission,
    *,
    command: Sequence[str],
    force: bool,
    scenario_sha256: str | None = None,
) -> RunFolder:
    """Write ``gap_mission.waypoints``, and a run folder inside this one that can be uploaded and flown from home.

    Raises:
        OutputError: the folder already exists and ``force`` is not set.
    """
    folder = RunFolder(run.file(GAP_FOLDER))
    autopilot = site.scenario.vehicle.autopilot
    with folder.reserved((*PLAN_FILES, *OF_A_PLAN), force=force):
        save_plan(
            folder, site, mission.plan, compiled=mission.compiled, autopilot=autopilot,
            seed=site.scenario.planner.seed, command=command, scenario_sha256=scenario_sha256,
        )  # fmt: skip
    texts = mission_texts(mission.wanted, autopilot=autopilot, name=site.scenario.name)
    run.write_text("gap_mission.waypoints", texts["mission.waypoints"])
    note_files(run, "gaps", ["gap_mission.waypoints"], command=command)
    return folder

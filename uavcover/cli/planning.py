"""Planning into a run folder, as ``plan``, ``plan-upload`` and ``demo`` do it."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from uavcover import pipeline
from uavcover.cli.console import Console, Interrupts, metres, percent
from uavcover.cli.ending import INTERRUPTED
from uavcover.cli.options import autopilot_name
from uavcover.errors import InputError
from uavcover.mission_compiler import CompiledMission
from uavcover.model.route import Plan, RouteMember
from uavcover.planning.planner import Progress
from uavcover.planning.selection import parse_rule
from uavcover.run_folder import RunFolder
from uavcover.site import Site


@dataclass(frozen=True, slots=True, eq=False)
class PlanOutcome:
    """What planning into a folder gave.

    Attributes:
        site: the scenario on its ground.
        plan: the Pareto set and the choice.
        compiled: the mission, none for a scenario that has no place on Earth.
        document: the answer for ``--json``.
        exit_code: 0, 1 when the rule was not met, 130 when the user ended the search.
    """

    site: Site
    plan: Plan
    compiled: CompiledMission | None
    document: dict[str, Any]
    exit_code: int


def plan_into(
    folder: Path,
    scenario: str,
    console: Console,
    *,
    seed: int | None,
    evaluations: int | None,
    budget_s: float | None,
    algorithm: str | None,
    max_waypoints: int | None,
    select: str | None,
    autopilot: str | None,
    workers: int | None,
    force: bool,
    command: Sequence[str],
) -> PlanOutcome:
    """Plan a scenario into a run folder, saying what happens."""
    if select is not None:
        parse_rule(select)
    if algorithm is not None and algorithm not in {"imodbo", "modbo"}:
        raise InputError(f"--algorithm: {algorithm!r} is neither imodbo nor modbo")
    site = pipeline.load_site(scenario)
    name = autopilot_name(autopilot, site.scenario.vehicle.autopilot)
    run = RunFolder(folder)
    run.prepare((*pipeline.PLAN_FILES, *pipeline.MISSION_FILES, "upload.json", *pipeline.FLIGHT_FILES), force=force)
    console.say(f"planning {site.scenario.name}: {site.scenario.description}".rstrip(": "))
    started = time.monotonic()
    with Interrupts() as interrupts, console.progress("planning") as bar:

        def show(progress: Progress) -> None:
            shortest = "" if progress.shortest_m is None else f", {progress.shortest_m:.0f} m"
            bar.update(
                progress.evaluations, total=progress.total, note=f"{100 * progress.best_coverage:.1f} %{shortest}"
            )

        result = pipeline.plan(
            site, seed=seed, evaluations=evaluations, budget_s=budget_s, algorithm=algorithm, max_waypoints=max_waypoints,
            select=select, workers=workers, should_stop=interrupts.any, on_progress=show,
        )  # fmt: skip
        used_seed = site.scenario.planner.seed if seed is None else seed
        pipeline.save_plan(run, site, result, seed=used_seed, command=command)
        compiled = None
        if site.frame is not None and site.home_m is not None:
            compiled = pipeline.compile_plan(site, result.chosen.route, autopilot=name)  # type: ignore[arg-type]
            pipeline.save_mission(run, compiled, autopilot=name, name=site.scenario.name)  # type: ignore[arg-type]
    _say_plan(console, run, result, compiled, time.monotonic() - started)
    code = INTERRUPTED if result.interrupted else 0 if result.rule_met else 1
    document = {
        "run": str(run),
        "coverage_fraction": result.chosen.metrics.coverage_fraction,
        "coverage_of_coverable": result.chosen.metrics.coverage_of_coverable,
        "waypoint_count": result.chosen.metrics.waypoint_count,
        "path_length_m": result.chosen.metrics.path_length_m,
        "rule": result.rule,
        "rule_met": result.rule_met,
        "interrupted": result.interrupted,
        "mission_files": compiled is not None,
    }
    return PlanOutcome(site, result, compiled, document, code)


def _say_plan(console: Console, run: RunFolder, result: Plan, compiled: CompiledMission | None, wall_s: float) -> None:
    console.say(f"{'':22}{'coverage':>10}{'waypoints':>11}{'length':>12}{'time':>9}")
    shown = [("chosen route", result.chosen)]
    plain = [member for member in result.baselines if member.origin == "boustrophedon"][:1]
    tuned = [member for member in result.baselines if member.origin != "boustrophedon"][:1]
    for label, member in shown + [(m.origin, m) for m in plain + tuned]:
        console.say(_figures(label, member))
    console.say(
        f"{len(result.members)} routes in the Pareto set, {result.evaluations} evaluations of {result.algorithm}, {wall_s:.1f} s"
    )
    if not result.rule_met:
        console.warn(f"no route meets {result.rule}; the best there is has been written")
    if result.interrupted:
        console.warn("interrupted: the best route found so far has been written")
    if compiled is None:
        console.say("the scenario has no place on Earth: no mission files (give it an [origin] and a [home])")
        return
    advice = compiled.return_advice
    if advice.unsafe_waypoints:
        numbers = ", ".join(map(str, advice.unsafe_waypoints[:8])) + (
            " ..." if len(advice.unsafe_waypoints) > 8 else ""
        )
        console.warn(
            f"a straight return at {advice.return_height_m:.0f} m above home is not safe from waypoints {numbers} "
            f"(lowest {metres(advice.worst_clearance_m)} above ground); set the autopilot's return height to at least "
            f"{advice.safe_return_height_m:.0f} m"
        )
    console.say(f"written: {run.file('mission.waypoints')} and mission.plan, fence, rally, kml beside it")


def _figures(label: str, member: RouteMember) -> str:
    m = member.metrics
    counts = f"{percent(m.coverage_of_coverable):>10}{m.waypoint_count:>11}"
    return f"{label:22}{counts}{m.path_length_m:>10.0f} m{m.flight_time_s:>7.0f} s"

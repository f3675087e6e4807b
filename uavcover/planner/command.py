"""Plan into a run folder, and select another route of its Pareto set."""

import dataclasses
import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from uavcover.errors import INTERRUPTED, InfeasibleError, InputError
from uavcover.missions.flights import compile_flights, one_or_several
from uavcover.missions.mission_compiler import CompiledMission, Sortie, check_fence
from uavcover.missions.objectives import judge_route
from uavcover.missions.path_cost import check_reach
from uavcover.model.area import RasterTerrain
from uavcover.model.route import Plan, Route, RouteMember
from uavcover.model.vehicle import AutopilotName, autopilot_name
from uavcover.planner.budget import FRACTIONS, CommandTime, StageTimes
from uavcover.planner.fleet_parts import part_sites
from uavcover.planner.pareto_file import read_pareto, read_pareto_routes
from uavcover.planner.plan_files import bounds, fleet_document, least_length_m, print_fleet, save_plan
from uavcover.planner.plan_messages import (
    print_hidden,
    print_missions,
    print_older,
    print_plan,
    print_size,
    print_steps,
    print_summary,
    print_window,
    print_zones,
    progress_text,
    room_text,
    telling_bounds,
)
from uavcover.planner.plan_search import SearchRequest, plan_and_site
from uavcover.planner.planner import SearchProgress
from uavcover.planner.selection_rule import Rule, missing_index, parse_rule, select, with_sizes
from uavcover.plugins import loaded
from uavcover.run.documents import bounds_text, read_plan_document
from uavcover.run.folder import OF_A_PLAN, PARTS, PLAN_FILES, RunFolder
from uavcover.run.user import ProgressBar, StopRequests, User
from uavcover.scenario.scenario_file import terrain_source
from uavcover.scenario.site import Site, load_site
from uavcover.scenario.vehicles import groups_of, own_sensors, vehicle_sites
from uavcover.sensing.photos import overlap_shortfall, planned_photos
from uavcover.sensing.site_maps import is_large, judging_map, planning_map
from uavcover.terrain.suspect_heights import confirmed_trust

_QUICK_BOUNDS_CELLS_1_S = 80_000
"""Bounds without a solver look at about this number of cells in a second."""

_FIRST_STOP = "stopping: evaluating and writing the best route so far; press Ctrl-C twice more to abort"


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanRequest(SearchRequest):
    """Request of a plan: scenario, folder and settings. None: the scenario's value."""

    scenario: str | Site  # a file, the name of a bundled one, or a site
    folder: Path  # the run folder
    command: Sequence[str]  # the command line, for ``run.json``
    force: bool  # whether to replace an existing plan with all its files
    bounds_s: float | None = None  # time for proving bounds, after the search
    waypoint_price: float | None = None  # cost of every waypoint, in metres of path or in seconds, as the objective is
    vehicles: int | None = None  # how many fly at the same time
    rally: Literal["home", "auto"] | None = None  # "home" or "auto"


@dataclass(frozen=True, slots=True, eq=False)
class PlanOutcome:
    """Result of planning into a folder."""

    site: Site  # the scenario on its ground
    plan: Plan  # the Pareto set and the choice
    # the mission; None without a position on Earth, and for several sorties
    compiled: CompiledMission | None
    sorties: tuple[Sortie, ...]  # the flights when there are several
    document: dict[str, Any]  # the answer for ``--json``
    exit_code: int  # 0; 1: rule or overlap not met; 130: stopped by the user


def plan_into(request: PlanRequest, user: User, *, check_site: Callable[[Site], object]) -> PlanOutcome:
    """Plan a scenario into a run folder and print the progress; ``check_site`` can raise to refuse the site.

    Raises:
        InfeasibleError: no route keeps the limits, or the chosen route has no checked mission. In the second case, the plan is
            written without mission files.
    """
    if request.select is not None:
        parse_rule(request.select)
    if request.begun_s is None:
        request = dataclasses.replace(request, begun_s=time.monotonic())
    site = request.scenario if isinstance(request.scenario, Site) else load_site(request.scenario)
    if request.waypoint_price is not None:
        site = site.minimising(waypoint_price=request.waypoint_price)
    if request.vehicles is not None:
        site = site.flown_by(request.vehicles)
    if request.rally is not None:
        planner = dataclasses.replace(site.scenario.planner, rally=request.rally)
        site = dataclasses.replace(site, scenario=dataclasses.replace(site.scenario, planner=planner))
    if request.autopilot is not None and site.scenario.vehicles:
        raise InputError("--autopilot: each [[vehicle]] has its own autopilot; omit this option")
    for own in part_sites(site) if groups_of(site.scenario) else vehicle_sites(site):
        check_site(own)
    check_site(site)
    name = autopilot_name(request.autopilot, site.scenario.vehicle.autopilot)
    for own in vehicle_sites(site) or (site,):
        check_fence(own, autopilot=own.scenario.vehicle.autopilot if site.scenario.vehicles else name)
    _check_heights(site, user)
    if request.bounds_s is not None and not loaded("uavcover.bounds"):
        raise InputError("--bounds: the extra bounds is not installed; reinstall uavcover with its extras")
    run = RunFolder(request.folder)
    started = time.monotonic()
    times = StageTimes(time.monotonic, request.budget_s)
    with (
        run.reserved((*PLAN_FILES, *OF_A_PLAN), force=request.force),
        _prepared(site, parse_rule(request.select or site.scenario.select)),
        user.stop_requests(_FIRST_STOP) as stops,
    ):
        user.say(f"planning {site.scenario.name}: {site.scenario.description}".rstrip(": "))
        with user.progress("planning") as bar:
            result, site = _search(site, request, stops, bar, run.file(PARTS))
        flights: tuple[Sortie, ...] = ()
        refused = None
        if site.frame is not None and site.home_m is not None:
            try:
                with times.stage("missions"):
                    flights = compile_flights(site, result.chosen.route, autopilot=name)
            except InfeasibleError as error:
                refused = error
        seed = site.scenario.planner.seed if request.seed is None else request.seed
        compiled, sorties = one_or_several(site, flights)
        with times.stage("bounds"):
            bounds = _bounds(site, request, result, user)
        with times.stage("own returns, files"):
            fleet = fleet_document(site, flights)
            older = save_plan(
                run, site, result, compiled=compiled, autopilot=name, seed=seed, command=request.command, sorties=sorties,
                fleet=fleet, proved=bounds,
            )  # fmt: skip
        if not result.interrupted:
            shutil.rmtree(run.file(PARTS), ignore_errors=True)
    print_older(user, older)
    if refused is not None:
        raise InfeasibleError(f"{refused}; wrote {run.file('plan.json')}, but no mission files") from refused
    print_summary(user, site, result, flights)
    shown = bounds if request.bounds_s is not None else telling_bounds(site, bounds)
    print_plan(
        user, run, site, result, bounds_text(shown), time.monotonic() - started,
        requirement=_requirement(site, request, result),
    )  # fmt: skip
    print_zones(user, site, result.chosen.metrics)
    print_steps(user, site)
    print_hidden(user, site)
    if "shortest_path_m" in shown and (small := _objective_text(site)) is not None:
        user.say(f"the plan is optimised for total mission {small} (the last column), not for route length")
    if flights and (warning := room_text(site.scenario.limits, result.chosen.metrics)):
        user.warn(warning)
    print_missions(user, run, compiled, sorties)
    print_fleet(user, fleet)
    print_size(user, result)
    print_window(user, site, flights)
    interrupted = result.interrupted or stops.any()
    if interrupted and not result.interrupted:
        user.warn(f"interrupted after the search; the complete plan was written to {run}")
    short = _overlap_missed(site, result.chosen.route, sorties)
    if short is not None:
        user.warn(
            f"{short}, so verify would fail the flight; plan with a larger budget, require less overlap, or lower "
            "requirements.min_overlap_fraction"
        )
    code = INTERRUPTED if interrupted else 0 if result.rule_met and short is None else 1
    document = {
        "run": str(run),
        "coverage_fraction": result.chosen.metrics.coverage_fraction,
        "coverage_of_coverable": result.chosen.metrics.coverage_of_coverable,
        "waypoint_count": result.chosen.metrics.waypoint_count,
        "path_length_m": result.chosen.metrics.path_length_m,
        "rule": result.rule,
        "rule_met": result.rule_met,
        "interrupted": interrupted,
        "bounds": bounds,
        "mission_files": bool(flights),
        "sorties": len(sorties),
        "mission": None if result.chosen.mission is None else dataclasses.asdict(result.chosen.mission),
        "fleet": fleet,
    }
    return PlanOutcome(site, result, compiled, sorties, document, code)


@contextmanager
def _prepared(site: Site, rule: Rule) -> Iterator[None]:
    """Prepare the evaluation grid, and refuse an area that no flight reaches.

    Before this, Ctrl-C ends the command without output. After it, a search that is stopped has a route to write.

    Raises:
        InfeasibleError: the required coverage is out of reach.
    """
    if not is_large(site):
        for coverage in (planning_map(site), judging_map(site)):
            _ = coverage.coverable
        if not groups_of(site.scenario) and not own_sensors(site.scenario) and not site.scenario.sensor.has_own_view:
            check_reach(vehicle_sites(site) or (site,), planning_map(site), rule.required_coverage)
    yield


def _check_heights(site: Site, user: User) -> None:
    """Ask about suspicious elevation data where flights may go.

    Raises:
        InputError: the data is suspicious, and the user did not confirm it.
    """
    terrain = site.scenario.terrain
    if isinstance(terrain, RasterTerrain) and site.frame is not None:
        confirmed_trust(
            terrain_source(terrain), terrain.vertical_datum, site.fence, site.frame, user, trusted=terrain.trust_heights
        )


def _objective_text(site: Site) -> str | None:
    """Objective of the whole mission, as text; None where the objective is the route's alone."""
    return {"mission-time": "time", "energy": "energy"}.get(site.scenario.objective)


def _overlap_missed(site: Site, route: Route, sorties: Sequence[Sortie]) -> str | None:
    """Shortfall of the planned photos below the required overlap; None without a shortfall."""
    if site.scenario.requirements.min_overlap_fraction is None:
        return None
    routes = [sortie.route.waypoints_m for sortie in sorties] or [route.waypoints_m]
    return overlap_shortfall(site.scenario, planned_photos(judging_map(site), routes))


def _search(site: Site, request: PlanRequest, stops: StopRequests, bar: ProgressBar, kept: Path) -> tuple[Plan, Site]:
    unit = {"length": "m", "energy": "s of hovering"}.get(site.scenario.objective, "s")
    bar.update(0, note="baselines first")
    # Slow for a large area, and here it is only reported during the search.
    least_m = None if is_large(site) else least_length_m(site, request.select or site.scenario.select)

    started, budget_s, furthest = time.monotonic(), request.budget_s, 0.0

    def show(progress: SearchProgress) -> None:
        nonlocal furthest
        done = float(progress.evaluations) if budget_s is None else min(time.monotonic() - started, budget_s)
        furthest = max(furthest, done)  # one bar from the start to the end, across all stages of the search
        total = progress.total if budget_s is None else budget_s
        bar.update(furthest, total=total, note=progress_text(progress, unit, least_m))
        if site.frame is not None and (route := progress.incumbent) is not None:
            frame = site.frame
            bar.draw(lambda: np.column_stack(frame.geodetic_from_enu(route.waypoints_m)[1::-1]).tolist())

    return plan_and_site(site, request, should_stop=stops.any, on_progress=show, kept=kept, stops=stops)


def _bounds(site: Site, request: PlanRequest, result: Plan, user: User) -> dict[str, Any]:
    """The requested bounds. By default the quick ones; under a time budget those without a solver, if time remains.

    Large areas have no quick bounds: the bound on the path examines all cells in this process alone.
    """
    if result.interrupted or (request.bounds_s is None and is_large(site)):
        return bounds(site)
    if groups_of(site.scenario):
        if request.bounds_s is not None:
            user.warn("no bounds are computed, because they apply to a single route, not to a divided area")
        return bounds(site)
    if request.bounds_s is None and request.budget_s is not None:
        limit = CommandTime(begun_s=request.begun_s or time.monotonic(), budget_s=request.budget_s)
        takes_s = judging_map(site).grid.count / _QUICK_BOUNDS_CELLS_1_S
        in_time = limit.left_s(fraction=1.0 + FRACTIONS.late_bounds) >= takes_s
        return bounds(site, result, time_s=0.0) if in_time else bounds(site)
    if request.bounds_s is None:
        return bounds(site, result)
    user.say(f"computing bounds (up to {request.bounds_s:g} s)")
    return bounds(site, result, time_s=request.bounds_s)


def _requirement(site: Site, request: PlanRequest, result: Plan) -> str:
    """Requirement on the chosen route, as text: the rule, and the most waypoints where they are limited."""
    planner = site.scenario.planner
    most = request.max_waypoints or planner.max_waypoints
    if most is None or planner.encoding != "swaths":
        return result.rule
    return f"{result.rule} with at most {most} waypoints"


_ROUTES = "pareto_routes.csv"


def read_members(run: RunFolder, site: Site) -> list[RouteMember]:
    """The Pareto set of a run folder, judged anew on the cells of the area.

    Raises:
        InputError: a file is missing or broken; says which command makes it.
    """
    path = run.existing(_ROUTES, made_by="uavcover plan")
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: the file cannot be read ({error}); create it again with: uavcover plan") from error
    routes = read_pareto_routes(text, source=str(path))
    makers = [entry.made_by for entry in read_pareto(run.existing("pareto.csv", made_by="uavcover plan"))]
    if len(makers) != len(routes):
        raise InputError(
            f"{path}: the file has {len(routes)} routes, but pareto.csv has {len(makers)}; create both files again "
            "with: uavcover plan"
        )
    groups = len(groups_of(site.scenario)) or 1
    if any(len(route.parts) != groups for route in routes):
        raise InputError(f"{path}: each route must have {groups} parts; create the file again with: uavcover plan")
    return [judge_route(site, route, maker, margin_m=0.0) for route, maker in zip(routes, makers, strict=True)]


def choose(
    run: RunFolder, site: Site, rule_text: str, *, autopilot: AutopilotName, command: Sequence[str]
) -> tuple[Plan, tuple[Sortie, ...], RunFolder | None]:
    """Select another member by a rule, and write ``plan.json``, ``pareto.csv`` and its mission files.

    Remove the files of the previous route. Keep a route that was flown in its own folder.

    Returns:
        The plan, its flights (None for a scenario without a position on Earth), and the folder of the previous route.

    Raises:
        InputError: the rule is invalid, or a file of the run is missing or broken.
        InfeasibleError: the route has no checked mission; nothing is written.
    """
    rule = parse_rule(rule_text)
    members = read_members(run, site)
    document = run.read_json("plan.json", made_by="uavcover plan")
    choice = select(members, rule)
    if missing := missing_index(rule, len(members)):
        raise InputError(f"select: {missing}")
    chosen = members[choice.index]
    try:
        result = Plan(
            chosen=chosen, members=tuple(members), baselines=(), rule=rule.text, rule_met=choice.met,
            algorithm=str(document["algorithm"]), evaluations=int(document["evaluations"]),
            wall_s=float(document["wall_s"]), interrupted=bool(document["interrupted"]),
        )  # fmt: skip
        seed, bounds, baselines = int(document["seed"]), dict(document["bounds"]), list(document["baselines"])
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{run.file('plan.json')}: cannot read the file as a plan ({type(error).__name__}: {error}); create it "
            "again with: uavcover plan"
        ) from error
    vehicles = read_plan_document(document, source=str(run.file("plan.json"))).vehicles
    result = with_sizes(site, result, autopilot=autopilot, vehicles=vehicles)
    flights: tuple[Sortie, ...] = ()
    if site.frame is not None and site.home_m is not None:
        try:
            flights = compile_flights(site, result.chosen.route, autopilot=autopilot, vehicles=vehicles)
        except InfeasibleError as error:
            index = result.members.index(result.chosen)
            raise InfeasibleError(f"member {index}: {error}; {run} was not changed") from error
    compiled, sorties = one_or_several(site, flights)
    older = save_plan(
        run, site, result, compiled=compiled, autopilot=autopilot, seed=seed,
        command=command, sorties=sorties, proved=bounds, baselines=baselines,
        fleet=fleet_document(site, flights) if vehicles > 1 else None,
    )  # fmt: skip
    return result, flights, older

"""Contenders of the coverage benchmark, and their runs in the order of their worth.

Contenders are planners, which get a budget and a seed, and constructions, which need neither. Among these is the exhaustive line
scan, a boustrophedon tuned for as long as it takes: many directions, heights, insets, tolerances, and every number of lines. Each
run has its own process and is stored as one file.
"""

import dataclasses
import functools
import math
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import groupby, pairwise
from types import MappingProxyType
from typing import Any, Final

from uavcover.errors import InfeasibleError
from uavcover.extras.benchmarks.coverage.judging import CASES, Case, Judge, moment_document
from uavcover.extras.benchmarks.runs import KeptRuns, kept
from uavcover.model.route import Route
from uavcover.model.scenario import InitialRoute, PlannerAlgorithm
from uavcover.planner.baselines.boustrophedon import (
    TUNED,
    best_height_agl_m,
    fly_layout,
    long_side_angle_rad,
    plain_boustrophedon,
    regular_layout,
    width_across_m,
)
from uavcover.planner.baselines.initial_routes import constructed_routes, fly_rows, plain_rows, scanned_rows
from uavcover.planner.front import NamedRoute, Snapshots
from uavcover.planner.planner import Effort, plan_routes
from uavcover.planner.terrain_following import PLAIN_TOLERANCE_M
from uavcover.scenario.site import Site, load_site
from uavcover.sensing.coverage_map import CoverageMap

_ANGLES = 12
_INSETS = (0.0, 0.5, 0.8, 1.0)
_CLOSER_M = (5.0, 2.0, 1.0)
"""Tolerances to the terrain besides PLAIN_TOLERANCE_M, tried for the shortest families only."""
_FEWEST_LINES, _MOST_LINES = 0.8, 1.45
_MOST_NODES = 120

_LESS_COVERAGE = (0.0, 0.002, 0.005, 0.01, 0.03)
_LONGER = 1.05


@dataclass(frozen=True, slots=True)
class Tried:
    """A boustrophedon that was tried."""

    family: str  # all that does not change with the number of lines, as text
    lines: int  # how many lines, or rows of nodes
    coverage: float  # fraction of the visible ground, on the cells of the area
    hold_out: float  # the same on cells that no planner has used
    waypoints: int  # how many
    length_m: float  # of the open path
    violation: float  # 0 when all limits are kept


@dataclass(frozen=True, slots=True)
class _Family:
    """Lines that differ in their number only; lengths in metres."""

    angle_rad: float
    height_agl_m: float
    inset: float
    tolerance_m: float

    @property
    def name(self) -> str:
        angle, height = math.degrees(self.angle_rad), self.height_agl_m
        return f"{angle:.0f} degrees, {height:.1f} m, inset {self.inset:g}, tolerance {self.tolerance_m:g} m"


_Laid = tuple[str, int, Route]


def scan(judge: Judge) -> tuple[list[Tried], list[NamedRoute]]:
    """The tried routes that were worth judging.

    All are tried on the planner's cells first. Families that are more than 5 % longer there than the best, at every one of a few
    coverages about the required one, are not judged on the finer cells; lines of those within 1 % are flown closer to
    the terrain as well.
    """
    site = judge.site
    coverages = [judge.case.required - less for less in _LESS_COVERAGE]
    coarse = CoverageMap(site, cell_size_m=site.scenario.planning_cell_size_m)
    if site.scenario.sensor.looks_along_path:
        families = _families(site)
        laid = [item for family in families for item in _flown(site, family)]
        first = _tried(coarse, laid)
        best = short_families(first, coverages, longer=1.01)
        for family in _closer(site, [family for family in families if family.name in best]):
            closer = list(_flown(site, family))
            laid += closer
            first += _tried(coarse, closer)
    else:
        laid = list(_rows(site))
        first = _tried(coarse, laid)
    kept = short_families(first, coverages)
    routes: list[NamedRoute] = [(route, TUNED) for family, _, route in laid if family in kept]
    names = [(family, lines) for family, lines, _ in laid if family in kept]
    tried = [
        Tried(
            family, lines, m.metrics.coverage_of_coverable, judge.hold_out(m), m.metrics.waypoint_count,
            m.metrics.path_length_m, m.violation,
        )
        for (family, lines), m in zip(names, judge.judged(routes), strict=True)
    ]  # fmt: skip
    return tried, routes


def _tried(coarse: CoverageMap, laid: Sequence[_Laid]) -> list[Tried]:
    """Routes on the planner's cells; the limits are not looked at."""
    return [
        Tried(family, lines, observed, observed, len(route), route.length_m, 0.0)
        for family, lines, route in laid
        for observed in [coarse.fraction_of_coverable(coarse.observed(route.waypoints_m))]
    ]


def short_families(tried: Sequence[Tried], coverages: Sequence[float], *, longer: float = _LONGER) -> set[str]:
    """Families that are at most ``longer`` times as long as the best at one of the coverages."""
    by_family: dict[str, list[Tried]] = {}
    for one in tried:
        by_family.setdefault(one.family, []).append(one)
    kept: set[str] = set()
    for coverage in coverages:
        lengths = {family: length_at(members, coverage) for family, members in by_family.items()}
        best = min((length for length in lengths.values() if not math.isnan(length)), default=math.inf)
        kept |= {family for family, length in lengths.items() if length <= longer * best}
    return kept


def _families(site: Site) -> list[_Family]:
    best, limits = best_height_agl_m(site), site.scenario.limits
    middle = 0.5 * (limits.min_height_agl_m + limits.max_height_agl_m)
    return [
        _Family(long_side_angle_rad(site.area) + k * math.pi / _ANGLES, height, inset, PLAIN_TOLERANCE_M)
        for k in range(_ANGLES)
        for height in sorted({best, 0.5 * (best + middle)}, reverse=True)
        for inset in _INSETS
    ]


def _closer(site: Site, families: Sequence[_Family]) -> list[_Family]:
    """The same swaths with legs closer to the height of the widest view, which is nearer to the end of the band then."""
    found = [
        replace(family, height_agl_m=best_height_agl_m(site, tolerance_m=tolerance_m), tolerance_m=tolerance_m)
        for family in families
        for tolerance_m in _CLOSER_M
    ]
    return list(dict.fromkeys(found))


def _flown(site: Site, family: _Family) -> Iterator[_Laid]:
    width = width_across_m(site, family.angle_rad)
    strip = 2.0 * max(site.scenario.sensor.half_width_m(family.height_agl_m), site.scenario.area.cell_size_m)
    few, many = (max(1, math.ceil(fraction * width / strip - 1e-9)) for fraction in (_FEWEST_LINES, _MOST_LINES))
    for lines in range(few, many + 1):
        layout = regular_layout(
            angle_rad=family.angle_rad, lines=lines, height_agl_m=family.height_agl_m, inset=family.inset,
            tolerance_m=family.tolerance_m,
        )  # fmt: skip
        yield family.name, lines, fly_layout(site, layout)


def _rows(site: Site) -> Iterator[_Laid]:
    for rows in scanned_rows(site, most_nodes=_MOST_NODES):
        family = f"{rows.columns} columns, stagger {rows.stagger:g}, height share {rows.height_fraction:g}"
        yield family, rows.rows, fly_rows(site, rows)


def length_at(tried: Sequence[Tried], hold_out: float) -> float:
    """Length of the shortest boustrophedon with a hold-out coverage, or NaN where none has it.

    Within a family the length between two numbers of lines that follow each other is interpolated by their coverage: a
    number of lines is a coarse step, and a route that needs a little less than 31 lines give should not be compared with all 31.
    """
    found = []
    for _, members in groupby(sorted(tried, key=lambda t: (t.family, t.lines)), key=lambda t: t.family):
        family = [member for member in members if member.violation <= 0.0]
        found += [one.length_m for one in family if one.hold_out >= hold_out]
        for few, many in pairwise(family):
            if few.hold_out < hold_out < many.hold_out and many.lines == few.lines + 1:
                fraction = (hold_out - few.hold_out) / (many.hold_out - few.hold_out)
                found.append(few.length_m + fraction * (many.length_m - few.length_m))
    return min(found, default=math.nan)


PLANNERS: tuple[PlannerAlgorithm, ...] = ("memetic", "imodbo", "modbo", "nsga2", "moead")
"""The planners by name; the first is ours, the others are plain optimizers: only what they found themselves counts for them."""

OURS = PLANNERS[0]


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """Result of a contender."""

    # the routes worth judging, by processor time; under the key of the last moment what it ended with
    moments: dict[float, tuple[NamedRoute, ...]]
    evaluations: int  # full evaluations that were spent
    cpu_s: float  # processor time that it took, judging by itself included
    tried: tuple[Tried, ...] = ()  # every boustrophedon, for a scan


def plan_for(
    site: Site, case: Case, algorithm: PlannerAlgorithm, *, seed: int, evaluations: int, moments_s: Sequence[float]
) -> Found:
    """A planner's run on one core.

    The clock is the process's own processor time, so that other work does not count.

    Args:
        site: the scenario on its ground.
        case: has the rule.
        algorithm: one of PLANNERS.
        seed: of every random number.
        evaluations: how many, when no moments are given.
        moments_s: when to look; the last one is the budget.
    """
    settings = dataclasses.replace(site.scenario.planner, algorithm=algorithm, seed=seed, evaluations=evaluations)
    budget_s = max(moments_s, default=None)
    snapshots = Snapshots(moments_s[:-1])
    begin = time.process_time()
    effort = Effort(evaluations, budget_s, time.process_time)
    spent = 0
    try:
        plan = plan_routes(site, settings=settings, select_rule=case.rule, effort=effort, snapshots=snapshots)
        spent = plan.evaluations
    except InfeasibleError:
        pass  # a rival that finds no route within the limits has found nothing: its moments say so
    cpu_s = time.process_time() - begin
    last_s = cpu_s if budget_s is None else budget_s
    routes = {**snapshots.taken, last_s: snapshots.last}
    if algorithm != OURS:
        routes = {at: tuple(item for item in found if item[1] == algorithm) for at, found in routes.items()}
    return Found(routes, spent, cpu_s)


def _plain(judge: Judge) -> Found:
    site = judge.site
    begin = time.process_time()
    if site.scenario.sensor.looks_along_path:
        route = fly_layout(site, plain_boustrophedon(site))
    else:
        route = fly_rows(site, plain_rows(site))
    cpu_s = time.process_time() - begin
    return Found({cpu_s: ((route, "boustrophedon"),)}, 1, cpu_s)


def _tuned(judge: Judge) -> Found:
    begin = time.process_time()
    tried, routes = scan(judge)
    cpu_s = time.process_time() - begin
    return Found({cpu_s: tuple(routes)}, len(routes), cpu_s, tuple(tried))


def _constructed(name: InitialRoute) -> Callable[[Judge], Found]:
    def make(judge: Judge) -> Found:
        site = judge.site
        coarse = CoverageMap(site, cell_size_m=site.scenario.planning_cell_size_m)
        settings = dataclasses.replace(site.scenario.planner, initial=(name,), seed=1)
        begin = time.process_time()
        made = constructed_routes(
            coarse, settings, required=judge.case.required, executor=None, left_s=lambda: math.inf
        )  # fmt: skip
        cpu_s = time.process_time() - begin
        # Plain lines are made besides where they are the encoding; here they are a baseline of their own.
        routes = tuple((one.route, one.name) for one in made if one.name.startswith(name))
        return Found({cpu_s: routes}, len(routes), cpu_s)

    return make


CONSTRUCTIONS: Final = MappingProxyType[str, Callable[[Judge], Found]](
    {
        "boustrophedon": _plain,
        "boustrophedon-tuned": _tuned,
        "contour-lines": _constructed("contour-lines"),
        "greedy-set-cover": _constructed("greedy-set-cover"),
        "set-cover": _constructed("set-cover"),
    }
)
"""Baselines that need no random numbers, each run once and for as long as it takes."""

CONTENDERS: Final = (*CONSTRUCTIONS, *PLANNERS)
"""The names of all, baselines first."""


ONCE = "once"
"""The effort of a baseline that needs no budget."""

EVALUATIONS = "evaluations"
"""The effort of a run with the number of evaluations that the scenario says."""

LONG_S = 100.0
"""Budgets above this are run with few seeds."""


@dataclass(frozen=True, slots=True)
class CoverageRun:
    """One run."""

    scenario: str  # a key of CASES
    algorithm: str  # a name of CONTENDERS
    effort: str  # "once", "evaluations", or seconds of processor time as "10s"
    number: int  # from 1; the seed

    def __str__(self) -> str:
        """Key of its file."""
        return f"{self.scenario}/{self.algorithm}/{self.effort}/{self.number}"

    @property
    def budget_s(self) -> float | None:
        """Its processor time, if it has a budget."""
        return None if self.effort in {ONCE, EVALUATIONS} else float(self.effort.removesuffix("s"))

    @property
    def guessed_s(self) -> float:
        """Approximate duration."""
        return 60.0 if self.budget_s is None else self.budget_s


def run_of_key(key: str) -> CoverageRun:
    """The run that is kept under a key."""
    scenario, algorithm, effort, number = key.split("/")
    return CoverageRun(scenario, algorithm, effort, int(number))


def effort_of(budget_s: float) -> str:
    """The name of a budget."""
    return f"{budget_s:g}s"


def wanted_runs(
    *,
    scenarios: Collection[str],
    algorithms: Collection[str],
    seeds: int,
    seeds_long: int,
    times_s: Sequence[float],
    equal_evaluations: bool = True,
) -> list[CoverageRun]:
    """Every run, the most telling first, so that a benchmark that is stopped early leaves a table worth reading.

    Baselines; then the shortest budget with every seed; then equal evaluations; then the longer budgets. The numbers of
    seeds go round before the scenarios do.
    """
    planners = [name for name in algorithms if name in PLANNERS]
    runs = [CoverageRun(s, name, ONCE, 1) for s in scenarios for name in algorithms if name in CONSTRUCTIONS]
    efforts = [(effort_of(t), seeds if t <= LONG_S else min(seeds, seeds_long)) for t in sorted(times_s)]
    if equal_evaluations:
        efforts.insert(1, (EVALUATIONS, min(seeds, 3)))
    for effort, count in efforts:
        runs += [
            CoverageRun(scenario, name, effort, number)
            for number in range(1, count + 1)
            for scenario in scenarios
            for name in planners
        ]
    return runs


def make_runs(
    folder: KeptRuns,
    runs: Sequence[CoverageRun],
    *,
    times_s: Sequence[float],
    processes: int | None,
    scheduler: str | None = None,
) -> Iterator[CoverageRun]:
    """Make the runs and yield each once it is in the folder; errors as of :func:`kept`."""
    make = functools.partial(_made, times_s=tuple(sorted(times_s)))
    return kept(folder, make, runs, processes=processes, scheduler=scheduler)


def _made(run: CoverageRun, *, times_s: tuple[float, ...]) -> dict[str, Any]:
    judge = _judge(run.scenario)
    construct = CONSTRUCTIONS.get(run.algorithm)
    found = _planned(judge, run, times_s) if construct is None else construct(judge)
    judged = [judge.moment(at_s, routes) for at_s, routes in sorted(found.moments.items())]
    _, chosen = judged[-1]
    return {
        "evaluations": found.evaluations,
        "cpu_s": found.cpu_s,
        "moments": [moment_document(moment) for moment, _ in judged],
        "tried": [asdict(one) for one in found.tried],
        "route": [] if chosen is None else chosen.route.waypoints_m.tolist(),
    }


def _planned(judge: Judge, run: CoverageRun, times_s: Sequence[float]) -> Found:
    _warm_up(run.scenario)
    moments = [] if run.budget_s is None else [t for t in times_s if t <= run.budget_s]
    algorithm = next(name for name in PLANNERS if name == run.algorithm)
    return plan_for(
        # a copy of the site: the planner's clock counts the coverage maps of every run.
        dataclasses.replace(judge.site), judge.case, algorithm, seed=run.number, moments_s=moments,
        evaluations=judge.site.scenario.planner.evaluations,
    )  # fmt: skip


@functools.lru_cache(maxsize=1)
def _judge(scenario: str) -> Judge:
    return Judge(CASES[scenario], load_site(scenario).minimising("length"))


@functools.cache
def _warm_up(scenario: str) -> None:
    """Load the compiled code before the clock starts, to measure a user's second plan."""
    judge = _judge(scenario)
    settings = judge.site.scenario.planner
    effort = Effort(2 * settings.population_size, None, lambda: 0.0)
    plan_routes(judge.site, settings=settings, select_rule=judge.case.rule, effort=effort)

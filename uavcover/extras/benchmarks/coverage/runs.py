"""The runs in the order of their worth, each made in a process of its own kind and kept as one file."""

import dataclasses
import functools
from collections.abc import Collection, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from uavcover.extras.benchmarks.coverage.contenders import CONSTRUCTIONS, PLANNERS, Found, plan_for
from uavcover.extras.benchmarks.coverage.judging import CASES, Judge, moment_document
from uavcover.extras.benchmarks.runs import KeptRuns, completed_by
from uavcover.planner.planner import Effort, plan_routes
from uavcover.scenario.site import load_site

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

    @property
    def key(self) -> str:
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


@dataclass(frozen=True, slots=True)
class _CoverageTask:
    run: CoverageRun
    times_s: tuple[float, ...]

    def __str__(self) -> str:
        return self.run.key


def make_runs(
    folder: KeptRuns,
    runs: Sequence[CoverageRun],
    *,
    times_s: Sequence[float],
    processes: int | None,
    scheduler: str | None = None,
) -> Iterator[CoverageRun]:
    """Make the runs and yield each once it is in the folder.

    Raises:
        UavcoverError: a process was killed, or a run failed; what is done is kept.
    """
    tasks = [_CoverageTask(run, tuple(sorted(times_s))) for run in runs]
    for task, document in completed_by(scheduler, _made, tasks, processes=processes):
        folder.write(task.run.key, document)
        yield task.run


def _made(task: _CoverageTask) -> dict[str, Any]:
    run = task.run
    judge = _judge(run.scenario)
    construct = CONSTRUCTIONS.get(run.algorithm)
    found = _planned(judge, run, task.times_s) if construct is None else construct(judge)
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
    """Load the compiled code before a clock runs: a user's second plan is what is measured."""
    judge = _judge(scenario)
    settings = judge.site.scenario.planner
    effort = Effort(2 * settings.population_size, None, lambda: 0.0)
    plan_routes(judge.site, settings=settings, select_rule=judge.case.rule, effort=effort)

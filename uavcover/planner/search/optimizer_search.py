"""Search by an optimizer: it asks, routes are decoded and evaluated, and it receives their values."""

import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from uavcover.kernels.arrays import FloatArray
from uavcover.missions.objectives import evaluate_routes
from uavcover.model.route import Route
from uavcover.optimizers.interface import AskAndTell
from uavcover.sensing.coverage_map import CoverageMap

_TIMED_ROUTES = 8
_SHORTEST_EVALUATION_S = 1e-5


class Encoding(Protocol):
    """Maps genes to routes."""

    lower: FloatArray  # (d,) lower bounds
    upper: FloatArray  # (d,) upper bounds

    def decode(self, genes: FloatArray) -> Route:
        """The route of a (d,) vector of genes."""
        ...


@dataclass(frozen=True, slots=True)
class SearchProgress:
    """Progress of a search."""

    evaluations: int  # routes evaluated so far
    total: int  # routes that will be evaluated, or an estimate under a time budget
    best_coverage: float  # largest share of the planner's cells that a feasible route sees
    # of the feasible routes that reach the required coverage, in the unit of the objective; none yet or none required
    least_cost: float | None
    incumbent: Route | None = None  # the best route so far; none where it is not known


@dataclass(frozen=True, slots=True, eq=False)
class Searched:
    """Result of a search."""

    interrupted: bool  # whether the user ended it
    scale: FloatArray | None  # (3,) by which the objectives were divided for the optimizer; None: it received no values


@dataclass(frozen=True, slots=True)
class Effort:
    """Effort of a search: a number of evaluations, or a time budget in seconds measured by ``now``.

    The baselines get at most half of the budget, a tenth or less where a local search follows; the optimizer at least one round.
    Where a local search follows, all of planning is inside (:class:`uavcover.planner.front.Finish`); of a plain optimizer
    judging what was found comes on top.
    """

    evaluations: int
    budget_s: float | None
    now: Callable[[], float]

    def left_s(self, started: float, *, share: float = 1.0) -> float:
        """Time left of a share of the time budget since ``started``; infinite without a budget."""
        return math.inf if self.budget_s is None else share * self.budget_s - (self.now() - started)

    def is_over(self, started: float, *, share: float = 1.0) -> bool:
        """Whether a share of the time budget, if there is one, has been used since ``started``."""
        return self.left_s(started, share=share) <= 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchRun:
    """Resources of a search, and its observers."""

    effort: Effort  # when to stop
    started: float  # when planning began, by the effort's clock
    executor: Executor | None = None  # works on routes side by side; the result does not depend on it
    should_stop: Callable[[], bool] = lambda: False  # the user's stop, asked before every round or batch
    on_progress: Callable[[SearchProgress], None] = lambda _: None  # called after every round or batch


def rounds_of(
    effort: Effort,
    started: float,
    *,
    encoding: Encoding,
    coverage: CoverageMap,
    population_size: int,
    executor: Executor | None,
) -> int:
    """Number of rounds that the optimizer should plan for.

    Its steps shrink with the rounds that are left (Eq. 12, 20, 21).

    Under a time budget a few routes from all over the encoding are timed, after one that warms up the compiled code, and
    what is left of the budget is divided by that. The clock ends the search all the same.
    """
    if effort.budget_s is None:
        return max(1, effort.evaluations // population_size)
    # A fixed sample: it only measures time, and must not depend on the seed of the search.
    genes = np.random.default_rng(0).uniform(encoding.lower, encoding.upper, (_TIMED_ROUTES + 1, encoding.lower.size))
    evaluate_routes(coverage, [encoding.decode(genes[0])])
    before = effort.now()
    evaluate_routes(coverage, [encoding.decode(row) for row in genes[1:]], executor)
    each_s = max((effort.now() - before) / _TIMED_ROUTES, _SHORTEST_EVALUATION_S)
    left_s = effort.budget_s - (effort.now() - started)
    return max(2, math.ceil(left_s / each_s / population_size))


def search(
    optimizer: AskAndTell,  # fresh
    run: SearchRun,  # its effort, its clock, and who follows it
    *,
    rounds: int,  # that it was made for
    encoding: Encoding,  # of the routes
    coverage: CoverageMap,  # on the planner's cells
    at_least_one_round: bool,  # whether the user's stop waits for the first round, because there is no other route yet
    goal: float | None,  # required share of the planner's cells, if one is required
    # may look at the Pareto set, before each round is added to it
    look: Callable[[Callable[[], Sequence[Route]]], None] = lambda _: None,
) -> Searched:
    """Run the optimizer until it ends, the budget is used up or the user stops it."""
    best, shortest = 0.0, math.inf
    scale: FloatArray | None = None
    while not optimizer.should_stop:
        first = optimizer.iteration == 0
        if run.should_stop() and not (first and at_least_one_round):
            return Searched(interrupted=True, scale=scale)
        if not first and run.effort.is_over(run.started):
            break
        genes = optimizer.ask()
        values = evaluate_routes(coverage, [encoding.decode(row) for row in genes], run.executor)
        if scale is None:
            scale = _spread(values.objectives)
        else:
            look(lambda: [encoding.decode(genes) for genes in optimizer.pareto_set().x])
        optimizer.tell(values.objectives / scale, values.violations)
        keeps = values.violations[:, 0] <= 0.0
        seen = -values.objectives[:, 0]
        best = max(best, float(seen[keeps].max(initial=0.0)))
        if goal is not None:
            shortest = min(shortest, float(values.objectives[keeps & (seen >= goal), 2].min(initial=math.inf)))
        total = max(rounds * len(genes), optimizer.evaluations)
        run.on_progress(
            SearchProgress(optimizer.evaluations, total, best, shortest if math.isfinite(shortest) else None)
        )
    return Searched(interrupted=False, scale=scale)


def _spread(objectives: FloatArray) -> FloatArray:
    """(m,) powers of two next to the spread of (n, m) objectives, to make the objectives of comparable size.

    What sums objectives up (MOEA/D) needs that. Powers of two round nothing, so all others propose exactly the same.
    """
    spread = np.ptp(objectives, axis=0)
    return np.asarray(2.0 ** np.round(np.log2(np.where(spread > 0.0, spread, 1.0))))

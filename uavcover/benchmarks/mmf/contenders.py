"""Who takes part in a benchmark: every algorithm by name, run once on one problem with one seed and one budget."""

import inspect
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from uavcover.benchmarks.mmf.problems import MmfProblem
from uavcover.kernels.arrays import FloatArray
from uavcover.optimizers import ALGORITHMS, DBO, make_optimizer, optimizer_class
from uavcover.optimizers.pymoo.adapters import spread_weights


@dataclass(frozen=True, slots=True)
class Budget:
    """What every contender may spend, and how much it may return.

    Attributes:
        population: candidates of each round.
        iterations: rounds; ``population * iterations`` evaluations in all.
        archive: most solutions to return.
    """

    population: int = 200
    iterations: int = 500
    archive: int = 200


Solver = Callable[[MmfProblem, int, Budget], FloatArray]


def solve(problem: MmfProblem, algorithm: str, *, seed: int, budget: Budget) -> tuple[FloatArray, FloatArray]:
    """One run of a contender.

    Args:
        problem: what to minimise.
        algorithm: a key of `CONTENDERS`, or ``module:Class`` as `optimizer_class` takes it.
        seed: of every random number in the run.
        budget: the evaluations it may use and the solutions it may return.

    Returns:
        ``(k, n)`` decision vectors and ``(k, m)`` their objectives, k <= ``budget.archive``.

    Raises:
        OptimizerError: no such contender, or the budget is too small for it.
    """
    solver = CONTENDERS[algorithm] if algorithm in CONTENDERS else _optimized(algorithm)
    x = solver(problem, seed, budget)
    return x, problem.evaluate(x)


def contender_names(asked: Iterable[str] = ()) -> list[str]:
    """Every contender by name, in the order of the tables: ours, other classes by name, the floor.

    Args:
        asked: names; those of the form ``module:Class`` are added.

    Raises:
        OptimizerError: one is no optimizer.
    """
    others = sorted({name for name in asked if ":" in name})
    for name in others:
        optimizer_class(name)
    return table_order([*CONTENDERS, *others])


def table_order(names: Iterable[str]) -> list[str]:
    """Names of contenders in the order of the tables: ours, other classes by name, the floor."""
    wanted = set(names)
    others = sorted(wanted.difference(CONTENDERS))
    return [*(name for name in CONTENDERS if name in wanted and name != FLOOR), *others, *wanted.intersection({FLOOR})]


def _optimized(algorithm: str) -> Solver:
    declared = algorithm in ALGORITHMS and "local_sets_wanted" in inspect.signature(ALGORITHMS[algorithm]).parameters

    def solver(problem: MmfProblem, seed: int, budget: Budget) -> FloatArray:
        settings: dict[str, Any] = {"local_sets_wanted": problem.local_sets_wanted} if declared else {}
        optimizer = make_optimizer(
            algorithm,
            problem.lower,
            problem.upper,
            n_objectives=problem.n_objectives,
            population_size=budget.population,
            max_iterations=budget.iterations,
            archive_size=budget.archive,
            seed=seed,
            **settings,
        )
        while not optimizer.should_stop:
            optimizer.tell(problem.evaluate(optimizer.ask()))
        return optimizer.pareto_set().x

    return solver


def _uniform_points(problem: MmfProblem, seed: int, budget: Budget) -> FloatArray:
    """As many uniform random points as may be returned: the floor under every indicator. No evaluation is used."""
    rng = np.random.default_rng(seed)
    return rng.uniform(problem.lower, problem.upper, (budget.archive, problem.n_variables))


def _weighted_dbo(problem: MmfProblem, seed: int, budget: Budget) -> FloatArray:
    """DBO, which has one objective, on one weighted sum of the objectives for each solution that may be returned.

    The budget is shared evenly: with 100,000 evaluations and 200 solutions 20 rounds of 25 beetles for each sum.
    """
    share = max(1, budget.population * budget.iterations // budget.archive)
    beetles = max(DBO.smallest_population, min(25, budget.population))
    seeds = np.random.SeedSequence(seed).spawn(budget.archive)
    found = []
    for weights, one_seed in zip(spread_weights(budget.archive, problem.n_objectives), seeds, strict=True):
        dbo = DBO(
            problem.lower,
            problem.upper,
            n_objectives=1,
            population_size=beetles,
            max_iterations=max(1, share // beetles),
            seed=one_seed,
        )
        while not dbo.should_stop:
            dbo.tell(problem.evaluate(dbo.ask()) @ weights[:, None])
        found.append(dbo.pareto_set().x[0])
    return np.array(found)


FLOOR: Final = "uniform"

CONTENDERS: Final = MappingProxyType[str, Solver](
    {name: _optimized(name) for name, algorithm in ALGORITHMS.items() if algorithm.most_objectives is None}
    | {"dbo": _weighted_dbo, FLOOR: _uniform_points}
)
"""Every contender by name; `FLOOR` is no algorithm but uniform random points."""

"""Our algorithms in pymoo: ``minimize(problem, UavcoverAlgorithm("imodbo"), ("n_gen", 200), seed=1)``.

This module imports pymoo; `uavcover.optimizers` itself does not.
"""

import inspect
import math
from typing import Any

import numpy as np

from uavcover.errors import OptimizerError
from uavcover.kernels.arrays import FloatArray
from uavcover.optimizers import ALGORITHMS
from uavcover.optimizers.ask_tell import AskTellOptimizer, ParetoSet
from uavcover.optimizers.pymoo.adapters import PymooOptimizer, pymoo_missing

try:
    from pymoo.core.algorithm import Algorithm
    from pymoo.core.population import Population
    from pymoo.util.display.multi import MultiObjectiveOutput
except ImportError as error:
    raise pymoo_missing("uavcover.optimizers.pymoo.algorithm", error) from error


class UavcoverAlgorithm(Algorithm):  # type: ignore[misc]
    """One of our algorithms as pymoo knows algorithms.

    On the way its ``pop`` and ``opt`` are the optimizer's ``interim_set``, at the end its ``pareto_set``. Constraints are
    pymoo's: G <= 0, and H = 0 within the tolerance that pymoo's individuals carry (1e-4). The same seed gives the same
    result, and the same as our own ask and tell. Without a seed one is drawn. An algorithm that takes ``local_sets_wanted``
    reads it from the attribute of that name of the problem, if there is one.

    Args:
        name: a key of `ALGORITHMS`, but not one of those that come from pymoo.
        population_size: n.
        max_iterations: the rounds that the algorithm plans for (its parameters change with t/Tmax) and makes at most; None
            takes them from the termination, which then has to be ``("n_gen", ...)`` or ``("n_eval", ...)``.
        archive_size: most solutions to return; the population size if None.
        **settings: those of pymoo's `Algorithm`.

    Raises:
        OptimizerError: no such name, or the termination does not give the rounds.
    """

    seed: int | None
    termination: Any
    pop: Any
    opt: Any

    def __init__(
        self,
        name: str,
        *,
        population_size: int = 50,
        max_iterations: int | None = None,
        archive_size: int | None = None,
        **settings: Any,
    ) -> None:
        ours = sorted(key for key, algorithm in ALGORITHMS.items() if not issubclass(algorithm, PymooOptimizer))
        if name not in ours:
            what = (
                "is pymoo's own algorithm; use it directly"
                if name in ALGORITHMS
                else f"is unknown; choose one of {', '.join(ours)}"
            )
            raise OptimizerError(f"algorithm {name!r} {what}")
        if max_iterations is not None:
            settings = {"termination": ("n_gen", max_iterations)} | settings
        super().__init__(**{"output": MultiObjectiveOutput()} | settings)
        self.name = name
        self.population_size = population_size
        self.max_iterations = max_iterations
        self.archive_size = archive_size
        self.optimizer: AskTellOptimizer | None = None

    def _setup(self, problem: Any, **_: Any) -> None:
        if self.seed is None:
            self.seed = int(np.random.SeedSequence().generate_state(1)[0])
        algorithm = ALGORITHMS[self.name]
        declared: dict[str, Any] = {}
        if "local_sets_wanted" in inspect.signature(algorithm).parameters:
            declared["local_sets_wanted"] = getattr(problem, "local_sets_wanted", False)
        self.optimizer = algorithm(
            problem.xl,
            problem.xu,
            n_objectives=problem.n_obj,
            n_constraints=problem.n_ieq_constr + 2 * problem.n_eq_constr,
            population_size=self.population_size,
            max_iterations=self.max_iterations or self._planned_rounds(),
            archive_size=self.archive_size,
            seed=self.seed,
            **declared,
        )

    def _planned_rounds(self) -> int:
        generations = getattr(self.termination, "n_max_gen", None)
        evaluations = getattr(self.termination, "n_max_evals", None)
        if generations is not None and math.isfinite(generations):
            return int(generations)
        if evaluations is not None and math.isfinite(evaluations):
            return math.ceil(int(evaluations) / self.population_size)
        raise OptimizerError(
            f"{self.name}: the termination does not state the number of iterations; use max_iterations=..., "
            'or a termination like ("n_gen", 200)'
        )

    def _initialize_infill(self) -> Any:
        return self._infill()

    def _initialize_advance(self, infills: Any = None, **settings: Any) -> None:
        self._advance(infills, **settings)

    def _infill(self) -> Any:
        assert self.optimizer is not None  # pymoo calls setup first
        return Population.new("X", self.optimizer.ask().copy())

    def _advance(self, infills: Any = None, **_: Any) -> None:
        assert self.optimizer is not None
        self.optimizer.tell(infills.get("F"), _violations(infills))
        self.pop = self._population(self.optimizer.interim_set())
        if self.optimizer.should_stop:
            self.termination.terminate()

    def _finalize(self) -> None:
        assert self.optimizer is not None
        self.pop = self._population(self.optimizer.pareto_set())
        self._set_optimum()

    def _population(self, best: ParetoSet) -> Any:
        n_g, n_h = self.problem.n_ieq_constr, self.problem.n_eq_constr
        g, above, below = np.split(best.violations, [n_g, n_g + n_h], axis=1)
        return Population.new("X", best.x, "F", best.objectives, "G", g, "H", (above - below) / 2)

    def _set_optimum(self) -> None:
        if self.problem.n_obj == 1:
            super()._set_optimum()
        else:
            self.opt = self.pop  # its rows do not dominate each other, or are meant to be returned anyway


def _violations(population: Any) -> FloatArray:
    """``(n, c)``: G, then by how much H and by how much -H exceeds the tolerance."""
    tolerance = np.array([individual.config["cv_eq"]["eps"] for individual in population])[:, None]
    n = len(population)
    g, h = (population.get(name).reshape(n, -1).astype(float) for name in ("G", "H"))
    columns: FloatArray = np.hstack([g, h - tolerance, -h - tolerance])
    return columns

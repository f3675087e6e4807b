"""The 24 MMF problems for pymoo: ``minimize(pymoo_problem("MMF1"), NSGA2(pop_size=200), ("n_gen", 500), seed=1)``.

This module imports pymoo; `uavcover.extras.benchmarks.mmf.problems` itself does not.
"""

from typing import Any

from uavcover.errors import InputError
from uavcover.extras.benchmarks.mmf.problems import PROBLEMS, reference_sets
from uavcover.kernels.arrays import FloatArray
from uavcover.optimizers.pymoo.adapters import pymoo_missing

try:
    from pymoo.core.problem import Problem
except ImportError as error:
    raise pymoo_missing("uavcover.extras.benchmarks.mmf.pymoo_problems", error) from error


class MmfInPymoo(Problem):  # type: ignore[misc]
    """An `MmfProblem` as pymoo knows problems; it evaluates whole populations at once and can be pickled.

    ``pareto_front()`` and ``pareto_set()`` are our reference sets, with pymoo's order: a front of two objectives is sorted
    by the first, so its rows are not those of the set. For a problem with local sets they hold the local ones too.

    Raises:
        InputError: there is no such problem.
    """

    # as `MmfProblem.local_sets_wanted`; `UavcoverAlgorithm` hands it to algorithms that read it
    local_sets_wanted: bool

    def __init__(self, mmf: str) -> None:
        if mmf not in PROBLEMS:
            raise InputError(f"unknown problem {mmf!r}; choose from {', '.join(PROBLEMS)}")
        problem = PROBLEMS[mmf]
        super().__init__(
            n_var=problem.n_variables, n_obj=problem.n_objectives, xl=problem.lower.copy(), xu=problem.upper.copy()
        )
        self.local_sets_wanted = problem.local_sets_wanted
        self._name = mmf  # the name and not the problem, whose function may be a closure that cannot be pickled

    def name(self) -> str:
        """As in the report."""
        return self._name

    def _evaluate(self, x: FloatArray, out: dict[str, Any], *_: Any, **__: Any) -> None:
        out["F"] = PROBLEMS[self._name].evaluate(x)

    def _calc_pareto_front(self, *_: Any, **__: Any) -> FloatArray:
        return reference_sets(self._name).pareto_front

    def _calc_pareto_set(self, *_: Any, **__: Any) -> FloatArray:
        return reference_sets(self._name).pareto_set


def pymoo_problem(name: str) -> MmfInPymoo:
    """The MMF problem of this name for pymoo. Raises InputError: no such problem."""
    return MmfInPymoo(name)

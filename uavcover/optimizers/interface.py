"""Interface of every optimizer: ask for candidates, tell their values, read the Pareto set.

The optimizer proposes, the caller evaluates: however, wherever and in as many processes as it likes. All objectives are
minimised; a constraint is a number that is > 0 when violated. `Solutions` are evaluated decision vectors, as read-only rows.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, Self

import numpy as np
import numpy.typing as npt

from uavcover.errors import OptimizerError
from uavcover.kernels.arrays import FloatArray, IntArray
from uavcover.kernels.dominance import least_crowded, non_dominated_ranks

State = dict[str, object]


@dataclass(frozen=True, slots=True, eq=False)
class ParetoSet:
    """The best that was found; all arrays are read-only and share their rows.

    Attributes:
        x: ``(k, d)`` decision vectors, k = solutions, d = variables.
        objectives: ``(k, m)``, minimised, m = objectives.
        violations: ``(k, c)``, > 0 where violated, c = constraints.
        feasible: True when every row keeps every constraint. False when no feasible point is known: then the rows are
            the ones with the smallest total violation, and non-dominated among themselves.
    """

    x: FloatArray
    objectives: FloatArray
    violations: FloatArray
    feasible: bool

    def __len__(self) -> int:
        """The number of solutions."""
        return len(self.x)


class AskAndTell(Protocol):
    """A multi-objective optimizer with ask and tell, one whole population at a time.

    A round is one ``ask`` and one successful ``tell``. Round 0 samples the first population, the others move it.
    """

    @property
    def iteration(self) -> int:
        """Rounds completed so far."""

    @property
    def evaluations(self) -> int:
        """Number of candidates whose values are known so far."""

    @property
    def should_stop(self) -> bool:
        """True once all rounds are done."""

    def ask(self) -> FloatArray:
        """The candidates to evaluate next.

        Asking again before telling returns the same candidates.

        Returns:
            ``(n, d)`` read-only, inside [lower, upper]; n = population size, d = variables.

        Raises:
            OptimizerError: All rounds are done.
        """

    def tell(self, objectives: npt.ArrayLike, violations: npt.ArrayLike | None = None) -> None:
        """Give the values of the candidates asked last, in their order.

        Args:
            objectives: ``(n, m)``, finite, minimised; m = objectives.
            violations: ``(n, c)``, finite, > 0 where violated; c = constraints. May be left out when c is 0. Their
                positive parts are summed, so constraints should be of comparable scale.

        Raises:
            OptimizerError: Nothing was asked, a shape is wrong, or a value is not finite. Nothing has changed then: the
                same candidates can be given to tell() again.
        """

    def pareto_set(self) -> ParetoSet:
        """The non-dominated solutions kept so far; feasible ones if there are any, else the least violating.

        Raises:
            OptimizerError: No candidates are evaluated yet.
        """


class Optimizer(AskAndTell, Protocol):
    """An optimizer that can be saved between two rounds and goes on later."""

    def state_dict(self) -> State:
        """All that is needed to go on later, random streams included: dicts, numbers, strings and copied arrays."""

    @classmethod
    def from_state(cls, state: State) -> Self:
        """The optimizer that ``state_dict`` described; it continues exactly as the saved one would have.

        Raises:
            OptimizerError: The state belongs to another algorithm.
        """


def read_only(values: FloatArray) -> FloatArray:
    """A read-only view of ``values``; the caller hands the array over and does not write to it any more."""
    view = values.view()
    view.setflags(write=False)
    return view


def finite_array(values: npt.ArrayLike, name: str) -> FloatArray:
    """A float64 copy of ``values``.

    Raises:
        OptimizerError: Not numbers, or not all finite; the message names the array and the first bad entry.
    """
    try:
        array = np.array(values, dtype=np.float64, order="C")
    except (TypeError, ValueError) as error:
        raise OptimizerError(f"{name}: this is not an array of numbers ({error}); use rows of equal length") from error
    bad = np.argwhere(~np.isfinite(array))
    if len(bad):
        place = tuple(int(i) for i in bad[0])
        raise OptimizerError(f"{name}: entry {place} is {array[place]}; use only finite numbers")
    return array


@dataclass(frozen=True, eq=False)
class Solutions:
    """Rows of decision vectors with what they are worth.

    Attributes:
        x: ``(n, d)`` decision vectors.
        objectives: ``(n, m)``, minimised.
        violations: ``(n, c)``, > 0 where violated.
    """

    x: FloatArray
    objectives: FloatArray
    violations: FloatArray

    def __post_init__(self) -> None:
        for name in ("x", "objectives", "violations"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    def __len__(self) -> int:
        return len(self.x)

    @classmethod
    def none(cls, n_variables: int, n_objectives: int, n_constraints: int) -> "Solutions":
        """No rows, of these widths."""
        return cls(np.empty((0, n_variables)), np.empty((0, n_objectives)), np.empty((0, n_constraints)))

    @cached_property
    def total_violation(self) -> FloatArray:
        """``(n,)`` sums of the positive parts of the violations; 0 is feasible."""
        return read_only(np.maximum(self.violations, 0.0).sum(axis=1))

    def rows(self, chosen: npt.NDArray[np.int64 | np.bool_]) -> "Solutions":
        """The chosen rows: ``(k,)`` row numbers or an ``(n,)`` mask."""
        return Solutions(self.x[chosen], self.objectives[chosen], self.violations[chosen])

    def followed_by(self, other: "Solutions") -> "Solutions":
        """These rows, then those of ``other``."""
        return Solutions(
            np.concatenate([self.x, other.x]),
            np.concatenate([self.objectives, other.objectives]),
            np.concatenate([self.violations, other.violations]),
        )


def survivors(solutions: Solutions, count: int) -> tuple[IntArray, IntArray]:
    """The ``count`` best rows: whole fronts first, then the least crowded of the front that does not fit.

    Fronts follow the feasibility rules: feasible before infeasible, less total violation before more, then dominance.

    Args:
        solutions: n rows, n >= count.
        count: how many survive.

    Returns:
        ``(count,)`` row numbers, ascending, and ``(count,)`` the number of each one's front, 0 for the first.
    """
    ranks = non_dominated_ranks(solutions.objectives, solutions.total_violation)
    last = int(np.sort(ranks)[count - 1])
    whole = np.flatnonzero(ranks < last)
    split = np.flatnonzero(ranks == last)
    spared = split[least_crowded(solutions.objectives[split], count - len(whole))]
    chosen = np.sort(np.concatenate([whole, spared]))
    return chosen, ranks[chosen]

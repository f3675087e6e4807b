"""Evaluated decision vectors, as read-only rows that stay together."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from uavcover.errors import OptimizerError
from uavcover.kernels.dominance import least_crowded, non_dominated_ranks
from uavcover.optimizers.interface import FloatArray, IntArray


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
        raise OptimizerError(f"{name}: not an array of numbers ({error}): give rows of equal length") from error
    bad = np.argwhere(~np.isfinite(array))
    if len(bad):
        place = tuple(int(i) for i in bad[0])
        raise OptimizerError(f"{name}: entry {place} is {array[place]}: give finite numbers only")
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

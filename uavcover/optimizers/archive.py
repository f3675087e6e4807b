"""The external archive: the best solutions so far, few enough to keep and spread along the front."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.dominance import crowding_distance, first_occurrences, least_crowded, non_dominated_mask
from uavcover.optimizers.interface import ParetoSet, Solutions


@dataclass(frozen=True, eq=False)
class Archive:
    """At most ``capacity`` solutions, none of which dominates another.

    By the feasibility rules they are all feasible, or, as long as no feasible one is known, all of the same smallest
    total violation. Solutions with equal objectives but different x are kept side by side: they are different answers.
    """

    solutions: Solutions
    capacity: int

    def __len__(self) -> int:
        return len(self.solutions)

    def with_evaluated(self, evaluated: Solutions) -> "Archive":
        """The archive after new rows: dominated rows and repetitions of both x and objectives dropped, then thinned.

        Above capacity the most crowded solution (in objectives) is removed, one at a time, until the rest fits; so the
        ends of the front stay.
        """
        merged = self.non_dominated_with(evaluated)
        return Archive(merged.rows(least_crowded(merged.objectives, self.capacity)), self.capacity)

    def non_dominated_with(self, evaluated: Solutions) -> Solutions:
        """The archive after new rows if it had room for all: none dominated, none repeated."""
        merged = self.solutions.followed_by(evaluated)
        merged = merged.rows(non_dominated_mask(merged.objectives, merged.total_violation))
        return merged.rows(first_occurrences(np.hstack([merged.objectives, merged.x])))

    @cached_property
    def crowding(self) -> FloatArray:
        """``(k,)`` crowding distance of each solution, infinite at the ends."""
        return crowding_distance(self.solutions.objectives)

    def leaders(self, count: int, rng: np.random.Generator) -> FloatArray:
        """Decision vectors ``(count, d)``, each the less crowded of two drawn at random."""
        one, other = rng.integers(0, len(self), size=(2, count))
        less_crowded = np.where(self.crowding[one] >= self.crowding[other], one, other)
        chosen: FloatArray = self.solutions.x[less_crowded]
        return chosen

    def pareto_set(self) -> ParetoSet:
        """Content of the archive, as a result."""
        best = self.solutions
        return ParetoSet(best.x, best.objectives, best.violations, feasible=not best.total_violation.any())

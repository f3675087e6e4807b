"""MOEA/D of pymoo with what it leaves out: any number of weights, a limit to replacements, constraints."""

from typing import Any

import numpy as np
from pymoo.algorithms.moo.moead import ParallelMOEAD

from uavcover.kernels.arrays import FloatArray


class GenerationalMOEAD(ParallelMOEAD):  # type: ignore[misc]
    """pymoo's `ParallelMOEAD`: a whole generation is proposed before any of it replaces anything.

    A child replaces at most ``n_replaced`` of its neighbours, in random order (Li and Zhang 2009). Less total violation is
    better than a better scalar value, as everywhere here.
    """

    ideal: FloatArray  # (m,), set by pymoo

    def __init__(self, weights: FloatArray, *, n_replaced: int, **settings: Any) -> None:
        self.n_replaced = n_replaced
        super().__init__(weights, **settings)

    def _advance(self, infills: Any = None, **_: Any) -> None:
        self.ideal = np.minimum(self.ideal, infills.get("F").min(axis=0))
        # arrays beside the population, because reading one row at a time out of it takes most of the run
        objectives, violations = self.pop.get("F", "total_violation")
        for k, child in zip(self.indices, infills, strict=True):
            near = self.random_state.permutation(self.neighbors[k])
            weights, violation = self.ref_dirs[near], child.get("total_violation")
            now, then = np.split(
                self.decomposition.do(
                    np.concatenate([objectives[near], np.tile(child.F, (len(near), 1))]),
                    weights=np.concatenate([weights, weights]),
                    ideal_point=self.ideal,
                    _type="one_to_one",
                ),
                2,
            )
            better = np.where(violations[near] == violation, then < now, violation < violations[near])
            replaced = near[better][: self.n_replaced]
            self.pop[replaced] = child
            objectives[replaced], violations[replaced] = child.F, violation

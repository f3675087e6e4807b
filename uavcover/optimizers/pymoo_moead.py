"""MOEA/D of pymoo with what it leaves out: any number of weights, a limit to replacements, constraints."""

from itertools import combinations
from math import comb
from typing import Any

import numpy as np
from pymoo.algorithms.moo.moead import ParallelMOEAD

from uavcover.optimizers.interface import FloatArray


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


def spread_weights(n: int, m: int) -> FloatArray:
    """Weight vectors ``(n, m)`` spread over the simplex, for any n: rows sum to 1, the corners come first.

    Two objectives: evenly spaced. More: from a Das-Dennis lattice of at least 20 n points (n <= 20 n always leaves a choice)
    the corners, then always the point farthest from all chosen ones.

    >>> spread_weights(3, 2).tolist()
    [[1.0, 0.0], [0.5, 0.5], [0.0, 1.0]]
    """
    if m == 1:
        return np.ones((n, 1))
    if m == 2:
        share = np.linspace(1.0, 0.0, n)
        return np.column_stack([share, 1.0 - share])
    divisions = 1
    while comb(divisions + m - 1, m - 1) < 20 * n:
        divisions += 1
    # stars and bars: the gaps between m - 1 bars are the parts of a sum
    bars = np.array(list(combinations(range(divisions + m - 1), m - 1)))
    ends = np.column_stack([np.full(len(bars), -1), bars, np.full(len(bars), divisions + m - 1)])
    lattice = (np.diff(ends, axis=1) - 1) / divisions
    chosen = np.flatnonzero(lattice.max(axis=1) == 1.0)[:n].tolist()
    nearest = np.min([np.linalg.norm(lattice - lattice[i], axis=1) for i in chosen], axis=0)
    while len(chosen) < n:
        chosen.append(int(np.argmax(nearest)))
        nearest = np.minimum(nearest, np.linalg.norm(lattice - lattice[chosen[-1]], axis=1))
    picked: FloatArray = lattice[chosen]
    return picked

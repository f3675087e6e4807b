"""IMODBO for problems with many equivalent solutions: its beetles steal within niches of decision space."""

from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from uavcover.kernels.arrays import FloatArray, IntArray
from uavcover.optimizers.dung_beetle_moves import breeder, roller, thief
from uavcover.optimizers.imodbo import IMODBO
from uavcover.optimizers.interface import ParetoSet, Solutions, State
from uavcover.optimizers.niching import NichePool, neighbours, representatives, smoothed


class ImodboNiching(IMODBO):
    """IMODBO whose leaders are neighbours, with a pool of solutions spread over decision space.

    Args:
        lower: see `AskTellOptimizer`, as the arguments that are not listed here.
        upper: see `AskTellOptimizer`.
        local_sets_wanted: whether locally Pareto-optimal sets belong to the answer. Then a solution counts if nothing in
            its niche dominates it, and `pareto_set` holds rows that dominate others from afar.
        **arguments: see `AskTellOptimizer`.
    """

    # rollers, breeders, small beetles, thieves, followers, smoothers
    exploring_groups: ClassVar[tuple[float, ...]] = (0.1, 0.1, 0.1, 0.3, 0.4, 0.0)
    settling_groups: ClassVar[tuple[float, ...]] = (0.0, 0.0, 0.0, 0.2, 0.4, 0.4)
    scouting_share: ClassVar[float] = 0.15  # of the rounds: Latin hypercubes, Eq. 19
    settling_share: ClassVar[float] = 0.1  # of the rounds, at the end: thieves, followers and smoothers only
    pool_share: ClassVar[int] = 15  # rows in the pool for each one returned
    shortlist_share: ClassVar[int] = 15
    leaders_at_hand: ClassVar[int] = 8  # neighbours a beetle can follow
    surface_neighbours: ClassVar[int] = 11  # that a smoother fits its surface through
    stride: ClassVar[float] = 0.7  # of followers, standard deviation
    global_niche_radius: ClassVar[float] = 0.1  # box widths
    local_niche_radius: ClassVar[float] = 0.2
    first_slack: ClassVar[float] = 1e-1  # of the front's range, within which distant niches count as equivalent
    last_slack: ClassVar[float] = 1e-2
    review_interval: ClassVar[int] = 20  # rounds
    front_weights: ClassVar[tuple[float, ...]] = (0.15, 0.3, 0.6, 1.2, 2.4)
    front_allowance: ClassVar[float] = 0.92
    crowd_radius: ClassVar[float] = 0.35
    medoid_passes: ClassVar[int] = 3

    _pool: NichePool
    _came_from: FloatArray

    def __init__(
        self, lower: npt.ArrayLike, upper: npt.ArrayLike, *, local_sets_wanted: bool = False, **arguments: Any
    ) -> None:
        super().__init__(lower, upper, **arguments)
        self._local_sets_wanted = bool(local_sets_wanted)
        widths = self._box.upper - self._box.lower
        nothing = Solutions.none(self._box.n_variables, self._n_objectives, self._n_constraints)
        self._pool = NichePool(
            nothing,
            nothing.x,
            np.where(widths > 0, widths, 1.0),
            self.local_niche_radius if self._local_sets_wanted else self.global_niche_radius,
            self.pool_share * self._archive.capacity,
        )
        self._scouts = nothing
        self._scouting_rounds = max(1, int(self.scouting_share * self._max_iterations))
        self._chosen: tuple[int, ParetoSet] | None = None

    def _move(self, rng: np.random.Generator) -> FloatArray:
        n, pool = self._population_size, self._pool
        if self._iteration < self._scouting_rounds:
            self._came_from = self._sample(rng)  # Eq. 19, once more
            return self._came_from
        parents = rng.integers(0, len(pool), n)
        unit = pool.unit
        around = neighbours(unit, parents, max(self.leaders_at_hand, self.surface_neighbours))
        near, on_surface = self._followable(around, rng), around[:, : self.surface_neighbours + 1]
        x, leaders = pool.solutions.x[parents], pool.solutions.x
        settling = self._iteration >= (1 - self.settling_share) * self._max_iterations
        shares = self.settling_groups if settling else self.exploring_groups
        groups = np.split(np.arange(n), np.rint(np.cumsum(shares)[:-1] * n).astype(int))
        rollers, breeders, smalls, thieves, followers, smoothers = groups

        worst = leaders[rng.integers(0, len(pool), len(rollers))]
        k, b = self._roller_coefficients()
        rolled = roller(x[rollers], pool.previous[parents[rollers]], worst, k=k, b=b, rng=rng)  # Eq. 9-11

        best = leaders[_drawn(near[breeders], rng)]
        bred = breeder(x[breeders], best, self._area_around(best), rng=rng)  # Eq. 12-14

        food = leaders[_drawn(near[smalls], rng)]
        walked = self._walk_small_beetles(x[smalls], self._area_around(food), rng)  # Eq. 15, 16, 22, 23

        best, food = leaders[_drawn(near[thieves], rng)], leaders[_drawn(near[thieves], rng)]
        stolen = thief(x[thieves], best, food, s=self.theft_constant, rng=rng)  # Eq. 18

        one, other = leaders[_drawn(near[followers], rng)], leaders[_drawn(near[followers], rng)]
        followed = x[followers] + self.stride * rng.standard_normal((len(followers), 1)) * (one - other)

        smooth = smoothed(unit[on_surface[smoothers]], self._n_objectives - 1) * pool.widths

        self._came_from = x
        return np.concatenate([rolled, bred, walked, stolen, followed, smooth])

    def _followable(self, around: IntArray, rng: np.random.Generator) -> IntArray:  # noqa: ARG002 -- variants draw
        """``(n, k)`` each beetle's parent, then the rows that it may follow, of the nearest ones ``around``."""
        return around[:, : self.leaders_at_hand + 1]

    @property
    def _slack(self) -> float:
        if self._local_sets_wanted:
            return np.inf
        second_half = max(0.0, 2.0 * self._iteration / self._max_iterations - 1.0)
        return float(self.first_slack * (self.last_slack / self.first_slack) ** second_half)

    def _learn(self, evaluated: Solutions) -> None:
        previous = evaluated.x if self._iteration == 0 else self._came_from
        self._pool = self._pool.with_evaluated(evaluated, previous, self._slack)
        if self._local_sets_wanted and self._iteration < self._scouting_rounds:
            self._scouts = self._scouts.followed_by(evaluated)
        elif self._iteration % self.review_interval == 0:
            self._pool = self._reviewed()

    def _reviewed(self) -> NichePool:
        if self._local_sets_wanted:
            return self._pool.outside_shadow_of(self._scouts)
        return self._pool.sifted(self._slack)

    def pareto_set(self) -> ParetoSet:
        """See `Optimizer.pareto_set`: the rows of the pool that stand for all of it, in both spaces.

        Unlike other algorithms' results they can include rows that another dominates: from outside of their niche, and, if
        local sets are not wanted, by no more than ``last_slack`` of the front's range at the end.
        """
        if self._iteration == 0:
            return super().pareto_set()
        if self._chosen is None or self._chosen[0] != self._iteration:
            pool, count = self._reviewed(), self._archive.capacity
            rows = representatives(
                pool.unit,
                pool.solutions.objectives,
                count,
                shortlist=self.shortlist_share * count,
                front_weights=self.front_weights,
                front_allowance=self.front_allowance,
                crowd_radius=self.crowd_radius,
                passes=self.medoid_passes,
            )
            best = pool.solutions.rows(rows)
            result = ParetoSet(best.x, best.objectives, best.violations, feasible=not best.total_violation.any())
            self._chosen = (self._iteration, result)
        return self._chosen[1]

    def interim_set(self) -> ParetoSet:
        """Set to show between rounds, without a choice from the pool: the archive of non-dominated solutions."""
        return super().pareto_set()

    def state_dict(self) -> State:
        """See `Optimizer.state_dict`."""
        state: dict[str, Any] = super().state_dict()
        state["settings"]["local_sets_wanted"] = self._local_sets_wanted
        return state

    def _memory(self) -> dict[str, npt.NDArray[Any]]:
        if self._iteration == 0:
            return {}
        pool, scouts = self._pool, self._scouts
        n_scouts = self._scouting_rounds * self._population_size if self._local_sets_wanted else 0
        memory: dict[str, npt.NDArray[Any]] = {
            "pool": _padded(_columns(pool.solutions, pool.previous), pool.capacity),
            "scouts": _padded(_columns(scouts), n_scouts),
            "counts": np.array([len(pool), len(scouts)]),
            "spacing": np.array([pool.spacing]),
        }
        return memory | ({} if self._asked is None else {"came_from": self._came_from})

    def _recall(self, memory: dict[str, npt.NDArray[Any]]) -> None:
        d, m = self._box.n_variables, self._n_objectives
        widths = (d, d + m, d + m + self._n_constraints)
        in_pool, in_scouts = (int(count) for count in memory["counts"])
        *parts, previous = np.split(memory["pool"][:in_pool], widths, axis=1)
        old = self._pool
        self._pool = NichePool(
            Solutions(*parts), previous, old.widths, old.radius, old.capacity, float(memory["spacing"][0])
        )
        self._scouts = Solutions(*np.split(memory["scouts"][:in_scouts], widths[:2], axis=1))
        if "came_from" in memory:
            self._came_from = memory["came_from"]


def _drawn(near: IntArray, rng: np.random.Generator) -> IntArray:
    """One of the neighbours of each beetle, not itself if there is another: ``(g, k)`` to ``(g,)``."""
    g, k = near.shape
    drawn: IntArray = near[np.arange(g), rng.integers(min(1, k - 1), k, g)]
    return drawn


def _columns(solutions: Solutions, *more: FloatArray) -> FloatArray:
    return np.hstack([solutions.x, solutions.objectives, solutions.violations, *more])


def _padded(rows: FloatArray, count: int) -> FloatArray:
    """``rows`` and zeros, ``count`` in all: so the state keeps its size."""
    return np.concatenate([rows, np.zeros((count - len(rows), rows.shape[1]))])

"""IMODBO for problems with many equivalent solutions: its beetles steal within niches of decision space.

A pool keeps good solutions spread over decision space, and a choice of a few represents all.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from uavcover.kernels.arrays import FloatArray, IntArray
from uavcover.kernels.niching import dominated_near, last_apart, niche_survivors, spread_out, two_space_medoids
from uavcover.optimizers.ask_tell import ParetoSet, Solutions, State
from uavcover.optimizers.imodbo import IMODBO, breeder, roller, thief

_NEIGHBOURS = 8  # for the local stretch of the map from x to f
_SPACING_GROWTH, _SPACING_DECAY = 1.15, 0.97
_EVENNESS = 0.75  # share of the set's extent in a row's weight in decision space; the rest is that of the front's
_ROOMY = 0.7  # share of the capacity below which the spacing shrinks


@dataclass(frozen=True, slots=True, eq=False)
class NichePool:
    """At most ``capacity`` solutions, not dominated by any near by, with a least distance between them.

    All have the same total violation, the smallest so far.

    Attributes:
        solutions: n rows.
        previous: ``(n, d)`` x(t-1) of each.
        widths: ``(d,)`` of the box, 1 where it has none; distances are measured in them.
        radius: of a niche, in box widths.
        capacity: most rows.
        spacing: least distance, in box widths; follows the number of rows.
    """

    solutions: Solutions
    previous: FloatArray
    widths: FloatArray
    radius: float
    capacity: int
    spacing: float = 0.0

    def __len__(self) -> int:
        return len(self.solutions)

    @property
    def unit(self) -> FloatArray:
        """``(n, d)`` decision vectors in box widths."""
        scaled: FloatArray = np.ascontiguousarray(self.solutions.x / self.widths)
        return scaled

    def with_evaluated(self, evaluated: Solutions, previous: FloatArray, slack: float) -> "NichePool":
        """The pool after new rows.

        Args:
            evaluated: new rows; each meets the old ones.
            previous: x(t-1) of each.
            slack: rows that are dominated from far away stay while they are worse by no more than this share of the
                pool's range of each objective; infinite keeps them all.
        """
        everything = self.solutions.followed_by(evaluated)
        least = everything.total_violation == everything.total_violation.min()
        start = int(np.count_nonzero(least[: len(self)]))
        merged = self._with(everything, np.concatenate([self.previous, previous]), self.spacing)._rows(least)
        known = merged.solutions.objectives[:start] if start else merged.solutions.objectives
        return merged._met(start, _fraction_of_range(slack, known), self.spacing)._thinned()

    def sifted(self, slack: float) -> "NichePool":
        """The pool after all its rows have met again, under another ``slack`` than before."""
        return self._met(0, _fraction_of_range(slack, self.solutions.objectives), 0.0)

    def outside_shadow_of(self, scouts: Solutions) -> "NichePool":
        """Without the rows that one of the ``scouts`` in the same niche dominates."""
        near = scouts.rows(scouts.total_violation <= self.solutions.total_violation[:1])
        shadowed = dominated_near(
            self.unit,
            self.solutions.objectives,
            np.ascontiguousarray(near.x / self.widths),
            near.objectives,
            self.radius,
        )
        return self if shadowed.all() else self._rows(~shadowed)

    def _rows(self, chosen: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> "NichePool":
        return self._with(self.solutions.rows(chosen), self.previous[chosen], self.spacing)

    def _with(self, solutions: Solutions, previous: FloatArray, spacing: float) -> "NichePool":
        return NichePool(solutions, previous, self.widths, self.radius, self.capacity, spacing)

    def _met(self, start: int, slack: FloatArray, spacing: float) -> "NichePool":
        f = self.solutions.objectives
        return self._rows(niche_survivors(self.unit, f, start, self.radius, slack, spacing))

    def _thinned(self) -> "NichePool":
        pool = self
        while len(pool) > self.capacity:
            unit, spacing = pool.unit, pool.spacing
            if spacing == 0.0:
                spacing = 0.5 * float(np.median(_nearest(unit, unit, 2)[0][:, 1]))
            spacing *= _SPACING_GROWTH
            kept = last_apart(unit, spacing)
            pool = pool._with(pool.solutions.rows(kept), pool.previous[kept], spacing)
        if len(pool) < _ROOMY * self.capacity:
            pool = pool._with(pool.solutions, pool.previous, pool.spacing * _SPACING_DECAY)
        return pool


def _fraction_of_range(fraction: float, objectives: FloatArray) -> FloatArray:
    """``(m,)``; infinite if the share is, also of an objective that is the same everywhere."""
    ranges: FloatArray = np.ptp(objectives, axis=0)
    return fraction * ranges if np.isfinite(fraction) else np.full_like(ranges, np.inf)


def _nearest(among: FloatArray, points: FloatArray, k: int) -> tuple[FloatArray, IntArray]:
    """Distances and rows ``(r, k)`` of the k nearest ``among`` ``(n, d)`` of each point ``(r, d)``."""
    from scipy.spatial import KDTree  # a third of a second to load, and the planner's own search needs none

    away, rows = KDTree(among).query(points, k)
    shape = (len(points), k)
    return np.asarray(away, np.float64).reshape(shape), np.asarray(rows, np.int64).reshape(shape)


def neighbours(unit: FloatArray, rows: IntArray, count: int) -> IntArray:
    """``(r, k)`` the row itself and its nearest others among ``unit`` ``(n, d)``; k = min(count + 1, n)."""
    k = min(count + 1, len(unit))
    return _nearest(unit, unit[rows], k)[1]


def smoothed(near: FloatArray, dimension: int) -> FloatArray:
    """Points moved onto a smooth surface through their neighbours.

    The surface is the least-squares quadratic over the neighbours' first principal axes; a point keeps its place along
    these axes. A connected Pareto set is piecewise a surface of m - 1 dimensions (the regularity that RM-MEDA, Zhang, Zhou
    and Jin 2008, builds on), so what scatters around it is averaged away.

    Args:
        near: ``(g, k, d)`` each point, then its neighbours.
        dimension: of the surface; at least 1 and at most d are used.

    Returns:
        ``(g, d)``; the points themselves where the surface fills the space.
    """
    g, k, d = near.shape
    q = min(max(dimension, 1), d)
    centre = near.mean(axis=1, keepdims=True)
    axes = np.linalg.svd(near - centre, full_matrices=True)[2]
    local = (near - centre) @ axes.transpose(0, 2, 1)
    along = local[:, :, :q]
    reach = np.abs(along).max(axis=(1, 2), keepdims=True)
    along = along / np.where(reach > 0, reach, 1.0)
    squares = [along[:, :, i] * along[:, :, j] for i in range(q) for j in range(i, q)]
    basis = np.stack([np.ones((g, k)), *along.transpose(2, 0, 1), *squares], axis=2)
    coefficients = np.linalg.pinv(basis, rcond=1e-8) @ local
    fitted = (basis[:, :1] @ coefficients)[:, 0]
    fitted[:, :q] = local[:, 0, :q]
    moved: FloatArray = centre[:, 0] + (fitted[:, None] @ axes)[:, 0]
    return moved


def representatives(
    unit: FloatArray,
    objectives: FloatArray,
    count: int,
    *,
    shortlist: int,
    front_weights: tuple[float, ...],
    front_allowance: float,
    crowd_radius: float,
    passes: int,
) -> IntArray:
    """Rows that stand for all in decision and in objective space.

    A shortlist, evenly spread in decision space, is reduced by k-medoids in both spaces, with the first of the weights
    for the front under which the front is covered well enough: not worse than by as many rows spread over the front
    alone (each the farthest from those before). The rows with the smallest and largest value of each variable always
    stay. In decision space a row weighs three quarters by its share of the set's extent there and one quarter by its share
    of the front's extent, in objective space by the latter alone. Of the set, rows in a crowd share what one alone would
    have, so a thick band of near-optimal rows counts no more than a thin one; of the front, the share is the ratio of
    distances between neighbours in both spaces, to the power m - 1.

    Args:
        unit: ``(n, d)`` decision vectors in box widths.
        objectives: ``(n, m)``.
        count: how many to choose; all if there are no more.
        shortlist: rows that k-medoids works on, at least ``count``.
        front_weights: ascending; cost of distances in objective space, where those in decision space cost 1, each for the
            shortlist's first ``count`` rows. The last is used if none is enough.
        front_allowance: mean distance to the front's representatives that is well enough, in those of a spread front.
        crowd_radius: of the ball in which rows are a crowd, in typical distances between rows chosen for spread alone.
        passes: of k-medoids.

    Returns:
        ``(min(n, count),)`` row numbers, ascending.
    """
    n, m = objectives.shape
    ends = _ends(unit)
    if n <= count or len(ends) >= count:
        return np.arange(n, dtype=np.int64) if n <= count else np.sort(spread_out(unit, ends[:1], count))
    listed = spread_out(unit, ends, min(shortlist, n))  # the ends first, then ever finer
    x = np.ascontiguousarray(unit[listed])
    ranges = np.ptp(objectives, axis=0)
    f = np.ascontiguousarray((objectives[listed] - objectives.min(axis=0)) / np.where(ranges > 0, ranges, 1.0))
    away, near = _nearest(x, x, min(_NEIGHBOURS + 1, len(x)))
    steps = np.linalg.norm(f[near[:, 1:]] - f[:, None], axis=2)
    stretch = np.median(steps / np.maximum(away[:, 1:], 1e-12), axis=1) ** (m - 1)
    start = np.arange(min(count, len(x)), dtype=np.int64)
    extent = 1.0 / _crowd(x, start, crowd_radius)
    front_fraction = stretch / stretch.sum() if stretch.sum() > 0 else np.full(len(x), 1.0 / len(x))
    set_fraction = _EVENNESS * extent / extent.sum() + (1 - _EVENNESS) * front_fraction
    x_cost, f_cost = _cost(x, start, set_fraction), _cost(f, start, front_fraction)
    if x_cost == 0.0 or len(start) < 2:
        return np.sort(listed[start])
    spread_front = _cost(f, spread_out(f, _ends(f)[:count], count), front_fraction)
    medoids = start
    for weight in front_weights:
        f_weights = front_fraction * (weight / f_cost if f_cost > 0 else 0.0)
        medoids = two_space_medoids(x, f, set_fraction / x_cost, f_weights, start, len(ends), passes)
        if _cost(f, medoids, front_fraction) <= front_allowance * spread_front:
            break
    return np.sort(listed[medoids])


def _ends(points: FloatArray) -> IntArray:
    """Rows with the smallest and largest value of each column."""
    return np.unique(np.concatenate([points.argmin(axis=0), points.argmax(axis=0)])).astype(np.int64, copy=False)


def _crowd(points: FloatArray, chosen: IntArray, radius: float) -> IntArray:
    """``(n,)`` how many rows are near each, itself included: where the band of near-optimal rows is thick they are many."""
    from scipy.spatial import KDTree

    apart = float(np.median(_nearest(points[chosen], points[chosen], min(2, len(chosen)))[0][:, -1]))
    return np.asarray(KDTree(points).query_ball_point(points, radius * apart, return_length=True), np.int64)


def _cost(points: FloatArray, chosen: IntArray, fractions: FloatArray) -> float:
    """Mean distance of the points, weighted by their shares, to the nearest of the chosen rows."""
    return float(fractions @ _nearest(points[chosen], points, 1)[0][:, 0])


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
    scouting_fraction: ClassVar[float] = 0.15  # of the rounds: Latin hypercubes, Eq. 19
    settling_fraction: ClassVar[float] = 0.1  # of the rounds, at the end: thieves, followers and smoothers only
    pool_fraction: ClassVar[int] = 15  # rows in the pool for each one returned
    shortlist_fraction: ClassVar[int] = 15
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
            self.pool_fraction * self._archive.capacity,
        )
        self._scouts = nothing
        self._scouting_rounds = max(1, int(self.scouting_fraction * self._max_iterations))
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
        settling = self._iteration >= (1 - self.settling_fraction) * self._max_iterations
        fractions = self.settling_groups if settling else self.exploring_groups
        groups = np.split(np.arange(n), np.rint(np.cumsum(fractions)[:-1] * n).astype(int))
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
        """See `AskAndTell.pareto_set`: the rows of the pool that stand for all of it, in both spaces.

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
                shortlist=self.shortlist_fraction * count,
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
        """See `AskAndTell.state_dict`."""
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

"""A pool of good solutions spread over decision space, and the choice of a few that represent all."""

from dataclasses import dataclass

import numpy as np

from uavcover.kernels.arrays import FloatArray, IntArray
from uavcover.kernels.niching import dominated_near, last_apart, niche_survivors, spread_out, two_space_medoids
from uavcover.optimizers.interface import Solutions

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
        return merged._met(start, _share_of_range(slack, known), self.spacing)._thinned()

    def sifted(self, slack: float) -> "NichePool":
        """The pool after all its rows have met again, under another ``slack`` than before."""
        return self._met(0, _share_of_range(slack, self.solutions.objectives), 0.0)

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


def _share_of_range(share: float, objectives: FloatArray) -> FloatArray:
    """``(m,)``; infinite if the share is, also of an objective that is the same everywhere."""
    ranges: FloatArray = np.ptp(objectives, axis=0)
    return share * ranges if np.isfinite(share) else np.full_like(ranges, np.inf)


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
    front_share = stretch / stretch.sum() if stretch.sum() > 0 else np.full(len(x), 1.0 / len(x))
    set_share = _EVENNESS * extent / extent.sum() + (1 - _EVENNESS) * front_share
    x_cost, f_cost = _cost(x, start, set_share), _cost(f, start, front_share)
    if x_cost == 0.0 or len(start) < 2:
        return np.sort(listed[start])
    spread_front = _cost(f, spread_out(f, _ends(f)[:count], count), front_share)
    medoids = start
    for weight in front_weights:
        f_weights = front_share * (weight / f_cost if f_cost > 0 else 0.0)
        medoids = two_space_medoids(x, f, set_share / x_cost, f_weights, start, len(ends), passes)
        if _cost(f, medoids, front_share) <= front_allowance * spread_front:
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


def _cost(points: FloatArray, chosen: IntArray, shares: FloatArray) -> float:
    """Mean distance of the points, weighted by their shares, to the nearest of the chosen rows."""
    return float(shares @ _nearest(points[chosen], points, 1)[0][:, 0])

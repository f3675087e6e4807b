"""Niching in decision space: local dominance, minimum spacing, and medoids that represent many rows.

``x`` are points of the unit cube (or anything else in which plain distance makes sense), objectives are minimised.
"""

import numpy as np

from uavcover.kernels.arrays import BoolArray, FloatArray, IntArray
from uavcover.kernels.jit import allocating_kernel, kernel


@allocating_kernel
def distance(points: FloatArray, i: int, j: int) -> float:
    """Euclidean distance between two rows of ``points`` ``(n, d)``."""
    total = 0.0
    for k in range(points.shape[1]):
        total += (points[i, k] - points[j, k]) ** 2
    return float(np.sqrt(total))


@kernel
def _squared_distance_above(x: FloatArray, i: int, j: int, limit: float) -> bool:
    total = 0.0
    for k in range(x.shape[1]):
        total += (x[i, k] - x[j, k]) ** 2
        if total > limit:
            return True
    return False


@kernel
def _measure_to_earlier(x: FloatArray, columns: FloatArray, i: int, away: FloatArray) -> None:
    """Write the squared distances of row i to rows 0..i - 1 into ``away``."""
    for j in range(i):
        away[j] = 0.0
    for k in range(len(columns)):
        column, own = columns[k], x[i, k]
        for j in range(i):
            away[j] += (own - column[j]) ** 2


@allocating_kernel
def niche_survivors(
    x: FloatArray, objectives: FloatArray, start: int, radius: float, slack: FloatArray, spacing: float
) -> BoolArray:
    """Which rows stay when each row from ``start`` on meets all rows before it, in their order.

    Of two rows of which one dominates the other, the dominated one goes if they are at most ``radius`` apart in ``x``, or if it
    is worse by more than ``slack`` in some objective (infinite slack: distant rows do not compete). Of two rows that do not
    dominate each other and are at most ``spacing`` apart, the later one stays; of exact repetitions in x the earlier one.

    Args:
        x: ``(n, d)``.
        objectives: ``(n, m)``.
        start: rows before it have met already.
        radius: of a niche.
        slack: ``(m,)``.
        spacing: least distance between equals.

    Returns:
        ``(n,)``; O((n - start) n (d + m)).
    """
    n, m = objectives.shape
    gone = np.zeros(n, np.bool_)
    reach = max(radius, spacing) if np.isinf(slack).all() else np.inf  # nothing farther away matters
    columns = np.ascontiguousarray(x.T)
    away = np.zeros(n)  # squared distances of row i
    for i in range(start, n):
        if reach < np.inf:
            _measure_to_earlier(x, columns, i, away)
        for j in range(i):
            if gone[j] or away[j] > reach * reach:
                continue
            less, more = False, False  # whether i is below, above j in some objective
            for k in range(m):
                if objectives[i, k] < objectives[j, k]:
                    less = True
                elif objectives[i, k] > objectives[j, k]:
                    more = True
                if less and more:
                    break
            if less == more:
                if _squared_distance_above(x, i, j, spacing * spacing):
                    continue
                if _squared_distance_above(x, i, j, 0.0):
                    gone[j] = True
                    continue
                gone[i] = True
                break
            competes = not _squared_distance_above(x, i, j, radius * radius)
            for k in range(m):
                competes = competes or abs(objectives[i, k] - objectives[j, k]) > slack[k]
            if competes and less:
                gone[j] = True
            elif competes:
                gone[i] = True
                break
    return ~gone


@allocating_kernel
def last_apart(x: FloatArray, spacing: float) -> BoolArray:
    """Which rows stay if each, from the last to the first, goes when one within ``spacing`` stays.

    Args:
        x: ``(n, d)``.
        spacing: >= 0.

    Returns:
        ``(n,)``; O(n k d), k = rows that stay.
    """
    n = len(x)
    stays = np.zeros(n, np.bool_)
    kept = np.empty(n, np.int64)
    count = 0
    for i in range(n - 1, -1, -1):
        stays[i] = True
        for q in range(count):
            if not _squared_distance_above(x, i, kept[q], spacing * spacing):
                stays[i] = False
                break
        if stays[i]:
            kept[count] = i
            count += 1
    return stays


@allocating_kernel
def _row_sums(points: FloatArray) -> FloatArray:
    sums = np.zeros(len(points))
    for i in range(points.shape[0]):
        for k in range(points.shape[1]):
            sums[i] += points[i, k]
    return sums


@allocating_kernel
def _cells_along(x: FloatArray, other_x: FloatArray, k: int, least: float) -> tuple[IntArray, IntArray, int]:
    """The cell of each row along axis k, and the number of cells, at most 16, none narrower than ``least``."""
    low = min(x[:, k].min(), other_x[:, k].min())
    extent = max(x[:, k].max(), other_x[:, k].max()) - low
    width = max(least, extent / 16.0)
    if not width > 0.0:
        width = 1.0
    cells, other_cells = np.empty(len(x), np.int64), np.empty(len(other_x), np.int64)
    for i in range(len(x)):
        cells[i] = int((x[i, k] - low) / width)
    for j in range(len(other_x)):
        other_cells[j] = int((other_x[j, k] - low) / width)
    return cells, other_cells, int(extent / width) + 1


@allocating_kernel
def _grouped(cell_of: IntArray, totals: FloatArray, cells: int) -> tuple[IntArray, IntArray]:
    """Rows by cell, and by total inside a cell: where each cell begins, ``(cells + 1,)``, and ``(k,)`` row numbers."""
    starts = np.zeros(cells + 1, np.int64)
    for cell in cell_of:
        starts[cell + 1] += 1
    starts = np.cumsum(starts)
    free, order = starts.copy(), np.empty(len(cell_of), np.int64)
    for j in np.argsort(totals):
        order[free[cell_of[j]]] = j
        free[cell_of[j]] += 1
    return starts, order


@kernel
def _within(x: FloatArray, i: int, other_x: FloatArray, j: int, radius: float) -> bool:
    """Whether row i of ``x`` and row j of ``other_x`` are at most ``radius`` apart."""
    total = 0.0
    for k in range(x.shape[1]):
        total += (x[i, k] - other_x[j, k]) ** 2
    return total <= radius * radius


@kernel
def _dominates(better: FloatArray, j: int, objectives: FloatArray, i: int) -> bool:
    """Whether row j of ``better`` dominates row i of ``objectives``."""
    below = False
    for k in range(objectives.shape[1]):
        if better[j, k] > objectives[i, k]:
            return False
        below = below or better[j, k] < objectives[i, k]
    return below


@allocating_kernel
def dominated_near(
    x: FloatArray, objectives: FloatArray, other_x: FloatArray, other_objectives: FloatArray, radius: float
) -> BoolArray:
    """Which rows are dominated by a row of the others at most ``radius`` away.

    Only the others in the same and the adjoining cells of a grid over the first two or three axes are looked at.

    Args:
        x: ``(n, d)``.
        objectives: ``(n, m)``.
        other_x: ``(k, d)``.
        other_objectives: ``(k, m)``.
        radius: >= 0.

    Returns:
        ``(n,)``; O(n k (d + m)).
    """
    n = len(objectives)
    dominated = np.zeros(n, np.bool_)
    if n == 0 or len(other_x) == 0:
        return dominated
    least = radius * (1.0 + 1e-9)  # so that rounding puts nothing within the radius two cells away
    counts = np.ones(3, np.int64)
    cells, other_cells = np.zeros((3, n), np.int64), np.zeros((3, len(other_x)), np.int64)
    for k in range(min(3, x.shape[1])):
        own, others, counts[k] = _cells_along(x, other_x, k, least)
        for i in range(n):
            cells[k, i] = own[i]
        for j in range(len(other_x)):
            other_cells[k, j] = others[j]
    totals, other_totals = _row_sums(objectives), _row_sums(other_objectives)
    cell_of = (other_cells[0] * counts[1] + other_cells[1]) * counts[2] + other_cells[2]
    starts, order = _grouped(cell_of, other_totals, counts[0] * counts[1] * counts[2])
    for i in range(n):
        for a in range(max(0, cells[0, i] - 1), min(counts[0], cells[0, i] + 2)):
            for b in range(max(0, cells[1, i] - 1), min(counts[1], cells[1, i] + 2)):
                for c in range(max(0, cells[2, i] - 1), min(counts[2], cells[2, i] + 2)):
                    cell = (a * counts[1] + b) * counts[2] + c
                    for q in range(starts[cell], starts[cell + 1]):
                        j = order[q]
                        if other_totals[j] > totals[i]:
                            break  # what dominates has no larger sum
                        if _dominates(other_objectives, j, objectives, i) and _within(x, i, other_x, j, radius):
                            dominated[i] = True
                            break
                    if dominated[i]:
                        break
                if dominated[i]:
                    break
            if dominated[i]:
                break
    return dominated


@allocating_kernel
def spread_out(points: FloatArray, first: IntArray, count: int) -> IntArray:
    """``first`` and then, one at a time, the row farthest from all chosen ones (Gonzalez 1985).

    Args:
        points: ``(n, d)``.
        first: ``(s,)`` rows chosen already, s >= 1, no repetitions.
        count: rows to choose, s <= count <= n; fewer are returned if the others repeat chosen ones.

    Returns:
        ``(k,)`` rows in the order of choice; O(n count d).
    """
    n = len(points)
    chosen = np.empty(count, np.int64)
    away = np.full(n, np.inf)
    for c in range(count):
        pick = int(first[c] if c < len(first) else np.argmax(away))
        if c >= len(first) and away[pick] <= 0.0:
            return chosen[:c]
        chosen[c] = pick
        for i in range(n):
            away[i] = min(away[i], distance(points, i, pick))
    return chosen


@kernel
def _two_nearest(points: FloatArray, medoids: IntArray, i: int) -> tuple[int, int, float, float]:
    one, two, near, next_near = -1, -1, np.inf, np.inf
    for q in range(len(medoids)):
        away = distance(points, i, medoids[q])
        if away < near:
            one, two, near, next_near = q, one, away, near
        elif away < next_near:
            two, next_near = q, away
    return one, two, near, next_near


@kernel
def _find_two_nearest(
    points: FloatArray, medoids: IntArray, one: IntArray, two: IntArray, near: FloatArray, next_near: FloatArray
) -> None:
    """Write the two nearest medoids of every row, and how far away they are, into the last four arrays."""
    for i in range(len(points)):
        one[i], two[i], near[i], next_near[i] = _two_nearest(points, medoids, i)


@kernel
def _cheapest_loss(loss: FloatArray, fixed: int) -> int:
    """The medoid behind the first ``fixed`` whose loss costs least; -1 without one."""
    worst = -1
    for q in range(fixed, len(loss)):
        if worst == -1 or loss[q] < loss[worst]:
            worst = q
    return worst


@allocating_kernel
def two_space_medoids(
    x: FloatArray,
    f: FloatArray,
    x_weights: FloatArray,
    f_weights: FloatArray,
    first: IntArray,
    fixed: int,
    passes: int,
) -> IntArray:
    """Rows that represent all rows in two spaces at once: k-medoids by eager swaps (FasterPAM, Schubert and Rousseeuw 2021).

    The cost is the sum over rows i of ``x_weights[i]`` times the distance in x to the nearest medoid in x, plus
    ``f_weights[i]`` times the distance in f to the nearest medoid in f. Each row in turn replaces the medoid whose loss
    costs least, if that lowers the cost.

    Args:
        x: ``(n, d)``.
        f: ``(n, m)``.
        x_weights: ``(n,)``, >= 0.
        f_weights: ``(n,)``, >= 0.
        first: ``(k,)`` medoids as the start, no repetitions, k >= 2.
        fixed: this number of the first ones stay.
        passes: over all rows; it ends before when nothing changes.

    Returns:
        ``(k,)`` rows; O(n^2 (d + m)) for each pass.
    """
    n, k = len(x), len(first)
    medoids = first.copy()
    is_medoid = np.zeros(n, np.bool_)
    is_medoid[medoids] = True
    spaces, weights = (x, f), (x_weights, f_weights)
    one, two = np.empty((2, n), np.int64), np.empty((2, n), np.int64)
    near, next_near, away = np.empty((2, n)), np.empty((2, n)), np.empty((2, n))
    for s in range(2):
        _find_two_nearest(spaces[s], medoids, one[s], two[s], near[s], next_near[s])
    loss = np.empty(k)
    for _ in range(passes):
        swapped = False
        for candidate in range(n):
            if is_medoid[candidate]:
                continue
            loss[:] = 0.0
            change = 0.0
            for s in range(2):
                points, weight = spaces[s], weights[s]
                for i in range(n):
                    d = distance(points, i, candidate)
                    away[s, i] = d
                    if d < near[s, i]:
                        change += weight[i] * (d - near[s, i])
                    else:
                        loss[one[s, i]] += weight[i] * (min(d, next_near[s, i]) - near[s, i])
            worst = _cheapest_loss(loss, fixed)
            if worst == -1 or change + loss[worst] >= -1e-12:
                continue
            swapped = True
            is_medoid[medoids[worst]] = False
            is_medoid[candidate] = True
            medoids[worst] = candidate
            for s in range(2):
                for i in range(n):
                    d = away[s, i]
                    if one[s, i] == worst or two[s, i] == worst:
                        one[s, i], two[s, i], near[s, i], next_near[s, i] = _two_nearest(spaces[s], medoids, i)
                    elif d < near[s, i]:
                        two[s, i], next_near[s, i] = one[s, i], near[s, i]
                        one[s, i], near[s, i] = worst, d
                    elif d < next_near[s, i]:
                        two[s, i], next_near[s, i] = worst, d
        if not swapped:
            break
    return medoids

"""Leg visibility of a nadir camera as runs of squares, and the changes of counts that they make.

This is the fast path of :mod:`uavcover.kernels.leg_visibility`. Squares are the places of a lattice, row * columns + column,
so what a camera observes of a row of cells is one run or a few. A set of squares is a rising row of numbers: the first square
of a run, the first square after it, the first of the next run, and so on. When some sets replace others, only their
differences change counts.

A cell c is inside the cone of the sample at s metres along the leg when |c - P(s)| <= tan (u(s) - z_c), on the map. The left side
is convex in s and the right side linear, so their difference has one smallest value, at a known place, and of the samples along
the leg one of the two beside that place is the best. Two tests decide for any number of samples. Cells for which more than the
cone counts (rays that are not steep enough, incidence, range, ground sample distance) are tried one by one.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.cells import Cells
from uavcover.kernels.horizon import CLEAR_FROM
from uavcover.kernels.jit import kernel
from uavcover.kernels.leg_visibility import leg_observes_cell, samples_of_leg
from uavcover.kernels.sight import CONE, NO_LINE_OF_SIGHT, RAY, Sight, horizontal_reach
from uavcover.kernels.surface import Surface, has_node_cell


@kernel
def runs_of(squares: NDArray[np.int32], count: int, out: NDArray[np.int32]) -> int:
    """Write the runs of the first ``count`` rising squares into ``out``; return their length, -1 if it is too short."""
    written = 0
    for k in range(count):
        square = squares[k]
        if written > 0 and out[written - 1] == square:
            out[written - 1] = square + 1
            continue
        if written + 2 > out.size:
            return -1
        out[written] = square
        out[written + 1] = square + 1
        written += 2
    return written


@kernel
def compare(
    runs: NDArray[np.int32],
    sizes: NDArray[np.int64],
    sets: NDArray[np.int64],
    olds: int,
    news: int,
    changes: NDArray[np.int32],
) -> int:
    """Change of the count of each square when some sets are replaced by others.

    Args:
        runs: (sets, stride) a set in each row.
        sizes: (sets,) how many numbers of each.
        sets: (olds + news, 3) in column 0 the rows of the old sets, then of the new ones; the rest is working memory.
        olds: how many old sets.
        news: how many new ones.
        changes: (m, 3) is written: first square, first square after, change of the count; m as large as all sets together.

    Returns:
        How many stretches have changed. Squares that all sets observe alike are in none of them.
    """
    left = 0
    for k in range(olds + news):
        if sizes[sets[k, 0]] > 0:
            sets[left, 0] = sets[k, 0]
            sets[left, 1] = 0
            sets[left, 2] = -1 if k < olds else 1
            left += 1
    count = 0
    level, at = 0, 0
    while left > 0:
        nearest = runs[sets[0, 0], sets[0, 1]]
        for k in range(1, left):
            nearest = min(nearest, runs[sets[k, 0], sets[k, 1]])
        if level != 0 and nearest > at:
            if count > 0 and changes[count - 1, 1] == at and changes[count - 1, 2] == level:
                changes[count - 1, 1] = nearest
            else:
                changes[count, 0], changes[count, 1], changes[count, 2] = at, nearest, level
                count += 1
        k = 0
        while k < left:
            number, position = sets[k, 0], sets[k, 1]
            if runs[number, position] == nearest:
                level += sets[k, 2] if position % 2 == 0 else -sets[k, 2]
                sets[k, 1] = position + 1
                if position + 1 == sizes[number]:
                    left -= 1
                    sets[k, 0], sets[k, 1], sets[k, 2] = sets[left, 0], sets[left, 1], sets[left, 2]
                    continue
                if runs[number, position + 1] == nearest:
                    continue
            k += 1
        at = nearest
    return count


@kernel
def weigh_changes(
    changes: NDArray[np.int32], count: int, counts: NDArray[np.uint16], weight: NDArray[np.float64]
) -> float:
    """Change of the total of ``weight`` (squares,) counted at least once, if the changes were made."""
    gained = 0.0
    for k in range(count):
        by = changes[k, 2]
        if by > 0:
            for square in range(changes[k, 0], changes[k, 1]):
                if counts[square] == 0:
                    gained += weight[square]
        else:
            for square in range(changes[k, 0], changes[k, 1]):
                if counts[square] == -by:
                    gained -= weight[square]
    return gained


@kernel
def weigh_often(
    changes: NDArray[np.int32], count: int, counts: NDArray[np.uint16], weight: NDArray[np.float64], times: int
) -> float:
    """Change of the total of ``weight`` (squares,) counted at least ``times`` times; :func:`weigh_changes` is faster for 1."""
    gained = 0.0
    for k in range(count):
        by = changes[k, 2]
        for square in range(changes[k, 0], changes[k, 1]):
            before = int(counts[square])
            if before < times <= before + by:
                gained += weight[square]
            elif before >= times > before + by:
                gained -= weight[square]
    return gained


@kernel
def make_changes(changes: NDArray[np.int32], count: int, counts: NDArray[np.uint16]) -> None:
    """Apply the changes to the counts."""
    for k in range(count):
        by = changes[k, 2]
        for square in range(changes[k, 0], changes[k, 1]):
            counts[square] = counts[square] + by


NOT_SO = -2
"""The fast path does not apply to this leg."""

_INSIDE = 1
_TO_BE_TRIED = 2

_BLOCK = 16
_WHOLE = 1.5 * 2.0**52
"""Adding it to a number of ordinary size removes the fraction."""
_NEARLY_HALF = 0.5 - 1e-7
"""A whole number less this is rounded to itself, not to the adjacent even number."""


class ConeCells(NamedTuple):
    """Cells in the form of the fast path.

    Attributes:
        up_m: (rows, columns) heights of the centres on the lattice, NaN without a cell; (0, 0) when there is no quick way for
            the sensor.
        slope2: (rows, columns) squared tangent of the slope from which on a ray is clear: along it a cell is observed that is
            inside the cone and in range. 0: along every ray inside the cone; infinite: the slope does not decide it.
        lowest_m: (rows // 16 + 1, columns // 16 + 1) smallest of the heights in each block; infinite without a cell.
        row_east_m: (rows,) how far east of their places on the lattice the centres of a row are.
        column_north_m: (columns,) how far north of them those of a column are.
    """

    up_m: NDArray[np.float64]
    slope2: NDArray[np.float64]
    lowest_m: NDArray[np.float64]
    row_east_m: NDArray[np.float64]
    column_north_m: NDArray[np.float64]


def cone_cells(surface: Surface, sight: Sight, cells: Cells) -> ConeCells:
    """Lay out cells for the fast path, with the offsets of rows and columns; empty for other sensors."""
    if sight.kind != CONE or sight.line_of_sight not in (NO_LINE_OF_SIGHT, RAY):
        nothing = np.empty((0, 0)), np.empty((0, 0)), np.empty((0, 0)), np.empty(0), np.empty(0)
        return _read_only(ConeCells(*nothing))
    there = cells.lattice >= 0
    numbers = cells.lattice[there]
    up_m, lowest_m, row_east_m, column_north_m = laid_out(cells)
    # The incidence is at most the slope and half the opening angle together.
    slope = np.arccos(np.minimum(1.0, cells.normal[numbers, 2]))
    any_incidence = slope + math.atan(sight.tan_half_fov) <= math.acos(sight.cos_max_incidence)
    steepest = np.maximum(cells.horizon[numbers], steepest_around(surface, cells)[numbers])
    always_clear = (sight.line_of_sight == NO_LINE_OF_SIGHT) | (steepest * sight.tan_half_fov <= 1.0)
    slope2 = np.full(cells.lattice.shape, np.inf)
    decided = any_incidence & math.isinf(sight.sample_focal_m)
    slope2[there] = np.where(decided, np.where(always_clear, 0.0, steepest**2), np.inf)
    return _read_only(ConeCells(up_m, slope2, lowest_m, row_east_m, column_north_m))


def steepest_around(surface: Surface, cells: Cells) -> FloatArray:
    """(n,) upper bound of the tangent of the ground below rays to each cell, from any direction."""
    anywhere = np.full(len(cells.centre_m), surface.steepest)
    return np.minimum(anywhere, cells.rise[:, CLEAR_FROM].max(axis=1)) if len(cells.rise) else anywhere


def laid_out(cells: Cells) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """``up_m``, ``lowest_m``, ``row_east_m`` and ``column_north_m`` of :class:`ConeCells`."""
    there = cells.lattice >= 0
    numbers = cells.lattice[there]
    up_m = np.full(cells.lattice.shape, np.nan)
    up_m[there] = cells.centre_m[numbers, 2]
    at_row, at_column = np.nonzero(there)
    rows, columns = len(cells.lattice) // _BLOCK + 1, len(cells.lattice[0]) // _BLOCK + 1
    blocks = np.full((rows * _BLOCK, columns * _BLOCK), np.inf)
    blocks[at_row, at_column] = up_m[there]
    lowest_m = np.ascontiguousarray(blocks.reshape(rows, _BLOCK, columns, _BLOCK).min(axis=(1, 3)))
    row_east_m, column_north_m = np.zeros(len(cells.lattice)), np.zeros(len(cells.lattice[0]))
    row_east_m[at_row] = cells.centre_m[numbers, 0] - (cells.east0_m + at_column * cells.size_m)
    column_north_m[at_column] = cells.centre_m[numbers, 1] - (cells.north0_m + at_row * cells.size_m)
    return up_m, lowest_m, row_east_m, column_north_m


def _read_only(cells: ConeCells) -> ConeCells:
    """Make all arrays read-only, because kernels are compiled separately for writable and read-only arrays."""
    for array in cells:
        array.flags.writeable = False
    return cells


@kernel
def list_cone_runs(
    surface: Surface,
    sight: Sight,
    cells: Cells,
    quick: ConeCells,
    p: tuple[float, float, float],
    q: tuple[float, float, float],
    spacing: float,
    row: NDArray[np.uint8],
    out: NDArray[np.int32],
) -> int:
    """Write the runs of squares that are observed from the leg p-q into ``out``; returns how many numbers were written.

    Args:
        surface: the ground.
        sight: the sensor, a cone.
        cells: of the area.
        quick: the same, laid out by :func:`cone_cells`.
        p: east, north, up of one end, metres, finite.
        q: of the other end; the same for a single place.
        spacing: largest distance between samples, metres.
        row: (columns,) working memory.
        out: (stride,) first square of a run, first square after it, and so on, rising. A square is row * columns + column.

    Returns:
        How many numbers, -1 when there are more than ``out`` holds, NOT_SO when
        :func:`~uavcover.kernels.leg_visibility.list_cells` has to find out.
    """
    de, dn, du = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    horizontal = math.sqrt(de * de + dn * dn)
    tan = sight.tan_half_fov
    if quick.up_m.size == 0 or abs(tan * du) >= 0.99 * horizontal > 0.0 or (horizontal == 0.0 and du != 0.0):
        return NOT_SO
    over_nodes = has_node_cell(surface, p[0], p[1], p[2]) and has_node_cell(surface, q[0], q[1], q[2])
    if not over_nodes:
        return NOT_SO
    pieces = samples_of_leg(math.sqrt(horizontal * horizontal + du * du), spacing)
    rows, columns = quick.up_m.shape
    reach = _reach_over(sight, cells, quick, p, q) + cells.scatter_m + 1e-6 * cells.size_m
    south, north = min(p[1], q[1]) - reach, max(p[1], q[1]) + reach
    first_row = max(0, math.ceil((south - cells.north0_m) / cells.size_m))
    last_row = min(rows - 1, math.floor((north - cells.north0_m) / cells.size_m))
    count = 0
    for i in range(first_row, last_row + 1):
        row_north = cells.north0_m + i * cells.size_m
        first, last = columns_in_reach(cells, p, de, dn, row_north, reach, columns)
        if first > last:
            continue
        _mark_row(cells, quick, i, first, last, p, de, dn, du, tan, pieces, sight.reach_m**2, row)
        inside = False
        for j in range(first, last + 1):
            observed = row[j - first] == _INSIDE
            if row[j - first] == _TO_BE_TRIED:
                cell = cells.lattice[i, j]
                observed = leg_observes_cell(surface, sight, cells, cell, p, (de, dn, du), pieces, over_nodes)
            if observed != inside:
                if count == out.size:
                    return -1
                out[count] = i * columns + j
                count += 1
                inside = observed
        if inside:
            if count == out.size:
                return -1
            out[count] = i * columns + last + 1
            count += 1
    return count


@kernel
def _reach_over(
    sight: Sight, cells: Cells, quick: ConeCells, p: tuple[float, float, float], q: tuple[float, float, float]
) -> float:
    """Largest map distance at which a cell is observed: the cone's radius over the lowest ground near the leg."""
    farthest = horizontal_reach(sight)
    lowest = lowest_around(cells, quick.lowest_m, p, q, farthest + cells.scatter_m)
    return min(farthest, max(0.0, (max(p[2], q[2]) - lowest) * sight.tan_half_fov))


@kernel
def lowest_around(
    cells: Cells,
    lowest_m: NDArray[np.float64],
    p: tuple[float, float, float],
    q: tuple[float, float, float],
    reach: float,
) -> float:
    """Lowest of the ``lowest_m`` of the blocks within reach of a leg; infinite without a cell."""
    per_block = 1.0 / (cells.size_m * _BLOCK)
    rows, columns = lowest_m.shape
    first_row = max(0, int((min(p[1], q[1]) - reach - cells.north0_m) * per_block + 0.5 / _BLOCK))
    last_row = min(rows - 1, int((max(p[1], q[1]) + reach - cells.north0_m) * per_block + 0.5 / _BLOCK))
    first = max(0, int((min(p[0], q[0]) - reach - cells.east0_m) * per_block + 0.5 / _BLOCK))
    last = min(columns - 1, int((max(p[0], q[0]) + reach - cells.east0_m) * per_block + 0.5 / _BLOCK))
    lowest = math.inf
    for i in range(first_row, last_row + 1):
        for j in range(first, last + 1):
            lowest = min(lowest, lowest_m[i, j])
    return lowest


@kernel
def columns_in_reach(
    cells: Cells, p: tuple[float, float, float], de: float, dn: float, row_north: float, reach: float, columns: int
) -> tuple[int, int]:
    """First and last column of a row that any part of the leg from p by (de, dn) may reach."""
    begin, end = 0.0, 1.0
    half = reach
    if dn != 0.0:
        t0, t1 = (row_north - reach - p[1]) / dn, (row_north + reach - p[1]) / dn
        begin, end = max(0.0, min(t0, t1)), min(1.0, max(t0, t1))
    else:
        half = math.sqrt(max(0.0, reach * reach - (row_north - p[1]) ** 2))
    east0, east1 = p[0] + begin * de, p[0] + end * de
    first = max(0, math.ceil((min(east0, east1) - half - cells.east0_m) / cells.size_m))
    last = min(columns - 1, math.floor((max(east0, east1) + half - cells.east0_m) / cells.size_m))
    return first, last


@kernel
def _mark_row(
    cells: Cells,
    quick: ConeCells,
    i: int,
    first: int,
    last: int,
    p: tuple[float, float, float],
    de: float,
    dn: float,
    du: float,
    tan: float,
    pieces: int,
    range2: float,
    row: NDArray[np.uint8],
) -> None:
    """Mark the columns first..last of row i: 0, _INSIDE, or _TO_BE_TRIED for a cell inside the cone where more counts."""
    horizontal = math.sqrt(de * de + dn * dn)
    per_metre = 1.0 / horizontal if horizontal > 0.0 else 0.0
    along_e, along_n = de * per_metre, dn * per_metre
    # Where the leg climbs, the best place lies further along: where the distance grows as fast as the cone's radius.
    growth = tan * du * per_metre
    ahead = growth / math.sqrt(1.0 - growth * growth)
    samples = pieces * per_metre
    piece = 1.0 / max(pieces, 1)
    most = float(max(pieces - 1, 0))
    up_m = quick.up_m[i, first : last + 1]
    slope2 = quick.slope2[i, first : last + 1]
    column_north_m = quick.column_north_m[first : last + 1]
    east = p[0] - (cells.east0_m + first * cells.size_m + quick.row_east_m[i])
    north = p[1] - (cells.north0_m + i * cells.size_m)
    for j in range(last + 1 - first):
        ae, an = east - j * cells.size_m, north - column_north_m[j]
        up = p[2] - up_m[j]
        best = (abs(ae * along_n - an * along_e) * ahead - ae * along_e - an * along_n) * samples
        # Round down by adding and subtracting, because a call of floor would cost as much as the rest.
        t = (min(most, max(0.0, best)) - _NEARLY_HALF + _WHOLE - _WHOLE) * piece
        e, n, u = ae + t * de, an + t * dn, up + t * du
        radius, beside2 = max(0.0, u * tan), e * e + n * n
        inside = beside2 <= radius * radius
        easy = inside & (beside2 + u * u <= range2) & (u * u >= slope2[j] * beside2)
        t += piece
        e, n, u = ae + t * de, an + t * dn, up + t * du
        radius, beside2 = max(0.0, u * tan), e * e + n * n
        inside_next = beside2 <= radius * radius
        easy |= inside_next & (beside2 + u * u <= range2) & (u * u >= slope2[j] * beside2)
        row[j] = (inside | inside_next) * (_TO_BE_TRIED - easy)

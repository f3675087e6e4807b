"""Leg visibility of a camera with a rectangular photo as runs of squares: the fast path of ``leg_visibility`` for it.

The aim of a level vehicle's camera is the same all along a leg, and the side planes of its photo are linear along it. Of every
cell of a row, four quotients tell the part of the leg that has the cell between these planes, without a branch. One sample of
that part, the nearest, is then asked for range, incidence, ground sample distance and whether its ray is steeper than anything
around; for photos by distance, both ends and the middle of one stretch (``leg_certainly_observes``). Other cells are tried one
by one, as all are on the slow path; both give the same cells.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.arrays import Point
from uavcover.kernels.cells import Cells
from uavcover.kernels.jit import allocating_kernel, kernel
from uavcover.kernels.leg_visibility import leg_certainly_observes, leg_observes_cell, samples_of_leg
from uavcover.kernels.nadir_visibility import NOT_SO, columns_in_reach, laid_out, lowest_around, steepest_around
from uavcover.kernels.sight import (
    FRUSTUM,
    NO_LINE_OF_SIGHT,
    RAY,
    Aim,
    Sight,
    horizontal_reach,
    level_aim,
    widest_tangent,
)
from uavcover.kernels.surface import Surface, has_node_cell

_INSIDE = 1
_TO_BE_TRIED = 2

_WHOLE = 1.5 * 2.0**52
"""Adding it to a number of ordinary size removes the fraction."""
_NEARLY_HALF = 0.5 - 1e-9

_CERTAINLY = 1e-9
_PERHAPS = 1e-6
"""Fractions of a leg by which a place is inside of the photo for sure, or may be inside of it."""

_INWARD = 0.02
"""As in ``leg_certainly_observes``: the stretch that is tried keeps this fraction of its room from both ends."""


class PhotoCells(NamedTuple):
    """Cells in the form of the fast path; all (0, 0) and (0,) for other sensors.

    Attributes:
        up_m: (rows, columns) heights of the centres on the lattice, NaN without a cell.
        normal_e: (rows, columns) unit normals of the cells, east part.
        normal_n: north part.
        normal_u: upward part.
        clear2: (rows, columns) squared tangent of the slope from which on a ray to the cell is clear.
        lowest_m: as of :class:`uavcover.kernels.nadir_visibility.ConeCells`, and so are the next two.
        row_east_m: see there.
        column_north_m: see there.
    """

    up_m: NDArray[np.float64]
    normal_e: NDArray[np.float64]
    normal_n: NDArray[np.float64]
    normal_u: NDArray[np.float64]
    clear2: NDArray[np.float64]
    lowest_m: NDArray[np.float64]
    row_east_m: NDArray[np.float64]
    column_north_m: NDArray[np.float64]


def photo_cells(surface: Surface, sight: Sight, cells: Cells) -> PhotoCells:
    """Lay out cells for the fast path; empty for other sensors."""
    there = cells.lattice >= 0
    numbers = cells.lattice[there]

    def on_lattice(values: NDArray[np.float64]) -> NDArray[np.float64]:
        out = np.full(cells.lattice.shape, np.nan)
        out[there] = values
        return out

    if sight.kind != FRUSTUM or sight.line_of_sight not in (NO_LINE_OF_SIGHT, RAY) or sight.cos_max_incidence < 0.0:
        no, none = np.empty((0, 0)), np.empty(0)
        made = PhotoCells(no, no.copy(), no.copy(), no.copy(), no.copy(), no.copy(), none, none.copy())
    else:
        clear = np.zeros(len(numbers))
        if sight.line_of_sight == RAY:
            clear = np.maximum(cells.horizon[numbers], steepest_around(surface, cells)[numbers])
        up_m, lowest_m, row_east_m, column_north_m = laid_out(cells)
        east, north, up = (on_lattice(cells.normal[numbers, axis]) for axis in range(3))
        made = PhotoCells(up_m, east, north, up, on_lattice(clear**2), lowest_m, row_east_m, column_north_m)
    for array in made:
        array.flags.writeable = False
    return made


class _Planes(NamedTuple):
    """The side planes of a photo along a leg; a position is inside if all four values are >= 0.

    Attributes:
        normal: (4, 3) value of a place.
        per_change: (4,) 1 / change along the whole leg, 0 without one.
        opens: (4,) 0 where the leg comes in through the plane, -inf where not.
        closes: (4,) 0 where it goes out through it, inf where not.
        fixed: (4,) 1 where the leg runs along the plane, 0 where not.
    """

    normal: NDArray[np.float64]
    per_change: NDArray[np.float64]
    opens: NDArray[np.float64]
    closes: NDArray[np.float64]
    fixed: NDArray[np.float64]


@allocating_kernel
def _planes(sight: Sight, aim: Aim, d: Point) -> _Planes:
    """The planes of a camera's photo, for a leg by d."""
    normal = np.empty((4, 3))
    ta, tl = sight.tan_half_fov, sight.tan_half_along
    axis = (aim.axis_e, aim.axis_n, aim.axis_u)
    right = (aim.right_e, aim.right_n, aim.right_u)
    top = (aim.top_e, aim.top_n, aim.top_u)
    per_change, opens, closes, fixed = np.zeros(4), np.empty(4), np.empty(4), np.zeros(4)
    for k in range(3):
        normal[0, k] = -ta * axis[k] - right[k]
        normal[1, k] = -ta * axis[k] + right[k]
        normal[2, k] = -tl * axis[k] - top[k]
        normal[3, k] = -tl * axis[k] + top[k]
    length = math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
    for m in range(4):
        change = normal[m, 0] * d[0] + normal[m, 1] * d[1] + normal[m, 2] * d[2]
        along = abs(change) <= 1e-12 * length
        fixed[m] = 1.0 if along else 0.0
        per_change[m] = 0.0 if along else 1.0 / change
        opens[m] = 0.0 if change > 0.0 and not along else -math.inf
        closes[m] = 0.0 if change < 0.0 and not along else math.inf
    return _Planes(normal, per_change, opens, closes, fixed)


@allocating_kernel
def list_photo_runs(
    surface: Surface,
    sight: Sight,
    cells: Cells,
    quick: PhotoCells,
    p: Point,
    q: Point,
    spacing: float,
    trigger: float,
    row: NDArray[np.uint8],
    out: NDArray[np.int32],
) -> int:
    """Write the runs of squares that are observed from the leg p-q into ``out``; returns how many numbers were written.

    Args:
        surface: the ground.
        sight: the sensor, a frustum.
        cells: of the area.
        quick: the same, laid out by :func:`photo_cells`.
        p: east, north, up of one end, metres, finite.
        q: of the other end; the same for a single place.
        spacing: largest distance between samples, metres.
        trigger: distance between photos, which then take the place of the samples; 0: none.
        row: (columns,) working memory.
        out: (stride,) first square of a run, first square after it, and so on, rising. A square is row * columns + column.

    Returns:
        How many numbers, -1 when there are more than ``out`` holds, NOT_SO when
        :func:`~uavcover.kernels.leg_visibility.list_cells` has to find out.
    """
    de, dn, du = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    horizontal = math.sqrt(de * de + dn * dn)
    aim = level_aim(sight, de, dn)
    if quick.up_m.size == 0 or not math.isfinite(aim.axis_e) or (horizontal == 0.0 and (du != 0.0 or trigger > 0.0)):
        return NOT_SO
    beyond = 0.5 * trigger / horizontal if trigger > 0.0 else 0.0
    begin = (p[0] - beyond * de, p[1] - beyond * dn, p[2] - beyond * du)
    end = (q[0] + beyond * de, q[1] + beyond * dn, q[2] + beyond * du)
    over_nodes = has_node_cell(surface, *begin) and has_node_cell(surface, *end)
    if not over_nodes:
        return NOT_SO
    d = (de * (1.0 + 2.0 * beyond), dn * (1.0 + 2.0 * beyond), du * (1.0 + 2.0 * beyond))
    pieces = samples_of_leg(math.sqrt(horizontal * horizontal + du * du), spacing)
    half = beyond / (1.0 + 2.0 * beyond)
    planes = _planes(sight, aim, d)
    rows, columns = quick.up_m.shape
    farthest = horizontal_reach(sight)
    lowest = lowest_around(cells, quick.lowest_m, p, q, farthest + cells.scatter_m)
    reach = min(farthest, max(0.0, (max(begin[2], end[2]) - lowest) * widest_tangent(sight)))
    reach += cells.scatter_m + 1e-6 * cells.size_m
    south, north = min(p[1], q[1]) - reach, max(p[1], q[1]) + reach
    first_row = max(0, math.ceil((south - cells.north0_m) / cells.size_m))
    last_row = min(rows - 1, math.floor((north - cells.north0_m) / cells.size_m))
    count = 0
    for i in range(first_row, last_row + 1):
        row_north = cells.north0_m + i * cells.size_m
        first, last = columns_in_reach(cells, p, de, dn, row_north, reach, columns)
        if first > last:
            continue
        _mark_row(sight, cells, quick, planes, i, first, last, begin, d, pieces, half, trigger, row)
        inside = False
        for j in range(first, last + 1):
            observed = row[j - first] == _INSIDE
            if row[j - first] == _TO_BE_TRIED:
                cell = cells.lattice[i, j]
                if trigger > 0.0:
                    observed = leg_certainly_observes(surface, sight, cells, cell, p, (de, dn, du), trigger, over_nodes)
                else:
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
def _mark_row(
    sight: Sight,
    cells: Cells,
    quick: PhotoCells,
    planes: _Planes,
    i: int,
    first: int,
    last: int,
    begin: Point,
    d: Point,
    pieces: int,
    half: float,
    trigger: float,
    row: NDArray[np.uint8],
) -> None:
    """Mark the columns first..last of row i: 0, _INSIDE, or _TO_BE_TRIED for a cell between the planes where more counts."""
    de, dn, du = d
    horizontal2 = de * de + dn * dn
    length2 = horizontal2 + du * du
    per_length2 = 1.0 / horizontal2 if horizontal2 > 0.0 else 0.0
    a0, a1, a2 = planes.normal[0, 0], planes.normal[0, 1], planes.normal[0, 2]
    b0, b1, b2 = planes.normal[1, 0], planes.normal[1, 1], planes.normal[1, 2]
    c0, c1, c2 = planes.normal[2, 0], planes.normal[2, 1], planes.normal[2, 2]
    e0, e1, e2 = planes.normal[3, 0], planes.normal[3, 1], planes.normal[3, 2]
    pa, pb, pc, pe = planes.per_change[0], planes.per_change[1], planes.per_change[2], planes.per_change[3]
    oa, ob, oc, oe = planes.opens[0], planes.opens[1], planes.opens[2], planes.opens[3]
    ca, cb, cc, ce = planes.closes[0], planes.closes[1], planes.closes[2], planes.closes[3]
    fa, fb, fc, fe = planes.fixed[0], planes.fixed[1], planes.fixed[2], planes.fixed[3]
    some_fixed = max(max(fa, fb), max(fc, fe))
    range2 = sight.reach_m * sight.reach_m * (1.0 - _CERTAINLY)
    steepest2 = sight.cos_max_incidence * sight.cos_max_incidence * (1.0 + _CERTAINLY)
    coarsest2 = sight.sample_focal_m * sight.sample_focal_m * (1.0 - _CERTAINLY)
    # The normals of two opposite planes add up to the axis.
    scale = -0.5 / sight.tan_half_fov
    axis_e, axis_n, axis_u = scale * (a0 + b0), scale * (a1 + b1), scale * (a2 + b2)
    by_distance = trigger > 0.0
    samples = float(max(pieces, 1))
    piece = 1.0 / samples
    slack = _PERHAPS * samples
    up_m, clear2 = quick.up_m[i, first : last + 1], quick.clear2[i, first : last + 1]
    normal_e, normal_n = quick.normal_e[i, first : last + 1], quick.normal_n[i, first : last + 1]
    normal_u, column_north_m = quick.normal_u[i, first : last + 1], quick.column_north_m[first : last + 1]
    east = begin[0] - (cells.east0_m + first * cells.size_m + quick.row_east_m[i])
    north = begin[1] - (cells.north0_m + i * cells.size_m)
    for j in range(last + 1 - first):
        ae, an, au = east - j * cells.size_m, north - column_north_m[j], begin[2] - up_m[j]
        va = a0 * ae + a1 * an + a2 * au
        vb = b0 * ae + b1 * an + b2 * au
        vc = c0 * ae + c1 * an + c2 * au
        ve = e0 * ae + e1 * an + e2 * au
        qa, qb, qc, qe = -va * pa, -vb * pb, -vc * pc, -ve * pe
        low = max(max(max(qa + oa, qb + ob), max(qc + oc, qe + oe)), 0.0)
        high = min(min(min(qa + ca, qb + cb), min(qc + cc, qe + ce)), 1.0)
        beside = min(min(va * fa, vb * fb), min(vc * fc, ve * fe))
        # A comparison with NaN is False: no cell, not in view.
        size = abs(ae) + abs(an) + abs(au)
        perhaps = beside >= -_PERHAPS * size
        easy = beside >= _CERTAINLY * some_fixed * size
        nearest = -(ae * de + an * dn) * per_length2
        if by_distance:
            # Where the range ends nothing, the stretch is the one that the slow path tries first.
            on = ae * de + an * dn + au * du
            easy &= ae * ae + an * an + au * au + low * (2.0 * on + low * length2) <= range2
            easy &= ae * ae + an * an + au * au + high * (2.0 * on + high * length2) <= range2
            low += half
            high -= half
            perhaps &= low <= high + _PERHAPS
            easy &= low + _PERHAPS <= high
            room = _INWARD * (high - low)
            t = min(high - room, max(low + room, nearest))
        else:
            # Round up and down by adding and subtracting, because a call of floor would cost as much as the rest.
            lowest = (low * samples - slack + _NEARLY_HALF + _WHOLE) - _WHOLE
            highest = (high * samples + slack - _NEARLY_HALF + _WHOLE) - _WHOLE
            perhaps &= lowest <= highest
            t = min(highest, max(lowest, (nearest * samples + _WHOLE) - _WHOLE)) * piece
            easy &= ((t >= low + _CERTAINLY) | (low <= 0.0)) & ((t <= high - _CERTAINLY) | (high >= 1.0))
        easy &= _observed_from(ae + t * de, an + t * dn, au + t * du, axis_e, axis_n, axis_u, normal_e[j], normal_n[j],
                           normal_u[j], range2, steepest2, coarsest2, clear2[j])  # fmt: skip
        if by_distance:
            s = t - half
            easy &= _observed_from(ae + s * de, an + s * dn, au + s * du, axis_e, axis_n, axis_u, normal_e[j], normal_n[j],
                               normal_u[j], range2, steepest2, coarsest2, clear2[j])  # fmt: skip
            s = t + half
            easy &= _observed_from(ae + s * de, an + s * dn, au + s * du, axis_e, axis_n, axis_u, normal_e[j], normal_n[j],
                               normal_u[j], range2, steepest2, coarsest2, clear2[j])  # fmt: skip
        row[j] = perhaps * (_TO_BE_TRIED - easy)


@kernel
def _observed_from(
    e: float, n: float, u: float, axis_e: float, axis_n: float, axis_u: float, ne: float, nn: float, nu: float,
    range2: float, steepest2: float, coarsest2: float, clear2: float,
) -> bool:  # fmt: skip
    """Whether a cell between the planes of a photo is in range, not too oblique or coarse, and not hidden."""
    beside2 = e * e + n * n
    distance2 = beside2 + u * u
    facing = e * ne + n * nn + u * nu
    depth = -(e * axis_e + n * axis_n + u * axis_u)
    return bool(
        (distance2 <= range2)
        & (facing > 0.0)
        & (facing * facing >= steepest2 * distance2)
        & (u > 0.0)
        & (u * u >= clear2 * beside2)
        & (depth * depth * depth <= coarsest2 * facing)
    )

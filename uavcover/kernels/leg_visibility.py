"""The cells that a leg or a position observes, as a list that the local search adds or removes.

A leg is observed from regular samples along it; a position is a leg with equal ends. For every sensor here, the set of positions
from which a cell is in view is convex (a ball, a disc, a cone or a pyramid above the cell; a level vehicle keeps its heading
along a leg). So the samples of a leg that observe a cell are consecutive. Their range is solved in closed form, and only samples
inside it are tested. Along a straight leg, each side plane of a pyramid is linear.

The photos of a distance-triggered camera depend on the path before the leg, which the local search would have to recompute after
every change. A leg is therefore taken to show what is in view all along a stretch of the trigger distance, because every such
stretch contains a photo. A search cannot exploit short legs or lengths that suit the trigger, and a flight with rounded corners
shows the same ground.
"""

import math

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.arrays import Point
from uavcover.kernels.cells import AroundCell, Cells, cell_in_line_of_sight, known_of_sight, surroundings
from uavcover.kernels.jit import kernel
from uavcover.kernels.sight import (
    CONE,
    DISC,
    FRUSTUM,
    Aim,
    Sight,
    horizontal_reach,
    in_round_view,
    in_view,
    level_aim,
    widest_tangent,
)
from uavcover.kernels.skyline import CLEAR, HIDDEN
from uavcover.kernels.surface import Surface, has_node_cell

_ROUNDING = 1e-7
_INWARD = 0.02
"""Fraction of the range of a stretch, from each of its ends, that is not tried."""


@kernel
def samples_of_leg(length: float, spacing: float) -> int:
    """Number of equal pieces between the samples of a leg, as in ``sample_path``; 0 for a place."""
    return max(1, math.ceil(length / spacing - 1e-9)) if length > 0.0 else 0


@kernel
def list_cells(
    surface: Surface,
    sight: Sight,
    cells: Cells,
    p: tuple[float, float, float],
    q: tuple[float, float, float],
    spacing: float,
    trigger: float,
    out: NDArray[np.int32],
) -> int:
    """Write the numbers of the cells observed from the leg p-q into ``out``; returns their count.

    Args:
        surface: the ground.
        sight: the sensor.
        cells: of the area.
        p: east, north, up of one end, metres, finite.
        q: of the other end; the same for a single place.
        spacing: largest distance between samples, metres.
        trigger: distance between photos, metres, which then replace the samples (:func:`leg_certainly_observes`); 0: none.
        out: (stride,) is written from its beginning.

    Returns:
        The number of cells, or -1 when there are more than ``out`` holds.
    """
    de, dn, du = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    pieces = samples_of_leg(math.sqrt(de * de + dn * dn + du * du), spacing)
    rows, columns = cells.lattice.shape
    reach = horizontal_reach(sight) + cells.scatter_m + 1e-6 * cells.size_m
    south, north = min(p[1], q[1]) - reach, max(p[1], q[1]) + reach
    first_row = max(0, math.ceil((south - cells.north0_m) / cells.size_m))
    last_row = min(rows - 1, math.floor((north - cells.north0_m) / cells.size_m))
    horizontal2 = de * de + dn * dn
    per_length2 = 1.0 / horizontal2 if horizontal2 > 0.0 else 0.0
    photo = sight.kind == FRUSTUM
    tan = sight.tan_half_fov
    # How fast the radius of a cone on the ground grows along the leg; where it grows slower than the leg moves on, a cell
    # beside the leg is observed from somewhere on its straight line when radius^2 >= distance^2 (1 - growth^2) at the nearest
    # place.
    growth2 = tan * tan * du * du * per_length2
    narrows = sight.kind == CONE and horizontal2 > 0.0 and growth2 < 1.0
    # A ray inside a cone or a photo that is steeper than the ground ever is needs no test, unless an obstacle stands near its
    # cell.
    widest = widest_tangent(sight)
    beyond = 0.5 * trigger * math.sqrt(per_length2)
    over_nodes = has_node_cell(surface, p[0] - beyond * de, p[1] - beyond * dn, p[2] - beyond * du) and has_node_cell(
        surface, q[0] + beyond * de, q[1] + beyond * dn, q[2] + beyond * du
    )
    steepest = surface.steepest if over_nodes else math.inf
    piece = 1.0 / max(pieces, 1)
    count = 0
    for i in range(first_row, last_row + 1):
        row_north = cells.north0_m + i * cells.size_m
        # The part of the leg within reach of this row of cells, 0..1.
        begin, end = 0.0, 1.0
        if dn != 0.0:
            t0, t1 = (row_north - reach - p[1]) / dn, (row_north + reach - p[1]) / dn
            begin, end = max(0.0, min(t0, t1)), min(1.0, max(t0, t1))
        east0, east1 = p[0] + begin * de, p[0] + end * de
        half = reach
        if dn == 0.0:
            half = math.sqrt(max(0.0, reach * reach - (row_north - p[1]) ** 2))
        first = max(0, math.ceil((min(east0, east1) - half - cells.east0_m) / cells.size_m))
        last = min(columns - 1, math.floor((max(east0, east1) + half - cells.east0_m) / cells.size_m))
        for j in range(first, last + 1):
            cell = cells.lattice[i, j]
            if cell < 0:
                continue
            # From the cell to the beginning of the leg, and the nearest that the leg comes on the map.
            ae, an = p[0] - cells.centre_m[cell, 0], p[1] - cells.centre_m[cell, 1]
            along = -(ae * de + an * dn) * per_length2
            nearest = min(1.0, max(0.0, along))
            if (ae + nearest * de) ** 2 + (an + nearest * dn) ** 2 > reach * reach:
                continue
            if narrows:
                radius = (p[2] - cells.centre_m[cell, 2] + along * du) * tan
                beside2 = (ae + along * de) ** 2 + (an + along * dn) ** 2
                if radius <= 0.0 or beside2 * (1.0 - growth2) > radius * radius * (1.0 + _ROUNDING):
                    continue
            observed = False
            if not photo:
                likely = math.floor(nearest * pieces + 0.5)
                t = likely * piece
                e, n, u = ae + t * de, an + t * dn, p[2] - cells.centre_m[cell, 2] + t * du
                # Test the view first, inlined: it decides most cells, and a call with the ground costs as much again.
                observed = in_round_view(
                    sight, e, n, u, cells.normal[cell, 0], cells.normal[cell, 1], cells.normal[cell, 2]
                )
            clear = max(steepest, cells.horizon[cell]) * widest <= 1.0
            if trigger > 0.0:
                observed = leg_certainly_observes(surface, sight, cells, cell, p, (de, dn, du), trigger, over_nodes)
            elif not (observed and clear) and (observed or pieces > 0 or photo):
                observed = leg_observes_cell(surface, sight, cells, cell, p, (de, dn, du), pieces, over_nodes)
            if observed:
                if count == out.size:
                    return -1
                out[count] = cell
                count += 1
    return count


@kernel
def leg_observes_cell(
    surface: Surface,
    sight: Sight,
    cells: Cells,
    cell: int,
    p: Point,
    d: Point,
    pieces: int,
    over_nodes: bool,
) -> bool:
    """Whether any sample of the leg from p by d, cut in ``pieces``, observes the cell.

    ``over_nodes``: whether both ends, and so all of the leg, are over the nodes of the ground.
    """
    de, dn, du = d
    ce, cn, cu = cells.centre_m[cell, 0], cells.centre_m[cell, 1], cells.centre_m[cell, 2]
    ae, an, au = p[0] - ce, p[1] - cn, p[2] - cu
    first, last = 0, pieces
    if pieces > 1:
        rise2 = 0.0 if sight.kind == DISC else 1.0
        low, high = _inside(
            de * de + dn * dn + rise2 * du * du,
            ae * de + an * dn + rise2 * au * du,
            ae * ae + an * an + rise2 * au * au - sight.reach_m * sight.reach_m,
        )
        if sight.kind == CONE:
            tan2 = sight.tan_half_fov * sight.tan_half_fov
            cone_low, cone_high = _inside(
                de * de + dn * dn - tan2 * du * du,
                ae * de + an * dn - tan2 * au * du,
                ae * ae + an * an - tan2 * au * au,
            )
            low, high = max(low, cone_low), min(high, cone_high)
        elif sight.kind == FRUSTUM:
            low, high = _inside_photo(sight, level_aim(sight, de, dn), low, high, (ae, an, au), d)
        if low > high:
            return False
        first = max(0, math.ceil(low * pieces - _ROUNDING * pieces))
        last = min(pieces, math.floor(high * pieces + _ROUNDING * pieces))
    # From the nearest sample outwards, because its ray is the steepest.
    horizontal2 = de * de + dn * dn
    nearest = math.floor(-(ae * de + an * dn) / horizontal2 * pieces + 0.5) if horizontal2 > 0.0 else first
    middle = min(last, max(first, nearest))
    aim = level_aim(sight, de, dn)
    ne, nn, nu = cells.normal[cell, 0], cells.normal[cell, 1], cells.normal[cell, 2]
    around = surroundings(surface, sight, cells, cell, over_nodes)
    for away in range(last - first + 1):
        for side in (-1, 1):
            k = middle + side * away
            if first <= k <= last and (away > 0 or side < 0):
                t = k / max(pieces, 1)
                e, n, u = ae + t * de, an + t * dn, au + t * du
                # The surroundings decide most rays, inlined: a call with the ground costs as much as ten of these.
                known = known_of_sight(around, cells.skylines.bounds, cells.rise, cell, e, n, u)
                if (
                    known != HIDDEN
                    and in_view(sight, aim, e, n, u, ne, nn, nu)
                    and (known == CLEAR or cell_in_line_of_sight(surface, sight, cells, cell, (ce + e, cn + n, cu + u)))
                ):
                    return True
    return False


@kernel
def leg_certainly_observes(
    surface: Surface,
    sight: Sight,
    cells: Cells,
    cell: int,
    p: Point,
    d: Point,
    trigger: float,
    over_nodes: bool,
) -> bool:
    """Whether a photo has the cell in view all along a stretch of the trigger distance, centred on the leg p by d.

    Half of the stretch may lie beyond an end of the leg, as if the path continued straight: waypoints on a straight line change
    nothing, and after the last photo of a line half the distance is missing on average. The positions with a cell in view are
    convex, so the ends decide; rays are traced from the ends and the middle. A vertical leg shows nothing.

    ``over_nodes``: whether both ends, extended by half a stretch, are over the nodes of the ground.
    """
    de, dn, du = d
    over_ground = math.hypot(de, dn)
    if over_ground == 0.0:
        return False
    beyond = 0.5 * trigger / over_ground
    # The leg with half a stretch more at each end, and half a stretch as a fraction of it.
    half = beyond / (1.0 + 2.0 * beyond)
    d = (de * (1.0 + 2.0 * beyond), dn * (1.0 + 2.0 * beyond), du * (1.0 + 2.0 * beyond))
    ae = p[0] - beyond * de - cells.centre_m[cell, 0]
    an = p[1] - beyond * dn - cells.centre_m[cell, 1]
    au = p[2] - beyond * du - cells.centre_m[cell, 2]
    horizontal2 = d[0] * d[0] + d[1] * d[1]
    low, high = _inside(
        horizontal2 + d[2] * d[2],
        ae * d[0] + an * d[1] + au * d[2],
        ae * ae + an * an + au * au - sight.reach_m * sight.reach_m,
    )
    low, high = _inside_photo(sight, level_aim(sight, de, dn), low, high, (ae, an, au), d)
    first, last = low + half, high - half
    if not first <= last:
        return False
    # Away from both ends, where rounding decides; from the nearest position outwards, because its rays are the steepest.
    room = _INWARD * (last - first)
    middle = min(last - room, max(first + room, -(ae * d[0] + an * d[1]) / horizontal2))
    aim, a, around = level_aim(sight, de, dn), (ae, an, au), surroundings(surface, sight, cells, cell, over_nodes)
    for away in range(math.ceil((last - first) / half) + 1):
        for side in (-1, 1):
            centre = middle + side * away * half
            if first <= centre <= last and (away > 0 or side < 0):
                begin = _known_of_sample(sight, aim, cells, cell, around, a, d, centre - half)
                end = (
                    HIDDEN
                    if begin == HIDDEN
                    else _known_of_sample(sight, aim, cells, cell, around, a, d, centre + half)
                )
                if begin == HIDDEN or end == HIDDEN:
                    continue
                between = _known_of_sample(sight, aim, cells, cell, around, a, d, centre)
                if (
                    between != HIDDEN
                    and (begin == CLEAR or _traced(surface, sight, cells, cell, a, d, centre - half))
                    and (end == CLEAR or _traced(surface, sight, cells, cell, a, d, centre + half))
                    and (between == CLEAR or _traced(surface, sight, cells, cell, a, d, centre))
                ):
                    return True
    return False


@kernel
def _known_of_sample(
    sight: Sight, aim: Aim, cells: Cells, cell: int, around: AroundCell, a: Point, d: Point, t: float
) -> int:
    """:func:`known_of_sight` to the cell's own centre plus a plus t d; HIDDEN if that is not in view."""
    e, n, u = a[0] + t * d[0], a[1] + t * d[1], a[2] + t * d[2]
    if not in_view(sight, aim, e, n, u, cells.normal[cell, 0], cells.normal[cell, 1], cells.normal[cell, 2]):
        return HIDDEN
    return known_of_sight(around, cells.skylines.bounds, cells.rise, cell, e, n, u)


@kernel
def _traced(surface: Surface, sight: Sight, cells: Cells, cell: int, a: Point, d: Point, t: float) -> bool:
    """Whether nothing stands between the cell and its own centre plus a plus t d."""
    e, n, u = a[0] + t * d[0], a[1] + t * d[1], a[2] + t * d[2]
    ce, cn, cu = cells.centre_m[cell, 0], cells.centre_m[cell, 1], cells.centre_m[cell, 2]
    return cell_in_line_of_sight(surface, sight, cells, cell, (ce + e, cn + n, cu + u))


@kernel
def _inside(a: float, b: float, c: float) -> tuple[float, float]:
    """Interval in 0..1 where a t^2 + 2 b t + c <= 0 if a > 0; otherwise all."""
    if a <= 0.0:
        return 0.0, 1.0
    root2 = b * b - a * c
    if root2 < -_ROUNDING * b * b:
        return 1.0, 0.0
    root = math.sqrt(max(0.0, root2))
    return max(0.0, (-b - root) / a - _ROUNDING), min(1.0, (-b + root) / a + _ROUNDING)


@kernel
def _inside_photo(sight: Sight, aim: Aim, low: float, high: float, a: Point, d: Point) -> tuple[float, float]:
    """The part of low..high of a leg on which a cell is between the four side planes of the photo.

    The sensor is at a + t d from the cell. Empty (low above high) if the camera's orientation is unknown.
    """
    (ae, an, au), (de, dn, du) = a, d
    depth = -(ae * aim.axis_e + an * aim.axis_n + au * aim.axis_u)
    deeper = -(de * aim.axis_e + dn * aim.axis_n + du * aim.axis_u)
    across = ae * aim.right_e + an * aim.right_n + au * aim.right_u
    wider = de * aim.right_e + dn * aim.right_n + du * aim.right_u
    along = ae * aim.top_e + an * aim.top_n + au * aim.top_u
    longer = de * aim.top_e + dn * aim.top_n + du * aim.top_u
    if not math.isfinite(depth):
        return 1.0, 0.0
    ta, tl = sight.tan_half_fov, sight.tan_half_along
    low, high = _not_negative(low, high, ta * depth - across, ta * deeper - wider)
    low, high = _not_negative(low, high, ta * depth + across, ta * deeper + wider)
    low, high = _not_negative(low, high, tl * depth - along, tl * deeper - longer)
    return _not_negative(low, high, tl * depth + along, tl * deeper + longer)


@kernel
def _not_negative(low: float, high: float, at_0: float, change: float) -> tuple[float, float]:
    """The part of low..high where at_0 + t change >= 0, slightly wider, because the samples decide."""
    slack = _ROUNDING * (abs(at_0) + abs(change))
    if change > 0.0:
        return max(low, -(at_0 + slack) / change), high
    if change < 0.0:
        return low, min(high, -(at_0 + slack) / change)
    return (low, high) if at_0 + slack >= 0.0 else (1.0, 0.0)

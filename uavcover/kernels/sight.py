"""The view of a sensor, its reach, and which rays need no tracing.

One test decides what is in view, without the line of sight, for planner, local search and verification. A camera's view is given
in its own axes: its direction, the right of its photo and the top of it. For every sensor here the set of places from which a
cell is in view is convex while the axes stay the same: a ball, a disc, a cone, a pyramid. The places with a small enough
incidence angle are a cone around the cell's normal, and those with a small enough ground sample distance satisfy depth^3 <=
constant * height above the cell's plane, a convex function below a linear one. From this follows how far away a cell can be
observed at all, by anything that flies no higher above ground than allowed.

Most rays pass without being traced because the ground between their ends is not steep enough to block them.
:attr:`uavcover.kernels.surface.Surface.steepest` bounds the slope of the whole ground, and is infinite as soon as one node
has no data. Here each block of the grid has its own bound, and a ray asks only the blocks between its ends.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.grid import GridFrame, in_cell, on_grid, steepest_in_cell
from uavcover.kernels.jit import allocating_kernel, kernel
from uavcover.kernels.surface import GRID, Surface

BLOCK_CELLS = 4


class LocalSlopes(NamedTuple):
    """Bounds on the slope in square blocks of the grid.

    Attributes:
        steepest: (rows, columns) tangents; infinite where a node of the block has no data. (1, 1) for an analytic surface.
    """

    steepest: NDArray[np.float64]


def local_slopes(surface: Surface) -> LocalSlopes:
    """The bounds of a surface; see :func:`uavcover.kernels.grid.steepest_in_cell` for that of one cell."""
    if surface.kind != GRID:
        return LocalSlopes(np.array([[surface.steepest]]))
    return LocalSlopes(_steepest_in_blocks(surface.up_m, surface.grid))


@allocating_kernel
def _steepest_in_blocks(nodes: NDArray[np.float64], frame: GridFrame) -> NDArray[np.float64]:
    rows, columns = nodes.shape[0] - 1, nodes.shape[1] - 1
    out = np.zeros(((rows - 1) // BLOCK_CELLS + 1, (columns - 1) // BLOCK_CELLS + 1))
    for i in range(rows):
        for j in range(columns):
            slope = steepest_in_cell(nodes, frame, i, j)
            if math.isnan(slope):
                slope = math.inf
            out[i // BLOCK_CELLS, j // BLOCK_CELLS] = max(out[i // BLOCK_CELLS, j // BLOCK_CELLS], slope)
    return out


@kernel
def steepest_between(surface: Surface, slopes: LocalSlopes, ae: float, an: float, be: float, bn: float) -> float:
    """Bound on the slope of the ground along the straight line between two places; infinite outside the grid."""
    if surface.kind != GRID:
        return float(slopes.steepest[0, 0])
    if not math.isfinite(ae + an + be + bn):
        return math.inf
    grid = surface.grid
    a_column, a_row = on_grid(grid, ae, an, grid.level_up_m)
    b_column, b_row = on_grid(grid, be, bn, grid.level_up_m)
    west, east = min(a_column, b_column) - grid.leeway, max(a_column, b_column) + grid.leeway
    first, last = min(a_row, b_row) - grid.leeway, max(a_row, b_row) + grid.leeway
    if not (west >= 0.0 and first >= 0.0 and east <= surface.up_m.shape[1] - 1 and last <= surface.up_m.shape[0] - 1):
        return math.inf
    rows, columns = slopes.steepest.shape
    steepest = 0.0
    for i in range(int(first) // BLOCK_CELLS, min(int(last) // BLOCK_CELLS, rows - 1) + 1):
        for j in range(int(west) // BLOCK_CELLS, min(int(east) // BLOCK_CELLS, columns - 1) + 1):
            steepest = max(steepest, slopes.steepest[i, j])
    return steepest


SPHERE = 0
DISC = 1
CONE = 2
FRUSTUM = 3

NO_LINE_OF_SIGHT = 0
RAY = 1
MIDPOINT = 2

NOT_IN_RANGE = 0
TOO_OBLIQUE = 1
TOO_COARSE = 2
OCCLUDED = 3
OBSERVED = 4


class Sight(NamedTuple):
    """The view of a sensor, as plain numbers.

    Attributes:
        kind: SPHERE, DISC, CONE or FRUSTUM.
        reach_m: largest slant range (SPHERE, CONE, FRUSTUM) or horizontal radius (DISC).
        tan_half_fov: tangent of half the opening angle (CONE), of half the angle across the photo (FRUSTUM).
        cos_max_incidence: cosine of the largest incidence angle (CONE, FRUSTUM); -1: any.
        line_of_sight: NO_LINE_OF_SIGHT, RAY or MIDPOINT.
        tan_half_along: tangent of half the angle from the bottom to the top of the photo (FRUSTUM).
        cos_pitch: of the angle between the camera's axis and the horizon (FRUSTUM).
        sin_pitch: the same; -1 looks straight down.
        heading_e: east part of the direction that a level camera's photo has at its top, where it is always the same
            (FRUSTUM); NaN: the camera turns with the legs.
        heading_n: north part.
        sample_focal_m: largest ground sample distance times the focal length in pixels (CONE, FRUSTUM); infinite: any.
    """

    kind: int
    reach_m: float
    tan_half_fov: float
    cos_max_incidence: float
    line_of_sight: int
    tan_half_along: float = 0.0
    cos_pitch: float = 0.0
    sin_pitch: float = -1.0
    heading_e: float = math.nan
    heading_n: float = math.nan
    sample_focal_m: float = math.inf


class Aim(NamedTuple):
    """Orientation of a camera: three orthogonal unit vectors in ENU; NaN where unknown.

    Attributes:
        axis_e, axis_n, axis_u: where it looks.
        right_e, right_n, right_u: the right of its photo.
        top_e, top_n, top_u: the top of its photo.
    """

    axis_e: float
    axis_n: float
    axis_u: float
    right_e: float
    right_n: float
    right_u: float
    top_e: float
    top_n: float
    top_u: float


@kernel
def level_aim(sight: Sight, east: float, north: float) -> Aim:
    """Orientation of the camera of a level vehicle that heads along (east, north), of any length.

    A photo with a top has no direction where the vehicle heads nowhere: all is NaN then, and nothing is in view.
    """
    if sight.kind != FRUSTUM:
        return Aim(0.0, 0.0, -1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    he, hn = sight.heading_e, sight.heading_n
    if math.isnan(he):
        length = math.hypot(east, north)
        he, hn = (east / length, north / length) if length > 0.0 else (math.nan, math.nan)
    c, s = sight.cos_pitch, sight.sin_pitch
    return Aim(c * he, c * hn, s, hn, -he, 0.0, -s * he, -s * hn, c)


@kernel
def in_view(sight: Sight, aim: Aim, de: float, dn: float, du: float, ne: float, nn: float, nu: float) -> bool:
    """Whether a cell is in range, in the field of view, not too oblique or coarse, from a level vehicle.

    Args:
        sight: the sensor.
        aim: its orientation, from :func:`level_aim`.
        de: from the cell to the sensor, east.
        dn: north.
        du: up.
        ne: unit normal of the cell, east.
        nn: north.
        nu: up.
    """
    if sight.kind != FRUSTUM:
        return in_round_view(sight, de, dn, du, ne, nn, nu)
    horizontal2 = de * de + dn * dn
    depth = -(de * aim.axis_e + dn * aim.axis_n + du * aim.axis_u)
    across = de * aim.right_e + dn * aim.right_n + du * aim.right_u
    along = de * aim.top_e + dn * aim.top_n + du * aim.top_u
    facing = de * ne + dn * nn + du * nu
    return bool(view(sight, horizontal2, horizontal2 + du * du, depth, across, along, facing) == OCCLUDED)


@kernel
def in_round_view(sight: Sight, de: float, dn: float, du: float, ne: float, nn: float, nu: float) -> bool:
    """:func:`in_view` of every sensor but a FRUSTUM; it does not depend on the heading."""
    horizontal2 = de * de + dn * dn
    return bool(view(sight, horizontal2, horizontal2 + du * du, du, 0.0, 0.0, de * ne + dn * nn + du * nu) == OCCLUDED)


@kernel
def view(
    sight: Sight, horizontal2: float, distance2: float, depth: float, across: float, along: float, facing: float
) -> int:
    """Test a cell against the view of a sensor, without the line of sight.

    Args:
        sight: the sensor.
        horizontal2: squared distance from the sensor to the cell over ground, metres^2.
        distance2: squared distance from the sensor to the cell.
        depth: the part of the distance along the axis of the camera, metres.
        across: the part along the right of the photo, of either sign.
        along: the part along the top of the photo, of either sign.
        facing: height of the sensor above the plane of the cell: distance times the cosine of the incidence angle.

    Returns:
        NOT_IN_RANGE: out of range or outside the field of view. TOO_OBLIQUE. TOO_COARSE: a pixel covers too much ground.
        OCCLUDED: none of these; the ray decides.
    """
    if sight.kind == DISC:
        return OCCLUDED if horizontal2 <= sight.reach_m * sight.reach_m else NOT_IN_RANGE
    if distance2 > sight.reach_m * sight.reach_m:
        return NOT_IN_RANGE
    if sight.kind == SPHERE:
        return OCCLUDED
    if sight.kind == CONE:
        if depth <= 0.0 or distance2 > depth * depth * (1.0 + sight.tan_half_fov * sight.tan_half_fov):
            return NOT_IN_RANGE
    # In this form, because a comparison with NaN is False.
    elif not (depth > 0.0 and abs(across) <= depth * sight.tan_half_fov and abs(along) <= depth * sight.tan_half_along):
        return NOT_IN_RANGE
    if facing < sight.cos_max_incidence * math.sqrt(distance2):
        return TOO_OBLIQUE
    limit = sight.sample_focal_m
    if limit < math.inf and depth * depth * depth > limit * limit * facing:
        return TOO_COARSE
    return OCCLUDED


@kernel
def ground_sample_m(focal_px: float, depth: float, facing: float) -> float:
    """Side of the square of ground that one pixel of a rectilinear camera covers.

    A pixel off the axis by the angle t fills the solid angle cos(t)^3 / f^2; at distance d on ground of incidence i that is an
    area of d^2 cos(t)^3 / (f^2 cos(i)) = depth^3 / (f^2 facing). On flat ground below a level camera this is height / f in the
    whole photo.

    Args:
        focal_px: f, focal length in pixels.
        depth: d cos(t), metres.
        facing: d cos(i), metres, above 0.
    """
    return depth / focal_px * math.sqrt(depth / facing)


@kernel
def horizontal_reach(sight: Sight) -> float:
    """Largest horizontal distance at which a sensor on a level vehicle observes anything, metres.

    For a cone that is range sin(half angle). The ray of a frustum that leaves the vertical most goes to one of its upper corners:
    the rays within an angle of the vertical are convex, so the corners decide.
    """
    if sight.kind == CONE:
        return sight.reach_m * sight.tan_half_fov / math.sqrt(1.0 + sight.tan_half_fov * sight.tan_half_fov)
    if sight.kind != FRUSTUM:
        return sight.reach_m
    highest = sight.sin_pitch + sight.tan_half_along * sight.cos_pitch
    if highest >= 0.0:
        return sight.reach_m
    corner2 = 1.0 + sight.tan_half_fov * sight.tan_half_fov + sight.tan_half_along * sight.tan_half_along
    return sight.reach_m * math.sqrt(max(0.0, 1.0 - highest * highest / corner2))


@kernel
def widest_tangent(sight: Sight) -> float:
    """Tangent of the largest angle between the vertical and a ray of a level vehicle's sensor; infinite for a ball."""
    if sight.kind == CONE:
        return sight.tan_half_fov
    reach = horizontal_reach(sight)
    return reach / math.sqrt(max(0.0, sight.reach_m**2 - reach * reach)) if reach < sight.reach_m else math.inf


@allocating_kernel
def highest_in_squares(
    surface: Surface, east0: float, north0: float, side: float, count: int, beside: float
) -> NDArray[np.float64]:
    """(count, count) upper bound of the ground of a grid in or beside squares of the map; rows go north.

    The box around a square on the grid is cut along its node lines: in each part the ground is bilinear, and highest at a corner.
    Cells without data are left out; NaN if nothing is left.

    Args:
        surface: a grid.
        east0: of the south-west corner of the first square.
        north0: the same.
        side: of the squares.
        count: of rows and of columns.
        beside: metres around each square that belong to it.
    """
    grid, z = surface.grid, surface.up_m
    rows, columns = z.shape
    out = np.full((count, count), np.nan)
    for i in range(count):
        for j in range(count):
            first_u, last_u, first_v, last_v = math.inf, -math.inf, math.inf, -math.inf
            for corner in range(4):
                e = east0 + (j + corner % 2) * side
                n = north0 + (i + corner // 2) * side
                u, v = on_grid(grid, e, n, grid.level_up_m)
                first_u, last_u = min(first_u, u), max(last_u, u)
                first_v, last_v = min(first_v, v), max(last_v, v)
            first_u = max(0.0, first_u - grid.leeway - beside * grid.per_column)
            last_u = min(columns - 1.0, last_u + grid.leeway + beside * grid.per_column)
            first_v = max(0.0, first_v - grid.leeway - beside * grid.per_row)
            last_v = min(rows - 1.0, last_v + grid.leeway + beside * grid.per_row)
            if first_u > last_u or first_v > last_v:
                continue
            for cell_v in range(min(int(first_v), rows - 2), min(int(last_v), rows - 2) + 1):
                for cell_u in range(min(int(first_u), columns - 2), min(int(last_u), columns - 2) + 1):
                    west, east = max(first_u, float(cell_u)), min(last_u, cell_u + 1.0)
                    near, far = max(first_v, float(cell_v)), min(last_v, cell_v + 1.0)
                    up = max(
                        max(in_cell(z, cell_v, cell_u, west, near), in_cell(z, cell_v, cell_u, east, near)),
                        max(in_cell(z, cell_v, cell_u, west, far), in_cell(z, cell_v, cell_u, east, far)),
                    )
                    if not math.isnan(up) and not up <= out[i, j]:
                        out[i, j] = up
    return out

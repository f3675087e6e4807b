"""The cells of an area, and whether ground or obstacles stand between a cell and a position.

The cells are on a square lattice: ``lattice`` maps its rows and columns to cell numbers, -1 without a cell.

The surroundings of a cell decide most rays: its horizon and skyline of obstacles, the steepest ground anywhere, and the rise of
the ground in each sector. The other rays are traced at their full length and in closed form.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.arrays import Point
from uavcover.kernels.horizon import CLEAR_FROM, HIDDEN_BELOW, HIDDEN_BEYOND_M, SECTORS, sector_of
from uavcover.kernels.jit import kernel
from uavcover.kernels.obstacles import keeps_clear
from uavcover.kernels.sight import MIDPOINT, NO_LINE_OF_SIGHT, RAY, Sight
from uavcover.kernels.skyline import CLEAR, HIDDEN, NO_SKYLINES, UNDECIDED, Skylines, beyond_skyline, skyline_row
from uavcover.kernels.surface import Surface, has_node_cell, height_above, stays_above

NO_RISE = np.empty((0, 3, SECTORS), dtype=np.float32)
NO_RISE.flags.writeable = False


class Cells(NamedTuple):
    """The cells of an area.

    Attributes:
        east0_m: east of the centre of lattice column 0.
        north0_m: north of the centre of lattice row 0.
        size_m: side of a cell.
        lattice: (rows, columns) int32, number of the cell or -1.
        centre_m: (n, 3) centres on the ground, or on the roof of what stands there.
        normal: (n, 3) unit normals of the ground, or of the roof.
        horizon: (n,) tangent of the slope above which no obstacle in the sensor's reach can hide the cell; 0 if none is near.
        scatter_m: no centre is farther than this from its place on the lattice, on the map.
        rise: (n, 3, 16) of :func:`uavcover.kernels.horizon.rises` within the sensor's reach; (0, 3, 16) if unknown.
        skylines: of the cells that obstacles may hide.
    """

    east0_m: float
    north0_m: float
    size_m: float
    lattice: NDArray[np.int32]
    centre_m: NDArray[np.float64]
    normal: NDArray[np.float64]
    horizon: NDArray[np.float64]
    scatter_m: float = 0.0
    rise: NDArray[np.float32] = NO_RISE
    skylines: Skylines = NO_SKYLINES


GRAZING_M = 1e-6
"""A ray that dips below the ground by no more than this still observes: the target itself lies on the ground."""

PAST_OBSTACLES = 3
"""In addition to UNDECIDED, CLEAR and HIDDEN of a skyline: the ground may block the ray."""


class AroundCell(NamedTuple):
    """The surroundings of a cell; tangents.

    Attributes:
        horizon: rays at least this steep pass over all obstacles.
        row: of its skyline, -1 without one.
        steepest: rays at least this steep are clear of the ground.
        rises: whether rays at least as steep as the cell's ``rise`` in their sector are clear, too.
    """

    horizon: float
    row: int
    steepest: float
    rises: bool


@kernel
def in_line_of_sight(surface: Surface, sight: Sight, eye: NDArray[np.float64], centre: NDArray[np.float64]) -> bool:
    """Whether neither ground nor an obstacle stands between ``eye`` (3,) and the centre (3,) of a cell."""
    p, q = (eye[0], eye[1], eye[2]), (centre[0], centre[1], centre[2])
    return _nothing_between(surface, sight, False, p, q)


@kernel
def surroundings(surface: Surface, sight: Sight, cells: Cells, cell: int, over_nodes: bool) -> AroundCell:
    """The surroundings of a cell; ``over_nodes``: whether all positions are over the nodes of the ground."""
    if sight.line_of_sight == RAY:
        rises = over_nodes and cells.rise.shape[0] > 0
        steepest = surface.steepest if over_nodes else math.inf
        return AroundCell(cells.horizon[cell], skyline_row(cells.skylines, cell), steepest, rises)
    if sight.line_of_sight == NO_LINE_OF_SIGHT:
        return AroundCell(-math.inf, -1, -math.inf, False)
    return AroundCell(math.inf, -1, math.inf, False)


@kernel
def known_of_sight(
    around: AroundCell,
    bounds: NDArray[np.float32],
    rise: NDArray[np.float32],
    cell: int,
    east: float,
    north: float,
    up: float,
) -> int:
    """Decide the line of sight from a cell without examining the ground or obstacles.

    Args:
        around: the cell's.
        bounds: of the skylines.
        rise: of the cells.
        cell: its number.
        east: from the cell to the position, metres.
        north: the same.
        up: the same.

    Returns:
        CLEAR; PAST_OBSTACLES if only the ground may block the ray; HIDDEN; or UNDECIDED.
    """
    over_ground = math.sqrt(east * east + north * north)
    if not up >= around.horizon * over_ground:
        past = UNDECIDED if around.row < 0 else beyond_skyline(bounds, around.row, east, north, up)
        if past != CLEAR:
            return past
    # A ray that is steeper than the ground can rise below it is clear.
    if up >= around.steepest * over_ground:
        return CLEAR
    if around.rises:
        sector = sector_of(east, north)
        if up >= rise[cell, CLEAR_FROM, sector] * over_ground:
            return CLEAR
        if over_ground >= rise[cell, HIDDEN_BEYOND_M, sector] and up < rise[cell, HIDDEN_BELOW, sector] * over_ground:
            return HIDDEN
    return PAST_OBSTACLES


@kernel
def cell_in_line_of_sight(surface: Surface, sight: Sight, cells: Cells, cell: int, eye: Point) -> bool:
    """:func:`in_line_of_sight` of a cell, with its surroundings."""
    ce, cn, cu = cells.centre_m[cell, 0], cells.centre_m[cell, 1], cells.centre_m[cell, 2]
    around = surroundings(surface, sight, cells, cell, has_node_cell(surface, eye[0], eye[1], eye[2]))
    known = known_of_sight(around, cells.skylines.bounds, cells.rise, cell, eye[0] - ce, eye[1] - cn, eye[2] - cu)
    if known in (CLEAR, HIDDEN):
        return known == CLEAR
    return _nothing_between(surface, sight, known == PAST_OBSTACLES, eye, (ce, cn, cu))


@kernel
def _nothing_between(surface: Surface, sight: Sight, past_obstacles: bool, eye: Point, centre: Point) -> bool:
    """:func:`in_line_of_sight` by coordinates; ``past_obstacles``: whether no obstacle is known to be in the way."""
    (ee, en, eu), (ce, cn, cu) = eye, centre
    if sight.line_of_sight == RAY:
        if not past_obstacles and not keeps_clear(surface.obstacles, eye, centre, 0.0, 0.0):
            return False
        if eu - cu >= surface.steepest * math.hypot(ee - ce, en - cn) and has_node_cell(surface, ee, en, eu):
            return True
        return stays_above(surface, ee, en, eu, ce, cn, cu, -GRAZING_M)
    if sight.line_of_sight == MIDPOINT:
        return bool(height_above(surface, 0.5 * (ee + ce), 0.5 * (en + cn), 0.5 * (eu + cu)) >= 0.0)
    return True

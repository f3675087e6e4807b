"""The problem of the local search and its hard limits, as arrays and numbers for the kernels."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.cells import Cells
from uavcover.kernels.jit import kernel
from uavcover.kernels.nadir_visibility import ConeCells
from uavcover.kernels.obstacles import keeps_clear
from uavcover.kernels.picture_visibility import PictureCells
from uavcover.kernels.sight import Sight
from uavcover.kernels.surface import Surface, height_above, height_range_between
from uavcover.kernels.way_cost import SHORTEST, WayCost

AT_WAYPOINTS = 0
ALONG_PATH = 1

_HEIGHT_TOLERANCE_M = 1e-7


class RouteLimits(NamedTuple):
    """Hard limits of a route.

    Attributes:
        lowest_agl_m: above ground, margins taken off.
        highest_agl_m: above ground.
        lowest_up_m: local up coordinate; -inf for none.
        highest_up_m: inf for none.
        max_slope: tangent of the steepest leg.
        legs: 1 when heights, slopes and fence hold for every leg at its full length, 0 for the waypoints alone.
        fence_m: (k, 2) corners of the fence, east and north.
        beside_m: clearance beside the obstacles on the surface.
        above_m: clearance above their tops.
    """

    lowest_agl_m: float
    highest_agl_m: float
    lowest_up_m: float
    highest_up_m: float
    max_slope: float
    legs: int
    fence_m: NDArray[np.float64]
    beside_m: float = 0.0
    above_m: float = 0.0


class SearchProblem(NamedTuple):
    """The problem of a local search: ground, sensor, cells and limits.

    Attributes:
        surface: the ground.
        sight: the sensor.
        cells: of the area.
        cone_cells: the cells for the fast path of a nadir camera.
        picture_cells: those for the fast path of a camera with a rectangular picture.
        square: (n,) place of each cell on the lattice, row * columns + column.
        weight: (rows * columns,) share of the cell in each square, of a sum of 1; 0 where none counts.
        spacing_m: largest distance between observations along the path.
        sensing: AT_WAYPOINTS or ALONG_PATH.
        limits: hard limits of places and legs.
        way: what the way costs.
        needed: observations after which a cell counts as seen; more than 1 goes with AT_WAYPOINTS.
        apart_m: smallest distance between any two waypoints, so that each is an observation of its own; 0: any.
        trigger_m: distance between two pictures, where a camera takes them by distance instead; 0: it does not.
    """

    surface: Surface
    sight: Sight
    cells: Cells
    cone_cells: ConeCells
    picture_cells: PictureCells
    square: NDArray[np.int32]
    weight: NDArray[np.float64]
    spacing_m: float
    sensing: int
    limits: RouteLimits
    way: WayCost = SHORTEST
    needed: int = 1
    apart_m: float = 0.0
    trigger_m: float = 0.0


@kernel
def place(array: NDArray[np.float64], row: int) -> tuple[float, float, float]:
    """Row of an (n, 3) array as three numbers."""
    return array[row, 0], array[row, 1], array[row, 2]


@kernel
def distance(p: tuple[float, float, float], q: tuple[float, float, float]) -> float:
    """Distance between two places, metres."""
    return math.sqrt((p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2 + (p[2] - q[2]) ** 2)


@kernel
def inside_fence(fence: NDArray[np.float64], east: float, north: float) -> bool:
    """Whether a place lies inside a ring of corners (even-odd rule)."""
    inside = False
    j = fence.shape[0] - 1
    for i in range(fence.shape[0]):
        if (fence[i, 1] > north) != (fence[j, 1] > north):
            at = fence[i, 0] + (north - fence[i, 1]) / (fence[j, 1] - fence[i, 1]) * (fence[j, 0] - fence[i, 0])
            if east < at:
                inside = not inside
        j = i
    return inside


@kernel
def allowed_place(problem: SearchProblem, p: tuple[float, float, float]) -> bool:
    """Whether a place is allowed for a waypoint."""
    limits = problem.limits
    agl = height_above(problem.surface, p[0], p[1], p[2])
    # A comparison with NaN is False: no elevation data, no waypoint.
    if not (limits.lowest_agl_m <= agl <= limits.highest_agl_m and limits.lowest_up_m <= p[2] <= limits.highest_up_m):
        return False
    return inside_fence(limits.fence_m, p[0], p[1]) and _clear_of_obstacles(problem, p, p)


@kernel
def allowed_leg(problem: SearchProblem, p: tuple[float, float, float], q: tuple[float, float, float]) -> bool:
    """Whether a leg between two allowed waypoints may be flown, at its full length."""
    limits = problem.limits
    if limits.legs == 0:
        return True
    if abs(q[2] - p[2]) > limits.max_slope * math.hypot(q[0] - p[0], q[1] - p[1]):
        return False
    if _crosses(limits.fence_m, p, q) or not _clear_of_obstacles(problem, p, q):
        return False
    low, _, high, _ = height_range_between(
        problem.surface, p[0], p[1], p[2], q[0], q[1], q[2], limits.lowest_agl_m - _HEIGHT_TOLERANCE_M
    )
    return bool(low >= limits.lowest_agl_m - _HEIGHT_TOLERANCE_M and high <= limits.highest_agl_m + _HEIGHT_TOLERANCE_M)


@kernel
def _clear_of_obstacles(problem: SearchProblem, p: tuple[float, float, float], q: tuple[float, float, float]) -> bool:
    """Whether the straight line p-q keeps its clearance from all obstacles."""
    limits = problem.limits
    return keeps_clear(problem.surface.obstacles, p, q, limits.beside_m, limits.above_m)


@kernel
def _crosses(fence: NDArray[np.float64], p: tuple[float, float, float], q: tuple[float, float, float]) -> bool:
    """Whether the straight line p-q crosses an edge of the ring."""
    j = fence.shape[0] - 1
    for i in range(fence.shape[0]):
        ae, an, be, bn = fence[j, 0], fence[j, 1], fence[i, 0], fence[i, 1]
        side_a = (q[0] - p[0]) * (an - p[1]) - (q[1] - p[1]) * (ae - p[0])
        side_b = (q[0] - p[0]) * (bn - p[1]) - (q[1] - p[1]) * (be - p[0])
        side_p = (be - ae) * (p[1] - an) - (bn - an) * (p[0] - ae)
        side_q = (be - ae) * (q[1] - an) - (bn - an) * (q[0] - ae)
        if side_a * side_b < 0.0 and side_p * side_q < 0.0:
            return True
        j = i
    return False

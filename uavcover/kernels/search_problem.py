"""The problem of the local search and its hard limits, as arrays and numbers for the kernels."""

import math
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from uavcover.kernels.cells import Cells
from uavcover.kernels.jit import allocating_kernel, kernel
from uavcover.kernels.nadir_visibility import ConeCells
from uavcover.kernels.obstacles import keeps_clear
from uavcover.kernels.path_cost import SHORTEST, PathCost
from uavcover.kernels.photo_visibility import PhotoCells
from uavcover.kernels.sight import Sight
from uavcover.kernels.surface import Surface, height_above, height_range_between

AT_WAYPOINTS = 0
ALONG_PATH = 1

_HEIGHT_TOLERANCE_M = 1e-7
_ROUNDING = 1e-9


class FlyableGround(NamedTuple):
    """A polygon with holes, its edges in an index of square tiles: a no-fly zone far away costs nothing.

    Attributes:
        edges_m: (k, 4) east and north of both ends of the edges that meet a tile, tile after tile.
        tiles: (rows * columns + 1, 2) where the edges of each tile begin, and 1 where its middle is inside the polygon.
        west_m: east of the western end of the tiles.
        south_m: north of their southern end.
        tile_m: side of a tile.
        columns: of tiles.
    """

    edges_m: NDArray[np.float64]
    tiles: NDArray[np.int64]
    west_m: float
    south_m: float
    tile_m: float
    columns: int


_MOST_ACROSS = 64


def flyable_ground(polygon: shapely.Polygon) -> FlyableGround:
    """Index the edges of a polygon; it may be empty."""
    rings = [np.asarray(ring.coords)[:, :2] for ring in (polygon.exterior, *polygon.interiors) if not ring.is_empty]
    edges = np.vstack([np.empty((0, 4)), *(np.hstack([ring[:-1], ring[1:]]) for ring in rings)])
    west, south, east, north = polygon.bounds if rings else (0.0, 0.0, 1.0, 1.0)
    tile = max(east - west, north - south) / min(_MOST_ACROSS, math.isqrt(len(edges)) + 1)
    rows, columns = math.floor((north - south) / tile) + 1, math.floor((east - west) / tile) + 1
    row, column = np.divmod(np.arange(rows * columns), columns)
    middle_m = np.column_stack([west + (column + 0.5) * tile, south + (row + 0.5) * tile])
    tiles = np.zeros((rows * columns + 1, 2), dtype=np.int64)
    tiles[:-1, 1] = shapely.contains_xy(polygon, middle_m)
    tile_of, edge_of = _edges_of_tiles(np.ascontiguousarray(edges - (west, south, west, south)) / tile, rows, columns)
    order = np.argsort(tile_of, kind="stable")
    tiles[1:, 0] = np.cumsum(np.bincount(tile_of, minlength=rows * columns))
    listed = np.ascontiguousarray(edges[edge_of[order]])
    for array in (listed, tiles):
        array.flags.writeable = False
    return FlyableGround(listed, tiles, float(west), float(south), float(tile), columns)


@allocating_kernel
def _edges_of_tiles(edges: NDArray[np.float64], rows: int, columns: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pairs of tiles and edges that meet: neither a side of the tile nor the edge parts the two. Ends (k, 4) are in tiles."""
    room = 16 + edges.shape[0]
    found_tile, found_edge = np.empty(room, dtype=np.int64), np.empty(room, dtype=np.int64)
    count = 0
    for k in range(edges.shape[0]):
        ax, ay, bx, by = edges[k, 0], edges[k, 1], edges[k, 2], edges[k, 3]
        widest = (0.5 + _ROUNDING) * (abs(bx - ax) + abs(by - ay))
        for row in range(
            max(0, math.floor(min(ay, by) - _ROUNDING)), min(rows - 1, math.floor(max(ay, by) + _ROUNDING)) + 1
        ):
            for column in range(
                max(0, math.floor(min(ax, bx) - _ROUNDING)), min(columns - 1, math.floor(max(ax, bx) + _ROUNDING)) + 1
            ):
                if abs((bx - ax) * (ay - row - 0.5) - (by - ay) * (ax - column - 0.5)) > widest:
                    continue
                if count == found_tile.size:
                    found_tile = np.concatenate((found_tile, found_tile))
                    found_edge = np.concatenate((found_edge, found_edge))
                found_tile[count], found_edge[count] = row * columns + column, k
                count += 1
    return found_tile[:count].copy(), found_edge[:count].copy()


class RouteLimits(NamedTuple):
    """Hard limits of a route.

    Attributes:
        lowest_agl_m: above ground, margins taken off.
        highest_agl_m: above ground.
        lowest_up_m: local up coordinate; -inf for none.
        highest_up_m: inf for none.
        max_slope: tangent of the steepest leg.
        legs: 1 when heights, slopes and fence hold for every leg at its full length, 0 for the waypoints alone.
        ground: where the route may be on the map.
        beside_m: clearance beside the obstacles on the surface.
        above_m: clearance above their tops.
    """

    lowest_agl_m: float
    highest_agl_m: float
    lowest_up_m: float
    highest_up_m: float
    max_slope: float
    legs: int
    ground: FlyableGround
    beside_m: float = 0.0
    above_m: float = 0.0


class SearchProblem(NamedTuple):
    """The problem of a local search: ground, sensor, cells and limits.

    Attributes:
        surface: the ground.
        sight: the sensor.
        cells: of the area.
        cone_cells: the cells for the fast path of a nadir camera.
        photo_cells: those for the fast path of a camera with a rectangular photo.
        square: (n,) place of each cell on the lattice, row * columns + column.
        weight: (rows * columns,) fraction of the cell in each square, of a sum of 1; 0 where none counts.
        spacing_m: largest distance between observations along the path.
        sensing: AT_WAYPOINTS or ALONG_PATH.
        limits: hard limits of places and legs.
        path_cost: cost of the path.
        needed: observations after which a cell counts as observed; more than 1 requires AT_WAYPOINTS.
        apart_m: smallest distance between any two waypoints, so that each is an observation of its own; 0: any.
        trigger_m: distance between two photos, where a camera takes them by distance instead; 0: it does not.
    """

    surface: Surface
    sight: Sight
    cells: Cells
    cone_cells: ConeCells
    photo_cells: PhotoCells
    square: NDArray[np.int32]
    weight: NDArray[np.float64]
    spacing_m: float
    sensing: int
    limits: RouteLimits
    path_cost: PathCost = SHORTEST
    needed: int = 1
    apart_m: float = 0.0
    trigger_m: float = 0.0


@kernel
def position(array: NDArray[np.float64], row: int) -> tuple[float, float, float]:
    """Row of an (n, 3) array as three numbers."""
    return array[row, 0], array[row, 1], array[row, 2]


@kernel
def distance(p: tuple[float, float, float], q: tuple[float, float, float]) -> float:
    """Distance between two places, metres."""
    return math.sqrt((p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2 + (p[2] - q[2]) ** 2)


@kernel
def is_inside(ground: FlyableGround, east: float, north: float) -> bool:
    """Whether a place lies in the polygon: as the middle of its tile, but for the edges between the two."""
    column = math.floor((east - ground.west_m) / ground.tile_m)
    row = math.floor((north - ground.south_m) / ground.tile_m)
    tile = row * ground.columns + column
    if not (0 <= column < ground.columns and 0 <= tile < ground.tiles.shape[0] - 1):
        return False
    me, mn = ground.west_m + (column + 0.5) * ground.tile_m, ground.south_m + (row + 0.5) * ground.tile_m
    de, dn = me - east, mn - north
    inside = ground.tiles[tile, 1] == 1
    for k in range(ground.tiles[tile, 0], ground.tiles[tile + 1, 0]):
        ae, an, be, bn = ground.edges_m[k, 0], ground.edges_m[k, 1], ground.edges_m[k, 2], ground.edges_m[k, 3]
        # An end of an edge on the line belongs to one side of it, so that two edges that meet there count once.
        a_left = de * (an - north) - dn * (ae - east) > 0.0
        b_left = de * (bn - north) - dn * (be - east) > 0.0
        if a_left != b_left:
            position = (be - ae) * (north - an) - (bn - an) * (east - ae)
            middle = (be - ae) * (mn - an) - (bn - an) * (me - ae)
            if (position > 0.0) != (middle > 0.0):
                inside = not inside
    return bool(inside)


@kernel
def allowed_position(problem: SearchProblem, p: tuple[float, float, float]) -> bool:
    """Whether a waypoint may be at a position."""
    limits = problem.limits
    agl = height_above(problem.surface, p[0], p[1], p[2])
    # A comparison with NaN is False: no elevation data, no waypoint.
    if not (limits.lowest_agl_m <= agl <= limits.highest_agl_m and limits.lowest_up_m <= p[2] <= limits.highest_up_m):
        return False
    return is_inside(limits.ground, p[0], p[1]) and _clear_of_obstacles(problem, p, p)


@kernel
def allowed_leg(problem: SearchProblem, p: tuple[float, float, float], q: tuple[float, float, float]) -> bool:
    """Whether a leg between two permitted waypoints keeps the limits along its full length."""
    limits = problem.limits
    if limits.legs == 0:
        return True
    if abs(q[2] - p[2]) > limits.max_slope * math.hypot(q[0] - p[0], q[1] - p[1]):
        return False
    if crosses_edge(limits.ground, p, q) or not _clear_of_obstacles(problem, p, q):
        return False
    low, _, high, _ = height_range_between(
        problem.surface, p[0], p[1], p[2], q[0], q[1], q[2], limits.lowest_agl_m - _HEIGHT_TOLERANCE_M
    )
    return bool(low >= limits.lowest_agl_m - _HEIGHT_TOLERANCE_M and high <= limits.highest_agl_m + _HEIGHT_TOLERANCE_M)


@allocating_kernel
def allowed_legs(problem: SearchProblem, legs: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(n,) which of (n, 6) legs, east, north, up of both ends, keep the limits."""
    out = np.empty(legs.shape[0], dtype=np.bool_)
    for k in range(legs.shape[0]):
        p, q = (legs[k, 0], legs[k, 1], legs[k, 2]), (legs[k, 3], legs[k, 4], legs[k, 5])
        out[k] = allowed_position(problem, p) and allowed_position(problem, q) and allowed_leg(problem, p, q)
    return out


@kernel
def _clear_of_obstacles(problem: SearchProblem, p: tuple[float, float, float], q: tuple[float, float, float]) -> bool:
    """Whether the straight line p-q keeps its clearance from all obstacles."""
    limits = problem.limits
    return keeps_clear(problem.surface.obstacles, p, q, limits.beside_m, limits.above_m)


@kernel
def crosses_edge(ground: FlyableGround, p: tuple[float, float, float], q: tuple[float, float, float]) -> bool:
    """Whether the straight line p-q on the map crosses an edge of the polygon."""
    x0, y0 = (p[0] - ground.west_m) / ground.tile_m, (p[1] - ground.south_m) / ground.tile_m
    x1, y1 = (q[0] - ground.west_m) / ground.tile_m, (q[1] - ground.south_m) / ground.tile_m
    rows = (ground.tiles.shape[0] - 1) // ground.columns
    for row in range(max(0, math.floor(min(y0, y1))), min(rows - 1, math.floor(max(y0, y1))) + 1):
        # The part of the line in this row of tiles.
        begin, end = 0.0, 1.0
        if y1 != y0:
            t0, t1 = (row - y0) / (y1 - y0), (row + 1 - y0) / (y1 - y0)
            begin, end = max(0.0, min(t0, t1)), min(1.0, max(t0, t1))
        xa, xb = x0 + begin * (x1 - x0), x0 + end * (x1 - x0)
        first = row * ground.columns + max(0, math.floor(min(xa, xb) - _ROUNDING))
        last = row * ground.columns + min(ground.columns - 1, math.floor(max(xa, xb) + _ROUNDING))
        if first > last:
            continue
        for k in range(ground.tiles[first, 0], ground.tiles[last + 1, 0]):
            ae, an, be, bn = ground.edges_m[k, 0], ground.edges_m[k, 1], ground.edges_m[k, 2], ground.edges_m[k, 3]
            side_a = (q[0] - p[0]) * (an - p[1]) - (q[1] - p[1]) * (ae - p[0])
            side_b = (q[0] - p[0]) * (bn - p[1]) - (q[1] - p[1]) * (be - p[0])
            side_p = (be - ae) * (p[1] - an) - (bn - an) * (p[0] - ae)
            side_q = (be - ae) * (q[1] - an) - (bn - an) * (q[0] - ae)
            if side_a * side_b < 0.0 and side_p * side_q < 0.0:
                return True
    return False

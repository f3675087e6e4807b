"""Heights for the bound on path length: ground that is nowhere too high, highest places that are nowhere too low."""

import math

import numpy as np
import scipy
import shapely

from uavcover.extras.bounds.relief import LEAST_GROWTH, Relief
from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.kernels.sight import CONE, highest_in_squares, horizontal_reach
from uavcover.kernels.surface import GRID
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.sensors import any_heading

_PARTS = 8
"""Parts of a square's side, at which heights between its nodes are tried."""
_ROWS_AT_ONCE = 64
_LEEWAY_M = 0.01
"""Against rounding in the tests of sensor and height band."""


def margin_cells(coverage: CoverageMap) -> int:
    """Cells around the area: places from which it can be observed, and what else can be observed from there."""
    return math.ceil(2.0 * horizontal_reach(any_heading(coverage.sight)) / coverage.grid.cells.size_m) + 5


def relief_over(coverage: CoverageMap, parts: int) -> Relief:
    """Heights on a lattice of ``parts`` squares a cell's side. Its first node is ``margin_cells`` south-west of the area."""
    site, cells = coverage.site, coverage.grid.cells
    sight, limits = any_heading(coverage.sight), site.scenario.limits
    side, margin = cells.size_m / parts, margin_cells(coverage)
    # Where limits apply to waypoints alone, legs may be at any height.
    cone = sight.kind == CONE and limits.applies_to == "legs"
    east0 = cells.east0_m - (margin + 0.5) * cells.size_m
    north0 = cells.north0_m - (margin + 0.5) * cells.size_m
    rows, columns = ((count + 2 * margin) * parts for count in cells.lattice.shape)
    east, north = east0 + side * np.arange(columns + 1), north0 + side * np.arange(rows + 1)
    ground = np.zeros((rows + 1, columns + 1))
    known: BoolArray = np.ones((rows, columns), dtype=bool)
    allowed = known
    if limits.applies_to == "legs":
        # A square that touches the fence has its centre within 0.71 sides of it; mitred corners reach further.
        near = site.fence.buffer(0.75 * side, join_style="mitre")
        shapely.prepare(near)
        middle_e, middle_n = np.meshgrid(east[:-1] + 0.5 * side, north[:-1] + 0.5 * side)
        allowed = np.asarray(shapely.contains_xy(near, middle_e, middle_n), dtype=bool)
    if not cone:
        return Relief(ground, ground, allowed, side, 0.0, horizontal_reach(sight) + _LEEWAY_M)
    ground = site.ground.heights_m(np.column_stack([a.ravel() for a in np.meshgrid(east, north)])).reshape(ground.shape)
    missing = ~np.isfinite(ground)
    if missing.any():
        nearest = scipy.ndimage.distance_transform_edt(missing, return_distances=False, return_indices=True)
        ground = ground[tuple(nearest)]
    above_m, below_m = _departures_m(coverage, ground, east0, north0, side)
    highest_agl_m = limits.max_height_agl_m - limits.height_margin_m
    top = ground + (highest_agl_m + site.ground.cut_error_m + _LEEWAY_M + above_m)
    low = _no_steeper(ground - below_m, (1.0 - LEAST_GROWTH) / (math.sqrt(2.0) * sight.tan_half_fov) * side)
    return Relief(low, top, allowed, side, sight.tan_half_fov, horizontal_reach(sight) + _LEEWAY_M)


def _no_steeper(up: FloatArray, most_m: float) -> FloatArray:
    """Heights that are nowhere above these and change by at most so much from node to node."""
    for axis in (0, 1):
        ramp = most_m * np.arange(up.shape[axis])
        ramp = ramp[:, None] if axis == 0 else ramp
        ahead = np.minimum.accumulate(up - ramp, axis=axis) + ramp
        behind = np.flip(np.minimum.accumulate(np.flip(up + ramp, axis=axis), axis=axis), axis=axis) - ramp
        up = np.minimum(ahead, behind)
    return up


def _departures_m(
    coverage: CoverageMap, ground: FloatArray, east0: float, north0: float, side: float
) -> tuple[FloatArray, FloatArray]:
    """Limits, at the nodes, of the ground's rise above and fall below the interpolation between the nodes."""
    surface = coverage.site.ground.surface
    lean = surface.grid.lean if surface.kind == GRID else 0.0
    # Plumb lines lean: above its ground a place of the band may stand a little aside of it, and so a little higher.
    aside_m = lean * coverage.site.scenario.limits.max_height_agl_m
    part = side / _PARTS
    if not math.isfinite(surface.steepest):
        return _departures_by_squares(coverage, ground, east0, north0, side, aside_m)
    above, below = np.zeros((2, ground.shape[0] - 1, ground.shape[1] - 1))
    for first in range(0, ground.shape[0] - 1, _ROWS_AT_ONCE):
        nodes = ground[first : first + _ROWS_AT_ONCE + 1]
        between = _between(nodes, _PARTS)
        e, n = np.meshgrid(
            east0 + part * np.arange(between.shape[1]), north0 + first * side + part * np.arange(between.shape[0])
        )
        off = coverage.site.ground.heights_m(np.column_stack([e.ravel(), n.ravel()])).reshape(e.shape) - between
        above[first : first + _ROWS_AT_ONCE] = _largest_in_squares(off)
        below[first : first + _ROWS_AT_ONCE] = _largest_in_squares(-off)
    # In a triangle with legs of one part a surface is that near to the plane through its corners.
    between_m = math.sqrt(0.5) * surface.steepest * part
    return over_tiles(above) + (between_m + surface.steepest * aside_m), over_tiles(below) + between_m


def _largest_in_squares(values: FloatArray) -> FloatArray:
    """(rows, columns) the largest of the parts' corners in each square, 0 at least; NaN is none."""
    rows, columns = (count // _PARTS for count in values.shape)
    largest = np.zeros((rows, columns))
    for i in range(_PARTS + 1):
        for j in range(_PARTS + 1):
            corners = values[i : i + (rows - 1) * _PARTS + 1 : _PARTS, j : j + (columns - 1) * _PARTS + 1 : _PARTS]
            np.fmax(largest, corners, out=largest)
    return largest


def over_tiles(squares: FloatArray, tile: int = 16) -> FloatArray:
    """(rows + 1, columns + 1) numbers at the nodes, nowhere below those of the squares (rows, columns) around them.

    Bilinear over tiles of squares. Each corner of a tile has the largest number of the tiles that meet there.
    """
    rows, columns = (math.ceil(count / tile) for count in squares.shape)
    padded = np.pad(squares, [(0, rows * tile - squares.shape[0]), (0, columns * tile - squares.shape[1])])
    tiles = np.pad(padded.reshape(rows, tile, columns, tile).max(axis=(1, 3)), 1)
    corners = np.stack([tiles[:-1, :-1], tiles[1:, :-1], tiles[:-1, 1:], tiles[1:, 1:]]).max(axis=0)
    i, j = np.arange(squares.shape[0] + 1) / tile, np.arange(squares.shape[1] + 1) / tile
    south, west = np.minimum(i.astype(np.int64), rows - 1), np.minimum(j.astype(np.int64), columns - 1)
    up, along = (i - south)[:, None], j - west
    lower = (1.0 - along) * corners[np.ix_(south, west)] + along * corners[np.ix_(south, west + 1)]
    upper = (1.0 - along) * corners[np.ix_(south + 1, west)] + along * corners[np.ix_(south + 1, west + 1)]
    numbers: FloatArray = (1.0 - up) * lower + up * upper
    return numbers


def _between(nodes: FloatArray, parts: int) -> FloatArray:
    """Heights of the triangles at ``parts`` positions along the sides of squares."""
    rows, columns = (count - 1 for count in nodes.shape)
    n, e = np.arange(rows * parts + 1), np.arange(columns * parts + 1)
    i, j = np.minimum(n // parts, rows - 1), np.minimum(e // parts, columns - 1)
    across, along = ((n - i * parts) / parts)[:, None], (e - j * parts) / parts
    sw, se = nodes[np.ix_(i, j)], nodes[np.ix_(i, j + 1)]
    nw, ne = nodes[np.ix_(i + 1, j)], nodes[np.ix_(i + 1, j + 1)]
    lower = sw + along * (se - sw) + across * (ne - se)
    upper = sw + along * (ne - nw) + across * (nw - sw)
    heights: FloatArray = np.where(along >= across, lower, upper)
    return heights


def _departures_by_squares(
    coverage: CoverageMap, ground: FloatArray, east0: float, north0: float, side: float, aside_m: float
) -> tuple[FloatArray, FloatArray]:
    """The same without a known steepest slope, on a grid: from the highest and lowest ground in parts of squares."""
    surface = coverage.site.ground.surface
    rows, columns = ((count - 1) * _PARTS for count in ground.shape)
    count, part = max(rows, columns), side / _PARTS
    between = _between(ground, _PARTS)
    corners = np.stack([between[:-1, :-1], between[1:, :-1], between[:-1, 1:], between[1:, 1:]])
    highest = highest_in_squares(surface, east0, north0, part, count, aside_m)[:rows, :columns]
    mirrored = surface._replace(up_m=-surface.up_m)
    lowest = -highest_in_squares(mirrored, east0, north0, part, count, 0.0)[:rows, :columns]
    above, below = highest - corners.min(axis=0), corners.max(axis=0) - lowest
    shape = (ground.shape[0] - 1, _PARTS, ground.shape[1] - 1, _PARTS)
    in_squares = [np.fmax(0.0, values).reshape(shape).max(axis=(1, 3)) for values in (above, below)]
    return over_tiles(in_squares[0]), over_tiles(in_squares[1])

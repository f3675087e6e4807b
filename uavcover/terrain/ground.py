"""The ground of a scenario: one surface in the local frame for every module; and filled gaps of heights."""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely.geometry.base import BaseGeometry

from mission_io.data_tables import data_table
from uavcover.errors import TerrainError
from uavcover.kernels import surface as kernels
from uavcover.kernels.arrays import BoolArray, ByteArray, FloatArray, read_only
from uavcover.kernels.grid import GridFrame, square_frame, steepest_slope
from uavcover.kernels.obstacles import roofs_m
from uavcover.kernels.surface import GRID, SINE_COSINE, Surface
from uavcover.terrain.frames import nodes_between, positions_of_nodes_m


@dataclass(frozen=True, slots=True, kw_only=True)
class _Relief:
    light_azimuth_deg: float
    light_elevation_deg: float
    ambient: float
    smooth_steps: float


RELIEF = data_table(_Relief, "uavcover/data/terrain.toml", "relief")


@dataclass(frozen=True, eq=False)
class Ground:
    """A height surface with its provenance."""

    surface: Surface  # the surface as kernels take it
    source: str  # its origin, as text
    vertical_datum: str  # reference of the source's heights
    sha256: str = ""  # hash of the source file, empty for a computed surface
    # largest measured difference between the surface and the file's own bilinear surface, metres; 0 for a computed
    # surface
    error_m: float = 0.0
    # largest difference between heights above ground along a leg and along the parts it is cut into
    cut_error_m: float = 0.0
    surface_sha256: str = ""  # hash of the surface model's file that lies over it, empty without one
    # parts of the map with rejected heights, each with the reason; they have no data
    left_out: tuple[tuple[BaseGeometry, str], ...] = ()

    def without(self, parts: Sequence[tuple[BaseGeometry, str]]) -> "Ground":
        """The same without the heights of parts of the map, (east, north) metres, each with its reason in words."""
        grid, up = self.surface.grid, np.array(self.surface.up_m)
        for shape, _ in parts:
            columns, rows = (np.arange(*ends) for ends in nodes_between(grid, up, shape.bounds))
            nodes = np.array([axis.ravel() for axis in np.meshgrid(columns, rows)], dtype=float).T.reshape(-1, 2)
            if len(nodes):
                positions = positions_of_nodes_m(grid, nodes, up[rows[:, None], columns].reshape(-1))
                inside = shapely.intersects_xy(shape, positions[:, 0], positions[:, 1]).reshape(len(rows), len(columns))
                up[rows[:, None], columns] = np.where(inside, np.nan, up[rows[:, None], columns])
        up.flags.writeable = False
        return dataclasses.replace(self, surface=self.surface._replace(up_m=up), left_out=tuple(parts))

    def heights_m(self, east_north_m: ArrayLike) -> FloatArray:
        """Up coordinates (n,) of the ground at (n, 2) positions, metres; NaN without data."""
        en = np.atleast_2d(np.asarray(east_north_m, float))
        return kernels.heights(self.surface, read_only(en[:, 0]), read_only(en[:, 1]))

    def heights_agl_m(self, positions_m: ArrayLike) -> FloatArray:
        """Heights above ground (n,) of (n, 3) ENU positions, along their plumb lines, metres; NaN without data."""
        return kernels.heights_above(self.surface, read_only(np.atleast_2d(np.asarray(positions_m, float))))

    def ups_m(self, east_north_m: ArrayLike, height_agl_m: ArrayLike) -> FloatArray:
        """Up coordinates (n,) for (n, 2) positions and heights above ground (n,), metres; NaN without data.

        The inverse of :meth:`heights_agl_m`. Heights are along the plumb line, so this differs from ground plus height
        by centimetres some kilometres from the origin.
        """
        en = np.atleast_2d(np.asarray(east_north_m, float))
        heights = np.broadcast_to(np.asarray(height_agl_m, float), len(en))
        return kernels.ups_above(self.surface, read_only(en[:, 0]), read_only(en[:, 1]), read_only(heights))

    def gradients(self, east_north_m: ArrayLike) -> FloatArray:
        """Slopes (n, 2) of the ground towards east and north at (n, 2) positions, dimensionless."""
        en = np.atleast_2d(np.asarray(east_north_m, float))
        return kernels.gradients(self.surface, np.ascontiguousarray(en[:, 0]), np.ascontiguousarray(en[:, 1]))

    def roofs_m(self, east_north_m: ArrayLike) -> FloatArray:
        """Up coordinates (n,) of the highest obstacle at each of (n, 2) positions; -inf where there is none."""
        en = np.atleast_2d(np.asarray(east_north_m, float))
        return roofs_m(self.surface.obstacles, np.ascontiguousarray(en[:, 0]), np.ascontiguousarray(en[:, 1]))

    def leg_height_ranges_m(self, route_m: ArrayLike) -> FloatArray:
        """Lowest and largest height above ground along the full length of every leg of an (n, 3) ENU route.

        Returns:
            (n - 1, 4) smallest height, its parameter along the leg 0..1, largest height, its parameter. Rows of NaN where
            a leg leaves the data. Exact to ``cut_error_m`` for grids; see :mod:`uavcover.kernels.surface` for the analytic
            surface.
        """
        return kernels.leg_height_ranges(self.surface, read_only(np.atleast_2d(np.asarray(route_m, float))))


def sine_cosine_ground(scale_m: float) -> Ground:
    """The paper's surface, Eq. 26, with ``scale_m`` metres to its unit."""
    empty = np.zeros((1, 1))
    # Read-only like the nodes of a grid, so that kernels are compiled once for both.
    empty.flags.writeable = False
    frame = square_frame(east0_m=0.0, north0_m=0.0, step_m=1.0)
    return Ground(Surface(SINE_COSINE, scale_m, empty, 1.0, frame), "sine-cosine (paper, Eq. 26)", "local")


def grid_ground(
    up_m: FloatArray,  # (rows, columns) heights, rows going north, NaN for no-data
    *,
    east0_m: float,  # east of the first column
    north0_m: float,  # north of the first row
    step_m: float,  # spacing of the nodes
    source: str,  # shown to the user
    vertical_datum: str,  # of the source
    sha256: str = "",  # of the source
) -> Ground:
    """Make a ground from heights on a square grid along east and north.

    Heights above it are along the up axis.

    Raises:
        TerrainError: fewer than 2 x 2 nodes.
    """
    frame = square_frame(east0_m=float(east0_m), north0_m=float(north0_m), step_m=float(step_m))
    return ground_of_nodes(
        up_m, frame, step_m=float(step_m), source=source, vertical_datum=vertical_datum, sha256=sha256
    )


def ground_of_nodes(
    up_m: FloatArray,  # (rows, columns) up coordinates, NaN for no-data
    frame: GridFrame,  # the positions of the nodes
    *,
    step_m: float,  # their smallest spacing
    source: str,  # shown to the user
    vertical_datum: str,  # of the source
    sha256: str = "",  # of the source
    cut_error_m: float = 0.0,  # of the ground
) -> Ground:
    """Make a ground from heights at nodes in any arrangement. Raises TerrainError: fewer than 2 x 2 nodes."""
    nodes = np.array(up_m, dtype=float, order="C")
    if nodes.ndim != 2 or min(nodes.shape) < 2:
        raise TerrainError(f"{source}: a grid needs at least 2 x 2 nodes, but this one has {nodes.shape}")
    nodes.flags.writeable = False
    surface = Surface(GRID, step_m, nodes, steepest_slope(nodes, frame), frame)
    return Ground(surface, source, vertical_datum, sha256, cut_error_m=cut_error_m)


# Shaded relief of a rectangle of ground, sampled on a grid and coloured. Arrays only.

# Low to high, muted, so that paths and cells stand out: sage, straw, clay, stone.
_RAMP = np.array([[96, 116, 92], [150, 146, 108], [140, 116, 92], [186, 182, 178]], dtype=float)


def hillshade(gradients: FloatArray) -> FloatArray:
    """Brightness (n,) of ground with slopes (n, 2) under light from the north-west; 1 is level ground, 0 without data."""
    azimuth, elevation = math.radians(RELIEF.light_azimuth_deg), math.radians(RELIEF.light_elevation_deg)
    light = (
        math.sin(azimuth) * math.cos(elevation),
        math.cos(azimuth) * math.cos(elevation),
        math.sin(elevation),
    )
    facing = -gradients[:, 0] * light[0] - gradients[:, 1] * light[1] + light[2]
    facing = np.maximum(facing / np.sqrt(1.0 + (gradients**2).sum(axis=1)), 0.0) / light[2]
    return np.asarray(np.nan_to_num(RELIEF.ambient + (1.0 - RELIEF.ambient) * facing))


def shaded(rgb: tuple[int, int, int], brightness: FloatArray) -> ByteArray:
    """One colour (n, 3) uint8 under (n,) brightnesses."""
    return np.asarray(np.clip(np.outer(brightness, rgb), 0.0, 255.0), dtype=np.uint8)


def relief_colors(up_m: FloatArray, gradients: FloatArray) -> ByteArray:
    """Colours (n, 3) uint8 of ground with heights (n,) and slopes (n, 2): by height, under hillshade; black without data."""
    colors = _height_colors(up_m) * hillshade(gradients)[:, None]
    return np.asarray(np.clip(colors, 0.0, 255.0), dtype=np.uint8)


def _height_colors(up_m: FloatArray) -> FloatArray:
    known = up_m[np.isfinite(up_m)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)
    fraction = np.nan_to_num((up_m - low) / (high - low)) if high > low else np.zeros(up_m.size)
    stops = np.linspace(0.0, 1.0, len(_RAMP))
    return np.column_stack([np.interp(fraction, stops, _RAMP[:, channel]) for channel in range(3)])


@dataclass(frozen=True, slots=True, eq=False)
class ReliefGrid:
    """Ground on a grid; rows run north, columns east."""

    east_m: FloatArray  # (rows, columns)
    north_m: FloatArray  # (rows, columns)
    up_m: FloatArray  # (rows, columns) heights, NaN without data
    rgb: NDArray[np.uint8]  # (rows, columns, 3) uint8, black without data


def relief_grid(ground: Ground, bounds_m: tuple[float, float, float, float], *, nodes: int) -> ReliefGrid:
    """Sample a rectangle from corner to corner.

    Args:
        ground: any surface.
        bounds_m: west, south, east, north.
        nodes: number of nodes along the longer side.
    """
    west, south, east, north = bounds_m
    step = max(east - west, north - south) / (nodes - 1)
    columns = np.linspace(west, east, max(2, math.ceil((east - west) / step - 1e-9) + 1))
    rows = np.linspace(south, north, max(2, math.ceil((north - south) / step - 1e-9) + 1))
    grid_e, grid_n = np.meshgrid(columns, rows)
    positions = np.column_stack([grid_e.ravel(), grid_n.ravel()])
    up = ground.heights_m(positions)
    colors = relief_colors(up, _smooth_slopes(ground, positions))
    return ReliefGrid(grid_e, grid_n, up.reshape(grid_e.shape), colors.reshape(*grid_e.shape, 3))


def _smooth_slopes(ground: Ground, positions_m: FloatArray) -> FloatArray:
    """Slopes (n, 2) across a few steps of the grid. The ground's own slopes jump from square to square and look like tiles."""
    if ground.surface.kind != GRID:
        return ground.gradients(positions_m)
    reach = RELIEF.smooth_steps * ground.surface.step_m
    slopes = [
        (ground.heights_m(positions_m + offset) - ground.heights_m(positions_m - offset)) / (2.0 * reach)
        for offset in ((reach, 0.0), (0.0, reach))
    ]
    return np.column_stack(slopes)


# Gaps of heights, and groups of pixels.

_NEIGHBOURS = np.ones((3, 3), dtype=int)


@dataclass(frozen=True, slots=True)
class FilledGaps:
    """Heights without small gaps."""

    heights_m: FloatArray  # (rows, columns) with NaN only where a gap is larger, or reaches the edge of the data
    count: int  # how many gaps were filled
    largest_m: float  # longer side of the largest one that was filled


def fill_gaps(heights_m: FloatArray, *, pixel_m: tuple[float, float], up_to_m: float) -> FilledGaps:
    """Fill the gaps that are no longer than a length along rows and columns, linearly between the heights around each.

    Args:
        heights_m: (rows, columns) heights, NaN without data; not changed.
        pixel_m: height and width of a pixel.
        up_to_m: longest side of a gap that is filled.
    """
    from scipy import ndimage  # half a second to load, and most elevation data has no gaps
    from scipy.interpolate import LinearNDInterpolator
    from scipy.spatial import QhullError

    filled = np.array(heights_m, dtype=float)
    labels, _ = ndimage.label(np.isnan(filled), structure=_NEIGHBOURS)
    count, largest_m = 0, 0.0
    for number, position in enumerate(ndimage.find_objects(labels), start=1):
        rows, columns = position
        side_m = max((rows.stop - rows.start) * pixel_m[0], (columns.stop - columns.start) * pixel_m[1])
        at_edge = (
            rows.start == 0 or columns.start == 0 or rows.stop == filled.shape[0] or columns.stop == filled.shape[1]
        )
        if side_m > up_to_m or at_edge:
            continue
        around = (slice(rows.start - 1, rows.stop + 1), slice(columns.start - 1, columns.stop + 1))
        gap = labels[around] == number
        rim = ndimage.binary_dilation(gap, structure=_NEIGHBOURS) & np.isfinite(heights_m[around])
        try:
            between = LinearNDInterpolator(np.argwhere(rim) * pixel_m, heights_m[around][rim])
        except QhullError:
            continue  # a rim on one line, beside another gap
        values = between(np.argwhere(gap) * pixel_m)
        if np.isfinite(values).all():
            filled[around][gap] = values
            count, largest_m = count + 1, max(largest_m, float(side_m))
    return FilledGaps(filled, count, largest_m)


def touching(mask: BoolArray) -> tuple[NDArray[np.int32], int]:
    """Number the groups of true elements that touch, also at corners, and count them.

    As ``scipy.ndimage.label`` does, which takes a third of a second to load; elevation data with level ground is frequent.

    Args:
        mask: (rows, columns).

    Returns:
        (rows, columns) numbers from 1, in the order of the first elements of the groups; 0 where the mask is false.
    """
    # First and last elements of the runs of each row, in a mask with a false column on either side.
    wide = np.pad(mask, ((0, 0), (1, 1)))
    first, last = (np.flatnonzero(wide[:, 1:-1] & ~beside) for beside in (wide[:, :-2], wide[:, 2:]))
    first, last = (at + at // mask.shape[1] * 2 + 1 for at in (first, last))
    # Pairs of runs that touch, in one row and in the next.
    begin = np.searchsorted(last, first + wide.shape[1] - 1)
    counts = np.searchsorted(first, last + wide.shape[1] + 1, side="right") - begin
    above = np.repeat(np.arange(len(first)), counts)
    below = np.arange(len(above)) + np.repeat(begin - np.cumsum(counts) + counts, counts)
    # Each run takes the lowest number beside it, until all that touch have one.
    group = np.arange(len(first))
    while (group[above] != group[below]).any():
        lower = np.minimum(group[above], group[below])
        np.minimum.at(group, group[above], lower)
        np.minimum.at(group, group[below], lower)
        while (group[group] != group).any():
            group = group[group]
    groups, numbers = np.unique(group, return_inverse=True)
    out = np.zeros(mask.shape, dtype=np.int32)
    out[mask] = np.repeat(numbers + 1, last - first + 1)
    return out, len(groups)

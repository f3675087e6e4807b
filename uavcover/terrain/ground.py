"""The ground of a scenario: one surface in the local frame, which every module asks."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uavcover.errors import TerrainError
from uavcover.kernels import surface as kernels
from uavcover.kernels.obstacles import roofs_m
from uavcover.kernels.surface import GRID, SINE_COSINE, Surface

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Ground:
    """A height surface with its provenance.

    Attributes:
        surface: the numbers, for kernels.
        source: where it came from, for people.
        vertical_datum: what its heights referred to at the source.
        sha256: hash of the source file, empty for a computed surface.
    """

    surface: Surface
    source: str
    vertical_datum: str
    sha256: str = ""

    def heights_m(self, east_north_m: ArrayLike) -> FloatArray:
        """Up coordinates (n,) of the ground at (n, 2) places, metres; NaN where there is no data."""
        en = np.atleast_2d(np.asarray(east_north_m, float))
        return kernels.heights(self.surface, np.ascontiguousarray(en[:, 0]), np.ascontiguousarray(en[:, 1]))

    def gradients(self, east_north_m: ArrayLike) -> FloatArray:
        """Slopes (n, 2) of the ground towards east and north at (n, 2) places, dimensionless."""
        en = np.atleast_2d(np.asarray(east_north_m, float))
        return kernels.gradients(self.surface, np.ascontiguousarray(en[:, 0]), np.ascontiguousarray(en[:, 1]))

    def roofs_m(self, east_north_m: ArrayLike) -> FloatArray:
        """Up coordinates (n,) of the highest obstacle over each of (n, 2) places; -inf where none stands."""
        en = np.atleast_2d(np.asarray(east_north_m, float))
        return roofs_m(self.surface.obstacles, np.ascontiguousarray(en[:, 0]), np.ascontiguousarray(en[:, 1]))

    def leg_height_ranges_m(self, route_m: ArrayLike) -> FloatArray:
        """Lowest and highest point above ground of every leg of an (n, 3) ENU route, at full length.

        Returns:
            (n - 1, 4) smallest height, its parameter along the leg 0..1, largest height, its parameter. Rows of NaN where
            a leg leaves the data. Exact for grids; see :mod:`uavcover.kernels.surface` for the analytic surface.
        """
        route = np.ascontiguousarray(np.atleast_2d(np.asarray(route_m, float)))
        return kernels.leg_height_ranges(self.surface, route)


def sine_cosine_ground(scale_m: float) -> Ground:
    """The paper's surface, Eq. 26, with ``scale_m`` metres to its unit."""
    empty = np.zeros((1, 1))
    # Read-only like the nodes of a grid: kernels are compiled once for both.
    empty.flags.writeable = False
    return Ground(Surface(SINE_COSINE, 0.0, 0.0, scale_m, empty, 1.0), "sine-cosine (paper, Eq. 26)", "local")


def grid_ground(
    up_m: FloatArray,
    *,
    east0_m: float,
    north0_m: float,
    step_m: float,
    source: str,
    vertical_datum: str,
    sha256: str = "",
) -> Ground:
    """A ground from heights at the nodes of a grid.

    Args:
        up_m: (rows, columns) heights, rows going north, NaN for no-data.
        east0_m: east of the first column.
        north0_m: north of the first row.
        step_m: spacing of the nodes.
        source: for people.
        vertical_datum: of the source.
        sha256: of the source.

    Raises:
        TerrainError: fewer than 2 x 2 nodes.
    """
    nodes = np.array(up_m, dtype=float, order="C")
    if nodes.ndim != 2 or min(nodes.shape) < 2:
        raise TerrainError(f"{source}: a grid needs at least 2 x 2 nodes, this one has {nodes.shape}")
    nodes.flags.writeable = False
    steepest = kernels.steepest_slope(nodes, float(step_m))
    surface = Surface(GRID, float(east0_m), float(north0_m), float(step_m), nodes, steepest)
    return Ground(surface, source, vertical_datum, sha256)

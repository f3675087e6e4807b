"""The ground of a scenario: one surface in the local frame, used by every module."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import ArrayLike
from shapely.geometry.base import BaseGeometry

from uavcover.errors import TerrainError
from uavcover.kernels import surface as kernels
from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.grid import GridFrame, square_frame, steepest_of_finite, steepest_slope
from uavcover.kernels.obstacles import roofs_m
from uavcover.kernels.surface import GRID, SINE_COSINE, Surface
from uavcover.terrain.pixel_frame import nodes_between, places_of_nodes_m


@dataclass(frozen=True, eq=False)
class Ground:
    """A height surface with its provenance.

    Attributes:
        surface: the surface as kernels take it.
        source: its origin, for people.
        vertical_datum: reference of the source's heights.
        sha256: hash of the source file, empty for a computed surface.
        surface_sha256: hash of the surface model's file that lies over it, empty without one.
        left_out: parts of the map whose heights were not believed, with the reason in words; there is no data there.
        error_m: largest measured difference between the surface and the file's own bilinear surface, metres; 0 for a computed
            surface.
        cut_error_m: largest difference between heights above ground along a leg and along the parts it is cut into.
    """

    surface: Surface
    source: str
    vertical_datum: str
    sha256: str = ""
    error_m: float = 0.0
    cut_error_m: float = 0.0
    surface_sha256: str = ""
    left_out: tuple[tuple[BaseGeometry, str], ...] = ()

    def without(self, parts: Sequence[tuple[BaseGeometry, str]]) -> "Ground":
        """The same without the heights of parts of the map, (east, north) metres, each with its reason in words."""
        grid, up = self.surface.grid, np.array(self.surface.up_m)
        for shape, _ in parts:
            columns, rows = (np.arange(*ends) for ends in nodes_between(grid, up, shape.bounds))
            nodes = np.array([axis.ravel() for axis in np.meshgrid(columns, rows)], dtype=float).T.reshape(-1, 2)
            if len(nodes):
                places = places_of_nodes_m(grid, nodes, up[rows[:, None], columns].reshape(-1))
                inside = shapely.intersects_xy(shape, places[:, 0], places[:, 1]).reshape(len(rows), len(columns))
                up[rows[:, None], columns] = np.where(inside, np.nan, up[rows[:, None], columns])
        up.flags.writeable = False
        return dataclasses.replace(self, surface=self.surface._replace(up_m=up), left_out=tuple(parts))

    def heights_m(self, east_north_m: ArrayLike) -> FloatArray:
        """Up coordinates (n,) of the ground at (n, 2) positions, metres; NaN where there is no data."""
        en = np.atleast_2d(np.asarray(east_north_m, float))
        return kernels.heights(self.surface, np.ascontiguousarray(en[:, 0]), np.ascontiguousarray(en[:, 1]))

    def heights_agl_m(self, places_m: ArrayLike) -> FloatArray:
        """Heights above ground (n,) of (n, 3) ENU positions, along their plumb lines, metres; NaN where there is no data."""
        return kernels.heights_above(self.surface, np.ascontiguousarray(np.atleast_2d(np.asarray(places_m, float))))

    def ups_m(self, east_north_m: ArrayLike, height_agl_m: ArrayLike) -> FloatArray:
        """Up coordinates (n,) for (n, 2) positions and heights above ground (n,), metres; NaN where there is no data.

        The inverse of :meth:`heights_agl_m`. Heights are along the plumb line, so this differs from ground plus height
        by centimetres some kilometres from the origin.
        """
        en = np.atleast_2d(np.asarray(east_north_m, float))
        heights = np.broadcast_to(np.asarray(height_agl_m, float), len(en))
        east, north = (np.ascontiguousarray(axis) for axis in en.T)
        return kernels.ups_above(self.surface, east, north, np.ascontiguousarray(heights))

    def lean_error_m(self, climb_m: float) -> float:
        """Largest change of a height above ground over a vertical climb, beyond the climb itself."""
        if self.surface.kind != GRID or self.surface.grid.lean == 0.0:
            return 0.0
        return climb_m * self.surface.grid.lean * steepest_of_finite(self.surface.up_m, self.surface.grid)

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
        route = np.ascontiguousarray(np.atleast_2d(np.asarray(route_m, float)))
        return kernels.leg_height_ranges(self.surface, route)


def sine_cosine_ground(scale_m: float) -> Ground:
    """The paper's surface, Eq. 26, with ``scale_m`` metres to its unit."""
    empty = np.zeros((1, 1))
    # Read-only like the nodes of a grid, so that kernels are compiled once for both.
    empty.flags.writeable = False
    frame = square_frame(east0_m=0.0, north0_m=0.0, step_m=1.0)
    return Ground(Surface(SINE_COSINE, scale_m, empty, 1.0, frame), "sine-cosine (paper, Eq. 26)", "local")


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
    """Make a ground from heights on a square grid along east and north.

    Heights above it are along the up axis.

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
    frame = square_frame(east0_m=float(east0_m), north0_m=float(north0_m), step_m=float(step_m))
    return ground_of_nodes(
        up_m, frame, step_m=float(step_m), source=source, vertical_datum=vertical_datum, sha256=sha256
    )


def ground_of_nodes(
    up_m: FloatArray,
    frame: GridFrame,
    *,
    step_m: float,
    source: str,
    vertical_datum: str,
    sha256: str = "",
    cut_error_m: float = 0.0,
) -> Ground:
    """Make a ground from heights at nodes in any arrangement.

    Args:
        up_m: (rows, columns) up coordinates, NaN for no-data.
        frame: the positions of the nodes.
        step_m: their smallest spacing.
        source: for people.
        vertical_datum: of the source.
        sha256: of the source.
        cut_error_m: of the ground.

    Raises:
        TerrainError: fewer than 2 x 2 nodes.
    """
    nodes = np.array(up_m, dtype=float, order="C")
    if nodes.ndim != 2 or min(nodes.shape) < 2:
        raise TerrainError(f"{source}: a grid needs at least 2 x 2 nodes, but this one has {nodes.shape}")
    nodes.flags.writeable = False
    surface = Surface(GRID, step_m, nodes, steepest_slope(nodes, frame), frame)
    return Ground(surface, source, vertical_datum, sha256, cut_error_m=cut_error_m)

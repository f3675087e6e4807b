"""The ground as the checks ask for it: any object that knows heights, and a grid of them that comes with the package."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from mission_io.errors import MisuseError
from mission_io.geodesy import ground_distance_m

FloatArray = NDArray[np.float64]


class Surface(Protocol):
    """The height of the ground at places."""

    def heights_amsl_m(self, lat_deg: FloatArray, lon_deg: FloatArray) -> FloatArray:
        """Heights above mean sea level, (n,) metres, at (n,) latitudes and longitudes; NaN where it is not known."""
        ...


@runtime_checkable
class BoundedSurface(Surface, Protocol):
    """A surface that also says how steep it can be, so that the ground between two samples is bounded."""

    @property
    def steepest_slope(self) -> float:
        """No two places have a steeper slope between them: height over ground distance, 1 for 45 degrees."""
        ...


def steepest_slope_of(surface: Surface) -> float | None:
    """The surface's bound on its slope; None when it gives none, or no finite one."""
    if isinstance(surface, BoundedSurface) and math.isfinite(surface.steepest_slope):
        return float(surface.steepest_slope)
    return None


@dataclass(frozen=True, eq=False)
class GridSurface:
    """Heights at the nodes of a grid in degrees, bilinear between them; unknown outside of it.

    Attributes:
        south_deg: Latitude of the first row.
        west_deg: Longitude of the first column.
        step_deg: Spacing of rows and of columns.
        heights: (rows, columns) float64, metres above mean sea level, rows going north; NaN where not known.
    """

    south_deg: float
    west_deg: float
    step_deg: float
    heights: FloatArray

    def __post_init__(self) -> None:
        if self.heights.ndim != 2 or min(self.heights.shape) < 2 or not self.step_deg > 0.0:
            raise MisuseError("a grid surface needs 2 rows, 2 columns and a step above 0")
        heights = np.array(self.heights, dtype=np.float64)
        heights.flags.writeable = False
        object.__setattr__(self, "heights", heights)

    def heights_amsl_m(self, lat_deg: FloatArray, lon_deg: FloatArray) -> FloatArray:
        """See ``Surface``."""
        rows, columns = self.heights.shape
        v = (np.asarray(lat_deg) - self.south_deg) / self.step_deg
        u = (np.asarray(lon_deg) - self.west_deg) / self.step_deg
        inside = (v >= 0.0) & (v <= rows - 1) & (u >= 0.0) & (u <= columns - 1)
        row = np.clip(np.where(inside, v, 0.0).astype(np.int64), 0, rows - 2)
        column = np.clip(np.where(inside, u, 0.0).astype(np.int64), 0, columns - 2)
        dv, du = v - row, u - column
        h = self.heights
        south = h[row, column] * (1.0 - du) + h[row, column + 1] * du
        north = h[row + 1, column] * (1.0 - du) + h[row + 1, column + 1] * du
        return np.where(inside, south * (1.0 - dv) + north * dv, np.nan)

    @cached_property
    def steepest_slope(self) -> float:
        """See ``BoundedSurface``: within a bilinear cell no partial slope is steeper than along the cell's edges."""
        rows = self.heights.shape[0]
        north_deg = self.south_deg + (rows - 1) * self.step_deg
        poleward_deg = min(89.0, max(abs(self.south_deg), abs(north_deg)))
        row_m = ground_distance_m(0.0, 0.0, self.step_deg, 0.0)  # a degree of latitude is shortest at the equator
        column_m = ground_distance_m(poleward_deg, 0.0, poleward_deg, self.step_deg)
        along_m, across_m = (np.nan_to_num(np.abs(np.diff(self.heights, axis=axis))).max() for axis in (0, 1))
        return math.hypot(float(along_m) / row_m, float(across_m) / column_m)

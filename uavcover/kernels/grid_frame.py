"""Where the nodes of a grid are: from a place in the local frame to a column and a row.

The ground keeps the pixels of its file as nodes; nothing is resampled. A raster in degrees or in a projection lies turned,
stretched and a little bent in the local frame, so column and row are polynomials of the third degree in east and north:
within 10 km of latitude 60 that is exact to a hundredth of a millimetre, where the second degree errs by 6 mm.

Height above ground is measured along the plumb line, which is how an elevation file means it: the height above sea level of a
place less that of the file at its latitude and longitude. Away from the origin a plumb line leans against the up axis, by the
distance over the Earth's radius: 0.3 m on 500 m at 4 km. Each place is therefore first brought along its plumb line to one
level.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels._jit import kernel

TERMS = 10
"""Of a polynomial of the third degree: 1, x, y, x^2, x y, y^2, x^3, x^2 y, x y^2, y^3."""


class GridFrame(NamedTuple):
    """Columns and rows of a grid in the local frame, whole numbers at the nodes.

    Attributes:
        east0_m: x = (east - east0_m) / scale_m, with the east at which the plumb line meets the level.
        north0_m: y = (north - north0_m) / scale_m, likewise.
        scale_m: unit of x and y.
        terms: (2, TERMS) float64 coefficients of the column's and of the row's polynomial.
        level_up_m: up coordinate of the level.
        lean_per_m: tangent by which plumb lines lean, for each metre from the origin of the local frame: 1 / Earth's radius;
            0 for a grid whose columns and rows do not depend on the height.
        lean: no plumb line over the grid leans more (tangent).
        per_column: columns to a metre, at most.
        per_row: rows to a metre, at most.
        skew: cosine of the angle between the directions in which columns and rows count, at most; 0: at right angles.
        piece_m: a straight line of at most this length is taken as straight on the grid.
        leeway: the ground under the straight line between two places is on the grid inside the box around both, grown by so
            many nodes.
    """

    east0_m: float
    north0_m: float
    scale_m: float
    terms: NDArray[np.float64]
    level_up_m: float
    lean_per_m: float
    lean: float
    per_column: float
    per_row: float
    skew: float
    piece_m: float
    leeway: float


def square_frame(*, east0_m: float, north0_m: float, step_m: float) -> GridFrame:
    """The frame of a square grid along east and north, column 0 at ``east0_m`` and row 0 at ``north0_m``."""
    terms = np.zeros((2, TERMS))
    terms[0, 1] = terms[1, 2] = 1.0
    terms.flags.writeable = False
    per_step = 1.0 / step_m
    return GridFrame(east0_m, north0_m, step_m, terms, 0.0, 0.0, 0.0, per_step, per_step, 0.0, math.inf, 0.0)


@kernel
def on_grid(frame: GridFrame, east: float, north: float, up: float) -> tuple[float, float]:
    """Column and row of a place; NaN when it is not finite."""
    if not math.isfinite(east + north + up):
        return math.nan, math.nan
    along = 1.0 - (up - frame.level_up_m) * frame.lean_per_m
    x = (east * along - frame.east0_m) / frame.scale_m
    y = (north * along - frame.north0_m) / frame.scale_m
    c = frame.terms
    column = (
        (c[0, 0] + x * (c[0, 1] + x * (c[0, 3] + x * c[0, 6])))
        + y * ((c[0, 2] + x * (c[0, 4] + x * c[0, 7])) + y * ((c[0, 5] + x * c[0, 8]) + y * c[0, 9]))
    )  # fmt: skip
    row = (
        (c[1, 0] + x * (c[1, 1] + x * (c[1, 3] + x * c[1, 6])))
        + y * ((c[1, 2] + x * (c[1, 4] + x * c[1, 7])) + y * ((c[1, 5] + x * c[1, 8]) + y * c[1, 9]))
    )  # fmt: skip
    return column, row


@kernel
def places_on_grid(frame: GridFrame, places: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 2) columns and rows of (n, 3) places."""
    out = np.empty((places.shape[0], 2))
    for i in range(places.shape[0]):
        out[i, 0], out[i, 1] = on_grid(frame, places[i, 0], places[i, 1], places[i, 2])
    return out


@kernel
def growth_on_grid(frame: GridFrame, east: float, north: float, up: float) -> NDArray[np.float64]:
    """(2, 3) by how much column and row grow at a place, for each metre east, north and up."""
    along = 1.0 - (up - frame.level_up_m) * frame.lean_per_m
    x = (east * along - frame.east0_m) / frame.scale_m
    y = (north * along - frame.north0_m) / frame.scale_m
    out = np.empty((2, 3))
    for k in range(2):
        c = frame.terms[k]
        to_x = c[1] + x * (2.0 * c[3] + x * 3.0 * c[6]) + y * (c[4] + 2.0 * x * c[7] + y * c[8])
        to_y = c[2] + y * (2.0 * c[5] + y * 3.0 * c[9]) + x * (c[4] + 2.0 * y * c[8] + x * c[7])
        out[k, 0] = to_x * along / frame.scale_m
        out[k, 1] = to_y * along / frame.scale_m
        out[k, 2] = -(to_x * east + to_y * north) * frame.lean_per_m / frame.scale_m
    return out


@kernel
def slope_of_cell(frame: GridFrame, across: float, along: float) -> float:
    """No ground is steeper (tangent) where it rises by at most ``across`` a column and ``along`` a row; infinite if not known."""
    x, y = across * frame.per_column, along * frame.per_row
    slope = math.sqrt(x * x + y * y + 2.0 * x * y * frame.skew)
    # What leans with the plumb lines is seen steeper from the up axis.
    left = 1.0 - slope * frame.lean
    return slope / left if left > 0.0 else math.inf

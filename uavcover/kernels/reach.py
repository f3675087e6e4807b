"""From how far away a cell can be seen at all, with anything that flies not higher above ground than allowed."""

import math

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels._jit import kernel


@kernel
def farthest_looks(
    centres: NDArray[np.float64],
    tops: NDArray[np.float64],
    east0: float,
    north0: float,
    side: float,
    tan_half_fov: float,
    reach: float,
) -> NDArray[np.float64]:
    """(n,) no allowed place further away than this, on the map, sees a cell through a cone; 0 where none does.

    The map is cut into squares. From a place at distance d a camera that looks straight down sees a cell when
    d <= tan_half_fov times its height above the cell, which is at most that of the square's top. Nothing else is asked
    (range, incidence, line of sight), so the true distance may be smaller, never larger.

    Args:
        centres: (n, 3) of the cells.
        tops: (rows, columns) highest allowed up coordinate anywhere over each square; NaN: no place is allowed there.
        east0: of the south-west corner of the first square.
        north0: likewise.
        side: of the squares.
        tan_half_fov: of the cone.
        reach: no place further away on the map sees anything.
    """
    rows, columns = tops.shape
    out = np.zeros(centres.shape[0])
    for k in range(centres.shape[0]):
        e, n, u = centres[k, 0] - east0, centres[k, 1] - north0, centres[k, 2]
        for i in range(max(0, int((n - reach) / side)), min(rows - 1, int((n + reach) / side)) + 1):
            dn_near = max(0.0, i * side - n, n - (i + 1) * side)
            dn_far = max(abs(n - i * side), abs(n - (i + 1) * side))
            for j in range(max(0, int((e - reach) / side)), min(columns - 1, int((e + reach) / side)) + 1):
                if math.isnan(tops[i, j]):
                    continue
                radius = min(reach, tan_half_fov * (tops[i, j] - u))
                if radius <= out[k]:
                    continue
                de_near = max(0.0, j * side - e, e - (j + 1) * side)
                if math.hypot(de_near, dn_near) > radius:
                    continue
                de_far = max(abs(e - j * side), abs(e - (j + 1) * side))
                out[k] = max(out[k], min(radius, math.hypot(de_far, dn_far)))
    return out

"""Distance of points from a polyline."""

import math

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels._jit import kernel


@kernel
def distances_to_polyline(points: NDArray[np.float64], polyline: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) distance of each of (n, 3) points from the (m, 3) polyline, metres. O(n m).

    Infinite where a point is not finite, and when there is no polyline.
    """
    out = np.empty(points.shape[0])
    for i in range(points.shape[0]):
        best = math.inf
        for j in range(polyline.shape[0] - 1 if polyline.shape[0] > 1 else polyline.shape[0]):
            a = polyline[j]
            b = polyline[min(j + 1, polyline.shape[0] - 1)]
            de, dn, du = b[0] - a[0], b[1] - a[1], b[2] - a[2]
            pe, pn, pu = points[i, 0] - a[0], points[i, 1] - a[1], points[i, 2] - a[2]
            length2 = de * de + dn * dn + du * du
            t = 0.0
            if length2 > 0.0:
                t = min(1.0, max(0.0, (pe * de + pn * dn + pu * du) / length2))
            d2 = (pe - t * de) ** 2 + (pn - t * dn) ** 2 + (pu - t * du) ** 2
            if d2 < best:
                best = d2
        out[i] = math.sqrt(best)
    return out

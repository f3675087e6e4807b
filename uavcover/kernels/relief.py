"""Ground and the highest places above it as numbers at the nodes of a square lattice, and how far is seen along a direction.

Heights are linear in the triangles of the lattice's squares, which are cut from south-west to north-east. From a place, ground at
a distance r in a direction u is seen where r <= min(reach, tangent * (top there - ground there)). Along each direction that is
one interval from 0 on, because ground falls by less than 1 / tangent a metre.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.jit import kernel

LEAST_GROWTH = 0.05
"""The distance seen along a direction exceeds the cone at least at this rate: ground is made no steeper."""
EXACT_M = 1e-5
"""Of a distance seen."""


class Relief(NamedTuple):
    """Ground around an area, the highest allowed places above it, and how far a sensor sees from there.

    Attributes:
        ground_m: (rows + 1, columns + 1) up of the nodes: the ground is nowhere below what lies between them.
        top_m: likewise: no allowed place is above what lies between them.
        allowed: (rows, columns) whether a place in each square may be allowed.
        side: of the squares, metres.
        tangent: of the half angle of view; 0 where height does not matter.
        reach: nothing further away on the map is seen.
    """

    ground_m: NDArray[np.float64]
    top_m: NDArray[np.float64]
    allowed: NDArray[np.bool_]
    side: float
    tangent: float
    reach: float


@kernel
def height(relief: Relief, up: NDArray[np.float64], e: float, n: float) -> tuple[float, float, float]:
    """Height between nodes and its slopes, at metres east and north of the first node."""
    j, i = int(e / relief.side), int(n / relief.side)
    along, across = e / relief.side - j, n / relief.side - i
    sw, ne = up[i, j], up[i + 1, j + 1]
    if along >= across:
        de, dn = up[i, j + 1] - sw, ne - up[i, j + 1]
    else:
        de, dn = ne - up[i + 1, j], up[i + 1, j] - sw
    return sw + along * de + across * dn, de / relief.side, dn / relief.side


@kernel
def farthest_seen(relief: Relief, e: float, n: float, top: float, ue: float, un: float, guess: float) -> float:
    """How far ground is seen along a direction from a place, metres; to 0.01 mm, and at most ``reach``."""
    if relief.tangent == 0.0:
        return relief.reach
    low, high = 0.0, relief.reach
    r = min(max(guess, low), high)
    for _ in range(60):
        up, ge, gn = height(relief, relief.ground_m, e + r * ue, n + r * un)
        beyond = r - relief.tangent * (top - up)
        if beyond > 0.0:
            high = r
        else:
            low = r
        if abs(beyond) < EXACT_M * LEAST_GROWTH or high - low < EXACT_M:
            break
        r -= beyond / (1.0 + relief.tangent * (ge * ue + gn * un))
        if r >= relief.reach == high and low < high:
            up, ge, gn = height(relief, relief.ground_m, e + high * ue, n + high * un)
            if high <= relief.tangent * (top - up):
                return high
        if not low < r < high:
            r = 0.5 * (low + high)
    return r

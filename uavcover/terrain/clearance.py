"""How straight lines stand to the obstacles on a ground, at their full length."""

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels import obstacle_breach as kernels
from uavcover.model.obstacles import Obstacles
from uavcover.terrain.ground import Ground

FloatArray = NDArray[np.float64]


def leg_breaches(ground: Ground, route_m: FloatArray, limits: Obstacles) -> FloatArray:
    """What the legs of an (n, 3) ENU route lack of the clearances from obstacles.

    Args:
        ground: with its obstacles.
        route_m: waypoints in flying order.
        limits: the clearances.

    Returns:
        (n - 1, 3) number of the obstacle, -1 for none; metres that are lacking where it is worst, aside or in height, whichever
        is less; the parameter 0..1 along the leg there.
    """
    route = np.ascontiguousarray(route_m, dtype=float).reshape(-1, 3)
    return _breaches(ground, route[:-1], route[1:], limits)


def waypoint_breaches(ground: Ground, places_m: FloatArray, limits: Obstacles) -> FloatArray:
    """(n, 3) the same for (n, 3) ENU places alone."""
    places = np.ascontiguousarray(places_m, dtype=float).reshape(-1, 3)
    return _breaches(ground, places, places, limits)


def _breaches(ground: Ground, begins: FloatArray, ends: FloatArray, limits: Obstacles) -> FloatArray:
    return kernels.breaches(ground.surface.obstacles, begins, ends, limits.clearance_beside_m, limits.clearance_above_m)

"""Set covers as routes: places in the order of a short tour, laid over the terrain where the limits apply to legs."""

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.open_tour import short_tour
from uavcover.model.route import Route
from uavcover.planning.terrain_following import lay_over_terrain
from uavcover.site import Site

FloatArray = NDArray[np.float64]


def tour_route(site: Site, places_m: FloatArray, *, tolerance_m: float) -> Route:
    """A short route through all of (k, 3) places, begun at the end that is nearer to home, or to the origin without one.

    Args:
        site: the scenario on its ground.
        places_m: ENU.
        tolerance_m: how far the straight legs may leave the wanted height above ground, where they are laid over the terrain.
    """
    points = places_m[short_tour(places_m)]
    reference = np.zeros(3) if site.home_m is None else site.home_m
    if len(points) and np.linalg.norm(points[-1] - reference) < np.linalg.norm(points[0] - reference):
        points = points[::-1]
    if site.scenario.limits.applies_to == "legs" and len(points) > 1:
        wanted_agl_m = site.ground.heights_agl_m(points)
        points = lay_over_terrain(site, points[:, :2], wanted_agl_m, tolerance_m=tolerance_m)
    return Route(points)

"""Laying a line on the map over the terrain."""

import math

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.route import follow_terrain
from uavcover.planning.detours import around_obstacles
from uavcover.site import Site

FloatArray = NDArray[np.float64]

SAMPLE_SPACING_M = 5.0
HAIR_M = 1e-6
"""So much of the band is left free at both ends, so that rounding does not break it."""


def lay_over_terrain(site: Site, polyline_m: FloatArray, wanted_agl_m: FloatArray, *, tolerance_m: float) -> FloatArray:
    """Waypoints over the terrain along a line on the map, inside the scenario's band and climb limit where that is possible.

    They lead over obstacles, and around those that the band does not reach over.

    Args:
        site: the scenario on its ground.
        polyline_m: (n, 2) east, north corners.
        wanted_agl_m: (n,) wanted height above ground at the corners.
        tolerance_m: how far the straight chords may leave the wanted height.

    Returns:
        (m, 3) ENU waypoints, corners among them. Where the ground has no data their height is read from the neighbours:
        a finite number, so that the route can be compared with others; the leg checks say that data is missing there.
    """
    # A sample's distance farther away nothing is raised over an obstacle.
    polyline_m, wanted_agl_m = around_obstacles(site, polyline_m, wanted_agl_m, apart_m=SAMPLE_SPACING_M)
    limits = site.scenario.limits
    # Heights are looked at between samples here, and along whole legs by those who judge the route.
    hair_m = HAIR_M + site.ground.cut_error_m
    points = follow_terrain(
        site.ground.surface,
        np.ascontiguousarray(polyline_m, dtype=float),
        np.ascontiguousarray(wanted_agl_m, dtype=float),
        limits.min_height_agl_m + limits.height_margin_m + hair_m,
        limits.max_height_agl_m - limits.height_margin_m - hair_m,
        # A hair below the limit, so that rounding does not break it.
        math.tan(math.radians(limits.max_climb_angle_deg)) * (1.0 - 1e-9),
        max(tolerance_m, 0.0),
        SAMPLE_SPACING_M,
        site.scenario.obstacles.clearance_beside_m,
        site.scenario.obstacles.clearance_above_m,
    )
    return finite_heights(points)


def finite_heights(points_m: FloatArray) -> FloatArray:
    """(n, 3) points with every missing height read from its neighbours in the row; 0 when all are missing."""
    known = np.isfinite(points_m[:, 2])
    if known.all():
        return points_m
    filled = points_m.copy()
    numbers = np.arange(len(points_m))
    filled[:, 2] = np.interp(numbers, numbers[known], points_m[known, 2]) if known.any() else 0.0
    return filled

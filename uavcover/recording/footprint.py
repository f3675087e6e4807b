"""What lies inside the sensor's field of view: its outline on the ground. Arrays only."""

import numpy as np
from numpy.typing import NDArray

from uavcover.coverage.coverage_map import CoverageMap
from uavcover.kernels.coverage import CONE, DISC

FloatArray = NDArray[np.float64]

_DIRECTIONS = 48
_STEPS = 40


def footprints_m(coverage: CoverageMap, eyes_m: FloatArray) -> list[FloatArray]:
    """Outlines on the ground of the sensor's view from (k, 3) ENU places.

    In each of 48 directions the ground is followed from the point below the sensor to where it first leaves the sensor's
    range or opening angle, to within a 40th of the largest reach. What hides behind ground inside the outline is not cut
    out of it; the cells know.

    Returns:
        k closed rings (49, 3), ENU metres; a ring is empty where the sensor does not reach the ground below it, and
        shorter where there is no elevation.
    """
    sight = coverage.sight
    reach_m = sight.reach_m
    if sight.kind == CONE:
        reach_m *= sight.tan_half_fov / np.sqrt(1.0 + sight.tan_half_fov**2)
    azimuth = np.linspace(0.0, 2.0 * np.pi, _DIRECTIONS + 1)
    radius = np.linspace(0.0, reach_m, _STEPS + 1)
    east = np.sin(azimuth)[:, None] * radius
    north = np.cos(azimuth)[:, None] * radius
    rings: list[FloatArray] = []
    for eye in np.asarray(eyes_m, float).reshape(-1, 3):
        places = np.column_stack([(eye[0] + east).ravel(), (eye[1] + north).ravel()])
        up = coverage.site.ground.heights_m(places).reshape(east.shape)
        below = eye[2] - up
        inside = np.isfinite(up)
        if sight.kind != DISC:
            inside &= radius**2 + below**2 <= sight.reach_m**2
        if sight.kind == CONE:
            inside &= radius <= below * sight.tan_half_fov
        last = np.where(inside.all(axis=1), _STEPS, inside.argmin(axis=1) - 1)
        rows = np.flatnonzero(last >= 0)
        column = last[rows]
        rings.append(np.column_stack([eye[0] + east[rows, column], eye[1] + north[rows, column], up[rows, column]]))
    return rings

"""What lies inside the sensor's field of view: its outline on the ground. Arrays only."""

import numpy as np
from numpy.typing import NDArray

from uavcover.coverage.coverage_map import CoverageMap
from uavcover.kernels.sight import CONE, DISC, FRUSTUM

FloatArray = NDArray[np.float64]

_DIRECTIONS = 48
_STEPS = 40
_LEVEL_COS = 0.9995  # an axis nearer to straight down than 1.8 degrees has its middle below the sensor


def footprints_m(coverage: CoverageMap, eyes_m: FloatArray, axes: FloatArray, tops: FloatArray) -> list[FloatArray]:
    """Outlines on the ground of the sensor's view from (k, 3) ENU places.

    In each of 48 directions the ground is followed from where the sensor's axis meets it to where it first leaves the
    sensor's range or opening angle, to within a 40th of the largest reach. What hides behind ground inside the outline is
    not cut out of it; the cells know.

    Args:
        coverage: the cells with their sensor.
        eyes_m: (k, 3) ENU places of the sensor.
        axes: (k, 3) unit vectors in ENU, where a camera points; other sensors look everywhere.
        tops: (k, 3) unit vectors at right angles to them: the top of its picture.

    Returns:
        k closed rings (49, 3), ENU metres; a ring is empty where the sensor does not reach the ground on its axis, and
        shorter where there is no elevation.
    """
    sight = coverage.sight
    azimuth = np.linspace(0.0, 2.0 * np.pi, _DIRECTIONS + 1)
    rings: list[FloatArray] = []
    for eye, axis, top in zip(*(np.asarray(rows, float).reshape(-1, 3) for rows in (eyes_m, axes, tops)), strict=True):
        reach_m = sight.reach_m
        middle = eye[:2]
        if sight.kind in {CONE, FRUSTUM}:
            if -axis[2] < _LEVEL_COS:
                middle = _on_axis_m(coverage, eye, axis)
                reach_m *= 2.0  # across the whole range
            else:
                # To the corner of a picture.
                widest = np.hypot(sight.tan_half_fov, sight.tan_half_along)
                reach_m *= widest / np.sqrt(1.0 + widest**2) / _LEVEL_COS
        radius = np.linspace(0.0, reach_m, _STEPS + 1)
        east = middle[0] + np.sin(azimuth)[:, None] * radius
        north = middle[1] + np.cos(azimuth)[:, None] * radius
        up = coverage.site.ground.heights_m(np.column_stack([east.ravel(), north.ravel()])).reshape(east.shape)
        de, dn, du = east - eye[0], north - eye[1], up - eye[2]
        inside = np.isfinite(up)
        if sight.kind == DISC:
            inside &= de**2 + dn**2 <= sight.reach_m**2
        else:
            inside &= de**2 + dn**2 + du**2 <= sight.reach_m**2
        if sight.kind == CONE:
            along = de * axis[0] + dn * axis[1] + du * axis[2]
            across2 = de**2 + dn**2 + du**2 - along**2
            inside &= (along > 0.0) & (across2 <= (along * sight.tan_half_fov) ** 2)
        if sight.kind == FRUSTUM:
            right = np.cross(axis, top)
            depth = de * axis[0] + dn * axis[1] + du * axis[2]
            across = de * right[0] + dn * right[1] + du * right[2]
            along = de * top[0] + dn * top[1] + du * top[2]
            inside &= (np.abs(across) <= depth * sight.tan_half_fov) & (np.abs(along) <= depth * sight.tan_half_along)
        last = np.where(inside.all(axis=1), _STEPS, inside.argmin(axis=1) - 1)
        rows = np.flatnonzero(last >= 0)
        column = last[rows]
        rings.append(np.column_stack([east[rows, column], north[rows, column], up[rows, column]]))
    return rings


def _on_axis_m(coverage: CoverageMap, eye_m: FloatArray, axis: FloatArray) -> FloatArray:
    """(2,) where the axis first comes to the ground, to a 200th of the range; below the sensor where it does not."""
    along = np.linspace(0.0, coverage.sight.reach_m, 201)[:, None]
    points = eye_m + along * axis
    under = coverage.site.ground.heights_agl_m(points) <= 0.0
    return points[int(under.argmax()), :2] if under.any() else eye_m[:2]

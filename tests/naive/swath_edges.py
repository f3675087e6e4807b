"""How far a moving sensor sees to one side, by small steps."""

import numpy as np

from uavcover.kernels.sight import CONE
from uavcover.kernels.surface import height


def side_reach(surface, sight, east, north, up, ce, cn, slope, steps=400):
    """The first of many small steps aside that is out of view from all of many places along the way."""
    farthest = 2.0 * sight.reach_m
    ahead = np.linspace(-farthest, farthest, 2001) if slope else np.zeros(1)
    for k in range(1, steps + 1):
        away = farthest * k / steps
        drop = up + slope * ahead - height(surface, east + away * ce, north + away * cn)
        beside = np.hypot(away, ahead)
        observed = np.hypot(beside, drop) <= sight.reach_m
        if sight.kind == CONE:
            observed &= beside <= drop * sight.tan_half_fov
        if not observed.any():
            return away
    return farthest

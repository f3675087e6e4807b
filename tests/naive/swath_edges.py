"""How far a sensor sees to one side, by small steps."""

import math

from uavcover.kernels.sight import CONE
from uavcover.kernels.surface import height


def side_reach(surface, sight, east, north, up, ce, cn, steps=4000):
    """The first of many small steps that is out of view."""
    farthest = sight.reach_m
    for k in range(1, steps + 1):
        away = farthest * k / steps
        drop = up - height(surface, east + away * ce, north + away * cn)
        seen = math.hypot(away, drop) <= sight.reach_m
        if sight.kind == CONE:
            seen = seen and away <= drop * sight.tan_half_fov
        if not seen:
            return away
    return farthest

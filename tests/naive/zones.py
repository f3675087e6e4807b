"""Slow, obvious twin of :mod:`uavcover.scenario.airspace.zones`: places along a leg, each asked on its own."""

import numpy as np
import shapely


def in_zone(zone, position, *, height_agl_m, alt_amsl_m, margin_m=0.0, height_margin_m=0.0):
    """Whether one place is in a zone, by the words of the scenario's reference."""
    east, north = position[:2]
    if zone.circle is not None:
        if np.hypot(east - zone.circle[0], north - zone.circle[1]) >= zone.circle[2] + margin_m:
            return False
    elif shapely.distance(zone.outline, shapely.Point(east, north)) >= max(margin_m, 1e-12):
        return False
    entry = zone.entry
    floors = [(entry.floor_agl_m, height_agl_m), (entry.floor_amsl_m, alt_amsl_m)]
    ceilings = [(entry.ceiling_agl_m, height_agl_m), (entry.ceiling_amsl_m, alt_amsl_m)]
    floors = [height > floor - height_margin_m for floor, height in floors if floor is not None]
    ceilings = [height < ceiling + height_margin_m for ceiling, height in ceilings if ceiling is not None]
    return (not floors or any(floors)) and (not ceilings or any(ceilings))


def enters(zone, ground, p, q, *, alt_offset_m, samples=4001, **margins):
    """Whether any of many places along the line p-q is in the zone. Straight up from a flat or sloping plane."""
    t = np.linspace(0.0, 1.0, samples)
    positions = np.asarray(p) + t[:, None] * (np.asarray(q) - np.asarray(p))
    heights = positions[:, 2] - ground(positions[:, 0], positions[:, 1])
    return any(
        in_zone(zone, position, height_agl_m=height, alt_amsl_m=position[2] + alt_offset_m, **margins)
        for position, height in zip(positions, heights, strict=True)
    )

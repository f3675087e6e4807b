"""From every part of the path: the line of sight to the pilot and the radio."""

import math

import numpy as np

from uavcover.checking.findings import CheckFinding, joined
from uavcover.checking.ground_checks import TOLERANCE_M
from uavcover.checking.return_lines import PIECE_M, lowest_of, places_along
from uavcover.checking.segments import FlownPath
from uavcover.checking.world import World
from uavcover.kernels.arrays import FloatArray

_EARTH_RADIUS_M = 6_371_000.0
_BENDING = 1.0 - 1.0 / (4.0 / 3.0)
"""Radio waves bend with the Earth as if it were 4/3 as large (ITU-R P.834)."""


def sight_findings(path: FlownPath, world: World, pilot_m: FloatArray) -> list[CheckFinding]:
    """Segments that terrain hides from the pilot, or from the radio beside him."""
    hidden = []
    for segment in path.distinct:
        if segment.phase not in ("route", "return"):
            continue
        lines = [_bent_line(pilot_m, place) for place in places_along(segment)]
        lowest, _, begin = lowest_of(world, lines)
        if lowest < -TOLERANCE_M:
            lat, lon, alt = world.geodetic(places_along(segment)[begin])
            hidden.append(
                CheckFinding(
                    kind="sight",
                    weight="look",
                    items=segment.items,
                    lat_deg=lat,
                    lon_deg=lon,
                    alt_amsl_m=alt,
                    by=-lowest,
                    unit="m",
                    what=f"hidden from the pilot and the radio by ground {-lowest:.0f} m high in the line of sight",
                    do="stand elsewhere (--pilot), fly higher, or have a spotter",
                ),
            )
    return joined(hidden, lambda one: one.kind)


def _bent_line(pilot_m: FloatArray, place: FloatArray) -> FloatArray:
    distance_m = float(np.hypot(*(place - pilot_m)[:2]))
    t = np.linspace(0.0, 1.0, max(2, math.ceil(distance_m / PIECE_M)) + 1)
    line = pilot_m + t[:, None] * (place - pilot_m)
    line[:, 2] += t * (1.0 - t) * distance_m**2 / (2.0 * _EARTH_RADIUS_M) * _BENDING
    return np.asarray(line)

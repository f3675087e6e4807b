"""From every part of the path: the line of sight to the pilot and the radio."""

import numpy as np

from uavcover.extras.check.findings import CheckFinding, joined
from uavcover.extras.check.ground_checks import TOLERANCE_M
from uavcover.extras.check.return_lines import PIECE_M, Lines, cut, lowest_of, places_along, with_gaps
from uavcover.extras.check.segments import FlownPath
from uavcover.extras.check.world import World
from uavcover.intake.surface_look import HIDES_M
from uavcover.kernels.arrays import FloatArray

_EARTH_RADIUS_M = 6_371_000.0
_BENDING = 1.0 - 1.0 / (4.0 / 3.0)
"""Radio waves bend with the Earth as if it were 4/3 as large (ITU-R P.834)."""


def sight_findings(path: FlownPath, world: World, pilot_m: FloatArray) -> list[CheckFinding]:
    """Segments that terrain, trees or roofs hide from the pilot, or from the radio beside him."""
    under_m = -float(world.clearances_m(pilot_m)[0])
    if under_m > HIDES_M:
        return [
            CheckFinding(
                kind="sight", weight="look", by=under_m, unit="m",
                what=f"the pilot stands under trees or a roof {under_m:.0f} m above his eyes and sees nothing of the flight",
                do="stand in the open (--pilot)",
            ).at(world.geodetic(pilot_m))
        ]  # fmt: skip
    hidden = []
    what_hides = "ground" if world.surface is None else "ground, trees or roofs"
    for segment in path.distinct:
        if segment.phase not in ("route", "return"):
            continue
        places = places_along(segment)
        lowest, _, begin = lowest_of(world, _bent_lines(pilot_m, places))
        if lowest < -TOLERANCE_M:
            hidden.append(
                CheckFinding(
                    kind="sight",
                    weight="look",
                    items=segment.items,
                    by=-lowest,
                    unit="m",
                    what=f"hidden from the pilot and the radio by {what_hides} {-lowest:.0f} m high in the line of sight",
                    do="stand elsewhere (--pilot), fly higher, or have a spotter",
                ).at(world.geodetic(places[begin])),
            )
    return joined(hidden, lambda one: one.kind)


def _bent_lines(pilot_m: FloatArray, places_m: FloatArray) -> Lines:
    """Lines from the pilot to (n, 3) places, as radio waves see the ground between them."""
    away = places_m - pilot_m
    distances_m = np.hypot(away[:, 0], away[:, 1])
    owner, t = cut(np.maximum(2, np.ceil(distances_m / PIECE_M)).astype(np.int64))
    lines = pilot_m + t[:, None] * away[owner]
    lines[:, 2] += t * (1.0 - t) * distances_m[owner] ** 2 / (2.0 * _EARTH_RADIUS_M) * _BENDING
    return with_gaps(lines, owner)

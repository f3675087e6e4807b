"""From every part of the path: the straight return of the autopilot, and the line of sight to the pilot and the radio."""

import math

import numpy as np

from uavcover.checking.aircraft import Aircraft, return_height_m
from uavcover.checking.findings import CheckFinding, joined
from uavcover.checking.ground_checks import TOLERANCE_M
from uavcover.checking.limits import Limits
from uavcover.checking.segments import FlownPath, Segment
from uavcover.checking.world import World
from uavcover.kernels.arrays import FloatArray

STEP_M = 20.0
"""A return begins at least this often along the path, and at every item."""
_PIECE_M = 400.0
_EARTH_RADIUS_M = 6_371_000.0
_BENDING = 1.0 - 1.0 / (4.0 / 3.0)
"""Radio waves bend with the Earth as if it were 4/3 as large (ITU-R P.834)."""


def return_findings(path: FlownPath, world: World, limits: Limits, aircraft: Aircraft) -> list[CheckFinding]:
    """Segments from where the autopilot's own return comes too near to the ground: straight up, then straight home."""
    found = []
    for segment in path.distinct:
        if segment.phase != "route":
            continue
        places = _along(segment)
        alts = world.alts_amsl_m(places)
        lines = [_home_line(world, place, float(alt), aircraft) for place, alt in zip(places, alts, strict=True)]
        lowest, where, begin = _lowest(world, lines)
        if lowest >= limits.min_height_agl_m - TOLERANCE_M:
            continue
        lat, lon, alt = world.geodetic(where)
        height_m = return_height_m(
            float(alts[begin]) - world.home_alt_amsl_m, float(np.hypot(*places[begin, :2])), aircraft
        )
        short_m = limits.min_height_agl_m - lowest
        words = f"{-lowest:.1f} m below the ground" if lowest < 0.0 else f"{lowest:.1f} m above it"
        enough_m = math.ceil(height_m + short_m)
        found.append(
            CheckFinding(
                kind="return",
                weight="breaks",
                items=segment.items,
                lat_deg=lat,
                lon_deg=lon,
                alt_amsl_m=alt,
                by=short_m,
                unit="m",
                what=f"the straight return {height_m:.0f} m above home comes {words}",
                do=f"set the return altitude to {enough_m} m above home or more, and give it with --return-height",
            ),
        )
    return joined(found, lambda one: one.kind)


def sight_findings(path: FlownPath, world: World, pilot_m: FloatArray) -> list[CheckFinding]:
    """Segments that terrain hides from the pilot, or from the radio beside him."""
    hidden = []
    for segment in path.distinct:
        if segment.phase not in ("route", "return"):
            continue
        lines = [_bent_line(pilot_m, place) for place in _along(segment)]
        lowest, _, begin = _lowest(world, lines)
        if lowest < -TOLERANCE_M:
            lat, lon, alt = world.geodetic(_along(segment)[begin])
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


def _along(segment: Segment) -> FloatArray:
    """(n, 3) places of a segment, ``STEP_M`` apart or nearer."""
    line = segment.enu_m[np.isfinite(segment.enu_m).all(axis=1)]
    if len(line) < 2:
        return line
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    reached = np.concatenate([[0.0], np.cumsum(steps)])
    count = max(1, math.ceil(reached[-1] / STEP_M))
    at = np.union1d(np.linspace(0.0, reached[-1], count + 1), reached if len(line) <= 3 else reached[[0, -1]])
    return np.column_stack([np.interp(at, reached, line[:, axis]) for axis in range(3)])


def _home_line(world: World, place: FloatArray, alt_amsl_m: float, aircraft: Aircraft) -> FloatArray:
    distance_m = math.hypot(place[0], place[1])
    home_m = world.home_alt_amsl_m
    height_m = home_m + return_height_m(alt_amsl_m - home_m, distance_m, aircraft)
    pieces = max(1, math.ceil(distance_m / _PIECE_M))
    t = np.linspace(0.0, 1.0, pieces + 1)
    heights = np.full(pieces + 1, height_m)
    if aircraft.has_wings:  # climbs, or descends, on the way
        reach = t * distance_m
        slope = (
            aircraft.max_climb_m_s if height_m > alt_amsl_m else aircraft.max_descent_m_s
        ) / aircraft.cruise_speed_m_s
        change = np.minimum(slope * reach, abs(height_m - alt_amsl_m))
        heights = alt_amsl_m + math.copysign(1.0, height_m - alt_amsl_m) * change
    return world.at_alts((1.0 - t)[:, None] * place[:2], heights)


def _bent_line(pilot_m: FloatArray, place: FloatArray) -> FloatArray:
    distance_m = float(np.hypot(*(place - pilot_m)[:2]))
    t = np.linspace(0.0, 1.0, max(2, math.ceil(distance_m / _PIECE_M)) + 1)
    line = pilot_m + t[:, None] * (place - pilot_m)
    line[:, 2] += t * (1.0 - t) * distance_m**2 / (2.0 * _EARTH_RADIUS_M) * _BENDING
    return np.asarray(line)


def _lowest(world: World, lines: list[FloatArray]) -> tuple[float, FloatArray, int]:
    """The least height above ground of some lines, its place, and the number of the line; infinite where nothing is known."""
    if not lines:
        return math.inf, np.zeros(3), 0
    gap = np.full((1, 3), np.nan)
    points = np.vstack([part for line in lines for part in (line, gap)])
    ranges = world.ground.leg_height_ranges_m(points)
    if not np.isfinite(ranges[:, 0]).any():
        return math.inf, np.zeros(3), 0
    k = int(np.nanargmin(ranges[:, 0]))
    begins = np.cumsum([0, *(len(line) + 1 for line in lines)])
    place = points[k] + ranges[k, 1] * (points[k + 1] - points[k])
    return float(ranges[k, 0]), place, int(np.searchsorted(begins, k, side="right")) - 1

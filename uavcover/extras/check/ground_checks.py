"""Heights along every segment at its full length: ground and what stands on it, band, height above home."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import shapely
import shapely.ops

from uavcover.extras.check.findings import CheckFinding, FlownPath, Segment, joined
from uavcover.extras.check.places import OTHER_DATA
from uavcover.extras.check.tuning import CHECKS
from uavcover.extras.check.world import Limits, World
from uavcover.kernels.arrays import FloatArray
from uavcover.new.tuning import TERRAIN


def height_findings(path: FlownPath, world: World, limits: Limits) -> list[CheckFinding]:
    """Segments too near to the ground or in it, too high, or over unknown ground."""
    low, high, unknown, above_home = [], [], [], []
    for whole in path.distinct:
        segment = _cut_at_doubts(whole, world)
        ranges = world.leg_height_ranges_m(segment.enu_m)
        if not np.isfinite(ranges).all():
            unknown.append(_unknown(segment, world, ranges))
        if np.isfinite(ranges).any():
            low += _too_low(segment, world, limits, ranges)
            high += _too_high(segment, world, limits, ranges)
        above_home += _above_home(segment, world, limits)
    return [
        *_worst_of_each(low),
        *joined(high, lambda one: one.kind),
        *joined(above_home, lambda one: one.kind),
        *joined(unknown, lambda one: (one.kind, one.what)),
    ]


def _worst_of_each(findings: list[CheckFinding]) -> list[CheckFinding]:
    """One finding for each pair of items; a leg that is flown again may come from elsewhere."""
    worst: dict[tuple[int, int] | None, CheckFinding] = {}
    for one in findings:
        if one.items not in worst or one.by > worst[one.items].by:
            worst[one.items] = one
    return list(worst.values())


def place_of(segment: Segment, piece: int, at: float) -> FloatArray:
    """The place (3,) at a parameter 0..1 of a piece of a segment."""
    begin, end = segment.enu_m[piece], segment.enu_m[piece + 1]
    return np.asarray(begin + at * (end - begin))


def _too_low(segment: Segment, world: World, limits: Limits, ranges: FloatArray) -> list[CheckFinding]:
    piece = int(np.nanargmin(ranges[:, 0]))
    lowest_m = float(ranges[piece, 0])
    where = place_of(segment, piece, float(ranges[piece, 1]))
    # Take-off and landing touch the ground at their ends, and nowhere else.
    landed_m = CHECKS.landed_m if world.surface is None else TERRAIN.hides_m
    limit_m = limits.min_height_agl_m if segment.phase in ("route", "return") else -landed_m
    if lowest_m >= limit_m - CHECKS.clearance_tolerance_m:
        return []
    short_m = limit_m - lowest_m
    words = height_in_words(lowest_m, where, world)
    a, b = segment.items
    points = f"item {b}" if a in (0, b) or segment.phase != "route" else f"items {a} and {b}"
    what = f"{words}; the limit is {max(limit_m, 0.0):g} m"
    do = _remedy(segment, world, points, short_m)
    return [segment.found("ground", short_m, what=what, do=do).at(world.geodetic(where))]


def _remedy(segment: Segment, world: World, points: str, short_m: float) -> str:
    if segment.phase == "return":
        return "use a greater return height (--return-height), or end the mission with a return transit"
    if segment.phase in ("take-off", "landing") and world.surface is not None:
        return "choose take-off and landing positions away from obstacles"
    return f"raise {points} by {short_m:.0f} m or more, or insert a waypoint"


def height_in_words(lowest_m: float, place_m: FloatArray, world: World) -> str:
    """A least height, above what it is, for people; also above the ground where trees or roofs stand on it."""
    side = f"{-lowest_m:.1f} m below" if lowest_m < 0.0 else f"{lowest_m:.1f} m above"
    bare_m = float(world.ground.heights_agl_m(place_m)[0])
    if world.surface is None or not bare_m - lowest_m > TERRAIN.hides_m:
        return f"{side} the ground"
    return f"{side} the top of trees or roofs ({bare_m:.1f} m above the ground)"


def _too_high(segment: Segment, world: World, limits: Limits, ranges: FloatArray) -> list[CheckFinding]:
    piece = int(np.nanargmax(ranges[:, 2]))
    highest_m = float(ranges[piece, 2])
    if limits.max_height_agl_m is None or highest_m <= limits.max_height_agl_m + CHECKS.clearance_tolerance_m:
        return []
    if segment.phase in ("return", "landing"):
        return []  # the band is that of the route; an autopilot's own return is high on purpose
    over_m = highest_m - limits.max_height_agl_m
    what = f"{highest_m:.0f} m above the ground; the limit is {limits.max_height_agl_m:g} m"
    do = f"fly {over_m:.0f} m lower there, or raise --max-height"
    place = place_of(segment, piece, float(ranges[piece, 3]))
    return [segment.found("height", over_m, what=what, do=do).at(world.geodetic(place))]


def _above_home(segment: Segment, world: World, limits: Limits) -> list[CheckFinding]:
    if limits.max_above_home_m is None:
        return []
    alts = world.alts_amsl_m(segment.enu_m)
    if not np.isfinite(alts).any():
        return []
    k = int(np.nanargmax(alts))
    over_m = float(alts[k]) - world.home_alt_amsl_m - limits.max_above_home_m
    if over_m <= CHECKS.clearance_tolerance_m:
        return []
    what = f"{over_m + limits.max_above_home_m:.0f} m above home; the limit is {limits.max_above_home_m:g} m"
    found = segment.found("above-home", over_m, what=what, do=f"fly {over_m:.0f} m lower there")
    return [found.at(world.geodetic(segment.enu_m[k]))]


def _cut_at_doubts(segment: Segment, world: World) -> Segment:
    """The segment with more places, where it enters or leaves ground that is not believed: the rest is judged."""
    line = segment.enu_m
    doubtful = [shape.buffer(2.0 * world.ground.surface.step_m) for shape, _ in world.ground.left_out]
    if not doubtful or not np.isfinite(line).all():
        return segment
    places = [line[:1]]
    for begin, end in pairwise(line):
        leg = shapely.LineString([begin[:2], end[:2]])
        length_m = leg.length
        cuts = [
            leg.project(shapely.Point(corner)) / length_m
            for shape in doubtful
            if length_m > 0.0 and shape.intersects(leg)
            for corner in shapely.get_coordinates(shape.intersection(leg))
        ]
        inner = np.array(sorted({cut for cut in cuts if 1e-6 < cut < 1.0 - 1e-6})).reshape(-1, 1)
        places += [begin + inner * (end - begin), end[None, :]]
    return replace(segment, enu_m=np.vstack(places))


def _unknown(segment: Segment, world: World, ranges: FloatArray) -> CheckFinding:
    piece = int(np.argmin(np.isfinite(ranges).all(axis=1)))
    place = segment.enu_m[piece]
    leg = shapely.LineString(segment.enu_m[piece : piece + 2, :2])
    reach_m = 2.0 * world.ground.surface.step_m
    for shape, words in world.ground.left_out:
        if np.isfinite(place).all() and shape.distance(leg) <= reach_m:
            nearest = shapely.ops.nearest_points(leg, shape)[0]
            at = np.array([nearest.x, nearest.y, place[2]])
            what = f"the elevation data is implausible here: {words}"
            return CheckFinding(
                kind="suspect-ground", weight="unknown", items=segment.items, what=what, do=OTHER_DATA
            ).at(world.geodetic(at))
    found = CheckFinding(
        kind="no-elevation", weight="unknown", items=segment.items, what="the elevation data contains no height here",
        do="use elevation data that covers the whole flight",
    )  # fmt: skip
    return found.at(world.geodetic(place)) if np.isfinite(place).all() else found

"""Was it safe? Heights, sea-level limits and the fence along the flown track, at its full length."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely
from numpy.typing import NDArray

from uavcover.model.report import Violation, ViolationKind
from uavcover.model.track import Track
from uavcover.site import Site

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

HEIGHT_TOLERANCE_M = 1e-6
_FENCE_STEP_M = 0.25
_ON_THE_FENCE_M = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Phases:
    """What each sample belongs to; every sample to exactly one.

    Attributes:
        route: (n,) between the first and the last planned waypoint.
        column: (n,) take-off and landing, where clearance cannot be asked for.
        junction: (n,) of the transit, straight above or below an end of the planned route: there the band of the route
            applies where it is lower than the transit clearance.
    """

    route: BoolArray
    column: BoolArray
    junction: BoolArray

    @property
    def transit(self) -> BoolArray:
        """(n,) the way there and the way home, junctions included."""
        return ~self.route & ~self.column


@dataclass(frozen=True, slots=True, eq=False)
class Heights:
    """Lowest and highest point above ground next to each sample: on the legs before and after it.

    A leg between two phases counts for the sample of the phase that asks for less: column, then transit, then route.

    Attributes:
        lowest_agl_m: (n,) NaN where the ground, there or on such a leg, is not known.
        highest_agl_m: (n,) likewise.
    """

    lowest_agl_m: FloatArray
    highest_agl_m: FloatArray


def track_heights(site: Site, enu_m: FloatArray, joined: BoolArray, phases: Phases) -> Heights:
    """Heights above ground of an (n, 3) track, between samples too where ``joined`` (n - 1,) says so."""
    here = enu_m[:, 2] - site.ground.heights_m(enu_m[:, :2])
    lowest, highest = here.copy(), here.copy()
    ranges = site.ground.leg_height_ranges_m(enu_m)
    laxity = np.where(phases.column, 2, np.where(phases.route, 0, 1))
    of_leg = np.maximum(laxity[:-1], laxity[1:])
    for side in (slice(None, -1), slice(1, None)):
        counts = joined & (laxity[side] == of_leg)
        lowest[side] = np.where(counts, np.minimum(lowest[side], ranges[:, 0]), lowest[side])
        highest[side] = np.where(counts, np.maximum(highest[side], ranges[:, 2]), highest[side])
    return Heights(lowest, highest)


def find_violations(
    site: Site, track: Track, enu_m: FloatArray, heights: Heights, phases: Phases, joined: BoolArray
) -> list[Violation]:
    """Every stretch of the track on which a limit was not kept, in order of time.

    Where the ground is not known no height is judged here; the verdict says so apart.

    Args:
        site: the scenario on its ground.
        track: the flown track.
        enu_m: (n, 3) its positions.
        heights: above ground.
        phases: of the samples.
        joined: (n - 1,) whether a straight line was flown between two samples.
    """
    limits = site.scenario.limits
    alts = track.geodetic[:, 2]
    distance = _outside_fence_m(site, enu_m, joined)
    outside = distance > 0.0
    route, transit = phases.route, phases.transit
    low, high = heights.lowest_agl_m, heights.highest_agl_m
    tolerance = HEIGHT_TOLERANCE_M
    found: list[Violation] = []

    def add(
        kind: ViolationKind,
        broken: BoolArray,
        value: FloatArray,
        limit: float,
        *,
        smallest: bool,
        phase: Literal["route", "transit"],
    ) -> None:
        for run in _runs(broken):
            worst = run[int(np.argmin(value[run]) if smallest else np.argmax(value[run]))]
            found.append(
                Violation(
                    kind=kind, start_s=float(track.time_s[run[0]]), end_s=float(track.time_s[run[-1]]),
                    worst=float(value[worst]), limit=float(limit),
                    lat_deg=float(track.geodetic[worst, 0]), lon_deg=float(track.geodetic[worst, 1]), phase=phase,
                )
            )  # fmt: skip

    minimum, maximum = limits.min_height_agl_m, limits.max_height_agl_m
    add("below-band", route & (low < minimum - tolerance), low, minimum, smallest=True, phase="route")
    add("above-band", route & (high > maximum + tolerance), high, maximum, smallest=False, phase="route")
    clearance = limits.transit_clearance_m
    open_way = transit & ~phases.junction
    add("clearance", open_way & (low < clearance - tolerance), low, clearance, smallest=True, phase="transit")
    clearance = min(clearance, minimum)
    junction = transit & phases.junction
    add("clearance", junction & (low < clearance - tolerance), low, clearance, smallest=True, phase="transit")
    if limits.min_alt_amsl_m is not None:
        limit = limits.min_alt_amsl_m
        add("below-sea-level-limit", route & (alts < limit - tolerance), alts, limit, smallest=True, phase="route")
    if limits.max_alt_amsl_m is not None:
        limit = limits.max_alt_amsl_m
        add("above-sea-level-limit", route & (alts > limit + tolerance), alts, limit, smallest=False, phase="route")
        add("above-sea-level-limit", ~route & (alts > limit + tolerance), alts, limit, smallest=False, phase="transit")
    add("fence", outside & route, distance, 0.0, smallest=False, phase="route")
    add("fence", outside & ~route, distance, 0.0, smallest=False, phase="transit")
    return sorted(found, key=lambda violation: violation.start_s)


def _outside_fence_m(site: Site, enu_m: FloatArray, joined: BoolArray) -> FloatArray:
    """(n,) how far each sample, or a leg from it whose ends are both inside, lies outside the fence; 0 inside."""
    distance = np.asarray(shapely.distance(site.fence, shapely.points(enu_m[:, :2])), float).copy()
    if len(enu_m) < 2 or site.fence.equals(site.fence.convex_hull):
        return distance
    # Only out of a fence with bays can a straight line lead from inside to inside.
    lines = np.asarray(shapely.linestrings(np.stack([enu_m[:-1, :2], enu_m[1:, :2]], axis=1)))
    ends_inside = (distance[:-1] == 0.0) & (distance[1:] == 0.0)
    across = np.flatnonzero(joined & ends_inside & ~shapely.covers(site.fence, lines))
    for k in across:
        parts = shapely.get_coordinates(shapely.segmentize(lines[k].difference(site.fence), _FENCE_STEP_M))
        furthest = float(np.max(shapely.distance(site.fence, shapely.points(parts)), initial=0.0))
        if furthest > _ON_THE_FENCE_M:
            distance[k : k + 2] = np.maximum(distance[k : k + 2], furthest)
    return distance


def _runs(mask: BoolArray) -> Iterator[NDArray[np.int64]]:
    chosen = np.flatnonzero(mask)
    if chosen.size:
        yield from np.split(chosen, np.flatnonzero(np.diff(chosen) > 1) + 1)

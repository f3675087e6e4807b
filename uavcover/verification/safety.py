"""Was it safe? Heights, sea-level limits, fence and obstacles along the flown track, at its full length."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely
from numpy.typing import NDArray

from uavcover.model.report import Violation, ViolationKind
from uavcover.model.track import Track
from uavcover.site import Site
from uavcover.terrain.clearance import leg_breaches, waypoint_breaches

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

Phase = Literal["route", "transit"]
Unit = Literal["m", "m/s"]

TOLERANCE = 1e-6
"""A limit counts as kept within this much of its own unit: rounding is no violation."""

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
class Figures:
    """A value for each sample, and where along the track it was taken.

    Attributes:
        values: (n,).
        at: (n,) place along the track: sample 7 and a quarter of the way to sample 8 is 7.25.
    """

    values: FloatArray
    at: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Heights:
    """Lowest and highest point above ground next to each sample: on the legs before and after it.

    A leg between two phases counts for the sample of the phase that asks for less: column, then transit, then route.

    Attributes:
        lowest: metres above ground; NaN where the ground, there or on such a leg, is not known.
        highest: likewise.
    """

    lowest: Figures
    highest: Figures


def track_heights(site: Site, enu_m: FloatArray, joined: BoolArray, phases: Phases) -> Heights:
    """Heights above ground of an (n, 3) track, between samples too where ``joined`` (n - 1,) says so."""
    here = site.ground.heights_agl_m(enu_m)
    number = np.arange(len(enu_m), dtype=float)
    lowest, highest, lowest_at, highest_at = here.copy(), here.copy(), number.copy(), number.copy()
    ranges = site.ground.leg_height_ranges_m(enu_m)
    laxity = np.where(phases.column, 2, np.where(phases.route, 0, 1))
    of_leg = np.maximum(laxity[:-1], laxity[1:])
    for side in (slice(None, -1), slice(1, None)):
        counts = joined & (laxity[side] == of_leg)
        # A height that is not known on the leg is not known next to the sample, whatever the leg on the other side says.
        unknown = np.isnan(ranges[:, 0])
        lower = counts & (unknown | (ranges[:, 0] < lowest[side]))
        higher = counts & (unknown | (ranges[:, 2] > highest[side]))
        lowest[side] = np.where(lower, ranges[:, 0], lowest[side])
        highest[side] = np.where(higher, ranges[:, 2], highest[side])
        lowest_at[side] = np.where(lower, number[:-1] + ranges[:, 1], lowest_at[side])
        highest_at[side] = np.where(higher, number[:-1] + ranges[:, 3], highest_at[side])
    return Heights(Figures(lowest, lowest_at), Figures(highest, highest_at))


class ViolationFinder:
    """Finds the stretches of a track on which a limit was not kept.

    Args:
        track: the flown track.
        enu_m: (n, 3) its positions.
    """

    def __init__(self, track: Track, enu_m: FloatArray) -> None:
        self._track, self._enu_m = track, enu_m

    def above(
        self, kind: ViolationKind, where: BoolArray, figures: Figures, limit: float, *, phase: Phase, unit: Unit = "m"
    ) -> Iterator[Violation]:
        """Stretches of the samples ``where`` (n,) with a value above the limit."""
        for run in _runs(where & (figures.values > limit + TOLERANCE)):
            worst = int(run[int(np.argmax(figures.values[run]))])
            yield self._violation(kind, run, worst, figures, limit, float(figures.values[worst]) - limit, phase, unit)

    def below(
        self, kind: ViolationKind, where: BoolArray, figures: Figures, limit: float, *, phase: Phase
    ) -> Iterator[Violation]:
        """Stretches of the samples ``where`` (n,) with a value below the limit."""
        for run in _runs(where & (figures.values < limit - TOLERANCE)):
            worst = int(run[int(np.argmin(figures.values[run]))])
            yield self._violation(kind, run, worst, figures, limit, limit - float(figures.values[worst]), phase, "m")

    def _violation(
        self,
        kind: ViolationKind,
        run: NDArray[np.int64],
        worst: int,
        figures: Figures,
        limit: float,
        excess: float,
        phase: Phase,
        unit: Unit,
    ) -> Violation:
        track = self._track
        at = float(figures.at[worst])
        before = min(int(at), len(track) - 1)
        after, share = min(before + 1, len(track) - 1), at - before

        def read(values: FloatArray) -> FloatArray:
            return np.asarray(values[before] + share * (values[after] - values[before]))

        lat_deg, lon_deg, _ = read(track.geodetic)
        east_m, north_m, _ = read(self._enu_m)
        return Violation(
            kind=kind, start_s=float(track.time_s[run[0]]), end_s=float(track.time_s[run[-1]]),
            worst_s=float(read(track.time_s)), worst=float(figures.values[worst]), limit=float(limit), excess=float(excess),
            unit=unit, lat_deg=float(lat_deg), lon_deg=float(lon_deg), east_m=float(east_m), north_m=float(north_m),
            phase=phase,
        )  # fmt: skip


def find_violations(
    site: Site, track: Track, enu_m: FloatArray, heights: Heights, phases: Phases, joined: BoolArray
) -> list[Violation]:
    """Every stretch of the track on which a limit of height or place was not kept, in order of time.

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
    route, transit = phases.route, phases.transit
    low, high = heights.lowest, heights.highest
    numbers = np.arange(len(track), dtype=float)
    # Along a straight line height above sea level is linear: it is worst at a sample.
    sea = Figures(track.geodetic[:, 2], numbers)
    outside = Figures(_outside_fence_m(site, enu_m, joined), numbers)
    lacking = _lacking_clearance(site, enu_m, joined)
    find = ViolationFinder(track, enu_m)
    found = [
        *find.below("below-band", route, low, limits.min_height_agl_m + site.ground_error_m, phase="route"),
        *find.above("above-band", route, high, limits.max_height_agl_m - site.ground_error_m, phase="route"),
        *find.below("clearance", transit & ~phases.junction, low, limits.transit_clearance_m, phase="transit"),
        *find.below(
            "clearance", transit & phases.junction, low, min(limits.transit_clearance_m, limits.min_height_agl_m),
            phase="transit",
        ),
        *find.above("above-transit-height", ~route, high, site.scenario.transit_ceiling_agl_m, phase="transit"),
        *find.above("fence", route, outside, 0.0, phase="route"),
        *find.above("fence", ~route, outside, 0.0, phase="transit"),
        *find.above("obstacle", route, lacking, 0.0, phase="route"),
        *find.above("obstacle", ~route, lacking, 0.0, phase="transit"),
    ]  # fmt: skip
    if limits.min_alt_amsl_m is not None:
        found += find.below("below-sea-level-limit", route, sea, limits.min_alt_amsl_m, phase="route")
    if limits.max_alt_amsl_m is not None:
        found += find.above("above-sea-level-limit", route, sea, limits.max_alt_amsl_m, phase="route")
        found += find.above("above-sea-level-limit", ~route, sea, limits.max_alt_amsl_m, phase="transit")
    return sorted(found, key=lambda violation: violation.start_s)


def _lacking_clearance(site: Site, enu_m: FloatArray, joined: BoolArray) -> Figures:
    """Metres of clearance from obstacles that each sample of an (n, 3) track lacks, there or on a leg next to it."""
    breaches = waypoint_breaches(site.ground, enu_m, site.scenario.obstacles)
    lacking, at = breaches[:, 1].copy(), np.arange(len(enu_m), dtype=float)
    legs = leg_breaches(site.ground, enu_m, site.scenario.obstacles)
    for k in np.flatnonzero(joined & (legs[:, 1] > 0.0)):
        for sample in (k, k + 1):
            if legs[k, 1] > lacking[sample]:
                lacking[sample], at[sample] = legs[k, 1], k + legs[k, 2]
    return Figures(lacking, at)


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

"""Safety along the full length of the flown track: heights, sea-level limits, fence, obstacles and no-fly zones.

Also speed, and deviation from the planned route.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import shapely
from numpy.typing import NDArray

from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.kernels.route import distances_to_polyline
from uavcover.model.limits import flown_window
from uavcover.model.track import Track
from uavcover.model.vehicle import Vehicle
from uavcover.model.verdict import Violation, ViolationKind
from uavcover.scenario.airspace.zones import Zone, ZoneBreach
from uavcover.scenario.obstacles import leg_breaches, waypoint_breaches
from uavcover.scenario.site import Site, prepared
from uavcover.verification.flown_route import SAFETY, PlannedRoute, observed_stretches
from uavcover.verification.measured_motion import FITTED_STEP_S


def ground_speeds_m_s(track: Track, enu_m: FloatArray, joined: BoolArray) -> FloatArray:
    """(n,) ground speed around each sample: distance flown in the second around it, divided by that time.

    At the ends of an observed stretch the window is cut to that stretch; NaN where nothing is left of it.
    """
    speeds = np.full(len(track), np.nan)
    for run in observed_stretches(np.ones(len(track), dtype=bool), joined):
        if len(run) < 2:
            continue
        time = track.time_s[run]
        legs = np.hypot(*np.diff(enu_m[run, :2], axis=0).T)
        flown = np.concatenate([[0.0], np.cumsum(legs)])
        begin = np.maximum(time - 0.5 * SAFETY.speed_window_s, time[0])
        end = np.minimum(time + 0.5 * SAFETY.speed_window_s, time[-1])
        speeds[run] = (np.interp(end, time, flown) - np.interp(begin, time, flown)) / (end - begin)
    return speeds


def deviations_m(enu_m: FloatArray, route: BoolArray, planned: PlannedRoute | None) -> FloatArray | None:
    """(n,) distance of each sample on the route from the planned one, NaN elsewhere. None without plan or route."""
    if planned is None or len(planned.waypoints_m) == 0 or not route.any():
        return None
    distances = np.full(len(enu_m), np.nan)
    distances[route] = distances_to_polyline(
        np.ascontiguousarray(enu_m[route]), np.ascontiguousarray(planned.waypoints_m)
    )
    return distances


def commanded_pace_doubt(
    track: Track,  # the samples that are evidence
    enu_m: FloatArray,  # (n, 3) their positions
    joined: BoolArray,  # (n - 1,) whether nothing is missing between a sample and the next
    vehicle: Vehicle,  # whose speeds are commanded
    planned: PlannedRoute | None,  # the planned route; None: no speed is expected of it
    *,
    # (k,) the planned waypoints that the vehicle passed: a leg between others was not flown; None: all were
    passed: BoolArray | None = None,
) -> str | None:
    """Reason why the pace of a track cannot be that of its mission; None when it can.

    Windows of 5 s are evaluated. A vehicle that is persistently faster than its mission commands has a wrong clock or wrong
    positions, or was flown otherwise; so has one that never approaches the commanded speed on a leg long enough for it.
    """
    time = track.time_s
    first = np.flatnonzero(np.diff(np.floor(time / FITTED_STEP_S), prepend=-np.inf))
    last = np.searchsorted(time, time[first] + SAFETY.sustained_s)
    gaps = np.concatenate([[0], np.cumsum(~joined)])
    inside = np.flatnonzero(last < len(time))
    inside = inside[gaps[last[inside]] == gaps[first[inside]]]
    first, last = first[inside], last[inside]
    if first.size == 0:
        return None
    seconds = time[last] - time[first]
    moved = enu_m[last] - enu_m[first]
    level, vertical = np.hypot(moved[:, 0], moved[:, 1]) / seconds, moved[:, 2] / seconds
    moving = level > SAFETY.moving * vehicle.cruise_speed_m_s
    cruise = vehicle.cruise_speed_m_s
    tell = "; its clock or positions are scaled, or the flight differs from the plan"
    fast = float(np.percentile(level[moving], 95.0)) if moving.any() else 0.0
    for what, sustained, wanted, most in (
        ("flies", fast, cruise, 1.25 * cruise + 2.0),
        ("climbs", float(vertical.max()), vehicle.max_climb_m_s, 1.25 * vehicle.max_climb_m_s + 1.0),
        ("descends", float(-vertical.min()), vehicle.max_descent_m_s, 1.25 * vehicle.max_descent_m_s + 1.0),
    ):
        if sustained > most:
            return f"the vehicle {what} at {sustained:.1f} m/s for several seconds instead of the planned {wanted:g} m/s{tell}"
    if planned is None or len(planned.waypoints_m) < 2:
        return None
    legs = np.diff(planned.waypoints_m, axis=0)
    lengths_m = np.hypot(legs[:, 0], legs[:, 1])
    steep = np.maximum(legs[:, 2] / vehicle.max_climb_m_s, -legs[:, 2] / vehicle.max_descent_m_s)
    pace = lengths_m / np.maximum(np.maximum(lengths_m / cruise, steep), 1e-9)
    long_enough = lengths_m >= 2.0 * SAFETY.sustained_s * cruise
    if passed is not None:
        long_enough &= passed[:-1] & passed[1:]
    if not long_enough.any():
        return None
    expected, fastest = float(pace[long_enough].max()), float(level.max())
    if fastest < SAFETY.too_slow * expected:
        return f"the vehicle never flies faster than {fastest:.1f} m/s instead of the planned {expected:.1f} m/s{tell}"
    return None


Phase = Literal["route", "transit"]
Unit = Literal["m", "m/s"]


@dataclass(frozen=True, slots=True, eq=False)
class Phases:
    """The phase of each sample; every sample belongs to exactly one."""

    route: BoolArray  # (n,) between the first and the last planned waypoint
    vertical: BoolArray  # (n,) take-off and landing, where clearance cannot be required
    # (n,) part of the transit directly above or below an end of the planned route; there the band of the route applies
    # where it is lower than the transit clearance
    junction: BoolArray

    @property
    def transit(self) -> BoolArray:
        """(n,) both transits, junctions included."""
        return ~self.route & ~self.vertical


@dataclass(frozen=True, slots=True, eq=False)
class SampleValues:
    """A value for each sample, and its position along the track."""

    values: FloatArray  # (n,) the values
    at: FloatArray  # (n,) position along the track in samples: 7.25 is a quarter of the way from sample 7 to sample 8


@dataclass(frozen=True, slots=True, eq=False)
class Heights:
    """Lowest and highest height above ground on the legs before and after each sample.

    A leg between two phases counts for the less strict one: column, then transit, then route.
    """

    lowest: SampleValues  # metres above ground; NaN where the ground there, or below such a leg, is unknown
    highest: SampleValues  # as ``lowest``, but the greatest heights


def track_heights(site: Site, enu_m: FloatArray, joined: BoolArray, phases: Phases) -> Heights:
    """Heights above ground of an (n, 3) track, between samples too where ``joined`` (n - 1,) says so."""
    here = site.ground.heights_agl_m(enu_m)
    number = np.arange(len(enu_m), dtype=float)
    lowest, highest, lowest_at, highest_at = here.copy(), here.copy(), number.copy(), number.copy()
    ranges = site.ground.leg_height_ranges_m(enu_m)
    laxity = np.where(phases.vertical, 2, np.where(phases.route, 0, 1))
    of_leg = np.maximum(laxity[:-1], laxity[1:])
    for side in (slice(None, -1), slice(1, None)):
        counts = joined & (laxity[side] == of_leg)
        # an unknown height on one leg makes the sample's height unknown; the other leg does not matter.
        unknown = np.isnan(ranges[:, 0])
        lower = counts & (unknown | (ranges[:, 0] < lowest[side]))
        higher = counts & (unknown | (ranges[:, 2] > highest[side]))
        lowest[side] = np.where(lower, ranges[:, 0], lowest[side])
        highest[side] = np.where(higher, ranges[:, 2], highest[side])
        lowest_at[side] = np.where(lower, number[:-1] + ranges[:, 1], lowest_at[side])
        highest_at[side] = np.where(higher, number[:-1] + ranges[:, 3], highest_at[side])
    return Heights(SampleValues(lowest, lowest_at), SampleValues(highest, highest_at))


class ViolationFinder:
    """Finds the stretches of a track that exceed a limit.

    Args:
        track: the flown track.
        enu_m: (n, 3) its positions.
    """

    def __init__(self, track: Track, enu_m: FloatArray) -> None:
        self._track, self._enu_m = track, enu_m

    def above(
        self,
        kind: ViolationKind,
        where: BoolArray,
        figures: SampleValues,
        limit: float,
        *,
        phase: Phase,
        unit: Unit = "m",
    ) -> Iterator[Violation]:
        """Stretches of the samples ``where`` (n,) with a value above the limit."""
        for run in _runs(where & (figures.values > limit + SAFETY.speed_tolerance)):
            worst = int(run[int(np.argmax(figures.values[run]))])
            yield self._violation(kind, run, worst, figures, limit, float(figures.values[worst]) - limit, phase, unit)

    def below(
        self, kind: ViolationKind, where: BoolArray, figures: SampleValues, limit: float, *, phase: Phase
    ) -> Iterator[Violation]:
        """Stretches of the samples ``where`` (n,) with a value below the limit."""
        for run in _runs(where & (figures.values < limit - SAFETY.speed_tolerance)):
            worst = int(run[int(np.argmin(figures.values[run]))])
            yield self._violation(kind, run, worst, figures, limit, limit - float(figures.values[worst]), phase, "m")

    def _violation(
        self,
        kind: ViolationKind,
        run: NDArray[np.int64],
        worst: int,
        figures: SampleValues,
        limit: float,
        excess: float,
        phase: Phase,
        unit: Unit,
    ) -> Violation:
        track = self._track
        at = float(figures.at[worst])
        before = min(int(at), len(track) - 1)
        after, fraction = min(before + 1, len(track) - 1), at - before

        def read(values: FloatArray) -> FloatArray:
            return np.asarray(values[before] + fraction * (values[after] - values[before]))

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
    """Find every stretch of the track that exceeds a limit of height or position, in order of time.

    Where the ground is unknown, no height is judged here; the verdict reports that separately.

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
    # Along a straight line height above sea level is linear, so its extremes are at samples.
    sea = SampleValues(track.geodetic[:, 2], numbers)
    outside = SampleValues(_outside_fence_m(site, enu_m, joined), numbers)
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
    for zone, inside in _inside_zones(site, track, enu_m, joined):
        breaches = [
            *find.above("no-fly-zone", route, inside, 0.0, phase="route"),
            *find.above("no-fly-zone", ~route, inside, 0.0, phase="transit"),
        ]
        found += [replace(breach, name=zone.name) for breach in breaches]
    if limits.min_alt_amsl_m is not None:
        found += find.below("below-sea-level-limit", route, sea, limits.min_alt_amsl_m, phase="route")
    if limits.max_alt_amsl_m is not None:
        found += find.above("above-sea-level-limit", route, sea, limits.max_alt_amsl_m, phase="route")
        found += find.above("above-sea-level-limit", ~route, sea, limits.max_alt_amsl_m, phase="transit")
    return sorted(found, key=lambda violation: violation.start_s)


def _lacking_clearance(site: Site, enu_m: FloatArray, joined: BoolArray) -> SampleValues:
    """Metres of missing clearance from obstacles for each sample of an (n, 3) track, there or on an adjacent leg."""
    breaches = waypoint_breaches(site.ground, enu_m, site.scenario.obstacles)
    lacking, at = breaches[:, 1].copy(), np.arange(len(enu_m), dtype=float)
    legs = leg_breaches(site.ground, enu_m, site.scenario.obstacles)
    for k in np.flatnonzero(joined & (legs[:, 1] > 0.0)):
        for sample in (k, k + 1):
            if legs[k, 1] > lacking[sample]:
                lacking[sample], at[sample] = legs[k, 1], k + legs[k, 2]
    return SampleValues(lacking, at)


def _zone_entries(
    site: Site, track: Track, enu_m: FloatArray, joined: BoolArray
) -> Iterator[tuple[Zone, ZoneBreach, tuple[int, ...], bool | None]]:
    """Find the samples and legs of a track inside each no-fly zone, and whether the zone was in force then.

    Where the track does not tell the time of day, zones of the flight window are in force, and of others it is not known (None).
    """
    zones = (*site.zones, *site.other_zones)
    check = replace(site.flown_zones, zones=zones)
    found: list[tuple[ZoneBreach, tuple[int, ...]]]
    found = [(breach, (breach.leg,)) for breach in check.position_breaches(enu_m)]
    if len(enu_m) > 1:
        found += [(breach, (breach.leg, breach.leg + 1)) for breach in check.leg_breaches(enu_m, joined)]
    for breach, samples in found:
        zone, window = zones[breach.zone], flown_window(track.unix_time_s[list(samples)])
        unknown = True if breach.zone < len(site.zones) else None
        yield zone, breach, samples, unknown if window is None else zone.entry.in_force(window)


def zones_at_unknown_time(site: Site, track: Track, enu_m: FloatArray, joined: BoolArray) -> list[str]:
    """Zones outside the flight window that a track without a time of day enters, by name."""
    if not site.other_zones:
        return []
    entries = _zone_entries(site, track, enu_m, joined)
    return sorted({zone.name for zone, _, _, in_force in entries if in_force is None})


def _inside_zones(
    site: Site, track: Track, enu_m: FloatArray, joined: BoolArray
) -> Iterator[tuple[Zone, SampleValues]]:
    """For each no-fly zone that was entered: metres inside its outline, for each sample, there or on an adjacent leg."""
    numbers = np.arange(len(enu_m), dtype=float)
    entered: dict[int, tuple[Zone, SampleValues]] = {}
    for zone, breach, samples, in_force in _zone_entries(site, track, enu_m, joined):
        if not in_force:
            continue
        _, inside = entered.setdefault(breach.zone, (zone, SampleValues(np.zeros(len(enu_m)), numbers.copy())))
        # To be in a zone at all is a violation, however little it is.
        depth_m = max(breach.depth_m, 2.0 * SAFETY.speed_tolerance)
        for sample in samples:
            if depth_m > inside.values[sample]:
                inside.values[sample], inside.at[sample] = depth_m, breach.leg + breach.at
    for _, found in sorted(entered.items()):
        yield found


def _outside_fence_m(site: Site, enu_m: FloatArray, joined: BoolArray) -> FloatArray:
    """(n,) distance outside the fence of each sample, or of a leg from it with both ends inside; 0 inside."""
    distance, fence = np.zeros(len(enu_m)), prepared(site.fence)
    outside = np.flatnonzero(~shapely.contains_xy(fence, enu_m[:, 0], enu_m[:, 1]))
    distance[outside] = shapely.distance(site.fence, shapely.points(enu_m[outside, :2]))
    if len(enu_m) < 2 or site.fence.equals(site.fence.convex_hull):
        return distance
    # Only in a non-convex fence can a line between inside points leave it.
    lines = np.asarray(shapely.linestrings(np.stack([enu_m[:-1, :2], enu_m[1:, :2]], axis=1)))
    ends_inside = (distance[:-1] == 0.0) & (distance[1:] == 0.0)
    across = np.flatnonzero(joined & ends_inside & ~shapely.covers(fence, lines))
    for k in across:
        parts = shapely.get_coordinates(shapely.segmentize(lines[k].difference(site.fence), SAFETY.fence_step_m))
        furthest = float(np.max(shapely.distance(site.fence, shapely.points(parts)), initial=0.0))
        if furthest > SAFETY.on_the_fence_m:
            distance[k : k + 2] = np.maximum(distance[k : k + 2], furthest)
    return distance


def _runs(mask: BoolArray) -> Iterator[NDArray[np.int64]]:
    chosen = np.flatnonzero(mask)
    if chosen.size:
        yield from np.split(chosen, np.flatnonzero(np.diff(chosen) > 1) + 1)

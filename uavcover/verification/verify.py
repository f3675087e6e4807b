"""The verdict on a flown track."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavcover.coverage.coverage_map import CoverageMap
from uavcover.errors import TrackError
from uavcover.kernels.coverage import sample_path
from uavcover.kernels.polyline import distances_to_polyline
from uavcover.model.report import VerificationReport
from uavcover.model.track import Track
from uavcover.site import Site
from uavcover.verification.gaps import find_gaps
from uavcover.verification.phases import PlannedRoute, observed_stretches, on_route
from uavcover.verification.safety import Phases, find_violations, track_heights

FloatArray = NDArray[np.float64]

MAX_CONTRADICTION_M = 1.0
"""Largest difference between a track's local columns and its latitudes and longitudes."""

_PLACE_RADII = 2.0
_PLACE_MARGIN_M = 2.0
"""A place is kept within two acceptance radii, and a little for wind: home while climbing and landing, a waypoint."""


@dataclass(frozen=True, slots=True, eq=False)
class FlownCoverage:
    """What was seen, and when.

    Attributes:
        seen: (cells,) whether each cell was seen.
        first_seen_s: (cells,) vehicle time at which it was first seen, NaN where it was not.
    """

    seen: NDArray[np.bool_]
    first_seen_s: FloatArray


def track_positions_m(site: Site, track: Track) -> FloatArray:
    """(n, 3) ENU positions of a track: from its latitudes, longitudes and heights where the site has a place on Earth."""
    if site.frame is None:
        return track.enu_m
    return site.frame.enu_from_geodetic(*track.geodetic.T)


def flown_coverage(coverage: CoverageMap, track: Track, planned: PlannedRoute | None) -> FlownCoverage:
    """What a track saw between its first and last planned waypoint, by the sensor of the scenario.

    Raises:
        TrackError: the sensor looks from waypoints only, and there is no plan that says where they are.
    """
    site = coverage.site
    enu = track_positions_m(site, track)
    looks, times = _looks(site, track, enu, planned)
    first = coverage.first_seen(looks)
    seen = first >= 0
    when = np.full(coverage.grid.count, np.nan)
    when[seen] = times[first[seen]]
    return FlownCoverage(seen, when)


def verify_track(site: Site, coverage: CoverageMap, track: Track, planned: PlannedRoute | None) -> VerificationReport:
    """Coverage and safety of what was flown, from the track alone; the plan is only compared with.

    Args:
        site: the scenario on its ground.
        coverage: on the cells that results are judged on.
        track: what was flown.
        planned: what was planned, for the deviation and for which part of the track is the route.

    Raises:
        TrackError: the track is empty, or has a position that is no place on Earth.
    """
    if len(track) == 0:
        raise TrackError("the track has no samples: nothing was flown, or nothing was recorded")
    requirements = site.scenario.requirements
    enu = track_positions_m(site, track)
    if not np.isfinite(enu).all():
        bad = int(np.argmin(np.isfinite(enu).all(axis=1)))
        raise TrackError(
            f"sample {bad} of the track, at {track.time_s[bad]} s, is no place on Earth; are latitude and longitude swapped?"
        )
    joined = np.diff(track.time_s) <= requirements.max_gap_s
    phases = _phases(site, track, enu, planned)
    route, transit = phases.route, phases.transit
    heights = track_heights(site, enu, joined, phases)
    violations = find_violations(site, track, enu, heights, phases, joined)
    flown = flown_coverage(coverage, track, planned)
    share = coverage.share_of_coverable(flown.seen)
    deviation = None
    if planned is not None and len(planned.waypoints_m) and route.any():
        deviation = float(distances_to_polyline(enu[route], np.ascontiguousarray(planned.waypoints_m)).max())
    unobserved = float(np.diff(track.time_s)[~joined].sum())
    unknown = np.isnan(heights.lowest_agl_m) & ~phases.column

    reasons = []
    if share < requirements.min_coverage_of_coverable:
        reasons.append(
            f"coverage {100 * share:.2f} % of the coverable area is below the required "
            f"{100 * requirements.min_coverage_of_coverable:.2f} %"
        )
    if violations:
        kinds = sorted({violation.kind for violation in violations})
        reasons.append(f"{len(violations)} violations of the limits ({', '.join(kinds)})")
    if unknown.any():
        first = float(track.time_s[int(np.argmax(unknown))])
        reasons.append(
            f"no elevation data under {int(unknown.sum())} samples of the flight, first at {first:.1f} s: their height "
            "above ground cannot be judged (if that is far away, latitude and longitude may be swapped)"
        )
    if requirements.max_deviation_m is not None and (deviation is None or deviation > requirements.max_deviation_m):
        flown_off = "unknown" if deviation is None else f"{deviation:.1f} m"
        reasons.append(f"the deviation from the planned route, {flown_off}, is above {requirements.max_deviation_m} m")
    contradiction = float(np.max(np.linalg.norm(enu - track.enu_m, axis=1)))
    if not contradiction <= MAX_CONTRADICTION_M:
        reasons.append(
            "the track contradicts itself: east, north, up differ from latitude, longitude, height by up to "
            f"{contradiction:.1f} m"
        )
    return VerificationReport(
        coverage_fraction=coverage.share(flown.seen),
        coverage_of_coverable=share,
        planned_coverage_fraction=None if planned is None else planned.coverage_fraction,
        min_height_agl_m=_smallest(heights.lowest_agl_m[route]),
        max_height_agl_m=_largest(heights.highest_agl_m[route]),
        min_transit_clearance_m=_smallest(heights.lowest_agl_m[transit]),
        violations=tuple(violations),
        max_deviation_m=deviation,
        gaps=tuple(find_gaps(coverage, flown.seen)),
        samples=len(track),
        unobserved_s=unobserved,
        passed=not reasons,
        reasons=tuple(reasons),
    )


def _phases(site: Site, track: Track, enu_m: FloatArray, planned: PlannedRoute | None) -> Phases:
    route = _route(site, track, enu_m, planned)
    radius = _PLACE_RADII * site.scenario.vehicle.acceptance_radius_m + _PLACE_MARGIN_M

    def at(place_m: FloatArray) -> NDArray[np.bool_]:
        return np.asarray(np.hypot(enu_m[:, 0] - place_m[0], enu_m[:, 1] - place_m[1]) <= radius)

    nowhere = np.zeros(len(enu_m), dtype=bool)
    column = nowhere if site.home_m is None else at(site.home_m)
    junction = nowhere
    if planned is not None and len(planned.waypoints_m):
        junction = at(planned.waypoints_m[0]) | at(planned.waypoints_m[-1])
    return Phases(route=route, column=column & ~route, junction=junction & ~route & ~column)


def _route(site: Site, track: Track, enu_m: FloatArray, planned: PlannedRoute | None) -> NDArray[np.bool_]:
    return on_route(track, enu_m, planned, acceptance_radius_m=site.scenario.vehicle.acceptance_radius_m)


def _smallest(values: FloatArray) -> float | None:
    known = values[np.isfinite(values)]
    return float(known.min()) if known.size else None


def _largest(values: FloatArray) -> float | None:
    known = values[np.isfinite(values)]
    return float(known.max()) if known.size else None


def _looks(site: Site, track: Track, enu_m: FloatArray, planned: PlannedRoute | None) -> tuple[FloatArray, FloatArray]:
    """Places (k, 3) from which the sensor looked, and their times (k,), in order of time."""
    if site.scenario.sensor.sensing == "at-waypoints":
        return _looks_at_waypoints(site, track, enu_m, planned)
    mask = _route(site, track, enu_m, planned)
    runs = observed_stretches(track, mask, max_gap_s=site.scenario.requirements.max_gap_s)
    places: list[FloatArray] = []
    times: list[FloatArray] = []
    for run in runs:
        points = sample_path(np.ascontiguousarray(enu_m[run]), site.scenario.sensor.sample_spacing_m)
        # Time along a run by the distance flown: both are increasing, so this is the flown track read in between.
        flown = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(enu_m[run], axis=0), axis=1))])
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        places.append(points)
        times.append(np.interp(along, flown, track.time_s[run]))
    if not places:
        return np.empty((0, 3)), np.empty(0)
    return np.vstack(places), np.concatenate(times)


def _looks_at_waypoints(
    site: Site, track: Track, enu_m: FloatArray, planned: PlannedRoute | None
) -> tuple[FloatArray, FloatArray]:
    """One look at each planned waypoint that was reached, from where the vehicle was nearest to it."""
    if planned is None:
        raise TrackError("the sensor looks from the waypoints; without plan.json it is not known where these are")
    radius = _PLACE_RADII * site.scenario.vehicle.acceptance_radius_m
    chosen = []
    for point in planned.waypoints_m:
        distance = np.linalg.norm(enu_m - point, axis=1)
        nearest = int(np.argmin(distance))
        if distance[nearest] <= radius:
            chosen.append(nearest)
    numbers = np.array(sorted(chosen), dtype=np.int64)
    return enu_m[numbers].reshape(-1, 3), track.time_s[numbers]

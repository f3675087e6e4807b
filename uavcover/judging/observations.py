"""Observations along a flown track: from where, in which direction, and when the sensor looked."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavcover.errors import TrackError
from uavcover.judging.phases import PlannedRoute, observed_stretches
from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.kernels.coverage import picture_places
from uavcover.model.track import Track
from uavcover.scenario.site import Site
from uavcover.sensing.sensors import camera_turn, sample_spacing_m, sight_of, trigger_distance_m, turns_with_legs

_LARGEST_TURN_DEG = 2.0
"""Between two observations. At 60 degrees a second ten samples a second are 6 degrees apart, and the corners of what a camera
shows in between are a point of a small area (tests/random_kinds.py, case 23)."""

REACHED_RADII = 2.0
"""A planned waypoint counts as reached within this many acceptance radii."""


@dataclass(frozen=True, slots=True, eq=False)
class Observations:
    """Observations of a sensor in order of time.

    Attributes:
        places_m: (k, 3) ENU positions.
        axes: (k, 3) ENU unit vectors along the camera's viewing direction.
        tops: (k, 3) unit vectors perpendicular to them, towards the top of the picture.
        times_s: (k,) times.
        known: (k,) whether the attitude is known; otherwise level and nose ahead are assumed.
    """

    places_m: FloatArray
    axes: FloatArray
    tops: FloatArray
    times_s: FloatArray
    known: BoolArray

    def __len__(self) -> int:
        return int(self.times_s.size)

    def where(self, chosen: BoolArray) -> "Observations":
        """The selected observations."""
        return Observations(
            self.places_m[chosen], self.axes[chosen], self.tops[chosen], self.times_s[chosen], self.known[chosen]
        )


def observations_of(
    site: Site, track: Track, enu_m: FloatArray, route: BoolArray, joined: BoolArray, planned: PlannedRoute | None
) -> Observations:
    """The observations of a track on the planned route, by the sensing rule of the scenario.

    Along the path there is one at every sample, and enough between samples to keep them ``sample_spacing_m`` apart, and a camera
    that turns with the vehicle 2 degrees; or, with pictures by distance, one at the start and one whenever the vehicle is that
    far from the last one, as autopilots trigger. Position, attitude and time are interpolated linearly. There are none between
    samples that are not joined. Where the track lacks the yaw that a picture needs, nose ahead is assumed. From waypoints, the
    pictures that the vehicle told of count, where it told of any; else every planned waypoint that was reached.

    Args:
        site: the scenario on its ground.
        track: what was flown.
        enu_m: (n, 3) its positions.
        route: (n,) which samples belong to the planned route.
        joined: (n - 1,) legs that were observed.
        planned: the plan, if there is one.

    Raises:
        TrackError: the sensor looks from waypoints only, and there is no plan that says where they are.
    """
    sensor = site.scenario.sensor
    if sensor.sensing == "at-waypoints":
        before, share = _at_waypoints(site, track, enu_m, joined, planned), np.empty(0)
    else:
        runs = observed_stretches(route, joined)
        trigger_m = trigger_distance_m(site.scenario)
        if trigger_m is None:
            turns_deg = _turns_deg(track) if turns_with_legs(sight_of(sensor)) else None
            parts = [_between(run, enu_m, sample_spacing_m(site.scenario), turns_deg) for run in runs]
        else:
            parts = [_pictures(run, enu_m, trigger_m) for run in runs]
        before = np.concatenate([part[0] for part in parts]) if parts else np.empty(0, dtype=np.int64)
        share = np.concatenate([part[1] for part in parts]) if parts else np.empty(0)
    if share.size == 0:
        share = np.zeros(before.size)
    after = np.minimum(before + 1, len(track) - 1)

    def read(values: FloatArray) -> FloatArray:
        t = share if values.ndim == 1 else share[:, None]
        # An observation at a sample ignores the next sample, which may be far away or NaN.
        return np.asarray(np.where(t == 0.0, values[before], values[before] + t * (values[after] - values[before])))

    attitude = np.column_stack([track.attitude_deg[:, :2], np.unwrap(track.attitude_deg[:, 2], period=360.0)])
    # np.unwrap propagates a missing yaw to the end; later samples know theirs.
    attitude[:, 2] = np.where(np.isfinite(attitude[:, 2]), attitude[:, 2], track.attitude_deg[:, 2])
    course = enu_m[after] - enu_m[np.where(after > before, before, np.maximum(before - 1, 0))]
    turn = camera_turn(sensor, read(attitude), np.degrees(np.arctan2(course[:, 0], course[:, 1])))
    return Observations(np.ascontiguousarray(read(enu_m)), turn.axes, turn.tops, read(track.time_s), turn.known)


def level_observations(site: Site, path_m: FloatArray, time_s: float) -> Observations:
    """Possible observations along a path without samples, as if it had been flown level; pictures may be anywhere on it."""
    sensor = site.scenario.sensor
    share = _between(np.arange(len(path_m)), path_m, sample_spacing_m(site.scenario))
    before, part = share
    after = np.minimum(before + 1, len(path_m) - 1)
    places = path_m[before] + part[:, None] * (path_m[after] - path_m[before])
    course = path_m[after] - path_m[np.where(after > before, before, np.maximum(before - 1, 0))]
    unknown = np.full((len(places), 3), np.nan)
    turn = camera_turn(sensor, unknown, np.degrees(np.arctan2(course[:, 0], course[:, 1])))
    times = np.full(len(places), time_s)
    return Observations(np.ascontiguousarray(places), turn.axes, turn.tops, times, np.zeros(len(places), dtype=bool))


def _turns_deg(track: Track) -> FloatArray:
    """(n - 1,) degrees by which the nose turns from sample to sample, the short way; 0 where that is not known."""
    return np.nan_to_num(np.abs((np.diff(track.attitude_deg[:, 2]) + 180.0) % 360.0 - 180.0))


def _between(
    run: NDArray[np.int64], enu_m: FloatArray, spacing_m: float, turns_deg: FloatArray | None = None
) -> tuple[NDArray[np.int64], FloatArray]:
    """The sample before each observation of a run of samples, and the fraction of the way to the next one, 0..1."""
    legs = np.linalg.norm(np.diff(enu_m[run], axis=0), axis=1)
    pieces = np.maximum(1, np.ceil(legs / spacing_m - 1e-9).astype(np.int64))
    if turns_deg is not None:
        pieces = np.maximum(pieces, np.ceil(turns_deg[run[:-1]] / _LARGEST_TURN_DEG - 1e-9).astype(np.int64))
    leg = np.repeat(np.arange(len(legs)), pieces)
    piece = np.arange(len(leg)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    return np.append(run[leg], run[-1]), np.append(piece / pieces[leg], 0.0)


def _pictures(run: NDArray[np.int64], enu_m: FloatArray, trigger_m: float) -> tuple[NDArray[np.int64], FloatArray]:
    """As :func:`_between` for pictures by distance: the trigger begins anew with every run."""
    legs, shares = picture_places(np.ascontiguousarray(enu_m[run]), trigger_m)
    # At the end of a leg it is the next sample: from there on another one may be far away or NaN.
    ends = shares == 1.0
    return run[legs + ends], np.where(ends, 0.0, shares)


def pictures_told(track: Track) -> bool:
    """Whether the vehicle told of at least one picture during the track, or that there was none: a count of 0 throughout."""
    known = track.pictures_taken[np.isfinite(track.pictures_taken)]
    rises = bool((np.diff(known) > 0).any()) or bool(np.isnan(track.pictures_taken[:1]).any())
    return bool(known.size) and (rises or not known.any())


def _at_waypoints(
    site: Site, track: Track, enu_m: FloatArray, joined: BoolArray, planned: PlannedRoute | None
) -> NDArray[np.int64]:
    """Samples from which a sensor looked that looks from the waypoints: where pictures came back, or else where these are.

    A picture counts at the first sample that knows of it, if the one before is joined to it. Where the count rises by more than
    one, messages were lost: the waypoints reached since the last report, as many as pictures are missing, count too.
    """
    if not pictures_told(track):
        return _reached(site, enu_m, planned)
    taken = track.pictures_taken.copy()
    known = np.flatnonzero(np.isfinite(taken))
    # Before the first report, one less than it tells; from then on what was told last.
    first, start = known[0], taken[known[0]] - (known[0] > 0)
    filled = taken[np.maximum.accumulate(np.where(np.isfinite(taken), np.arange(len(taken)), first))]
    filled[:first] = start
    gained = np.diff(filled)
    reports = np.flatnonzero((gained > 0) & joined) + 1
    chosen = set(reports.tolist())
    lost = np.flatnonzero(gained > 1) + 1
    if lost.size and planned is not None:
        reached = _reached(site, enu_m, planned)
        for report in lost.tolist():
            earlier = np.flatnonzero(gained[: report - 1] > 0)
            since = int(earlier[-1]) + 1 if earlier.size else -1
            between = reached[(reached > since) & (reached < report)]
            chosen.update(between[-(int(gained[report - 1]) - 1) :].tolist())
    return np.array(sorted(chosen), dtype=np.int64)


def missing_pictures(
    site: Site, track: Track, enu_m: FloatArray, joined: BoolArray, planned: PlannedRoute | None
) -> str | None:
    """What to tell where fewer pictures came back than waypoints were reached; none where all did, or nothing is known."""
    if site.scenario.sensor.sensing != "at-waypoints" or planned is None:
        return None
    if not pictures_told(track):
        return "nothing is told of pictures: every planned waypoint that was reached counts as one"
    reached, looks = len(_reached(site, enu_m, planned)), len(_at_waypoints(site, track, enu_m, joined, planned))
    if looks >= reached:
        return None
    return f"{reached} planned waypoints were reached, and {looks} pictures came back: only these count"


def _reached(site: Site, enu_m: FloatArray, planned: PlannedRoute | None) -> NDArray[np.int64]:
    """Numbers of the samples nearest to each planned waypoint that was reached."""
    if planned is None:
        raise TrackError("the sensor looks from the waypoints; without plan.json it is not known where these are")
    radius = REACHED_RADII * site.scenario.vehicle.acceptance_radius_m
    chosen = []
    for point in planned.waypoints_m:
        distance = np.linalg.norm(enu_m - point, axis=1)
        nearest = int(np.argmin(distance))
        if distance[nearest] <= radius:
            chosen.append(nearest)
    return np.array(sorted(chosen), dtype=np.int64)

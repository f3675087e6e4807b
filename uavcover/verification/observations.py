"""Observations along a flown track: positions, directions and times of the sensor, or its photos.

If the vehicle reports photos, only these count. Predicted trigger points show where reports are missing, and the positions of
photos whose message was lost: the vehicle counts its photos, so a count that rises by three means three photos.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavcover.errors import TrackError
from uavcover.kernels.arrays import BoolArray, FloatArray, IntArray
from uavcover.kernels.coverage import photo_positions
from uavcover.model.track import Track
from uavcover.model.verdict import MissingPhotos, PhotoSource
from uavcover.scenario.site import Site
from uavcover.sensing.sensors import sample_spacing_m, trigger_distance_m, turns_with_legs
from uavcover.verification.flown_route import TRACK, PlannedRoute, lat_lon_deg, length_of_m, observed_stretches

_REACHED_RADII = 2.0
_MATCH_FRACTION = 0.5
"""A predicted trigger point within this fraction of the trigger distance from a reported photo is that photo."""
_SHOWN = 3


@dataclass(frozen=True, slots=True, eq=False)
class TrackPhotos:
    """Positions of photos, and stretches without a report."""

    source: PhotoSource  # whether the vehicle reported them, or the track predicts them
    before: IntArray  # (k,) the sample at or before each photo
    fraction: FloatArray  # (k,) fraction of the way from it to the next sample, 0..1
    expected: int  # number of photos that the plan takes where the track is on its route
    missing: tuple[MissingPhotos, ...] = ()  # stretches without the photos that were expected
    # (n, 3) ENU each: paths on which photos may have been taken at places that are not known
    perhaps_m: tuple[FloatArray, ...] = ()

    @property
    def findings(self) -> list[str]:
        """Findings on the photos, one line each."""
        if self.source == "predicted":
            return [
                "the vehicle reported no photos, so every planned photo counts as taken; with --require-photos, "
                "the flight would not be proved"
            ]
        if not self.missing:
            return []
        lacking = sum(stretch.expected for stretch in self.missing)
        longest = sorted(self.missing, key=lambda stretch: -stretch.expected)
        return [
            f"{lacking} of {self.expected} expected photos were not reported; only reported photos count",
            *map(str, longest[:_SHOWN]),
        ]


def reached_m(site: Site) -> float:
    """Distance within which a planned waypoint counts as reached."""
    return _REACHED_RADII * site.scenario.vehicle.acceptance_radius_m


def reports_photos(track: Track) -> bool:
    """Whether the vehicle reported photos; a reported count, even 0, shows that it does."""
    return bool(np.isfinite(track.pictures_taken).any())


def photos_of(
    site: Site,
    track: Track,
    enu_m: FloatArray,
    route: BoolArray,
    joined: BoolArray,
    planned: PlannedRoute | None,
    *,
    source: PhotoSource,
) -> TrackPhotos | None:
    """The photos of a track; None for a sensor that looks along the path.

    Predicted by distance: one at the start of each observed run of the route, and one whenever the vehicle is the trigger
    distance from the last one. Reported: one at each rise of the vehicle's count; those whose message was lost at the trigger
    points between.

    Args:
        site: the scenario on its ground.
        track: what was flown.
        enu_m: (n, 3) its positions.
        route: (n,) which samples belong to the planned route.
        joined: (n - 1,) legs that were observed.
        planned: the plan, where there is one.
        source: which photos count.

    Raises:
        TrackError: the sensor looks from waypoints, and there is no plan that says where they are.
    """
    if not site.scenario.sensor.looks_along_path:
        return _photos_at_waypoints(site, track, enu_m, joined, planned, source)
    trigger_m = trigger_distance_m(site.scenario)
    if trigger_m is None:
        return None
    runs = observed_stretches(route, joined)
    if source == "reported":
        return _Matching(site, track, enu_m, joined, trigger_m).photos(runs)
    parts = [_trigger_points(enu_m, run, trigger_m) for run in runs]
    before = np.concatenate([part[0] for part in parts]) if parts else np.empty(0, dtype=np.int64)
    fraction = np.concatenate([part[1] for part in parts]) if parts else np.empty(0)
    return TrackPhotos("predicted", before, fraction, len(before))


def _photos_at_waypoints(
    site: Site, track: Track, enu_m: FloatArray, joined: BoolArray, planned: PlannedRoute | None, source: PhotoSource
) -> TrackPhotos:
    """The photos, or looks, of a sensor that looks from the waypoints.

    A photo counts at the first sample that knows of it, if the one before is joined to it. Where the count rises by more than
    one, messages were lost: the waypoints reached since the last report, as many as photos are missing, count too.
    """
    reached = _reached(site, enu_m, planned) if planned is not None or source == "predicted" else np.empty(0, np.int64)
    if source == "predicted":
        return TrackPhotos("predicted", reached, np.zeros(len(reached)), len(reached))
    gained = _gained(track)
    reports = np.flatnonzero((gained > 0) & joined) + 1
    chosen = set(reports.tolist())
    for report in (np.flatnonzero(gained > 1) + 1).tolist():
        earlier = np.flatnonzero(gained[: report - 1] > 0)
        since = int(earlier[-1]) + 1 if earlier.size else -1
        between = reached[(reached > since) & (reached < report)]
        chosen.update(between[-(int(gained[report - 1]) - 1) :].tolist())
    found = np.array(sorted(chosen), dtype=np.int64)
    missing: list[MissingPhotos] = []
    if len(found) < len(reached):
        # Which waypoint a photo belongs to is a matter of its time; here only the number that is lacking is stated.
        missing = [_stretch(site, track, enu_m, int(reached[0]), int(reached[-1]), expected=len(reached) - len(found))]
    return TrackPhotos("reported", found, np.zeros(len(found)), len(reached), tuple(missing))


def _gained(track: Track) -> FloatArray:
    """(n - 1,) increase of the vehicle's photo count from sample to sample; below 0 where the count began anew."""
    taken = track.pictures_taken
    known = np.flatnonzero(np.isfinite(taken))
    if known.size == 0:
        return np.zeros(len(taken) - 1)
    # Before the first report, one less than it says; afterwards the last reported count.
    first, start = known[0], max(0.0, taken[known[0]] - (known[0] > 0))
    filled = taken[np.maximum.accumulate(np.where(np.isfinite(taken), np.arange(len(taken)), first))]
    filled[:first] = start
    return np.asarray(np.diff(filled))


def _trigger_points(enu_m: FloatArray, run: NDArray[np.int64], trigger_m: float) -> tuple[IntArray, FloatArray]:
    """Trigger points along a run of samples, the first at its start: the sample before each, and the leg fraction."""
    legs, fractions = photo_positions(np.ascontiguousarray(enu_m[run]), trigger_m)
    # At the end of a leg it is the next sample: from there on another one may be far away or NaN.
    ends = fractions == 1.0
    return run[legs + ends], np.where(ends, 0.0, fractions)


def _reached(site: Site, enu_m: FloatArray, planned: PlannedRoute | None) -> IntArray:
    """Numbers of the samples nearest to each planned waypoint that was reached."""
    if planned is None:
        raise TrackError("the sensor observes at waypoints, which are unknown without plan.json")
    radius = reached_m(site)
    chosen = []
    for point in planned.waypoints_m:
        distance = np.linalg.norm(enu_m - point, axis=1)
        nearest = int(np.argmin(distance))
        if distance[nearest] <= radius:
            chosen.append(nearest)
    return np.array(sorted(chosen), dtype=np.int64)


def _stretch(site: Site, track: Track, enu_m: FloatArray, first: int, last: int, *, expected: int) -> MissingPhotos:
    lat_deg, lon_deg = lat_lon_deg(site, enu_m[first])
    return MissingPhotos(
        expected=expected,
        start_s=float(track.time_s[first]),
        end_s=float(track.time_s[last]),
        length_m=length_of_m(enu_m[first : last + 1]),
        lat_deg=lat_deg,
        lon_deg=lon_deg,
        east_m=float(enu_m[first, 0]),
        north_m=float(enu_m[first, 1]),
    )


class _Matching:
    """Matches the reported photos of a track with its predicted trigger points."""

    def __init__(self, site: Site, track: Track, enu_m: FloatArray, joined: BoolArray, trigger_m: float) -> None:
        self._site, self._track, self._enu_m, self._trigger_m = site, track, enu_m, trigger_m
        gained = _gained(track)
        self._reports = np.flatnonzero((gained > 0) & joined) + 1
        self._gained = gained
        known = np.flatnonzero(np.isfinite(track.pictures_taken))
        # Whether the photos that the first count includes were taken on this flight is not known.
        self._first_count = int(known[0]) if known.size and track.pictures_taken[known[0]] > 1.0 else -1
        self._positions = {int(sample): (int(sample), 0.0) for sample in self._reports}
        self._filled: list[tuple[int, float]] = []
        self._missing: list[MissingPhotos] = []
        self._perhaps_m: list[FloatArray] = []

    def photos(self, runs: list[NDArray[np.int64]]) -> TrackPhotos:
        """The photos of all runs of the route, and those that were reported elsewhere."""
        for number, run in enumerate(runs):
            self._match(run, is_first=number == 0)
        positions = sorted([*self._positions.values(), *self._filled])
        lacking = sum(stretch.expected for stretch in self._missing)
        on_route = sum(bool(run[0] <= sample <= run[-1]) for run in runs for sample, _ in positions)
        return TrackPhotos(
            "reported",
            np.array([sample for sample, _ in positions], dtype=np.int64),
            np.array([fraction for _, fraction in positions]),
            on_route + lacking,
            tuple(self._missing),
            tuple(self._perhaps_m),
        )

    def _match(self, run: NDArray[np.int64], *, is_first: bool) -> None:
        first, last = int(run[0]), int(run[-1])
        inside = self._reports[(self._reports > first) & (self._reports <= last)].tolist()
        at = first
        for report in inside:
            self._between(at, report, from_photo=at != first or not is_first, gained=int(self._gained[report - 1]))
            at = report
        self._between(at, last, from_photo=at != first or not is_first, gained=0)

    def _between(self, first: int, last: int, *, from_photo: bool, gained: int) -> None:
        """Judge the samples between two photos. The first may be the start of a run, the second its end (``gained`` 0)."""
        run = np.arange(first, last + 1)
        if len(run) < 2:
            return
        start = self._positions.get(first)
        before, fraction = _trigger_points(self._enu_m, run, self._trigger_m)
        if from_photo:
            before, fraction = before[1:], fraction[1:]
        if gained and start is not None and before.size and int(before[0]) >= last - 2:
            # It was due between two samples, and is known from the next one on.
            self._positions[last] = (int(before[0]), float(fraction[0]))
        open_ = self._unmatched(before, fraction, first, last)
        before, fraction = before[open_], fraction[open_]
        lost = max(0, gained - 1)
        if before.size == 0:
            return
        if lost >= before.size:
            self._filled += list(zip(before.tolist(), fraction.tolist(), strict=True))
            return
        self._missing.append(_stretch(self._site, self._track, self._enu_m, first, last, expected=before.size - lost))
        if lost or not gained or last == self._first_count:
            # Which of them were taken, or whether messages of the last ones were lost, is not known.
            self._perhaps_m.append(self._enu_m[first : last + 1])

    def _unmatched(self, before: IntArray, fraction: FloatArray, first: int, last: int) -> BoolArray:
        """Trigger points without a reported photo near them: neither the two between which they lie nor the next ones."""
        if before.size == 0:
            return np.zeros(0, dtype=bool)
        after = np.minimum(before + 1, len(self._enu_m) - 1)
        points = self._enu_m[before] + fraction[:, None] * (self._enu_m[after] - self._enu_m[before])
        number = int(np.searchsorted(self._reports, first, side="right"))
        behind = int(np.searchsorted(self._reports, last, side="left"))
        near = self._reports[max(0, number - 1) : behind + 1]
        if near.size == 0:
            return np.ones(before.size, dtype=bool)
        away = np.linalg.norm(points[:, None, :2] - self._enu_m[near][None, :, :2], axis=2)
        return np.asarray(away.min(axis=1) > _MATCH_FRACTION * self._trigger_m)


_BLOCK = 50_000
"""Observations whose views are compared at a time: those of a fast log take more memory than its samples."""
_STEP_S = 0.1
_STILL_M = 0.01
_SHALLOWEST = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class Observations:
    """Observations of a sensor in order of time."""

    positions_m: FloatArray  # (k, 3) ENU positions
    axes: FloatArray  # (k, 3) ENU unit vectors along the camera's viewing direction
    tops: FloatArray  # (k, 3) unit vectors perpendicular to them, towards the top of the photo
    times_s: FloatArray  # (k,) times
    # (k,) whether the attitude is known; otherwise a level attitude with the yaw along the path is assumed
    known: BoolArray

    def __len__(self) -> int:
        return int(self.times_s.size)

    def where(self, chosen: BoolArray | IntArray) -> "Observations":
        """The selected observations."""
        return Observations(
            self.positions_m[chosen], self.axes[chosen], self.tops[chosen], self.times_s[chosen], self.known[chosen]
        )


def observations_of(
    site: Site, track: Track, enu_m: FloatArray, route: BoolArray, joined: BoolArray, photos: TrackPhotos | None
) -> Observations:
    """The observations of a track on the planned route, by the sensing rule of the scenario.

    Along the path there is one at every sample, and enough between samples to keep them ``sample_spacing_m`` apart, and a camera
    that turns with the vehicle 2 degrees; a sensor that takes single photos, or observes at waypoints, has one at each of them.
    Position, attitude and time are interpolated linearly. There are none between samples that are not joined. Where the track
    lacks the yaw that a photo needs, nose ahead is assumed. Samples so close that they show the same ground count once
    (:func:`informative`).

    Args:
        site: the scenario on its ground.
        track: what was flown.
        enu_m: (n, 3) its positions.
        route: (n,) which samples belong to the planned route.
        joined: (n - 1,) legs that were observed.
        photos: where they were taken; None for a sensor that looks along the path.
    """
    sensor = site.scenario.sensor
    # np.unwrap propagates a missing yaw to the end; later samples know theirs.
    yaw_deg = np.unwrap(track.attitude_deg[:, 2], period=360.0)
    yaw_deg = np.where(np.isfinite(yaw_deg), yaw_deg, track.attitude_deg[:, 2])

    def looks(before: IntArray, fraction: FloatArray) -> Observations:
        after = np.minimum(before + 1, len(track) - 1)

        def read(values: FloatArray) -> FloatArray:
            t = fraction if values.ndim == 1 else fraction[:, None]
            # an observation at a sample ignores the next sample, which may be far away or NaN.
            return np.asarray(np.where(t == 0.0, values[before], values[before] + t * (values[after] - values[before])))

        attitude = np.column_stack([read(track.attitude_deg[:, 0]), read(track.attitude_deg[:, 1]), read(yaw_deg)])
        course = enu_m[after] - enu_m[np.where(after > before, before, np.maximum(before - 1, 0))]
        turn = sensor.camera_turn(attitude, np.degrees(np.arctan2(course[:, 0], course[:, 1])))
        return Observations(np.ascontiguousarray(read(enu_m)), turn.axes, turn.tops, read(track.time_s), turn.known)

    if photos is not None:
        return looks(photos.before, photos.fraction)
    turns_deg = _turns_deg(track) if turns_with_legs(sensor.sight) else None
    parts: list[tuple[IntArray, FloatArray]] = [(np.empty(0, dtype=np.int64), np.empty(0))]
    for run in observed_stretches(route, joined):
        before, fraction = _between(run, enu_m, sample_spacing_m(site.scenario), turns_deg)
        for block in range(0, len(before), _BLOCK):
            here, there = before[block : block + _BLOCK], fraction[block : block + _BLOCK]
            kept = informative(site, looks(here, there))
            parts.append((here[kept], there[kept]))
    return looks(np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts]))


def informative(site: Site, looks: Observations) -> IntArray:
    """Numbers of the observations along a path that add to the others; the rest shows the same ground within a centimetre.

    A log of a thousand samples a second has a hundred observations on a metre. Of each short piece of the path the first one
    counts, and those from which the edge of the view lies furthest to each side, ahead and behind, where it lies more than
    ``TRACK.same_view_m`` beyond that of the first ones of this piece and of the next. Pieces are so short that between the
    circles that are seen from their ends no more than that is omitted.
    """
    spacing_m = sample_spacing_m(site.scenario)
    # Circles of radius r, d apart, leave out d^2 / (8 r) at the edge of their swath; spacing_m is less than r.
    piece_m = min(spacing_m, math.sqrt(8.0 * spacing_m * TRACK.same_view_m))
    tenths = np.flatnonzero(np.diff(np.floor(looks.times_s / _STEP_S), prepend=-np.inf))
    # Along samples a tenth of a second apart: noise of each would make the path longer.
    along_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(looks.positions_m[tenths], axis=0), axis=1))])
    at = np.interp(looks.times_s, looks.times_s[tenths], along_m)
    keys = [at // piece_m, looks.times_s // (0.5 * site.scenario.requirements.max_gap_s), looks.known]
    if turns_with_legs(site.scenario.sensor.sight):
        yaw = np.unwrap(np.arctan2(looks.tops[:, 0] + looks.axes[:, 0], looks.tops[:, 1] + looks.axes[:, 1]))
        keys.append(yaw // math.radians(TRACK.largest_turn_deg))
    new = np.any([np.diff(key, prepend=np.nan) != 0.0 for key in map(np.asarray, keys)], axis=0)
    first = np.flatnonzero(new)
    piece = np.cumsum(new) - 1
    following = np.append(first[1:], len(looks) - 1)
    ahead = (looks.positions_m[following] - looks.positions_m[first])[:, :2]
    length = np.linalg.norm(ahead, axis=1, keepdims=True)
    ahead = np.where(length > _STILL_M, ahead / np.maximum(length, _STILL_M), [0.0, 1.0])
    up_m = looks.positions_m[:, 2]
    under_m = np.nan_to_num(
        np.clip(site.ground.heights_agl_m(looks.positions_m[first]), 0.0, site.scenario.sensor.reach_m)
    )
    kept = new.copy()
    kept[-1] = True
    for side in (ahead, -ahead, ahead[:, ::-1] * [1.0, -1.0], ahead[:, ::-1] * [-1.0, 1.0]):
        edge_m = _edge_m(site, looks, side[piece], under_m[piece] + up_m - up_m[first][piece])
        furthest_m = np.maximum.reduceat(edge_m, first)
        of_next = _edge_m(site, looks.where(following), side, under_m + up_m[following] - up_m[first])
        beyond = furthest_m > np.maximum(edge_m[first], of_next) + TRACK.same_view_m
        there = np.flatnonzero(beyond[piece] & (edge_m == furthest_m[piece]))
        kept[there[np.unique(piece[there], return_index=True)[1]]] = True
    return np.flatnonzero(kept)


def _edge_m(site: Site, looks: Observations, side: FloatArray, depth_m: FloatArray) -> FloatArray:
    """(k,) how far the edges of the views lie to a side, (k, 2) level unit vectors, on ground ``depth_m`` (k,) under the eyes."""
    axes, tops, edges = looks.axes, looks.tops, site.scenario.sensor.edges
    own = np.einsum("ij,ij->i", looks.positions_m[:, :2], side)
    if not len(edges):
        return np.asarray(own)
    rights = np.cross(axes, tops)[:, :2]
    right, top = np.einsum("ij,ij->i", rights, side), np.einsum("ij,ij->i", tops[:, :2], side)
    furthest = np.max([x * right + y * top for x, y in edges], axis=0)
    return np.asarray(
        own + depth_m / np.maximum(-axes[:, 2], _SHALLOWEST) * (np.einsum("ij,ij->i", axes[:, :2], side) + furthest)
    )


def level_observations(site: Site, path_m: FloatArray, time_s: float) -> Observations:
    """Possible observations along a path without samples, as if it had been flown level; photos may be anywhere on it."""
    sensor = site.scenario.sensor
    fraction = _between(np.arange(len(path_m)), path_m, sample_spacing_m(site.scenario))
    before, part = fraction
    after = np.minimum(before + 1, len(path_m) - 1)
    positions = path_m[before] + part[:, None] * (path_m[after] - path_m[before])
    course = path_m[after] - path_m[np.where(after > before, before, np.maximum(before - 1, 0))]
    unknown = np.full((len(positions), 3), np.nan)
    turn = sensor.camera_turn(unknown, np.degrees(np.arctan2(course[:, 0], course[:, 1])))
    times = np.full(len(positions), time_s)
    return Observations(
        np.ascontiguousarray(positions), turn.axes, turn.tops, times, np.zeros(len(positions), dtype=bool)
    )


def _turns_deg(track: Track) -> FloatArray:
    """(n - 1,) degrees of yaw from sample to sample, the short way; 0 if unknown."""
    return np.nan_to_num(np.abs((np.diff(track.attitude_deg[:, 2]) + 180.0) % 360.0 - 180.0))


def _between(
    run: NDArray[np.int64], enu_m: FloatArray, spacing_m: float, turns_deg: FloatArray | None = None
) -> tuple[NDArray[np.int64], FloatArray]:
    """The sample before each observation of a run of samples, and the fraction 0..1 of the way to the next."""
    legs = np.linalg.norm(np.diff(enu_m[run], axis=0), axis=1)
    pieces = np.maximum(1, np.ceil(legs / spacing_m - 1e-9).astype(np.int64))
    if turns_deg is not None:
        pieces = np.maximum(pieces, np.ceil(turns_deg[run[:-1]] / TRACK.largest_turn_deg - 1e-9).astype(np.int64))
    leg = np.repeat(np.arange(len(legs)), pieces)
    piece = np.arange(len(leg)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    return np.append(run[leg], run[-1]), np.append(piece / pieces[leg], 0.0)

"""Photos of a track: those that the vehicle reported, and where it reported none, those that its track predicts.

A track whose vehicle reports photos counts only these. Predicted trigger points say where reports are missing, and where photos
were taken whose message was lost: the vehicle counts its photos, so a count that rises by three is three photos.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavcover.errors import TrackError
from uavcover.kernels.arrays import BoolArray, FloatArray, IntArray
from uavcover.kernels.coverage import picture_places
from uavcover.model.track import Track
from uavcover.model.verdict import MissingPhotos, PhotoSource
from uavcover.scenario.site import Site
from uavcover.sensing.sensors import trigger_distance_m
from uavcover.verification.unobserved import PlannedRoute, length_of_m, observed_stretches

REACHED_RADII = 2.0
"""A planned waypoint counts as reached within this many acceptance radii."""
_MATCH_FRACTION = 0.5
"""A predicted trigger point within this fraction of the trigger distance from a reported photo is that photo."""
_SHOWN = 3


@dataclass(frozen=True, slots=True, eq=False)
class TrackPhotos:
    """Positions of photos, and stretches without a report."""

    source: PhotoSource  # whether the vehicle reported them, or the track predicts them
    before: IntArray  # (k,) the sample at or before each photo
    share: FloatArray  # (k,) fraction of the way from it to the next sample, 0..1
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


def reports_photos(track: Track) -> bool:
    """Whether the vehicle reported photos: a count of any time, 0 too, shows that it does."""
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
    """The photos of a track; none for a sensor that looks along the path.

    Raises:
        TrackError: the sensor looks from waypoints, and there is no plan that says where they are.
    """
    if not site.scenario.sensor.looks_along_path:
        return photos_at_waypoints(site, track, enu_m, joined, planned, source=source)
    if trigger_distance_m(site.scenario) is None:
        return None
    return photos_by_distance(site, track, enu_m, route, joined, source=source)


def photos_by_distance(
    site: Site, track: Track, enu_m: FloatArray, route: BoolArray, joined: BoolArray, *, source: PhotoSource
) -> TrackPhotos:
    """The photos of a camera that is triggered by distance.

    Predicted: one at the start of each observed run of the route, and one whenever the vehicle is the trigger distance from the
    last one. Reported: one at each rise of the vehicle's count; those whose message was lost at the trigger points between.

    Args:
        site: the scenario on its ground.
        track: what was flown.
        enu_m: (n, 3) its positions.
        route: (n,) which samples belong to the planned route.
        joined: (n - 1,) legs that were observed.
        source: which photos count.
    """
    trigger_m = trigger_distance_m(site.scenario)
    if trigger_m is None:
        raise TrackError("the sensor does not take photos by distance")
    runs = observed_stretches(route, joined)
    if source == "predicted":
        parts = [_trigger_points(enu_m, run, trigger_m) for run in runs]
        before = np.concatenate([part[0] for part in parts]) if parts else np.empty(0, dtype=np.int64)
        share = np.concatenate([part[1] for part in parts]) if parts else np.empty(0)
        return TrackPhotos("predicted", before, share, len(before))
    return _Matching(site, track, enu_m, joined, trigger_m).photos(runs)


def photos_at_waypoints(
    site: Site,
    track: Track,
    enu_m: FloatArray,
    joined: BoolArray,
    planned: PlannedRoute | None,
    *,
    source: PhotoSource,
) -> TrackPhotos:
    """The photos, or looks, of a sensor that looks from the waypoints.

    A photo counts at the first sample that knows of it, if the one before is joined to it. Where the count rises by more than
    one, messages were lost: the waypoints reached since the last report, as many as photos are missing, count too.

    Raises:
        TrackError: there is no plan that says where the waypoints are.
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
    legs, shares = picture_places(np.ascontiguousarray(enu_m[run]), trigger_m)
    # At the end of a leg it is the next sample: from there on another one may be far away or NaN.
    ends = shares == 1.0
    return run[legs + ends], np.where(ends, 0.0, shares)


def _reached(site: Site, enu_m: FloatArray, planned: PlannedRoute | None) -> IntArray:
    """Numbers of the samples nearest to each planned waypoint that was reached."""
    if planned is None:
        raise TrackError("the sensor observes at waypoints, which are unknown without plan.json")
    radius = REACHED_RADII * site.scenario.vehicle.acceptance_radius_m
    chosen = []
    for point in planned.waypoints_m:
        distance = np.linalg.norm(enu_m - point, axis=1)
        nearest = int(np.argmin(distance))
        if distance[nearest] <= radius:
            chosen.append(nearest)
    return np.array(sorted(chosen), dtype=np.int64)


def _stretch(site: Site, track: Track, enu_m: FloatArray, first: int, last: int, *, expected: int) -> MissingPhotos:
    lat, lon = np.full(1, np.nan), np.full(1, np.nan)
    if site.frame is not None:
        lat, lon, _ = site.frame.geodetic_from_enu(enu_m[first])
    return MissingPhotos(
        expected=expected,
        start_s=float(track.time_s[first]),
        end_s=float(track.time_s[last]),
        length_m=length_of_m(enu_m[first : last + 1]),
        lat_deg=float(lat[0]),
        lon_deg=float(lon[0]),
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
        self._places = {int(sample): (int(sample), 0.0) for sample in self._reports}
        self._filled: list[tuple[int, float]] = []
        self._missing: list[MissingPhotos] = []
        self._perhaps_m: list[FloatArray] = []

    def photos(self, runs: list[NDArray[np.int64]]) -> TrackPhotos:
        """The photos of all runs of the route, and those that were reported elsewhere."""
        for number, run in enumerate(runs):
            self._match(run, is_first=number == 0)
        places = sorted([*self._places.values(), *self._filled])
        lacking = sum(stretch.expected for stretch in self._missing)
        on_route = sum(bool(run[0] <= sample <= run[-1]) for run in runs for sample, _ in places)
        return TrackPhotos(
            "reported",
            np.array([sample for sample, _ in places], dtype=np.int64),
            np.array([share for _, share in places]),
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
        start = self._places.get(first)
        before, share = _trigger_points(self._enu_m, run, self._trigger_m)
        if from_photo:
            before, share = before[1:], share[1:]
        if gained and start is not None and before.size and int(before[0]) >= last - 2:
            # It was due between two samples, and is known from the next one on.
            self._places[last] = (int(before[0]), float(share[0]))
        open_ = self._unmatched(before, share, first, last)
        before, share = before[open_], share[open_]
        lost = max(0, gained - 1)
        if before.size == 0:
            return
        if lost >= before.size:
            self._filled += list(zip(before.tolist(), share.tolist(), strict=True))
            return
        self._missing.append(_stretch(self._site, self._track, self._enu_m, first, last, expected=before.size - lost))
        if lost or not gained or last == self._first_count:
            # Which of them were taken, or whether messages of the last ones were lost, is not known.
            self._perhaps_m.append(self._enu_m[first : last + 1])

    def _unmatched(self, before: IntArray, share: FloatArray, first: int, last: int) -> BoolArray:
        """Trigger points without a reported photo near them: neither the two between which they lie nor the next ones."""
        if before.size == 0:
            return np.zeros(0, dtype=bool)
        after = np.minimum(before + 1, len(self._enu_m) - 1)
        points = self._enu_m[before] + share[:, None] * (self._enu_m[after] - self._enu_m[before])
        number = int(np.searchsorted(self._reports, first, side="right"))
        behind = int(np.searchsorted(self._reports, last, side="left"))
        near = self._reports[max(0, number - 1) : behind + 1]
        if near.size == 0:
            return np.ones(before.size, dtype=bool)
        away = np.linalg.norm(points[:, None, :2] - self._enu_m[near][None, :, :2], axis=2)
        return np.asarray(away.min(axis=1) > _MATCH_FRACTION * self._trigger_m)

"""Observations along a flown track: from where, in which direction, and when the sensor looked."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.model.track import Track
from uavcover.scenario.site import Site
from uavcover.sensing.sensors import sample_spacing_m, turns_with_legs
from uavcover.verification.phases import observed_stretches
from uavcover.verification.reported_photos import TrackPhotos
from uavcover.verification.tuning import TRACK


@dataclass(frozen=True, slots=True, eq=False)
class Observations:
    """Observations of a sensor in order of time.

    Attributes:
        places_m: (k, 3) ENU positions.
        axes: (k, 3) ENU unit vectors along the camera's viewing direction.
        tops: (k, 3) unit vectors perpendicular to them, towards the top of the photo.
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
    site: Site, track: Track, enu_m: FloatArray, route: BoolArray, joined: BoolArray, photos: TrackPhotos | None
) -> Observations:
    """The observations of a track on the planned route, by the sensing rule of the scenario.

    Along the path there is one at every sample, and enough between samples to keep them ``sample_spacing_m`` apart, and a camera
    that turns with the vehicle 2 degrees; of a sensor that takes single photos, or looks from waypoints, one at each of them.
    Position, attitude and time are interpolated linearly. There are none between samples that are not joined. Where the track
    lacks the yaw that a photo needs, nose ahead is assumed.

    Args:
        site: the scenario on its ground.
        track: what was flown.
        enu_m: (n, 3) its positions.
        route: (n,) which samples belong to the planned route.
        joined: (n - 1,) legs that were observed.
        photos: where they were taken; none for a sensor that looks along the path.
    """
    sensor = site.scenario.sensor
    if photos is not None:
        before, share = photos.before, photos.share
    else:
        runs = observed_stretches(route, joined)
        turns_deg = _turns_deg(track) if turns_with_legs(sensor.sight) else None
        parts = [_between(run, enu_m, sample_spacing_m(site.scenario), turns_deg) for run in runs]
        before = np.concatenate([part[0] for part in parts]) if parts else np.empty(0, dtype=np.int64)
        share = np.concatenate([part[1] for part in parts]) if parts else np.empty(0)
    after = np.minimum(before + 1, len(track) - 1)

    def read(values: FloatArray) -> FloatArray:
        t = share if values.ndim == 1 else share[:, None]
        # An observation at a sample ignores the next sample, which may be far away or NaN.
        return np.asarray(np.where(t == 0.0, values[before], values[before] + t * (values[after] - values[before])))

    attitude = np.column_stack([track.attitude_deg[:, :2], np.unwrap(track.attitude_deg[:, 2], period=360.0)])
    # np.unwrap propagates a missing yaw to the end; later samples know theirs.
    attitude[:, 2] = np.where(np.isfinite(attitude[:, 2]), attitude[:, 2], track.attitude_deg[:, 2])
    course = enu_m[after] - enu_m[np.where(after > before, before, np.maximum(before - 1, 0))]
    turn = sensor.camera_turn(read(attitude), np.degrees(np.arctan2(course[:, 0], course[:, 1])))
    return Observations(np.ascontiguousarray(read(enu_m)), turn.axes, turn.tops, read(track.time_s), turn.known)


def level_observations(site: Site, path_m: FloatArray, time_s: float) -> Observations:
    """Possible observations along a path without samples, as if it had been flown level; photos may be anywhere on it."""
    sensor = site.scenario.sensor
    share = _between(np.arange(len(path_m)), path_m, sample_spacing_m(site.scenario))
    before, part = share
    after = np.minimum(before + 1, len(path_m) - 1)
    places = path_m[before] + part[:, None] * (path_m[after] - path_m[before])
    course = path_m[after] - path_m[np.where(after > before, before, np.maximum(before - 1, 0))]
    unknown = np.full((len(places), 3), np.nan)
    turn = sensor.camera_turn(unknown, np.degrees(np.arctan2(course[:, 0], course[:, 1])))
    times = np.full(len(places), time_s)
    return Observations(np.ascontiguousarray(places), turn.axes, turn.tops, times, np.zeros(len(places), dtype=bool))


def _turns_deg(track: Track) -> FloatArray:
    """(n - 1,) degrees of yaw from sample to sample, the short way; 0 where it is not known."""
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

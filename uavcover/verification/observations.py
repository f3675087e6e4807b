"""Observations along a flown track: from where, in which direction, and when the sensor looked."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.arrays import BoolArray, FloatArray, IntArray
from uavcover.model.track import Track
from uavcover.scenario.site import Site
from uavcover.sensing.sensors import sample_spacing_m, turns_with_legs
from uavcover.verification.reported_photos import TrackPhotos
from uavcover.verification.tuning import TRACK
from uavcover.verification.unobserved import observed_stretches

_BLOCK = 50_000
"""Observations whose views are compared at a time: those of a fast log take more memory than its samples."""
_STEP_S = 0.1
_STILL_M = 0.01
_SHALLOWEST = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class Observations:
    """Observations of a sensor in order of time."""

    places_m: FloatArray  # (k, 3) ENU positions
    axes: FloatArray  # (k, 3) ENU unit vectors along the camera's viewing direction
    tops: FloatArray  # (k, 3) unit vectors perpendicular to them, towards the top of the photo
    times_s: FloatArray  # (k,) times
    known: BoolArray  # (k,) whether the attitude is known; otherwise level and nose ahead are assumed

    def __len__(self) -> int:
        return int(self.times_s.size)

    def where(self, chosen: BoolArray | IntArray) -> "Observations":
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
    lacks the yaw that a photo needs, nose ahead is assumed. Samples so close that they show the same ground count once
    (:func:`informative`).

    Args:
        site: the scenario on its ground.
        track: what was flown.
        enu_m: (n, 3) its positions.
        route: (n,) which samples belong to the planned route.
        joined: (n - 1,) legs that were observed.
        photos: where they were taken; none for a sensor that looks along the path.
    """
    sensor = site.scenario.sensor
    # np.unwrap propagates a missing yaw to the end; later samples know theirs.
    yaw_deg = np.unwrap(track.attitude_deg[:, 2], period=360.0)
    yaw_deg = np.where(np.isfinite(yaw_deg), yaw_deg, track.attitude_deg[:, 2])

    def looks(before: IntArray, share: FloatArray) -> Observations:
        after = np.minimum(before + 1, len(track) - 1)

        def read(values: FloatArray) -> FloatArray:
            t = share if values.ndim == 1 else share[:, None]
            # an observation at a sample ignores the next sample, which may be far away or NaN.
            return np.asarray(np.where(t == 0.0, values[before], values[before] + t * (values[after] - values[before])))

        attitude = np.column_stack([read(track.attitude_deg[:, 0]), read(track.attitude_deg[:, 1]), read(yaw_deg)])
        course = enu_m[after] - enu_m[np.where(after > before, before, np.maximum(before - 1, 0))]
        turn = sensor.camera_turn(attitude, np.degrees(np.arctan2(course[:, 0], course[:, 1])))
        return Observations(np.ascontiguousarray(read(enu_m)), turn.axes, turn.tops, read(track.time_s), turn.known)

    if photos is not None:
        return looks(photos.before, photos.share)
    turns_deg = _turns_deg(track) if turns_with_legs(sensor.sight) else None
    parts: list[tuple[IntArray, FloatArray]] = [(np.empty(0, dtype=np.int64), np.empty(0))]
    for run in observed_stretches(route, joined):
        before, share = _between(run, enu_m, sample_spacing_m(site.scenario), turns_deg)
        for block in range(0, len(before), _BLOCK):
            here, there = before[block : block + _BLOCK], share[block : block + _BLOCK]
            kept = informative(site, looks(here, there))
            parts.append((here[kept], there[kept]))
    return looks(np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts]))


def informative(site: Site, looks: Observations) -> IntArray:
    """Numbers of the observations along a path that add to the others; the rest shows the same ground within a centimetre.

    A log of a thousand samples a second has a hundred observations on a metre. Of each short piece of the path the first one
    counts, and those from which the edge of the view lies furthest to each side, ahead and behind, where it lies more than
    ``TRACK.same_view_m`` beyond that of the first ones of this piece and of the next. Pieces are so short that between the
    circles that are seen from their ends no more than that is left out.
    """
    spacing_m = sample_spacing_m(site.scenario)
    # Circles of radius r, d apart, leave out d^2 / (8 r) at the edge of their swath; spacing_m is less than r.
    piece_m = min(spacing_m, math.sqrt(8.0 * spacing_m * TRACK.same_view_m))
    tenths = np.flatnonzero(np.diff(np.floor(looks.times_s / _STEP_S), prepend=-np.inf))
    # Along samples a tenth of a second apart: noise of each would make the path longer.
    way_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(looks.places_m[tenths], axis=0), axis=1))])
    at = np.interp(looks.times_s, looks.times_s[tenths], way_m)
    keys = [at // piece_m, looks.times_s // (0.5 * site.scenario.requirements.max_gap_s), looks.known]
    if turns_with_legs(site.scenario.sensor.sight):
        nose = np.unwrap(np.arctan2(looks.tops[:, 0] + looks.axes[:, 0], looks.tops[:, 1] + looks.axes[:, 1]))
        keys.append(nose // math.radians(TRACK.largest_turn_deg))
    new = np.any([np.diff(key, prepend=np.nan) != 0.0 for key in map(np.asarray, keys)], axis=0)
    first = np.flatnonzero(new)
    piece = np.cumsum(new) - 1
    following = np.append(first[1:], len(looks) - 1)
    ahead = (looks.places_m[following] - looks.places_m[first])[:, :2]
    length = np.linalg.norm(ahead, axis=1, keepdims=True)
    ahead = np.where(length > _STILL_M, ahead / np.maximum(length, _STILL_M), [0.0, 1.0])
    up_m = looks.places_m[:, 2]
    under_m = np.nan_to_num(
        np.clip(site.ground.heights_agl_m(looks.places_m[first]), 0.0, site.scenario.sensor.reach_m)
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
    own = np.einsum("ij,ij->i", looks.places_m[:, :2], side)
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

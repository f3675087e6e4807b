"""Where a flown track's sensor looked from, in which direction, and when."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavcover.errors import TrackError
from uavcover.model.sensor import NadirCamera, Sensor
from uavcover.model.track import Track
from uavcover.site import Site
from uavcover.verification.phases import PlannedRoute, observed_stretches

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

REACHED_RADII = 2.0
"""A planned waypoint counts as reached within this many acceptance radii."""


@dataclass(frozen=True, slots=True, eq=False)
class Looks:
    """Looks of a sensor in order of time.

    Attributes:
        places_m: (k, 3) ENU.
        axes: (k, 3) unit vectors, ENU: where a camera pointed.
        times_s: (k,).
        level_assumed: how many of them were taken as level because the track has no attitude there.
    """

    places_m: FloatArray
    axes: FloatArray
    times_s: FloatArray
    level_assumed: int

    def __len__(self) -> int:
        return int(self.times_s.size)


def looks_of(site: Site, track: Track, enu_m: FloatArray, route: BoolArray, planned: PlannedRoute | None) -> Looks:
    """The looks of a track on the planned route, by the sensing rule of the scenario.

    Along the path there is one at every sample, and between two samples as many as keep them ``sample_spacing_m`` apart; place,
    attitude and time are read linearly in between. Where the samples are further apart than ``max_gap_s`` there is none.

    Args:
        site: the scenario on its ground.
        track: what was flown.
        enu_m: (n, 3) its positions.
        route: (n,) which samples belong to the planned route.
        planned: the plan, if there is one.

    Raises:
        TrackError: the sensor looks from waypoints only, and there is no plan that says where they are.
    """
    sensor = site.scenario.sensor
    if sensor.sensing == "at-waypoints":
        before, share = _reached(site, enu_m, planned), np.empty(0)
    else:
        runs = observed_stretches(track, route, max_gap_s=site.scenario.requirements.max_gap_s)
        parts = [_between(run, enu_m, sensor.sample_spacing_m) for run in runs]
        before = np.concatenate([part[0] for part in parts]) if parts else np.empty(0, dtype=np.int64)
        share = np.concatenate([part[1] for part in parts]) if parts else np.empty(0)
    if share.size == 0:
        share = np.zeros(before.size)
    after = np.minimum(before + 1, len(track) - 1)

    def read(values: FloatArray) -> FloatArray:
        t = share if values.ndim == 1 else share[:, None]
        # Where a look is at a sample the next one has no say: it may be far away, or not a number.
        return np.asarray(np.where(t == 0.0, values[before], values[before] + t * (values[after] - values[before])))

    attitude = np.column_stack([track.attitude_deg[:, :2], np.unwrap(track.attitude_deg[:, 2], period=360.0)])
    # np.unwrap carries a missing yaw on to the end; the samples behind it know theirs.
    attitude[:, 2] = np.where(np.isfinite(attitude[:, 2]), attitude[:, 2], track.attitude_deg[:, 2])
    axes, level_assumed = camera_axes(sensor, read(attitude))
    return Looks(np.ascontiguousarray(read(enu_m)), axes, read(track.time_s), level_assumed)


def camera_axes(sensor: Sensor, attitude_deg: FloatArray) -> tuple[FloatArray, int]:
    """Where the camera of a vehicle with these (k, 3) rolls, pitches and yaws points.

    The camera looks along the vehicle's downward axis. A stabilised one, and sensors that are no camera, look straight down. A
    row that is not known is taken as level.

    Returns:
        (k, 3) unit vectors in ENU, and how many rows were not known.
    """
    level = np.tile([0.0, 0.0, -1.0], (len(attitude_deg), 1))
    if not isinstance(sensor, NadirCamera) or sensor.mount == "stabilised":
        return level, 0
    known = np.asarray(np.isfinite(attitude_deg).all(axis=1), dtype=bool)
    roll, pitch, yaw = np.radians(np.where(known[:, None], attitude_deg, 0.0)).T
    # The third column of the rotation from body (forward, right, down) to north-east-down, yaw-pitch-roll order.
    north = np.cos(roll) * np.sin(pitch) * np.cos(yaw) + np.sin(roll) * np.sin(yaw)
    east = np.cos(roll) * np.sin(pitch) * np.sin(yaw) - np.sin(roll) * np.cos(yaw)
    down = np.cos(roll) * np.cos(pitch)
    axes = np.where(known[:, None], np.column_stack([east, north, -down]), level)
    return np.ascontiguousarray(axes), int((~known).sum())


def _between(run: NDArray[np.int64], enu_m: FloatArray, spacing_m: float) -> tuple[NDArray[np.int64], FloatArray]:
    """The sample before each look of a run of samples, and how far it is on the way to the next, 0..1."""
    legs = np.linalg.norm(np.diff(enu_m[run], axis=0), axis=1)
    pieces = np.maximum(1, np.ceil(legs / spacing_m - 1e-9).astype(np.int64))
    leg = np.repeat(np.arange(len(legs)), pieces)
    piece = np.arange(len(leg)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    return np.append(run[leg], run[-1]), np.append(piece / pieces[leg], 0.0)


def _reached(site: Site, enu_m: FloatArray, planned: PlannedRoute | None) -> NDArray[np.int64]:
    """Numbers of the samples that came nearest to each planned waypoint that was reached."""
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

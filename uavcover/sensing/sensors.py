"""Observations of a scenario's sensor: their spacing, bounding views, and the observed cells.

The kernels compute the observed cells. For a sensor with its own view they do so pose by pose, which is slower: the sensor's
method determines which cells near a pose are in view. The kernel then tests only these cells, without the sides of the camera's
view: range, incidence, ground sample distance and the ray.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from uavcover.errors import InputError, ScenarioError
from uavcover.kernels import coverage as kernels
from uavcover.kernels.arrays import BoolArray, FloatArray, IntArray
from uavcover.kernels.cells import Cells
from uavcover.kernels.observation_counting import Camera, ObservationCounts, SensorPoses, count_rows, no_observations
from uavcover.kernels.sight import CONE, FRUSTUM, SPHERE, LocalSlopes, Sight, horizontal_reach
from uavcover.kernels.surface import Surface
from uavcover.model.scenario import Scenario
from uavcover.model.sensor import FrameCamera, Sensor
from uavcover.model.sensor_base import CameraTurn, FlatPhoto, Rays, rays_to
from uavcover.scenario.site import Site

_LEVEL = 1e-9
"""Cosine of the pitch of a camera that looks straight down."""
_DIRECTIONS = 12
_RADII = (0.35, 0.7, 0.95)
_BAND_FRACTIONS = (0.5, 0.0, 1.0)
_AHEAD = (0.5, 0.05, 0.95)
_ACROSS = (0.0, -0.9, 0.9)
LONGEST_SPACING_M = 10.0
"""Spacing of observations along the path without a spacing in the scenario."""


def turns_with_legs(sight: Sight) -> bool:
    """Whether a sensor's view depends on the direction of the leg."""
    return sight.kind == FRUSTUM and math.isnan(sight.heading_e)


def any_heading(sight: Sight) -> Sight:
    """A sensor whose view contains this one's for every heading, used as a bound; itself if heading has no effect."""
    if not turns_with_legs(sight):
        return sight
    reach = horizontal_reach(sight)
    if reach >= sight.reach_m:
        return sight._replace(kind=SPHERE)
    return sight._replace(
        kind=CONE, tan_half_fov=reach / math.sqrt(sight.reach_m**2 - reach**2), sample_focal_m=math.inf
    )


def narrowed(sight: Sight, *, margin_m: float, reach_m: float) -> Sight:
    """The sensor with its range on the map reduced by ``margin_m``.

    For a camera, this holds at the height where it reaches ``reach_m``. A photo loses the same angle at the bottom and top as at
    its sides, because the ground there is as near or farther away.
    """
    fraction = max(0.1, 1.0 - margin_m / max(reach_m, 1e-9))
    if sight.kind == FRUSTUM:
        along = max(0.1 * sight.tan_half_along, sight.tan_half_along - (1.0 - fraction) * sight.tan_half_fov)
        return sight._replace(tan_half_fov=sight.tan_half_fov * fraction, tan_half_along=along)
    if sight.kind == CONE:
        return sight._replace(tan_half_fov=sight.tan_half_fov * fraction)
    return sight._replace(reach_m=sight.reach_m * fraction)


def keeping_inside(sight: Sight, margin_m: float, height_agl_m: float) -> Sight:
    """The sensor with its range and a camera's field of view narrowed by a margin, by half at most."""
    reach = max(sight.reach_m - margin_m, 0.5 * sight.reach_m)
    if sight.kind not in {CONE, FRUSTUM}:
        return sight._replace(reach_m=reach)
    less = margin_m / height_agl_m
    return sight._replace(
        reach_m=reach,
        tan_half_fov=max(sight.tan_half_fov - less, 0.5 * sight.tan_half_fov),
        tan_half_along=max(sight.tan_half_along - less, 0.5 * sight.tan_half_along),
    )


def inside_every_heading(sight: Sight) -> list[Sight]:
    """View of a frame camera straight down that holds at any heading; empty for other sensors."""
    if sight.kind != FRUSTUM or sight.cos_pitch > _LEVEL:
        return []
    return [sight._replace(kind=CONE, tan_half_fov=min(sight.tan_half_fov, sight.tan_half_along))]


def is_ball_or_cone(sight: Sight) -> bool:
    """Whether :mod:`uavcover.kernels.swaths` supports the sensor."""
    return sight.kind in {CONE, SPHERE}


_NO_FLOOR = 0.01
"""A band with a lowest footprint of at most this fraction of the middle one has no floor, as in a flight without a plan."""


def sample_spacing_m(scenario: Scenario) -> float:
    """Distance between two observations along the path: the scenario's value, or one that suits the sensor's footprint.

    Part of the edge of a swath between two circles is not observed. Spaced by a third of the radius, circles lose at most 1.4 %
    of the width, and 0.5 % on average. Photos with a fixed heading lose more: on a leg across their corners, the edge of the
    swath has teeth as deep as half the spacing. Spaced by a twelfth of half a photo, they lose 2 % of the width on average.

    Raises:
        ScenarioError: the scenario's value is larger than the radius, which loses 13 % or more.
    """
    sensor = scenario.sensor
    low, high = scenario.limits.min_height_agl_m, scenario.limits.max_height_agl_m
    # A camera observes least from the lowest height of the band, a sphere from the highest, which it need not reach.
    reaches = [_half_footprint_m(sensor, height) for height in (low, 0.5 * (low + high))]
    seeing = [reach for reach in reaches if reach > _NO_FLOOR * max(reaches)]
    stated = sensor.sample_spacing_m
    if not seeing:
        return LONGEST_SPACING_M if stated is None else stated
    reach_m = min(seeing)
    if stated is None:
        teeth = sensor.flat_photo(low) is not None and not turns_with_legs(sensor.sight)
        return min(LONGEST_SPACING_M, reach_m / (12.0 if teeth else 3.0))
    if stated > reach_m and sensor.looks_along_path and trigger_distance_m(scenario) is None:
        raise ScenarioError(
            f"sensor.sample_spacing_m: {stated:g} m between observations leaves gaps, because the sensor observes only "
            f"{reach_m:.3g} m to each side; remove this key, or use at most {math.floor(100.0 * reach_m) / 100.0:g}"
        )
    return stated


def _half_footprint_m(sensor: Sensor, height_agl_m: float) -> float:
    """Half the swath width on flat ground, or half a photo's length along the path if that is shorter."""
    reach_m, photo = sensor.half_width_m(height_agl_m), sensor.flat_photo(height_agl_m)
    return reach_m if photo is None else min(reach_m, 0.5 * photo.length_m)


def trigger_distance_m(scenario: Scenario) -> float | None:
    """Distance between two photos; None without a distance trigger.

    Raises:
        ScenarioError: the photo shows nothing from the lowest height of the band, where it shows least.
    """
    return scenario.sensor.photo_spacing_m(scenario.limits.min_height_agl_m)


def looks_singly(scenario: Scenario) -> bool:
    """Whether the sensor observes from single positions: waypoints or trigger points."""
    return not scenario.sensor.looks_along_path or trigger_distance_m(scenario) is not None


def frame_camera(sensor: Sensor, *, source: str) -> FrameCamera:
    """The sensor as a camera with rectangular photos.

    Raises:
        InputError: it is another sensor.
    """
    if isinstance(sensor, FrameCamera):
        return sensor
    raise InputError(f"{source}: the sensor is a {sensor.kind}; photos require a frame-camera")


@dataclass(frozen=True, slots=True)
class TrialPosition:
    """A position relative to a cell, with the heading of a level vehicle there.

    Attributes:
        east_m, north_m: from the cell.
        band_fraction: fraction 0..1 of the permitted heights at that point.
        heading_e, heading_n: of the vehicle.
    """

    east_m: float
    north_m: float
    band_fraction: float
    heading_e: float
    heading_n: float


def trial_positions(scenario: Scenario) -> Iterator[TrialPosition]:
    """The positions tried for every cell, the most promising first.

    They are directly above it and 36 positions around, each at three heights of the band. For a frame camera, they are the
    positions from which flat ground at the cell would be at the centre, near the corners and near the edges of the photo, for
    twelve headings or the scenario's heading.
    """
    limits, sensor = scenario.limits, scenario.sensor
    low, high = limits.min_height_agl_m, limits.max_height_agl_m
    photos = [(fraction, sensor.flat_photo(low + fraction * (high - low))) for fraction in _BAND_FRACTIONS]
    if sensor.turns_with_vehicle or sensor.heading_deg is not None:
        yield from _by_photo(sensor.heading_deg, photos)
        return
    reach = max(sensor.half_width_m(low + fraction * (high - low)) for fraction in _BAND_FRACTIONS)
    offsets = [(0.0, 0.0)] + [(reach * r * math.cos(a), reach * r * math.sin(a)) for r in _RADII for a in _angles_rad()]
    for (east, north), fraction in itertools.product(offsets, _BAND_FRACTIONS):
        yield TrialPosition(east, north, fraction, 0.0, 1.0)


def _by_photo(stated: float | None, photos: Sequence[tuple[float, FlatPhoto | None]]) -> Iterator[TrialPosition]:
    headings = _angles_rad() if stated is None else [math.radians(90.0 - stated)]
    for ahead, across, (fraction, photo) in itertools.product(_AHEAD, _ACROSS, photos):
        if photo is None:
            continue
        forward = photo.near_m + ahead * (photo.far_m - photo.near_m)
        for angle in headings:
            he, hn = math.cos(angle), math.sin(angle)
            # The cell is ``forward`` ahead of the place and ``across`` to the right of it.
            right = across * photo.half_width_m
            yield TrialPosition(-forward * he - right * hn, -forward * hn + right * he, fraction, he, hn)


def _angles_rad() -> list[float]:
    return [float(a) for a in np.arange(_DIRECTIONS) * (2.0 * math.pi / _DIRECTIONS)]


WORKERS = 2
"""Threads that share the rows of the lattice; the result does not depend on their number."""
_WIDE = 1e9
"""Tangent of half an angle of nearly 180 degrees."""


class SensorPose(NamedTuple):
    """Position of a sensor, and unit vectors along its axis and to the top of its photo; each (3,) ENU."""

    eye_m: FloatArray
    axis: FloatArray
    top: FloatArray


def sight_for_cells(sensor: Sensor) -> Sight:
    """A view that contains that of a sensor, including its own view."""
    return wide_open(sensor.sight) if sensor.has_own_view else sensor.sight


def wide_open(sight: Sight) -> Sight:
    """The view with the sides of a camera's view wide open."""
    return sight._replace(tan_half_fov=_WIDE, tan_half_along=_WIDE) if sight.kind in {CONE, FRUSTUM} else sight


def observed_often(
    site: Site, cells: Cells, positions_m: FloatArray, headings: FloatArray, looks: tuple[int, float] = (1, 0.0)
) -> IntArray:
    """(cells,) number of the observation with which each cell was observed as often as needed; -1 if never.

    Args:
        site: with such a sensor, on a level vehicle.
        cells: of the area.
        positions_m: (k, 3) ENU.
        headings: (k, 2) direction east and north; (0, 0) without one.
        looks: required number of observations, and their least distance from each other, metres.
    """
    (needed, apart_m), sensor, count = looks, site.scenario.sensor, len(cells.centre_m)
    sight, surface = wide_open(sensor.sight), site.ground.surface
    found, times = np.full(count, -1, dtype=np.int64), np.zeros(count, dtype=np.int64)
    counted = np.full((count, needed, 3), np.inf)
    turn = level_turns(sensor, headings)
    for k in np.flatnonzero(turn.known & np.isfinite(positions_m).all(axis=1)):
        near = in_own_view(
            sensor, cells, SensorPose(positions_m[k], turn.axes[k], turn.tops[k]), sensor.in_view, times < needed
        )
        observed = kernels.first_observed(surface, sight, near, positions_m[k : k + 1], headings[k : k + 1]) >= 0
        new = np.flatnonzero(observed)
        if apart_m > 0.0:
            new = new[(np.linalg.norm(counted[new] - positions_m[k], axis=2) >= apart_m).all(axis=1)]
        counted[new, times[new]] = positions_m[k]
        times[new] += 1
        found[new[times[new] == needed]] = k
    return found


def observes_each(
    site: Site, positions_m: FloatArray, headings: FloatArray, centres: FloatArray, normals: FloatArray
) -> BoolArray:
    """(k,) whether each of k observations of a sensor with its own view observes the cell of the same row."""
    sensor = site.scenario.sensor
    turn = level_turns(sensor, headings)
    rays = rays_to((centres - positions_m).T, turn.axes, turn.tops)
    clear = kernels.observes_each(site.ground.surface, wide_open(sensor.sight), positions_m, headings, centres, normals)
    return np.asarray(clear & turn.known & sensor.in_view(rays))


def level_turns(sensor: Sensor, headings: FloatArray) -> CameraTurn:
    """Orientations of a sensor on a level vehicle, by (k, 2) directions east and north; unknown where (0, 0) matters."""
    yaw_deg = np.degrees(np.arctan2(headings[:, 0], headings[:, 1]))
    yaw_deg[~headings.any(axis=1)] = np.nan if sensor.turns_with_vehicle else 0.0
    return sensor.camera_turn(np.column_stack([np.zeros((len(headings), 2)), yaw_deg]))


def in_own_view(
    sensor: Sensor, cells: Cells, pose: SensorPose, test: Callable[[Rays], BoolArray], also: BoolArray | None = None
) -> Cells:
    """The cells near a pose that pass a test of rays and belong to (cells,) others."""
    reach_m = sensor.reach_m + cells.scatter_m + cells.size_m
    rows, columns = cells.lattice.shape
    west, south = pose.eye_m[0] - reach_m - cells.east0_m, pose.eye_m[1] - reach_m - cells.north0_m
    first_row, first_column = (
        int(np.clip(low // cells.size_m, 0, most)) for low, most in ((south, rows), (west, columns))
    )
    across = int(2.0 * reach_m // cells.size_m) + 2
    lattice = cells.lattice[first_row : first_row + across + 1, first_column : first_column + across + 1].copy()
    there = lattice >= 0
    numbers = lattice[there]
    rays = rays_to((cells.centre_m[numbers] - pose.eye_m).T, pose.axis, pose.top)
    inside = test(rays) if also is None else test(rays) & also[numbers]
    lattice[there] = np.where(inside, numbers, -1)
    lattice.flags.writeable = cells.lattice.flags.writeable
    return cells._replace(
        east0_m=cells.east0_m + first_column * cells.size_m, north0_m=cells.north0_m + first_row * cells.size_m,
        lattice=lattice,
    )  # fmt: skip


def add_observations(
    site: Site, slopes: LocalSlopes, sight: Sight, camera: Camera, cells: Cells, poses: SensorPoses,
    counts: ObservationCounts,
) -> None:  # fmt: skip
    """Add observations of the sensor to the counts of cells: :func:`uavcover.kernels.observation_counting.count_rows`."""
    sensor, surface = site.scenario.sensor, site.ground.surface
    if sensor.has_own_view:
        _add_by_own_view(sensor, surface, slopes, wide_open(sight), camera, cells, poses, counts)
        return

    def add(first_row: int) -> None:
        count_rows(surface, slopes, sight, camera, cells, poses, (first_row, WORKERS), counts)

    with ThreadPoolExecutor(WORKERS) as executor:
        list(executor.map(add, range(WORKERS)))


def _add_by_own_view(
    sensor: Sensor, surface: Surface, slopes: LocalSlopes, sight: Sight, camera: Camera, cells: Cells, poses: SensorPoses,
    counts: ObservationCounts,
) -> None:  # fmt: skip
    offset_m, turn_rad = camera.offset_m, camera.turn_rad
    exact = camera._replace(offset_m=0.0, horizontal_m=0.0, lift_m=0.0, turn_rad=0.0)
    passes: list[tuple[Callable[[Rays], BoolArray], Camera, ObservationCounts]] = [(sensor.in_view, exact, counts)]
    # Sure and possible observations are counted separately, each by its own view.
    apart = [no_observations(len(cells.centre_m), camera.needed) for _ in range(2)]
    if offset_m > 0.0 or turn_rad > 0.0:
        passes.append((partial(sensor.surely_in_view, offset_m=offset_m, turn_rad=turn_rad), camera, apart[0]))
        passes.append((partial(sensor.possibly_in_view, offset_m=offset_m, turn_rad=turn_rad), camera, apart[1]))
    for own, known in zip(apart, (counts.sure, counts.possible), strict=True):
        for each in (own.sure, own.possible):
            each[:] = known
        own.positions[:] = counts.positions
    for k in np.flatnonzero(np.isfinite(poses.eyes).all(axis=1) & np.isfinite(poses.tops).all(axis=1)):
        one = SensorPoses(*(rows[k : k + 1] for rows in poses))
        for test, how, into in passes:
            near = in_own_view(sensor, cells, SensorPose(poses.eyes[k], poses.axes[k], poses.tops[k]), test)
            numbers = near.lattice[near.lattice >= 0]
            new = numbers[into.first[numbers] < 0]
            count_rows(surface, slopes, sight, how, near, one, (0, 1), into)
            into.first[new[into.first[new] >= 0]] = k
    counts.sure[:], counts.possible[:] = apart[0].sure, apart[1].possible
    counts.positions[1], counts.positions[2] = apart[0].positions[1], apart[1].positions[2]

"""Observations of sensors, by the kernels; of one with a view of its own pose by pose, which is slower.

A view of its own is asked, by its method on arrays, which cells near a pose are in view. The kernel then sees these cells
alone, with the sides of the camera's view wide open: range, incidence, ground sample distance and the ray are its part.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import NamedTuple

import numpy as np

from uavcover.kernels import coverage as kernels
from uavcover.kernels.arrays import BoolArray, FloatArray, IntArray
from uavcover.kernels.cells import Cells
from uavcover.kernels.observation_counting import Camera, ObservationCounts, SensorPoses, count_rows, no_observations
from uavcover.kernels.sight import CONE, FRUSTUM, LocalSlopes, Sight
from uavcover.kernels.surface import Surface
from uavcover.model.sensor import Sensor
from uavcover.model.sensor_base import CameraTurn, Rays, rays_to
from uavcover.scenario.site import Site

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
    """A view that contains that of a sensor, its own one too."""
    return wide_open(sensor.sight) if sensor.has_own_view else sensor.sight


def wide_open(sight: Sight) -> Sight:
    """The view with the sides of a camera's wide open."""
    return sight._replace(tan_half_fov=_WIDE, tan_half_along=_WIDE) if sight.kind in {CONE, FRUSTUM} else sight


def seen_often(
    site: Site, cells: Cells, places_m: FloatArray, headings: FloatArray, looks: tuple[int, float] = (1, 0.0)
) -> IntArray:
    """(cells,) number of the observation by which each cell is seen as often as needed; -1 where none does.

    Args:
        site: with such a sensor, on a level vehicle.
        cells: of the area.
        places_m: (k, 3) ENU.
        headings: (k, 2) direction east and north; (0, 0) where there is none.
        looks: how many observations are needed, and how far from each other, metres.
    """
    (needed, apart_m), sensor, count = looks, site.scenario.sensor, len(cells.centre_m)
    sight, surface = wide_open(sensor.sight), site.ground.surface
    found, times = np.full(count, -1, dtype=np.int64), np.zeros(count, dtype=np.int64)
    counted = np.full((count, needed, 3), np.inf)
    turn = level_turns(sensor, headings)
    for k in np.flatnonzero(turn.known & np.isfinite(places_m).all(axis=1)):
        near = in_own_view(
            sensor, cells, SensorPose(places_m[k], turn.axes[k], turn.tops[k]), sensor.in_view, times < needed
        )
        seen = kernels.first_seen(surface, sight, near, places_m[k : k + 1], headings[k : k + 1]) >= 0
        new = np.flatnonzero(seen)
        if apart_m > 0.0:
            new = new[(np.linalg.norm(counted[new] - places_m[k], axis=2) >= apart_m).all(axis=1)]
        counted[new, times[new]] = places_m[k]
        times[new] += 1
        found[new[times[new] == needed]] = k
    return found


def sees_each(
    site: Site, places_m: FloatArray, headings: FloatArray, centres: FloatArray, normals: FloatArray
) -> BoolArray:
    """(k,) whether each of k observations by a view of its own sees the cell of the same row."""
    sensor = site.scenario.sensor
    turn = level_turns(sensor, headings)
    rays = rays_to((centres - places_m).T, turn.axes, turn.tops)
    clear = kernels.sees_each(site.ground.surface, wide_open(sensor.sight), places_m, headings, centres, normals)
    return np.asarray(clear & turn.known & sensor.in_view(rays))


def level_turns(sensor: Sensor, headings: FloatArray) -> CameraTurn:
    """The turns of a sensor on a level vehicle by (k, 2) directions east and north; not known where (0, 0) matters."""
    yaw_deg = np.degrees(np.arctan2(headings[:, 0], headings[:, 1]))
    yaw_deg[~headings.any(axis=1)] = np.nan if sensor.turns_with_vehicle else 0.0
    return sensor.camera_turn(np.column_stack([np.zeros((len(headings), 2)), yaw_deg]))


def in_own_view(
    sensor: Sensor, cells: Cells, pose: SensorPose, test: Callable[[Rays], BoolArray], also: BoolArray | None = None
) -> Cells:
    """The cells near a pose that pass a test of rays, and are among (cells,) others."""
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
    # What is sure and what is possible is counted apart: each by the cells that are in view in its own sense.
    apart = [no_observations(len(cells.centre_m), camera.needed) for _ in range(2)]
    if offset_m > 0.0 or turn_rad > 0.0:
        passes.append((partial(sensor.surely_in_view, offset_m=offset_m, turn_rad=turn_rad), camera, apart[0]))
        passes.append((partial(sensor.possibly_in_view, offset_m=offset_m, turn_rad=turn_rad), camera, apart[1]))
    for own, known in zip(apart, (counts.sure, counts.possible), strict=True):
        for each in (own.sure, own.possible):
            each[:] = known
        own.places[:] = counts.places
    for k in np.flatnonzero(np.isfinite(poses.eyes).all(axis=1) & np.isfinite(poses.tops).all(axis=1)):
        one = SensorPoses(*(rows[k : k + 1] for rows in poses))
        for test, how, into in passes:
            near = in_own_view(sensor, cells, SensorPose(poses.eyes[k], poses.axes[k], poses.tops[k]), test)
            numbers = near.lattice[near.lattice >= 0]
            new = numbers[into.first[numbers] < 0]
            count_rows(surface, slopes, sight, how, near, one, (0, 1), into)
            into.first[new[into.first[new] >= 0]] = k
    counts.sure[:], counts.possible[:] = apart[0].sure, apart[1].possible
    counts.places[1], counts.places[2] = apart[0].places[1], apart[1].places[2]

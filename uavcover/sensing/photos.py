"""Number of photos and looks at each cell, and their ground sample distance, for reconstruction.

Coverage requires a cell in the central strip of a photo, according to the side overlap. Here, every photo counts that shows the
cell inside its frame, in range, not too obliquely and unhidden. Its ground sample distance does not matter for the count; the
best one is reported.

A look is all photos from one position in one direction, in any number of files, because a reconstruction needs views from
different positions. Bands of a multispectral camera, bursts, and photos of a hovering vehicle are one look.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from mission_io.model.plain_text import counted
from uavcover.kernels import observation_counting as kernels
from uavcover.kernels.arrays import BoolArray, FloatArray, IntArray
from uavcover.kernels.observation_counting import Camera, SensorPoses
from uavcover.kernels.sight import local_slopes
from uavcover.model.scenario import Scenario
from uavcover.model.sensor import Sensor
from uavcover.model.verdict import PhotoStatistics, percent_beside
from uavcover.scenario.site import area_as_drawn
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.sensors import add_observations, looks_singly, trigger_distance_m

OVERLAP_FRACTION = 0.99
"""Fraction of the drawn area that must have the required number of photos."""

FLOWN_OVERLAP_FRACTION = 0.97
"""The same for a flight whose plan meets it: photos are triggered slightly late, and one is missing at the end of a line."""

_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class PhotoCounts:
    """Photos that show each cell.

    Attributes:
        photos: (cells,) number of looks that show it; photos from one position are one look.
        ground_sample_m: (cells,) the best ground sample distance of these; NaN without one.
        taken: number of photos.
        looks: number of looks.
    """

    photos: NDArray[np.int32]
    ground_sample_m: FloatArray
    taken: int
    looks: int


def takes_photos(scenario: Scenario) -> bool:
    """Whether the sensor takes single photos: a camera with a distance trigger, or one that observes at waypoints."""
    return scenario.sensor.is_camera and looks_singly(scenario)


def photos_required(sensor: Sensor) -> int | None:
    """Number of photos in which the required overlap puts a point; None without a required overlap.

    With forward overlap F photos begin every 1 - F of their length, so at least floor(1 / (1 - F)) of a line show a point; with
    side overlap S at least floor(1 / (1 - S)) lines do. The product counts photos of all lines.

    >>> from uavcover.model.sensor import FrameCamera
    >>> photos_required(FrameCamera(kind="frame-camera", fov_across_deg=60.0, fov_along_deg=40.0, range_m=200.0,
    ...                            forward_overlap=0.75, side_overlap=0.7))
    12
    """
    forward, side = sensor.forward_overlap or 0.0, sensor.side_overlap
    if forward == side == 0.0:
        return None
    return math.floor(1.0 / (1.0 - forward) + _ROUNDING) * math.floor(1.0 / (1.0 - side) + _ROUNDING)


def overlap_rule(sensor: Sensor) -> str | None:
    """Derivation of the number of :func:`photos_required`, as text; None without a required overlap.

    >>> from uavcover.model.sensor import FrameCamera
    >>> overlap_rule(FrameCamera(kind="frame-camera", fov_across_deg=60.0, fov_along_deg=40.0, range_m=200.0,
    ...                          forward_overlap=0.75, side_overlap=0.7))
    '75 % forward: a point is in at least 4 photos of a swath; 70 % side: a point is in at least 3 swaths; 4 x 3 = 12 photos'
    """
    required = photos_required(sensor)
    if required is None:
        return None
    forward, side = sensor.forward_overlap or 0.0, sensor.side_overlap
    lines = math.floor(1.0 / (1.0 - side) + _ROUNDING)
    words = (
        f"{100.0 * forward:g} % forward: a point is in at least {counted(required // lines, 'photo')} of a swath",
        f"{100.0 * side:g} % side: a point is in at least {counted(lines, 'swath')}",
    )
    return f"{'; '.join(words)}; {required // lines} x {lines} = {required} photos"


def planned_poses(coverage: CoverageMap, routes_m: Sequence[FloatArray]) -> SensorPoses:
    """Positions and camera directions of a level vehicle's observations on (n, 3) ENU routes as they are flown."""
    parts = [coverage.flown_observations(route) for route in routes_m]
    positions = np.vstack([np.empty((0, 3)), *(part.positions_m for part in parts)])
    headings = np.vstack([np.empty((0, 2)), *(part.headings for part in parts)])
    yaw_deg = np.degrees(np.arctan2(headings[:, 0], headings[:, 1]))
    yaw_deg[~headings.any(axis=1)] = np.nan
    level = np.zeros(len(positions))
    turn = coverage.site.scenario.sensor.camera_turn(np.column_stack([level, level, yaw_deg]))
    return SensorPoses(positions[turn.known], turn.axes[turn.known], turn.tops[turn.known], level[turn.known])


def count_photos(coverage: CoverageMap, poses: SensorPoses, looks: IntArray | None = None) -> PhotoCounts:
    """Count the photos that show each cell of a map.

    Args:
        coverage: the cells.
        poses: of the photos; their times do not matter.
        looks: (n,) number of each photo's look, which counts once; None: each photo is a look.
    """
    site = coverage.site
    sight, slopes = site.scenario.sensor.whole_photo, local_slopes(site.ground.surface)
    # Each look is a separate pass: its number is the time of its photos.
    camera = Camera(
        focal_px=site.scenario.sensor.focal_px,
        pass_gap_s=0.0,
        offset_m=0.0,
        horizontal_m=0.0,
        lift_m=0.0,
        turn_rad=0.0,
    )
    numbers = np.arange(len(poses.eyes)) if looks is None else looks
    order = np.argsort(numbers, kind="stable")
    numbered = SensorPoses(
        np.ascontiguousarray(poses.eyes[order]), np.ascontiguousarray(poses.axes[order]),
        np.ascontiguousarray(poses.tops[order]), numbers[order].astype(float),
    )  # fmt: skip
    counts = kernels.no_observations(coverage.grid.count)
    add_observations(coverage.site, slopes, sight, camera, coverage.grid.cells, numbered, counts)
    sample_m = np.where(np.isfinite(counts.ground_sample_m), counts.ground_sample_m, np.nan)
    return PhotoCounts(counts.passes, sample_m, len(poses.eyes), len(np.unique(numbers)))


def drawn_cells(coverage: CoverageMap) -> BoolArray:
    """(cells,) which cells have their middle in the area as drawn, without its margin."""
    middles = coverage.grid.middles_m
    return np.asarray(shapely.contains_xy(area_as_drawn(coverage.site), middles[:, 0], middles[:, 1]))


def overlap_fraction(coverage: CoverageMap, counts: PhotoCounts, also: BoolArray | None = None) -> float | None:
    """Fraction of the ground, as drawn, in as many photos as the overlap requires; None without a requirement.

    Args:
        coverage: the cells.
        counts: of their photos.
        also: (cells,) cells that count as having enough photos.
    """
    drawn, required = drawn_cells(coverage), photos_required(coverage.site.scenario.sensor)
    if required is None or not drawn.any():
        return None
    weight, enough = coverage.grid.weight_m2, counts.photos >= required
    if also is not None:
        enough = enough | also
    return float(weight[drawn & enough].sum() / weight[drawn].sum())


def photo_statistics(coverage: CoverageMap, counts: PhotoCounts) -> PhotoStatistics:
    """Statistics of photos over the cells of the drawn area. Its margin may be observed less often."""
    drawn = drawn_cells(coverage)
    photos = counts.photos[drawn]
    required, enough = photos_required(coverage.site.scenario.sensor), overlap_fraction(coverage, counts)
    sample_m = counts.ground_sample_m[drawn]
    sample_m = sample_m[np.isfinite(sample_m)]
    return PhotoStatistics(
        taken=counts.taken,
        looks=counts.looks,
        asked=required,
        overlap_fraction=enough,
        overlap_holds=None if enough is None else enough >= OVERLAP_FRACTION,
        fewest=int(photos.min(initial=np.iinfo(np.int32).max)) if drawn.any() else 0,
        median=float(np.median(photos)) if drawn.any() else 0.0,
        ground_sample_median_m=float(np.median(sample_m)) if sample_m.size else None,
        ground_sample_p95_m=float(np.percentile(sample_m, 95.0)) if sample_m.size else None,
    )


def overlap_shortfall(scenario: Scenario, photos: PhotoStatistics | None) -> str | None:
    """Shortfall of the photos against the required overlap, as text; None without one.

    Args:
        scenario: with its requirements.
        photos: number of photos of the ground; None if unknown.
    """
    wanted = scenario.requirements.min_overlap_fraction
    if wanted is None:
        return None
    found = None if photos is None else photos.overlap_fraction
    if photos is None or found is None:
        return "an overlap is required, but no photos are known"
    if found >= wanted:
        return None
    return (
        f"the required overlap, {photos.asked} photos of every point, is achieved on "
        f"{percent_beside(found, wanted)} of the area, which is below the required {100.0 * wanted:.2f} %"
    )


def planned_photos(coverage: CoverageMap, routes_m: Sequence[FloatArray]) -> PhotoStatistics | None:
    """Statistics of the photos planned on (n, 3) ENU routes, one for each flight; None for a sensor without photos."""
    if not takes_photos(coverage.site.scenario):
        return None
    return photo_statistics(coverage, count_photos(coverage, planned_poses(coverage, routes_m)))


def camera_axes(yaw_deg: FloatArray, pitch_deg: FloatArray, roll_deg: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(n, 3) ENU unit vectors along cameras' views, and towards the tops of their photos.

    Angles are turned in the order yaw, pitch, roll, as DJI, Parrot and MAVLink gimbals tell them.

    >>> axes, tops = camera_axes(np.array([90.0]), np.array([-90.0]), np.array([0.0]))
    >>> (axes + 0.0).round(6).tolist(), (tops + 0.0).round(6).tolist()
    ([[0.0, 0.0, -1.0]], [[1.0, 0.0, 0.0]])
    """
    yaw, pitch, roll = np.radians(yaw_deg), np.radians(pitch_deg), np.radians(roll_deg)
    ahead = np.column_stack([np.sin(yaw), np.cos(yaw), np.zeros_like(yaw)])
    up = np.array([0.0, 0.0, 1.0])
    axes = np.cos(pitch)[:, None] * ahead + np.sin(pitch)[:, None] * up
    level_tops = -np.sin(pitch)[:, None] * ahead + np.cos(pitch)[:, None] * up
    right = np.cross(axes, level_tops)
    tops = np.cos(roll)[:, None] * level_tops + np.sin(roll)[:, None] * right
    return np.ascontiguousarray(axes), np.ascontiguousarray(tops)


SPACING_FRACTION = 0.25
"""Photos closer than this fraction of the forward spacing are one look."""
_MOST_OF_SPACING = 0.5
"""Photos farther apart than this fraction of the forward spacing are two looks, at any uncertainty of the positions."""
_ALIKE_DEG = 30.0
"""Views that differ by less have a similar direction."""
_LONGEST_CAPTURE_M = 20.0
"""Files of one capture are closer: its bands are up to 1 s apart, at up to 20 m/s. An id that covers more is invalid."""


def look_distance_m(scenario: Scenario, error_m: FloatArray) -> FloatArray:
    """(n,) distance within which photos in a similar direction are one look.

    It is the larger of the position error and a fraction of the forward spacing.

    Args:
        scenario: with the camera, and its forward spacing, if any.
        error_m: (n,) errors of the photos' positions.
    """
    spacing_m = trigger_distance_m(scenario)
    if spacing_m is None:
        return error_m
    return np.clip(error_m, SPACING_FRACTION * spacing_m, _MOST_OF_SPACING * spacing_m)


def looks_of(
    positions_m: FloatArray, axes: FloatArray, closer_m: FloatArray, captures: Sequence[str | None] | None = None
) -> IntArray:
    """(n,) number of the look that each photo belongs to, counted from 0 in order of the first photo of each.

    A photo belongs to the first look whose first photo is closer than ``closer_m`` across the view, with a like direction;
    heights along the view do not make another look. Photos of one capture id are one look.

    Args:
        positions_m: (n, 3) ENU positions.
        axes: (n, 3) unit vectors along the views.
        closer_m: (n,) distances, see :func:`look_distance_m`.
        captures: (n,) capture ids; none where a photo has none.

    >>> places = np.array([[0.0, 0.0, 80.0], [0.1, 0.0, 80.0], [20.0, 0.0, 80.0], [20.0, 0.5, 95.0]])
    >>> looks_of(places, np.tile([0.0, 0.0, -1.0], (4, 1)), np.full(4, 5.0)).tolist()
    [0, 0, 1, 1]
    """
    count = len(positions_m)
    found = np.full(count, -1, dtype=np.int64)
    first = np.empty(count, dtype=np.int64)
    looks = 0
    of_capture = _captures(positions_m, captures)
    known: dict[int, int] = {}
    alike = np.cos(np.radians(_ALIKE_DEG))
    for k in range(count):
        if of_capture[k] in known:
            found[k] = known[of_capture[k]]
            continue
        leaders = first[:looks]
        offsets = positions_m[leaders] - positions_m[k]
        along = np.einsum("ij,ij->i", offsets, axes[leaders])
        across2 = np.einsum("ij,ij->i", offsets, offsets) - along * along
        same = np.flatnonzero((across2 <= closer_m[k] ** 2) & (axes[leaders] @ axes[k] >= alike))
        if same.size:
            found[k] = same[0]
        else:
            found[k], first[looks] = looks, k
            looks += 1
        if of_capture[k] >= 0:
            known[of_capture[k]] = int(found[k])
    return found


def _captures(positions_m: FloatArray, captures: Sequence[str | None] | None) -> list[int]:
    """(n,) number of each photo's capture; -1 without one, or if the id covers more than one position."""
    numbers: dict[str, list[int]] = {}
    for k, capture in enumerate(captures or ()):
        if capture is not None:
            numbers.setdefault(capture, []).append(k)
    out = [-1] * len(positions_m)
    for number, members in enumerate(numbers.values()):
        spread_m = np.linalg.norm(positions_m[members] - positions_m[members[0]], axis=1).max()
        if spread_m <= _LONGEST_CAPTURE_M:
            for k in members:
                out[k] = number
    return out

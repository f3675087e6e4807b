"""Number, distance and certainty of the observations of each cell from a flown track, and reasons for none.

Every observation counts, unlike in :mod:`uavcover.kernels.coverage`, which needs only the first one. Rows of the lattice are
independent, so threads can divide them and never touch the same cell.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.arrays import Point
from uavcover.kernels.cells import GRAZING_M, Cells
from uavcover.kernels.coverage import NO_DETECTION, DetectionTable, Looks, near_another, no_looks, note_look
from uavcover.kernels.jit import kernel
from uavcover.kernels.obstacles import keeps_clear
from uavcover.kernels.sight import (
    CONE,
    DISC,
    FRUSTUM,
    MIDPOINT,
    OBSERVED,
    OCCLUDED,
    RAY,
    SPHERE,
    LocalSlopes,
    Sight,
    ground_sample_m,
    steepest_between,
    view,
)  # fmt: skip
from uavcover.kernels.surface import Surface, height_above, stays_above


class Camera(NamedTuple):
    """Parameters of the counting in addition to the sensor's sight.

    Attributes:
        focal_px: focal length in pixels; NaN if unknown.
        pass_gap_s: a cell that was out of view for longer is passed again.
        offset_m: largest distance of the eye from its measured position, relative to the ground.
        horizontal_m: the horizontal part of that.
        lift_m: raised or lowered by this, the ray to the measured eye bounds the rays to all of these positions.
        needed: required number of observations of a cell that are ``apart_m`` from each other.
        apart_m: 0 if every pass is a separate observation.
        turn_rad: largest angle of the camera from its measured orientation.
        detection: probability that a look finds a target, for ``ObservationCounts.looks``.
    """

    focal_px: float
    pass_gap_s: float
    offset_m: float
    horizontal_m: float
    lift_m: float
    turn_rad: float
    needed: int = 1
    apart_m: float = 0.0
    detection: DetectionTable = NO_DETECTION


class SensorPoses(NamedTuple):
    """Positions and orientations of a sensor.

    Attributes:
        eyes: (k, 3) ENU metres; a position that is not finite observes nothing.
        axes: (k, 3) unit vectors along the view.
        tops: (k, 3) orthogonal unit vectors towards the top of the photo; NaN if unknown.
        times_s: (k,) increasing.
    """

    eyes: NDArray[np.float64]
    axes: NDArray[np.float64]
    tops: NDArray[np.float64]
    times_s: NDArray[np.float64]


class ObservationCounts(NamedTuple):
    """Results for each of (n,) cells.

    Attributes:
        passes: int32, number of times that it came into view.
        first: int64, number of the observation by which it was observed as often as needed, -1: none.
        last_s: time of the last observation, NaN: none.
        nearest_m: shortest distance of an observation, infinite: never.
        ground_sample_m: smallest ground sample distance of an observation, infinite: never, or unknown.
        cos_incidence: cosine of the smallest incidence angle of an observation, -1: never.
        outcome: uint8, the best result of any observation: NOT_IN_RANGE, TOO_OBLIQUE, TOO_COARSE, OCCLUDED, OBSERVED.
        sure: int32, number of counted observations that hold for every error, at most the required number.
        possible: int32, number of those that hold for some error, at most the required number.
        positions: (3, n, needed, 3) positions of the counted observations: as measured, surely, possibly.
        looks: probabilities of detection; for no cell if not requested.
    """

    passes: NDArray[np.int32]
    first: NDArray[np.int64]
    last_s: NDArray[np.float64]
    nearest_m: NDArray[np.float64]
    ground_sample_m: NDArray[np.float64]
    cos_incidence: NDArray[np.float64]
    outcome: NDArray[np.uint8]
    sure: NDArray[np.int32]
    possible: NDArray[np.int32]
    positions: NDArray[np.float64]
    looks: Looks


def no_observations(count: int, needed: int = 1, *, searched: bool = False) -> ObservationCounts:
    """Counts of ``count`` cells without observations, for this number of needed observations; or for a search."""
    return ObservationCounts(
        passes=np.zeros(count, dtype=np.int32),
        first=np.full(count, -1, dtype=np.int64),
        last_s=np.full(count, np.nan),
        nearest_m=np.full(count, np.inf),
        ground_sample_m=np.full(count, np.inf),
        cos_incidence=np.full(count, -1.0),
        outcome=np.zeros(count, dtype=np.uint8),
        sure=np.zeros(count, dtype=np.int32),
        possible=np.zeros(count, dtype=np.int32),
        positions=np.zeros((3, count if needed > 1 else 0, needed, 3)),
        looks=no_looks(count if searched else 0),
    )


@kernel
def count_rows(
    surface: Surface,
    slopes: LocalSlopes,
    sight: Sight,
    camera: Camera,
    cells: Cells,
    poses: SensorPoses,
    lattice_rows: tuple[int, int],
    counts: ObservationCounts,
) -> None:
    """Add k observations to ``counts``, for the cells in some rows of the lattice.

    Args:
        surface: the ground.
        slopes: its bounds.
        sight: the sensor.
        camera: its other parameters.
        cells: of the area.
        poses: positions and orientations of the sensor.
        lattice_rows: the first row, and the step from each to the next: threads that share the lattice out have like steps.
        counts: is added to.
    """
    eyes, axes, tops, times_s = poses
    first_row, row_step = lattice_rows
    rows, columns = cells.lattice.shape
    centre, normal = cells.centre_m, cells.normal
    exact = camera.offset_m == 0.0 and camera.turn_rad == 0.0
    farthest = sight.reach_m + camera.offset_m
    for k in range(eyes.shape[0]):
        ee, en, eu = eyes[k, 0], eyes[k, 1], eyes[k, 2]
        if not math.isfinite(ee + en + eu):
            continue
        ae, an, au = axes[k, 0], axes[k, 1], axes[k, 2]
        te, tn, tu = tops[k, 0], tops[k, 1], tops[k, 2]
        re, rn, ru = an * tu - au * tn, au * te - ae * tu, ae * tn - an * te
        reach = _reach_over_ground_m(sight, au) if exact else farthest
        # A little wider against rounding: the tests below decide.
        reach += cells.scatter_m + 1e-6 * cells.size_m
        lowest = max(0, math.ceil((en - reach - cells.north0_m) / cells.size_m))
        highest = min(rows - 1, math.floor((en + reach - cells.north0_m) / cells.size_m))
        for i in range(lowest + (first_row - lowest) % row_step, highest + 1, row_step):
            to_row = cells.north0_m + i * cells.size_m - en
            half = math.sqrt(max(0.0, reach * reach - to_row * to_row))
            west = max(0, math.ceil((ee - half - cells.east0_m) / cells.size_m))
            east = min(columns - 1, math.floor((ee + half - cells.east0_m) / cells.size_m))
            for j in range(west, east + 1):
                cell = cells.lattice[i, j]
                if cell < 0:
                    continue
                ce, cn, cu = centre[cell, 0], centre[cell, 1], centre[cell, 2]
                de, dn, du = ee - ce, en - cn, eu - cu
                horizontal2 = de * de + dn * dn
                distance2 = horizontal2 + du * du
                if sight.kind != DISC and distance2 > farthest * farthest:
                    continue
                depth = -(de * ae + dn * an + du * au)
                across = de * re + dn * rn + du * ru
                along = de * te + dn * tn + du * tu
                facing = de * normal[cell, 0] + dn * normal[cell, 1] + du * normal[cell, 2]
                outcome = view(sight, horizontal2, distance2, depth, across, along, facing)
                if outcome == OCCLUDED and _unhidden(
                    surface, slopes, sight, cells.horizon[cell], 0.0, (ee, en, eu), (ce, cn, cu)
                ):
                    outcome = OBSERVED
                    _note(sight, camera, k, times_s[k], cell, (ee, en, eu), math.sqrt(distance2), depth, facing, counts)
                    if counts.looks.missed.size > 0 and facing > 0.0:
                        sample_m = ground_sample_m(camera.focal_px, depth, facing)
                        note_look(camera.detection, counts.looks, cell, sample_m, de, dn, du)
                if outcome > counts.outcome[cell]:
                    counts.outcome[cell] = outcome
                if exact:
                    continue
                horizon, beside, lift = cells.horizon[cell], camera.horizontal_m, camera.lift_m
                eye = (ee, en, eu)
                if (
                    outcome == OBSERVED
                    and counts.sure[cell] < camera.needed
                    and _sure_in_view(sight, camera, horizontal2, distance2, depth, across, along, facing)
                    and _unhidden(surface, slopes, sight, horizon, beside, (ee, en, eu - lift), (ce, cn, cu))
                ):
                    counts.sure[cell] += _is_new(camera, counts, 1, cell, counts.sure[cell], 2.0 * camera.offset_m, eye)
                # From a nearby position, an obstacle may not block the ray.
                if counts.possible[cell] < camera.needed and (
                    outcome == OBSERVED
                    or (
                        _possible_in_view(sight, camera, horizontal2, distance2, depth, across, along, facing)
                        and _unhidden(surface, slopes, sight, horizon, -beside, (ee, en, eu + lift), (ce, cn, cu))
                    )
                ):
                    # Each of the observations that are apart is near another one that counts here: half the distance misses none.
                    nearer = -0.5 * camera.apart_m - camera.offset_m
                    counts.possible[cell] += _is_new(camera, counts, 2, cell, counts.possible[cell], nearer, eye)


@kernel
def _is_new(
    camera: Camera,
    counts: ObservationCounts,
    which: int,
    cell: int,
    times: int,
    further_m: float,
    eye: tuple[float, float, float],
) -> int:
    """1 if an observation is ``apart_m`` and ``further_m`` from a cell's counted ones, and add its position; otherwise 0."""
    if camera.needed == 1:
        return 1
    positions = counts.positions[which]
    # Below 0, any two observations may have been far enough apart.
    apart_m = max(0.0, camera.apart_m + further_m)
    if near_another(positions, cell, min(times, camera.needed), apart_m, eye[0], eye[1], eye[2]):
        return 0
    if times < camera.needed:
        for axis in range(3):
            positions[cell, times, axis] = eye[axis]
    return 1


@kernel
def _unhidden(
    surface: Surface,
    slopes: LocalSlopes,
    sight: Sight,
    horizon: float,
    beside: float,
    eye: Point,
    centre: Point,
) -> bool:
    """Whether nothing blocks the ray from an eye to a cell; most rays are steeper than the ground around it.

    Obstacles block the ray if it comes within ``beside`` of them; below 0 they never do.
    """
    (ee, en, eu), (ce, cn, cu) = eye, centre
    if sight.line_of_sight == RAY:
        if (
            beside >= 0.0
            and not eu - cu >= horizon * (math.hypot(ee - ce, en - cn) + beside)
            and not keeps_clear(surface.obstacles, eye, centre, beside, 0.0)
        ):
            return False
        if eu - cu >= steepest_between(surface, slopes, ee, en, ce, cn) * math.hypot(ee - ce, en - cn):
            return True
        return stays_above(surface, ee, en, eu, ce, cn, cu, -GRAZING_M)
    if sight.line_of_sight == MIDPOINT:
        return bool(height_above(surface, 0.5 * (ee + ce), 0.5 * (en + cn), 0.5 * (eu + cu)) >= 0.0)
    return True


@kernel
def _note(
    sight: Sight,
    camera: Camera,
    number: int,
    time_s: float,
    cell: int,
    eye: tuple[float, float, float],
    distance: float,
    depth: float,
    facing: float,
    counts: ObservationCounts,
) -> None:
    """Record that an observation observed a cell."""
    # "not <=" counts the first observation, too, whose last time is NaN.
    if not time_s - counts.last_s[cell] <= camera.pass_gap_s:
        counts.passes[cell] += _is_new(camera, counts, 0, cell, counts.passes[cell], 0.0, eye)
    if counts.first[cell] < 0 and counts.passes[cell] >= camera.needed:
        counts.first[cell] = number
    counts.last_s[cell] = time_s
    counts.nearest_m[cell] = min(counts.nearest_m[cell], distance)
    counts.cos_incidence[cell] = max(counts.cos_incidence[cell], facing / distance if distance > 0.0 else 1.0)
    if (sight.kind == CONE or sight.kind == FRUSTUM) and depth > 0.0 and facing > 0.0:
        sample = ground_sample_m(camera.focal_px, depth, facing)
        if sample < counts.ground_sample_m[cell]:
            counts.ground_sample_m[cell] = sample


@kernel
def _reach_over_ground_m(sight: Sight, axis_up: float) -> float:
    """Largest distance over ground of a cell in view."""
    if sight.kind != CONE and sight.kind != FRUSTUM:
        return sight.reach_m
    # To the corner of a photo; a round view has no other direction than its half angle.
    half = math.atan(math.hypot(sight.tan_half_fov, sight.tan_half_along))
    widest = half + math.acos(min(1.0, max(-1.0, -axis_up)))
    return sight.reach_m * math.sin(min(widest, 0.5 * math.pi))


@kernel
def _sure_in_view(
    sight: Sight,
    camera: Camera,
    horizontal2: float,
    distance2: float,
    depth: float,
    across: float,
    along: float,
    facing: float,
) -> bool:
    """Whether a cell is in view from every position within ``offset_m`` and at every turn within ``turn_rad``.

    From the cell, the eye moves by at most asin(offset / distance), so all angles keep this margin from their limits.
    """
    if sight.kind == DISC:
        return math.sqrt(horizontal2) + camera.horizontal_m <= sight.reach_m
    distance = math.sqrt(distance2)
    if distance <= camera.offset_m or distance + camera.offset_m > sight.reach_m:
        return False
    if sight.kind == SPHERE:
        return True
    swing = math.asin(camera.offset_m / distance)
    if _inside_by_rad(sight, distance, depth, across, along) < swing + camera.turn_rad:
        return False
    if _angle_rad(facing, distance) + swing > math.acos(sight.cos_max_incidence):
        return False
    deepest = (distance + camera.offset_m) * math.cos(max(0.0, _angle_rad(depth, distance) - swing - camera.turn_rad))
    return sight.sample_focal_m == math.inf or deepest**3 <= sight.sample_focal_m**2 * (facing - camera.offset_m)


@kernel
def _possible_in_view(
    sight: Sight,
    camera: Camera,
    horizontal2: float,
    distance2: float,
    depth: float,
    across: float,
    along: float,
    facing: float,
) -> bool:
    """Whether a cell may be in view from some position within ``offset_m`` and at some turn within ``turn_rad``."""
    if sight.kind == DISC:
        return math.sqrt(horizontal2) - camera.horizontal_m <= sight.reach_m
    distance = math.sqrt(distance2)
    if distance - camera.offset_m > sight.reach_m:
        return False
    if sight.kind == SPHERE or distance <= camera.offset_m:
        return True
    swing = math.asin(camera.offset_m / distance)
    if not _inside_by_rad(sight, distance, depth, across, along) >= -swing - camera.turn_rad:
        return False
    if _angle_rad(facing, distance) - swing > math.acos(sight.cos_max_incidence):
        return False
    off_axis = min(0.5 * math.pi, _angle_rad(depth, distance) + swing + camera.turn_rad)
    shallowest = (distance - camera.offset_m) * math.cos(off_axis)
    return sight.sample_focal_m == math.inf or shallowest**3 <= sight.sample_focal_m**2 * (facing + camera.offset_m)


@kernel
def _angle_rad(part: float, whole: float) -> float:
    """The angle whose cosine is ``part / whole``."""
    return math.acos(min(1.0, max(-1.0, part / whole)))


@kernel
def _inside_by_rad(sight: Sight, distance: float, depth: float, across: float, along: float) -> float:
    """Angle of a ray inside the field of view, negative outside; for a photo the smallest to its side planes."""
    if sight.kind == CONE:
        return math.atan(sight.tan_half_fov) - _angle_rad(depth, distance)
    ta, tl = sight.tan_half_fov, sight.tan_half_along
    side = (ta * depth - abs(across)) / math.sqrt(1.0 + ta * ta)
    end = (tl * depth - abs(along)) / math.sqrt(1.0 + tl * tl)
    return 0.5 * math.pi - _angle_rad(min(side, end), distance)

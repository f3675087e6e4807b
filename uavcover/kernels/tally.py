"""How often, how closely and how surely each cell was seen from a flown track, and why the others were not.

Every look is counted, unlike in :mod:`uavcover.kernels.coverage`, which asks for the first one only. Rows of the lattice are
independent of each other, so threads can share them out without ever touching the same cell.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels._jit import kernel
from uavcover.kernels.coverage import CONE, DISC, Cells, Sight, in_line_of_sight
from uavcover.kernels.surface import Surface

NOT_IN_RANGE = 0
TOO_OBLIQUE = 1
OCCLUDED = 2
SEEN = 3


class Camera(NamedTuple):
    """What a tally needs beside the sensor's sight.

    Attributes:
        focal_px: focal length in pixels; NaN when it is not known.
        pass_gap_s: a cell that was out of sight for longer than this is passed anew.
        offset_m: the eye may be anywhere within this distance of where it was measured, relative to the ground.
        horizontal_m: the horizontal part of that.
        lift_m: raised or lowered by this, the ray to the measured eye bounds the rays to all of these places.
        turn_rad: the axis may point anywhere within this angle of where it was measured.
    """

    focal_px: float
    pass_gap_s: float
    offset_m: float
    horizontal_m: float
    lift_m: float
    turn_rad: float


class Tally(NamedTuple):
    """What is known of each of (n,) cells.

    Attributes:
        passes: int32, how often it came into sight.
        first: int64, number of the first look that saw it, -1: none.
        last_s: time of the last look that saw it, NaN: none.
        nearest_m: shortest distance from which it was seen, infinite: never.
        ground_sample_m: smallest ground sample distance with which it was seen, infinite: never, or not known.
        cos_incidence: cosine of the smallest incidence angle under which it was seen, -1: never.
        outcome: uint8, the furthest that any look got: NOT_IN_RANGE, TOO_OBLIQUE, OCCLUDED, SEEN.
        sure: whether a look saw it whatever the errors were.
        possible: whether a look may have seen it, the errors being as they may.
    """

    passes: NDArray[np.int32]
    first: NDArray[np.int64]
    last_s: NDArray[np.float64]
    nearest_m: NDArray[np.float64]
    ground_sample_m: NDArray[np.float64]
    cos_incidence: NDArray[np.float64]
    outcome: NDArray[np.uint8]
    sure: NDArray[np.bool_]
    possible: NDArray[np.bool_]


def empty_tally(count: int) -> Tally:
    """Of ``count`` cells that nothing has looked at yet."""
    return Tally(
        passes=np.zeros(count, dtype=np.int32),
        first=np.full(count, -1, dtype=np.int64),
        last_s=np.full(count, np.nan),
        nearest_m=np.full(count, np.inf),
        ground_sample_m=np.full(count, np.inf),
        cos_incidence=np.full(count, -1.0),
        outcome=np.zeros(count, dtype=np.uint8),
        sure=np.zeros(count, dtype=np.bool_),
        possible=np.zeros(count, dtype=np.bool_),
    )


@kernel
def tally_rows(
    surface: Surface,
    sight: Sight,
    camera: Camera,
    cells: Cells,
    eyes: NDArray[np.float64],
    axes: NDArray[np.float64],
    times_s: NDArray[np.float64],
    first_row: int,
    row_step: int,
    tally: Tally,
) -> None:
    """Add (k, 3) looks to ``tally``, for the cells in rows first_row, first_row + row_step, ... of the lattice.

    Args:
        surface: the ground.
        sight: the sensor.
        camera: what else is to be known of it.
        cells: of the area.
        eyes: (k, 3) where the sensor was; a place that is not finite sees nothing.
        axes: (k, 3) unit vectors along which a camera looked.
        times_s: (k,) increasing.
        first_row: of the lattice.
        row_step: of the lattice.
        tally: is added to.
    """
    rows, columns = cells.lattice.shape
    exact = camera.offset_m == 0.0 and camera.turn_rad == 0.0
    lowered = np.empty(3)
    raised = np.empty(3)
    for k in range(eyes.shape[0]):
        eye = eyes[k]
        if not math.isfinite(eye[0] + eye[1] + eye[2]):
            continue
        for axis in range(3):
            lowered[axis] = eye[axis]
            raised[axis] = eye[axis]
        lowered[2] -= camera.lift_m
        raised[2] += camera.lift_m
        reach = _reach_over_ground_m(sight, axes[k, 2]) if exact else sight.reach_m + camera.offset_m
        # A little wider against rounding: the tests below decide.
        reach += 1e-6 * cells.size_m
        lowest = max(0, math.ceil((eye[1] - reach - cells.north0_m) / cells.size_m))
        highest = min(rows - 1, math.floor((eye[1] + reach - cells.north0_m) / cells.size_m))
        for i in range(lowest + (first_row - lowest) % row_step, highest + 1, row_step):
            dn = cells.north0_m + i * cells.size_m - eye[1]
            half = math.sqrt(max(0.0, reach * reach - dn * dn))
            west = max(0, math.ceil((eye[0] - half - cells.east0_m) / cells.size_m))
            east = min(columns - 1, math.floor((eye[0] + half - cells.east0_m) / cells.size_m))
            for j in range(west, east + 1):
                cell = cells.lattice[i, j]
                if cell < 0:
                    continue
                seen = _count(surface, sight, camera, cells, eye, axes[k], times_s[k], k, cell, tally)
                if exact:
                    continue
                centre, normal = cells.centre_m[cell], cells.normal[cell]
                if seen and not tally.sure[cell]:
                    tally.sure[cell] = _sure_in_view(sight, camera, eye, axes[k], centre, normal) and in_line_of_sight(
                        surface, sight, lowered, centre
                    )
                if not tally.possible[cell]:
                    tally.possible[cell] = seen or (
                        _possible_in_view(sight, camera, eye, axes[k], centre, normal)
                        and in_line_of_sight(surface, sight, raised, centre)
                    )


@kernel
def _count(
    surface: Surface,
    sight: Sight,
    camera: Camera,
    cells: Cells,
    eye: NDArray[np.float64],
    axis: NDArray[np.float64],
    time_s: float,
    number: int,
    cell: int,
    tally: Tally,
) -> bool:
    """Note what one look makes of one cell; whether it saw it."""
    centre, normal = cells.centre_m[cell], cells.normal[cell]
    outcome = view(sight, eye, axis, centre, normal)
    if outcome == OCCLUDED and in_line_of_sight(surface, sight, eye, centre):
        outcome = SEEN
    if outcome > tally.outcome[cell]:
        tally.outcome[cell] = outcome
    if outcome != SEEN:
        return False
    if tally.first[cell] < 0:
        tally.first[cell] = number
    # "not <=" counts the first look, too, whose last time is NaN.
    if not time_s - tally.last_s[cell] <= camera.pass_gap_s:
        tally.passes[cell] += 1
    tally.last_s[cell] = time_s
    distance, depth, cos_incidence = _geometry(eye, axis, centre, normal)
    tally.nearest_m[cell] = min(tally.nearest_m[cell], distance)
    tally.cos_incidence[cell] = max(tally.cos_incidence[cell], cos_incidence)
    if sight.kind == CONE and depth > 0.0 and cos_incidence > 0.0:
        sample = ground_sample_m(camera.focal_px, distance, depth, cos_incidence)
        if sample < tally.ground_sample_m[cell]:
            tally.ground_sample_m[cell] = sample
    return True


@kernel
def view(
    sight: Sight,
    eye: NDArray[np.float64],
    axis: NDArray[np.float64],
    centre: NDArray[np.float64],
    normal: NDArray[np.float64],
) -> int:
    """How a cell stands to the view of a sensor at ``eye`` (3,) that looks along ``axis`` (3,), whatever lies between.

    Returns:
        NOT_IN_RANGE: out of range or outside the field of view. TOO_OBLIQUE. OCCLUDED: neither; the ray decides.
    """
    distance, depth, cos_incidence = _geometry(eye, axis, centre, normal)
    if sight.kind == DISC:
        return OCCLUDED if math.hypot(eye[0] - centre[0], eye[1] - centre[1]) <= sight.reach_m else NOT_IN_RANGE
    if distance > sight.reach_m:
        return NOT_IN_RANGE
    if sight.kind == CONE:
        if depth <= 0.0 or depth * math.sqrt(1.0 + sight.tan_half_fov**2) < distance:
            return NOT_IN_RANGE
        if cos_incidence < sight.cos_max_incidence:
            return TOO_OBLIQUE
    return OCCLUDED


@kernel
def ground_sample_m(focal_px: float, distance: float, depth: float, cos_incidence: float) -> float:
    """Side of the square of ground that one pixel of a rectilinear camera sees.

    A pixel off the axis by the angle t fills the solid angle cos(t)^3 / f^2; at distance d on ground of incidence i that is an
    area of d^2 cos(t)^3 / (f^2 cos(i)). On flat ground below a level camera this is height / f in the whole picture.

    Args:
        focal_px: f, focal length in pixels.
        distance: d, metres.
        depth: d cos(t), metres.
        cos_incidence: cos(i), above 0.
    """
    return depth / focal_px * math.sqrt(depth / (distance * cos_incidence))


@kernel
def _geometry(
    eye: NDArray[np.float64], axis: NDArray[np.float64], centre: NDArray[np.float64], normal: NDArray[np.float64]
) -> tuple[float, float, float]:
    """Distance, its part along the axis, and the cosine of the incidence angle."""
    de, dn, du = eye[0] - centre[0], eye[1] - centre[1], eye[2] - centre[2]
    distance = math.sqrt(de * de + dn * dn + du * du)
    depth = -(de * axis[0] + dn * axis[1] + du * axis[2])
    upright = de * normal[0] + dn * normal[1] + du * normal[2]
    return distance, depth, upright / distance if distance > 0.0 else 1.0


@kernel
def _reach_over_ground_m(sight: Sight, axis_up: float) -> float:
    """No cell farther away than this over ground is in view."""
    if sight.kind != CONE:
        return sight.reach_m
    widest = math.atan(sight.tan_half_fov) + math.acos(min(1.0, max(-1.0, -axis_up)))
    return sight.reach_m * math.sin(min(widest, 0.5 * math.pi))


@kernel
def _sure_in_view(
    sight: Sight,
    camera: Camera,
    eye: NDArray[np.float64],
    axis: NDArray[np.float64],
    centre: NDArray[np.float64],
    normal: NDArray[np.float64],
) -> bool:
    """Whether a cell is in view from every place within ``offset_m`` and with every axis within ``turn_rad``.

    Seen from the cell, the eye moves by at most asin(offset / distance), so both angles keep that much from their limits.
    """
    distance, depth, cos_incidence = _geometry(eye, axis, centre, normal)
    if sight.kind == DISC:
        return math.hypot(eye[0] - centre[0], eye[1] - centre[1]) + camera.horizontal_m <= sight.reach_m
    if distance <= camera.offset_m or distance + camera.offset_m > sight.reach_m:
        return False
    if sight.kind == CONE:
        swing = math.asin(camera.offset_m / distance)
        off_axis = math.acos(min(1.0, max(-1.0, depth / distance)))
        if off_axis + swing + camera.turn_rad > math.atan(sight.tan_half_fov):
            return False
        return math.acos(min(1.0, max(-1.0, cos_incidence))) + swing <= math.acos(sight.cos_max_incidence)
    return True


@kernel
def _possible_in_view(
    sight: Sight,
    camera: Camera,
    eye: NDArray[np.float64],
    axis: NDArray[np.float64],
    centre: NDArray[np.float64],
    normal: NDArray[np.float64],
) -> bool:
    """Whether a cell may be in view from some place within ``offset_m`` and with some axis within ``turn_rad``."""
    distance, depth, cos_incidence = _geometry(eye, axis, centre, normal)
    if sight.kind == DISC:
        return math.hypot(eye[0] - centre[0], eye[1] - centre[1]) - camera.horizontal_m <= sight.reach_m
    if distance - camera.offset_m > sight.reach_m:
        return False
    if sight.kind == CONE and distance > camera.offset_m:
        swing = math.asin(camera.offset_m / distance)
        off_axis = math.acos(min(1.0, max(-1.0, depth / distance)))
        if off_axis - swing - camera.turn_rad > math.atan(sight.tan_half_fov):
            return False
        return math.acos(min(1.0, max(-1.0, cos_incidence))) - swing <= math.acos(sight.cos_max_incidence)
    return True

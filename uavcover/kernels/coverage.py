"""Coverage of a route, and the probability that several looks at a cell find the target.

Coverage is a loop over the observations and, within it, over the cells in reach.

A look is one photo that shows the cell. Its probability is read from a table over ground sample distance and angle off the
vertical. The ground sample distance includes the slope of the ground (:func:`uavcover.kernels.sight.ground_sample_m`). The angle
stands for objects on the ground, which hide more in flatter views.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.arrays import Point
from uavcover.kernels.cells import Cells, cell_in_line_of_sight, in_line_of_sight, known_of_sight, surroundings
from uavcover.kernels.jit import allocating_kernel, kernel
from uavcover.kernels.sight import Aim, Sight, horizontal_reach, in_view, level_aim
from uavcover.kernels.skyline import CLEAR, HIDDEN
from uavcover.kernels.surface import Surface, has_node_cell

_ROUNDING = 1e-9
"""A photo due after the end of a leg by at most this fraction of the leg is taken at its end."""


@kernel
def observes(
    surface: Surface,
    sight: Sight,
    aim: Aim,
    eye: NDArray[np.float64],
    centre: NDArray[np.float64],
    normal: NDArray[np.float64],
) -> bool:
    """Whether the sensor at ``eye`` (3,), turned by ``aim``, observes the cell with this centre (3,) and normal (3,).

    False if the eye is not finite.
    """
    if not math.isfinite(eye[0] + eye[1] + eye[2]):
        return False
    de = eye[0] - centre[0]
    dn = eye[1] - centre[1]
    du = eye[2] - centre[2]
    if not in_view(sight, aim, de, dn, du, normal[0], normal[1], normal[2]):
        return False
    return in_line_of_sight(surface, sight, eye, centre)


@allocating_kernel
def _open_columns(cells: Cells, first: NDArray[np.int64]) -> NDArray[np.int32]:
    """(rows, columns + 1) for each node of the lattice, the next column, itself included, with an unobserved cell.

    ``columns`` means none. :func:`_observe` updates the table and skips runs of observed cells: along a path, seven of ten cells
    in reach were observed from the previous position.
    """
    rows, columns = cells.lattice.shape
    table = np.empty((rows, columns + 1), dtype=np.int32)
    for i in range(rows):
        table[i, columns] = columns
        for j in range(columns - 1, -1, -1):
            cell = cells.lattice[i, j]
            table[i, j] = j if cell >= 0 and first[cell] < 0 else table[i, j + 1]
    return table


@kernel
def _observe(
    surface: Surface,
    sight: Sight,
    cells: Cells,
    aim: Aim,
    eye: Point,
    number: int,
    first: NDArray[np.int64],
    table: NDArray[np.int32],
) -> int:
    """Set ``first`` (n,) to ``number`` for every open cell that is observed from ``eye``, and close it in ``table``."""
    ee, en, eu = eye
    if not math.isfinite(ee + en + eu):
        return 0
    rows, columns = cells.lattice.shape
    centre, normal = cells.centre_m, cells.normal
    # A little wider against rounding: in_view decides.
    reach = horizontal_reach(sight) + cells.scatter_m + 1e-6 * cells.size_m
    first_row = max(0, math.ceil((en - reach - cells.north0_m) / cells.size_m))
    last_row = min(rows - 1, math.floor((en + reach - cells.north0_m) / cells.size_m))
    over_nodes = has_node_cell(surface, ee, en, eu)
    new = 0
    for i in range(first_row, last_row + 1):
        to_row = cells.north0_m + i * cells.size_m - en
        half = math.sqrt(max(0.0, reach * reach - to_row * to_row))
        last = min(columns - 1, math.floor((ee + half - cells.east0_m) / cells.size_m))
        j = max(0, math.ceil((ee - half - cells.east0_m) / cells.size_m))
        while j <= last:
            if table[i, j] != j:
                # Already observed: jump, and shorten the path for the next time (path halving).
                table[i, j] = table[i, table[i, j]]
                j = table[i, j]
                continue
            cell = cells.lattice[i, j]
            ce, cn, cu = centre[cell, 0], centre[cell, 1], centre[cell, 2]
            de, dn, du = ee - ce, en - cn, eu - cu
            if in_view(sight, aim, de, dn, du, normal[cell, 0], normal[cell, 1], normal[cell, 2]):
                # The surroundings decide most rays. This is inlined, because a call with the ground costs as much as ten of
                # these.
                around = surroundings(surface, sight, cells, cell, over_nodes)
                known = known_of_sight(around, cells.skylines.bounds, cells.rise, cell, de, dn, du)
                if known == CLEAR or (known != HIDDEN and cell_in_line_of_sight(surface, sight, cells, cell, eye)):
                    first[cell] = number
                    table[i, j] = j + 1
                    new += 1
            j += 1
    return new


@allocating_kernel
def first_observed(
    surface: Surface,
    sight: Sight,
    cells: Cells,
    eyes: NDArray[np.float64],
    headings: NDArray[np.float64],
) -> NDArray[np.int64]:
    """(n,) number of the first observation that observes each cell, -1 if none does.

    Args:
        surface: the ground.
        sight: the sensor.
        cells: of the area.
        eyes: (m, 3) from where it observes.
        headings: (m, 2) east and north, of any length: where the level vehicle heads there.
    """
    first = np.full(cells.centre_m.shape[0], -1, dtype=np.int64)
    table = _open_columns(cells, first)
    for k in range(eyes.shape[0]):
        aim = level_aim(sight, headings[k, 0], headings[k, 1])
        _observe(surface, sight, cells, aim, (eyes[k, 0], eyes[k, 1], eyes[k, 2]), k, first, table)
    return first


@allocating_kernel
def observed_often(
    surface: Surface,
    sight: Sight,
    cells: Cells,
    eyes: NDArray[np.float64],
    headings: NDArray[np.float64],
    needed: int,
    apart_m: float,
) -> NDArray[np.int64]:
    """(n,) number of the observation with which each cell was observed ``needed`` times, -1 if never.

    Observations count in their order. One that is nearer than ``apart_m`` to a counted one for the same cell does not count. See
    :func:`first_observed` for the rest.
    """
    rows, columns = cells.lattice.shape
    found = np.full(cells.centre_m.shape[0], -1, dtype=np.int64)
    times = np.zeros(cells.centre_m.shape[0], dtype=np.int64)
    counted = np.zeros((cells.centre_m.shape[0], needed, 3))
    # A little wider against rounding: in_view decides.
    reach = horizontal_reach(sight) + cells.scatter_m + 1e-6 * cells.size_m
    for k in range(eyes.shape[0]):
        ee, en, eu = eyes[k, 0], eyes[k, 1], eyes[k, 2]
        if not math.isfinite(ee + en + eu):
            continue
        aim = level_aim(sight, headings[k, 0], headings[k, 1])
        for i in range(
            max(0, math.ceil((en - reach - cells.north0_m) / cells.size_m)),
            min(rows - 1, math.floor((en + reach - cells.north0_m) / cells.size_m)) + 1,
        ):
            for j in range(
                max(0, math.ceil((ee - reach - cells.east0_m) / cells.size_m)),
                min(columns - 1, math.floor((ee + reach - cells.east0_m) / cells.size_m)) + 1,
            ):
                cell = cells.lattice[i, j]
                if cell < 0 or times[cell] == needed or near_another(counted, cell, times[cell], apart_m, ee, en, eu):
                    continue
                if observes(surface, sight, aim, eyes[k], cells.centre_m[cell], cells.normal[cell]):
                    counted[cell, times[cell], 0], counted[cell, times[cell], 1] = ee, en
                    counted[cell, times[cell], 2] = eu
                    times[cell] += 1
                    if times[cell] == needed:
                        found[cell] = k
    return found


@kernel
def near_another(
    counted: NDArray[np.float64], cell: int, times: int, apart_m: float, ee: float, en: float, eu: float
) -> bool:
    """Whether a position is nearer than ``apart_m`` to one of a cell's first ``times`` (n, needed, 3) positions."""
    for k in range(times):
        de, dn, du = counted[cell, k, 0] - ee, counted[cell, k, 1] - en, counted[cell, k, 2] - eu
        if de * de + dn * dn + du * du < apart_m * apart_m:
            return True
    return False


@allocating_kernel
def observed_from_points(
    surface: Surface,
    sight: Sight,
    cells: Cells,
    eyes: NDArray[np.float64],
    headings: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """(n,) whether each cell is observed by any of the observations; see :func:`first_observed`."""
    return first_observed(surface, sight, cells, eyes, headings) >= 0


@allocating_kernel
def sample_path(route: NDArray[np.float64], spacing: float) -> NDArray[np.float64]:
    """Points along the (n, 3) route, the waypoints among them, at most ``spacing`` metres apart."""
    n = route.shape[0]
    count = min(n, 1)
    for i in range(n - 1):
        count += max(1, math.ceil(_distance(route[i], route[i + 1]) / spacing - 1e-9))
    out = np.empty((count, 3))
    if n == 0:
        return out
    # Axis by axis: an array assignment takes numba 2 s to compile.
    for axis in range(3):
        out[0, axis] = route[0, axis]
    k = 1
    for i in range(n - 1):
        pieces = max(1, math.ceil(_distance(route[i], route[i + 1]) / spacing - 1e-9))
        for piece in range(1, pieces):
            t = piece / pieces
            for axis in range(3):
                out[k, axis] = route[i, axis] + t * (route[i + 1, axis] - route[i, axis])
            k += 1
        for axis in range(3):
            out[k, axis] = route[i + 1, axis]
        k += 1
    return out


@allocating_kernel
def photo_positions(path: NDArray[np.float64], distance: float) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Positions of the photos of a distance-triggered camera on a path: one at once, and then as autopilots trigger.

    ArduPilot (AP_Camera) and PX4 (camera_trigger) take the next photo when the straight line over ground from the last photo
    reaches ``distance``. This line continues through corners and waypoints, and restarts only when the trigger is switched off.
    Climbing straight up takes no photo. Planned routes and flown tracks both use this function.

    Args:
        path: (n, 3) ENU metres; only east and north count.
        distance: between two photos, metres, above 0.

    Returns:
        (m,) number of the leg of each photo, and (m,) its position along it, 0..1. A photo at a corner belongs to the leg that
        ends there.
    """
    n = path.shape[0]
    over_ground, gaps = 0.0, 0
    for leg in range(n - 1):
        length = math.hypot(path[leg + 1, 0] - path[leg, 0], path[leg + 1, 1] - path[leg, 1])
        if math.isfinite(length):
            over_ground += length
        else:
            gaps += 1
    # No path is shorter than the straight line, except after a gap; one for the begin, and one for rounding.
    legs = np.zeros(min(n, 1) * (int(over_ground / distance) + gaps + 2), dtype=np.int64)
    fractions = np.zeros(legs.size)
    if n == 0:
        return legs, fractions
    count = 1
    last_e, last_n = path[0, 0], path[0, 1]
    for leg in range(n - 1):
        de, dn = path[leg + 1, 0] - path[leg, 0], path[leg + 1, 1] - path[leg, 1]
        length2 = de * de + dn * dn
        at = 0.0
        while length2 > 0.0:
            # From the last photo to the vehicle: the remaining way until it is ``distance`` away.
            e, north = path[leg, 0] + at * de - last_e, path[leg, 1] + at * dn - last_n
            missing = e * e + north * north - distance * distance
            if missing < 0.0:
                half = e * de + north * dn
                at += (math.sqrt(half * half - length2 * missing) - half) / length2
            # In this form, because a comparison with NaN is False.
            if not (at <= 1.0 + _ROUNDING and math.isfinite(missing)):
                break
            at = min(at, 1.0)
            legs[count], fractions[count] = leg, at
            count += 1
            last_e, last_n = path[leg, 0] + at * de, path[leg, 1] + at * dn
    return legs[:count], fractions[:count]


@kernel
def _distance(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@allocating_kernel
def observes_each(
    surface: Surface,
    sight: Sight,
    eyes: NDArray[np.float64],
    headings: NDArray[np.float64],
    centres: NDArray[np.float64],
    normals: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """(k,) whether each of k observations observes the cell of the same row; False if a position is not finite.

    Args:
        surface: the ground.
        sight: the sensor.
        eyes: (k, 3) positions of the sensor.
        headings: (k, 2) east and north, of any length: heading of the level vehicle.
        centres: (k, 3) of the cells.
        normals: (k, 3) of the cells.
    """
    out = np.zeros(eyes.shape[0], dtype=np.bool_)
    for i in range(eyes.shape[0]):
        aim = level_aim(sight, headings[i, 0], headings[i, 1])
        out[i] = observes(surface, sight, aim, eyes[i], centres[i], normals[i])
    return out


SIDES = 5
"""From above (within ``ABOVE_WITHIN_DEG`` of the vertical), or from the north, the east, the south or the west."""
ABOVE_WITHIN_DEG = 45.0


class DetectionTable(NamedTuple):
    """Probabilities that one look finds the target; read-only arrays.

    Attributes:
        sample_m: (k,) ground sample distances, increasing.
        off_vertical_deg: (m,) angles of the line of sight off the vertical, increasing from 0.
        probability: (m, k).
    """

    sample_m: NDArray[np.float64]
    off_vertical_deg: NDArray[np.float64]
    probability: NDArray[np.float64]


def detection_table(
    sample_m: NDArray[np.float64], off_vertical_deg: NDArray[np.float64], probability: NDArray[np.float64]
) -> DetectionTable:
    """A table of read-only copies."""
    table = DetectionTable(
        *(np.array(part, dtype=float, order="C") for part in (sample_m, off_vertical_deg, probability))
    )
    for part in table:
        part.flags.writeable = False
    return table


NO_DETECTION = detection_table(np.empty(0), np.empty(0), np.empty((0, 0)))


class Looks(NamedTuple):
    """Result of the looks at each of (n,) cells; (0,) and (0, SIDES) if not requested.

    Attributes:
        missed: (n,) probability that all of them miss the target, each look independent of the others.
        best: (n, SIDES) probability of the best look from each side.
    """

    missed: NDArray[np.float64]
    best: NDArray[np.float64]


def no_looks(count: int) -> Looks:
    """At ``count`` cells."""
    return Looks(np.ones(count), np.zeros((count, SIDES)))


@allocating_kernel
def look_probability(table: DetectionTable, sample_m: float, off_vertical_deg: float) -> float:
    """Probability that a look finds the target: bilinear in the table.

    A finer ground sample distance counts as the first one. A coarser one than the last, or a flatter angle than the last: 0.
    """
    samples, angles = table.sample_m, table.off_vertical_deg
    if not (sample_m <= samples[-1] and off_vertical_deg <= angles[-1]):
        return 0.0
    j = min(max(int(np.searchsorted(samples, sample_m)) - 1, 0), max(samples.size - 2, 0))
    i = min(max(int(np.searchsorted(angles, off_vertical_deg)) - 1, 0), max(angles.size - 2, 0))
    right, below = min(j + 1, samples.size - 1), min(i + 1, angles.size - 1)
    width, height = samples[right] - samples[j], angles[below] - angles[i]
    x = min(1.0, max(0.0, (sample_m - samples[j]) / width)) if width > 0.0 else 0.0
    y = min(1.0, max(0.0, (off_vertical_deg - angles[i]) / height)) if height > 0.0 else 0.0
    upper = (1.0 - x) * table.probability[i, j] + x * table.probability[i, right]
    lower = (1.0 - x) * table.probability[below, j] + x * table.probability[below, right]
    return float((1.0 - y) * upper + y * lower)


@kernel
def note_look(table: DetectionTable, looks: Looks, cell: int, sample_m: float, de: float, dn: float, du: float) -> None:
    """Add a look from (de, dn, du), metres from the cell, to ``looks``."""
    off_vertical_deg = math.degrees(math.atan2(math.hypot(de, dn), du))
    found = look_probability(table, sample_m, off_vertical_deg)
    side = 0
    if off_vertical_deg > ABOVE_WITHIN_DEG:
        side = 1 + math.floor(math.degrees(math.atan2(de, dn)) / 90.0 + 0.5) % 4
    looks.missed[cell] *= 1.0 - found
    looks.best[cell, side] = max(looks.best[cell, side], found)

"""Viewpoints: places from which missing cells may be seen, and few of them that see as many as all.

The few are found by a greedy set cover over a grid of allowed places.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from uavcover.kernels import coverage as kernels
from uavcover.kernels.arrays import BoolArray, FloatArray, IntArray
from uavcover.kernels.cells import Cells
from uavcover.kernels.sight import Sight
from uavcover.planner.baselines.boustrophedon import best_height_agl_m
from uavcover.planner.set_cover.candidates import seen_from_each
from uavcover.scenario.airspace.flyable import flyable_area
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap, LevelObservations
from uavcover.sensing.observing import seen_often
from uavcover.sensing.sensors import whatever_heading

_SPACING_REACHES = 0.4
"""Candidates stand this many reaches apart."""
_AROUND_REACHES = (0.0, 0.35, 0.7, 0.95)
_AROUND_DIRECTIONS = 12
_AROUND_SHARES = (0.5, 0.0, 1.0)
_MOST_PLACES = 6_000
"""Around unseen cells, in one round."""


@dataclass(frozen=True, slots=True, eq=False)
class MissingCells:
    """Part of the cells of a map, with numbers of their own."""

    coverage: CoverageMap  # the whole map
    cells: Cells  # the part, cut out of the lattice
    numbers: IntArray  # (m,) of these cells in the whole map, rising
    weight_m2: FloatArray  # (m,) ground area of each

    @classmethod
    def of(cls, coverage: CoverageMap, missing: BoolArray) -> "MissingCells":
        """Those marked in ``missing`` (cells,), at least one."""
        whole = coverage.grid.cells
        chosen = np.zeros(whole.lattice.shape, dtype=bool)
        inside = whole.lattice >= 0
        chosen[inside] = missing[whole.lattice[inside]]
        rows, columns = np.flatnonzero(chosen.any(axis=1)), np.flatnonzero(chosen.any(axis=0))
        cut = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
        numbers = whole.lattice[cut][chosen[cut]]
        lattice = np.full(chosen[cut].shape, -1, dtype=np.int32)
        lattice[chosen[cut]] = np.arange(numbers.size, dtype=np.int32)
        own = (
            lattice, np.ascontiguousarray(whole.centre_m[numbers]), np.ascontiguousarray(whole.normal[numbers]),
            np.ascontiguousarray(whole.horizon[numbers]),
        )  # fmt: skip
        for array in own:
            array.flags.writeable = False  # kernels are compiled separately for writable and read-only arrays
        west_m = whole.east0_m + whole.size_m * int(columns[0])
        south_m = whole.north0_m + whole.size_m * int(rows[0])
        cells = Cells(west_m, south_m, whole.size_m, *own, whole.scatter_m)
        return cls(coverage, cells, numbers.astype(np.int64), coverage.grid.weight_m2[numbers])

    def seen_by(self, looks: LevelObservations, sight: Sight) -> BoolArray:
        """(m,) whether any observation sees each cell."""
        site = self.coverage.site
        if sight is self.coverage.sight and site.scenario.sensor.has_own_view:
            return seen_often(site, self.cells, looks.places_m, looks.headings) >= 0
        return kernels.seen_from_points(site.ground.surface, sight, self.cells, looks.places_m, looks.headings)

    def seen_on(self, route_m: FloatArray, sights: Sequence[Sight]) -> BoolArray:
        """(k, m) whether an (n, 3) ENU route as flown observes each cell by each of k sensors, by the sensing rule."""
        looks = self.coverage.flown_observations(route_m)
        return np.stack([self.seen_by(looks, sight) for sight in sights])


def grid_places(site: Site, missing: MissingCells) -> FloatArray:
    """(k, 3) places in a grid over the missing cells and their surroundings, at the height that sees widest.

    The last column is the height above ground.
    """
    height = best_height_agl_m(site)
    reach = max(site.scenario.sensor.half_width_m(height), site.scenario.area.cell_size_m)
    step = _SPACING_REACHES * reach
    centres = missing.cells.centre_m[:, :2]
    low, high = centres.min(axis=0) - reach, centres.max(axis=0) + reach
    east, north = np.meshgrid(
        *(low[axis] + (np.arange(math.ceil((high[axis] - low[axis]) / step)) + 0.5) * step for axis in (0, 1))
    )
    places = np.column_stack([east.ravel(), north.ravel()])
    # Importing scipy.spatial takes a while, which other commands need not wait for.
    from scipy.spatial import cKDTree

    near = np.isfinite(cKDTree(centres).query(places, distance_upper_bound=reach)[0])
    places = places[near & inside_fence(site, places)]
    return np.column_stack([places, np.full(len(places), height)])


def places_around(site: Site, cells_m: FloatArray) -> FloatArray:
    """(k, 3) points above and around (m, 3) cells at several heights of the band. The last column is above ground."""
    limits = site.scenario.limits
    low, high = limits.min_height_agl_m + limits.height_margin_m, limits.max_height_agl_m - limits.height_margin_m
    found = []
    for share in _AROUND_SHARES:
        height = low + share * (high - low)
        reach = site.scenario.sensor.half_width_m(height)
        for radius in _AROUND_REACHES:
            for angle in np.arange(_AROUND_DIRECTIONS if radius else 1) * (2.0 * math.pi / _AROUND_DIRECTIONS):
                by = radius * reach * np.array([math.cos(angle), math.sin(angle)])
                found.append(np.column_stack([cells_m[:, :2] + by, np.full(len(cells_m), height)]))
    places = np.vstack(found)
    return places[inside_fence(site, places[:, :2])]


def few_enough(cells_m: FloatArray) -> FloatArray:
    """Some of (m, 3) cells, evenly spaced, to limit the number of points around them; at least one is given."""
    places_a_cell = len(_AROUND_SHARES) * (1 + (len(_AROUND_REACHES) - 1) * _AROUND_DIRECTIONS)
    return cells_m[:: math.ceil(len(cells_m) * places_a_cell / _MOST_PLACES)]


def inside_fence(site: Site, places_m: FloatArray) -> BoolArray:
    """(k,) whether each of (k, 2) places is inside fence and no-fly zones by the acceptance radius, over known ground."""
    inner = flyable_area(site).polygon.buffer(-site.scenario.vehicle.acceptance_radius_m)
    inside = shapely.contains_xy(inner, places_m[:, 0], places_m[:, 1])
    return np.asarray(inside & np.isfinite(site.ground.heights_m(places_m)), dtype=bool)


def cover(missing: MissingCells, places_agl_m: FloatArray, sight: Sight, wanted: BoolArray) -> FloatArray:
    """A subset of (k, 3) places that sees the same ``wanted`` (m,) cells as all of them together.

    Always the one that sees the most ground not yet seen (greedy set cover: at most ln(m) + 1 times as many as needed). A camera
    that turns with the legs is taken as looking all ways at once: the route that is laid through the places decides.

    Returns:
        (j, 3) places with their heights above ground, in the order of choice.
    """
    ups = missing.coverage.site.ground.ups_m(places_agl_m[:, :2], places_agl_m[:, 2])
    eyes = np.column_stack([places_agl_m[:, :2], ups])
    start, cells = seen_from_each(missing.coverage, eyes, missing.numbers[wanted], whatever_heading(sight))
    places = np.repeat(np.arange(len(eyes)), np.diff(start))
    left = np.zeros(missing.coverage.grid.count)
    left[missing.numbers[wanted]] = missing.weight_m2[wanted]
    chosen: list[int] = []
    while len(chosen) < len(eyes):
        gain = np.bincount(places, weights=left[cells], minlength=len(eyes))
        best = int(np.argmax(gain))
        if gain[best] <= 0.0:
            break
        chosen.append(best)
        left[cells[start[best] : start[best + 1]]] = 0.0
    return places_agl_m[np.array(chosen, dtype=np.int64)]

"""The route that closes the gaps of a flight.

A greedy set cover over a grid of permitted positions gives a few viewpoints that observe all missing cells. They are put in a
short order, laid over the terrain, and pruned where the route already observes the ground.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from uavcover.errors import InfeasibleError
from uavcover.kernels import coverage as kernels
from uavcover.kernels.arrays import BoolArray, FloatArray, IntArray
from uavcover.kernels.cells import Cells
from uavcover.kernels.sight import Sight
from uavcover.kernels.tours import order_between_ends
from uavcover.missions.leg_checks import measure_violations
from uavcover.model.route import Route
from uavcover.planner.baselines.boustrophedon import best_height_agl_m
from uavcover.planner.set_cover import observed_from_each
from uavcover.planner.terrain_following import lay_over_terrain
from uavcover.scenario.airspace.flyable import flyable_area
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap, LevelObservations
from uavcover.sensing.sensors import any_heading, inside_every_heading, keeping_inside, observed_often

_SPACING_REACHES = 0.4
"""Candidates stand this many reaches apart."""
_AROUND_REACHES = (0.0, 0.35, 0.7, 0.95)
_AROUND_DIRECTIONS = 12
_AROUND_FRACTIONS = (0.5, 0.0, 1.0)
_MOST_POSITIONS = 6_000
"""Around unseen cells, in one round."""


@dataclass(frozen=True, slots=True, eq=False)
class MissingCells:
    """Part of the cells of a map, numbered separately."""

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

    def observed_by(self, looks: LevelObservations, sight: Sight) -> BoolArray:
        """(m,) whether any observation observes each cell."""
        site = self.coverage.site
        if sight is self.coverage.sight and site.scenario.sensor.has_own_view:
            return observed_often(site, self.cells, looks.positions_m, looks.headings) >= 0
        return kernels.observed_from_points(site.ground.surface, sight, self.cells, looks.positions_m, looks.headings)

    def observed_on(self, route_m: FloatArray, sights: Sequence[Sight]) -> BoolArray:
        """(k, m) whether an (n, 3) ENU route as flown observes each cell by each of k sensors, by the sensing rule."""
        looks = self.coverage.flown_observations(route_m)
        return np.stack([self.observed_by(looks, sight) for sight in sights])


def grid_positions(site: Site, missing: MissingCells) -> FloatArray:
    """(k, 3) positions in a grid over the missing cells and their surroundings, at the height of the widest view.

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
    positions = np.column_stack([east.ravel(), north.ravel()])
    # Importing scipy.spatial takes a while, which other commands need not wait for.
    from scipy.spatial import cKDTree

    near = np.isfinite(cKDTree(centres).query(positions, distance_upper_bound=reach)[0])
    positions = positions[near & inside_fence(site, positions)]
    return np.column_stack([positions, np.full(len(positions), height)])


def positions_around(site: Site, cells_m: FloatArray) -> FloatArray:
    """(k, 3) points above and around (m, 3) cells at several heights of the band. The last column is above ground."""
    limits = site.scenario.limits
    low, high = limits.min_height_agl_m + limits.height_margin_m, limits.max_height_agl_m - limits.height_margin_m
    found = []
    for fraction in _AROUND_FRACTIONS:
        height = low + fraction * (high - low)
        reach = site.scenario.sensor.half_width_m(height)
        for radius in _AROUND_REACHES:
            for angle in np.arange(_AROUND_DIRECTIONS if radius else 1) * (2.0 * math.pi / _AROUND_DIRECTIONS):
                by = radius * reach * np.array([math.cos(angle), math.sin(angle)])
                found.append(np.column_stack([cells_m[:, :2] + by, np.full(len(cells_m), height)]))
    positions = np.vstack(found)
    return positions[inside_fence(site, positions[:, :2])]


def few_enough(cells_m: FloatArray) -> FloatArray:
    """At least one of (m, 3) cells, evenly spaced, to limit the number of points around them."""
    positions_a_cell = len(_AROUND_FRACTIONS) * (1 + (len(_AROUND_REACHES) - 1) * _AROUND_DIRECTIONS)
    return cells_m[:: math.ceil(len(cells_m) * positions_a_cell / _MOST_POSITIONS)]


def inside_fence(site: Site, positions_m: FloatArray) -> BoolArray:
    """(k,) whether each of (k, 2) positions is inside fence and no-fly zones by the acceptance radius, over known ground."""
    inner = flyable_area(site).polygon.buffer(-site.scenario.vehicle.acceptance_radius_m)
    inside = shapely.contains_xy(inner, positions_m[:, 0], positions_m[:, 1])
    return np.asarray(inside & np.isfinite(site.ground.heights_m(positions_m)), dtype=bool)


def cover(
    missing: MissingCells,
    positions_agl_m: FloatArray,
    sight: Sight,
    wanted: BoolArray,
    is_over: Callable[[], bool] = lambda: False,
) -> FloatArray:
    """A subset of (k, 3) positions that observes the same ``wanted`` (m,) cells as all of them together.

    Greedy set cover: choose the position that observes the most unobserved ground (at most ln(m) + 1 times the optimum). A camera
    that turns with the legs is assumed to look in all directions, because the route through the positions determines its heading.
    When the time is over, only some of the positions are considered.

    Returns:
        (j, 3) positions with their heights above ground, in the order of choice.
    """
    ups = missing.coverage.site.ground.ups_m(positions_agl_m[:, :2], positions_agl_m[:, 2])
    eyes = np.column_stack([positions_agl_m[:, :2], ups])
    start, cells = observed_from_each(missing.coverage, eyes, missing.numbers[wanted], any_heading(sight), is_over)
    positions = np.repeat(np.arange(len(eyes)), np.diff(start))
    left = np.zeros(missing.coverage.grid.count)
    left[missing.numbers[wanted]] = missing.weight_m2[wanted]
    chosen: list[int] = []
    while len(chosen) < len(eyes):
        gain = np.bincount(positions, weights=left[cells], minlength=len(eyes))
        best = int(np.argmax(gain))
        if gain[best] <= 0.0:
            break
        chosen.append(best)
        left[cells[start[best] : start[best + 1]]] = 0.0
    return positions_agl_m[np.array(chosen, dtype=np.int64)]


_TOLERANCE_M = 10.0
_ROUNDS = 8
"""Number of times that viewpoints are added for cells that the laid route does not observe."""
_PULLS = (1.0, 0.5, 0.2)
"""A corner is tried this far on the way to the middle of its neighbours, ..."""
_STEPS_M = (25.0, 8.0)
_DIRECTIONS = 8
"""... and this far away in each of this number of directions."""
_LEAST_GAIN_M = 0.5
"""A move that saves less is not worth its evaluation."""
_MARGIN = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class GapRoute:
    """A route for the gaps."""

    route: Route  # the waypoints
    wanted_m2: float  # ground area to observe
    observed_m2: float  # the part that the route observes


def plan_gap_route(
    coverage: CoverageMap,  # on the cells that results are judged on
    # (cells,) cells to observe; the caller omits those that no permitted position observes
    missing: BoolArray,
    *,
    start_m: FloatArray,  # (3,) ENU, where the vehicle comes from: home, or where it is
    end_m: FloatArray,  # (3,) ENU, where it goes to afterwards
    # sufficient area of the missing cells, without the costliest ones; default: all visible ones
    needed_m2: float | None = None,
    # area of the missing cells below which a route is useless
    useful_m2: float = 0.0,
    # whether the time for improvements is over: called between trials
    is_over: Callable[[], bool] = lambda: False,
    # whether no time is left even for the first route, which may then lack some of the ground
    gives_up: Callable[[], bool] = lambda: False,
) -> GapRoute:
    """A short route from a start to an end that observes the missing cells.

    The sensor is narrowed by the vehicle's acceptance radius, so that the flight observes the cells although waypoints are
    rounded. The full sensor is used for cells that the narrowed one misses.

    Raises:
        InfeasibleError: nothing is missing, or no permitted route observes enough of it to be useful.
    """
    if not missing.any():
        raise InfeasibleError("there are no gaps to close: all visible ground was observed")
    site = coverage.site
    builder = _Builder(site, MissingCells.of(coverage, missing), start_m, end_m, is_over, gives_up)
    builder.add_viewpoints(math.inf if needed_m2 is None else needed_m2)
    if builder.observed_m2 < useful_m2:
        raise InfeasibleError(f"cannot close the gaps: only {builder.observed_m2:.0f} of {useful_m2:.0f} m² is visible")
    if needed_m2 is not None:
        builder.drop_costly(needed_m2)
    builder.shorten()
    return builder.result()


class _Builder:
    """A route as corners on the map with wanted heights, and the cells that it observes."""

    def __init__(
        self, site: Site, missing: MissingCells, start_m: FloatArray, end_m: FloatArray,
        is_over: Callable[[], bool], gives_up: Callable[[], bool],
    ) -> None:  # fmt: skip
        self.site, self.missing = site, missing
        self.start_m, self.end_m = start_m, end_m
        self.is_over, self.gives_up = is_over, gives_up
        self.corners = np.empty((0, 3))
        limits, self.sight = site.scenario.limits, missing.coverage.sight
        middle_agl_m = 0.5 * (limits.min_height_agl_m + limits.max_height_agl_m)
        self.narrow = keeping_inside(self.sight, site.scenario.vehicle.acceptance_radius_m, middle_agl_m)
        self.views = np.zeros((2, len(missing.weight_m2)), dtype=bool)

    @property
    def observed(self) -> BoolArray:
        """(m,) cells observed by the unreduced sensor."""
        return np.asarray(self.views[1])

    @property
    def observed_m2(self) -> float:
        """Ground area of these."""
        return self._area_m2(self.observed)

    def add_viewpoints(self, needed_m2: float = math.inf) -> None:
        """Add corners until the laid route observes enough, or all: first with the narrowed sensor, then with the full one."""
        wanted = np.ones(len(self.missing.weight_m2), dtype=bool)
        grid = grid_positions(self.site, self.missing)
        self._take(np.vstack([self.corners, cover(self.missing, grid, self.narrow, wanted, self.gives_up)]))
        sights = [self.sight, *inside_every_heading(self.sight)]
        for _ in range(_ROUNDS):
            if self.observed.all() or self._area_m2(self.observed) >= needed_m2 or self.is_over():
                return
            around = positions_around(self.site, self._some_unobserved())
            more = cover(self.missing, around, sights[0], ~self.observed, self.gives_up)
            before = self.corners, self.views
            if len(more) > 0:
                self._take(np.vstack([self.corners, more]))
            if self.observed.sum() <= before[1][1].sum():
                # The camera looked away there. Next, try positions that observe the ground at any heading.
                self.corners, self.views = before
                sights = sights[1:]
                if not sights:
                    return

    def drop_costly(self, needed_m2: float) -> None:
        """Remove the corners that save the most distance for the ground they cover, while enough ground is observed.

        The loss of a corner mostly grows as others go, unless a new order moves the legs. So a corner is evaluated again only
        while its previous loss promises more than the best one so far (lazy greedy, Minoux 1978).
        """
        cell_m2 = self.missing.coverage.grid.cells.size_m**2
        lost_m2 = np.full(len(self.corners), cell_m2)
        while len(self.corners) > 1:
            now_m2 = self._area_m2(self.observed)
            saved_m = self._savings()
            best, best_score = None, 0.0
            for k in np.argsort(-saved_m / lost_m2, kind="stable"):
                if saved_m[k] / lost_m2[k] <= best_score:
                    break
                if self.is_over():
                    return
                # Another order has other legs over the terrain, so evaluate the flown route.
                fewer = np.delete(self.corners, k, axis=0)
                order = self._order(fewer)
                views = self._views_with(fewer[order])
                left_m2 = self._area_m2(views[1])
                lost_m2[k] = max(now_m2 - left_m2, cell_m2) if left_m2 >= needed_m2 else np.inf
                if saved_m[k] / lost_m2[k] > best_score:
                    best, best_score = (fewer[order], views, np.delete(lost_m2, k)[order]), saved_m[k] / lost_m2[k]
            if best is None:
                return
            self.corners, self.views, lost_m2 = best

    def shorten(self) -> None:
        """Remove corners and pull them in without losing coverage, by the narrowed or the full sensor."""
        keep = self.views
        improved = True
        while improved:
            improved = False
            for k in np.argsort(-self._savings(), kind="stable"):
                if self.is_over():
                    return
                if k < len(self.corners) and len(self.corners) > 1:
                    improved |= self._try(np.delete(self.corners, k, axis=0), keep)
            for k in range(len(self.corners)):
                for move in self._moves(k):
                    if self.is_over():
                        return
                    corners = self.corners.copy()
                    corners[k, :2] += move
                    if inside_fence(self.site, corners[k : k + 1, :2])[0] and self._try(corners, keep):
                        improved = True
                        break

    def result(self) -> GapRoute:
        """The route, laid over the terrain.

        Raises:
            InfeasibleError: it observes nothing.
        """
        if not self.observed.any():
            raise InfeasibleError("no allowed position can observe any of the gaps; they remain open")
        return GapRoute(
            Route(self._laid(self.corners)), self._area_m2(np.ones_like(self.observed)), self._area_m2(self.observed)
        )

    def _moves(self, k: int) -> FloatArray:
        """(j, 2) moves of a corner that may shorten the route."""
        around = self._with_ends()[[k, k + 2], :2]
        pulls = np.multiply.outer(_PULLS, around.mean(axis=0) - self.corners[k, :2])
        angles = np.arange(_DIRECTIONS) * (2.0 * np.pi / _DIRECTIONS)
        steps = np.multiply.outer(_STEPS_M, np.column_stack([np.cos(angles), np.sin(angles)]))
        return np.vstack([pulls, steps.reshape(-1, 2)])

    def _try(self, corners: FloatArray, keep: BoolArray) -> bool:
        """Accept other corners if they shorten the route, keep coverage of ``keep`` and exceed no further limit.

        Fewer corners are accepted at equal length.
        """
        corners = self._ordered(corners)
        gain_m = self._length_m(self.corners) - self._length_m(corners)
        if not gain_m > (-_MARGIN if len(corners) < len(self.corners) else _LEAST_GAIN_M):
            return False
        views = self._views_with(corners)
        if (keep & ~views).any() or self._violation(corners) > self._violation(self.corners) + _MARGIN:
            return False
        self.corners, self.views = corners, views
        return True

    def _take(self, corners: FloatArray) -> None:
        self.corners = self._ordered(corners)
        self.views = self._views_with(self.corners)

    def _ordered(self, corners: FloatArray) -> FloatArray:
        return corners[self._order(corners)]

    def _order(self, corners: FloatArray) -> IntArray:
        """(n,) a short order of the corners between start and end."""
        positions = np.vstack([self.start_m[:2], corners[:, :2], self.end_m[:2]])
        distance = np.hypot(*(positions[:, None] - positions[None]).transpose(2, 0, 1))
        return order_between_ends(np.ascontiguousarray(distance))[1:-1] - 1

    def _with_ends(self) -> FloatArray:
        return np.vstack([[*self.start_m[:2], 0.0], self.corners, [*self.end_m[:2], 0.0]])

    def _savings(self) -> FloatArray:
        """(n,) distance saved by removing each corner."""
        positions = self._with_ends()[:, :2]
        legs = np.hypot(*np.diff(positions, axis=0).T)
        return np.asarray(legs[:-1] + legs[1:] - np.hypot(*(positions[2:] - positions[:-2]).T))

    def _length_m(self, corners: FloatArray) -> float:
        positions = np.vstack([self.start_m[:2], corners[:, :2], self.end_m[:2]])
        return float(np.hypot(*np.diff(positions, axis=0).T).sum())

    def _laid(self, corners: FloatArray) -> FloatArray:
        if len(corners) == 1:
            up = self.site.ground.ups_m(corners[:, :2], corners[:, 2])
            return np.column_stack([corners[:, :2], up])
        return lay_over_terrain(self.site, corners[:, :2], corners[:, 2], tolerance_m=_TOLERANCE_M)

    def _views_with(self, corners: FloatArray) -> BoolArray:
        """(2, m) cells that the laid route observes: with the narrowed sensor, and with the full one."""
        if len(corners) == 0:  # the positions that were considered observe nothing
            return np.zeros_like(self.views)
        return self.missing.observed_on(self._laid(corners), (self.narrow, self.sight))

    def _violation(self, corners: FloatArray) -> float:
        return measure_violations(self.site, self._laid(corners), margin_m=0.0).total

    def _some_unobserved(self) -> FloatArray:
        return few_enough(self.missing.cells.centre_m[~self.observed])

    def _area_m2(self, observed: BoolArray) -> float:
        return float(self.missing.weight_m2[observed].sum())

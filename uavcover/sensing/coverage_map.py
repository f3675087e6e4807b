"""Coverage of routes and tracks, and the visible cells.

Observations are positions and headings of a level vehicle. Positions around a cell are tried to find out whether it is visible.
"""

import itertools
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from operator import attrgetter
from typing import Any, TypeVar

import numpy as np
import shapely
from numpy.typing import NDArray

from uavcover.kernels import coverage as kernels
from uavcover.kernels.arrays import BoolArray, FloatArray, IntArray, read_only
from uavcover.kernels.sight import Sight
from uavcover.scenario.airspace.flyable import flyable_area
from uavcover.scenario.obstacles import waypoint_breaches
from uavcover.scenario.site import Site
from uavcover.sensing import sensors
from uavcover.sensing.cells import CellGrid, make_cells, with_rises
from uavcover.sensing.flown_line import corners_matter, heading_there, line_flown, photos_on, positions_passed_m
from uavcover.sensing.sensors import sample_spacing_m, trial_positions, trigger_distance_m, turns_with_legs


@dataclass(frozen=True, slots=True, eq=False)
class LevelObservations:
    """Observations in flying order.

    Attributes:
        positions_m: (k, 3) ENU.
        headings: (k, 2) direction east and north, of any length; (0, 0) where there is no heading.
    """

    positions_m: FloatArray
    headings: FloatArray

    def __len__(self) -> int:
        return int(self.positions_m.shape[0])

    @classmethod
    def towards_north(cls, positions_m: FloatArray) -> "LevelObservations":
        """Observations from (k, 3) ENU positions, heading north: for sensors whose view does not depend on heading."""
        positions = np.ascontiguousarray(positions_m, dtype=float).reshape(-1, 3)
        return cls(positions, np.tile([0.0, 1.0], (len(positions), 1)))

    @classmethod
    def by_yaw(cls, positions_m: FloatArray, yaw_deg: FloatArray) -> "LevelObservations":
        """Observations from (k, 3) ENU positions with (k,) yaws, clockwise from north; no heading where yaw is NaN."""
        positions = np.ascontiguousarray(positions_m, dtype=float).reshape(-1, 3)
        yaw = np.radians(yaw_deg)
        return cls(positions, np.nan_to_num(np.column_stack([np.sin(yaw), np.cos(yaw)])))

    def spread_out(self) -> "LevelObservations":
        """The same observations in another order: first those far from each other, then those in between.

        Neighbours on a path observe similar ground. A few observations all over the map decide most cells, which then need no
        further test.
        """
        strides = [np.arange(0, len(self), _FIRST_STRIDE)]
        stride = _FIRST_STRIDE
        while stride > 1:
            strides.append(np.arange(stride // 2, len(self), stride))
            stride //= 2
        order = np.concatenate(strides)
        return LevelObservations(
            np.ascontiguousarray(self.positions_m[order]), np.ascontiguousarray(self.headings[order])
        )


_FIRST_STRIDE = 64
"""A power of two: 16 to 256 are equally fast, 1.1 to 2.1 times as fast as the order of flight (docs/results/cost.md)."""


_AT_A_TIME = 100_000
_MOST_CELLS = 16_000_000
"""Cells of all kept routes together, one byte each."""
Found = TypeVar("Found", bound=NDArray[Any])
_SAME_POSITION_M = 1e-6


class RecentlyObserved:
    """The cells that the latest routes observe, by route, because a search evaluates the same route several times."""

    def __init__(self, *, most_cells: int = _MOST_CELLS) -> None:
        self._most_cells = most_cells
        self._observed: OrderedDict[bytes, Any] = OrderedDict()
        self._cells = 0
        # Routes are evaluated in parallel.
        self._lock = threading.Lock()

    def knows(self, route_m: FloatArray) -> bool:
        """Whether the observations of an (n, 3) route are known."""
        with self._lock:
            return _key(route_m) in self._observed

    def get(self, route_m: FloatArray, find: Callable[[], Found]) -> Found:
        """(cells,) observed by an (n, 3) route, or (bytes,) of it, read-only; ``find`` computes them if unknown."""
        key = _key(route_m)
        with self._lock:
            known: Found | None = self._observed.get(key)
        if known is not None:
            return known
        found = find()
        self.keep(route_m, found)
        return found

    def keep(self, route_m: FloatArray, found: NDArray[Any]) -> None:
        """Store the observations of an (n, 3) route."""
        key = _key(route_m)
        found.flags.writeable = False
        with self._lock:
            if key not in self._observed:
                self._observed[key] = found
                self._cells += found.size
            while self._cells > self._most_cells:
                self._cells -= self._observed.popitem(last=False)[1].size


def _key(route_m: FloatArray) -> bytes:
    return np.ascontiguousarray(route_m, dtype=float).tobytes()


class CoverageMap:
    """Computes which cells of a site are observed, for one cell size.

    Attributes:
        site: the scenario on its ground.
        grid: its cells.
        sight: its sensor.
    """

    def __init__(self, site: Site, *, cell_size_m: float, cut: Callable[[Site, float], CellGrid] = make_cells) -> None:
        self.site = site
        self.grid: CellGrid = cut(site, cell_size_m)
        self.sight: Sight = site.scenario.sensor.sight
        self._recent = RecentlyObserved()
        self._coverable_pieces: dict[int, BoolArray] = {}

    def expect_many_routes(self) -> None:
        """Find what decides most rays, unless it is known: see :func:`uavcover.sensing.cells.with_rises`."""
        self.grid = with_rises(self.site, self.grid)

    def less_certain(self, *, position_m: float, height_m: float) -> "CoverageMap":
        """The same cells, for flights whose positions are at least this uncertain."""
        known = self.site.scenario.uncertainty
        wider = replace(known, position_m=max(known.position_m, position_m), height_m=max(known.height_m, height_m))
        return SameCells(self, replace(self.site, scenario=replace(self.site.scenario, uncertainty=wider)))

    def observations(self, route_m: FloatArray) -> LevelObservations:
        """Observations of a sensor on an (n, 3) ENU route: at its waypoints, along its legs, or at trigger points.

        A camera that turns with the legs observes twice from a waypoint between two legs, once along each. A distance-triggered
        camera takes at most one photo there, on the leg that ends.
        """
        route = np.ascontiguousarray(route_m, dtype=float).reshape(-1, 3)
        return self._observations(route, np.diff(route[:, :2], axis=0))

    def _observations(self, route: FloatArray, directions: FloatArray) -> LevelObservations:
        """Observations on an (n, 3) ENU route; the vehicle heads along (n - 1, 2) directions on its legs."""
        if not self.site.scenario.sensor.looks_along_path:
            return LevelObservations.towards_north(route)
        trigger_m = trigger_distance_m(self.site.scenario)
        if trigger_m is not None:
            return self._photos(route, directions, trigger_m)
        spacing_m = sample_spacing_m(self.site.scenario)
        if not turns_with_legs(self.sight):
            return LevelObservations.towards_north(kernels.sample_path(read_only(route), spacing_m))
        legs = [kernels.sample_path(read_only(route[k : k + 2]), spacing_m) for k in range(len(route) - 1)]
        headings = [np.tile(direction, (len(leg), 1)) for leg, direction in zip(legs, directions, strict=True)]
        if not legs:
            return LevelObservations(route, np.zeros((len(route), 2)))
        return LevelObservations(np.vstack(legs), np.vstack(headings))

    def _photos(self, route: FloatArray, directions: FloatArray, trigger_m: float) -> LevelObservations:
        """Trigger points on an (n, 3) ENU route, each turned along the (n - 1, 2) direction of its leg."""
        legs, positions_m = photos_on(route, trigger_m)
        headings = np.vstack([directions, np.zeros(2)])[legs]  # a single waypoint has no direction
        return LevelObservations(positions_m, np.ascontiguousarray(headings))

    def flown_observations(self, route_m: FloatArray) -> LevelObservations:
        """As :meth:`observations`, with corners as the autopilot flies them, if that changes the observations."""
        route = np.ascontiguousarray(route_m, dtype=float).reshape(-1, 3)
        if not self.site.scenario.sensor.looks_along_path:
            return self.observations(positions_passed_m(self.site, route))
        if not corners_matter(self.site):
            return self.observations(route)
        line = line_flown(self.site, route)
        looks = self._observations(line.positions_m, line.headings)
        if trigger_distance_m(self.site.scenario) is not None:
            # The first photo is taken at the stop, before the turn onto the first leg.
            looks.headings[0] = heading_there(self.site, route[0])
        return looks

    def observed_legs(self, route_m: FloatArray) -> IntArray:
        """(k,) number of the leg of an (n, 3) ENU route, n >= 2, of each of its :meth:`observations`."""
        route = np.ascontiguousarray(route_m, dtype=float)
        trigger_m = trigger_distance_m(self.site.scenario)
        if trigger_m is not None:
            return kernels.photo_positions(route, trigger_m)[0]
        path_m, at_m = path_lengths_m(route), path_lengths_m(self.observations(route).positions_m)
        # One between two legs belongs to the first; the second one from the same position, of a turning camera, to the other.
        again = np.concatenate([[False], np.diff(at_m) == 0.0])
        leg = np.searchsorted(path_m, np.where(again, at_m + _SAME_POSITION_M, at_m - _SAME_POSITION_M)) - 1
        return np.clip(leg, 0, len(path_m) - 2)

    def observed(self, route_m: FloatArray) -> BoolArray:
        """(cells,) whether an (n, 3) ENU route as flown observes each cell by the sensing rule; read-only."""
        return self._recent.get(route_m, lambda: self.observed_by(self.flown_observations(route_m)))

    def blocks(self) -> Iterator["CoverageMap"]:
        """Maps whose cells, in this order, are its cells: itself, or several that are made one after the other."""
        yield self

    def observed_by(self, observations: LevelObservations) -> BoolArray:
        """(cells,) whether enough of the observations observe each cell, as the scenario requires."""
        if self.site.scenario.requirements.look_distance_m is None:
            # The observed cells do not depend on the order.
            observations = observations.spread_out()
        return self.first_observed(observations) >= 0

    def first_observed(self, observations: LevelObservations) -> NDArray[np.int64]:
        """(cells,) number of the observation that completes the requirement for each cell, -1 if none does."""
        surface, wanted = self.site.ground.surface, self.site.scenario.requirements
        if self.site.scenario.sensor.has_own_view:
            looks = wanted.looks, wanted.look_distance_m or 0.0
            return sensors.observed_often(
                self.site, self.grid.cells, observations.positions_m, observations.headings, looks
            )
        if wanted.look_distance_m is not None:
            return kernels.observed_often(
                surface,
                self.sight,
                self.grid.cells,
                observations.positions_m,
                observations.headings,
                wanted.looks,
                wanted.look_distance_m,
            )
        positions_m, headings = read_only(observations.positions_m), read_only(observations.headings)
        return kernels.first_observed(surface, self.sight, self.grid.cells, positions_m, headings)

    def fraction(self, observed: BoolArray) -> float:
        """Fraction of the area, 0..1, weighted by ground surface."""
        return self.grid.fraction(observed)

    def fraction_of_coverable(self, observed: BoolArray) -> float:
        """Fraction of the coverable area, 0..1; 0 when nothing is coverable."""
        coverable = float(self.grid.weight_m2[self.coverable].sum())
        return float(self.grid.weight_m2[observed & self.coverable].sum()) / coverable if coverable > 0.0 else 0.0

    @cached_property
    def coverable(self) -> BoolArray:
        """(cells,) whether a cell can be observed from a permitted position.

        Every cell is tried from several positions around it (:func:`trial_positions`), all inside the fence, the height band
        and the sea-level limits, outside no-fly zones and clear of obstacles. An observed cell is certainly visible. Other
        cells might be observed from a position that was not tried, so the set is a lower bound.
        """
        _ = self.knows_coverable(lambda: False)
        pieces = [piece for _, piece in sorted(self._coverable_pieces.items())]
        return np.concatenate(pieces) if pieces else np.zeros(0, dtype=bool)

    def knows_coverable(self, is_over: Callable[[], bool]) -> bool:
        """Find ``coverable`` while there is time; whether it is known now.

        Args:
            is_over: whether the time is over.
        """
        # Cells are independent; blocks only limit the memory.
        for first in range(0, self.grid.count, _AT_A_TIME):
            if first not in self._coverable_pieces:
                piece = self._can_be_observed(np.arange(first, min(first + _AT_A_TIME, self.grid.count)), is_over)
                if piece is None:
                    return False
                self._coverable_pieces[first] = piece
        return True

    def _can_be_observed(self, cells: NDArray[np.int64], is_over: Callable[[], bool]) -> BoolArray | None:
        """(k,) whether each of some cells can be observed from a permitted position; None if the time is over before."""
        wanted = self.site.scenario.requirements
        apart_m = wanted.look_distance_m or 0.0
        times = np.zeros(cells.size, dtype=np.int64)
        counted = np.full((cells.size, wanted.looks, 3), np.inf)
        for offset_m, positions in itertools.groupby(
            trial_positions(self.site.scenario), attrgetter("east_m", "north_m")
        ):
            todo = np.flatnonzero(times < wanted.looks)
            if todo.size == 0:
                break
            if is_over():
                return None
            over = self.grid.cells.centre_m[cells[todo], :2] + np.array(offset_m)
            allowed, low, high = self._allowed_ups_m(over)
            todo, over = todo[allowed], over[allowed]
            for position in positions:
                eyes = np.column_stack([over, low + position.band_fraction * (high - low)])
                eyes[times[todo] == wanted.looks] = np.nan
                if apart_m > 0.0:
                    near = (np.linalg.norm(counted[todo] - eyes[:, None], axis=2) < apart_m).any(axis=1)
                    eyes[near] = np.nan
                observations = LevelObservations(
                    eyes, np.tile([position.heading_e, position.heading_n], (todo.size, 1))
                )
                observed = observes_each(self, observations, cells[todo], self.sight)
                # Few positions observe their cell, so only these are compared with the obstacles.
                breaches = waypoint_breaches(self.site.ground, eyes[observed], self.site.scenario.obstacles)
                observed[observed] = breaches[:, 1] <= 0.0
                counted[todo[observed], times[todo[observed]]] = eyes[observed]
                times[todo[observed]] += 1
        return np.asarray(times == wanted.looks, dtype=bool)

    def restricted_to(self, only: BoolArray) -> "CoverageMap":
        """This map with fewer visible cells: those of the (cells,) marked ones."""
        return SameCells(self, self.site, coverable=self.coverable & only)

    def flown_from(self, site: Site, coverable: BoolArray | None = None) -> "CoverageMap":
        """This map for another vehicle of a fleet: the same cells and sensor, with its home and settings.

        Args:
            site: of the vehicle.
            coverable: (cells,) cells that can be covered; None: the same.
        """
        return SameCells(self, site, coverable=coverable)

    def _allowed_ups_m(self, east_north_m: FloatArray) -> tuple[BoolArray, FloatArray, FloatArray]:
        """(k,) whether a position above each of (k, 2) points is permitted without obstacles, and its lowest and highest up."""
        limits = self.site.scenario.limits
        inside = shapely.intersects_xy(flyable_area(self.site).polygon, east_north_m[:, 0], east_north_m[:, 1])
        over = east_north_m[inside]
        low = self.site.ground.ups_m(over, limits.min_height_agl_m)
        high = self.site.ground.ups_m(over, limits.max_height_agl_m)
        if limits.min_alt_amsl_m is not None or limits.max_alt_amsl_m is not None:
            # Sea level in the local frame: up minus height above sea level, at the position itself.
            ground = self.site.ground.heights_m(over)
            sea = ground - self.site.alts_amsl_m(np.column_stack([over, ground]))
            low = np.maximum(low, -np.inf if limits.min_alt_amsl_m is None else limits.min_alt_amsl_m + sea)
            high = np.minimum(high, np.inf if limits.max_alt_amsl_m is None else limits.max_alt_amsl_m + sea)
        allowed: BoolArray = low <= high
        inside[inside] = allowed
        return inside, low[allowed], high[allowed]


class SameCells(CoverageMap):
    """The cells of another map, with the same sensor, for other settings of their site."""

    def __init__(self, other: CoverageMap, site: Site, coverable: BoolArray | None = None) -> None:
        self.site, self.sight = site, other.sight
        self._other, self._coverable = other, coverable
        # Another vehicle may fly a route in another way.
        self._recent = other._recent if site is other.site else RecentlyObserved()

    @property
    def grid(self) -> CellGrid:  # type: ignore[override]
        """Its cells."""
        return self._other.grid

    @property
    def coverable(self) -> BoolArray:
        """See :class:`CoverageMap`."""
        return self._other.coverable if self._coverable is None else self._coverable

    def knows_coverable(self, is_over: Callable[[], bool]) -> bool:
        """See :class:`CoverageMap`."""
        return self._coverable is not None or self._other.knows_coverable(is_over)

    def blocks(self) -> Iterator[CoverageMap]:
        """See :class:`CoverageMap`."""
        yield from self._other.blocks()

    def observed_by(self, observations: LevelObservations) -> BoolArray:
        """See :class:`CoverageMap`."""
        return self._other.observed_by(observations)

    def first_observed(self, observations: LevelObservations) -> NDArray[np.int64]:
        """See :class:`CoverageMap`."""
        return self._other.first_observed(observations)


def path_lengths_m(points: FloatArray) -> FloatArray:
    """(n,) length of the path through (n, 3) points up to each of them."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


def observes_each(
    coverage: CoverageMap, observations: LevelObservations, cell_numbers: NDArray[np.int64], sight: Sight
) -> BoolArray:
    """(k,) whether each of k observations observes the cell of the same row; False where a position is NaN."""
    cells, site = coverage.grid.cells, coverage.site
    positions_m = np.ascontiguousarray(observations.positions_m)
    centre_m, normal = cells.centre_m[cell_numbers], cells.normal[cell_numbers]
    if sight is coverage.sight and site.scenario.sensor.has_own_view:
        return sensors.observes_each(site, positions_m, observations.headings, centre_m, normal)
    return kernels.observes_each(site.ground.surface, sight, positions_m, observations.headings, centre_m, normal)

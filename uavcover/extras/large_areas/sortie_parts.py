"""Parts that are a flight each, around home: how many sectors and layers, and where their sides are.

A flight that observes something on its way there and back is worth more than one that works in a compact part: on 100 km² around
home the ways take a quarter of the time. So the area is divided into sectors and layers (``sectors.py``), as few as batteries
allow.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import pairwise

import numpy as np
import shapely
from shapely.affinity import affine_transform

from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.flight_time import leg_time
from uavcover.kernels.path_cost import battery_s, flight_s, route_cost
from uavcover.missions.leg_checks import measure_violations
from uavcover.missions.objectives import straight_flight_costs
from uavcover.missions.path_cost import path_cost_of
from uavcover.planner.baselines.boustrophedon import best_height_agl_m
from uavcover.planner.terrain_following import lay_over_terrain
from uavcover.scenario.site import Site
from uavcover.scenario.vehicles import Piece, pace_of, polygons_of
from uavcover.sensing.coverage_map import CoverageMap

# Sectors: parts of an area between two rays from home, and their flights, one for each layer.
#
# Every flight to a distant layer crosses nearer ground twice. Here it observes something on both ways: it goes out in a strip
# along one side of the sector, observes its layer in lines across, the nearest first, and comes home in a strip along the other
# side, which begins at the far end of its layer. Farther layers have the outer strips, and nearer ones see what is between them.
# Lines across meet the sides at right angles or nearly so, where lines along a ray would leave gaps or overlap in proportion to
# the distance from home. Where the sector is no wider than all its strips, flights observe it from straight ways to home.

_NEAREST = 0.6
"""A flight begins and ends to observe so near to home, in widths of a strip: what is nearer is observed on the way."""
_GRID_M = 1e-4
"""Corners of pieces lie on so fine a grid: between those anywhere rounding makes slivers, and these break what follows."""
_ROUNDED = 0.3
"""Fraction of a line across: above this remainder one more is flown."""


@dataclass(frozen=True, slots=True)
class Swath:
    """Strip that a flight covers beside it."""

    width_m: float  # of the ground that one line observes
    spacing_m: float  # between lines across
    inset_m: float  # how far lines stop before the border of what they observe


class Sector:
    """A sector and its layers, the first of them farthest from home.

    Attributes:
        piece: of the area, east and north metres.
    """

    def __init__(
        self,
        area: Piece,  # that is divided
        home_en: tuple[float, float],  # (east, north) of home
        from_rad: float,  # one side, counter-clockwise from east
        to_rad: float,  # the other side, less than pi farther
        layers: int,  # how many
        swath: Swath,  # what a flight observes
        *,
        turned: bool = False,  # whether flights go out along the other side
    ) -> None:
        middle = 0.5 * (from_rad + to_rad)
        along, across = (math.cos(middle), math.sin(middle)), (-math.sin(middle), math.cos(middle))
        if turned:
            across = (-across[0], -across[1])
        # The sector's own frame: x away from home, y from the side of the ways out to that of the return transit.
        self._home, self._axes = np.array(home_en), np.array([along, across])
        shift = -self._axes @ self._home
        own = _on_grid(affine_transform(area, [*along, *across, *shift]))
        west, south, east, north = own.bounds
        self._far_m = 4.0 * (math.hypot(max(abs(west), abs(east)), max(abs(south), abs(north))) + swath.width_m)
        self._half_rad, self._layers, self._swath = 0.5 * (to_rad - from_rad), layers, swath
        ends = self._far_m * np.array([math.cos(self._half_rad), math.sin(self._half_rad)])
        tip, far = 2.0 * self._far_m, ends[1]
        self._own = _common(
            own, shapely.Polygon([(0.0, 0.0), (ends[0], -far), (tip, -far), (tip, far), (ends[0], far)])
        )
        self._strips_from_m = layers * swath.width_m / math.sin(self._half_rad)
        self.piece = self._on_map(self._own)

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing of the area in it."""
        return bool(self._own.is_empty)

    def bounds_m(self, fractions: Sequence[float] | FloatArray) -> FloatArray:
        """(layers + 1,) ascending distances from home, along the axis, between layers with given fractions of the ground.

        Args:
            fractions: (layers,) of the ground, the layer farthest from home first.
        """
        nearest, _, farthest, _ = self._own.bounds
        distances = np.linspace(nearest, farthest, 65)
        below = np.array([0.0, *(self._own.intersection(self._band(nearest - 1.0, far)).area for far in distances[1:])])
        wanted = below[-1] * np.cumsum(list(fractions)[::-1]) / sum(fractions)
        return np.array([nearest - 1.0, *np.interp(wanted[:-1], below, distances), farthest + 1.0])

    def pieces(self, bounds_m: FloatArray) -> list[Piece]:
        """Part of the area of each layer's flight: the layer and its strips; together the sector, none twice."""
        inside = self._band(-self._far_m, self._strips_from_m)
        near, left = _common(self._own, inside), _rest(self._own, inside)
        found: list[Piece] = []
        for layer in range(1, self._layers + 1):
            own = left
            if layer < self._layers:
                inner = bounds_m[self._layers - layer]
                sides = [self._side(sign, layer) for sign in (-1.0, 1.0)]
                beyond: Piece = self._band(inner, self._far_m)
                own = _common(left, reduce(_joined, sides, beyond))
            left = _rest(left, own)
            wedges = [_common(near, self._wedge(number)) for number in (layer - 1, 2 * self._layers - layer)]
            found.append(self._on_map(reduce(_joined, wedges, own)))
        return found

    def lines(self, layer: int, bounds_m: FloatArray, *, more: int, other_end: bool) -> FloatArray:
        """(n, 2) corners on the map of the flight that observes a layer.

        Args:
            layer: from 1, the one farthest from home.
            bounds_m: of the layers.
            more: number of lines across beyond those that fit.
            other_end: whether the first line across is begun at the side of the return transit.
        """
        inner, outer = bounds_m[self._layers - layer], bounds_m[self._layers - layer + 1]
        across = self._lines_across(layer, inner, outer, more)
        there = self._spoke(-1.0, layer, self._strips_from_m, inner)
        back = self._spoke(1.0, layer, self._strips_from_m, outer)[::-1]
        if len(back):
            chord = back[-1] - back[0]
            inset_m = min(self._swath.inset_m, 0.5 * float(np.hypot(*chord)))
            back[0] += inset_m * chord / max(float(np.hypot(*chord)), 1e-9)
        ordered = [line[:: 1 if (k % 2 == 0) == other_end else -1] for k, line in enumerate(across)]
        corners = np.vstack([there, *ordered, back])
        if len(corners) == 0:
            return corners
        whole = np.vstack([self._near_home(corners[0]), corners, self._near_home(corners[-1])])
        return np.asarray(whole @ self._axes + self._home)

    def _lines_across(self, layer: int, inner_m: float, outer_m: float, more: int) -> list[FloatArray]:
        """(2, 2) or (1, 2) each, from the side of the return to that of the outbound path. The nearest first."""
        ground = _common(self._own, self._band(max(inner_m, self._strips_from_m), outer_m))
        ground = _rest(ground, self._side(1.0, layer))
        if layer > 1:
            ground = _rest(ground, self._side(-1.0, layer - 1))
        if ground.is_empty:
            return []
        nearest, _, farthest, _ = ground.bounds
        count = max(1, math.ceil((farthest - nearest) / self._swath.spacing_m - _ROUNDED)) + more
        inset_m, found = self._swath.inset_m, []
        for x in nearest + (farthest - nearest) * (np.arange(count) + 0.5) / count:
            crossing = ground.intersection(shapely.LineString([(x, -self._far_m), (x, self._far_m)]))
            if crossing.is_empty:
                continue
            _, low, _, high = crossing.bounds
            ends = [high - inset_m, low + inset_m] if high - low > 2.0 * inset_m else [0.5 * (low + high)]
            found.append(np.array([(x, y) for y in ends]))
        return found

    def _spoke(self, sign: float, strip: int, near_m: float, far_m: float) -> FloatArray:
        """(2, 2) or (0, 2): near and far end of the middle of a strip, from 1 at the side, between two distances."""
        if far_m <= near_m:
            return np.empty((0, 2))
        ray, inward = self._ray(sign)
        begin = (strip - 0.5) * self._swath.width_m * inward
        inside = shapely.LineString([begin, begin + self._far_m * ray]).intersection(self._own)
        line = inside.intersection(self._band(near_m, far_m))
        if line.is_empty:
            return np.empty((0, 2))
        ends = shapely.get_coordinates(line)
        return ends[[int(np.argmin(ends[:, 0])), int(np.argmax(ends[:, 0]))]]

    def _near_home(self, corner: FloatArray) -> FloatArray:
        """Passage of a straight path between home and a corner near home inside the area; nothing without one."""
        away_m = float(np.hypot(*corner))
        position = corner * min(0.5, _NEAREST * self._swath.width_m / max(away_m, 1e-9))
        return position[None] if self._own.intersects(shapely.Point(position)) else np.empty((0, 2))

    def _ray(self, sign: float) -> tuple[FloatArray, FloatArray]:
        """The direction of a side, and that from it into the sector."""
        c, s = math.cos(self._half_rad), math.sin(self._half_rad)
        return np.array([c, sign * s]), np.array([s, -sign * c])

    def _side(self, sign: float, strips: int) -> shapely.Polygon:
        """The first strips at a side, and all beyond it."""
        ray, inward = self._ray(sign)
        line = strips * self._swath.width_m * inward + self._far_m * np.outer([-1.0, 1.0], ray)
        return shapely.Polygon([*line, *(line[::-1] - self._far_m * inward)])

    def _band(self, near_m: float, far_m: float) -> shapely.Polygon:
        """All between two distances from home along the axis."""
        return shapely.box(near_m, -self._far_m, far_m, self._far_m)

    def _wedge(self, number: int) -> shapely.Polygon:
        """One of 2 * layers equal wedges at home, from the side of the ways out."""
        width = math.tan(self._half_rad) * np.linspace(-1.0, 1.0, 2 * self._layers + 1)
        return shapely.Polygon([(0.0, 0.0), *((self._far_m, self._far_m * y) for y in width[number : number + 2])])

    def _on_map(self, own: Piece) -> Piece:
        (ax, ay), (bx, by) = self._axes
        return _on_grid(affine_transform(own, [ax, bx, ay, by, *self._home]))


def _on_grid(piece: shapely.Geometry) -> Piece:
    return polygons_of(shapely.set_precision(piece, _GRID_M))


def _common(one: Piece, other: Piece) -> Piece:
    return polygons_of(shapely.intersection(one, other, grid_size=_GRID_M))


def _rest(one: Piece, other: Piece) -> Piece:
    return polygons_of(shapely.difference(one, other, grid_size=_GRID_M))


def _joined(one: Piece, other: Piece) -> Piece:
    return polygons_of(shapely.union(one, other, grid_size=_GRID_M))


def rays_rad(
    area: Piece, home_en: tuple[float, float], begin_rad: float, extent_rad: float
) -> tuple[FloatArray, FloatArray]:
    """(k,) directions from home, and how much of the area is between the first of them and each."""
    home = np.array(home_en)
    west, south, east, north = area.bounds
    far_m = 4.0 * (math.hypot(east - west, north - south) + float(shapely.distance(area, shapely.Point(home))))
    angles = begin_rad + np.linspace(0.0, extent_rad, max(8, round(360 * extent_rad / (2.0 * math.pi))) + 1)
    ends = home + far_m * np.column_stack([np.cos(angles), np.sin(angles)])
    between = [area.intersection(shapely.Polygon([home, *pair])).area for pair in pairwise(ends)]
    return angles, np.concatenate([[0.0], np.cumsum(between)])


FEWEST = 4
"""With fewer flights sectors are wide, and the transits are short beside the rest."""
_MOST = 400
_WIDEST_RAD = 0.5 * math.pi
"""Widest sector."""
_TOLERANCE = 1 / 8
"""Tolerance of legs to their height, as a fraction of the band: as of tight lines."""
_INSET = 0.9
"""Inset at the ends of lines, as a fraction of the sensor's reach."""
_SPACINGS = (1.09, 1.06, 1.03, 1.0, 0.97, 0.94, 0.9, 0.85)
"""Between lines across, in widths of a swath: the widest that observes enough is taken."""
_ENOUGH = 0.002
"""Shortfall against the required coverage that is accepted in an initial solution."""
_BALANCINGS, _FINAL_BALANCINGS = 2, 5
_DAMPED = 0.8
"""Sides move so that loads become equal, by a power of what they differ by: numbers of lines change in steps."""
_COUNTS = 4
"""This number of sector counts is tried for each number of layers."""
_FULL = 1.03
"""Largest battery use of an initial solution, as a share; the search makes flights shorter by 5 to 8 %."""
_WELL_FILLED = 0.5
"""At least: fewer flights would do else."""


@dataclass(frozen=True, slots=True, eq=False)
class SortiePart:
    """A part of an area for one flight."""

    area: Piece  # of the part
    begin_m: FloatArray  # (n, 3) ENU of a flight that observes it, nearly
    cost: float  # of the mission that flies it
    load: float  # the fraction of what one flight may take: time, battery or items, whichever is most


def may_have_sorties(site: Site) -> bool:
    """Whether flights are limited and their ways count."""
    limited = site.scenario.vehicle.longest_flight_s is not None
    return limited and site.home_m is not None and not site.scenario.vehicles and path_cost_of(site).mission == 1


def sortie_parts(site: Site, coarse: CoverageMap, goal: float) -> list[SortiePart]:
    """Parts of least cost; empty with few flights, or if flights around home are infeasible or lack coverage.

    Args:
        site: for which :func:`may_have_sorties` holds.
        coarse: cells to find out what the flights observe.
        goal: required fraction of the coverable ground.
    """
    best: tuple[float, int, int] | None = None
    plans = _Sorties(site)
    for layers in range(1, 5):
        tried: dict[int, tuple[float, float]] = {}
        sectors = plans.first_guess(layers)
        while sectors not in tried and len(tried) < _COUNTS and sectors * layers <= _MOST:
            made = plans.divided(sectors, layers, 1.0, balancings=_BALANCINGS)
            if not made:
                break
            fullest = max(part.load for part in made)
            tried[sectors] = fullest, math.fsum(part.cost for part in made)
            sectors = max(plans.fewest_sectors, math.ceil(sectors * fullest / _FULL - 1e-9))
        for count, (fullest, cost) in tried.items():
            if _WELL_FILLED <= fullest <= _FULL and count * layers >= FEWEST and (best is None or cost < best[0]):
                best = cost, count, layers
    if best is None:
        return []
    for spacing in _SPACINGS:
        made = plans.divided(best[1], best[2], spacing, balancings=_FINAL_BALANCINGS)
        if not made or any(plans.breaks_limits(part.begin_m) for part in made):
            return []
        observed = np.zeros(coarse.grid.count, dtype=bool)
        for part in made:
            observed |= coarse.observed(part.begin_m)
        if coarse.fraction_of_coverable(observed) >= goal - _ENOUGH:
            return made
    return []


class _Sorties:
    """Divisions of one site."""

    def __init__(self, site: Site) -> None:
        self._site, self._path_cost = site, path_cost_of(site)
        home = site.home_m
        self._home = (0.0, 0.0) if home is None else (float(home[0]), float(home[1]))
        limits = site.scenario.limits
        self._tolerance_m = _TOLERANCE * (
            limits.max_height_agl_m - limits.min_height_agl_m - 2.0 * limits.height_margin_m
        )
        self._height_m = best_height_agl_m(site, tolerance_m=self._tolerance_m)
        self._reach_m = max(site.scenario.sensor.half_width_m(self._height_m), site.scenario.area.cell_size_m)
        begin_rad, extent_rad = _extent(site.area, self._home)
        # Where a ray is does not depend on small corners of the area.
        plain = polygons_of(site.area.simplify(0.5 * self._reach_m))
        self._angles, self._ground_m2 = rays_rad(plain, self._home, begin_rad, extent_rad)
        self.fewest_sectors = max(1, math.ceil(extent_rad / _WIDEST_RAD - 1e-9))

    def first_guess(self, layers: int) -> int:
        """Sectors, by the ground alone."""
        pace, longest_s = pace_of(self._site), self._site.scenario.vehicle.longest_flight_s or math.inf
        transit_m = float(self._site.area.area) / (2.0 * self._reach_m)
        flights = leg_time(pace, (0.0, 0.0, 0.0), (transit_m, 0.0, 0.0)) / longest_s
        return max(self.fewest_sectors, math.ceil(1.2 * flights / layers))

    def divided(self, sectors: int, layers: int, spacing: float, *, balancings: int) -> list[SortiePart]:
        """Parts with equal battery use. Empty where a part has no visible ground, or far more than a flight may take."""
        swath = Swath(2.0 * self._reach_m, spacing * 2.0 * self._reach_m, _INSET * self._reach_m)
        ground, fractions = np.diff(self._ground_m2), np.ones((sectors, layers))
        best: list[SortiePart] = []
        for _ in range(balancings):
            so_far = np.concatenate([[0.0], np.cumsum(ground)])
            sides = np.interp(np.linspace(0.0, so_far[-1], sectors + 1), so_far, self._angles)
            made: list[list[SortiePart]] = []
            for pair, fraction in zip(itertools.pairwise(sides), fractions, strict=True):
                sector = Sector(self._site.area, self._home, *pair, layers, swath)
                if sector.is_empty:
                    return best
                bounds_m = sector.bounds_m(fraction)
                flights = [self._flight(sector, layer, bounds_m) for layer in range(1, layers + 1)]
                if any(len(flight) < 2 for flight in flights):
                    return best
                made.append([self._part(*each) for each in zip(sector.pieces(bounds_m), flights, strict=True)])
            loads = np.array([[part.load for part in flights] for flights in made])
            if not best or loads.max() < max(part.load for part in best):
                best = list(itertools.chain.from_iterable(made))
            # Ground that takes more than its share counts more the next time.
            heavy = (loads.mean(axis=1) / loads.mean()) ** _DAMPED
            ground = ground * np.interp(
                0.5 * (self._angles[1:] + self._angles[:-1]), 0.5 * (sides[1:] + sides[:-1]), heavy
            )
            fractions = fractions * (loads.mean(axis=1, keepdims=True) / loads) ** _DAMPED
        return best

    def _flight(self, sector: Sector, layer: int, bounds_m: FloatArray) -> FloatArray:
        """(n, 3) over the terrain: of lines one more or fewer, begun at either end, the quickest over flat ground."""
        site = self._site
        paths = [sector.lines(layer, bounds_m, more=more, other_end=end) for more in (0, 1) for end in (False, True)]
        level = self._path_cost._replace(deviation_price=0.0)

        def cost(path: FloatArray) -> float:
            flat_m = np.column_stack([path, np.zeros(len(path))])
            return float(route_cost(site.ground.surface, level, flat_m))

        best = min((path for path in paths if len(path) > 1), key=cost, default=np.empty((0, 2)))
        if len(best) == 0:
            return np.empty((0, 3))
        heights_m = np.full(len(best), self._height_m)
        return lay_over_terrain(site, best, heights_m, tolerance_m=self._tolerance_m)

    def _part(self, area: Piece, begin_m: FloatArray) -> SortiePart:
        # mission items of a way between home and the first place that is observed: a few waypoints
        costs = straight_flight_costs(self._site, begin_m, transit_items=4)
        last = len(begin_m) - 1
        free = costs._replace(
            endurance_s=math.inf, item_limit=math.inf, energies=costs.energies._replace(usable_s=math.inf)
        )
        items = costs.there_items[0] + costs.each_items * (last + 1) + costs.back_items[last]
        load = max(
            flight_s(free, 0, last) / costs.endurance_s,
            battery_s(costs.energies, 0, last) / costs.energies.usable_s,
            items / costs.item_limit,
        )
        cost = float(route_cost(self._site.ground.surface, self._path_cost, begin_m))
        return SortiePart(area, begin_m, cost, float(load))

    def breaks_limits(self, route_m: FloatArray) -> bool:
        """Whether a flight keeps no limit on legs."""
        margin_m = self._site.scenario.limits.height_margin_m
        return measure_violations(self._site, route_m, margin_m=margin_m).total > 0.0


def _extent(area: Piece, home_en: tuple[float, float]) -> tuple[float, float]:
    """The first direction from home in which there is something of the area, and how far it reaches from there."""
    hull = area.convex_hull
    if hull.contains(shapely.Point(home_en)):
        return -math.pi, 2.0 * math.pi
    corners = shapely.get_coordinates(hull) - np.array(home_en)
    corners = corners[np.hypot(*corners.T) > 1e-6]
    angles = np.sort(np.arctan2(corners[:, 1], corners[:, 0]))
    gaps = np.diff(np.append(angles, angles[0] + 2.0 * math.pi))
    widest = int(np.argmax(gaps))
    return float(angles[(widest + 1) % len(angles)]), float(2.0 * math.pi - gaps[widest])

"""Parts that are a flight each, around home: how many sectors and layers, and where their sides are.

A flight that sees something on its way there and back is worth more than one that works in a compact part: on 100 km² around home
the ways take a quarter of the time. So the area is divided into sectors and layers (``sectors.py``), as few as batteries allow.
"""

import itertools
import math
from dataclasses import dataclass

import numpy as np
import shapely

from uavcover.extras.large_areas.sectors import Sector, Swath, rays_rad
from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.flight_time import leg_time
from uavcover.kernels.way_cost import battery_s, flight_s, route_cost
from uavcover.missions.flight_costs import straight_flight_costs
from uavcover.missions.leg_checks import measure_violations
from uavcover.missions.way_cost import way_cost_of
from uavcover.planner.baselines.boustrophedon import best_height_agl_m
from uavcover.planner.terrain_following import lay_over_terrain
from uavcover.scenario.pace import pace_of
from uavcover.scenario.site import Site
from uavcover.scenario.vehicle_areas import Piece, polygons_of
from uavcover.sensing.coverage_map import CoverageMap

FEWEST = 4
"""With fewer flights sectors are wide, and the transits are short beside the rest."""
_MOST = 400
_MOST_LAYERS = 4
_WIDEST_RAD = 0.5 * math.pi
"""Widest sector."""
_TOLERANCE = 1 / 8
"""Tolerance of legs to their height, as a share of the band: as of tight lines."""
_INSET = 0.9
"""Inset at the ends of lines, as a share of the sensor's reach."""
_SPACINGS = (1.09, 1.06, 1.03, 1.0, 0.97, 0.94, 0.9, 0.85)
"""Between lines across, in widths of a swath: the widest that sees enough is taken."""
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
_WAY_ITEMS = 4
"""Mission items of a way between home and the first place that is seen: a few waypoints."""


@dataclass(frozen=True, slots=True, eq=False)
class SortiePart:
    """A part of an area for one flight.

    Attributes:
        area: of the part.
        begin_m: (n, 3) ENU of a flight that sees it, nearly.
        cost: of the mission that flies it.
        load: the share of what one flight may take: time, battery or items, whichever is most.
    """

    area: Piece
    begin_m: FloatArray
    cost: float
    load: float


def may_have_sorties(site: Site) -> bool:
    """Whether flights are limited and their ways count."""
    limited = site.scenario.vehicle.longest_flight_s is not None
    return limited and site.home_m is not None and not site.scenario.vehicles and way_cost_of(site).mission == 1


def sortie_parts(site: Site, coarse: CoverageMap, goal: float) -> list[SortiePart]:
    """Parts of least cost; None with few flights, or where flights around home are infeasible or lack coverage.

    Args:
        site: for which :func:`may_have_sorties` holds.
        coarse: cells to find out what the flights see.
        goal: required share of the coverable ground.
    """
    best: tuple[float, int, int] | None = None
    plans = _Sorties(site)
    for layers in range(1, _MOST_LAYERS + 1):
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
        seen = np.zeros(coarse.grid.count, dtype=bool)
        for part in made:
            seen |= coarse.seen(part.begin_m)
        if coarse.share_of_coverable(seen) >= goal - _ENOUGH:
            return made
    return []


class _Sorties:
    """Divisions of one site."""

    def __init__(self, site: Site) -> None:
        self._site, self._way = site, way_cost_of(site)
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
        way_m = float(self._site.area.area) / (2.0 * self._reach_m)
        flights = leg_time(pace, (0.0, 0.0, 0.0), (way_m, 0.0, 0.0)) / longest_s
        return max(self.fewest_sectors, math.ceil(1.2 * flights / layers))

    def divided(self, sectors: int, layers: int, spacing: float, *, balancings: int) -> list[SortiePart]:
        """Parts with equal battery use. None where a part has no visible ground, or far more than a flight may take."""
        swath = Swath(2.0 * self._reach_m, spacing * 2.0 * self._reach_m, _INSET * self._reach_m)
        ground, shares = np.diff(self._ground_m2), np.ones((sectors, layers))
        best: list[SortiePart] = []
        for _ in range(balancings):
            so_far = np.concatenate([[0.0], np.cumsum(ground)])
            sides = np.interp(np.linspace(0.0, so_far[-1], sectors + 1), so_far, self._angles)
            made: list[list[SortiePart]] = []
            for pair, share in zip(itertools.pairwise(sides), shares, strict=True):
                sector = Sector(self._site.area, self._home, *pair, layers, swath)
                if sector.is_empty:
                    return best
                bounds_m = sector.bounds_m(share)
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
            shares = shares * (loads.mean(axis=1, keepdims=True) / loads) ** _DAMPED
        return best

    def _flight(self, sector: Sector, layer: int, bounds_m: FloatArray) -> FloatArray:
        """(n, 3) over the terrain: of lines one more or fewer, begun at either end, the quickest over flat ground."""
        site = self._site
        ways = [sector.lines(layer, bounds_m, more=more, other_end=end) for more in (0, 1) for end in (False, True)]
        level = self._way._replace(deviation_price=0.0)

        def cost(way: FloatArray) -> float:
            flat_m = np.column_stack([way, np.zeros(len(way))])
            return float(route_cost(site.ground.surface, level, flat_m))

        best = min((way for way in ways if len(way) > 1), key=cost, default=np.empty((0, 2)))
        if len(best) == 0:
            return np.empty((0, 3))
        heights_m = np.full(len(best), self._height_m)
        return lay_over_terrain(site, best, heights_m, tolerance_m=self._tolerance_m)

    def _part(self, area: Piece, begin_m: FloatArray) -> SortiePart:
        costs = straight_flight_costs(self._site, begin_m, way_items=_WAY_ITEMS)
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
        return SortiePart(area, begin_m, float(route_cost(self._site.ground.surface, self._way, begin_m)), float(load))

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

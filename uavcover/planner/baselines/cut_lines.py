"""Parallel lines cut at holes, bays and no-fly zones, and flown in a short order.

Plain lines cross the holes and bays of an area. A cell decomposition flies the lines of one cell after those of another. Here,
lines are cut into pieces, and a short tour visits the pieces in any order and direction. Orders by cells are some of these tours.
"""

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import shapely

from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.flight_time import leg_times
from uavcover.kernels.path_cost import LENGTH
from uavcover.kernels.tours import nearest, shorten
from uavcover.missions.path_cost import path_cost_of
from uavcover.model.route import Route
from uavcover.planner.baselines.boustrophedon import (
    Baseline,
    best_height_agl_m,
    directions_rad,
    evaluated,
    strip_half_width_m,
    to_lines_frame,
    width_across_m,
)
from uavcover.planner.terrain_following import PLAIN_TOLERANCE_M, flyable_paths, lay_over_terrain
from uavcover.scenario.airspace.flyable import flyable_area
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap

NAME = "cut-lines"

_CONVEX = 0.995
"""Fraction of its hull that an area fills whose lines need no cuts."""

_LINES = (1.0, 0.93, 1.07, 0.86)
"""Numbers of lines, as multiples of what flat ground needs."""

_DIRECTIONS = 3
"""Of each number of lines, this number of directions is flown."""

_MOST_ROUTES = 6

_NEAR, _TRIALS, _KICKS_PER_END, _MOST_ENDS = 10, 8, 60, 700
"""Ends that an end may be linked with; orders that are begun with; changes that are tried of each; and ends beyond which a
table of all links takes too long."""

_MOST_CORNERS = 400
"""With more corners of zones and bays a table of all ways takes too long: links are compared by their straight lines."""

_ROUNDS = 3
"""Number of times that ground is looked for which the pieces miss."""

_POINT_M = 1e-3
_STAYS = -1e5
"""Cost of the link that is a piece itself: far below all others, and small enough that sums with it stay exact."""


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """Pieces of lines."""

    ends_m: FloatArray  # (n, 2, 2) positions of both ends on the map
    height_agl_m: float  # of all of them


def needs_cuts(site: Site) -> bool:
    """Whether plain lines would cross ground outside the area, or positions where flight is not permitted."""
    hull = shapely.convex_hull(site.area)
    region = shapely.intersection(hull, flyable_area(site).polygon)
    return bool(min(site.area.area, region.area) < _CONVEX * hull.area)


def cut_lines(site: Site, goal: float, is_over: Callable[[], bool] = lambda: False) -> Iterator[Route]:
    """Routes of cut lines, the most promising directions and numbers of lines first.

    Args:
        site: the scenario on its ground; its sensor senses along the path.
        goal: fraction of the area that they should observe on flat ground.
        is_over: whether the time is over; the first order of each route is always improved.
    """
    height_m = best_height_agl_m(site)
    for fraction in _LINES:
        made: list[tuple[float, Pieces]] = []
        for angle in directions_rad(site):
            reach_m = strip_half_width_m(site, angle, height_m)
            lines = max(1, math.ceil(fraction * width_across_m(site, angle) / (2.0 * reach_m) - 1e-9))
            pieces = cut_pieces(site, angle, lines=lines, reach_m=reach_m, height_agl_m=height_m, goal=goal)
            if 0 < 2 * len(pieces.ends_m) <= _MOST_ENDS:
                # A link is at least as long as lines are apart.
                links_m = np.tile([[[0.0, 0.0], [2.0 * reach_m, 0.0]]], (len(pieces.ends_m), 1, 1))
                made.append((float(_leg_costs(site, np.vstack([pieces.ends_m, links_m])).sum()), pieces))
        for _, pieces in sorted(made, key=lambda each: each[0])[:_DIRECTIONS]:
            yield ordered_route(site, pieces, is_over)


def cut_baselines(coverage: CoverageMap, goal: float, should_stop: Callable[[], bool]) -> list[Baseline]:
    """Cut lines evaluated, the most promising ones; the first one in any time."""
    found: list[Baseline] = []
    for route in itertools.islice(cut_lines(coverage.site, goal, should_stop), _MOST_ROUTES):
        found += evaluated(coverage, NAME, [route], None)
        if should_stop():
            break
    return found


def cut_pieces(site: Site, angle_rad: float, *, lines: int, reach_m: float, height_agl_m: float, goal: float) -> Pieces:
    """Equally spaced lines in a direction, cut to the ground to observe and to permitted positions.

    Pieces are added for ground that the lines miss beside holes and at slanted borders.

    Args:
        site: the scenario on its ground.
        angle_rad: direction of the lines, counter-clockwise from east.
        lines: number of lines.
        reach_m: half the width of the observed strip.
        height_agl_m: of the lines.
        goal: required fraction of the area.
    """
    turn = to_lines_frame(angle_rad)
    area, open_to = (
        shapely.transform(each, lambda positions: positions @ turn.T)
        for each in (site.area, flyable_area(site).polygon)
    )
    west, south, east, north = area.bounds
    across = south + (np.arange(lines) + 0.5) * (north - south) / lines
    half_m = 0.5 * (north - south) / lines
    strips = np.array([shapely.box(west, each - half_m, east, each + half_m) for each in across.tolist()])
    parts, line = shapely.get_parts(shapely.intersection(area, strips), return_index=True)
    bounds = shapely.bounds(parts)
    whole = shapely.linestrings(
        np.stack([np.column_stack([bounds[:, k], across[line]]) for k in (0, 2)], axis=1)[bounds[:, 2] > bounds[:, 0]]
    )
    kept = shapely.get_parts(shapely.line_merge(shapely.intersection(shapely.union_all(whole), open_to)))
    found = [shapely.get_coordinates(piece)[[0, -1]] for piece in kept if piece.length > _POINT_M]
    for _ in range(_ROUNDS):
        strips_observed = shapely.buffer(shapely.linestrings(np.array(found)), reach_m) if found else np.empty(0)
        missed = shapely.get_parts(shapely.difference(area, shapely.union_all(strips_observed)))
        missed = missed[np.argsort(-shapely.area(missed), kind="stable")]
        left_m2 = float(shapely.area(missed).sum()) - np.cumsum(shapely.area(missed))
        # Of what is missed the largest parts, until the rest does not matter.
        missed = missed[: 1 + int(np.searchsorted(-left_m2, -max((1.0 - goal) * area.area, 1e-6 * area.area)))]
        if float(shapely.area(missed).sum()) + 0.0 <= 1e-6 * area.area:
            break
        found += [_through(part, open_to, reach_m) for part in missed]
    return Pieces(np.array(found) @ turn, height_agl_m)


def _through(part: shapely.Geometry, open_to: shapely.Geometry, reach_m: float) -> FloatArray:
    """(2, 2) ends of a piece along the middle of missed ground; twice the same position if one position observes all of it."""
    circle = shapely.minimum_bounding_circle(part)
    ring = shapely.get_coordinates(shapely.minimum_rotated_rectangle(part))
    if shapely.minimum_bounding_radius(part) > reach_m and len(ring) == 5:
        k = int(np.argmin(np.hypot(*np.diff(ring[:3], axis=0).T)))
        axis = shapely.LineString([0.5 * (ring[k] + ring[k + 1]), 0.5 * (ring[k + 2] + ring[(k + 3) % 4])])
        pieces = shapely.get_parts(shapely.intersection(axis, open_to))
        if len(pieces) > 0 and (longest := max(pieces, key=lambda each: float(each.length))).length > _POINT_M:
            return np.asarray(shapely.get_coordinates(longest)[[0, -1]])
    position = shapely.get_coordinates(shapely.shortest_line(open_to, shapely.centroid(circle)))[0]
    return np.array([position, position + np.array([_POINT_M, 0.0])])


def ordered_route(site: Site, pieces: Pieces, is_over: Callable[[], bool] = lambda: False) -> Route:
    """The route along pieces in a short order, around zones and bays between them, laid over the terrain."""
    positions = pieces.ends_m.reshape(-1, 2)
    if site.home_m is not None and path_cost_of(site).mission == 1:
        positions = np.vstack([positions, site.home_m[:2]])
    # Where there is no home, the last end of the table is near to all others.
    number = len(pieces.ends_m) * 2
    paths = _Paths(site, positions)
    cost = np.zeros((number + 1, number + 1))
    cost[: len(positions), : len(positions)] = paths.cost
    each = np.arange(0, number, 2)
    cost[each, each + 1] = cost[each + 1, each] = _STAYS
    near, rng = nearest(cost, min(_NEAR, number)), np.random.default_rng(0)
    best, least = np.arange(number + 1), math.inf
    for trial in range(_TRIALS):
        if trial > 0 and is_over():
            break
        pieces_order = rng.permutation(number // 2)
        begin = np.append(2 * np.repeat(pieces_order, 2) + np.tile([0, 1], number // 2), number)
        tour = shorten(cost, near, begin, _KICKS_PER_END * number, rng)
        if (length := float(cost[tour, np.roll(tour, -1)].sum())) < least:
            best, least = tour, length
    order = np.roll(best, -int(np.flatnonzero(best == number)[0]))[1:].tolist()
    line = [positions[order[:1]]]
    line += [positions[[b]] if a // 2 == b // 2 else paths.between(a, b)[1:] for a, b in itertools.pairwise(order)]
    points = np.vstack(line)
    points = points[np.append(True, np.hypot(*np.diff(points, axis=0).T) > 2.0 * _POINT_M)]
    heights = np.full(len(points), pieces.height_agl_m)
    return Route(lay_over_terrain(site, points, heights, tolerance_m=PLAIN_TOLERANCE_M))


class _Paths:
    """Cheapest paths between positions, around zones and bays.

    Attributes:
        cost: (n, n) cost of the path from one position to another.
    """

    def __init__(self, site: Site, positions_m: FloatArray) -> None:
        self._round = paths = flyable_paths(site)
        count = len(positions_m)
        self._straight_only = len(paths.corners_m) > _MOST_CORNERS
        self._nodes = positions_m if self._straight_only else np.vstack([positions_m, paths.corners_m])
        first, second = np.triu_indices(len(self._nodes), 1)
        ends = np.stack([self._nodes[first], self._nodes[second]], axis=1)
        straight = np.zeros((len(self._nodes), len(self._nodes)))
        straight[first, second] = straight[second, first] = np.maximum(_leg_costs(site, ends), 1e-9)
        if self._straight_only:
            self.cost = straight
            return
        direct = np.zeros_like(straight, dtype=bool)
        direct[first, second] = direct[second, first] = paths.are_straight(ends)
        from scipy.sparse.csgraph import dijkstra  # a tenth of a second to load

        found, self._before = dijkstra(
            np.where(direct, straight, 0.0), indices=np.arange(count), return_predecessors=True
        )
        # A place that cannot be reached is left to the terrain's own ways.
        self.cost = np.where(np.isfinite(found[:, :count]), found[:, :count], 10.0 * straight[:count, :count])

    def between(self, a: int, b: int) -> FloatArray:
        """(k, 2) corners of the way from one place to another, both included."""
        if self._straight_only:
            path_m = self._round.between(self._nodes[a], self._nodes[b])
            return self._nodes[[a, b]] if path_m is None else path_m
        path = [b]
        while path[-1] != a:
            before = int(self._before[a, path[-1]])
            path.append(before if before >= 0 else a)
        return self._nodes[path[::-1]]


def _leg_costs(site: Site, ends_m: FloatArray) -> FloatArray:
    """(n,) metres, or seconds from rest to rest, of (n, 2, 2) level legs."""
    path_cost = path_cost_of(site)
    if path_cost.unit == LENGTH:
        return np.asarray(np.hypot(*(ends_m[:, 1] - ends_m[:, 0]).T))
    level = np.zeros((2 * len(ends_m), 3))
    level[:, :2] = ends_m.reshape(-1, 2)
    return np.asarray(leg_times(path_cost.pace, level)[::2])

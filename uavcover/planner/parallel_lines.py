"""Routes of lines only: the best of a scan, without a free search.

Parallel lines in one direction, for crosshatch and oblique surveys; or lines along the contours of the terrain.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np

from uavcover.kernels.dominance import least_crowded, non_dominated_mask
from uavcover.kernels.path_cost import LENGTH, route_cost
from uavcover.missions.path_cost import path_cost_of
from uavcover.model.route import Plan, Route, RouteMember
from uavcover.model.scenario import PlannerSettings
from uavcover.model.sensor import Sensor
from uavcover.planner.baselines.adaptive_swaths import adaptive_swaths, ample_lines, can_be_adapted, simple_lines
from uavcover.planner.baselines.boustrophedon import (
    SwathLayout,
    angle_of_heading_rad,
    best_height_agl_m,
    fly_layout,
    long_side_angle_rad,
    regular_layout,
    strip_half_width_m,
    width_across_m,
)
from uavcover.planner.baselines.contour_lines import NAME as CONTOUR_NAME
from uavcover.planner.baselines.contour_lines import ContourLayout, fly_contours, layouts_to_try
from uavcover.planner.final_choice import choose
from uavcover.planner.front import NamedRoute, judge_members
from uavcover.planner.search.optimizer_search import Effort
from uavcover.planner.selection_rule import parse_rule
from uavcover.planner.terrain_following import PLAIN_TOLERANCE_M
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.site_maps import judging_map

NAME = "parallel-lines"
_CLOSEST, _FARTHEST = 0.7, 2.5
"""Number of lines that are tried, as multiples of what flat ground needs."""
_MOST_COUNTS = 16
_HEIGHTS = 2
_INSETS = (0.0, 0.5)
_TOLERANCES = (0.5, 1.0)
_MOST_TURNED = 20
"""This number of the best is also begun at their other three corners."""


@dataclass(frozen=True, slots=True, eq=False)
class _Lines:
    layout: SwathLayout | ContourLayout
    member: RouteMember


def plan_lines(
    site: Site,  # the scenario on its ground
    *,
    settings: PlannerSettings,  # the direction and largest number of waypoints
    select_rule: str,  # see :mod:`uavcover.planner.selection_rule`
    effort: Effort,  # when to stop
    executor: Executor | None,  # judges routes in parallel; the result does not depend on it
    should_stop: Callable[[], bool],  # called between batches; the first is always judged
) -> Plan:
    """Plan lines along ``planner.line_heading_deg``, along the longer side of the area, or along contours.

    Scan the number, height, length and start of the lines (for contour lines, how closely they follow the contours), and evaluate
    them on the finer cells of the area.

    Raises:
        InfeasibleError: no lines keep the hard limits; names the limit, the position and the excess.
        InputError: the rule is invalid.
    """
    started, rule = effort.now(), parse_rule(select_rule)
    fine = judging_map(site)
    found: list[_Lines] = []
    interrupted = False
    for batch in _batches(site, settings):
        if found and (should_stop() or effort.is_over(started)):
            interrupted = should_stop()
            break
        found += _judged(site, fine, batch, executor)
    begun_elsewhere = [replace(layout, start=start) for layout in _best(found) for start in range(1, 4)]
    judged = [lines.member for lines in (*found, *_judged(site, fine, begun_elsewhere, executor))]
    # Keep all waypoints: without one between the ends of two lines, a line would turn.
    chosen = choose(fine, settings, rule, judged, executor=executor, interrupted=interrupted, is_over=None)
    return Plan(
        chosen=chosen.route,
        members=chosen.pareto,
        baselines=(),
        rule=rule.text,
        rule_met=chosen.rule_met,
        algorithm=settings.algorithm,
        evaluations=len(judged),
        wall_s=effort.now() - started,
        interrupted=interrupted,
    )


def _batches(site: Site, settings: PlannerSettings) -> Iterable[Sequence[SwathLayout | ContourLayout]]:
    if settings.algorithm == "contour-lines":
        return layouts_to_try(site)
    heading_deg = settings.line_heading_deg
    return _parallel(site, long_side_angle_rad(site.area) if heading_deg is None else angle_of_heading_rad(heading_deg))


def _parallel(site: Site, angle_rad: float) -> list[list[SwathLayout]]:
    """Layouts to try, grouped by the number of lines; the number for flat ground comes first."""
    limits = site.scenario.limits
    low, high = limits.min_height_agl_m + limits.height_margin_m, limits.max_height_agl_m - limits.height_margin_m
    best = best_height_agl_m(site)
    wanted = width_across_m(site, angle_rad) / (2.0 * strip_half_width_m(site, angle_rad, best))
    counts = np.unique(np.ceil(np.linspace(_CLOSEST, _FARTHEST, _MOST_COUNTS) * wanted - 1e-9).clip(1.0)).astype(int)
    heights = sorted({best, *np.linspace(low, high, _HEIGHTS + 2)[1:-1].tolist()}, reverse=True)
    tolerances = sorted({min(fraction * 0.5 * (high - low), PLAIN_TOLERANCE_M) for fraction in _TOLERANCES})
    return [
        [
            replace(
                regular_layout(
                    angle_rad=angle_rad, lines=count, height_agl_m=height, inset=inset, tolerance_m=tolerance
                ),
                shift_m=shift_m,
            )
            for height in heights
            for shift_m in _shifts_m(site.scenario.sensor, height)
            for inset in _INSETS
            for tolerance in tolerances
        ]
        for count in sorted(counts.tolist(), key=lambda count: abs(count - wanted))
    ]


def _shifts_m(sensor: Sensor, height_agl_m: float) -> list[tuple[float, float]]:
    """No shift, and the look-ahead of a tilted camera with a fixed heading: the edge behind is observed from outside."""
    photo = sensor.flat_photo(height_agl_m)
    if sensor.heading_deg is None or photo is None or abs(photo.near_m + photo.far_m) < 1.0:
        return [(0.0, 0.0)]
    ahead_m, heading = 0.5 * (photo.near_m + photo.far_m), math.radians(sensor.heading_deg)
    return [(0.0, 0.0), (-ahead_m * math.sin(heading), -ahead_m * math.cos(heading))]


def _judged(
    site: Site, fine: CoverageMap, layouts: Sequence[SwathLayout | ContourLayout], executor: Executor | None
) -> list[_Lines]:
    drawn = [
        (fly_layout(site, layout), NAME)
        if isinstance(layout, SwathLayout)
        else (fly_contours(site, layout), CONTOUR_NAME)
        for layout in layouts
    ]
    members = judge_members(fine, drawn, executor)
    return [_Lines(layout, member) for layout, member in zip(layouts, members, strict=True)]


def _best(found: list[_Lines]) -> list[SwathLayout]:
    """Layouts of parallel lines that no others dominate, thinned."""
    parallel = [(lines.layout, lines.member) for lines in found if isinstance(lines.layout, SwathLayout)]
    feasible = [(layout, member) for layout, member in parallel if member.violation <= 0.0]
    if not feasible:
        return []
    figures = [member.metrics for _, member in feasible]
    values = np.array([(-m.coverage_fraction, m.waypoint_count, m.cost) for m in figures])
    best = np.flatnonzero(non_dominated_mask(values, np.zeros(len(values))))
    if len(best) > _MOST_TURNED:
        best = best[least_crowded(values[best], _MOST_TURNED)]
    return [feasible[k][0] for k in best]


def first_lines(
    site: Site, angle_rad: float, executor: Executor | None, should_stop: Callable[[], bool]
) -> list[NamedRoute]:
    """Balanced and simple lines, the best initial solutions first, until the time is over."""

    def balanced() -> list[Route]:
        if not can_be_adapted(site):
            return []
        return adaptive_swaths(site, angle_rad, executor=executor, should_stop=should_stop)

    def simple() -> list[Route]:
        return simple_lines(site, angle_rad, executor=executor, should_stop=should_stop)

    makers = [("simple-lines", simple), ("balanced-lines", balanced)]
    kinds: list[tuple[str, list[Route]]] = []
    for kind, make in reversed(makers) if _by_length(site) else makers:
        if not any(routes for _, routes in kinds) or not should_stop():
            kinds.append((kind, make()))
    return [(_cheaper_direction(site, route), kind) for kind, routes in kinds for route in routes]


def _by_length(site: Site) -> bool:
    """Whether balanced lines are better than simple ones.

    Balanced lines are the shortest, but they have more waypoints, and each waypoint takes time. On 25 km², simple lines have a
    third fewer.
    """
    return path_cost_of(site).unit == LENGTH


def any_reaches(coarse: CoverageMap, lines: Sequence[NamedRoute], required: float | None) -> bool:
    """Whether one of the lines has the required coverage; True without a requirement or without lines."""
    if required is None or not lines:
        return True
    return any(coarse.fraction_of_coverable(coarse.observed(route.waypoints_m)) >= required for route, _ in lines)


def one_line_more(site: Site, angle_rad: float) -> list[NamedRoute]:
    """Lines for a short time budget with few numbers of lines: these reach nearly every coverage."""
    if not can_be_adapted(site):
        return []
    shortest = _by_length(site)
    kind = "balanced-lines" if shortest else "simple-lines"
    return [(_cheaper_direction(site, route), kind) for route in ample_lines(site, angle_rad, shortest=shortest)]


def _cheaper_direction(site: Site, route: Route) -> Route:
    """The cheaper of the route and its reverse. They differ in wind, and no single move reverses a whole route."""
    path_cost, surface = path_cost_of(site), site.ground.surface
    back = Route(np.ascontiguousarray(route.waypoints_m[::-1]))
    there_cost, back_cost = (float(route_cost(surface, path_cost, each.waypoints_m)) for each in (route, back))
    # If both directions are equally good, rounding must not decide.
    return back if back_cost < there_cost * (1.0 - 1e-9) else route

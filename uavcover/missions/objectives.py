"""Objectives of a route (Eq. 8) and its violations of hard limits."""

from collections.abc import Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from uavcover.kernels import route as kernels
from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.flight_time import flight_time
from uavcover.kernels.way_cost import ENERGY, route_cost
from uavcover.missions.flight_costs import MissionCost, mission_cost
from uavcover.missions.leg_checks import corner_excess_m, measure_violations, route_height_range_m
from uavcover.missions.way_cost import way_cost_of
from uavcover.model.route import Route, RouteMember, RouteMetrics
from uavcover.scenario.site import Site
from uavcover.scenario.vehicles import groups_of, pace_of, vehicle_sites
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.site_maps import fleet_map, map_for

OBJECTIVES = ("minus_coverage", "waypoint_count", "cost")
"""Names of the objectives, all minimised: -f1, f2, f3 of Eq. 8; the cost is what ``planner.objective`` says."""


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Objectives and violations of many routes."""

    objectives: FloatArray  # (n, 3) in the order of OBJECTIVES
    violations: FloatArray  # (n, 1) total violation, 0 when the hard limits hold


def evaluate_routes(coverage: CoverageMap, routes: Sequence[Route], executor: Executor | None = None) -> Evaluation:
    """Evaluate routes independently of each other, so the number of threads does not change the result."""
    way = way_cost_of(coverage.site)

    def one(route: Route) -> tuple[float, float, float, float]:
        points = route.waypoints_m
        share = coverage.share(coverage.seen(points))
        violation = measure_violations(
            coverage.site, points, margin_m=coverage.site.scenario.limits.height_margin_m
        ).total
        return -share, float(len(route)), float(route_cost(coverage.site.ground.surface, way, points)), violation

    rows = np.array(list(executor.map(one, routes) if executor is not None else map(one, routes))).reshape(-1, 4)
    return Evaluation(objectives=rows[:, :3], violations=rows[:, 3:])


def judge_member(coverage: CoverageMap, route: Route, origin: str, *, margin_m: float) -> RouteMember:
    """Rate a route: its figures and its violation of the hard limits, in legs and corners.

    No other function does.

    Args:
        coverage: the cells it is judged on.
        route: the waypoints.
        origin: what made it.
        margin_m: how far inside both ends of the height band it must stay. What is planned keeps ``limits.height_margin_m``;
            a route that is read back, or a stretch of one, was held to it when it was planned, and is judged with 0.
    """
    site, points = coverage.site, route.waypoints_m
    violation = measure_violations(site, points, margin_m=margin_m).total + float(corner_excess_m(site, points).sum())
    return RouteMember(route, judge(coverage, route), violation, origin)


def judge(coverage: CoverageMap, route: Route) -> RouteMetrics:
    """The reported metrics of a route, on the cells of ``coverage``."""
    site: Site = coverage.site
    points = route.waypoints_m
    seen = coverage.seen(points)
    lowest, highest = route_height_range_m(site, points)
    mission = None if site.home_m is None else mission_cost(site, route)
    return RouteMetrics(
        coverage_fraction=coverage.share(seen),
        coverage_of_coverable=coverage.share_of_coverable(seen),
        waypoint_count=len(route),
        path_length_m=float(kernels.path_length(points)),
        flight_time_s=float(flight_time(pace_of(site), points)),
        min_height_agl_m=lowest,
        max_height_agl_m=highest,
        cost=_cost(site, route, mission),
        mission_time_s=None if mission is None else mission.time_s,
        mission_energy_hover_s=None if mission is None else mission.energy_hover_s,
    )


def _cost(site: Site, route: Route, mission: MissionCost | None) -> float:
    """The planner's cost of a route; of its mission along the transits that would be flown."""
    way, surface, points = way_cost_of(site), site.ground.surface, route.waypoints_m
    cost = float(route_cost(surface, way, points))
    if way.mission == 0 or mission is None:
        return cost
    flown = mission.energy_hover_s if way.unit == ENERGY else mission.time_s
    return flown + cost - float(route_cost(surface, way._replace(deviation_price=0.0, waypoint_price=0.0), points))


# Figures of a route whose parts of the area are flown by different vehicles: they count together.


def judge_route(site: Site, route: Route, origin: str, *, margin_m: float) -> RouteMember:
    """A route on the cells of the whole area, as :func:`uavcover.missions.objectives.judge_member`.

    Where vehicles have parts of the area, each part of the route has the figures of the first vehicle that sees that part. What
    any of them sees is seen; counts, lengths, times and costs are those of all together.
    """
    whole = fleet_map(site)
    groups = groups_of(site.scenario)
    if not groups:
        return judge_member(whole, route, origin, margin_m=margin_m)
    sites = vehicle_sites(site)
    maps = [map_for(site, sites[group[0] - 1]) for group in groups]
    members = [judge_member(own, part, origin, margin_m=margin_m) for own, part in zip(maps, route.parts, strict=True)]
    seen = np.logical_or.reduce(
        [own.seen(part.waypoints_m) for own, part in zip(maps, route.parts, strict=True)], axis=0
    )
    metrics = _together(
        [member.metrics for member in members], share=whole.share(seen), of_coverable=whole.share_of_coverable(seen)
    )
    return RouteMember(route, metrics, sum(member.violation for member in members), origin)


def _together(parts: Sequence[RouteMetrics], *, share: float, of_coverable: float) -> RouteMetrics:
    return RouteMetrics(
        coverage_fraction=share,
        coverage_of_coverable=of_coverable,
        waypoint_count=sum(part.waypoint_count for part in parts),
        path_length_m=sum(part.path_length_m for part in parts),
        flight_time_s=sum(part.flight_time_s for part in parts),
        min_height_agl_m=min(part.min_height_agl_m for part in parts),
        max_height_agl_m=max(part.max_height_agl_m for part in parts),
        cost=sum(part.cost for part in parts),
        mission_time_s=_sum(part.mission_time_s for part in parts),
        mission_energy_hover_s=_sum(part.mission_energy_hover_s for part in parts),
    )


def _sum(values: Iterable[float | None]) -> float | None:
    """The sum; none where one is not known."""
    known = list(values)
    return None if None in known else sum(value for value in known if value is not None)

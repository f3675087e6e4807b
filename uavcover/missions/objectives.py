"""Cost of a route's flights and of its whole mission, and its objectives (Eq. 8) and violations in the search."""

import math
from collections.abc import Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from uavcover.errors import InfeasibleError
from uavcover.kernels import route as kernels
from uavcover.kernels.arrays import FloatArray, IntArray, read_only
from uavcover.kernels.flight_time import Pace, flight_time, landing_time, leg_times, takeoff_time, turn_times
from uavcover.kernels.path_cost import ENERGY, FlightCosts, FlightEnergies, PathCost, route_cost, split, straight_ends
from uavcover.missions.leg_checks import corner_excess_m, measure_violations, route_height_range_m
from uavcover.missions.mission_compiler import AUTOPILOTS, items_per_waypoint
from uavcover.missions.path_cost import FlightEnergy, mission_cost_of, path_cost_of, usable_s
from uavcover.missions.transit import check_outbound, check_return, home_of, transit
from uavcover.model.route import Route, RouteMember, RouteMetrics
from uavcover.model.vehicle import AutopilotName
from uavcover.scenario.site import Site, once
from uavcover.scenario.vehicles import groups_of, pace_of, vehicle_sites
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.sensors import trigger_distance_m
from uavcover.sensing.site_maps import fleet_map, map_for


def flight_costs_along_transits(
    site: Site, route: Route, autopilot: AutopilotName, most_points: int | None
) -> FlightCosts:
    """Costs of flights whose transits follow the terrain exactly as the compiler makes them."""
    home, vehicle = home_of(site), site.scenario.vehicle
    points, n, pace = route.waypoints_m, len(route), pace_of(site, autopilot)
    # The waypoint at which photos begin stands twice in the mission and is a stop.
    stops = trigger_distance_m(site.scenario) is not None
    there, back, alone, items = np.empty(n), np.empty(n), np.empty(n), np.empty(n, dtype=np.int64)
    energy = FlightEnergy(site, autopilot)
    # Routes of one Pareto set share many waypoints.
    paths = _transits(site)
    used_there, used_back, used_alone = np.empty((3, len(energy.winds_m_s), n))
    for k, point in enumerate(points):
        end = point.tobytes()
        if end not in paths:
            paths[end] = transit(site, home[:2], point, ground_end_height_m=vehicle.takeoff_height_m)
        path = paths[end]
        # With the turn onto the leg behind it, and off the leg before it.
        onto, off = points[k + 1 : k + 1] if stops else points[k + 1 : k + 2], points[max(k - 1, 0) : k]
        there[k] = _there_s(pace, home, path, onto)
        back[k] = _back_s(pace, home, path, off)
        # a flight to this waypoint alone turns from the outbound to the return transit.
        round_m = np.vstack([path, path[-1:] if stops else path[:0], path[-2::-1]])
        climb_out_m = path[0, 2] - home[2]
        vertical_s = takeoff_time(pace, climb_out_m), landing_time(pace, climb_out_m)
        alone[k] = vertical_s[0] + flight_time(pace, read_only(round_m)) + vertical_s[1]
        items[k] = len(path) - 1
        up, down, legs = energy.takeoff_s(climb_out_m), energy.landing_s(climb_out_m), len(path) - 1
        used_there[:, k] = up + energy.first_legs_s(np.vstack([path, onto]), legs)
        used_back[:, k] = energy.first_legs_s(np.vstack([off, path[::-1]]), -legs) + down
        used_alone[:, k] = up + energy.path_s(round_m) + down
    # Home, take-off, speed and transit before the route; transit and landing after it.
    costs = _flight_costs(
        site, points, pace, ends=(there, back, alone), items=(items + 2, items + 1), limits=_limits(site, autopilot),
        energies=energy.flights(points, used_there, used_back, used_alone),
    )  # fmt: skip
    if most_points is None:
        return costs
    # Points are fewer than items: where items are the tighter limit, the compiler says so, and another split is tried.
    return costs._replace(there_items=items, back_items=items, each_items=1, item_limit=float(most_points))


@once
def _transits(_site: Site) -> dict[bytes, FloatArray]:
    """Transits to waypoints that were computed before, by the waypoint."""
    return {}


def _flight_costs(
    site: Site, points_m: FloatArray, pace: Pace, *, ends: tuple[FloatArray, ...], items: tuple[IntArray, IntArray],
    limits: tuple[float, float], energies: FlightEnergies,
) -> FlightCosts:  # fmt: skip
    """Costs of the flights of an (n, 3) route.

    Args:
        site: the scenario on its ground.
        points_m: the route.
        pace: of the vehicle.
        ends: (n,) seconds there, back, and of a flight to the waypoint alone.
        items: (n,) mission items before the waypoint, and behind it.
        limits: seconds and items of one flight.
        energies: of the flights.
    """
    there, back, alone = ends
    return FlightCosts(
        so_far_s=np.concatenate([[0.0], np.cumsum(leg_times(pace, points_m))]),
        turns_s=np.cumsum(turn_times(pace, points_m)),
        there_s=there,
        back_s=back,
        alone_s=alone,
        there_items=items[0],
        back_items=items[1],
        each_items=items_per_waypoint(site.scenario.sensor),
        shared=1 if site.scenario.sensor.looks_along_path else 0,
        endurance_s=limits[0],
        item_limit=limits[1],
        barred=np.empty((0, 2), dtype=np.int64),
        energies=energies,
    )


def _limits(site: Site, autopilot: AutopilotName) -> tuple[float, float]:
    """Seconds and mission items of one flight."""
    vehicle = site.scenario.vehicle
    limits = (AUTOPILOTS[autopilot].item_limit, vehicle.max_mission_items)
    items = min((float(limit) for limit in limits if limit is not None), default=math.inf)
    return vehicle.longest_flight_s or math.inf, items


def tighter(costs: FlightCosts) -> FlightCosts:
    """The same costs with slightly lower limits."""
    return costs._replace(
        endurance_s=0.998 * costs.endurance_s, item_limit=costs.item_limit - 2,
        energies=costs.energies._replace(usable_s=0.998 * costs.energies.usable_s),
    )  # fmt: skip


def without(costs: FlightCosts, first: int, last: int) -> FlightCosts:
    """The same costs with one flight excluded."""
    return costs._replace(barred=np.vstack([costs.barred, [[first, last]]]))


def checked(costs: FlightCosts, site: Site, route: Route) -> FlightCosts:
    """The same costs, excluding flights whose transit the compiler refuses."""
    home, height_m = home_of(site), site.scenario.vehicle.takeoff_height_m
    there, back = costs.there_s.copy(), costs.back_s.copy()
    for k, point in enumerate(route.waypoints_m):
        path = transit(site, home[:2], point, ground_end_height_m=height_m)
        try:
            check_outbound(site, path)
        except InfeasibleError:
            there[k] = math.inf
        try:
            check_return(site, path[::-1])
        except InfeasibleError:
            back[k] = math.inf
    return costs._replace(there_s=there, back_s=back)


@dataclass(frozen=True, slots=True)
class MissionCost:
    """Cost of the whole mission of a route, from take-off to landing, of all its flights."""

    time_s: float  # in the air
    energy_hover_s: float  # seconds of hovering that take as much of the batteries, in the stated wind


def mission_cost(site: Site, route: Route) -> MissionCost:
    """Time and energy of the whole mission of a route.

    One flight is counted along its transits, as the compiler does. Several are split as :func:`compile_sorties` splits them, but
    with straight transits. Nothing is checked: a route that cannot be split or flown costs what one flight does.
    """
    home, vehicle = site.home_m, site.scenario.vehicle
    if home is None or len(route) == 0:
        raise InfeasibleError(f"scenario {site.scenario.name} has no [home], or the route has no waypoints")
    points, pace = route.waypoints_m, pace_of(site)
    stops = trigger_distance_m(site.scenario) is not None
    path, path_back = (
        transit(site, home[:2], point, ground_end_height_m=vehicle.takeoff_height_m) for point in points[[0, -1]]
    )
    whole_m = np.vstack([path, points[:1] if stops else points[:0], points[1:], path_back[-2::-1]])
    time_s = float(
        takeoff_time(pace, path[0, 2] - home[2])
        + flight_time(pace, read_only(whole_m))
        + landing_time(pace, path_back[0, 2] - home[2])
    )
    straight = mission_cost_of(site)
    if not math.isfinite(time_s):
        # Part of the ground between home and the route is unknown; the compiler will refuse the mission.
        surface, of_energy = site.ground.surface, straight._replace(unit=ENERGY)
        return MissionCost(float(route_cost(surface, straight, points)), float(route_cost(surface, of_energy, points)))
    longest_s, most_items = _limits(site, vehicle.autopilot)
    each = items_per_waypoint(site.scenario.sensor)
    one = len(path) + len(path_back) + each * len(route) + 1 <= most_items and time_s <= longest_s
    energy = FlightEnergy(site)
    used_s = (
        energy.takeoff_s(path[0, 2] - home[2]) + energy.path_s(whole_m) + energy.landing_s(path_back[0, 2] - home[2])
    )
    in_one = MissionCost(time_s, float(used_s[0]))
    if one and float(used_s.max()) <= usable_s(vehicle):
        return in_one
    costs = straight_flight_costs(site, points, transit_items=round(0.5 * (len(path) + len(path_back))) - 1)
    split_s, begun = split(costs)
    if not math.isfinite(split_s):
        return in_one
    flights = flights_of_split(begun, costs.shared)
    used = [_straight_flight_s(energy, straight, points[first : last + 1]) for first, last in flights]
    return MissionCost(float(split_s), math.fsum(used))


def straight_flight_costs(site: Site, route_m: FloatArray, *, transit_items: int) -> FlightCosts:
    """Costs of the flights of an (n, 3) route with straight transits from and to above home.

    Args:
        site: the scenario on its ground, with a home.
        route_m: two waypoints at least.
        transit_items: mission items of a way between home and the route, without home and take-off, or landing.
    """
    straight, items = mission_cost_of(site), np.full(len(route_m), transit_items, dtype=np.int64)
    return _flight_costs(
        site,
        route_m,
        pace_of(site),
        ends=straight_ends(straight, route_m),
        items=(items + 2, items + 1),
        limits=_limits(site, site.scenario.vehicle.autopilot),
        energies=FlightEnergy(site).straight_flights(straight, route_m),
    )


def _straight_flight_s(energy: FlightEnergy, cost: PathCost, points_m: FloatArray) -> float:
    """Hovering seconds of a flight along (k, 3) waypoints in the stated wind, with straight transits."""
    stop, top = points_m[: cost.stop_at_first], np.array([cost.climb_out_top])
    path = np.vstack([top, points_m[:1], stop, points_m[1:], top])
    return float((energy.takeoff_s(cost.climb_out_m) + energy.path_s(path) + energy.landing_s(cost.climb_out_m))[0])


def flights_of_split(begun: IntArray, shared: int) -> list[tuple[int, int]]:
    """First and last waypoint of each flight, in their order.

    Args:
        begun: (n,) where the flight that ends at each waypoint begins, by :func:`uavcover.kernels.path_cost.split`.
        shared: 1 when a flight begins at the last waypoint of the previous one.
    """
    end = len(begun) - shared
    flights: list[tuple[int, int]] = []
    while end > 0:
        last = end - 1 + shared
        flights.append((int(begun[last]), last))
        end = int(begun[last])
    return flights[::-1]


def return_path(site: Site, position_m: FloatArray) -> tuple[FloatArray, float]:
    """The transit home from rest at a (3,) ENU place in flight.

    Returns:
        (k, 3) ENU from the place to the ground at home, and the seconds that it takes.

    Raises:
        InfeasibleError: the site has no home.
    """
    home = home_of(site)
    path = transit(site, home[:2], position_m, ground_end_height_m=site.scenario.vehicle.takeoff_height_m)
    return np.vstack([path[::-1], home]), _back_s(pace_of(site), home, path, np.empty((0, 3)))


def _there_s(pace: Pace, home_m: FloatArray, path_m: FloatArray, onto_m: FloatArray) -> float:
    """Time from home on the ground along a (k, 3) transit, with the turn onto the next leg."""
    return float(takeoff_time(pace, path_m[0, 2] - home_m[2])) + _time_s(
        pace, np.vstack([path_m, onto_m]), legs=len(path_m) - 1
    )


def _back_s(pace: Pace, home_m: FloatArray, path_m: FloatArray, off_m: FloatArray) -> float:
    """Time along a (k, 3) transit to home on the ground, with the turn off the previous leg."""
    return float(landing_time(pace, path_m[0, 2] - home_m[2])) + _time_s(
        pace, np.vstack([off_m, path_m[::-1]]), legs=1 - len(path_m)
    )


def _time_s(pace: Pace, points_m: FloatArray, *, legs: int) -> float:
    """Flight time of the first ``legs`` legs of a line, or of the last ones when negative, including turns."""
    line_m = read_only(points_m)
    times = leg_times(pace, line_m)
    return float((times[:legs] if legs > 0 else times[legs:]).sum() + turn_times(pace, line_m).sum())


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Objectives and violations of many routes."""

    # (n, 3), all minimised: -f1 (coverage), f2 (waypoints), f3 of Eq. 8; the cost is what ``planner.objective`` says
    objectives: FloatArray
    violations: FloatArray  # (n, 1) total violation, 0 when the hard limits hold


def evaluate_routes(coverage: CoverageMap, routes: Sequence[Route], executor: Executor | None = None) -> Evaluation:
    """Evaluate routes independently of each other, so the number of threads does not change the result."""
    path_cost = path_cost_of(coverage.site)

    def one(route: Route) -> tuple[float, float, float, float]:
        points = route.waypoints_m
        fraction = coverage.fraction(coverage.observed(points))
        violation = measure_violations(
            coverage.site, points, margin_m=coverage.site.scenario.limits.height_margin_m
        ).total
        cost = float(route_cost(coverage.site.ground.surface, path_cost, points))
        return -fraction, float(len(route)), cost, violation

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
    observed = coverage.observed(points)
    lowest, highest = route_height_range_m(site, points)
    mission = None if site.home_m is None else mission_cost(site, route)
    return RouteMetrics(
        coverage_fraction=coverage.fraction(observed),
        coverage_of_coverable=coverage.fraction_of_coverable(observed),
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
    by_mission = mission is not None and site.scenario.objective in {"mission-time", "energy"}
    path_cost, surface, points = path_cost_of(site, straight=by_mission), site.ground.surface, route.waypoints_m
    cost = float(route_cost(surface, path_cost, points))
    if mission is None or not by_mission:
        return cost
    flown = mission.energy_hover_s if path_cost.unit == ENERGY else mission.time_s
    path_cost = path_cost._replace(deviation_price=0.0, waypoint_price=0.0)
    return flown + cost - float(route_cost(surface, path_cost, points))


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
    observed = np.logical_or.reduce(
        [own.observed(part.waypoints_m) for own, part in zip(maps, route.parts, strict=True)], axis=0
    )
    metrics = _together(
        [member.metrics for member in members], fraction=whole.fraction(observed),
        of_coverable=whole.fraction_of_coverable(observed),
    )  # fmt: skip
    return RouteMember(route, metrics, sum(member.violation for member in members), origin)


def _together(parts: Sequence[RouteMetrics], *, fraction: float, of_coverable: float) -> RouteMetrics:
    return RouteMetrics(
        coverage_fraction=fraction,
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
    """The sum; None where one is not known."""
    known = list(values)
    return None if None in known else sum(value for value in known if value is not None)

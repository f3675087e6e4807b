"""Choice among the evaluated routes, without overfitting, infeasible numbers of waypoints or unneeded waypoints."""

import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from uavcover.errors import InfeasibleError
from uavcover.kernels.arrays import IntArray
from uavcover.kernels.path_cost import FlightCosts, battery_s
from uavcover.missions.leg_checks import measure_violations
from uavcover.missions.objectives import flight_costs_along_transits
from uavcover.model.route import Route, RouteMember
from uavcover.model.scenario import PlannerSettings
from uavcover.planner.final_changes import certainly, simplified, with_sound_corners
from uavcover.planner.front import NamedRoute, judge_members, pareto_members, thinned, why_infeasible
from uavcover.planner.search.repair import with_gaps_closed
from uavcover.planner.search.route_problem import with_safety
from uavcover.planner.search.tuning import TUNED
from uavcover.planner.selection_rule import Rule, select, without_overfitted
from uavcover.planner.sortie_order.reorder import OrderEffort, has_several_sorties, reordered
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.site_maps import finer_map, judging_maps

_MOST_LONG = 10
"""This number of choices with legs that are too long for a battery get waypoints on them."""

_MOST_UNSURE = 5
"""This number of choices with unsure photos are given up for the next one before the first of them is taken after all."""

_MOST_UNSOUND = 20
"""This number of choices with feasible legs and infeasible corners are tried. Where all can be repaired, it is one."""

_MOST_NEAR, _MOST_CLOSED, _CHEAPER = 8, 2, 0.97
"""Gaps of this number of routes are repaired at the end, until this number succeed, at this fraction of the goal's cost."""

_COSTLY = 20.0
"""Of these, the cheapest after repair come first: full coverage would cost this multiple of the route at its last rate.

The factor was 17 to 80 in four cases of scripts/bench/kinds.py.
"""


@dataclass(frozen=True, slots=True, eq=False)
class ChosenRoute:
    """The chosen route and its alternatives."""

    route: RouteMember  # the chosen one
    pareto: tuple[RouteMember, ...]  # the Pareto set that it is in
    rule_met: bool  # whether it meets the rule
    # routes that were made of it with fewer waypoints, or in another order, whether chosen or not
    simpler: tuple[NamedRoute, ...]


def choose(
    fine: CoverageMap,  # the cells on which they were judged
    settings: PlannerSettings,  # how many waypoints a route may have
    rule: Rule,  # the selection rule
    judged: Sequence[RouteMember],  # the routes
    *,
    executor: Executor | None,  # judges routes in parallel
    interrupted: bool,  # whether the search was interrupted, for the error message
    is_over: Callable[[], bool] | None,  # stops the removal of waypoints; None: keep all
    # effort of the search for an order with shorter sorties; None: keep the order
    order: OrderEffort | None = None,
) -> ChosenRoute:
    """Choose a route by the rule.

    Raises:
        InfeasibleError: no route keeps the hard limits; names the limit, the position and the excess.
    """
    site = fine.site
    feasible = _feasible_with_corners_repaired(fine, judged, settings, rule, executor)
    if not feasible:
        early = "interrupted: so far " if interrupted else ""
        raise InfeasibleError(early + why_infeasible(site, judged))
    few = _few_enough(feasible, settings)
    if is_over is not None:
        closed = _feasible(fine, _nearly_with_gaps_closed(fine, few, rule, is_over), executor)
        few = _few_enough([*few, *closed], settings)
    confirmed = _confirmed(fine, few, rule, is_over)
    simpler: list[NamedRoute] = []
    if is_over is not None:
        closed = _feasible(fine, _overfitted_repaired(site, few, confirmed, rule, is_over), executor)
        if closed and _is_few_enough(closed[0], settings):
            confirmed = _confirmed(fine, [*confirmed, *closed], rule, is_over)
        simpler = _simplified(site, confirmed, rule, is_over)
        confirmed += _feasible(fine, simpler, executor)
    if order is not None:
        others = _in_other_order(site, confirmed, rule, order, is_over)
        confirmed += [member for member in _feasible(fine, others, executor) if _is_few_enough(member, settings)]
        simpler += others
    confirmed = _with_legs_that_fit(fine, _with_sure_photos(fine, confirmed, rule, executor, is_over), rule, executor)
    pareto = thinned(pareto_members(confirmed), rule)
    choice = select(pareto, rule)
    route = pareto[choice.index]
    return ChosenRoute(route, tuple(pareto), choice.met and _is_few_enough(route, settings), tuple(simpler))


def choose_at_once(
    fine: CoverageMap, settings: PlannerSettings, rule: Rule, judged: Sequence[RouteMember], *, interrupted: bool
) -> ChosenRoute:
    """:func:`choose` without slow steps: no finer cells, no repair except of corners.

    Raises:
        InfeasibleError: no route keeps the hard limits.
    """
    feasible = _feasible_with_corners_repaired(fine, judged, settings, rule, None)
    if not feasible:
        raise InfeasibleError(("interrupted: so far " if interrupted else "") + why_infeasible(fine.site, judged))
    members = _with_legs_that_fit(fine, _few_enough(feasible, settings), rule, None)
    pareto = thinned(pareto_members(members), rule)
    choice = select(pareto, rule)
    route = pareto[choice.index]
    return ChosenRoute(route, tuple(pareto), choice.met and _is_few_enough(route, settings), ())


def _feasible(fine: CoverageMap, routes: Sequence[NamedRoute], executor: Executor | None) -> list[RouteMember]:
    sound = [(with_sound_corners(fine.site, route), origin) for route, origin in routes]
    return [member for member in judge_members(fine, sound, executor) if member.violation <= 0.0]


def _feasible_with_corners_repaired(
    fine: CoverageMap,
    judged: Sequence[RouteMember],
    settings: PlannerSettings,
    rule: Rule,
    executor: Executor | None,
) -> list[RouteMember]:
    """Feasible members, and repaired ones that the rule would choose and that exceed limits in corners only.

    The flown corner is inside the waypoint, away from the legs: nearer to obstacles, and at a cliff over other ground.
    """
    site = fine.site
    margin_m = site.scenario.limits.height_margin_m
    feasible = [member for member in judged if member.violation <= 0.0]
    unsound = [
        member
        for member in judged
        if member.violation > 0.0 and measure_violations(site, member.route.waypoints_m, margin_m=margin_m).total <= 0.0
    ]

    def choice(members: Sequence[RouteMember]) -> RouteMember | None:
        chosen = _chosen_so_far(_few_enough(members, settings), rule)
        return next((one for one in members if one.violation > 0.0), None) if chosen is None else chosen

    def repaired(chosen: RouteMember) -> list[RouteMember] | None:
        return None if chosen.violation <= 0.0 else _feasible(fine, [(chosen.route, chosen.origin)], executor)

    members, _ = _replaced([*feasible, *unsound], choice, repaired, most=_MOST_UNSOUND)
    return [member for member in members if member.violation <= 0.0]


def _is_few_enough(member: RouteMember, settings: PlannerSettings) -> bool:
    """Whether a route has at most the permitted number of waypoints."""
    return settings.most_waypoints is None or member.metrics.waypoint_count <= settings.most_waypoints


def _few_enough(members: Sequence[RouteMember], settings: PlannerSettings) -> list[RouteMember]:
    """Members within the permitted number of waypoints; without any, those with the fewest."""
    fewest = min(member.metrics.waypoint_count for member in members)
    few = [member for member in members if _is_few_enough(member, settings)]
    return few or [member for member in members if member.metrics.waypoint_count == fewest]


def _confirmed(
    fine: CoverageMap, members: list[RouteMember], rule: Rule, is_over: Callable[[], bool] | None
) -> list[RouteMember]:
    """The members without overfitted choices of the rule, if there are finer cells and the time to prepare them."""
    finer = finer_map(fine.site)
    if finer is None or not finer.knows_coverable((lambda: False) if is_over is None else is_over):
        return members
    return without_overfitted(
        members,
        rule,
        lambda route: finer.fraction_of_coverable(finer.observed(route.waypoints_m)),
        cells=fine.grid.count,
    )


def _nearly_with_gaps_closed(
    fine: CoverageMap, members: Sequence[RouteMember], rule: Rule, is_over: Callable[[], bool]
) -> list[NamedRoute]:
    """Repair routes that cost less than the rule's choice and nearly reach the coverage.

    A search may end a few cells short of its goal, and the next route that reaches it may take two thirds longer
    (tests/random_kinds.py, case 12).
    """
    chosen, required = _chosen_so_far(members, rule), rule.required_coverage
    if chosen is None or required is None:
        return []
    most = _CHEAPER * chosen.metrics.cost if chosen.metrics.coverage_of_coverable >= required else math.inf
    found: list[tuple[float, RouteMember]] = []
    for member in members:
        lacking = required - member.metrics.coverage_of_coverable
        closed_cost = member.metrics.cost * (1.0 + _COSTLY * lacking)
        if 0.0 < lacking <= TUNED.goal.most_short and closed_cost < most:
            found.append((closed_cost, member))
    routes: list[NamedRoute] = []
    for _, member in sorted(found, key=lambda each: each[0])[:_MOST_NEAR]:
        if len(routes) == _MOST_CLOSED or is_over():
            break
        closed = _closed(fine, member.route, with_safety(required), is_over)
        routes += [] if closed is None else [(closed, member.origin)]
    return routes


def _overfitted_repaired(
    site: Site,
    members: Sequence[RouteMember],
    confirmed: Sequence[RouteMember],
    rule: Rule,
    is_over: Callable[[], bool],
) -> list[NamedRoute]:
    """Repair the rule's choice among all members if finer cells show too little coverage.

    The next best route may cost a third more, although this one is nearly sufficient (scripts/bench/kinds.py, ``city:tilted``,
    seed 2).
    """
    chosen, finer, required = _chosen_so_far(members, rule), finer_map(site), rule.required_coverage
    if chosen is None or finer is None or required is None or chosen.metrics.coverage_of_coverable < required:
        return []
    if any(one is chosen for one in confirmed) or is_over():
        return []
    closed = _closed(finer, chosen.route, required, is_over)
    return [] if closed is None else [(closed, chosen.origin)]


def _closed(judging: CoverageMap, route: Route, goal: float, is_over: Callable[[], bool]) -> Route | None:
    return with_gaps_closed(judging, route, goal, TUNED.goal.closed, is_over, most_trials=TUNED.goal.most_trials)


def _simplified(
    site: Site, feasible: Sequence[RouteMember], rule: Rule, is_over: Callable[[], bool]
) -> list[NamedRoute]:
    """The rule's choice among the members, without unneeded waypoints; empty if it needs all."""
    chosen = _chosen_so_far(feasible, rule)
    if chosen is None:
        return []
    maps = [each for each in judging_maps(site) if each.knows_coverable(is_over)]
    simpler = simplified(maps, chosen.route, required=rule.required_coverage, is_over=is_over)
    return [] if simpler is None else [(simpler, chosen.origin)]


def _in_other_order(
    site: Site,
    feasible: Sequence[RouteMember],
    rule: Rule,
    order: OrderEffort,
    is_over: Callable[[], bool] | None,
) -> list[NamedRoute]:
    """The rule's choice in an order with shorter sorties, and the same without unneeded waypoints."""
    chosen = _chosen_so_far(feasible, rule)
    if chosen is None or not has_several_sorties(site, chosen.route):
        return []
    judges, required = judging_maps(site), rule.required_coverage
    other = reordered(site, judges, chosen.route, order, required=required)
    if other is None:
        return []
    simpler = None if is_over is None else simplified(judges, other, required=required, is_over=is_over)
    return [(route, chosen.origin) for route in (other, simpler) if route is not None]


def _with_sure_photos(
    fine: CoverageMap,
    members: list[RouteMember],
    rule: Rule,
    executor: Executor | None,
    is_over: Callable[[], bool] | None,
) -> list[RouteMember]:
    """The members, with sure photos for the rule's choice if one of the first choices permits it."""
    found, is_sure = _replaced(
        members, lambda left: _chosen_so_far(left, rule), lambda chosen: _made_of(chosen, certainly, fine, executor),
        most=_MOST_UNSURE, confirmed=lambda left: _confirmed(fine, left, rule, is_over),
    )  # fmt: skip
    return found if is_sure and select(pareto_members(found), rule).met else members


def _with_legs_that_fit(
    fine: CoverageMap, members: list[RouteMember], rule: Rule, executor: Executor | None
) -> list[RouteMember]:
    """The members, with waypoints on legs of the rule's choice that are too long for one flight.

    The line does not change, but coverage may change slightly if the sensor observes at other points of a leg. The route then
    takes several flights, and the rule may choose another one.
    """
    found, fits = _replaced(
        members, lambda left: _chosen_so_far(left, rule),
        lambda chosen: _made_of(chosen, with_legs_that_fit, fine, executor), most=_MOST_LONG,
    )  # fmt: skip
    return found if fits else members


def _made_of(
    chosen: RouteMember, repaired: Callable[[Site, Route], Route], fine: CoverageMap, executor: Executor | None
) -> list[RouteMember] | None:
    """A changed member that keeps the limits; None if its route does not change."""
    route = repaired(fine.site, chosen.route)
    return None if route is chosen.route else _feasible(fine, [(route, chosen.origin)], executor)


def _replaced(
    members: list[RouteMember],  # feasible or repairable
    choice: Callable[[Sequence[RouteMember]], RouteMember | None],  # chooses one member; None: stop
    made_of: Callable[[RouteMember], list[RouteMember] | None],  # the replacement of a choice; None: keep it
    *,
    most: int,  # largest number of replaced choices
    # those of some members that may be chosen
    confirmed: Callable[[list[RouteMember]], list[RouteMember]] = lambda members: members,
) -> tuple[list[RouteMember], bool]:
    """The members with replaced choices, repeated until the choice stays.

    Returns:
        The members, and whether the choice among them may stay.
    """
    for _ in range(most):
        chosen = choice(members) if members else None
        made = None if chosen is None else made_of(chosen)
        if made is None:
            return members, bool(members)
        members = [*(member for member in members if member is not chosen), *made]
        members = confirmed(members) if members else members
    return members, False


def _chosen_so_far(feasible: Sequence[RouteMember], rule: Rule) -> RouteMember | None:
    """The rule's choice among members; None where it names a number in the set of all."""
    if rule.kind == "index":
        return None
    pareto = pareto_members(feasible)
    return pareto[select(pareto, rule).index]


_MOST_HALVINGS = 6
_SHORTEST_M = 20.0
"""A leg of less is not halved: what is too far away is not reached by shorter legs."""


def with_legs_that_fit(site: Site, route: Route) -> Route:
    """The route, with additional waypoints on legs that are too long for one flight.

    Sorties are split at waypoints. The route does not change if even short legs do not fit, or if the sensor observes at
    waypoints.

    Args:
        site: the scenario on its ground; of one vehicle, or of several identical ones.
        route: keeps the limits.
    """
    vehicle = site.scenario.vehicle
    looks_along = site.scenario.sensor.looks_along_path
    if vehicle.endurance_s is None or site.home_m is None or site.frame is None or not looks_along:
        return route
    if site.scenario.vehicles or route.begins or len(route) < 2:
        return route
    points = route.waypoints_m
    for _ in range(_MOST_HALVINGS):
        long = _too_long(flight_costs_along_transits(site, Route(points), vehicle.autopilot, None))
        if long.size == 0:
            return route if len(points) == len(route) else Route(points)
        if (np.linalg.norm(points[long + 1] - points[long], axis=1) < _SHORTEST_M).any():
            return route
        points = np.insert(points, long + 1, 0.5 * (points[long] + points[long + 1]), axis=0)
    return route


def _too_long(costs: FlightCosts) -> IntArray:
    """Numbers of the first waypoints of legs that take too much time or battery for one flight."""
    legs = np.arange(len(costs.so_far_s) - 1)
    alone_s = costs.there_s[:-1] + np.diff(costs.so_far_s) + costs.back_s[1:]
    used_s = np.array([battery_s(costs.energies, int(leg), int(leg) + 1) for leg in legs])
    return np.flatnonzero((alone_s > costs.endurance_s) | (used_s > costs.energies.usable_s))

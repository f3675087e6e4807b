import dataclasses
import itertools
import math

import numpy as np
import pytest

from tests.planner.sites import make_site, ridge, with_scenario
from uavcover.kernels.path_cost import split
from uavcover.missions.fleet_cuts import allocate
from uavcover.missions.flights import compile_sorties
from uavcover.missions.leg_checks import measure_violations
from uavcover.missions.objectives import judge_member, mission_cost, straight_flight_costs
from uavcover.model.route import Route
from uavcover.model.vehicle import Fleet, PowerModel, Wind
from uavcover.planner.final_choice import ChosenRoute, choose
from uavcover.planner.selection_rule import parse_rule
from uavcover.planner.sortie_order.order_costs import (
    NO_LINK_S,
    OrderCosts,
    Stretches,
    first_position,
    last_position,
    stretches_of,
)
from uavcover.planner.sortie_order.reorder import OrderEffort, better_order, has_several_sorties, reordered
from uavcover.planner.terrain_following import lay_over_terrain
from uavcover.scenario.site import Site
from uavcover.sensing.site_maps import judging_map, judging_maps


def lines(site: Site, order: tuple[int, ...] = (0, 2, 4, 1, 3)) -> Route:
    """Level lines 40 m apart in a bad order, each flown to the east or back to the west."""
    corners = []
    for number, k in enumerate(order):
        ends = [(20.0, 20.0 + 40.0 * k), (280.0, 20.0 + 40.0 * k)]
        corners += ends if number % 2 == 0 else ends[::-1]
    return Route(lay_over_terrain(site, np.array(corners), np.full(len(corners), 60.0), tolerance_m=80.0))


def windy(site: Site) -> Site:
    return with_scenario(site, wind=Wind(speed_m_s=4.0, from_deg=250.0, most_m_s=6.0))


def costs_of(site: Site, route: Route) -> tuple[OrderCosts, Stretches]:
    stretches = stretches_of(site, route)
    return OrderCosts(site, stretches, straight_flight_costs(site, route.waypoints_m, transit_items=2)), stretches


VEHICLE = {"endurance_s": 270.0, "max_airspeed_m_s": 14.0, "power": PowerModel(hover_induced_m_s=3.0)}


@pytest.mark.parametrize("limit", [{}, {"max_mission_items": 14}], ids=["batteries", "items"])
@pytest.mark.parametrize("wind", [False, True])
def test_an_order_costs_what_the_split_of_its_route_does(wind: bool, limit: dict[str, int]) -> None:
    site = make_site(vehicle={**VEHICLE, **limit})
    site = windy(site) if wind else site
    route = lines(site)
    costs, stretches = costs_of(site, route)
    rng = np.random.default_rng(2)
    finite = 0
    for _ in range(20):
        order = 2 * rng.permutation(stretches.count) + rng.integers(2, size=stretches.count)
        mine = costs.flights(order)
        laid = stretches.joined(order)
        # The same cost from the waypoints, where flights end only at ends of stretches, as in the tables.
        whole = straight_flight_costs(site, laid.waypoints_m, transit_items=2)
        ends, at = [0], 0
        for number, following in itertools.zip_longest(order, order[1:]):
            at += 1
            ends.append(at)
            if following is not None and last_position(number) != first_position(following):
                at += 1 + len(stretches.links_m[last_position(number), first_position(following)])
        inner = np.setdiff1d(np.arange(len(laid)), ends)
        there, back = whole.there_s.copy(), whole.back_s.copy()
        there[inner] = back[inner] = math.inf
        expected, _ = split(whole._replace(there_s=there, back_s=back))
        assert costs.total_s(order) == pytest.approx(expected, rel=1e-9)
        finite += math.isfinite(expected)
        assert len(mine.so_far_s) == stretches.count + 1
    assert finite > 1


@pytest.mark.parametrize("seed", [3, 11])
def test_the_order_found_is_the_best_of_all(seed: int) -> None:
    site = make_site(vehicle={**VEHICLE, "endurance_s": 180.0})
    rng = np.random.default_rng(seed)
    positions = np.column_stack([rng.uniform(10.0, 290.0, 6), rng.uniform(10.0, 190.0, 6), np.full(6, 60.0)])
    costs, _ = costs_of(site, Route(positions))
    best = min(
        costs.total_s(2 * np.array(order) + np.array(paths))
        for order in itertools.permutations(range(5))
        for paths in itertools.product((0, 1), repeat=5)
    )
    found_s, order = better_order(costs, costs.as_it_is, done=lambda k: k / 100, rng=np.random.default_rng(1))
    assert found_s == pytest.approx(costs.total_s(order))
    assert sorted(order // 2) == list(range(5))
    assert found_s == pytest.approx(best, rel=1e-6)
    assert best < costs.total_s(costs.as_it_is) - 1.0


def test_no_work_leaves_the_order() -> None:
    site = make_site(vehicle=VEHICLE)
    costs, stretches = costs_of(site, lines(site))
    found_s, order = better_order(costs, costs.as_it_is, done=lambda _: 1.0, rng=np.random.default_rng(1))
    assert (order == 2 * np.arange(stretches.count)).all()
    assert found_s == costs.total_s(costs.as_it_is)


def test_links_keep_the_limits_and_lead_over_a_ridge() -> None:
    site = make_site(ridge(150.0, 30.0))
    route = Route(np.array([[20.0, 20.0, 60.0], [20.0, 180.0, 60.0], [100.0, 180.0, 60.0], [280.0, 180.0, 60.0]]))
    stretches = stretches_of(site, route)
    margin_m = site.scenario.limits.height_margin_m
    assert stretches.links_m
    for (a, b), between in stretches.links_m.items():
        path = np.vstack([stretches.positions_m[a], between, stretches.positions_m[b]])
        assert measure_violations(site, path, margin_m=margin_m).total == 0.0


def test_a_link_outside_the_fence_is_none() -> None:
    notch = (
        (0.0, 0.0),
        (300.0, 0.0),
        (300.0, 200.0),
        (200.0, 200.0),
        (200.0, 60.0),
        (100.0, 60.0),
        (100.0, 200.0),
        (0.0, 200.0),
    )
    site = make_site(ring=notch, home=(20.0, 20.0), fence=notch)
    up = 60.0
    route = Route(np.array([[50.0, 180.0, up], [50.0, 30.0, up], [250.0, 30.0, up], [250.0, 180.0, up]]))
    costs, stretches = costs_of(site, route)
    link = stretches.links_m.get((0, 3))
    assert link is None or len(link) > 0
    assert (1, 2) in stretches.links_m
    assert costs.link_s[0, 0] == NO_LINK_S


def test_sorties_are_done_sooner_and_see_as_much() -> None:
    site = make_site(vehicle=VEHICLE)
    route = lines(site)
    judges = judging_maps(site)
    assert has_several_sorties(site, route)
    found = reordered(site, judges, route, OrderEffort(150, 1), required=None)
    assert found is not None
    assert mission_cost(site, found).time_s < 0.95 * mission_cost(site, route).time_s
    flown_s = [
        sum(sortie.compiled.flight_time_s for sortie in compile_sorties(site, each, autopilot="ardupilot"))
        for each in (found, route)
    ]
    assert flown_s[0] < flown_s[1]
    observed = [judging_map(site).observed(each.waypoints_m) for each in (found, route)]
    assert (observed[0] | ~observed[1]).all()
    again = reordered(site, judges, route, OrderEffort(150, 1), required=None)
    assert again is not None
    assert np.array_equal(again.waypoints_m, found.waypoints_m)


def test_one_sortie_keeps_its_order() -> None:
    site = make_site(vehicle={"endurance_s": 5000.0})
    assert not has_several_sorties(site, lines(site))
    assert reordered(site, judging_maps(site), lines(site), OrderEffort(50, 1), required=None) is None


def test_a_route_that_is_to_be_short_keeps_its_order() -> None:
    site = make_site(vehicle=VEHICLE)
    site = with_scenario(site, planner=dataclasses.replace(site.scenario.planner, objective="length"))
    assert reordered(site, judging_maps(site), lines(site), OrderEffort(50, 1), required=None) is None


def test_no_time_no_search() -> None:
    site = make_site(vehicle=VEHICLE)
    effort = OrderEffort(50, 1, used=lambda: 1.0)
    assert reordered(site, judging_maps(site), lines(site), effort, required=None) is None


def test_less_coverage_is_no_other_order(monkeypatch: pytest.MonkeyPatch) -> None:
    site = make_site(vehicle=VEHICLE)
    route = lines(site)
    judges = judging_maps(site)
    observed = judges[0].observed

    def less_elsewhere(points_m: np.ndarray) -> np.ndarray:
        return observed(points_m) if np.array_equal(points_m, route.waypoints_m) else observed(points_m[:2])

    monkeypatch.setattr(judges[0], "observed", less_elsewhere)
    assert reordered(site, judges, route, OrderEffort(100, 1), required=None) is None


def test_the_choice_is_the_route_in_the_better_order() -> None:
    site = make_site(vehicle=VEHICLE)
    fine = judging_map(site)
    member = judge_member(fine, lines(site), "lines", margin_m=0.0)
    rule = parse_rule("max-coverage")

    def chosen(order: OrderEffort | None) -> ChosenRoute:
        settings = site.scenario.planner
        return choose(fine, settings, rule, [member], executor=None, interrupted=False, is_over=None, order=order)

    before, behind = chosen(None).route, chosen(OrderEffort(60, 1)).route
    assert before is member
    assert behind.origin == "lines"
    assert behind.violation == 0.0
    assert behind.metrics.cost < before.metrics.cost
    assert behind.metrics.coverage_of_coverable >= before.metrics.coverage_of_coverable


def test_an_order_with_more_waypoints_than_allowed_is_not_chosen() -> None:
    site = make_site(vehicle=VEHICLE)
    route = lines(site)
    fine = judging_map(site)
    member = judge_member(fine, route, "lines", margin_m=0.0)
    settings = dataclasses.replace(site.scenario.planner, max_waypoints=len(route))
    found = reordered(site, judging_maps(site), route, OrderEffort(60, 1), required=None)
    assert found is not None
    assert len(found) > len(route)
    chosen = choose(
        fine, settings, parse_rule("max-coverage"), [member], executor=None, interrupted=False, is_over=None,
        order=OrderEffort(60, 1),
    )  # fmt: skip
    assert chosen.route is member


def test_the_stop_of_the_user_ends_the_search() -> None:
    site = make_site(vehicle=VEHICLE)
    effort = OrderEffort(50, 1, should_stop=lambda: True)
    assert reordered(site, judging_maps(site), lines(site), effort, required=None) is None


def test_two_vehicles_are_not_done_later() -> None:
    site = with_scenario(make_site(vehicle=VEHICLE), fleet=Fleet(vehicles=2, turnaround_s=20.0))
    route = lines(site)
    found = reordered(site, judging_maps(site), route, OrderEffort(60, 1), required=None)
    assert found is not None
    done_s = []
    for each in (found, route):
        sorties = compile_sorties(site, each, autopilot="ardupilot", vehicles=2)
        times_s = [sortie.compiled.flight_time_s for sortie in sorties]
        done_s.append((allocate(times_s, 2, 20.0).makespan_s, sum(times_s)))
    assert done_s[0][0] <= done_s[1][0]
    assert done_s[0][1] <= done_s[1][1]

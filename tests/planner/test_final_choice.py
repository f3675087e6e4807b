"""The choice among judged routes, where finer cells do not confirm the cheapest."""

import dataclasses

import numpy as np
import pytest

from tests.missions.test_leg_checks import AROUND, obstacle_beside
from tests.planner.sites import hills, make_site
from tests.planner.test_insertion import SPHERE, some_route
from uavcover.errors import InfeasibleError
from uavcover.model.limits import Obstacles
from uavcover.model.route import Route, RouteMember
from uavcover.planner.baselines.boustrophedon import fly_layout, regular_layout
from uavcover.planner.baselines.initial_routes import fly_rows, scanned_rows
from uavcover.planner.final_choice import ChosenRoute, choose
from uavcover.planner.front import judge_members
from uavcover.planner.search.repair import with_viewpoints
from uavcover.planner.selection_rule import parse_rule
from uavcover.scenario.site import Site
from uavcover.sensing.site_maps import finer_map, judging_map

REQUIRED = 0.984


def lines(site: Site, count: int) -> Route:
    return fly_layout(site, regular_layout(angle_rad=3.0, lines=count, height_agl_m=80.0, inset=0.2, tolerance_m=2.0))


def chosen(site: Site, *, most_waypoints: int | None = None, is_over: bool = False) -> ChosenRoute:
    fine = judging_map(site)
    settings = dataclasses.replace(site.scenario.planner, max_waypoints=most_waypoints)
    return choose(
        fine, settings, parse_rule(f"coverage>={REQUIRED}"),
        judge_members(fine, [(lines(site, n), f"{n} lines") for n in (2, 3)]),
        executor=None, interrupted=False, is_over=lambda: is_over,
    )  # fmt: skip


def test_the_cheapest_route_that_finer_cells_do_not_confirm_gets_what_it_lacks() -> None:
    """Two lines see 98.5 % on the cells they are judged on and 97.9 % on finer ones; three lines cost 10 % more."""
    site = make_site(hills, limits={"height_margin_m": 5.0})
    fine, finer = judging_map(site), finer_map(site)
    assert finer is not None
    two, three = judge_members(fine, [(lines(site, n), "") for n in (2, 3)])
    assert (
        two.metrics.coverage_of_coverable
        >= REQUIRED
        > finer.fraction_of_coverable(finer.observed(two.route.waypoints_m))
    )
    found = chosen(site)
    assert found.rule_met
    assert found.route.origin == "2 lines"
    assert found.route.metrics.cost < 0.95 * three.metrics.cost
    assert found.route.violation == 0.0
    assert finer.fraction_of_coverable(finer.observed(found.route.route.waypoints_m)) >= REQUIRED
    np.testing.assert_array_equal(found.route.route.waypoints_m[0], two.route.waypoints_m[0])


def test_when_the_time_is_over_no_finer_cells_are_prepared() -> None:
    site = make_site(hills, limits={"height_margin_m": 5.0})
    found, finer = chosen(site, is_over=True), finer_map(site)
    assert (found.rule_met, found.route.origin) == (True, "2 lines")
    assert finer is not None
    assert not finer.knows_coverable(lambda: True)


def test_not_with_more_waypoints_than_there_may_be() -> None:
    site = make_site(hills, limits={"height_margin_m": 5.0})
    most = max(len(lines(site, n)) for n in (2, 3))
    found = chosen(site, most_waypoints=most)
    assert found.route.metrics.waypoint_count <= most


def pit(east: np.ndarray, north: np.ndarray) -> np.ndarray:
    return np.where((east > 105.0) & (north > 105.0), -60.0, 0.0)


def test_corners_that_break_a_limit_are_mended_before_they_are_chosen() -> None:
    """Two legs along the edges of a pit keep to 120 m; the vehicle turns inside of their corner, where the ground is lower."""
    site = make_site(pit, limits={"height_margin_m": 0.0})
    fine, rule = judging_map(site), parse_rule("coverage>=0.3")
    near, away = (Route(np.array([[at, 190.0, 119.5], [at, at, 119.5], [290.0, at, 119.5]])) for at in (100.0, 95.0))
    members = judge_members(fine, [(near, "near"), (away, "away")])
    assert members[0].violation > 0.1
    assert members[1].violation == 0.0
    assert members[0].metrics.cost < members[1].metrics.cost

    def chosen_of(offered: list[RouteMember]) -> ChosenRoute:
        found = choose(
            fine, site.scenario.planner, rule, offered, executor=None, interrupted=False, is_over=lambda: True
        )
        assert found.rule_met
        assert [member.violation for member in found.pareto] == [0.0] * len(found.pareto)
        return found

    assert chosen_of(members).route.origin == "near"
    assert chosen_of(members[:1]).route.origin == "near"
    moved_m = np.linalg.norm(chosen_of(members).route.route.waypoints_m - near.waypoints_m, axis=1)
    assert moved_m[[0, 2]].tolist() == [0.0, 0.0]
    assert 0.1 < moved_m[1] < 5.0


def test_what_cannot_be_mended_is_not_chosen_and_said_where_there_is_nothing_else() -> None:
    """Masts on both sides of a corner."""
    inside, outside = obstacle_beside(10.5).prisms[0], obstacle_beside(-10.5).prisms[0]
    site = make_site(obstacles=Obstacles(prisms=(inside, outside)))
    fine, rule = judging_map(site), parse_rule("coverage>=0.3")
    members = judge_members(fine, [(Route(AROUND), "around")])
    with pytest.raises(
        InfeasibleError, match=r"violates one: corner flown beside waypoint 1: .* too close to obstacle"
    ):
        choose(fine, site.scenario.planner, rule, members, executor=None, interrupted=False, is_over=lambda: True)


@pytest.mark.parametrize("reaches", [True, False], ids=["one reaches it", "none does"])
def test_what_lacks_a_little_and_is_much_cheaper_gets_the_rest(reaches: bool) -> None:
    """A search ended a few cells short of its goal, and the next route that reached it took two thirds longer."""
    site = make_site(hills, sensor=SPHERE, limits={"height_margin_m": 3.0})
    fine, rule = judging_map(site), parse_rule("coverage>=0.95")
    near = with_viewpoints(fine, some_route(site), 0.93, lambda: False)
    assert near is not None
    rows = max(
        (fly_rows(site, layout) for layout in scanned_rows(site, most_nodes=40)),
        key=lambda route: (fine.fraction_of_coverable(fine.observed(route.waypoints_m)) >= 0.95, route.length_m),
    )  # fmt: skip
    members = judge_members(fine, [(near, "near"), *([(rows, "rows")] if reaches else [])])
    found = choose(fine, site.scenario.planner, rule, members, executor=None, interrupted=False, is_over=lambda: False)
    assert found.rule_met
    assert found.route.origin == "near"
    assert found.route.metrics.cost < 1.2 * members[0].metrics.cost
    if reaches:
        assert members[1].metrics.coverage_of_coverable >= 0.95
        assert found.route.metrics.cost < 0.9 * members[1].metrics.cost

"""Routes whose corners break a limit: a waypoint gives way."""

import numpy as np
import pytest

from tests.missions.test_leg_checks import AROUND, obstacle_beside
from tests.planner.sites import make_site
from uavcover.missions.leg_checks import corner_excess_m, measure_violations
from uavcover.model.route import Route
from uavcover.planner.final_changes import with_sound_corners


def test_a_route_without_unsound_corners_stays() -> None:
    route = Route(AROUND)
    assert with_sound_corners(make_site(), route) is route


@pytest.mark.parametrize("away_m", [10.45, 10.5, 10.7])
def test_the_waypoint_moves_outward_by_as_much_as_it_is_passed_inside(away_m: float) -> None:
    site = make_site(obstacles=obstacle_beside(away_m))
    assert corner_excess_m(site, AROUND)[1] > 0.3
    route = with_sound_corners(site, Route(AROUND))
    assert corner_excess_m(site, route.waypoints_m).sum() == 0.0
    assert measure_violations(site, route.waypoints_m, margin_m=0.0).total == 0.0
    moved_m = np.linalg.norm(route.waypoints_m - AROUND, axis=1)
    assert moved_m[[0, 2]].tolist() == [0.0, 0.0]
    assert 0.3 < moved_m[1] < 6.0
    assert (route.waypoints_m[1, :2] < AROUND[1, :2]).all()


def test_legs_are_not_broken_for_a_corner() -> None:
    """West and south of the waypoint the ground rises so far that nothing moves there."""
    site = make_site(
        lambda east, north: np.where((east < 80.0) & (north < 80.0), 0.0, 0.0), obstacles=obstacle_beside(10.5),
        limits={"min_height_agl_m": 79.99, "max_height_agl_m": 80.01},
    )  # fmt: skip
    route = with_sound_corners(site, Route(AROUND))
    assert measure_violations(site, route.waypoints_m, margin_m=0.0).total == 0.0


def test_where_no_way_is_sound_the_least_unsound_is_given() -> None:
    """Masts on both sides: the waypoint cannot move out, and the corner is cut on the inside."""
    out = obstacle_beside(-10.5).prisms[0]
    both = obstacle_beside(10.5)
    site = make_site(obstacles=type(both)(prisms=(*both.prisms, out)))
    route = with_sound_corners(site, Route(AROUND))
    before = corner_excess_m(site, AROUND).sum()
    assert 0.0 < corner_excess_m(site, route.waypoints_m).sum() <= before
    assert measure_violations(site, route.waypoints_m, margin_m=0.0).total == 0.0


def test_waypoints_of_corners_above_the_band_lie_lower_and_stay_where_they_are() -> None:
    """Legs keep to the edges of a pit, and their corner is passed over it."""
    site = make_site(
        lambda east, north: np.where((east > 105.0) & (north > 105.0), -60.0, 0.0), limits={"height_margin_m": 0.0}
    )
    route = Route(np.array([[100.0, 190.0, 119.5], [100.0, 100.0, 119.5], [290.0, 100.0, 119.5]]))
    assert measure_violations(site, route.waypoints_m, margin_m=0.0).total == 0.0
    assert corner_excess_m(site, route.waypoints_m)[1] > 0.05
    sound = with_sound_corners(site, route).waypoints_m
    assert measure_violations(site, sound, margin_m=0.0).total == 0.0
    assert corner_excess_m(site, sound).sum() == 0.0
    assert np.array_equal(sound[:, :2], route.waypoints_m[:, :2])
    assert (sound[:, 2] <= route.waypoints_m[:, 2]).all()
    assert sound[1, 2] > 118.0

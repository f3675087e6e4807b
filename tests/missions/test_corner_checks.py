"""Corners as they are flown, against limits that their legs keep; compared with small steps of time and shapely."""

import math

import numpy as np
import pytest
import shapely

from tests.naive.flown_line import arducopter, passed_corners
from tests.planner.sites import EXACT, make_site, tower
from uavcover.errors import InfeasibleError
from uavcover.missions.leg_checks import (
    LegProblem,
    corner_excess_around_m,
    corner_excess_m,
    corner_heights_off_m,
    find_corner_problems,
    find_problems,
    measure_violations,
)
from uavcover.missions.mission_compiler import compile_mission
from uavcover.missions.objectives import judge_member
from uavcover.model.limits import NoFly, Obstacles
from uavcover.model.route import Route
from uavcover.scenario.site import Site
from uavcover.sensing.site_maps import judging_map

CORNER_M = 100.0
AROUND = np.array([[50.0, 186.6, 80.0], [CORNER_M, CORNER_M, 80.0], [186.6, 50.0, 80.0]])
"""Thirty degrees to the left, around what is to the north-east of its corner."""


def apex_m(site: Site) -> np.ndarray:
    """Where the corner of AROUND is passed, by small steps of time."""
    vehicle = site.scenario.vehicle
    pace = arducopter({
        "cruise_speed_m_s": vehicle.cruise_speed_m_s, "max_climb_m_s": vehicle.max_climb_m_s,
        "max_descent_m_s": vehicle.max_descent_m_s,
    })  # fmt: skip
    (places,), _ = passed_corners(AROUND, pace, steps=200)
    return np.asarray(places)[100]


def only(site: Site) -> LegProblem:
    assert find_problems(site, AROUND, lowest_agl_m=40.0, highest_agl_m=120.0) == []
    assert measure_violations(site, AROUND, margin_m=0.0).total == 0.0
    (found,) = find_corner_problems(site, AROUND)
    assert (found.leg, found.in_corner) == (1, True)
    excess_m = corner_excess_m(site, AROUND)
    assert excess_m[[0, 2]].tolist() == [0.0, 0.0]
    assert excess_m[1] > 0.0
    return found


def obstacle_beside(away_m: float) -> Obstacles:
    """A mast north-east of the corner, so far from it."""
    at = CORNER_M + away_m / math.sqrt(2.0)
    return Obstacles(prisms=(tower(at - 0.05, at - 0.05, at + 0.05, at + 0.05, 85.0, name="mast"),))


def test_a_corner_is_nearer_to_what_is_led_around_than_its_legs() -> None:
    site = make_site(obstacles=obstacle_beside(10.5))
    found = only(site)
    assert (found.kind, found.name) == ("obstacle", "mast")
    at = CORNER_M + 10.5 / math.sqrt(2.0) - 0.05
    mast = shapely.box(at, at, at + 0.1, at + 0.1)
    lacking_m = 10.0 - mast.distance(shapely.Point(apex_m(site)[:2]))
    assert lacking_m > 0.5
    assert found.value == pytest.approx(lacking_m, abs=0.15)
    assert corner_excess_m(site, AROUND)[1] == found.value
    assert f"corner flown beside waypoint 1: {found.value:.1f} m too close to obstacle 'mast'" in str(found)


def test_corners_around_a_waypoint_are_those_of_the_whole_route() -> None:
    """Over ground in waves, beside a mast, and at both ends of the route."""
    site = make_site(
        lambda east, north: 6.0 * np.sin(east / 9.0) * np.cos(north / 7.0), obstacles=obstacle_beside(10.5),
        limits={"min_height_agl_m": 78.0, "max_height_agl_m": 82.0},
    )  # fmt: skip
    rng = np.random.default_rng(5)
    for _ in range(20):
        route = np.column_stack([rng.uniform(40.0, 180.0, (6, 2)), rng.uniform(75.0, 85.0, 6)])
        whole_m = corner_excess_m(site, route)
        assert whole_m.max() > 0.0
        for k in range(6):
            around_m = whole_m[max(k - 1, 0) : k + 2].sum()
            assert corner_excess_around_m(site, route, k) == pytest.approx(around_m, abs=1e-9)


def test_corners_are_off_the_band_above_it_or_below() -> None:
    pit = make_site(lambda east, north: np.where((east > 105.0) & (north > 105.0), -300.0, 0.0))
    route = np.array([[100.0, 190.0, 119.5], [100.0, 100.0, 119.5], [290.0, 100.0, 119.5]])
    assert corner_heights_off_m(pit, route) == pytest.approx(corner_excess_m(pit, route))
    hill = make_site(lambda east, north: np.where((east > 105.0) & (north > 105.0), 300.0, 0.0))
    low = route - [0.0, 0.0, 79.0]
    assert corner_heights_off_m(hill, low) == pytest.approx(-corner_excess_m(hill, low))
    assert corner_heights_off_m(hill, low)[1] < -1.0


def test_over_the_edge_of_a_pit_a_corner_is_too_high() -> None:
    site = make_site(lambda east, north: np.where((east > 105.0) & (north > 105.0), -300.0, 0.0))
    route = np.array([[100.0, 190.0, 119.5], [100.0, 100.0, 119.5], [290.0, 100.0, 119.5]])
    assert measure_violations(site, route, margin_m=0.0).total == 0.0
    (found,) = find_corner_problems(site, route)
    assert (found.kind, found.limit) == ("too high", 120.0)
    assert found.value > 120.5
    assert corner_excess_m(site, route)[1] == pytest.approx(found.value - 120.1, abs=1e-9)
    low = make_site(lambda east, north: np.where((east > 105.0) & (north > 105.0), 300.0, 0.0))
    (found,) = find_corner_problems(low, route - [0.0, 0.0, 79.0])
    assert (found.kind, found.limit) == ("too low", 40.0)


def test_in_the_bay_of_a_fence_a_corner_is_outside() -> None:
    """The fence's corner sticks in to a hand's breadth beside the waypoint, and opens a little more widely than the legs."""
    east, north = (
        (CORNER_M + 250.0 * math.cos(math.radians(a)), CORNER_M + 250.0 * math.sin(math.radians(a)))
        for a in (-27.0, 117.0)
    )
    at = CORNER_M + 0.1
    fence = ((-300.0, -100.0), (east[0], -100.0), east, (at, at), north, (-300.0, north[1]))
    site = make_site(fence=fence)
    found = only(site)
    assert found.kind == "fence"
    assert found.value == pytest.approx(site.fence.distance(shapely.Point(apex_m(site)[:2])), abs=0.15)
    assert "m outside the fence" in str(found)


def test_a_no_fly_zone_is_entered_in_the_corner() -> None:
    zone = NoFly(name="mast", center_east_north_m=(CORNER_M + 5.0, CORNER_M + 5.0), radius_m=6.75, margin_m=0.0)
    found = only(make_site(no_fly=(zone,)))
    assert (found.kind, found.name) == ("no-fly zone", "mast")
    # Its margin is for what a vehicle flies beside its line.
    wider = NoFly(name="mast", center_east_north_m=(CORNER_M + 5.0, CORNER_M + 5.0), radius_m=3.0, margin_m=4.0)
    assert find_corner_problems(make_site(no_fly=(wider,)), AROUND) == []


def test_where_corners_are_flown_exactly_or_only_waypoints_count_there_is_nothing() -> None:
    near = obstacle_beside(10.5)
    for site in (
        make_site(obstacles=near, vehicle=EXACT), make_site(obstacles=near, home=None),
        make_site(obstacles=near, vehicle={"autopilot": "px4"}),
        make_site(obstacles=near, limits={"applies_to": "waypoints"}),
    ):  # fmt: skip
        assert not corner_excess_m(site, AROUND).any()
        assert find_corner_problems(site, AROUND) == []
    assert corner_excess_m(make_site(obstacles=near), AROUND[:1]).tolist() == [0.0]


def test_members_count_corners_and_the_compiler_refuses_them() -> None:
    site = make_site(obstacles=obstacle_beside(10.5))
    member = judge_member(judging_map(site), Route(AROUND), "own", margin_m=0.0)
    assert member.violation == pytest.approx(corner_excess_m(site, AROUND).sum())
    with pytest.raises(InfeasibleError, match=r"corner flown beside waypoint 1: .* too close to obstacle 'mast'"):
        compile_mission(site, Route(AROUND), autopilot="ardupilot")
    farther = make_site(obstacles=obstacle_beside(12.5))
    assert judge_member(judging_map(farther), Route(AROUND), "own", margin_m=0.0).violation == 0.0
    assert compile_mission(farther, Route(AROUND), autopilot="ardupilot").waypoint_count == 3


def test_ends_are_left_out_where_a_route_is_cut() -> None:
    """The corner is the end of the first of two flights: there the vehicle turns home, the other way round."""
    site = make_site(obstacles=obstacle_beside(10.5))
    first = np.ascontiguousarray(AROUND[:2])
    assert find_corner_problems(site, first, with_ends=False) == []
    compile_mission(site, Route(first), autopilot="ardupilot")


@pytest.mark.parametrize("seed", range(8))
def test_as_by_small_steps_of_time_and_shapely(seed: int) -> None:
    """A slow twin: the worst place of each inner corner among masts, the ground flat."""
    rng = np.random.default_rng(seed)
    places = rng.uniform((0.0, 0.0), (300.0, 200.0), (12, 2))
    masts = tuple(tower(e - 1.0, n - 1.0, e + 1.0, n + 1.0, 300.0, name=f"{k}") for k, (e, n) in enumerate(places))
    site = make_site(obstacles=Obstacles(prisms=masts))
    route = np.column_stack([rng.uniform((0.0, 0.0), (300.0, 200.0), (9, 2)), rng.uniform(60.0, 100.0, 9)])
    vehicle = site.scenario.vehicle
    pace = arducopter({
        "cruise_speed_m_s": vehicle.cruise_speed_m_s, "max_climb_m_s": vehicle.max_climb_m_s,
        "max_descent_m_s": vehicle.max_descent_m_s,
    })  # fmt: skip
    corners, _ = passed_corners(route, pace, steps=400)
    squares = [shapely.box(e - 1.0, n - 1.0, e + 1.0, n + 1.0) for e, n in places]
    found = corner_excess_m(site, route)[1:-1]
    for corner, excess_m in zip(corners, found, strict=True):
        lacking = max(10.0 - square.distance(shapely.LineString(np.array(corner)[:, :2])) for square in squares)
        assert excess_m == pytest.approx(max(0.0, lacking), abs=0.4)

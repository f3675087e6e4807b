"""Legs, waypoints and flown corners against the hard limits."""

import math

import numpy as np
import pytest
import shapely

from tests.naive.flown_line import arducopter, passed_corners
from tests.planner.sites import EXACT, ORIGIN, make_site, ridge, tower
from uavcover.errors import InfeasibleError
from uavcover.missions.leg_checks import (
    LegProblem,
    climb_angles_deg,
    corner_excess_around_m,
    corner_excess_m,
    corner_heights_off_m,
    find_corner_problems,
    find_problems,
    find_waypoint_problems,
    measure_violations,
    route_height_range_m,
)
from uavcover.missions.mission_compiler import compile_mission
from uavcover.missions.objectives import judge_member
from uavcover.model.limits import NoFly, Obstacles
from uavcover.model.route import Route
from uavcover.scenario.site import Site
from uavcover.sensing.site_maps import judging_map


def route(*points: tuple[float, float, float]) -> np.ndarray:
    return np.array(points)


def only(site: Site, points: np.ndarray) -> LegProblem:
    (found,) = find_problems(site, points, lowest_agl_m=40.0, highest_agl_m=120.0)
    return found


GOOD = route((0, 50, 80), (100, 50, 80), (200, 50, 90))


def test_a_good_route_has_no_problem() -> None:
    site = make_site()
    assert find_problems(site, GOOD, lowest_agl_m=40.0, highest_agl_m=120.0) == []
    violations = measure_violations(site, GOOD, margin_m=0.0)
    assert violations.total == 0.0
    assert route_height_range_m(site, GOOD) == (80.0, 90.0)


def test_the_limits_themselves_are_allowed() -> None:
    at_limits = route((0, 50, 40), (100, 50, 40), (100 + 80 / math.tan(math.radians(30)), 50, 120))
    assert find_problems(make_site(), at_limits, lowest_agl_m=40.0, highest_agl_m=120.0) == []
    assert measure_violations(make_site(), at_limits, margin_m=0.0).total == 0.0


@pytest.mark.parametrize("beyond_m", [0.001, 1.0, 4.9])
@pytest.mark.parametrize(("kind", "limit", "side"), [("too low", 40.0, -1.0), ("too high", 120.0, 1.0)])
def test_a_little_beyond_a_limit_is_beyond_it(kind: str, limit: float, side: float, beyond_m: float) -> None:
    height = limit + side * beyond_m
    points = route((0, 50, 80), (100, 50, height), (200, 50, 80))
    found = find_problems(make_site(), points, lowest_agl_m=40.0, highest_agl_m=120.0)
    assert {(problem.kind, problem.leg) for problem in found if problem.kind != "climb"} == {(kind, 1), (kind, 2)}
    alone = find_waypoint_problems(make_site(), points, lowest_agl_m=40.0, highest_agl_m=120.0)
    assert [(problem.kind, problem.leg) for problem in alone] == [(kind, 1)]
    violations = measure_violations(make_site(), points, margin_m=0.0)
    both_legs_m = pytest.approx(2.0 * beyond_m, abs=1e-5)
    assert (violations.below_m, violations.above_m) == ((both_legs_m, 0.0) if side < 0.0 else (0.0, both_legs_m))


def test_too_low_over_a_hill_between_two_waypoints() -> None:
    # The ridge is 50 m high at 150 m east; both ends of the leg are at 80 m.
    site = make_site(ridge(150.0, 50.0))
    found = only(site, route((0, 50, 80), (100, 50, 80), (300, 50, 80)))
    assert (found.leg, found.kind, found.limit) == (2, "too low", 40.0)
    assert found.value == pytest.approx(30.0)
    assert (found.east_m, found.north_m) == (pytest.approx(150.0), pytest.approx(50.0))
    assert str(found) == (
        "leg to waypoint 2: too low, 30.0 m above ground against 40.0 m above ground at 150 m east, 50 m north"
    )
    violations = measure_violations(site, route((0, 50, 80), (100, 50, 80), (300, 50, 80)), margin_m=0.0)
    assert violations.below_m == violations.total == pytest.approx(10.0, abs=1e-5)


def test_too_high_over_a_valley_between_two_waypoints() -> None:
    valley = make_site(lambda east, north: -ridge(150.0, 60.0)(east, north))
    points = route((0, 50, 80), (300, 50, 80))
    found = only(valley, points)
    assert (found.leg, found.kind, found.limit) == (1, "too high", 120.0)
    assert found.value == pytest.approx(140.0)
    assert found.east_m == pytest.approx(150.0)
    assert measure_violations(valley, points, margin_m=0.0).above_m == pytest.approx(20.0, abs=1e-5)
    assert route_height_range_m(valley, points) == (80.0, pytest.approx(140.0))


def test_the_margin_narrows_the_band_at_both_ends() -> None:
    points = route((0, 50, 42), (100, 50, 42), (200, 50, 42))
    assert measure_violations(make_site(), points, margin_m=0.0).total == 0.0
    assert measure_violations(make_site(), points, margin_m=5.0).below_m == pytest.approx(6.0, abs=1e-5)
    assert measure_violations(make_site(), points + np.array([0, 0, 76]), margin_m=5.0).above_m == pytest.approx(
        6.0, abs=1e-5
    )


def test_climb_up_and_down() -> None:
    points = route((0, 50, 50), (40, 50, 90), (140, 50, 90), (180, 50, 50))
    assert climb_angles_deg(points) == pytest.approx([45.0, 0.0, 45.0])
    found = find_problems(make_site(), points, lowest_agl_m=40.0, highest_agl_m=120.0)
    assert [(p.leg, p.kind, p.limit, p.east_m) for p in found] == [(1, "climb", 30.0, 40.0), (3, "climb", 30.0, 180.0)]
    assert found[0].value == pytest.approx(45.0)
    assert measure_violations(make_site(), points, margin_m=0.0).climb_deg == pytest.approx(30.0, abs=1e-5)


def test_sea_level_limits() -> None:
    site = make_site(limits={"min_alt_amsl_m": ORIGIN.alt_amsl_m + 60.0, "max_alt_amsl_m": ORIGIN.alt_amsl_m + 85.0})
    points = route((0, 0, 70), (50, 0, 50), (100, 0, 70), (150, 0, 95))
    found = find_problems(site, points, lowest_agl_m=40.0, highest_agl_m=120.0)
    assert [(p.leg, p.kind) for p in found] == [
        (1, "below sea-level limit"), (2, "below sea-level limit"), (3, "above sea-level limit"),
    ]  # fmt: skip
    assert [p.east_m for p in found] == [50.0, 50.0, 150.0]
    assert found[0].value == pytest.approx(ORIGIN.alt_amsl_m + 50.0, abs=0.01)
    assert found[2].value == pytest.approx(ORIGIN.alt_amsl_m + 95.0, abs=0.01)
    # Each waypoint counts once: 10 m below and 10 m above.
    assert measure_violations(site, points, margin_m=0.0).sea_level_m == pytest.approx(20.0, abs=0.01)


FENCE = ((-150.0, -50.0), (200.0, -50.0), (200.0, 250.0), (-150.0, 250.0))


def test_the_fence_by_how_much_and_where() -> None:
    site = make_site(fence=FENCE)
    points = route((100, 50, 80), (240, 60, 80), (100, 70, 80))
    found = find_problems(site, points, lowest_agl_m=40.0, highest_agl_m=120.0)
    assert [(p.leg, p.kind) for p in found] == [(1, "fence"), (2, "fence")]
    assert [p.value for p in found] == pytest.approx([40.0, 40.0])
    assert [(p.east_m, p.north_m) for p in found] == [(240, 60), (240, 60)]
    assert str(found[0]) == "leg to waypoint 1: 40.0 m outside the fence at 240 m east, 60 m north"
    # 40 of the 140 m east of each leg are outside.
    outside = 2 * math.hypot(140, 10) * 40 / 140
    assert measure_violations(site, points, margin_m=0.0).fence_m == pytest.approx(outside, abs=1e-4)


def test_a_leg_across_a_bay_of_the_fence() -> None:
    bay = (
        (-150.0, -50.0),
        (400.0, -50.0),
        (400.0, 250.0),
        (200.0, 250.0),
        (150.0, 0.0),
        (100.0, 250.0),
        (-150.0, 250.0),
    )
    found = only(make_site(fence=bay), route((0, 100, 80), (300, 100, 80)))
    assert found.kind == "fence"
    assert found.east_m == pytest.approx(150.0, abs=1.0)
    # From (150, 100) to the side of the bay, which rises 250 m over 50 m: 100 * 50 / hypot(50, 250).
    assert found.value == pytest.approx(100.0 * 50.0 / math.hypot(50.0, 250.0), rel=0.02)


def test_a_leg_along_the_fence_is_inside() -> None:
    points = route((200, 0, 80), (200, 100, 80), (200 + 5e-7, 200, 80))
    assert find_problems(make_site(fence=FENCE), points, lowest_agl_m=40.0, highest_agl_m=120.0) == []
    assert measure_violations(make_site(fence=FENCE), points, margin_m=0.0).total == 0.0


def test_no_elevation_data() -> None:
    site = make_site(lambda east, north: np.where((east > 140) & (east < 160), np.nan, 0.0 * north))
    points = route((0, 50, 80), (100, 50, 80), (200, 50, 80), (250, 50, 80))
    found = only(site, points)
    assert (found.leg, found.kind) == (2, "no elevation data")
    assert str(found) == "leg to waypoint 2: no elevation data at 150 m east, 50 m north"
    violations = measure_violations(site, points, margin_m=0.0)
    assert (violations.no_data_legs, violations.total) == (1, 1000.0)
    outside_the_grid = only(
        make_site(fence=((-9e3, -9e3), (9e3, -9e3), (9e3, 9e3), (-9e3, 9e3))), route((0, 0, 80), (5000, 0, 80))
    )
    assert outside_the_grid.kind == "no elevation data"


def test_several_limits_on_one_leg_are_all_named_in_flying_order() -> None:
    points = route((0, 50, 80), (100, 50, 20), (130, 50, 130))
    found = find_problems(make_site(), points, lowest_agl_m=40.0, highest_agl_m=120.0)
    assert [(p.leg, p.kind) for p in found] == [
        (1, "too low"), (1, "climb"), (2, "too low"), (2, "too high"), (2, "climb"),
    ]  # fmt: skip


def test_no_ceiling() -> None:
    assert find_problems(make_site(), GOOD + np.array([0, 0, 1000]), lowest_agl_m=40.0, highest_agl_m=None) == []


# The waypoints alone


def test_waypoints_alone_do_not_see_the_hill_between_them() -> None:
    points = route((0, 50, 80), (150, 50, 80), (300, 50, 200))
    site = make_site(ridge(100.0, 60.0), limits={"applies_to": "waypoints"}, fence=FENCE)
    violations = measure_violations(site, points, margin_m=0.0)
    assert violations.below_m == 0.0
    assert violations.above_m == pytest.approx(80.0, abs=1e-5)
    assert violations.climb_deg == 0.0  # a limit of legs
    assert violations.fence_m == pytest.approx(100.0)  # how far the waypoint lies outside
    assert route_height_range_m(site, points) == (80.0, 200.0)
    found = find_waypoint_problems(site, points, lowest_agl_m=40.0, highest_agl_m=120.0)
    assert [str(p) for p in found] == [
        "waypoint 2: too high, 200.0 m above ground against 120.0 m above ground at 300 m east, 50 m north",
        "waypoint 2: 100.0 m outside the fence at 300 m east, 50 m north",
    ]
    # Whoever asks for legs gets legs, whatever the limits apply to.
    assert "too low" in [p.kind for p in find_problems(site, points, lowest_agl_m=40.0, highest_agl_m=120.0)]


@pytest.mark.parametrize(("up_m", "kind"), [(20.0, "too low"), (80.0, None), (130.0, "too high")])
def test_a_route_of_one_waypoint_is_looked_at_too(up_m: float, kind: str | None) -> None:
    found = find_problems(make_site(), route((50, 50, up_m)), lowest_agl_m=40.0, highest_agl_m=120.0)
    assert [p.kind for p in found] == ([] if kind is None else [kind])
    assert all(str(p).startswith("waypoint 0: ") for p in found)
    total = measure_violations(make_site(), route((50, 50, up_m)), margin_m=0.0).total
    assert total == pytest.approx({20.0: 20.0, 80.0: 0.0, 130.0: 10.0}[up_m], abs=1e-5)


def test_arguments_are_left_alone() -> None:
    points = GOOD.copy()
    points.flags.writeable = False
    find_problems(make_site(), points, lowest_agl_m=40.0, highest_agl_m=120.0)
    measure_violations(make_site(), points, margin_m=0.0)
    np.testing.assert_array_equal(points, GOOD)


TOWER = Obstacles(prisms=(tower(140, 90, 160, 110, 50),), clearance_beside_m=12.0, clearance_above_m=8.0)


def test_an_obstacle_by_how_much_and_where() -> None:
    site = make_site(obstacles=TOWER)
    # Over it: the top is at 50 m, so 58 m is enough and 53 m is 5 m too low, from where the leg is 12 m near.
    assert find_problems(site, route((0, 100, 58), (300, 100, 58)), lowest_agl_m=40.0, highest_agl_m=120.0) == []
    found = only(site, route((0, 100, 53), (300, 100, 53)))
    assert (found.kind, found.leg, found.name) == ("obstacle", 1, "tower")
    assert found.value == pytest.approx(5.0)
    assert found.east_m == pytest.approx(128.0)
    assert str(found) == "leg to waypoint 1: 5.0 m too close to obstacle 'tower' at 128 m east, 100 m north"
    # Beside it, lower: 12 m is enough, 10 m lacks 2.
    assert measure_violations(site, route((0, 122, 45), (300, 122, 45)), margin_m=0.0).obstacle_m == 0.0
    assert measure_violations(site, route((0, 120, 45), (300, 120, 45)), margin_m=0.0).obstacle_m == pytest.approx(2.0)
    # Between two samples of any grid: the leg is looked at all along.
    assert measure_violations(site, route((0, 99, 45), (300, 101, 45)), margin_m=0.0).total == pytest.approx(13.0)


def test_where_limits_are_for_waypoints_a_leg_may_pass_through_an_obstacle() -> None:
    site = make_site(obstacles=TOWER, limits={"applies_to": "waypoints"})
    assert measure_violations(site, route((0, 100, 53), (300, 100, 53)), margin_m=0.0).total == 0.0
    inside = route((0, 100, 53), (150, 100, 45))
    assert measure_violations(site, inside, margin_m=0.0).obstacle_m == pytest.approx(13.0)
    (found,) = find_waypoint_problems(site, inside, lowest_agl_m=40.0, highest_agl_m=120.0)
    assert str(found).startswith("waypoint 1: 13.0 m too close to obstacle 'tower'")


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
    (positions,), _ = passed_corners(AROUND, pace, steps=200)
    return np.asarray(positions)[100]


def only_corner(site: Site) -> LegProblem:
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
    found = only_corner(site)
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
    found = only_corner(site)
    assert found.kind == "fence"
    assert found.value == pytest.approx(site.fence.distance(shapely.Point(apex_m(site)[:2])), abs=0.15)
    assert "m outside the fence" in str(found)


def test_a_no_fly_zone_is_entered_in_the_corner() -> None:
    zone = NoFly(name="mast", center_east_north_m=(CORNER_M + 5.0, CORNER_M + 5.0), radius_m=6.75, margin_m=0.0)
    found = only_corner(make_site(no_fly=(zone,)))
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
    positions = rng.uniform((0.0, 0.0), (300.0, 200.0), (12, 2))
    masts = tuple(tower(e - 1.0, n - 1.0, e + 1.0, n + 1.0, 300.0, name=f"{k}") for k, (e, n) in enumerate(positions))
    site = make_site(obstacles=Obstacles(prisms=masts))
    route = np.column_stack([rng.uniform((0.0, 0.0), (300.0, 200.0), (9, 2)), rng.uniform(60.0, 100.0, 9)])
    vehicle = site.scenario.vehicle
    pace = arducopter({
        "cruise_speed_m_s": vehicle.cruise_speed_m_s, "max_climb_m_s": vehicle.max_climb_m_s,
        "max_descent_m_s": vehicle.max_descent_m_s,
    })  # fmt: skip
    corners, _ = passed_corners(route, pace, steps=400)
    squares = [shapely.box(e - 1.0, n - 1.0, e + 1.0, n + 1.0) for e, n in positions]
    found = corner_excess_m(site, route)[1:-1]
    for corner, excess_m in zip(corners, found, strict=True):
        lacking = max(10.0 - square.distance(shapely.LineString(np.array(corner)[:, :2])) for square in squares)
        assert excess_m == pytest.approx(max(0.0, lacking), abs=0.4)

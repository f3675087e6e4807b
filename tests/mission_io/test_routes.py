"""Legs, limits, fences and times of whole missions, against pyproj, shapely and figures made by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest
from pyproj import Geod

from mission_io.actions import ChangeSpeed, Jump, LoiterTurns, item_of
from mission_io.areas import Fence, FenceCircle, FencePolygon, FramedPoint, LatLon
from mission_io.errors import MisuseError
from mission_io.fence_checks import FenceGround, Inclusion
from mission_io.flight_time import Performance, bearing_deg, flight_time_s
from mission_io.items import (
    Command,
    Frame,
    GeoPoint,
    Mission,
    MissionItem,
    SpeedType,
    change_speed,
    delay,
    land,
    return_to_launch,
    takeoff,
    waypoint,
)
from mission_io.legs import Climb, Leg, LegKind, legs_of
from mission_io.route_checks import RouteLimits, RouteReport, check_route
from mission_io.surface import FloatArray, GridSurface

GEOD = Geod(ellps="WGS84")
HOME = GeoPoint(33.0, -98.0, 300.0)
SPEEDS = Performance(10.0, 2.0, 1.0)


def place(east_m: float, north_m: float) -> tuple[float, float]:
    """A place by metres east and north of home."""
    lon, lat, _ = GEOD.fwd(
        HOME.lon_deg, HOME.lat_deg, math.degrees(math.atan2(east_m, north_m)), math.hypot(east_m, north_m)
    )
    return lat, lon


def at(east_m: float, north_m: float, height_m: float = 50.0, frame: Frame = Frame.ABOVE_HOME) -> MissionItem:
    return waypoint(*place(east_m, north_m), height_m, frame=frame)


def mission(*items: MissionItem) -> Mission:
    return Mission(HOME, items)


UP = takeoff(*place(0.0, 0.0), 50.0, frame=Frame.ABOVE_HOME)
SQUARE = mission(
    UP, at(1000.0, 0.0), at(1000.0, 1000.0), at(0.0, 1000.0), land(*place(0.0, 0.0), frame=Frame.ABOVE_HOME)
)


class Tilted:
    """Ground that rises by 0.1 m a metre to the east, from 300 m at home."""

    steepest_slope = 0.101

    def heights_amsl_m(self, lat_deg: FloatArray, lon_deg: FloatArray) -> FloatArray:
        east_m = (lon_deg - HOME.lon_deg) * math.radians(1.0) * 6378137.0 * math.cos(math.radians(HOME.lat_deg))
        return 300.0 + 0.1 * np.asarray(east_m) + 0.0 * lat_deg


def lines(report: RouteReport) -> list[str]:
    return [str(problem) for problem in report.problems]


def test_the_legs_of_a_mission() -> None:
    legs = legs_of(SQUARE)
    assert [(leg.item, leg.kind) for leg in legs] == [
        (1, LegKind.TAKEOFF), (2, LegKind.FLIGHT), (3, LegKind.FLIGHT), (4, LegKind.FLIGHT), (5, LegKind.FLIGHT),
        (5, LegKind.LANDING),
    ]  # fmt: skip
    assert [leg.ground_m for leg in legs] == pytest.approx([0.0, 1000.0, 1000.0, 1000.0, 1000.0, 0.0], abs=0.5)
    assert [leg.climb_m for leg in legs] == [50.0, 0.0, 0.0, 0.0, 0.0, -50.0]
    assert sum(leg.length_m for leg in legs) == pytest.approx(4100.0, abs=1.0)
    assert legs[0].start == HOME


def test_a_fixed_wing_climbs_towards_the_place_of_its_takeoff() -> None:
    far = replace(UP, lat_deg=place(0.0, 500.0)[0])
    (leg, _) = legs_of(mission(far, at(1000.0, 0.0)), climb=Climb.TOWARDS_THE_PLACE)
    assert (leg.ground_m, leg.climb_m) == (pytest.approx(500.0, abs=0.1), 50.0)
    (leg, _) = legs_of(mission(far, at(1000.0, 0.0)))
    assert leg.ground_m == 0.0


def test_a_mission_without_takeoff_begins_at_its_first_place() -> None:
    (leg,) = legs_of(mission(at(0.0, 100.0), change_speed(3.0), at(0.0, 300.0)))
    assert leg.item == 3
    assert leg.ground_m == pytest.approx(200.0, abs=0.01)
    assert legs_of(Mission(None, (takeoff(33.0, -98.0, 400.0, frame=Frame.AMSL),))) == ()


def test_a_landing_at_zero_zero_is_one_where_the_vehicle_is() -> None:
    legs = legs_of(mission(UP, at(0.0, 100.0), land(0.0, 0.0, frame=Frame.ABOVE_HOME)))
    assert [leg.kind for leg in legs] == [LegKind.TAKEOFF, LegKind.FLIGHT, LegKind.LANDING]
    assert legs[-1].end.lat_deg == legs[-2].end.lat_deg
    assert legs_of(mission(land(*place(5.0, 5.0), frame=Frame.ABOVE_HOME))) == ()


def test_a_return_is_flown_at_the_height_that_it_is_given() -> None:
    flown = mission(UP, at(0.0, 800.0), return_to_launch())
    assert len(legs_of(flown)) == 2
    up, home, down = legs_of(flown, return_alt_above_home_m=80.0)[2:]
    assert (up.climb_m, home.climb_m, down.climb_m) == (30.0, 0.0, -80.0)
    assert (up.kind, home.kind, down.kind) == (LegKind.RETURN, LegKind.RETURN, LegKind.LANDING)
    assert len(legs_of(flown, return_alt_above_home_m=20.0)) == 4


def test_jumps_are_flown_as_often_as_they_say() -> None:
    there_and_back = mission(at(0.0, 0.0), at(0.0, 100.0), item_of(Jump(1, 2)), at(0.0, 200.0))
    assert [leg.item for leg in legs_of(there_and_back)] == [2, 1, 2, 1, 2, 4]
    for_ever = mission(at(0.0, 0.0), at(0.0, 100.0), item_of(Jump(1, -1)))
    assert [leg.item for leg in legs_of(for_ever)] == [2, 1, 2]
    assert flight_time_s(for_ever, legs_of(for_ever), SPEEDS) == math.inf
    for pointless in (Jump(3, 5), Jump(9, 5), Jump(1, 0)):
        assert len(legs_of(mission(at(0.0, 0.0), at(0.0, 100.0), item_of(pointless)))) == 1
    with pytest.raises(MisuseError, match="more than 200000 steps"):
        legs_of(mission(change_speed(5.0), item_of(Jump(1, 2_000_000))))


def test_heights_above_terrain_need_the_terrain() -> None:
    over = mission(
        at(0.0, 0.0, 50.0, Frame.AMSL),
        at(1000.0, 0.0, 60.0, Frame.ABOVE_TERRAIN),
        at(0.0, 0.0, 60.0, Frame.ABOVE_TERRAIN),
    )
    with pytest.raises(MisuseError, match="item 2: its height is above the terrain; give a surface"):
        legs_of(over)
    first, second = legs_of(over, surface=Tilted())
    assert second.follows_terrain
    assert (second.start_height_agl_m, second.end_height_agl_m) == (pytest.approx(60.0), 60.0)
    assert first.start_height_agl_m == pytest.approx(-250.0)
    assert first.end.alt_amsl_m == pytest.approx(460.0, abs=0.5)
    report = check_route(over, RouteLimits(min_height_agl_m=59.0), surface=Tilted())
    assert [problem.item for problem in report.problems] == [2]
    with pytest.raises(MisuseError, match="does not know there"):
        legs_of(over, surface=GridSurface(0.0, 0.0, 1.0, np.zeros((2, 2))))


@pytest.mark.parametrize(
    ("items", "what"),
    [
        ([replace(at(0.0, 0.0), alt_m=math.nan)], "item 1: no place"),
        ([replace(at(0.0, 0.0), lat_deg=91.0)], "item 1: no place"),
        ([MissionItem(Command.NAV_WAYPOINT, Frame.COMMAND)], "item 1: command 16 without a position"),
    ],
)
def test_places_that_are_none_are_refused(items: list[MissionItem], what: str) -> None:
    with pytest.raises(MisuseError, match=what):
        legs_of(mission(*items))
    with pytest.raises(MisuseError, match="the mission has no home"):
        legs_of(Mission(None, (at(0.0, 0.0),)))


def test_a_good_route_has_no_problems() -> None:
    report = check_route(
        SQUARE,
        RouteLimits(
            max_height_agl_m=60.0, max_alt_above_home_m=50.0, max_alt_amsl_m=350.0, max_climb_deg=1.0, max_descent_deg=1.0,
            max_leg_m=1001.0, max_distance_from_home_m=1415.0, max_length_m=4101.0, endurance_s=480.0,
        ),
        surface=GridSurface(32.9, -98.1, 0.05, np.full((5, 5), 300.0)),
        performance=SPEEDS,
        fence=Fence((FencePolygon(tuple(LatLon(*place(*p)) for p in ((-9, -9), (-9, 1009), (1009, 1009), (1009, -9)))),)),
    )  # fmt: skip
    assert report.problems == ()
    assert report.length_m == pytest.approx(4100.0, abs=1.0)
    assert report.time_s == pytest.approx(25.0 + 400.0 + 50.0, abs=0.2)
    assert report.error_m == 0.0
    assert [round(along.lowest_agl_m) for along in report.heights] == [0, 50, 50, 50, 50, 0]


def test_every_limit_is_kept_or_named() -> None:
    steep = mission(UP, at(0.0, 1000.0, 250.0), at(0.0, 0.0, 20.0), return_to_launch())
    report = check_route(
        steep,
        RouteLimits(
            max_alt_above_home_m=200.0, max_alt_amsl_m=400.0, max_climb_deg=10.0, max_descent_deg=10.0, max_leg_m=900.0,
            max_distance_from_home_m=900.0, max_length_m=2000.0, endurance_s=100.0,
        ),
        performance=SPEEDS,
    )  # fmt: skip
    assert [(problem.item, problem.what) for problem in report.problems] == [
        (2, "550.0 m above sea level, 400.0 m is allowed"),
        (2, "250.0 m above home, 200.0 m is allowed"),
        (2, "climbs at 11.3 degrees, 10.0 degrees are allowed"),
        (2, "is 1020 m long, 900 m is allowed"),
        (2, "1000 m from home, 900 m is allowed"),
        (3, "550.0 m above sea level, 400.0 m is allowed"),
        (3, "250.0 m above home, 200.0 m is allowed"),
        (3, "descends at 13.0 degrees, 10.0 degrees are allowed"),
        (3, "is 1026 m long, 900 m is allowed"),
        (3, "1000 m from home, 900 m is allowed"),
        (4, "the return was not checked; give the home and the height that the autopilot returns at"),
        (None, "is 2096 m long, 2000 m is allowed"),
        (None, "takes 355 s, the endurance is 100 s"),
    ]
    lat, lon = place(0.0, 1000.0)
    assert str(report.problems[0]).startswith("leg to item 2: 550.0 m above sea level")
    assert str(report.problems[0]).endswith(f" at {lat:.6f}, {lon:.6f}")
    assert str(report.problems[-1]).startswith("the route: takes 355 s")


def test_clearance_counts_between_the_waypoints_and_not_at_the_ground() -> None:
    ridge = np.full((5, 5), 300.0)
    ridge[:, 3] = 345.0
    surface = GridSurface(HOME.lat_deg - 0.01, HOME.lon_deg - 0.01, 0.005, ridge)
    over = mission(UP, at(900.0, 0.0), land(*place(900.0, 0.0), frame=Frame.ABOVE_HOME))
    limits = RouteLimits(min_height_agl_m=20.0, max_height_agl_m=49.0)
    low, high = check_route(over, limits, surface=surface).problems
    assert (low.item, high.item) == (2, 2)
    assert low.what.startswith("5.0 m above ground")
    assert low.lon_deg == pytest.approx(HOME.lon_deg + 0.005, abs=2e-5)
    assert high.what.startswith("50.0 m above ground")
    assert check_route(over, RouteLimits(), surface=surface).problems == ()


def test_what_was_not_checked_is_a_problem() -> None:
    unlit = Mission(
        None, (waypoint(33.0, -98.0, 350.0, frame=Frame.AMSL), waypoint(33.0, -97.99, 350.0, frame=Frame.AMSL))
    )
    limits = RouteLimits(min_height_agl_m=5.0, max_alt_above_home_m=1.0, max_distance_from_home_m=1.0, endurance_s=5.0)
    assert [problem.what for problem in check_route(unlit, limits).problems] == [
        "its height above home was not checked; give the home",
        "its distance from home was not checked; give the home",
        "heights above ground were not checked; give a surface",
        "its time was not checked; give a performance",
    ]
    nowhere = GridSurface(0.0, 0.0, 1.0, np.zeros((2, 2)))
    (problem,) = check_route(unlit, RouteLimits(min_height_agl_m=5.0), surface=nowhere).problems
    assert problem.what == "the ground is not known"
    spline = MissionItem(Command.NAV_SPLINE_WAYPOINT, Frame.AMSL, lat_deg=33.0, lon_deg=-97.99, alt_m=350.0)
    assert (
        "a curve, checked as the straight line"
        in lines(check_route(Mission(None, (unlit.items[0], spline)), RouteLimits()))[0]
    )


def test_the_error_of_the_terrain_counts_against_the_route() -> None:
    level = mission(UP, at(900.0, 0.0, 150.0), at(0.0, 0.0, 150.0))
    report = check_route(level, RouteLimits(min_height_agl_m=49.95), surface=Tilted(), tolerance_m=5.0, step_m=400.0)
    assert report.error_m is not None
    assert any("measured to" in line for line in lines(report))
    fine = check_route(level, RouteLimits(min_height_agl_m=49.95), surface=Tilted(), tolerance_m=0.01)
    assert fine.problems == ()


def test_the_same_place_twice_is_found() -> None:
    report = check_route(
        mission(at(0.0, 0.0), at(0.0, 100.0), delay(2.0), at(0.0, 100.01), at(0.0, 200.0)), RouteLimits()
    )
    assert [str(problem).split(" at ")[0] for problem in report.problems] == [
        "leg to item 4: the same place as item 2; leave one out"
    ]


@pytest.mark.parametrize(
    ("corners", "found"),
    [
        ([(0, 0), (0, 500), (500, 500)], []),
        ([(0, 0), (0, 500), (60, 500), (60, 0)], ["60 m are too short for its turns of 50 m radius, which take 100 m"]),
        ([(0, 0), (0, 500), (100.1, 500), (100.1, 0)], []),
        ([(0, 0), (0, 500), (0, 0)], ["turns straight back; a turn of 50 m radius cannot"]),
        ([(0, 0), (0, 20), (500, 20)], ["20 m are too short for its turns of 50 m radius, which take 50 m"]),
    ],
)
def test_turns_that_cannot_be_flown(corners: list[tuple[float, float]], found: list[str]) -> None:
    route = mission(*(at(float(east), float(north)) for east, north in corners))
    assert [problem.what for problem in check_route(route, RouteLimits(turn_radius_m=50.0)).problems] == found


def test_times_count_speeds_holds_loiters_and_climbs() -> None:
    def seconds(*items: MissionItem) -> float:
        flown = mission(*items)
        return flight_time_s(flown, legs_of(flown), SPEEDS)

    assert seconds(at(0, 0), at(0, 100)) == pytest.approx(10.0, abs=0.01)
    assert seconds(at(0, 0), at(0, 100, 150)) == pytest.approx(50.0)
    assert seconds(at(0, 0, 150), at(0, 100, 50)) == pytest.approx(100.0)
    assert seconds(change_speed(5.0), at(0, 0), at(0, 100)) == pytest.approx(20.0, abs=0.01)
    assert seconds(change_speed(-1.0), at(0, 0), at(0, 100)) == pytest.approx(10.0, abs=0.01)
    assert seconds(item_of(ChangeSpeed(SpeedType.CLIMB, 10.0)), at(0, 0), at(0, 10, 150)) == pytest.approx(10.0)
    assert seconds(item_of(ChangeSpeed(SpeedType.DESCENT, 5.0)), at(0, 0, 150), at(0, 10, 50)) == pytest.approx(20.0)
    hold = replace(at(0, 100), params=(7.0, 0.0, 0.0, 0.0))
    assert seconds(at(0, 0), hold, delay(3.0)) == pytest.approx(20.0, abs=0.01)
    turns = item_of(LoiterTurns(FramedPoint(*place(0, 100), 50.0), turns=2.0, radius_m=-50.0))
    assert seconds(at(0, 0), turns) == pytest.approx(10.0 + 2 * 2 * math.pi * 5.0, abs=0.01)
    assert seconds(replace(at(0, 0), command=17)) == math.inf
    with pytest.raises(MisuseError, match="speeds have to be above 0"):
        Performance(0.0, 1.0, 1.0)


def test_bearings_agree_with_pyproj() -> None:
    for start, end in (((33.0, -98.0), (33.2, -97.7)), ((-60.0, 179.99), (-60.1, -179.9)), ((10.0, 5.0), (9.0, 5.0))):
        leg = Leg(1, LegKind.FLIGHT, GeoPoint(*start, 0.0), GeoPoint(*end, 0.0))
        forward, back, _ = GEOD.inv(start[1], start[0], end[1], end[0])
        assert bearing_deg(leg, 0.0) == pytest.approx(forward % 360.0, abs=0.2)
        assert bearing_deg(leg, 1.0) == pytest.approx((back + 180.0) % 360.0, abs=0.2)


def box(west: float, south: float, east: float, north: float, *, inclusion: bool = True) -> FencePolygon:
    corners = ((west, south), (east, south), (east, north), (west, north))
    return FencePolygon(tuple(LatLon(*place(*corner)) for corner in corners), inclusion)


def straight(*ends: tuple[float, float]) -> Leg:
    (lat_a, lon_a), (lat_b, lon_b) = (place(*end) for end in ends)
    return Leg(1, LegKind.FLIGHT, GeoPoint(lat_a, lon_a, 350.0), GeoPoint(lat_b, lon_b, 350.0))


HOME_CIRCLE = LatLon(*place(0.0, 500.0))


@pytest.mark.parametrize(
    ("fence", "leg", "found"),
    [
        (Fence((box(-10, -10, 1000, 1000),)), straight((0, 0), (990, 990)), []),
        (Fence((box(-10, -10, 1000, 1000),)), straight((0, 0), (1300, 500)), [(300.0, "outside of fence polygon 0", 1300, 500)]),
        (Fence((box(-10, -10, 1000, 1000), box(400, -100, 600, 100, inclusion=False))), straight((0, 50), (900, 50)),
         [(50.0, "inside of fence polygon 1", None, 50)]),
        (Fence((), (FenceCircle(HOME_CIRCLE, 200.0),)), straight((0, 500), (150, 500)), []),
        (Fence((), (FenceCircle(HOME_CIRCLE, 200.0),)), straight((0, 500), (300, 500)),
         [(100.0, "outside of fence circle 0", 300, 500)]),
        (Fence((), (FenceCircle(HOME_CIRCLE, 200.0, inclusion=False),)), straight((-900, 420), (900, 420)),
         [(120.0, "inside of fence circle 0", 0, 420)]),
        (Fence((), (FenceCircle(HOME_CIRCLE, 50.0, inclusion=False),)), straight((-900, 420), (900, 420)), []),
        (Fence((box(-10, -10, 100, 100),)), straight((500, 50), (500, 50)), [(400.0, "outside of fence polygon 0", 500, 50)]),
        (Fence(), straight((0, 0), (990, 990)), []),
    ],
)  # fmt: skip
def test_fences_are_kept_along_the_whole_leg(
    fence: Fence, leg: Leg, found: list[tuple[float, str, float | None, float]]
) -> None:
    breaches = list(FenceGround(fence).breaches(leg))
    assert [(round(b.outside_m), b.what) for b in breaches] == [(distance, what) for distance, what, _, _ in found]
    for breach, (_, _, east, north) in zip(breaches, found, strict=True):
        lat, lon = place(east or 0.0, north)
        assert breach.lat_deg == pytest.approx(lat, abs=2e-5)
        assert east is None or breach.lon_deg == pytest.approx(lon, abs=2e-5)


def test_several_inclusion_areas_are_all_or_any() -> None:
    two = Fence((box(-10, -10, 500, 100), box(400, -10, 1000, 100)), (FenceCircle(LatLon(*place(1100, 50)), 200.0),))
    leg = straight((0, 50), (900, 50))
    assert len(list(FenceGround(two).breaches(leg))) == 3
    assert list(FenceGround(two, Inclusion.INSIDE_ANY).breaches(leg)) == []
    (breach,) = FenceGround(two, Inclusion.INSIDE_ANY).breaches(straight((0, 50), (1500, 50)))
    assert (round(breach.outside_m), breach.what) == (200, "outside of every inclusion area")


def test_a_route_out_of_its_fence_is_a_problem_at_the_worst_place() -> None:
    report = check_route(mission(UP, at(1300.0, 500.0)), RouteLimits(), fence=Fence((box(-10, -10, 1000, 1000),)))
    (line,) = lines(report)
    assert line.startswith("leg to item 2: 300.0 m outside of fence polygon 0 at 33.00")

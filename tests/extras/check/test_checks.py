import math

import numpy as np
import pytest
import shapely

from mission_io.model.items import (
    Command,
    Fence,
    FenceCircle,
    FencePolygon,
    Frame,
    FramedPoint,
    GeoPoint,
    LatLon,
    Mission,
    MissionItem,
)
from tests.extras.check.worlds import (
    COPTER,
    FRAME,
    HOME_M,
    LAT,
    LON,
    PLANE,
    command,
    home,
    item,
    lat_lon,
    mission,
    ridge_ground,
    up,
    waypoint,
    world,
)  # fmt: skip
from uavcover.errors import InputError
from uavcover.extras.check.check import Checked, CheckRequest, check_mission
from uavcover.extras.check.endurance_checks import flight_time_s
from uavcover.extras.check.flown_path import flown_path
from uavcover.extras.check.return_checks import OwnReturn
from uavcover.extras.check.world import Aircraft, Limits
from uavcover.model.limits import NoFly, Obstacle

HIGH = Aircraft(return_height_m=130.0)
FREE = Limits(max_height_agl_m=None)


def heights(lat: np.ndarray, lon: np.ndarray) -> np.ndarray:
    """Of the ridge, above the sea; there is none 1,400 m away."""
    enu = FRAME.enu_from_geodetic(lat, lon, HOME_M)
    up_m = 100.0 * np.maximum(0.0, 1.0 - np.abs(enu[:, 0] - 400.0) / 50.0)
    return np.where(np.abs(enu[:, :2]).max(axis=1) < 1400.0, HOME_M + up_m, np.nan)


def checked(
    *items: MissionItem, aircraft: Aircraft = HIGH, limits: Limits = FREE, zones=(), whole=None, **more
) -> Checked:
    request = CheckRequest(mission=whole or mission(*items), aircraft=aircraft, limits=limits, **more)
    return check_mission(request, heights, lambda *_: ridge_ground(), lambda _: zones)


def found(outcome: Checked, weight: str = "breaks") -> list[tuple[str, tuple[int, int] | None]]:
    return [(one.kind, one.items) for one in outcome.findings if one.weight == weight]


OVER = (up(), waypoint(300.0, 0.0, 115.0), waypoint(600.0, 0.0, 115.0), home())


def test_a_good_mission_passes() -> None:
    outcome = checked(*OVER)
    assert outcome.verdict == "passed"
    assert found(outcome, "look") == [("sight", (2, 4))]


def test_a_ridge_between_two_points() -> None:
    outcome = checked(up(), waypoint(300.0, 0.0, 60.0), waypoint(500.0, 0.0, 60.0), home())
    (leg, *_) = [one for one in outcome.findings if one.kind == "ground"]
    assert (leg.items, leg.weight) == ((2, 3), "breaks")
    assert leg.by == pytest.approx(50.0, abs=0.1), "40 m in the ridge, 10 m are to be kept"
    position = FRAME.enu_from_geodetic(leg.lat_deg, leg.lon_deg, leg.alt_amsl_m)[0]
    assert position == pytest.approx([400.0, 0.0, 60.0], abs=0.1)


def test_the_band() -> None:
    outcome = checked(*OVER, limits=Limits(max_height_agl_m=112.0, max_above_home_m=114.0))
    assert found(outcome) == [("height", (1, 3)), ("above-home", (1, 4))]


def test_unknown_ground_is_not_proved() -> None:
    outcome = checked(up(), waypoint(-1450.0, 0.0, 60.0), waypoint(-1600.0, 0.0, 60.0), home(), aircraft=COPTER)
    assert outcome.verdict == "not proved"
    assert {kind for kind, _ in found(outcome, "unknown")} == {"no-elevation"}


def fence(*rings: list[tuple[float, float]], inclusion: bool = True) -> Fence:
    return Fence(tuple(FencePolygon(tuple(LatLon(*lat_lon(*at)) for at in ring), inclusion) for ring in rings))


SQUARE = [(-50.0, -50.0), (650.0, -50.0), (650.0, 50.0), (-50.0, 50.0)]
SHORT = [(-50.0, -50.0), (580.0, -50.0), (580.0, 50.0), (-50.0, 50.0)]


def test_fences() -> None:
    assert found(checked(*OVER, fence=fence(SQUARE))) == []
    (beyond,) = [one for one in checked(*OVER, fence=fence(SHORT)).findings if one.kind == "fence"]
    assert beyond.by == pytest.approx(20.0, abs=0.1)
    # ArduPilot wants a place inside every inclusion, PX4 inside any.
    assert ("fence", (2, 4)) in found(checked(*OVER, fence=fence(SQUARE, SHORT)))
    px4 = Aircraft(autopilot="px4", return_height_m=130.0)
    assert found(checked(*OVER, fence=fence(SQUARE, SHORT), aircraft=px4)) == []
    assert ("fence", (2, 4)) in found(checked(*OVER, fence=fence(SHORT), aircraft=px4))


@pytest.mark.parametrize("corners", [0, 1, 2])
def test_a_polygon_of_fewer_than_three_corners_is_refused(corners: int) -> None:
    with pytest.raises(InputError, match=f"polygon 1 has {corners} of the at least 3 corners"):
        checked(*OVER, fence=fence(SQUARE, SHORT[:corners]))


def test_fences_of_circles_and_holes() -> None:
    def circle(east_m: float, north_m: float, radius_m: float, inclusion: bool) -> Fence:
        return Fence(circles=(FenceCircle(LatLon(*lat_lon(east_m, north_m)), radius_m, inclusion),))

    assert found(checked(*OVER, fence=circle(0.0, 0.0, 601.0, True))) == []
    (beyond,) = [one for one in checked(*OVER, fence=circle(0.0, 0.0, 590.0, True)).findings if one.kind == "fence"]
    assert beyond.by == pytest.approx(10.0, abs=0.1)
    # Its middle is beside the leg, between its ends.
    (within,) = [one for one in checked(*OVER, fence=circle(450.0, 20.0, 30.0, False)).findings if one.kind == "fence"]
    assert within.by == pytest.approx(10.0, abs=0.1)
    assert found(checked(*OVER, fence=circle(450.0, 31.0, 30.0, False))) == []
    hole = fence([(440.0, -5.0), (460.0, -5.0), (460.0, 5.0), (440.0, 5.0)], inclusion=False)
    assert ("fence", (2, 4)) in found(checked(*OVER, fence=hole))


def test_a_take_off_outside_of_the_fence() -> None:
    aside = fence([(50.0, -50.0), (650.0, -50.0), (650.0, 50.0), (50.0, 50.0)])
    hole = fence([(-20.0, -20.0), (20.0, -20.0), (20.0, 20.0), (-20.0, 20.0)], inclusion=False)
    for where, by_m in ((aside, 50.0), (hole, 20.0)):
        (column,) = [one for one in checked(up(50.0), home(), fence=where).findings if one.kind == "fence"]
        assert (column.items, column.by) == ((0, 2), pytest.approx(by_m, abs=0.1))


def zone(floor_agl_m: float | None, ceiling_amsl_m: float | None) -> NoFly:
    corners = [lat_lon(*at)[::-1] for at in ((440.0, -5.0), (460.0, -5.0), (460.0, 5.0), (440.0, 5.0))]
    return NoFly(polygon_lon_lat_deg=tuple(corners), floor_agl_m=floor_agl_m, ceiling_amsl_m=ceiling_amsl_m, name="Z")


@pytest.mark.parametrize(
    ("floor_agl_m", "ceiling_amsl_m", "enters"),
    [(None, None, True), (116.0, None, False), (None, 814.0, False), (100.0, 820.0, True)],
)
def test_no_fly_zones_have_floor_and_ceiling(floor_agl_m: float, ceiling_amsl_m: float, enters: bool) -> None:
    outcome = checked(*OVER[:3], zones=(zone(floor_agl_m, ceiling_amsl_m),))
    assert (("no-fly", (2, 3)) in found(outcome)) == enters


def test_legs_through_one_zone_are_one_finding() -> None:
    legs = [waypoint(430.0 + 5.0 * k, 0.0, 115.0) for k in range(9)]
    near = NoFly(center_lon_lat_deg=lat_lon(450.0, 8.0)[::-1], radius_m=9.0, name="N")
    outcome = checked(OVER[0], *legs, zones=(zone(None, None), near))
    assert [one for one in found(outcome) if one[0] == "no-fly"] == [("no-fly", (4, 8)), ("no-fly", (5, 7))]


def test_a_return_behind_a_ridge() -> None:
    outcome = checked(
        *OVER[:3], waypoint(600.0, 100.0, 60.0), item(Command.NAV_LAND, 600.0, 100.0, 0.0), aircraft=COPTER
    )
    assert found(outcome) == [("return", (3, 4))]
    assert found(checked(*OVER[:3], waypoint(600.0, 100.0, 60.0), item(Command.NAV_LAND, 600.0, 100.0, 0.0))) == []


L_SHAPE = [(-50.0, -50.0), (650.0, -50.0), (650.0, 400.0), (560.0, 400.0), (560.0, 50.0), (-50.0, 50.0)]


def test_a_return_out_of_the_fence_and_into_a_zone() -> None:
    """A place in the arm of an L: the legs keep to the fence, the straight return cuts the corner."""
    legs = (*OVER[:3], waypoint(600.0, 350.0, 115.0), waypoint(600.0, 0.0, 115.0), home())
    outcome = checked(*legs, fence=fence(L_SHAPE))
    assert found(outcome) == [("return-fence", (3, 5))]
    (out,) = [one for one in outcome.findings if one.kind == "return-fence"]
    # From (600, 350) the line passes the bay's corner (560, 50), which is farthest from the fence at about (400, 233).
    assert 100.0 < out.by < 250.0
    assert found(checked(*legs, fence=fence(SQUARE)))[0][0] == "fence"

    def zone_at(north_m: float, **heights: float) -> NoFly:
        ring = [(240.0, north_m - 20.0), (260.0, north_m - 20.0), (260.0, north_m + 20.0), (240.0, north_m + 20.0)]
        return NoFly(polygon_lon_lat_deg=tuple(lat_lon(*at)[::-1] for at in ring), name="Z", **heights)

    # Out and back past the place from where the zone is in the way: two intervals.
    assert found(checked(*legs, zones=(zone_at(100.0),))) == [("return-no-fly", (3, 4)), ("return-no-fly", (4, 5))]
    assert found(checked(*legs, zones=(zone_at(300.0),))) == []
    assert found(checked(*legs, zones=(zone_at(100.0, floor_agl_m=140.0),))) == []
    # Above the leg, below the return altitude: the climb enters it.
    over_the_leg = zone_at(0.0, floor_agl_m=120.0, ceiling_agl_m=128.0)
    assert ("return-no-fly", (1, 2)) in found(checked(*OVER, zones=(over_the_leg,)))


def test_a_leg_out_of_a_convex_fence_is_told_once() -> None:
    """Found by scripts/attack/faulty_missions.py --seed 7: a return from outside the fence counted as one that leaves it."""
    assert found(checked(*OVER, fence=fence(SHORT))) == [("fence", (2, 4))]


def test_obstacles() -> None:
    def tower(height_m: float, east_m: float = 480.0, north_m: float = 0.0) -> Obstacle:
        ring = [(-5.0, -5.0), (5.0, -5.0), (5.0, 5.0), (-5.0, 5.0), (-5.0, -5.0)]
        corners = tuple(lat_lon(east_m + x, north_m + y)[::-1] for x, y in ring)
        return Obstacle(height_m=height_m, rings_lon_lat_deg=(corners,), name="mast")

    assert found(checked(*OVER, obstacles=(tower(100.0),))) == []
    (near, *_) = [one for one in checked(*OVER, obstacles=(tower(108.0),)).findings if one.weight == "breaks"]
    assert (near.kind, near.items) == ("obstacle", (2, 3))
    assert near.by == pytest.approx(3.0, abs=0.1), "the leg is 7 m above its top"
    assert "mast" in near.what
    position = FRAME.enu_from_geodetic(near.lat_deg, near.lon_deg, near.alt_amsl_m)[0]
    assert abs(position[0] - 480.0) < 16.0
    # Beside: 12 m away is room enough, 8 m is not.
    assert found(checked(*OVER, obstacles=(tower(300.0, north_m=17.0),))) == []
    assert ("obstacle", (2, 4)) in found(checked(*OVER, obstacles=(tower(300.0, north_m=13.0),)))
    free = Limits(max_height_agl_m=None, obstacle_clearance_m=7.0)
    assert found(checked(*OVER, obstacles=(tower(300.0, north_m=13.0),), limits=free)) == []
    # Only the return, 130 m above home, comes near to a tower that no leg passes.
    there = (*OVER[:3], waypoint(600.0, 350.0, 115.0), waypoint(600.0, 0.0, 115.0), home())
    assert found(checked(*there, obstacles=(tower(125.0, 300.0, 175.0),))) == [("return-obstacle", (3, 5))]


def test_distance_from_home() -> None:
    assert found(checked(*OVER, limits=Limits(max_height_agl_m=None, max_distance_m=550.0))) == [("distance", (2, 4))]


def test_sight_from_another_place() -> None:
    on_the_ridge = lat_lon(400.0, 0.0)
    assert found(checked(*OVER, pilot=on_the_ridge), "look") == []


def test_a_battery_and_the_wind() -> None:
    seconds = checked(*OVER).time_s
    assert seconds > (2.0 * 600.0) / 10.0 + 130.0 / 2.5
    import dataclasses

    tired = dataclasses.replace(HIGH, endurance_s=seconds / 0.8 - 1.0)
    assert found(checked(*OVER, aircraft=tired)) == [("battery", None)]
    fresh = dataclasses.replace(HIGH, endurance_s=seconds / 0.8 + 1.0)
    assert found(checked(*OVER, aircraft=fresh)) == []
    slow = dataclasses.replace(fresh, max_airspeed_m_s=12.0)
    windy = Limits(max_height_agl_m=None, wind_m_s=8.0)
    assert found(checked(*OVER, aircraft=slow, limits=windy)) == [("battery", None)]
    storm = Limits(max_height_agl_m=None, wind_m_s=12.0)
    assert found(checked(*OVER, aircraft=slow, limits=storm)) == [("wind", None)]
    # Of an aircraft whose largest speed nobody knows the question stays open, and the battery is judged without wind.
    unknown = checked(*OVER, aircraft=tired, limits=storm)
    assert (found(unknown), found(unknown, "unknown")) == ([("battery", None)], [("wind", None)])
    assert checked(*OVER, aircraft=fresh, limits=storm).verdict == "not proved"


def test_time_of_wings_in_wind() -> None:
    path = flown_path(mission(up(50.0), waypoint(900.0, 0.0, 50.0)), world(), PLANE)
    climb_s = 50.0 / PLANE.max_climb_m_s
    assert flight_time_s(path, PLANE, 0.0) == pytest.approx(climb_s + 900.0 / 15.0, rel=1e-3)
    assert flight_time_s(path, PLANE, 5.0) == pytest.approx(climb_s + 900.0 / 10.0, rel=1e-3)
    assert math.isinf(flight_time_s(path, PLANE, 16.0))


def test_wings_need_room() -> None:
    steep = checked(up(), waypoint(200.0, 0.0, 115.0), waypoint(220.0, 0.0, 180.0), home(), aircraft=PLANE)
    assert ("climb", (2, 3)) in found(steep)
    back = checked(
        up(),
        waypoint(300.0, 0.0, 115.0),
        waypoint(320.0, 0.0, 115.0),
        waypoint(300.0, 10.0, 115.0),
        home(),
        aircraft=PLANE,
    )
    assert ("turn", (3, 4)) in found(back, "look")


@pytest.mark.parametrize("swap", [(2,), (2, 3)])
def test_swapped_axes_of_items(swap: tuple[int, ...]) -> None:
    import dataclasses

    items = [
        dataclasses.replace(one, lat_deg=one.lon_deg, lon_deg=one.lat_deg) if number in swap else one
        for number, one in enumerate(OVER, 1)
    ]
    outcome = checked(*items)
    wrong = [one for one in outcome.findings if one.kind == "place"]
    assert [one.items for one in wrong] == [(number, number) for number in swap]
    assert all("swapped" in one.what for one in wrong)


def test_everything_swapped_or_elsewhere() -> None:
    swapped = checked(whole=Mission(GeoPoint(LON, LAT, 0.0), OVER))
    assert [one.what for one in swapped.findings] == ["latitude and longitude of home seem to be swapped"]
    assert swapped.verdict == "failed"
    beside = checked(whole=Mission(GeoPoint(LAT + 1.0, LON, 0.0), OVER))
    assert "outside the elevation data" in beside.findings[0].what
    far = checked(whole=Mission(GeoPoint(-LAT, LON, 0.0), (MissionItem(16, Frame.AMSL, (0.0,) * 4, -LAT, LON, 50.0),)))
    assert "the mission lies outside the elevation data" in far.findings[0].what


def test_places_that_nobody_means() -> None:
    at_zero = MissionItem(16, Frame.ABOVE_HOME, (0.0,) * 4, 0.0, 0.0, 115.0)
    assert ("place", (2, 2)) in found(checked(up(), at_zero, *OVER[1:]), "look")
    far = MissionItem(16, Frame.ABOVE_HOME, (0.0,) * 4, LAT + 2.0, LON, 50.0)
    assert ("place", (3, 3)) in found(checked(*OVER[:2], far, *OVER[2:]))
    no_home = checked(whole=Mission(None, OVER))
    assert ("home", (0, 0)) in found(no_home, "look")
    high = checked(whole=Mission(GeoPoint(LAT, LON, HOME_M + 50.0), OVER))
    assert ("home", (0, 0)) in found(high, "look")
    nothing = checked(whole=Mission(None, (home(),)))
    assert nothing.verdict == "not proved"


@pytest.mark.parametrize(
    ("made", "word"),
    [
        (lambda e, h: waypoint(e, 0.0, h + HOME_M), "height above sea level"),
        (lambda e, h: waypoint(e, 0.0, h, Frame.AMSL), "height above home"),
        (lambda e, h: waypoint(e, 0.0, h / 0.3048), "feet"),
    ],
)
def test_why_heights_may_be_wrong(made, word: str) -> None:
    limits = Limits(max_height_agl_m=120.0)
    outcome = checked(up(), made(300.0, 115.0), made(500.0, 115.0), home(), limits=limits)
    reported = [one.what for one in outcome.findings if one.kind in ("ground", "height")]
    assert any(word in what for what in reported), reported


def test_heights_above_terrain_are_not_for_px4() -> None:
    px4 = Aircraft(autopilot="px4", return_height_m=130.0)
    low = waypoint(300.0, 0.0, 50.0, Frame.ABOVE_TERRAIN)
    assert ("frame", (2, 2)) in found(checked(up(), low, home(), aircraft=px4))
    assert ("frame", (2, 2)) in found(checked(up(), low, home()), "look")


def test_every_finding_says_what_to_do() -> None:
    outcome = checked(up(), waypoint(300.0, 0.0, 60.0), waypoint(500.0, 0.0, 60.0), home(), fence=fence(SHORT))
    assert all(one.what and one.do for one in outcome.findings)
    assert (
        shapely.Point(LON, LAT).distance(shapely.Point(outcome.findings[0].lon_deg, outcome.findings[0].lat_deg)) < 0.1
    )


@pytest.mark.parametrize(
    "made",
    [
        waypoint(300.0, 0.0, 1e9),
        item(Command.NAV_LOITER_TURNS, 300.0, 0.0, 115.0, params=(1e6, 0.0, 20.0, 0.0)),
        item(Command.NAV_LOITER_TURNS, 300.0, 0.0, 115.0, params=(1.0, 0.0, -1e9, 0.0)),
        command(Command.DO_CHANGE_SPEED, 1.0, 1e9),
    ],
)
def test_numbers_that_nobody_flies_are_told_at_once(made: MissionItem) -> None:
    assert found(checked(up(), made, home())) == [("number", (2, 2))]


def test_what_a_stranger_would_write() -> None:
    import dataclasses

    battery = dataclasses.replace(HIGH, endurance_s=1200.0)
    assert ("jump", (3, 3)) in found(checked(*OVER[:2], command(Command.DO_JUMP, 2.0, math.nan), home()))
    at_two = command(Command.NAV_DELAY, -1.0, 14.0, 0.0, 0.0)
    assert checked(*OVER[:2], at_two, home(), aircraft=battery).verdict == "not proved"
    assert ("battery", None) in found(checked(*OVER[:2], command(Command.NAV_DELAY, 1e9), home(), aircraft=battery))
    reversed_hole = fence([(440.0, -5.0), (440.0, 5.0), (460.0, 5.0), (460.0, -5.0)], inclusion=False)
    assert ("fence", (2, 4)) in found(checked(*OVER, fence=reversed_hole))
    assert found(checked(*OVER, fence=fence(SQUARE[::-1]))) == []
    aside = Fence(circles=(FenceCircle(LatLon(*lat_lon(450.0, 31.0)), 30.0, False),))
    assert found(checked(*OVER, fence=aside)) == []
    deep = checked(up(), waypoint(300.0, 0.0, -400.0), home())
    assert ("ground", (1, 2)) in found(deep)
    mixed = (up(), waypoint(300.0, 0.0, 115.0), waypoint(500.0, 0.0, HOME_M + 40.0, Frame.AMSL), home())
    assert ("ground", (2, 3)) in found(checked(*mixed))
    splines = (up(115.0), *(item(Command.NAV_SPLINE_WAYPOINT, east, 0.0, 115.0) for east in (300.0, 600.0)))
    assert found(checked(*splines)) == []


def rally_outcome(*points: FramedPoint, parameters=None, fenced=None, legs=None, aircraft=HIGH) -> Checked:
    own = OwnReturn(parameters=parameters or {}, rally=points)
    return checked(*(legs or OVER), fence=fenced, own_return=own, aircraft=aircraft)


def rally_at(east_m: float, north_m: float, alt_m: float, frame: Frame = Frame.ABOVE_HOME) -> FramedPoint:
    return FramedPoint(*lat_lon(east_m, north_m), alt_m, frame)


def rally_words(outcome: Checked) -> list[str]:
    return [one.what for one in outcome.findings if one.kind == "rally"]


def test_a_rally_point_inside_a_ridge() -> None:
    outcome = rally_outcome(rally_at(400.0, 100.0, -40.0))
    assert rally_words(outcome) == ["rally point 1: it is 140 m below the ground"]
    assert outcome.verdict == "failed"
    assert rally_words(rally_outcome(rally_at(400.0, 100.0, 100.0))) == []


def test_a_rally_point_whose_height_above_the_sea_is_taken_as_one_above_home() -> None:
    limits = Limits(max_height_agl_m=120.0)
    own = OwnReturn(parameters={}, rally=(rally_at(200.0, 0.0, 705.0),))
    outcome = checked(*OVER, limits=limits, own_return=own)
    assert rally_words(outcome) == [
        "rally point 1: 705 m above home is 705 m above ground; the value seems to be a height above sea level"
    ]
    own = OwnReturn(parameters={}, rally=(rally_at(200.0, 0.0, 705.0, Frame.AMSL),))
    assert rally_words(checked(*OVER, limits=limits, own_return=own)) == []


def test_a_rally_point_outside_the_fence() -> None:
    outcome = rally_outcome(rally_at(200.0, 500.0, 20.0), fenced=fence(SQUARE))
    assert any("outside the fence" in words for words in rally_words(outcome))


def test_a_rally_point_behind_a_ridge() -> None:
    """Nearer than home, with a ridge in between: the way there hits it at a height at which the way home is clear."""
    legs = (up(), waypoint(300.0, 0.0, 60.0), waypoint(300.0, 200.0, 60.0), waypoint(0.0, 0.0, 60.0), home())
    low = Aircraft(return_height_m=60.0)
    behind = rally_at(520.0, 0.0, 30.0)
    assert found(rally_outcome(legs=legs, aircraft=low)) == []
    outcome = rally_outcome(behind, legs=legs, aircraft=low)
    returns = [one.what for one in outcome.findings if one.kind == "return"]
    assert returns
    assert all("to rally point 1" in words for words in returns)
    assert "below the ground" in returns[0]
    # ArduCopter flies to none that is farther away than RALLY_LIMIT_KM.
    assert found(rally_outcome(behind, legs=legs, aircraft=low, parameters={"RALLY_LIMIT_KM": 0.1})) == []


def test_issue_31968_a_final_height_above_home_is_in_the_ground_of_a_higher_rally_point() -> None:
    legs = (up(), waypoint(300.0, 0.0, 115.0), waypoint(0.0, 0.0, 115.0), home())
    on_top = rally_at(400.0, 0.0, 105.0)
    parameters = {"RTL_ALT_FINAL": 1000.0}
    outcome = rally_outcome(on_top, legs=legs, parameters=parameters)
    (sunk,) = [one for one in outcome.findings if one.kind == "return"]
    assert "descends 90.0 m below the ground at flying speed" in sunk.what
    assert found(rally_outcome(on_top, legs=legs)) == []

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from mission_io.model.items import Command, Frame, FramedPoint, MissionItem
from tests.extras.check.worlds import COPTER, PLANE, command, home, item, lat_lon, mission, up, waypoint, world
from uavcover.extras.check.findings import FlownPath
from uavcover.extras.check.flown_path import flown_path
from uavcover.extras.check.item_checks import order_of
from uavcover.extras.check.return_checks import OwnReturn
from uavcover.extras.check.world import Aircraft, default_aircraft

PX4 = Aircraft(autopilot="px4", return_height_m=60.0)


def flown(*items: MissionItem, aircraft: Aircraft = COPTER) -> FlownPath:
    return flown_path(mission(*items), world(), aircraft)


def ends(path: FlownPath) -> list[tuple[float, float, float]]:
    alts = [world().alts_amsl_m(segment.enu_m[-1:])[0] - 700.0 for segment in path.segments]
    return [(*np.round(s.enu_m[-1, :2], 2), round(float(alt), 1)) for s, alt in zip(path.segments, alts, strict=True)]


def test_a_whole_flight() -> None:
    path = flown(up(50.0), waypoint(200.0, 100.0, 80.0), home())
    assert ends(path) == [(0, 0, 50), (200, 100, 80), (0, 0, 80), (0, 0, 0)]
    assert [segment.phase for segment in path.segments] == ["take-off", "route", "return", "landing"]
    assert path.findings == ()


def test_legs_keep_their_height_above_the_sea() -> None:
    path = flown(up(50.0), waypoint(1400.0, 0.0, 50.0))
    alts = world().alts_amsl_m(path.segments[1].enu_m)
    assert alts == pytest.approx(750.0, abs=1e-6)


def test_frames() -> None:
    path = flown(up(), waypoint(100.0, 0.0, 790.0, Frame.AMSL), waypoint(400.0, 0.0, 40.0, Frame.ABOVE_TERRAIN))
    assert ends(path)[1:] == [(100, 0, 90), (400, 0, 140)]
    # Over the plain and up the ridge it keeps its height above the ground, which changes evenly.
    leg = path.segments[2]
    heights = world().ground.heights_agl_m(leg.enu_m)
    assert heights == pytest.approx(np.linspace(90.0, 40.0, len(heights)), abs=0.01)
    assert not leg.is_straight


@pytest.mark.parametrize("aircraft", [COPTER, PX4])
def test_zeros_mean_what_was_there_before(aircraft: Aircraft) -> None:
    held = MissionItem(Command.NAV_WAYPOINT, Frame.ABOVE_HOME, (3.0, 0.0, 0.0, 0.0), alt_m=70.0)
    path = flown(up(), waypoint(100.0, 0.0, 60.0), held, waypoint(200.0, 0.0, 0.0), aircraft=aircraft)
    assert ends(path)[2] == (100, 0, 70)
    assert path.segments[2].wait_s == 3.0
    assert ends(path)[3] == (200, 0, 70 if aircraft is COPTER else 0)


def test_only_px4_flies_to_the_place_of_a_take_off() -> None:
    away = item(Command.NAV_TAKEOFF, 50.0, 0.0, 40.0)
    assert ends(flown(away, home()))[0] == (0, 0, 40)
    assert ends(flown(away, home(), aircraft=PX4))[:2] == [(0, 0, 40), (50, 0, 40)]


def test_splines_begin_and_end_along_their_neighbours() -> None:
    curve = item(Command.NAV_SPLINE_WAYPOINT, 200.0, 100.0, 60.0)
    path = flown(up(), waypoint(100.0, 0.0, 60.0), curve, waypoint(200.0, 300.0, 60.0), home())
    spline = path.segments[2].enu_m
    first, last = spline[1] - spline[0], spline[-1] - spline[-2]
    assert abs(first[1]) < 0.05 * first[0], "begins along the leg before it, to the east"
    assert abs(last[0]) < 0.05 * last[1], "ends along the leg after it, to the north"
    # With a wait at the waypoint before it, it begins at rest, along the curve itself.
    waits = MissionItem(Command.NAV_WAYPOINT, Frame.ABOVE_HOME, (5.0, 0.0, 0.0, 0.0), *_position(100.0, 0.0), 60.0)
    spline = flown(up(), waits, curve, waypoint(200.0, 300.0, 60.0), home()).segments[2].enu_m
    assert (spline[2] - spline[0])[1] < (spline[-1] - spline[-3])[1]
    assert flown(up(), curve, home(), aircraft=PX4).findings[0].kind == "meaning"


def _position(east_m: float, north_m: float) -> tuple[float, float]:
    position = waypoint(east_m, north_m, 0.0)
    return position.lat_deg, position.lon_deg


def test_circles() -> None:
    turns = item(Command.NAV_LOITER_TURNS, 200.0, 0.0, 60.0, params=(2.0, 0.0, -30.0, 0.0))
    path = flown(up(), turns, home())
    assert ends(path)[1] == (170, 0, 60), "flies to the edge that is nearest"
    assert np.hypot(*(path.segments[2].enu_m[:, :2] - [200.0, 0.0]).T) == pytest.approx(30.0, rel=1e-3)
    waits = item(Command.NAV_LOITER_TIME, 200.0, 0.0, 60.0, params=(20.0, 0.0, 0.0, 0.0))
    assert flown(up(), waits, home()).segments[1].wait_s == 20.0
    assert flown(waits, aircraft=PLANE).segments[1].enu_m[:, 0].max() == pytest.approx(260.0, rel=1e-3)


def test_landing_is_level_and_then_straight_down() -> None:
    path = flown(up(50.0), waypoint(300.0, 0.0, 80.0), item(Command.NAV_LAND, 300.0, 100.0, 0.0))
    assert ends(path)[2:] == [(300, 100, 80), (300, 100, 0)]
    wings = flown(up(50.0), waypoint(300.0, 0.0, 80.0), item(Command.NAV_LAND, 300.0, 300.0, 0.0), aircraft=PLANE)
    assert ends(wings)[-1] == (300, 300, 0)
    assert wings.segments[-1].enu_m[:, 1].min() == pytest.approx(0.0, abs=0.01)


def test_what_follows_the_end_is_flown_only_after_another_take_off() -> None:
    assert len(flown(up(), home(), waypoint(900.0, 0.0, 50.0)).segments) == 2
    again = flown(up(), item(Command.NAV_LAND, 0.0, 0.0, 0.0), up(), waypoint(200.0, 0.0, 50.0), home())
    assert (200, 0, 50) in ends(again)
    lands = (command(Command.DO_LAND_START), item(Command.NAV_LAND, 300.0, 0.0, 0.0))
    assert ends(flown(up(), home(), *lands, aircraft=PLANE))[-1] == (300, 0, 0)


def test_speeds_and_delays() -> None:
    path = flown(
        up(), command(Command.DO_CHANGE_SPEED, 1.0, 4.0), command(Command.NAV_DELAY, 12.0), waypoint(9.0, 0.0, 50.0)
    )
    assert (path.segments[1].speed_m_s, path.segments[1].wait_s) == (4.0, 12.0)


@pytest.mark.parametrize(
    ("height_m", "distance_m", "copter_m", "px4_m"),
    [(20.0, 500.0, 60.0, 60.0), (80.0, 500.0, 80.0, 80.0), (1.0, 11.0, 33.0, 60.0), (1.0, 5.0, 15.0, 5.0)],
)
def test_returns_are_lower_near_home(height_m: float, distance_m: float, copter_m: float, px4_m: float) -> None:
    assert top_of_return_m(height_m, distance_m, COPTER) == copter_m
    assert top_of_return_m(height_m, distance_m, PX4) == px4_m


def top_of_return_m(
    height_m: float, distance_m: float, aircraft: Aircraft, parameters: Mapping[str, float] | None = None
) -> float:
    own = OwnReturn(parameters=parameters or {})
    path = flown_path(mission(up(height_m), waypoint(distance_m, 0.0, height_m), home()), world(), aircraft, own)
    return max(height for (_, _, height), one in zip(ends(path), path.segments, strict=True) if one.phase == "return")


def test_returns_by_other_parameters() -> None:
    assert top_of_return_m(1.0, 10.0, COPTER, {"RTL_CONE_SLOPE": 0.0}) == 60.0
    assert top_of_return_m(1.0, 10.0, COPTER, {"RTL_CONE_SLOPE": 1.0}) == 10.0
    assert top_of_return_m(80.0, 10.0, replace(PLANE, return_height_m=-1.0)) == 80.0


RALLY = FramedPoint(*lat_lon(200.0, 0.0), 90.0, Frame.ABOVE_HOME)
"""Nearer to the last waypoint than home."""


@pytest.mark.parametrize(
    ("aircraft", "parameters", "end"),
    [
        (COPTER, {}, [(300, 0, 90), (200, 0, 90), (200, 0, 0)]),
        (COPTER, {"RALLY_LIMIT_KM": 0.05}, [(300, 0, 60), (0, 0, 60), (0, 0, 0)]),
        (COPTER, {"RTL_ALT_FINAL": 2000.0}, [(300, 0, 90), (200, 0, 90), (200, 0, 20)]),
        (PX4, {}, [(300, 0, 150), (200, 0, 150), (200, 0, 0)]),
        (replace(PLANE, return_height_m=60.0), {}, [(200, 0, 70)]),  # it climbs at 3 of 15 m/s, and circles there
    ],
)
def test_a_return_of_the_mission_ends_at_a_rally_point(
    aircraft: Aircraft, parameters: dict[str, float], end: list[tuple[float, float, float]]
) -> None:
    """It was flown home, whatever rally points the vehicle had."""
    items = mission(up(50.0), waypoint(300.0, 0.0, 50.0), home())
    path = flown_path(items, world(), aircraft, OwnReturn(parameters=parameters, rally=(RALLY,)))
    assert ends(path)[2:] == end


def test_a_return_along_the_mission_is_not_known() -> None:
    items = mission(up(50.0), waypoint(300.0, 0.0, 50.0), home())
    for kind, unknown in ((0, False), (1, False), (2, True), (4, True)):
        path = flown_path(items, world(), PX4, OwnReturn(parameters={"RTL_TYPE": float(kind)}))
        assert bool(path.findings) == unknown, kind
        assert all((one.kind, one.weight) == ("meaning", "unknown") for one in path.findings)


def kinds(path: FlownPath) -> list[str]:
    return [one.kind for one in path.findings]


def test_what_items_themselves_show() -> None:
    assert kinds(flown(waypoint(100.0, 0.0, 50.0))) == ["take-off", "end"]
    assert kinds(flown(command(Command.DO_CHANGE_SPEED, 1.0, 4.0))) == ["empty"]
    assert kinds(flown(up(), item(Command.NAV_LOITER_UNLIM, 100.0, 0.0, 50.0), home())) == ["endless"]
    assert kinds(flown(up(), MissionItem(30, Frame.ABOVE_HOME, (0.0,) * 4, *_position(5.0, 5.0), 60.0), home())) == [
        "meaning"
    ]


@pytest.mark.parametrize(
    ("number", "first", "reported"),
    [
        (92, 1.0, "another controller"),
        (92, 0.0, None),
        (42702, 1.0, "another controller"),
        (94, 0.0, "no position"),
        (80, 0.0, None),
    ],
)
def test_items_that_let_others_fly_or_have_no_place_are_told(number: int, first: float, reported: str | None) -> None:
    path = flown(up(), MissionItem(number, Frame.ABOVE_HOME, (first, 0.0, 0.0, 0.0), 0.0, 0.0, 0.0), home())
    assert [one.weight for one in path.findings] == ([] if reported is None else ["unknown"])
    assert all(reported is not None and reported in one.what for one in path.findings)


def test_a_region_of_interest_is_looked_at_and_not_flown_to() -> None:
    position = MissionItem(80, Frame.ABOVE_HOME, (0.0,) * 4, *_position(500.0, 500.0), 60.0)
    assert len(flown(up(), position, home()).segments) == len(flown(up(), home()).segments)


@pytest.mark.parametrize(
    ("jump", "numbers", "kind"),
    [
        ((2.0, 2.0), [1, 2, 3, 2, 3, 2, 3, 5], None),
        ((2.0, 0.0), [1, 2, 3, 5], None),
        ((5.0, 1.0), [1, 2, 3, 5], None),
        ((2.0, -1.0), [1, 2, 3, 2, 3, 2, 3, 5], "endless"),
        ((9.0, 1.0), [1, 2, 3, 5], "jump"),
        ((0.5, 1.0), [1, 2, 3, 5], "jump"),
        ((float("nan"), 1.0), [1, 2, 3, 5], "jump"),
    ],
)
def test_jumps(jump: tuple[float, float], numbers: list[int], kind: str | None) -> None:
    items = [up(), waypoint(1.0, 0.0, 50.0), waypoint(2.0, 0.0, 50.0), command(Command.DO_JUMP, *jump), home()]
    order = order_of(items)
    assert list(order.numbers) == numbers
    assert [one.kind for one in order.findings] == ([] if kind is None else [kind])


def test_a_jump_that_repeats_for_ever_is_cut_off() -> None:
    items = [waypoint(1.0, 0.0, 50.0), command(Command.DO_JUMP, 1.0, 1e9)]
    order = order_of(items)
    assert len(order.numbers) <= 20_001
    assert [(one.kind, one.weight) for one in order.findings] == [("endless", "unknown")]
    empty = order_of([command(Command.DO_JUMP, 1.0, 1e9)])
    assert empty.numbers == ()


def test_an_inner_loop_is_repeated_by_ardupilot_alone() -> None:
    inner, outer = command(Command.DO_JUMP, 1.0, 2.0), command(Command.DO_JUMP, 1.0, 1.0)
    items = [waypoint(1.0, 0.0, 50.0), inner, waypoint(2.0, 0.0, 50.0), outer]
    assert list(order_of(items).numbers) == [1, 1, 1, 3, 1, 1, 1, 3]
    assert list(order_of(items, "px4").numbers) == [1, 1, 1, 3, 1, 3]


@pytest.mark.parametrize("condition", [Command.CONDITION_DELAY, Command.CONDITION_DISTANCE])
def test_a_speed_behind_a_condition_is_not_proved(condition: Command) -> None:
    slow, none = command(Command.DO_CHANGE_SPEED, 1.0, 2.0), command(condition, 0.0)
    path = flown(up(), waypoint(1.0, 0.0, 50.0), command(condition, 20.0), slow, waypoint(2.0, 0.0, 50.0), slow, home())
    assert [(one.kind, one.weight, one.items) for one in path.findings] == [("meaning", "unknown", (4, 4))]
    assert flown(up(), none, slow, waypoint(2.0, 0.0, 50.0), home()).findings == ()


def test_jumps_to_tags() -> None:
    items = [command(600, 7.0), waypoint(1.0, 0.0, 50.0), command(601, 7.0, 1.0)]
    assert list(order_of(items).numbers) == [1, 2, 1, 2]
    (lost,) = order_of([waypoint(1.0, 0.0, 50.0), command(601, 8.0, 2.0)]).findings
    assert lost.what == "a jump to tag 8, 2 times; no item of the mission has this tag"


def test_a_delay_of_px4_is_not_proved() -> None:
    """PX4 1.17 flew 34 and 38 m below the leg after it."""
    items = mission(up(), command(Command.NAV_DELAY, 5.0), waypoint(9.0, 0.0, 50.0))
    px4 = flown_path(items, world(), default_aircraft("px4", "multirotor"))
    reported = [(one.kind, one.weight, one.items) for one in px4.findings if "DELAY" in one.what]
    assert reported == [("meaning", "unknown", (2, 2))]
    assert not [one for one in flown_path(items, world(), COPTER).findings if "DELAY" in one.what]

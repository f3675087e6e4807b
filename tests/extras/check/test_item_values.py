"""Items whose values do nothing or not what was meant, and items that change what is flown."""

import dataclasses
import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mission_io.model.items import LAST_NAVIGATION, Command, Frame, MissionItem
from tests.extras.check.test_checks import HIGH, OVER, checked
from tests.extras.check.worlds import COPTER, HOME_M, LAT, LON, PLANE, command, home, item, mission, up, waypoint, world
from uavcover.extras.check.flown_path import flown_path
from uavcover.extras.check.item_checks import DEFINED, impossible_numbers, value_findings
from uavcover.extras.check.world import Aircraft

PX4 = Aircraft(autopilot="px4", return_height_m=130.0)
TURNS = Command.NAV_LOITER_TURNS


def circle(turns: float, radius_m: float) -> MissionItem:
    return item(TURNS, 100.0, 0.0, 60.0, params=(turns, 0.0, radius_m, 0.0))


def reported(one: MissionItem, aircraft: Aircraft = COPTER, *more: MissionItem) -> list[tuple[str, str]]:
    flight = mission(up(), one, *more)
    return [(found.weight, found.what) for found in value_findings(flight, aircraft, flight.home)]


@pytest.mark.parametrize(
    ("one", "aircraft", "weight", "word"),
    [
        (command(178, 1.0, 0.0), COPTER, "look", "changes nothing"),
        (command(178, 1.0, 0.0), PX4, "look", "default"),
        (command(178, 1.0, -5.0), PLANE, "look", "minimum ground speed"),
        (command(178, 7.0, 5.0), COPTER, "look", "not a speed"),
        (command(178, 1.0, math.nan), COPTER, "unknown", "states no speed"),
        (command(93, -5.0, -1.0, -1.0, -1.0), COPTER, "look", "not a valid time"),
        (command(112, -5.0), COPTER, "look", "not a valid time"),
        (circle(0.0, 20.0), COPTER, "look", "0 turns"),
        (circle(-2.0, 20.0), COPTER, "breaks", "-2 turns"),
        (circle(300.0, 20.0), COPTER, "breaks", "keeps only 255"),
        (item(Command.NAV_LOITER_TIME, 100.0, 0.0, 60.0, params=(7e4, 0.0, 0.0, 0.0)), COPTER, "breaks", "keeps only 65535"),
        (circle(2.0, 3000.0), COPTER, "breaks", "keeps only 2550 m"),
        (dataclasses.replace(waypoint(100.0, 0.0, 60.0), frame=Frame.COMMAND), COPTER, "breaks", "frame 2"),
        (MissionItem(Command.NAV_TAKEOFF, Frame.COMMAND, alt_m=40.0), COPTER, "breaks", "frame 2"),
        (MissionItem(179, Frame.ABOVE_HOME, (0.0, 0.0, 0.0, 0.0), LAT + 0.01, LON, 0.0), COPTER, "unknown", "moves home"),
        (MissionItem(179, Frame.AMSL, (0.0, 0.0, 0.0, 0.0), LAT, LON, HOME_M + 30.0), COPTER, "unknown", "moves home"),
        (command(179, 1.0), COPTER, "unknown", "moves home"),
        (command(176, 1.0), COPTER, "unknown", "mode"),
        (command(185, 1.0), COPTER, "breaks", "motors off"),
        (command(207, 0.0), COPTER, "look", "fence"),
        (command(208, 2.0), COPTER, "breaks", "parachute"),
        (command(209, 1.0), COPTER, "unknown", "single motors"),
        (command(224, 3.0), COPTER, "unknown", "continues at another item"),
        (command(246, 1.0), COPTER, "breaks", "restarts"),
        (command(252, 0.0), COPTER, "unknown", "leaves this mission"),
        (command(262, 1.0), COPTER, "unknown", "changes the flight mode"),
        (MissionItem(30001, Frame.ABOVE_HOME, (0.0, 0.0, 0.0, 0.0), LAT, LON, 50.0), COPTER, "unknown", "drop its payload"),
        (MissionItem(31000, Frame.ABOVE_HOME, (0.0, 0.0, 0.0, 0.0), LAT, LON, 50.0), COPTER, "unknown", "does not define"),
        (command(31999), PX4, "unknown", "MAVLink does not define what command 31999 does"),
        (dataclasses.replace(waypoint(100.0, 0.0, 60.0), autocontinue=False), PX4, "look", "autocontinue"),
    ],
)  # fmt: skip
def test_it_is_told(one: MissionItem, aircraft: Aircraft, weight: str, word: str) -> None:
    ((found_weight, what),) = reported(one, aircraft)
    assert found_weight == weight
    assert word in what


def test_every_command_that_mavlink_defines_is_known() -> None:
    defined = {
        int(number)
        for number, entry in mavlink.enums["MAV_CMD"].items()
        if number > LAST_NAVIGATION and not entry.name.endswith(("_LAST", "_ENUM_END"))
    }
    known = {number for numbers in DEFINED for number in numbers}
    assert defined - known == set(range(31000, 31015))


@pytest.mark.parametrize(
    ("one", "aircraft"),
    [
        (command(178, 1.0, 5.0), COPTER),
        (command(178, 1.0, -1.0, 60.0), COPTER),
        (command(178, 0.0, -2.0), PLANE),
        (command(178, 3.0, 2.0), COPTER),
        (command(93, -1.0, 9.0, 0.0, 0.0), COPTER),
        (command(93, 5.0), COPTER),
        (circle(0.5, -40.0), COPTER),
        (circle(300.0, 20.0), PX4),
        (MissionItem(Command.NAV_LAND, Frame.COMMAND), COPTER),
        (MissionItem(179, Frame.AMSL, (0.0, 0.0, 0.0, 0.0), LAT, LON, HOME_M), COPTER),
        (command(207, 1.0), COPTER),
        (command(208, 1.0), COPTER),
        (dataclasses.replace(waypoint(100.0, 0.0, 60.0), autocontinue=False), COPTER),
        (waypoint(100.0, 0.0, math.nan), PX4),
    ],
)
def test_it_is_fine(one: MissionItem, aircraft: Aircraft) -> None:
    assert reported(one, aircraft) == []


def test_px4_refuses_two_land_starts_and_ardupilot_takes_them() -> None:
    starts = (command(189), command(189))
    assert [weight for weight, _ in reported(starts[0], PX4, starts[1])] == ["breaks"]
    assert reported(starts[0], PLANE, starts[1]) == []


@pytest.mark.parametrize(
    "one", [command(93, math.inf), command(178, 2.0, 1e9), command(178, 1.0, math.inf), command(112, math.inf)]
)
def test_numbers_that_nobody_flies(one: MissionItem) -> None:
    (found,) = impossible_numbers(mission(up(), one))
    assert found.weight == "breaks"


def test_a_speed_of_nothing_is_the_default_of_px4_and_nothing_to_arducopter() -> None:
    flight = mission(
        up(), command(178, 1.0, 9.0), waypoint(100.0, 0.0, 60.0), command(178, 1.0, 0.0), waypoint(200.0, 0.0, 60.0)
    )
    for aircraft, then in ((COPTER, 9.0), (PX4, PX4.cruise_speed_m_s)):
        assert [s.speed_m_s for s in flown_path(flight, world(), aircraft).segments[1:]] == [9.0, then]


@pytest.mark.parametrize("times", [3.0, -1.0])
@pytest.mark.parametrize("begin", [3.0, 4.0])
def test_a_jump_that_flies_nowhere(begin: float, times: float) -> None:
    """To itself, or back to an item that does not fly."""
    outcome = checked(*OVER[:2], command(206, 20.0), command(177, begin, times), *OVER[2:], aircraft=HIGH)
    (found,) = [one for one in outcome.findings if one.kind == "jump"]
    assert found.weight == "breaks"
    assert outcome.path is not None
    assert outcome.path.segments[-1].items[1] == 6


def test_items_that_are_never_flown() -> None:
    outcome = checked(*OVER, waypoint(300.0, 50.0, 115.0), waypoint(300.0, 90.0, 115.0))
    (found,) = [one for one in outcome.findings if one.kind == "order"]
    assert (found.weight, found.items) == ("look", (5, 6))
    skips = checked(OVER[0], command(177, 4.0, -1.0), waypoint(300.0, 50.0, 115.0), *OVER[1:])
    assert [one.items for one in skips.findings if one.kind == "order"] == [(3, 3)]
    assert not [one for one in checked(*OVER, aircraft=HIGH).findings if one.kind == "order"]


def test_a_home_that_stays_is_a_good_mission() -> None:
    stays = MissionItem(179, Frame.AMSL, (0.0, 0.0, 0.0, 0.0), LAT, LON, HOME_M)
    assert checked(OVER[0], stays, *OVER[1:-1], home()).verdict == "passed"

"""Repaired and split missions."""

import dataclasses
import itertools

import numpy as np
import pytest

from mission_io.model.items import Command, Frame, Mission, MissionItem
from tests.extras.check.test_checks import HIGH, checked
from tests.extras.check.worlds import COPTER, PLANE, command, home, item, lat_lon, mission, up, waypoint, world
from uavcover.errors import InputError
from uavcover.extras.check.flown_path import flown_path
from uavcover.extras.check.planned_photos import planned_photos
from uavcover.extras.check.repair import Repaired, parts_of, repaired
from uavcover.extras.check.world import Limits

LIMITS = Limits(min_height_agl_m=10.0)


def fixed(*items: MissionItem) -> Repaired:
    here = world()
    return repaired(mission(*items), here, LIMITS, lambda changed: flown_path(changed, here, COPTER))


def lowest_m(changed: Mission) -> float:
    """The least height above the ridge along the straight lines between waypoints, looked at every metre or so."""
    path = flown_path(changed, world(), COPTER)
    heights = []
    for segment in path.segments:
        if segment.phase == "route" and segment.is_straight:
            t = np.linspace(0.0, 1.0, 900)[:, None]
            line = segment.enu_m[0] + t * (segment.enu_m[-1] - segment.enu_m[0])
            heights.append((line[:, 2] - 100.0 * np.maximum(0.0, 1.0 - np.abs(line[:, 0] - 400.0) / 50.0)).min())
    return min(heights)


def test_a_leg_through_the_ridge_gets_waypoints_over_it() -> None:
    made = fixed(up(), waypoint(300.0, 0.0, 60.0), waypoint(500.0, 0.0, 60.0), home())
    assert made.raised == ()
    assert len(made.inserted) >= 1
    assert lowest_m(made.mission) >= 9.9
    kept = [one for n, one in enumerate(made.mission.items, 1) if n not in made.inserted]
    assert kept == list(mission(up(), waypoint(300.0, 0.0, 60.0), waypoint(500.0, 0.0, 60.0), home()).items)


def test_a_waypoint_in_the_ground_is_raised_once() -> None:
    made = fixed(
        up(),
        waypoint(380.0, 0.0, 115.0),
        waypoint(400.0, 0.0, 60.0, Frame.ABOVE_HOME),
        waypoint(420.0, 0.0, 115.0),
        home(),
    )
    assert (made.raised, made.inserted) == ((3,), ())
    assert made.mission.items[2].alt_m == pytest.approx(111.0, abs=0.2)


def test_heights_above_the_sea_stay_such() -> None:
    made = fixed(up(), waypoint(300.0, 0.0, 760.0, Frame.AMSL), waypoint(500.0, 0.0, 760.0, Frame.AMSL), home())
    assert {one.frame for one in made.mission.items[1:-1]} == {Frame.AMSL}
    assert lowest_m(made.mission) >= 9.9


def test_jumps_lead_where_they_led() -> None:
    jump = command(Command.DO_JUMP, 3.0, 1.0)
    made = fixed(up(), waypoint(300.0, 0.0, 60.0), waypoint(500.0, 0.0, 60.0), waypoint(600.0, 0.0, 60.0), jump, home())
    target = made.mission.items[int(made.mission.items[-2].params[0]) - 1]
    assert target == waypoint(500.0, 0.0, 60.0)


@pytest.mark.parametrize(
    "low",
    [
        item(Command.NAV_SPLINE_WAYPOINT, 500.0, 0.0, 60.0),
        item(Command.NAV_LOITER_TURNS, 400.0, 0.0, 60.0, params=(1.0, 0.0, 20.0, 0.0)),
        waypoint(400.0, 0.0, 5.0, Frame.ABOVE_TERRAIN),
    ],
)
def test_what_is_not_plain_stays(low: MissionItem) -> None:
    made = fixed(up(), waypoint(300.0, 0.0, 60.0), low, home())
    assert made.mission.items == mission(up(), waypoint(300.0, 0.0, 60.0), low, home()).items


ANY_HEIGHT = Limits(max_height_agl_m=None)
LINES = [waypoint(150.0 * (k // 2 % 2 == (k % 2)) + 500.0, 30.0 * (k // 2), 60.0) for k in range(20)]
PITCH = MissionItem(Command.DO_GIMBAL_MANAGER_PITCHYAW, Frame.COMMAND, (-70.0, 0.0, 0.0, 0.0))
SPEED = command(Command.DO_CHANGE_SPEED, 1.0, 6.0, -1.0)
TRIGGER = command(Command.DO_SET_CAM_TRIGG_DIST, 25.0, 0.0, 1.0)
OFF = command(Command.DO_SET_CAM_TRIGG_DIST, 0.0)
LANDING = item(Command.NAV_LAND, 0.0, 0.0, 0.0)


def survey(*end: MissionItem) -> Mission:
    there = waypoint(0.0, 0.0, 120.0), waypoint(500.0, 0.0, 120.0)
    return mission(
        up(120.0), SPEED, PITCH, *there, LINES[0], TRIGGER, *LINES[1:], OFF, waypoint(640.0, 270.0, 120.0), *end
    )


def legs(whole: Mission) -> list[tuple[float, ...]]:
    waypoints = [one for one in whole.items if one.command == Command.NAV_WAYPOINT]
    return [(a.lat_deg, a.lon_deg, a.alt_m, b.lat_deg, b.lon_deg, b.alt_m) for a, b in itertools.pairwise(waypoints)]


@pytest.mark.parametrize("end", [(home(),), (waypoint(0.0, 0.0, 120.0), LANDING)])
def test_every_leg_is_in_one_part_and_each_part_is_safe(end: tuple[MissionItem, ...]) -> None:
    whole = survey(*end)
    parts = parts_of(whole, world(), ANY_HEIGHT, HIGH, most_items=16)
    assert len(parts) > 2
    assert max(len(part.items) for part in parts) <= 16
    flown = [leg for part in parts for leg in legs(part)]
    assert all(flown.count(leg) == 1 for leg in legs(whole))
    for part in parts:
        assert part.items[0].command == Command.NAV_TAKEOFF
        assert part.items[-1].command == end[-1].command
        outcome = checked(whole=part, aircraft=HIGH, limits=ANY_HEIGHT)
        assert outcome.verdict == "passed", outcome.findings


def test_speed_gimbal_and_pictures_hold_in_each_part() -> None:
    whole = survey(home())
    position = world()

    def shown(one: Mission) -> set[tuple[int, int, int]]:
        taken = planned_photos(one, flown_path(one, position, COPTER), position, COPTER)
        assert set(taken.pitch_deg) <= {-70.0}
        return {(round(e / 25.0), round(n / 25.0), round(u)) for e, n, u in taken.positions_m}

    parts = parts_of(whole, position, ANY_HEIGHT, HIGH, most_items=16)
    observed = set().union(*(shown(part) for part in parts))
    lines = {each for each in shown(whole) if each[2] == 60}
    missing = lines - observed
    assert len(missing) <= len(parts), "a picture at a cut may lie in the next cell of 25 m"
    for part in parts:
        speeds = [leg.speed_m_s for leg in flown_path(part, position, COPTER).segments if leg.phase == "route"]
        assert set(speeds) == {6.0}
        assert part.items[-2].command in (Command.DO_SET_CAM_TRIGG_DIST, Command.NAV_WAYPOINT)


@pytest.mark.parametrize(
    ("change", "telling"),
    [
        (lambda items: (*items[:5], command(Command.DO_JUMP, 3.0, 1.0), *items[5:]), "command 177"),
        (lambda items: (*items[:5], item(Command.NAV_LOITER_TURNS, 500.0, 0.0, 60.0), *items[5:]), "command 18"),
        (lambda items: (*items[:5], dataclasses.replace(items[5], command=82), *items[6:]), "command 82"),
        (lambda items: (*items, up(50.0)), "take-offs"),
        (lambda items: items[1:], "take-offs"),
        (lambda items: (*items, waypoint(0.0, 0.0, 50.0)), "follows the end"),
        (lambda items: (*items[:-1], item(Command.NAV_LAND, 500.0, 0.0, 0.0)), "does not land at home"),
        (lambda items: (items[0], items[-1]), "no waypoint"),
    ],
)
def test_what_is_not_plain_is_refused(change, telling: str) -> None:
    whole = survey(home())
    with pytest.raises(InputError, match=telling):
        parts_of(dataclasses.replace(whole, items=change(whole.items)), world(), ANY_HEIGHT, HIGH, most_items=16)


def test_no_room_and_wings_are_refused() -> None:
    with pytest.raises(InputError, match="9 items are too"):
        parts_of(survey(home()), world(), ANY_HEIGHT, HIGH, most_items=9)
    with pytest.raises(InputError, match="runway"):
        parts_of(survey(home()), world(), ANY_HEIGHT, PLANE, most_items=16)
    assert lat_lon(0.0, 0.0)

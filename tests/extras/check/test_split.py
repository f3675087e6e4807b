"""Missions with too many items in parts, each a flight of its own."""

import dataclasses
import itertools

import pytest

from mission_io.model.items import Command, Frame, Mission, MissionItem
from tests.extras.check.test_checks import HIGH, checked
from tests.extras.check.worlds import COPTER, PLANE, command, home, item, lat_lon, mission, up, way, world
from uavcover.errors import InputError
from uavcover.extras.check.flown_path import flown_path
from uavcover.extras.check.planned_pictures import planned_pictures
from uavcover.extras.check.repair import parts_of
from uavcover.extras.check.world import Limits

LIMITS = Limits(max_height_agl_m=None)
LINES = [way(150.0 * (k // 2 % 2 == (k % 2)) + 500.0, 30.0 * (k // 2), 60.0) for k in range(20)]
PITCH = MissionItem(Command.DO_GIMBAL_MANAGER_PITCHYAW, Frame.COMMAND, (-70.0, 0.0, 0.0, 0.0))
SPEED = command(Command.DO_CHANGE_SPEED, 1.0, 6.0, -1.0)
TRIGGER = command(Command.DO_SET_CAM_TRIGG_DIST, 25.0, 0.0, 1.0)
OFF = command(Command.DO_SET_CAM_TRIGG_DIST, 0.0)
LANDING = item(Command.NAV_LAND, 0.0, 0.0, 0.0)


def survey(*end: MissionItem) -> Mission:
    there = way(0.0, 0.0, 120.0), way(500.0, 0.0, 120.0)
    return mission(up(120.0), SPEED, PITCH, *there, LINES[0], TRIGGER, *LINES[1:], OFF, way(640.0, 270.0, 120.0), *end)


def legs(whole: Mission) -> list[tuple[float, ...]]:
    ways = [one for one in whole.items if one.command == Command.NAV_WAYPOINT]
    return [(a.lat_deg, a.lon_deg, a.alt_m, b.lat_deg, b.lon_deg, b.alt_m) for a, b in itertools.pairwise(ways)]


@pytest.mark.parametrize("end", [(home(),), (way(0.0, 0.0, 120.0), LANDING)])
def test_every_leg_is_in_one_part_and_each_part_is_safe(end: tuple[MissionItem, ...]) -> None:
    whole = survey(*end)
    parts = parts_of(whole, world(), LIMITS, HIGH, most_items=16)
    assert len(parts) > 2
    assert max(len(part.items) for part in parts) <= 16
    flown = [leg for part in parts for leg in legs(part)]
    assert all(flown.count(leg) == 1 for leg in legs(whole))
    for part in parts:
        assert part.items[0].command == Command.NAV_TAKEOFF
        assert part.items[-1].command == end[-1].command
        outcome = checked(whole=part, aircraft=HIGH, limits=LIMITS)
        assert outcome.verdict == "passed", outcome.findings


def test_speed_gimbal_and_pictures_hold_in_each_part() -> None:
    whole = survey(home())
    place = world()

    def shown(one: Mission) -> set[tuple[int, int, int]]:
        taken = planned_pictures(one, flown_path(one, place, COPTER), place, COPTER)
        assert set(taken.pitch_deg) <= {-70.0}
        return {(round(e / 25.0), round(n / 25.0), round(u)) for e, n, u in taken.places_m}

    parts = parts_of(whole, place, LIMITS, HIGH, most_items=16)
    seen = set().union(*(shown(part) for part in parts))
    lines = {each for each in shown(whole) if each[2] == 60}
    missing = lines - seen
    assert len(missing) <= len(parts), "a picture at a cut may lie in the next cell of 25 m"
    for part in parts:
        speeds = [leg.speed_m_s for leg in flown_path(part, place, COPTER).segments if leg.phase == "route"]
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
        (lambda items: (*items, way(0.0, 0.0, 50.0)), "follows the end"),
        (lambda items: (*items[:-1], item(Command.NAV_LAND, 500.0, 0.0, 0.0)), "does not land at home"),
        (lambda items: (items[0], items[-1]), "no waypoint"),
    ],
)
def test_what_is_not_plain_is_refused(change, telling: str) -> None:
    whole = survey(home())
    with pytest.raises(InputError, match=telling):
        parts_of(dataclasses.replace(whole, items=change(whole.items)), world(), LIMITS, HIGH, most_items=16)


def test_no_room_and_wings_are_refused() -> None:
    with pytest.raises(InputError, match="9 items are too"):
        parts_of(survey(home()), world(), LIMITS, HIGH, most_items=9)
    with pytest.raises(InputError, match="runway"):
        parts_of(survey(home()), world(), LIMITS, PLANE, most_items=16)
    assert lat_lon(0.0, 0.0)

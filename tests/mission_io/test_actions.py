"""Actions against items, and against the parameter names in MAVLink's own tables."""

import math
from dataclasses import fields

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from mission_io.model import actions as a
from mission_io.model.items import Command, Frame, FramedPoint, MissionItem, SpeedType, same_item
from tests.mission_io.formats.samples import COMMANDS, ITEMS, LATITUDES, LONGITUDES

POSITION = FramedPoint(33.2191234, -98.1240001, 60.25, Frame.ABOVE_TERRAIN)

_FLOATS = st.floats(-1e30, 1e30)
_POSITIONS = st.builds(FramedPoint, LATITUDES, LONGITUDES, _FLOATS, st.sampled_from([Frame.AMSL, Frame.ABOVE_HOME]))
_OF_TYPE = {
    "FramedPoint": _POSITIONS,
    "float": _FLOATS,
    "int": st.integers(-1000, 1000),
    "bool": st.booleans(),
    "float | None": st.none() | _FLOATS,
    "SpeedType": st.sampled_from(SpeedType),
    "TurnDirection": st.sampled_from(a.TurnDirection),
    "MountMode": st.sampled_from(a.MountMode),
}


def any_of(kind: type[a.Action]) -> st.SearchStrategy[a.Action]:
    return st.builds(kind, **{f.name: _OF_TYPE[getattr(f.type, "__name__", str(f.type))] for f in fields(kind)})


@pytest.mark.parametrize("kind", a.ACTIONS, ids=lambda kind: kind.__name__)
def test_every_action_survives_as_an_item(kind: type[a.Action]) -> None:
    @settings(derandomize=True, max_examples=30)
    @given(any_of(kind))
    def survives(action: a.Action) -> None:
        item = a.item_of(action)
        assert item.command == kind.COMMAND
        assert a.action_of(item) == action
        assert same_item(a.item_of(action), item)

    survives()


@settings(derandomize=True, max_examples=200)
@given(ITEMS | COMMANDS)
def test_looking_at_an_item_raises_nothing_and_agrees_with_it(item: MissionItem) -> None:
    action = a.action_of(item)
    if action is not None:
        assert a.item_of(action).command == item.command
        assert a.action_of(a.item_of(action)) == action


@pytest.mark.parametrize(
    ("action", "command", "values"),
    [
        (a.Waypoint(POSITION, 5.0, 2.0), 16, (5.0, 2.0, 0.0, math.nan, 33.2191234, -98.1240001, 60.25)),
        (a.Turn(90.0, 10.0, a.TurnDirection.COUNTERCLOCKWISE, relative=True), 115, (90.0, 10.0, -1.0, 1.0, 0, 0, 0)),
        (a.PointMount(-90.0), 205, (-90.0, 0, 0, 0, 0, 0, 2.0)),
        (a.PointGimbal(-45.0), 1000, (-45.0, math.nan, math.nan, math.nan, 0, 0, 0)),
        (a.TriggerEvery(25.0, at_once=True), 206, (25.0, 0, 1.0, 0, 0, 0, 0)),
        (a.TakePicture(), 203, (0, 0, 0, 0, 1.0, 0, 0)),
        (a.StartPictures(interval_s=2.0, count=7), 2000, (0, 2.0, 7.0, 0, 0, 0, 0)),
        (a.StopPictures(), 2001, (0,) * 7),
        (a.StartVideo(1, 0.5), 2500, (1.0, 0.5, 0, 0, 0, 0, 0)),
        (a.StopVideo(), 2501, (0,) * 7),
        (a.Jump(3, -1), 177, (3.0, -1.0, 0, 0, 0, 0, 0)),
        (a.ChangeSpeed(SpeedType.GROUND, 7.5), 178, (1.0, 7.5, -1.0, 0, 0, 0, 0)),
    ],
)
def test_parameters_are_where_mavlink_has_them(action: a.Action, command: int, values: tuple[float, ...]) -> None:
    item = a.item_of(action)
    assert item.command == command
    assert [repr(float(value)) for _, value in item.values()] == [repr(float(value)) for value in values]


def test_commands_have_the_names_and_numbers_of_mavlink() -> None:
    theirs = dialect.enums["MAV_CMD"]
    for command in Command:
        assert theirs[int(command)].name == f"MAV_CMD_{command.name}"


def test_camera_commands_say_what_mavlinks_own_table_says_of_their_parameters() -> None:
    theirs = dialect.enums["MAV_CMD"]
    for kind, number, word in ((a.PointGimbal, 1, "pitch"), (a.Turn, 1, "angle"), (a.StartPictures, 2, "time between"),
                               (a.StartPictures, 3, "total number"), (a.TriggerEvery, 1, "distance")):  # fmt: skip
        assert word in theirs[int(kind.COMMAND)].param[number].lower()


@pytest.mark.parametrize(
    "item",
    [
        MissionItem(31010, Frame.COMMAND, (1.0, 2.0, 3.0, 4.0)),
        MissionItem(16, Frame.COMMAND),
        MissionItem(178, Frame.COMMAND, (9.0, 5.0, -1.0, 0.0)),
        MissionItem(178, Frame.COMMAND, (math.nan, 5.0, -1.0, 0.0)),
        MissionItem(177, Frame.COMMAND, (1.5, 1.0, 0.0, 0.0)),
        MissionItem(177, Frame.COMMAND, (math.inf, 1.0, 0.0, 0.0)),
        MissionItem(115, Frame.COMMAND, (1.0, 1.0, 1.0, 0.5)),
        MissionItem(205, Frame.COMMAND, (0.0, 0.0, 0.0, 0.0), alt_m=math.inf),
    ],
)
def test_what_is_no_known_action_stays_an_item(item: MissionItem) -> None:
    assert a.action_of(item) is None

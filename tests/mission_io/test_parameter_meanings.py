"""The table of parameters against pymavlink's copy of MAVLink's descriptions, and what becomes of NaN in files."""

import math
import re

import pytest
from pymavlink.dialects.v20 import common as dialect

from mission_io.autopilots.comparison import Meaning, _meanings, has_no_position, meaning_of, number_for_nan
from mission_io.errors import FormatError
from mission_io.formats import plan, wpl
from mission_io.model.items import Fence, Frame, Mission, MissionItem, RallyPoints
from tests.mission_io.formats.samples import HOME

NAN = math.nan
OF_NO_USE = re.compile(r"(empty|reserved|unused|not used|$)", re.IGNORECASE)
A_POSITION_THAT_MAY_BE_LEFT_OUT = {(189, 5), (189, 6), (189, 7)}
DESCRIBED = [(command, number) for command, letters in _meanings().items() for number in range(1, len(letters) + 1)]


def description(command: int, number: int) -> str:
    return " ".join(dialect.enums["MAV_CMD"][command].param.get(number, "").split())


def test_what_is_of_no_use_is_so_to_mavlink() -> None:
    wrong = [
        position
        for position in DESCRIBED
        if meaning_of(*position) is Meaning.RESERVED
        and not OF_NO_USE.match(description(*position))
        and position not in A_POSITION_THAT_MAY_BE_LEFT_OUT
    ]
    assert wrong == []


def test_headings_are_those_of_which_mavlink_says_so() -> None:
    headings = {position for position in DESCRIBED if "current system yaw heading mode" in description(*position)}
    where_a_circle_is_left = {(18, 4), (19, 4)}
    assert headings - where_a_circle_is_left == {
        position for position in DESCRIBED if meaning_of(*position) is Meaning.HEADING
    }


def test_commands_without_a_place_have_none_in_mavlink() -> None:
    for command in _meanings():
        if has_no_position(command) and command != 189:
            assert all(OF_NO_USE.match(description(command, number)) for number in (5, 6, 7)), command
    assert not has_no_position(16)
    assert not has_no_position(31010)


@pytest.mark.parametrize(
    ("item", "written"),
    [
        (MissionItem(84, Frame.ABOVE_HOME, (NAN, 1.0, NAN, NAN), 46.5, -7.3, 20.0), (0.0, 1.0, 0.0, 0.0)),
        (MissionItem(85, Frame.ABOVE_HOME, (1.0, NAN, 5.0, NAN), 46.5, -7.3, 0.0), (1.0, 0.0, 5.0, 0.0)),
        (MissionItem(530, Frame.COMMAND, (0.0, 2.0, NAN, NAN)), (0.0, 2.0, 0.0, 0.0)),
        (MissionItem(1000, Frame.COMMAND, (-90.0, 0.0, NAN, NAN)), (-90.0, 0.0, 0.0, 0.0)),
        (MissionItem(93, Frame.COMMAND, (30.0, NAN, NAN, NAN)), (30.0, -1.0, -1.0, -1.0)),
        (MissionItem(206, Frame.COMMAND, (25.0, NAN, 1.0, NAN)), (25.0, 0.0, 1.0, 0.0)),
        (MissionItem(2500, Frame.COMMAND, (0.0, NAN, NAN, NAN)), (0.0, 0.0, 0.0, 0.0)),
    ],
)
def test_nan_that_means_nothing_of_its_own_goes_from_plan_to_waypoints(
    item: MissionItem, written: tuple[float, ...]
) -> None:
    text = plan.write(plan.PlanFile(Mission(HOME, (item,)), Fence(), RallyPoints(), 12))
    mission = plan.read(text).mission
    assert wpl.read(wpl.write_mission(mission)).items[0].params == written
    assert wpl.losses(mission)
    # No reader of pymavlink's kind, that knows no NaN, sees another mission than one that fills in what means the same.
    assert all(math.isnan(a) or a == b for a, b in zip(mission.items[0].params, written, strict=True))


@pytest.mark.parametrize(
    "item",
    [
        MissionItem(1000, Frame.COMMAND, (NAN, 0.0, NAN, 0.0)),
        MissionItem(1000, Frame.COMMAND, (NAN, NAN, NAN, NAN)),
        MissionItem(187, Frame.COMMAND, (0.5, NAN, 0.0, 0.0)),
        MissionItem(18, Frame.ABOVE_HOME, (NAN, 0.0, 0.0, 0.0), 46.5, -7.3, 20.0),
        MissionItem(31010, Frame.COMMAND, (0.0, NAN, 0.0, 0.0)),
    ],
)
def test_nan_that_no_number_can_say_is_an_error(item: MissionItem) -> None:
    assert any(math.isnan(number_for_nan(item, number)) for number in range(1, 5))
    with pytest.raises(FormatError, match="nan cannot be written"):
        wpl.write_mission(Mission(HOME, (item,)))

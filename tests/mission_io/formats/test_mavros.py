"""JSON for MAVROS: the fields of its messages, filled the way that ``ros2 service call`` fills them."""

import json
import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Autopilot, mission_from_wire, wire_items
from mission_io.errors import FormatError
from mission_io.formats import mavros
from mission_io.model.items import Frame, Mission, MissionItem, same_item, waypoint
from tests.mission_io.formats.samples import HOME, MISSION, MISSIONS, NAN_YAW

WAYPOINT: dict[str, type] = {
    "frame": int,
    "command": int,
    "is_current": bool,
    "autocontinue": bool,
    "param1": float,
    "param2": float,
    "param3": float,
    "param4": float,
    "x_lat": float,
    "y_long": float,
    "z_alt": float,
}
"""Fields of mavros_msgs/msg/Waypoint (github.com/mavlink/mavros, ros2) and what Python has for their types."""


def pushed(text: str) -> list[dict[str, Any]]:
    """The waypoints of a WaypointPush request as rosidl's ``set_message_fields`` fills them: ``type(field)(value)``."""

    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is not JSON")

    request = json.loads(text, parse_constant=refuse)
    assert set(request) == {"start_index", "waypoints"}
    assert request["start_index"] == 0
    filled = []
    for entry in request["waypoints"]:
        assert set(entry) == set(WAYPOINT)
        assert all(type(entry[name]) is kind for name, kind in WAYPOINT.items() if kind is not float)
        assert 0 <= entry["frame"] <= 255
        assert 0 <= entry["command"] <= 65535
        filled.append({name: kind(entry[name]) for name, kind in WAYPOINT.items()})
    assert [entry["is_current"] for entry in filled] == [k == 0 for k in range(len(filled))]
    return filled


def items_of(text: str) -> list[MissionItem]:
    return [
        MissionItem(
            entry["command"], Frame.from_mav_frame(entry["frame"]),
            (entry["param1"], entry["param2"], entry["param3"], entry["param4"]),
            entry["x_lat"], entry["y_long"], entry["z_alt"], entry["autocontinue"],
        )
        for entry in pushed(text)
    ]  # fmt: skip


@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=["ardupilot", "px4"])
@given(mission=MISSIONS)
def test_the_items_are_those_on_the_wire(autopilot: Autopilot, mission: Mission) -> None:
    mission = replace(mission, home=mission.home or HOME)
    found = items_of(mavros.write_mission(mission, autopilot=autopilot))
    wanted = wire_items(mission, autopilot)
    assert len(found) == len(wanted)
    assert all(map(same_item, found, wanted))
    assert mission_from_wire(found, autopilot).home == (mission.home if autopilot is ARDUPILOT else None)


def test_home_is_item_0_for_ardupilot_alone() -> None:
    first = items_of(mavros.write_mission(MISSION))[0]
    assert (first.lat_deg, first.lon_deg, first.alt_m, first.frame) == (33.21875, -98.1234567, 345.678, Frame.AMSL)
    assert items_of(mavros.write_mission(MISSION, autopilot=PX4))[0].command == 22


def test_any_heading_is_0_for_ardupilot_and_nan_for_px4() -> None:
    mission = Mission(HOME, (NAN_YAW,))
    assert items_of(mavros.write_mission(mission))[1].params == (0.0, 0.0, 0.0, 0.0)
    text = mavros.write_mission(mission, autopilot=PX4)
    assert '"param4": "nan"' in text
    assert math.isnan(items_of(text)[0].params[3])


@pytest.mark.parametrize(
    ("mission", "match"),
    [
        (replace(MISSION, home=None), "no home"),
        (Mission(HOME, (replace(NAN_YAW, lat_deg=math.nan),)), "item 1: a coordinate is not finite"),
        (Mission(HOME, (waypoint(33.0, 181.0, 1.0, frame=Frame.AMSL),)), "item 1: latitude 33, longitude 181"),
        (Mission(HOME, (waypoint(33.0, 18.0, 1.0, frame=Frame.AMSL, hold_s=math.inf),)), "item 1: a parameter is inf"),
    ],
)
def test_what_it_cannot_hold_is_refused(mission: Mission, match: str) -> None:
    with pytest.raises(FormatError, match=match):
        mavros.write_mission(mission)


def test_px4_needs_no_home() -> None:
    assert len(items_of(mavros.write_mission(replace(MISSION, home=None), autopilot=PX4))) == len(MISSION.items)

import math
from dataclasses import replace

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Autopilot, autopilot_for
from mission_io.autopilots.comparison import compare_items
from mission_io.autopilots.mission_lists import check_for_autopilot, mission_from_wire, stored_item, wire_items
from mission_io.errors import FormatError, MisuseError
from mission_io.model.items import (
    Command,
    Frame,
    GeoPoint,
    Mission,
    MissionItem,
    MissionType,
    change_speed,
    delay,
    land,
    return_to_launch,
    trigger_camera_every,
    waypoint,
)
from mission_io.wire.messages import (
    MissionItemFloat,
    MissionItemInt,
    degrees_on_wire,
    float32,
    item_from_message,
    message_from_item,
)

HOME = GeoPoint(46.5, -7.25, 512.0)
WAYPOINT = waypoint(46.1234567, -7.7654321, 40.0, frame=Frame.ABOVE_HOME)
TO = {"mission_type": MissionType.MISSION, "target_system": 1, "target_component": 1}


def test_home_goes_in_front_for_ardupilot_only() -> None:
    mission = Mission(HOME, (WAYPOINT, return_to_launch()))
    assert wire_items(mission, PX4) == mission.items
    first, *rest = wire_items(mission, ARDUPILOT)
    assert (first.command, first.frame, first.lat_deg, first.alt_m) == (16, Frame.AMSL, 46.5, 512.0)
    assert tuple(rest) == mission.items
    assert mission_from_wire(wire_items(mission, ARDUPILOT), ARDUPILOT) == mission
    assert mission_from_wire(mission.items, PX4) == replace(mission, home=None)
    assert wire_items(replace(mission, home=None), ARDUPILOT)[0].lat_deg == 0.0
    assert mission_from_wire((), ARDUPILOT) == Mission(None, ())


def test_commands_without_a_position_get_their_frame_back() -> None:
    stored = [stored_item(item, ARDUPILOT) for item in wire_items(Mission(HOME, (change_speed(8.0),)), ARDUPILOT)]
    assert stored[1].frame is Frame.AMSL
    assert mission_from_wire(stored, ARDUPILOT).items == (change_speed(8.0),)


def test_autopilots_are_found_by_their_number() -> None:
    assert (autopilot_for(3), autopilot_for(12)) == (ARDUPILOT, PX4)
    with pytest.raises(MisuseError, match="autopilot 8"):
        autopilot_for(8)


@pytest.mark.parametrize(
    ("item", "changes"),
    [
        (replace(WAYPOINT, params=(2.9, 1.0, 2.0, 90.0)), {"params": (2.0, 0.0, 0.0, 0.0)}),
        (replace(WAYPOINT, params=(-5.0, 0.0, 0.0, 0.0)), {"params": (65531.0, 0.0, 0.0, 0.0)}),
        (replace(WAYPOINT, params=(0.0, 0.0, 0.0, math.nan)), {"params": (0.0, 0.0, 0.0, 0.0)}),
        (replace(WAYPOINT, alt_m=40.129), {"alt_m": float32(40.12)}),
        (replace(WAYPOINT, alt_m=-0.019), {"alt_m": float32(-0.01)}),
        (replace(WAYPOINT, autocontinue=False), {"autocontinue": True}),
        (MissionItem(5100, Frame.ABOVE_HOME, (1.0, 2.0, 3.0, 4.0), 46.0, -7.0, 20.9),
         {"params": (0.0, 0.0, 0.0, 0.0), "alt_m": 20.0, "autocontinue": False}),
        (return_to_launch(), {"frame": Frame.AMSL}),
    ],
)  # fmt: skip
def test_what_ardupilot_makes_of_an_item(item: MissionItem, changes: dict[str, object]) -> None:
    assert stored_item(item, ARDUPILOT) == replace(item, **changes)  # type: ignore[arg-type]


def test_what_px4_makes_of_an_item() -> None:
    item = replace(WAYPOINT, params=(2.9, 1.0, 2.0, 90.0), alt_m=40.129)
    assert stored_item(item, PX4) == replace(item, params=(float32(2.9), 1.0, 0.0, 90.0), alt_m=float32(40.129))


@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
def test_what_an_autopilot_stores_is_acceptable_to_the_comparison(autopilot: Autopilot) -> None:
    mission = Mission(
        HOME,
        (
            replace(WAYPOINT, params=(2.9, 1.0, 2.0, 90.0), alt_m=40.129),
            change_speed(7.3),
            delay(2.5),
            trigger_camera_every(12.7),
            return_to_launch(),
        ),
    )
    sent = wire_items(mission, autopilot)
    received = [
        item_from_message(message_from_item(stored_item(item, autopilot), seq, **TO)) for seq, item in enumerate(sent)
    ]
    differences = compare_items(sent, received, autopilot)
    assert differences
    assert all(difference.acceptable for difference in differences), differences


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"lat_deg": 46.1234569}, "lat_deg"),
        ({"lon_deg": math.nan}, "lon_deg"),
        ({"alt_m": 40.02}, "alt_m"),
        ({"params": (1.0, 0.0, 0.0, 0.0)}, "param1"),
        ({"params": (0.0, 5.0, 0.0, 0.0)}, "param2"),
        ({"frame": Frame.AMSL}, "frame"),
        ({"command": 17}, "command"),
        ({"autocontinue": False}, "autocontinue"),
    ],
)
@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
def test_real_faults_are_not_acceptable(change: dict[str, object], field: str, autopilot: Autopilot) -> None:
    sent = [WAYPOINT, WAYPOINT]
    received = [WAYPOINT, replace(WAYPOINT, **change)]  # type: ignore[arg-type]
    (difference,) = compare_items(sent, received, autopilot)
    assert (difference.item, difference.field, difference.acceptable) == (1, field, False)


def test_ardupilots_wrapped_hold_time_is_a_fault() -> None:
    sent = replace(WAYPOINT, params=(-5.0, 0.0, 0.0, 0.0))
    (difference,) = compare_items([WAYPOINT, sent], [WAYPOINT, stored_item(sent, ARDUPILOT)], ARDUPILOT)
    assert (difference.received, difference.acceptable) == (65531.0, False)


def test_altitudes_one_centimetre_down_are_ardupilots_arithmetic() -> None:
    (difference,) = compare_items([WAYPOINT] * 2, [WAYPOINT, replace(WAYPOINT, alt_m=39.99)], ARDUPILOT)
    assert difference.acceptable
    assert "centimetres" in difference.why


def test_home_is_the_vehicles_own_and_lengths_must_agree() -> None:
    sent = wire_items(Mission(HOME, (WAYPOINT,)), ARDUPILOT)
    other = wire_items(Mission(GeoPoint(46.6, -7.3, 500.0), (WAYPOINT,)), ARDUPILOT)
    (home,) = compare_items(sent, other, ARDUPILOT)
    assert (home.field, home.acceptable, home.received) == ("home", True, "46.6000000, -7.3000000, 500.00 m AMSL")
    assert compare_items(sent, sent, ARDUPILOT) == ()
    for received, why in ((sent[:1], "lost"), ((*sent, WAYPOINT), "not sent")):
        (count,) = compare_items(sent, received, ARDUPILOT)
        assert (count.field, count.acceptable) == ("count", False)
        assert why in count.why
    (position,) = compare_items(sent[:1], other[:1], ARDUPILOT, MissionType.RALLY)[:1]
    assert not position.acceptable


@pytest.mark.parametrize(
    ("item", "ardupilot", "px4"),
    [
        (WAYPOINT, "", ""),
        (replace(WAYPOINT, lat_deg=91.0), "lat_deg", "lat_deg"),
        (replace(WAYPOINT, lon_deg=math.nan), "lon_deg", "lon_deg"),
        (replace(WAYPOINT, alt_m=math.nan), "alt_m", "alt_m"),
        (replace(WAYPOINT, alt_m=math.inf), "alt_m", "alt_m"),
        (replace(WAYPOINT, params=(-5.0, 0.0, 0.0, 0.0)), "param1", "param1"),
        (replace(WAYPOINT, params=(7e4, 0.0, 0.0, 0.0)), "param1", "param1"),
        (replace(WAYPOINT, params=(0.0, 0.0, 0.0, math.nan)), "", ""),
        (replace(WAYPOINT, params=(0.0, math.nan, 0.0, 0.0)), "param2", ""),
        (replace(WAYPOINT, params=(0.0, 1e39, 0.0, 0.0)), "param2", "param2"),
        (replace(WAYPOINT, frame=Frame.ABOVE_TERRAIN), "", "frame"),
        (delay(-1.0), "param1", "param1"),
        (replace(return_to_launch(), frame=Frame.ABOVE_HOME), "", "frame"),
        (MissionItem(197, Frame.COMMAND, lat_deg=0.5), "parameters 5 and 6", "parameters 5 and 6"),
    ],
)
def test_checked_before_it_is_sent(item: MissionItem, ardupilot: str, px4: str) -> None:
    for autopilot, wanted in ((ARDUPILOT, ardupilot), (PX4, px4)):
        problems = check_for_autopilot([WAYPOINT, item], autopilot)
        assert bool(problems) == bool(wanted), problems
        assert all(problem.item == 1 and wanted in str(problem) for problem in problems)


def test_too_many_items_and_impossible_lists() -> None:
    (problem,) = check_for_autopilot([WAYPOINT] * 651, ARDUPILOT)
    assert str(problem) == "the list: 651 items exceed the ArduPilot limit of 650; split the mission"
    assert check_for_autopilot([WAYPOINT] * 651, PX4) == ()
    (problem,) = check_for_autopilot([WAYPOINT], PX4, MissionType.FENCE)
    assert "not a fence item" in problem.what


def test_messages_carry_items_to_the_last_unit() -> None:
    message = message_from_item(WAYPOINT, 0, **TO)
    assert (message.x, message.y, message.z, message.frame, message.current) == (461234567, -77654321, 40.0, 6, 1)
    assert item_from_message(message) == WAYPOINT
    assert message_from_item(WAYPOINT, 1, **TO).current == 0
    command = MissionItem(Command.NAV_DELAY, Frame.COMMAND, (1.0, 2.0, 3.0, 4.0), 5.0, 6.0, 7.0)
    assert item_from_message(message_from_item(command, 3, **TO)) == command


def test_the_deprecated_message_is_in_degrees() -> None:
    message = MissionItemFloat(1, 1, 4, 3, 16, (0.0, 0.0, 0.0, 0.0), 46.5, -7.25, 20.0)
    assert item_from_message(message) == waypoint(46.5, -7.25, 20.0, frame=Frame.ABOVE_HOME)


def test_what_messages_cannot_carry() -> None:
    with pytest.raises(MisuseError, match="item 2: the latitude"):
        message_from_item(replace(WAYPOINT, lat_deg=math.nan), 2, **TO)
    with pytest.raises(MisuseError, match="the longitude"):
        message_from_item(replace(WAYPOINT, lon_deg=1e9), 2, **TO)
    with pytest.raises(FormatError, match="item 4: unknown frame 1"):
        item_from_message(MissionItemInt(1, 1, 4, 1, 16, (0.0, 0.0, 0.0, 0.0), 0, 0, 0.0))
    with pytest.raises(MisuseError, match="32-bit"):
        float32(1e39)
    assert degrees_on_wire(46.12345678) == 46.1234568


def test_what_arducopter_gives_back_of_a_landing_a_fence_and_a_rally_point_is_no_fault():
    """Seen with ArduCopter 4.7: the landing's fourth parameter came back as 1, and autocontinue as not set."""
    home = land(36.4762, -84.216, frame=Frame.ABOVE_HOME)
    assert stored_item(home, ARDUPILOT).params == (0.0, 0.0, 0.0, 1.0)
    sent = wire_items(Mission(HOME, (home,)), ARDUPILOT)
    for value, acceptable in ((1.0, True), (2.0, False)):
        received = (sent[0], replace(home, params=(0.0, 0.0, 0.0, value)))
        (difference,) = compare_items(sent, received, ARDUPILOT, MissionType.MISSION)
        assert (difference.field, difference.acceptable) == ("param4", acceptable)
    for command, kind in (
        (Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION, MissionType.FENCE),
        (Command.NAV_RALLY_POINT, MissionType.RALLY),
    ):
        item = MissionItem(command, Frame.ABOVE_HOME, (3.0, 0.0, 0.0, 0.0), 36.4762, -84.216, 0.0)
        assert all(d.acceptable for d in compare_items([item], [replace(item, autocontinue=False)], ARDUPILOT, kind))
        assert stored_item(item, ARDUPILOT).autocontinue is False

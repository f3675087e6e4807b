"""What is known of ArduPilot, PX4 and the file formats (../shared/MAVLINK.md), a named test for each fact about data.

Facts about the conversation are tested in ``protocol/``, file formats byte for byte in ``formats/``.
"""

import json
import math
from dataclasses import replace

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, ARDUPILOT_PLANE, ARDUPILOT_ROVER, PX4, Autopilot, autopilot_for
from mission_io.autopilots.comparison import compare_items
from mission_io.autopilots.mission_lists import (
    check_for_autopilot,
    fence_problems,
    mission_from_wire,
    stored_item,
    wire_items,
)
from mission_io.formats import plan, wpl
from mission_io.model.items import (
    Command,
    Fence,
    FencePolygon,
    Frame,
    FramedPoint,
    LatLon,
    Mission,
    MissionItem,
    MissionType,
    RallyPoints,
    change_speed,
    delay,
    items_from_fence,
    land,
    return_to_launch,
    takeoff,
    trigger_camera_every,
    waypoint,
)
from mission_io.protocol.upload import Upload
from mission_io.wire.messages import (
    Address,
    MissionItemInt,
    MissionRequestInt,
    Received,
    degrees_on_wire,
    float32,
    item_from_message,
    message_from_item,
)
from tests.mission_io.formats.samples import FENCE, HOME, MISSION, RALLY

BOTH = pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
TO = {"mission_type": MissionType.MISSION, "target_system": 1, "target_component": 1}
POSITION = waypoint(33.2191234, -98.1240001, 60.25, frame=Frame.ABOVE_HOME)
JUMP = MissionItem(Command.DO_JUMP, Frame.COMMAND, (2.0, 3.0, 0.0, 0.0))


def problems(item: MissionItem, autopilot: Autopilot) -> str:
    found = check_for_autopilot([POSITION, item, POSITION], autopilot)
    return "; ".join(str(problem) for problem in found)


def round_trip(items: tuple[MissionItem, ...], autopilot: Autopilot) -> list[MissionItem]:
    """What comes back over the wire of items that the autopilot stored."""
    return [
        item_from_message(message_from_item(stored_item(item, autopilot), n, **TO))  # type: ignore[arg-type]
        for n, item in enumerate(items)
    ]


def test_int_items_use_frames_5_6_and_11_and_commands_2() -> None:
    assert {frame: frame.wire for frame in Frame} == {
        Frame.AMSL: 5, Frame.ABOVE_HOME: 6, Frame.ABOVE_TERRAIN: 11, Frame.COMMAND: 2,
    }  # fmt: skip


def test_rally_points_go_in_frames_0_and_3_for_px4_returns_to_no_other() -> None:
    point = MissionItem(Command.NAV_RALLY_POINT, Frame.ABOVE_HOME, lat_deg=33.2, lon_deg=-98.1, alt_m=30.0)
    upload = Upload((point,), mission_type=MissionType.RALLY, local=Address(255, 190), vehicle=Address(1, 1), now=0.0)
    upload.receive(Received(MissionRequestInt(255, 190, 0, MissionType.RALLY), 1, 1), 0.1)
    sent = [message for message in upload.messages_to_send(0.1) if isinstance(message, MissionItemInt)]
    assert [message.frame for message in sent] == [3]
    assert item_from_message(sent[0]) == point


def test_float_items_lose_decimetres_and_int_items_nothing() -> None:
    lost_m = abs(float32(POSITION.lon_deg) - POSITION.lon_deg) * 111_000.0
    assert 0.01 < lost_m < 0.5
    message = message_from_item(POSITION, 1, **TO)  # type: ignore[arg-type]
    assert (item_from_message(message).lat_deg, item_from_message(message).lon_deg) == (
        POSITION.lat_deg,
        POSITION.lon_deg,
    )


def test_coordinates_are_rounded_because_truncation_puts_six_in_a_hundred_off_by_one() -> None:
    degrees = [n / 1e7 for n in range(331234001, 331234001 + 20_000)]
    truncated = sum(int(value * 1e7) != round(value * 1e7) for value in degrees)
    assert 0.01 < truncated / len(degrees) < 0.2
    assert all(degrees_on_wire(value) == value for value in degrees)


@BOTH
def test_sequence_0_is_home_or_the_first_item(autopilot: Autopilot) -> None:
    sent = wire_items(MISSION, autopilot)
    assert len(sent) - len(MISSION.items) == int(autopilot is ARDUPILOT)
    assert (sent[0].alt_m == HOME.alt_amsl_m) == (autopilot is ARDUPILOT)


def test_a_list_without_home_would_lose_its_first_item_on_ardupilot() -> None:
    (problem,) = check_for_autopilot([takeoff(33.2, -98.1, 30.0, frame=Frame.ABOVE_HOME), POSITION], ARDUPILOT)
    assert (problem.item, problem.field) == (0, "command")
    assert "would be lost; send home first" in problem.what
    assert check_for_autopilot([takeoff(33.2, -98.1, 30.0, frame=Frame.ABOVE_HOME), POSITION], PX4) == ()


def test_terrain_frames_are_for_ardupilot_only() -> None:
    terrain = replace(POSITION, frame=Frame.ABOVE_TERRAIN)
    assert problems(terrain, ARDUPILOT) == ""
    assert (
        problems(terrain, PX4)
        == "item 1, frame: PX4 does not accept heights in frame ABOVE_TERRAIN; use ABOVE_HOME or AMSL"
    )


@BOTH
@pytest.mark.parametrize("item", [return_to_launch(), change_speed(5.0), trigger_camera_every(25.0), delay(2.0)])
def test_commands_without_a_location_go_in_frame_2_which_both_take(item: MissionItem, autopilot: Autopilot) -> None:
    written_by_mission_planner = replace(item, frame=Frame.ABOVE_HOME)
    sent = wire_items(Mission(HOME, (POSITION, written_by_mission_planner)), autopilot)
    assert sent[-1] == item
    assert check_for_autopilot(sent, autopilot) == ()
    assert bool(check_for_autopilot([POSITION, written_by_mission_planner], PX4))


@BOTH
def test_all_commands_come_back_as_they_were_meant(autopilot: Autopilot) -> None:
    items = (
        POSITION, JUMP, change_speed(5.0), trigger_camera_every(25.0), delay(2.0), return_to_launch(),
        land(33.2, -98.1, frame=Frame.ABOVE_HOME),
        MissionItem(Command.DO_DIGICAM_CONTROL, Frame.COMMAND, lat_deg=1.0),
        MissionItem(Command.DO_GIMBAL_MANAGER_PITCHYAW, Frame.COMMAND, (-45.0, 10.0, 0.0, 0.0), 12.0, 0.0, 1.0),
        MissionItem(Command.CONDITION_YAW, Frame.COMMAND, (90.0, 10.0, -1.0, 1.0)),
        MissionItem(Command.IMAGE_START_CAPTURE, Frame.COMMAND, (0.0, 2.0, 5.0, 0.0)),
    )  # fmt: skip
    sent = wire_items(Mission(HOME, items), autopilot)
    received = round_trip(sent, autopilot)
    assert all(difference.acceptable for difference in compare_items(sent, received, autopilot))
    back = mission_from_wire(received, autopilot).items
    assert [replace(item, params=(0.0,) * 4) for item in back if item.command != Command.NAV_LAND] == [
        replace(item, params=(0.0,) * 4, autocontinue=True) for item in items if item.command != Command.NAV_LAND
    ]
    assert [item.params for item in back[7:]] == [item.params for item in items[7:]]


def test_jumps_name_items_as_each_autopilot_counts_them() -> None:
    mission = Mission(HOME, (POSITION, POSITION, JUMP))
    assert wire_items(mission, ARDUPILOT)[3].params[0] == 2.0
    assert wire_items(mission, PX4)[2].params[0] == 1.0
    for autopilot in (ARDUPILOT, PX4):
        assert mission_from_wire(wire_items(mission, autopilot), autopilot).items == mission.items
        assert check_for_autopilot(wire_items(mission, autopilot), autopilot) == ()
    assert "the jump leads to item 5, but the list has items 0 to 2" in problems(
        replace(JUMP, params=(5.0, 1.0, 0.0, 0.0)), PX4
    )
    home = replace(JUMP, params=(0.0, 1.0, 0.0, 0.0))  # ArduPilot answers ERROR
    assert "the jump leads to item 0, but the list has items 1 to 2" in problems(home, ARDUPILOT)
    assert "a jump" not in problems(home, PX4)


@BOTH
def test_stored_precision(autopilot: Autopilot) -> None:
    item = replace(POSITION, alt_m=60.259, params=(5.9, 2.0, 3.0, 4.0), autocontinue=False)
    stored = stored_item(item, autopilot)
    if autopilot is ARDUPILOT:
        assert (stored.params, stored.alt_m, stored.autocontinue) == ((5.0, 0.0, 0.0, 0.0), float32(60.25), True)
    else:
        assert (stored.params, stored.alt_m) == ((float32(5.9), 2.0, 0.0, 4.0), float32(60.259))
        assert not stored.autocontinue


def test_frames_come_back_changed_on_ardupilot_and_as_they_were_on_px4() -> None:
    for frame in (Frame.AMSL, Frame.ABOVE_HOME, Frame.ABOVE_TERRAIN):
        assert stored_item(replace(POSITION, frame=frame), ARDUPILOT).frame is frame
    assert stored_item(return_to_launch(), ARDUPILOT).frame is Frame.AMSL
    assert stored_item(return_to_launch(), PX4).frame is Frame.COMMAND
    assert [Frame.from_mav_frame(number).wire for number in (0, 5, 3, 6)] == [5, 5, 6, 6]


@pytest.mark.parametrize("command", [16, 21, 22])
def test_nan_is_taken_by_ardupilot_only_as_parameter_4_of_waypoint_land_and_takeoff(command: int) -> None:
    item = replace(POSITION, command=command, params=(0.0, 0.0, 0.0, math.nan))
    assert problems(item, ARDUPILOT) == problems(item, PX4) == ""
    assert "param1: ArduPilot does not accept NaN" in problems(
        replace(item, params=(math.nan, 0.0, 0.0, 0.0)), ARDUPILOT
    )
    assert "param4: ArduPilot does not accept NaN" in problems(replace(item, command=19), ARDUPILOT)
    assert problems(replace(item, command=19), PX4) == ""


def test_the_item_limit_is_the_vehicles_when_it_tells_one() -> None:
    many = [POSITION] * 700
    assert "700 items exceed the ArduPilot limit of 650" in str(check_for_autopilot(many, ARDUPILOT)[0])
    assert check_for_autopilot(many, ARDUPILOT, item_limit=718) == ()
    assert "700 items exceed the PX4 limit of 500" in str(check_for_autopilot(many, PX4, item_limit=500)[0])


def test_a_hold_of_minus_5_seconds_would_come_back_as_65531() -> None:
    item = replace(POSITION, params=(-5.0, 0.0, 0.0, 0.0))
    assert stored_item(item, ARDUPILOT).params[0] == 65531.0
    assert "-5 would become 65531" in problems(item, ARDUPILOT)
    assert "but must not be negative" in problems(item, PX4)


@BOTH
@pytest.mark.parametrize(("change", "field"), [({"lat_deg": 91.0}, "lat_deg"), ({"alt_m": math.nan}, "alt_m"),
                                               ({"lon_deg": 181.0}, "lon_deg"), ({"alt_m": 1e308}, "alt_m")])  # fmt: skip
def test_accepted_is_not_validation_so_it_is_checked_here(
    change: dict[str, float], field: str, autopilot: Autopilot
) -> None:
    assert f"item 1, {field}" in problems(replace(POSITION, **change), autopilot)  # type: ignore[arg-type]


def test_altitudes_are_truncated_to_centimetres_and_those_of_rally_points_to_metres() -> None:
    assert stored_item(replace(POSITION, alt_m=-60.259), ARDUPILOT).alt_m == float32(-60.25)
    rally = MissionItem(Command.NAV_RALLY_POINT, Frame.ABOVE_HOME, lat_deg=33.2, lon_deg=-98.1, alt_m=50.9)
    stored = stored_item(rally, ARDUPILOT)
    assert (stored.alt_m, stored.autocontinue) == (50.0, False)
    assert all(d.acceptable for d in compare_items([rally], [stored], ARDUPILOT, MissionType.RALLY))
    assert not all(
        d.acceptable for d in compare_items([rally], [replace(stored, alt_m=48.0)], ARDUPILOT, MissionType.RALLY)
    )


def test_planes_keep_the_radii_of_a_waypoint_and_never_hold() -> None:
    item = replace(POSITION, params=(0.0, 20.7, -3.0, 0.0))
    assert stored_item(item, ARDUPILOT_PLANE).params == (0.0, 20.0, 255.0, 0.0)
    assert "-3 would become 255" in problems(item, ARDUPILOT_PLANE)
    hold = replace(POSITION, params=(5.0, 0.0, 0.0, 0.0))
    assert "5 would become 0: ArduPilot planes do not hold at a waypoint; use a loiter" in problems(
        hold, ARDUPILOT_PLANE
    )
    (difference,) = compare_items([POSITION, hold], [POSITION, stored_item(hold, ARDUPILOT_PLANE)], ARDUPILOT_PLANE)
    assert not difference.acceptable
    assert problems(hold, ARDUPILOT_ROVER) == ""


@pytest.mark.parametrize(
    ("item", "stored"),
    [
        (MissionItem(17, Frame.AMSL, (1.0, 2.0, -60.5, 1.0), 33.2, -98.1, 50.0), (0.0, 0.0, -60.0, 0.0)),
        (MissionItem(18, Frame.AMSL, (3.0, 2.0, -60.0, 1.0), 33.2, -98.1, 50.0), (3.0, 0.0, -60.0, 1.0)),
        (MissionItem(19, Frame.AMSL, (9.5, 2.0, -60.0, 0.5), 33.2, -98.1, 50.0), (9.0, 0.0, -1.0, 1.0)),
        (MissionItem(31, Frame.AMSL, (1.0, -75.0, 0.0, 1.0), 33.2, -98.1, 50.0), (0.0, -75.0, 0.0, 1.0)),
        (MissionItem(93, Frame.COMMAND, (2.5, -1.0, 12.0, 7.5)), (2.5, -1.0, 12.0, 7.0)),
        (MissionItem(1000, Frame.COMMAND, (-45.5, 190.0, 0.0, 0.0)), (-45.0, 190.0, 0.0, 0.0)),
        (MissionItem(177, Frame.COMMAND, (1.0, -1.0, 5.0, 5.0)), (1.0, -1.0, 0.0, 0.0)),
        (MissionItem(16, Frame.AMSL, (math.inf, math.nan, 0.0, 0.0)), (0.0, 0.0, 0.0, 0.0)),
        (MissionItem(177, Frame.COMMAND, (1.0, math.nan, math.inf, 5.0)), (1.0, 0.0, 0.0, 0.0)),
    ],
)
def test_what_ardupilot_packs_into_its_fifteen_bytes(item: MissionItem, stored: tuple[float, ...]) -> None:
    assert stored_item(item, ARDUPILOT).params == stored


@pytest.mark.parametrize(
    "item",
    [
        MissionItem(18, Frame.AMSL, (300.0, 0.0, 60.0, 0.0), 33.2, -98.1, 50.0),
        MissionItem(18, Frame.AMSL, (3.0, 0.0, 300.0, 0.0), 33.2, -98.1, 50.0),
        MissionItem(1000, Frame.COMMAND, (-200.0, 0.0, 0.0, 0.0)),
        MissionItem(177, Frame.COMMAND, (1.0, 40_000.0, 0.0, 0.0)),
    ],
)
def test_numbers_that_would_wrap_are_found_before_they_are_sent(item: MissionItem) -> None:
    assert " would become " in problems(item, ARDUPILOT)
    assert " would become " not in problems(item, PX4)


@pytest.mark.parametrize(
    ("item", "what"),
    [
        (change_speed(0.0), "the speed must be greater than 0"),
        (change_speed(-1.0), ""),
        (trigger_camera_every(-1.0), "the distance is -1 m"),
        (MissionItem(Command.NAV_DELAY, Frame.COMMAND, (-1.0, 12.0, 30.0, 0.0)), ""),
        (MissionItem(Command.NAV_DELAY, Frame.COMMAND, (-1.0, -1.0, -1.0, -1.0)), "the delay is -1 s"),
    ],
)
def test_numbers_that_no_autopilot_refuses_and_none_can_mean(item: MissionItem, what: str) -> None:
    assert (what in problems(item, PX4)) if what else problems(item, PX4) == ""


SQUARE = (LatLon(33.1, -98.2), LatLon(33.3, -98.2), LatLon(33.3, -98.0), LatLon(33.1, -98.0))


def test_every_fence_vertex_carries_the_count_of_its_polygon() -> None:
    assert [item.params[0] for item in items_from_fence(FENCE)[:7]] == [3.0] * 3 + [4.0] * 4


def bad_fence(name: str) -> list[MissionItem]:
    vertices = list(items_from_fence(Fence((FencePolygon(SQUARE),))))
    point = MissionItem(Command.NAV_FENCE_RETURN_POINT, Frame.ABOVE_HOME, lat_deg=33.2, lon_deg=-98.1)
    crossing = (SQUARE[0], SQUARE[2], SQUARE[1], SQUARE[3])
    return {
        "frame": [replace(item, frame=Frame.COMMAND, lat_deg=0.0, lon_deg=0.0) for item in vertices],
        "no vertices": [replace(item, params=(0.0, 0.0, 0.0, 0.0)) for item in vertices],
        "wrong count": vertices[:3],
        "two return points": [*vertices, point, point],
        "latitude 100": [replace(vertices[0], lat_deg=100.0), *vertices[1:]],
        "two vertices": [replace(item, params=(2.0, 0.0, 0.0, 0.0)) for item in vertices[:2]],
        "circle without a radius": [MissionItem(Command.NAV_FENCE_CIRCLE_INCLUSION, Frame.AMSL, lat_deg=33.2, lon_deg=-98.1)],
        "crossing itself": list(items_from_fence(Fence((FencePolygon(crossing),)))),
        "terrain": [replace(item, frame=Frame.ABOVE_TERRAIN) for item in vertices],
    }[name]  # fmt: skip


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("frame", "crosses or touches itself"),
        ("no vertices", "the polygon has 0 vertices"),
        ("wrong count", "the last polygon has only 3 of its 4"),
        ("two return points", "this is a second return point"),
        ("latitude 100", "latitude must be between -90 and 90, not 100.0"),
        ("two vertices", "the polygon has 2 vertices"),
        ("circle without a radius", "the radius must be above 0, not 0.0 m"),
        ("crossing itself", "fence polygon 0 crosses or touches itself (self-intersection); draw it again"),
        ("terrain", "does not accept heights in frame ABOVE_TERRAIN"),
    ],
)
def test_a_bad_fence_is_found_on_our_side(name: str, what: str) -> None:
    found = check_for_autopilot(bad_fence(name), PX4, MissionType.FENCE)
    assert any(what in str(problem) for problem in found), found


def test_a_fence_across_the_180th_meridian_is_one_for_ardupilot_alone() -> None:
    ring = (LatLon(-17.8, 179.999), LatLon(-17.8, -179.998), LatLon(-17.7, -179.998), LatLon(-17.7, 179.999))
    across, mixed = (
        items_from_fence(Fence((FencePolygon(corners),))) for corners in (ring, (ring[0], ring[2], ring[1], ring[3]))
    )
    assert check_for_autopilot(across, ARDUPILOT, MissionType.FENCE) == ()
    assert "crosses or touches itself" in str(check_for_autopilot(mixed, ARDUPILOT, MissionType.FENCE)[0])
    assert "crosses the 180th meridian, but PX4" in str(check_for_autopilot(across, PX4, MissionType.FENCE)[0])


def test_a_good_fence_and_good_rally_points_raise_nothing() -> None:
    assert check_for_autopilot(items_from_fence(FENCE), ARDUPILOT, MissionType.FENCE) == ()
    rally = [MissionItem(Command.NAV_RALLY_POINT, Frame.ABOVE_HOME, lat_deg=33.2, lon_deg=-98.1, alt_m=50.0)]
    assert check_for_autopilot(rally, ARDUPILOT, MissionType.RALLY) == ()
    assert "is not a rally point" in str(check_for_autopilot([POSITION], ARDUPILOT, MissionType.RALLY)[0])


@BOTH
def test_an_empty_mission_is_nothing_to_complain_of(autopilot: Autopilot) -> None:
    assert check_for_autopilot((), autopilot) == ()
    assert compare_items((), (), autopilot) == ()


@pytest.mark.parametrize(("kind", "wanted"), [(2, ARDUPILOT), (4, ARDUPILOT), (13, ARDUPILOT), (1, ARDUPILOT_PLANE),
                                              (21, ARDUPILOT_PLANE), (10, ARDUPILOT_ROVER), (11, ARDUPILOT_ROVER)])  # fmt: skip
def test_ardupilot_is_another_on_each_kind_of_vehicle(kind: int, wanted: Autopilot) -> None:
    assert autopilot_for(3, kind) is wanted
    assert autopilot_for(12, kind) is PX4


def test_the_published_sample_row_with_longitude_first_is_refused_or_doubted() -> None:
    row = "QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t{}\t{}\t540\t1\n1\t0\t3\t16\t0\t0\t0\t0\t{}\t{}\t60\t1\n"
    right = wpl.read(row.format(47.3, 8.5, 47.31, 8.51))
    assert (right.items[0].lat_deg, right.items[0].lon_deg) == (47.31, 8.51)
    assert right.doubts() == ()
    assert "swapped" in wpl.read(row.format(47.3, 8.5, 8.51, 47.31)).doubts()[0]


def test_what_every_reader_of_waypoints_accepts_is_what_is_written() -> None:
    text = wpl.write_mission(
        Mission(HOME, (replace(POSITION, frame=Frame.ABOVE_TERRAIN), change_speed(1e-5), POSITION))
    )
    header, home, *rows = text.split("\n")
    assert header == "QGC WPL 110"
    assert home.split("\t")[:4] == ["0", "1", "0", "16"]
    assert [row.split("\t")[2] for row in rows[:3]] == ["10", "2", "3"]
    assert all(len(row.split("\t")) == 12 for row in rows[:3])
    assert not set(text.removeprefix(header)) - set("0123456789.-\t\n")
    assert len(rows[0].split("\t")[8].split(".")[1]) == 8
    assert text.endswith("\n")
    assert rows[3:] == [""]


def test_a_plan_has_every_key_that_its_readers_need() -> None:
    document = json.loads(plan.write(plan.PlanFile(MISSION, Fence(), RallyPoints(), 12)))
    assert (document["geoFence"]["version"], document["rallyPoints"]["version"]) == (2, 2)
    assert document["mission"]["firmwareType"] == 12
    assert isinstance(document["mission"]["cruiseSpeed"], int)
    altitude_keys = {"Altitude", "AltitudeMode", "AMSLAltAboveTerrain"}
    for entry in document["mission"]["items"]:
        assert len(altitude_keys & set(entry)) in (0, 3)


def test_fences_and_rally_points_are_exported_as_110_with_commands_5000_to_5100() -> None:
    fence, rally = wpl.write_fence(FENCE, HOME), wpl.write_rally(RALLY, HOME)
    assert {row.split("\t")[3] for row in fence.splitlines()[2:]} == {"5000", "5001", "5002", "5004"}
    assert {row.split("\t")[3] for row in rally.splitlines()[2:]} == {"5100"}
    assert fence.startswith("QGC WPL 110\n")
    point = FramedPoint(33.2, -98.1, 900.0, Frame.AMSL)
    assert wpl.read(wpl.write_rally(RallyPoints((point,)), HOME)).rally().points == (point,)


def test_a_polygon_that_is_none_is_left_to_the_items_to_say() -> None:
    assert fence_problems(Fence((FencePolygon(SQUARE[:2]), FencePolygon((*SQUARE, LatLon(math.nan, 1.0)))))) == ()


def test_an_altitude_one_centimetre_off_is_arithmetic_and_two_are_a_fault() -> None:
    for off_m, acceptable in ((0.0099, True), (0.02, False)):
        (difference,) = compare_items(
            [POSITION] * 2, [POSITION, replace(POSITION, alt_m=POSITION.alt_m - off_m)], ARDUPILOT
        )
        assert difference.acceptable is acceptable


def test_a_frame_that_changes_the_meaning_of_a_height_is_a_fault() -> None:
    (difference,) = compare_items([POSITION] * 2, [POSITION, replace(POSITION, frame=Frame.AMSL)], PX4)
    assert (difference.field, difference.acceptable) == ("frame", False)
    assert difference.why == "the height would refer to a different datum"

"""One test for each row of what a simulated ArduCopter 4.7.0-dev was seen doing, on the mock vehicle."""

import math

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, Mode
from mission_io.model.enums import CommandResult, EkfFlag, MissionResult
from mission_io.model.items import (
    Command,
    Fence,
    FencePolygon,
    Frame,
    LatLon,
    MissionItem,
    MissionType,
    items_from_fence,
)
from mission_io.protocol.terrain import TerrainAnswers
from mission_io.wire import messages as m
from tests.flight.scene import HOME, above_home
from tests.mock.bench import Bench, go, up_there
from uavcover.mock.behaviour import OBSERVED

FENCE, RALLY = MissionType.FENCE, MissionType.RALLY


def switched_on(seconds: float = 3.0, **options) -> Bench:
    bench = Bench(ARDUPILOT, behaviour=OBSERVED[ARDUPILOT.mav_autopilot], **options)
    bench.run(seconds)
    return bench


def ready() -> Bench:
    return switched_on(42.0)


def home_row() -> MissionItem:
    return MissionItem(Command.NAV_WAYPOINT, Frame.AMSL)


def position(frame: int = 3, alt_m: float = 30.0, lat_deg: float = 36.5, **params) -> MissionItem:
    values = tuple(params.get(f"p{n}", 0.0) for n in range(1, 5))
    return MissionItem(Command.NAV_WAYPOINT, Frame(frame), values, lat_deg, -84.2, alt_m)


# "COUNT is answered NO_SPACE in the first 1-2 s after boot: wait and try again. At most 650 items here. It asks with
# MISSION_REQUEST."


def test_a_count_just_after_boot_is_answered_no_space():
    bench = switched_on(1.0)
    assert bench.count(3) == m.MissionAck(255, 190, MissionResult.NO_SPACE)
    bench.run(1.5)
    assert isinstance(bench.count(3), m.MissionRequest)


def test_it_takes_650_items_and_no_more():
    bench = switched_on()
    assert isinstance(bench.count(650), m.MissionRequest)
    assert bench.count(651) == m.MissionAck(255, 190, MissionResult.NO_SPACE)


def test_it_asks_with_the_deprecated_request():
    bench = switched_on()
    bench.count(2)
    assert type(bench.send_item(0, home_row())) is m.MissionRequest


# "Item 0 is overwritten by home: a list sent without a home row loses its first item. MISSION_CURRENT.total leaves home
# out."


def test_item_0_is_overwritten_by_home():
    bench = switched_on(25.0)
    bench.upload([position(lat_deg=10.0), position(lat_deg=36.51)])
    first, second = bench.download()
    here = (HOME.lat_deg, HOME.lon_deg, HOME.alt_amsl_m)
    assert (first.lat_deg, first.lon_deg, first.alt_m) == pytest.approx(here, abs=5e-8)
    assert second.lat_deg == 36.51


def test_mission_currents_total_leaves_home_out():
    bench = switched_on(25.0)
    bench.upload([home_row(), position(), position(), position()])
    bench.command(Command.REQUEST_MESSAGE, 42.0)
    assert bench.heard(m.MissionCurrent)[-1].total == 3


# "Frames come back changed: 0, 2, 5 -> 0; 3, 6 -> 3; 10, 11 -> 10; anything else UNSUPPORTED_FRAME. Altitude is truncated
# to centimetres, rally points to metres. A waypoint loses p2-p4, and p1 is stored as an unsigned 16-bit number: -5 s comes
# back as 65531 s. autocontinue comes back 1."


@pytest.fixture
def bench():
    """One that waits for item 1 of 2."""
    bench = switched_on()
    bench.count(2)
    bench.send_item(0, home_row())
    return bench


@pytest.mark.parametrize(
    ("sent", "back"),
    [
        *(({"frame": sent}, {"frame": back}) for sent, back in ((0, 0), (5, 0), (3, 3), (6, 3), (10, 10), (11, 10))),
        ({"frame": 2, "command": 178}, {"frame": 0}),  # a command without a place
        ({"autocontinue": 0}, {"autocontinue": 1}),
    ],
)
def test_frames_and_autocontinue_come_back_changed(bench, sent, back):
    bench.send_raw_item(1, **sent)
    stored = bench.raw_item(1)
    assert {name: getattr(stored, name) for name in back} == back


@pytest.mark.parametrize("frame", [1, 4, 7, 12, 20])
def test_any_other_frame_is_unsupported(bench, frame):
    assert bench.send_raw_item(1, frame=frame).result == MissionResult.UNSUPPORTED_FRAME


def test_altitudes_are_truncated_to_centimetres():
    bench = switched_on()
    bench.upload([home_row(), position(alt_m=30.129), position(alt_m=-30.129)])
    assert [item.alt_m for item in bench.download()[1:]] == pytest.approx([30.12, -30.12], abs=1e-6)


def test_rally_altitudes_are_truncated_to_metres():
    bench = switched_on()
    bench.upload([MissionItem(Command.NAV_RALLY_POINT, Frame.ABOVE_HOME, (0.0,) * 4, 36.5, -84.2, 40.9)], RALLY)
    assert [item.alt_m for item in bench.download(RALLY)] == [40.0]


def test_a_waypoint_loses_p2_to_p4_and_a_negative_hold_time_becomes_huge():
    bench = switched_on()
    bench.upload([home_row(), position(p1=-5.0, p2=2.0, p3=3.0, p4=90.0)])
    assert bench.download()[1].params == (65531.0, 0.0, 0.0, 0.0)


# "Latitude 91 -> INVALID_PARAM5_X, NaN altitude -> INVALID_PARAM7. A wrong seq -> INVALID_SEQUENCE, and the transfer stays
# open."


@pytest.mark.parametrize(
    ("item", "result"),
    [
        (position(lat_deg=91.0), MissionResult.INVALID_PARAM5_X),
        (position(alt_m=math.nan), MissionResult.INVALID_PARAM7),
    ],
)
def test_impossible_numbers_are_refused(bench, item, result):
    assert bench.send_item(1, item).result == result


def test_a_wrong_seq_is_answered_and_the_transfer_stays_open(bench):
    assert bench.send_item(5, position()).result == MissionResult.INVALID_SEQUENCE
    assert bench.send_item(1, position()).result == MissionResult.ACCEPTED


# "Not atomic: after a failed upload the vehicle holds a mixture of new and old items (fences are atomic, the rally count
# is not)."


def test_a_failed_upload_leaves_a_mixture():
    bench = switched_on()
    bench.upload([home_row(), *(position(lat_deg=36.5) for _ in range(4))])
    bench.count(5)
    bench.send_item(0, home_row())
    bench.send_item(1, position(lat_deg=36.6))
    bench.send_item(2, position(lat_deg=91.0))
    assert [item.lat_deg for item in bench.download()[1:]] == [36.6, 36.5, 36.5, 36.5]


def test_a_failed_fence_upload_leaves_the_old_fence():
    bench = switched_on()
    old = items_from_fence(Fence((square(),)))
    bench.upload(old, FENCE)
    bench.count(4, FENCE)
    bench.send_item(0, old[1], FENCE)
    bench.run(10.0)
    assert [(i.lat_deg, i.lon_deg) for i in bench.download(FENCE)] == [(i.lat_deg, i.lon_deg) for i in old]


def test_a_failed_rally_upload_leaves_another_count():
    bench = switched_on()
    point = MissionItem(Command.NAV_RALLY_POINT, Frame.ABOVE_HOME, (0.0,) * 4, 36.5, -84.2, 40.0)
    bench.upload([point] * 4, RALLY)
    bench.count(2, RALLY)
    bench.run(10.0)
    assert len(bench.download(RALLY)) == 2


# "Another component in the middle of an upload -> DENIED. A denied CLEAR_ALL sends two ACKs. Time-outs run in simulated
# time."


def test_another_component_in_the_middle_is_denied():
    bench = switched_on()
    bench.count(5)
    [answer] = bench.send(m.MissionCount(1, 1, 3), component_id=191)
    assert answer.result == MissionResult.DENIED
    assert isinstance(bench.send_item(0, home_row()), m.MissionRequest)


def test_a_denied_clear_sends_two_acks():
    bench = switched_on()
    bench.count(5)
    answers = bench.send(m.MissionClearAll(1, 1), component_id=191)
    assert [a.result for a in answers] == [MissionResult.DENIED, MissionResult.ERROR]


def test_time_outs_run_in_simulated_time():
    bench = switched_on(speed=10.0)
    bench.count(5)
    bench.said.clear()
    bench.run(7.9)
    assert len(bench.heard(m.MissionRequest)) == 7  # again each second
    assert not bench.heard(m.MissionAck)
    bench.run(0.2)
    assert [a.result for a in bench.heard(m.MissionAck)] == [MissionResult.OPERATION_CANCELLED]


# "A fence circle with radius <= 0 or a polygon of 2 points -> ERROR; a self-crossing polygon is accepted."


def fence_vertex(lat_deg: float, lon_deg: float, size: float) -> MissionItem:
    return MissionItem(5001, Frame.AMSL, (size, 0.0, 0.0, 0.0), lat_deg, lon_deg)


def square() -> FencePolygon:
    return FencePolygon((LatLon(36.4, -84.3), LatLon(36.6, -84.3), LatLon(36.6, -84.1), LatLon(36.4, -84.1)))


@pytest.mark.parametrize("radius_m", [0.0, -5.0])
def test_a_fence_circle_without_a_radius_is_an_error(radius_m):
    bench = switched_on()
    bench.count(1, FENCE)
    circle = MissionItem(5003, Frame.AMSL, (radius_m, 0.0, 0.0, 0.0), 36.5, -84.2)
    assert bench.send_item(0, circle, FENCE).result == MissionResult.ERROR


def test_a_polygon_of_two_points_is_an_error():
    bench = switched_on()
    bench.count(2, FENCE)
    bench.send_item(0, fence_vertex(36.5, -84.2, 2.0), FENCE)
    assert bench.send_item(1, fence_vertex(36.6, -84.2, 2.0), FENCE).result == MissionResult.ERROR


def test_a_self_crossing_polygon_is_accepted():
    bench = switched_on()
    corners = [(36.4, -84.3), (36.6, -84.1), (36.6, -84.3), (36.4, -84.1)]
    bench.upload([fence_vertex(lat, lon, 4.0) for lat, lon in corners], FENCE)


# "No telemetry streams by default: ask with SET_MESSAGE_INTERVAL. The pre-arm bit is good about 18 s before arming works:
# wait for EKF_STATUS_REPORT with 0x10 set and 0x80 clear. Ready to arm after about 41 s of simulated time."


def test_it_tells_nothing_unasked_but_its_heartbeat_and_texts():
    bench = ready()
    assert {type(message) for message in bench.said} == {m.Heartbeat, m.StatusText}
    assert bench.command(Command.SET_MESSAGE_INTERVAL, 33.0, 1e5) is CommandResult.ACCEPTED
    bench.run(1.0)
    assert len(bench.heard(m.GlobalPositionInt)) == pytest.approx(10, abs=1)


def test_the_pre_arm_bit_comes_18_s_before_arming_works():
    bench = switched_on(0.0)
    for number in (1.0, 193.0):
        bench.command(Command.SET_MESSAGE_INTERVAL, number, 1e5)
    first: dict[str, float] = {}
    while bench.now < 45.0:
        bench.run(0.5)
        if bench.heard(m.SysStatus)[-1].sensors_healthy & m.PREARM_CHECK_BIT:
            first.setdefault("bit", bench.now)
        flags = bench.heard(m.EkfStatusReport)[-1].flags
        if flags & EkfFlag.POSITION_HORIZONTAL_ABSOLUTE and not flags & EkfFlag.CONSTANT_POSITION:
            first.setdefault("filter", bench.now)
        if bench.now > 3.0 and bench.vehicle.mode is not Mode.GUIDED:
            bench.set_mode(Mode.GUIDED)
        if not bench.vehicle.armed and bench.command(Command.COMPONENT_ARM_DISARM, 1.0) is CommandResult.ACCEPTED:
            first.setdefault("armed", bench.now)
    assert first["bit"] == pytest.approx(41.0 - 18.0, abs=1.0)
    assert first["armed"] == pytest.approx(41.0, abs=1.0)
    assert first["filter"] == pytest.approx(first["armed"], abs=0.5)


def test_it_says_what_it_waits_for_and_knows_home_with_the_origin():
    bench = switched_on(20.0)
    assert bench.command(Command.REQUEST_MESSAGE, 242.0) is CommandResult.ACCEPTED
    assert not bench.heard(m.HomePosition)
    bench.run(25.0)
    bench.command(Command.REQUEST_MESSAGE, 242.0)
    assert bench.heard(m.HomePosition)
    texts = [text.text for text in bench.heard(m.StatusText)]
    assert texts.index("PreArm: GPS 1: Bad fix") < texts.index("PreArm: Need Position Estimate")
    assert texts[-1] == "EKF3 IMU0 is using GPS"


# "To fly: GUIDED -> arm -> AUTO -> COMMAND MISSION_START. In flight an upload is accepted and restarts the active item;
# CLEAR_ALL is refused with ERROR."


def test_to_fly_is_guided_arm_auto_start():
    bench = ready()
    bench.load(*up_there(go(0, 50, 20)))
    assert bench.set_mode(Mode.MISSION) is CommandResult.ACCEPTED
    assert bench.command(Command.COMPONENT_ARM_DISARM, 1.0) is CommandResult.FAILED
    assert bench.set_mode(Mode.GUIDED) is CommandResult.ACCEPTED
    assert bench.command(Command.COMPONENT_ARM_DISARM, 1.0) is CommandResult.ACCEPTED
    assert bench.set_mode(Mode.MISSION) is CommandResult.ACCEPTED
    bench.run(5.0)
    assert bench.vehicle.body.on_ground
    assert bench.command(Command.MISSION_START) is CommandResult.ACCEPTED
    bench.run(5.0)
    assert not bench.vehicle.body.on_ground


def test_an_upload_in_flight_restarts_the_active_item_and_clearing_is_an_error():
    bench = ready()
    bench.take_off(go(0, 300, 20))
    bench.run(15.0)
    active = bench.vehicle.current_seq
    bench.load(*up_there(go(0, -300, 20)))
    assert bench.vehicle.current_seq == active
    bench.run(12.0)
    assert bench.vehicle.body.point.velocity_m_s[1] < -5.0
    assert bench.send(m.MissionClearAll(1, 1)) == [m.MissionAck(255, 190, MissionResult.ERROR)]
    assert len(bench.download()) == 3


# "Terrain frames need somebody to answer TERRAIN_REQUEST with TERRAIN_DATA."


def test_terrain_frames_need_somebody_to_answer_terrain_requests():
    def hill(lat_deg: float, lon_deg: float) -> float:
        return 300.0 + 2000.0 * (lat_deg - HOME.lat_deg) - 1000.0 * (lon_deg - HOME.lon_deg)

    bench = ready()
    lat, lon, _ = above_home((40.0, 120.0, 0.0))
    bench.load(*up_there(MissionItem(Command.NAV_WAYPOINT, Frame.ABOVE_TERRAIN, (0.0,) * 4, lat, lon, 40.0)))
    bench.set_mode(Mode.GUIDED)
    assert bench.command(Command.COMPONENT_ARM_DISARM, 1.0) is CommandResult.FAILED
    assert bench.heard(m.StatusText)[-1].text == "PreArm: waiting for terrain data"
    bench.run(5.0)
    assert not bench.heard(m.TerrainRequest)  # it requests nothing on a link that has not asked for it
    assert bench.command(Command.SET_MESSAGE_INTERVAL, 133.0, 5e5) is CommandResult.ACCEPTED
    answers = TerrainAnswers(lambda positions: [hill(*position) for position in positions], parts_per_s=1000.0)
    for turn in range(40):
        bench.run(2.1)
        for request in bench.heard(m.TerrainRequest)[-1:]:
            answers.receive(m.Received(request, 1, 1, 2), turn)
            for data in answers.messages_to_send(turn + 1.0):
                bench.send(data)
        bench.said.clear()
    bench.said.clear()
    bench.run(5.0)
    assert not bench.heard(m.TerrainRequest)
    bench.take_off()
    bench.run(25.0)
    assert bench.vehicle.body.point.position_m[2] == pytest.approx(hill(lat, lon) + 40.0 - HOME.alt_amsl_m, abs=1.5)
    bench.command(Command.REQUEST_MESSAGE, 136.0)
    report = bench.heard(m.TerrainReport)[-1]
    assert report.height_above_terrain_m == pytest.approx(40.0, abs=2.5)
    assert report.pending == 0

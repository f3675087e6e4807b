"""The mock vehicle on its own: what it answers, what it refuses, what it does when it is told something."""

import math

import numpy as np
import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Mode
from mission_io.model.enums import CommandResult, EkfFlag, LandedState, MissionResult, MissionState
from mission_io.model.items import Command, Frame, GeoPoint, delay, land, takeoff, waypoint
from mission_io.wire import messages as m
from mission_io.wire.codec import message_id
from tests.flight.scene import HOME, above_home
from tests.mock.bench import Bench, go, ready, up_there
from uavcover.flight.orders import custom_mode
from uavcover.mock.behaviour import Settings, quick
from uavcover.mock.dynamics import WindModel
from uavcover.mock.telemetry import MOCK_UID

BOTH = pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)


# Telemetry.


@BOTH
def test_it_tells_about_itself_by_default(autopilot):
    bench = Bench(autopilot)
    bench.run(10.0)
    for kind, least in [
        (m.Heartbeat, 10), (m.GlobalPositionInt, 100), (m.Attitude, 100), (m.MissionCurrent, 10), (m.SysStatus, 10),
        (m.GpsRawInt, 10), (m.ExtendedSysState, 10), (m.HomePosition, 1), (m.SystemTime, 10),
    ]:  # fmt: skip
        assert len(bench.heard(kind)) >= least, kind
    assert bool(bench.heard(m.EkfStatusReport)) is (autopilot is ARDUPILOT)
    times = [position.time_boot_s for position in bench.heard(m.GlobalPositionInt)]
    assert np.diff(times) == pytest.approx(0.1)
    assert bench.heard(m.HomePosition)[0] == m.HomePosition(HOME.lat_deg, HOME.lon_deg, HOME.alt_amsl_m)


def test_an_interval_can_be_asked_for_and_taken_back():
    bench = ready()
    number = message_id(m.Attitude)
    assert bench.command(Command.SET_MESSAGE_INTERVAL, number, 1e6) is CommandResult.ACCEPTED
    bench.said.clear()
    bench.run(10.0)
    assert len(bench.heard(m.Attitude)) == 10
    assert bench.command(Command.SET_MESSAGE_INTERVAL, number, -1.0) is CommandResult.ACCEPTED
    bench.said.clear()
    bench.run(2.0)
    assert not bench.heard(m.Attitude)
    assert bench.command(Command.SET_MESSAGE_INTERVAL, number, 0.0) is CommandResult.ACCEPTED
    bench.run(2.0)
    assert len(bench.heard(m.Attitude)) == pytest.approx(20, abs=1)
    assert bench.command(Command.SET_MESSAGE_INTERVAL, 9999.0, 1e6) is CommandResult.DENIED


def test_messages_are_sent_on_request():
    bench = ready()
    bench.said.clear()
    assert bench.command(Command.REQUEST_MESSAGE, message_id(m.AutopilotVersion)) is CommandResult.ACCEPTED
    assert bench.heard(m.AutopilotVersion)[0].uid == MOCK_UID
    assert bench.command(Command.REQUEST_AUTOPILOT_CAPABILITIES, 1.0) is CommandResult.ACCEPTED
    assert bench.command(Command.GET_HOME_POSITION) is CommandResult.ACCEPTED
    assert bench.heard(m.HomePosition)
    assert bench.command(Command.REQUEST_MESSAGE, 9999.0) is CommandResult.UNSUPPORTED


def test_the_pre_arm_bit_is_good_before_arming_works():
    bench = Bench(behaviour=quick(10.0))
    bench.run(7.0)
    status = bench.heard(m.SysStatus)[-1]
    assert status.sensors_healthy & m.PREARM_CHECK_BIT
    assert bench.heard(m.EkfStatusReport)[-1].flags & EkfFlag.CONSTANT_POSITION
    assert bench.set_mode(Mode.GUIDED) is CommandResult.ACCEPTED
    assert bench.command(Command.COMPONENT_ARM_DISARM, 1.0) is CommandResult.FAILED
    assert "PreArm: Need Position Estimate" in [text.text for text in bench.heard(m.StatusText)]
    bench.run(4.0)
    assert not bench.heard(m.EkfStatusReport)[-1].flags & EkfFlag.CONSTANT_POSITION
    assert bench.command(Command.COMPONENT_ARM_DISARM, 1.0) is CommandResult.ACCEPTED


# Arming and modes.


def test_ardupilot_does_not_arm_in_auto_and_disarms_when_nothing_follows():
    bench = ready()
    bench.load(*up_there())
    assert bench.set_mode(Mode.MISSION) is CommandResult.ACCEPTED
    assert bench.command(Command.COMPONENT_ARM_DISARM, 1.0) is CommandResult.FAILED
    assert bench.set_mode(Mode.GUIDED) is CommandResult.ACCEPTED
    assert bench.command(Command.COMPONENT_ARM_DISARM, 1.0) is CommandResult.ACCEPTED
    assert bench.command(Command.COMPONENT_ARM_DISARM, 1.0) is CommandResult.ACCEPTED
    bench.run(11.0)
    assert not bench.vehicle.armed


@BOTH
def test_mission_mode_needs_a_mission(autopilot):
    bench = ready(autopilot)
    assert bench.set_mode(Mode.MISSION) is CommandResult.FAILED
    assert bench.command(Command.MISSION_START) is CommandResult.FAILED


def test_px4_does_not_arm_in_mission_mode_when_the_mission_is_gone():
    bench = ready(PX4)
    bench.load(*up_there())
    bench.set_mode(Mode.MISSION)
    bench.send(m.MissionClearAll(1, 1))
    assert bench.command(Command.COMPONENT_ARM_DISARM, 1.0) is CommandResult.TEMPORARILY_REJECTED


def test_modes_need_a_position_and_unknown_ones_are_denied():
    bench = Bench(behaviour=quick(10.0))
    bench.run(1.0)
    assert bench.set_mode(Mode.GUIDED) is CommandResult.FAILED
    assert bench.command(Command.DO_SET_MODE, 1.0, 77.0) is CommandResult.DENIED


def test_set_mode_messages_and_start_before_the_mode_work_like_commands():
    """MISSION_START changes to AUTO by itself, from any mode (ArduCopter 4.7)."""
    bench = ready()
    bench.load(*up_there(go(0, 50, 20)))
    bench.send(m.SetMode(1, 1, custom_mode(ARDUPILOT, Mode.GUIDED)))
    assert bench.vehicle.mode is Mode.GUIDED
    bench.command(Command.COMPONENT_ARM_DISARM, 1.0)
    assert bench.command(Command.MISSION_START) is CommandResult.ACCEPTED
    assert bench.vehicle.mode is Mode.MISSION
    bench.run(5.0)
    assert bench.vehicle.flying
    assert bench.command(Command.MISSION_START, 2.0) is CommandResult.DENIED


def test_what_ardupilot_does_with_the_calls_of_mavsdk_before_it_is_armed():
    """Start is accepted disarmed; then MAVSDK holds before it arms, in BRAKE, where ArduCopter 4.7 refuses to arm."""
    bench = ready()
    bench.load(*up_there(go(0, 50, 20)))
    assert bench.command(Command.DO_SET_MODE, 1.0, 3.0) is CommandResult.ACCEPTED
    assert bench.command(Command.MISSION_START) is CommandResult.ACCEPTED
    bench.run(2.0)
    assert not bench.vehicle.flying
    assert bench.command(Command.DO_SET_MODE, 1.0, 17.0) is CommandResult.ACCEPTED
    bench.said.clear()
    assert bench.command(Command.COMPONENT_ARM_DISARM, 1.0) is CommandResult.FAILED
    bench.run(1.5)
    assert bench.heard(m.StatusText)[0].text == "Arm: BRAKE mode not armable"
    assert bench.heard(m.Heartbeat)[-1].custom_mode == 17


def test_ardupilot_refuses_a_mission_without_a_take_off_on_the_ground():
    bench = ready()
    bench.load(go(0, 50, 20), go(0, 80, 20))
    assert bench.command(Command.DO_SET_MODE, 1.0, 3.0) is CommandResult.ACCEPTED, "disarmed it may"
    assert bench.set_mode(Mode.GUIDED) is CommandResult.ACCEPTED
    assert bench.command(Command.COMPONENT_ARM_DISARM, 1.0) is CommandResult.ACCEPTED
    bench.said.clear()
    assert bench.command(Command.MISSION_START) is CommandResult.FAILED
    bench.run(0.1)
    assert [said.text for said in bench.heard(m.StatusText)] == [
        "Auto: Missing Takeoff Cmd",
        "Mode change to AUTO failed: init failed",
    ]
    assert bench.vehicle.mode is Mode.GUIDED


def test_commands_for_others_are_not_answered():
    bench = ready()
    assert bench.send(m.CommandLong(2, 1, Command.MISSION_START, (0.0,) * 7)) == []
    assert bench.command(31000) is CommandResult.UNSUPPORTED


@BOTH
def test_in_the_air_it_is_not_disarmed_unless_forced(autopilot):
    bench = ready(autopilot)
    bench.take_off(go(0, 50, 20))
    assert bench.command(Command.COMPONENT_ARM_DISARM, 0.0) is CommandResult.DENIED
    assert bench.command(Command.COMPONENT_ARM_DISARM, 0.0, 21196.0) is CommandResult.ACCEPTED
    assert bench.vehicle.body.crashed


# Flying.


@BOTH
def test_pause_holds_and_continue_goes_on(autopilot):
    bench = ready(autopilot)
    bench.take_off(go(0, 300, 20))
    bench.run(10.0)
    assert bench.command(Command.DO_PAUSE_CONTINUE, 0.0) is CommandResult.ACCEPTED
    bench.run(8.0)
    at = bench.vehicle.body.point.position_m
    assert bench.heard(m.MissionCurrent)[-1].state == MissionState.PAUSED
    bench.run(20.0)
    assert bench.vehicle.body.point.position_m == pytest.approx(at, abs=0.1)
    assert bench.command(Command.DO_PAUSE_CONTINUE, 1.0) is CommandResult.ACCEPTED
    bench.run(5.0)
    assert bench.vehicle.body.point.position_m[1] > at[1] + 10.0


@BOTH
def test_return_climbs_goes_home_lands_and_disarms(autopilot):
    bench = ready(autopilot)
    bench.take_off(go(40, 60, 20))
    bench.run(12.0)
    assert bench.command(Command.NAV_RETURN_TO_LAUNCH) is CommandResult.ACCEPTED
    heights = []
    for _ in range(120):
        bench.run(1.0)
        heights.append(bench.up_m)
    assert max(heights) == pytest.approx(Settings().return_height_m, abs=1.0)
    assert not bench.vehicle.armed
    assert math.hypot(*bench.vehicle.body.point.position_m[:2]) < 1.0
    states = [state.landed_state for state in bench.heard(m.ExtendedSysState)]
    assert states[0] == LandedState.ON_GROUND
    assert {LandedState.IN_AIR, LandedState.LANDING} <= set(states)
    assert states[-1] == LandedState.ON_GROUND


def test_land_comes_down_where_it_is():
    bench = ready()
    bench.take_off(go(40, 60, 20))
    bench.run(12.0)
    assert bench.command(Command.NAV_LAND) is CommandResult.ACCEPTED
    bench.run(60.0)
    assert not bench.vehicle.armed
    assert math.hypot(*bench.vehicle.body.point.position_m[:2]) > 20.0


@BOTH
def test_another_item_can_be_made_current(autopilot):
    bench = ready(autopilot)
    bench.take_off(go(0, 200, 20), go(200, 0, 20), go(0, -200, 20))
    first = 1 if autopilot is ARDUPILOT else 0
    assert bench.command(Command.DO_SET_MISSION_CURRENT, first + 3.0) is CommandResult.ACCEPTED
    bench.run(10.0)
    assert bench.vehicle.body.point.position_m[1] < -20.0
    bench.send(m.MissionSetCurrent(1, 1, first + 2))
    assert bench.vehicle.current_seq == first + 2
    assert bench.command(Command.DO_SET_MISSION_CURRENT, 99.0) is CommandResult.DENIED


def test_speeds_can_be_changed_by_command_and_by_parameter():
    bench = ready()
    bench.take_off(go(0, 900, 20))
    bench.run(10.0)
    assert bench.command(Command.DO_CHANGE_SPEED, 1.0, 4.0, -1.0) is CommandResult.ACCEPTED
    bench.run(10.0)
    assert bench.vehicle.body.point.velocity_m_s[1] == pytest.approx(4.0, abs=0.1)
    for kind, attribute in [(2.0, "climb_m_s"), (3.0, "descent_m_s")]:
        bench.command(Command.DO_CHANGE_SPEED, kind, 1.5)
        assert getattr(bench.vehicle.speeds, attribute) == 1.5
    before = bench.vehicle.speeds
    bench.command(Command.DO_CHANGE_SPEED, 1.0, -1.0)
    assert bench.vehicle.speeds == before


def test_waits_and_radii_of_the_mission_are_kept():
    bench = ready(PX4)
    bench.take_off(go(0, 30, 20, hold_s=5.0), delay(4.0), go(0, 60, 20, acceptance_radius_m=9.0))
    reached = {}
    for _ in range(400):
        bench.run(0.1)
        for message in bench.heard(m.MissionItemReached):
            reached.setdefault(message.seq, (bench.now, bench.vehicle.body.point.position_m))
    assert reached[2][0] - reached[1][0] == pytest.approx(4.0, abs=0.2)
    assert 60.0 - reached[3][1][1] == pytest.approx(9.0, abs=2.0)
    assert bench.vehicle.mission_state is MissionState.COMPLETE
    assert bench.heard(m.MissionCurrent)[-1].state == MissionState.COMPLETE


@BOTH
def test_an_upload_in_flight_restarts_the_active_item(autopilot):
    bench = ready(autopilot)
    bench.take_off(go(0, 300, 20))
    bench.run(15.0)
    assert bench.vehicle.body.point.velocity_m_s[1] > 5.0
    bench.load(*up_there(go(0, -300, 20)))
    bench.run(10.0)
    assert bench.vehicle.body.point.velocity_m_s[1] < -5.0


def test_ardupilot_keeps_its_mission_in_flight_and_its_home_in_item_0():
    bench = ready()
    bench.load(*up_there(go(0, 300, 20)))
    home = bench.vehicle.mission_items[0]
    assert (home.lat_deg, home.lon_deg, home.alt_m) == (HOME.lat_deg, HOME.lon_deg, HOME.alt_amsl_m)
    assert bench.heard(m.MissionCurrent)[-1].total in (None, 0, 2)
    bench.run(1.1)
    assert bench.heard(m.MissionCurrent)[-1].total == 2
    bench.take_off()
    [answer] = bench.send(m.MissionClearAll(1, 1))
    assert answer == m.MissionAck(255, 190, MissionResult.ERROR, 0)
    assert len(bench.vehicle.mission_items) == 3


def test_uploads_just_after_boot_are_refused_for_two_seconds_of_vehicle_time():
    bench = Bench(speed=100.0)
    bench.run(1.0)
    assert bench.send(m.MissionCount(1, 1, 3))[-1].result == MissionResult.NO_SPACE
    bench.run(1.5)
    assert isinstance(bench.send(m.MissionCount(1, 1, 3))[-1], m.MissionRequest)


def test_over_given_ground_terrain_heights_are_followed_and_hitting_it_is_a_crash():
    def slope(lat_deg: float, lon_deg: float) -> float:
        del lon_deg
        return HOME.alt_amsl_m + max(0.0, (lat_deg - HOME.lat_deg) * 111_000.0 * 0.5)

    bench = ready(ground=slope)
    over = waypoint(*above_home((0.0, 100.0, 0.0))[:2], 30.0, frame=Frame.ABOVE_TERRAIN)
    bench.take_off(over)
    bench.run(30.0)
    assert bench.up_m == pytest.approx(80.0, abs=2.5)
    bench.load(*up_there(over, go(0, 400, 100)))
    bench.command(Command.DO_SET_MISSION_CURRENT, 3.0)
    bench.run(60.0)
    assert bench.vehicle.body.crashed
    assert not bench.vehicle.armed
    assert any(text.text.startswith("Crash") for text in bench.heard(m.StatusText))


def test_landing_beside_home_on_a_slope_ends_on_the_ground_there():
    def slope(lat_deg: float, lon_deg: float) -> float:
        del lon_deg
        return HOME.alt_amsl_m + (lat_deg - HOME.lat_deg) * 111_000.0 * 0.1

    bench = ready(ground=slope)
    bench.take_off(go(0, 50, 30), land(*above_home((0.0, 50.0, 5.0)), frame=Frame.ABOVE_HOME))
    bench.run(80.0)
    assert not bench.vehicle.armed
    assert bench.up_m == pytest.approx(5.0, abs=0.1)


def test_flat_ground_does_not_stop_a_route_below_home():
    bench = ready()
    bench.take_off(go(0, 60, -30), go(0, 90, 10))
    lowest = 0.0
    for _ in range(60):
        bench.run(0.5)
        lowest = min(lowest, bench.up_m)
    assert lowest < -25.0
    assert bench.vehicle.armed


def test_settings_refuse_what_makes_no_sense():
    with pytest.raises(ValueError, match="cruise_m_s: must be greater than 0, not 0"):
        Settings(cruise_m_s=0)


def test_it_is_deterministic_to_the_last_message():
    def story() -> list[m.Message]:
        bench = ready(rng=np.random.default_rng(4), home=GeoPoint(1.0, 2.0, 3.0), wind=WindModel(gust_m_s=1.0))
        bench.load(takeoff(0.0, 0.0, 20.0, frame=Frame.ABOVE_HOME))
        bench.take_off()
        bench.run(5.0)
        return bench.said

    assert story() == story()

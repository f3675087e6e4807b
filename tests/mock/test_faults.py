"""Faults by name: how they are written, when they begin, what the vehicle does then, and what ends them."""

import math

import numpy as np
import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Mode
from mission_io.model.enums import CommandResult, EkfFlag, LandedState, MissionState
from mission_io.model.items import Command
from mission_io.wire import messages as m
from tests.mock.bench import Bench, go, ready, up_there
from uavcover.errors import InputError
from uavcover.mock.faults import Fault, FaultKind, FaultSchedule, FaultTrigger, Since, parse_fault

BOTH = pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("gps-loss", Fault(FaultKind.GPS_LOSS, FaultTrigger(Since.TAKE_OFF, 20.0))),
        ("gps-loss@40s", Fault(FaultKind.GPS_LOSS, FaultTrigger(Since.TAKE_OFF, 40.0))),
        ("gps-loss:30@boot+2.5s", Fault(FaultKind.GPS_LOSS, FaultTrigger(Since.BOOT, 2.5), 30.0)),
        ("link-outage", Fault(FaultKind.LINK_OUTAGE, FaultTrigger(Since.TAKE_OFF, 20.0), 10.0)),
        ("pilot-mode:land@item5", Fault(FaultKind.PILOT_MODE, FaultTrigger(Since.ITEM, 5.0), mode=Mode.LAND)),
        ("battery-failsafe", Fault(FaultKind.BATTERY_FAILSAFE, FaultTrigger(Since.TAKE_OFF, 20.0), mode=Mode.RETURN)),
        ("arming-refused", Fault(FaultKind.ARMING_REFUSED, FaultTrigger(Since.BOOT, 0.0))),
        ("mission-changed@item3", Fault(FaultKind.MISSION_CHANGED, FaultTrigger(Since.ITEM, 3.0))),
    ],
)
def test_faults_are_read_as_they_are_written(text, fault):
    assert parse_fault(text) == fault
    assert parse_fault(str(fault)) == fault


@pytest.mark.parametrize("kind", FaultKind)
def test_every_fault_can_be_asked_for_by_its_name_alone(kind):
    assert parse_fault(kind.value).kind is kind


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("engine-fire", "use one of heartbeat-loss, gps-loss"),
        ("gps-loss@soon", r"'soon' is not a time or an item, such as 40s, boot\+40s or item5"),
        ("gps-loss:-3", "expected a number above 0"),
        ("gps-loss:nan", "expected a number above 0"),
        ("pilot-mode:acro", "'pilot-mode:acro': expected the mode: hold, land"),
        ("mission-changed:4", "does not accept a value after the colon"),
        ("", "unknown name"),
    ],
)
def test_what_is_no_fault_is_refused_with_what_would_be_one(text, says):
    with pytest.raises(InputError, match=says):
        parse_fault(text)


def flying(autopilot, fault: str, **options) -> Bench:
    """A vehicle on a long leg north, with a fault to come."""
    bench = ready(autopilot, faults=[parse_fault(fault)], **options)
    bench.take_off(go(0, 150, 20), go(0, 300, 20), go(0, 450, 20), go(0, 600, 20))
    return bench


def run_to(bench: Bench, seconds: float) -> None:
    """On to so many seconds after it left the ground."""
    took_off_s = bench.vehicle.took_off_at_s
    assert took_off_s is not None
    bench.run(took_off_s + seconds - bench.vehicle.powered_s)


def reported(bench: Bench) -> str:
    return " | ".join(text.text for text in bench.heard(m.StatusText))


@BOTH
def test_without_faults_nothing_is_wrong(autopilot):
    bench = flying(autopilot, "gps-loss@item9999")
    bench.run(120.0)
    assert bench.vehicle.faults.begun == []
    assert bench.vehicle.mission_state is MissionState.COMPLETE


@BOTH
def test_heartbeat_loss_takes_the_heartbeats_and_nothing_else(autopilot):
    bench = flying(autopilot, "heartbeat-loss:6@10s")
    run_to(bench, 12.0)
    bench.said.clear()
    bench.run(3.0)
    assert not bench.heard(m.Heartbeat)
    assert len(bench.heard(m.GlobalPositionInt)) == 30
    bench.run(10.0)
    assert bench.heard(m.Heartbeat)


@BOTH
def test_gps_loss_lands_where_it_is_and_the_position_runs_away(autopilot):
    bench = flying(autopilot, "gps-loss@15s")
    run_to(bench, 20.0)
    assert bench.vehicle.mode is Mode.LAND
    assert bench.heard(m.GpsRawInt)[-1].fix_type < 3
    assert bench.heard(m.GpsRawInt)[-1].satellites_visible == 0
    bench.said.clear()
    bench.run(20.0)
    if autopilot is ARDUPILOT:
        assert bench.heard(m.EkfStatusReport)[-1].flags & EkfFlag.CONSTANT_POSITION
        assert math.hypot(*bench.vehicle.body.believed.error_m[:2]) == pytest.approx(0.6 * 25, abs=3.0)
    else:
        assert not bench.heard(m.GlobalPositionInt)
    bench.run(60.0)
    assert not bench.vehicle.armed
    assert not bench.vehicle.body.crashed


def test_a_short_gps_loss_heals_and_the_mode_stays():
    bench = flying(ARDUPILOT, "gps-loss:5@15s")
    bench.run(35.0)
    assert "EKF Failsafe: changed to LAND Mode" in reported(bench)
    assert bench.vehicle.has_fix
    assert bench.vehicle.body.believed.error_m == pytest.approx((0.0, 0.0, 0.0), abs=0.01)
    assert bench.vehicle.mode is Mode.LAND


@BOTH
@pytest.mark.parametrize(("argument", "mode"), [("", Mode.RETURN), (":land", Mode.LAND)])
def test_a_battery_failsafe_brings_it_down_and_says_so(autopilot, argument, mode):
    bench = flying(autopilot, f"battery-failsafe{argument}@15s")
    bench.run(20.0)
    assert bench.vehicle.mode is mode
    assert bench.heard(m.SysStatus)[-1].battery_remaining_percent <= 6
    assert "attery" in reported(bench)
    bench.run(120.0)
    assert not bench.vehicle.armed
    assert not bench.vehicle.body.crashed
    # It does not take off again with what is left.
    assert bench.set_mode(Mode.GUIDED) is CommandResult.ACCEPTED
    assert bench.command(Command.COMPONENT_ARM_DISARM, 1.0) is not CommandResult.ACCEPTED


@BOTH
def test_the_pilot_changes_the_mode(autopilot):
    bench = flying(autopilot, "pilot-mode@15s")
    bench.run(30.0)
    assert bench.vehicle.mode is Mode.HOLD
    assert bench.heard(m.MissionCurrent)[-1].state == MissionState.PAUSED
    assert math.hypot(*bench.vehicle.body.point.velocity_m_s) < 0.1


@BOTH
def test_a_reboot_in_flight_is_silence_a_fall_and_a_new_start(autopilot):
    bench = flying(autopilot, "reboot:4@10s")
    bench.load(*up_there(go(0, 800, 80)))
    run_to(bench, 9.0)
    items = bench.vehicle.mission_items
    bench.run(2.0)
    bench.said.clear()
    bench.run(1.0)
    assert bench.said == []
    assert bench.send(m.CommandLong(1, 1, Command.MISSION_START, (0.0,) * 7)) == []
    bench.run(8.0)
    assert bench.vehicle.body.crashed
    assert bench.vehicle.body.on_ground
    assert bench.heard(m.GlobalPositionInt)[0].time_boot_s < 1.0
    assert not bench.vehicle.armed
    assert bench.vehicle.mission_items == items
    assert bench.heard(m.ExtendedSysState)[-1].landed_state == LandedState.ON_GROUND


@BOTH
def test_a_link_outage_lasts_as_long_on_the_links_clock(autopilot):
    bench = flying(autopilot, "link-outage:0.5@10s", speed=10.0)
    run_to(bench, 11.0)
    bench.said.clear()
    bench.run(2.5)
    assert bench.said == []
    assert bench.send(m.MissionRequestList(1, 1)) == []
    bench.run(6.0)
    assert bench.heard(m.Heartbeat)
    assert bench.vehicle.mode is Mode.MISSION


@BOTH
def test_stuck_reaches_the_item_and_stays_there_until_it_comes_loose(autopilot):
    item = 3 if autopilot is ARDUPILOT else 2
    bench = flying(autopilot, f"stuck:60@item{item}")
    bench.run(60.0)
    assert bench.vehicle.current_seq == item
    assert bench.vehicle.body.point.position_m == pytest.approx((0.0, 300.0, 20.0), abs=0.5)
    assert bench.vehicle.mission_state is MissionState.ACTIVE
    for _ in range(140):
        bench.run(0.5)
        if bench.vehicle.current_seq > item:
            break
    # It counted the item only when legs that had stood still came by there, and it was tens of metres further by then.
    assert bench.vehicle.current_seq > item
    assert bench.vehicle.body.point.position_m == pytest.approx((0.0, 300.0, 20.0), abs=5.0)


@BOTH
def test_refused_arming_says_why_and_ends(autopilot):
    bench = ready(autopilot, faults=[parse_fault("arming-refused:20")])
    bench.load(*up_there())
    assert not bench.heard(m.SysStatus)[-1].sensors_healthy & m.PREARM_CHECK_BIT
    bench.set_mode(Mode.GUIDED)
    expected = CommandResult.FAILED if autopilot is ARDUPILOT else CommandResult.TEMPORARILY_REJECTED
    assert bench.command(Command.COMPONENT_ARM_DISARM, 1.0) is expected
    assert "Compass not healthy" in reported(bench) or "Resolve system health failures" in reported(bench)
    bench.run(20.0)
    assert bench.command(Command.COMPONENT_ARM_DISARM, 1.0) is CommandResult.ACCEPTED


@BOTH
def test_wind_above_its_limits_carries_it_away(autopilot):
    bench = flying(autopilot, "strong-wind:25@15s")
    run_to(bench, 14.9)
    assert abs(bench.vehicle.body.point.position_m[0]) < 1.0
    bench.run(40.0)
    # 25 m/s from the west, and it makes 18 m/s through the air.
    assert bench.vehicle.body.point.velocity_m_s[0] > 5.0
    assert bench.vehicle.body.point.position_m[0] > 150.0


@BOTH
def test_another_ground_station_takes_a_waypoint_out_of_the_mission(autopilot):
    bench = flying(autopilot, "mission-changed@15s")
    before = bench.vehicle.mission_items
    bench.run(20.0)
    after = bench.vehicle.mission_items
    assert len(after) == len(before) - 1
    assert bench.heard(m.MissionCurrent)[-1].total == len(after) - (1 if autopilot is ARDUPILOT else 0)
    assert bench.vehicle.mission_state is MissionState.ACTIVE
    bench.run(120.0)
    assert bench.vehicle.mission_state is MissionState.COMPLETE


def test_faults_come_in_any_order_and_can_be_added_in_flight():
    bench = flying(ARDUPILOT, "pilot-mode:guided@25s")
    bench.vehicle.faults.add(parse_fault("heartbeat-loss:3@5s"))
    bench.run(40.0)
    assert [fault.kind for fault in bench.vehicle.faults.begun] == [FaultKind.HEARTBEAT_LOSS, FaultKind.PILOT_MODE]
    assert not FaultSchedule().is_going_on(FaultKind.STUCK)


def test_the_same_seed_and_fault_are_the_same_flight():
    def story() -> list[m.Message]:
        bench = flying(PX4, "gps-loss:9@12s", rng=np.random.default_rng(6))
        bench.run(60.0)
        return bench.said

    assert story() == story()

"""Parameters of each autopilot, and commands of a second station that change how the mock vehicle flies its mission."""

import math
import struct

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Mode
from mission_io.model.enums import AutopilotId, CommandResult
from mission_io.model.items import Command
from mission_io.wire import messages as m
from tests.flight.scene import HOME
from tests.mock.bench import Bench, go, ready
from tests.mock.test_failsafes import BOTH, set_parameter, texts
from uavcover.missions.failsafes import failsafe_parameter_groups
from uavcover.mock.behaviour import PARAMETERS, Settings


@pytest.mark.parametrize(
    ("autopilot", "name", "value"), [(ARDUPILOT, "WPNAV_SPEED", 750.0), (PX4, "MPC_XY_CRUISE", 7.5)]
)
def test_parameters_are_read_and_set_in_their_own_units(autopilot, name, value):
    bench = ready(autopilot)
    [answer] = bench.send(m.ParamSet(1, 1, name, value))
    assert answer == m.ParamValue(name, value, 9, len(PARAMETERS[autopilot.mav_autopilot]), 0)
    assert bench.vehicle.settings.cruise_m_s == 7.5
    assert bench.send(m.ParamRequestRead(1, 1, "", 0)) == [answer]
    assert bench.send(m.ParamRequestRead(1, 1, "NO_SUCH")) == []
    assert bench.send(m.ParamSet(1, 1, name, -1.0)) == [answer]


@BOTH
def test_all_parameters_are_told_once_and_numbered(autopilot):
    reported = ready(autopilot).send(m.ParamRequestList(1, 1))
    assert all(isinstance(value, m.ParamValue) for value in reported)
    assert [value.index for value in reported] == list(range(len(reported)))
    assert {value.count for value in reported} == {len(reported)}
    assert [value.name for value in reported] == list(PARAMETERS[autopilot.mav_autopilot])


def test_px4_sends_the_bits_of_integers_and_ardupilot_their_values():
    [px4] = ready(PX4).send(m.ParamRequestRead(1, 1, "GF_ACTION"))
    assert (px4.param_type, struct.unpack("<i", struct.pack("<f", px4.value))[0]) == (6, 2)
    [ardupilot] = ready(ARDUPILOT).send(m.ParamRequestRead(1, 1, "FENCE_ACTION"))
    assert (ardupilot.param_type, ardupilot.value) == (6, 1.0)
    bench = ready(PX4)
    three = struct.unpack("<f", struct.pack("<i", 3))[0]
    bench.send(m.ParamSet(1, 1, "GF_ACTION", three, 6))
    assert bench.vehicle.parameters["GF_ACTION"] == 3.0


def test_settings_refuse_what_makes_no_sense():
    with pytest.raises(ValueError, match="cruise_m_s: must be greater than 0, not 0"):
        Settings(cruise_m_s=0)


@pytest.mark.parametrize(("name", "number"), [("ardupilot", AutopilotId.ARDUPILOT), ("px4", AutopilotId.PX4)])
def test_the_mock_has_what_returns_depend_on(name, number):
    """A name that it lacked would be waited for before every flight."""
    assert not [names for names in failsafe_parameter_groups(name) if not set(names) & set(PARAMETERS[number])]


def flying(autopilot, *items, **parameters: float) -> Bench:
    bench = ready(autopilot)
    for name, value in parameters.items():
        set_parameter(bench, name, value)
    bench.take_off(*(items or (go(0, 100, 20), go(0, 300, 20))))
    return bench


@pytest.mark.parametrize(("restart", "before"), [(0, False), (1, True)])
def test_mis_restart_begins_the_mission_anew_on_entering_auto(restart, before):
    bench = flying(ARDUPILOT, MIS_RESTART=restart)
    while bench.vehicle.current_seq < 3:
        bench.run(1.0)
    assert bench.set_mode(Mode.GUIDED) is CommandResult.ACCEPTED
    assert bench.command(Command.DO_SET_MISSION_CURRENT, 3.0) is CommandResult.ACCEPTED
    assert bench.set_mode(Mode.MISSION) is CommandResult.ACCEPTED
    assert (bench.vehicle.current_seq < 3) is before
    assert bench.command(Command.DO_SET_MISSION_CURRENT, 3.0) is CommandResult.ACCEPTED
    assert bench.vehicle.current_seq == 3


@pytest.mark.parametrize(
    ("autopilot", "parameters", "heading_deg"),
    [
        (ARDUPILOT, {}, 90.0),
        (ARDUPILOT, {"WP_YAW_BEHAVIOR": 0}, 0.0),
        (PX4, {"MPC_YAW_MODE": 4}, 90.0),
        (PX4, {"MPC_YAW_MODE": 1}, 270.0),
        (PX4, {"MPC_YAW_MODE": 5}, 0.0),
    ],
)
def test_the_nose_turns_as_the_parameter_says(autopilot, parameters, heading_deg):
    bench = flying(autopilot, go(200, 0, 20), **parameters)
    bench.run(15.0)
    assert math.degrees(bench.vehicle.body.point.yaw_rad) % 360.0 == pytest.approx(heading_deg, abs=5.0)


@pytest.mark.parametrize(("kinds", "mode"), [(8, Mode.RETURN), (7, Mode.MISSION)])
def test_the_floor_of_the_fence_breaks_a_mission_off_that_goes_below_it(kinds, mode):
    bench = flying(ARDUPILOT, go(0, 40, 30), go(0, 150, 12), FENCE_ENABLE=1, FENCE_TYPE=kinds, FENCE_ALT_MIN=15)
    bench.run(25.0)
    assert bench.vehicle.mode is mode
    assert ("Min Alt fence breached" in texts(bench)) is (kinds == 8)


def test_landing_ends_the_floor_of_the_fence():
    bench = flying(ARDUPILOT, FENCE_ENABLE=1, FENCE_TYPE=8, FENCE_ALT_MIN=15)
    assert bench.set_mode(Mode.LAND) is CommandResult.ACCEPTED
    bench.run(40.0)
    assert bench.vehicle.body.on_ground
    assert "breached" not in texts(bench)


@BOTH
def test_home_moved_in_flight_lowers_the_legs_at_once_or_from_the_next_item_on(autopilot):
    bench = flying(autopilot)
    while bench.vehicle.current_seq < (2 if autopilot is ARDUPILOT else 1):
        bench.run(0.2)
    position = (0.0, 0.0, 0.0, 0.0, HOME.lat_deg, HOME.lon_deg, HOME.alt_amsl_m - 8.0)
    assert bench.command(Command.DO_SET_HOME, *position) is CommandResult.ACCEPTED
    assert bench.heard(m.HomePosition)[-1].alt_amsl_m == pytest.approx(HOME.alt_amsl_m - 8.0)
    while bench.vehicle.body.point.position_m[1] < 80.0:
        bench.run(0.5)
    assert bench.up_m == pytest.approx(20.0 if autopilot is ARDUPILOT else 12.0, abs=1.5)
    while bench.vehicle.body.point.position_m[1] < 290.0:
        bench.run(0.5)
    assert bench.up_m == pytest.approx(12.0, abs=1.5)


def test_px4_without_home_by_command_keeps_its_home():
    bench = flying(PX4, COM_HOME_EN=0)
    assert bench.command(Command.DO_SET_HOME, 1.0) is CommandResult.DENIED


def test_ardupilot_may_listen_to_one_ground_station_alone():
    bench = ready(ARDUPILOT)
    set_parameter(bench, "MAV_GCS_SYSID", 250)
    assert bench.command(Command.GET_HOME_POSITION) is CommandResult.ACCEPTED
    set_parameter(bench, "MAV_OPTIONS", 1)
    assert bench.send(m.CommandLong(1, 1, Command.GET_HOME_POSITION, (0.0,) * 7)) == []


def test_a_command_takes_the_fence_out_of_force():
    bench = ready(ARDUPILOT)
    set_parameter(bench, "FENCE_ENABLE", 1)
    assert bench.command(Command.DO_FENCE_ENABLE, 0.0) is CommandResult.ACCEPTED
    assert not bench.vehicle.fence.in_force

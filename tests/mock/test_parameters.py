"""Parameters: names, units and types of each autopilot; a third party reads and sets them."""

import struct

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4
from mission_io.model.enums import AutopilotId
from mission_io.wire import messages as m
from tests.mock.bench import ready
from uavcover.missions.failsafes import failsafe_parameter_groups
from uavcover.mock.behaviour import PARAMETERS, Settings

BOTH = pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)


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
    told = ready(autopilot).send(m.ParamRequestList(1, 1))
    assert all(isinstance(value, m.ParamValue) for value in told)
    assert [value.index for value in told] == list(range(len(told)))
    assert {value.count for value in told} == {len(told)}
    assert [value.name for value in told] == list(PARAMETERS[autopilot.mav_autopilot])


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

"""What proves that a vehicle is simulated."""

from dataclasses import replace

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4
from mission_io.model.enums import CommandResult
from mission_io.wire import messages as m
from tests.flight.scene import make_scene, mission
from uavcover.errors import VehicleError
from uavcover.flight.client import simulated_by
from uavcover.mock import reactions
from uavcover.mock import vehicle as mock_vehicle
from uavcover.mock.behaviour import FLIGHT
from uavcover.mock.flight_control import FlightControl
from uavcover.mock.state import MockState
from uavcover.model.outcome import Ending, EventKind


@pytest.mark.parametrize(
    ("autopilot", "name", "value", "expected"),
    [
        (ARDUPILOT, "SIM_SPEEDUP", 1.0, "ArduPilot's simulator"),
        (ARDUPILOT, "OTHER", 1.0, None),
        (PX4, "SYS_HITL", 1e-45, "PX4 with simulated hardware"),  # the bits of the integer 1
        (PX4, "SYS_HITL", 0.0, None),
    ],
)
@pytest.mark.parametrize("tells_version", [True, False])
def test_parameters_tell_when_the_uid_does_not(autopilot, name, value, expected, tells_version, monkeypatch):
    monkeypatch.setattr("uavcover.flight.client.MOCK_UID", 42)
    if not tells_version:
        monkeypatch.setitem(reactions._HANDLERS, 512, lambda *_: CommandResult.UNSUPPORTED)

    def answer(_: MockState, message: m.ParamRequestRead) -> m.ParamValue | None:
        return m.ParamValue(name, value) if message.name == name else None

    monkeypatch.setattr(reactions, "answer_parameter", answer)
    scene = make_scene(autopilot)
    scene.client.wait_for_vehicle()
    assert simulated_by(scene.client) == expected


# How a flight copes with an autopilot that does not know a command.


def test_a_vehicle_that_does_not_know_set_mission_current_is_sent_the_message(monkeypatch):
    monkeypatch.delitem(reactions._HANDLERS, 224)
    asked = []
    original = FlightControl.set_current
    monkeypatch.setattr(FlightControl, "set_current", lambda self, seq: (asked.append(seq), original(self, seq))[1])
    scene = make_scene()
    scene.upload(mission())
    assert scene.fly().ending is Ending.LANDED
    assert asked == [1]


def test_refused_intervals_are_warnings(monkeypatch):
    scene = make_scene()
    scene.upload(mission())
    monkeypatch.setitem(reactions._HANDLERS, 511, lambda *_: CommandResult.DENIED)
    assert scene.fly().ending is Ending.LANDED
    assert "Attitude every 0.1 s: the vehicle answered DENIED" in scene.told(EventKind.WARNING)


def test_a_vehicle_that_stays_armed_after_landing_is_told_to_disarm(monkeypatch):
    monkeypatch.setattr(mock_vehicle, "FLIGHT", replace(FLIGHT, disarm_after_landing_s=1e6))
    scene = make_scene()
    scene.upload(mission())
    assert scene.fly().ending is Ending.LANDED
    assert not scene.vehicle.armed


def test_a_vehicle_that_refuses_to_disarm_after_landing_is_an_error(monkeypatch):
    monkeypatch.setattr(mock_vehicle, "FLIGHT", replace(FLIGHT, disarm_after_landing_s=1e6))
    monkeypatch.setattr(FlightControl, "disarm", lambda *_, **__: CommandResult.ACCEPTED)
    scene = make_scene()
    scene.upload(mission())
    with pytest.raises(VehicleError, match="has landed but is still armed"):
        scene.fly()

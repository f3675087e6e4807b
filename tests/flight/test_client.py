"""What proves that a vehicle is simulated, and which are refused before anything is sent, whichever autopilot they have."""

from dataclasses import replace

import pytest
from pymavlink import mavutil

from mission_io.autopilots.autopilot import (
    ARDUPILOT,
    PX4,
    Mode,
    VehicleKind,
    autopilot_for,
    has_mode,
    kind_of,
    mode_from_custom,
)
from mission_io.model.enums import VEHICLE_TYPES, CommandResult, parse_type, type_name
from mission_io.model.items import MissionType
from mission_io.wire import messages as m
from tests.flight.scene import make_scene, mission
from uavcover.errors import VehicleError
from uavcover.flight.orders import custom_mode, simulated_by
from uavcover.mock import reactions
from uavcover.mock import vehicle as mock_vehicle
from uavcover.mock.behaviour import FLIGHT
from uavcover.mock.flight_control import FlightControl
from uavcover.mock.state import MockState
from uavcover.mock.vehicle import MockVehicle
from uavcover.model.track import Ending, EventKind, FlightFailedError


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
    monkeypatch.setattr("uavcover.flight.orders.MOCK_UID", 42)
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
    requested = []
    original = FlightControl.set_current
    monkeypatch.setattr(FlightControl, "set_current", lambda self, seq: (requested.append(seq), original(self, seq))[1])
    scene = make_scene()
    scene.upload(mission())
    assert scene.fly().ending is Ending.LANDED
    assert requested == [1]


def test_refused_intervals_are_warnings(monkeypatch):
    scene = make_scene()
    scene.upload(mission())
    monkeypatch.setitem(reactions._HANDLERS, 511, lambda *_: CommandResult.DENIED)
    assert scene.fly().ending is Ending.LANDED
    assert "Attitude every 0.1 s: the vehicle answered DENIED" in scene.reported(EventKind.WARNING)


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


FLYABLE = [n for n in VEHICLE_TYPES if kind_of(n) is VehicleKind.MULTIROTOR]
FOREIGN = [n for n in VEHICLE_TYPES if kind_of(n) not in (VehicleKind.MULTIROTOR, VehicleKind.NO_VEHICLE)] + [49, 250]


@pytest.fixture
def received(monkeypatch) -> list[m.Message]:
    """All that the mock vehicle was sent but heartbeats."""
    sent: list[m.Message] = []
    original = MockVehicle.receive

    def receive(vehicle, message, now):
        if not isinstance(message.message, m.Heartbeat):
            sent.append(message.message)
        original(vehicle, message, now)

    monkeypatch.setattr(MockVehicle, "receive", receive)
    return sent


@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
@pytest.mark.parametrize("vehicle_type", FOREIGN, ids=type_name)
def test_what_is_no_multirotor_is_not_touched(autopilot, vehicle_type, received):
    scene = make_scene(autopilot, vehicle_type=vehicle_type)
    scene.vehicle.missions.replace(MissionType.MISSION, ())
    said = rf"reports that it is an? .*, MAV_TYPE {vehicle_type}; uavcover supports only multirotors"
    with pytest.raises(FlightFailedError, match=said) as failed:
        scene.fly()
    assert failed.value.outcome.ending is Ending.NOT_ARMED
    assert received == []
    assert (scene.vehicle.armed, scene.vehicle.mode) == (False, Mode.MANUAL)


@pytest.mark.parametrize("vehicle_type", FLYABLE, ids=type_name)
def test_every_multirotor_flies(vehicle_type):
    scene = make_scene(vehicle_type=vehicle_type)
    scene.upload(mission())
    assert scene.fly().ending is Ending.LANDED


def test_a_type_that_changes_before_arming_is_refused(received):
    scene = make_scene()
    scene.upload(mission())
    scene.vehicle.vehicle_type = parse_type("plane")
    scene.client.poll(1.5)
    received.clear()
    with pytest.raises(FlightFailedError, match="reports that it is a plane, MAV_TYPE 1"):
        scene.fly()
    assert not scene.vehicle.armed
    assert received == []


MAPPINGS = {
    "quadrotor": mavutil.mode_mapping_acm,
    "plane": mavutil.mode_mapping_apm,
    "vtol": mavutil.mode_mapping_apm,
    "rover": mavutil.mode_mapping_rover,
    "boat": mavutil.mode_mapping_rover,
    "submarine": mavutil.mode_mapping_sub,
    "airship": mavutil.mode_mapping_blimp,
}
WORDS = {
    Mode.MANUAL: {"STABILIZE", "MANUAL"},
    Mode.GUIDED: {"GUIDED"},
    Mode.MISSION: {"AUTO"},
    Mode.HOLD: {"LOITER", "HOLD", "POSHOLD"},
    Mode.RETURN: {"RTL"},
    Mode.LAND: {"LAND", "QLAND", "SURFACE"},
}


@pytest.mark.parametrize("name", MAPPINGS)
def test_the_mode_numbers_are_those_that_pymavlink_knows_of_that_type(name):
    autopilot = autopilot_for(ARDUPILOT.mav_autopilot, parse_type(name))
    for mode, words in WORDS.items():
        if has_mode(autopilot, mode):
            number = custom_mode(autopilot, mode)
            assert MAPPINGS[name][number] in words
            assert mode_from_custom(autopilot, number) is mode


def test_a_number_means_another_mode_on_another_type():
    plane = autopilot_for(ARDUPILOT.mav_autopilot, parse_type("plane"))
    assert custom_mode(ARDUPILOT, Mode.GUIDED) == 4
    assert mode_from_custom(plane, 4) is None, "ACRO"
    assert mode_from_custom(plane, 3) is None, "TRAINING"


def test_a_mode_that_a_type_has_not_is_an_error_and_no_number():
    submarine = autopilot_for(ARDUPILOT.mav_autopilot, parse_type("submarine"))
    with pytest.raises(VehicleError, match=r"ArduPilot \(submarine\) has no return mode"):
        custom_mode(submarine, Mode.RETURN)


@pytest.mark.parametrize("vehicle_type", FOREIGN, ids=type_name)
def test_the_mock_answers_with_its_own_types_numbers(vehicle_type):
    scene = make_scene(vehicle_type=vehicle_type)
    scene.client.wait_for_vehicle()
    autopilot = scene.client.vehicle.autopilot
    assert scene.client.vehicle.vehicle_type == vehicle_type
    if has_mode(autopilot, Mode.GUIDED):
        scene.client.poll(3.0)
        scene.client.set_mode(custom_mode(autopilot, Mode.GUIDED))
        assert scene.vehicle.mode is Mode.GUIDED

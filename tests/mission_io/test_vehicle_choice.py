"""Which vehicle on a link is meant, and which of its components is the autopilot."""

import itertools
import random

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4
from mission_io.errors import AmbiguousVehicleError, MisuseError, VehicleSilentError
from mission_io.model.enums import VEHICLE_TYPES, AutopilotId, VehicleClass, VehicleKind, kind_of, parse_type, type_name
from mission_io.model.items import MissionType
from mission_io.protocol.timing import CALLS
from mission_io.wire import messages as m
from tests.mission_io.test_peers import ITEMS, Bus, Station, Vehicle, client_on

COMPANION = 191


def claims(autopilot: int, vehicle_type: int) -> m.Heartbeat:
    return m.Heartbeat(autopilot, vehicle_type, 128, 9, 4)


def test_two_vehicles_and_none_named_is_an_error_that_lists_both() -> None:
    client = client_on(Bus(Vehicle(7, ARDUPILOT), Vehicle(3, PX4)))
    with pytest.raises(AmbiguousVehicleError) as raised:
        client.wait_for_vehicle()
    assert str(raised.value) == (
        "2 vehicles are on this link: system 3, component 1 (PX4, quadrotor); system 7, component 1 (ArduPilot, quadrotor); "
        "choose one by --system"
    )
    assert [vehicle.system_id for vehicle in raised.value.vehicles] == [7, 3]


@pytest.mark.parametrize("system_id", [3, 7])
def test_the_named_one_is_talked_to_also_by_a_second_call(system_id: int) -> None:
    client = client_on(Bus(Vehicle(7, ARDUPILOT), Vehicle(3, PX4)))
    assert client.wait_for_vehicle(system_id=system_id).system_id == system_id
    assert client.wait_for_vehicle().system_id == system_id


def test_a_second_vehicle_whose_heartbeat_comes_a_second_later_is_heard() -> None:
    with pytest.raises(AmbiguousVehicleError):
        client_on(Bus(Vehicle(1, ARDUPILOT), late=Vehicle(2, PX4))).wait_for_vehicle()


def test_a_single_vehicle_is_found_after_one_heartbeats_time() -> None:
    client = client_on(Bus(Vehicle(1)))
    began_s = client.clock.now()
    client.wait_for_vehicle()
    assert client.clock.now() - began_s < CALLS.listen_s + 1.1


@pytest.mark.parametrize(
    "beat",
    [
        claims(autopilot, vehicle_type)
        for autopilot in (AutopilotId.INVALID, AutopilotId.ARDUPILOT, AutopilotId.PX4)
        for vehicle_type in (2, 1, 18)
    ],
    ids=lambda beat: f"{beat.autopilot}-{beat.vehicle_type}",
)
@pytest.mark.parametrize("companion_first", [True, False])
@pytest.mark.parametrize("named", [None, 1])
def test_a_companion_that_claims_to_be_an_autopilot_is_not_talked_to(
    beat: m.Heartbeat, companion_first: bool, named: int | None
) -> None:
    autopilot, companion = Vehicle(1, ARDUPILOT), Station(1, COMPANION, beat)
    members = (companion, autopilot) if companion_first else (autopilot, companion)
    client = client_on(Bus(*members))
    assert client.wait_for_vehicle(system_id=named).component_id == 1
    client.poll(2.5)
    assert (client.vehicle.component_id, client.vehicle.armed, client.vehicle.custom_mode) == (1, False, 0)


def test_two_claims_without_component_1_need_a_component() -> None:
    members = (Vehicle(1, PX4, component_id=5), Vehicle(1, PX4, component_id=7))
    with pytest.raises(AmbiguousVehicleError, match="choose one by --component"):
        client_on(Bus(*members)).wait_for_vehicle()
    assert client_on(Bus(*members)).wait_for_vehicle(component_id=7).component_id == 7
    assert client_on(Bus(*members)).wait_for_vehicle(system_id=1, component_id=5).component_id == 5


def test_a_component_that_is_not_there_is_named() -> None:
    with pytest.raises(VehicleSilentError, match="no vehicle with system ID 1 and component ID 9 sent a heartbeat"):
        client_on(Bus(Vehicle(1))).wait_for_vehicle(2.0, system_id=1, component_id=9)


def test_two_types_under_the_same_ids_are_two_vehicles() -> None:
    plane = Station(1, 1, claims(ARDUPILOT.mav_autopilot, VehicleClass.FIXED_WING))
    with pytest.raises(
        MisuseError,
        match="reports both ArduPilot, quadrotor and ArduPilot, plane: two vehicles share these IDs",
    ):
        client_on(Bus(Vehicle(1, ARDUPILOT), plane)).wait_for_vehicle()


def test_a_type_that_changes_later_is_not_believed_and_nothing_is_sent_to_it() -> None:
    autopilot, plane = Vehicle(1, ARDUPILOT), Station(1, 1, claims(ARDUPILOT.mav_autopilot, VehicleClass.FIXED_WING))
    bus = Bus(autopilot, plane)
    bus.members.remove(plane)
    client = client_on(bus)
    client.wait_for_vehicle()
    bus.members.append(plane)
    client.poll(2.5)
    assert client.vehicle.vehicle_type == VehicleClass.QUADROTOR
    assert not client.vehicle.armed
    assert client.impostor is not None
    with pytest.raises(MisuseError, match=r"two vehicles share these IDs.*nothing was sent"):
        client.upload(MissionType.MISSION, ITEMS)
    assert autopilot.server.items(MissionType.MISSION) == ()


def test_a_type_that_was_not_known_yet_may_become_known() -> None:
    unsure = Station(1, 1, claims(ARDUPILOT.mav_autopilot, VehicleClass.GENERIC))
    client = client_on(Bus(unsure))
    assert client.wait_for_vehicle().kind is VehicleKind.OTHER
    unsure.messages = (claims(ARDUPILOT.mav_autopilot, VehicleClass.HEXAROTOR),)
    client.poll(1.5)
    assert client.vehicle.vehicle_type == VehicleClass.HEXAROTOR
    assert client.impostor is None


def test_whoever_else_is_there_in_whatever_order_the_named_autopilot_is_found() -> None:
    rng = random.Random(14)
    for _ in range(40):
        systems = rng.sample(range(1, 250), rng.randint(1, 4))
        members: list[Vehicle | Station] = [Vehicle(s, rng.choice([ARDUPILOT, PX4])) for s in systems]
        for system_id, component_id in itertools.product(systems, rng.sample(range(2, 250), 3)):
            members.append(Station(system_id, component_id, claims(rng.choice([3, 8, 12]), rng.choice(VEHICLE_TYPES))))
        rng.shuffle(members)
        wanted = rng.choice(systems)
        assert client_on(Bus(*members)).wait_for_vehicle(system_id=wanted).component_id == 1
        if len(systems) > 1:
            with pytest.raises(AmbiguousVehicleError) as raised:
                client_on(Bus(*members)).wait_for_vehicle()
            assert {v.system_id for v in raised.value.vehicles} == set(systems)


def test_names_of_types_are_read_back() -> None:
    for number in VEHICLE_TYPES:
        if kind_of(number) is not VehicleKind.NO_VEHICLE:
            assert parse_type(type_name(number)) == number
    assert kind_of(parse_type("vtol")) is VehicleKind.VTOL
    with pytest.raises(MisuseError, match="unknown vehicle type 'zeppelin'; use one of generic, plane, quadrotor"):
        parse_type("zeppelin")


def test_the_types_are_those_of_mavlink() -> None:
    from pymavlink.dialects.v20 import ardupilotmega

    theirs = {number: entry.name for number, entry in ardupilotmega.enums["MAV_TYPE"].items()}
    theirs.pop(ardupilotmega.MAV_TYPE_ENUM_END)
    assert set(VEHICLE_TYPES) == set(theirs)
    for number, name in theirs.items():
        assert ("VTOL" in name) == (kind_of(number) is VehicleKind.VTOL), name
        if (name.endswith(("ROTOR", "TRICOPTER")) and "VTOL" not in name) or name == "MAV_TYPE_COAXIAL":
            assert kind_of(number) is VehicleKind.MULTIROTOR, name

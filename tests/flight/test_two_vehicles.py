"""Two vehicles that share one system ID on one link."""

import math
from random import Random

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Autopilot
from mission_io.links.simulated import Conditions
from mission_io.wire import messages as m
from mission_io.wire.messages import Address, Received
from tests.flight.scene import HOME, Scene, geodetic, make_scene, mission, mock_vehicle
from uavcover.errors import VehicleError
from uavcover.flight.monitor import Monitor, TwoPositions
from uavcover.flight.orders import require_one_vehicle
from uavcover.mock.server import InMemoryPeer
from uavcover.mock.vehicle import MockVehicle
from uavcover.model.track import Ending, FlightFailedError


def beside(scene: Scene, away_m: float, *, from_s: float = 0.0) -> MockVehicle:
    """Another vehicle on the same link with the same IDs and the same clock, heard from a time on."""
    other = mock_vehicle(ARDUPILOT if scene.vehicle.is_ardupilot else PX4, geodetic((away_m, 0.0, 0.0)))
    second, first = InMemoryPeer(other), scene.peer
    send, receive = first.datagrams_to_send, first.receive_datagram

    def sends(now: float) -> list[bytes]:
        datagrams = second.datagrams_to_send(now)
        return [*send(now), *(datagrams if now >= from_s else [])]

    def receives(data: bytes, now: float) -> None:
        receive(data, now)
        second.receive_datagram(data, now)

    first.datagrams_to_send, first.receive_datagram = sends, receives  # type: ignore[method-assign]
    return other


@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4])
@pytest.mark.parametrize("away_m", [4.0, 400.0])
@pytest.mark.parametrize("loss", [0.0, 0.1])
def test_two_vehicles_with_one_clock_are_not_armed(autopilot: Autopilot, away_m: float, loss: float) -> None:
    scene = make_scene(autopilot, conditions=Conditions(loss=loss, delay_s=0.01), seed=3)
    scene.upload(mission())
    other = beside(scene, away_m)
    with pytest.raises(FlightFailedError, match=rf"share system ID 1: .* two places {away_m:.0f} m apart, .* change"):
        scene.fly()
    assert not scene.vehicle.armed
    assert not other.armed


def test_a_second_vehicle_that_is_heard_in_flight_is_an_alarm() -> None:
    scene = make_scene(seed=3)
    scene.upload(mission())
    beside(scene, 400.0, from_s=50.0)
    with pytest.raises(FlightFailedError) as failed:
        scene.fly()
    reported = [i.text for i in failed.value.outcome.incidents if i.kind is Ending.POSITION_LOST]
    assert "positions alternate between two places" in reported[0]
    assert "or two vehicles share system ID 1" in reported[0]


def position(time_s: float, east_m: float, speed_m_s: float = 0.0) -> m.GlobalPositionInt:
    at = geodetic((east_m, 0.0, 0.0))
    return m.GlobalPositionInt(time_s, at.lat_deg, at.lon_deg, HOME.alt_amsl_m, 0.0, 0.0, speed_m_s, 0.0, 0.0)


@pytest.mark.parametrize("seed", range(20))
def test_one_vehicle_is_one_on_two_links_that_lose_repeat_and_reorder(seed: int) -> None:
    random, positions = Random(seed), TwoPositions()
    arrivals = []
    for number in range(600):
        time_s = 0.1 * number
        speed_m_s = 15.0 * abs(math.sin(0.2 * time_s))
        east_m = 15.0 * (1.0 - math.cos(0.2 * time_s)) / 0.2 + random.gauss(0.0, 0.2)
        for _ in range(2):  # links
            for _ in range(random.choice([0, 0, 1, 1, 3])):
                arrivals.append((time_s + random.uniform(0.0, 4.0), position(time_s, east_m, speed_m_s)))
    for _, here in sorted(arrivals, key=lambda arrival: arrival[0]):
        positions.take(here)
        assert positions.apart_m is None


def test_a_reset_of_the_position_estimate_is_no_second_vehicle() -> None:
    positions = TwoPositions()
    for number in range(300):
        positions.take(position(0.1 * number, 20.0 * (number // 60 % 2)))
        assert positions.apart_m is None


def heard(*versions: m.AutopilotVersion) -> Monitor:
    monitor = Monitor()
    monitor.listen_to(Address(1, 1))
    for version in versions:
        monitor(Received(version, 1, 1), 0.0)
    return monitor


def test_different_hardware_numbers_are_two_vehicles() -> None:
    client = make_scene().client
    client.wait_for_vehicle()
    first, second = (1,) * 12 + (0,) * 6, (2,) * 12 + (0,) * 6
    with pytest.raises(VehicleError, match="two vehicles share system ID 1: it answers with different hardware IDs"):
        require_one_vehicle(client, heard(m.AutopilotVersion(0, uid2=first), m.AutopilotVersion(0, uid2=second)))
    # In MAVLink 1 the newer field is absent, and not every autopilot has a number.
    alone = heard(m.AutopilotVersion(0, 0, 5), m.AutopilotVersion(0, 0, 5, first), m.AutopilotVersion(0))
    require_one_vehicle(client, alone)
    require_one_vehicle(client, heard())

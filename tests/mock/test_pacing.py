"""A vehicle faster than real time waits for ground stations that answer TIMESYNC, and for no others."""

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT
from mission_io.wire import messages as m
from mission_io.wire.codec import Codec
from tests.flight.scene import HOME
from uavcover.mock.faults import parse_fault
from uavcover.mock.server import MockPeer
from uavcover.mock.telemetry import Pacing
from uavcover.mock.vehicle import MockConfig, MockVehicle

SPEED = 100.0


class Station:
    """A ground station that reads, or does not."""

    def __init__(self, peer: MockPeer[str], name: str, *, system_id: int = 255) -> None:
        self.peer, self.name = peer, name
        self.codec = Codec(system_id=system_id, component_id=190)
        self.requested: list[int] = []

    def says_hello(self, now: float) -> None:
        self.peer.receive_from(self.name, self.codec.encode(m.Heartbeat(8, 6)), now)

    def hears(self, data: bytes) -> None:
        questions = [received.message for received in self.codec.decode(data)]
        self.requested += [q.requested_ns for q in questions if isinstance(q, m.TimeSync)]

    def answers(self, now: float) -> None:
        for requested_ns in self.requested:
            self.peer.receive_from(self.name, self.codec.encode(m.TimeSync(123, requested_ns)), now)
        self.requested.clear()


def paced(*names: str) -> tuple[MockPeer[str], MockVehicle, dict[str, Station]]:
    vehicle = MockVehicle(ARDUPILOT, HOME, MockConfig(speed=SPEED))
    peer: MockPeer[str] = MockPeer(vehicle, speed=SPEED, paced=True)
    stations = {name: Station(peer, name, system_id=250 + k) for k, name in enumerate(names)}
    for station in stations.values():
        station.says_hello(0.0)
    return peer, vehicle, stations


def run(peer: MockPeer[str], stations: dict[str, Station], begin_s: float, end_s: float, reads: set[str]) -> None:
    """Let real time pass in steps of 10 ms."""
    for tick in range(round(begin_s * 100) + 1, round(end_s * 100) + 1):
        for name, data in peer.datagrams(tick / 100):
            stations[name].hears(data)
        for name in reads:
            stations[name].answers(tick / 100)


def test_who_reads_on_gets_the_full_speed():
    peer, vehicle, stations = paced("one", "other")
    run(peer, stations, 0.0, 2.0, {"one", "other"})
    assert vehicle.time_s == pytest.approx(2.0 * SPEED, rel=0.02)


def test_who_stops_to_read_is_waited_for_and_then_not_any_more():
    peer, vehicle, stations = paced("one")
    run(peer, stations, 0.0, 1.0, {"one"})
    stopped_s = vehicle.time_s
    run(peer, stations, 1.0, 1.9, set())
    assert vehicle.time_s <= stopped_s + 5.0 + 2.0
    run(peer, stations, 1.9, 4.0, set())
    assert vehicle.time_s > stopped_s + 100.0
    # It reads on, and is waited for again.
    run(peer, stations, 4.0, 5.0, {"one"})
    again_s = vehicle.time_s
    run(peer, stations, 5.0, 5.9, set())
    assert vehicle.time_s <= again_s + 5.0 + 2.0


def test_the_slowest_decides():
    peer, vehicle, stations = paced("one", "other")
    run(peer, stations, 0.0, 1.0, {"one", "other"})
    before_s = vehicle.time_s
    run(peer, stations, 1.0, 1.8, {"one"})
    assert vehicle.time_s <= before_s + 5.0 + 2.0


def test_who_never_answers_is_never_waited_for():
    peer, vehicle, stations = paced("one")
    run(peer, stations, 0.0, 2.0, set())
    assert vehicle.time_s == pytest.approx(2.0 * SPEED, rel=0.02)


def test_a_question_that_got_lost_is_asked_again():
    peer, vehicle, stations = paced("one")
    run(peer, stations, 0.0, 1.0, {"one"})
    for tick in range(101, 140):
        peer.datagrams(tick / 100)
    before_s = vehicle.time_s
    run(peer, stations, 1.4, 1.6, {"one"})
    assert vehicle.time_s > before_s + 10.0


@pytest.mark.parametrize("answer", [m.TimeSync(0, 10**9), m.TimeSync(5, 0), m.TimeSync(5, -1), m.TimeSync(5, 10**18)])
def test_what_is_no_answer_counts_as_none(answer: m.TimeSync):
    pacing: Pacing[str] = Pacing()
    assert pacing.questions(1.0, 0.0) == [m.TimeSync(0, 10**9)]
    pacing.take("one", answer)
    assert not pacing.waits(100.0, 1.0)


def test_an_outage_is_total_and_time_goes_on():
    """No datagram either way, TIMESYNC included: else a fast vehicle would never be silent."""
    peer, vehicle, stations = paced("one")
    run(peer, stations, 0.0, 1.0, {"one"})
    vehicle.faults.add(parse_fault("link-outage:1.5@boot+0s"))
    began_s = vehicle.time_s
    peer.datagrams(1.01)
    assert vehicle.cut_off
    station, heard = stations["one"], 0
    for tick in range(102, 245):
        heard += len(peer.datagrams(tick / 100))
        station.peer.receive_from("one", station.codec.encode(m.CommandLong(1, 1, 400, (1.0,) * 7)), tick / 100)
        station.peer.receive_from("one", station.codec.encode(m.TimeSync(123, round(vehicle.time_s * 1e9))), tick / 100)
    assert heard == 0
    assert not vehicle.armed
    assert vehicle.time_s == pytest.approx(began_s + 1.44 * SPEED, rel=0.02), "it waits for no station"
    run(peer, stations, 2.5, 3.5, {"one"})
    assert not vehicle.cut_off
    again_s = vehicle.time_s
    run(peer, stations, 3.5, 4.4, set())
    assert vehicle.time_s <= again_s + 5.0 + 2.0, "and waits again for one that is heard again"

"""Several vehicles and ground stations on one link, on simulated time."""

import logging
import random
from collections.abc import Callable, Sequence

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Autopilot
from mission_io.client.client import Client
from mission_io.client.peers import VehicleInfo
from mission_io.errors import MisuseError, VehicleSilentError
from mission_io.links.simulated import Conditions, SimulatedLink
from mission_io.model.items import Frame, MissionType, waypoint
from mission_io.protocol.server import MissionServer
from mission_io.wire import messages as m
from mission_io.wire.codec import Codec
from mission_io.wire.messages import Address

ITEMS = tuple(waypoint(46.5 + i * 1e-4, -7.25, 30.0, frame=Frame.ABOVE_HOME) for i in range(5))


GROUND_BEAT = m.Heartbeat(8, 6, system_status=4)


class Vehicle:
    """A vehicle that hears everything on the link and answers what is for it."""

    def __init__(self, system_id: int, autopilot: Autopilot = PX4, *, component_id: int = 1) -> None:
        self.autopilot = autopilot
        self.codec = Codec(system_id=system_id, component_id=component_id)
        self.server = MissionServer(autopilot, local=Address(system_id, component_id), booted_at=-100.0)
        self.outbox: list[m.Message] = []

    def receive(self, data: bytes, now: float) -> None:
        for received in self.codec.decode(data):
            self.server.receive(received, now)

    def to_send(self, now: float) -> list[m.Message]:
        outbox, self.outbox = self.outbox, []
        return [*self.server.messages_to_send(now), *outbox]


class Station:
    """Another ground station on the link; says what it is told to each second."""

    def __init__(self, system_id: int, component_id: int, *messages: m.Message) -> None:
        self.codec = Codec(system_id=system_id, component_id=component_id)
        self.codec.encode(GROUND_BEAT)  # one that says the same at the same number is no different from an echo
        self.messages = messages

    def receive(self, data: bytes, now: float) -> None:
        del data, now

    def to_send(self, now: float) -> Sequence[m.Message]:
        del now
        return ()


class Bus:
    """The other end of a simulated link, with everybody on it; each second each says its heartbeat."""

    def __init__(self, *members: Vehicle | Station, echo: bool = False, late: Vehicle | None = None) -> None:
        self.members: list[Vehicle | Station] = list(members)
        self.echo, self.late = echo, late
        self._echoes: list[bytes] = []
        self._beat_at, self._late_beat_at = 0.0, 0.9

    def receive_datagram(self, data: bytes, now: float) -> None:
        if self.echo:
            self._echoes.append(data)
        for member in self.members:
            member.receive(data, now)

    def datagrams_to_send(self, now: float) -> list[bytes]:
        sent, self._echoes = self._echoes, []
        beats = now >= self._beat_at
        if beats:
            self._beat_at = now + 1.0
        for member in self.members:
            messages = list(member.to_send(now))
            if beats and isinstance(member, Vehicle):
                messages.append(m.Heartbeat(member.autopilot.mav_autopilot, 2, 0, 0, 3))
            elif beats and isinstance(member, Station):
                messages.extend(member.messages)
            sent.extend(member.codec.encode(message) for message in messages)
        if self.late is not None and now >= self._late_beat_at:
            self._late_beat_at = now + 1.0
            sent.append(self.late.codec.encode(m.Heartbeat(self.late.autopilot.mav_autopilot, 2, 0, 0, 3)))
        return sent

    def next_timer(self) -> float | None:
        timers = [member.server.next_timer() for member in self.members if isinstance(member, Vehicle)]
        return min([self._beat_at, *[timer for timer in timers if timer is not None]])


def client_on(bus: Bus, *, system_id: int = 255, listener: Callable[[m.Received, float], None] | None = None) -> Client:
    link = SimulatedLink(bus, rng=random.Random(2), conditions=Conditions(delay_s=0.01))
    return Client(link, system_id=system_id, listener=listener)


def test_each_of_several_vehicles_gets_and_gives_its_own_mission(caplog: pytest.LogCaptureFixture) -> None:
    one, two, three = Vehicle(1, ARDUPILOT), Vehicle(2, PX4), Vehicle(2, PX4, component_id=7)
    client = client_on(Bus(one, two, three))
    for vehicle, count in ((one, 5), (two, 3)):
        client.wait_for_vehicle(system_id=vehicle.codec.system_id)
        client.upload(MissionType.MISSION, ITEMS[:count])
        assert len(client.download(MissionType.MISSION)) == count
    assert [len(v.server.items(MissionType.MISSION)) for v in (one, two, three)] == [5, 3, 0]
    client.poll(1.5)
    assert [(v.system_id, v.component_id) for v in client.peers.vehicles] == [(1, 1), (2, 1), (2, 7)]
    assert caplog.text.count("vehicle 2 (component 1) is also on this link") == 1
    assert caplog.text.count("vehicle 2 (component 7) is also on this link") == 1


def test_what_is_for_another_ground_station_is_ignored_counted_and_still_told_to_the_listener() -> None:
    vehicle = Vehicle(1)
    heard: list[m.Message] = []
    client = client_on(Bus(vehicle), listener=lambda received, _: heard.append(received.message))
    client.wait_for_vehicle()
    for_another, for_us = m.CommandAck(400, 0, target_system=254, target_component=190), m.CommandAck(400, 4)
    other_component = m.CommandAck(400, 2, target_system=255, target_component=9)
    vehicle.outbox = [for_another, other_component, for_us]
    found = client.wait_until(lambda r: isinstance(r.message, m.CommandAck), timeout_s=5.0, what="an answer")
    assert found.message == for_us
    assert client.statistics.for_others == 2
    assert for_another in heard


def test_an_answer_of_another_part_of_the_vehicle_is_not_the_autopilots() -> None:
    autopilot, gimbal = Vehicle(1), Vehicle(1, component_id=154)
    client = client_on(Bus(autopilot, gimbal))
    assert client.wait_for_vehicle().component_id == 1

    def answer(attempt: int) -> None:
        answering = gimbal if attempt == 0 else autopilot
        answering.outbox = [m.MissionCurrent(answering.codec.component_id)]

    found = client.wait_until(
        lambda r: isinstance(r.message, m.MissionCurrent), timeout_s=5.0, what="the item", again=answer
    )
    assert found == m.Received(m.MissionCurrent(1), 1, 1)


@pytest.mark.parametrize(
    ("station", "said"),
    [
        (Station(255, 190, GROUND_BEAT), True),
        (Station(255, 190, m.MissionRequestList(1, 1)), True),
        (Station(255, 230, GROUND_BEAT), True),
        (Station(254, 190, GROUND_BEAT), False),
        (Station(255, 191, m.Heartbeat(8, 18)), False),
        (Station(255, 191, m.MissionRequestList(1, 1)), False),
    ],
)
def test_a_ground_station_with_our_system_id_is_noticed_and_said_once(
    station: Station, said: bool, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING)
    client = client_on(Bus(Vehicle(1), station))
    client.wait_for_vehicle()
    for _ in range(5):
        client.poll(1.0)
    address = Address(station.codec.system_id, station.codec.component_id)
    assert client.peers.same_ids == ({address} if said else set())
    assert caplog.text.count("change the system ID of one of them") == int(said)


def test_our_own_messages_coming_back_are_no_other_ground_station(caplog: pytest.LogCaptureFixture) -> None:
    heard: list[m.Received] = []
    client = client_on(Bus(Vehicle(1), echo=True), listener=lambda received, _: heard.append(received))
    client.wait_for_vehicle()
    client.upload(MissionType.MISSION, ITEMS)
    for _ in range(300):
        client.poll(1.0)
    assert client.peers.same_ids == frozenset()
    assert client.statistics.echoes > 300
    assert {received.system_id for received in heard} == {1}
    assert caplog.text == ""


def test_a_vehicle_with_our_own_system_id_is_an_error() -> None:
    client = client_on(Bus(Vehicle(1)), system_id=1)
    with pytest.raises(MisuseError, match="the vehicle and this program both use system ID 1; use another system ID"):
        client.wait_for_vehicle()


def test_a_vehicle_that_is_not_there_names_those_that_are() -> None:
    client = client_on(Bus(Vehicle(3), Vehicle(4), Station(254, 190, GROUND_BEAT)))
    with pytest.raises(
        VehicleSilentError,
        match=r"no vehicle with system ID 9 sent a heartbeat within 3 s; received heartbeats from \[3, 4\]",
    ):
        client.wait_for_vehicle(3.0, system_id=9)


def test_what_a_vehicle_answers_to_another_ground_station_does_not_end_our_transfer() -> None:
    vehicle = Vehicle(1, ARDUPILOT)
    client = client_on(Bus(vehicle))
    client.wait_for_vehicle()
    other = Codec(system_id=254, component_id=190)

    def interfere(across: int, total: int) -> None:
        if across < total - 2:  # the vehicle must not be done before it hears this
            client.link.send(other.encode(m.MissionCount(1, 1, 2)))

    client.upload(MissionType.MISSION, ITEMS, progress=interfere)
    assert len(vehicle.server.items(MissionType.MISSION)) == len(ITEMS)
    assert client.statistics.for_others > 0


def test_vehicle_info_is_the_latest_heartbeat() -> None:
    client = client_on(Bus(Vehicle(1)))
    assert client.wait_for_vehicle() == VehicleInfo(1, 1, PX4.mav_autopilot, 2, False, 0, 3)
    assert client.vehicle.address == Address(1, 1)

"""Several vehicles on one link: each client hears its own, over a radio that carries all and over one port with many places."""

import contextlib
import threading
import time
from collections.abc import Callable, Iterator

import pytest

from mission_io.autopilots.autopilot import PX4
from mission_io.client.client import Client
from mission_io.errors import LinkError, MisuseError
from mission_io.links.datagrams import Clock, Link, MonotonicClock, UdpLink
from mission_io.links.opening import MOST_WAITING, LinkView, SharedLink, open_link
from mission_io.links.stream import TcpListeningLink
from mission_io.model.items import Frame, MissionType, waypoint
from mission_io.wire.codec import Codec
from mission_io.wire.messages import Heartbeat
from tests.mission_io.real_vehicle import flying_on
from tests.mission_io.vehicle import VehiclePeer

BEAT = Heartbeat(12, 2, system_status=3)
WATCHDOG_S = 60.0


class Fake:
    """A link whose datagrams are given; what is sent is kept."""

    def __init__(self) -> None:
        self.arriving: list[bytes | LinkError] = []
        self.sent: list[bytes] = []
        self.closed = 0

    @property
    def clock(self) -> Clock:
        return MonotonicClock()

    def send(self, data: bytes) -> None:
        self.sent.append(data)

    def receive(self, timeout_s: float) -> bytes | None:
        del timeout_s
        if not self.arriving:
            return None
        data = self.arriving.pop(0)
        if isinstance(data, LinkError):
            raise data
        return data

    def close(self) -> None:
        self.closed += 1


def beat_of(system_id: int) -> bytes:
    return Codec(system_id=system_id, component_id=1).encode(BEAT)


@contextlib.contextmanager
def fractions_of(fake: Fake, *systems: int) -> Iterator[list[LinkView]]:
    shared = SharedLink(lambda: fake, systems)
    with contextlib.ExitStack() as opened:
        yield [opened.enter_context(contextlib.closing(shared.view(system))) for system in systems]


def test_each_share_hears_its_vehicle_and_whoever_has_no_share() -> None:
    fake = Fake()
    with fractions_of(fake, 1, 2) as (one, two):
        fake.arriving = [beat_of(1) + beat_of(2), beat_of(255), b"no frame at all", beat_of(2)]
        for _ in range(4):
            one.receive(0.0)
        heard = [data for data in (two.receive(0.0) for _ in range(5)) if data is not None]
        assert heard == [beat_of(2), beat_of(255), b"no frame at all", beat_of(2)]
        fake.arriving = [beat_of(1) + beat_of(2) + beat_of(7)]
        assert two.receive(0.0) == beat_of(2) + beat_of(7)
        assert one.receive(0.0) == beat_of(1) + beat_of(7)
        assert one.receive(0.0) is None
        one.send(b"to the radio")
        assert fake.sent == [b"to the radio"]


def test_the_last_share_closes_the_link_and_the_next_one_opens_it_again() -> None:
    opened: list[Fake] = []

    def opener() -> Link:
        opened.append(Fake())
        return opened[-1]

    shared = SharedLink(opener, (1, 2))
    assert not opened
    one, two = shared.view(1), shared.view(2)
    with pytest.raises(MisuseError, match="share of system 1 is in use"):
        shared.view(1)
    with pytest.raises(MisuseError, match=r"system 3 has no share of this link; the systems with a share are \[1, 2\]"):
        shared.view(3)
    one.close()
    one.close()
    assert opened[0].closed == 0
    for use in (lambda: one.receive(0.0), lambda: one.send(b"x")):
        with pytest.raises(LinkError, match="closed"):
            use()
    two.close()
    assert (len(opened), opened[0].closed) == (1, 1)
    again = shared.view(1)
    assert len(opened) == 2
    again.close()


def test_a_link_that_is_gone_is_gone_for_all_after_what_had_arrived() -> None:
    fake = Fake()
    with fractions_of(fake, 1, 2) as (one, two):
        fake.arriving = [beat_of(2), LinkError("the radio was pulled out")]
        assert one.receive(0.0) is None
        with pytest.raises(LinkError, match="pulled out"):
            one.receive(0.1)
        assert two.receive(0.0) == beat_of(2)
        with pytest.raises(LinkError, match="pulled out"):
            two.receive(0.0)


def test_what_nobody_reads_is_dropped_from_the_oldest_on_and_told(caplog: pytest.LogCaptureFixture) -> None:
    fake = Fake()
    with fractions_of(fake, 1, 2) as (one, two):
        codec = Codec(system_id=2, component_id=1)
        sent = [codec.encode(BEAT) for _ in range(MOST_WAITING + 3)]
        fake.arriving = list(sent)
        while fake.arriving:
            one.receive(0.0)
        assert two.dropped == 3
        assert two.receive(0.0) == sent[3]
    assert [record.message for record in caplog.records] == [
        "no client reads the datagrams of system 2; dropping the oldest ones"
    ]


def missions(client: Client, system_id: int, count: int) -> None:
    """Find the vehicle, send it a mission of its own, and read it back."""
    vehicle = client.wait_for_vehicle(WATCHDOG_S, system_id=system_id)
    assert vehicle.system_id == system_id
    assert [other.system_id for other in client.peers.vehicles] == [system_id]
    items = tuple(
        waypoint(46.5 + 0.1 * system_id, -7.25 + i * 1e-4, 30.0, frame=Frame.ABOVE_HOME) for i in range(count)
    )
    client.upload(MissionType.MISSION, items)
    assert [item.lat_deg for item in client.download(MissionType.MISSION)] == [item.lat_deg for item in items]


def all_at_once(shared: SharedLink, systems: tuple[int, ...]) -> None:
    """A client for each vehicle, in a thread of its own."""
    failed: list[BaseException] = []

    def one(view: LinkView, system_id: int) -> None:
        try:
            with Client(view) as client:
                missions(client, system_id, 20 + system_id)
        except BaseException as error:  # told by the test
            failed.append(error)

    threads = [threading.Thread(target=one, args=(shared.view(system_id), system_id)) for system_id in systems]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(WATCHDOG_S)
    assert not failed
    assert not any(thread.is_alive() for thread in threads)


def peer(system_id: int) -> VehiclePeer:
    return VehiclePeer(PX4, system_id=system_id)


def test_vehicles_that_all_speak_to_one_port_are_each_answered_where_they_are() -> None:
    ground = UdpLink.listening()
    systems = (1, 2, 3)
    with contextlib.ExitStack() as flying:
        for system_id in systems:
            flying.enter_context(flying_on(UdpLink.connecting("127.0.0.1", ground.local_port), peer(system_id)))
        all_at_once(SharedLink(lambda: ground, systems), systems)


def test_vehicles_behind_one_stream_share_it() -> None:
    """What a radio or a router does: all bytes on one line."""
    router = TcpListeningLink("127.0.0.1", 0)
    systems = (1, 2, 3)
    stop = threading.Event()
    peers = [peer(system_id) for system_id in systems]

    def carry() -> None:
        while not stop.is_set():
            data = router.receive(0.005)
            now = time.monotonic()
            for each in peers:
                if data is not None:
                    each.receive_datagram(data, now)
                for answer in each.datagrams_to_send(now):
                    router.send(answer)

    thread = threading.Thread(target=carry, daemon=True)
    thread.start()
    try:
        all_at_once(SharedLink(lambda: open_link(f"tcp://127.0.0.1:{router.local_port}"), systems), systems)
    finally:
        stop.set()
        thread.join(WATCHDOG_S)
        router.close()


def stranger_speaks(port: int, use: Callable[[UdpLink], None]) -> None:
    with UdpLink.connecting("127.0.0.1", port) as stranger:
        use(stranger)


def test_a_stranger_with_a_vehicles_ids_is_not_heard() -> None:
    ground = UdpLink.listening()
    shared = SharedLink(lambda: ground, (1, 2))
    with (
        contextlib.closing(shared.view(1)) as one,
        contextlib.closing(shared.view(2)) as two,
        UdpLink.connecting("127.0.0.1", ground.local_port) as vehicle,
        UdpLink.connecting("127.0.0.1", ground.local_port) as other,
    ):
        vehicle.send(beat_of(1))
        assert one.receive(WATCHDOG_S) == beat_of(1)
        one.keep_to(1, 1)
        other.send(beat_of(2))
        assert two.receive(WATCHDOG_S) == beat_of(2)
        two.keep_to(2, 1)
        stranger_speaks(ground.local_port, lambda link: link.send(beat_of(1)))
        vehicle.send(beat_of(1) + beat_of(1))
        assert one.receive(WATCHDOG_S) == beat_of(1) + beat_of(1)
        assert two.receive(0.0) is None
        one.send(b"to one")
        two.send(b"to two")
        assert (vehicle.receive(WATCHDOG_S), other.receive(WATCHDOG_S)) == (b"to one", b"to two")
        assert (vehicle.receive(0.0), other.receive(0.0)) == (None, None)
        one.let_go()
        stranger_speaks(ground.local_port, lambda link: link.send(beat_of(1)))
        assert one.receive(WATCHDOG_S) == beat_of(1)

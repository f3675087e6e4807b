import contextlib
import random
import socket

import pytest

from mission_io.autopilots.autopilot import PX4
from mission_io.client.client import Client
from mission_io.errors import LinkError, MisuseError
from mission_io.links.datagrams import FORGOTTEN_AFTER_S, MOST_PEERS, TAKE_OVER_S, UdpLink
from mission_io.links.opening import LinkUrl, open_link, parse_link_url, register_endpoint
from mission_io.links.simulated import ManualClock
from mission_io.model.items import Frame, MissionType, waypoint
from mission_io.wire.codec import Codec
from mission_io.wire.messages import Heartbeat, MissionCurrent
from tests.mission_io.real_vehicle import flying_on
from tests.mission_io.vehicle import VehiclePeer


@pytest.mark.parametrize(
    ("url", "parsed"),
    [
        ("udpin://127.0.0.1:14550", LinkUrl("udpin", "127.0.0.1", 14550)),
        ("udpin://0.0.0.0:14550", LinkUrl("udpin", "0.0.0.0", 14550)),
        ("udp:127.0.0.1:14550", LinkUrl("udpin", "127.0.0.1", 14550)),
        ("udp::14550", LinkUrl("udpin", "127.0.0.1", 14550)),
        ("udpin://:0", LinkUrl("udpin", "127.0.0.1", 0)),
        ("udpout://vehicle:14551", LinkUrl("udpout", "vehicle", 14551)),
        ("udpin://[::1]:14550", LinkUrl("udpin", "::1", 14550)),
        ("tcp://127.0.0.1:5760", LinkUrl("tcp", "127.0.0.1", 5760)),
        ("tcp:vehicle:5760", LinkUrl("tcp", "vehicle", 5760)),
        ("tcpin://:0", LinkUrl("tcpin", "127.0.0.1", 0)),
        ("tcpin:0.0.0.0:5760", LinkUrl("tcpin", "0.0.0.0", 5760)),
        ("serial:///dev/ttyUSB0:115200", LinkUrl("serial", rest="/dev/ttyUSB0", baud=115200)),
        ("serial:/dev/ttyUSB0,9600", LinkUrl("serial", rest="/dev/ttyUSB0", baud=9600)),
        ("serial:///dev/ttyUSB0", LinkUrl("serial", rest="/dev/ttyUSB0", baud=57600)),
        ("/dev/ttyACM0", LinkUrl("serial", rest="/dev/ttyACM0", baud=57600)),
        ("/dev/ttyACM0,115200", LinkUrl("serial", rest="/dev/ttyACM0", baud=115200)),
        ("/dev/ttyACM0:115200", LinkUrl("serial", rest="/dev/ttyACM0", baud=115200)),
        (
            "/dev/serial/by-path/pci-0000:00:14.0-usb-0:2:1.0-port0:57600",
            LinkUrl("serial", rest="/dev/serial/by-path/pci-0000:00:14.0-usb-0:2:1.0-port0", baud=57600),
        ),
        (
            "/dev/serial/by-path/pci-0000:00:14.0-usb-0:2:1.0-port0",
            LinkUrl("serial", rest="/dev/serial/by-path/pci-0000:00:14.0-usb-0:2:1.0-port0", baud=57600),
        ),
    ],
)
def test_urls(url: str, parsed: LinkUrl) -> None:
    assert parse_link_url(url) == parsed


@pytest.mark.parametrize(
    ("url", "what"),
    [
        ("", "not a valid link"),
        ("14550", "not a valid link"),
        ("http://127.0.0.1:80", "not a valid link; use udpin://HOST:PORT"),
        ("udpin://127.0.0.1", "a port"),
        ("udpin://127.0.0.1:70000", "a port"),
        ("udpin://127.0.0.1:-1", "a port"),
        ("udpin://127.0.0.1:１４", "a port"),
        ("udpout://127.0.0.1:0", "port 0"),
        ("tcp://127.0.0.1:0", "port 0"),
        ("tcpin://", "a port"),
        ("tcp://127.0.0.1:x", "a port"),
        ("serial://", "names no device"),
        ("serial:COM3:57600", "names no device; write serial:///dev/ttyUSB0:57600"),
        ("/dev/ttyUSB0:0", "0 is not a valid baud rate"),
        ("/dev/ttyUSB0,99999999", "99999999 is not a valid baud rate"),
    ],
)
def test_urls_that_cannot_be_opened_say_what_can(url: str, what: str) -> None:
    with pytest.raises(MisuseError, match=what):
        open_link(url)


def test_an_endpoint_can_be_registered_under_a_name_of_its_own() -> None:
    link = UdpLink.listening()
    observed: list[LinkUrl] = []

    def factory(url: LinkUrl) -> UdpLink:
        observed.append(url)
        return link

    register_endpoint("testmock", factory)
    assert open_link("testmock:px4") is link
    assert observed == [LinkUrl("testmock", rest="px4")]
    link.close()
    for taken in ("udp", "tcp", "tcpin", "serial", "no scheme"):
        with pytest.raises(MisuseError, match="cannot be registered"):
            register_endpoint(taken, factory)


def test_datagrams_go_both_ways_over_loopback() -> None:
    with UdpLink.listening() as ground:
        ground.send(b"nobody there yet")
        assert ground.peer is None
        with UdpLink.connecting("127.0.0.1", ground.local_port) as vehicle:
            vehicle.send(b"hello")
            assert ground.receive(5.0) == b"hello"
            assert ground.peer == ("127.0.0.1", vehicle.local_port)
            ground.send(b"back")
            assert vehicle.receive(5.0) == b"back"
            assert vehicle.receive(0.0) is None


def test_a_listening_link_follows_its_peer_to_another_port() -> None:
    with UdpLink.listening() as ground:
        for text in (b"one", b"two"):
            with UdpLink.connecting("127.0.0.1", ground.local_port) as vehicle:
                vehicle.send(text)
                assert ground.receive(5.0) == text
                ground.send(text)
                assert vehicle.receive(5.0) == text


def test_two_vehicles_on_one_listening_port_both_hear_the_ground() -> None:
    with (
        UdpLink.listening() as ground,
        UdpLink.connecting("127.0.0.1", ground.local_port) as one,
        UdpLink.connecting("127.0.0.1", ground.local_port) as two,
    ):
        for vehicle, text in ((one, b"one"), (two, b"two"), (one, b"three")):
            vehicle.send(text)
            assert ground.receive(5.0) == text
        assert ground.peers == (("127.0.0.1", two.local_port), ("127.0.0.1", one.local_port))
        assert ground.peer == ("127.0.0.1", one.local_port)
        ground.send(b"to all")
        assert [one.receive(5.0), two.receive(5.0)] == [b"to all"] * 2
        assert one.peers == (("127.0.0.1", ground.local_port),)


def test_a_place_that_fell_silent_is_no_longer_sent_to_but_the_last_one_always_is() -> None:
    clock = ManualClock()
    with (
        UdpLink.listening(clock=clock) as ground,
        UdpLink.connecting("127.0.0.1", ground.local_port) as early,
        UdpLink.connecting("127.0.0.1", ground.local_port) as late,
    ):
        for vehicle, at_s in ((early, 0.0), (late, 5.0)):
            clock.advance_to(at_s)
            vehicle.send(b"hello")
            assert ground.receive(5.0) == b"hello"
        clock.advance_to(FORGOTTEN_AFTER_S)
        assert ground.peers == (("127.0.0.1", early.local_port), ("127.0.0.1", late.local_port))
        clock.advance_to(FORGOTTEN_AFTER_S + 0.1)
        assert ground.peers == (("127.0.0.1", late.local_port),)
        clock.advance_to(1000.0)
        assert ground.peers == (("127.0.0.1", late.local_port),)


def test_no_more_than_so_many_places_are_sent_to() -> None:
    with UdpLink.listening() as ground, contextlib.ExitStack() as open_links:
        for number in range(MOST_PEERS + 2):
            vehicle = open_links.enter_context(UdpLink.connecting("127.0.0.1", ground.local_port))
            vehicle.send(bytes([number]))
            assert ground.receive(5.0) == bytes([number])
        assert len(ground.peers) == MOST_PEERS
        assert ground.peers[-1] == ("127.0.0.1", vehicle.local_port)


def test_strangers_are_not_heard() -> None:
    with UdpLink.listening() as ground, UdpLink.connecting("127.0.0.1", ground.local_port) as vehicle:
        vehicle.send(b"hello")
        assert ground.receive(5.0) == b"hello"
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            stranger.sendto(b"psst", ("127.0.0.1", vehicle.local_port))
        ground.send(b"back")
        assert vehicle.receive(5.0) == b"back"


def test_nobody_there_is_silence_not_an_error() -> None:
    with UdpLink.listening() as gone:
        port = gone.local_port
    with UdpLink.connecting("127.0.0.1", port) as link:
        for _ in range(3):
            link.send(b"hello")
            assert link.receive(0.01) is None


def test_a_taken_port_an_unknown_host_and_a_closed_link_are_errors() -> None:
    with UdpLink.listening() as first, pytest.raises(LinkError, match="is the port in use"):
        open_link(f"udpin://127.0.0.1:{first.local_port}")
    with pytest.raises(LinkError, match="cannot find the host"):
        open_link("udpout://host.invalid:14550")
    for use in (lambda: first.receive(0.0), lambda: first.local_port):
        with pytest.raises(LinkError):
            use()
    sender = UdpLink.connecting("127.0.0.1", 9)
    sender.close()
    with pytest.raises(LinkError, match="cannot send"):
        sender.send(b"x")


def test_a_mission_goes_over_real_udp() -> None:
    ground = UdpLink.listening()
    items = tuple(waypoint(46.5 + i * 1e-4, -7.25, 30.0, frame=Frame.ABOVE_HOME) for i in range(200))
    with (
        Client(ground) as client,
        flying_on(UdpLink.connecting("127.0.0.1", ground.local_port), VehiclePeer(PX4)) as peer,
    ):
        client.wait_for_vehicle()
        client.upload(MissionType.MISSION, items)
        assert client.download(MissionType.MISSION) == peer.server.items(MissionType.MISSION)
        assert len(peer.server.items(MissionType.MISSION)) == 200


def test_a_connecting_link_hears_its_peers_address_and_port_only() -> None:
    with UdpLink.listening() as vehicle, UdpLink.connecting("127.0.0.1", vehicle.local_port) as ground:
        other = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        other.bind(("127.0.0.2", vehicle.local_port))  # the same port of another address
        stranger = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        for sock in (other, stranger):
            sock.sendto(b"strange", ("127.0.0.1", ground.local_port))
        ground.send(b"hello")
        assert vehicle.receive(5.0) == b"hello"
        vehicle.send(b"back")
        assert ground.receive(5.0) == b"back"
        assert ground.receive(0.0) is None
        other.close()
        stranger.close()


BEAT = Heartbeat(12, 2, 0, 0, 3)


def listening_to(vehicle: UdpLink, ground: UdpLink, codec: Codec) -> None:
    vehicle.send(codec.encode(BEAT))
    assert ground.receive(5.0) is not None
    ground.keep_to(codec.system_id, codec.component_id)


@pytest.mark.parametrize("seed", range(5))
def test_strangers_on_the_port_of_a_vehicle_neither_redirect_nor_are_heard(seed: int) -> None:
    rng = random.Random(seed)
    clock = ManualClock()
    spoof, companion = Codec(system_id=1, component_id=1), Codec(system_id=1, component_id=191)
    with UdpLink.listening(clock=clock) as ground, contextlib.ExitStack() as open_links:
        vehicle = open_links.enter_context(UdpLink.connecting("127.0.0.1", ground.local_port))
        listening_to(vehicle, ground, Codec(system_id=1, component_id=1))
        position = ("127.0.0.1", vehicle.local_port)
        for number in range(40):
            clock.advance_to(number * 0.5)
            stranger = open_links.enter_context(UdpLink.connecting("127.0.0.1", ground.local_port))
            codec = rng.choice([spoof, companion])
            stranger.send(
                rng.choice([b"garbage", rng.randbytes(50), codec.encode(BEAT), codec.encode(MissionCurrent(3))])
            )
            vehicle.send(b"still here")
            assert ground.receive(5.0) == b"still here"
            assert (ground.peer, ground.peers) == (position, (position,))
        ground.send(b"to the vehicle")
        assert vehicle.receive(5.0) == b"to the vehicle"
        assert stranger.receive(0.0) is None
        assert ground.strangers == 40


def test_a_vehicle_that_comes_back_on_another_port_is_followed_once_its_own_is_silent(
    caplog: pytest.LogCaptureFixture,
) -> None:
    clock, codec = ManualClock(), Codec(system_id=1, component_id=1)
    with (
        UdpLink.listening(clock=clock) as ground,
        UdpLink.connecting("127.0.0.1", ground.local_port) as before,
        UdpLink.connecting("127.0.0.1", ground.local_port) as after,
        UdpLink.connecting("127.0.0.1", ground.local_port) as companion,
        UdpLink.connecting("127.0.0.1", ground.local_port) as twin,
    ):
        listening_to(before, ground, codec)
        for _ in range(2):
            twin.send(codec.encode(BEAT))
            assert ground.receive(0.05) is None
        (reported,) = caplog.messages
        assert reported == f"system 1 also sends from 127.0.0.1:{twin.local_port}, which is ignored"
        clock.advance_to(TAKE_OVER_S + 0.1)
        twin.send(codec.encode(BEAT))
        assert ground.receive(0.05) is None, "another vehicle with this system ID"
        companion.send(Codec(system_id=1, component_id=191).encode(BEAT))
        after.send(codec.encode(MissionCurrent(3)))
        assert ground.receive(0.05) is None, "neither another component, nor a message that is no heartbeat"
        after.send(codec.encode(BEAT))
        assert ground.receive(5.0) is not None
        assert ground.peer == ("127.0.0.1", after.local_port)
        ground.send(b"found")
        assert after.receive(5.0) == b"found"
        # Where the silent one speaks again, the other was another vehicle.
        before.send(codec.encode(MissionCurrent(3)))
        assert ground.receive(0.05) is None
        before.send(codec.encode(BEAT))
        assert ground.receive(5.0) is not None
        after.send(codec.encode(BEAT))
        assert ground.receive(0.05) is None
        assert ground.peer == ("127.0.0.1", before.local_port)

import socket

import pytest

from mission_io.autopilots import PX4
from mission_io.client import Client
from mission_io.errors import LinkError, MisuseError
from mission_io.items import Frame, MissionType, waypoint
from mission_io.link import LinkUrl, UdpLink, open_link, parse_link_url, register_endpoint
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
        ("tcp://127.0.0.1:5760", LinkUrl("tcp", rest="127.0.0.1:5760")),
        ("/dev/ttyACM0", LinkUrl("serial", rest="/dev/ttyACM0")),
    ],
)
def test_urls(url: str, parsed: LinkUrl) -> None:
    assert parse_link_url(url) == parsed


@pytest.mark.parametrize(
    ("url", "what"),
    [
        ("", "no link"),
        ("14550", "no link"),
        ("http://127.0.0.1:80", "no link this version can open; use udpin://HOST:PORT"),
        ("udpin://127.0.0.1", "no port"),
        ("udpin://127.0.0.1:70000", "no port"),
        ("udpin://127.0.0.1:-1", "no port"),
        ("udpin://127.0.0.1:１４", "no port"),
        ("udpout://127.0.0.1:0", "port 0"),
        ("tcp://127.0.0.1:5760", "tcp links are not in this version; use udpin"),
        ("serial:///dev/ttyUSB0:57600", "serial links are not in this version"),
        ("/dev/ttyUSB0", "serial links are not in this version"),
    ],
)
def test_urls_that_cannot_be_opened_say_what_can(url: str, what: str) -> None:
    with pytest.raises(MisuseError, match=what):
        open_link(url)


def test_an_endpoint_can_be_registered_under_a_name_of_its_own() -> None:
    link = UdpLink.listening()
    seen: list[LinkUrl] = []

    def factory(url: LinkUrl) -> UdpLink:
        seen.append(url)
        return link

    register_endpoint("testmock", factory)
    assert open_link("testmock:px4") is link
    assert seen == [LinkUrl("testmock", rest="px4")]
    link.close()
    for taken in ("udp", "tcp", "no scheme"):
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
    with UdpLink.listening() as first, pytest.raises(LinkError, match="is the port taken"):
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

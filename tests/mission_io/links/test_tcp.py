import logging
import os
import socket

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT
from mission_io.client.client import Client
from mission_io.errors import LinkError
from mission_io.links import stream
from mission_io.links.datagrams import Link, StreamLink
from mission_io.links.opening import open_link
from mission_io.links.stream import MOST_PEERS, TcpListeningLink, connect_tcp
from mission_io.model.items import Frame, MissionType, waypoint
from mission_io.wire.codec import FramingCounts
from tests.mission_io.links.streams import PATIENCE_S, frames, received
from tests.mission_io.real_vehicle import flying_on
from tests.mission_io.vehicle import VehiclePeer


def test_frames_go_both_ways_over_loopback() -> None:
    with TcpListeningLink() as ground, connect_tcp("127.0.0.1", ground.local_port) as vehicle:
        sent = frames(50)
        for frame in sent:
            vehicle.send(frame)
        assert received(ground, 50) == sent
        assert len(ground.peers) == 1
        for frame in sent:
            ground.send(frame)
        assert received(vehicle, 50) == sent
        assert vehicle.receive(0.0) is None
        assert ground.receive(0.0) is None
        assert isinstance(ground, StreamLink)


def test_it_listens_on_this_machine_unless_told_otherwise() -> None:
    link = open_link("tcpin://:0")
    assert isinstance(link, TcpListeningLink)
    with link:
        assert link._listener.getsockname()[0] == "127.0.0.1"


def test_a_peer_that_goes_away_is_one_clear_error_after_what_it_had_sent() -> None:
    with TcpListeningLink() as ground, connect_tcp("127.0.0.1", ground.local_port) as vehicle:
        ground.send(b"")
        ground.send(frames(1)[0])
        ground.close()
        assert received(vehicle, 1) == frames(1)
        with pytest.raises(
            LinkError, match=r"TCP 127\.0\.0\.1:\d+ was lost: the other side closed the connection; open the link again"
        ):
            vehicle.receive(PATIENCE_S)
        for use in (lambda: vehicle.receive(0.0), lambda: vehicle.send(frames(1)[0])):
            with pytest.raises(LinkError, match="is closed"):
                use()


def test_a_peer_that_breaks_off_is_the_same_error() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        link = connect_tcp("127.0.0.1", server.getsockname()[1])
        peer, _ = server.accept()
        peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\x01\0\0\0\0\0\0\0")  # close by a reset
        peer.close()
        with link, pytest.raises(LinkError, match="lost: Connection reset"):
            link.receive(PATIENCE_S)
        again = connect_tcp("127.0.0.1", server.getsockname()[1])
        peer, _ = server.accept()
        peer.close()
        with again, pytest.raises(LinkError, match=r"TCP .* was lost: (Broken pipe|Connection reset)"):
            _send_without_end(again)


def _send_without_end(link: Link) -> None:
    while True:
        link.send(frames(1)[0])


def test_a_listening_link_goes_on_with_the_next_who_connects(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    one, two = frames(2)
    with TcpListeningLink() as ground:
        ground.send(one)  # to nobody
        with connect_tcp("127.0.0.1", ground.local_port) as vehicle:
            vehicle.send(b"noise" + one + two[:9])
            assert received(ground, 1) == [one]
        assert ground.receive(0.2) is None
        assert ground.peers == ()
        with connect_tcp("127.0.0.1", ground.local_port) as vehicle:
            vehicle.send(two)
            assert received(ground, 1) == [two]
        assert ground.framing == FramingCounts(5, 0, 0)
    said = [record.getMessage() for record in caplog.records]
    assert len([line for line in said if "has connected" in line]) == 2
    assert len([line for line in said if "was lost: the other side closed the connection" in line]) == 1


def test_several_who_connect_hear_everything_and_are_all_heard() -> None:
    with (
        TcpListeningLink() as ground,
        connect_tcp("127.0.0.1", ground.local_port) as one,
        connect_tcp("127.0.0.1", ground.local_port) as two,
    ):
        one.send(frames(1, system_id=1)[0])
        two.send(frames(1, system_id=2)[0])
        assert {frame[5] for frame in received(ground, 2)} == {1, 2}
        ground.send(frames(1, system_id=255)[0])
        assert received(one, 1) == received(two, 1) == frames(1, system_id=255)


def test_one_who_takes_nothing_or_goes_while_we_send_does_not_hurt_the_other(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream, "SEND_BUFFER_BYTES", 500)
    (frame,) = frames(1)
    with TcpListeningLink() as ground, socket.socket() as stuck:
        stuck.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1024)
        stuck.connect(("127.0.0.1", ground.local_port))
        stuck.send(frame)
        assert received(ground, 1) == [frame]
        (stuck_peer,) = ground._peers.values()
        with connect_tcp("127.0.0.1", ground.local_port) as good:
            good.send(frame)
            assert received(ground, 1) == [frame]
            with socket.socket(fileno=os.dup(stuck_peer.channel.fileno())) as its_end:
                its_end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1024)
            while stuck_peer.dropped_frames == 0:  # takes a few kilobytes, whatever the system keeps
                ground.send(frame)
                assert received(good, 1) == [frame]
            stuck.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\x01\0\0\0\0\0\0\0")
            stuck.close()
            for _ in range(3):
                ground.send(frame)
                assert received(good, 1) == [frame]
            assert len(ground.peers) == 1


def test_more_than_so_many_are_turned_away(caplog: pytest.LogCaptureFixture) -> None:
    with TcpListeningLink() as ground:
        links = []
        for _ in range(MOST_PEERS + 1):
            links.append(connect_tcp("127.0.0.1", ground.local_port))
            ground.send(b"")
            assert ground.receive(0.0) is None
        assert len(ground.peers) == MOST_PEERS
        with pytest.raises(LinkError, match="was lost"):
            links[-1].receive(PATIENCE_S)
        for link in links:
            link.close()
    assert "because 16 clients are already connected" in caplog.text


def test_nobody_there_a_taken_port_an_unknown_host_and_a_closed_link_are_errors() -> None:
    ground = TcpListeningLink()
    port = ground.local_port
    with pytest.raises(LinkError, match=f"cannot listen on TCP 127.0.0.1:{port}: .*is the port in use"):
        open_link(f"tcpin://127.0.0.1:{port}")
    ground.close()
    ground.close()
    for use in (lambda: ground.receive(0.0), lambda: ground.send(b""), lambda: ground.local_port):
        with pytest.raises(LinkError, match="the link is closed"):
            use()
    with pytest.raises(
        LinkError, match=f"cannot connect to TCP 127.0.0.1:{port}: Connection refused; is the vehicle switched on"
    ):
        open_link(f"tcp://127.0.0.1:{port}")
    with pytest.raises(LinkError, match=r"cannot connect to TCP host\.invalid:5760"):
        open_link("tcp:host.invalid:5760")
    with pytest.raises(LinkError, match="cannot find the host"):
        open_link("tcpin://host.invalid:5760")


def test_a_mission_goes_over_real_tcp_in_both_directions_of_connecting() -> None:
    items = tuple(waypoint(46.5 + i * 1e-4, -7.25, 30.0, frame=Frame.ABOVE_HOME) for i in range(100))
    for vehicle_listens in (True, False):
        listening = TcpListeningLink()
        other = connect_tcp("127.0.0.1", listening.local_port)
        vehicle, ground = (listening, other) if vehicle_listens else (other, listening)
        with Client(ground) as client, flying_on(vehicle, VehiclePeer(ARDUPILOT)):
            client.wait_for_vehicle()
            client.upload(MissionType.MISSION, items)
            assert len(client.download(MissionType.MISSION)) == 100
            assert client.statistics.lost == client.statistics.garbage_bytes == 0


def test_statistics_count_the_garbage_that_the_link_has_cut_away() -> None:
    listening = TcpListeningLink()
    with Client(listening) as client, connect_tcp("127.0.0.1", listening.local_port) as vehicle:
        (frame,) = frames(1)
        vehicle.send(b"garbage" + frame[:-1] + b"\x00" + frame)
        while not client.poll(PATIENCE_S):
            pass
        counts = client.statistics
        assert (counts.frames_in, counts.garbage_bytes, counts.checksum_errors) == (1, 7 + len(frame), 1)


def test_wakeups_without_a_byte_and_a_peer_that_goes_before_it_is_accepted_are_no_errors() -> None:
    with TcpListeningLink() as ground, connect_tcp("127.0.0.1", ground.local_port) as vehicle:
        (frame,) = frames(1)
        vehicle.send(frame)
        assert received(ground, 1) == [frame]
        (peer,) = ground._peers.values()
        assert peer.take() == []
        ground._accept()
        assert len(ground.peers) == 1

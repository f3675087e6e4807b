"""Serial links, on the two ends of a pseudo-terminal."""

import errno
import os
import sys
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest

from mission_io.autopilots.autopilot import PX4
from mission_io.client.client import Client
from mission_io.errors import LinkError, MisuseError
from mission_io.links import stream
from mission_io.links.opening import open_link
from mission_io.links.stream import ChannelLink, open_serial
from mission_io.model.items import Frame, MissionType, waypoint
from mission_io.wire.codec import FramingCounts
from tests.mission_io.links.streams import PATIENCE_S, frames, received
from tests.mission_io.real_vehicle import flying_on
from tests.mission_io.vehicle import VehiclePeer


class Radio:
    """The end of a pseudo-terminal that is not the port."""

    name = "pseudo-terminal"

    def __init__(self) -> None:
        self.handle, port = os.openpty()
        tty.setraw(port)
        self.device = os.ttyname(port)
        self._port = port
        os.set_blocking(self.handle, False)

    def fileno(self) -> int:
        return self.handle

    def read(self, size: int) -> bytes:
        return os.read(self.handle, size)

    def write(self, data: bytes) -> int:
        return os.write(self.handle, data)

    def close(self) -> None:
        for handle in (self.handle, self._port):
            if handle >= 0:
                os.close(handle)
        self.handle = self._port = -1


@pytest.fixture
def radio() -> Iterator[Radio]:
    end = Radio()
    yield end
    end.close()


@pytest.mark.parametrize("form", ["serial://{}:57600", "{},115200", "{}:57600", "{}"])
def test_frames_go_both_ways_by_every_form_of_the_url(radio: Radio, form: str) -> None:
    link = open_link(form.format(radio.device))
    assert isinstance(link, ChannelLink)
    with link, ChannelLink(radio) as other:
        sent = frames(30)
        for frame in sent:
            link.send(frame)
            other.send(b"~" + frame)
        assert received(other, 30) == sent
        assert received(link, 30) == sent
        assert link.framing == FramingCounts(30, 0, 0)
        assert link.receive(0.0) is None


def test_every_byte_value_goes_through_unchanged(radio: Radio) -> None:
    with open_serial(radio.device) as link:
        link.send(bytes(range(256)))
        assert radio.read(1000) == bytes(range(256))


def test_a_port_that_is_pulled_out_is_one_clear_error_after_what_it_had_sent(radio: Radio) -> None:
    with open_serial(radio.device) as link:
        radio.write(frames(1)[0])
        assert received(link, 1) == frames(1)
        radio.close()
        with pytest.raises(
            LinkError,
            match=r"connection to serial port /dev/.* was lost: the device was disconnected; open the link again",
        ):
            link.receive(PATIENCE_S)
        for use in (lambda: link.receive(0.0), lambda: link.send(b"x")):
            with pytest.raises(LinkError, match="is closed"):
                use()


def test_a_port_that_is_pulled_out_while_sending_is_the_same_error(radio: Radio) -> None:
    with open_serial(radio.device) as link:
        radio.close()
        with pytest.raises(LinkError, match=r"serial port /dev/.* was lost: Input/output error"):
            link.send(frames(1)[0])


def test_a_port_that_is_ready_and_empty_has_gone(radio: Radio, monkeypatch: pytest.MonkeyPatch) -> None:
    with open_serial(radio.device) as link:
        radio.write(b"x")
        monkeypatch.setattr(os, "read", lambda *_: b"")
        with pytest.raises(LinkError, match="the device was disconnected"):
            link.receive(PATIENCE_S)


def test_a_wakeup_without_a_byte_is_no_error(radio: Radio, monkeypatch: pytest.MonkeyPatch) -> None:
    def nothing(*_: int) -> bytes:
        monkeypatch.undo()
        raise BlockingIOError(errno.EAGAIN, "again")

    with open_serial(radio.device) as link:
        radio.write(frames(1)[0])
        monkeypatch.setattr(os, "read", nothing)
        assert received(link, 1) == frames(1)


def test_a_port_that_takes_nothing_does_not_hold_us_up(radio: Radio, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream, "SEND_BUFFER_BYTES", 500)
    with open_serial(radio.device) as link:
        (frame,) = frames(1)
        while link.dropped_frames == 0:
            link.send(frame)
        with ChannelLink(radio) as other:
            for _ in range(100):
                assert link.receive(0.0) is None
                assert received(other, 1) == [frame]


def test_a_port_is_opened_once(radio: Radio) -> None:
    with open_serial(radio.device), pytest.raises(LinkError, match="another program uses the device"):
        open_serial(radio.device)


def test_a_port_that_is_not_there_or_not_ours_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(LinkError, match="cannot open the serial port /dev/ttyNOWHERE at 57600 baud: No such file"):
        open_link("/dev/ttyNOWHERE")
    plain = tmp_path / "file"
    plain.touch()
    with pytest.raises(LinkError, match="cannot open the serial port"):
        open_serial(str(plain))

    def forbidden(*_: object) -> int:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(os, "open", forbidden)
    with pytest.raises(LinkError, match="Permission denied; does this user have access to serial ports"):
        open_serial("/dev/ttyUSB0")


def test_without_pyserial_the_error_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "serial", None)
    with pytest.raises(MisuseError, match=r"pip install pyserial"):
        open_link("/dev/ttyUSB0")


def test_a_mission_goes_over_a_serial_line(radio: Radio) -> None:
    items = tuple(waypoint(46.5 + i * 1e-4, -7.25, 30.0, frame=Frame.ABOVE_HOME) for i in range(100))
    with Client(open_serial(radio.device)) as client, flying_on(ChannelLink(radio), VehiclePeer(PX4)) as peer:
        client.wait_for_vehicle()
        client.upload(MissionType.MISSION, items)
        assert client.download(MissionType.MISSION) == peer.server.items(MissionType.MISSION)
        assert client.statistics.garbage_bytes == 0

"""Telemetry logs: what pymavlink reads out of them is what went over the link."""

from pathlib import Path

import pytest
from pymavlink import mavutil

from mission_io.errors import LinkError
from mission_io.links.opening import FLUSH_S, LoggedLink, TelemetryLogWriter
from mission_io.model.enums import AutopilotId, VehicleClass
from mission_io.wire.codec import Codec, FramingCounts
from mission_io.wire.messages import Heartbeat, MissionCount, MissionRequestInt

START_S = 1_790_000_000.25


class Clocks:
    """A time of day and a monotonic clock that stand still until they are moved."""

    def __init__(self) -> None:
        self.passed_s = 0.0

    def now(self) -> float:
        return self.passed_s

    def unix_s(self) -> float:
        return START_S + self.passed_s


class Queue:
    """A link of datagrams whose other end is a list."""

    def __init__(self, clock: Clocks, arriving: list[bytes]) -> None:
        self.clock, self.arriving, self.sent, self.closed = clock, arriving, list[bytes](), False

    def send(self, data: bytes) -> None:
        self.sent.append(data)

    def receive(self, timeout_s: float) -> bytes | None:
        self.clock.passed_s += timeout_s
        return self.arriving.pop(0) if self.arriving else None

    def close(self) -> None:
        self.closed = True


def read(path: Path) -> list[tuple[float, str, int]]:
    log = mavutil.mavlogfile(str(path), robust_parsing=True)
    try:
        found = []
        while (message := log.recv_msg()) is not None:
            found.append((message._timestamp, message.get_type(), message.get_srcSystem()))
        return found
    finally:
        log.close()


def beat(codec: Codec) -> bytes:
    return codec.encode(Heartbeat(AutopilotId.ARDUPILOT, VehicleClass.QUADROTOR))


def test_pymavlink_reads_what_was_heard_and_sent(tmp_path: Path) -> None:
    clocks, vehicle, ours = Clocks(), Codec(system_id=7, component_id=1), Codec(system_id=255, component_id=190)
    two = beat(vehicle) + vehicle.encode(MissionRequestInt(255, 190, 3))
    inner = Queue(clocks, [beat(vehicle), b"garbage" + two + b"\xfd\x09", b"nothing at all"])
    link = LoggedLink(inner)
    link.send(beat(ours))
    with TelemetryLogWriter(tmp_path / "a.tlog", clock=clocks, flush_clock=clocks) as log:
        link.log_to(log)
        assert link.receive(0.5) is not None
        link.send(ours.encode(MissionCount(7, 1, 3)))
        assert [link.receive(1.0) for _ in range(3)][2] is None
        assert log.frames == 4
        link.log_to(None)
        link.send(beat(ours))
    assert read(tmp_path / "a.tlog") == [
        (pytest.approx(START_S + 0.5, abs=1e-6), "HEARTBEAT", 7),
        (pytest.approx(START_S + 0.5, abs=1e-6), "MISSION_COUNT", 255),
        (pytest.approx(START_S + 1.5, abs=1e-6), "HEARTBEAT", 7),
        (pytest.approx(START_S + 1.5, abs=1e-6), "MISSION_REQUEST_INT", 7),
    ]
    assert len(inner.sent) == 3
    link.close()
    assert inner.closed


def test_what_was_written_is_in_the_file_soon(tmp_path: Path) -> None:
    clocks, vehicle = Clocks(), Codec(system_id=1, component_id=1)
    link = LoggedLink(Queue(clocks, [beat(vehicle)]))
    path = tmp_path / "a.tlog"
    with TelemetryLogWriter(path, clock=clocks, flush_clock=clocks) as log:
        link.log_to(log)
        assert link.receive(0.0) is not None
        assert path.read_bytes() == b""
        assert link.receive(FLUSH_S) is None
        assert len(read(path)) == 1


def test_it_goes_on_under_another_name(tmp_path: Path) -> None:
    clocks, vehicle = Clocks(), Codec(system_id=1, component_id=1)
    (tmp_path / "b.tlog").write_bytes(b"older")
    with TelemetryLogWriter(tmp_path / "a.tlog", clock=clocks, flush_clock=clocks) as log:
        log.write(beat(vehicle))
        log.move_to(tmp_path / "b.tlog")
        log.write(beat(vehicle))
        assert log.error is None
    assert len(read(tmp_path / "b.tlog")) == 2
    assert not (tmp_path / "a.tlog").exists()


class FullFile:
    """A file on a disk that is full after so many bytes."""

    def __init__(self, room: int) -> None:
        self.room = room

    def write(self, data: bytes) -> int:
        self.room -= len(data)
        if self.room < 0:
            raise OSError(28, "No space left on device")
        return len(data)

    def flush(self) -> None:
        if self.room < 0:
            raise OSError(28, "No space left on device")

    def close(self) -> None:
        self.flush()


@pytest.mark.parametrize("room", [0, 25, 60])
def test_a_full_disk_ends_the_log_and_nothing_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, room: int) -> None:
    clocks, vehicle = Clocks(), Codec(system_id=1, component_id=1)
    link = LoggedLink(Queue(clocks, [beat(vehicle) for _ in range(9)]))
    log = TelemetryLogWriter(tmp_path / "a.tlog", clock=clocks, flush_clock=clocks)
    log._file.close()
    monkeypatch.setattr(log, "_file", FullFile(room))
    link.log_to(log)
    assert all(link.receive(0.1) is not None for _ in range(9))
    assert link.receive(1.0) is None
    assert log.error is not None
    assert "No space left on device" in log.error
    log.move_to(tmp_path / "b.tlog")
    log.close()


def test_a_log_that_cannot_be_made(tmp_path: Path) -> None:
    with pytest.raises(LinkError, match=r"missing.*telemetry log cannot be written"):
        TelemetryLogWriter(tmp_path / "missing" / "a.tlog")


def test_garbage_on_a_stream_is_counted_once(tmp_path: Path) -> None:
    class Stream(Queue):
        framing = FramingCounts(5, 1, 0)

    clocks = Clocks()
    assert LoggedLink(Stream(clocks, [])).framing == FramingCounts(5, 1, 0)
    assert LoggedLink(Queue(clocks, [])).framing == FramingCounts()
    assert LoggedLink(Queue(clocks, [])).clock is clocks
    with TelemetryLogWriter(tmp_path / "a.tlog") as log:
        log.keep_up()
        log.write(b"")

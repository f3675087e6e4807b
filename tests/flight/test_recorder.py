"""A sample has the attitude of its own moment, or none, and each position of the vehicle's own log is a sample."""

import contextlib
import math
from types import SimpleNamespace

import numpy as np
import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Autopilot
from mission_io.model.enums import EkfFlag
from mission_io.wire import messages as m
from mission_io.wire.messages import Address
from tests.flight.scene import Scene, make_scene, mission
from uavcover.flight.fly import Recorder
from uavcover.flight.monitor import Monitor
from uavcover.flight.orders import FlightTimeouts
from uavcover.mock.faults import parse_fault
from uavcover.mock.state import Streams, TruthSample
from uavcover.model.track import Ending, FlightFailedError, TrackSample
from uavcover.terrain.frames import LocalFrame

FRAME = LocalFrame(36.5, -84.2, 400.0)


def recorded(
    attitude: m.Attitude | None,
    *more: m.Message,
    heading_deg: float | None = 123.0,
    at_s: float = 50.0,
    photos_taken: int | None = None,
    velocities: tuple[tuple[float, float, float], ...] = ((0.0, 0.0, 0.0),),
) -> TrackSample:
    samples: list[TrackSample] = []
    monitor = SimpleNamespace(
        latest={type(each): each for each in (attitude, *more)}.get,
        current_seq=3,
        on_position=None,
        position_at_s=7.5,
        photos_taken=photos_taken,
    )
    recorder = Recorder(
        monitor,  # type: ignore[arg-type]
        FRAME, waypoint_of=lambda seq: seq - 1, on_sample=samples.append, utc_offset_s=1.7e9,
    )  # fmt: skip
    recorder.start()
    for number, velocity in enumerate(velocities):
        monitor.on_position(m.GlobalPositionInt(at_s + number, 36.5, -84.2, 480.0, 80.0, *velocity, heading_deg))
    return samples[-1]


def attitude(at_s: float) -> m.Attitude:
    return m.Attitude(at_s, 0.1, -0.2, 1.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("age_s", [0.0, 0.4, 1.0, -0.1])
def test_an_attitude_of_that_moment_is_written_with_its_age(age_s: float) -> None:
    sample = recorded(attitude(50.0 - age_s))
    assert (sample.roll_deg, sample.pitch_deg, sample.yaw_deg) == pytest.approx(
        (math.degrees(0.1), math.degrees(-0.2), math.degrees(1.0))
    )
    assert sample.attitude_age_s == pytest.approx(age_s)
    assert sample.current_waypoint == 2


@pytest.mark.parametrize("age_s", [1.01, 30.0, -5.0])
def test_an_older_or_newer_one_is_not_known_but_the_heading_of_the_position_is(age_s: float) -> None:
    sample = recorded(attitude(50.0 - age_s))
    assert math.isnan(sample.roll_deg)
    assert math.isnan(sample.pitch_deg)
    assert sample.yaw_deg == pytest.approx(123.0)
    assert sample.attitude_age_s == pytest.approx(age_s)


def test_without_any_attitude_nothing_is_made_up() -> None:
    sample = recorded(None, heading_deg=None)
    assert all(math.isnan(x) for x in (sample.roll_deg, sample.pitch_deg, sample.yaw_deg, sample.attitude_age_s))


def test_the_time_of_day_is_the_vehicles() -> None:
    reported = m.SystemTime(1_780_000_000.0, 49.5)
    assert recorded(None, reported).unix_time_s == 1_780_000_000.5  # half a second later
    for unknown in (m.SystemTime(0.0, 49.5), m.SystemTime(49.5, 49.5)):
        assert math.isnan(recorded(None, unknown).unix_time_s)
    assert math.isnan(recorded(None).unix_time_s)


def test_a_sample_says_whether_there_is_a_fix() -> None:
    def has_fix(*reported: m.Message) -> float:
        return recorded(None, *reported).has_fix

    filter_flags = EkfFlag.POSITION_HORIZONTAL_ABSOLUTE
    good, lost = m.EkfStatusReport(int(filter_flags)), m.EkfStatusReport(int(filter_flags | EkfFlag.CONSTANT_POSITION))
    receiver = [m.GpsRawInt(50.0, fix, 36.5, -84.2, 480.0) for fix in range(7)]
    assert math.isnan(has_fix())
    assert [has_fix(each) for each in receiver] == [0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0]
    assert (has_fix(good), has_fix(lost)) == (1.0, 0.0)
    assert (has_fix(receiver[3], good), has_fix(receiver[3], lost), has_fix(receiver[1], good)) == (1.0, 0.0, 0.0)


def counted(*messages: m.Message) -> int | None:
    monitor = Monitor()
    monitor.listen_to(Address(1, 1))
    for number, message in enumerate(messages):
        monitor(m.Received(message, 1, 1), 10.0 + number)
    return monitor.photos_taken


def test_pictures_are_counted_as_the_vehicle_counts_them() -> None:
    where = (36.5, -84.2, 480.0, 80.0)
    feedback = m.CameraFeedback(50.0, 12, *where, 0.0, 0.0, 0.0)
    captured = m.CameraImageCaptured(50.0, *where, (1.0, 0.0, 0.0, 0.0), 11, 1)
    assert counted() is None
    assert counted(feedback) == counted(captured) == 12
    assert math.isnan(recorded(None).pictures_taken)
    assert recorded(None, photos_taken=12).pictures_taken == 12.0
    # A camera that fails reports: its photos do not count, and those after it are not taken for lost ones.
    failed = m.CameraImageCaptured(50.0, *where, (1.0, 0.0, 0.0, 0.0), 12, 0)
    after = m.CameraImageCaptured(51.0, *where, (1.0, 0.0, 0.0, 0.0), 13, 1)
    assert counted(m.CameraImageCaptured(50.0, *where, (1.0, 0.0, 0.0, 0.0), 0, 0)) == 0
    assert (counted(captured, failed, failed), counted(captured, failed, after)) == (12, 13)


def test_when_a_position_arrived_is_on_the_clock_of_the_ground_station():
    assert recorded(None).received_utc_s == 1.7e9 + 7.5


def velocity(*reported: tuple[float, float, float]) -> list[float]:
    sample = recorded(None, velocities=reported)
    return [sample.velocity_north_m_s, sample.velocity_east_m_s, sample.velocity_down_m_s]


def test_the_velocity_is_that_of_the_position() -> None:
    assert velocity((3.0, -4.0, 0.25)) == [3.0, -4.0, 0.25]


def test_a_velocity_of_zero_is_one_only_of_a_vehicle_that_reports_others() -> None:
    assert all(map(math.isnan, velocity((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))))
    assert velocity((0.0, 0.0, 0.0), (0.0, 0.01, 0.0), (0.0, 0.0, 0.0)) == [0.0, 0.0, 0.0]


BOTH = pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
TIMEOUTS = FlightTimeouts(override_s=10.0, held_s=10.0, ready_s=20.0, stuck_s=20.0)


def scene_at(
    rate_hz: float, autopilot: Autopilot, monkeypatch: pytest.MonkeyPatch, *faults: str
) -> tuple[Scene, list[TruthSample]]:
    """A vehicle that tells its position and attitude so often, whatever it is asked for, and its own log."""
    requested = Streams.set_interval

    def set_interval(self: Streams, kind: type[m.Message], interval_s: float | None, now: float) -> None:
        own = kind in (m.GlobalPositionInt, m.Attitude)
        requested(self, kind, 1.0 / rate_hz if own else interval_s, now)

    monkeypatch.setattr(Streams, "set_interval", set_interval)
    log: list[TruthSample] = []
    scene = make_scene(autopilot, on_truth=log.append, faults=[parse_fault(fault) for fault in faults])
    scene.upload(mission())
    return scene, log


def assert_whole(scene: Scene, log: list[TruthSample]) -> None:
    times_s = [sample.time_s for sample in scene.samples]
    reported = [true for true in log if times_s[0] - 1e-9 <= true.time_s <= times_s[-1] + 1e-9]
    assert times_s == pytest.approx([true.time_s for true in reported], abs=0.0011), "MAVLink counts milliseconds"
    recorded = np.array([(s.lat_deg, s.lon_deg, s.alt_amsl_m) for s in scene.samples])
    true = np.array([(s.lat_deg, s.lon_deg, s.alt_amsl_m) for s in reported])
    assert np.abs(recorded[:, :2] - true[:, :2]).max() <= 0.6e-7
    assert np.abs(recorded[:, 2] - true[:, 2]).max() <= 0.0006


@pytest.mark.thinned
@BOTH
@pytest.mark.parametrize("rate_hz", [5.0, 10.0, 17.0, 50.0])
def test_at_every_rate_each_position_is_a_sample(
    rate_hz: float, autopilot: Autopilot, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, log = scene_at(rate_hz, autopilot, monkeypatch)
    outcome = scene.fly()
    assert outcome.ending is Ending.LANDED
    assert_whole(scene, log)
    assert len(scene.samples) == pytest.approx(rate_hz * outcome.duration_s, rel=0.02)


@BOTH
@pytest.mark.parametrize("rate_hz", [1.0, 2.0, 4.0])
def test_a_rate_that_is_too_low_keeps_it_on_the_ground(
    rate_hz: float, autopilot: Autopilot, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, _ = scene_at(rate_hz, autopilot, monkeypatch)
    begun: list[bool] = []
    with pytest.raises(FlightFailedError, match=r"GlobalPositionInt .*requires 5|no position messages") as caught:
        scene.fly(on_begin=lambda: begun.append(True))
    assert caught.value.outcome.ending is Ending.NOT_READY
    assert not scene.vehicle.armed
    assert begun == scene.samples == []


@pytest.mark.thinned
@BOTH
@pytest.mark.parametrize(
    "fault", ["mission-changed@15s", "mission-changed@25s", "pilot-mode:land@20s", "pilot-mode@20s"]
)
def test_nothing_is_left_out_when_somebody_else_has_the_vehicle_or_its_mission(
    fault: str, autopilot: Autopilot, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, log = scene_at(10.0, autopilot, monkeypatch, fault)
    with pytest.raises(FlightFailedError):
        scene.fly(timeouts=TIMEOUTS)
    assert_whole(scene, log)
    assert -1 in [sample.current_waypoint for sample in scene.samples[-20:]]
    assert scene.samples[-1].time_s > 25.0


@BOTH
def test_what_cannot_be_written_keeps_it_on_the_ground(autopilot: Autopilot, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, _ = scene_at(10.0, autopilot, monkeypatch)

    def refuse() -> None:
        raise OSError("no room")

    with contextlib.suppress(OSError):
        scene.fly(on_begin=refuse)
        pytest.fail("it flew")
    assert not scene.vehicle.armed
    assert scene.samples == []
    assert scene.monitor.on_position is None

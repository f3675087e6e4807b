"""A sample has the attitude of its own moment, or none."""

import math
from types import SimpleNamespace

import pytest

from mission_io.wire import messages as m
from mission_io.wire.messages import Address
from uavcover.flight.fly import Recorder
from uavcover.flight.monitor import Monitor
from uavcover.model.track import TrackSample
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
    told = m.SystemTime(1_780_000_000.0, 49.5)
    assert recorded(None, told).unix_time_s == 1_780_000_000.5  # half a second later
    for unknown in (m.SystemTime(0.0, 49.5), m.SystemTime(49.5, 49.5)):
        assert math.isnan(recorded(None, unknown).unix_time_s)
    assert math.isnan(recorded(None).unix_time_s)


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


def velocity(*told: tuple[float, float, float]) -> list[float]:
    sample = recorded(None, velocities=told)
    return [sample.velocity_north_m_s, sample.velocity_east_m_s, sample.velocity_down_m_s]


def test_the_velocity_is_that_of_the_position() -> None:
    assert velocity((3.0, -4.0, 0.25)) == [3.0, -4.0, 0.25]


def test_a_velocity_of_zero_is_one_only_of_a_vehicle_that_reports_others() -> None:
    assert all(map(math.isnan, velocity((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))))
    assert velocity((0.0, 0.0, 0.0), (0.0, 0.01, 0.0), (0.0, 0.0, 0.0)) == [0.0, 0.0, 0.0]

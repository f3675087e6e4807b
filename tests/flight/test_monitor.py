"""Time stamps: one wrong one costs a message; several that agree are a restart, or the end of a silence. Texts in pieces."""

import math
import random

import pytest

from mission_io.wire import messages as m
from mission_io.wire.messages import Address, StatusText
from uavcover.flight.monitor import Monitor, TextAssembler, VehicleClock


def running(*, until_s: float = 60.0, hz: float = 10.0) -> VehicleClock:
    clock = VehicleClock()
    for step in range(int(until_s * hz) + 1):
        clock.take(step / hz, step / hz)
    return clock


WRONG = [0.0, 4294967.295, 59.0, 61.0, 63.0, 75.0, 3600.0, 1.0, -5.0, math.inf, math.nan]


@pytest.mark.parametrize("wrong_s", WRONG)
def test_one_wrong_stamp_costs_one_message(wrong_s):
    clock = running()
    clock.take(wrong_s, 60.05)
    believed = [clock.take(60.1 + 0.1 * step, 60.1 + 0.1 * step) for step in range(20)]
    assert all(believed)
    assert clock.time_s == pytest.approx(62.0)
    assert not clock.restarted


@pytest.mark.parametrize("seed", range(200))
def test_a_wrong_stamp_now_and_then_never_reads_as_a_restart(seed):
    rng = random.Random(seed)
    clock, believed = VehicleClock(), 0
    for step in range(2000):
        if rng.random() < 0.3:
            clock.take(rng.choice([0.0, rng.uniform(0.0, 400.0), 10.0 ** rng.uniform(0.0, 7.0)]), step * 0.1)
        believed += clock.take(step * 0.1, step * 0.1)
    assert believed > 1980
    assert clock.time_s == pytest.approx(199.9, abs=0.5)
    assert not clock.restarted


@pytest.mark.parametrize("base_s", [0.0, 2.0, 40.0])
def test_a_restart_is_believed_at_the_third_message_that_agrees(base_s):
    clock = running()
    believed = [clock.take(base_s + 0.1 * step, 60.1 + 0.1 * step) for step in range(5)]
    assert believed == [False, False, True, True, True]
    assert clock.restarted
    assert clock.time_s == pytest.approx(base_s + 0.4)


@pytest.mark.parametrize("speed", [1.0, 20.0, 60.0])
def test_after_a_silence_time_goes_on_without_a_restart(speed):
    clock = running()
    after_s = 60.0 + 12.0 * speed
    believed = [clock.take(after_s + 0.1 * step, 72.0 + 0.1 * step / speed) for step in range(5)]
    assert believed == [False, False, True, True, True]
    assert not clock.restarted


def test_late_messages_are_believed_and_do_not_set_the_time_back():
    clock = running()
    assert clock.take(57.0, 60.1)
    assert clock.time_s == pytest.approx(60.0)


def test_rare_messages_tell_the_time_too():
    clock = VehicleClock()
    believed = [clock.take(float(step), float(step)) for step in range(20)]
    assert believed == [*[False] * 4, *[True] * 16]
    assert not clock.restarted


def test_a_stamp_that_stands_still_proves_nothing():
    clock = running()
    assert not any(clock.take(0.0, 60.0 + step) for step in range(50))
    assert clock.time_s == pytest.approx(60.0)


@pytest.mark.parametrize("seed", range(30))
def test_no_position_of_the_vehicle_is_lost_by_a_silence_or_a_wrong_stamp(seed):
    rng = random.Random(seed)
    vehicle, monitor, recorded = Address(1, 1), Monitor(), list[float]()
    monitor.listen_to(vehicle)
    monitor.on_position = lambda position: recorded.append(position.time_boot_s)
    time_s, sent, since_silence = 10.0, list[float](), 0
    for _ in range(300):
        since_silence = 0 if since_silence > 3 and rng.random() < 0.03 else since_silence + 1
        time_s = round(time_s + (0.1 if since_silence else rng.uniform(1.0, 40.0)), 3)
        stamps = [(time_s, m.GlobalPositionInt), (time_s, m.Attitude)]
        if since_silence > 3 and rng.random() < 0.1:
            stamps.append((rng.choice([0.0, time_s + 3600.0]), m.SystemTime))
        for stamp_s, kind in stamps:
            monitor(m.Received(message_of(kind, stamp_s), 1, 1, 2), time_s)
        sent.append(time_s)
    # The last ones may still wait for their proof.
    assert recorded == sent[: len(recorded)]
    assert len(recorded) >= len(sent) - 2


def message_of(kind: type, stamp_s: float) -> m.Message:
    if kind is m.GlobalPositionInt:
        return m.GlobalPositionInt(stamp_s, 36.5, -84.2, 400.0, 20.0, 0.0, 0.0, 0.0, None)
    if kind is m.Attitude:
        return m.Attitude(stamp_s, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return m.SystemTime(0.0, stamp_s)


LONG = "Arming denied: Resolve system health failures first, and then some more letters\t"


def lines(*pieces: StatusText) -> list[tuple[int, str]]:
    assembler = TextAssembler()
    return [(line.severity, line.text) for piece in pieces for line in assembler.take(piece)]


def test_a_short_line_is_a_line() -> None:
    assert lines(StatusText(6, "Takeoff detected\t")) == [(6, "Takeoff detected")]


def test_a_full_piece_of_a_line_without_a_number_is_a_line() -> None:
    assert lines(StatusText(4, "x" * 50)) == [(4, "x" * 50)]


def test_pieces_of_a_line_are_put_together() -> None:
    assert lines(StatusText(2, LONG[:50], 7, 0), StatusText(2, LONG[50:], 7, 1)) == [(2, LONG.strip())]


def test_a_line_of_exactly_two_pieces_ends_with_an_empty_one() -> None:
    assert lines(StatusText(2, "a" * 50, 7, 0), StatusText(2, "b" * 50, 7, 1), StatusText(2, "", 7, 2)) == [
        (2, "a" * 50 + "b" * 50)
    ]


def test_a_line_whose_end_was_lost_is_given_when_the_next_begins() -> None:
    assert lines(StatusText(2, "a" * 50, 7, 0), StatusText(5, "next")) == [(2, "a" * 50), (5, "next")]


def test_a_piece_that_does_not_fit_begins_a_line() -> None:
    assert lines(StatusText(2, "a" * 50, 7, 0), StatusText(2, "c", 7, 2)) == [(2, "a" * 50), (2, "c")]

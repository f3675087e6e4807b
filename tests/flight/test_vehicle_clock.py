"""Time stamps: one that is wrong costs one message; several that agree are a restart, or the end of a silence."""

import math
import random

import pytest

from uavcover.flight.vehicle_clock import VehicleClock


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

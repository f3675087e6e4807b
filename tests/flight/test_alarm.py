"""When an alarm is told: rules on made-up times, no vehicle."""

import random
from itertools import pairwise

import pytest

from uavcover.flight.evidence import WATCH
from uavcover.flight.watch import Alarm, ReportReason


def reported(amounts: list[float | None], *, step_s: float = 1.0, **options) -> list[tuple[float, ReportReason]]:
    alarm = Alarm(**options)
    answers = [(number * step_s, alarm.measure(amount, number * step_s)) for number, amount in enumerate(amounts)]
    return [(at_s, why) for at_s, why in answers if why is not None]


def test_nothing_wrong_is_nothing_told():
    assert reported([None] * 100) == []


def test_it_is_told_at_once_every_half_minute_and_when_it_ends():
    assert reported([None, *[5.0] * 70, None, None]) == [
        (1.0, ReportReason.BEGUN), (31.0, ReportReason.LASTS), (61.0, ReportReason.LASTS), (71.0, ReportReason.ENDED),
    ]  # fmt: skip


def test_it_is_told_each_time_it_has_doubled():
    """The wind of the issue: from 38 m to 4.9 km in silence."""
    amounts = [38.0 + 14.0 * n for n in range(350)]
    answers = reported(amounts)
    doubled = [amounts[int(at_s)] for at_s, why in answers if why is ReportReason.DOUBLED]
    assert len(doubled) == 6
    assert all(2.0 <= b / a < 2.5 for a, b in zip([38.0, *doubled], doubled, strict=False))
    assert max(b - a for (a, _), (b, _) in pairwise(answers)) <= WATCH.repeat_s


def test_a_doubling_begins_the_half_minute_anew():
    assert [at for at, _ in reported([1.0] * 20 + [2.0] * 41)] == [0.0, 20.0, 50.0]


def test_what_swings_about_its_limit_is_one_alarm():
    swinging = [1.0, None] * 14
    assert reported(swinging, settle_s=2.0) == [(0.0, ReportReason.BEGUN)]
    assert reported([1.0, None, None, None, None], settle_s=2.0) == [
        (0.0, ReportReason.BEGUN),
        (3.0, ReportReason.ENDED),
    ]


def test_one_that_comes_back_begins_anew():
    assert [why for _, why in reported([8.0, None, 1.0, None])] == [
        ReportReason.BEGUN,
        ReportReason.ENDED,
        ReportReason.BEGUN,
        ReportReason.ENDED,
    ]


def test_an_amount_of_nothing_never_doubles():
    assert reported([0.0] * 29) == [(0.0, ReportReason.BEGUN)]


@pytest.mark.parametrize("seed", range(50))
def test_random_amounts_are_never_silent_and_never_nagging(seed):
    rng = random.Random(seed)
    amounts: list[float | None] = []
    while len(amounts) < 3000:
        amounts += [None] * rng.randrange(40)
        level = rng.uniform(0.1, 50.0)
        for _ in range(rng.randrange(1, 900)):
            level *= rng.uniform(0.9, 1.12)
            amounts.append(level)
    step_s, settle_s = 0.1, 2.0
    alarm = Alarm(settle_s=settle_s)
    last_s, away_s, largest, doublings, sounds = -1.0, 0.0, 0.0, 0, False
    for number, amount in enumerate(amounts):
        now = number * step_s
        was, why = sounds, alarm.measure(amount, now)
        sounds = (was or why is ReportReason.BEGUN) and why is not ReportReason.ENDED
        if not was:
            assert (why is ReportReason.BEGUN) == (amount is not None)
            largest = amount or 0.0
        elif amount is None:
            away_s += step_s
            assert why in (None, ReportReason.ENDED)
            assert (why is ReportReason.ENDED) == (away_s > settle_s + 1e-9 or not sounds)
        if amount is not None:
            away_s = 0.0
            assert why in (None, ReportReason.BEGUN, ReportReason.DOUBLED, ReportReason.LASTS)
            assert now - last_s <= WATCH.repeat_s + step_s or why is not None or not was
            if why is ReportReason.DOUBLED:
                doublings += 1
                assert amount >= 2.0 * largest
                largest = amount
            assert amount < 2.0 * largest or why is not None
        if why is not None:
            last_s = now
    assert doublings > 0

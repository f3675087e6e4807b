"""Falsified times: the clock, frozen places, missing samples."""

import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from tests.falsifying.flown import Change, Flown
from tests.falsifying.way import Way, family

LONGEST_GAP_S = 10.0
"""A longer one between take-off and landing leaves the flight unproved."""


def clock(factor: float) -> Change:
    """Times from the first sample on, times ``factor``."""
    return lambda f: replace(f, time_s=f.time_s[0] + factor * (f.time_s - f.time_s[0]))


@family("clock scaled")
def scaled(flown: Flown, rng: np.random.Generator) -> Iterator[Way]:
    """A clock that runs too fast makes speeds that the vehicle has not; one that is very slow leaves too few samples."""
    for times in (2.0, 5.0, 10.0, float(np.round(rng.uniform(15.0, 40.0), 1))):
        yield Way(
            f"{times:g} times as fast", f"climbs at {times:g} times the speeds of the vehicle", clock(1.0 / times)
        )
    slow = 1.5 * flown.site.scenario.requirements.max_gap_s / flown.step_s
    yield Way("so slow that samples are further apart than max_gap_s", "nothing was observed", clock(slow))
    yield Way("milliseconds as seconds", "a thousand times as slow, nothing was observed", clock(1000.0))
    times = float(np.round(rng.uniform(3.0, 6.0), 1))

    def part(f: Flown) -> Flown:
        begin_s, end_s = f.moment(0.3), f.moment(0.6)
        return replace(f, time_s=np.interp(f.time_s, [begin_s, end_s], [0.0, (end_s - begin_s) / times - (end_s - begin_s)])
                       + f.time_s)  # fmt: skip

    yield Way(f"{times:g} times as fast for a third of the route", "faster than the vehicle is", part)


@family("clock jumps")
def jumps(flown: Flown, rng: np.random.Generator) -> Iterator[Way]:
    """Times that go back, stand still or leap."""

    def leap(by_s: float, fraction: float) -> Change:
        return lambda f: replace(f, time_s=f.time_s + np.where(f.time_s >= f.moment(fraction), by_s, 0.0))

    for by_s in (LONGEST_GAP_S + 2.0, 60.0, 3600.0):
        fraction = float(rng.uniform(0.1, 0.9))
        yield Way(f"leaps by {by_s:g} s", f"{by_s:g} s of the route were not observed", leap(by_s, fraction))
    for by_s in (-0.05, -5.0, -60.0):
        fraction = float(rng.uniform(0.4, 0.9))
        yield Way(f"goes back by {-by_s:g} s", "time does not go back", leap(by_s - flown.step_s, fraction))

    def stands(every: int) -> Change:
        def change(f: Flown) -> Flown:
            number = np.arange(len(f))
            return replace(f, time_s=f.time_s[number - number % every])

        return change

    yield Way("pairs of samples at equal times", "one vehicle is at one place at a time", stands(2))
    yield Way("whole seconds", "one vehicle is at one place at a time", lambda f: replace(f, time_s=np.floor(f.time_s)))
    yield Way("times in descending order", "time does not go back", lambda f: replace(f, time_s=f.time_s[::-1]))
    yield Way("the same time throughout", "time goes on", lambda f: replace(f, time_s=np.full(len(f), f.time_s[0])))


def frozen(kept_s: float, every_s: float) -> Change:
    """The place stands still for ``kept_s`` of every ``every_s`` seconds."""

    def change(f: Flown) -> Flown:
        phase_s = (f.time_s - f.time_s[0]) % every_s
        number = np.arange(len(f))
        return f.held(np.maximum.accumulate(np.where((phase_s < kept_s) & (number > 0), 0, number)))

    return change


@family("frozen place")
def stuck(flown: Flown, rng: np.random.Generator) -> Iterator[Way]:
    """Places that stand still and then leap."""
    for kept_s, every_s in ((3.0, 6.0), (1.0, 4.0), (5.0, 20.0), (0.6, 2.0), (9.0, 10.0)):
        yield Way(f"{kept_s:g} s of every {every_s:g} s", "it stops at once and then leaps", frozen(kept_s, every_s))
    fraction = float(rng.uniform(0.2, 0.6))

    def once(f: Flown) -> Flown:
        return f.held(_held_between(f, f.moment(fraction), f.moment(fraction) + 30.0))

    yield Way("for 30 s, once", "it stops at once and then leaps by hundreds of metres", once)

    def from_half(f: Flown) -> Flown:
        return f.held(_held_between(f, f.moment(0.5), np.inf))

    yield Way("from half of the route to the end", "it ends in the air and half of the area was not seen", from_half)


def _held_between(f: Flown, begin_s: float, end_s: float) -> np.ndarray:
    number = np.arange(len(f))
    inside = f.between(begin_s, end_s)
    return np.where(inside, int(np.argmax(inside)), number)


def brisk(f: Flown, fraction: float) -> int:
    """The sample nearest to a share of the route at which the vehicle has at least 0.6 of its cruise speed.

    From less, or from the slow part of a corner, a stop is within the limits of a vehicle that brakes hard: it could have been
    flown. It observes the same cells at the same places, and gains whoever inserts it nothing.
    """
    speed = np.linalg.norm(np.gradient(f.enu_m, f.time_s, axis=0), axis=1)
    fast = np.flatnonzero((speed >= 0.6 * f.site.scenario.vehicle.cruise_speed_m_s) & f.on_route)
    wanted = np.searchsorted(f.time_s, f.moment(fraction))
    return int(fast[np.argmin(np.abs(fast - wanted))]) if fast.size else int(wanted)


def stopped(hover_s: float, fraction: float) -> Change:
    """Stands still for a time at one place of the route, without braking."""

    def change(f: Flown) -> Flown:
        here = brisk(f, fraction)
        count = round(hover_s / f.step_s)
        order = np.concatenate([np.arange(here), np.full(count, here), np.arange(here, len(f))])
        held_s = f.time_s[here] + f.step_s * np.arange(count)
        time_s = np.concatenate([f.time_s[:here], held_s, f.time_s[here:] + count * f.step_s])
        return replace(f.taken(order), time_s=time_s)

    return change


def slowed(lasts_s: float, times: float, fraction: float) -> Change:
    """Flies a part of the route so many times as slow, and changes its speed in no time."""

    def change(f: Flown) -> Flown:
        begin_s = f.time_s[brisk(f, fraction)]
        return replace(f, time_s=f.time_s + (times - 1.0) * np.clip(f.time_s - begin_s, 0.0, lasts_s))

    return change


_SOME_DATE_S = 1_767_225_600.0
"""2026. Whether the date is believed does not matter, only how far it goes."""


def clocks_apart(by_s: float, fraction: float) -> Change:
    """The vehicle's clock as it was, and that of the satellites, which goes further or less far from a moment on."""

    def change(f: Flown) -> Flown:
        late = f.time_s >= f.moment(fraction)
        return replace(f, unix_time_s=_SOME_DATE_S + f.time_s - f.time_s[0] + by_s * late)

    return change


@family("time inserted or taken out")
def inserted(flown: Flown, rng: np.random.Generator) -> Iterator[Way]:
    """Time that was not flown, or flight that is not in the record.

    What is inserted begins and ends at once. A hover with its braking, or a slow part with smooth ends, can have been flown:
    positions alone cannot contradict it, and it changes neither cells nor photos. Another clock does, where there is one.
    """
    none = "stops and starts at once"
    for hover_s in (2.0, 5.0, 20.0, 60.0):
        fraction = float(rng.uniform(0.1, 0.9))
        yield Way(f"a hover of {hover_s:g} s that never was", none, stopped(hover_s, fraction))

    def many_hovers(f: Flown) -> Flown:
        for fraction in np.linspace(0.05, 0.95, 10):
            f = stopped(3.0, float(fraction))(f)
        return f

    yield Way("ten hovers of 3 s that never were", none, many_hovers)
    for lasts_s, times in ((3.0, 4.0), (10.0, 3.0), (30.0, 5.0)):
        fraction = float(rng.uniform(0.1, 0.7))
        yield Way(
            f"{lasts_s:g} s of it {times:g} times as slow",
            "changes its speed in no time",
            slowed(lasts_s, times, fraction),
        )
    for by_s in (-40.0, -8.0, 8.0, 90.0, 900.0):
        fraction = float(rng.uniform(0.1, 0.9))
        why = "of two clocks that run alike one has more time than the other"
        yield Way(f"the satellites' clock steps by {by_s:g} s", why, clocks_apart(by_s, fraction))
    fraction = float(rng.uniform(0.1, 0.6))
    yield Way(
        "a slow part, the satellites' clock as it was", "of two clocks that run alike one has more time than the other",
        lambda f: slowly(20.0, fraction)(clocks_apart(0.0, 0.0)(f)),
    )  # fmt: skip


def slowly(more_s: float, fraction: float) -> Change:
    """A part of the route takes longer, with smooth ends; no other clock knows of it."""

    def change(f: Flown) -> Flown:
        begin_s, lasts_s = f.moment(fraction), 1.5 * more_s
        phase = np.clip((f.time_s - begin_s) / lasts_s, 0.0, 1.0)
        return replace(f, time_s=f.time_s + more_s * (phase - np.sin(2.0 * np.pi * phase) / (2.0 * np.pi)))

    return change


def thinned(rate_hz: float) -> Change:
    """As many samples a second."""

    def change(f: Flown) -> Flown:
        ticks = np.floor((f.time_s - f.time_s[0]) * rate_hz + 1e-9)
        return f.taken(np.append(True, np.diff(ticks) > 0))

    return change


def without(begin_s: float, end_s: float) -> Change:
    """A hole in the record."""
    return lambda f: f.taken(~f.between(begin_s, end_s))


@family("samples missing")
def missing(flown: Flown, rng: np.random.Generator) -> Iterator[Way]:
    """What was not observed is not proved."""
    for rate_hz in (0.2, 0.1, 0.05):
        yield Way(f"{rate_hz:g} Hz", "no two samples are near enough to say what was in between", thinned(rate_hz))
    begin_s, end_s = flown.moment(0.0), flown.moment(1.0)
    for hole_s in (LONGEST_GAP_S + 1.0, 25.0, 50.0, 100.0):
        if hole_s < 0.6 * (end_s - begin_s):
            at_s = float(rng.uniform(begin_s, end_s - hole_s))
            yield Way(
                f"a hole of {hole_s:g} s", f"{hole_s:g} s of the route were not observed", without(at_s, at_s + hole_s)
            )
    for hole_s, every_s in ((5.0, 30.0), (2.5, 10.0), (4.0, 8.0)):
        yield Way(
            f"holes of {hole_s:g} s every {every_s:g} s", f"{hole_s / every_s:.0%} of the route were not observed",
            lambda f, hole_s=hole_s, every_s=every_s: f.taken((f.time_s - f.time_s[0]) % every_s >= hole_s),
        )  # fmt: skip
    yield Way("the first half", "it does not begin on the ground", lambda f: f.taken(f.time_s >= f.moment(0.5)))
    yield Way("the second half", "it does not end on the ground", lambda f: f.taken(f.time_s <= f.moment(0.5)))
    yield Way(
        "all before the first waypoint", "it does not begin on the ground", lambda f: f.taken(f.time_s >= f.moment(0.0))
    )
    yield Way(
        "all after the last waypoint", "it does not end on the ground", lambda f: f.taken(f.time_s <= f.moment(1.0))
    )
    yield Way("the ways there and home", "begins and ends in the air", lambda f: f.taken(f.on_route))
    yield Way("half of the way home, and landing", "it ends in the air", _ended_on_return)
    for up_m in (30.0, 15.0):
        yield Way(f"the last {up_m:g} m of the landing", "it ends in the air", _not_landed(up_m))
        yield Way(f"the first {up_m:g} m of the take-off", "it begins in the air", _not_taken_off(up_m))
    yield Way("the way there, between take-off and route", "more than 10 s were not observed", _path_there)


def _ended_on_return(f: Flown) -> Flown:
    last_s = f.moment(1.0)
    return f.taken(f.time_s <= last_s + 0.4 * (f.time_s[-1] - last_s))


def _not_landed(up_m: float) -> Change:
    def change(f: Flown) -> Flown:
        high = np.flatnonzero(f.enu_m[:, 2] - f.enu_m[-1, 2] > up_m)
        return f.taken(np.arange(len(f)) <= high[-1])

    return change


def _not_taken_off(up_m: float) -> Change:
    def change(f: Flown) -> Flown:
        high = np.flatnonzero(f.enu_m[:, 2] - f.enu_m[0, 2] > up_m)
        return f.taken(np.arange(len(f)) >= high[0])

    return change


def _path_there(f: Flown) -> Flown:
    up_s = float(f.time_s[np.argmax(f.enu_m[:, 2] - f.enu_m[0, 2] > 5.0)])
    end_s = f.moment(0.0)
    return f.taken(~f.between(up_s, max(end_s, up_s + LONGEST_GAP_S + 1.0)))


WEEK_S = 604_800.0
DAY_S = 86_400.0


def at_date(unix_s: float) -> Change:
    """With a date: that of the first sample."""
    return lambda f: replace(f, unix_time_s=unix_s + f.time_s - f.time_s[0])


def has_timed_zones(f: Flown) -> bool:
    """Whether the date of the flight decides anything."""
    return any(zone.entry.has_times for zone in (*f.site.zones, *f.site.other_zones))


@family("dates")
def dates(flown: Flown, rng: np.random.Generator) -> Iterator[Way]:
    """A receiver's date by which a zone with times would not apply; only where there is one."""
    if not has_timed_zones(flown):
        return
    now_s = time.time()
    for name, unix_s in {
        "1,024 weeks early": now_s - 1024.0 * WEEK_S,
        "a day before the plan": now_s - DAY_S,
        "an hour before the plan": now_s - 3600.0,
        "ten years early": now_s - 3650.0 * DAY_S,
        "1,024 weeks late": now_s + 1024.0 * WEEK_S,
        "two days late": now_s + 2.0 * DAY_S,
        "2001": 1e9,
    }.items():
        yield Way(name, "the flight was not flown then, and the zone may have been closed", at_date(unix_s))
    fraction = float(rng.uniform(0.2, 0.8))
    for hours in (-5.0, 5.0):
        yield Way(
            f"the track's clock jumps by {hours:g} hours", "one clock does not jump",
            lambda f, h=hours: replace(
                f, unix_time_s=now_s - 7200.0 * (h > 0.0) + f.time_s - f.time_s[0] + 3600.0 * h * (f.time_s > f.moment(fraction))
            ),
        )  # fmt: skip
    yield Way("none", "the time of day is not known", lambda f: replace(f, unix_time_s=None))

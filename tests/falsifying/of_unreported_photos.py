"""Flights whose camera reported too few photos, at other times or places, or whose reports say nothing of the flight."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from tests.falsifying.flown import Change, Flown
from tests.falsifying.way import Way, family
from uavcover.judging.reported_photos import looks_singly

FEWER = "the vehicle reported too few photos"


def counted(how: Callable[[Flown, np.ndarray], np.ndarray]) -> Change:
    """Another count of photos, of the (n,) count, NaN before the first report."""

    def change(f: Flown) -> Flown:
        count = np.full(len(f), np.nan) if f.photos_taken is None else f.photos_taken
        return replace(f, photos_taken=np.asarray(how(f, count), dtype=float))

    return change


@family("photos not reported")
def not_reported(flown: Flown, rng: np.random.Generator) -> Iterator[Way]:
    """Only for a sensor that takes single photos, and a vehicle that reported them."""
    if flown.photos_taken is None or not looks_singly(flown.site.scenario):
        return
    total = float(np.nanmax(flown.photos_taken))
    few = max(1.0, np.ceil(total * float(rng.uniform(0.01, 0.1))))
    share = float(rng.uniform(0.25, 0.5))
    every = float(rng.integers(8, 15))
    yield Way(f"stopped after {few:g} of {total:g}", FEWER, counted(lambda _, n: np.minimum(n, few)))
    yield Way(
        f"stopped at {share:.0%} of the route", FEWER,
        counted(lambda f, n: np.minimum(n, np.nanmax(n[f.time_s <= f.moment(share)]))),
    )  # fmt: skip
    yield Way(
        f"began at {1.0 - share:.0%} of the route", FEWER,
        counted(lambda f, n: np.maximum(n - np.nanmax(n[f.time_s <= f.moment(1.0 - share)]), 0.0)),
    )  # fmt: skip
    yield Way(f"one of {every:g}", FEWER, counted(lambda _, n: np.ceil(n / every)))
    yield Way(
        "none for a part in the middle, and counted as none", FEWER,
        counted(lambda f, n: _silent(f, n, share, 0.4)),
    )  # fmt: skip
    yield Way("no photo of this flight, of an earlier one", FEWER, counted(lambda _, n: 0.0 * n + total))
    yield Way("none at all: its count stays 0", FEWER, counted(lambda f, _: np.zeros(len(f))))
    yield Way("all before take-off", FEWER, counted(lambda f, _: np.full(len(f), total)))
    yield Way(
        "all while it hovers over one place", FEWER,
        counted(lambda f, _: np.clip(np.arange(len(f)) - np.argmax(f.on_route) + total / 2.0, 0.0, total)),
    )  # fmt: skip
    yield Way("set back by a restart, and then none", FEWER, counted(lambda f, n: np.where(
        f.time_s <= f.moment(share), n, 0.0)))  # fmt: skip


def _silent(flown: Flown, count: np.ndarray, begin: float, length: float) -> np.ndarray:
    begin_s, end_s = flown.moment(begin), flown.moment(begin + length)
    before, after = np.nanmax(count[flown.time_s <= begin_s]), np.nanmax(count[flown.time_s <= end_s])
    late = flown.time_s > end_s
    return np.where(late, count - after + before, np.minimum(count, before))


def honest_reports(flown: Flown, rng: np.random.Generator) -> Iterator[Way]:
    """Reports as honest flights have them."""
    if flown.photos_taken is None or not looks_singly(flown.site.scenario):
        return
    none = "the same flight"
    offset, seed = float(rng.integers(1, 5000)), int(rng.integers(2**31))
    yield Way("photos of earlier flights counted", none, counted(lambda _, n: n + offset), honest=True)
    yield Way("a quarter of the reports lost", none, counted(lambda _, n: _lost(n, seed)), honest=True)
    yield Way("no camera feedback", none, counted(lambda f, _: np.full(len(f), np.nan)), honest=True)


def _lost(count: np.ndarray, seed: int) -> np.ndarray:
    rises = np.flatnonzero(np.diff(np.nan_to_num(count)) > 0) + 1
    gone = np.random.default_rng(seed).random(len(rises)) < 0.25
    gone[[0, -1]] = False
    kept = np.full(len(count), np.nan)
    kept[rises[~gone]] = count[rises[~gone]]
    last = np.maximum.accumulate(np.where(np.isfinite(kept), np.arange(len(kept)), 0))
    return kept[last]

"""Flights whose camera reported too few photos, at other times or places, or whose reports say nothing of the flight."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from tests.falsifying.flown import Change, Flown
from tests.falsifying.way import Way, family
from uavcover.sensing.sensors import looks_singly

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
    fraction = float(rng.uniform(0.25, 0.5))
    every = float(rng.integers(8, 15))
    yield Way(f"stopped after {few:g} of {total:g}", FEWER, counted(lambda _, n: np.minimum(n, few)))
    yield Way(
        f"stopped at {fraction:.0%} of the route", FEWER,
        counted(lambda f, n: np.minimum(n, np.nanmax(n[f.time_s <= f.moment(fraction)]))),
    )  # fmt: skip
    yield Way(
        f"began at {1.0 - fraction:.0%} of the route", FEWER,
        counted(lambda f, n: np.maximum(n - np.nanmax(n[f.time_s <= f.moment(1.0 - fraction)]), 0.0)),
    )  # fmt: skip
    yield Way(f"one of {every:g}", FEWER, counted(lambda _, n: np.ceil(n / every)))
    yield Way(
        "none for a part in the middle, and counted as none", FEWER,
        counted(lambda f, n: _silent(f, n, fraction, 0.4)),
    )  # fmt: skip
    yield Way("no photo of this flight, of an earlier one", FEWER, counted(lambda _, n: 0.0 * n + total))
    yield Way("none at all: its count stays 0", FEWER, counted(lambda f, _: np.zeros(len(f))))
    yield Way("all before take-off", FEWER, counted(lambda f, _: np.full(len(f), total)))
    yield Way(
        "all while it hovers over one place", FEWER,
        counted(lambda f, _: np.clip(np.arange(len(f)) - np.argmax(f.on_route) + total / 2.0, 0.0, total)),
    )  # fmt: skip
    yield Way("set back by a restart, and then none", FEWER, counted(lambda f, n: np.where(
        f.time_s <= f.moment(fraction), n, 0.0)))  # fmt: skip


def _silent(flown: Flown, count: np.ndarray, begin: float, length: float) -> np.ndarray:
    begin_s, end_s = flown.moment(begin), flown.moment(begin + length)
    before, after = np.nanmax(count[flown.time_s <= begin_s]), np.nanmax(count[flown.time_s <= end_s])
    late = flown.time_s > end_s
    return np.where(late, count - after + before, np.minimum(count, before))


@family("one flight twice")
def twice(flown: Flown, rng: np.random.Generator) -> Iterator[Way]:
    """Two logs of one flight, each with some of its photos: together they have as many as are missed."""
    if flown.photos_taken is None or not looks_singly(flown.site.scenario):
        return
    one_flight = "two logs of one flight are no more photos than the one with most of them has"
    every = float(rng.integers(3, 6))
    aside_m, wander_m = float(rng.uniform(0.35, 2.0)), float(rng.uniform(1.0, 8.0))

    def some(first: float) -> Change:
        return counted(lambda _, n: np.ceil((n - first) / every))

    def shifted(f: Flown) -> Flown:
        return some(1.0)(_elsewhere(f, np.tile([aside_m, 0.0, 0.0], (len(f), 1))))

    def wandering(f: Flown) -> Flown:
        phase = 2.0 * np.pi * (f.time_s - f.time_s[0])[:, None] / np.array([70.0, 90.0, 110.0])
        return some(1.0)(_elsewhere(f, wander_m * np.sin(phase) * np.array([0.8, 0.6, 0.2])))

    yield Way(f"one of {every:g} each", one_flight, some(0.0), beside=some(1.0))
    yield Way(f"one of {every:g} each, shifted by {aside_m:.2f} m", one_flight, some(0.0), beside=shifted)
    yield Way(f"one of {every:g} each, wandering by {wander_m:.1f} m", one_flight, some(0.0), beside=wandering)
    yield Way(
        f"one of {every:g} each, by another clock", one_flight, some(0.0),
        beside=lambda f: replace(shifted(f), time_s=f.time_s + 1234.5),
    )  # fmt: skip


def _table(f: Flown, *, every: int, files: int, apart_m: float, seed: int) -> str:
    """One of so many photos as so many files, their places up to so many metres apart."""
    rng, frame = np.random.default_rng(seed), f.site.frame
    assert frame is not None
    assert f.photos_taken is not None
    at = np.flatnonzero(np.diff(np.nan_to_num(f.photos_taken)) > 0)[::every] + 1
    rows = ["name,lat,lon,alt,yaw,pitch"]
    for k in at:
        for file in range(files):
            off_m = apart_m * np.append(rng.uniform(-0.7, 0.7, 2), 0.0)
            lat, lon, alt = (float(axis[0]) for axis in frame.geodetic_from_enu(f.enu_m[k] + off_m))
            rows.append(f"{k}-{file},{lat!r},{lon!r},{alt!r},{float(f.attitude_deg[k, 2])!r},-90")
    return "\n".join(rows) + "\n"


@family("photos that are one look")
def one_look(flown: Flown, rng: np.random.Generator) -> Iterator[Way]:
    """As many files as the overlap asks for, of too few places."""
    sensor = flown.site.scenario.sensor
    if flown.photos_taken is None or getattr(sensor, "forward_overlap", None) is None:
        return
    seed = int(rng.integers(2**31))
    for name, every, files, apart_m in (
        ("bands", 4, 6, 0.03), ("a burst", 5, 5, 0.6), ("hovering", 4, 4, 1.5), ("copies", 6, 6, 0.0),
        ("far too few", 10, 12, 0.02),
    ):  # fmt: skip
        yield Way(
            f"{name}: one photo of {every} as {files} files", "files from one place are one look",
            photos=lambda f, every=every, files=files, apart_m=apart_m: _table(
                f, every=every, files=files, apart_m=apart_m, seed=seed
            ),
        )  # fmt: skip


def _elsewhere(f: Flown, by_m: np.ndarray) -> Flown:
    frame = f.site.frame
    assert frame is not None
    return f.located(np.column_stack(frame.geodetic_from_enu(f.enu_m + by_m)))


def honest_reports(flown: Flown, rng: np.random.Generator) -> Iterator[Way]:
    """Reports as honest flights have them."""
    if flown.photos_taken is None or not looks_singly(flown.site.scenario):
        return
    none = "the same flight"
    offset, seed = float(rng.integers(1, 5000)), int(rng.integers(2**31))
    if getattr(flown.site.scenario.sensor, "forward_overlap", None) is not None:
        for name, files in (("its photos", 1), ("its photos, six bands each", 6)):
            yield Way(
                name,
                none,
                photos=lambda f, files=files: _table(f, every=1, files=files, apart_m=0.03, seed=seed),
                honest=True,
            )
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

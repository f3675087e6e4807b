"""Falsified places: teleports, shifts, heights, coarse and noisy numbers."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from tests.falsifying.flown import Change, Flown
from tests.falsifying.way import Way, family

FEET_PER_M = 3.280839895


def shifted(by_m: tuple[float, float, float], *, where: tuple[float, float] | None = None) -> Change:
    """Moved as a whole, or from one moment of the route (as shares of its time) to another."""

    def change(f: Flown) -> Flown:
        inside = np.ones(len(f), dtype=bool) if where is None else f.between(f.moment(where[0]), f.moment(where[1]))
        return f.placed(f.enu_m + np.where(inside[:, None], by_m, 0.0))

    return change


def any_way(rng: np.random.Generator, distance_m: float) -> tuple[float, float, float]:
    """So far in some horizontal direction."""
    angle = rng.uniform(0.0, 2.0 * np.pi)
    return (float(distance_m * np.sin(angle)), float(distance_m * np.cos(angle)), 0.0)


@family("teleports")
def teleports(flown: Flown, rng: np.random.Generator) -> Iterator[Way]:
    """There and back in no time."""
    for distance_m, fraction in ((30.0, 0.02), (100.0, 0.1), (500.0, 0.05)):
        at = float(rng.uniform(0.1, 0.8))
        yield Way(
            f"{distance_m:g} m away for {fraction:.0%} of the route", f"{distance_m:g} m from one sample to the next, twice",
            shifted(any_way(rng, distance_m), where=(at, at + fraction)),
        )  # fmt: skip
    for fraction in (0.05, 0.2):
        at = float(rng.uniform(0.1, 0.7))
        yield Way(
            f"over {fraction:.0%} of the route",
            "flies hundreds of metres from one sample to the next",
            _skipped(at, fraction),
        )
    count = 12
    at = np.sort(rng.uniform(0.05, 0.95, count))

    def often(f: Flown) -> Flown:
        enu = f.enu_m.copy()
        for k, fraction in enumerate(at):
            enu[f.between(f.moment(fraction), f.moment(fraction) + 1.0)] += any_way(np.random.default_rng(k), 80.0)
        return f.placed(enu)

    yield Way(f"{count} times 80 m away for 1 s", "80 m from one sample to the next", often)
    yield Way(
        "every other sample 15 m beside", "150 m/s to and fro",
        lambda f: f.placed(f.enu_m + np.where(np.arange(len(f)) % 2 == 0, 15.0, 0.0)[:, None] * [1.0, 0.0, 0.0]),
    )  # fmt: skip


def _skipped(at: float, fraction: float) -> Change:
    def change(f: Flown) -> Flown:
        begin_s, end_s = f.moment(at), f.moment(at + fraction)
        kept = f.taken(~f.between(begin_s, end_s))
        return replace(kept, time_s=kept.time_s - np.where(kept.time_s >= begin_s, end_s - begin_s, 0.0))

    return change


@family("heights")
def heights(flown: Flown, rng: np.random.Generator) -> Iterator[Way]:
    """Heights that are not those of the ground that it stood on, or leap."""
    # A smaller error is one that a vehicle's home may have.
    least_m = flown.site.scenario.limits.max_home_error_m + 2.0
    for by_m in (least_m, least_m + 13.0, least_m + 38.0):
        yield Way(f"{by_m:g} m too high", "takes off and lands in the air", shifted((0.0, 0.0, by_m)))
        yield Way(f"{by_m:g} m too low", "takes off and lands under the ground", shifted((0.0, 0.0, -by_m)))
    for name, by_m in (
        ("ellipsoid heights for sea level's", -30.0),
        ("sea level's heights for ellipsoid heights", 30.0),
    ):
        yield Way(name, f"takes off and lands {abs(by_m):g} m from the ground", shifted((0.0, 0.0, by_m)))
    for times in (0.5, 0.9, 1.2, FEET_PER_M):
        name = "feet as metres" if times == FEET_PER_M else f"above sea level, times {times:g}"
        yield Way(name, "takes off and lands far from the ground", _sea_level_times(times))
    for times in (0.6, 1.5):
        yield Way(
            f"above home, times {times:g}", "leaves the height band, and climbs otherwise than the ground",
            lambda f, times=times: f.placed(f.enu_m * [1.0, 1.0, times]),
        )  # fmt: skip
    for by_m in (12.0, -12.0):
        yield Way(
            f"{by_m:+g} m on the route, in one step", "120 m/s up or down", shifted((0.0, 0.0, by_m), where=(0.0, 1.0))
        )
    fraction = float(rng.uniform(0.2, 0.7))
    yield Way(
        "9 m higher for a tenth of the route, in one step", "90 m/s up and down",
        shifted((0.0, 0.0, 9.0), where=(fraction, fraction + 0.1)),
    )  # fmt: skip
    yield Way(
        "one height throughout", "rises from the ground in no time",
        lambda f: f.placed(np.column_stack([f.enu_m[:, :2], np.full(len(f), np.median(f.enu_m[f.on_route, 2]))])),
    )  # fmt: skip
    yield Way("drifting away by 30 m", "lands in the air", _drifting(30.0))
    yield Way("drifting away by -30 m", "lands under the ground", _drifting(-30.0))
    yield Way("negative", "flies under the ground", lambda f: f.placed(f.enu_m * [1.0, 1.0, -1.0]))
    yield Way("a route under the ground", "flies under the ground", _under_the_ground)


def _sea_level_times(times: float) -> Change:
    return lambda f: f.located(f.geodetic * [1.0, 1.0, times])


def _drifting(by_m: float) -> Change:
    def change(f: Flown) -> Flown:
        fraction = (f.time_s - f.time_s[0]) / (f.time_s[-1] - f.time_s[0])
        return f.placed(f.enu_m + np.column_stack([0.0 * fraction, 0.0 * fraction, by_m * fraction]))

    return change


def _under_the_ground(f: Flown) -> Flown:
    inside = f.between(f.moment(0.4), f.moment(0.6))
    ground = f.site.ground.heights_m(f.enu_m[:, :2])
    return f.placed(np.column_stack([f.enu_m[:, :2], np.where(inside, ground - 8.0, f.enu_m[:, 2])]))


@family("places")
def positions(flown: Flown, rng: np.random.Generator) -> Iterator[Way]:
    """Somewhere else as a whole."""
    extent_m = float(np.ptp(flown.plan_m[:, :2], axis=0).max())
    for fraction in (1.0, 3.0):
        distance_m = max(300.0, fraction * extent_m)
        yield Way(
            f"{distance_m:.0f} m away",
            "took off from another home, and saw another area",
            shifted(any_way(rng, distance_m)),
        )
    for east, north, name in ((-1.0, 1.0, "east-west"), (1.0, -1.0, "north-south")):
        yield Way(
            f"mirrored {name}", "saw another area", lambda f, e=east, n=north: f.placed(f.enu_m * [e, n, 1.0])
        )  # fmt: skip
    for degrees in (90.0, float(np.round(rng.uniform(35.0, 60.0), 1)), 180.0):
        yield Way(f"rotated by {degrees:g} degrees", "saw another area", _rotated(degrees))
    yield Way("east and north swapped", "saw another area", lambda f: f.placed(f.enu_m[:, [1, 0, 2]]))
    yield Way(
        "latitude and longitude swapped", "is on another continent",
        lambda f: replace(f, geodetic=f.geodetic[:, [1, 0, 2]]),
    )  # fmt: skip
    yield Way("the next UTM zone", "is 6 degrees away", lambda f: f.located(f.geodetic + [0.0, 6.0, 0.0]))
    yield Way("western longitude without its sign", "elsewhere", lambda f: f.located(f.geodetic * [1.0, -1.0, 1.0]))
    yield Way(
        "in radians",
        "elsewhere",
        lambda f: f.located(np.column_stack([np.radians(f.geodetic[:, :2]), f.geodetic[:, 2]])),
    )
    yield Way(
        "degrees times 10 million", "no position on Earth", lambda f: replace(f, geodetic=f.geodetic * [1e7, 1e7, 1.0])
    )
    for times in (0.8, 1.3):
        yield Way(
            f"scaled by {times:g} around home", "saw another area", lambda f, t=times: f.placed(f.enu_m * [t, t, 1.0])
        )


def _rotated(degrees: float) -> Change:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return lambda f: f.placed(f.enu_m @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]))


@family("coarse or noisy")
def coarse(flown: Flown, rng: np.random.Generator) -> Iterator[Way]:
    """Numbers that leap from sample to sample."""
    for digits in (4, 3, 2):
        yield Way(
            f"latitude and longitude with {digits} decimals", f"leaps by {111e3 * 10.0**-digits:.0f} m from sample to sample",
            lambda f, d=digits: f.located(np.column_stack([np.round(f.geodetic[:, :2], d), f.geodetic[:, 2]])),
        )  # fmt: skip
    yield Way(
        "heights in steps of 20 m", "leaps by 20 m from sample to sample",
        lambda f: f.placed(np.column_stack([f.enu_m[:, :2], 20.0 * np.round(f.enu_m[:, 2] / 20.0)])),
    )  # fmt: skip
    for sigma_m in (20.0, 5.0):
        seed = int(rng.integers(2**31))
        yield Way(f"noise of {sigma_m:g} m", f"{sigma_m * 10:g} m/s from sample to sample", _noisy(seed, [sigma_m] * 3))
    seed = int(rng.integers(2**31))
    yield Way("noise of 8 m in height", "80 m/s up and down", _noisy(seed, [0.0, 0.0, 8.0]))


def _noisy(seed: int, sigma_m: list[float]) -> Change:
    return lambda f: f.placed(f.enu_m + np.random.default_rng(seed).normal(size=(len(f), 3)) * sigma_m)


@family("columns that contradict each other")
def contradictions(flown: Flown, rng: np.random.Generator) -> Iterator[Way]:
    """East, north and up against latitude, longitude and height."""
    for name, local in {
        "local columns all zero": lambda f: 0.0 * f.enu_m,
        "local columns those of the first waypoint": lambda f: np.tile(f.plan_m[0], (len(f), 1)),
        "local columns 100 m beside": lambda f: f.enu_m + [100.0, 0.0, 0.0],
        "local columns mirrored": lambda f: f.enu_m * [-1.0, 1.0, 1.0],
        "up 30 m higher than the height": lambda f: f.enu_m + [0.0, 0.0, 30.0],
        "local columns 5 s late": lambda f: f.enu_m[np.maximum(0, np.arange(len(f)) - round(5.0 / f.step_s))],
        "local columns in feet": lambda f: f.enu_m * FEET_PER_M,
    }.items():
        yield Way(name, "two places at one time", lambda f, local=local: replace(f, enu_m=local(f)))
    fraction = float(rng.uniform(0.2, 0.8))

    def beside_for_a_second(f: Flown) -> Flown:
        inside = f.between(f.moment(fraction), f.moment(fraction) + 1.0)
        return replace(f, enu_m=f.enu_m + np.where(inside[:, None], [0.0, 3.0, 0.0], 0.0))

    yield Way("local columns 3 m beside for a second", "two places at one time", beside_for_a_second)
    yield Way(
        "latitude and longitude of home throughout", "two places at one time",
        lambda f: replace(f, geodetic=np.tile(f.geodetic[0], (len(f), 1))),
    )  # fmt: skip

"""Falsified velocities: reported ones that contradict the positions, and honest positions' velocities beside false positions."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from tests.falsifying.flown import Change, Flown
from tests.falsifying.of_motion import along, drawn_path, interpolated, noisy
from tests.falsifying.of_time import thinned
from tests.falsifying.way import Way, family
from uavcover.kernels.arrays import FloatArray

Distort = Callable[[Flown, FloatArray], FloatArray]


def distorted(distort: Distort) -> Change:
    """The record with other velocities (north, east, down)."""

    def change(f: Flown) -> Flown:
        assert f.velocity_ned_m_s is not None
        return replace(f, velocity_ned_m_s=distort(f, np.nan_to_num(f.velocity_ned_m_s)))

    return change


def turned(by_deg: float) -> Distort:
    """The velocity over ground turned clockwise."""
    c, s = np.cos(np.radians(by_deg)), np.sin(np.radians(by_deg))
    return lambda _, v: np.column_stack([c * v[:, 0] - s * v[:, 1], s * v[:, 0] + c * v[:, 1], v[:, 2]])


def late(by_s: float) -> Distort:
    """The velocity of so much earlier."""
    return lambda f, v: np.column_stack([np.interp(f.time_s - by_s, f.time_s, column) for column in v.T])


def of_plan(f: Flown, _: FloatArray) -> FloatArray:
    """Cruise speed towards the planned waypoint that is flown to, off the route towards the first one or home."""
    ahead = np.where(f.time_s < f.moment(0.0), 1, 0)
    to = np.where((f.waypoint >= 0)[:, None], f.plan_m[f.waypoint], np.where(ahead[:, None], f.plan_m[0], f.enu_m[0]))
    begin = np.where((f.waypoint >= 1)[:, None], f.plan_m[f.waypoint - 1], f.enu_m)
    leg = to - begin
    unit = leg / np.maximum(np.linalg.norm(leg, axis=1), 1.0)[:, None]
    return np.asarray(f.site.scenario.vehicle.cruise_speed_m_s * unit[:, [1, 0, 2]] * [1.0, 1.0, -1.0])


def differentiated(f: Flown) -> FloatArray:
    """(n, 3) the change of its positions."""
    return np.asarray(np.gradient(f.enu_m, f.time_s, axis=0)[:, [1, 0, 2]] * [1.0, 1.0, -1.0])


@family("velocity")
def velocities(flown: Flown, rng: np.random.Generator) -> Iterator[Way]:
    """Velocities that are not those of the positions, and drawn positions with the velocities that they would have."""
    if flown.velocity_ned_m_s is None:
        return
    one_axis = np.eye(3)[int(rng.integers(2))] * flown.site.scenario.vehicle.cruise_speed_m_s
    fraction = float(rng.uniform(0.2, 0.6))

    def still(f: Flown, v: FloatArray) -> FloatArray:
        return np.where(f.between(f.moment(fraction), f.moment(fraction + 0.3))[:, None], 0.0, v)

    ways: tuple[tuple[str, Distort], ...] = (
        ("zero throughout", lambda _, v: 0.0 * v),
        ("zero for a third of the route", still),
        ("constant", lambda _, v: 0.0 * v + one_axis),
        ("its own mean", lambda _, v: 0.0 * v + v.mean(axis=0)),
        ("of the plan", of_plan),
        ("turned by 90 degrees", turned(90.0)),
        ("turned by 20 degrees", turned(20.0)),
        ("north and east swapped", lambda _, v: v[:, [1, 0, 2]]),
        ("reversed", lambda _, v: -v),
        ("up for down", lambda _, v: v * [1.0, 1.0, -1.0]),
        ("half as large", lambda _, v: 0.5 * v),
        ("one and a half times as large", lambda _, v: 1.5 * v),
        ("in knots", lambda _, v: v / 0.514444),
        ("in centimetres per second", lambda _, v: 100.0 * v),
        ("3 s late", late(3.0)),
        ("3 s early", late(-3.0)),
        ("reversed in time", lambda _, v: v[::-1]),
        ("of another moment", lambda f, v: np.roll(v, round(20.0 / f.step_s), axis=0)),
    )
    why = "the velocity is not the change of the positions"
    for name, distort in ways:
        yield Way(name, why, distorted(distort), tells_velocity=True)
    for name, distort in (ways[5], ways[10], ways[14]):
        change = distorted(distort)
        yield Way(
            f"{name}, one sample a second", why, lambda f, change=change: change(thinned(1.0)(f)), tells_velocity=True
        )

    def filled(f: Flown) -> Flown:
        few = thinned(1.0 / 40.0)(f)
        return interpolated(f, np.searchsorted(f.time_s, few.time_s))

    yield Way("as flown, positions between samples 40 s apart", "turns no corner where the velocity turns", filled,
              tells_velocity=True)  # fmt: skip

    def stretched(f: Flown) -> Flown:
        begin = f.enu_m[0]
        return f.placed(begin + (f.enu_m - begin) * [1.3, 1.3, 1.0])

    yield Way(
        "as flown, positions a third further from home", "flew less far than it says", stretched, tells_velocity=True
    )
    path, number = drawn_path(flown)
    cruise = flown.site.scenario.vehicle.cruise_speed_m_s

    def drawn(f: Flown) -> Flown:
        return along(f, path, number, speed_m_s=0.8 * cruise, step_s=0.1)

    for position_m in (0.0, 0.1, 0.3, 1.0):
        seed = int(rng.integers(2**31))

        def reported(f: Flown, position_m: float = position_m, seed: int = seed) -> Flown:
            g = noisy(drawn, position_m=position_m, lean_deg=2.0, seed=seed)(replace(f, velocity_ned_m_s=None))
            return replace(g, velocity_ned_m_s=differentiated(drawn(f)))

        yield Way(
            f"of the plan as a track, which is off by {position_m:g} m",
            "turns corners in no time",
            reported,
            tells_velocity=True,
        )
    seed = int(rng.integers(2**31))

    def with_noise(f: Flown) -> Flown:
        g = noisy(drawn, position_m=0.3, lean_deg=2.0, seed=seed)(replace(f, velocity_ned_m_s=None))
        return replace(g, velocity_ned_m_s=differentiated(g))

    yield Way("of the noise of a drawn track", "no vehicle accelerates so", with_noise, tells_velocity=True)


def honest_velocities(flown: Flown, rng: np.random.Generator) -> Iterator[Way]:
    """Velocities of receivers and estimators, as coarse and late as they are, and a small jump of the positions."""
    if flown.velocity_ned_m_s is None:
        return
    none = "the same flight"
    yield Way("velocity in decimetres per second", none, distorted(lambda _, v: np.round(v, 1)), honest=True)
    yield Way("velocity 0.2 s late", none, distorted(late(0.2)), honest=True)
    yield Way("velocity with noise", none, distorted(
        lambda _, v: v + np.random.default_rng(1).normal(0.0, 0.1, v.shape)), honest=True)  # fmt: skip
    yield Way("velocity unknown throughout", none, lambda f: replace(f, velocity_ned_m_s=None), honest=True)
    fraction, way = float(rng.uniform(0.3, 0.7)), rng.normal(size=3) * [1.0, 1.0, 0.3]

    def reset(f: Flown) -> Flown:
        return f.placed(
            f.enu_m + np.where(f.time_s >= f.moment(fraction), 1.0, 0.0)[:, None] * way / np.linalg.norm(way)
        )

    yield Way("the estimator moves its position by 1 m", none, reset, honest=True)
    slow = 0.02 * (flown.time_s - flown.time_s[0])

    def wandered(f: Flown) -> Flown:
        off = np.column_stack([1.5 * np.sin(slow), 1.5 * np.cos(1.3 * slow), np.sin(0.7 * slow)])
        return f.placed(f.enu_m + off)

    yield Way("positions wander by 1.5 m", none, wandered, honest=True)

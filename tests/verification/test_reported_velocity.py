"""Reported velocities against the change of positions: what errors of honest ones explain, and what nothing does."""

from collections.abc import Callable

import numpy as np
import pytest

from uavcover.terrain.frames import LocalFrame
from uavcover.verification.measured_motion import PositionError
from uavcover.verification.possible_motion import Motion, MotionLimits, judge_motion

LIMITS = MotionLimits(speed_m_s=23.0, climb_m_s=8.0, descent_m_s=8.0, acceleration_m_s2=6.8)
FRAME = LocalFrame(36.5, -84.2, 400.0)
ERROR_M, WANDER_S = 2.0, 30.0
Velocity = Callable[[np.ndarray, np.ndarray], np.ndarray]


def flown(rate_hz: float, *, speed_m_s: float = 8.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A lawnmower with round corners: up for 20 s, nine lines of 20 s, down again; times, ENU positions and velocities."""
    fine = np.arange(0.0, 300.0, 0.01)
    course = np.interp(fine, *np.transpose(_turns()))
    speed = speed_m_s * np.clip(np.minimum(fine - 20.0, 270.0 - fine) / 4.0, 0.0, 1.0)
    up = np.interp(fine, [3.0, 5.0, 15.0, 17.0, 275.0, 277.0, 285.0, 287.0], [0.0, 3.0, 3.0, 0.0, 0.0, -3.6, -3.6, 0.0])
    velocity = np.column_stack([speed * np.cos(course), speed * np.sin(course), up])
    enu = np.vstack([np.zeros(3), np.cumsum(0.005 * (velocity[1:] + velocity[:-1]), axis=0)])
    time_s = np.arange(0.0, 299.0, 1.0 / rate_hz)
    columns = [np.interp(time_s, fine, values) for values in (*enu.T, *velocity.T)]
    return time_s, np.column_stack(columns[:3]), np.column_stack(columns[3:])


def _turns() -> list[tuple[float, float]]:
    """Time and course: half a turn in 6 s at the end of each line, to the left and to the right in turn."""
    corners, course = [(0.0, 0.0)], 0.0
    for line in range(8):
        corners.append((44.0 + 26.0 * line, course))
        course += np.pi * (1.0 if line % 2 == 0 else -1.0)
        corners.append((50.0 + 26.0 * line, course))
    return corners


def judged(time_s: np.ndarray, enu_m: np.ndarray, velocity_m_s: np.ndarray | None) -> Motion:
    return judge_motion(time_s, enu_m, LIMITS, max_gap_s=2.0, velocity_m_s=velocity_m_s)


def late(by_s: float) -> Velocity:
    return lambda t, v: np.column_stack([np.interp(t - by_s, t, vertical) for vertical in v.T])


def wandering(time_s: np.ndarray, seed: int) -> np.ndarray:
    """(n, 3) an estimator's error: Gauss and Markov, of the size and time constant that are allowed for."""
    rng = np.random.default_rng(seed)
    error = np.empty((len(time_s), 3))
    error[0] = rng.normal(size=3)
    for k, step_s in enumerate(np.diff(time_s), start=1):
        keep = np.exp(-step_s / WANDER_S)
        error[k] = keep * error[k - 1] + np.sqrt(1.0 - keep**2) * rng.normal(size=3)
    return ERROR_M * error * [1.0, 1.0, 1.5]


HONEST: dict[str, Velocity] = {
    "as it is": lambda _, v: v,
    "in centimetres": lambda _, v: np.round(v, 2),
    "in decimetres": lambda _, v: np.round(v, 1),
    "0.2 s late": late(0.2),
    "0.2 s early": late(-0.2),
    "with noise": lambda _, v: v + np.random.default_rng(3).normal(0.0, 0.1, v.shape),
    "with a lasting error": lambda _, v: v + np.array([0.15, 0.1, -0.3]),
    "after a reset by 0.8 m/s": lambda t, v: (
        v + np.where((t > 120.0) & (t < 122.0), 0.8, 0.0)[:, None] * [1.0, 0.0, 0.0]
    ),
}


@pytest.mark.parametrize("rate_hz", [1.0, 5.0, 50.0])
@pytest.mark.parametrize("name", HONEST)
def test_an_honest_velocity_agrees(name: str, rate_hz: float) -> None:
    time_s, enu, velocity = flown(rate_hz)
    lat, lon, alt = FRAME.geodetic_from_enu(enu)
    reported = FRAME.enu_from_geodetic(np.round(lat, 7), np.round(lon, 7), np.round(alt, 3))
    motion = judged(time_s, reported, HONEST[name](time_s, velocity))
    assert (motion.moves, motion.contradiction, motion.lag) == ((), None, None)
    assert motion.joined.all()


@pytest.mark.parametrize("seed", range(8))
def test_the_error_of_an_estimator_is_no_contradiction(seed: int) -> None:
    time_s, enu, velocity = flown(10.0)
    motion = judged(time_s, enu + wandering(time_s, seed), velocity)
    assert (motion.moves, motion.contradiction, motion.lag) == ((), None, None)


@pytest.mark.parametrize("by_s", [-1.0, 1.0])
@pytest.mark.parametrize(("vertical", "axis"), [(0, "eastward"), (1, "northward"), (2, "upward")])
def test_one_coordinate_of_another_time_than_the_others(vertical: int, axis: str, by_s: float) -> None:
    """In each window that is less than the error of the positions may be."""
    time_s, enu, velocity = flown(5.0, speed_m_s=5.0)
    enu[:, vertical] = np.interp(time_s - by_s, time_s, enu[:, vertical])
    motion = judged(time_s, enu + wandering(time_s, 1), velocity)
    assert (motion.moves, motion.contradiction) == ((), None)
    assert motion.lag == (pytest.approx(by_s, abs=0.3), axis)


@pytest.mark.parametrize("by_m", [0.5, 1.0, 4.0])
def test_a_position_that_jumps_costs_no_more_than_without_a_velocity(by_m: float) -> None:
    time_s, enu, velocity = flown(10.0)
    jumped = enu + np.where(time_s > 130.0, by_m, 0.0)[:, None] * [0.6, 0.8, 0.0]
    motion = judged(time_s, jumped, velocity)
    assert [str(move) for move in motion.moves] == [str(move) for move in judged(time_s, jumped, None).moves]


FALSE: dict[str, Velocity] = {
    "zero": lambda _, v: 0.0 * v,
    "constant": lambda _, v: 0.0 * v + np.array([8.0, 0.0, 0.0]),
    "its mean": lambda _, v: 0.0 * v + v.mean(axis=0),
    "turned": lambda _, v: v[:, [1, 0, 2]] * [-1.0, 1.0, 1.0],
    "east for north": lambda _, v: v[:, [1, 0, 2]],
    "reversed": lambda _, v: -v,
    "half": lambda _, v: 0.5 * v,
    "one and a half": lambda _, v: 1.5 * v,
    "3 s late": late(3.0),
    "3 s early": late(-3.0),
    "of the end first": lambda _, v: v[::-1],
}


@pytest.mark.parametrize(("rate_hz", "speed_m_s"), [(1.0, 8.0), (10.0, 8.0), (10.0, 4.0)])
@pytest.mark.parametrize("name", FALSE)
def test_a_velocity_that_is_not_that_of_the_positions_contradicts_them(
    name: str, rate_hz: float, speed_m_s: float
) -> None:
    time_s, enu, velocity = flown(rate_hz, speed_m_s=speed_m_s)
    motion = judged(time_s, enu, FALSE[name](time_s, velocity))
    assert motion.contradiction is not None or len(motion.moves) > 3
    # The error of an estimator does not excuse it.
    motion = judged(time_s, enu + wandering(time_s, 9), FALSE[name](time_s, velocity))
    assert motion.contradiction is not None or len(motion.moves) > 3


def test_a_large_contradiction_takes_no_evidence_but_says_how_large_it_is() -> None:
    time_s, enu, velocity = flown(10.0)
    motion = judged(time_s, enu, -velocity)
    assert motion.contradiction is not None
    assert motion.contradiction.kind == "velocity"
    assert str(motion.contradiction).startswith("the reported velocity differs from the change of position by 1")
    assert 0.8 < motion.contradicted_fraction <= 1.0
    assert motion.joined.all()
    assert motion.evidence.all()


def test_up_for_down_shows_where_it_climbs_and_sinks() -> None:
    time_s, enu, velocity = flown(10.0)
    motion = judged(time_s, enu, velocity * [1.0, 1.0, -1.0])
    assert [(move.kind, round(time_s[move.first] / 10.0)) for move in motion.moves] == [
        ("velocity", 0),
        ("velocity", 28),
    ]


def test_a_small_one_is_a_stretch_that_was_not_observed() -> None:
    time_s, enu, velocity = flown(10.0)
    # Smoothly 20 m aside and back within 16 s: no acceleration shows it.
    aside = 20.0 * np.sin(np.pi * np.clip((time_s - 130.0) / 16.0, 0.0, 1.0)) ** 2
    moved = enu + aside[:, None] * [0.0, 1.0, 0.0]
    assert judged(time_s, moved, None).moves == ()
    motion = judged(time_s, moved, velocity)
    assert motion.contradiction is None
    assert len(motion.moves) in (1, 2)
    assert {move.kind for move in motion.moves} == {"velocity"}
    left_out = time_s[1:][~motion.joined]
    assert left_out.min() > 125.0
    assert left_out.max() < 151.0


@pytest.mark.parametrize("noise_m", [0.0, 0.05, 0.3])
def test_corners_in_no_time_show_in_the_velocity_whatever_the_noise_of_the_positions(noise_m: float) -> None:
    time_s = np.arange(0.0, 200.0, 0.1)
    course = np.pi / 2.0 * (time_s // 20.0)
    velocity = 8.0 * np.column_stack([np.cos(course), np.sin(course), 0.0 * course])
    enu = np.vstack([np.zeros(3), np.cumsum(0.05 * (velocity[1:] + velocity[:-1]), axis=0)])
    motion = judged(time_s, enu + np.random.default_rng(5).normal(0.0, noise_m, enu.shape), velocity)
    corners = np.searchsorted(time_s, np.arange(20.0, 199.0, 20.0) - 0.05)
    assert not motion.joined[corners - 1].any()
    if noise_m == 0.0:
        assert len(motion.moves) == 9
        assert {move.kind for move in motion.moves} == {"acceleration"}


def test_without_a_velocity_nothing_is_compared() -> None:
    time_s, enu, velocity = flown(10.0)
    for unknown in (None, np.full(enu.shape, np.nan)):
        motion = judged(time_s, enu, unknown)
        assert (motion.moves, motion.contradiction, motion.contradicted_fraction) == ((), None, 0.0)
    # Samples that report none are left out, and windows in which there is none for long; those beside them are not.
    part = np.where((time_s < 150.0)[:, None], np.nan, -velocity)
    motion = judged(time_s, enu, part)
    assert motion.contradiction is not None
    assert time_s[motion.contradiction.first] >= 150.0
    rare = np.where((np.arange(len(time_s)) % 10 > 0)[:, None], np.nan, velocity)
    assert judged(time_s, enu, rare).moves == ()
    assert judged(time_s, enu, -rare).contradiction is not None
    too_rare = np.where((np.arange(len(time_s)) % 21 > 0)[:, None], np.nan, -velocity)
    assert judged(time_s, enu, too_rare).contradiction is None


def test_the_error_of_positions_changes_with_time_and_no_more_than_twice_its_variance() -> None:
    error = PositionError((2.0, 3.0), 30.0)
    assert error.change_m(np.array([0.0, 0.3, 1e9]), 0) == pytest.approx(
        [0.0, 2.0 * np.sqrt(0.02), 2.0 * np.sqrt(2.0)], rel=0.01
    )
    assert error.change_m(np.array([10.0]), 1) == pytest.approx(1.5 * error.change_m(np.array([10.0]), 0))

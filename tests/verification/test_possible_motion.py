"""Changes of velocity that nothing can make, against jumps of a receiver that leave the velocity as it was."""

import numpy as np
import pytest

from uavcover.model.track import Track
from uavcover.verification.attitude import ATTITUDE, known_attitude
from uavcover.verification.possible_motion import Motion, MotionLimits, judge_motion

pytestmark = pytest.mark.usefixtures("attitudes_count")

LIMITS = MotionLimits(speed_m_s=23.0, climb_m_s=12.0, descent_m_s=12.0, acceleration_m_s2=6.8)
TIME_S = np.arange(0.0, 60.0, 0.1)


def straight(speed_m_s: float = 10.0) -> np.ndarray:
    return np.column_stack([speed_m_s * TIME_S, 0.0 * TIME_S, np.full(TIME_S.size, 80.0)])


def judged(enu_m: np.ndarray, time_s: np.ndarray = TIME_S) -> Motion:
    return judge_motion(time_s, enu_m, LIMITS, max_gap_s=2.0)


def steps(motion: Motion) -> list[float]:
    return [move.step_m_s for move in motion.moves if move.step_m_s > 0.0]


def test_a_straight_line_and_a_turn_that_can_be_flown_hold_nothing_impossible() -> None:
    assert judged(straight()).moves == ()
    angle = TIME_S * 10.0 / 25.0  # 4 m/s2 on a circle
    circle = np.column_stack([25.0 * np.cos(angle), 25.0 * np.sin(angle), 0.0 * TIME_S])
    assert judged(circle).moves == ()


def test_a_hover_without_braking_is_a_step_at_both_ends() -> None:
    held = np.minimum(TIME_S, 20.0) + np.maximum(0.0, TIME_S - 40.0)
    enu = straight()
    enu[:, 0] = 10.0 * held
    found = steps(judged(enu))
    assert len(found) == 2
    assert all(2.0 < step < 10.0 for step in found)


@pytest.mark.parametrize("rate_hz", [50, 10, 5])
def test_turning_round_on_the_spot_is_a_step(rate_hz: int) -> None:
    time_s = np.arange(0.0, 60.0, 1.0 / rate_hz)
    enu = np.column_stack([10.0 * np.minimum(time_s, 60.0 - time_s), 0.0 * time_s, 0.0 * time_s])
    motion = judged(enu, time_s)
    assert len(motion.moves) == 1
    assert 11.0 < steps(motion)[0] < 20.0


def test_at_one_sample_a_second_too() -> None:
    time_s = np.arange(0.0, 60.0)
    enu = np.column_stack([20.0 * np.minimum(time_s, 60.0 - time_s), 0.0 * time_s, 0.0 * time_s])
    assert steps(judged(enu, time_s))[0] > 10.0


def test_what_noise_may_have_done_is_no_step() -> None:
    enu = np.column_stack([10.0 * np.minimum(TIME_S, 60.0 - TIME_S), 0.0 * TIME_S, 0.0 * TIME_S])
    noise = 0.05 * np.where(np.arange(TIME_S.size) % 4 < 2, 1.0, -1.0)
    (sharp,) = steps(judged(enu))
    (noisy,) = steps(judged(enu + noise[:, None] * [0.0, 1.0, 0.0]))
    # Second differences of 0.2 m: half of six times as much, on each side within half a second.
    assert sharp - noisy == pytest.approx(0.5 * 6.0 * 0.2 * (1.0 / 0.5 + 1.0 / 0.5), abs=1.0)


def test_climbing_at_once_is_a_step() -> None:
    enu = straight(4.0)
    enu[:, 2] = 10.0 * np.maximum(0.0, TIME_S - 30.0)
    assert len(steps(judged(enu))) == 1


@pytest.mark.parametrize("by_m", [(2.0, 0.0, 0.0), (0.0, 4.5, 0.0), (0.0, 0.0, -4.0)])
def test_a_jump_of_the_receiver_is_impossible_and_no_step(by_m: tuple[float, float, float]) -> None:
    enu = straight() + np.where((TIME_S >= 30.0)[:, None], by_m, 0.0)
    motion = judged(enu)
    assert len(motion.moves) == 1
    assert steps(motion) == []
    assert motion.evidence.sum() >= len(enu) - 10


def test_nothing_is_said_of_a_velocity_that_was_not_observed() -> None:
    # One sample before the jump, none of whose neighbours is known.
    time_s = np.append(0.0, 5.0 + TIME_S)
    enu = np.vstack([[-3000.0, 0.0, 0.0], straight()])
    assert steps(judge_motion(time_s, enu, LIMITS, max_gap_s=2.0)) == []


# Attitude


def turning_track(attitude_deg: np.ndarray) -> Track:
    angle = TIME_S * 0.1
    enu = np.column_stack([100.0 * np.sin(angle), 100.0 * np.cos(angle), 0.0 * TIME_S])
    return Track(
        time_s=TIME_S.copy(), geodetic=np.zeros((TIME_S.size, 3)), enu_m=enu, attitude_deg=attitude_deg,
        current_waypoint=np.ones(TIME_S.size, dtype=np.int64),
    )  # fmt: skip


def sideways(yaw_deg: float, course_deg: float) -> tuple[str, ...]:
    """What is said of a straight flight whose nose points elsewhere than it flies."""
    course = np.radians(course_deg)
    enu = np.column_stack([10.0 * TIME_S * np.sin(course), 10.0 * TIME_S * np.cos(course), 0.0 * TIME_S])
    rng = np.random.default_rng(2)
    attitude = np.column_stack([rng.normal(size=(TIME_S.size, 2)), yaw_deg + 0.1 * rng.normal(size=TIME_S.size)])
    track = Track(
        time_s=TIME_S.copy(), geodetic=np.zeros((TIME_S.size, 3)), enu_m=enu, attitude_deg=attitude,
        current_waypoint=np.ones(TIME_S.size, dtype=np.int64),
    )  # fmt: skip
    return known_attitude(track, enu, np.ones(TIME_S.size - 1, dtype=bool)).problems


def test_a_nose_that_points_elsewhere_is_not_in_radians() -> None:
    # Of 30 radians the course would be 279 degrees; no angle in radians is as large.
    assert sideways(30.0, float(np.degrees(30.0) % 360.0)) == ()
    assert "radians" in sideways(3.0, float(np.degrees(3.0)))[0]


def known(attitude_deg: np.ndarray) -> tuple[np.ndarray, list[str]]:
    track = turning_track(attitude_deg)
    found = known_attitude(track, track.enu_m, np.ones(TIME_S.size - 1, dtype=bool))
    return found.attitude_deg, list(found.problems)


def measured() -> np.ndarray:
    rng = np.random.default_rng(1)
    yaw = (90.0 + np.degrees(TIME_S * 0.1)) % 360.0
    return np.column_stack([6.0 + rng.normal(size=TIME_S.size), rng.normal(size=TIME_S.size), yaw])


def test_a_measured_attitude_is_known() -> None:
    attitude, problems = known(measured())
    assert problems == []
    assert np.isfinite(attitude).all()


def test_one_that_stands_still_while_the_course_turns_is_not() -> None:
    stuck = measured()
    stuck[100:400] = stuck[100]
    attitude, problems = known(stuck)
    assert np.isnan(attitude[100:400]).all()
    assert np.isfinite(attitude[:100]).all()
    assert np.isfinite(attitude[400:]).all()
    assert len(problems) == 1
    assert "from 10.0 s to 39.9 s" in problems[0]
    assert "the course turns by 149" in problems[0]


def test_one_that_stands_still_for_a_moment_is() -> None:
    held = measured()[np.arange(TIME_S.size) // 50 * 50]  # for 5 s each, in which the course turns by 29 degrees
    attitude, problems = known(held)
    assert problems == []
    assert np.isfinite(attitude).all()


@pytest.mark.parametrize("axis", [0, 1])
def test_a_lean_that_nothing_flies_with_is_unknown_there(axis: int) -> None:
    leaning = measured()
    leaning[200:300, axis] = 70.0
    leaning[300:310, axis] = ATTITUDE.max_tilt_deg - 1.0
    leaning[300:310, 1 - axis] = 0.0
    attitude, problems = known(leaning)
    assert np.isnan(attitude[200:300]).all()
    assert np.isfinite(np.delete(attitude, np.arange(200, 300), axis=0)).all()
    assert "100 attitudes are tilted by more than 60 degrees, the first by 70 degrees at 20.0 s" in problems[0]

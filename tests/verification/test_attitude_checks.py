"""Which attitudes are known: by their age, their range, and whether they go with the motion."""

import numpy as np
import pytest

from uavcover.model.track import Track
from uavcover.verification.attitude import known_attitude

pytestmark = pytest.mark.usefixtures("attitudes_count")

TIME_S = np.arange(0.0, 60.0, 0.1)
COURSES_RAD = TIME_S * 0.1


def circling(speed_m_s: float = 10.0, turn_rad_s: float = 0.1) -> np.ndarray:
    radius_m, angle = speed_m_s / turn_rad_s, TIME_S * turn_rad_s
    return np.column_stack([-radius_m * np.cos(angle), radius_m * np.sin(angle), 0.0 * TIME_S])


def measured(lean_deg: float = 6.0) -> np.ndarray:
    """With the nose along the circle."""
    rng = np.random.default_rng(4)
    noise = 0.05 * rng.normal(size=(TIME_S.size, 3))
    yaw = np.degrees(COURSES_RAD) % 360.0
    return np.column_stack([lean_deg + noise[:, 0], noise[:, 1], np.clip(yaw + noise[:, 2], 0.0, 360.0)])


def known(
    attitude_deg: np.ndarray, age_s: np.ndarray | None = None, enu_m: np.ndarray | None = None
) -> tuple[np.ndarray, list[str]]:
    enu = circling() if enu_m is None else enu_m
    track = Track(
        time_s=TIME_S.copy(), geodetic=np.zeros((TIME_S.size, 3)), enu_m=enu, attitude_deg=attitude_deg,
        current_waypoint=np.ones(TIME_S.size, dtype=np.int64), attitude_age_s=np.empty(0) if age_s is None else age_s,
    )  # fmt: skip
    found = known_attitude(track, enu, np.ones(TIME_S.size - 1, dtype=bool))
    return found.attitude_deg, list(found.problems)


def test_what_was_measured_is_known_as_it_is() -> None:
    attitude, problems = known(measured())
    assert problems == []
    assert attitude.tolist() == measured().tolist()


# Age


def test_older_than_a_second_is_unknown_and_no_problem_of_the_track() -> None:
    age = np.full(TIME_S.size, 0.3)
    age[100:103] = [1.0, -1.0, np.nan]
    age[200:203] = [1.01, -1.01, 30.0]
    attitude, problems = known(measured(), age)
    assert problems == []
    assert np.flatnonzero(np.isnan(attitude).all(axis=1)).tolist() == [200, 201, 202]
    assert np.isnan(attitude).sum() == 9


def test_the_heading_of_a_position_is_as_old_as_the_position() -> None:
    # A position tells a heading of its own; beside it roll and pitch are empty.
    alone = measured()
    alone[:, :2] = np.nan
    attitude, problems = known(alone, np.full(TIME_S.size, 9.0))
    assert problems == []
    np.testing.assert_array_equal(attitude, alone)


# Range


@pytest.mark.parametrize(
    ("axis", "value", "fits"),
    [
        (0, 180.5, False), (0, -180.5, False), (1, 90.5, False), (1, -90.5, False), (2, 360.5, False), (2, -180.5, False),
        (2, 360.0, True), (2, -180.0, True), (2, 0.0, True),
    ],
)  # fmt: skip
def test_out_of_range_is_unknown_there_and_told(axis: int, value: float, fits: bool) -> None:
    wrong = measured()
    wrong[300:302, axis] = value
    attitude, problems = known(wrong)
    unknown = np.isnan(attitude).all(axis=1)
    assert unknown.sum() == (0 if fits else 2)
    if not fits:
        assert unknown[300:302].all()
        (problem,) = problems
        name = ("roll", "pitch", "yaw")[axis]
        assert problem.startswith("2 attitudes are out of range, the first (roll ")
        assert f"{name} {value:g}" in problem
        assert problem.endswith(" degrees) at 30.0 s")
    else:
        assert problems == []


def test_upside_down_leans_too_much() -> None:
    wrong = measured()
    wrong[300:302, 0] = -180.0
    attitude, problems = known(wrong)
    assert np.isnan(attitude).all(axis=1).sum() == 2
    assert "2 attitudes are tilted by more than 60 degrees, the first by 180 degrees at 30.0 s" in problems[0]


def test_roll_and_pitch_lean_together() -> None:
    wrong = measured()
    wrong[300, :2] = [50.0, 45.0]  # by 63 degrees
    wrong[400, :2] = [50.0, 35.0]  # by 58
    attitude, problems = known(wrong)
    assert np.flatnonzero(np.isnan(attitude).all(axis=1)).tolist() == [300]
    assert "1 attitude is tilted by more than 60 degrees, the first by 63 degrees at 30.0 s" in problems[0]


# Against the motion


@pytest.mark.parametrize(("samples", "unknown"), [(135, False), (155, True)])
def test_one_that_stands_still_while_the_course_turns_by_more_than_60_degrees(samples: int, unknown: bool) -> None:
    # The course turns by 5.7 degrees a second, and is taken every 2 s: 13.4 s show 57 degrees, 15.4 s 69.
    stuck = measured()
    held = np.arange(100, 100 + samples)
    stuck[held] = stuck[100]
    attitude, problems = known(stuck)
    assert np.isnan(attitude).any() == unknown
    if unknown:
        assert np.isnan(attitude[held]).all()
        assert np.isfinite(np.delete(attitude, held, axis=0)).all()
        (problem,) = problems
        assert problem.startswith(
            "the attitude is exactly constant from 10.0 s to 25.4 s, while the course turns by 69"
        )


def test_one_that_stands_still_on_a_straight_line_or_at_rest_may_have_been_measured() -> None:
    straight = np.column_stack([10.0 * TIME_S, 0.0 * TIME_S, 0.0 * TIME_S])
    held = np.tile([3.0, -2.0, 90.0], (TIME_S.size, 1))
    assert known(held, enu_m=straight)[1] == []
    # At rest the places wander, and have no course.
    wandering = np.column_stack([1.5 * np.cos(TIME_S), 1.5 * np.sin(TIME_S), 0.0 * TIME_S])
    assert known(held, enu_m=wandering)[1] == []


def test_in_radians() -> None:
    radians = np.radians(measured())
    attitude, problems = known(radians)
    assert np.isnan(attitude).all()
    assert problems == ["the attitude is in radians instead of degrees: yaw times 57.3 equals the flown course"]
    # In radians -pi to pi as well.
    signed = radians.copy()
    signed[:, 2] = (signed[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
    assert len(known(signed)[1]) == 1
    # One that is not known hides nothing.
    hidden = signed.copy()
    hidden[50] = np.nan
    assert len(known(hidden)[1]) == 1
    # Too little of it has a course: nothing follows.
    few = np.full_like(radians, np.nan)
    few[::150] = radians[::150]
    assert not any("radians" in problem for problem in known(few)[1])
    # At rest neither.
    assert not any("radians" in problem for problem in known(radians, enu_m=0.01 * circling())[1])


def test_small_angles_that_agree_with_the_courses_are_degrees() -> None:
    # Straight to the north, yaw about 1 degree: taken as radians it would be 57 degrees off.
    north = np.column_stack([0.0 * TIME_S, 10.0 * TIME_S, 0.0 * TIME_S])
    rng = np.random.default_rng(5)
    attitude, problems = known(1.0 + 0.3 * rng.normal(size=(TIME_S.size, 3)), enu_m=north)
    assert problems == []
    assert np.isfinite(attitude).all()


def test_exact_zeros_are_no_measurement() -> None:
    level = measured()
    level[:, :2] = 0.0
    level[300, 2] = 0.0
    attitude, problems = known(level)
    assert problems == ["roll and pitch are exactly zero throughout: they were not measured"]
    assert np.isnan(attitude[:, :2]).all()
    np.testing.assert_array_equal(attitude[:, 2], level[:, 2])
    # Nor was the yaw then, where it is zero as well.
    straight = np.column_stack([0.0 * TIME_S, 10.0 * TIME_S, 0.0 * TIME_S])
    attitude, problems = known(np.zeros((TIME_S.size, 3)), enu_m=straight)
    assert len(problems) == 1
    assert np.isnan(attitude).all()


def test_one_that_never_leans_though_the_vehicle_accelerates() -> None:
    # Straight at 10 m/s, and every 15 s a turn by 90 degrees within 3 s: 5.2 m/s2, for which it leans by 28 degrees.
    course = np.cumsum(np.where(TIME_S % 15.0 > 12.0, np.radians(30.0), 0.0)) * 0.1
    enu = np.cumsum(np.column_stack([np.sin(course), np.cos(course), 0.0 * course]), axis=0)
    leaning = measured(0.0)
    leaning[:, 2] = np.degrees(course) % 360.0
    for lean_deg, known_there in ((28.0, True), (11.0, True), (8.5, False), (-8.5, False)):
        told = leaning.copy()
        told[:, 0] += np.where(TIME_S % 15.0 > 12.0, lean_deg, 0.0)
        attitude, problems = known(told, enu_m=enu)
        assert np.isfinite(attitude[:, :2]).all() == known_there
        assert np.isfinite(attitude[:, 2]).all()
        if known_there:
            assert problems == []
        else:
            (problem,) = problems
            most = float(np.abs(told[:, :2]).max())
            assert problem == (
                f"roll and pitch never exceed {most:.1f} degrees, although the vehicle accelerates by 5.1 m/s2"
            )
    # Without brisk turns nothing asks for a lean.
    assert known(measured(0.5))[1] == []


def test_nothing_told_is_nothing_wrong() -> None:
    attitude, problems = known(np.full((TIME_S.size, 3), np.nan))
    assert problems == []
    assert np.isnan(attitude).all()

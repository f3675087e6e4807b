"""The camera looks where the vehicle's attitude points it, and an attitude is known by its age, range and motion."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.planner.sites import CAMERA
from tests.verification.flights import changed, fly_along, make_site, track_of
from uavcover.model.sensor import FrameCamera, NadirCamera, SphereSensor
from uavcover.model.track import Track
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.verification.attitude import known_attitude
from uavcover.verification.verify import flown_coverage, verify_track

pytestmark = pytest.mark.usefixtures("attitudes_count")

PATH = np.array([[0.0, 100.0, 80.0], [300.0, 100.0, 80.0]])


def with_attitude(track, roll=0.001, pitch=0.0, yaw=0.0):
    return changed(track, attitude_deg=np.tile([roll, pitch, yaw], (len(track), 1)))


def middle_north(coverage, observed):
    return float(coverage.grid.cells.centre_m[observed, 1].mean())


def test_axes_are_those_of_scipys_rotations():
    attitude = np.random.default_rng(3).uniform([-40.0, -30.0, 0.0], [40.0, 30.0, 360.0], (50, 3))
    turn = CAMERA.camera_turn(attitude)
    # Yaw, pitch, roll of the body (forward, right, down) against north-east-down; the camera looks down in the body.
    ned = Rotation.from_euler("ZYX", attitude[:, ::-1], degrees=True).apply([0.0, 0.0, 1.0])
    np.testing.assert_allclose(turn.axes, ned[:, [1, 0, 2]] * [1.0, 1.0, -1.0], atol=1e-12)
    assert turn.known.all()


@pytest.mark.parametrize(
    ("attitude", "points"),
    [
        ((30.0, 0.0, 0.0), (-0.5, 0.0)),  # heading north, right side down: the camera looks west
        ((30.0, 0.0, 90.0), (0.0, 0.5)),  # heading east: north
        ((0.0, 30.0, 0.0), (0.0, 0.5)),  # nose up: ahead
        ((0.0, -30.0, 270.0), (0.5, 0.0)),  # nose down, heading west: behind, which is east
    ],
)
def test_which_way_it_looks(attitude, points):
    turn = CAMERA.camera_turn(np.array([attitude]))
    np.testing.assert_allclose(turn.axes[0], [*points, -math.cos(math.radians(30.0))], atol=1e-12)


def test_a_track_rolled_by_30_degrees_covers_other_cells():
    site = make_site(cell_m=5.0)
    coverage = CoverageMap(site, cell_size_m=5.0)
    level = with_attitude(fly_along(site, PATH), yaw=90.0)
    rolled = with_attitude(level, roll=30.0, yaw=90.0)
    straight, slanted = (flown_coverage(coverage, track, None).observed for track in (level, rolled))
    assert middle_north(coverage, straight) == pytest.approx(100.0, abs=1.0)
    # 80 m above ground the axis meets it 80 tan(30) = 46 m to the left of the track, which is north.
    assert middle_north(coverage, slanted) > 130.0
    assert (straight & ~slanted).sum() > 0.2 * straight.sum()
    assert verify_track(site, coverage, rolled, None).coverage_fraction != pytest.approx(
        verify_track(site, coverage, level, None).coverage_fraction, abs=0.01
    )


def test_a_gimbal_and_a_sphere_see_the_same_whatever_the_attitude():
    for sensor in (
        NadirCamera(kind="nadir-camera", fov_deg=70.0, range_m=200.0, mount="stabilised"),
        SphereSensor(kind="sphere", range_m=110.0, sensing="along-path"),
    ):
        site = make_site(sensor=sensor)
        coverage = CoverageMap(site, cell_size_m=10.0)
        level = fly_along(site, PATH)
        rolled = with_attitude(level, roll=30.0)
        np.testing.assert_array_equal(
            flown_coverage(coverage, level, None).observed, flown_coverage(coverage, rolled, None).observed
        )
        assert verify_track(site, coverage, with_attitude(level, roll=math.nan), None).unknown_attitude_looks == 0


def test_what_an_unknown_attitude_saw_is_possibly_seen():
    site = make_site()
    coverage = CoverageMap(site, cell_size_m=10.0)
    level = fly_along(site, PATH)
    unknown = with_attitude(level, roll=math.nan, pitch=5.0)
    report, known = verify_track(site, coverage, unknown, None), verify_track(site, coverage, level, None)
    assert report.unknown_attitude_looks >= len(level) - 1
    assert known.unknown_attitude_looks == 0
    assert report.coverage_fraction == 0.0
    # Whichever way it leaned: more than what a level camera sees.
    assert report.possibly_covered_fraction > known.coverage_fraction > 0.3
    assert {gap.reason for gap in report.gaps if gap.area_m2 > 1000.0} == {"attitude-not-known"}


def test_between_two_samples_the_attitude_turns_the_short_way():
    site = make_site()
    points = np.array([[100.0, 100.0, 80.0], [120.0, 100.0, 80.0]])
    track = track_of(site, points, time_s=np.array([0.0, 2.0]), current_waypoint=np.array([1, 1]))
    track = changed(track, attitude_deg=np.array([[30.0, 0.0, 350.0], [30.0, 0.0, 10.0]]))
    coverage = CoverageMap(site, cell_size_m=10.0)
    observed = flown_coverage(coverage, track, None).observed
    # Heading north all the time: rolled right it looks west, never east.
    assert coverage.grid.cells.centre_m[observed, 0].max() < 150.0
    assert coverage.grid.cells.centre_m[observed, 0].min() < 20.0


def test_while_the_nose_turns_a_camera_is_looked_through_between_two_samples_too():
    """Ten places a second are 6 degrees apart: what a tilted camera showed between them did not count."""
    site = make_site(sensor=FrameCamera(
        kind="frame-camera", fov_across_deg=50.0, fov_along_deg=40.0, range_m=250.0, pitch_deg=-50.0, mount="stabilised"
    ))  # fmt: skip
    fractions, yaw_deg = np.linspace(0.0, 1.0, 41), 50.0

    def observed(fractions):
        points = np.column_stack(
            [100.0 + 2.0 * fractions, np.full(len(fractions), 100.0), np.full(len(fractions), 80.0)]
        )
        track = track_of(site, points, time_s=4.0 * fractions, current_waypoint=np.ones(len(fractions), dtype=int))
        attitude = np.column_stack([0.0 * fractions, 0.0 * fractions, (yaw_deg + 80.0 * fractions) % 360.0])
        coverage = CoverageMap(site, cell_size_m=2.0)
        return flown_coverage(coverage, changed(track, attitude_deg=attitude), None).observed

    every_two, few = observed(fractions), observed(fractions[::8])
    assert np.array_equal(every_two, few)
    assert every_two.sum() > 100


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
        reported = leaning.copy()
        reported[:, 0] += np.where(TIME_S % 15.0 > 12.0, lean_deg, 0.0)
        attitude, problems = known(reported, enu_m=enu)
        assert np.isfinite(attitude[:, :2]).all() == known_there
        assert np.isfinite(attitude[:, 2]).all()
        if known_there:
            assert problems == []
        else:
            (problem,) = problems
            most = float(np.abs(reported[:, :2]).max())
            assert problem == (
                f"roll and pitch never exceed {most:.1f} degrees, although the vehicle accelerates by 5.1 m/s2"
            )
    # Without brisk turns nothing asks for a lean.
    assert known(measured(0.5))[1] == []


def test_nothing_told_is_nothing_wrong() -> None:
    attitude, problems = known(np.full((TIME_S.size, 3), np.nan))
    assert problems == []
    assert np.isnan(attitude).all()

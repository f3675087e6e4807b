import math

import numpy as np
import pytest

from tests.naive import flight_time as naive
from uavcover.kernels.flight_time import (
    BLENDED,
    BRAKED,
    Pace,
    flight_time,
    landing_time,
    leg_times,
    mission_time,
    speed_over_ground,
    speeds_over_ground,
    takeoff_time,
    turn_times,
)

CHOICES = {
    "cruise_m_s": (4.0, 10.0),
    "climb_m_s": (1.0, 4.0),
    "descent_m_s": (0.5, 3.0),
    "airspeed_m_s": (12.0, 30.0, math.inf),
    "wind_east_m_s": (0.0, 5.0, -8.0),
    "wind_north_m_s": (0.0, 7.0, -3.0),
    "acceleration_m_s2": (math.inf, 2.5, 3.0),
    "vertical_acceleration_m_s2": (1.0, 3.0),
    "jerk_m_s3": (1.0, 4.0),
    "corner": (BLENDED, BRAKED),
    "corner_radius_m": (2.0, 6.0),
    "smoothing_s": (0.0, 0.3),
    "settling_s": (0.0, 3.2),
    "settling_tc_s": (3.0,),
    "vertical_change_m_s": (1.7, math.inf),
}
SHARP = Pace(10.0, 3.0, 3.0, acceleration_m_s2=2.0, vertical_acceleration_m_s2=2.0)
"""No limit of the jerk."""
ARDUCOPTER = Pace(
    10.0,
    2.5,
    1.5,
    acceleration_m_s2=2.5,
    vertical_acceleration_m_s2=1.0,
    jerk_m_s3=1.0,
    corner=BLENDED,
    smoothing_s=0.3,
)
PX4 = Pace(10.0, 3.0, 1.5, acceleration_m_s2=3.0, vertical_acceleration_m_s2=3.0, jerk_m_s3=4.0, corner=BRAKED)


@pytest.mark.parametrize("size_m", [20.0, 400.0])
@pytest.mark.parametrize("seed", range(12))
def test_time_equals_the_naive_twin(seed, size_m):
    rng = np.random.default_rng(seed)
    pace = Pace(**{name: rng.choice(values) for name, values in CHOICES.items()})
    pace = pace._replace(corner=int(pace.corner))
    route = rng.uniform(-size_m, size_m, (4, 3))
    route.setflags(write=False)
    # The twin adds up small steps.
    assert flight_time(pace, route) == pytest.approx(naive.flight_time(route.tolist(), pace), rel=0.03, abs=0.1)
    assert leg_times(pace, route).sum() + turn_times(pace, route).sum() == pytest.approx(flight_time(pace, route))
    assert flight_time(pace, route[:1]) == flight_time(pace, route[:0]) == 0.0


def test_time_without_a_limit_of_acceleration_by_hand():
    route = np.array([[0.0, 0.0, 0.0], [30.0, 40.0, 0.0], [30.0, 40.0, 8.0], [30.0, 40.0, 2.0], [130.0, 40.0, 1.0]])
    assert flight_time(Pace(10.0, 4.0, 3.0), route) == pytest.approx(5.0 + 2.0 + 2.0 + 10.0, rel=1e-4)


def test_speeds_over_ground_are_those_of_each_direction():
    pace = Pace(10.0, 4.0, 3.0, airspeed_m_s=11.0, wind_east_m_s=6.0, wind_north_m_s=-2.0)
    angles = np.linspace(0.0, 6.0, 9)
    directions = np.column_stack([np.cos(angles), np.sin(angles)])
    expected = [speed_over_ground(pace, east, north) for east, north in directions.tolist()]
    np.testing.assert_array_equal(speeds_over_ground(pace, directions), expected)
    assert min(expected) < 6.0 < max(expected)


def test_wind_by_hand():
    there = np.array([[0.0, 0.0, 0.0], [100.0, 0.0, 0.0]])
    # A wind of 6 m/s from the west and 10 m/s through the air: 16 m/s with it, 4 m/s against it, 8 m/s across it.
    pace = Pace(20.0, 4.0, 3.0, airspeed_m_s=10.0, wind_east_m_s=6.0)
    assert flight_time(pace, there) == pytest.approx(100.0 / 16.0)
    assert flight_time(pace, there[::-1].copy()) == pytest.approx(100.0 / 4.0)
    assert flight_time(pace, np.ascontiguousarray(there[:, [1, 0, 2]])) == pytest.approx(100.0 / 8.0)
    assert flight_time(pace._replace(cruise_m_s=5.0), there) == pytest.approx(20.0), "no faster than cruise"


def test_legs_from_rest_to_rest_by_hand():
    # 10 m/s with 2 m/s2: 5 s over 25 m at each end, and 50 m at full speed; 32 m are too short for it: 8 m/s in the middle.
    assert flight_time(SHARP, np.array([[0.0, 0.0, 0.0], [100.0, 0.0, 0.0]])) == pytest.approx(15.0)
    assert flight_time(SHARP, np.array([[0.0, 0.0, 0.0], [32.0, 0.0, 0.0]])) == pytest.approx(8.0)
    # With a jerk of 1 m/s3 to 2.5 m/s2: 6.5 s over 32.5 m at each end, 35 m at full speed, and 0.3 s for the jerk's own rise.
    assert flight_time(ARDUCOPTER, np.array([[0.0, 0.0, 0.0], [100.0, 0.0, 0.0]])) == pytest.approx(13.0 + 3.5 + 0.3)
    # 4 m: twice the time in which 2 m are flown with a jerk of 1 m/s3 up and down again: 2 (2 t), t^3 = 2.
    assert flight_time(ARDUCOPTER, np.array([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0]])) == pytest.approx(
        4.0 * 2.0 ** (1 / 3) + 0.3
    )


def test_blended_corners_by_hand():
    bent = np.array([[0.0, 0.0, 0.0], [100.0, 0.0, 0.0], [100.0, 100.0, 0.0], [100.0, 0.0, 0.0], [200.0, 0.0, 0.0]])
    # The apex of a right angle is sqrt(2) times the way a t^2 / 2 off, of a turn round twice of it; both within 2 m, and
    # blended for 2 t.
    right, back = 2.0 * math.sqrt(math.sqrt(2.0)), 2.0
    assert turn_times(SHARP, bent)[1:4].tolist() == pytest.approx([-right, -back, -right], rel=1e-5)
    straight = np.array([[0.0, 0.0, 0.0], [100.0, 0.0, 0.0], [200.0, 0.0, 0.0]])
    assert flight_time(SHARP, straight) == pytest.approx(20.0 + 5.0), "as one leg of 200 m"


@pytest.mark.parametrize("pace", [ARDUCOPTER, PX4, SHARP], ids=["ArduCopter", "PX4", "without jerk"])
def test_time_grows_with_sharper_corners_shorter_legs_and_less_acceleration(pace):
    def bent(turn_deg, leg_m=60.0, count=12):
        course = np.radians(turn_deg) * (np.arange(count) % 2)
        steps = leg_m * np.column_stack([np.sin(course), np.cos(course), np.zeros(count)])
        return np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])

    by_corner = [flight_time(pace, bent(turn_deg)) for turn_deg in (0.0, 10.0, 45.0, 90.0, 135.0, 180.0)]
    assert by_corner == sorted(by_corner)
    assert by_corner[0] >= 72.0, "not faster than at full speed"
    by_leg = [flight_time(pace, bent(90.0, 600.0 / count, count)) for count in (4, 8, 20, 60)]
    assert by_leg == sorted(by_leg)
    assert flight_time(pace._replace(acceleration_m_s2=1.5), bent(90.0)) > flight_time(pace, bent(90.0))


@pytest.mark.parametrize("pace", [ARDUCOPTER, PX4], ids=["ArduCopter", "PX4"])
def test_no_leg_is_faster_than_at_full_speed(pace):
    rng = np.random.default_rng(5)
    for _ in range(200):
        route = np.cumsum(rng.normal(size=(12, 3)) * rng.choice([1.0, 10.0, 100.0]) * [1.0, 1.0, 0.2], axis=0)
        fastest = flight_time(pace._replace(acceleration_m_s2=math.inf), route)
        # Corners are cut by up to the radius.
        assert flight_time(pace, route) >= fastest - 11 * 2.0 * pace.corner_radius_m / pace.descent_m_s
        assert np.isfinite(flight_time(pace, route))


def test_take_off_and_landing_by_hand():
    pace = Pace(10.0, 3.0, 1.5, takeoff_m_s=1.5, takeoff_slow_m=10.0, land_m_s=0.5, land_slow_m=10.0, land_band_m=1.0)
    assert takeoff_time(pace, 40.0) == pytest.approx(10.0 / 1.5 + 30.0 / 3.0)
    assert takeoff_time(pace, 4.0) == pytest.approx(4.0 / 1.5)
    assert landing_time(pace, 41.0) == pytest.approx(30.0 / 1.5 + math.log(3.0) + 20.0)
    assert landing_time(pace, 6.0) == pytest.approx(12.0)
    assert landing_time(pace._replace(land_m_s=2.0), 30.0) == pytest.approx(20.0), "no faster than it descends"
    path = np.array([[0.0, 0.0, 5.0], [0.0, 0.0, 45.0], [100.0, 0.0, 45.0], [0.0, 0.0, 46.0], [0.0, 0.0, 5.0]])
    middle = flight_time(pace, path[1:4])
    assert mission_time(pace, path) == pytest.approx(takeoff_time(pace, 40.0) + middle + landing_time(pace, 41.0))

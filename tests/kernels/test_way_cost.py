import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.kernels.test_route import deterministic, points
from tests.naive import route as naive
from uavcover.kernels.route import path_length
from uavcover.kernels.way_cost import LENGTH, TIME, Pace, WayCost, flight_time, leg_times, route_cost, turn_times
from uavcover.scenario.ground import grid_ground

paces = st.builds(
    Pace,
    cruise_m_s=st.sampled_from([1.0, 10.0]),
    climb_m_s=st.sampled_from([0.5, 4.0]),
    descent_m_s=st.sampled_from([0.25, 3.0]),
    airspeed_m_s=st.sampled_from([12.0, 30.0, math.inf]),
    wind_east_m_s=st.sampled_from([0.0, 5.0, -8.0]),
    wind_north_m_s=st.sampled_from([0.0, 7.0, -3.0]),
    acceleration_m_s2=st.sampled_from([math.inf, 2.0]),
)


def flat(up=0.0):
    return grid_ground(
        np.full((3, 3), up), east0_m=-500.0, north0_m=-500.0, step_m=500.0, source="", vertical_datum=""
    ).surface


@deterministic
@given(points(0, 6), paces)
def test_time_equals_the_naive_twin(route, pace):
    route.setflags(write=False)
    expected = naive.flight_time(route.tolist(), pace)
    assert flight_time(pace, route) == pytest.approx(expected, rel=1e-9)
    way = WayCost(TIME, pace, 0.0, 0.0)
    assert route_cost(flat(), way, route) == pytest.approx(expected, rel=1e-9)
    assert leg_times(pace, route).sum() + turn_times(pace, route).sum() == pytest.approx(expected, rel=1e-9)
    assert route_cost(flat(), way._replace(unit=LENGTH), route) == pytest.approx(path_length(route), rel=1e-12)


def test_time_by_hand():
    route = np.array([[0.0, 0.0, 0.0], [30.0, 40.0, 0.0], [30.0, 40.0, 8.0], [30.0, 40.0, 2.0], [130.0, 40.0, 1.0]])
    assert flight_time(Pace(10.0, 4.0, 3.0), route) == 5.0 + 2.0 + 2.0 + 10.0


def test_wind_by_hand():
    there = np.array([[0.0, 0.0, 0.0], [100.0, 0.0, 0.0]])
    # A wind of 6 m/s from the west and 10 m/s through the air: 16 m/s with it, 4 m/s against it, 8 m/s across it.
    pace = Pace(20.0, 4.0, 3.0, airspeed_m_s=10.0, wind_east_m_s=6.0)
    assert flight_time(pace, there) == pytest.approx(100.0 / 16.0)
    assert flight_time(pace, there[::-1].copy()) == pytest.approx(100.0 / 4.0)
    assert flight_time(pace, np.ascontiguousarray(there[:, [1, 0, 2]])) == pytest.approx(100.0 / 8.0)
    assert flight_time(pace._replace(cruise_m_s=5.0), there) == pytest.approx(20.0), "no faster than cruise"


def test_turns_by_hand():
    square = np.array([[0.0, 0.0, 0.0], [100.0, 0.0, 0.0], [100.0, 100.0, 0.0], [100.0, 0.0, 0.0], [100.0, 0.0, 30.0]])
    pace = Pace(10.0, 3.0, 3.0, acceleration_m_s2=2.0)
    # A right angle changes the velocity by 10 sqrt(2) m/s, turning round by 20, stopping to climb by 10; over 2 a = 4.
    assert turn_times(pace, square).tolist() == pytest.approx([0.0, 10.0 * math.sqrt(2.0) / 4.0, 5.0, 2.5, 0.0])


def test_deviation_from_the_middle_of_the_band():
    route = np.array([[0.0, 0.0, 110.0], [100.0, 0.0, 180.0], [200.0, 0.0, 150.0]])
    # Equation 7 with the band 40..120 m over ground at 70 m: 40, 30 and 0 m off its middle.
    way = WayCost(LENGTH, Pace(1.0, 1.0, 1.0), 2.0, 80.0)
    assert route_cost(flat(70.0), way, route) == pytest.approx(path_length(route) + 2.0 * (40.0 + 30.0 + 0.0))

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import RegularGridInterpolator

from tests.kernels.test_route import deterministic, points
from tests.naive import energy as naive
from uavcover.kernels.arrays import read_only
from uavcover.kernels.energy import Power
from uavcover.kernels.flight_time import BLENDED, BRAKED, Pace, flight_time, landing_time, takeoff_time
from uavcover.kernels.path_cost import ENERGY, LENGTH, TIME, Detours, PathCost, route_cost
from uavcover.kernels.route import path_length
from uavcover.terrain.ground import grid_ground

paces = st.builds(
    Pace,
    cruise_m_s=st.sampled_from([1.0, 10.0]),
    climb_m_s=st.sampled_from([0.5, 4.0]),
    descent_m_s=st.sampled_from([0.25, 3.0]),
    airspeed_m_s=st.sampled_from([12.0, 30.0, math.inf]),
    wind_east_m_s=st.sampled_from([0.0, 5.0, -8.0]),
    wind_north_m_s=st.sampled_from([0.0, 7.0, -3.0]),
    acceleration_m_s2=st.sampled_from([math.inf, 2.0]),
    vertical_acceleration_m_s2=st.sampled_from([math.inf, 1.0]),
    jerk_m_s3=st.sampled_from([math.inf, 4.0]),
    corner=st.sampled_from([BLENDED, BRAKED]),
    corner_radius_m=st.sampled_from([0.5, 2.0]),
    smoothing_s=st.sampled_from([0.0, 0.3]),
    settling_s=st.sampled_from([0.0, 3.2]),
    settling_tc_s=st.just(3.0),
    vertical_change_m_s=st.sampled_from([math.inf, 1.7]),
    takeoff_m_s=st.just(1.5),
    takeoff_slow_m=st.just(10.0),
    land_m_s=st.just(0.7),
    land_slow_m=st.just(5.0),
    land_band_m=st.just(5.0),
)


def flat(up=0.0):
    return grid_ground(
        np.full((3, 3), up), east0_m=-500.0, north0_m=-500.0, step_m=500.0, source="", vertical_datum=""
    ).surface


@deterministic
@given(points(0, 6), paces)
def test_time_is_that_of_the_flight_and_length_that_of_the_path(route, pace):
    route.setflags(write=False)
    path_cost = PathCost(TIME, pace, 0.0, 0.0)
    assert route_cost(flat(), path_cost, route) == pytest.approx(flight_time(pace, route), rel=1e-9)
    assert route_cost(flat(), path_cost._replace(unit=LENGTH), route) == pytest.approx(path_length(route), rel=1e-12)


def test_deviation_from_the_middle_of_the_band():
    route = np.array([[0.0, 0.0, 110.0], [100.0, 0.0, 180.0], [200.0, 0.0, 150.0]])
    # Equation 7 with the band 40..120 m over ground at 70 m: 40, 30 and 0 m off its middle.
    path_cost = PathCost(LENGTH, Pace(1.0, 1.0, 1.0), 2.0, 80.0)
    assert route_cost(flat(70.0), path_cost, route) == pytest.approx(path_length(route) + 2.0 * (40.0 + 30.0 + 0.0))


@deterministic
@given(points(1, 5), points(1, 1), paces, st.integers(0, 1))
def test_a_mission_begins_and_ends_on_the_ground_at_home(route, home, pace, stop):
    route.setflags(write=False)
    path_cost = PathCost(TIME, pace, 0.0, 0.0, 1, tuple(home[0]), 30.0, stop)
    whole = np.vstack([home, route[:1], route[:stop], route[1:], home])
    expected = takeoff_time(pace, 30.0) + flight_time(pace, whole) + landing_time(pace, 30.0)
    # Of a single waypoint the turn onto the way home counts only for flights of their own (straight_ends).
    if len(route) > 1:
        assert route_cost(flat(), path_cost, route) == pytest.approx(expected, rel=1e-9)
    else:
        assert route_cost(flat(), path_cost, route) >= expected * (1.0 - 1e-9)


@deterministic
@given(points(1, 5), points(1, 1), paces, st.integers(0, 1))
def test_power_that_is_always_that_of_hovering_makes_energy_time(route, home, pace, stop):
    path_cost = PathCost(TIME, pace, 0.0, 0.0, 1, tuple(home[0]), 30.0, stop)
    assert route_cost(flat(), path_cost._replace(unit=ENERGY), route) == pytest.approx(
        route_cost(flat(), path_cost, route), rel=1e-9
    )


POWER = Power(
    induced_m_s=5.0, profile_share=0.2, tip_m_s=120.0, drag_1_s=0.2, drag_1_m=0.01, idle_share=0.03,
    descent_gain=0.3, gust_m_s=1.0,
)  # fmt: skip


def test_energy_of_a_mission_is_that_of_small_steps_of_time():
    """By a twin that looks power up every 2 ms; each leg from rest to rest, climbs and descents straight up and down."""
    acceleration = 2.0
    pace = Pace(
        10.0, 4.0, 3.0, airspeed_m_s=15.0, wind_east_m_s=3.0, wind_north_m_s=-2.0, acceleration_m_s2=acceleration,
        vertical_acceleration_m_s2=1e3, jerk_m_s3=1e9, corner_radius_m=1e-9,
    )  # fmt: skip
    path_cost = PathCost(ENERGY, pace, 0.0, 0.0, 1, (0.0, 0.0, 40.0), 40.0, 1, power=POWER)
    legs = [((0, 0, 40), (200, 50, 80)), ((200, 50, 80), (0, 300, 60)), ((0, 300, 60), (0, 0, 40))]
    expected = 40.0 / 4.0 * naive.fraction(POWER, math.hypot(3.0, 2.0, math.sqrt(2.0)), 4.0)
    expected += 40.0 / 3.0 * naive.fraction(POWER, math.hypot(3.0, 2.0, math.sqrt(2.0)), -3.0)
    for p, q in legs:
        level, up, length = math.dist(p[:2], q[:2]), q[2] - p[2], math.dist(p, q)
        # The wind of 3.6 m/s leaves of 15 m/s more than cruise speed on every leg.
        speed = min(10.0 * length / level, (4.0 if up > 0 else 3.0) * length / abs(up) if up else math.inf)
        expected += naive.leg(
            POWER, p, q, speed=speed, acceleration=acceleration * length / level, wind=(3.0, -2.0)
        )[1]  # fmt: skip
    route = np.array([legs[0][1], legs[1][1]], dtype=float)
    assert route_cost(flat(), path_cost, route) == pytest.approx(expected, rel=0.01)
    assert route_cost(flat(), path_cost._replace(unit=TIME), route) != pytest.approx(expected, rel=0.05)


def test_detours_are_interpolated_between_places_and_heights():
    """As by SciPy's interpolator, beyond the lattice as at its edge."""
    rng = np.random.default_rng(8)
    more = read_only(rng.uniform(0.0, 9.0, (4, 3, 4)))
    known = Detours(more, east0_m=-3.0, north0_m=2.0, east_m=2.0, north_m=1.5, low_agl_m=1.0, high_agl_m=3.0)
    path_cost = PathCost(TIME, Pace(2.0, 0.7, 0.5), 0.0, 0.0, mission=1, climb_out_top=(0.0, 0.0, 2.0), climb_out_m=2.0)
    axes = [1.0, 3.0], 2.0 + 1.5 * np.arange(4), -3.0 + 2.0 * np.arange(3)
    levels = np.moveaxis(more.reshape(4, 3, 2, 2), 2, 0)
    exact = RegularGridInterpolator(axes, levels)
    for p, q in rng.uniform([-5.0, 0.0, 0.5], [4.0, 8.0, 4.0], (60, 2, 3)):
        ends = (
            np.clip([position[2], position[1], position[0]], [1.0, 2.0, -3.0], [3.0, 6.5, 1.0]) for position in (p, q)
        )
        expected = exact(next(ends))[0, 0] + exact(next(ends))[0, 1]
        route, surface = np.array([p, q]), flat()
        added = route_cost(surface, path_cost._replace(detours=known), route) - route_cost(surface, path_cost, route)
        assert added == pytest.approx(expected, abs=1e-9)
    unknown = np.array([[-800.0, 0.0, 2.0], [-800.0, 5.0, 2.0]])
    assert math.isfinite(route_cost(flat(), path_cost._replace(detours=known), unknown))

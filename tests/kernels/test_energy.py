"""Energy of flight: the formula against others', legs against small steps, flights against the sum of their parts."""

import itertools
import math

import numpy as np
import pytest

from tests.compiled_kernels import cases
from tests.kernels.test_sorties import random_costs
from tests.naive import energy as naive
from uavcover.kernels.energy import (
    Power,
    in_wind,
    landing_energy,
    leg_energy,
    path_energies,
    power_fraction,
    star_energies,
    takeoff_energy,
    vertical_energies,
)
from uavcover.kernels.flight_time import Pace, landing_time, takeoff_time
from uavcover.kernels.path_cost import FlightEnergies, battery_s, flight_s
from uavcover.missions.path_cost import power_of
from uavcover.mock.dynamics import power_fraction as of_the_mock
from uavcover.model.vehicle import PowerModel, Vehicle

PLAIN = Power(6.0, 0.0, 120.0, 0.2, 0.0, 0.03, 0.3, 0.0)
PACE = Pace(10.0, 4.0, 3.0, 18.0, acceleration_m_s2=2.5, vertical_acceleration_m_s2=1.0)
ZENG = PowerModel(
    mass_kg=20.0 / 9.80665,
    hover_induced_m_s=4.03,
    profile_share=79.86 / (79.86 + 88.63),
    tip_speed_m_s=120.0,
    rotor_drag_1_s=0.0,
    body_drag_area_m2=0.6 * 0.05 * 0.503,
    idle_share=0.0,
)
"""The rotary-wing vehicle of 20 N of Zeng, Xu and Zhang 2019 (Table I)."""


def random_power(rng: np.random.Generator) -> Power:
    return Power(
        rng.uniform(2.0, 9.0), rng.uniform(0.0, 0.6), 120.0, rng.uniform(0.0, 0.4), rng.uniform(0.0, 0.03),
        rng.uniform(0.0, 0.1), rng.uniform(0.0, 1.0), rng.uniform(0.0, 2.0),
    )  # fmt: skip


def test_power_is_that_of_its_parts() -> None:
    rng = np.random.default_rng(3)
    for _ in range(cases(compiled=300, interpreted=60)):
        power, speed, climb = random_power(rng), rng.uniform(0.0, 25.0), rng.uniform(-4.0, 6.0)
        assert power_fraction(power, speed, climb) == pytest.approx(naive.fraction(power, speed, climb), rel=1e-9)


def test_a_published_vehicle() -> None:
    """Zeng et al., Eq. 12, and the speeds that they state: 10.2 m/s for the longest, 18.3 m/s for the farthest flight."""
    power = power_of(Vehicle(power=ZENG))
    speeds = np.arange(0.0, 30.0, 0.1)
    watts = np.array([168.49 * power_fraction(power, v, 0.0) for v in speeds])
    eq_12 = (
        79.86 * (1.0 + 3.0 * speeds**2 / 120.0**2)
        + 88.63 * np.sqrt(np.sqrt(1.0 + speeds**4 / (4.0 * 4.03**4)) - speeds**2 / (2.0 * 4.03**2))
        + 0.5 * 0.6 * 1.225 * 0.05 * 0.503 * speeds**3
    )
    # Theirs counts 10 % of losses with the induced power and not with the body's drag; ours with both.
    body = 0.1 * 0.5 * 0.6 * 1.225 * 0.05 * 0.503 * speeds**3
    assert np.abs(watts - eq_12 - body).max() < 0.3
    assert speeds[np.argmin(watts)] == pytest.approx(10.2, abs=0.4)
    assert speeds[1:][np.argmin(watts[1:] / speeds[1:])] == pytest.approx(18.3, abs=0.7)


@pytest.mark.parametrize("model", [PowerModel(), ZENG, PowerModel(mass_kg=3.2, payload_kg=0.8, rotor_area_m2=0.454)])
def test_the_mock_uses_as_much(model: PowerModel) -> None:
    power = power_of(Vehicle(power=model))
    for speed in (0.0, 3.0, 10.0, 18.0):
        for climb in (-3.0, 0.0, 4.0):
            assert power_fraction(power, speed, climb) == pytest.approx(of_the_mock(speed, climb, model), rel=1e-12)


def test_hovering_for_the_endurance_empties_the_battery() -> None:
    assert power_fraction(PLAIN, 0.0, 0.0) == pytest.approx(1.0)
    assert power_fraction(power_of(Vehicle(power=ZENG)), 0.0, 0.0) == pytest.approx(1.0)


def test_a_leg_is_the_sum_of_its_moments() -> None:
    rng = np.random.default_rng(7)
    for _ in range(cases(compiled=12, interpreted=3)):
        power, wind = random_power(rng), rng.uniform(-5.0, 5.0, 2)
        a, b = (tuple(float(x) for x in p) for p in rng.uniform([-200.0, -200.0, 40.0], [200.0, 200.0, 60.0], (2, 3)))
        pace = in_wind(PACE._replace(vertical_acceleration_m_s2=math.inf), wind[0], wind[1])
        level = math.hypot(b[0] - a[0], b[1] - a[1]) / math.dist(a, b)
        steep = abs(b[2] - a[2]) / math.dist(a, b)
        speed = min(10.0 / level, (4.0 if b[2] > a[2] else 3.0) / max(steep, 1e-9))
        _, used = naive.leg(power, a, b, speed=speed, acceleration=2.5 / level, wind=wind)
        assert leg_energy(power, pace, a, b) == pytest.approx(used, rel=0.004)


def test_a_short_leg_never_reaches_its_speed() -> None:
    _, used = naive.leg(PLAIN, (0.0, 0.0, 50.0), (9.0, 0.0, 50.0), speed=10.0, acceleration=2.5, wind=(0.0, -6.0))
    assert leg_energy(PLAIN, in_wind(PACE, 0.0, -6.0), (0.0, 0.0, 50.0), (9.0, 0.0, 50.0)) == pytest.approx(
        used, rel=0.01
    )
    assert leg_energy(PLAIN, PACE, (5.0, 5.0, 50.0), (5.0, 5.0, 50.0)) == 0.0


def test_up_costs_and_down_gives_a_part_back() -> None:
    up, down = takeoff_energy(PLAIN, PACE, 30.0), landing_energy(PLAIN, PACE, 30.0)
    assert up == pytest.approx(takeoff_time(PACE, 30.0) + 0.97 * 30.0 / 6.0)
    assert down == pytest.approx(landing_time(PACE, 30.0) - 0.97 * 0.3 * 30.0 / 6.0)
    assert takeoff_energy(PLAIN, PACE, 0.0) == landing_energy(PLAIN, PACE, 0.0) == 0.0


def test_against_the_wind_costs_most() -> None:
    away, home = ((0.0, 0.0, 50.0), (0.0, 400.0, 50.0)), ((0.0, 400.0, 50.0), (0.0, 0.0, 50.0))
    north = in_wind(PACE, 0.0, 8.0)
    assert leg_energy(PLAIN, north, *home) > 1.3 * leg_energy(PLAIN, PACE, *home)
    assert leg_energy(PLAIN, north, *away) < 1.1 * leg_energy(PLAIN, PACE, *away)
    gusts = PLAIN._replace(gust_m_s=3.0)
    assert leg_energy(gusts, north, *home) > leg_energy(PLAIN, north, *home)


def test_of_flights_the_worst_wind_counts() -> None:
    winds = np.array([[0.0, 0.0], [0.0, 8.0], [-6.0, 0.0]])
    route = np.array([[0.0, 50.0, 60.0], [150.0, 60.0, 70.0], [150.0, 200.0, 55.0], [0.0, 220.0, 60.0]])
    centre = (0.0, 0.0, 60.0)
    legs, turns = path_energies(PLAIN, PACE, winds, route)
    out, back = star_energies(PLAIN, PACE, winds, centre, route)
    up, down = vertical_energies(PLAIN, PACE, winds, 30.0)
    assert (turns <= 0.0).all()
    for w, (east, north) in enumerate(winds):
        pace = in_wind(PACE, east, north)
        positions = [tuple(float(x) for x in p) for p in route]
        assert legs[w] == pytest.approx([leg_energy(PLAIN, pace, p, q) for p, q in itertools.pairwise(positions)])
        assert out[w] == pytest.approx([leg_energy(PLAIN, pace, centre, p) for p in positions])
        assert back[w] == pytest.approx([leg_energy(PLAIN, pace, p, centre) for p in positions])
        assert (up[w], down[w]) == (takeoff_energy(PLAIN, pace, 30.0), landing_energy(PLAIN, pace, 30.0))
    energies = FlightEnergies(
        np.hstack([np.zeros((3, 1)), np.cumsum(legs, axis=1)]), np.cumsum(turns, axis=1), out + up[:, None],
        back + down[:, None], out + back + (up + down)[:, None], 100.0,
    )  # fmt: skip
    whole = up + out[:, 1] + legs[:, 1:].sum(axis=1) + turns[:, 2] + back[:, 3] + down
    assert battery_s(energies, 1, 3) == pytest.approx(whole.max())
    assert battery_s(energies, 2, 2) == pytest.approx((up + out[:, 2] + back[:, 2] + down).max())


def test_a_flight_that_uses_too_much_may_not_be_flown() -> None:
    costs = random_costs(np.random.default_rng(1), 5, 0)._replace(
        endurance_s=math.inf, item_limit=math.inf, barred=np.empty((0, 2), dtype=np.int64),
        there_s=np.full(5, 10.0), back_s=np.full(5, 10.0),
    )  # fmt: skip
    ones = np.ones((2, 5))
    energies = FlightEnergies(np.cumsum(ones, axis=1), 0.0 * ones, ones, ones * [[1.0], [3.0]], 5.0 * ones, 6.5)
    costs = costs._replace(energies=energies)
    assert math.isfinite(flight_s(costs, 0, 2))  # 1 + 2 + 3
    assert flight_s(costs, 0, 3) == math.inf
    assert math.isfinite(flight_s(costs, 3, 3))
    assert flight_s(costs._replace(energies=energies._replace(usable_s=4.0)), 3, 3) == math.inf

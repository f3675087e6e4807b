"""The battery: what flying costs, against closed forms and a long way to the same number."""

import math

import pytest

from mission_io.wire import messages as m
from tests.mock.bench import Bench
from uavcover.mock.dynamics import Battery, BatteryData, power_share
from uavcover.model.vehicle import PowerModel, Vehicle

DATA = BatteryData(endurance_s=1200.0, hover_w=250.0)
POWER = DATA.power


def test_a_full_battery_hovers_for_its_endurance():
    battery = Battery(DATA)
    seconds = 0.0
    while battery.remaining > 0.0:
        battery.fly(1.0, airspeed_m_s=0.0, climb_m_s=0.0)
        seconds += 1.0
    assert seconds == pytest.approx(1200.0, abs=1.0)
    assert power_share(0.0, 0.0, POWER) == pytest.approx(1.0)
    assert battery.power_w == pytest.approx(250.0)


def test_induced_speed_solves_glauerts_equation():
    def bisected(airspeed_m_s: float) -> float:
        """The induced speed v with v sqrt(V^2 + v^2) = v_h^2, by halving."""
        low, high = 0.0, 6.0
        for _ in range(60):
            middle = 0.5 * (low + high)
            if middle * math.sqrt(airspeed_m_s**2 + middle**2) < 36.0:
                low = middle
            else:
                high = middle
        return low

    for airspeed in (0.0, 3.0, 8.0, 15.0):
        drag = POWER.rotor_drag_1_s * airspeed**2 / 9.80665
        expected = 0.03 + 0.97 * (bisected(airspeed) + drag) / 6.0
        assert power_share(airspeed, 0.0, POWER) == pytest.approx(expected, rel=1e-9)


def test_there_is_a_cheapest_speed_above_hovering():
    shares = [power_share(0.5 * n, 0.0, POWER) for n in range(41)]
    cheapest = 0.5 * shares.index(min(shares))
    assert 3.0 < cheapest < 12.0
    assert min(shares) < 0.9
    assert shares[-1] > 1.0


def test_climbing_costs_its_weight_and_descending_gives_a_part_back():
    # Climbing at 3 m/s adds m g 3 W, hovering takes m g 6 W.
    assert power_share(0.0, 3.0, POWER) == pytest.approx(1.0 + 0.97 * 0.5)
    assert power_share(0.0, -3.0, POWER) == pytest.approx(1.0 - 0.97 * 0.15)


def test_a_scenarios_longest_flight_leaves_a_fifth_of_the_charge():
    assert BatteryData.for_vehicle(Vehicle(endurance_s=1200.0)).endurance_s == 1200.0
    assert BatteryData.for_vehicle(Vehicle()) == BatteryData()


def test_voltage_falls_with_charge_and_load():
    battery = Battery(DATA)
    idle_v = battery.voltage_v
    battery.fly(1.0, airspeed_m_s=0.0, climb_m_s=3.0)
    assert battery.voltage_v < idle_v
    assert battery.current_a == pytest.approx(battery.power_w / battery.voltage_v)
    battery.idle(1.0)
    before = battery.voltage_v
    battery.drop_to(0.2)
    assert battery.voltage_v == pytest.approx(before - 4 * 0.8 * 0.8, abs=0.01)
    battery.drop_to(0.9)
    assert battery.remaining == 0.2


@pytest.mark.parametrize("make", [lambda: BatteryData(endurance_s=0.0), lambda: Battery(DATA, remaining=0.0)])
def test_impossible_batteries_are_refused(make):
    with pytest.raises(ValueError, match=r"endurance_s|remaining"):
        make()


def test_without_electronics_nothing_is_drawn_on_the_ground():
    battery = Battery(BatteryData(endurance_s=1200.0, power=PowerModel(idle_share=0.0)))
    battery.idle(100.0)
    assert (battery.remaining, battery.time_left_s) == (1.0, math.inf)
    bench = Bench(battery=battery.data)
    bench.run(6.0)
    assert bench.heard(m.BatteryStatus)[-1].time_left_s is None

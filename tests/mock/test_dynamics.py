"""The mock vehicle's motion, its battery against closed forms, and legs as routes of missions have them."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mission_io.wire import messages as m
from tests.mock.bench import Bench
from tests.sensing.flown_lines import positions_when_passed
from uavcover.mock.behaviour import Speeds
from uavcover.mock.dynamics import Airframe, Battery, BatteryData, PointMass, WindField, WindModel, power_fraction
from uavcover.mock.guidance import Stop, along_speed, passing_speeds, velocity_along, velocity_to
from uavcover.mock.itinerary import Itinerary, Step, StepKind
from uavcover.model.vehicle import MOTIONS, AutopilotName, PowerModel, Vehicle

STEP_S = 0.02
SPEEDS = Speeds(8.0, 3.0, 2.0)
RADIUS_M = 2.0

_coordinate = st.floats(-80.0, 80.0)
_points = st.lists(st.tuples(_coordinate, _coordinate, st.floats(5.0, 60.0)), min_size=2, max_size=5)


def fly_route(points, *, wind=None, seed=0, airframe=None, seconds=400.0):
    """The states of a body that flies a route from the origin: positions, velocities, accelerations."""
    airframe = airframe or Airframe()
    wind = wind or WindModel()
    body = PointMass(airframe, step_s=STEP_S, position_m=(0.0, 0.0, 0.0))
    air = WindField(wind, step_s=STEP_S, rng=np.random.default_rng(seed))
    itinerary = Itinerary([Step(i, StepKind.GO, SPEEDS, p, RADIUS_M) for i, p in enumerate(points)], body, 0.0)
    states = []
    for n in range(int(seconds / STEP_S)):
        if itinerary.step is None:
            break
        body.step(itinerary.wanted_velocity(n * STEP_S, -1e9), air.step())
        states.append((*body.position_m, *body.velocity_m_s, *body.acceleration_m_s2))
    assert itinerary.step is None, "the route was not flown to its end"
    return np.array(states)


def distance_to_route(positions, route):
    nearest = np.full(len(positions), np.inf)
    for a, b in pairwise(np.asarray(route, float)):
        along = b - a
        fraction = np.clip(((positions - a) @ along) / max(along @ along, 1e-12), 0.0, 1.0)
        nearest = np.minimum(nearest, np.linalg.norm(positions - (a + fraction[:, None] * along), axis=1))
    return nearest


@settings(max_examples=25, deadline=None)
@given(_points)
def test_limits_hold_and_every_waypoint_is_passed_inside_its_radius(points):
    airframe = Airframe(max_speed_m_s=9.0, max_climb_m_s=3.5, max_descent_m_s=2.5)
    states = fly_route(points, airframe=airframe)
    velocity, acceleration = states[:, 3:6], states[:, 6:9]
    assert np.hypot(velocity[:, 0], velocity[:, 1]).max() <= airframe.max_speed_m_s + 1e-9
    assert velocity[:, 2].max() <= airframe.max_climb_m_s + 1e-9
    assert velocity[:, 2].min() >= -airframe.max_descent_m_s - 1e-9
    assert np.hypot(acceleration[:, 0], acceleration[:, 1]).max() <= airframe.max_acceleration_m_s2 + 1e-6
    assert np.abs(acceleration[:, 2]).max() <= airframe.max_vertical_acceleration_m_s2 + 1e-6
    for point in points:
        assert np.linalg.norm(states[:, :3] - point, axis=1).min() <= RADIUS_M + 0.3  # a step at 9 m/s is 0.18 m
    assert distance_to_route(states[:, :3], [(0.0, 0.0, 0.0), *points]).max() <= RADIUS_M + 0.5


def test_gusts_push_no_further_than_drag_allows():
    route = [(100.0, 0.0, 30.0), (100.0, 100.0, 40.0), (0.0, 100.0, 30.0)]
    airframe = Airframe()
    states = fly_route(route, wind=WindModel(speed_m_s=7.0, from_deg=200.0, gust_m_s=2.0), seed=3)
    # On top of the controller's limit, only the air's pull that it does not know yet.
    most = airframe.max_acceleration_m_s2 + airframe.drag_1_s * (7.0 + 6 * 2.0)
    assert np.hypot(states[:, 6], states[:, 7]).max() <= most
    assert np.hypot(states[:, 3], states[:, 4]).max() <= airframe.max_speed_m_s
    assert distance_to_route(states[50:, :3], [(0.0, 0.0, 0.0), *route]).max() < 5.0


def test_wind_beyond_the_lean_carries_the_vehicle_away():
    airframe = Airframe(max_lean_deg=10.0, max_speed_m_s=40.0)
    body = PointMass(airframe, step_s=STEP_S, position_m=(0.0, 0.0, 50.0))
    for _ in range(1000):
        body.step((0.0, 0.0, 0.0), (0.0, 30.0, 0.0))
    assert body.position_m[1] > 50.0
    assert math.degrees(body.pitch_rad) == pytest.approx(0.0, abs=15.0)


def test_a_steady_wind_costs_lean_and_no_place():
    airframe = Airframe()
    body = PointMass(airframe, step_s=STEP_S, position_m=(0.0, 0.0, 50.0), yaw_rad=0.0)
    air = WindField(WindModel(speed_m_s=8.0, from_deg=0.0), step_s=STEP_S, rng=np.random.default_rng(0))
    for _ in range(1500):
        wanted = velocity_to(body.position_m, (0.0, 0.0, 50.0), speeds=SPEEDS, airframe=airframe)
        body.step(wanted, air.step())
    assert math.dist(body.position_m, (0.0, 0.0, 50.0)) < 0.05
    # Drag of 0.2 * 8 m/s from the north: nose down into it by atan(1.6 / g).
    assert body.pitch_rad == pytest.approx(-math.atan2(1.6, 9.80665), abs=0.01)
    assert body.roll_rad == pytest.approx(0.0, abs=0.01)


def test_gusts_have_the_spread_and_memory_they_were_asked_for():
    step_s = 0.1
    field = WindField(WindModel(gust_m_s=2.0, gust_time_s=1.0), step_s=step_s, rng=np.random.default_rng(5))
    gusts = np.array([field.step() for _ in range(60_000)])
    assert gusts[:, 0].std() == pytest.approx(2.0, rel=0.05)
    assert gusts[:, 2].std() == pytest.approx(1.0, rel=0.05)
    lag = 10  # one correlation time
    correlation = np.mean(gusts[:-lag, 1] * gusts[lag:, 1]) / gusts[:, 1].var()
    assert correlation == pytest.approx(math.exp(-1.0), abs=0.05)


def test_the_wind_comes_from_where_it_is_said_to():
    assert WindModel(speed_m_s=5.0, from_deg=90.0).steady_m_s == pytest.approx((-5.0, 0.0, 0.0), abs=1e-12)
    assert WindModel(speed_m_s=5.0, from_deg=180.0).steady_m_s == pytest.approx((0.0, 5.0, 0.0), abs=1e-12)


def test_same_seed_same_flight():
    route = [(60.0, 0.0, 30.0), (0.0, 60.0, 30.0)]
    wind = WindModel(speed_m_s=3.0, from_deg=45.0, gust_m_s=1.5)
    assert np.array_equal(fly_route(route, wind=wind, seed=9), fly_route(route, wind=wind, seed=9))
    assert not np.array_equal(fly_route(route, wind=wind, seed=9)[:100], fly_route(route, wind=wind, seed=10)[:100])


def test_the_nose_turns_to_the_course_no_faster_than_it_can():
    body = PointMass(Airframe(max_yaw_rate_deg_s=90.0), step_s=STEP_S, position_m=(0.0, 0.0, 0.0))
    for _ in range(25):  # half a second
        body.step((-5.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert math.degrees(body.yaw_rad) == pytest.approx(315.0)
    for _ in range(100):
        body.step((-5.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert math.degrees(body.yaw_rad) == pytest.approx(270.0)


def test_the_rate_of_the_nose_changes_no_faster_than_it_can():
    """Half of a turn speeds up, the other half slows down: 90 degrees at 20 degrees/s² take 2 sqrt(90 / 20) s."""
    body = PointMass(Airframe(max_yaw_acceleration_deg_s2=20.0), step_s=STEP_S, position_m=(0.0, 0.0, 0.0))
    yaws_deg = []
    for _ in range(round(6.0 / STEP_S)):
        body.step((5.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        yaws_deg.append(math.degrees(body.yaw_rad))
    rates = np.diff(yaws_deg, prepend=0.0) / STEP_S
    assert np.abs(np.diff(rates, prepend=0.0)).max() <= 20.0 * STEP_S + 1e-6
    assert rates.max() == pytest.approx(math.sqrt(90.0 * 20.0), rel=0.03)
    assert max(yaws_deg) < 91.0
    over_s = STEP_S * int(np.argmax(np.array(yaws_deg) > 89.0))
    assert over_s == pytest.approx(2.0 * math.sqrt(90.0 / 20.0), abs=0.4)


def test_speed_along_a_leg_keeps_all_three_limits():
    assert along_speed((1.0, 0.0, 0.0), SPEEDS) == 8.0
    assert along_speed((0.0, 0.0, 1.0), SPEEDS) == 3.0
    assert along_speed((0.6, 0.0, -0.8), SPEEDS) == pytest.approx(2.0 / 0.8)


def test_sharp_corners_are_passed_slowly_and_straight_ones_fast():
    def speed_at_corner(turned_to):
        stops = [Stop((100.0, 0.0, 0.0), 2.0, False), Stop(turned_to, 2.0, False)]
        return passing_speeds((0.0, 0.0, 0.0), stops, Airframe())[0]

    straight, square, back = (speed_at_corner(p) for p in ((300.0, 0.0, 0.0), (100.0, 200.0, 0.0), (-100.0, 0.0, 0.0)))
    assert straight > 15.0
    # v = sqrt(0.5 * 2.5 m/s2 * 2 m / sin(45 deg))
    assert square == pytest.approx(math.sqrt(0.5 * 2.5 * 2.0 / math.sin(math.pi / 4)))
    assert back < square


def test_a_stop_soon_after_a_gentle_corner_slows_the_corner():
    stops = [Stop((100.0, 0.0, 0.0), 2.0, False), Stop((106.0, 0.1, 0.0), 2.0, True)]
    assert passing_speeds((0.0, 0.0, 0.0), stops, Airframe())[0] <= math.sqrt(2 * 0.6 * 2.5 * 2.1)


def test_far_beside_the_leg_the_vehicle_first_comes_back_to_it():
    stop = Stop((100.0, 0.0, 30.0), 2.0, True)
    wanted = velocity_along(
        (10.0, 60.0, 30.0), (0.0, 0.0, 30.0), stop, passing_m_s=0.0, speeds=SPEEDS, airframe=Airframe()
    )
    assert wanted[0] == pytest.approx(0.0)
    assert wanted[1] == pytest.approx(-8.0)


@pytest.mark.parametrize(
    "make", [lambda: Airframe(max_speed_m_s=0.0), lambda: WindModel(gust_time_s=0.0), lambda: WindModel(speed_m_s=-1.0)]
)
def test_impossible_values_are_refused(make):
    with pytest.raises(ValueError, match="must"):
        make()


@settings(max_examples=15, deadline=None)
@given(_points)
def test_what_the_controller_asks_for_changes_no_faster_than_the_jerk_limit(points):
    airframe = Airframe(max_jerk_m_s3=12.0)
    states = fly_route(points, airframe=airframe)
    change = np.diff(states[:, 6:9], axis=0) / STEP_S
    assert np.hypot(change[:, 0], change[:, 1]).max() <= 12.0 + 1e-6
    assert np.abs(change[:, 2]).max() <= 12.0 + 1e-6


def test_against_the_wind_it_makes_its_airspeed_and_no_more():
    airframe = Airframe(max_airspeed_m_s=15.0, max_speed_m_s=40.0)
    body = PointMass(airframe, step_s=STEP_S, position_m=(0.0, 0.0, 50.0))
    for _ in range(1000):
        body.step((0.0, 14.0, 0.0), (0.0, -9.0, 0.0))
    assert body.velocity_m_s[1] == pytest.approx(15.0 - 9.0, abs=0.1)
    assert body.airspeed_m_s == pytest.approx(15.0, abs=0.1)
    for _ in range(1000):  # more wind than it can fly: it drifts with the rest
        body.step((0.0, 0.0, 0.0), (0.0, -20.0, 0.0))
    assert body.velocity_m_s[1] == pytest.approx(15.0 - 20.0, abs=0.1)


def test_a_wind_that_comes_up_keeps_its_gusts():
    field = WindField(WindModel(gust_m_s=1.0), step_s=STEP_S, rng=np.random.default_rng(3))
    before = np.array([field.step() for _ in range(20_000)])
    field.change(WindModel(speed_m_s=12.0, from_deg=270.0))
    after = np.array([field.step() for _ in range(20_000)])
    assert np.hypot(*(after[1] - before[-1])[:2]) < 1.0  # not at once
    assert after[2000:, 0].mean() == pytest.approx(12.0, abs=0.5)
    assert after[2000:, 1].std() == pytest.approx(before[:, 1].std(), rel=0.3)


def test_a_body_without_motors_falls():
    body = PointMass(Airframe(), step_s=STEP_S, position_m=(0.0, 0.0, 100.0))
    for _ in range(50):
        body.fall((3.0, 0.0, 0.0))
    # One second of free fall with drag 0.2/s: v = g / k (1 - exp(-k t)).
    assert body.velocity_m_s[2] == pytest.approx(-9.80665 / 0.2 * (1.0 - math.exp(-0.2)), rel=0.01)
    assert body.position_m[0] > 0.2


DATA = BatteryData(endurance_s=1200.0, hover_w=250.0)
POWER = DATA.power


def test_a_full_battery_hovers_for_its_endurance():
    battery = Battery(DATA)
    seconds = 0.0
    while battery.remaining > 0.0:
        battery.fly(1.0, airspeed_m_s=0.0, climb_m_s=0.0)
        seconds += 1.0
    assert seconds == pytest.approx(1200.0, abs=1.0)
    assert power_fraction(0.0, 0.0, POWER) == pytest.approx(1.0)
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
        assert power_fraction(airspeed, 0.0, POWER) == pytest.approx(expected, rel=1e-9)


def test_there_is_a_cheapest_speed_above_hovering():
    fractions = [power_fraction(0.5 * n, 0.0, POWER) for n in range(41)]
    cheapest = 0.5 * fractions.index(min(fractions))
    assert 3.0 < cheapest < 12.0
    assert min(fractions) < 0.9
    assert fractions[-1] > 1.0


def test_climbing_costs_its_weight_and_descending_gives_a_part_back():
    # Climbing at 3 m/s adds m g 3 W, hovering takes m g 6 W.
    assert power_fraction(0.0, 3.0, POWER) == pytest.approx(1.0 + 0.97 * 0.5)
    assert power_fraction(0.0, -3.0, POWER) == pytest.approx(1.0 - 0.97 * 0.15)


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


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_a_waypoint_may_stand_twice(autopilot: AutopilotName) -> None:
    """It does where pictures by distance begin; the vehicle of PX4 was divided by the length of the leg between the two."""
    points = np.array([(0, 0, 60), (80, 0, 60), (80, 0, 60), (80, 40, 70), (80, 40, 70), (0, 40, 70)], dtype=float)
    passed = positions_when_passed(MOTIONS[autopilot], points, cruise_m_s=10.0, climb_m_s=4.0, descent_m_s=3.0)
    assert len(passed) == 5
    assert np.linalg.norm(passed - points[1:], axis=1).max() < 3.0

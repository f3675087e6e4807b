"""The cost of a mission as numbers for the kernels, and the battery use of flights."""

import dataclasses
import math

import numpy as np
import pytest

from tests.planner.sites import make_site, ridge, with_scenario
from uavcover.errors import InputError
from uavcover.kernels.flight_time import BLENDED, BRAKED
from uavcover.kernels.path_cost import ENERGY, LENGTH, NO_DETOURS, TIME, route_cost
from uavcover.missions.mission_compiler import compile_mission
from uavcover.missions.objectives import mission_cost
from uavcover.missions.path_cost import FlightEnergy, detours, mission_cost_of, path_cost_of, power_of
from uavcover.model.limits import NoFly
from uavcover.model.route import Route
from uavcover.model.scenario import PlannerSettings
from uavcover.model.vehicle import Vehicle, Wind
from uavcover.scenario.site import Site, load_site
from uavcover.scenario.vehicles import pace_of

AT_ONCE = {"max_airspeed_m_s": 12.0, "acceleration_m_s2": math.inf}
WINDY = with_scenario(make_site(vehicle=AT_ONCE), wind=Wind(speed_m_s=8.0, from_deg=270.0))


def test_a_wind_from_the_west_blows_to_the_east() -> None:
    pace = pace_of(WINDY)
    assert (pace.wind_east_m_s, pace.wind_north_m_s) == (pytest.approx(8.0), pytest.approx(0.0, abs=1e-12))
    assert pace.acceleration_m_s2 == math.inf
    own = pace_of(make_site())
    assert (own.acceleration_m_s2, own.jerk_m_s3, own.corner) == (2.5, 1.0, BLENDED), "ArduPilot's own"
    other = make_site(vehicle={"autopilot": "px4", "acceleration_m_s2": 2.0})
    assert (pace_of(other).acceleration_m_s2, pace_of(other).jerk_m_s3, pace_of(other).corner) == (2.0, 4.0, BRAKED)
    assert pace_of(other, "ardupilot").jerk_m_s3 == 1.0
    assert pace_of(make_site(vehicle={"acceleration_m_s2": math.inf})).acceleration_m_s2 == math.inf
    assert pace_of(make_site()).airspeed_m_s == math.inf


def test_objective_and_middle_of_the_band() -> None:
    assert path_cost_of(make_site(planner={"objective": "length"})).unit == LENGTH
    assert path_cost_of(load_site("paper-R2")).unit == LENGTH, "no home, no mission"
    mission = path_cost_of(make_site(vehicle={"takeoff_height_m": 45.0}))
    assert (mission.unit, mission.mission, mission.climb_out_m, mission.stop_at_first) == (TIME, 1, 45.0, 0)
    assert mission.climb_out_top == (-100.0, 50.0, 45.0), "above home"
    with pytest.raises(InputError, match=r"\[home\]"):
        mission_cost_of(load_site("paper-R2"))
    frugal = path_cost_of(make_site(planner={"objective": "energy"}, vehicle={"takeoff_height_m": 45.0}))
    assert (frugal.unit, frugal.mission, frugal.climb_out_m) == (ENERGY, 1, 45.0)
    assert frugal.power == power_of(Vehicle())
    timed = path_cost_of(make_site(planner={"objective": "flight-time", "band_deviation_price": 0.5}))
    assert timed.mission == 0
    assert (timed.unit, timed.deviation_price, timed.middle_agl_m) == (TIME, 0.5, 80.0)


def test_a_flat_ground_has_next_to_no_detours() -> None:
    assert detours(make_site()).more.max() < 0.6, "a steep transit begins higher"
    assert path_cost_of(make_site(planner={"objective": "flight-time"})).detours is NO_DETOURS


def test_where_no_transit_is_low_enough_few_are_tried() -> None:
    walled = make_site(ridge(-50.0, 200.0))
    assert detours(walled).more.shape[:2] == (8, 8)
    assert detours(make_site(ridge(-50.0, 60.0))).more.shape[:2] == (20, 20)


ZONE = NoFly(polygon_east_north_m=((-60.0, -100.0), (-20.0, -100.0), (-20.0, 190.0), (-60.0, 190.0)), margin_m=5.0)


@pytest.mark.parametrize(
    "site",
    [
        make_site(ridge(-40.0, 150.0), planner={"objective": "mission-time"}),
        make_site(ridge(-40.0, 150.0), planner={"objective": "energy"}),
        make_site(no_fly=(ZONE,), planner={"objective": "mission-time"}),
    ],
)
def test_the_search_counts_missions_along_their_transits(site: Site) -> None:
    """Over a ridge and around a zone, against the mission's cost along its transits."""
    rng, path_cost, errors_s = np.random.default_rng(5), path_cost_of(site), []
    for _ in range(30):
        positions_m = rng.uniform([0.0, 0.0], [300.0, 200.0], (3, 2))
        route = Route(np.column_stack([positions_m, site.ground.ups_m(positions_m, rng.uniform(40.0, 120.0, 3))]))
        cost, price = mission_cost(site, route), len(route) * path_cost.waypoint_price
        real_s = cost.energy_hover_s if site.scenario.objective == "energy" else cost.time_s
        paths = path_cost, path_cost._replace(detours=NO_DETOURS)
        errors_s.append([route_cost(site.ground.surface, each, route.waypoints_m) - price - real_s for each in paths])
    counted_s, straight_s = np.abs(errors_s).mean(axis=0)
    assert counted_s < 0.1 * straight_s
    assert straight_s > 10.0


def test_the_flight_against_the_wind_takes_longer_and_counts_against_endurance() -> None:
    still = make_site(vehicle=AT_ONCE)
    there = Route(np.array([[0.0, 50.0, 80.0], [300.0, 50.0, 80.0]]))
    calm, windy = (compile_mission(site, there, autopilot="ardupilot").flight_time_s for site in (still, WINDY))
    # 400 m home at 12 - 8 m/s instead of 10 m/s; with the wind cruise speed is kept.
    assert windy - calm == pytest.approx(400.0 / 4.0 - 400.0 / 10.0)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Wind(speed_m_s=-1.0), "speed_m_s: must not be negative, but is -1.0"),
        (lambda: Wind(from_deg=400.0), "from_deg: must be between -360 and 360 degrees, not 400.0"),
        (lambda: Vehicle(max_airspeed_m_s=5.0), "max_airspeed_m_s: must be at least cruise_speed_m_s = 10.0"),
        (lambda: Vehicle(acceleration_m_s2=0.0), "acceleration_m_s2: must be greater than 0"),
        (lambda: Vehicle(jerk_m_s3=-1.0), "jerk_m_s3: must be greater than 0"),
        (lambda: Vehicle(max_mission_items=3), r"max_mission_items: must be at least 8 .*, not 3"),
        (lambda: PlannerSettings(waypoint_price=-0.5), "waypoint_price: must not be negative, but is -0.5"),
        (lambda: PlannerSettings(band_deviation_price=-1.0), "band_deviation_price: must not be negative, but is -1.0"),
        (
            lambda: make_site(home=None, planner={"objective": "energy"}),
            r'planner\.objective: "energy" requires a \[home\], where the mission starts',
        ),
        (
            lambda: dataclasses.replace(make_site().scenario, wind=Wind(speed_m_s=5.0)),
            r"wind.speed_m_s: 5.0 m/s requires a larger vehicle.max_airspeed_m_s than none",
        ),
        (
            lambda: dataclasses.replace(WINDY.scenario, wind=Wind(speed_m_s=12.0)),
            r"wind.speed_m_s: 12.0 m/s requires a larger vehicle.max_airspeed_m_s than 12.0",
        ),
    ],
)
def test_what_makes_no_sense_is_refused(make, words: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(ValueError, match=words):
        make()


ROUTE = np.array([[40.0, 20.0, 90.0], [220.0, 35.0, 101.0], [250.0, 150.0, 88.0], [60.0, 140.0, 93.0]])


@pytest.mark.parametrize("stop_at_first", [0, 1])
@pytest.mark.parametrize("count", [1, 2, 4])
def test_straight_flights_are_what_each_path_uses(count: int, stop_at_first: int) -> None:
    site = make_site(
        home=(10.0, -20.0), vehicle={"endurance_s": 900.0, "max_airspeed_m_s": 20.0},
        wind=Wind(speed_m_s=4.0, from_deg=250.0),
    )  # fmt: skip
    energy, route = FlightEnergy(site), ROUTE[:count]
    path_cost = mission_cost_of(site)._replace(stop_at_first=stop_at_first)
    found = energy.straight_flights(path_cost, route)
    height_m = float(path_cost.climb_out_m)
    top, up, down = np.array(path_cost.climb_out_top), energy.takeoff_s(height_m), energy.landing_s(height_m)
    for k, position in enumerate(route):

        def used(*positions: np.ndarray) -> np.ndarray:
            return energy.path_s(np.array(positions))

        def turning(before: np.ndarray, after: np.ndarray, at: np.ndarray = position) -> np.ndarray:
            return used(before, at, after) - used(before, at) - used(at, after)

        there, home = up + used(top, position), used(position, top) + down
        alone = there + home + (turning(top, top) if stop_at_first == 0 else 0.0)
        if stop_at_first == 0 and k < count - 1:
            there = there + turning(top, route[k + 1])
        if k > 0:
            home = home + turning(route[k - 1], top)
        assert found.there_s[:, k] == pytest.approx(there, rel=1e-9)
        assert found.back_s[:, k] == pytest.approx(home, rel=1e-9)
        assert found.alone_s[:, k] == pytest.approx(alone, rel=1e-9)

"""Energies of flights along parts of a route, with straight ways there and home."""

import numpy as np
import pytest

from tests.planner.sites import make_site
from uavcover.missions.way_cost import FlightEnergy, mission_cost_of
from uavcover.model.vehicle import Wind

ROUTE = np.array([[40.0, 20.0, 90.0], [220.0, 35.0, 101.0], [250.0, 150.0, 88.0], [60.0, 140.0, 93.0]])


@pytest.mark.parametrize("stop_at_first", [0, 1])
@pytest.mark.parametrize("count", [1, 2, 4])
def test_straight_flights_are_what_each_path_uses(count: int, stop_at_first: int) -> None:
    site = make_site(
        home=(10.0, -20.0), vehicle={"endurance_s": 900.0, "max_airspeed_m_s": 20.0},
        wind=Wind(speed_m_s=4.0, from_deg=250.0),
    )  # fmt: skip
    energy, route = FlightEnergy(site), ROUTE[:count]
    way = mission_cost_of(site)._replace(stop_at_first=stop_at_first)
    found = energy.straight_flights(way, route)
    height_m = float(way.column_m)
    top, up, down = np.array(way.column_top), energy.takeoff_s(height_m), energy.landing_s(height_m)
    for k, place in enumerate(route):

        def used(*places: np.ndarray) -> np.ndarray:
            return energy.path_s(np.array(places))

        def turning(before: np.ndarray, after: np.ndarray, at: np.ndarray = place) -> np.ndarray:
            return used(before, at, after) - used(before, at) - used(at, after)

        there, home = up + used(top, place), used(place, top) + down
        alone = there + home + (turning(top, top) if stop_at_first == 0 else 0.0)
        if stop_at_first == 0 and k < count - 1:
            there = there + turning(top, route[k + 1])
        if k > 0:
            home = home + turning(route[k - 1], top)
        assert found.there_s[:, k] == pytest.approx(there, rel=1e-9)
        assert found.back_s[:, k] == pytest.approx(home, rel=1e-9)
        assert found.alone_s[:, k] == pytest.approx(alone, rel=1e-9)

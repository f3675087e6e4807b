"""Legs that are too long for one flight get waypoints, at which sorties are cut."""

import dataclasses

import numpy as np
import pytest

from tests.planner.sites import make_site
from tests.planner.test_planner import make_plan
from uavcover.errors import InfeasibleError
from uavcover.missions.flights import compile_flights
from uavcover.model.route import Route
from uavcover.model.sensor import SphereSensor
from uavcover.planner.final_choice import with_legs_that_fit
from uavcover.scenario.site import Site

STRIP = ((-500.0, 0.0), (900.0, 0.0), (900.0, 40.0), (-500.0, 40.0))
LINE = Route(np.array([[-500.0, 20.0, 80.0], [900.0, 20.0, 80.0]]))


def strip(endurance_s: float | None) -> Site:
    """Home is beside its middle: the ends are 700 m away, and it is 1,400 m long."""
    return make_site(ring=STRIP, home=(200.0, -60.0), vehicle={"endurance_s": endurance_s}, cell_m=10.0)


def test_a_leg_that_no_flight_takes_as_a_whole_is_halved() -> None:
    site = strip(325.0)
    with pytest.raises(InfeasibleError, match="the leg to waypoint 1: a sortie with this part alone takes"):
        compile_flights(site, LINE)
    route = with_legs_that_fit(site, LINE)
    np.testing.assert_allclose(route.waypoints_m, [LINE.waypoints_m[0], [200.0, 20.0, 80.0], LINE.waypoints_m[1]])
    flights = compile_flights(site, route)
    assert [(flight.first, flight.last) for flight in flights] == [(0, 1), (1, 2)]
    assert all(flight.compiled.flight_time_s <= 0.8 * 325.0 for flight in flights)
    # Half a kilometre beside it the halves are too long, too.
    aside = make_site(ring=STRIP, home=(200.0, -500.0), vehicle={"endurance_s": 322.0}, cell_m=10.0)
    quarters = with_legs_that_fit(aside, LINE)
    assert len(quarters) == 5
    assert len(compile_flights(aside, quarters)) > 2


@pytest.mark.parametrize("endurance_s", [None, 900.0, 150.0], ids=["no limit", "long enough", "out of reach"])
def test_where_it_is_of_no_use_the_route_stays(endurance_s: float | None) -> None:
    assert with_legs_that_fit(strip(endurance_s), LINE) is LINE
    looks = make_site(
        ring=STRIP,
        home=(200.0, -60.0),
        vehicle={"endurance_s": 325.0},
        sensor=SphereSensor(kind="sphere", range_m=110.0),
    )
    assert with_legs_that_fit(looks, LINE) is LINE
    assert with_legs_that_fit(dataclasses.replace(strip(325.0), home_m=None), LINE) is LINE


def test_what_is_chosen_can_be_flown() -> None:
    site = strip(325.0)
    plan = make_plan(site, rule="coverage>=0.95")
    assert plan.rule_met
    flights = compile_flights(site, plan.chosen.route)
    assert len(flights) >= 2
    assert flights[-1].last == len(plan.chosen.route) - 1

"""No-fly zones on the ways there and home, in the columns above home, in returns and in continued flights."""

import numpy as np
import pytest

from tests.planner.sites import flat, hills, make_site
from tests.planner.test_no_fly import assert_stays_out, circle, ring
from uavcover.errors import InfeasibleError
from uavcover.missions.mission_compiler import compile_continuation, compile_mission, compile_return
from uavcover.missions.sorties import compile_sorties
from uavcover.model.route import Route

BETWEEN = (-50.0, 50.0)
"""Between home at (-100, 50) and the area."""


def route(*points):
    return Route(np.array(points, dtype=float))


LEVEL = route((20, 50, 80), (280, 50, 80), (280, 150, 80))


def compiled(site, planned=LEVEL):
    return compile_mission(site, planned, autopilot="ardupilot")


@pytest.mark.parametrize("ups", [flat, hills])
@pytest.mark.parametrize("radius", [5.0, 25.0])
def test_transits_lead_around_zones(ups, radius):
    site = make_site(ups, no_fly=(circle(*BETWEEN, radius),))
    points = Route(
        np.column_stack([LEVEL.waypoints_m[:, :2], site.ground.ups_m(LEVEL.waypoints_m[:, :2], np.full(3, 80.0))])
    )
    found = compiled(site, points)
    assert_stays_out(site, found.path_m, ups)
    free = compiled(make_site(ups), points)
    assert found.flight_time_s > free.flight_time_s
    assert found.flight_time_s < free.flight_time_s + 30.0
    # The straight return passes through it.
    assert found.return_advice.no_fly == ("no_fly 0",)
    assert found.return_advice.no_fly_waypoints == (0, 1, 2)
    assert found.return_advice.unsafe_waypoints == compiled(make_site(ups), points).return_advice.unsafe_waypoints


@pytest.mark.parametrize("keys", [{"floor_agl_m": 200.0}, {"ceiling_agl_m": 15.0}])
def test_a_zone_above_or_below_changes_nothing(keys):
    site = make_site(no_fly=(circle(*BETWEEN, 25.0, **keys),))
    np.testing.assert_array_equal(compiled(site).path_m, compiled(make_site()).path_m)


def test_transits_pass_below_a_floor_that_they_cannot_go_around():
    over_home = circle(-100, 50, 120.0, floor_agl_m=75.0, name="approach")
    site = make_site(no_fly=(over_home,), vehicle={"takeoff_height_m": 30.0})
    low = route((40, 50, 70), (280, 50, 70))
    assert_stays_out(site, compiled(site, low).path_m, flat)
    walled = make_site(no_fly=(over_home, circle(*BETWEEN, 20.0)), vehicle={"takeoff_height_m": 30.0})
    found = compiled(walled, low)
    assert_stays_out(walled, found.path_m, flat)


def test_the_column_above_home_enters_no_zone():
    site = make_site(
        no_fly=(circle(-100, 50, 30.0, floor_agl_m=35.0, name="heliport"),), vehicle={"takeoff_height_m": 40.0}
    )
    with pytest.raises(
        InfeasibleError, match=r"the climb-out above home climbs 40 m, into no-fly zone 'heliport' \(from 35 m"
    ):
        compiled(site)


def test_a_home_that_is_walled_in_is_refused_with_the_zone():
    moat = [ring((-150, 0), (-50, 0), (-50, 20), (-150, 20)), ring((-150, 80), (-50, 80), (-50, 100), (-150, 100))]
    moat += [
        ring((-170, 0), (-150, 0), (-150, 100), (-170, 100)),
        ring((-60, 0), (-40, 0), (-40, 100), (-60, 100), name="gate"),
    ]
    with pytest.raises(
        InfeasibleError, match=r"the outbound transit: leg to waypoint .* inside no-fly zone 'gate' or its margin"
    ):
        compiled(make_site(no_fly=tuple(moat)))


def test_the_planned_route_is_refused_with_the_zone():
    with pytest.raises(InfeasibleError, match=r"the planned route: leg to waypoint 1: 30\.0 m inside no-fly zone 'x'"):
        compiled(make_site(no_fly=(circle(150, 50, 20.0, name="x"),)))


def test_every_sortie_keeps_out():
    site = make_site(no_fly=(circle(*BETWEEN, 25.0),), vehicle={"endurance_s": 215.0, "reserve_fraction": 0.0})
    many = route(*((20.0 + 260.0 * (k % 2), 10.0 + 45.0 * (k // 2), 80.0) for k in range(8)))
    sorties = compile_sorties(site, many, autopilot="ardupilot")
    assert len(sorties) > 1
    for sortie in sorties:
        assert_stays_out(site, sortie.compiled.path_m, flat)


def geodetic(site, *place):
    lat, lon, alt = site.frame.geodetic_from_enu(np.array([place], dtype=float))
    return {"lat_deg": float(lat[0]), "lon_deg": float(lon[0]), "alt_amsl_m": float(alt[0])}


def path_of(site, mission):
    """Where the items of a mission are, heights above home made up."""
    items = [item for item in mission.items if item.command in (16, 21)]
    home = site.home_m
    return np.vstack(
        [
            [*site.frame.enu_from_geodetic(i.lat_deg, i.lon_deg, mission.home.alt_amsl_m)[0][:2], home[2] + i.alt_m]
            for i in items
        ]
    )


@pytest.mark.parametrize("place", [(60.0, 50.0, 80.0), (-18.0, 50.0, 60.0), (-50.0, 110.0, 40.0)])
def test_returns_and_continued_flights_keep_out(place):
    # The second place is in the margin of the zone, 7 m from it: a vehicle may come there, and has to be let out.
    site = make_site(no_fly=(circle(*BETWEEN, 25.0),))
    way = path_of(site, compile_return(site, **geodetic(site, *place)))
    assert_stays_out(site, np.vstack([place, way[:-1]]), flat, margin_share=0.0)
    if place[0] != -18.0:
        onward = compile_continuation(site, LEVEL, **geodetic(site, *place), flown_s=10.0, autopilot="ardupilot")
        assert_stays_out(site, onward.path_m, flat)


def test_transits_lead_around_the_bay_of_a_fence():
    fence = ((-150, -100), (-80, -100), (-80, 120), (-30, 120), (-30, -100), (400, -100), (400, 300), (-150, 300))
    site = make_site(fence=tuple((float(e), float(n)) for e, n in fence))
    found = compiled(site)
    assert found.path_m[:, 1].max() > 120.0

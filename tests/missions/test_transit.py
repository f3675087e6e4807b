"""No-fly zones on the ways there and home, in columns and returns, and the fence that is uploaded with a mission."""

import dataclasses

import numpy as np
import pytest
import shapely

from mission_io.formats import plan as plan_format
from mission_io.model.items import fence_from_items, items_from_fence
from tests.planner.sites import flat, hills, make_site
from tests.planner.test_no_fly import assert_stays_out, circle, ring
from uavcover.errors import InfeasibleError
from uavcover.missions.flights import compile_sorties
from uavcover.missions.mission_compiler import check_fence, compile_continuation, compile_mission, compile_return
from uavcover.missions.transit import _lattice, fence_of
from uavcover.model.route import Route
from uavcover.planner.command import PlanRequest, plan_into
from uavcover.run.user import Unattended
from uavcover.scenario.airspace.flyable import transit_area

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
    assert {(one.first_leg, one.last_leg) for one in found.return_advice.unsafe if one.danger == "zone"} == {(0, 2)}
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


def geodetic(site, *position):
    lat, lon, alt = site.frame.geodetic_from_enu(np.array([position], dtype=float))
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


@pytest.mark.parametrize("position", [(60.0, 50.0, 80.0), (-18.0, 50.0, 60.0), (-50.0, 110.0, 40.0)])
def test_returns_and_continued_flights_keep_out(position):
    # The second place is in the margin of the zone, 7 m from it: a vehicle may come there, and has to be let out.
    site = make_site(no_fly=(circle(*BETWEEN, 25.0),))
    path = path_of(site, compile_return(site, **geodetic(site, *position)))
    assert_stays_out(site, np.vstack([position, path[:-1]]), flat, margin_fraction=0.0)
    if position[0] != -18.0:
        onward = compile_continuation(site, LEVEL, **geodetic(site, *position), flown_s=10.0, autopilot="ardupilot")
        assert_stays_out(site, onward.path_m, flat)


def test_transits_lead_around_the_bay_of_a_fence():
    fence = ((-150, -100), (-80, -100), (-80, 120), (-30, 120), (-30, -100), (400, -100), (400, 300), (-150, 300))
    site = make_site(fence=tuple((float(e), float(n)) for e, n in fence))
    found = compiled(site)
    assert found.path_m[:, 1].max() > 120.0


PATH = np.array([[-100.0, 50.0, 40.0], [20.0, 50.0, 80.0], [280.0, 150.0, 80.0], [-100.0, 50.0, 40.0]])


def local(site, polygon):
    lat, lon = np.array([(v.lat_deg, v.lon_deg) for v in polygon.vertices]).T
    return shapely.Polygon(site.frame.enu_from_geodetic(lat, lon, site.frame.alt_amsl_m)[:, :2])


def made(*zones, path=PATH, **keys):
    site = make_site(no_fly=zones, **keys)
    return site, fence_of(site, site.frame, path)


def test_without_zones_it_is_one_inclusion():
    _, found = made()
    assert [polygon.inclusion for polygon in found.fence.polygons] == [True]
    assert found.fence.circles == ()


def test_zones_are_exclusions():
    site, found = made(circle(150, -40, 20.0), ring((200, -60), (260, -60), (260, -20)))
    (_, exclusion), (round_one,) = found.fence.polygons, found.fence.circles
    assert not exclusion.inclusion
    assert not round_one.inclusion
    assert round_one.radius_m == 20.0
    assert local(site, exclusion).symmetric_difference(site.zones[1].outline).area < 1e-3
    assert len(found.zones) == 2
    assert found.left_out == ()
    assert fence_from_items(items_from_fence(found.fence)) == found.fence


@pytest.mark.parametrize(
    "zone",
    [
        circle(150, 100, 30.0, floor_agl_m=130.0, name="above"),
        circle(-100, 50, 30.0, floor_agl_m=130.0, name="over home"),
        ring((100, 0), (200, 0), (200, 200), (100, 200), ceiling_agl_m=20.0, name="below"),
        ring((-500, -500), (900, -500), (900, 900), (-500, 900), floor_agl_m=200.0, name="everywhere"),
    ],
)
def test_a_zone_that_the_mission_passes_over_or_under_is_left_out(zone):
    _, found = made(zone)
    assert [one.name for one in found.left_out] == [zone.name]
    assert found.zones == ()
    assert len(found.fence.polygons) == 1
    assert found.fence.circles == ()


def test_a_mission_in_the_hole_of_a_zone_leaves_it_out():
    outline = shapely.box(-400, -300, 600, 500).difference(shapely.box(-200, -100, 400, 300))
    site = make_site()
    zone = made(ring((0, 0), (1, 0), (0, 1)), path=PATH)[0].zones[0]
    site = dataclasses.replace(site, zones=(dataclasses.replace(zone, outline=outline),))
    assert len(fence_of(site, site.frame, PATH).left_out) == 1
    away = PATH + np.array([2000.0, 0.0, 0.0])
    (_, exclusion) = fence_of(site, site.frame, away).fence.polygons
    assert local(site, exclusion).area == pytest.approx(1000 * 800, rel=1e-3)  # filled: nothing flies in the hole


@pytest.mark.parametrize("corners", [200, 1000])
def test_zones_with_many_corners_get_fewer_and_stay_whole(corners):
    rng = np.random.default_rng(corners)
    angles = np.linspace(0.0, 2.0 * np.pi, corners, endpoint=False)
    reach = 60.0 + 0.5 * rng.standard_normal(corners)
    rough = ring(*np.column_stack([150 + reach * np.cos(angles), -80 + reach * np.sin(angles)]))
    site, found = made(rough)
    (_, exclusion) = found.fence.polygons
    assert len(exclusion.vertices) < 100
    simple = local(site, exclusion)
    assert simple.buffer(1e-3).covers(site.zones[0].outline)
    assert site.zones[0].grown(10.0).buffer(1e-3).covers(simple)


def test_a_fence_with_a_hole_excludes_it():
    site = make_site()
    holed = dataclasses.replace(site, fence=site.fence.difference(shapely.box(300, 250, 320, 270)))
    keep_in, hole = fence_of(holed, holed.frame, PATH).fence.polygons
    assert (keep_in.inclusion, hole.inclusion) == (True, False)


def test_compiled_missions_tell_and_plan_files_keep_the_exclusions():
    site = make_site(no_fly=(circle(150, -40, 20.0), circle(150, 100, 30.0, floor_agl_m=130.0, name="above")))
    found = compiled(site, LEVEL)
    assert [zone.name for zone in found.zones_left_out] == ["above"]
    assert [zone.name for zone in found.zones_in_fence] == ["no_fly 0"]
    kept = plan_format.read(plan_format.write(plan_format.PlanFile(found.mission, found.fence, found.rally, 3))).fence
    assert kept == found.fence
    assert [circle.inclusion for circle in kept.circles] == [False]


def many(count, **heights):
    """Small zones in rows north of the area."""
    return [
        ring((x, y), (x + 3, y), (x + 3, y + 3), **heights)
        for x, y in ((400.0 - 5.0 * (k % 40), 330.0 + 5.0 * (k // 40)) for k in range(count))
    ]


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_a_fence_that_is_too_large_is_refused_before_a_search(autopilot):
    large = make_site(no_fly=many(400))
    if autopilot == "px4":
        check_fence(large, autopilot=autopilot)
        return
    with pytest.raises(
        InfeasibleError, match="would reject this fence: the list: 845 items exceed the ArduPilot limit of"
    ):
        check_fence(large, autopilot=autopilot)
    # No mission passes over a zone as high as transits may be.
    with pytest.raises(InfeasibleError, match="would reject this fence"):
        check_fence(make_site(no_fly=many(400, ceiling_agl_m=500.0)), autopilot=autopilot)
    # What a mission may pass over need not be in the fence, and a few zones are no problem.
    check_fence(make_site(no_fly=many(400, ceiling_agl_m=20.0)), autopilot=autopilot)
    check_fence(make_site(no_fly=many(20)), autopilot=autopilot)
    check_fence(make_site(no_fly=many(400), on_earth=False, home=None), autopilot=autopilot)


def test_plan_refuses_the_fence_of_a_single_vehicle_before_it_searches(tmp_path, monkeypatch):
    """Only vehicles that differ were asked, so that a usual plan was searched for first."""
    monkeypatch.setattr("uavcover.planner.command.plan_and_site", lambda *_args, **_keys: pytest.fail("searched"))
    request = PlanRequest(scenario=make_site(no_fly=many(400)), folder=tmp_path / "run", command=(), force=False)
    with pytest.raises(InfeasibleError, match="would reject this fence"):
        plan_into(request, Unattended(), check_site=lambda _: None)
    assert not (tmp_path / "run" / "plan.json").exists()


def test_no_geometry_that_threads_share_is_prepared_for_lines(monkeypatch):
    """GEOS writes to a prepared geometry while it tests lines against it: two threads that judged routes crashed plan."""
    site, prepare, seen = make_site(hills), shapely.prepare, []
    monkeypatch.setattr(shapely, "prepare", lambda geometry: (seen.append(geometry), prepare(geometry))[1])
    points = Route(
        np.column_stack([LEVEL.waypoints_m[:, :2], site.ground.ups_m(LEVEL.waypoints_m[:, :2], np.full(3, 80.0))])
    )
    assert compiled(site, points).return_advice is not None
    assert len(_lattice(site).links)
    assert len(seen) >= 2
    assert not any(geometry is shared for geometry in seen for shared in (site.fence, transit_area(site)))

"""The uploaded fence: one keep-in polygon, its holes, and no-fly zones as exclusions where the mission does not pass them."""

import dataclasses

import numpy as np
import pytest
import shapely

from mission_io.formats import plan as plan_format
from mission_io.model.items import fence_from_items, items_from_fence
from tests.missions.test_no_fly_transits import LEVEL, compiled
from tests.planner.sites import make_site
from tests.planner.test_no_fly import circle, ring
from uavcover.errors import InfeasibleError
from uavcover.missions.mission_compiler import check_fence
from uavcover.missions.transit import fence_of
from uavcover.planner.command import PlanRequest, plan_into
from uavcover.run.user import Unattended

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

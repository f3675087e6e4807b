"""No-fly zones in planning: whatever the search does, no leg enters, and what cannot be reached is told."""

import itertools
import math

import numpy as np
import pytest
import shapely

from tests.naive.zones import enters
from tests.planner.sites import flat, hills, make_site, ridge, tower
from tests.planner.test_planner import make_plan
from uavcover.errors import InfeasibleError
from uavcover.kernels.search_problem import crosses_edge, flyable_ground, is_inside
from uavcover.missions.leg_checks import find_problems, find_waypoint_problems, measure_violations
from uavcover.model.limits import NoFly, Obstacles
from uavcover.model.sensor import NadirCamera
from uavcover.planner.baselines.boustrophedon import fly_layout, plain_boustrophedon
from uavcover.planner.gap_route import plan_gap_route
from uavcover.planner.terrain_following import lay_over_terrain
from uavcover.scenario.airspace.flyable import flyable_area
from uavcover.sensing.coverage_map import CoverageMap

AREA = ((0.0, 0.0), (300.0, 0.0), (300.0, 300.0), (0.0, 300.0))
"""Of the plans here; home is at (-100, 50)."""
NARROW = NadirCamera(kind="nadir-camera", fov_deg=30.0, range_m=200.0)


def circle(east, north, radius, **keys):
    return NoFly(center_east_north_m=(east, north), radius_m=radius, **keys)


def ring(*corners, **keys):
    return NoFly(polygon_east_north_m=tuple((float(e), float(n)) for e, n in corners), **keys)


def site_with(*zones, ups=flat, **keys):
    return make_site(ups, ring=AREA, no_fly=zones, cell_m=15.0, **keys)


def assert_stays_out(site, points, ups, *, margin_fraction=0.999):
    offset = site.alt_amsl_offset_m
    for zone in site.zones:
        for p, q in itertools.pairwise(points):
            inside = enters(
                zone, ups, p, q, alt_offset_m=offset, samples=200, margin_m=margin_fraction * zone.entry.margin_m,
                height_margin_m=0.0,
            )  # fmt: skip
            assert not inside, (zone.name, p, q)


# The kernels' flyable ground


def test_places_and_lines_on_flyable_ground_are_as_shapely_says():
    rng = np.random.default_rng(7)
    found = []
    for number in range(20):
        outer = shapely.box(0, 0, 100, 100).difference(shapely.box(60, 60, 100, 100))
        holes = [
            shapely.Point(rng.uniform(5, 95, 2)).buffer(rng.uniform(2, 25), quad_segs=3 if number % 2 else 40)
            for _ in range(rng.integers(0, 4))
        ]
        region = outer.difference(shapely.union_all(holes))
        region = max(shapely.get_parts(region), key=lambda part: part.area)
        ground = flyable_ground(region)
        for p, q in rng.uniform(-10, 110, (60, 2, 2)):
            assert is_inside(ground, *p) == bool(shapely.contains_xy(region, *p))
            found.append(bool(shapely.LineString([p, q]).crosses(region.boundary)))
            assert crosses_edge(ground, (*p, 0.0), (*q, -500.0)) == found[-1]
    assert not is_inside(flyable_ground(shapely.Polygon()), 0.5, 0.5)
    assert 50 < sum(found) < len(found) - 50


# Where the route may be


def test_without_zones_the_fence_is_flyable():
    site = site_with()
    assert flyable_area(site).polygon is site.fence


@pytest.mark.parametrize(
    ("keys", "closed"),
    [
        ({}, True),
        ({"floor_agl_m": 120.0}, False),  # the band is 40 to 120 m
        ({"floor_agl_m": 119.0}, True),
        ({"ceiling_agl_m": 40.0}, False),
        ({"ceiling_agl_m": 41.0}, True),
        ({"floor_agl_m": 500.0, "ceiling_agl_m": 900.0}, False),
        ({"floor_amsl_m": 2000.0}, False),
        ({"floor_agl_m": 125.0, "floor_amsl_m": 0.0}, True),
    ],
)
def test_only_zones_that_meet_the_band_close_it(keys, closed):
    site = site_with(circle(150, 150, 50, **keys))
    area = flyable_area(site)
    assert bool(area.closed) == closed
    assert area.polygon.contains(shapely.Point(150, 150)) != closed


def test_a_zone_partly_in_the_band_says_so():
    assert [
        zone.entry.floor_agl_m for zone in flyable_area(site_with(circle(150, 150, 50, floor_agl_m=60.0))).partly
    ] == [60.0]
    assert flyable_area(site_with(circle(150, 150, 50))).partly == ()


def test_what_a_zone_cuts_off_from_home_is_not_flyable():
    wall = ring((140, -900), (160, -900), (160, 900), (140, 900))
    area = flyable_area(site_with(wall))
    assert area.cut_off
    assert area.polygon.bounds[2] < 140.0
    # Transits pass below this one, so the larger piece counts, wherever home is.
    low = flyable_area(site_with(ring((40, -900), (60, -900), (60, 900), (40, 900), floor_agl_m=60.0)))
    assert low.polygon.bounds[0] > 60.0


def test_a_zone_over_everything_leaves_nothing():
    site = make_site(ring=AREA, no_fly=(circle(150, 150, 2000, floor_agl_m=30.0),), cell_m=15.0)
    assert flyable_area(site).polygon.is_empty
    assert not CoverageMap(site, cell_size_m=15.0).coverable.any()


# Routes


@pytest.mark.parametrize("ups", [flat, hills])
def test_lines_are_laid_around_zones(ups):
    site = site_with(circle(150, 100, 60), ring((100, 180), (220, 190), (160, 280)), ups=ups)
    line = np.array([(0.0, 100.0), (300.0, 100.0), (150.0, 100.0), (150.0, 220.0), (300.0, 220.0), (0.0, 220.0)])
    points = lay_over_terrain(site, line, np.full(len(line), 80.0), tolerance_m=5.0)
    assert measure_violations(site, points, margin_m=0.0).no_fly_m == 0.0
    assert_stays_out(site, points, ups)


def test_lines_are_laid_around_the_bays_of_a_fence():
    bay = ((-150, -150), (450, -150), (450, 450), (200, 450), (200, 100), (100, 100), (100, 450), (-150, 450))
    site = make_site(ring=AREA, fence=tuple((float(e), float(n)) for e, n in bay), cell_m=15.0)
    line = np.array([(20.0, 250.0), (280.0, 250.0), (20.0, 280.0)])
    points = lay_over_terrain(site, line, np.full(3, 80.0), tolerance_m=5.0)
    assert measure_violations(site, points, margin_m=0.0).fence_m == 0.0


def test_a_line_whose_corners_all_move_to_one_place_is_one_waypoint():
    """Its memory was not written: a plan beside a cliff ended with "entry (9, 2) is nan" (tests/random_kinds.py, case 78)."""
    fence = ((0.0, 0.0), (300.0, 0.0), (300.0, 40.0), (40.0, 40.0), (40.0, 300.0), (0.0, 300.0))
    site = make_site(ring=AREA, fence=fence, cell_m=15.0)
    beside_a_tower = make_site(
        ring=AREA,
        fence=fence,
        cell_m=15.0,
        obstacles=Obstacles(prisms=(tower(100.0, 10.0, 110.0, 20.0, 300.0, name="tower"),)),
    )
    beyond_a_corner = np.array([(-500.0, -500.0), (-400.0, -600.0)])
    for each in (site, beside_a_tower):
        points = lay_over_terrain(each, beyond_a_corner, np.full(2, 80.0), tolerance_m=5.0)
        assert points == pytest.approx(np.array([[0.0, 0.0, 80.0]]), abs=0.05)
        assert measure_violations(each, points, margin_m=0.0).total == 0.0


def test_leg_problems_name_the_zone():
    site = site_with(circle(150, 100, 60, name="airport"))
    points = np.array([(0.0, 100.0, 80.0), (300.0, 100.0, 80.0)])
    (problem,) = find_problems(site, points, lowest_agl_m=40.0, highest_agl_m=120.0)
    assert problem.kind == "no-fly zone"
    assert str(problem) == (
        "leg to waypoint 1: 70.0 m inside no-fly zone 'airport' or its margin at 150 m east, 100 m north"
    )
    (alone,) = find_waypoint_problems(site, np.array([(150.0, 100.0, 80.0)]), lowest_agl_m=40.0, highest_agl_m=120.0)
    assert alone.value == pytest.approx(70.0)
    assert measure_violations(site, points, margin_m=0.0).total == pytest.approx(70.0, abs=0.01)


def random_zones(rng):
    zones = []
    for _ in range(rng.integers(1, 4)):
        middle = rng.uniform(-20.0, 320.0, 2)
        keys = {"margin_m": float(rng.choice([0.0, 5.0, 10.0]))}
        if rng.random() < 0.4:
            keys["floor_agl_m"] = float(rng.uniform(20.0, 140.0))
        if rng.random() < 0.3:
            keys["ceiling_agl_m"] = keys.get("floor_agl_m", 0.0) + float(rng.uniform(10.0, 100.0))
        if rng.random() < 0.5:
            zones.append(circle(*map(float, middle), float(rng.uniform(10.0, 80.0)), **keys))
        else:
            angles = np.sort(rng.uniform(0.0, 2.0 * math.pi, 7))
            corners = middle + rng.uniform(10.0, 110.0, 7)[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
            shape = shapely.Polygon(corners)
            shape = shape if shape.is_valid else shape.convex_hull
            zones.append(ring(*np.asarray(shape.exterior.coords)[:-1], **keys))
    return [zone for zone in zones if site_with(zone).zones == () or _home_is_out(zone)]


def _home_is_out(zone):
    (local,) = site_with(zone).zones
    return local.grown(zone.margin_m + 1.0).distance(shapely.Point(-100.0, 50.0)) > 0.0


@pytest.mark.parametrize("ups", [flat, ridge(150.0, 30.0)])
@pytest.mark.parametrize("seed", range(5))
def test_no_leg_of_a_plan_enters_a_zone(seed, ups):
    zones = random_zones(np.random.default_rng(seed))
    algorithm = ["memetic", "local-search", "imodbo"][seed % 3]
    site = make_site(
        ups,
        ring=AREA,
        no_fly=tuple(zones),
        cell_m=15.0,
        limits={"height_margin_m": 4.0},
        planner={"algorithm": algorithm},
    )
    assert CoverageMap(site, cell_size_m=15.0).coverable.mean() > 0.2
    plan = make_plan(site, rule="max-coverage")
    for member in plan.members:
        assert measure_violations(site, member.route.waypoints_m, margin_m=4.0).total == 0.0
        assert_stays_out(site, member.route.waypoints_m, ups)


def test_ground_in_a_zone_is_seen_from_outside():
    site = site_with(circle(150, 150, 20, margin_m=0.0))
    plan = make_plan(site, rule="max-coverage", evaluations=300)
    assert max(member.metrics.coverage_fraction for member in plan.members) > 0.9


def test_a_zone_over_everything_is_one_line():
    site = site_with(circle(150, 150, 2000, floor_agl_m=30.0))
    with pytest.raises(InfeasibleError) as error:
        make_plan(site)
    assert "\n" not in str(error.value)
    assert "no-fly zone" in str(error.value)


def coverable(coverage):
    assert 0.5 < coverage.fraction(coverage.coverable) <= 1.0
    return coverage.coverable.copy()


def test_gap_routes_keep_out_of_zones():
    site = site_with(circle(150, 150, 40))
    coverage = CoverageMap(site, cell_size_m=15.0)
    found = plan_gap_route(coverage, coverable(coverage), start_m=site.home_m, end_m=site.home_m)
    assert measure_violations(site, found.route.waypoints_m, margin_m=0.0).no_fly_m == 0.0
    assert_stays_out(site, found.route.waypoints_m, flat)


def test_lines_around_a_small_zone_see_what_they_see_without_it():
    """A zone in a hole of the area: lines that left their places for the shortest way round saw 4 % less, for 70 % more time."""
    hole = ((100.0, 90.0), (200.0, 90.0), (200.0, 210.0), (100.0, 210.0))
    keys = {"ring": AREA, "holes": (hole,), "cell_m": 10.0, "sensor": NARROW}
    free, closed = make_site(**keys), make_site(no_fly=(circle(150.0, 150.0, 35.0),), **keys)
    observed = []
    for site in (free, closed):
        route = fly_layout(site, plain_boustrophedon(site))
        coverage = CoverageMap(site, cell_size_m=5.0)
        observed.append(coverage.fraction_of_coverable(coverage.observed(route.waypoints_m)))
    assert_stays_out(closed, route.waypoints_m, flat)
    assert observed[1] >= observed[0] - 0.01

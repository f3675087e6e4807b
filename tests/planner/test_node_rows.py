"""Rows of nodes for sensors that look from waypoints."""

import dataclasses
import math

import numpy as np
import pytest
import shapely

from tests.planner.sites import flat, hills, make_site
from uavcover.missions.leg_checks import measure_violations
from uavcover.model.scenario import PlannerSettings
from uavcover.model.sensor import DiscSensor, FrameCamera, NadirCamera, Sensor, SphereSensor
from uavcover.planner.baselines.boustrophedon import best_height_agl_m
from uavcover.planner.baselines.initial_routes import (
    NODE_LINES,
    NodeRows,
    constructed_routes,
    fly_rows,
    node_lines,
    plain_rows,
    scanned_rows,
)
from uavcover.planner.planner import Effort, plan_routes
from uavcover.scenario.site import load_site
from uavcover.sensing.coverage_map import CoverageMap

LARGE = ((0.0, 0.0), (900.0, 0.0), (900.0, 700.0), (0.0, 700.0))
DISC = DiscSensor(kind="disc", radius_m=50.0, sensing="at-waypoints")


def test_back_and_forth_in_the_middle_of_equal_boxes() -> None:
    site = make_site(flat, sensor=DISC, limits={"applies_to": "waypoints"})
    points = fly_rows(site, NodeRows(2, 3, 0.0, 0.5)).waypoints_m
    positions = [(50, 50), (150, 50), (250, 50), (250, 150), (150, 150), (50, 150)]
    assert points[:, :2] == pytest.approx(np.array(positions, dtype=float))
    assert points[:, 2] == pytest.approx(80.0)


def test_every_other_row_is_shifted_by_half_a_distance() -> None:
    site = make_site(flat, sensor=DISC, limits={"applies_to": "waypoints"})
    points = fly_rows(site, NodeRows(2, 3, 0.5, 0.0)).waypoints_m
    first, second = np.sort(points[:3, 0]), np.sort(points[3:, 0])
    assert first == pytest.approx([25.0, 125.0, 225.0])
    assert second - first == pytest.approx(50.0)


def test_the_plain_one_sees_all_of_flat_ground() -> None:
    site = make_site(flat, sensor=DISC, limits={"applies_to": "waypoints"})
    coverage = CoverageMap(site, cell_size_m=5.0)
    layout = plain_rows(site)
    assert (layout.rows, layout.columns) == (3, 5)
    assert coverage.fraction(coverage.observed(fly_rows(site, layout).waypoints_m)) == 1.0


@pytest.mark.parametrize("applies_to", ["legs", "waypoints"])
def test_nodes_keep_the_height_band(applies_to: str) -> None:
    sensor = SphereSensor(kind="sphere", range_m=150.0)
    site = make_site(hills, sensor=sensor, limits={"applies_to": applies_to, "max_climb_angle_deg": 60.0})
    for layout in (NodeRows(3, 4, 0.5, 0.0), NodeRows(4, 3, 0.0, 1.0)):
        route = fly_rows(site, layout)
        assert len(route) >= 12
        assert measure_violations(site, route.waypoints_m, margin_m=0.0).total == 0.0


def test_rows_are_a_named_beginning_of_free_waypoints() -> None:
    site = load_site("paper-planar")
    settings = dataclasses.replace(
        site.scenario.planner, algorithm="imodbo", initial=("boustrophedon",), evaluations=100, max_waypoints=20
    )
    plan = plan_routes(site, settings=settings, select_rule="max-coverage", effort=Effort(100, None, lambda: 0.0))
    assert len(plan.baselines[0].route) == len(fly_rows(site, plain_rows(site))) == 64
    tuned = [one for one in plan.baselines if one.origin == "boustrophedon-tuned"]
    assert max(len(one.route) for one in tuned) <= 20
    # Rows that are known at the start: the optimizer's own routes see no less.
    assert plan.chosen.metrics.coverage_of_coverable >= max(one.metrics.coverage_of_coverable for one in tuned)


def test_the_scan_is_of_sensible_lattices_each_once() -> None:
    site = load_site("paper-planar")
    layouts = list(scanned_rows(site, most_nodes=40))
    assert len(set(layouts)) == len(layouts)
    assert max(one.rows * one.columns for one in layouts) == 40
    assert {(one.rows, one.columns) for one in layouts} >= {(1, 1), (1, 2), (6, 6), (5, 8)}
    assert not [one for one in layouts if one.columns > 2 * one.rows or one.rows > 2 * one.columns]


def photos(**pose: float) -> FrameCamera:
    return FrameCamera(
        kind="frame-camera", fov_across_deg=70.0, fov_along_deg=50.0, range_m=300.0, sensing="at-waypoints",
        mount="stabilised", **pose,
    )  # fmt: skip


@pytest.mark.parametrize(
    "sensor",
    [photos(heading_deg=0.0), photos(heading_deg=300.0), photos(heading_deg=30.0, pitch_deg=-75.0), DISC],
)
def test_lines_of_nodes_see_flat_ground_first_all_then_ever_less(sensor: Sensor) -> None:
    site = make_site(flat, sensor=sensor, ring=LARGE)
    coverage = CoverageMap(site, cell_size_m=10.0)
    fractions = np.array([coverage.fraction(coverage.observed(route.waypoints_m)) for route in node_lines(site)])
    # A tilted camera's photo is narrower near its lower side.
    assert fractions[0] >= (0.99 if not isinstance(sensor, FrameCamera) or sensor.pitch_deg == -90.0 else 0.93)
    assert 0.4 < fractions[-1] < 0.9 * fractions[0]


def test_lines_of_photos_are_as_far_apart_as_a_photo_is_wide() -> None:
    site = make_site(flat, sensor=photos(heading_deg=0.0))
    height_m = best_height_agl_m(site)
    width_m, length_m = (2.0 * height_m * math.tan(math.radians(half)) for half in (35.0, 25.0))
    fewest = math.ceil(300.0 / width_m), math.ceil(200.0 / length_m)
    east, north = next(iter(node_lines(site))).waypoints_m[:, :2].T
    assert (len(np.unique(east.round(3))), len(np.unique(north.round(3)))) == fewest


def test_nodes_are_where_the_area_is() -> None:
    hole = ((60.0, 40.0), (240.0, 40.0), (240.0, 160.0), (60.0, 160.0))
    site = make_site(flat, sensor=DiscSensor(kind="disc", radius_m=15.0, sensing="at-waypoints"), holes=(hole,))
    inside = shapely.Polygon(hole).buffer(-25.0)
    for route in node_lines(site):
        assert not shapely.contains_xy(inside, route.waypoints_m[:, :2]).any()


def test_a_search_begins_with_lines_of_nodes_only_where_photos_are_taken_at_waypoints_of_a_path() -> None:
    settings = PlannerSettings(algorithm="memetic")
    for sensor, applies_to, expected in (
        (photos(heading_deg=0.0), "legs", True),
        (photos(heading_deg=0.0), "waypoints", False),
        (NadirCamera(kind="nadir-camera", fov_deg=70.0, range_m=200.0), "legs", False),
    ):
        site = make_site(flat, sensor=sensor, limits={"applies_to": applies_to})
        coverage = CoverageMap(site, cell_size_m=20.0)
        found = constructed_routes(coverage, settings, required=0.9, executor=None, left_s=lambda: math.inf)
        assert (NODE_LINES in {each.name for each in found}) is expected


def test_without_time_there_is_one_route_of_nodes() -> None:
    site = make_site(flat, sensor=photos(heading_deg=0.0))
    coverage = CoverageMap(site, cell_size_m=20.0)
    found = constructed_routes(coverage, PlannerSettings(), required=0.9, executor=None, left_s=lambda: 0.0)
    assert [each.name for each in found].count(NODE_LINES) == 1


def test_a_cover_of_what_is_asked_follows_the_cover_of_all() -> None:
    site = make_site(flat, sensor=photos(heading_deg=0.0), ring=LARGE)
    coverage = CoverageMap(site, cell_size_m=25.0)
    found = constructed_routes(coverage, PlannerSettings(), required=0.8, executor=None, left_s=lambda: math.inf)
    whole, some = (each for each in found if each.name == "set-cover")
    assert len(some.route) < len(whole.route)
    assert 0.8 <= -some.objectives[0] / coverage.fraction(coverage.coverable) < 0.95


@pytest.mark.parametrize(("sensor", "apart_m"), [(photos(heading_deg=0.0), 20.0), (DISC, 20.0), (DISC, 60.0)])
def test_where_several_looks_are_required_nodes_are_closer_together(sensor: Sensor, apart_m: float) -> None:
    once = make_site(flat, sensor=sensor, ring=LARGE)
    twice = make_site(flat, sensor=sensor, ring=LARGE, requirements={"looks": 2, "look_distance_m": apart_m})
    observes_all, least = next(iter(node_lines(once))), next(iter(node_lines(twice)))
    coverage = CoverageMap(twice, cell_size_m=10.0)
    assert coverage.fraction(coverage.observed(observes_all.waypoints_m)) < 0.7
    # Nodes of neighbouring lines that are nearer than two looks have to be count as one.
    assert coverage.fraction(coverage.observed(least.waypoints_m)) > (0.9 if apart_m < 30.0 else 0.78)
    assert len(least) < 2.3 * len(observes_all)

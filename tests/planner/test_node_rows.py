"""Rows of nodes for sensors that look from waypoints."""

import dataclasses

import numpy as np
import pytest

from tests.planner.sites import flat, hills, make_site
from uavcover.missions.leg_checks import measure_violations
from uavcover.model.sensor import DiscSensor, SphereSensor
from uavcover.planner.baselines.initial_routes import NodeRows, fly_rows, plain_rows, scanned_rows
from uavcover.planner.planner import Effort, plan_routes
from uavcover.scenario.site import load_site
from uavcover.sensing.coverage_map import CoverageMap

DISC = DiscSensor(kind="disc", radius_m=50.0, sensing="at-waypoints")


def test_back_and_forth_in_the_middle_of_equal_boxes() -> None:
    site = make_site(flat, sensor=DISC, limits={"applies_to": "waypoints"})
    points = fly_rows(site, NodeRows(2, 3, 0.0, 0.5)).waypoints_m
    places = [(50, 50), (150, 50), (250, 50), (250, 150), (150, 150), (50, 150)]
    assert points[:, :2] == pytest.approx(np.array(places, dtype=float))
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
    assert coverage.share(coverage.seen(fly_rows(site, layout).waypoints_m)) == 1.0


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

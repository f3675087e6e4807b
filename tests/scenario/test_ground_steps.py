"""Steps of the ground: what they part, against places on a known side, a search from node to node, and plans."""

import dataclasses
import math
from collections import deque

import numpy as np
import pytest
import shapely

from tests.planner.sites import STEP_M, hills, make_site
from tests.planner.test_planner import make_plan
from uavcover.missions.leg_checks import measure_violations
from uavcover.planner.plan_messages import print_steps
from uavcover.run.user import Unattended
from uavcover.scenario.airspace.flyable import flyable_area, least_width_m, parts_between_steps
from uavcover.terrain.ground import sine_cosine_ground

REGION = shapely.box(-200.0, -150.0, 400.0, 350.0)
LEVEL = math.tan(math.radians(30.0))
AREA = ((0.0, 0.0), (300.0, 0.0), (300.0, 300.0), (0.0, 300.0))


def cliff(height_m, at_north=lambda east: 120.0 + 20.0 * np.sin(east / 40.0)):
    return lambda east, north: np.where(north > at_north(east), height_m, 0.0) + 0.02 * east


def crater(depth_m, radius_m=90.0):
    return lambda east, north: np.where(np.hypot(east - 150.0, north - 150.0) < radius_m, -depth_m, 0.0)


def parts_of(ups, *, width_m=60.0, region=REGION):
    return parts_between_steps(make_site(ups).ground, region, width_m=width_m, slope=LEVEL)


def test_a_cliff_parts_the_ground_along_its_edge():
    lower, upper = sorted(parts_of(cliff(90.0)), key=lambda part: part.centroid.y)
    for east in np.arange(-190.0, 400.0, 7.0):
        edge_m = 120.0 + 20.0 * math.sin(east / 40.0)
        # The slope is between two nodes: the edge is at most one distance between them away, and two of those are kept.
        assert lower.contains(shapely.Point(east, edge_m - 3.5 * STEP_M))
        assert upper.contains(shapely.Point(east, edge_m + 3.5 * STEP_M))
        assert not lower.contains(shapely.Point(east, edge_m + STEP_M))
        assert not upper.contains(shapely.Point(east, edge_m - STEP_M))


@pytest.mark.parametrize(
    ("ups", "count"),
    [
        (hills, 0),
        (cliff(60.0 + LEVEL * STEP_M - 0.5), 0),  # with the climb from one node to the next a leg gets over it
        (cliff(60.0 + LEVEL * STEP_M + 0.5), 2),
        (crater(90.0), 2),
        # A ramp leads up, and a needle can be flown around.
        (lambda east, north: cliff(90.0)(east, north) * np.clip((east + 50.0) / 300.0, 0.0, 1.0), 0),
        (lambda east, north: np.where(np.hypot(east - 100.0, north - 100.0) < 12.0, 200.0, 0.0), 0),
    ],
)
def test_only_what_parts_the_ground_counts(ups, count):
    assert len(parts_of(ups)) == count


def test_the_wall_of_a_crater_is_a_hole_and_its_floor_a_part():
    floor, around = sorted(parts_of(crater(90.0)), key=lambda part: part.area)
    assert floor.contains(shapely.Point(150.0, 150.0))
    assert len(around.interiors) == 1
    assert shapely.Polygon(around.interiors[0]).contains(floor)


def test_a_formula_has_no_steps():
    assert parts_between_steps(sine_cosine_ground(20.0), REGION, width_m=0.1, slope=0.0) == []


def test_the_width_that_is_enough_is_that_of_the_step():
    """Between nodes of different rows the ground rises by 90 m, and a leg by ten times the slope."""
    ground = make_site(cliff(90.0, lambda _: 123.0)).ground
    parts = parts_between_steps(ground, REGION, width_m=50.0, slope=LEVEL)
    found_m = least_width_m(ground, REGION, parts, width_m=50.0, slope=LEVEL)
    assert found_m == pytest.approx(90.0 - LEVEL * STEP_M, abs=0.1)
    assert parts_between_steps(ground, REGION, width_m=found_m, slope=LEVEL) == []


@pytest.mark.parametrize("seed", range(6))
def test_parts_are_those_of_a_search_from_node_to_node(seed):
    """A slow twin: from node to node, over every rise that is no step, all of one part is reached and nothing else."""
    heights = 90.0 * np.random.default_rng(seed).integers(0, 2, (6, 6)).repeat(10, axis=0).repeat(10, axis=1)

    def ups(east, north):
        column, row = ((each + 200.0) / STEP_M for each in (east, north))
        inside = np.clip(np.round(column), 0, 59).astype(int), np.clip(np.round(row), 0, 59).astype(int)
        return heights[inside[1], inside[0]] + 0.0 * east

    axis = np.arange(-200.0, 391.0, STEP_M)
    up = ups(*np.meshgrid(axis, axis))
    parts = parts_of(ups, width_m=60.0, region=shapely.box(-200.0, -200.0, 390.0, 390.0))
    nodes = [shapely.contains_xy(part, *np.meshgrid(axis, axis)) for part in parts]
    left, count = np.ones(up.shape, dtype=bool), 0
    while left.any():
        reached = _reached(up, tuple(np.argwhere(left)[0]), 60.0 + LEVEL * STEP_M)
        (part,) = (inside for inside in nodes if (inside & reached).any())
        assert not (part & ~reached).any()
        left &= ~reached
        count += 1
    assert count == len(parts) > 1


def _reached(up, start, most_m):
    reached, queue = np.zeros(up.shape, dtype=bool), deque([start])
    reached[start] = True
    while queue:
        row, column = queue.popleft()
        for r, c in ((row + 1, column), (row - 1, column), (row, column + 1), (row, column - 1)):
            inside = 0 <= r < up.shape[0] and 0 <= c < up.shape[1]
            if inside and not reached[r, c] and abs(up[r, c] - up[row, column]) <= most_m:
                reached[r, c] = True
                queue.append((r, c))
    return reached


# What it is for


def test_a_route_stays_on_one_side_of_a_cliff():
    """All lines over the whole area cross it: no route kept the limits."""
    site = make_site(cliff(110.0), ring=AREA, cell_m=15.0, limits={"max_height_agl_m": 90.0})
    plan = make_plan(site, rule="coverage>=0.9")
    assert plan.rule_met
    points = plan.chosen.route.waypoints_m
    assert measure_violations(site, points, margin_m=0.0).total == 0.0
    assert flyable_area(site).polygon.contains(shapely.LineString(points[:, :2]))
    words = Words()
    print_steps(words, site)
    (warning,) = words.warnings
    assert "% of the area is next to or behind them" in warning
    enough_m = float(warning.split("max_height_agl_m to at least ")[1].split()[0].rstrip(",;"))
    assert enough_m == pytest.approx(40.0 + 110.0 - LEVEL * STEP_M, abs=2.0)
    wider = make_site(cliff(110.0), ring=AREA, cell_m=15.0, limits={"max_height_agl_m": enough_m})
    assert flyable_area(wider).polygon is wider.fence
    print_steps(words, wider)
    assert len(words.warnings) == 1


def test_a_step_outside_of_the_area_is_not_spoken_of():
    """It was said of 0.00 % of the area."""
    fence = ((-150.0, -50.0), (350.0, -50.0), (350.0, 450.0), (-150.0, 450.0))
    limits = {"max_height_agl_m": 90.0}
    site = make_site(cliff(110.0, lambda _: 350.0), ring=AREA, cell_m=15.0, limits=limits, fence=fence)
    assert flyable_area(site).polygon.bounds[3] < 350.0
    assert flyable_area(site).polygon.contains(site.area)
    words = Words()
    print_steps(words, site)
    assert words.warnings == []


def test_the_side_that_transits_reach_is_flown():
    """Behind a wall that not even transits get over there is more of the area; home is on this side."""
    site = make_site(
        cliff(300.0, lambda _: 110.0), ring=AREA, limits={"max_height_agl_m": 90.0, "max_transit_height_agl_m": 150.0}
    )
    assert flyable_area(site).polygon.bounds[3] < 110.0
    # Over a lower one transits do.
    low = make_site(
        cliff(110.0, lambda _: 110.0), ring=AREA, limits={"max_height_agl_m": 90.0, "max_transit_height_agl_m": 400.0}
    )
    assert flyable_area(low).polygon.bounds[1] > 110.0


def test_a_part_of_the_area_is_flown_on_the_side_of_the_whole():
    """A slice of a large area that lies behind the cliff would be flown there by itself."""
    site = make_site(cliff(110.0, lambda _: 110.0), ring=AREA, limits={"max_height_agl_m": 90.0})
    part = dataclasses.replace(site, area=shapely.box(0.0, 0.0, 300.0, 60.0))
    assert flyable_area(part).polygon.bounds[3] < 110.0
    assert flyable_area(dataclasses.replace(part, whole=site)).polygon.equals(flyable_area(site).polygon)


def test_where_only_waypoints_are_held_to_the_limits_steps_part_nothing():
    site = make_site(cliff(110.0), ring=AREA, limits={"max_height_agl_m": 90.0, "applies_to": "waypoints"})
    assert flyable_area(site).polygon is site.fence


class Words(Unattended):
    """Keeps what is said."""

    def __init__(self):
        self.warnings = []

    def warn(self, text):
        self.warnings.append(text)

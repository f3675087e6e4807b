import dataclasses
import itertools
import math

import numpy as np
import pytest
import shapely

from tests.planner.sites import hills, make_site
from uavcover.extras.large_areas.plan_by_parts import Slice, sliced, tasks_of
from uavcover.kernels.route import path_length
from uavcover.missions.leg_checks import measure_violations
from uavcover.planner.baselines.adaptive_swaths import TIGHT, bend_lines, fly_tight, tight_layouts
from uavcover.planner.baselines.boustrophedon import long_side_angle_rad
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap

GOAL = 0.98
TILT_RAD = math.radians(20.0)


def ring(*corners: tuple[float, float]) -> tuple[tuple[float, float], ...]:
    """Corners turned by 20° about the middle of a rectangle of 1200 m x 900 m, which comes to the middle of the ground."""
    c, s = math.cos(TILT_RAD), math.sin(TILT_RAD)
    moved = [(x - 600.0, y - 450.0) for x, y in corners]
    return tuple((200.0 + c * x - s * y, 200.0 + s * x + c * y) for x, y in moved)


RECTANGLE = ring((0.0, 0.0), (1200.0, 0.0), (1200.0, 900.0), (0.0, 900.0))


def coarse(site: Site) -> CoverageMap:
    return CoverageMap(site, cell_size_m=30.0)


@pytest.fixture(scope="module")
def site() -> Site:
    return make_site(hills, ring=RECTANGLE, home=None)


@pytest.fixture(scope="module")
def slices(site: Site) -> list[Slice]:
    return sliced(site, coarse(site), GOAL, 3)


def whole_routes(site: Site) -> list[np.ndarray]:
    """All that slices can be cut from."""
    first = long_side_angle_rad(site.area)
    paths = itertools.product((first, first + 0.5 * math.pi), (1 / 32, *TIGHT), (-1, 0, 1))
    layouts = [
        layout for angle, fraction, more in paths for layout in tight_layouts(site, angle, fraction=fraction, more=more)
    ]
    return [fly_tight(site, layout, bend_lines(site, layout)).waypoints_m for layout in layouts]


def test_one_behind_the_other_they_are_a_route_over_the_whole_area(site: Site, slices: list[Slice]) -> None:
    together = np.vstack([each.begin_m for each in slices])
    # Links between lines have waypoints where the terrain asks for them.
    lengths = [float(path_length(np.ascontiguousarray(route))) for route in whole_routes(site)]
    assert float(path_length(together)) == pytest.approx(
        min(lengths, key=lambda m: abs(m - path_length(together))), rel=2e-3
    )
    ends = [(one.begin_m[-1], other.begin_m[0]) for one, other in itertools.pairwise(slices)]
    assert max(math.dist(*pair) for pair in ends) < 0.25 * math.sqrt(site.area.area)


def test_they_see_about_what_is_asked_for_and_keep_the_limits(site: Site, slices: list[Slice]) -> None:
    cells = coarse(site)
    observed = np.logical_or.reduce([cells.observed(each.begin_m) for each in slices])
    assert cells.fraction_of_coverable(observed) > GOAL - 0.04  # what they miss has a price, as have lines
    for each in slices:
        assert measure_violations(site, each.begin_m, margin_m=0.0).total == 0.0


def test_parts_are_the_area_and_as_large_as_their_lines_are_long(site: Site, slices: list[Slice]) -> None:
    assert len(slices) == 3
    assert sum(each.area.area for each in slices) == pytest.approx(site.area.area, rel=1e-6)
    for one, other in itertools.combinations(slices, 2):
        assert one.area.intersection(other.area).area < 1e-6 * site.area.area
    for each in slices:
        inside = shapely.LineString(each.begin_m[:, :2]).intersection(each.area.buffer(30.0)).length
        assert inside > 0.95 * shapely.LineString(each.begin_m[:, :2]).length


@pytest.mark.parametrize("count", [2, 3, 4, 5])
def test_every_slice_has_two_lines_at_least(count: int) -> None:
    triangle = make_site(hills, ring=ring((0.0, 0.0), (1200.0, 0.0), (0.0, 900.0)), home=None)
    made = sliced(triangle, coarse(triangle), GOAL, count)
    assert len(made) in (0, count)
    directions = [np.degrees(np.arctan2(*np.diff(each.begin_m[:, :2], axis=0).T[::-1])) for each in made]
    assert all(np.ptp(np.round(each / 180.0) % 2) > 0 for each in directions), "lines there and back"


def test_no_more_slices_than_lines(site: Site) -> None:
    assert sliced(site, coarse(site), GOAL, 40) == []


def test_lines_that_cross_what_is_between_parts_are_not_cut() -> None:
    apart = make_site(hills, ring=RECTANGLE, home=None)
    corners = [shapely.box(-400.0, -400.0, -100.0, -100.0), shapely.box(500.0, 500.0, 800.0, 800.0)]
    apart = dataclasses.replace(apart, area=shapely.MultiPolygon(corners))
    assert sliced(apart, coarse(apart), GOAL, 2) == []


def test_a_part_knows_its_neighbours_from_the_first_round_on(site: Site, slices: list[Slice]) -> None:
    areas, routes = [each.area for each in slices], [each.begin_m for each in slices]
    tasks = tasks_of(site, areas, routes, GOAL, round_number=0, seed=1, evaluations=1, budget_s=None)
    assert [task.route_m is route for task, route in zip(tasks, routes, strict=True)] == [True] * 3
    assert {id(each.route_m) for each in tasks[1].neighbours} == {id(routes[0]), id(routes[2])}

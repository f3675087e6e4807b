import dataclasses
import itertools
import math

import numpy as np
import pytest

from tests.planning.sites import hills, make_site
from uavcover.kernels.tours import short_tour
from uavcover.planning.baselines.adaptive_swaths import adaptive_swaths, enough_lines
from uavcover.planning.baselines.swaths import fly_layout, long_side_angle_rad
from uavcover.planning.joining import in_good_order
from uavcover.planning.parts.chain import ChainedLines, chained
from uavcover.planning.parts.division import divide
from uavcover.planning.parts.planner import flight_work, tasks_of
from uavcover.scenario.site import Site

GOAL = 0.95
RING = ((0.0, 0.0), (1000.0, 0.0), (1000.0, 900.0), (0.0, 900.0))


@pytest.fixture(scope="module")
def parts() -> list[Site]:
    site = make_site(hills, ring=RING, home=None)
    return [dataclasses.replace(site, area=area) for area in divide(site.area, 4, flight_work(site))]


def every_choice(part: Site) -> list[ChainedLines]:
    """By the layouts, flown."""
    out = []
    for quarter, start in itertools.product((0.0, 0.5 * math.pi), range(4)):
        angle = long_side_angle_rad(part.area) + quarter
        layout = enough_lines(part, angle, GOAL, start=start)
        flown = fly_layout(part, dataclasses.replace(layout, tolerance_m=1e9)).waypoints_m[:, :2]
        length_m = float(np.linalg.norm(np.diff(flown, axis=0), axis=1).sum())
        out.append(ChainedLines(angle, start, flown[0], flown[-1], length_m))
    return out


def length_m(order: list[int], lines: list[ChainedLines]) -> float:
    ways = [math.dist(lines[a].last_en, lines[b].first_en) for a, b in itertools.pairwise(order)]
    return sum(each.length_m for each in lines) + sum(ways)


def test_no_other_directions_and_corners_are_shorter(parts: list[Site]) -> None:
    middles = np.array([[part.area.centroid.x, part.area.centroid.y, 0.0] for part in parts])
    order = short_tour(middles).tolist()
    shortest = min(length_m(order, list(lines)) for lines in itertools.product(*map(every_choice, parts)))
    assert length_m(order, chained(parts, GOAL)) == pytest.approx(shortest, abs=0.01)


def test_ways_between_parts_are_shorter_than_those_of_each_part_s_own_lines(parts: list[Site]) -> None:
    def between_m(lines: list[ChainedLines]) -> float:
        routes = in_good_order([np.array([[*each.first_en, 0.0], [*each.last_en, 0.0]]) for each in lines], None)
        return sum(math.dist(one[-1], other[0]) for one, other in itertools.pairwise(routes))

    alone = [min(every_choice(part), key=lambda each: each.length_m) for part in parts]
    assert between_m(chained(parts, GOAL)) <= 0.7 * between_m(alone)


def test_bent_lines_run_as_they_are_wanted(parts: list[Site]) -> None:
    for part, lines in zip(parts, chained(parts, GOAL), strict=True):
        routes = adaptive_swaths(part, lines.angle_rad, across=False, start=lines.start)
        alike = [route for route in routes if lines.ends_alike(route)]
        assert alike
        backwards = dataclasses.replace(lines, first_en=lines.last_en, last_en=lines.first_en)
        assert not any(backwards.ends_alike(route) for route in alike)


def test_the_first_round_is_told_how_lines_run_and_later_ones_are_not(parts: list[Site]) -> None:
    lines = chained(parts, GOAL)
    areas = [part.area for part in parts]
    first = tasks_of(parts[0], areas, None, 0.9, round_number=0, seed=1, evaluations=1, budget_s=None, lines=lines)
    assert [task.lines for task in first] == lines
    routes = [adaptive_swaths(part, each.angle_rad)[0].waypoints_m for part, each in zip(parts, lines, strict=True)]
    later = tasks_of(parts[0], areas, routes, 0.9, round_number=1, seed=1, evaluations=1, budget_s=None, lines=lines)
    assert [task.lines for task in later] == [None] * len(parts)

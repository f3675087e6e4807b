"""The second chain of a search begins with other lines than the first, where these are nearly as good."""

import itertools
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely

from uavcover.model.route import Route
from uavcover.planner.search.local_search import SearchStart, fraction_apart, starts_of_chains


def back_and_forth(lines: int, *, across: bool = False, shift_m: float = 0.0) -> Route:
    positions = [(x, y) for k in range(lines) for x, y in ((0, 100 * k), (600, 100 * k))[:: -1 if k % 2 else 1]]
    east_north = np.array(positions, dtype=float)[:, :: -1 if across else 1] + shift_m
    return Route(np.column_stack([east_north, np.full(len(positions), 80.0)]))


def slow_fraction(line_m: np.ndarray, other_m: np.ndarray, apart_m: float) -> float:
    far, all_positions = 0, 0
    for begin, end in itertools.pairwise(line_m):
        count = max(1, int(np.linalg.norm(end - begin) / apart_m))
        for k in range(count):
            position = shapely.Point(begin + (k + 0.5) / count * (end - begin))
            along = [
                shapely.LineString([a, b])
                for a, b in itertools.pairwise(other_m)
                if abs(math.cos(math.atan2(*(end - begin)) - math.atan2(*(b - a)))) >= math.sqrt(0.5)
            ]
            far += all(shapely.distance(position, leg) > apart_m for leg in along)
            all_positions += 1
    return far / all_positions


@pytest.mark.parametrize("seed", range(6))
def test_the_share_agrees_with_a_slow_count(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = (Route(rng.uniform(0.0, 300.0, (rng.integers(2, 9), 3))) for _ in range(2))
    positions = a.waypoints_m[:, :2], b.waypoints_m[:, :2]
    expected = max(slow_fraction(*positions, 40.0), slow_fraction(*positions[::-1], 40.0))
    assert fraction_apart(a, b, 40.0) == fraction_apart(b, a, 40.0) == pytest.approx(expected)


def test_lines_that_are_moved_a_little_are_the_same_and_lines_across_are_others() -> None:
    lines = back_and_forth(6)
    assert fraction_apart(lines, lines, 50.0) == fraction_apart(lines, back_and_forth(6, shift_m=20.0), 50.0) == 0.0
    assert fraction_apart(lines, back_and_forth(6, across=True), 50.0) > 0.7
    there_and_back = Route(np.vstack([lines.waypoints_m, [[-80.0, 500.0, 80.0], [-80.0, 0.0, 80.0]]]))
    assert 0.08 < fraction_apart(lines, there_and_back, 50.0) < 0.3
    assert fraction_apart(lines, Route(lines.waypoints_m[:1]), 50.0) == 1.0


@pytest.mark.parametrize(("worse", "free_order", "second"), [(1.02, False, 2), (1.05, False, 1), (1.02, True, 1)])
def test_the_second_chain_begins_with_other_lines_that_are_nearly_as_good(
    worse: float, free_order: bool, second: int
) -> None:
    routes = [back_and_forth(6), back_and_forth(6, shift_m=5.0), back_and_forth(6, across=True)]
    costs = dict(zip(map(id, routes), (100.0, 100.5, 100.0 * worse), strict=True))
    problem: Any = SimpleNamespace(cost=lambda route: costs[id(route)], free_order=free_order, reach_m=100.0)
    ranked = [SearchStart(route, 1.0) for route in routes]
    assert starts_of_chains(problem, ranked, 0.9) == [ranked[0], ranked[second]]
    assert starts_of_chains(problem, ranked[:1], 0.9) == ranked[:1]
    assert starts_of_chains(problem, ranked, 0.999) == ranked[:2]

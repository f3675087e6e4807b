import itertools

import numpy as np
import pytest

from tests.planner.sites import hills, make_site
from uavcover.missions.leg_checks import find_problems
from uavcover.planner.terrain_following import in_good_order, joined


def cost(routes, home) -> float:
    """Of an order, by hand: links, the way home and back at each from its nearer end, and both ways at the ends."""
    total = 0.0
    for before, behind in itertools.pairwise(routes):
        a, b = before[-1], behind[0]
        total += float(np.linalg.norm(a - b))
        if home is not None:
            total += 2.0 * min(float(np.linalg.norm(a - home)), float(np.linalg.norm(b - home)))
    if home is not None:
        total += float(np.linalg.norm(routes[0][0] - home)) + float(np.linalg.norm(routes[-1][-1] - home))
    return total


@pytest.mark.parametrize("home", [None, np.array([300.0, 300.0, 0.0])], ids=["no home", "home"])
@pytest.mark.parametrize("seed", range(6))
def test_the_order_is_the_best_of_all(home, seed) -> None:
    rng = np.random.default_rng(seed)
    routes = [rng.uniform(0.0, 1000.0, (3, 3)) for _ in range(5)]
    found = in_good_order(routes, home)
    assert sorted(tuple(route[[0, -1]].sum(axis=0)) for route in found) == sorted(
        tuple(route[[0, -1]].sum(axis=0)) for route in routes
    )
    best = min(
        cost([route[::path] for route, path in zip(order, paths, strict=True)], home)
        for order in itertools.permutations(routes)
        for paths in itertools.product((1, -1), repeat=5)
    )
    assert cost(found, home) == pytest.approx(best, rel=0.01)


def steepest_deg(routes) -> float:
    links = np.array([behind[0] - before[-1] for before, behind in itertools.pairwise(routes)])
    return float(np.degrees(np.arctan2(np.abs(links[:, 2]), np.hypot(links[:, 0], links[:, 1]))).max())


def test_flights_that_begin_and_end_around_home_are_joined_without_steep_links() -> None:
    rng = np.random.default_rng(4)
    home, routes = np.zeros(3), []
    for k in range(9):
        ends = np.column_stack([rng.uniform(-50.0, 50.0, (2, 2)), rng.uniform(40.0, 90.0, 2)])
        far = 900.0 * np.array([np.cos(k), np.sin(k), 0.1])
        routes.append(np.vstack([ends[:1], far[None], ends[1:]]))
    short = in_good_order(routes, home)
    gentle = in_good_order(routes, home, max_climb_angle_deg=30.0)
    assert steepest_deg(short) > 45.0
    assert steepest_deg(gentle) <= 30.0
    assert cost(gentle, home) < 1.1 * cost(short, home)


def test_one_route_stays_as_it_is() -> None:
    route = np.arange(9.0).reshape(3, 3)
    (found,) = in_good_order([route], None)
    assert np.array_equal(found, route)


def test_links_follow_the_terrain() -> None:
    site = make_site(hills)
    first, second = np.array([[20.0, 20.0], [40.0, 150.0]]), np.array([[260.0, 150.0], [280.0, 20.0]])
    routes = [np.column_stack([positions, site.ground.ups_m(positions, 80.0)]) for positions in (first, second)]
    whole = joined(site, routes)
    assert np.array_equal(whole[0], routes[0][0])
    assert np.array_equal(whole[-1], routes[1][-1])
    link = whole[1 : len(whole) - 1]
    assert find_problems(site, link, lowest_agl_m=60.0, highest_agl_m=100.0) == []

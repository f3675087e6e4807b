from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from tests.planner.sites import hills, make_site
from uavcover.missions.objectives import evaluate_routes, judge
from uavcover.model.route import Route
from uavcover.model.sensor import DiscSensor
from uavcover.sensing.coverage_map import CoverageMap

LINE = Route(np.array([[50.0, 50.0, 80.0], [110.0, 50.0, 80.0], [110.0, 130.0, 80.0]]))


def test_objectives_by_hand() -> None:
    # Cells of 100 m: centres (50, 50), (150, 50), (250, 50) and the same at 150. A disc of 60 m from the three waypoints
    # sees (50, 50), then (150, 50) from 40 m away, then (150, 150) from 45 m away.
    disc = DiscSensor(kind="disc", radius_m=60.0)
    site = make_site(sensor=disc, cell_m=50.0, planner={"objective": "length"})
    coverage = CoverageMap(site, cell_size_m=100.0)
    values = evaluate_routes(coverage, [LINE])
    np.testing.assert_allclose(values.objectives, [[-3 / 6, 3, 140.0]])
    np.testing.assert_array_equal(values.violations, [[0.0]])


def test_violation_is_what_the_leg_checks_measure() -> None:
    coverage = CoverageMap(make_site(limits={"height_margin_m": 4.0}), cell_size_m=50.0)
    low = Route(LINE.waypoints_m - [0.0, 0.0, 41.0])  # 39 m above flat ground: 5 m below 40 + 4, on both legs
    assert evaluate_routes(coverage, [low]).violations[0, 0] == pytest.approx(10.0, abs=1e-5)


def test_evaluation_does_not_depend_on_the_executor() -> None:
    coverage = CoverageMap(make_site(hills), cell_size_m=20.0)
    rng = np.random.default_rng(7)
    routes = [
        Route(np.column_stack([rng.uniform(0, 300, 9), rng.uniform(0, 200, 9), rng.uniform(30, 140, 9)]))
        for _ in range(24)
    ]
    alone = evaluate_routes(coverage, routes)
    for threads in (1, 2, 4):
        with ThreadPoolExecutor(threads) as executor:
            together = evaluate_routes(coverage, routes, executor)
        np.testing.assert_array_equal(together.objectives, alone.objectives)
        np.testing.assert_array_equal(together.violations, alone.violations)
    assert len({tuple(row) for row in alone.objectives}) == 24


def test_no_routes() -> None:
    coverage = CoverageMap(make_site(), cell_size_m=50.0)
    assert evaluate_routes(coverage, []).objectives.shape == (0, 3)


def test_judged_figures_by_hand() -> None:
    speeds = {"cruise_speed_m_s": 10.0, "max_climb_m_s": 2.0, "max_descent_m_s": 4.0, "acceleration_m_s2": np.inf}
    site = make_site(vehicle=speeds, cell_m=50.0)
    route = Route(np.array([[0.0, 50.0, 60.0], [100.0, 50.0, 60.0], [100.0, 130.0, 100.0], [100.0, 210.0, 40.0]]))
    metrics = judge(CoverageMap(site, cell_size_m=50.0), route)
    assert metrics.waypoint_count == 4
    assert metrics.path_length_m == pytest.approx(100.0 + np.hypot(80, 40) + np.hypot(80, 60))
    # Level 100 m at 10 m/s; 40 m up at 2 m/s; 60 m down at 4 m/s.
    assert metrics.flight_time_s == pytest.approx(10.0 + 20.0 + 15.0)
    assert (metrics.min_height_agl_m, metrics.max_height_agl_m) == (40.0, 100.0)
    assert 0.0 < metrics.coverage_fraction == metrics.coverage_of_coverable < 1.0

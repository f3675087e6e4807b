import math

import numpy as np
import pytest

from tests.compiled_kernels import cases
from uavcover.kernels.sight import local_slopes, steepest_between
from uavcover.kernels.surface import heights
from uavcover.terrain.ground import grid_ground, sine_cosine_ground


def rough(nodes):
    return grid_ground(nodes, east0_m=-20.0, north0_m=5.0, step_m=2.0, source="test", vertical_datum="local").surface


@pytest.mark.parametrize("seed", range(5))
def test_no_way_between_two_places_is_steeper_anywhere(seed):
    rng = np.random.default_rng(seed)
    surface = rough(rng.normal(0.0, 3.0, (14, 19)) * rng.uniform(0.1, 1.0, (14, 19)))
    slopes = local_slopes(surface)
    for _ in range(cases(compiled=200, interpreted=10)):
        ends = rng.uniform([-20.0, 5.0], [16.0, 31.0], (2, 2))
        path = ends[0] + np.linspace(0.0, 1.0, 400)[:, None] * (ends[1] - ends[0])
        ups = heights(surface, np.ascontiguousarray(path[:, 0]), np.ascontiguousarray(path[:, 1]))
        steepest = np.abs(np.diff(ups)).max() / (np.hypot(*(ends[1] - ends[0])) / 399.0)
        bound = steepest_between(surface, slopes, *ends[0], *ends[1])
        assert steepest <= bound + 1e-9
        assert bound <= surface.steepest


def test_missing_data_is_felt_only_near_it():
    nodes = np.zeros((30, 30))
    nodes[20, 20] = math.nan
    surface = rough(nodes)
    slopes = local_slopes(surface)
    assert surface.steepest == math.inf
    assert steepest_between(surface, slopes, -19.0, 6.0, -10.0, 12.0) == 0.0
    assert steepest_between(surface, slopes, -19.0, 6.0, 30.0, 55.0) == math.inf


def test_outside_the_grid_nothing_is_known():
    surface = rough(np.zeros((10, 10)))
    slopes = local_slopes(surface)
    for position in ((-20.1, 6.0), (-1.9, 6.0), (-10.0, 4.9), (-10.0, 23.1), (math.nan, 6.0)):
        assert steepest_between(surface, slopes, -10.0, 10.0, *position) == math.inf
    assert steepest_between(surface, slopes, -20.0, 5.0, -2.0, 23.0) == 0.0


def test_the_analytic_surface_is_one_block():
    surface = sine_cosine_ground(3.0).surface
    assert steepest_between(surface, local_slopes(surface), 0.0, 0.0, 1e4, -1e4) == surface.steepest

"""Gaps in elevation data: planes come back exactly, large gaps and gaps at the edge stay."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from uavcover.terrain.ground import fill_gaps


@settings(max_examples=60)
@given(
    seed=st.integers(0, 2**32), count=st.integers(1, 4), slope=st.floats(-2.0, 2.0), tilt=st.floats(-2.0, 2.0),
    pixel=st.tuples(st.floats(0.5, 40.0), st.floats(0.5, 40.0)),
)  # fmt: skip
def test_a_plane_comes_back(seed, count, slope, tilt, pixel):
    rng = np.random.default_rng(seed)
    rows, columns = np.indices((40, 50))
    plane = 300.0 + slope * rows * pixel[0] + tilt * columns * pixel[1]
    holed = plane.copy()
    for _ in range(count):
        row, column = rng.integers(2, 28), rng.integers(2, 38)
        holed[row : row + rng.integers(1, 10), column : column + rng.integers(1, 10)] = np.nan
    before = holed.copy()
    filled = fill_gaps(holed, pixel_m=pixel, up_to_m=1e6)
    assert np.array_equal(holed, before, equal_nan=True)
    assert np.allclose(filled.heights_m, plane, atol=1e-6 * (1.0 + np.abs(plane).max()))
    assert 1 <= filled.count <= count
    assert filled.largest_m <= 40.0 * max(pixel) * 1.001


def test_larger_gaps_and_those_at_the_edge_stay():
    heights = np.full((30, 30), 100.0)
    heights[5:10, 5:9] = np.nan  # 50 m x 40 m
    heights[15:22, 12:14] = np.nan  # 70 m x 20 m
    heights[0:3, 20:22] = np.nan
    filled = fill_gaps(heights, pixel_m=(10.0, 10.0), up_to_m=50.0)
    assert (filled.count, filled.largest_m) == (1, 50.0)
    assert np.isfinite(filled.heights_m[5:10, 5:9]).all()
    assert np.isnan(filled.heights_m[15:22, 12:14]).all()
    assert np.isnan(filled.heights_m[0:3, 20:22]).all()
    assert fill_gaps(heights, pixel_m=(10.0, 10.0), up_to_m=70.0).count == 2


def test_a_lake_is_as_high_as_its_shore():
    rng = np.random.default_rng(2)
    heights = 500.0 + rng.uniform(0.0, 50.0, (40, 40))
    rows, columns = np.indices(heights.shape)
    away = np.hypot(rows - 20, columns - 20)
    heights[away < 12.0] = 480.0
    heights[away < 10.0] = np.nan
    filled = fill_gaps(heights, pixel_m=(5.0, 5.0), up_to_m=100.0)
    assert np.allclose(filled.heights_m[away < 10.0], 480.0)

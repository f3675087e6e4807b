import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from shapely import LineString, Point

from tests.compiled_kernels import cases
from tests.naive import route as naive
from uavcover.kernels.route import distances_to_polyline

deterministic = settings(derandomize=True, deadline=None, max_examples=cases(compiled=25, interpreted=10))
coordinates = st.one_of(st.integers(-2, 2).map(float), st.floats(-100, 100, width=32))


@deterministic
@given(
    hnp.arrays(np.float64, st.tuples(st.integers(0, 3), st.just(3)), elements=coordinates),
    hnp.arrays(np.float64, st.tuples(st.integers(1, 5), st.just(3)), elements=coordinates),
)
def test_distances_equal_the_naive_twin(points, polyline):
    points.setflags(write=False)
    polyline.setflags(write=False)
    expected = [naive.distance_to_polyline(p, polyline.tolist()) for p in points.tolist()]
    # Near zero the search of the twin ends at the square root of the machine's precision.
    assert distances_to_polyline(points, polyline).tolist() == pytest.approx(expected, rel=1e-9, abs=1e-5)


def test_distances_in_the_plane_equal_those_of_shapely():
    rng = np.random.default_rng(4)
    points, polyline = rng.uniform(-9, 9, (50, 3)), rng.uniform(-9, 9, (7, 3))
    points[:, 2] = polyline[:, 2] = 4.0
    expected = [LineString(polyline[:, :2]).distance(Point(p[:2])) for p in points]
    np.testing.assert_allclose(distances_to_polyline(points, polyline), expected, rtol=1e-12)


def test_height_counts_as_much_as_the_plane():
    polyline = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 10.0]])
    assert distances_to_polyline(np.array([[10.0, 0.0, 0.0]]), polyline)[0] == pytest.approx(math.sqrt(50.0))


def test_nothing_to_be_near_to_is_infinitely_far():
    assert distances_to_polyline(np.zeros((2, 3)), np.empty((0, 3))).tolist() == [math.inf, math.inf]
    nan = np.array([[math.nan, 0.0, 0.0], [1.0, 0.0, 0.0]])
    assert distances_to_polyline(nan, np.zeros((2, 3))).tolist() == [math.inf, 1.0]

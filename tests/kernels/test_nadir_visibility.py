"""The quick way of the camera that looks straight down against the slow twin."""

import math

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.compiled_kernels import cases
from tests.kernels.test_coverage import cells_on, rough_ground
from tests.naive import route_state as naive
from tests.naive import runs as naive_runs
from uavcover.kernels.cells import Cells
from uavcover.kernels.nadir_visibility import NOT_SO, cone_cells, list_cone_runs
from uavcover.kernels.search_problem import ALONG_PATH
from uavcover.kernels.sight import CONE, NO_LINE_OF_SIGHT, RAY, SPHERE, Sight
from uavcover.terrain.ground import sine_cosine_ground

deterministic = settings(derandomize=True, deadline=None, max_examples=cases(compiled=60, interpreted=8))


def listed(surface, sight, cells, p, q, spacing):
    """Numbers of the cells, or None when there is no quick way."""
    out = np.full(400, -7, dtype=np.int32)
    row = np.zeros(cells.lattice.shape[1], dtype=np.uint8)
    quick = cone_cells(surface, sight, cells)
    found = list_cone_runs(surface, sight, cells, quick, tuple(map(float, p)), tuple(map(float, q)), spacing, row, out)
    if found == NOT_SO:
        return None
    assert (np.diff(out[:found]) >= 0).all()
    assert (out[found:] == -7).all()
    numbers = {int(cells.lattice.ravel()[square]) for square in naive_runs.squares_of(out[:found].tolist())}
    assert -1 not in numbers
    return numbers


@deterministic
@given(
    seed=st.integers(0, 10**6),
    sight=st.builds(
        Sight, st.just(CONE), st.sampled_from([1.5, 4.0]), st.sampled_from([0.3, 0.7, 1.4]),
        st.sampled_from([-1.0, 0.5, 0.9]), st.sampled_from([NO_LINE_OF_SIGHT, RAY]),
        st.just(0.0), st.just(0.0), st.just(-1.0), st.just(math.nan), st.just(math.nan), st.sampled_from([math.inf, 2.2]),
    ),
    spacing=st.sampled_from([0.2, 1.0, 20.0]),
    rise=st.sampled_from([0.0, 0.3, -0.8]),
    rough=st.booleans(),
    still=st.booleans(),
)  # fmt: skip
def test_the_quick_way_sees_what_any_sample_sees(seed, sight, spacing, rise, rough, still):
    surface = rough_ground(seed) if rough else sine_cosine_ground(1.0).surface
    cells = cells_on(surface, seed)
    rng = np.random.default_rng(seed)
    p = rng.uniform([-1, 2, 0.5], [4, 6, 4])
    step = np.array([0.0, 0.0]) if still else rng.normal(0.0, 1.5, 2)
    q = p + np.array([*step, rise * float(np.hypot(*step))])
    observations = [tuple(p)] if still else naive.segment_observations(ALONG_PATH, [tuple(p), tuple(q)], spacing)[0]
    found = listed(surface, sight, cells, p, q, spacing)
    if found is not None:
        assert found == naive.list_cells(surface, sight, cells, observations)
    else:
        # Off the ground's data, or a leg that climbs as fast as the cone widens.
        assert rough or abs(rise) * sight.tan_half_fov >= 0.99


@pytest.mark.parametrize("spacing", [0.07, 0.5])
@pytest.mark.parametrize("rise", [0.0, 0.4, -0.4])
def test_both_ends_of_a_leg_look(spacing, rise):
    surface = sine_cosine_ground(1.0).surface
    cells = cells_on(surface, 5)
    sight = Sight(CONE, 9.0, 0.7, -1.0, NO_LINE_OF_SIGHT)
    p, q = np.array([-0.2, 3.1, 2.0]), np.array([2.9, 4.4, 2.0 + rise * 3.36])
    observations = naive.segment_observations(ALONG_PATH, [tuple(p), tuple(q)], spacing)[0]
    expected = naive.list_cells(surface, sight, cells, observations)
    assert listed(surface, sight, cells, p, q, spacing) == expected == listed(surface, sight, cells, q, p, spacing)


def test_other_sensors_have_no_quick_way():
    surface = sine_cosine_ground(1.0).surface
    cells: Cells = cells_on(surface)
    assert listed(surface, Sight(SPHERE, 2.0, 0.0, -1.0, RAY), cells, (1.0, 3.0, 2.0), (1.0, 3.0, 2.0), 1.0) is None


def test_regression_every_sensor_is_compiled_for_once():
    cells = cells_on(sine_cosine_ground(1.0).surface)
    surface = sine_cosine_ground(1.0).surface
    sights = Sight(SPHERE, 2.0, 0.0, -1.0, RAY), Sight(CONE, 9.0, 1.4, -1.0, NO_LINE_OF_SIGHT)
    sphere, cone = (numba.typeof(cone_cells(surface, sight, cells)) for sight in sights)
    assert sphere == cone


def test_runs_that_do_not_fit_say_so():
    surface = sine_cosine_ground(1.0).surface
    cells = cells_on(surface)
    sight = Sight(CONE, 9.0, 1.4, -1.0, NO_LINE_OF_SIGHT)
    row = np.zeros(cells.lattice.shape[1], dtype=np.uint8)
    position = (1.0, 3.0, 2.5)
    quick = cone_cells(surface, sight, cells)
    for room, expected in ((3, -1), (4, -1)):
        out = np.zeros(room, dtype=np.int32)
        assert list_cone_runs(surface, sight, cells, quick, position, position, 1.0, row, out) == expected

"""The quick way of a camera with a rectangular picture against the slow ones."""

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
from uavcover.kernels.horizon import rises
from uavcover.kernels.leg_visibility import list_cells
from uavcover.kernels.nadir_visibility import NOT_SO
from uavcover.kernels.photo_visibility import list_photo_runs, photo_cells
from uavcover.kernels.search_problem import ALONG_PATH
from uavcover.kernels.sight import CONE, FRUSTUM, MIDPOINT, NO_LINE_OF_SIGHT, RAY, Sight
from uavcover.kernels.surface import GRID
from uavcover.terrain.ground import sine_cosine_ground

deterministic = settings(derandomize=True, deadline=None, max_examples=cases(compiled=80, interpreted=8))


def photo(pitch_deg, across, along, heading_deg, reach_m, cos_incidence, line_of_sight, sample_m):
    pitch = math.radians(pitch_deg)
    he, hn = (math.nan, math.nan)
    if heading_deg is not None:
        he, hn = math.sin(math.radians(heading_deg)), math.cos(math.radians(heading_deg))
    return Sight(
        FRUSTUM,
        reach_m,
        across,
        cos_incidence,
        line_of_sight,
        along,
        math.cos(pitch),
        math.sin(pitch),
        he,
        hn,
        sample_m,
    )


SIGHTS = st.builds(
    photo,
    pitch_deg=st.sampled_from([-90.0, -70.0, -45.0, -20.0]),
    across=st.sampled_from([0.3, 0.8]),
    along=st.sampled_from([0.2, 0.6]),
    heading_deg=st.sampled_from([None, None, 0.0, 137.0]),
    reach_m=st.sampled_from([1.8, 5.0]),
    cos_incidence=st.sampled_from([0.0, 0.2, 0.8]),
    line_of_sight=st.sampled_from([NO_LINE_OF_SIGHT, RAY]),
    sample_m=st.sampled_from([math.inf, 2.2]),
)


def with_rises(surface, sight, cells):
    """The cells as a site would make them: with what rises around them, where rays are traced."""
    rise = rises(surface, cells.centre_m, reach_m=sight.reach_m + cells.scatter_m)
    rise.flags.writeable = False
    return cells._replace(rise=rise)


def listed(surface, sight, cells, p, q, spacing, trigger=0.0):
    """Numbers of the cells, or None when there is no quick way."""
    out = np.full(400, -7, dtype=np.int32)
    row = np.zeros(cells.lattice.shape[1], dtype=np.uint8)
    ends = tuple(map(float, p)), tuple(map(float, q))
    quick = photo_cells(surface, sight, cells)
    found = list_photo_runs(surface, sight, cells, quick, *ends, spacing, trigger, row, out)
    if found == NOT_SO:
        return None
    assert (np.diff(out[:found]) >= 0).all()
    assert (out[found:] == -7).all()
    numbers = {int(cells.lattice.ravel()[square]) for square in naive_runs.squares_of(out[:found].tolist())}
    assert -1 not in numbers
    return numbers


def leg(seed, *, still, rise):
    rng = np.random.default_rng(seed)
    p = rng.uniform([-1, 2, 0.5], [4, 6, 4])
    step = np.array([0.0, 0.0]) if still else rng.normal(0.0, 1.5, 2)
    if not still and seed % 4 == 0:
        step[seed % 8 // 4] = 0.0  # along a row or a column: planes of the picture that the leg runs along
    return p, p + np.array([*step, rise * float(np.hypot(*step))])


@deterministic
@given(
    seed=st.integers(0, 10**6), sight=SIGHTS, spacing=st.sampled_from([0.2, 1.0, 20.0]),
    rise=st.sampled_from([0.0, 0.3, -0.8]), rough=st.booleans(), still=st.booleans(), known=st.booleans(),
)  # fmt: skip
def test_the_quick_way_sees_what_any_sample_sees(seed, sight, spacing, rise, rough, still, known):
    surface = rough_ground(seed) if rough else sine_cosine_ground(1.0).surface
    cells = cells_on(surface, seed)
    if known:
        cells = with_rises(surface, sight, cells)
    p, q = leg(seed, still=still, rise=rise)
    found = listed(surface, sight, cells, p, q, spacing)
    if found is None:
        # Off the ground's data, or a picture that turns with a leg that goes nowhere.
        assert rough or (still and math.isnan(sight.heading_e))
        return
    observations = [tuple(p)] if still else naive.segment_observations(ALONG_PATH, [tuple(p), tuple(q)], spacing)[0]
    assert found == naive.list_cells(surface, sight, cells, observations)


@deterministic
@given(
    seed=st.integers(0, 10**6), sight=SIGHTS, trigger=st.sampled_from([0.05, 0.4, 1.3]),
    rise=st.sampled_from([0.0, 0.3, -0.8]), rough=st.booleans(),
)  # fmt: skip
def test_the_quick_way_shows_what_the_slow_one_surely_shows(seed, sight, trigger, rise, rough):
    surface = rough_ground(seed) if rough else sine_cosine_ground(1.0).surface
    cells = cells_on(surface, seed)
    p, q = leg(seed, still=False, rise=rise)
    ends = tuple(map(float, p)), tuple(map(float, q))
    squares = np.zeros(len(cells.centre_m), dtype=np.int32)
    slow = set(squares[: list_cells(surface, sight, cells, *ends, 1.0, trigger, squares)].tolist())
    found = listed(surface, sight, cells, p, q, 1.0, trigger)
    assert found is None if found is None else found == slow
    if found is not None:
        quick = listed(surface, sight, with_rises(surface, sight, cells), p, q, 1.0, trigger)
        assert quick == slow


def test_a_picture_shows_something():
    surface = sine_cosine_ground(1.0).surface
    cells = cells_on(surface, 5)
    sight = photo(-70.0, 0.8, 0.6, None, 5.0, 0.2, RAY, math.inf)
    shown = listed(surface, sight, cells, (0.0, 3.0, 2.0), (2.0, 4.0, 2.0), 0.3)
    assert 10 < len(shown) < len(cells.centre_m)


@pytest.mark.parametrize(
    ("sight", "p", "q"),
    [
        (Sight(CONE, 2.0, 0.7, 0.1, RAY), (1.0, 3.0, 2.0), (2.0, 3.0, 2.0)),
        (photo(-70.0, 0.8, 0.6, None, 5.0, 0.2, MIDPOINT, math.inf), (1.0, 3.0, 2.0), (2.0, 3.0, 2.0)),
        (photo(-70.0, 0.8, 0.6, None, 5.0, -0.5, RAY, math.inf), (1.0, 3.0, 2.0), (2.0, 3.0, 2.0)),
        (photo(-70.0, 0.8, 0.6, 20.0, 5.0, 0.2, RAY, math.inf), (1.0, 3.0, 2.0), (1.0, 3.0, 3.0)),
        (photo(-70.0, 0.8, 0.6, None, 5.0, 0.2, RAY, math.inf), (1.0, 3.0, 2.0), (1.0, 3.0, 2.0)),
    ],
)
def test_there_is_no_quick_way_for_other_sensors_and_vertical_legs(sight, p, q):
    surface = sine_cosine_ground(1.0).surface
    assert listed(surface, sight, cells_on(surface), p, q, 1.0) is None


def test_regression_every_sensor_is_compiled_for_once():
    surface = sine_cosine_ground(1.0).surface
    cells = cells_on(surface)
    sights = Sight(CONE, 2.0, 0.7, 0.1, RAY), photo(-70.0, 0.8, 0.6, None, 5.0, 0.2, RAY, math.inf)
    cone, frustum = (numba.typeof(photo_cells(surface, sight, cells)) for sight in sights)
    assert cone == frustum
    assert numba.typeof(cells) == numba.typeof(with_rises(surface, sights[0], cells))


def test_runs_that_do_not_fit_say_so():
    surface = sine_cosine_ground(1.0).surface
    cells = cells_on(surface)
    sight = photo(-90.0, 0.8, 0.8, 0.0, 9.0, 0.0, NO_LINE_OF_SIGHT, math.inf)
    row = np.zeros(cells.lattice.shape[1], dtype=np.uint8)
    position = (1.0, 3.0, 2.5)
    quick = photo_cells(surface, sight, cells)
    for room in (3, 4):
        out = np.zeros(room, dtype=np.int32)
        assert list_photo_runs(surface, sight, cells, quick, position, position, 1.0, 0.0, row, out) == -1


def test_the_ground_of_these_tests_is_of_both_kinds():
    assert rough_ground(2).kind == GRID != sine_cosine_ground(1.0).surface.kind

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tests.compiled_kernels import cases
from tests.naive import surface as naive
from uavcover.kernels import surface as kernels
from uavcover.kernels.grid import square_frame, steepest_slope
from uavcover.kernels.surface import GRID, Surface
from uavcover.terrain.ground import grid_ground, sine_cosine_ground

deterministic = settings(derandomize=True, deadline=None, max_examples=cases(compiled=40, interpreted=12))

fractions = st.one_of(st.sampled_from([0.0, 0.25, 0.5, 1.0]), st.floats(0.0, 1.0, width=32))
node_heights = st.one_of(st.integers(-3, 3).map(float), st.floats(-500.0, 500.0, width=32))


def grid(nodes, east0, north0, step):
    frame = square_frame(east0_m=east0, north0_m=north0, step_m=step)
    return Surface(GRID, step, nodes, steepest_slope(nodes, frame), frame)


@st.composite
def grids(draw, *, with_gaps=False):
    shape = draw(st.tuples(st.integers(2, 5), st.integers(2, 5)))
    elements = st.one_of(node_heights, node_heights, st.just(math.nan)) if with_gaps else node_heights
    nodes = draw(hnp.arrays(np.float64, shape, elements=elements))
    east0, north0 = draw(st.sampled_from([(0.0, 0.0), (-7.5, 100.25)]))
    step = draw(st.sampled_from([0.5, 1.0, 3.75]))
    return grid(nodes, east0, north0, step)


@st.composite
def positions(draw, surface, *, outside=False):
    rows, columns = surface.up_m.shape
    u = draw(fractions) * (columns - 1)
    v = draw(fractions) * (rows - 1)
    if outside:
        u += draw(st.sampled_from([0.0, 0.0, columns, -columns]))
    return surface.grid.east0_m + u * surface.step_m, surface.grid.north0_m + v * surface.step_m


@st.composite
def segments(draw, *, with_gaps=False, outside=False):
    surface = draw(grids(with_gaps=with_gaps))
    ends = [(*draw(positions(surface, outside=outside)), draw(node_heights)) for _ in range(2)]
    p, q = (np.array(end) for end in ends)
    p.setflags(write=False)
    q.setflags(write=False)
    return surface, p, q


def twin(function, surface, *args):
    return function(surface.up_m.tolist(), surface.grid, *args)


@deterministic
@given(st.data())
def test_height_and_gradient_equal_the_naive_twin(data):
    surface = data.draw(grids(with_gaps=True))
    position = data.draw(positions(surface, outside=True))
    expected = twin(naive.height, surface, *position)
    assert kernels.height(surface, *position) == pytest.approx(expected, abs=1e-9, nan_ok=True)
    assert kernels.gradient(surface, *position) == pytest.approx(
        twin(naive.gradient, surface, *position), abs=1e-9, nan_ok=True
    )
    east = position[0] - surface.grid.east0_m
    assert kernels.has_node_cell(surface, *position, 0.0) == (
        0.0 <= east <= surface.step_m * (surface.up_m.shape[1] - 1)
    )


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_place_that_is_not_finite_has_no_ground(bad):
    flat = grid_ground(np.zeros((3, 4)), east0_m=0, north0_m=0, step_m=1, source="", vertical_datum="").surface
    here = np.array([1.0, 1.0, 5.0])
    for surface in (flat, sine_cosine_ground(1.0).surface):
        for axis in (0, 1):
            there = np.array([1.0, 1.0, 5.0])
            there[axis] = bad
            assert not kernels.has_node_cell(surface, *there)
            for p, q in ((here, there), (there, here), (there, there)):
                assert all(math.isnan(x) for x in kernels.height_range_between(surface, *p, *q, -math.inf))
    nan_up = np.array([2.0, 1.0, math.nan])
    for surface in (flat, sine_cosine_ground(1.0).surface):
        assert all(math.isnan(x) for x in kernels.height_range_between(surface, *here, *nan_up, -math.inf))
        assert all(math.isnan(x) for x in kernels.height_range_between(surface, *nan_up, *here, -math.inf))


def test_nodes_keep_their_values_and_the_middle_of_a_cell_is_their_mean():
    nodes = np.array([[1.0, 2.0, 4.0], [8.0, 16.0, 32.0]])
    surface = grid(nodes, 10.0, 20.0, 5.0)
    east, north = np.meshgrid([10.0, 15.0, 20.0], [20.0, 25.0])
    np.testing.assert_array_equal(kernels.heights(surface, east.ravel(), north.ravel()), nodes.ravel())
    assert kernels.height(surface, 12.5, 22.5) == (1 + 2 + 8 + 16) / 4
    np.testing.assert_allclose(
        kernels.gradients(surface, np.array([12.5]), np.array([22.5])), [[(1 + 8) / 2 / 5, (7 + 14) / 2 / 5]]
    )


@deterministic
@given(segments(with_gaps=True, outside=True))
def test_height_range_equals_the_naive_twin(case):
    surface, p, q = case
    low, low_at, high, high_at = kernels.height_range_between(surface, *p, *q, -math.inf)
    expected = twin(naive.height_range_above, surface, p.tolist(), q.tolist())
    assert (low, high) == pytest.approx(expected, abs=1e-9, nan_ok=True)
    if math.isnan(low):
        assert all(math.isnan(x) for x in (low_at, high, high_at))
        return
    for value, at in ((low, low_at), (high, high_at)):
        assert 0.0 <= at <= 1.0
        east, north, up = p + at * (q - p)
        # Rounding may carry a place at the very rim a hair over it.
        ground = twin(naive.height, surface, east, north)
        assert math.isnan(ground) or up - ground == pytest.approx(value, abs=1e-6)


@deterministic
@given(segments())
def test_height_range_is_never_missed_by_dense_sampling(case):
    surface, p, q = case
    low, _, high, _ = kernels.height_range_between(surface, *p, *q, -math.inf)
    sampled = naive.sampled_heights(lambda e, n: kernels.height(surface, e, n), p.tolist(), q.tolist(), 500)
    sampled = [z for z in sampled if not math.isnan(z)]
    assert low <= min(sampled) + 1e-9
    assert high >= max(sampled) - 1e-9
    # A smooth piece of the curve lies within slope * spacing / 2 of its nearest sample.
    run = math.dist(p[:2], q[:2]) / 500
    room = 0.5 * (abs(q[2] - p[2]) / 500 + surface.steepest * run) + 1e-9
    assert min(sampled) - low <= room
    assert high - max(sampled) <= room


@deterministic
@given(segments(), st.floats(-600.0, 600.0, width=32))
def test_stopping_early_gives_the_same_verdict(case, limit):
    surface, p, q = case
    low = kernels.height_range_between(surface, *p, *q, -math.inf)[0]
    stopped = kernels.height_range_between(surface, *p, *q, limit)[0]
    assert (stopped < limit) == (low < limit)
    assert stopped >= low
    if low >= limit:
        assert stopped == low


@deterministic
@given(segments(with_gaps=True))
def test_height_range_is_the_same_backwards(case):
    surface, p, q = case
    there, back = (kernels.height_range_between(surface, *a, *b, -math.inf) for a, b in ((p, q), (q, p)))
    if not (math.isnan(there[0]) or math.isnan(back[0])):
        assert there[0] == pytest.approx(back[0], abs=1e-9)
        assert there[2] == pytest.approx(back[2], abs=1e-9)


def test_a_dip_inside_a_cell_is_found_exactly():
    # A saddle cell: along its diagonal z = u (1 - u) * -4 + ..., lowest ground in the middle, highest along the other one.
    surface = grid(np.array([[0.0, 4.0], [4.0, 0.0]]), 0.0, 0.0, 2.0)
    p, q = np.array([0.0, 0.0, 5.0]), np.array([2.0, 2.0, 5.0])
    assert kernels.height_range_between(surface, *p, *q, -math.inf) == pytest.approx((3.0, 0.5, 5.0, 0.0))
    p, q = np.array([2.0, 0.0, 5.0]), np.array([0.0, 2.0, 5.0])
    assert kernels.height_range_between(surface, *p, *q, -math.inf) == pytest.approx((1.0, 0.0, 3.0, 0.5))


def test_a_narrow_ridge_between_samples_is_not_missed():
    nodes = np.zeros((2, 2001))
    nodes[:, 1234] = 90.0
    surface = grid(nodes, 0.0, 0.0, 1.0)
    low, at, _, _ = kernels.height_range_between(surface, 0.0, 0.3, 50.0, 2000.0, 0.7, 50.0, -math.inf)
    assert low == pytest.approx(-40.0)
    assert at == pytest.approx(1234 / 2000)


@deterministic
@given(segments(with_gaps=True), st.integers(0, 4))
def test_legs_are_segments(case, count):
    surface, p, q = case
    rng = np.random.default_rng(count)
    route = p + rng.random((count, 1)) * (q - p)
    legs = kernels.leg_height_ranges(surface, route)
    assert legs.shape == (max(0, count - 1), 4)
    for i, leg in enumerate(legs):
        np.testing.assert_array_equal(leg, kernels.height_range_between(surface, *route[i], *route[i + 1], -math.inf))


@deterministic
@given(st.data())
def test_no_two_places_have_a_steeper_slope_than_the_bound(data):
    surface = data.draw(grids())
    (e0, n0), (e1, n1) = (data.draw(positions(surface)) for _ in range(2))
    run = math.dist((e0, n0), (e1, n1))
    rise = abs(kernels.height(surface, e1, n1) - kernels.height(surface, e0, n0))
    assert rise <= surface.steepest * run * (1 + 1e-9) + 1e-9


def test_the_bound_is_reached_by_a_plane_and_infinite_with_gaps():
    east, north = np.meshgrid(np.arange(5.0), np.arange(4.0))
    plane = 3.0 * east + 4.0 * north
    assert steepest_slope(plane, square_frame(east0_m=0.0, north0_m=0.0, step_m=1.0)) == pytest.approx(5.0)
    assert steepest_slope(plane, square_frame(east0_m=0.0, north0_m=0.0, step_m=10.0)) == pytest.approx(0.5)
    plane[2, 1] = math.nan
    assert steepest_slope(plane, square_frame(east0_m=0.0, north0_m=0.0, step_m=1.0)) == math.inf


@pytest.mark.parametrize("scale", [1.0, 100.0])
def test_the_analytic_surface_is_the_papers(scale):
    surface = sine_cosine_ground(scale).surface
    rng = np.random.default_rng(5)
    h = 1e-6 * scale
    for east, north in rng.uniform(-20 * scale, 20 * scale, (50, 2)):
        assert kernels.height(surface, east, north) == naive.analytic_height(scale, east, north)
        numeric = (
            (naive.analytic_height(scale, east + h, north) - naive.analytic_height(scale, east - h, north)) / (2 * h),
            (naive.analytic_height(scale, east, north + h) - naive.analytic_height(scale, east, north - h)) / (2 * h),
        )
        assert kernels.gradient(surface, east, north) == pytest.approx(numeric, abs=1e-8)
        assert math.hypot(*numeric) <= surface.steepest + 1e-8


@pytest.mark.parametrize("scale", [1.0, 40.0])
def test_the_stated_error_above_the_analytic_surface_holds_and_is_no_idle_one(scale):
    surface = sine_cosine_ground(scale).surface
    rng = np.random.default_rng(6)
    bound = math.sqrt(2) * 0.05**3 * scale / (72 * math.sqrt(3))
    worst = 0.0
    for _ in range(30):
        p = rng.uniform([0, 0, -1], [10, 10, 1]) * scale
        direction = rng.uniform(0, 2 * math.pi)
        q = p + scale * np.array([math.cos(direction), math.sin(direction), rng.uniform(-1, 1)])
        low, _, high, _ = kernels.height_range_between(surface, *p, *q, -math.inf)
        t = np.linspace(0, 1, 50_001)[:, None]
        east, north, up = (p + t * (q - p)).T
        above = up - scale * np.sin(north / scale) * np.cos(east / scale)
        # A sample misses the extreme by at most |f''| h^2 / 8, here 1e-10 of the scale.
        assert abs(low - above.min()) <= bound + 1e-10 * scale
        assert abs(high - above.max()) <= bound + 1e-10 * scale
        worst = max(worst, abs(low - above.min()), abs(high - above.max()))
    assert worst > 0.001 * bound


def test_stopping_early_above_the_analytic_surface():
    surface = sine_cosine_ground(1.0).surface
    p, q = np.array([0.0, 0.0, 0.5]), np.array([0.0, 7.0, 0.5])
    low, at, _, _ = kernels.height_range_between(surface, *p, *q, -math.inf)
    assert (low, at * 7.0) == pytest.approx((-0.5, math.pi / 2), abs=1e-4)
    assert -0.5 < kernels.height_range_between(surface, *p, *q, -0.1)[0] < -0.1
    assert kernels.height_range_between(surface, *p, *q, -0.6)[0] == low
    # A point is a segment of no length.
    assert kernels.height_range_between(surface, *p, *p, -math.inf)[0] == 0.5


@deterministic
@given(seed=st.integers(0, 10**6), limit=st.sampled_from([-1e-6, 0.0, 0.3]), scale=st.sampled_from([1.0, 25.0]))
def test_staying_above_is_the_answer_of_the_whole_range(seed, limit, scale):
    rng = np.random.default_rng(seed)
    nodes = rng.uniform(-2.0, 2.0, (6, 6))
    rough = grid_ground(nodes, east0_m=0.0, north0_m=0.0, step_m=2.0, source="t", vertical_datum="local").surface
    nodes[rng.integers(6), rng.integers(6)] = math.nan
    gap = grid_ground(nodes, east0_m=0.0, north0_m=0.0, step_m=2.0, source="t", vertical_datum="local").surface
    for surface, size in ((sine_cosine_ground(scale).surface, scale), (rough, 1.0), (gap, 1.0)):
        for _ in range(20):
            p, q = rng.uniform(0.0, 9.0, (2, 2))
            if rng.random() < 0.3:
                # Along lines of nodes, and from node to node.
                p, q = np.round(p), np.where(rng.random(2) < 0.5, np.round(q), np.round(p))
            (pe, pn), (qe, qn) = (size * p).tolist(), (size * q).tolist()
            # From a place above the ground down to the ground, as a ray to a cell; some begin under it.
            pu = kernels.height(surface, pe, pn) + size * float(rng.uniform(-0.2, 3.0))
            qu = kernels.height(surface, qe, qn) + limit + float(rng.choice([-limit, -1e-9, 1e-9]))
            lowest = kernels.height_range_between(surface, pe, pn, pu, qe, qn, qu, -math.inf)[0]
            if abs(lowest - limit) > 1e-12:
                assert kernels.stays_above(surface, pe, pn, pu, qe, qn, qu, limit) == (lowest >= limit)
    assert not kernels.stays_above(rough, 1.0, 1.0, 9.0, 99.0, 1.0, 9.0, 0.0)
    assert not kernels.stays_above(sine_cosine_ground(1.0).surface, math.nan, 1.0, 9.0, 2.0, 1.0, 9.0, 0.0)

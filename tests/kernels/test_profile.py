import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.compiled_kernels import cases
from tests.naive import route as naive
from uavcover.kernels import profile as kernels
from uavcover.kernels.route import path_length
from uavcover.kernels.surface import height, height_range_between
from uavcover.terrain.ground import grid_ground, sine_cosine_ground

deterministic = settings(derandomize=True, deadline=None, max_examples=cases(compiled=25, interpreted=8))


def hills(seed):
    nodes = np.random.default_rng(seed).uniform(0.0, 60.0, (9, 9))
    return grid_ground(nodes, east0_m=0, north0_m=0, step_m=50, source="", vertical_datum="").surface


def densely(route, polyline, spacing):
    """Samples of the polyline as the kernel makes them, with the height of the route above each."""
    out = []
    for a, b in itertools.pairwise(polyline):
        pieces = max(1, math.ceil(math.dist(a, b) / spacing))
        out += [a + k / pieces * (b - a) for k in range(pieces)]
    out.append(polyline[-1])
    positions = np.array(out)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(positions, axis=0), axis=1))])
    run = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(route[:, :2], axis=0), axis=1))])
    return positions, along, np.interp(along, run, route[:, 2])


def left_by_the_ground(surface, positions, steps=200):
    """How far the ground rises above the straight lines through it beside each place, and sinks below, by small steps."""
    rise, fall = np.zeros(len(positions)), np.zeros(len(positions))
    at_position = [height(surface, *position) for position in positions]
    for k in range(len(positions) - 1):
        fractions = np.linspace(0.0, 1.0, steps + 1)
        between = [height(surface, *(positions[k] + t * (positions[k + 1] - positions[k]))) for t in fractions]
        above = np.array(between) - np.interp(fractions, [0.0, 1.0], at_position[k : k + 2])
        rise[k : k + 2] = np.maximum(rise[k : k + 2], above.max())
        fall[k : k + 2] = np.maximum(fall[k : k + 2], -above.min())
    return rise, fall


BETWEEN_STEPS_M = 0.05
"""So much the ground of these hills may leave its straight line between two of the small steps."""


@deterministic
@given(st.integers(0, 1000), st.sampled_from([0.3, 0.6, 2.0]), st.sampled_from([0.0, 3.0, 25.0]))
def test_terrain_following_keeps_band_slope_tolerance_and_corners(seed, max_slope, tolerance):
    surface = hills(seed)
    rng = np.random.default_rng(seed)
    low, high, spacing = 20.0, 70.0, 10.0
    polyline = rng.uniform(0.0, 400.0, (rng.integers(2, 5), 2))
    wanted = rng.uniform(0.0, 90.0, len(polyline))
    polyline.setflags(write=False)
    wanted.setflags(write=False)
    route = kernels.follow_terrain(surface, polyline, wanted, low, high, max_slope, tolerance, spacing, 0.0, 0.0)
    assert np.isfinite(route).all()
    assert {tuple(corner) for corner in polyline.tolist()} <= {tuple(p) for p in route[:, :2].tolist()}
    assert route[0, :2].tolist() == polyline[0].tolist()
    assert route[-1, :2].tolist() == polyline[-1].tolist()
    runs = np.linalg.norm(np.diff(route[:, :2], axis=0), axis=1)
    assert (np.abs(np.diff(route[:, 2])) <= max_slope * runs * (1 + 1e-9) + 1e-9).all()
    positions, along, up = densely(route, polyline, spacing)
    ground = np.array([height(surface, *position) for position in positions])
    lowest = min(height_range_between(surface, *p, *q, -math.inf)[0] for p, q in itertools.pairwise(route))
    assert lowest >= low - 1e-6, "below the band, if only between two samples"
    rise, fall = left_by_the_ground(surface, positions)
    floor, ceiling = ground + low + rise, ground + high - fall
    # The ceiling of the widened profiles, by their definition: no place forces more than its own floor less the slope.
    reachable_floor = (floor - max_slope * np.abs(along[:, None] - along)).max(axis=1)
    reachable_ceiling = (ceiling + max_slope * np.abs(along[:, None] - along)).min(axis=1)
    assert (up <= np.maximum(reachable_floor, reachable_ceiling) + BETWEEN_STEPS_M).all(), (
        "above the band for no reason"
    )
    if (reachable_floor <= reachable_ceiling - BETWEEN_STEPS_M).all():
        highest = max(height_range_between(surface, *p, *q, -math.inf)[2] for p, q in itertools.pairwise(route))
        assert highest <= high + 1e-6, "above the band though both limits can hold"
    # The reference, by its definition, and the tolerance around it.
    corner_along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(polyline, axis=0), axis=1))])
    wish = ground + np.interp(along, corner_along, wanted)
    wish = (wish - max_slope * np.abs(along[:, None] - along)).max(axis=1)
    reference = np.maximum(reachable_floor, np.minimum(reachable_ceiling, wish))
    assert (np.abs(up - reference) <= tolerance + BETWEEN_STEPS_M).all()


def test_where_both_limits_cannot_hold_the_lower_one_wins():
    nodes = np.zeros((2, 21))
    nodes[:, 10:] = 100.0
    surface = grid_ground(nodes, east0_m=0, north0_m=0, step_m=10, source="", vertical_datum="").surface
    polyline = np.array([[0.0, 5.0], [200.0, 5.0]])
    route = kernels.follow_terrain(surface, polyline, np.full(2, 15.0), 10.0, 20.0, 1.0, 0.0, 1.0, 0.0, 0.0)
    up_at = np.interp([60.0, 90.0, 100.0, 150.0], route[:, 0], route[:, 2])
    # 45 degrees up to the lower limit above the edge, 110 m; 10 m of cliff are too steep to keep under 20 m.
    assert up_at[1] == pytest.approx(100.0)
    assert up_at[2] >= 110.0
    assert (np.diff(route[:, 2]) <= np.diff(route[:, 0]) + 1e-9).all()


def test_on_flat_ground_and_a_tolerance_saves_waypoints():
    flat = grid_ground(np.zeros((5, 5)), east0_m=0, north0_m=0, step_m=100, source="", vertical_datum="").surface
    polyline = np.array([[0.0, 0.0], [400.0, 0.0], [400.0, 300.0]])
    route = kernels.follow_terrain(flat, polyline, np.full(3, 50.0), 40.0, 60.0, 0.5, 0.5, 7.0, 0.0, 0.0)
    np.testing.assert_allclose(route, [[0, 0, 50], [400, 0, 50], [400, 300, 50]])
    tight, loose = (
        kernels.follow_terrain(hills(1), polyline, np.full(3, 50.0), 20.0, 90.0, 2.0, tolerance, 5.0, 0.0, 0.0)
        for tolerance in (0.1, 10.0)
    )
    assert len(loose) < len(tight)


def test_a_corner_given_twice_changes_nothing():
    polyline = np.array([[10.0, 10.0], [200.0, 30.0], [200.0, 30.0], [300.0, 300.0], [300.0, 300.0]])
    once = polyline[[0, 1, 3]]
    twice = kernels.follow_terrain(hills(4), polyline, np.full(5, 40.0), 20.0, 90.0, 1.0, 2.0, 5.0, 0.0, 0.0)
    expected = kernels.follow_terrain(hills(4), once, np.full(3, 40.0), 20.0, 90.0, 1.0, 2.0, 5.0, 0.0, 0.0)
    different = np.concatenate([[True], np.abs(np.diff(twice, axis=0)).sum(axis=1) > 0])
    np.testing.assert_allclose(twice[different], expected)


def test_no_chord_crosses_ground_without_data_and_the_rest_is_as_if_it_were_not_there():
    nodes = np.zeros((3, 41))
    nodes[:, 20] = math.nan
    surface = grid_ground(nodes, east0_m=0, north0_m=0, step_m=10, source="", vertical_datum="").surface
    polyline = np.array([[0.0, 10.0], [400.0, 10.0]])
    route = kernels.follow_terrain(surface, polyline, np.full(2, 50.0), 40.0, 60.0, 0.5, 5.0, 5.0, 0.0, 0.0)
    gap = np.isnan(route[:, 2])
    assert gap.any()
    assert ((route[gap, 0] >= 190.0) & (route[gap, 0] <= 210.0)).all()
    assert route[~gap, 2].tolist() == [50.0] * int((~gap).sum())
    # Waypoints at both rims of the gap: nothing without data lies under a leg between two of the others.
    assert 185.0 <= route[~gap, 0][route[~gap, 0] < 200.0].max() <= 190.0
    assert 210.0 <= route[~gap, 0][route[~gap, 0] > 200.0].min() <= 215.0


def test_terrain_following_over_the_analytic_surface():
    surface = sine_cosine_ground(50.0).surface
    polyline = np.array([[0.0, 0.0], [300.0, 200.0]])
    route = kernels.follow_terrain(surface, polyline, np.full(2, 30.0), 20.0, 40.0, 1.0, 1.0, 1.0, 0.0, 0.0)
    above = [p[2] - height(surface, p[0], p[1]) for p in route]
    assert 20.0 <= min(above) <= max(above) <= 40.0


@deterministic
@given(st.integers(0, 1000))
def test_the_tight_line_is_as_short_as_the_shortest_of_the_naive_twin(seed):
    rng = np.random.default_rng(seed)
    along = np.cumsum(rng.uniform(1.0, 9.0, rng.integers(2, 14)))
    lower = rng.uniform(-9.0, 9.0, along.size)
    upper = lower + rng.uniform(0.0, 9.0, along.size)
    lower[-1] = upper[-1] = rng.uniform(lower[-1], upper[-1])
    first = float(rng.uniform(-20.0, 20.0))
    line = kernels._tight(along, lower, upper, first)
    assert line[0] == first
    assert (line[1:] >= lower[1:] - 1e-9).all()
    assert (line[1:] <= upper[1:] + 1e-9).all()
    length = float(np.hypot(np.diff(along), np.diff(line)).sum())
    assert length == pytest.approx(naive.shortest_between(*(x.tolist() for x in (along, lower, upper)), first))


@deterministic
@given(st.integers(0, 1000), st.sampled_from([0.3, 0.6, 2.0]))
def test_the_shortest_profile_keeps_band_slope_and_corners_and_climbs_less_than_terrain_following(seed, max_slope):
    surface = hills(seed)
    rng = np.random.default_rng(seed)
    low, high, spacing = 20.0, 120.0, 10.0
    polyline = rng.uniform(0.0, 400.0, (rng.integers(2, 5), 2))
    followed = kernels.follow_terrain(
        surface, polyline, rng.uniform(low, high, len(polyline)), low, high, max_slope, 0.0, spacing, 0.0, 0.0
    )
    ups = (float(followed[0, 2]), float(followed[-1, 2]))
    route = kernels.shortest_profile(surface, polyline, ups, low, high, max_slope, 5.0, spacing, 0.0, 0.0)
    assert {tuple(corner) for corner in polyline.tolist()} <= {tuple(p) for p in route[:, :2].tolist()}
    runs = np.linalg.norm(np.diff(route[:, :2], axis=0), axis=1)
    assert (np.abs(np.diff(route[:, 2])) <= max_slope * runs * (1 + 1e-9) + 1e-9).all()
    ranges = np.array([height_range_between(surface, *p, *q, -math.inf) for p, q in itertools.pairwise(route)])
    assert ranges[:, 0].min() >= low - 1e-6
    highest = max(height_range_between(surface, *p, *q, -math.inf)[2] for p, q in itertools.pairwise(followed))
    if highest <= high + 1e-6:
        assert ranges[:, 2].max() <= high + 1e-6
        assert route[0, 2] >= ups[0] - 1e-9
        assert route[-1, 2] == pytest.approx(ups[1])
        assert path_length(route) <= path_length(followed) + 0.5
        assert len(route) <= len(followed)


def test_a_profile_between_steep_ends_is_raised_at_the_first_and_lowered_at_the_last():
    flat = grid_ground(np.zeros((5, 5)), east0_m=0, north0_m=0, step_m=100, source="", vertical_datum="").surface
    line = np.array([[0.0, 0.0], [100.0, 0.0]])
    up = kernels.shortest_profile(flat, line, (30.0, 110.0), 20.0, 120.0, 0.5, 5.0, 7.0, 0.0, 0.0)
    np.testing.assert_allclose(up, [[0, 0, 60], [100, 0, 110]])
    down = kernels.shortest_profile(flat, line, (110.0, 30.0), 20.0, 120.0, 0.5, 5.0, 7.0, 0.0, 0.0)
    np.testing.assert_allclose(down, [[0, 0, 110], [100, 0, 60]])
    outside = kernels.shortest_profile(flat, line, (10.0, 10.0), 20.0, 120.0, 0.5, 5.0, 7.0, 0.0, 0.0)
    np.testing.assert_allclose(outside, [[0, 0, 20], [100, 0, 20]])

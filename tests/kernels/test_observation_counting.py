import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tests.compiled_kernels import cases
from tests.kernels.test_coverage import cells_on, deterministic, rough_ground, sights
from tests.naive import observation_counting as naive
from uavcover.kernels import observation_counting as kernels
from uavcover.kernels.cells import Cells
from uavcover.kernels.observation_counting import Camera
from uavcover.kernels.sight import (
    CONE,
    DISC,
    FRUSTUM,
    NO_LINE_OF_SIGHT,
    NOT_IN_RANGE,
    OBSERVED,
    OCCLUDED,
    RAY,
    SPHERE,
    TOO_COARSE,
    TOO_OBLIQUE,
    Sight,
    local_slopes,
)  # fmt: skip
from uavcover.terrain.ground import grid_ground

EXACT = Camera(focal_px=900.0, pass_gap_s=1.5, offset_m=0.0, horizontal_m=0.0, lift_m=0.0, turn_rad=0.0)
DOWN = np.array([[0.0, 0.0, -1.0]])
seeds = st.integers(0, 2**16)


def flat_ground():
    return grid_ground(
        np.zeros((60, 60)), east0_m=-300.0, north0_m=-300.0, step_m=10.0, source="test", vertical_datum="local"
    ).surface


def one_cell(east=0.0, north=0.0, up=0.0, normal=(0.0, 0.0, 1.0)):
    return Cells(
        east,
        north,
        1.0,
        np.zeros((1, 1), dtype=np.int32),
        np.array([[east, north, up]]),
        np.array([normal], dtype=float),
        np.zeros(1),
    )


def tops_of(axes, turn=0.3):
    """Unit vectors at right angles to (k, 3) axes, turned somehow about them."""
    axes = np.asarray(axes, dtype=float)
    top = np.cross(axes, np.cross([math.sin(turn), math.cos(turn), 0.1], axes))
    return top / np.linalg.norm(top, axis=1)[:, None]


def counted(surface, sight, camera, cells, eyes, axes, times, *, tops=None, workers=1):
    counts = kernels.no_observations(cells.centre_m.shape[0], camera.needed)
    eyes, axes = (np.ascontiguousarray(array, dtype=float) for array in (eyes, axes))
    tops = tops_of(axes) if tops is None else tops
    slopes, times = local_slopes(surface), np.asarray(times, dtype=float)
    for first_row in range(workers):
        poses = kernels.SensorPoses(eyes, axes, tops, times)
        kernels.count_rows(surface, slopes, sight, camera, cells, poses, (first_row, workers), counts)
    return counts


def some_looks(rng, count, *, tilt):
    eyes = np.column_stack([rng.uniform(-1.0, 4.0, count), rng.uniform(1.9, 6.0, count), rng.uniform(-0.5, 4.0, count)])
    axes = np.column_stack([rng.normal(0.0, tilt, count), rng.normal(0.0, tilt, count), -np.ones(count)])
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    return eyes, axes, np.cumsum(rng.choice([0.5, 1.0, 2.0], count))


@deterministic
@given(seeds, sights, st.sampled_from([0.0, 0.5]))
def test_equals_its_naive_twin(seed, sight, tilt):
    rng = np.random.default_rng(seed)
    surface = rough_ground(seed)
    cells = cells_on(surface, seed)
    eyes, axes, times = some_looks(rng, 6, tilt=tilt)
    eyes[rng.integers(6), 2] = math.nan
    known = np.isfinite(eyes).all(axis=1)
    tops = tops_of(axes, rng.uniform(0.0, math.tau))
    expected = naive.counts(surface, sight, EXACT, cells, eyes[known], axes[known], tops[known], times[known])
    counts = counted(surface, sight, EXACT, cells, eyes, axes, times, tops=tops, workers=int(rng.integers(1, 4)))
    numbers = np.flatnonzero(known)
    assert counts.outcome.tolist() == [cell["outcome"] for cell in expected]
    assert counts.passes.tolist() == [cell["passes"] for cell in expected]
    assert counts.first.tolist() == [numbers[cell["first"]] if cell["first"] >= 0 else -1 for cell in expected]
    np.testing.assert_allclose(counts.nearest_m, [cell["nearest"] for cell in expected])
    np.testing.assert_allclose(counts.ground_sample_m, [cell["sample"] for cell in expected], rtol=1e-6)
    np.testing.assert_allclose(
        counts.cos_incidence, np.cos(np.radians([cell["incidence"] for cell in expected])), atol=1e-9
    )
    assert not counts.sure.any()


def test_ground_sample_distance_of_a_level_camera_over_flat_ground_is_height_by_focal_length_everywhere():
    sight = Sight(CONE, 500.0, 1.0, 0.0, RAY)
    for east in (0.0, 40.0, 79.0):
        counts = counted(flat_ground(), sight, EXACT, one_cell(east), [[0.0, 0.0, 80.0]], DOWN, [0.0])
        assert counts.ground_sample_m[0] == pytest.approx(80.0 / 900.0)
        assert counts.cos_incidence[0] == pytest.approx(80.0 / math.hypot(80.0, east))


def test_a_camera_rolled_by_30_degrees_sees_other_ground():
    sight = Sight(CONE, 500.0, math.tan(math.radians(20.0)), 0.0, RAY)
    rolled = [[math.sin(math.radians(30.0)), 0.0, -math.cos(math.radians(30.0))]]
    below, beside = one_cell(0.0), one_cell(80.0 * math.tan(math.radians(45.0)))
    eye = [[0.0, 0.0, 80.0]]
    assert counted(flat_ground(), sight, EXACT, below, eye, DOWN, [0.0]).outcome[0] == OBSERVED
    assert counted(flat_ground(), sight, EXACT, below, eye, rolled, [0.0]).outcome[0] == NOT_IN_RANGE
    assert counted(flat_ground(), sight, EXACT, beside, eye, DOWN, [0.0]).outcome[0] == NOT_IN_RANGE
    assert counted(flat_ground(), sight, EXACT, beside, eye, rolled, [0.0]).outcome[0] == OBSERVED


def test_why_a_cell_was_not_seen():
    wall = np.zeros((60, 60))
    wall[:, 33] = 60.0
    surface = grid_ground(
        wall, east0_m=-300.0, north0_m=-300.0, step_m=10.0, source="test", vertical_datum="local"
    ).surface
    sight = Sight(CONE, 150.0, 1.0, math.cos(math.radians(40.0)), RAY)
    cell = one_cell(50.0)
    assert counted(surface, sight, EXACT, cell, [[-200.0, 0.0, 80.0]], DOWN, [0.0]).outcome[0] == NOT_IN_RANGE
    assert counted(surface, sight, EXACT, cell, [[-29.0, 0.0, 80.0]], DOWN, [0.0]).outcome[0] == TOO_OBLIQUE
    behind = [[-2.0, 0.0, 80.0]]
    assert counted(surface, sight, EXACT, cell, behind, DOWN, [0.0]).outcome[0] == OCCLUDED
    assert counted(flat_ground(), sight, EXACT, cell, behind, DOWN, [0.0]).outcome[0] == OBSERVED
    # The furthest any look got counts, in whatever order they come.
    eyes = [behind[0], [-29.0, 0.0, 80.0], [-200.0, 0.0, 80.0]]
    assert counted(surface, sight, EXACT, cell, eyes, np.repeat(DOWN, 3, 0), [0.0, 1.0, 2.0]).outcome[0] == OCCLUDED


def test_a_picture_taken_from_too_high_is_too_coarse():
    focal_px, largest_m = 900.0, 0.1
    for kind in (CONE, FRUSTUM):
        sight = Sight(kind, 500.0, 1.0, 0.0, RAY, tan_half_along=1.0, sample_focal_m=largest_m * focal_px)
        for up, outcome in ((89.9, OBSERVED), (90.1, TOO_COARSE)):
            counts = counted(flat_ground(), sight, EXACT, one_cell(30.0), [[0.0, 0.0, up]], DOWN, [0.0])
            assert counts.outcome[0] == outcome
            assert counts.ground_sample_m[0] == (pytest.approx(up / focal_px) if outcome == OBSERVED else math.inf)


def test_passes_are_separate_when_the_cell_was_out_of_sight_for_longer_than_the_gap():
    sight = Sight(SPHERE, 100.0, 0.0, -1.0, NO_LINE_OF_SIGHT)
    eye = np.repeat([[0.0, 0.0, 80.0]], 5, axis=0)
    axes = np.repeat(DOWN, 5, axis=0)
    times = [0.0, 1.5, 3.1, 4.0, 9.0]
    assert counted(flat_ground(), sight, EXACT, one_cell(), eye, axes, times).passes[0] == 3


@deterministic
@given(seeds, sights, st.floats(0.01, 0.4), st.floats(0.0, 0.4), st.sampled_from([0.0, 0.1]))
def test_sure_and_possible_bound_what_any_error_would_have_made(seed, sight, horizontal, vertical, turn):
    rng = np.random.default_rng(seed)
    surface = rough_ground(seed)
    cells = cells_on(surface, seed)
    eyes, axes, times = some_looks(rng, 1, tilt=0.3)
    # Beyond the data nothing is seen, and no error bound speaks of that: the eye stays inside wherever it is moved.
    eyes[:, :2] = np.clip(eyes[:, :2], [-0.6, 2.4], [3.6, 5.6])
    camera = Camera(
        math.nan, 1.0, math.hypot(horizontal, vertical), horizontal, vertical + horizontal * surface.steepest, turn
    )
    tops = tops_of(axes, rng.uniform(0.0, math.tau))
    counts = counted(surface, sight, camera, cells, eyes, axes, times, tops=tops)
    observed = counts.outcome == OBSERVED
    assert not (counts.sure & ~observed).any()
    assert not (observed & ~counts.possible).any()
    for _ in range(cases(compiled=30, interpreted=5)):
        angle, radius = rng.uniform(0.0, math.tau), horizontal * math.sqrt(rng.random())
        by = np.array([radius * math.cos(angle), radius * math.sin(angle), rng.uniform(-vertical, vertical)])
        moved = eyes + by
        error = rng.normal(size=3)
        error *= turn * rng.random() / np.linalg.norm(error)
        turned, turned_tops = (Rotation.from_rotvec(error).apply(rows) for rows in (axes, tops))
        other = counted(surface, sight, EXACT, cells, moved, turned, times, tops=turned_tops).outcome == OBSERVED
        assert not (counts.sure & ~other).any()
        assert not (other & ~counts.possible).any()


@deterministic
@given(seeds, sights, st.sampled_from([2, 3]), st.sampled_from([0.1, 0.3]), st.floats(0.2, 1.5))
def test_sure_and_possible_bound_how_often_a_cell_is_seen_from_places_that_are_apart(
    seed, sight, needed, horizontal, apart
):
    rng = np.random.default_rng(seed)
    surface = rough_ground(seed)
    cells = cells_on(surface, seed)
    eyes, axes, times = some_looks(rng, 6, tilt=0.3)
    eyes[:, :2] = np.clip(eyes[:, :2], [-0.6, 2.4], [3.6, 5.6])
    tops = tops_of(axes)
    lift = horizontal * surface.steepest
    camera = Camera(math.nan, 0.0, horizontal, horizontal, lift, 0.0, needed, apart)
    counts = counted(surface, sight, camera, cells, eyes, axes, times, tops=tops)
    certainly, possibly = counts.sure >= needed, counts.possible >= needed
    for _ in range(6):
        angle, radius = rng.uniform(0.0, math.tau, 6), horizontal * np.sqrt(rng.random(6))
        moved = eyes + np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(6)])
        by_look = [
            counted(surface, sight, EXACT, cells, *(rows[k : k + 1] for rows in (moved, axes, times)), tops=tops[[k]])
            for k in range(6)
        ]
        often = np.zeros(len(certainly), dtype=bool)
        for some in itertools.combinations(range(6), needed):
            if all(math.dist(moved[i], moved[j]) >= apart for i, j in itertools.combinations(some, 2)):
                often |= np.all([by_look[k].outcome == OBSERVED for k in some], axis=0)
        assert not (certainly & ~often).any()
        assert not (often & ~possibly).any()


def test_a_sure_cell_keeps_its_distance_from_the_edge_of_the_view():
    radius = 80.0
    sight = Sight(CONE, 500.0, 1.0, 0.0, NO_LINE_OF_SIGHT)
    camera = Camera(900.0, 1.0, 5.0, 5.0, 0.0, 0.0)
    eye = [[0.0, 0.0, 80.0]]

    def at(east):
        counts = counted(flat_ground(), sight, camera, one_cell(east), eye, DOWN, [0.0])
        return bool(counts.sure[0]), bool(counts.outcome[0] == OBSERVED), bool(counts.possible[0])

    assert at(radius - 8.0) == (True, True, True)
    assert at(radius - 4.0) == (False, True, True)
    assert at(radius + 4.0) == (False, False, True)
    assert at(radius + 8.0) == (False, False, False)
    disc = Sight(DISC, 80.0, 0.0, -1.0, NO_LINE_OF_SIGHT)
    sure = [counted(flat_ground(), disc, camera, one_cell(e), eye, DOWN, [0.0]).sure[0] for e in (74.9, 75.1)]
    assert sure == [True, False]

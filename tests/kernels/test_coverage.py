import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.compiled_kernels import cases
from tests.kernels.test_obstacles import obstacles_of
from tests.naive import coverage as naive
from tests.naive import plan_coverage as naive_photos
from uavcover.kernels import coverage as kernels
from uavcover.kernels.cells import Cells, in_line_of_sight
from uavcover.kernels.obstacles import horizons, roofs_m
from uavcover.kernels.sight import (
    CONE,
    DISC,
    FRUSTUM,
    MIDPOINT,
    NO_LINE_OF_SIGHT,
    RAY,
    SPHERE,
    Aim,
    Sight,
    in_view,
    level_aim,
)
from uavcover.kernels.skyline import skylines
from uavcover.kernels.surface import gradients, heights
from uavcover.terrain.ground import grid_ground, sine_cosine_ground

deterministic = settings(derandomize=True, deadline=None, max_examples=cases(compiled=25, interpreted=6))


def make_sight(pitch_deg, heading_deg, **numbers):
    """A sight with angles in degrees; a heading of None turns with the vehicle."""
    pitch = math.radians(pitch_deg)
    heading = math.nan if heading_deg is None else math.radians(heading_deg)
    return Sight(
        cos_pitch=math.cos(pitch), sin_pitch=math.sin(pitch), heading_e=math.sin(heading), heading_n=math.cos(heading),
        **numbers,
    )  # fmt: skip


sights = st.builds(
    make_sight,
    kind=st.sampled_from([SPHERE, DISC, CONE, FRUSTUM, FRUSTUM]),
    reach_m=st.sampled_from([0.7, 2.0, 3.3]),
    tan_half_fov=st.sampled_from([0.4, 1.3]),
    cos_max_incidence=st.sampled_from([0.0, 0.6, 0.9]),
    line_of_sight=st.sampled_from([NO_LINE_OF_SIGHT, RAY, MIDPOINT]),
    tan_half_along=st.sampled_from([0.3, 0.9]),
    pitch_deg=st.sampled_from([-90.0, -71.0, -30.0]),
    heading_deg=st.sampled_from([None, 40.0, 290.0]),
    sample_focal_m=st.sampled_from([math.inf, 1.2]),
)


def rough_ground(seed, *, gaps=False):
    """A small grid; with an odd seed two boxes and a court stand on it."""
    rng = np.random.default_rng(seed)
    nodes = rng.uniform(-1.0, 1.0, (5, 6)) * rng.choice([0.2, 1.0, 3.0])
    if gaps:
        nodes[rng.integers(5), rng.integers(6)] = math.nan
    bare = grid_ground(nodes, east0_m=-1.0, north0_m=2.0, step_m=1.0, source="test", vertical_datum="local").surface
    if seed % 2 == 0:
        return bare
    prisms = []
    for _ in range(3):
        east, north = rng.uniform([-0.5, 2.3], [2.5, 4.5])
        box = shapely.affinity.rotate(shapely.box(east, north, east + 1.1, north + 0.7), rng.uniform(0.0, 90.0))
        prisms.append((box, rng.uniform(0.0, 3.0)))
    prisms[0] = (prisms[0][0].difference(prisms[0][0].buffer(-0.2)), prisms[0][1])
    return bare._replace(obstacles=obstacles_of(prisms))


def cells_on(surface, seed=0):
    """Cells of 0.45 on most of the lattice, in a shuffled order, none without data below; scattered for every third seed."""
    rng = np.random.default_rng(seed)
    east0, north0, size = -0.8, 2.1, 0.45
    east, north = np.meshgrid(east0 + np.arange(10) * size, north0 + np.arange(8) * size)
    scatter = 0.5 * size if seed % 3 == 2 else 0.0
    moved = np.random.default_rng([seed, 1])
    east, north = east + moved.uniform(-scatter, scatter, (8, 1)), north + moved.uniform(-scatter, scatter, 10)
    up = heights(surface, east.ravel(), north.ravel()).reshape(east.shape)
    roof = roofs_m(surface.obstacles, east.ravel(), north.ravel()).reshape(up.shape)
    up = np.maximum(up, roof)
    there = np.isfinite(up) & (rng.random(up.shape) < 0.8)
    lattice = np.full(up.shape, -1, dtype=np.int32)
    lattice[there] = rng.permutation(int(there.sum()))
    order = np.argsort(lattice[there])
    positions = np.column_stack([east[there], north[there], up[there]])[order]
    slopes = gradients(surface, np.ascontiguousarray(positions[:, 0]), np.ascontiguousarray(positions[:, 1]))
    slopes[np.isfinite(roof[there][order])] = 0.0
    normals = np.column_stack([-slopes, np.ones(len(positions))])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    horizon = horizons(surface.obstacles, lattice, positions, east0, north0, size, 100.0)
    skyline = skylines(surface.obstacles, positions, horizon, reach_m=100.0, flattest=(seed % 4) / 4.0)
    scatter_m = scatter * math.sqrt(2.0)
    for array in (lattice, positions, normals, horizon):
        array.setflags(write=False)
    return Cells(east0, north0, size, lattice, positions, normals, horizon, scatter_m, skylines=skyline)


def eyes_over(seed, count=3):
    rng = np.random.default_rng(seed)
    # Some of them outside the lattice, some outside the grid, some under the ground.
    return rng.uniform([-2.0, 1.5, -1.0], [5.0, 6.5, 3.5], (count, 3))


NORTH = np.array([[0.0, 1.0]])
DOWN = Aim(0.0, 0.0, -1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0)


def north(eyes):
    """For sensors that see the same whatever the heading."""
    return np.tile([0.0, 1.0], (len(eyes), 1))


def headings_of(seed, count):
    """Of any length; the first is none at all."""
    headings = np.random.default_rng(seed + 1).normal(size=(count, 2))
    headings[0] = 0.0
    return headings


@deterministic
@given(sights, st.integers(0, 1000), st.booleans())
def test_seen_cells_equal_the_naive_twin(sight, seed, gaps):
    surface = rough_ground(seed, gaps=gaps)
    cells = cells_on(surface, seed)
    eyes, headings = eyes_over(seed), headings_of(seed, 3)
    expected = naive.first_observed(surface, sight, cells, eyes, headings)
    assert kernels.first_observed(surface, sight, cells, eyes, headings).tolist() == expected
    assert kernels.observed_from_points(surface, sight, cells, eyes, headings).tolist() == [k >= 0 for k in expected]


@deterministic
@given(sights, st.integers(0, 1000), st.sampled_from([1, 2, 3]), st.sampled_from([0.0, 0.8]))
def test_cells_seen_often_equal_the_naive_twin(sight, seed, needed, apart_m):
    surface = rough_ground(seed)
    cells = cells_on(surface, seed)
    eyes = np.random.default_rng(seed).uniform([0.0, 3.0, 0.5], [3.0, 5.0, 3.0], (7, 3))
    headings = headings_of(seed, 7)
    expected = naive.observed_often(surface, sight, cells, eyes, headings, needed, apart_m)
    assert kernels.observed_often(surface, sight, cells, eyes, headings, needed, apart_m).tolist() == expected
    if needed == 1:
        assert kernels.first_observed(surface, sight, cells, eyes, headings).tolist() == expected


@deterministic
@given(sights, st.integers(0, 1000))
def test_each_pair_equals_the_naive_twin(sight, seed):
    surface = rough_ground(seed)
    cells = cells_on(surface, seed)
    count = len(cells.centre_m)
    eyes = cells.centre_m + np.random.default_rng(seed).uniform([-2, -2, 0], [2, 2, 3], (count, 3))
    headings = headings_of(seed, count)
    rows = [array.tolist() for array in (eyes, cells.centre_m, cells.normal, headings)]
    expected = [naive.observes(surface, sight, *row) for row in zip(*rows, strict=True)]
    assert kernels.observes_each(surface, sight, eyes, headings, cells.centre_m, cells.normal).tolist() == expected
    for i in range(count):
        aim = level_aim(sight, *headings[i])
        assert kernels.observes(surface, sight, aim, eyes[i], cells.centre_m[i], cells.normal[i]) == expected[i]
        view = in_view(sight, aim, *(eyes[i] - cells.centre_m[i]), *cells.normal[i])
        assert view == naive.in_view(sight, *(row[i] for row in rows))
        clear = in_line_of_sight(surface, sight, eyes[i], cells.centre_m[i])
        assert (view and clear) == expected[i]


@deterministic
@given(sights, st.integers(0, 1000))
def test_above_the_analytic_surface_the_naive_twin_agrees(sight, seed):
    surface = sine_cosine_ground(1.5).surface
    cells = cells_on(surface, seed)
    eyes, headings = eyes_over(seed, 2), headings_of(seed, 2)
    expected = naive.first_observed(surface, sight, cells, eyes, headings)
    assert kernels.first_observed(surface, sight, cells, eyes, headings).tolist() == expected


@deterministic
@given(st.integers(0, 1000), st.booleans())
def test_the_shortcut_by_the_steepest_slope_never_changes_an_answer(seed, analytic):
    surface = sine_cosine_ground(1.5).surface if analytic else rough_ground(seed)
    slow = surface._replace(steepest=math.inf)
    assert surface.steepest < math.inf
    cells = cells_on(surface, seed)
    # High enough for the shortcut to be taken often; some places lie outside the grid.
    eyes = np.random.default_rng(seed).uniform([-3.0, 0.0, 0.0], [6.0, 8.0, 15.0], (6, 3))
    for eye in eyes:
        sight = Sight(SPHERE, 20.0, 0.0, -1.0, RAY)
        fast_observed = kernels.observed_from_points(surface, sight, cells, eye[None], NORTH)
        slow_observed = kernels.observed_from_points(slow, sight, cells, eye[None], NORTH)
        assert fast_observed.tolist() == slow_observed.tolist()


def test_obstacles_hide_and_a_gap_is_seen_when_they_are_taken_away():
    sight = Sight(CONE, 300.0, 1.0, -1.0, RAY)
    flat = grid_ground(np.zeros((9, 9)), east0_m=-80, north0_m=-80, step_m=20, source="", vertical_datum="").surface
    wall = flat._replace(obstacles=obstacles_of([(shapely.box(20.0, -30.0, 25.0, 30.0), 30.0)]))
    eye, up = np.array([0.0, 0.0, 60.0]), np.array([0.0, 0.0, 1.0])
    # The ray over the wall's far edge comes down at 60 / 30 times its distance; past its end nothing hides.
    for position, hidden in (((49.9, 0.0), True), ((50.1, 0.0), False), ((15.0, 0.0), False), ((25.0, 50.0), False)):
        centre = np.array([*position, 0.0])
        assert kernels.observes(flat, sight, DOWN, eye, centre, up)
        assert kernels.observes(wall, sight, DOWN, eye, centre, up) != hidden
    assert kernels.observes(wall, sight, DOWN, eye, np.array([22.0, 0.0, 30.0]), up), "its roof"


def test_regression_shortcut_saw_from_outside_the_data():
    surface = grid_ground(np.zeros((3, 3)), east0_m=0, north0_m=0, step_m=1, source="", vertical_datum="").surface
    sight = Sight(SPHERE, 20.0, 0.0, -1.0, RAY)
    centre, normal = np.array([1.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
    assert kernels.observes(surface, sight, DOWN, np.array([2.0, 1.0, 9.0]), centre, normal)
    assert not kernels.observes(surface, sight, DOWN, np.array([2.5, 1.0, 9.0]), centre, normal)


def test_regression_a_place_that_is_not_finite_saw_everything():
    for surface in (rough_ground(1), sine_cosine_ground(1.0).surface):
        cells = cells_on(surface)
        for axis in range(3):
            for bad in (math.nan, math.inf, -math.inf):
                eye = np.array([[1.0, 4.0, 3.0]])
                eye[0, axis] = bad
                for kind in (SPHERE, DISC, CONE):
                    for line_of_sight in (NO_LINE_OF_SIGHT, RAY, MIDPOINT):
                        sight = Sight(kind, 9.0, 1.0, -1.0, line_of_sight)
                        assert not kernels.observed_from_points(surface, sight, cells, eye, north(eye)).any()
                        assert not kernels.observes_each(
                            surface, sight, eye, north(eye), cells.centre_m[:1], cells.normal[:1]
                        )[0]


def test_no_data_is_never_seen_through():
    nodes = np.zeros((3, 12))
    nodes[:, 5] = math.nan
    surface = grid_ground(nodes, east0_m=0, north0_m=0, step_m=1, source="", vertical_datum="").surface
    centre, normal = np.array([2.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
    sight = Sight(SPHERE, 50.0, 0.0, -1.0, RAY)
    assert kernels.observes(surface, sight, DOWN, np.array([3.9, 1.0, 1.0]), centre, normal)
    # Beyond the gap, and above it, however high.
    assert not kernels.observes(surface, sight, DOWN, np.array([9.0, 1.0, 1.0]), centre, normal)
    assert not kernels.observes(surface, sight, DOWN, np.array([9.0, 1.0, 40.0]), centre, normal)
    assert not kernels.observes(surface, sight, DOWN, np.array([4.5, 1.0, 40.0]), centre, normal)
    midpoint = sight._replace(line_of_sight=MIDPOINT)
    assert not kernels.observes(surface, midpoint, DOWN, np.array([8.0, 1.0, 40.0]), centre, normal)


def test_a_wall_hides_what_is_behind_it():
    nodes = np.zeros((3, 21))
    nodes[:, 10] = 5.0
    surface = grid_ground(nodes, east0_m=0, north0_m=0, step_m=1, source="", vertical_datum="").surface
    centre, normal = np.array([5.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
    ray = Sight(SPHERE, 50.0, 0.0, -1.0, RAY)
    # By the intercept theorem the wall of 5 m at 5 m just hides a place 10 m away below 10 m.
    assert not kernels.observes(surface, ray, DOWN, np.array([15.0, 1.0, 9.99]), centre, normal)
    assert kernels.observes(surface, ray, DOWN, np.array([15.0, 1.0, 10.01]), centre, normal)
    # The paper's midpoint test looks only at the middle: a wall elsewhere escapes it.
    midpoint = ray._replace(line_of_sight=MIDPOINT)
    assert kernels.observes(surface, midpoint, DOWN, np.array([19.0, 1.0, 3.0]), centre, normal)
    assert not kernels.observes(surface, ray, DOWN, np.array([19.0, 1.0, 3.0]), centre, normal)
    assert kernels.observes(
        surface, ray._replace(line_of_sight=NO_LINE_OF_SIGHT), DOWN, np.array([19.0, 1.0, 3.0]), centre, normal
    )


@pytest.mark.parametrize(
    ("sight", "radius"),
    [
        (Sight(SPHERE, 5.0, 0.0, -1.0, RAY), 4.0),
        (Sight(DISC, 5.0, 0.0, -1.0, NO_LINE_OF_SIGHT), 5.0),
        (Sight(CONE, 50.0, 0.5, -1.0, RAY), 1.5),
        (Sight(CONE, 5.0, 9.0, -1.0, RAY), 4.0),
        (Sight(CONE, 50.0, 9.0, math.cos(math.atan(0.75)), RAY), 2.25),
    ],
    ids=["sphere", "disc", "cone by its angle", "cone by its range", "cone by incidence"],
)
def test_reach_on_flat_ground_from_three_metres(sight, radius):
    surface = grid_ground(np.zeros((2, 2)), east0_m=-9, north0_m=-9, step_m=18, source="", vertical_datum="").surface
    eye, up = np.array([0.0, 0.0, 3.0]), np.array([0.0, 0.0, 1.0])
    for angle in np.arange(0.0, 6.0, 0.7):
        direction = np.array([math.cos(angle), math.sin(angle), 0.0])
        assert kernels.observes(surface, sight, DOWN, eye, direction * (radius - 1e-6), up)
        assert not kernels.observes(surface, sight, DOWN, eye, direction * (radius + 1e-6), up)


def test_a_cell_exactly_at_the_reach_is_seen():
    surface = grid_ground(np.zeros((2, 2)), east0_m=-9, north0_m=-9, step_m=18, source="", vertical_datum="").surface
    centre = np.array([[0.1 * k, 0.0, 0.0] for k in range(8)])
    lattice, normals = np.arange(8, dtype=np.int32)[None], np.tile([0.0, 0.0, 1.0], (8, 1))
    horizon = np.zeros(8)
    for array in (lattice, centre, normals, horizon):
        array.setflags(write=False)
    cells = Cells(0.0, 0.0, 0.1, lattice, centre, normals, horizon)
    for radius in (0.3, 0.30000000000000004, 0.7):
        sight = Sight(DISC, radius, 0.0, -1.0, NO_LINE_OF_SIGHT)
        observed = kernels.observed_from_points(surface, sight, cells, np.zeros((1, 3)), NORTH)
        assert observed.tolist() == (centre[:, 0] ** 2 <= radius**2).tolist()


def test_a_camera_never_sees_upwards():
    surface = grid_ground(np.zeros((2, 2)), east0_m=-9, north0_m=-9, step_m=18, source="", vertical_datum="").surface
    camera = Sight(CONE, 9.0, 1.0, -1.0, NO_LINE_OF_SIGHT)
    centre, normal = np.array([0.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    assert kernels.observes(surface, camera, DOWN, np.array([0.0, 0.0, 1.0]), centre, normal)
    assert not kernels.observes(surface, camera, DOWN, np.array([0.0, 0.0, -1.0]), centre, normal)
    assert not kernels.observes(surface, camera, DOWN, np.array([0.0, 0.0, 0.0]), centre, normal)


def test_no_look_sees_nothing():
    surface = rough_ground(3)
    cells = cells_on(surface)
    sight = Sight(DISC, 1.0, 0.0, -1.0, NO_LINE_OF_SIGHT)
    assert kernels.observed_from_points(surface, sight, cells, np.empty((0, 3)), np.empty((0, 2))).sum() == 0
    assert set(kernels.first_observed(surface, sight, cells, np.empty((0, 3)), np.empty((0, 2))).tolist()) == {-1}


@deterministic
@given(st.integers(0, 5), st.integers(0, 1000), st.sampled_from([0.3, 1.0, 50.0]))
def test_samples_of_a_path_equal_the_naive_twin(count, seed, spacing):
    route = np.random.default_rng(seed).choice([0.0, 0.1, 1.0, 2.7], (count, 3))
    route.setflags(write=False)
    samples = kernels.sample_path(route, spacing)
    expected = np.array(naive.sample_path(route.tolist(), spacing)).reshape(-1, 3)
    np.testing.assert_allclose(samples, expected, rtol=0, atol=1e-12)
    # Waypoints are among them to the last bit.
    assert {tuple(p) for p in route.tolist()} <= {tuple(p) for p in samples.tolist()}
    gaps = np.linalg.norm(np.diff(samples, axis=0), axis=1)
    assert (gaps <= spacing * (1 + 1e-8)).all()


@pytest.mark.parametrize("distance", [0.7, 3.0, 10.0, 45.0])
def test_pictures_are_taken_where_the_last_one_is_far_enough_away(distance):
    """By the definition: none is nearer to the one before it, and no place on the way between is as far from it."""
    rng = np.random.default_rng(round(10 * distance))
    for number in range(12):
        path = rng.uniform(0.0, 30.0, (rng.integers(2, 9), 3))
        if number % 3 == 0:
            path = np.round(path / distance) * distance  # lengths that the trigger divides
        if number % 4 == 0:
            path = np.repeat(path, 2, axis=0)
        legs, fractions = kernels.photo_positions(path, distance)
        assert (legs[0], fractions[0]) == (0, 0.0)
        assert (np.diff(legs) >= 0).all()
        assert ((fractions >= 0.0) & (fractions <= 1.0)).all()
        ends = np.minimum(legs + 1, len(path) - 1)
        positions = (path[legs] + fractions[:, None] * (path[ends] - path[legs]))[:, :2]
        np.testing.assert_allclose(np.linalg.norm(np.diff(positions, axis=0), axis=1), distance, rtol=1e-7)
        paths = [*zip(legs + fractions, [*(legs + fractions)[1:], len(path) - 1.0], strict=True)]
        for position, (begin, end) in zip(positions, paths, strict=True):
            at = np.linspace(begin, end, 400)[:-1] if end < len(path) - 1.0 else np.linspace(begin, end, 400)
            leg = np.minimum(at.astype(int), len(path) - 2)
            on = path[leg] + (at - leg)[:, None] * (path[leg + 1] - path[leg])
            assert np.linalg.norm(on[:, :2] - position, axis=1).max() < distance * (1.0 + 1e-6)


def test_pictures_equal_those_of_a_naive_flight():
    path = np.array([[0.0, 0.0, 5.0], [23.0, 4.0, 9.0], [25.0, 30.0, 9.0], [25.0, 30.0, 20.0], [2.0, 33.0, 6.0]])
    legs, fractions = kernels.photo_positions(path, 7.3)
    flown, _ = naive_photos.trigger(path, 7.3, step_m=0.002)
    np.testing.assert_allclose(path[legs] + fractions[:, None] * (path[legs + 1] - path[legs]), flown, atol=0.02)


def test_pictures_of_paths_that_are_hardly_any():
    nowhere = np.zeros((0, 3))
    assert [part.size for part in kernels.photo_positions(nowhere, 5.0)] == [0, 0]
    for path in (
        np.ones((1, 3)),
        np.ones((4, 3)),
        np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 90.0]]),
        np.full((3, 3), np.nan),
    ):
        assert [part.tolist() for part in kernels.photo_positions(path, 5.0)] == [[0], [0.0]]
    gap = np.array([[0.0, 0.0, 0.0], [np.nan, 0.0, 0.0], [6.0, 0.0, 0.0], [12.0, 0.0, 0.0]])
    assert [part.tolist() for part in kernels.photo_positions(gap, 5.0)] == [[0, 2, 2], [0.0, 0.0, 5.0 / 6.0]]

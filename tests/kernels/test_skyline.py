"""What a skyline tells of a ray is what the obstacles say."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from tests.compiled_kernels import cases
from tests.kernels.test_obstacles import obstacles_of, odd, positions, prism_lists
from tests.naive import obstacles as naive
from uavcover.kernels.obstacles import horizons, keeps_clear
from uavcover.kernels.skyline import (
    BINS,
    CLEAR,
    HIDDEN,
    NO_SKYLINES,
    UNDECIDED,
    beyond_skyline,
    bin_of,
    skyline_row,
    skylines,
)

deterministic = settings(derandomize=True, deadline=None, max_examples=cases(compiled=400, interpreted=30))

REACH_M = 60.0


def skylines_of(obstacles, cells, flattest=0.0):
    lattice = np.arange(len(cells), dtype=np.int32)[None]
    horizon = horizons(obstacles, lattice, cells, cells[0, 0], cells[0, 1], 1e-9, REACH_M)
    return skylines(obstacles, cells, horizon, reach_m=REACH_M, flattest=flattest)


def reported(obstacles, cell, eyes, flattest=0.0):
    """What the skyline of a cell tells of the rays to some eyes."""
    skyline = skylines_of(obstacles, np.array([cell]), flattest)
    row = skyline_row(skyline, 0)
    if row < 0:
        return []
    return [beyond_skyline(skyline.bounds, row, *(np.array(eye) - cell)) for eye in eyes]


def test_bins_go_once_around_counter_clockwise_from_east():
    angles = np.linspace(0.0, 2.0 * math.pi, 10_000, endpoint=False)
    found = [bin_of(math.cos(angle), math.sin(angle)) for angle in angles]
    assert found[0] == 0
    assert set(np.diff(found)) == {0, 1}
    assert found[-1] == BINS - 1
    assert 0 <= bin_of(0.0, 0.0) < BINS


@deterministic
@given(prism_lists, positions, st.lists(positions, min_size=5, max_size=5), st.sampled_from([0.0, 0.4, 2.0]))
def test_no_ray_is_told_to_be_what_it_is_not(prisms, cell, eyes, flattest):
    obstacles, spot = obstacles_of(prisms), shapely.Point(cell[:2])
    assume(not any(footprint.intersects(spot) and top > cell[2] for footprint, top in prisms))
    eyes = [eye for eye in eyes if math.dist(eye[:2], cell[:2]) < REACH_M]
    for eye, tells in zip(eyes, reported(obstacles, cell, eyes, flattest), strict=False):
        if tells == CLEAR:
            assert keeps_clear(obstacles, eye, cell, 0.0, 0.0)
            assert naive.enters(prisms, eye, cell) < 1e-6
        elif tells == HIDDEN:
            assert not keeps_clear(obstacles, eye, cell, 0.0, 0.0)
            assert naive.enters(prisms, eye, cell) > 0.0


@deterministic
@given(
    prism_lists,
    st.tuples(odd, odd),
    st.sampled_from([0.9, 0.9995, 1.0, 1.0005, 1.1]),
    st.floats(1.001, 2.0),
    st.floats(-1.0, 1.0),
    st.booleans(),
)
def test_rays_that_graze_a_top_are_told_right(prisms, position, steeper, beyond, aside, corner):
    """As steep as the way to where a ray enters a footprint, or a little more or less; also through corners."""
    (footprint, top), *_ = prisms
    cell = (*position, top - 5.0)
    obstacles, spot = obstacles_of(prisms), shapely.Point(position)
    assume(footprint.distance(spot) > 0.1)
    assume(not any(other.intersects(spot) and high > cell[2] for other, high in prisms))
    target = np.array(footprint.exterior.coords[0] if corner else footprint.representative_point().coords[0])
    path = target - position
    if not corner:
        path = path + aside * np.array([-path[1], path[0]]) * 0.2
    far = np.array(position) + beyond * path
    entry = footprint.intersection(shapely.LineString([position, far])).distance(spot)
    assume(0.0 < entry < REACH_M and math.dist(far, position) < REACH_M)
    eye = (*far, cell[2] + steeper * 5.0 / entry * math.dist(far, position))
    for tells in reported(obstacles, cell, [eye]):
        assert tells == UNDECIDED or (tells == CLEAR) == keeps_clear(obstacles, eye, cell, 0.0, 0.0)


def test_a_skyline_decides_nearly_all_rays_past_a_house():
    house = obstacles_of([(shapely.box(5.0, -10.0, 20.0, 10.0), 12.0)])
    rng = np.random.default_rng(1)
    eyes = [(*rng.uniform(-50.0, 50.0, 2), rng.uniform(0.0, 60.0)) for _ in range(2000)]
    found = np.array(reported(house, (0.0, 0.0, 0.0), eyes))
    true = np.array([keeps_clear(house, eye, (0.0, 0.0, 0.0), 0.0, 0.0) for eye in eyes])
    assert np.mean(found[true] == CLEAR) > 0.95
    assert np.mean(found[~true] == HIDDEN) > 0.8
    assert not (found[true] == HIDDEN).any()
    assert not (found[~true] == CLEAR).any()


@pytest.mark.parametrize(
    ("cell", "expected"),
    [
        ((4.9, 0.0, 0.0), {UNDECIDED, CLEAR, HIDDEN}),
        ((5.005, 0.0, 0.0), {UNDECIDED}),
        ((8.0, 3.0, 2.0), {UNDECIDED}),
    ],
    ids=["beside", "at", "inside"],
)
def test_nothing_is_told_of_a_cell_at_a_wall(cell, expected):
    house = obstacles_of([(shapely.box(5.01, -10.0, 20.0, 10.0), 12.0), (shapely.box(-9.0, -9.0, -3.0, 9.0), 30.0)])
    eyes = [(a, b, c) for a in (-40.0, 2.0, 40.0) for b in (-40.0, 3.0, 40.0) for c in (1.0, 20.0, 400.0)]
    assert set(reported(house, cell, eyes)) == expected


def test_only_cells_that_rays_may_be_hidden_from_have_a_skyline():
    house = obstacles_of([(shapely.box(5.0, -10.0, 20.0, 10.0), 12.0)])
    cells = np.array([[0.0, 0.0, 0.0], [-19.0, 0.0, 0.0], [10.0, 0.0, 12.0]])
    assert skylines_of(house, cells).row.tolist() == [0, 1, -1]
    assert skylines_of(house, cells, flattest=1.0).row.tolist() == [0, -1, -1]
    assert skylines_of(house, cells, flattest=3.0) is NO_SKYLINES
    assert skyline_row(NO_SKYLINES, 2) == -1


def test_of_too_many_cells_none_has_a_skyline(monkeypatch):
    monkeypatch.setattr("uavcover.kernels.skyline._MOST_ROWS", 1)
    house = obstacles_of([(shapely.box(5.0, -10.0, 20.0, 10.0), 12.0)])
    assert skylines_of(house, np.array([[0.0, 0.0, 0.0], [-9.0, 0.0, 0.0]])) is NO_SKYLINES

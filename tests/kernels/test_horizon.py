"""What rises around a cell, against the ground itself along many rays."""

import math

import numpy as np
import pytest
from scipy.ndimage import maximum_filter

from tests.compiled_kernels import cases
from uavcover.kernels.arrays import highest_around
from uavcover.kernels.cells import NO_RISE, Cells
from uavcover.kernels.coverage import first_observed
from uavcover.kernels.horizon import CLEAR_FROM, HIDDEN_BELOW, HIDDEN_BEYOND_M, SECTORS, rises, sector_of
from uavcover.kernels.sight import RAY, SPHERE, Sight
from uavcover.kernels.surface import Surface, heights
from uavcover.scenario.scenario_file import load_scenario
from uavcover.scenario.site import load_site
from uavcover.terrain.ground import grid_ground, sine_cosine_ground

REACH_M = 30.0


def rough(seed: int, *, gap: bool = False, step_m: float = 2.0) -> Surface:
    rng = np.random.default_rng(seed)
    nodes = rng.normal(0.0, 1.0, (44, 49)).cumsum(axis=0) * rng.choice([0.05, 0.5, 2.0])
    nodes[rng.random(nodes.shape) < 0.02] += 15.0
    if gap:
        nodes[20, 21] = math.nan
    return grid_ground(
        nodes, east0_m=-40.0, north0_m=-35.0, step_m=step_m, source="test", vertical_datum="local"
    ).surface


def positions(surface: Surface, count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng([seed, 1])
    where = rng.uniform(-25.0, 30.0, (count, 2))
    up = heights(surface, np.ascontiguousarray(where[:, 0]), np.ascontiguousarray(where[:, 1]))
    # Some stand on a roof.
    return np.column_stack([where, up + np.where(rng.random(count) < 0.2, 4.0, 0.0)])[np.isfinite(up)]


@pytest.mark.parametrize("seed", range(6))
def test_no_ground_in_an_sector_rises_more(seed):
    surface = rough(seed)
    centre = positions(surface, cases(compiled=40, interpreted=3), seed)
    rise = rises(surface, centre, reach_m=REACH_M)[:, CLEAR_FROM]
    rng = np.random.default_rng(seed)
    away = np.concatenate([np.geomspace(1e-3, 3.0, 60), np.linspace(3.0, REACH_M, 300)])
    tight = []
    for k, position in enumerate(centre):
        found = np.zeros(SECTORS)
        for angle in [*rng.uniform(0.0, 2.0 * math.pi, 120), *np.arange(8) * 0.25 * math.pi]:
            east, north = math.cos(angle), math.sin(angle)
            ground = heights(surface, position[0] + away * east, position[1] + away * north)
            tangents = ((ground - position[2]) / away)[np.isfinite(ground)]
            sector = sector_of(east, north)
            assert tangents.max() <= rise[k, sector] + 1e-9
            found[sector] = max(found[sector], tangents.max())
        tight += (found[found > 0.1] / rise[k, found > 0.1]).tolist()
    # On spiky ground it is a bound all the same, and not one that says nothing.
    assert np.median(tight) > 0.3 or len(centre) < 10


def test_no_ground_of_an_elevation_file_rises_more_in_an_sector():
    """On its own grid, whose columns and rows do not run along east and north."""
    surface = load_site(load_scenario("jacksboro")).ground.surface
    rng = np.random.default_rng(2)
    where = rng.uniform(-350.0, 350.0, (cases(compiled=100, interpreted=5), 2))
    centre = np.column_stack([where, heights(surface, *np.ascontiguousarray(where.T))])
    rise = rises(surface, centre, reach_m=100.0)[:, CLEAR_FROM]
    away = np.concatenate([np.geomspace(1e-2, 40.0, 150), np.linspace(40.0, 100.0, 60)])
    tight = []
    for k, position in enumerate(centre):
        for angle in [*rng.uniform(0.0, 2.0 * math.pi, 60), *np.arange(8) * 0.25 * math.pi]:
            east, north = math.cos(angle), math.sin(angle)
            ground = heights(surface, position[0] + away * east, position[1] + away * north)
            # A step of 1 cm is known to 1e-10 m or so.
            steepest = np.nanmax((ground - position[2]) / away)
            assert steepest <= rise[k, sector_of(east, north)] + 1e-7
            tight.append(steepest - rise[k, sector_of(east, north)])
    assert np.median(tight) > -0.3


def test_a_slope_rises_hardly_more_than_it_does():
    east = np.arange(49) * 2.0 - 40.0
    nodes = np.tile(0.5 * east, (44, 1))
    surface = grid_ground(nodes, east0_m=-40.0, north0_m=-35.0, step_m=2.0, source="t", vertical_datum="local").surface
    centre = positions(surface, 30, 1)
    rise = rises(surface, centre[centre[:, 2] <= 0.5 * centre[:, 0] + 1e-9], reach_m=REACH_M)[:, CLEAR_FROM]
    up, down = [sector_of(1.0, by) for by in (0.1, -0.1)], [sector_of(-1.0, by) for by in (0.1, -0.1)]
    assert ((rise[:, up] >= 0.5) & (rise[:, up] < 1.0)).all()
    assert (rise[:, down] < 0.02).all()


def test_a_step_beside_a_cell_rises_on_its_own_side_alone():
    nodes = np.zeros((44, 49))
    nodes[:, 25:] = 20.0
    surface = grid_ground(nodes, east0_m=-40.0, north0_m=-35.0, step_m=2.0, source="t", vertical_datum="local").surface
    # The step is between 8 and 10 m east.
    rise = rises(surface, np.array([[7.0, 0.9, 0.0], [5.0, 0.9, 0.0]]), reach_m=REACH_M)[:, CLEAR_FROM]
    west = [sector_of(-1.0, by) for by in (0.1, -0.1)]
    assert (rise[:, west] < 1e-30).all()
    # 20 m at a distance of 3 and 5 m.
    assert 20.0 / 3.0 <= rise[0, sector_of(1.0, 0.1)] < 10.1
    assert 20.0 / 5.0 <= rise[1, sector_of(1.0, 0.1)] < 7.0


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("flattest", [0.2, 1.4])
def test_ground_that_rises_less_than_the_flattest_ray_is_left_out(seed, flattest):
    surface = rough(seed, gap=seed == 5)
    centre = positions(surface, cases(compiled=60, interpreted=3), seed)
    closely = bool(seed % 2)
    rise = rises(surface, centre, reach_m=REACH_M, flattest=flattest, closely=closely)[:, CLEAR_FROM]
    known = rises(surface, centre, reach_m=REACH_M, closely=closely)[:, CLEAR_FROM]
    least = np.nextafter(np.float32(flattest), np.float32(math.inf))
    np.testing.assert_allclose(rise, np.maximum(known, least), rtol=1e-6)
    assert (rise > least).any()
    assert (rise == least).any() or flattest < 1.0


@pytest.mark.parametrize(
    ("shape", "window"), [((5, 7), (3, 3)), ((1, 1), (9, 9)), ((20, 30), (4, 7)), ((6, 3), (9, 21))]
)
def test_the_highest_around_each_is_that_of_scipy(shape: tuple[int, int], window: tuple[int, int]) -> None:
    values = np.random.default_rng(1).normal(size=shape)
    expected = maximum_filter(values, size=window, mode="constant", cval=-np.inf)
    np.testing.assert_array_equal(highest_around(values, *window), expected)


def test_sectors_are_sixteenths_of_a_turn():
    turns = (np.arange(720) + 0.5) * math.pi / 360.0
    sectors = [sector_of(math.cos(turn), math.sin(turn)) for turn in turns]
    assert sectors == [k // 45 for k in range(720)]


def test_missing_data_within_reach_is_never_clear():
    surface, same = rough(3, gap=True), rough(3)
    gap = np.array([-40.0 + 2.0 * 21, -35.0 + 2.0 * 20])
    centre = positions(same, 60, 3)
    rise, known = rises(surface, centre, reach_m=REACH_M), rises(same, centre, reach_m=REACH_M)
    for k, position in enumerate(centre):
        path = gap - position[:2]
        if np.hypot(*path) < REACH_M:
            assert rise[k, CLEAR_FROM, sector_of(*path)] > 1e5
        if np.hypot(*path) > REACH_M + 12.0:
            np.testing.assert_array_equal(rise[k], known[k])


def test_beside_the_edge_of_the_data_nothing_is_known():
    surface = rough(4)
    assert (rises(surface, np.array([[-39.0, 0.0, 900.0]]), reach_m=5.0)[:, CLEAR_FROM] == math.inf).all()


def test_where_it_would_not_pay_nothing_is_bounded():
    assert rises(sine_cosine_ground(1.0).surface, np.zeros((3, 3)), reach_m=5.0).shape == (0, 3, SECTORS)
    assert rises(rough(1), np.zeros((0, 3)), reach_m=5.0).shape == (0, 3, SECTORS)
    assert rises(rough(1), np.zeros((2, 3)), reach_m=1e5).shape == (0, 3, SECTORS)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("gap", [False, True])
def test_the_same_is_seen_with_bounds_and_without(seed, gap):
    surface = rough(seed, gap=gap)
    rng = np.random.default_rng(seed)
    size = 4.0
    east, north = np.meshgrid(-20.0 + size * np.arange(10), -18.0 + size * np.arange(9))
    up = heights(surface, east.ravel(), north.ravel())
    there = np.isfinite(up)
    lattice = np.full(east.shape, -1, dtype=np.int32)
    lattice.ravel()[there] = np.arange(there.sum())
    centre = np.column_stack([east.ravel(), north.ravel(), up])[there]
    normal = np.tile([0.0, 0.0, 1.0], (len(centre), 1))
    rise = rises(surface, centre, reach_m=REACH_M, closely=bool(seed % 2))
    for array in (lattice, centre, normal, rise):
        array.flags.writeable = False
    horizon = np.zeros(len(centre))
    horizon.flags.writeable = False
    bare = Cells(-20.0, -18.0, size, lattice, centre, normal, horizon)
    bounded = bare._replace(rise=rise)
    sight = Sight(SPHERE, REACH_M, 0.0, -1.0, RAY)
    eyes = np.column_stack([rng.uniform(-30.0, 30.0, (25, 2)), np.nanmax(surface.up_m) + rng.uniform(-20.0, 15.0, 25)])
    headings = np.zeros((25, 2))
    observed = first_observed(surface, sight, bare, eyes, headings)
    np.testing.assert_array_equal(observed, first_observed(surface, sight, bounded, eyes, headings))
    assert len(set(observed.tolist())) > 3
    assert NO_RISE.shape == (0, 3, SECTORS)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("gap", [False, True])
def test_rays_below_the_ground_of_a_whole_ring_are_hidden(seed, gap):
    surface = rough(seed, gap=gap)
    centre = positions(surface, cases(compiled=60, interpreted=3), seed)
    rise = rises(surface, centre, reach_m=REACH_M, closely=True)
    rng = np.random.default_rng(seed)
    known = 0
    for k, position in enumerate(centre):
        for angle in rng.uniform(0.0, 2.0 * math.pi, 60):
            east, north = math.cos(angle), math.sin(angle)
            below, beyond_m = rise[k, [HIDDEN_BELOW, HIDDEN_BEYOND_M], sector_of(east, north)].tolist()
            if below > 0.0:
                known += 1
                away = np.linspace(0.05, beyond_m, 400)
                ground = heights(surface, position[0] + away * east, position[1] + away * north)
                assert np.nanmax(ground - position[2] - away * below) > 0.0
    assert known > 20 or len(centre) < 10 or seed in {1, 2, 4}


def test_a_wall_hides_what_is_behind_it_from_low_rays():
    nodes = np.zeros((44, 49))
    nodes[:, 25:27] = 20.0
    surface = grid_ground(nodes, east0_m=-40.0, north0_m=-35.0, step_m=2.0, source="t", vertical_datum="local").surface
    # The wall is 20 m high from 10 to 12 m east.
    rise = rises(surface, np.array([[5.0, 0.9, 0.0]]), reach_m=REACH_M, closely=True)[0]
    towards = sector_of(1.0, 0.1)
    assert 2.0 < rise[HIDDEN_BELOW, towards] < rise[CLEAR_FROM, towards]
    assert 5.0 < rise[HIDDEN_BEYOND_M, towards] < 9.0
    assert (rise[HIDDEN_BELOW, [sector_of(-1.0, 0.1), sector_of(0.1, 1.0)]] < 0.0).all()

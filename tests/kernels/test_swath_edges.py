"""What a moving sensor sees to both sides, and lines that share the ground evenly."""

import math

import numpy as np
import pytest

from tests.naive import swath_edges as naive
from tests.planner.sites import flat, make_site
from uavcover.kernels.sight import CONE, NO_LINE_OF_SIGHT, SPHERE, Sight, horizontal_reach
from uavcover.kernels.surface import height
from uavcover.kernels.swaths import balance_lines, side_reach
from uavcover.terrain.ground import sine_cosine_ground

SURFACE = sine_cosine_ground(10.0).surface
CAMERA = Sight(CONE, 9.0, 0.7, -1.0, NO_LINE_OF_SIGHT)


@pytest.mark.parametrize("sight", [CAMERA, Sight(SPHERE, 4.0, 0.0, -1.0, NO_LINE_OF_SIGHT)], ids=["cone", "ball"])
def test_the_edge_is_where_small_steps_find_it(sight):
    rng = np.random.default_rng(3)
    for _ in range(40):
        east, north, direction = rng.uniform(0.0, 60.0, 3)
        up = height(SURFACE, east, north) + rng.uniform(1.0, 3.0)
        toward = math.cos(direction), math.sin(direction)
        slope = rng.choice([0.0, 0.4, -0.8])
        expected = naive.side_reach(SURFACE, sight, east, north, up, *toward, slope)
        # Between two steps ground and edge are taken as straight.
        found = side_reach(SURFACE, sight, east, north, up, *toward, slope)
        assert found == pytest.approx(min(expected, horizontal_reach(sight)), abs=0.02 * horizontal_reach(sight))


def gaps(across, heights, along):
    """(n + 1, s) between the strips of lines flown east over the ground, and to the borders at 0 and 20."""
    step = along[1] - along[0]
    edges = np.empty((2 * len(across) + 2, len(along)))
    edges[0], edges[-1] = 0.0, 20.0
    for i, east in enumerate(along.tolist()):
        for k, north in enumerate(across[:, i].tolist()):
            up = height(SURFACE, east, north) + heights[k]
            ahead, behind = (across[k, min(max(i + d, 0), len(along) - 1)] for d in (1, -1))
            slope = (height(SURFACE, east + step, ahead) - height(SURFACE, east - step, behind)) / (2.0 * step)
            edges[2 * k + 1, i] = north - side_reach(SURFACE, CAMERA, east, north, up, 0.0, -1.0, slope)
            edges[2 * k + 2, i] = north + side_reach(SURFACE, CAMERA, east, north, up, 0.0, 1.0, slope)
    return edges[1::2] - edges[::2]


def test_adaptive_swaths_have_like_gaps_everywhere():
    along, heights = np.linspace(0.0, 40.0, 41), np.full(5, 2.5)
    straight = np.repeat(np.linspace(2.0, 18.0, 5)[:, None], 41, axis=1)
    there = np.ones(straight.shape, dtype=bool)
    low, high = np.zeros(41), np.full(41, 20.0)
    before = straight.copy()
    found = balance_lines(SURFACE, CAMERA, 0.0, along, low, high, heights, straight, there, 16, 1)
    np.testing.assert_array_equal(straight, before)
    inner = slice(3, -3)
    assert np.ptp(gaps(found, heights, along)[:, inner], axis=0).max() < 0.15
    assert np.ptp(gaps(straight, heights, along)[:, inner], axis=0).max() > 0.6
    assert (np.diff(found, axis=0) > 0.0).all()


def test_a_line_that_is_not_there_stays_and_takes_no_room():
    along, heights = np.linspace(0.0, 10.0, 11), np.full(3, 2.5)
    rows = np.repeat(np.array([[5.0], [10.0], [15.0]]), 11, axis=1)
    there = np.ones(rows.shape, dtype=bool)
    there[1] = False
    found = balance_lines(
        make_site(flat).ground.surface, CAMERA, 0.0, along, np.zeros(11), np.full(11, 20.0), heights, rows, there, 30, 0
    )
    # On flat ground a strip is 2 x 0.7 x 2.5 wide, so three gaps share 20 - 7.
    gap = 13.0 / 3.0
    np.testing.assert_allclose(found[0], gap + 1.75, atol=0.01)
    np.testing.assert_allclose(found[2], 2.0 * gap + 5.25, atol=0.01)
    np.testing.assert_array_equal(found[1], rows[1])

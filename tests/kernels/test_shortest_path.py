"""Ways past walls against those over all corners of the free ground."""

import numpy as np
import pytest
import shapely

from tests.compiled_kernels import cases
from tests.naive.paths import shortest_length
from uavcover.scenario.airspace.zones import PathAround


def free_ground(rng):
    """A square with a bay, round and square zones, some of them with many corners."""
    zones = [
        shapely.Point(rng.uniform(20, 180, 2)).buffer(rng.uniform(5, 30), quad_segs=int(rng.choice([1, 2, 14])))
        for _ in range(4)
    ]
    zones += [
        shapely.affinity.rotate(shapely.box(x, y, x + 40, y + 6), rng.uniform(0, 90))
        for x, y in rng.uniform(20, 140, (3, 2))
    ]
    left = shapely.box(0, 0, 200, 200).difference(shapely.union_all([*zones, shapely.box(95, 120, 105, 200)]))
    return max(shapely.get_parts(left), key=lambda part: part.area)


@pytest.mark.parametrize("seed", range(cases(compiled=8, interpreted=2)))
def test_ways_are_as_short_as_those_over_all_corners(seed):
    rng = np.random.default_rng([45, seed])
    region = free_ground(rng)
    paths = PathAround(region)
    bent = 0
    for _ in range(3):
        a, b = (paths.inside(position) for position in rng.uniform(0, 200, (2, 2)))
        path = paths.between(a, b)
        bent += len(path) > 2
        assert region.buffer(1e-6).covers(shapely.LineString(path))
        assert np.hypot(*np.diff(path, axis=0).T).sum() == pytest.approx(shortest_length(region, a, b), abs=0.5)
    assert bent


def test_lines_are_clear_when_shapely_says_so():
    rng = np.random.default_rng(46)
    region = free_ground(rng)
    paths, roomy = PathAround(region), region.buffer(1e-7)
    lines = rng.uniform(0, 200, (cases(compiled=400, interpreted=60), 2, 2))
    lines[::5, 1] = lines[::5, 0]
    found = [paths.is_straight(*line) for line in lines]
    assert found == shapely.covers(roomy, shapely.linestrings(lines)).tolist()
    assert len(set(found)) == 2


def test_an_end_that_nothing_sees_ends_the_search():
    region = shapely.box(0, 0, 100, 100).difference(shapely.box(20, 20, 40, 40))
    paths = PathAround(region)
    assert paths.between(np.array([5.0, 30.0]), np.array([30.0, 30.0])) is None
    assert paths.between(np.array([30.0, 30.0]), np.array([90.0, 30.0])) is None

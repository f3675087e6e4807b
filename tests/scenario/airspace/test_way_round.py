"""Ways around: compared with all ways over a graph of corners, and with the region itself."""

import numpy as np
import pytest
import shapely

from tests.naive.ways import shortest_length
from uavcover.scenario.airspace.zones import WayRound


def random_region(rng):
    outer = shapely.box(0, 0, 200, 200).difference(shapely.box(*rng.uniform((80, 120, 100, 200), (100, 160, 130, 220))))
    holes = [shapely.Point(rng.uniform(20, 180, 2)).buffer(rng.uniform(5, 35), quad_segs=2) for _ in range(5)]
    pieces = shapely.get_parts(outer.difference(shapely.union_all(holes)))
    return max(pieces, key=lambda part: part.area)


@pytest.mark.parametrize("seed", range(6))
def test_ways_are_inside_and_the_shortest(seed):
    rng = np.random.default_rng(seed)
    region = random_region(rng)
    ways = WayRound(region)
    for _ in range(4):
        a, b = (ways.inside(place) for place in rng.uniform(0, 200, (2, 2)))
        way = ways.between(a, b)
        np.testing.assert_array_equal(way[[0, -1]], [a, b])
        assert shapely.LineString(way).length == 0.0 or region.buffer(1e-6).covers(shapely.LineString(way))
        # Corners of ways are 2 cm inside.
        assert np.hypot(*np.diff(way, axis=0).T).sum() == pytest.approx(shortest_length(region, a, b), abs=0.5)


def test_there_is_no_way_to_another_piece():
    ways = WayRound(shapely.MultiPolygon([shapely.box(0, 0, 10, 10), shapely.box(20, 0, 30, 10)]))
    assert ways.between(np.array([5.0, 5.0]), np.array([25.0, 5.0])) is None
    assert ways.between(np.array([5.0, 5.0]), np.array([8.0, 5.0])).tolist() == [[5.0, 5.0], [8.0, 5.0]]


def test_places_outside_move_to_the_nearest_inside():
    ways = WayRound(shapely.box(0, 0, 10, 10))
    np.testing.assert_allclose(ways.inside(np.array([15.0, 4.0])), [9.98, 4.0])
    np.testing.assert_array_equal(ways.inside(np.array([5.0, 4.0])), [5.0, 4.0])


def test_nothing_is_in_an_empty_region():
    ways = WayRound(shapely.Polygon())
    assert ways.between(np.array([5.0, 5.0]), np.array([25.0, 5.0])) is None
    assert ways.inside(np.array([5.0, 5.0])).tolist() == [5.0, 5.0]


@pytest.mark.parametrize("seed", range(8))
def test_a_line_is_kept_wherever_it_is_inside(seed):
    """Every place of the line that is well inside is on the way; what is between such pieces is the shortest way."""
    rng = np.random.default_rng(seed)
    region = random_region(rng)
    ways = WayRound(region)
    for _ in range(4):
        a, b = (ways.inside(place) for place in rng.uniform(0, 200, (2, 2)))
        way = ways.along(a, b)
        np.testing.assert_array_equal(way[[0, -1]], [a, b])
        flown = shapely.LineString(way)
        assert region.buffer(1e-6).covers(flown)
        line = shapely.LineString([a, b])
        kept = line.intersection(region.buffer(-0.1))
        assert kept.is_empty or flown.buffer(0.05).covers(kept)
        longest = line.length + sum(2.0 * part.length for part in shapely.get_parts(region.boundary))
        assert flown.length <= longest


def test_a_zone_in_the_middle_of_a_line_does_not_move_its_ends():
    ways = WayRound(shapely.box(0, 0, 100, 700).difference(shapely.box(40, 300, 70, 340)))
    way = ways.along(np.array([50.0, 5.0]), np.array([50.0, 695.0]))
    np.testing.assert_allclose(way, [[50, 5], [50, 300], [40, 300], [40, 340], [50, 340], [50, 695]], atol=0.05)
    assert len(ways.between(np.array([50.0, 5.0]), np.array([50.0, 695.0]))) == 4

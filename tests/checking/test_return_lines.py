"""Lines from many places at once are those from each place alone."""

import math

import numpy as np
import pytest

from tests.checking.worlds import COPTER, PLANE, world
from uavcover.checking.aircraft import Aircraft, return_height_m
from uavcover.checking.return_lines import PIECE_M, cut, lowest_of, return_ways, with_gaps

PLACES = np.array(
    [[300.0, 40.0, 20.0], [0.0, 0.0, 30.0], [1200.0, -700.0, 110.0], [-350.0, 20.0, 61.0], [400.0, 0.0, 5.0]]
)


def test_pieces_are_those_of_linspace() -> None:
    pieces = np.array([1, 3, 7, 2])
    owner, t = cut(pieces)
    assert owner.tolist() == [0] * 2 + [1] * 4 + [2] * 8 + [3] * 3
    assert t.tolist() == np.concatenate([np.linspace(0.0, 1.0, count + 1) for count in pieces]).tolist()


def test_lines_of_equal_number_beside_each_other() -> None:
    first = with_gaps(np.arange(9.0).reshape(3, 3), np.array([0, 0, 1]))
    second = with_gaps(10.0 + np.arange(6.0).reshape(2, 3), np.array([0, 1]))
    both = first + second
    assert both.owner.tolist() == [0, 0, 0, 0, 0, 1, 1, 1, 1]
    assert np.nan_to_num(both.points_m[:, 0], nan=-1.0).tolist() == [0, 3, -1, 10, -1, 6, -1, 13, -1]


@pytest.mark.parametrize("aircraft", [COPTER, PLANE])
def test_the_ways_of_many_places(aircraft: Aircraft) -> None:
    here = world()
    ways = return_ways(here, PLACES, here.alts_amsl_m(PLACES), aircraft)
    least = []
    for k, (place, alt) in enumerate(zip(PLACES, here.alts_amsl_m(PLACES), strict=True)):
        distance = math.hypot(place[0], place[1])
        height = here.home_alt_amsl_m + return_height_m(alt - here.home_alt_amsl_m, distance, aircraft)
        line = []
        for t in np.linspace(0.0, 1.0, max(1, math.ceil(distance / PIECE_M)) + 1):
            up = height
            if aircraft.has_wings:
                rate = aircraft.max_climb_m_s if height > alt else -aircraft.max_descent_m_s
                moved = rate / aircraft.cruise_speed_m_s * t * distance
                up = min(height, alt + moved) if height > alt else max(height, alt + moved)
            line.append(here.at_alts([(1.0 - t) * place[:2]], up)[0])
        own = ways.home.points_m[ways.home.owner == k]
        assert np.isnan(own[-1]).all()
        assert own[:-1] == pytest.approx(np.array(line), abs=1e-9)
        least.append(float(np.nanmin(here.ground.leg_height_ranges_m(np.array(line))[:, 0])))
        if not aircraft.has_wings:
            column = ways.columns.points_m[ways.columns.owner == k]
            assert column[[0, 1, 3, 4]] == pytest.approx(np.array([place, line[0], line[-1], np.zeros(3)]), abs=1e-9)
    lowest, _, number = lowest_of(here, ways.home)
    assert lowest == pytest.approx(min(least), abs=1e-6)
    assert number == int(np.argmin(least))

"""Which flights a pattern has."""

import pytest

from uavcover.errors import InputError
from uavcover.new.survey import SINGLE, views_of
from uavcover.new.tuning import SURVEY


def test_one_flight_chooses_its_own_lines():
    assert views_of(None, along_deg=30.0) == views_of("Single", along_deg=30.0) == (SINGLE,)


@pytest.mark.parametrize("along_deg", [0.0, 44.6, 90.0, 179.7])
def test_lines_of_a_crosshatch_cross_at_right_angles(along_deg):
    along, across = views_of("crosshatch", along_deg=along_deg)
    assert not along.is_tilted
    assert not across.is_tilted
    assert (across.line_heading_deg - along.line_heading_deg) % 180.0 == 90.0
    assert abs((along.line_heading_deg - along_deg + 90.0) % 180.0 - 90.0) <= 0.5


def test_an_oblique_set_looks_straight_down_and_to_four_sides():
    nadir, *tilted = views_of("oblique", along_deg=20.0)
    assert (nadir.pitch_deg, nadir.heading_deg) == (-90.0, None)
    assert [view.heading_deg for view in tilted] == [0.0, 90.0, 180.0, 270.0]
    assert all(view.is_tilted and view.line_heading_deg == view.heading_deg for view in tilted)
    # Level ground in the middle of a picture at 45 degrees counts: sqrt(2) x 2^(1/4) times the sample straight below.
    assert SURVEY.oblique_sample > 2.0**0.75


def test_an_unknown_pattern():
    with pytest.raises(InputError, match=r"^--pattern: must be single, crosshatch or oblique, not 'grid'$"):
        views_of("grid", along_deg=0.0)

"""From what pictures tell to places and directions, and what is said of those that have none."""

import numpy as np
import pytest

from uavcover.errors import TerrainError, TrackError
from uavcover.extras.photos import placing
from uavcover.extras.photos.picture import HeightDatum, Picture
from uavcover.extras.photos.placing import Assumptions, courses_deg, place_pictures
from uavcover.terrain.frames import LocalFrame

FRAME = LocalFrame(46.0, 8.0, 1000.0)


def picture(name="a", **told):
    return Picture(
        **{"name": name, "lat_deg": 46.0, "lon_deg": 8.0, "alt_m": 1100.0, "yaw_deg": 0.0, "pitch_deg": -90.0, **told}
    )


def test_what_a_picture_does_not_tell_is_assumed_and_marked():
    placed = place_pictures(
        [picture(), picture("b", yaw_deg=None, pitch_deg=None, vehicle_yaw_deg=90.0)], FRAME, Assumptions()
    )
    np.testing.assert_allclose(placed.eyes_m, [[0, 0, 100], [0, 0, 100]], atol=1e-6)
    assert placed.direction_known.tolist() == [True, False]
    assert placed.turn_deg.tolist() == [2.0, 10.0]
    assert placed.horizontal_m.tolist() == [3.0, 3.0]
    assert placed.vertical_m.tolist() == [10.0, 10.0]
    np.testing.assert_allclose(placed.tops, [[0, 1, 0], [1, 0, 0]], atol=1e-12)


def test_errors_are_rounded_up_never_down():
    placed = place_pictures(
        [picture(horizontal_error_m=0.013, vertical_error_m=0.21), picture(horizontal_error_m=77.0)],
        FRAME,
        Assumptions(),
    )
    assert placed.horizontal_m.tolist() == [0.05, 77.0]
    assert placed.vertical_m.tolist() == [0.5, 10.0]


def test_pictures_without_a_place_or_a_direction_do_not_count_and_say_why():
    bad = [
        picture("no place", lat_deg=None),
        picture("zero", lat_deg=0.0, lon_deg=0.0),
        picture("swapped", lat_deg=120.0),
        picture("no height", alt_m=None),
        picture("in space", alt_m=1e300),
        picture("turning", yaw_deg=1e9),
        picture("relative", alt_m=None, height_above_takeoff_m=50.0),
        picture("alone", yaw_deg=None, lat_deg=46.01),
    ]
    placed = place_pictures([picture(), *bad], FRAME, Assumptions())
    assert [p.name for p in placed.pictures] == ["a", "alone"]  # the line from a to it is its heading
    assert placed.left_out == {
        "no place": "no position",
        "zero": "position 0, 0 is not on Earth",
        "swapped": "position 120, 8 is not on Earth",
        "no height": "no height",
        "in space": "height 1e+300 m is not possible for a flight",
        "turning": "the angles exceed a full turn",
        "relative": "only a height above take-off; specify --takeoff",
    }
    with pytest.raises(TrackError, match=r"none of the 1 photos can be located \(alone: no direction"):
        place_pictures([bad[-1]], FRAME, Assumptions())


@pytest.mark.parametrize(
    ("left_out", "advised"),
    [
        ({"lat_deg": None}, True),
        ({"lat_deg": None, "fault": "the file is cut off"}, False),
        ({"lat_deg": None, "digital_zoom": 2.0}, False),
        ({"alt_m": None}, False),
    ],
)
def test_a_list_of_positions_is_advised_where_only_these_are_missing(left_out, advised):
    with pytest.raises(TrackError, match="none of the 1 photos") as caught:
        place_pictures([picture(**left_out)], FRAME, Assumptions())
    assert ("add a list of their positions" in str(caught.value)) is advised


def test_heights_above_take_off_count_when_its_place_is_given():
    placed = place_pictures(
        [picture(alt_m=1300.0, height_above_takeoff_m=80.0), picture("b")],
        FRAME,
        Assumptions(takeoff_alt_amsl_m=1005.0),
    )
    np.testing.assert_allclose(placed.eyes_m[:, 2], [85.0], atol=1e-6)
    assert placed.vertical_m.tolist() == [3.0]
    assert placed.left_out == {"b": "no height above the take-off position"}


def test_heights_above_the_ellipsoid_need_the_geoid(monkeypatch):
    above = picture(alt_m=1150.0, datum=HeightDatum.ELLIPSOID)
    placed = place_pictures([above, picture("b")], FRAME, Assumptions(geoid_height_m=50.0))
    np.testing.assert_allclose(placed.eyes_m[:, 2], [100.0, 100.0], atol=1e-6)

    def none():
        raise TerrainError("no grid")

    monkeypatch.setattr(placing, "Undulation", none)
    with pytest.raises(TrackError, match=r"1 photo has a height above the ellipsoid.*--geoid-height"):
        place_pictures([above], FRAME, Assumptions())


def test_the_ends_of_lines_belong_to_their_lines():
    east = np.r_[np.arange(0, 100, 20.0), np.arange(80, -20, -20.0)]
    north = np.r_[np.zeros(5), np.full(5, 40.0)]
    courses = courses_deg(np.column_stack([east, north, np.zeros(10)]))
    np.testing.assert_allclose(courses, [90.0] * 5 + [-90.0] * 5)
    assert np.isnan(courses_deg(np.zeros((3, 3)))).all()
    assert np.isnan(courses_deg(np.zeros((1, 3)))).all()


def test_a_pitch_counts_with_the_vehicles_heading():
    """DJI's tables often have the gimbal's pitch, and of the headings only the vehicle's."""
    placed = place_pictures([picture(pitch_deg=-80.0, yaw_deg=None, vehicle_yaw_deg=90.0)], FRAME, Assumptions())
    np.testing.assert_allclose(placed.axes[0], [np.sin(np.radians(10.0)), 0.0, -np.cos(np.radians(10.0))], atol=1e-12)
    assert (placed.direction_known[0], placed.turn_deg[0]) == (False, 10.0)
    told = {"pitch_deg": -80.0, "yaw_deg": None}
    alone = place_pictures([picture("a", **told), picture("b", **told, lon_deg=8.001)], FRAME, Assumptions())
    np.testing.assert_allclose(alone.axes[0], [0.0, 0.0, -1.0], atol=1e-12)

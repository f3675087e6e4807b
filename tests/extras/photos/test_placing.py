"""Photos in place, and doubts about them."""

from dataclasses import replace

import numpy as np
import pytest

from uavcover.errors import TerrainError, TrackError
from uavcover.extras.photos import placing
from uavcover.extras.photos.photo import HeightDatum, Photo
from uavcover.extras.photos.placing import Assumptions, courses_deg, height_doubts, locate_photos, missing_stretches
from uavcover.terrain.frames import LocalFrame
from uavcover.terrain.ground import grid_ground

FRAME = LocalFrame(46.0, 8.0, 1000.0)


def photo(name="a", **reported):
    return Photo(
        **{
            "name": name,
            "lat_deg": 46.0,
            "lon_deg": 8.0,
            "alt_m": 1100.0,
            "yaw_deg": 0.0,
            "pitch_deg": -90.0,
            **reported,
        }
    )


def test_what_a_picture_does_not_tell_is_assumed_and_marked():
    placed = locate_photos(
        [photo(), photo("b", yaw_deg=None, pitch_deg=None, vehicle_yaw_deg=90.0)], FRAME, Assumptions()
    )
    np.testing.assert_allclose(placed.eyes_m, [[0, 0, 100], [0, 0, 100]], atol=1e-6)
    assert placed.direction_known.tolist() == [True, False]
    assert placed.turn_deg.tolist() == [2.0, 10.0]
    assert placed.horizontal_m.tolist() == [3.0, 3.0]
    assert placed.vertical_m.tolist() == [10.0, 10.0]
    np.testing.assert_allclose(placed.tops, [[0, 1, 0], [1, 0, 0]], atol=1e-12)


def test_errors_are_rounded_up_never_down():
    placed = locate_photos(
        [photo(horizontal_error_m=0.013, vertical_error_m=0.21), photo(horizontal_error_m=77.0)],
        FRAME,
        Assumptions(),
    )
    assert placed.horizontal_m.tolist() == [0.05, 77.0]
    assert placed.vertical_m.tolist() == [0.5, 10.0]


def test_pictures_without_a_place_or_a_direction_do_not_count_and_say_why():
    bad = [
        photo("no place", lat_deg=None),
        photo("zero", lat_deg=0.0, lon_deg=0.0),
        photo("swapped", lat_deg=120.0),
        photo("no height", alt_m=None),
        photo("in space", alt_m=1e300),
        photo("turning", yaw_deg=1e9),
        photo("relative", alt_m=None, height_above_takeoff_m=50.0),
        photo("alone", yaw_deg=None, lat_deg=46.01),
    ]
    placed = locate_photos([photo(), *bad], FRAME, Assumptions())
    assert [p.name for p in placed.photos] == ["a", "alone"]  # the line from a to it is its heading
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
        locate_photos([bad[-1]], FRAME, Assumptions())


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
        locate_photos([photo(**left_out)], FRAME, Assumptions())
    assert ("add a list of their positions" in str(caught.value)) is advised


def test_heights_above_take_off_count_when_its_place_is_given():
    placed = locate_photos(
        [photo(alt_m=1300.0, height_above_takeoff_m=80.0), photo("b")],
        FRAME,
        Assumptions(takeoff_alt_amsl_m=1005.0),
    )
    np.testing.assert_allclose(placed.eyes_m[:, 2], [85.0], atol=1e-6)
    assert placed.vertical_m.tolist() == [3.0]
    assert placed.left_out == {"b": "no height above the take-off position"}


def test_heights_above_the_ellipsoid_need_the_geoid(monkeypatch):
    above = photo(alt_m=1150.0, datum=HeightDatum.ELLIPSOID)
    placed = locate_photos([above, photo("b")], FRAME, Assumptions(geoid_height_m=50.0))
    np.testing.assert_allclose(placed.eyes_m[:, 2], [100.0, 100.0], atol=1e-6)

    def none():
        raise TerrainError("no grid")

    monkeypatch.setattr(placing, "Undulation", none)
    with pytest.raises(TrackError, match=r"1 photo has a height above the ellipsoid.*--geoid-height"):
        locate_photos([above], FRAME, Assumptions())


def test_the_ends_of_lines_belong_to_their_lines():
    east = np.r_[np.arange(0, 100, 20.0), np.arange(80, -20, -20.0)]
    north = np.r_[np.zeros(5), np.full(5, 40.0)]
    courses = courses_deg(np.column_stack([east, north, np.zeros(10)]))
    np.testing.assert_allclose(courses, [90.0] * 5 + [-90.0] * 5)
    assert np.isnan(courses_deg(np.zeros((3, 3)))).all()
    assert np.isnan(courses_deg(np.zeros((1, 3)))).all()


def test_a_pitch_counts_with_the_vehicles_heading():
    """DJI's tables often have the gimbal's pitch, and of the headings only the vehicle's."""
    placed = locate_photos([photo(pitch_deg=-80.0, yaw_deg=None, vehicle_yaw_deg=90.0)], FRAME, Assumptions())
    np.testing.assert_allclose(placed.axes[0], [np.sin(np.radians(10.0)), 0.0, -np.cos(np.radians(10.0))], atol=1e-12)
    assert (placed.direction_known[0], placed.turn_deg[0]) == (False, 10.0)
    reported = {"pitch_deg": -80.0, "yaw_deg": None}
    alone = locate_photos([photo("a", **reported), photo("b", **reported, lon_deg=8.001)], FRAME, Assumptions())
    np.testing.assert_allclose(alone.axes[0], [0.0, 0.0, -1.0], atol=1e-12)


def doubts(photos, *, takeoff_m=None, ground_m=0.0, slope=0.0, home_en_m=None):
    """Of pictures over level or sloping ground, which is ``ground_m`` above the frame's origin at 1000 m."""
    east = np.arange(-1500.0, 1501.0, 50.0)
    up = np.tile(ground_m + slope * east, (east.size, 1))
    ground = grid_ground(up, east0_m=-1500.0, north0_m=-1500.0, step_m=50.0, source="test", vertical_datum="local")
    placed = locate_photos(photos, FRAME, Assumptions(takeoff_alt_amsl_m=takeoff_m, geoid_height_m=48.0))
    return height_doubts(placed, FRAME, ground, by_takeoff=takeoff_m is not None, error_m=10.0, home_en_m=home_en_m)


def line(*, off_m=0.0, drift_m=0.0, **reported):
    """Twenty pictures along a line 80 m above level ground at 1000 m, with heights by satellites that are off."""
    fractions = np.linspace(0.0, 1.0, 20)
    return [
        photo(
            f"p{k}", lat_deg=46.0 + 0.0005 * fraction, height_above_takeoff_m=80.0 + (-1.0) ** k,
            **{"alt_m": 1080.0 + off_m + drift_m * fraction, **reported},
        )
        for k, fraction in enumerate(fractions)
    ]  # fmt: skip


def test_heights_that_fit_are_not_doubted():
    assert doubts(line()) == []
    assert doubts(line(off_m=8.0)) == []
    assert doubts(line(), takeoff_m=1000.0) == []


@pytest.mark.parametrize(("off_m", "words"), [(60.0, "at least 60 m too high"), (-40.0, "at least 40 m too low")])
def test_a_constant_error_is_told_with_its_size(off_m, words):
    reported = doubts(line(off_m=off_m))
    assert len(reported) == 1
    assert words in reported[0]
    assert f"put the take-off at {1000 + off_m:.0f} m" in reported[0]
    assert "--takeoff" in reported[0]


def test_on_a_slope_only_what_no_ground_near_explains_is_told():
    # Within 500 m the ground rises to 1150 m: the take-off may have been there.
    assert doubts(line(off_m=100.0), slope=0.3) == []
    assert "m too high" in doubts(line(off_m=180.0), slope=0.3)[0]


def test_a_planned_home_is_where_the_ground_counts():
    home_en_m = np.array([100.0, 0.0])  # on the slope, at 1030 m
    assert doubts(line(off_m=30.0), slope=0.3, home_en_m=home_en_m) == []
    (reported,) = doubts(line(off_m=100.0), slope=0.3, home_en_m=home_en_m)
    assert "put the take-off 70 m above the ground at the scenario's home" in reported
    # Outside the elevation data the ground around counts, as without a plan.
    assert doubts(line(off_m=100.0), slope=0.3, home_en_m=np.array([9e3, 0.0])) == []


def test_with_the_place_of_take_off_the_error_is_known():
    reported = doubts(line(off_m=-25.0), takeoff_m=1000.0)
    assert len(reported) == 1
    assert "put the take-off 25 m below the ground at --takeoff" in reported[0]


def test_heights_above_the_ellipsoid_are_brought_to_sea_level_first():
    assert doubts(line(off_m=48.0, datum=HeightDatum.ELLIPSOID)) == []
    assert "at least 48 m too low" in doubts(line(datum=HeightDatum.ELLIPSOID))[0]
    # Beside --takeoff they are not compared: the geoid may not be known.
    assert doubts(line(off_m=48.0, datum=HeightDatum.ELLIPSOID), takeoff_m=1000.0) == []


def test_heights_that_drift_are_told_and_several_take_offs_are_named():
    reported = doubts(line(drift_m=30.0))
    assert len(reported) == 1
    assert "drift apart by 2" in reported[0]
    assert "several flights" in reported[0]


def test_one_height_alone_tells_nothing_of_the_other():
    assert doubts([photo(f"p{k}", lat_deg=46.0 + 1e-4 * k, alt_m=1200.0) for k in range(9)]) == []
    assert doubts(line(off_m=60.0)[:2]) == []


def test_pictures_under_the_ground_are_told():
    assert "20 of 20 photos are below ground" in doubts(line(), ground_m=90.0)[0]


def survey(rng, *, by, lines=5, a_line=15, names=True, times=True):
    """A survey of lines 60 m apart with a photo every 20 m: triggered by distance, or every 2 s, also while it turns slowly."""
    positions, seconds, now = [], [], 0.0
    for number in range(lines):
        along = 20.0 * np.arange(a_line)[:: 1 if number % 2 == 0 else -1]
        turn = np.linspace(0.0, 60.0, 7)[1:-1] if by == "time" and number < lines - 1 else []
        for east, north in [*((x, 60.0 * number) for x in along), *((along[-1], 60.0 * number + y) for y in turn)]:
            positions.append(rng.normal((east, north), 0.5))
            seconds.append(round(now))
            now += 2.0
        now += 0.0 if by == "time" else 12.0
    return [
        photo(
            f"IMG_{k:04d}.JPG" if names else f"{chr(65 + k // 26)}{chr(65 + k % 26)}", lat_deg=46.0 + position[1] / 111_195.0,
            lon_deg=8.0 + position[0] / (111_195.0 * np.cos(np.radians(46.0))), alt_m=80.0, vehicle_yaw_deg=90.0,
            time_s=float(seconds[k]) if times else None, clock="clock" if times else None,
        )
        for k, position in enumerate(positions)
    ]  # fmt: skip


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("by", ["distance", "time"])
@pytest.mark.parametrize(("names", "times"), [(True, True), (False, True), (True, False)])
def test_missing_photos_are_found_and_none_where_all_are_there(seed, by, names, times):
    rng = np.random.default_rng(seed)
    whole = survey(rng, by=by, names=names, times=times)
    assert missing_stretches(locate_photos(whole, FRAME, Assumptions())) == []
    per_line = 15 if by == "distance" else 20
    firsts = {line: line * per_line + int(rng.integers(3, 9)) for line in (0, 2, 3)}
    gone = {first + k for line, first in firsts.items() for k in range(line + 1)}
    left = [one for k, one in enumerate(whole) if k not in gone]
    found = missing_stretches(locate_photos(left, FRAME, Assumptions()))
    assert [stretch.photos for stretch in found] == [1, 3, 4]
    assert [stretch.length_m for stretch in found] == pytest.approx([40.0, 80.0, 100.0], abs=5.0)
    assert found[0].usual_m == pytest.approx(20.0, abs=1.5)


def test_a_change_of_batteries_or_of_spacing_lacks_no_photo():
    whole = survey(np.random.default_rng(0), by="distance")
    later = [replace(one, time_s=one.time_s + 900.0) for one in whole[20:]]
    moved = [replace(one, lat_deg=one.lat_deg + 0.002) for one in later]
    assert missing_stretches(locate_photos([*whole[:20], *later], FRAME, Assumptions())) == []
    assert missing_stretches(locate_photos([*whole[:20], *moved], FRAME, Assumptions())) == []
    sparse = survey(np.random.default_rng(1), by="distance")[::2]
    renamed = [replace(one, name=f"B{k:03d}.JPG", time_s=one.time_s + 2000.0) for k, one in enumerate(sparse)]
    assert missing_stretches(locate_photos([*whole, *renamed], FRAME, Assumptions())) == []

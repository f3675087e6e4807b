"""Designs of surveys and their patterns."""

import math

import pytest

from uavcover.errors import InputError
from uavcover.new.catalog import CAMERAS, VEHICLES
from uavcover.new.quantities import SURVEY
from uavcover.new.survey import SINGLE, SurveyWish, design_survey, views_of

M3E = CAMERAS.named("dji-m3e")


def wish(**changes):
    return SurveyWish(**{"camera": M3E, "gsd_m": 0.025, "forward_overlap": 0.75, "side_overlap": 0.7, **changes})


def design(*, slope_deg=5.0, area_m2=250_000.0, **changes):
    return design_survey(wish(**changes), slope_deg=slope_deg, area_m2=area_m2)


def test_a_mavic_3_enterprise_on_level_ground():
    """2.5 cm: 0.025 x 12.29 mm / (17.3 mm / 5280) = 93.77 m; lower end 75 % of it; 13 / 12.29 of the height along the picture."""
    found = design()
    assert found.gsd_height_m == pytest.approx(93.77, abs=0.01)
    assert (found.min_height_agl_m, found.max_height_agl_m) == (71.0, 93.7)
    assert found.photo_distance_m == pytest.approx(0.25 * 71.0 * 13.0 / 12.29)
    assert found.line_distance_m == pytest.approx(0.3 * 0.5 * (71.0 + 93.7) * 17.3 / 12.29)
    assert found.speed_m_s == 10.0
    assert not found.is_capped
    assert found.gsd_at_m(93.7) == pytest.approx(0.025, rel=1e-3)


def test_the_usual_limit_of_height_and_another():
    """The A7R IV with 35 mm would fly 233 m high for 2.5 cm."""
    camera = CAMERAS.named("sony-a7r4-35mm")
    found = design(camera=camera)
    assert found.gsd_height_m == pytest.approx(232.9, abs=0.1)
    assert found.max_height_agl_m == 120.0
    assert found.is_capped
    assert design(camera=camera, ceiling_agl_m=400.0).max_height_agl_m == pytest.approx(232.9, abs=0.1)
    assert not design(camera=camera, ceiling_agl_m=400.0).is_capped


def test_steep_ground_gets_a_deeper_band():
    lows = [design(slope_deg=slope).min_height_agl_m for slope in (0.0, 8.0, 16.0, 25.0, 60.0)]
    assert lows == sorted(lows, reverse=True)
    assert lows[0] == lows[1] > lows[2] > lows[3] == lows[4]


def test_legs_climb_more_steeply_than_the_ground():
    angles = [design(slope_deg=slope).max_climb_angle_deg for slope in (0.0, 15.0, 16.0, 40.0, 64.0, 89.0)]
    assert angles == [30.0, 30.0, 35.0, 55.0, 80.0, 80.0]


def test_the_speed_obeys_the_camera():
    camera = CAMERAS.named("dji-mini-3-pro")  # a picture every 2 s
    found = design(camera=camera)
    assert found.speed_m_s < 10.0
    assert found.photo_distance_m / found.speed_m_s >= 2.0 * 1.1
    assert "the 2 s interval of dji-mini-3-pro" in found.speed_reason
    with pytest.raises(InputError, match=r"^--speed: .* a coarser --gsd or a lower --speed"):
        design(camera=camera, speed_m_s=10.0)
    with pytest.raises(InputError, match=r"^--overlap: .* use less forward overlap"):
        design(camera=camera, forward_overlap=0.95)


def test_the_speed_obeys_the_vehicle():
    assert design(vehicle=VEHICLES.named("px4")).speed_m_s == 5.0
    assert design(vehicle=VEHICLES.named("dji-mini-3-pro")).speed_m_s == 8.0
    with pytest.raises(InputError, match=r"^--speed: 14 m/s exceeds the maximum of px4"):
        design(vehicle=VEHICLES.named("px4"), speed_m_s=14.0)
    assert design(vehicle=VEHICLES.named("dji-m3e")).endurance_s == 2700.0
    assert design(vehicle=VEHICLES.named("dji-m3e"), endurance_s=1500.0).endurance_s == 1500.0


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"gsd_m": 0.002}, "--gsd: 0.2 cm with dji-m3e requires a height of 7.5 m"),
        ({"ceiling_agl_m": 20.0}, "--max-height: 20 m leaves no room for a height band"),
    ],
)
def test_what_cannot_be_flown(changes, words):
    with pytest.raises(InputError) as caught:
        design(**changes)
    assert words in str(caught.value)
    assert ";" in str(caught.value)


@pytest.mark.parametrize("camera", [camera.name for camera in CAMERAS.by_name().values()])
def test_every_camera_has_a_band_that_can_be_planned_in(camera):
    body = CAMERAS.named(camera)
    for slope_deg, top_m in (
        (0.0, SURVEY.lowest_top_m + 8.0),
        (40.0, SURVEY.lowest_top_m + 8.0),
        (0.0, 60.0),
        (20.0, 118.0),
    ):
        found = design(camera=body, gsd_m=top_m / body.focal_px, slope_deg=slope_deg, forward_overlap=0.0)
        assert found.max_height_agl_m <= top_m + 1e-9
        assert found.max_height_agl_m - found.min_height_agl_m > 2.0 * found.height_margin_m + 3.0
        assert found.min_height_agl_m >= 9.0
        assert 0.5 <= found.cell_size_m <= max(found.line_distance_m, 2.0)
        # The corners of a picture are in range.
        half = math.hypot(
            math.tan(math.radians(0.5 * body.fov_across_deg)), math.tan(math.radians(0.5 * body.fov_along_deg))
        )
        assert found.range_m > found.max_height_agl_m * math.hypot(1.0, half)
        if body.min_interval_s is not None:
            assert found.photo_distance_m / found.speed_m_s >= body.min_interval_s


def test_no_margin_and_another():
    assert design(margin_m=0.0).margin_m == 0.0
    assert design(margin_m=33.0).margin_m == 33.0
    # f L along the line is more than s W / 2 across it: 0.75 x 13 / 12.29 x 93.7 m.
    assert design().margin_m == math.ceil(0.75 * 13.0 / 12.29 * 93.7)


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

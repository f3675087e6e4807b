"""How probably pictures find a target, against brute force over every look."""

import dataclasses

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from tests.extras.photos.test_showing import CAMERA, flight, placed
from tests.naive import detection as naive
from tests.planner.sites import HIGH_M, LOW_M, STEP_M, hills, make_site
from uavcover.extras.photos.showing import Detection, detection_document, detection_doubts, shown_cells
from uavcover.kernels.coverage import detection_table, look_probability
from uavcover.new.catalog import CURVES, DetectionCurve
from uavcover.sensing.photos import camera_axes
from uavcover.sensing.site_maps import judging_map

SAMPLES_M = [0.02, 0.025, 0.03, 0.05]
ANGLES_DEG = [0.0, 25.0, 70.0]
PROBABILITY = [[0.9, 0.6, 0.3, 0.05], [0.8, 0.5, 0.2, 0.04], [0.3, 0.2, 0.1, 0.0]]


def curve(independent="sides", *, samples_m=SAMPLES_M):
    table = detection_table(np.array(samples_m), np.array(ANGLES_DEG), np.array(PROBABILITY))
    return DetectionCurve("own", "a ball", "", table, independent)


OBLIQUE = dataclasses.replace(CAMERA, pitch_deg=-40.0)


@pytest.fixture(scope="module")
def searched():
    """Every third picture of a lawnmower over hills, by a camera that looks ahead and down, so that lines look to two sides."""
    coverage = judging_map(make_site(hills, sensor=OBLIQUE, cell_m=25.0))
    eyes_m, yaws_deg, _ = (part[::3] for part in flight(3))
    return coverage, eyes_m, yaws_deg, shown_cells(coverage, ahead(eyes_m, yaws_deg), curve())


def ahead(eyes_m, yaws_deg):
    axes, tops = camera_axes(yaws_deg, np.full(len(yaws_deg), OBLIQUE.pitch_deg), np.zeros(len(yaws_deg)))
    return dataclasses.replace(placed(eyes_m, yaws_deg), axes=axes, tops=tops)


def test_it_equals_brute_force_over_every_look(searched):
    coverage, eyes_m, yaws_deg, shown = searched
    axis = np.arange(LOW_M, HIGH_M + STEP_M / 2, STEP_M)
    between = RegularGridInterpolator((axis, axis), hills(axis[None, :], axis[:, None]))
    cells = coverage.grid.cells
    best, by_sides, by_photos, doubtful = naive.found(
        OBLIQUE, lambda at: between(at[:, ::-1]), eyes_m, yaws_deg, cells.centre_m, cells.normal,
        lambda sample_m, angle_deg: naive.of_one_look(SAMPLES_M, ANGLES_DEG, PROBABILITY, sample_m, angle_deg),
    )  # fmt: skip
    sure = ~doubtful
    assert sure.mean() > 0.7
    np.testing.assert_allclose(shown.detection.best_look[sure], best[sure], atol=1e-6)
    np.testing.assert_allclose(shown.detection.by_sides[sure], by_sides[sure], atol=1e-6)
    np.testing.assert_allclose(shown.detection.by_photos[sure], by_photos[sure], atol=1e-6)
    assert np.ptp(by_sides[sure]) > 0.3
    assert (by_sides[sure] > best[sure] + 0.05).mean() > 0.2


def test_more_chances_find_more_and_never_less_than_the_best_look(searched):
    found = searched[3].detection
    assert (found.best_look <= found.by_sides + 1e-12).all()
    assert (found.by_sides <= found.by_photos + 1e-12).all()
    assert found.best_look.mean() < found.by_sides.mean() < found.by_photos.mean()


@pytest.mark.parametrize(
    ("independent", "which"), [("none", "best_look"), ("sides", "by_sides"), ("pictures", "by_photos")]
)
def test_the_curve_says_which_looks_are_chances_of_their_own(independent, which):
    parts = {"best_look": np.array([0.1]), "by_sides": np.array([0.2]), "by_photos": np.array([0.3])}
    found = Detection(curve(independent), **parts)
    assert found.pod is parts[which]


def test_pictures_of_one_place_find_no_more_than_one_of_them_unless_each_is_a_chance(searched):
    coverage, eyes_m, yaws_deg, once = searched
    twice = shown_cells(coverage, ahead(np.repeat(eyes_m, 2, axis=0), np.repeat(yaws_deg, 2)), curve()).detection
    np.testing.assert_allclose(twice.by_sides, once.detection.by_sides)
    np.testing.assert_allclose(1.0 - twice.by_photos, (1.0 - once.detection.by_photos) ** 2, atol=1e-12)


def test_counting_is_the_same_whether_anything_is_searched_or_not(searched):
    coverage, eyes_m, yaws_deg, shown = searched
    plain = shown_cells(coverage, ahead(eyes_m, yaws_deg))
    assert plain.detection is None
    np.testing.assert_array_equal(plain.photos, shown.photos)
    np.testing.assert_array_equal(plain.coverage.ground_sample_m, shown.coverage.ground_sample_m)


@pytest.mark.parametrize(
    ("sample_m", "angle_deg", "expected"),
    [
        (0.001, 0.0, 0.9),
        (0.02, 0.0, 0.9),
        (0.0225, 0.0, 0.75),
        (0.05, 70.0, 0.0),
        (0.025, 12.5, 0.55),
        (0.0500001, 0.0, 0.0),
        (0.02, 70.1, 0.0),
        (np.nan, 0.0, 0.0),
        (0.02, np.nan, 0.0),
    ],
)
def test_the_table_is_read_off_between_its_values_and_finds_nothing_beyond(sample_m, angle_deg, expected):
    assert look_probability(curve().table, sample_m, angle_deg) == pytest.approx(expected)


def test_a_table_of_one_value_is_a_step():
    table = detection_table(np.array([0.03]), np.array([0.0]), np.array([[0.7]]))
    assert look_probability(table, 0.01, 0.0) == 0.7
    assert look_probability(table, 0.04, 0.0) == 0.0
    assert look_probability(table, 0.01, 1.0) == 0.0


def test_the_mean_and_percentiles_weigh_cells_by_their_area():
    values = np.array([0.0, 0.5, 1.0, 0.3])
    found = Detection(curve(), values, values, values)
    drawn = np.array([True, True, True, False])
    reported = detection_document(found, drawn, np.array([1.0, 1.0, 8.0, 99.0]), 0.8)
    assert reported["pod"] == pytest.approx(0.85)
    assert reported["holds"] is True
    assert reported["area_below_m2"] == pytest.approx(2.0)
    assert reported["pod_percentiles"] == {"5": 0.0, "25": 1.0, "50": 1.0, "75": 1.0, "95": 1.0}
    assert detection_document(found, drawn, np.ones(4), 0.8)["holds"] is False
    assert detection_document(found, drawn, np.ones(4), None)["holds"] is None


def test_a_curve_by_pixels_is_for_low_flights_too():
    values = np.zeros(1)
    found = Detection(CURVES.named("person"), values, values, values)
    assert not any("begins at" in doubt for doubt in detection_doubts(found, np.array([0.002])))


def test_a_curve_for_other_pictures_is_doubted():
    values = np.zeros(3)
    shown = np.array([0.02, 0.025, np.nan])
    assert detection_doubts(Detection(curve(), values, values, values), shown) == []
    centimetres = Detection(curve(samples_m=[2.0, 2.5, 3.0, 5.0]), values, values, values)
    assert "in metres" in detection_doubts(centimetres, shown)[0]
    millimetres = Detection(curve(samples_m=[0.002, 0.0025, 0.003, 0.005]), values, values, values)
    assert "coarser photos detect nothing" in detection_doubts(millimetres, shown)[0]
    assert detection_doubts(centimetres, np.full(3, np.nan)) == []


def test_a_curve_of_the_package_is_told_to_be_an_example() -> None:
    values = np.array([0.5, 0.5])
    shown = np.array([0.02, 0.02])
    example = CURVES.named("person")
    assert example.is_example
    (doubt,) = detection_doubts(Detection(example, values, values, values), shown)
    assert "is a rule of thumb" in doubt

"""Curves of detection: those of the package, people's own, and what is none."""

import numpy as np
import pytest

from tests.naive import detection as naive
from uavcover.errors import InputError
from uavcover.kernels.detection import look_probability
from uavcover.new.catalog import all_curves, curve_named


def own(tmp_path, text):
    path = tmp_path / "ball.toml"
    path.write_text(text)
    return curve_named(str(path))


def test_those_of_the_package_find_half_near_johnsons_pixels():
    at = {one.name: one.half_at_m for one in all_curves()}
    # 0.5 m by 2 pixels, by 8 pixels, and finer by 7.5 % because 11 % are overlooked anyhow.
    assert at == pytest.approx({"person": 0.2325, "person-recognised": 0.0581}, rel=0.02)
    assert all(one.source and one.independent == "sides" for one in all_curves())
    assert curve_named("People").name == "person"


@pytest.mark.parametrize("sample_m", [0.002, 0.05, 0.0731, 0.11, 0.25, 0.4, 0.9, 2.0])
@pytest.mark.parametrize("angle_deg", [0.0, 37.0, 80.0])
def test_the_table_is_the_formula(sample_m, angle_deg):
    expected = 0.889 * naive.by_johnson(0.5, 2.0, sample_m)
    assert look_probability(curve_named("person").table, sample_m, angle_deg) == pytest.approx(expected, abs=1e-3)


def test_leaves_hide_more_the_flatter_the_view(tmp_path):
    table = own(tmp_path, "target_m = 0.5\nhidden_from_above = 0.4\nfound_at_best = 0.9").table
    clear = 0.9 * naive.by_johnson(0.5, 2.0, 0.1)
    for angle_deg in (0.0, 20.5, 45.0, 60.0, 75.25):
        expected = clear * 0.6 ** (1.0 / np.cos(np.radians(angle_deg)))
        assert look_probability(table, 0.1, angle_deg) == pytest.approx(expected, abs=1e-3)
    assert look_probability(table, 0.1, 90.0) == pytest.approx(0.0, abs=1e-6)


def test_a_table_of_ones_own(tmp_path):
    curve = own(
        tmp_path,
        'independent = "pictures"\nsource = "our test"\nground_sample_m = [0.01, 0.03]\noff_vertical_deg = [0, 60]\n'
        "probability = [[0.9, 0.5], [0.4, 0]]",
    )
    assert (curve.name, curve.independent, curve.source) == ("ball", "pictures", "our test")
    assert look_probability(curve.table, 0.02, 30.0) == pytest.approx(0.45)
    any_angle = own(tmp_path, "ground_sample_m = [0.01, 0.03]\nprobability = [0.9, 0.5]")
    assert look_probability(any_angle.table, 0.02, 89.0) == pytest.approx(0.7)


SAMPLES = "ground_sample_m = [0.01, 0.03]\n"
FAULTS = {
    "": "target_m: the key is missing",
    "target_m = 0": "must be a number above 0",
    "target_m = nan": "must be a number above 0",
    "target_m = 0.5\nhidden_from_above = 40": "hidden_from_above: must be a fraction between 0 and 1, not 40",
    "target_m = 0.5\nfound_at_best = nan": "must be a fraction",
    "target_m = 0.5\npixels_for_haf = 2": "did you mean pixels_for_half",
    'target_m = 0.5\nindependent = "all"': "independent: unknown value 'all'",
    "target_m = 0.5\nindependent = []": "independent: unknown value \\[\\]",
    "probability = [0.5]": "ground_sample_m: the key is missing",
    f"{SAMPLES}probability = [0.5]": "has 1 values for 2",
    f"{SAMPLES}probability = 0.5": "has 1 values for 2",
    f"{SAMPLES}probability = [0.5, 1.5]": r"must be from 0 to 1, not 1\.5 \(row 1\)",
    f"{SAMPLES}probability = [50, 20]": r"must be from 0 to 1, not 50 \(row 1\)",
    f"{SAMPLES}probability = [0.5, true]": "not True \\(row 1",
    f"{SAMPLES}probability = [[0.5, 0.4], [0.3, 0.2]]": "off_vertical_deg: the key is missing",
    f"{SAMPLES}off_vertical_deg = [0, 30]\nprobability = [0.5, 0.4]": r"requires a row",
    f"{SAMPLES}off_vertical_deg = [0, 30, 60]\nprobability = [[0.5, 0.4], [0.3, 0.2]]": "2 rows for 3 angles",
    f"{SAMPLES}off_vertical_deg = [10, 30]\nprobability = [[0.5, 0.4], [0.3, 0.2]]": "begin at 0",
    f"{SAMPLES}off_vertical_deg = [0, 95]\nprobability = [[0.5, 0.4], [0.3, 0.2]]": "end at 90",
    f"{SAMPLES}off_vertical_deg = [0, 30]\nprobability = [[0.5, 0.4], 0.3]": "row 2 has 1 values",
    "ground_sample_m = [0.03, 0.01]\nprobability = [0.5, 0.4]": "values must increase",
    "ground_sample_m = []\nprobability = []": "must be a list of numbers",
    'ground_sample_m = ["2cm"]\nprobability = [0.5]': "must be a number, not '2cm'",
    "ground_sample_m = [0, 0.1]\nprobability = [0.5, 0.4]": "above 0 and below 100",
    "ground_sample_m = [1, 1000]\nprobability = [0.5, 0.4]": "above 0 and below 100",
    "ground_sample_m = [inf]\nprobability = [0.5]": "be a number",
    "[a]\ntarget_m = 1\n[b]\ntarget_m = 1": "has several tables",
    "target_m =": "not valid TOML",
    "target_m = " + "9" * 5000: "not valid TOML",
    "target_m = 0x" + "f" * 5000: "hundreds of digits",
}


@pytest.mark.parametrize("text", FAULTS)
def test_what_is_no_curve_is_one_line(tmp_path, text):
    with pytest.raises(InputError, match=FAULTS[text]) as raised:
        own(tmp_path, text)
    assert "\n" not in str(raised.value)
    assert len(str(raised.value)) < 400


def test_unknown_names_say_what_is_near():
    with pytest.raises(InputError, match="did you mean person"):
        curve_named("persn")

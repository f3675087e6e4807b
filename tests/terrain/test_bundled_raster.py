import sys

import matplotlib.cbook
import numpy as np
import pytest
import rasterio

from scripts.docs import make_terrain
from uavcover.scenario.scenario_file import load_scenario, terrain_source
from uavcover.terrain.elevation_file import read_height_amsl_m


@pytest.fixture(scope="module")
def bundled():
    return terrain_source(load_scenario("jacksboro").terrain).files[0]


def test_the_bundled_file_is_the_sample_with_north_up(bundled):
    sample = matplotlib.cbook.get_sample_data("jacksboro_fault_dem.npz")
    with rasterio.open(bundled) as dataset:
        heights = dataset.read(1)
        assert heights.shape == (344, 403)
        assert (heights.min(), heights.max()) == (236, 1076)
        np.testing.assert_array_equal(heights, sample["elevation"])
        assert dataset.bounds.top == pytest.approx(float(sample["ymin"]), abs=1e-9)
        assert dataset.bounds.top == pytest.approx(36.7329, abs=1e-4)
        assert dataset.bounds.bottom == pytest.approx(36.4463, abs=1e-4)
        assert dataset.bounds.left == pytest.approx(-84.4138, abs=1e-4)
        assert dataset.res == pytest.approx((3 / 3600, 3 / 3600), rel=1e-6)
        assert (dataset.nodata, dataset.units) == (-32768, ("m",))
    # Row 0 is north: a place near the north edge has a height of the first rows.
    height = read_height_amsl_m(bundled, "EGM96", lat_deg=36.7329 - 1.5 / 1200, lon_deg=-84.25)
    first_rows = sample["elevation"][:3]
    assert first_rows[:, 190:205].min() <= height <= first_rows[:, 190:205].max()


def test_the_script_makes_the_bundled_file(bundled, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(make_terrain, "OUT", tmp_path / "data" / "again.tif")
    monkeypatch.setattr(sys, "argv", ["make_terrain.py"])
    make_terrain.main()
    assert "403 x 344, 236..1076 m" in capsys.readouterr().out
    with rasterio.open(bundled) as old, rasterio.open(make_terrain.OUT) as new:
        np.testing.assert_array_equal(old.read(1), new.read(1))
        assert (old.transform, old.crs, old.nodata, old.tags()) == (new.transform, new.crs, new.nodata, new.tags())

"""Pictures by distance: what a plan claims is what its pictures show, by a recomputation from its files alone."""

import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import rasterio
from rasterio.transform import Affine

from tests.cli.conftest import Cli
from tests.naive.plan_coverage import true_coverage
from tests.terrain.dem_files import fractal_m

LAT_DEG, LON_DEG = 36.51, -84.23
WIDTH_M, LENGTH_M, PIXEL_M, AROUND_M = 240.0, 180.0, 5.0, 400.0
TRUE_TO_SCALE = f"+proj=tmerc +lat_0={LAT_DEG} +lon_0={LON_DEG} +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m"
Relief = Callable[[np.ndarray, np.ndarray], np.ndarray]


def volcano(east: np.ndarray, north: np.ndarray) -> np.ndarray:
    away = np.hypot(east - 110.0, north - 95.0)
    return np.asarray(np.maximum(0.0, 80.0 - 0.65 * away) - 1.5 * np.maximum(0.0, 25.0 - away))


def ridges(east: np.ndarray, north: np.ndarray) -> np.ndarray:
    return np.asarray(26.0 * np.abs((east + 0.35 * north) / 60.0 % 2.0 - 1.0) + 0.08 * east)


def fractal(east: np.ndarray, north: np.ndarray) -> np.ndarray:
    field = fractal_m(np.random.default_rng(5), *east.shape, pixel_m=PIXEL_M, steepest=1.3)
    return np.asarray(field + 0.02 * north)


OVERLAP = "fov_across_deg = 73.0\nfov_along_deg = 53.0\nforward_overlap = 0.75\nside_overlap = 0.6"
SPARSE = "fov_across_deg = 60.0\nfov_along_deg = 40.0\ntrigger_distance_m = 27.0"
AHEAD = (
    'fov_across_deg = 60.0\nfov_along_deg = 45.0\npitch_deg = -65.0\nmount = "stabilised"\ntrigger_distance_m = 14.0'
)
SCENARIO = f"""
name = "made"
select = "coverage>=0.97"
[area]
polygon_east_north_m = [[0.0, 0.0], [{WIDTH_M}, 0.0], [{WIDTH_M}, {LENGTH_M}], [0.0, {LENGTH_M}]]
cell_size_m = 4.0
[origin]
lat_deg = {LAT_DEG}
lon_deg = {LON_DEG}
alt_amsl_m = 600.0
[terrain]
kind = "raster"
file = "dem.tif"
vertical_datum = "EGM96"
[sensor]
kind = "frame-camera"
range_m = 300.0
%s
[limits]
min_height_agl_m = 40.0
max_height_agl_m = 100.0
"""


def made(folder: Path, relief: Relief, sensor: str) -> Path:
    """A scenario and its elevation file, whose system has metres that are true, so that the check needs no geodesy of ours."""
    across = round((WIDTH_M + 2 * AROUND_M) / PIXEL_M)
    axis = PIXEL_M * (np.arange(across) + 0.5) - AROUND_M
    east, north = np.meshgrid(axis, axis[::-1])
    heights = 600.0 + relief(east, north) - relief(east, north).mean()
    corner = Affine(PIXEL_M, 0.0, -AROUND_M, 0.0, -PIXEL_M, PIXEL_M * across - AROUND_M)
    with rasterio.open(
        folder / "dem.tif", "w", driver="GTiff", width=across, height=across, count=1, crs=TRUE_TO_SCALE,
        transform=corner, dtype="float64",
    ) as file:  # fmt: skip
        file.write(heights, 1)
    scenario = folder / "made.toml"
    scenario.write_text(SCENARIO % sensor)
    return scenario


@pytest.mark.parametrize(
    ("relief", "sensor", "seed"),
    [(volcano, OVERLAP, 1), (ridges, SPARSE, 2), (fractal, OVERLAP, 3), (volcano, AHEAD, 4)],
    ids=["volcano, overlap", "ridges, sparse", "fractal, overlap", "volcano, ahead"],
)
def test_a_plan_claims_what_its_pictures_show(cli: Cli, tmp_path: Path, relief: Relief, sensor: str, seed: int) -> None:
    run = tmp_path / "run"
    ended = cli("plan", made(tmp_path, relief, sensor), "-o", run, "--evaluations", 150, "--seed", seed, "--json")
    assert ended.code in (0, 1), ended.err
    plan = json.loads((run / "plan.json").read_text())
    claimed = plan["metrics"]["coverage_fraction"]
    shown, images = true_coverage(run)
    assert images > 10
    # Cells of the check's own, half as large and moved: they tell a share of the area from another to about this.
    assert claimed == pytest.approx(shown, abs=0.006)
    assert plan["rule_met"] == (ended.code == 0)
    assert not math.isnan(shown)

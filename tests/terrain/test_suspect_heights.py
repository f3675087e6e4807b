"""What does not look like ground is found in made-up relief, and nothing is found where relief, lakes and seas are real."""

from importlib import resources

import numpy as np
import pytest
import rasterio
import shapely
from rasterio.transform import Affine
from scipy import ndimage

from tests.terrain.dem_files import fractal_m
from uavcover.model.area import RasterTerrain
from uavcover.scenario.scenario_file import bundled_scenarios, load_scenario, terrain_source
from uavcover.scenario.site import load_site
from uavcover.terrain.ground import touching
from uavcover.terrain.suspect_heights import _rough_alone, suspect_pixels, suspect_positions

SIZE, PIXEL_M = 300, 10.0
ROWS, COLUMNS = np.mgrid[0:SIZE, 0:SIZE]


def relief(seed, *, steepest=0.7):
    """(300, 300) heights around 600 m, single precision as files have them."""
    heights = fractal_m(np.random.default_rng(seed), SIZE, SIZE, pixel_m=PIXEL_M, steepest=steepest)
    return heights.astype(np.float32).astype(float)


def found(heights):
    return [one.kind for one in suspect_pixels(heights, (PIXEL_M, PIXEL_M))]


def disc(row, column, radius):
    return np.hypot(ROWS - row, COLUMNS - column) < radius


def void(heights, rng):
    """A blot of one value, at any height but the ground's."""
    row, column = rng.integers(60, SIZE - 60, 2)
    return np.where(disc(row, column, rng.uniform(4, 50)), rng.choice([0.0, -32.0, 1.0, 8000.0]), heights)


def collar(heights, rng):
    """A turned raster without a no-data value: wedges of 0 at its edges."""
    slope = rng.uniform(0.02, 0.3)
    return np.where(slope * COLUMNS > ROWS, 0.0, heights)


def blended_collar(heights, rng):
    """The same after bilinear resampling: two pixels between nothing and ground."""
    outside = np.clip((rng.uniform(10, 40) - COLUMNS) / 2.0 + 0.5, 0.0, 1.0)
    return heights * (1.0 - outside)


def mean_void(heights, rng):
    """A void filled with the mean height of a mountain's flank."""
    slope = heights + 1.5 * COLUMNS
    hole = disc(*rng.integers(80, SIZE - 80, 2), 30)
    return np.where(hole, 8.0 + slope.max(), slope)


def pit(heights, rng):
    out = heights.copy()
    row, column = rng.integers(10, SIZE - 10, 2)
    out[row : row + rng.integers(1, 4), column : column + rng.integers(1, 4)] -= 300.0
    return out


def mast(heights, rng):
    out = heights.copy()
    out[tuple(rng.integers(10, SIZE - 10, 2))] += 300.0
    return out


def tiles(heights, rng):
    """One tile 5 m above the other: another vertical datum."""
    seam = rng.integers(40, SIZE - 40)
    return heights + 5.0 * ((ROWS if rng.integers(2) else COLUMNS) >= seam)


FAULTS = {
    void: "block", collar: "block", blended_collar: "block", mean_void: "block", pit: "spike", mast: "spike", tiles: "step",
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.__name__)
@pytest.mark.parametrize("seed", range(6))
def test_each_fault_is_found_and_nothing_beside_it(fault, seed):
    whole = relief(seed)
    faulty = fault(whole, np.random.default_rng(seed))
    kinds = set(found(faulty))
    assert kinds == {FAULTS[fault]}
    marked = np.zeros(whole.shape, dtype=bool)
    for one in suspect_pixels(faulty, (PIXEL_M, PIXEL_M)):
        marked[one.positions] |= one.mask
    if FAULTS[fault] == "step":
        return
    changed = faulty != whole if fault is not mean_void else faulty == faulty.max()
    assert marked[changed].mean() > 0.97
    near = np.array([changed[max(0, r - 3) : r + 4, max(0, c - 3) : c + 4].any() for r, c in np.argwhere(marked)])
    assert near.all()


def lake(heights, rng):
    """Water at one height, up to where the ground is as high: its shore is as steep as its surroundings."""
    return np.maximum(heights, np.quantile(heights, rng.uniform(0.1, 0.6)))


def sea(heights, rng):
    return np.maximum(heights - np.quantile(heights, rng.uniform(0.2, 0.7)), 0.0)


def whole_metres(heights, rng):
    """As SRTM has them, where gentle ground is all blocks of one value."""
    return np.round(600.0 + (heights - 600.0) * rng.uniform(0.02, 1.0))


def whole_feet(heights, rng):
    return np.round(heights / 3.048) * 3.048 + 0.0 * rng.random()


def terraces(heights, rng):
    """Fields in steps: level, with walls on one side."""
    tall = rng.uniform(2.0, 6.0)
    up = 0.5 * COLUMNS + 4.0 * np.sin(ROWS / 9.0)
    return np.floor(up / tall) * tall + 0.02 * (heights - 600.0)


def steep_terraces(heights, rng):
    """Walls of 14 m between fields that are level to the bit."""
    up = 0.35 * 10.0 * (ROWS + 0.4 * COLUMNS) + 700.0 + 0.0 * heights
    return 14.0 * np.floor(up / 14.0) + 0.0 * rng.random()


def flat_roofs(heights, rng):
    """As models of cities have them: whole houses at one height."""
    out = heights.copy()
    for _ in range(40):
        row, column = rng.integers(10, SIZE - 30, 2)
        out[row : row + 6, column : column + 9] = out[row, column] + rng.uniform(6.0, 60.0)
    return out


def sea_with_some_cliffs(heights, rng):
    """A coast of which half falls from 60 m."""
    land = 0.4 * (COLUMNS - 120.0 - 30.0 * np.sin(ROWS / 40.0))
    land += np.where(ROWS > 150 + 0.2 * COLUMNS, 60.0, 0.0) * (land > 0.0) + 0.002 * heights * rng.uniform(0.5, 1.0)
    return np.where(120.0 + 30.0 * np.sin(ROWS / 40.0) > COLUMNS, 0.0, np.maximum(land, 0.0))


def no_data(heights, rng):
    return np.where(disc(150, 150, rng.uniform(10, 60)), np.nan, heights)


def plain(heights, rng):
    return np.full_like(heights, rng.uniform(0.0, 500.0))


REAL = (
    lambda heights, _: heights,
    lake,
    sea,
    whole_metres,
    whole_feet,
    terraces,
    steep_terraces,
    flat_roofs,
    sea_with_some_cliffs,
    no_data,
    plain,
)


@pytest.mark.parametrize("made", REAL, ids=lambda made: made.__name__)
@pytest.mark.parametrize("seed", range(6))
def test_nothing_is_found_in_real_ground(made, seed):
    for steepest in (0.05, 0.4, 1.0):
        assert found(made(relief(seed, steepest=steepest), np.random.default_rng(seed))) == []


def test_bundled_data_looks_like_ground_everywhere():
    with rasterio.open(str(resources.files("uavcover") / "data" / "jacksboro.tif")) as dataset:
        heights = dataset.read(1).astype(float)
    # A lake in the deepest valley, and the sea, are none either.
    level_m = float(np.quantile(heights, 0.1))
    for made in (heights, np.maximum(heights, level_m), np.maximum(heights - level_m, 0.0)):
        assert suspect_pixels(made, (92.0, 74.0)) == []


@pytest.mark.parametrize("name", bundled_scenarios())
def test_no_bundled_scenario_has_a_suspect_place(name):
    scenario = load_scenario(name)
    if not isinstance(scenario.terrain, RasterTerrain):
        return
    site = load_site(name)
    west, south, east, north = site.fence.bounds
    lat, lon, _ = site.frame.geodetic_from_enu([[west, south, 0.0], [east, north, 0.0]])
    around = (lon[0], lat[0], lon[1], lat[1])
    assert suspect_positions(terrain_source(scenario.terrain), scenario.terrain.vertical_datum, around) == ()


def test_a_place_is_where_the_file_has_it(tmp_path):
    heights = relief(3)
    heights[100:140, 200:260] = 0.0
    path = tmp_path / "dem.tif"
    with rasterio.open(
        path, "w", driver="GTiff", width=SIZE, height=SIZE, count=1, crs="EPSG:4326", dtype="float32",
        transform=Affine(1e-4, 0.0, 8.0, 0.0, -1e-4, 46.03),
    ) as file:  # fmt: skip
        file.write(heights.astype(np.float32), 1)
    (position,) = suspect_positions(path, "EGM96", (8.0, 46.0, 8.03, 46.03))
    block = shapely.box(8.0200, 46.0160, 8.0260, 46.0200)
    assert position.shape.covers(block)
    assert position.shape.area < 1.3 * block.area
    assert "exactly 0 m whose rim is at" in position.words
    assert suspect_positions(path, "EGM96", (8.0, 46.0, 8.01, 46.01)) == ()


@pytest.mark.parametrize("by_m", [-300.0, -120.0, 120.0, 300.0])
def test_a_lone_pixel_in_rugged_ground_is_a_spike(by_m: float) -> None:
    """In relief of 100 m from pixel to pixel a pit of 300 m is not beyond three times the ring's range."""
    with rasterio.open(str(resources.files("uavcover") / "data" / "jacksboro.tif")) as data:
        heights_m = data.read(1).astype(float)
    rng = np.random.default_rng(0)
    for _ in range(10):
        row, column = rng.integers(20, 320), rng.integers(20, 380)
        spoilt_m = heights_m.copy()
        spoilt_m[row, column] += by_m
        [found] = suspect_pixels(spoilt_m, (90.0, 75.0))
        assert found.kind == "spike"


@pytest.mark.parametrize("seed", range(20))
def test_lone_pixels_are_those_of_the_slow_twin(seed: int) -> None:
    rng = np.random.default_rng(seed)
    heights_m = rng.normal(0.0, 5.0, (32, 40))
    for _ in range(3):
        heights_m[rng.integers(32), rng.integers(40)] += rng.choice([-1.0, 1.0]) * rng.uniform(60.0, 300.0)
    padded = np.pad(heights_m, 1, mode="edge")
    off_m = np.empty_like(heights_m)
    for row, column in np.ndindex(off_m.shape):
        around = padded[row : row + 3, column : column + 3].ravel()
        off_m[row, column] = abs(around[4] - np.delete(around, 4).mean())
    expected = np.zeros(off_m.shape, dtype=bool)
    for row, column in np.ndindex(off_m.shape):
        others = [
            off_m[i, j]
            for i in range(max(0, row - 10), min(32, row + 11))
            for j in range(max(0, column - 10), min(40, column + 11))
            if max(abs(i - row), abs(j - column)) > 1
        ]
        expected[row, column] = off_m[row, column] > max(36.0, 3.0 * max(others))
    assert np.array_equal(_rough_alone(heights_m, (90.0, 90.0)), expected)


@pytest.mark.parametrize("fraction", [0.0, 0.05, 0.3, 0.5, 0.8, 1.0])
def test_groups_that_touch_are_numbered_as_scipy_does(fraction: float) -> None:
    rng = np.random.default_rng(5)
    for rows, columns in ((1, 1), (1, 30), (30, 1), (13, 17), (40, 50)):
        mask = rng.random((rows, columns)) < fraction
        numbers, count = touching(mask)
        expected, expected_count = ndimage.label(mask, structure=np.ones((3, 3)))
        assert count == expected_count
        assert (numbers == expected).all()

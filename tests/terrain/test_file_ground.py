"""The ground in use is the file's ground: rugged files in many rasters against code that shares nothing with it."""

import math

import numpy as np
import pytest
import rasterio
from rasterio.transform import Affine

from tests.naive.file_ground import FileGround, ecef_of, geodetic_of
from tests.terrain.dem_files import POSITIONS, largest_difference_m, write_dem
from uavcover.errors import ScenarioError, TerrainError
from uavcover.kernels.grid import square_frame, steepest_of_finite
from uavcover.kernels.surface import GRID, Surface, height_above, up_above
from uavcover.scenario.scenario_file import load_scenario, terrain_source
from uavcover.scenario.site import load_site
from uavcover.terrain.elevation_file import read_ground
from uavcover.terrain.frames import PIXELS, LocalFrame
from uavcover.terrain.terrain_source import FILES

ALT_M = 550.0


def ground_of(path, position, size_m, step_m=None):
    half = 0.5 * size_m
    frame = LocalFrame(position.lat_deg, position.lon_deg, ALT_M)
    return read_ground(path, "EGM96", frame=frame, bounds_m=(-half, -half, half, half), grid_step_m=step_m)


CASES = [
    (position, pixel_m, size_m)
    for position in POSITIONS
    for pixel_m, size_m in ((1.0, 1000.0), (5.0, 2500.0), (10.0, 5000.0), (30.0, 5000.0))
]


@pytest.mark.parametrize(("position", "pixel_m", "size_m"), CASES, ids=lambda value: str(getattr(value, "name", value)))
def test_heights_are_those_of_the_file(tmp_path, position, pixel_m, size_m):
    rng = np.random.default_rng(int(1000 * pixel_m + size_m))
    path = write_dem(
        tmp_path / "dem.tif", rng, lat_deg=position.lat_deg, lon_deg=position.lon_deg, epsg=position.epsg, pixel_m=pixel_m,
        size_m=size_m, turn_deg=position.turn_deg,
    )  # fmt: skip
    ground = ground_of(path, position, size_m)
    assert steepest_of_finite(ground.surface.up_m, ground.surface.grid) > 0.9
    origin = (position.lat_deg, position.lon_deg, ALT_M)
    found = largest_difference_m(ground, path, rng, origin=origin, size_m=size_m, count=10_000)
    assert found < 0.02
    # What was measured at load is no less than a third of what is found here, and promises no more than it may.
    assert found < 3.0 * ground.error_m + 1e-4
    assert ground.error_m < 0.02 < FILES.max_error_m


@pytest.mark.parametrize("seed", range(3))
def test_legs_cut_into_pieces_have_the_heights_of_whole_ones(tmp_path, seed):
    """A leg's range against dense sampling of the true line, and against that of its parts."""
    rng = np.random.default_rng(seed)
    position = POSITIONS[3 * seed]
    path = write_dem(
        tmp_path / "dem.tif", rng, lat_deg=position.lat_deg, lon_deg=position.lon_deg, epsg=position.epsg, pixel_m=30.0,
        size_m=4000.0, turn_deg=position.turn_deg,
    )  # fmt: skip
    ground = ground_of(path, position, 4000.0)
    surface = ground.surface
    assert 50.0 < surface.grid.piece_m < 2000.0
    for _ in range(25):
        ends = np.column_stack([rng.uniform(-1900.0, 1900.0, (2, 2)), rng.uniform(100.0, 400.0, 2)])
        t = np.linspace(0.0, 1.0, 4001)[:, None]
        line = ends[0] + t * (ends[1] - ends[0])
        above = np.array([height_above(surface, *row) for row in line])
        low, low_at, high, high_at = ground.leg_height_ranges_m(ends)[0]
        between = 0.5 * (np.linalg.norm(ends[1] - ends[0]) / 4000.0) * (1.0 + surface.steepest)
        assert -PIXELS.straight_within_m - between <= low - above.min() <= PIXELS.straight_within_m
        assert -PIXELS.straight_within_m <= high - above.max() <= PIXELS.straight_within_m + between
        for value, at in ((low, low_at), (high, high_at)):
            position_m = ends[0] + at * (ends[1] - ends[0])
            assert height_above(surface, *position_m) == pytest.approx(value, abs=2.0 * PIXELS.straight_within_m)
        cuts = np.sort(rng.random(3))
        parts = ground.leg_height_ranges_m(
            ends[0] + np.concatenate([[0.0], cuts, [1.0]])[:, None] * (ends[1] - ends[0])
        )
        assert parts[:, 0].min() == pytest.approx(low, abs=ground.cut_error_m)
        assert parts[:, 2].max() == pytest.approx(high, abs=ground.cut_error_m)
        # There and back is the same.
        np.testing.assert_allclose(ground.leg_height_ranges_m(ends[::-1])[0, ::2], (low, high), atol=1e-6)


def test_heights_above_ground_and_up_coordinates_are_each_others_inverse():
    ground = load_site("ridge-25km2").ground
    rng = np.random.default_rng(4)
    positions = rng.uniform(-2500.0, 2500.0, (500, 2))
    agl = rng.uniform(0.0, 300.0, 500)
    ups = ground.ups_m(positions, agl)
    np.testing.assert_allclose(ground.heights_agl_m(np.column_stack([positions, ups])), agl, atol=1e-7)
    np.testing.assert_array_equal(ground.ups_m(positions, 0.0), ground.heights_m(positions))
    # Plumb lines lean: straight above the ground, the height above it is not quite the climb.
    off = np.abs(ups - ground.heights_m(positions) - agl)
    assert 0.005 < off.max() < 0.2
    for (e, n), a in zip(positions[:20], agl, strict=False):
        # By halving instead of by rounds.
        low, high = -500.0, 1500.0
        for _ in range(70):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if height_above(ground.surface, e, n, middle) < a else (low, middle)
        assert up_above(ground.surface, e, n, a) == pytest.approx(low, abs=1e-7)


def test_gradients_are_those_of_the_heights():
    ground = load_site("jacksboro").ground
    rng = np.random.default_rng(5)
    positions = rng.uniform([-900.0, 50.0], [50.0, 900.0], (200, 2))
    h = 1e-3
    numeric = np.column_stack([
        (ground.heights_m(positions + shift) - ground.heights_m(positions - shift)) / (2.0 * h)
        for shift in (np.array([h, 0.0]), np.array([0.0, h]))
    ])  # fmt: skip
    found = ground.gradients(positions)
    # But for a place whose two neighbours lie in two cells.
    assert np.median(np.abs(found - numeric)) < 1e-6
    assert (np.abs(found - numeric).max(axis=1) < 1e-4).mean() > 0.98
    assert np.hypot(*found.T).max() <= ground.surface.steepest


@pytest.mark.parametrize("name", ["jacksboro", "ridge-obstacles", "ridge-25km2"])
def test_the_bundled_scenarios_stand_on_the_bundled_file(name):
    site = load_site(name)
    assert 0.0 < site.ground.error_m < 0.005
    west, south, east, north = site.fence.bounds
    rng = np.random.default_rng(6)
    positions = np.column_stack(
        [rng.uniform(west, east, 20_000), rng.uniform(south, north, 20_000), rng.uniform(200, 900, 20_000)]
    )
    lat, lon, alt = site.frame.geodetic_from_enu(positions)
    np.testing.assert_allclose(
        np.column_stack(geodetic_of(ecef_of(lat, lon, alt))), np.column_stack([lat, lon, alt]), atol=1e-7
    )
    truth = alt - FileGround(terrain_source(load_scenario(name).terrain).files[0]).height_m(lat, lon)
    np.testing.assert_allclose(site.ground.heights_agl_m(positions), truth, atol=0.005)


def test_a_square_grid_is_measured_too_and_refused_where_the_margin_does_not_hold_it(tmp_path):
    scenario = (
        terrain_source(load_scenario("jacksboro").terrain).files[0].parent.parent / "scenarios" / "jacksboro.toml"
    )
    text = scenario.read_text(encoding="utf-8").replace('"EGM96"', '"EGM96"\ngrid_step_m = 37.0')
    path = tmp_path / "s.toml"
    path.write_text(text)
    site = load_site(str(path))
    assert 1.0 < site.ground.error_m < 8.0
    assert site.ground_error_m == site.vertical_uncertainty_m == site.ground.error_m
    path.write_text(text.replace("height_margin_m = 8.0", "height_margin_m = 0.5"))
    with pytest.raises(ScenarioError, match=r"^terrain.grid_step_m: a grid of 37 m differs .* remove grid_step_m"):
        load_site(str(path))


def test_what_was_measured_is_added_to_a_stated_uncertainty(tmp_path):
    scenario = (
        terrain_source(load_scenario("jacksboro").terrain).files[0].parent.parent / "scenarios" / "jacksboro.toml"
    )
    path = tmp_path / "s.toml"
    path.write_text(scenario.read_text(encoding="utf-8") + "\n[uncertainty]\nterrain_m = 3.0\nheight_m = 1.0\n")
    site = load_site(str(path))
    assert site.vertical_uncertainty_m == 4.0 + site.ground.error_m > 4.0
    plain = load_site("jacksboro")
    assert (plain.ground_error_m, plain.vertical_uncertainty_m) == (0.0, 0.0)


@pytest.mark.parametrize("lon_deg", [179.995, -179.995])
def test_a_file_across_the_antimeridian(tmp_path, lon_deg):
    values = np.random.default_rng(7).uniform(100.0, 130.0, (60, 60)).astype(np.float32)
    with rasterio.open(
        tmp_path / "dem.tif", "w", driver="GTiff", width=60, height=60, count=1, crs="EPSG:4326", dtype="float32",
        transform=Affine(0.001, 0, 179.97, 0, -0.001, -16.97),
    ) as file:  # fmt: skip
        file.write(values, 1)
    frame = LocalFrame(-17.0, lon_deg, 100.0)
    ground = read_ground(
        tmp_path / "dem.tif", "EGM96", frame=frame, bounds_m=(-1500, -1500, 1500, 1500), grid_step_m=None
    )
    assert ground.error_m < 0.01
    (position,) = frame.enu_from_geodetic(-16.97 - 0.0305, 179.97 + 0.0305 - 360.0, float(values[30, 30]))
    assert ground.heights_m(position[:2])[0] == pytest.approx(position[2], abs=0.01)


def test_a_raster_that_cannot_be_followed_is_refused(tmp_path):
    """Half a degree from the pole meridians turn too fast for polynomials over 20 km."""
    rng = np.random.default_rng(8)
    rows = np.abs(np.add.outer(rng.uniform(0, 300, 400), rng.uniform(0, 300, 4000)))
    with rasterio.open(
        tmp_path / "dem.tif", "w", driver="GTiff", width=4000, height=400, count=1, crs="EPSG:4326", dtype="float32",
        transform=Affine(0.02, 0, -40.0, 0, -0.001, 89.9),
    ) as file:  # fmt: skip
        file.write(rows.astype(np.float32), 1)
    frame = LocalFrame(89.7, 0.0, 100.0)
    with pytest.raises(
        TerrainError, match=r"wrong by up to 412\.30 m, but the limit is 0\.1 m; use a smaller area, or convert"
    ):
        read_ground(tmp_path / "dem.tif", "EGM96", frame=frame, bounds_m=(-9e3, -9e3, 9e3, 9e3), grid_step_m=None)


def test_ground_that_leans_over_has_no_height():
    """Where plumb lines lean more than the ground, east and north name no one place of it: unknown, not guessed."""
    nodes = np.zeros((4, 200))
    nodes[:, 100:] = 1000.0
    flat = square_frame(east0_m=0.0, north0_m=-15.0, step_m=10.0)
    leaning = flat._replace(lean_per_m=1e-4, lean=0.2)
    surface = Surface(GRID, 10.0, nodes, math.inf, leaning)
    assert up_above(surface, 500.0, 0.0, 30.0) == 30.0
    assert math.isnan(up_above(surface, 1050.0, 0.0, 0.0))
    assert height_above(surface, 500.0, 0.0, 30.0) == 30.0

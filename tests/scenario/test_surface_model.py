"""A surface model beside a ground model: flights keep above the higher of both, what is looked at is the ground."""

import numpy as np
import pytest
import rasterio

from tests.naive.file_ground import leg_ranges_m
from tests.naive.surface_over_ground import HigherFile
from tests.scenario.surface_files import HOUSE, WOOD, ground_height_m, lon_lat, scenario_text, stands_m, write_models
from uavcover.errors import ScenarioError, TerrainError
from uavcover.flight.connect import heights_of_site
from uavcover.missions.flights import compile_flights
from uavcover.planner.baselines.boustrophedon import fly_layout, plain_boustrophedon
from uavcover.scenario.scenario_file import dump_scenario, parse_scenario
from uavcover.scenario.site import load_site
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.site_maps import judging_map
from uavcover.terrain.elevation_file import read_heights_amsl_m

SURFACE = 'surface_file = "dsm.tif"'


def site_of(folder, **changes):
    text = scenario_text(**{"terrain": SURFACE, **changes})
    return load_site(parse_scenario(text, source="s", folder=folder))


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    folder = tmp_path_factory.mktemp("models")
    write_models(folder)
    return folder


@pytest.mark.parametrize(
    ("ground_pixel_m", "surface_pixel_m"),
    [(2.0, 2.0), (1.5, 4.0), (5.0, 1.0)],
    ids=["same", "finer ground", "finer surface"],
)
def test_heights_are_kept_above_the_higher_of_both_files(tmp_path, ground_pixel_m, surface_pixel_m):
    files = write_models(tmp_path, ground_pixel_m=ground_pixel_m, surface_pixel_m=surface_pixel_m, noise_m=0.1)
    site = site_of(tmp_path)
    naive = HigherFile(files.ground, files.surface)
    rng = np.random.default_rng(3)
    west, south, east, north = site.fence.bounds
    positions = np.column_stack([
        rng.uniform(west, east, 20_000), rng.uniform(south, north, 20_000), rng.uniform(120.0, 200.0, 20_000)
    ])  # fmt: skip
    lat, lon, alt = site.frame.geodetic_from_enu(positions)
    true = alt - naive.height_m(lat, lon)
    found = site.ground.heights_agl_m(positions)
    # Never higher above it than the files say, but for what was measured; lower only where the two cross inside of a pixel.
    assert np.max(found - true) <= site.ground.error_m + 1e-3
    assert np.percentile(true - found, 99.0) < 0.15
    bare = alt - naive.ground.height_m(lat, lon)
    assert site.bare_ground.heights_agl_m(positions) == pytest.approx(bare, abs=1e-3)


def test_every_leg_of_a_mission_is_clear_of_the_trees(models):
    site = site_of(models)
    route = fly_layout(site, plain_boustrophedon(site))
    (flight,) = compile_flights(site, route, autopilot="ardupilot")
    naive, limits = HigherFile(models / "dtm.tif", models / "dsm.tif"), site.scenario.limits
    lat, lon, alt = site.frame.geodetic_from_enu(route.waypoints_m)
    ranges = leg_ranges_m(naive.height_m, np.column_stack([lat, lon, alt]), step_m=0.25)
    assert ranges[:, 0].min() >= limits.min_height_agl_m + limits.height_margin_m - 0.01
    assert ranges[:, 1].max() <= limits.max_height_agl_m - limits.height_margin_m + 0.01
    # The same above the ground alone: the wood was really flown over.
    assert leg_ranges_m(naive.ground.height_m, np.column_stack([lat, lon, alt]), step_m=0.25)[:, 1].max() > 62.0
    items = [item for item in flight.compiled.mission.items if item.command == 16]
    positions = np.array([(item.lat_deg, item.lon_deg, item.alt_m + site.frame.alt_amsl_m) for item in items])
    paths = leg_ranges_m(naive.height_m, positions, step_m=0.25)
    assert len(positions) >= len(lat) + 2
    assert paths[:, 0].min() >= limits.transit_clearance_m


def test_what_is_looked_at_is_the_ground_that_nothing_hides(models):
    site = site_of(models)
    coverage = judging_map(site)
    naive = HigherFile(models / "dtm.tif", models / "dsm.tif")
    cells = coverage.grid.cells.centre_m
    lat, lon, alt = site.frame.geodetic_from_enu(cells)
    assert not naive.is_hidden(lat, lon, by_m=2.0 + 1e-3).any()
    assert np.all(alt - naive.ground.height_m(lat, lon) <= 2.0 + 1e-3)
    assert np.all(alt - naive.ground.height_m(lat, lon) >= -1e-3)
    # The wood covers 170 by 240 of 300 by 280 metres, the house lies outside.
    assert coverage.grid.hidden_fraction == pytest.approx(170.0 * 240.0 / (300.0 * 280.0), abs=0.02)
    everything = np.ones(coverage.grid.count, dtype=bool)
    assert coverage.fraction(everything) == pytest.approx(1.0 - coverage.grid.hidden_fraction)
    assert coverage.fraction_of_coverable(coverage.coverable) == 1.0


def test_trees_hide_the_ground_beside_them(models):
    """From low beside the wood: without the surface model the same places see more."""
    hiding, open_ground = site_of(models), site_of(models, terrain="")
    eyes = np.array([[45.0, 60.0, 60.0]])
    eyes[:, 2] += hiding.bare_ground.heights_m(eyes[:, :2])
    observed = [
        CoverageMap(site, cell_size_m=5.0).observed(np.vstack([eyes, eyes + 0.1])) for site in (hiding, open_ground)
    ]
    assert 0 < observed[0].sum() < observed[1].sum()


def test_home_is_on_the_ground_and_in_the_open(models):
    site = site_of(models)
    assert site.home_m[2] == pytest.approx(0.0, abs=1e-3)
    lat, lon = site.scenario.home.lat_deg, site.scenario.home.lon_deg
    assert site.ground_alt_amsl_m(lat, lon) == pytest.approx(float(ground_height_m(180.0, 180.0)), abs=0.02)
    for position in ((300.0, 200.0), (127.0, 306.0)):
        assert stands_m(*position) > 0.0
        with pytest.raises(
            ScenarioError, match=r"home: the surface there is (21|22|8|9)\.\d m above the ground.*open ground"
        ):
            site_of(models, home=position)


def test_vehicles_are_told_the_higher_of_both(models):
    heights = heights_of_site(site_of(models), lambda _: None)
    naive = HigherFile(models / "dtm.tif", models / "dsm.tif")
    rng = np.random.default_rng(5)
    lon, lat = lon_lat(rng.uniform(100.0, 500.0, 200), rng.uniform(100.0, 500.0, 200))
    assert heights(list(zip(lat, lon, strict=True))) == pytest.approx(naive.height_m(lat, lon), abs=1e-3)


def test_obstacles_stand_on_the_ground(models):
    corner, other = lon_lat(300.0, 250.0), lon_lat(310.0, 260.0)
    ring = [corner, (other[0], corner[1]), other, (corner[0], other[1])]
    more = f'[[obstacles.prisms]]\nname = "mast"\nheight_m = 30.0\nrings_lon_lat_deg = [{[list(position) for position in ring]}]'
    (mast,) = site_of(models, more=more).prisms
    assert mast.top_m + 500.0 + 0.12 * 180.0 + 9.0 == pytest.approx(
        float(ground_height_m(305.0, 255.0)) + 30.0, abs=6.0
    )


def test_the_scenario_comes_back_from_its_text_with_absolute_files(models):
    scenario = parse_scenario(scenario_text(terrain=SURFACE), source="s", folder=models)
    assert scenario.terrain.surface_file == str(models / "dsm.tif")
    assert parse_scenario(dump_scenario(scenario), source="s", folder=models.parent) == scenario


BAD = {
    "no such file": ('surface_file = "no.tif"', {}, r"no\.tif: no such file \(terrain\.surface_file is relative"),
    "a key without its file": ('surface_band = 2', {}, r"terrain\.surface_band: this key describes a surface model"),
    "the same file": ('surface_file = "dtm.tif"', {}, r"is the same file as terrain\.file"),
    "hides nothing": (SURFACE + "\nsurface_hides_m = 0.0", {}, r"terrain\.surface_hides_m: must be greater than 0"),
    "no tile": ('surface_file = "none/*.tif"', {}, r"terrain\.surface_file: none/\*\.tif contains no tile"),
    "in feet": (SURFACE, {"factor": 1.0 / 0.3048}, r"3\.28 times its height; the surface seems to be in feet"),
    "another datum": (SURFACE, {"shift_m": 47.3}, r"47\.3 m above the ground in terrain\.file \(47\.2 to 69\.3 m at 98 % of the"),
    "another datum below": (SURFACE, {"shift_m": -31.0}, r"lies 31\.0 m under the ground in terrain\.file \(-31\.1 to -9\.0"),
    "home under an offset": (SURFACE, {"shift_m": 6.0}, r"home: the surface there is 6\.\d m above the ground.*vertical datum"),
}  # fmt: skip


@pytest.mark.parametrize("what", BAD)
def test_bad_surface_models_are_one_line(tmp_path, what):
    terrain, changes, message = BAD[what]
    write_models(tmp_path, **changes)
    if what == "another datum":
        terrain += "\nsurface_hides_m = 60.0"
    with pytest.raises((ScenarioError, TerrainError), match=message) as caught:
        site_of(tmp_path, terrain=terrain)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("wood", [True, False], ids=["wood", "one house"])
def test_swapped_files_are_noticed(tmp_path, wood, caplog):
    write_models(tmp_path)
    (tmp_path / "dtm.tif").rename(tmp_path / "third.tif")
    (tmp_path / "dsm.tif").rename(tmp_path / "dtm.tif")
    (tmp_path / "third.tif").rename(tmp_path / "dsm.tif")
    if not wood:
        west, east, south, north = (round(metres / 2.0) for metres in WOOD)
        with rasterio.open(tmp_path / "dsm.tif") as ground, rasterio.open(tmp_path / "dtm.tif", "r+") as surface:
            heights, bare = surface.read(1), ground.read(1)
            part = np.s_[300 - north - 1 : 300 - south + 1, west - 1 : east + 1]
            heights[part] = bare[part]
            surface.write(heights, 1)
        assert stands_m(*(0.5 * (HOUSE[k] + HOUSE[k + 1]) for k in (0, 2))) > 0.0
        # A single house may as well be newer than the other model: flights keep above both.
        assert site_of(tmp_path).ground_model is not None
        assert (
            "dsm.tif (the data extends from 46.9515, 8.3166 to 46.9569, 8.3245) lies below the ground in terrain.file"
            in caplog.text
        )
        return
    with pytest.raises(
        TerrainError, match=r"lies below the ground in terrain\.file at 12 % of the nodes, by up to 22\.1 m"
    ):
        site_of(tmp_path)


def test_a_surface_that_ends_in_the_area_is_refused(tmp_path):
    write_models(tmp_path)
    with rasterio.open(tmp_path / "dsm.tif", "r+") as surface:
        heights = surface.read(1)
        heights[:, 215:] = np.nan
        surface.write(heights, 1)
    site = site_of(tmp_path)
    with pytest.raises(TerrainError, match=r"area: there is no elevation data in \d+\.\d % of its cells.*dsm\.tif"):
        judging_map(site)


def test_an_area_of_trees_alone_says_what_to_do(models):
    with pytest.raises(ScenarioError, match=r"cannot be observed from the air.*as terrain\.file"):
        judging_map(site_of(models, area=(270.0, 400.0, 170.0, 380.0)))


def test_places_that_the_files_system_cannot_express_have_no_height(models):
    """Where swapped axes are tried PROJ may say inf, and nothing warns of it."""
    lat, lon = np.array([46.96, 96.0]), np.array([8.32, 8.0])
    assert np.isnan(read_heights_amsl_m(models / "dtm.tif", "EGM96", lat, lon)[1])

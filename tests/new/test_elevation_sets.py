"""Sets of elevation files, and the words about their heights."""

from pathlib import Path
from random import Random

import pytest
import rasterio
import shapely

from tests.scenario.surface_files import write_models
from uavcover.errors import InputError, TerrainError
from uavcover.new.elevation_questions import (
    NeededTiles,
    all_sets,
    bands_in_words,
    feet_in_words,
    national_sources,
    needed_tiles,
    shading_in_words,
    surface_in_words,
)
from uavcover.terrain.terrain_source import TerrainSource


def box(west: float, south: float, east: float, north: float):
    return ((((west, south), (east, south), (east, north), (west, north), (west, south)),),)


def tiles(name: str, area, around_m: float = 500.0) -> NeededTiles:
    [found] = [one for one in needed_tiles(area, around_m=around_m, where="area") if one.of.name == name]
    return found


@pytest.mark.parametrize(
    ("name", "corner", "expected"),
    [
        ("glo-30", (46, 8), "Copernicus_DSM_COG_10_N46_00_E008_00_DEM.tif"),
        ("glo-30", (-34, -71), "Copernicus_DSM_COG_10_S34_00_W071_00_DEM.tif"),
        ("glo-90", (0, -1), "Copernicus_DSM_COG_30_N00_00_W001_00_DEM.tif"),
        ("srtm-1", (46, 8), "N46E008.hgt"),
        ("srtm-3", (-1, 179), "S01E179.hgt"),
        ("aster", (82, -180), "ASTGTMV003_N82W180_dem.tif"),
        ("aw3d30", (46, 8), "ALPSMLC30_N046E008_DSM.tif"),
        ("aw3d30-5x5", (45, 5), "N045E005_N050E010.zip"),
        ("aw3d30-5x5", (-5, -5), "S005W005_N000E000.zip"),
    ],
)
def test_names_are_the_providers(name: str, corner: tuple[int, int], expected: str) -> None:
    [one] = [one for one in all_sets() if one.name == name]
    assert one.names(corner)[0] == expected


@pytest.mark.parametrize(
    ("area", "corners"),
    [
        (box(8.2, 46.2, 8.4, 46.4), {(46, 8)}),
        (box(7.9, 45.9, 8.1, 46.1), {(45, 7), (45, 8), (46, 7), (46, 8)}),
        (box(179.9, -16.6, -179.9, -16.4), {(-17, 179), (-17, -180)}),
        (box(-0.1, -0.1, 0.1, 0.1), {(-1, -1), (-1, 0), (0, -1), (0, 0)}),
        (box(20.5, 89.9, 20.6, 89.99), {(89, 20)}),
        (box(8.0, 46.0, 8.01, 46.01), {(45, 7), (45, 8), (46, 7), (46, 8)}),  # 500 m around it
    ],
)
def test_tiles_across_edges_180_degrees_and_near_a_pole(area, corners: set[tuple[int, int]]) -> None:
    found = set(tiles("glo-30", area).corners)
    if corners == {(89, 20)}:
        assert (89, 20) in found  # 500 m are several degrees of longitude there
        assert all(lat == 89 for lat, _ in found)
    else:
        assert found == corners


@pytest.mark.parametrize("seed", range(8))
def test_every_place_of_an_area_lies_on_a_tile_and_no_tile_is_far(seed: int) -> None:
    rng = Random(seed)
    lat, lon, size = rng.uniform(-80.0, 80.0), rng.uniform(-180.0, 180.0), rng.uniform(0.01, 2.5)
    ring = shapely.Point(lon, lat).buffer(size).exterior.coords
    area = ((tuple(((x + 180.0) % 360.0 - 180.0, y) for x, y in ring),),)
    found = set(tiles("glo-90", area, around_m=1.0).corners)
    shape = shapely.Point(lon, lat).buffer(size)
    for _ in range(400):
        x, y = rng.uniform(lon - size, lon + size), rng.uniform(lat - size, lat + size)
        if shape.contains(shapely.Point(x, y)):
            assert (int(y // 1), int(((x + 180.0) % 360.0 - 180.0) // 1)) in found
    for south, west in found:
        near = min(
            shape.distance(shapely.box(west + turn, south, west + turn + 1, south + 1)) for turn in (-360.0, 0.0, 360.0)
        )
        assert near < 0.01


def test_srtm_ends_at_60_degrees_and_says_so() -> None:
    found = tiles("srtm-1", box(10.2, 59.9, 10.4, 60.1))
    assert found.corners == ((59, 10),)
    assert found.beyond == 1
    assert tiles("srtm-1", box(10.2, 71.2, 10.4, 71.4)).corners == ()


def test_what_a_folder_has_is_known_by_name_and_size(tmp_path: Path) -> None:
    area = box(7.9, 46.2, 8.1, 46.4)
    (tmp_path / "n46e007.hgt").write_bytes(bytes(2_884_802))
    (tmp_path / "N46E008.SRTMGL1.hgt.zip").write_bytes(b"PK")
    (tmp_path / "Copernicus_DSM_COG_10_N46_00_E007_00_DEM.tif").write_bytes(b"II")
    there = list(tmp_path.iterdir())
    assert tiles("srtm-1", area).missing_in(there) == ("N46E007.hgt",)  # it is one of 3 arc-seconds
    assert tiles("srtm-3", area).missing_in(there) == ("N46E008.hgt",)
    assert tiles("glo-30", area).missing_in(there) == ("Copernicus_DSM_COG_10_N46_00_E008_00_DEM.tif",)
    assert tiles("glo-90", area).missing_in(there) == tiles("glo-90", area).names


def test_half_the_earth_is_refused() -> None:
    with pytest.raises(InputError, match=r"spans .* tiles of 1 degree; use a part"):
        needed_tiles(box(-80.0, -60.0, 80.0, 60.0), around_m=100.0, where="area")


@pytest.mark.parametrize(
    ("area", "word"),
    [
        (box(8.2, 46.2, 8.4, 46.4), "Switzerland"),
        (box(179.9, 66.1, -179.9, 66.2), "ArcticDEM"),
        (box(-84.3, 36.4, -84.2, 36.5), "3DEP"),
    ],
)
def test_national_models_are_pointed_at(area, word: str) -> None:
    assert any(word in one.title for one in national_sources(area))


def test_every_set_says_all_that_is_promised() -> None:
    for one in all_sets():
        assert one.address.startswith("https://")
        assert one.vertical_datum in ("EGM96", "EGM2008")
        assert one.licence
        assert "arc-second" in one.resolution


SURFACES = {
    "Copernicus_DSM_COG_10_N46_00_E008_00_DEM.tif": "Copernicus DEM GLO-30 is a surface, with buildings and trees",
    "Copernicus_DSM_30_N46_00_E008_00_DEM.tif": "Copernicus DEM GLO-90",
    "ALPSMLC30_N046E008_DSM.tif": "ALOS World 3D",
    "N46E008.hgt": "the name of an SRTM tile",
    "n46e008.SRTMGL1.hgt.zip": "the name of an SRTM tile",
    "smith_SRTM.tif": "the name of an SRTM tile",
    "ASTGTMV003_N46E008_dem.tif": "ASTER GDEM",
    "site-dsm.tif": 'contains "dsm"',
    "DSM_2024.tif": 'contains "DSM"',
    "dom1_32_448_5200.tif": 'contains "dom"',
    "LHD_FXX_MNS_0448.tif": 'contains "MNS"',
    "MDS05-HU30.tif": 'contains "MDS"',
    "surface_model.tif": 'contains "surface_model"',
}
# The names of the ground models of docs/results/kinds.md and of national providers.
OTHERS = [
    "dem.tif", "davosdorf.tif", "olinda_dem_utm25s.tif", "elev.tif", "elev_vinschgau.tif", "dem1.tif", "dem25.tif",
    "pre_runout_DEM.asc", "small_dem_3m_merged.tif", "jacksboro.tif", "swissalti3d_2019_2501-1120_2_2056_5728.tif",
    "dgm1_32_448_5200.tif", "LHD_FXX_MNT_0448.tif", "MDT05-HU30.tif", "N46E008_DTM.hgt", "domleschg.tif", "kingdom.tif",
    "random.tif", "wisdom-hill.tif",
]  # fmt: skip


@pytest.mark.parametrize("name", SURFACES)
def test_a_surface_model_is_noticed_by_its_name(tmp_path, name):
    assert SURFACES[name] in surface_in_words(TerrainSource((tmp_path / name,)))


@pytest.mark.parametrize("name", OTHERS)
def test_other_names_are_no_alarm(tmp_path, name):
    assert surface_in_words(TerrainSource((tmp_path / name,))) is None


def test_metadata_tell_too(tmp_path):
    ground = write_models(tmp_path).ground
    source = TerrainSource((ground.rename(tmp_path / "heights.tif"),))
    assert surface_in_words(source) is None
    with rasterio.open(source.files[0], "r+") as file:
        file.update_tags(TIFFTAG_IMAGEDESCRIPTION="Digital Surface Model, 1 m")
    assert surface_in_words(source) == 'its metadata contains "Surface Model"'
    with rasterio.open(source.files[0], "r+") as file:
        file.update_tags(TIFFTAG_IMAGEDESCRIPTION="Digital Terrain Model; the surface model is sold apart")
    assert surface_in_words(source) is None


@pytest.mark.parametrize(
    ("name", "word"),
    [
        ("hill_feet.tif", "feet"), ("lidar_us-ft.tif", "us-ft"), ("dem2ft.tif", "ft"), ("left.tif", None),
        ("foothills.tif", None),
    ],
)  # fmt: skip
def test_feet_are_asked_about(tmp_path, name, word):
    path = write_models(tmp_path).ground.rename(tmp_path / name)
    assert feet_in_words(TerrainSource((path,))) == (None if word is None else f'its name contains "{word}"')
    assert feet_in_words(TerrainSource((path,), height_unit="m")) is None


def test_feet_in_metadata_are_asked_about_unless_the_file_states_its_unit(tmp_path):
    path = write_models(tmp_path).ground
    with rasterio.open(path, "r+") as file:
        file.update_tags(TIFFTAG_IMAGEDESCRIPTION="LiDAR bare earth, US survey feet")
    assert feet_in_words(TerrainSource((path,))) == 'its metadata contains "feet"'
    with rasterio.open(path, "r+") as file:
        file.units = ("m",)
    assert feet_in_words(TerrainSource((path,))) is None


def test_pictures_of_heights_are_asked_about(tmp_path):
    ground = write_models(tmp_path).ground
    assert shading_in_words(TerrainSource((ground,))) is None
    assert (
        shading_in_words(TerrainSource((ground.rename(tmp_path / "hillshade_10m.tif"),)))
        == 'its name contains "hillshade"'
    )
    with rasterio.open(tmp_path / "hillshade_10m.tif") as file:
        values, profile = file.read(1), file.profile
    with rasterio.open(tmp_path / "dem.tif", "w", **{**profile, "dtype": "uint8", "nodata": None}) as file:
        file.write((values % 250).astype("uint8"), 1)
    assert shading_in_words(TerrainSource((tmp_path / "dem.tif",))) == "dem.tif has 8 bits (0 to 255), like an image"
    assert shading_in_words(TerrainSource((tmp_path / "none.tif",))) is None


def test_bands_beside_the_first_are_told_and_a_better_name_is_a_question(tmp_path):
    ground = write_models(tmp_path).ground
    with rasterio.open(ground) as file:
        values, profile = file.read(1), file.profile
    path = tmp_path / "bands.tif"

    def source(*names, band=None):
        with rasterio.open(path, "w", **{**profile, "count": len(names)}) as file:
            for number, name in enumerate(names, start=1):
                file.write(values, number)
                if name:
                    file.set_band_description(number, name)
        return TerrainSource((path,), band=band)

    assert bands_in_words(source("")) is None
    assert bands_in_words(source("", "")) == "1 without a name, 2 without a name"
    assert bands_in_words(source("", "", band="2")) is None
    assert bands_in_words(source("Height", "Elevation uncertainty")) == "1 Height, 2 Elevation uncertainty"
    with source("slope", "Elevation").opened() as dataset, pytest.raises(TerrainError) as ended:
        source("slope", "Elevation").band_of(dataset)
    assert str(ended.value).endswith(
        "the first band is 'slope', but the band 'Elevation' seems to contain the heights; set terrain.band (--band) to one of: "
        "1 slope, 2 Elevation"
    )

"""Words about elevation files: surfaces, feet, shaded pictures and further bands are noticed."""

import pytest
import rasterio

from tests.scenario.surface_files import write_models
from uavcover.errors import TerrainError
from uavcover.new.elevation_questions import bands_text, feet_text, shading_text, surface_text
from uavcover.terrain.terrain_source import TerrainSource

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
    assert SURFACES[name] in surface_text(TerrainSource((tmp_path / name,)))


@pytest.mark.parametrize("name", OTHERS)
def test_other_names_are_no_alarm(tmp_path, name):
    assert surface_text(TerrainSource((tmp_path / name,))) is None


def test_metadata_tell_too(tmp_path):
    ground = write_models(tmp_path).ground
    source = TerrainSource((ground.rename(tmp_path / "heights.tif"),))
    assert surface_text(source) is None
    with rasterio.open(source.files[0], "r+") as file:
        file.update_tags(TIFFTAG_IMAGEDESCRIPTION="Digital Surface Model, 1 m")
    assert surface_text(source) == 'its metadata contains "Surface Model"'
    with rasterio.open(source.files[0], "r+") as file:
        file.update_tags(TIFFTAG_IMAGEDESCRIPTION="Digital Terrain Model; the surface model is sold apart")
    assert surface_text(source) is None


@pytest.mark.parametrize(
    ("name", "word"),
    [
        ("hill_feet.tif", "feet"), ("lidar_us-ft.tif", "us-ft"), ("dem2ft.tif", "ft"), ("left.tif", None),
        ("foothills.tif", None),
    ],
)  # fmt: skip
def test_feet_are_asked_about(tmp_path, name, word):
    path = write_models(tmp_path).ground.rename(tmp_path / name)
    assert feet_text(TerrainSource((path,))) == (None if word is None else f'its name contains "{word}"')
    assert feet_text(TerrainSource((path,), height_unit="m")) is None


def test_feet_in_metadata_are_asked_about_unless_the_file_states_its_unit(tmp_path):
    path = write_models(tmp_path).ground
    with rasterio.open(path, "r+") as file:
        file.update_tags(TIFFTAG_IMAGEDESCRIPTION="LiDAR bare earth, US survey feet")
    assert feet_text(TerrainSource((path,))) == 'its metadata contains "feet"'
    with rasterio.open(path, "r+") as file:
        file.units = ("m",)
    assert feet_text(TerrainSource((path,))) is None


def test_pictures_of_heights_are_asked_about(tmp_path):
    ground = write_models(tmp_path).ground
    assert shading_text(TerrainSource((ground,))) is None
    assert (
        shading_text(TerrainSource((ground.rename(tmp_path / "hillshade_10m.tif"),))) == 'its name contains "hillshade"'
    )
    with rasterio.open(tmp_path / "hillshade_10m.tif") as file:
        values, profile = file.read(1), file.profile
    with rasterio.open(tmp_path / "dem.tif", "w", **{**profile, "dtype": "uint8", "nodata": None}) as file:
        file.write((values % 250).astype("uint8"), 1)
    assert shading_text(TerrainSource((tmp_path / "dem.tif",))) == "dem.tif has 8 bits (0 to 255), like an image"
    assert shading_text(TerrainSource((tmp_path / "none.tif",))) is None


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

    assert bands_text(source("")) is None
    assert bands_text(source("", "")) == "1 without a name, 2 without a name"
    assert bands_text(source("", "", band="2")) is None
    assert bands_text(source("Height", "Elevation uncertainty")) == "1 Height, 2 Elevation uncertainty"
    with source("slope", "Elevation").opened() as dataset, pytest.raises(TerrainError) as ended:
        source("slope", "Elevation").band_of(dataset)
    assert str(ended.value).endswith(
        "the first band is 'slope', but the band 'Elevation' seems to contain the heights; set terrain.band (--band) to one of: "
        "1 slope, 2 Elevation"
    )

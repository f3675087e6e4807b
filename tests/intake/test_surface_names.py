"""Elevation data that says of itself that it is a surface model."""

import pytest
import rasterio

from tests.scenario.surface_files import write_models
from uavcover.intake.surface_names import surface_in_words
from uavcover.scenario.terrain_source import TerrainSource

SURFACES = {
    "Copernicus_DSM_COG_10_N46_00_E008_00_DEM.tif": "Copernicus DEM GLO-30 is a surface, with buildings and trees",
    "Copernicus_DSM_30_N46_00_E008_00_DEM.tif": "Copernicus DEM GLO-90",
    "ALPSMLC30_N046E008_DSM.tif": "ALOS World 3D",
    "N46E008.hgt": "named as SRTM's tiles are",
    "n46e008.SRTMGL1.hgt.zip": "named as SRTM's tiles are",
    "smith_SRTM.tif": "named as SRTM's tiles are",
    "ASTGTMV003_N46E008_dem.tif": "ASTER GDEM",
    "site-dsm.tif": 'says "dsm"',
    "DSM_2024.tif": 'says "DSM"',
    "dom1_32_448_5200.tif": 'says "dom"',
    "LHD_FXX_MNS_0448.tif": 'says "MNS"',
    "MDS05-HU30.tif": 'says "MDS"',
    "surface_model.tif": 'says "surface_model"',
}
# The names of the ground models of docs/results/foreign_inputs.md and of national providers.
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
    assert surface_in_words(source) == 'its metadata say "Surface Model"'
    with rasterio.open(source.files[0], "r+") as file:
        file.update_tags(TIFFTAG_IMAGEDESCRIPTION="Digital Terrain Model; the surface model is sold apart")
    assert surface_in_words(source) is None

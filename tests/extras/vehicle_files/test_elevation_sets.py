"""Sets of elevation files: which tiles an area needs, and which of them a folder has."""

from pathlib import Path
from random import Random

import pytest
import shapely

from uavcover.errors import InputError
from uavcover.extras.vehicle_files.area_terrain import NeededTiles, all_sets, national_sources, needed_tiles


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

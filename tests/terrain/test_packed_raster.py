"""Elevation files inside a zip or gzip file: the same heights as unpacked, or one line that says why not."""

import gzip
import zipfile
from dataclasses import replace

import numpy as np
import pytest
import rasterio

from tests.terrain.dem_files import write_dem
from uavcover.errors import TerrainError
from uavcover.terrain import terrain_source
from uavcover.terrain.elevation_file import read_height_amsl_m, read_heights_amsl_m
from uavcover.terrain.terrain_source import FILES, TerrainSource, find_tiles, gdal_name

LAT, LON = 46.55, 8.03
SEA = bytes(2 * 1201 * 1201)


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return write_dem(
        tmp_path_factory.mktemp("dem") / "whole.tif", np.random.default_rng(5), lat_deg=LAT, lon_deg=LON, epsg=32632,
        pixel_m=10.0, size_m=1400.0,
    )  # fmt: skip


def in_zip(path, *entries):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in entries:
            archive.writestr(name, data)
    return path


def in_gzip(path, data):
    path.write_bytes(gzip.compress(data, compresslevel=1))
    return path


def ascii_grid(plain):
    """The same heights as an ASCII grid, rounded to centimetres."""
    with rasterio.open(plain) as file:
        values, at = file.read(1), file.transform
    head = (
        f"ncols {values.shape[1]}\nnrows {values.shape[0]}\nxllcorner {at.c}\nyllcorner {at.f + at.e * len(values)}\n"
    )
    rows = "\n".join(" ".join(f"{value:.2f}" for value in row) for row in values)
    return f"{head}cellsize {at.a}\nNODATA_value -9999\n{rows}\n".encode()


@pytest.mark.parametrize("packed", ["dem.zip", "dem.tif.gz", "DEM.TIF.GZ", "dem.asc.gz"])
def test_packed_heights_are_those_of_the_file(plain, tmp_path, packed):
    unpacked, crs = plain, None
    if ".asc" in packed:
        unpacked, crs = tmp_path / "plain.asc", "EPSG:32632"
        unpacked.write_bytes(ascii_grid(plain))
    if packed.endswith(".zip"):
        path = in_zip(tmp_path / packed, ("inner/whole.tif", unpacked.read_bytes()), ("readme.txt", b"a text"))
    else:
        path = in_gzip(tmp_path / packed, unpacked.read_bytes())
    (found,) = find_tiles([packed], folder=tmp_path, around=None)
    lat, lon = np.array([[LAT], [LON]]) + np.random.default_rng(1).uniform(-0.005, 0.005, (2, 500))
    heights, expected = (
        read_heights_amsl_m(TerrainSource((file,), crs=crs), "EGM96", lat, lon) for file in (found, unpacked)
    )
    assert np.isfinite(expected).all()
    assert (heights == expected).all()
    assert TerrainSource((found,)).sha256() == TerrainSource((path.resolve(),)).sha256()


def test_nothing_is_left_beside_a_gzip_file(tmp_path):
    """GDAL keeps the length of a long one in a file ``.gz.properties`` unless it is told not to."""
    noise = np.random.default_rng(3).integers(100, 4000, (1201, 1201)).astype(">i2")
    path = in_gzip(tmp_path / "N46E008.hgt.gz", noise.tobytes())
    assert path.stat().st_size > 1_500_000
    rows, columns = np.array([1, 600, 1199]), np.array([1, 30, 1199])
    heights = read_heights_amsl_m(TerrainSource((path,)), "EGM96", 47.0 - rows / 1200.0, 8.0 + columns / 1200.0)
    assert heights == pytest.approx(noise[rows, columns].astype(float))
    with rasterio.Env(CPL_VSIL_GZIP_WRITE_PROPERTIES="YES"):
        read_height_amsl_m(path, "EGM96", lat_deg=46.5, lon_deg=8.5)
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


def test_a_packed_tile_of_open_sea_is_no_bomb(tmp_path):
    for path in (in_zip(tmp_path / "N46E008.hgt.zip", ("N46E008.hgt", SEA)), in_gzip(tmp_path / "N46E008.hgt.gz", SEA)):
        assert read_height_amsl_m(path, "EGM96", lat_deg=46.5, lon_deg=8.5) == 0.0


def test_zip_files_that_are_none_or_hold_something_else(tmp_path, monkeypatch):
    monkeypatch.setattr(terrain_source, "FILES", replace(FILES, harmless_zip_bytes=1_000_000))
    for entries, words in (
        ([("a.txt", b"x")], "the archive must contain one elevation file, but 0 of its 1 entries are elevation files"),
        (
            [("a.hgt", b"x"), ("b.hgt", b"x")],
            "the archive must contain one elevation file, but 2 of its 2 entries are elevation files",
        ),
        ([("a.hgt", bytes(10_000_000))], "times its packed size; unpack it yourself if you trust it"),
    ):
        with pytest.raises(TerrainError, match=words):
            gdal_name(in_zip(tmp_path / "a.zip", *entries))
    (tmp_path / "bad.zip").write_bytes(b"no zip")
    with pytest.raises(TerrainError, match="cannot open the file as a zip archive"):
        gdal_name(tmp_path / "bad.zip")


def test_gzip_files_that_are_none_damaged_or_too_long(tmp_path, monkeypatch):
    whole = gzip.compress(np.random.default_rng(3).integers(100, 4000, (1201, 1201)).astype(">i2").tobytes())
    flipped = bytearray(whole)
    flipped[len(whole) // 2] ^= 0xFF
    for data, words in (
        (b"no gzip", r"cannot be unpacked \(Not a gzipped file \(b'no'\)\); download it again"),
        (whole[: len(whole) // 2], r"cannot be unpacked \(Compressed file ended .*\); download it again"),
        (bytes(flipped), r"cannot be unpacked \(.*\); download it again"),
        (gzip.compress(b""), "the archive is empty; download it again"),
    ):
        path = tmp_path / f"N46E00{len(data) % 10}.hgt.gz"
        path.write_bytes(data)
        with pytest.raises(TerrainError, match=words) as refused:
            read_height_amsl_m(path, "EGM96", lat_deg=46.5, lon_deg=8.5)
        assert "\n" not in str(refused.value)
        path.unlink()
    # The length at the end of the file lies; what comes out counts.
    monkeypatch.setattr(terrain_source, "FILES", replace(FILES, max_gzip_bytes=2_000_000))
    bomb = gzip.compress(bytes(5_000_000))
    (tmp_path / "bomb.hgt.gz").write_bytes(bomb[:-4] + (100).to_bytes(4, "little"))
    with pytest.raises(
        TerrainError,
        match=r"the archive unpacks to more than 2,000,000 bytes; unpack it yourself \(gunzip\) if you trust it",
    ):
        gdal_name(tmp_path / "bomb.hgt.gz")


@pytest.mark.parametrize("name", ["dem.tar.gz", "dem.7z", "dem.hgt.bz2", "dem.tgz", "dem.gz"])
def test_other_archives_say_unpack(tmp_path, name):
    (tmp_path / name).write_bytes(b"packed")
    with pytest.raises(TerrainError, match=r"is compressed .*; unpack it and specify the raster"):
        read_height_amsl_m(tmp_path / name, "EGM96", lat_deg=46.5, lon_deg=8.5)


def test_a_folder_of_tiles_has_other_archives_too(plain, tmp_path):
    """A zipped Shapefile beside the tiles is none of them; a zip file that is damaged may be one."""
    (tmp_path / "a.tif").write_bytes(plain.read_bytes())
    in_gzip(tmp_path / "b.tif.gz", plain.read_bytes())
    in_zip(tmp_path / "c.zip", ("whole.tif", plain.read_bytes()))
    in_zip(tmp_path / "fields.zip", ("fields.shp", b"x"))
    (tmp_path / "points.csv.gz").write_bytes(b"x")
    found = find_tiles(["."], folder=tmp_path, around=None)
    assert [file.name for file in found] == ["a.tif", "b.tif.gz", "c.zip"]
    (tmp_path / "d.zip").write_bytes(b"no zip")
    assert len(find_tiles(["."], folder=tmp_path, around=None)) == 4

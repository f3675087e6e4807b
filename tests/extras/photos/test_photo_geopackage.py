"""A verdict on pictures as a GeoPackage, read by GDAL (pyogrio) and, for its coordinate system, by sqlite."""

import builtins
import dataclasses
import sqlite3

import pytest
import shapely

from tests.extras.photos.test_photo_page import verdict  # noqa: F401 (the fixture)
from uavcover.errors import InputError, OutputError
from uavcover.extras.photos.photo_page import LAYERS, write_geopackage
from uavcover.extras.photos.photo_verdict import footprints_geojson
from uavcover.run.user import Unattended

pyogrio = pytest.importorskip("pyogrio")


def test_other_readers_find_the_layers_where_they_belong(tmp_path, verdict):  # noqa: F811
    path = tmp_path / "verdict.gpkg"
    write_geopackage(verdict, path, Unattended(), force=False)
    assert [str(name) for name, _ in pyogrio.list_layers(path)] == list(LAYERS)
    with sqlite3.connect(path) as database:
        systems = database.execute("SELECT DISTINCT organization, organization_coordsys_id FROM gpkg_contents "
                                   "JOIN gpkg_spatial_ref_sys USING (srs_id)").fetchall()  # fmt: skip
    assert systems == [("EPSG", 4326)]
    meta, _, shapes, fields = pyogrio.raw.read(path, layer="footprints")
    assert meta["crs"] == "EPSG:4326"
    expected = footprints_geojson(verdict)["features"]
    assert [str(name) for name in fields[0]] == [feature["properties"]["name"] for feature in expected]
    one = shapely.from_wkb(shapes[3])
    assert shapely.equals_exact(shapely.force_2d(one), shapely.geometry.shape(expected[3]["geometry"]), tolerance=1e-9)
    meta, _, shapes, fields = pyogrio.raw.read(path, layer="pictures")
    place = shapely.from_wkb(shapes[3])
    picture = verdict.placed.pictures[3]
    assert (place.x, place.y) == pytest.approx((picture.lon_deg, picture.lat_deg), abs=1e-7)
    assert place.z == pytest.approx(picture.alt_m, abs=0.05)
    assert fields[list(meta["fields"]).index("tilt_deg")][3] == pytest.approx(0.0, abs=1e-5)
    meta, _, shapes, fields = pyogrio.raw.read(path, layer="gaps")
    assert sum(fields[list(meta["fields"]).index("area_m2")]) == pytest.approx(
        sum(gap["area_m2"] for gap in verdict.document["gaps"])
    )


def test_no_gap_is_an_empty_layer_and_no_file_is_replaced(tmp_path, verdict):  # noqa: F811
    path = tmp_path / "verdict.gpkg"
    write_geopackage(dataclasses.replace(verdict, gaps=[]), path, Unattended(), force=False)
    assert pyogrio.read_info(path, layer="gaps")["features"] == 0
    kept = path.read_bytes()
    with pytest.raises(OutputError, match="--force"):
        write_geopackage(verdict, path, Unattended(), force=False)
    assert path.read_bytes() == kept
    write_geopackage(verdict, path, Unattended(), force=True)
    assert pyogrio.read_info(path, layer="gaps")["features"] == len(verdict.gaps)
    assert [file.name for file in tmp_path.iterdir()] == ["verdict.gpkg"]
    with pytest.raises(OutputError, match="no such folder"):
        write_geopackage(verdict, tmp_path / "none/verdict.gpkg", Unattended(), force=False)


def test_without_the_extra_and_with_another_name_it_is_one_line(tmp_path, verdict, monkeypatch):  # noqa: F811
    with pytest.raises(InputError, match=r"must end in \.gpkg"):
        write_geopackage(verdict, tmp_path / "verdict.json", Unattended(), force=False)
    real = builtins.__import__

    def without(name, *arguments, **named):
        if name.startswith("pyogrio"):
            raise ImportError(name)
        return real(name, *arguments, **named)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(InputError, match=r"uavcover\[gis\]"):
        write_geopackage(verdict, tmp_path / "verdict.gpkg", Unattended(), force=False)
    assert not list(tmp_path.iterdir())

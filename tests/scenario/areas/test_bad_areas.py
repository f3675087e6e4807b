"""Bad areas: each is one line that names the file, and the feature where there is one, with the way out."""

import json
import sys
import zipfile

import numpy as np
import pytest
import shapely

from tests.scenario.areas import written
from tests.scenario.scenario_texts import survey_text
from uavcover.errors import InputError, ScenarioError
from uavcover.scenario.areas import features
from uavcover.scenario.areas.area_file import AreaQuery, read_area
from uavcover.scenario.scenario_file import parse_scenario

RING = [[8.0, 46.5], [8.02, 46.5], [8.02, 46.52], [8.0, 46.52], [8.0, 46.5]]
BOW_TIE = [[8.0, 46.5], [8.02, 46.52], [8.02, 46.5], [8.0, 46.52], [8.0, 46.5]]
HOLE = [[8.005, 46.505], [8.01, 46.505], [8.01, 46.51], [8.005, 46.505]]


def polygon(*rings):
    return json.dumps({"type": "Polygon", "coordinates": rings})


def named(*rings, **more):
    geometry = {"type": "Polygon", "coordinates": rings}
    feature = {"type": "Feature", "properties": {"name": "north"}, "geometry": geometry}
    return json.dumps({"type": "FeatureCollection", "features": [feature], **more})


def kml(coordinates):
    return (
        "<kml><Placemark><name>north</name><Polygon><outerBoundaryIs><LinearRing><coordinates>"
        f"{coordinates}</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark></kml>"
    )


_SECTION = "a\n1\n 8.0 46.5\n 8.02 46.5\n 8.02 46.52\n"
TEXTS = {
    "curves": ("a.wkt", "CURVEPOLYGON (CIRCULARSTRING (0 0, 1 1, 2 0, 1 -1, 0 0))", "curves are not supported"),
    "osmosis cut off": ("a.poly", _SECTION.replace("a\n", "END\n", 1), "line 5: the last section lacks END; download the"),
    "osmosis of two places": ("a.poly", "a\n1\n 8.0 46.5\n 8.1 46.5\nEND\nEND", "line 5: the section has 2 positions; an"),
    "osmosis swapped": ("a.poly", _SECTION.replace("46.5\n", "146.5\n") + "END\nEND", "'8.0 146.5' is not a valid position"),
    "osmosis nan": ("a.poly", _SECTION + " nan 46.5\nEND\nEND", "line 6: 'nan 46.5' is not a valid position; write longitude"),
    "osmosis hole outside": (
        "a.poly", _SECTION + "END\n!2\n 9 46\n 9 47\n 10 47\nEND\nEND", "line 7: the hole does not lie inside a polygon"),
    "osmosis of nothing": ("a.poly", "a\nEND\n", "contains no polygons"),
    "empty": ("a.geojson", "", "the file is empty"),
    "no JSON": ("a.geojson", "{", "cannot read the file as JSON"),
    "nested too deeply": ("a.geojson", "[" * 100_000, "nested too deeply"),
    "no type": ("a.geojson", '{"rings": []}', "document.type: the key is missing"),
    "a number that is none": ("a.geojson", polygon([[1.0, "a"], [2, 2], [3, 3]]), "expected a number"),
    "NaN": ("a.geojson", polygon(RING).replace("46.52", "NaN", 1), "cannot read"),
    "one number": ("a.geojson", polygon([[1.0], [2.0, 1.0], [3.0, 1.0]]), "position has 1 numbers"),
    "only a line": ("a.geojson", json.dumps({"type": "LineString", "coordinates": RING}), "no polygons (only 1 LineString)"),
    "no features": ("a.geojson", '{"type": "FeatureCollection", "features": []}', "contains no polygons"),
    "no ring": ("a.geojson", polygon(), "the polygon has no ring"),
    "crosses itself": (
        "a.geojson", named(BOW_TIE), "a.geojson, feature 1 (north): the outline crosses itself at longitude 8.010000, latitude "
        "46.510000; correct it there, or use --make-valid",
    ),
    "not closed": ("a.geojson", named(RING[:-1]), "feature 1 (north): the ring is not closed: it ends at (8, 46.52)"),
    "two corners": ("a.geojson", named([RING[0], RING[1], RING[0]]), "has 2 different corners, but needs"),
    "on one line": ("a.geojson", named([[8.0, 46.0], [8.1, 46.1], [8.2, 46.2], [8.0, 46.0]]), "the area is zero"),
    "a hole outside": ("a.geojson", named(HOLE, RING), "a hole lies outside"),
    "swapped beyond 90": (
        "a.geojson", named([[36.4, -121.0], [36.5, -121.0], [36.5, -121.1], [36.4, -121.0]]), "first, or use --swap-axes",
    ),
    "metres as degrees": (
        "a.geojson", named([[5e5, 5e6], [5.1e5, 5e6], [5.1e5, 5.1e6], [5e5, 5e6]]), "coordinate system with --crs",
    ),
    "tiny": ("a.geojson", named([[8.0, 46.0], [8.000001, 46.0], [8.000001, 46.000001], [8.0, 46.0]]), "square metres"),
    "unknown system": ("a.geojson", named(RING, crs={"type": "name", "properties": {"name": "EPSG:1"}}), "unknown CRS"),
    "round a pole": (
        "a.geojson", named([[0.0, 85.0], [90.0, 85.0], [180.0, 85.0], [-90.0, 85.0], [0.0, 85.0]]), "contains a pole",
    ),
    "not XML": ("a.kml", "not xml", "invalid XML"),
    "entities": ("a.kml", '<!DOCTYPE kml [<!ENTITY a "b">]><kml/>', "document types"),
    "external entities": ("a.kml", '<!DOCTYPE kml [<!ENTITY a SYSTEM "file:///etc/passwd">]><kml>&a;</kml>', "document types"),
    "KML swapped": ("a.kml", kml("36.4,-121,0 36.5,-121,0 36.5,-121.1,0 36.4,-121,0"), "write longitude first"),
    "KML not closed": ("a.kml", kml("8,46.5 8.02,46.5 8.02,46.52"), "the ring was not closed; repeat its first corner"),
    "a path": ("a.kml", "<kml><LineString><coordinates>8,46 9,46</coordinates></LineString></kml>", "(only 1 line)"),
    "a link": ("a.kml", "<kml><NetworkLink><Link><href>http://a/b.kml</href></Link></NetworkLink></kml>", "does not download"),
    "WKT that is none": ("a.wkt", "POLYGON ((8 46, 8.1", "not valid WKT"),
    "WKT not closed": ("a.wkt", "POLYGON ((8 46, 8.1 46, 8.1 46.1))", "a ring is not closed"),
    "a WKT point": ("a.wkt", "POINT (8 46)", "contains no polygons (only 1 Point)"),
    "SRID": ("a.wkt", "SRID=1;POLYGON ((8 46, 8.1 46, 8.1 46.1, 8 46))", "SRID=1 is not an EPSG coordinate system"),
    "poly of two": ("a.poly", "46.5 8.0\n46.6 8.1\n", "corners"),
    "no plan": ("a.plan", '{"fileType": "Mission"}', "not a plan"),
    "zero bytes": ("a.kml", "\0\0\0", "zero byte"),
    "unknown suffix": ("a.dwg", "x", ".dwg is not a supported area format; use one of .geojson"),
}  # fmt: skip


def refused(folder, name, **more):
    with pytest.raises(InputError) as caught:
        read_area(AreaQuery(source=name, **more), folder=folder)
    message = str(caught.value)
    assert "\n" not in message
    assert ";" in message  # the way out
    return message


@pytest.mark.parametrize("what", TEXTS)
def test_a_bad_file_is_one_line_with_the_way_out(tmp_path, what):
    name, text, words = TEXTS[what]
    (tmp_path / name).write_text(text, encoding="utf-8")
    message = refused(tmp_path, name)
    assert words in message
    assert message.startswith(str(tmp_path / name))


def test_a_scenario_tells_the_same_with_its_key(tmp_path):
    (tmp_path / "a.geojson").write_text(named(BOW_TIE), encoding="utf-8")
    for area, words in (
        ('file = "a.geojson"', r"area\.file: .*a\.geojson, feature 1 \(north\): the outline crosses itself"),
        ('geojson = "a.geojson"\nlayer = "b"', r"area\.layer: this key requires file"),
    ):
        with pytest.raises(ScenarioError, match=words):
            parse_scenario(survey_text(area, '"d.tif"', (46.5, 8.0)), source="s.toml", folder=tmp_path)


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("nowhere.kml", "no such file"),
        ("8,46,0.5", "the radius must be between 1 and 50,000 m, not 0.5 m"),
        ("46,8,0", "the radius must be between 1 and 50,000 m, not 0 m"),
        ("46,8,100km", "must be between 1 and 50,000 m"),
        ("146,8,100", "latitude 146"),
        ("8,46", "2 numbers as an area; write a box as WEST,SOUTH,EAST,NORTH"),
        ("8,46,9,47,5", "5 numbers"),
        ("8,46.1,8.1,46", "must be below north"),
        ("46,108,46.1,108.1", "write WEST,SOUTH,EAST,NORTH"),
        ("8,46,-172.5,47", None),
        ("10,46,8,47", "more than half the Earth"),
        ("POLYGON ((8 46, 8.1 46", "not valid WKT"),
        ("POLYGON EMPTY", "contains no polygons"),
        ("circle:1,2,3,4", "4 numbers"),
    ],
)
def test_bad_text(tmp_path, source, words):
    if words is None:
        assert read_area(AreaQuery(source=source), folder=tmp_path).parts
        return
    assert words in refused(tmp_path, source)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"feature": "nort"}, "did you mean 'north'?"),
        ({"feature": "zzz"}, "the file has no feature 'zzz'; the names are: north"),
        ({"feature": "2"}, "has no feature 2; it has 1, counted from 1"),
        ({"layer": "a"}, "no feature has a name"),
        ({"crs": "EPSG:none"}, "--crs: unknown coordinate system 'EPSG:none'; use, for example, EPSG:32632"),
        ({"crs": "EPSG:2056"}, "square metres; if the coordinates use another coordinate system"),
        ({"crs": "EPSG:5773"}, "not a coordinate system on Earth"),
    ],
)
def test_bad_choices(tmp_path, more, words):
    (tmp_path / "a.geojson").write_text(named(RING), encoding="utf-8")
    assert words in refused(tmp_path, "a.geojson", **more)


def zipped(path, entries):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in entries:
            archive.writestr(name, data)


GOOD_KML = kml("8,46.5 8.02,46.5 8.02,46.52 8,46.5")


@pytest.mark.parametrize(
    ("entries", "words"),
    [
        ([("a.txt", "x")], "contains no KML document"),
        ([("inner.kmz", "x")], "the archive contains another archive (inner.kmz)"),
        ([("a.kml", GOOD_KML), ("b.kml", GOOD_KML)], "has 2 documents and no doc.kml"),
        (
            [("doc.kml", GOOD_KML), *((f"{n}.png", "") for n in range(features.MAX_ENTRIES))],
            "a.kmz: the archive has 2001 entries",
        ),
        ([("doc.kml", " " * (features.MAX_KML_BYTES + 1))], "unpacks to"),
        ([("doc.kml", " " * (features.MAX_KML_BYTES // 8))], "times its packed size"),
    ],
    ids=["no KML", "nested", "two documents", "many entries", "large", "a bomb"],
)
def test_a_bad_kmz(tmp_path, entries, words):
    zipped(tmp_path / "a.kmz", entries)
    assert words in refused(tmp_path, "a.kmz")


def test_a_kmz_that_is_no_zip_and_one_that_was_cut(tmp_path):
    (tmp_path / "a.kmz").write_bytes(b"PK\3\4 nothing")
    assert "cannot open the file as KMZ" in refused(tmp_path, "a.kmz")
    zipped(tmp_path / "b.kmz", [("doc.kml", GOOD_KML * 50)])
    data = bytearray((tmp_path / "b.kmz").read_bytes())
    data[60:90] = bytes(30)
    (tmp_path / "b.kmz").write_bytes(data)
    refused(tmp_path, "b.kmz")


def test_a_size_in_the_directory_that_lies_fills_no_memory(tmp_path, monkeypatch):
    monkeypatch.setattr(features, "MAX_KML_BYTES", 1000)
    monkeypatch.setattr(features, "MAX_RATIO", 1e9)
    zipped(tmp_path / "a.kmz", [("doc.kml", "x" * 5000)])
    data = (tmp_path / "a.kmz").read_bytes()
    (tmp_path / "a.kmz").write_bytes(data.replace((5000).to_bytes(4, "little"), (900).to_bytes(4, "little")))
    refused(tmp_path, "a.kmz")


@pytest.mark.parametrize("seed", range(60))
def test_any_damage_is_one_line_or_an_area(tmp_path, seed):
    """Bytes of good files changed, cut or doubled: never a trace."""
    rng = np.random.default_rng(seed)
    parts, _, _ = written.at_position(written.drawn_parts(seed, 2, 1), "Tennessee")
    name = ("a.geojson", "a.kml", "a.kmz", "a.wkt", "a.poly", "a.plan")[seed % 6]
    path = tmp_path / name
    match name:
        case "a.poly":
            written.poly(path, parts[0].exterior.coords)
        case "a.plan":
            written.plan(path, surveys=[part.exterior.coords for part in parts])
        case _:
            getattr(written, name[2:])(path, parts)
    data = bytearray(path.read_bytes())
    for _ in range(int(rng.integers(1, 6))):
        at = int(rng.integers(len(data)))
        match int(rng.integers(3)):
            case 0:
                data[at] = int(rng.integers(256))
            case 1:
                del data[at : at + int(rng.integers(1, 40))]
            case _:
                data[at:at] = data[at : at + 20]
    path.write_bytes(data)
    try:
        found, message = read_area(AreaQuery(source=str(path), make_valid=bool(seed % 2))).parts, ""
    except InputError as error:
        found, message = (), str(error)
    assert "\n" not in message
    assert bool(found) != bool(message)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("POINT (8 46)", "the area: the file contains no polygons (only 1 Point); draw"),
        ("LINESTRING Z (8 46 1, 9 47 1)", "the area: the file contains no polygons (only 1 LineString); draw"),
        (
            "MULTISURFACE (CURVEPOLYGON (CIRCULARSTRING (0 0, 1 1, 2 0, 1 -1, 0 0)))",
            "curves are not supported; save",
        ),
    ],
)
def test_shapes_that_are_no_area_are_no_missing_file(tmp_path, text, words):
    assert words in refused(tmp_path, text)


def test_a_layer_that_is_not_there_is_named_before_systems_that_differ(tmp_path):
    pytest.importorskip("pyogrio")
    parts, _, _ = written.at_position(written.drawn_parts(1, 1, 0), "Tennessee")
    written.gis(tmp_path / "a.gpkg", parts, 4326, driver="GPKG", layer="fields")
    written.gis(tmp_path / "a.gpkg", parts, 32616, driver="GPKG", layer="forest")
    assert "a.gpkg: the layers (fields, forest) differ" in refused(tmp_path, "a.gpkg")
    assert "a.gpkg: the file has no layer 'meadow', and the layers (fields, forest) differ" in refused(
        tmp_path, "a.gpkg", layer="meadow"
    )


def test_bad_zips(tmp_path):
    pytest.importorskip("pyogrio")
    parts, _, _ = written.at_position(written.drawn_parts(1, 1, 0), "Tennessee")
    written.gis(tmp_path / "fields.shp", parts, 4326, driver="ESRI Shapefile")
    shapes = [(path.name, path.read_bytes()) for path in sorted(tmp_path.glob("fields.*"))]
    zipped(tmp_path / "good.zip", shapes)
    assert read_area(AreaQuery(source="good.zip"), folder=tmp_path).name == "field 1"
    zipped(tmp_path / "two.zip", [*shapes, ("other.gpkg", b"x")])
    assert "the archive must contain one file (.gpkg, .shp, .fgb), not 2; unpack it" in refused(tmp_path, "two.zip")
    zipped(tmp_path / "none.zip", [("a.txt", b"x")])
    assert "the archive must contain one file" in refused(tmp_path, "none.zip")
    zipped(tmp_path / "bomb.zip", [*shapes, ("big.txt", bytes(20_000_000))])
    assert "unpack it yourself if you trust it" in refused(tmp_path, "bomb.zip")
    (tmp_path / "bad.zip").write_bytes(b"PK no")
    assert "cannot open the file as a zip archive" in refused(tmp_path, "bad.zip")


def test_without_pyogrio_the_line_says_how_to_get_it(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyogrio", None)
    (tmp_path / "a.gpkg").write_bytes(b"SQLite format 3\0")
    message = refused(tmp_path, "a.gpkg")
    assert "extra gis (pip install 'uavcover[gis]'); or use GeoJSON or KML" in message


def test_bad_gis_files(tmp_path):
    pytest.importorskip("pyogrio")
    parts, grid, epsg = written.at_position(written.drawn_parts(1, 1, 0), "Tennessee")
    (tmp_path / "a.gpkg").write_bytes(b"SQLite format 3\0 nothing")
    assert "cannot be read" in refused(tmp_path, "a.gpkg")
    written.gis(tmp_path / "b.shp", grid, epsg, driver="ESRI Shapefile")
    (tmp_path / "b.prj").unlink()
    assert "specify it with --crs EPSG:NUMBER" in refused(tmp_path, "b.shp")
    assert read_area(AreaQuery(source="b.shp", crs=f"EPSG:{epsg}"), folder=tmp_path).parts
    (tmp_path / "b.shx").unlink()
    (tmp_path / "b.shp").write_bytes((tmp_path / "b.shp").read_bytes()[:120])
    refused(tmp_path, "b.shp")
    written.gis(tmp_path / "c.gpkg", parts, 4326, driver="GPKG", layer="north")
    import pyogrio

    pyogrio.raw.write(
        str(tmp_path / "c.gpkg"), geometry=shapely.to_wkb(np.array(parts, dtype=object)), crs="EPSG:4326",
        geometry_type="Polygon", fields=[], field_data=[], driver="GPKG", layer="south", append=True,
    )  # fmt: skip
    assert "several layers (north, south); choose one with --layer" in refused(tmp_path, "c.gpkg")
    assert "did you mean 'south'?" in refused(tmp_path, "c.gpkg", layer="soth")

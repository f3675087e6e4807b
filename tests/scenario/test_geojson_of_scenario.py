"""An area that a scenario takes from a GeoJSON file."""

import json
from pathlib import Path

import pytest

from tests.scenario.scenario_texts import GOOD, parse, refused
from uavcover.scenario.scenario_file import dump_scenario

OUTER = [[-84.22, 36.47], [-84.21, 36.47], [-84.21, 36.48], [-84.22, 36.48], [-84.22, 36.47]]
HOLE = [[-84.218, 36.472], [-84.216, 36.472], [-84.216, 36.474], [-84.218, 36.472]]
POLYGON = {"type": "Polygon", "coordinates": [OUTER, HOLE]}
FEATURE = {"type": "Feature", "properties": {}, "geometry": POLYGON}
WITH_GEOJSON = "\n".join(
    'geojson = "sub/area.geojson"' if line.startswith("polygon") else "" if line.startswith("holes") else line
    for line in GOOD.splitlines()
)


def write_geojson(folder, document):
    (folder / "sub").mkdir(exist_ok=True)
    text = document if isinstance(document, str) else json.dumps(document)
    (folder / "sub" / "area.geojson").write_text(text, encoding="utf-8")


@pytest.mark.parametrize(
    "document",
    [
        POLYGON,
        FEATURE,
        {"type": "FeatureCollection", "features": [{"type": "Feature", "geometry": None}, FEATURE]},
        {"type": "MultiPolygon", "coordinates": [[OUTER, HOLE]]},
        {**FEATURE, "crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}}},
        {"type": "Polygon", "coordinates": [[[*p, 300.0] for p in OUTER], HOLE]},
    ],
    ids=["Polygon", "Feature", "FeatureCollection", "MultiPolygon of one", "old style with its crs", "with heights"],
)
def test_geojson_with_one_polygon(tmp_path, document):
    write_geojson(tmp_path, document)
    area = parse(WITH_GEOJSON, tmp_path).area
    assert area.geojson is None
    assert area.polygon_lon_lat_deg == tuple((lon, lat) for lon, lat in OUTER)
    assert area.holes_lon_lat_deg == (tuple((lon, lat) for lon, lat in HOLE),)
    # The scenario of the run folder does not need the file any more.
    scenario = parse(WITH_GEOJSON, tmp_path)
    assert parse(dump_scenario(scenario), Path("/elsewhere")) == scenario


EAST = [[lon + 0.02, lat] for lon, lat in OUTER]


@pytest.mark.parametrize(
    "document",
    [
        {"type": "MultiPolygon", "coordinates": [[OUTER, HOLE], [EAST]]},
        {
            "type": "FeatureCollection",
            "features": [
                FEATURE,
                {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": [EAST]}},
            ],
        },
    ],
    ids=["MultiPolygon", "two features"],
)
def test_geojson_with_several_parts(tmp_path, document):
    write_geojson(tmp_path, document)
    scenario = parse(WITH_GEOJSON, tmp_path)
    rings = [tuple((lon, lat) for lon, lat in ring) for ring in (OUTER, HOLE, EAST)]
    assert scenario.area.parts == ((rings[0], rings[1]), (rings[2],))
    assert parse(dump_scenario(scenario), Path("/elsewhere")) == scenario


@pytest.mark.parametrize(
    ("document", "words"),
    [
        ("{", "cannot read the file as GeoJSON"),
        ("[" * 100_000, "cannot read the file as GeoJSON"),
        ({"type": "Point", "coordinates": [1, 2]}, "contains no polygons"),
        ([], "cannot read the file as GeoJSON"),
        ({"type": "MultiPolygon", "coordinates": []}, "contains no polygons"),
        ({"type": "MultiPolygon", "coordinates": [[OUTER], []]}, "cannot read the file as GeoJSON"),
        (
            {"type": "MultiPolygon", "coordinates": [[OUTER], [HOLE, OUTER]]},
            "polygon 1: hole 0: the hole reaches outside",
        ),
        ({"type": "MultiPolygon", "coordinates": [[OUTER], [HOLE[:2]]]}, "polygon 1: a ring needs at least 3"),
        ({"type": "Polygon", "coordinates": []}, "cannot read the file as GeoJSON"),
        ({"type": "Polygon"}, "cannot read the file as GeoJSON"),
        ({"type": "Polygon", "coordinates": [[["a", "b"]]]}, "cannot read the file as GeoJSON"),
        ({"type": "FeatureCollection", "features": 5}, "cannot read the file as GeoJSON"),
        ({"type": "MultiPolygon", "coordinates": 5}, "cannot read the file as GeoJSON"),
        ({"type": "Polygon", "coordinates": [[[500000.0, 4e6], [500100.0, 4e6], [500100.0, 5e6]]]}, "in this order"),
        (
            {**FEATURE, "crs": {"type": "name", "properties": {"name": "EPSG:32616"}}},
            "has a different coordinate system",
        ),
        ({"type": "Polygon", "coordinates": [[OUTER[0], OUTER[2], OUTER[1], OUTER[3]]]}, "Self-intersection"),
        ({"type": "Polygon", "coordinates": [HOLE, OUTER]}, "hole 0: the hole reaches outside"),
    ],
)
def test_geojson_that_is_no_area(tmp_path, document, words):
    write_geojson(tmp_path, document)
    message = refused(text=WITH_GEOJSON, folder=tmp_path)
    assert message.startswith("area.geojson: ")
    assert words in message


def test_geojson_that_is_not_there(tmp_path):
    assert "cannot read the file as GeoJSON" in refused(text=WITH_GEOJSON, folder=tmp_path)


def test_a_broken_geojson_is_named_beside_other_mistakes(tmp_path):
    message = refused(("seed = 7", "sed = 7"), text=WITH_GEOJSON, folder=tmp_path)
    assert "planner.sed: unknown key (did you mean seed?); area.geojson: " in message

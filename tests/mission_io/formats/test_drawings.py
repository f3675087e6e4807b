"""Areas, lines and places out of KML, GeoJSON, ``.poly`` and ``.fen``; GeoJSON as shapely writes it."""

import csv as stdlib_csv
import io
import json
import math
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
import shapely
from shapely.geometry import mapping

from mission_io.errors import FormatError
from mission_io.formats.csv_tables import write_csv
from mission_io.formats.drawings import (
    Drawing,
    DrawnArea,
    DrawnLine,
    Spot,
    read_area_list,
    read_fence_list,
    read_geojson,
    write_geojson,
)
from mission_io.formats.map_xml import read_kml_drawing, write_kml
from mission_io.model.items import Frame, LatLon, Mission, waypoint
from tests.mission_io.formats.samples import HOME, MISSION, NAN_YAW

RING = (LatLon(33.1, -98.2), LatLon(33.3, -98.25), LatLon(33.35, -98.05), LatLon(33.12, -98.04))
HOLE = (LatLon(33.2, -98.15), LatLon(33.21, -98.15), LatLon(33.21, -98.14))
AREA = DrawnArea(RING, (HOLE,), "field <1>")


def pairs(ring: tuple[LatLon, ...]) -> str:
    return " ".join(f"{p.lon_deg},{p.lat_deg},0" for p in (*ring, ring[0]))


def kml_of(body: str, head: str = '<kml xmlns="http://www.opengis.net/kml/2.2">') -> str:
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{head}<Document><name>all</name>{body}</Document></kml>'


POLYGON = (
    "<Placemark><name>field &lt;1></name><Polygon><outerBoundaryIs><LinearRing><coordinates>"
    f"{pairs(RING)}</coordinates></LinearRing></outerBoundaryIs><innerBoundaryIs><LinearRing><coordinates>\n{pairs(HOLE)}\n"
    "</coordinates></LinearRing></innerBoundaryIs></Polygon></Placemark>"
)
REST = (
    "<Placemark><name>way</name><LineString><coordinates>-98.2,33.1 -98.25,33.3,77</coordinates></LineString></Placemark>"
    "<Placemark><Point><coordinates>-98.2,33.1</coordinates></Point></Placemark>"
)
WHOLE = Drawing((AREA,), (DrawnLine(RING[:2], "way"),), (Spot(RING[0]),))


@pytest.mark.parametrize(
    "head",
    ['<kml xmlns="http://www.opengis.net/kml/2.2">', '<kml xmlns="http://earth.google.com/kml/2.0">', "<kml>",
     '<k:kml xmlns:k="http://www.opengis.net/kml/2.2" xmlns="http://www.opengis.net/kml/2.2">'],
)  # fmt: skip
def test_kml_of_any_version_is_read(head: str) -> None:
    text = kml_of(POLYGON + REST, head)
    assert read_kml_drawing(text.replace("</kml>", "</k:kml>") if head.startswith("<k:") else text) == WHOLE


def test_kml_multigeometries_folders_and_bare_rings() -> None:
    ring = f"<LinearRing><coordinates>{pairs(HOLE)}</coordinates></LinearRing>"
    text = kml_of(
        f"<Folder><name>f</name><Placemark><name>m</name><MultiGeometry>{ring}{ring}</MultiGeometry></Placemark></Folder>"
    )
    assert read_kml_drawing(text).areas == (DrawnArea(HOLE, (), "m", "f"),) * 2


LINE = "<Placemark><name>way</name><LineString><coordinates>{}</coordinates></LineString></Placemark>"


@pytest.mark.parametrize(
    ("coordinates", "repair"),
    [
        ("-98.2, 33.1, 5 -98.25 ,33.3,\n6 -98.05,33.35", "removed space around commas"),
        ("-98.2,33.1,\n-98.25,33.3,\n-98.05,33.35,\n", "removed commas between positions"),
        ("-98.2,33.1, -98.25,33.3, -98.05,33.35", "removed commas between positions"),
        ("-98.2,33.1,5,1700000000 -98.25,33.3,6,1700000001 -98.05,33.35", "ignored a fourth number"),
        ("-98.2,33.1\u00a0-98.25,33.3\t\r\n-98.05,33.35", None),
    ],
)
def test_kml_coordinates_with_four_numbers_or_odd_spaces(coordinates: str, repair: str | None) -> None:
    found = read_kml_drawing(kml_of(LINE.format(coordinates)))
    assert found.lines == (DrawnLine(RING[:3], "way"),)
    assert [line.split(": ")[1] for line in found.repairs if "LF" not in line] == ([repair] if repair else [])


@pytest.mark.parametrize("coordinates", ["1,2,3,4,5", "1,2, 3,4, x", "1, 2, 3, 4 5", "1,2,3,4, 5,6", "1 2", ",2 1,2"])
def test_kml_coordinates_that_could_be_anything_are_an_error(coordinates: str) -> None:
    with pytest.raises(FormatError, match="line 2, coordinate"):
        read_kml_drawing(kml_of(LINE.format(coordinates)))


@pytest.mark.parametrize("coordinates", ["", " \n", ",", ", ,"])
def test_kml_coordinates_that_say_nothing_are_left_out(coordinates: str) -> None:
    found = read_kml_drawing(kml_of(LINE.format(coordinates) + REST))
    assert (found.lines, found.spots) == (WHOLE.lines, WHOLE.spots)
    assert [line.split(": ")[1] for line in found.repairs] == ["ignored an empty LineString"]


def test_kml_names_may_follow_what_they_name() -> None:
    swapped = [
        text.replace(f"<name>{name}</name>", "").replace("</Placemark>", f"<name>{name}</name></Placemark>", 1)
        for text, name in ((POLYGON, "field &lt;1>"), (REST, "way"))
    ]
    assert read_kml_drawing(kml_of("".join(swapped))) == WHOLE
    folder = f"<Folder><Folder>{POLYGON}<name>inner</name></Folder>{POLYGON}<name>outer</name></Folder>{POLYGON}"
    assert [area.folder for area in read_kml_drawing(kml_of(folder)).areas] == ["inner", "outer", ""]


def geo(*geometries: dict[str, Any], name: str = "") -> str:
    features = [{"type": "Feature", "geometry": g, "properties": {"name": name}} for g in geometries]
    return json.dumps({"type": "FeatureCollection", "features": features})


SHAPE = shapely.Polygon([(p.lon_deg, p.lat_deg) for p in RING], [[(p.lon_deg, p.lat_deg) for p in HOLE]])


def test_geojson_as_shapely_writes_it() -> None:
    line, point = shapely.LineString([(-98.2, 33.1), (-98.25, 33.3)]), shapely.Point(-98.2, 33.1, 50.0)
    assert read_geojson(geo(mapping(SHAPE), name="field <1>")).areas == (AREA,)
    two = shapely.MultiPolygon([SHAPE, shapely.Polygon([(1, 2), (3, 2), (3, 4)])])
    both = read_geojson(json.dumps(mapping(two)))
    assert [len(area.holes) for area in both.areas] == [1, 0]
    assert both.areas[1].exterior == (LatLon(2.0, 1.0), LatLon(2.0, 3.0), LatLon(4.0, 3.0))
    collection = shapely.GeometryCollection(
        [line, point, shapely.MultiLineString([line, line]), shapely.MultiPoint([point])]
    )
    read = read_geojson(json.dumps(mapping(collection)))
    assert read.lines == (DrawnLine(RING[:2]),) * 3
    assert read.spots == (Spot(RING[0]),) * 2


def test_what_is_repaired_or_left_out_is_listed() -> None:
    open_kml = kml_of(POLYGON.replace(f" {RING[0].lon_deg},{RING[0].lat_deg},0<", "<")).replace("-98.25,", "-98.25 , ")
    assert read_kml_drawing(open_kml).areas == (AREA,)
    assert read_kml_drawing(open_kml).repairs == (
        "line 2: removed space around commas",
        "line 2: the ring was not closed",
    )
    assert read_kml_drawing(open_kml).unclosed == ("line 2: the ring was not closed",)
    empty = kml_of("<Placemark><Point></Point></Placemark>")
    assert read_kml_drawing("\ufeff" + empty).repairs == (
        "removed a byte order mark",
        "line 2: ignored an empty Point",
    )
    assert read_geojson(geo(None, {"type": "Polygon", "coordinates": []})).repairs == (  # type: ignore[arg-type]
        "document.features[0]: ignored a feature without a geometry",
        "document.features[1].geometry.coordinates: ignored an empty polygon",
    )


BOMB = '<!DOCTYPE kml [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'


@pytest.mark.parametrize(
    ("read", "text", "what"),
    [
        (read_kml_drawing, "", "line 1: invalid XML: no element found"),
        (read_kml_drawing, kml_of(POLYGON)[:-9], "invalid XML"),
        (read_kml_drawing, "<html></html>", "line 1: <html> is not the root element of a KML file"),
        (read_kml_drawing, f"{BOMB}<kml><name>&b;</name></kml>", "document types are not supported; remove"),
        (read_kml_drawing, "<!DOCTYPE kml SYSTEM 'file:///etc/passwd'><kml/>", "document types"),
        (read_kml_drawing, "<kml>&undefined;</kml>", "invalid XML: undefined entity"),
        (read_kml_drawing, "<kml>\ud800</kml>", "an incomplete character"),
        (read_kml_drawing, kml_of("<Point><coordinates>1</coordinates></Point>"), "coordinate 0: '1' is not longitude,latitude"),
        (read_kml_drawing, kml_of("<Point><coordinates>1,nan</coordinates></Point>"), "'nan' is not a finite number"),
        (read_kml_drawing, kml_of("<Point><coordinates>33,-98</coordinates></Point>"), "latitude -98 is not a valid position"),
        (read_kml_drawing, kml_of("<Polygon></Polygon>"), "the polygon has no outer boundary"),
        (read_kml_drawing, kml_of(POLYGON.replace("inner", "outer")), "a second outer boundary"),
        (read_kml_drawing, kml_of("<LinearRing><coordinates>1,2 3,4 1,2</coordinates></LinearRing>"), "only 2 different corners"),
        (read_geojson, "", "line 1: cannot read the file as JSON"),
        (read_geojson, "[" * 200_000, "document: the JSON is nested too deeply"),
        (read_geojson, "{}", r"document\.type: the key is missing"),
        (read_geojson, '{"type": 5}', r"document\.type: expected a string"),
        (read_geojson, '{"type": "Circle"}', "'Circle' is not a GeoJSON type"),
        (read_geojson, '{"type": "Point", "coordinates": [33, -98]}', "longitude 33, latitude -98 is no"),
        (read_geojson, '{"type": "Point", "coordinates": [1e999, 0]}', "a number that is too large"),
        (read_geojson, '{"type": "Point", "coordinates": [null, true]}', "expected a number"),
        (read_geojson, '{"type": "Point", "coordinates": [5]}', "the position has 1 numbers"),
        (read_geojson, '{"type": "Polygon", "coordinates": [[[1, 2], [3, 4], [1, 2]]]}', "only 2 different corners"),
        (read_geojson, '{"type": "Point", "coordinates": [1, 2], "crs": {"type": "name", "properties":'
         ' {"name": "urn:ogc:def:crs:EPSG::3857"}}}', "the reference system is 'urn:ogc:def:crs:EPSG::3857'; export"),
        (read_area_list, "33.1 -98.2\n33.2 -98.2\n", "the area: only 2 different corners"),
        (read_area_list, "33.1 -98.2 5\n", "line 1: expected 2 columns, not 3; latitude, then longitude"),
        (read_area_list, "-98.2 33.1\n", "is not a valid position; write latitude first"),
        (read_area_list, "x y\n", "line 1: 'x' is not a finite number"),
        (read_fence_list, "# nothing\n", "the file contains no positions; begin with the return point"),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_one_error_with_its_place(read: Callable[[str], Any], text: str, what: str) -> None:
    with pytest.raises(FormatError, match=what):
        read(text)


def test_the_old_wgs84_name_of_geojson_is_taken() -> None:
    point = {"type": "Point", "coordinates": [-98.2, 33.1]}
    for name in ("urn:ogc:def:crs:OGC:1.3:CRS84", "EPSG:4326"):
        text = json.dumps({**point, "crs": {"type": "name", "properties": {"name": name}}})
        assert read_geojson(text).spots == (Spot(RING[0]),)


def test_a_name_that_xml_cannot_hold_is_refused() -> None:
    from tests.mission_io.formats.samples import MISSION

    with pytest.raises(FormatError, match=r"the name contains '\\x07'"):
        write_kml(MISSION, name="a\x07")


def test_poly_files_of_mission_planner_are_read() -> None:
    theirs = "\ufeff#saved by Mission Planner 1.3.80\r\n33.1 -98.2\r\n33.3, -98.25\r\n33.35\t-98.05\r\n33.12 -98.04\r\n"
    read = read_area_list(theirs)
    assert read.areas == (DrawnArea(RING),)
    assert read.repairs == (
        "removed a byte order mark", "changed the line ends to LF", "line 3: changed the separators to spaces",
        "the area: the ring was not closed",
    )  # fmt: skip


KML = "{http://www.opengis.net/kml/2.2}"


def test_kml_is_longitude_latitude_height_above_sea() -> None:
    root = ET.fromstring(write_kml(MISSION, name="a < b"))
    line, *points = [node.text or "" for node in root.iter(f"{KML}coordinates")]
    assert line.split()[1] == "-98.12400010,33.21912340,405.928"
    assert line.split()[2].endswith(",470.5")
    assert len(points) == 5
    names = [node.text for node in root.iter(f"{KML}name")]
    assert names[:3] == ["a < b", "route", "1"]


def test_geojson_is_longitude_latitude_height_above_sea() -> None:
    document = json.loads(write_geojson(MISSION, name="demo"))
    line, *points = document["features"]
    assert line["geometry"]["coordinates"][2] == [-98.1250002, 33.2201234, 470.5]
    assert line["properties"] == {"name": "demo", "height_datum": "AMSL"}
    assert points[1]["properties"] == {
        "item": 4, "command": 16, "frame": "ABOVE_HOME", "alt_m": 60.25, "height_datum": "AMSL",
    }  # fmt: skip


def test_csv_has_every_item_unrounded_with_units_in_the_header() -> None:
    rows = list(stdlib_csv.DictReader(io.StringIO(write_csv(MISSION))))
    assert len(rows) == 9
    assert (float(rows[0]["alt_m"]), rows[0]["alt_datum"]) == (345.678, "AMSL")
    assert [row["command"] for row in rows] == ["16", "22", "178", "206", "16", "16", "16", "21", "20"]
    assert (float(rows[4]["lat_deg"]), float(rows[4]["lon_deg"])) == (33.2191234, -98.1240001)
    assert rows[4]["alt_datum"] == "ABOVE_HOME"
    without_home = write_csv(Mission(None, (NAN_YAW,))).splitlines()
    assert without_home[1] == "1,16,0,0.0,0.0,0.0,,33.2,-98.1,400.0,AMSL,1"


@pytest.mark.parametrize("write", [write_kml, write_geojson])
def test_heights_that_cannot_be_known_are_refused(write: Callable[[Mission], str]) -> None:
    with pytest.raises(FormatError, match="item 1: its height is above home"):
        write(replace(MISSION, home=None))
    with pytest.raises(FormatError, match="item 1: its height is above the terrain"):
        write(Mission(HOME, (waypoint(33.0, -98.0, 50.0, frame=Frame.ABOVE_TERRAIN),)))
    with pytest.raises(FormatError, match="item 1"):
        write(Mission(HOME, (replace(NAN_YAW, lat_deg=math.nan),)))


def test_one_point_makes_no_line() -> None:
    one = Mission(HOME, MISSION.items[:1])
    assert "LineString" not in write_kml(one)
    assert "LineString" not in write_geojson(one)

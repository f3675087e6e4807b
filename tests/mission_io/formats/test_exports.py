import csv as stdlib_csv
import io
import json
import math
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import replace

import pytest

from mission_io.errors import FormatError
from mission_io.formats.csv_tables import write_csv
from mission_io.formats.drawings import write_geojson
from mission_io.formats.map_xml import write_kml
from mission_io.model.items import Frame, Mission, waypoint
from tests.mission_io.formats.samples import HOME, MISSION, NAN_YAW

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

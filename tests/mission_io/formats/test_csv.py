import csv as stdlib_csv
import io
import json
import math
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import replace

import pytest
from hypothesis import given, settings

from mission_io.errors import FormatError
from mission_io.formats import csv, geojson, kml
from mission_io.model.items import Frame, Mission, waypoint
from tests.mission_io.formats.samples import HOME, MISSION, MISSIONS, NAN_YAW

#

KML = "{http://www.opengis.net/kml/2.2}"


def test_kml_is_longitude_latitude_height_above_sea() -> None:
    root = ET.fromstring(kml.write_mission(MISSION, name="a < b"))
    line, *points = [node.text or "" for node in root.iter(f"{KML}coordinates")]
    assert line.split()[1] == "-98.12400010,33.21912340,405.928"
    assert line.split()[2].endswith(",470.5")
    assert len(points) == 5
    names = [node.text for node in root.iter(f"{KML}name")]
    assert names[:3] == ["a < b", "route", "1"]


def test_geojson_is_longitude_latitude_height_above_sea() -> None:
    document = json.loads(geojson.write_mission(MISSION, name="demo"))
    line, *points = document["features"]
    assert line["geometry"]["coordinates"][2] == [-98.1250002, 33.2201234, 470.5]
    assert line["properties"] == {"name": "demo", "height_datum": "AMSL"}
    assert points[1]["properties"] == {
        "item": 4, "command": 16, "frame": "ABOVE_HOME", "alt_m": 60.25, "height_datum": "AMSL",
    }  # fmt: skip


def test_csv_has_every_item_unrounded_with_units_in_the_header() -> None:
    rows = list(stdlib_csv.DictReader(io.StringIO(csv.write_mission(MISSION))))
    assert len(rows) == 9
    assert (float(rows[0]["alt_m"]), rows[0]["alt_datum"]) == (345.678, "AMSL")
    assert [row["command"] for row in rows] == ["16", "22", "178", "206", "16", "16", "16", "21", "20"]
    assert (float(rows[4]["lat_deg"]), float(rows[4]["lon_deg"])) == (33.2191234, -98.1240001)
    assert rows[4]["alt_datum"] == "ABOVE_HOME"
    without_home = csv.write_mission(Mission(None, (NAN_YAW,))).splitlines()
    assert without_home[1] == "1,16,0,0.0,0.0,0.0,,33.2,-98.1,400.0,AMSL,1"


@pytest.mark.parametrize("write", [kml.write_mission, geojson.write_mission])
def test_heights_that_cannot_be_known_are_refused(write: Callable[[Mission], str]) -> None:
    with pytest.raises(FormatError, match="item 1: its height is above home"):
        write(replace(MISSION, home=None))
    with pytest.raises(FormatError, match="item 1: its height is above the terrain"):
        write(Mission(HOME, (waypoint(33.0, -98.0, 50.0, frame=Frame.ABOVE_TERRAIN),)))
    with pytest.raises(FormatError, match="item 1"):
        write(Mission(HOME, (replace(NAN_YAW, lat_deg=math.nan),)))


def test_one_point_makes_no_line() -> None:
    one = Mission(HOME, MISSION.items[:1])
    assert "LineString" not in kml.write_mission(one)
    assert "LineString" not in geojson.write_mission(one)


TEXT = csv.write_mission(MISSION)


@settings(derandomize=True, max_examples=150)
@given(MISSIONS)
def test_round_trip(mission: Mission) -> None:
    assert csv.read_mission(csv.write_mission(mission)) == csv.CsvFile(mission, ())
    without_home = replace(mission, home=None)
    assert csv.read_mission(csv.write_mission(without_home)).mission == without_home


def test_no_value_is_an_empty_cell() -> None:
    read = csv.read_mission(csv.write_mission(Mission(None, (NAN_YAW,)))).mission
    assert math.isnan(read.items[0].params[3])


def test_what_a_spreadsheet_does_to_it_is_repaired_and_listed() -> None:
    rows = [line.split(",") for line in TEXT.splitlines()]
    shuffled = "\r\n".join(",".join(['"a, b"', *row[::-1]]) for row in rows).replace('"a, b"', "note", 1) + "\r\n\r\n"
    read = csv.read_mission("\ufeff" + shuffled.replace(",8\r\n", ",18\r\n"))
    assert read.mission == MISSION
    assert read.repairs == (
        "removed a byte order mark", "changed the line ends to LF", "line 1: left out 1 columns, the first is 'note'",
        "line 10: renumbered from 18 to 8",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("", "line 1: 0 columns item, there must be 1"),
        (TEXT.replace("lat_deg", "latitude"), "line 1: 0 columns lat_deg"),
        (TEXT.replace("ABOVE_HOME", "AGL", 1), "line 3, alt_datum: 'AGL' is not a datum; use AMSL, COMMAND"),
        (TEXT.replace(",AMSL,", ",ABOVE_HOME,", 1), "line 2: frame 0 is not ABOVE_HOME; use 3"),
        (TEXT.replace("\n1,22,", "\n1,99999,"), "line 3: command 99999"),
        (TEXT.replace("\n1,22,", "\n1.5,22,"), "line 3, item: '1.5' is not a whole number"),
        (TEXT.replace("12.5", "fast"), "line 4, param2: 'fast' is not a finite number"),
        (TEXT.replace("33.21875,-98.1234567", "-98.1234567,33.21875", 1), "latitude comes first"),
        (TEXT[:-2] + "7\n", "line 10, autocontinue: '7' is not 0 or 1"),
        (TEXT + "9,16\n", "line 11: 2 columns, the header has 12"),
        (TEXT + '9,"16', "line 11: no CSV"),
        (TEXT + "x" * 200_000, "line 11: no CSV: field larger"),
    ],
)
def test_what_cannot_be_read_is_one_error_with_its_line(text: str, what: str) -> None:
    with pytest.raises(FormatError, match=what):
        csv.read_mission(text)

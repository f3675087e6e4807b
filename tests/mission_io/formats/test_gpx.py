"""GPX 1.1, read by code that shares nothing with the writer and held against the rules of the published schema."""

import math
import xml.etree.ElementTree as ET
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mission_io.errors import FormatError
from mission_io.formats.map_xml import write_gpx
from mission_io.model.items import Frame, GeoPoint, Mission, land, takeoff, waypoint
from tests.mission_io.formats.samples import HOME, LATITUDES, LONGITUDES, MISSION

SPACE = "{http://www.topografix.com/GPX/1/1}"
ORDER = {
    "gpx": ("metadata", "wpt", "rte", "trk", "extensions"),
    "metadata": ("name", "desc", "author", "copyright", "link", "time", "keywords", "bounds", "extensions"),
    "rte": ("name", "cmt", "desc", "src", "link", "number", "type", "extensions", "rtept"),
    "wpt": (
        "ele", "time", "magvar", "geoidheight", "name", "cmt", "desc", "src", "link", "sym", "type", "fix", "sat",
        "hdop", "vdop", "pdop", "ageofdgpsdata", "dgpsid", "extensions",
    ),
}  # fmt: skip
"""What each element may hold, in this order: gpxType, metadataType, rteType and wptType of the schema."""
MANY = {"wpt", "rte", "trk", "rtept", "link"}


def checked(text: str) -> ET.Element:
    """The root of a GPX document that keeps the schema's rules."""
    root = ET.fromstring(text.encode())
    assert root.tag == f"{SPACE}gpx"
    assert root.get("version") == "1.1"
    assert root.get("creator")
    for element in root.iter():
        kind = element.tag.removeprefix(SPACE).replace("rtept", "wpt")
        names = [child.tag.removeprefix(SPACE) for child in element]
        if kind not in ORDER:
            assert names == []
            continue
        positions = [ORDER[kind].index(name) for name in names]
        assert positions == sorted(positions)
        assert all(names.count(name) == 1 for name in names if name not in MANY)
        if kind == "wpt":
            assert -90.0 <= float(element.attrib["lat"]) <= 90.0
            assert -180.0 <= float(element.attrib["lon"]) < 180.0
            assert (
                "e" not in "".join((element.attrib["lat"], element.attrib["lon"], element[0].text or "")).lower()
            )  # xsd:decimal
    return root


POSITIONS = st.tuples(LATITUDES, LONGITUDES, st.floats(-400.0, 9000.0))


@pytest.mark.no_cover  # what takes long is the schema's library; the lines are reached by the other tests
@given(
    home=POSITIONS,
    positions=st.lists(POSITIONS, min_size=1, max_size=5),
    name=st.text(st.characters(codec="utf-8", min_codepoint=32)),
)
def test_every_mission_keeps_the_schema_and_reads_back(
    home: tuple[float, float, float], positions: list[tuple[float, float, float]], name: str
) -> None:
    name = name.replace("\ufffe", "").replace("\uffff", "")
    start = GeoPoint(*home)
    items = [takeoff(home[0], home[1], 30.0, frame=Frame.ABOVE_HOME)]
    items += [waypoint(lat, lon, alt - home[2], frame=Frame.ABOVE_HOME) for lat, lon, alt in positions]
    items.append(land(home[0], home[1], home[2], frame=Frame.AMSL))
    text = write_gpx(Mission(start, tuple(items)), name=name)
    root = checked(text)
    wanted = [(home[0], home[1], home[2] + 30.0), *positions, home]
    points = root.findall(f"{SPACE}rte/{SPACE}rtept")
    assert len(points) == len(wanted)
    for point, (lat, lon, alt) in zip(points, wanted, strict=True):
        assert float(point.attrib["lat"]) == pytest.approx(lat, abs=1e-8)
        away = abs(float(point.attrib["lon"]) - lon)
        assert min(away, 360.0 - away) <= 1e-8
        assert float(point.findtext(f"{SPACE}ele") or "") == pytest.approx(alt, abs=1e-6)
    assert root.findtext(f"{SPACE}rte/{SPACE}name", "") == name.replace("\r\n", "\n").replace("\r", "\n")


def test_gpxpy_reads_the_route_and_home() -> None:
    gpxpy = pytest.importorskip("gpxpy", reason="the extra dev has it")
    read = gpxpy.parse(write_gpx(MISSION, name='"a" < b & c'))
    assert read.name == '"a" < b & c'
    (home,) = read.waypoints
    assert (home.latitude, home.longitude, home.elevation) == (33.21875, -98.1234567, 345.678)
    (route,) = read.routes
    assert [point.name for point in route.points] == ["1", "4", "5", "6", "7"]
    assert [point.type for point in route.points] == ["take-off", "waypoint", "waypoint", "waypoint", "landing"]
    second = route.points[1]
    assert (second.latitude, second.longitude) == (33.2191234, -98.1240001)
    assert second.elevation == pytest.approx(345.678 + 60.25, abs=1e-9)
    assert route.points[2].elevation == 470.5


def test_the_180th_meridian_is_written_as_the_schema_wants_it() -> None:
    mission = Mission(GeoPoint(-16.5, 180.0, 5.0), (waypoint(-16.5, 179.999999999, 40.0, frame=Frame.AMSL),))
    root = checked(write_gpx(mission))
    assert [element.get("lon") for element in root.iter() if element.get("lon")] == ["-180.00000000", "-180.00000000"]


@pytest.mark.parametrize(
    ("mission", "name", "match"),
    [
        (replace(MISSION, home=None), "x", "item 1: its height is above home"),
        (Mission(HOME, (waypoint(33.0, -98.0, 50.0, frame=Frame.ABOVE_TERRAIN),)), "x", "item 1: its height is above"),
        (Mission(HOME, (waypoint(math.nan, -98.0, 50.0, frame=Frame.AMSL),)), "x", "item 1: latitude nan"),
        (Mission(HOME, (waypoint(33.0, -181.0, 50.0, frame=Frame.AMSL),)), "x", "item 1: latitude 33, longitude -181"),
        (Mission(HOME, (waypoint(33.0, -98.0, math.inf, frame=Frame.AMSL),)), "x", "item 1: inf"),
        (Mission(replace(HOME, lat_deg=91.0), ()), "x", "home: latitude 91"),
        (MISSION, "bell \x07", r"the name contains .*, which XML does not allow"),
        (MISSION, "half \ud800", r"the name contains .*, which XML does not allow"),
    ],
)
def test_what_it_cannot_hold_is_refused(mission: Mission, name: str, match: str) -> None:
    with pytest.raises(FormatError, match=match):
        write_gpx(mission, name=name)

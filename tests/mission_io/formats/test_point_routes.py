"""Routes of points: what other programs write is read, and so is what this package writes; the rest is refused with a reason."""

import contextlib
import io
import zipfile
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mission_io.errors import FormatError
from mission_io.formats import litchi, wpml
from mission_io.formats.litchi import write_csv
from mission_io.formats.map_xml import read_gpx_route, read_kml_route
from mission_io.formats.point_route import PointRoute
from mission_io.formats.wpml import write_kmz
from mission_io.model.items import Command, Frame
from tests.mission_io.formats.flights import random_flight
from tests.mission_io.formats.route_files import ROUTES
from uavcover.extras.exports.command import all_dji_aircraft

POINTS = [(46.5, 8.25, 40.0), (46.501, 8.252, 55.5), (46.499, 8.26, 61.0)]
READERS: dict[str, Callable[[str], PointRoute]] = {
    ".gpx": read_gpx_route, ".kml": read_kml_route, ".csv": litchi.read_route, ".wpml": wpml.read_route,
}  # fmt: skip


@pytest.mark.parametrize("suffix", READERS)
def test_what_others_write(suffix: str) -> None:
    route = READERS[suffix](ROUTES[suffix](POINTS, 1000.0))
    absolute = suffix in (".gpx", ".kml")
    items = [route.mission.items[number - 1] for number in route.numbers]
    expected = [(lat, lon, up + 1000.0 if absolute else up) for lat, lon, up in POINTS]
    assert [(one.lat_deg, one.lon_deg, one.alt_m) for one in items] == expected
    assert {one.frame for one in items} == {Frame.AMSL if absolute else Frame.ABOVE_HOME}
    first = route.mission.items[0]
    assert (first.command, first.alt_m) == (Command.NAV_TAKEOFF, expected[0][2])
    assert route.mission.home is None
    assert route.speed_m_s == (None if absolute else 7.5)
    assert route.return_height_m == (88.0 if suffix == ".wpml" else None)
    assert (route.mission.items[-1].command == Command.NAV_RETURN_TO_LAUNCH) == (suffix == ".wpml")


@pytest.mark.parametrize("seed", range(4))
def test_our_own_files_read_back(seed: int) -> None:
    flight = random_flight(seed)
    archive = zipfile.ZipFile(io.BytesIO(write_kmz(flight, all_dji_aircraft()["dji-m3e"], return_height_m=80.0)))
    texts = {".wpml": archive.read(wpml.DOCUMENT).decode()}
    with contextlib.suppress(FormatError):  # Litchi cannot do every one
        texts[".csv"] = write_csv(flight)
    for suffix, text in texts.items():
        route = READERS[suffix](text)
        items = [route.mission.items[number - 1] for number in route.numbers]
        assert [(one.lat_deg, one.lon_deg, one.alt_m) for one in items] == [
            (pytest.approx(p.lat_deg, abs=1e-8), pytest.approx(p.lon_deg, abs=1e-8), p.height_above_home_m)
            for p in flight.points
        ]


def test_speeds_that_differ_are_items() -> None:
    text = ROUTES[".csv"](POINTS, 1.0).replace(",0,7.5\n", ",0,4\n", 1)
    route = litchi.read_route(text)
    assert [one.params[1] for one in route.mission.items if one.command == Command.DO_CHANGE_SPEED] == [4.0, 7.5]
    assert route.numbers == (2, 5, 8), "a speed and a heading of its own behind the first two"
    assert "2 headings" in route.repairs[-1]


def test_the_climb_of_dji_is_no_lower_than_its_security_height() -> None:
    text = ROUTES[".wpml"](POINTS, 1.0).replace("<wpml:takeOffSecurityHeight>20<", "<wpml:takeOffSecurityHeight>90<")
    assert wpml.read_route(text).mission.items[0].alt_m == 90.0


def test_heights_above_ground() -> None:
    assert (
        read_kml_route(ROUTES[".kml"](POINTS, 0.0).replace("absolute", "relativeToGround")).mission.items[1].frame
        is Frame.ABOVE_TERRAIN
    )
    assert (
        litchi.read_route(ROUTES[".csv"](POINTS, 1.0).replace(",0,7.5", ",1,7.5")).mission.items[1].frame
        is Frame.ABOVE_TERRAIN
    )


def test_curves_are_told() -> None:
    text = ROUTES[".wpml"](POINTS, 1.0).replace(
        "</wpml:waypointSpeed>", "</wpml:waypointSpeed><wpml:useStraightLine>0</wpml:useStraightLine>"
    )
    assert "3 curved" in wpml.read_route(text).repairs[0]
    assert "corners" in litchi.read_route(ROUTES[".csv"](POINTS, 1.0).replace(",90,0,", ",90,5,")).repairs[0]


@pytest.mark.parametrize(
    ("suffix", "old", "new", "telling"),
    [
        (".gpx", "<ele>1040.0</ele>", "", "no height"),
        (".gpx", 'lat="46.5"', 'lat="146.5"', "146.5"),
        (".gpx", 'lat="46.5"', 'lat="x"', "number"),
        (".gpx", "gpx", "gpy", "gpy"),
        (".gpx", "</rte>", "</rte><rte/>", "2 routes"),
        (".gpx", '<?xml version="1.0"?>', '<!DOCTYPE a [<!ENTITY b "c">]>', "document type"),
        (".gpx", "</gpx>", "", "invalid XML"),
        (".gpx", "1040.0", "1e9", "1e+09"),
        (
            ".kml",
            "absolute",
            "clampToGround",
            "0 with heights",
        ),
        (".kml", ",1040.0", "", "heights"),
        (".kml", "8.25,46.5,1040.0", "8.25,nan,1040.0", "number"),
        (".csv", "altitude(m)", "altitude(ft)", "metric"),
        (".csv", "latitude,", "lat,", "header"),
        (".csv", "46.5,8.25", "north,8.25", "number"),
        (".csv", ",0,7.5", ",7,7.5", "altitude mode 7"),
        (".wpml", "relativeToStartPoint", "WGS84", "relativeToStartPoint"),
        (".wpml", "8.25,46.5<", "8.25<", "longitude and latitude"),
        (".wpml", "<wpml:executeHeight>40.0</wpml:executeHeight>", "", "number"),
        (".wpml", "missionConfig", "mission", "missionConfig"),
        (".wpml", "</Folder>", "</Folder><Folder/>", "2 waylines"),
    ],
)
def test_the_rest_is_refused_with_a_reason(suffix: str, old: str, new: str, telling: str) -> None:
    text = ROUTES[suffix](POINTS, 1000.0)
    assert old in text
    with pytest.raises(FormatError) as refused:
        READERS[suffix](text.replace(old, new))
    assert telling in str(refused.value)


@pytest.mark.parametrize("suffix", READERS)
@given(data=st.data())
def test_damaged_files_end_in_an_error_of_the_package(suffix: str, data: st.DataObject) -> None:
    text = ROUTES[suffix](POINTS, 1000.0)
    at = data.draw(st.integers(0, len(text)))
    cut = data.draw(st.integers(0, 40))
    text = text[:at] + data.draw(st.text(max_size=8)) + text[at + cut :]
    with contextlib.suppress(FormatError):
        READERS[suffix](text)


def _held(route: PointRoute) -> list[tuple[float | None, int, float | None]]:
    """Pitch, pictures and distance between pictures at each point, from the items alone."""
    found: list[tuple[float | None, int, float | None]] = []
    pitch, distance, pictures = None, None, 0
    for number, item in enumerate(route.mission.items, 1):
        if number in route.numbers:
            if number > route.numbers[0]:
                found.append((pitch, pictures, distance))
            pictures = 0
        elif item.command == Command.DO_GIMBAL_MANAGER_PITCHYAW:
            pitch = item.params[0]
        elif item.command == Command.DO_SET_CAM_TRIGG_DIST:
            assert item.params[2] == 0.0, "the first picture is one of its own"
            distance = item.params[0] or None
        elif item.command == Command.IMAGE_START_CAPTURE:
            pictures += 1
    return [*found, (pitch, pictures, distance)]


@pytest.mark.parametrize("seed", range(6))
def test_what_the_camera_does_reads_back(seed: int) -> None:
    flight = random_flight(seed)
    archive = zipfile.ZipFile(io.BytesIO(write_kmz(flight, all_dji_aircraft()["dji-m3e"], return_height_m=80.0)))
    texts = {".wpml": archive.read(wpml.DOCUMENT).decode()}
    with contextlib.suppress(FormatError):
        texts[".csv"] = write_csv(flight)
    expected, before = [], None
    for point in flight.points:
        begins = point.picture_distance_m is not None and point.picture_distance_m != before
        before = point.picture_distance_m
        expected.append((point.pitch_deg, point.pictures + begins, before))
    for suffix, text in texts.items():
        told = _held(READERS[suffix](text))
        if suffix == ".wpml":  # its last point has no leg after it
            told, wanted = told[:-1], expected[:-1]
        else:
            wanted = expected
        assert [row[1:] for row in told] == [
            (count, None if every is None else pytest.approx(every, abs=1e-3)) for _, count, every in wanted
        ]
        assert [row[0] for row in told if row[0] is not None] == [
            pytest.approx(pitch) for (pitch, *_), row in zip(wanted, told, strict=True) if row[0] is not None
        ]


def test_actions_of_litchi() -> None:
    lines = ROUTES[".csv"](POINTS, 1.0).splitlines()
    lines[0] += ",photo_timeinterval,photo_distinterval"
    lines[1] = lines[1].replace(",-1,0" * 15, ",0,2500,5,-45,1,0,4,30" + ",-1,0" * 11) + ",2,-1"
    lines[2], lines[3] = f"{lines[2]},-1,-1", f"{lines[3]},-1,-1"
    items = litchi.read_route("\n".join(lines)).mission.items
    assert [(int(one.command), *one.params[:3]) for one in items[2:8]] == [
        (93, 2.5, -1.0, -1.0), (1000, -45.0, pytest.approx(float("nan"), nan_ok=True), pytest.approx(float("nan"), nan_ok=True)),
        (115, 30.0, 0.0, 0.0), (2000, 0.0, 0.0, 1.0), (2000, 0.0, 2.0, 0.0), (16, 0.0, 0.0, 0.0),
    ]  # fmt: skip
    assert [one.command for one in items[8:10]] == [Command.CONDITION_YAW, Command.IMAGE_STOP_CAPTURE]

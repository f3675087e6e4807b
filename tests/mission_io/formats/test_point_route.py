"""Missions as points: what holds from each of them on, and every item that points cannot express is refused by its number."""

import contextlib
import io
import math
import zipfile
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mission_io.errors import FormatError
from mission_io.formats import csv_tables, wpml
from mission_io.formats.csv_tables import write_litchi
from mission_io.formats.map_xml import read_gpx_route, read_kml_route
from mission_io.formats.point_route import PointRoute, camera_flight
from mission_io.formats.wpml import write_kmz
from mission_io.model.actions import PointGimbal, PointMount, StartPictures, TakePicture, item_of
from mission_io.model.items import (
    Command,
    Frame,
    GeoPoint,
    Mission,
    MissionItem,
    SpeedType,
    change_speed,
    delay,
    land,
    look_at,
    return_to_launch,
    takeoff,
    trigger_camera_every,
    waypoint,
)
from tests.mission_io.formats.flights import random_flight
from tests.mission_io.formats.route_files import ROUTES
from tests.mission_io.formats.wpml_tables import check_kmz
from uavcover.extras.exports.command import DJI_AIRCRAFT

M3E = DJI_AIRCRAFT.named("dji-m3e")
HOME = GeoPoint(47.25, -8.5, 512.25)


def at(north_m: float, height_m: float = 60.0) -> MissionItem:
    return waypoint(HOME.lat_deg + north_m / 111_000.0, HOME.lon_deg, height_m, frame=Frame.ABOVE_HOME)


UP = takeoff(HOME.lat_deg, HOME.lon_deg, 40.0, frame=Frame.ABOVE_HOME)
OVER_HOME = waypoint(HOME.lat_deg, HOME.lon_deg, 40.0, frame=Frame.ABOVE_HOME)
DOWN = land(HOME.lat_deg, HOME.lon_deg, frame=Frame.ABOVE_HOME)


def flown(*items: MissionItem) -> Mission:
    return Mission(HOME, (UP, change_speed(8.0), *items, OVER_HOME, DOWN))


def test_what_is_set_holds_from_the_point_before_it_on() -> None:
    mission = flown(
        at(100), item_of(PointMount(-60.0)), at(200), trigger_camera_every(12.5), at(300), change_speed(5.0), at(400),
        trigger_camera_every(0.0), at(500),
    )  # fmt: skip
    points = camera_flight(mission).points
    assert [p.height_above_home_m for p in points] == [40.0, 60.0, 60.0, 60.0, 60.0, 60.0, 40.0]
    assert [p.pitch_deg for p in points] == [None, -60.0, -60.0, -60.0, -60.0, -60.0, -60.0]
    assert [p.photo_distance_m for p in points] == [None, None, 12.5, 12.5, None, None, None]
    assert [p.speed_m_s for p in points] == [8.0, 8.0, 8.0, 5.0, 5.0, 5.0, 5.0]
    assert [p.photos for p in points] == [0] * 7


def test_a_waypoint_that_stands_twice_is_one_point() -> None:
    points = camera_flight(
        flown(at(100), trigger_camera_every(20.0), at(100), at(300), trigger_camera_every(0.0))
    ).points
    assert len(points) == 4
    assert [p.photo_distance_m for p in points] == [None, 20.0, None, None]


@pytest.mark.parametrize("photo", [TakePicture(), StartPictures(count=1, first_number=3)])
def test_pictures_at_waypoints(photo: Any) -> None:
    points = camera_flight(flown(at(100), item_of(photo), at(200), item_of(photo), item_of(photo))).points
    assert [p.photos for p in points] == [0, 1, 2, 0]


def test_headings_of_waypoints_hold_there_and_that_of_a_gimbal_until_it_is_changed() -> None:
    north = replace(at(100), params=(0.0, 0.0, 0.0, 350.0))
    free = replace(at(200), params=(0.0, 0.0, 0.0, math.nan))
    over = replace(OVER_HOME, params=(0.0, 0.0, 0.0, math.nan))
    mission = Mission(HOME, (UP, change_speed(8.0), north, free, over, DOWN))
    assert [p.heading_deg for p in camera_flight(mission).points] == [None, 350.0, None, None]
    locked = item_of(PointGimbal(-80.0, -90.0, 0.0, 0.0, flags=16))
    mission = Mission(HOME, (UP, change_speed(8.0), locked, free, over, DOWN))
    assert [(p.heading_deg, p.pitch_deg) for p in camera_flight(mission).points] == [(270.0, -80.0)] * 3


def test_a_fixed_camera_keeps_the_angle_that_it_is_given() -> None:
    assert {p.pitch_deg for p in camera_flight(flown(at(100)), pitch_deg=-45.0).points} == {-45.0}


def test_heights_above_the_sea_become_heights_above_home() -> None:
    point = waypoint(HOME.lat_deg + 0.001, HOME.lon_deg, 500.25, frame=Frame.AMSL)
    assert camera_flight(flown(point)).points[1].height_above_home_m == -12.0


KNOWN = {
    int(command)
    for command in (
        Command.NAV_WAYPOINT, Command.NAV_LAND, Command.NAV_TAKEOFF, Command.DO_CHANGE_SPEED, Command.DO_MOUNT_CONTROL,
        Command.DO_GIMBAL_MANAGER_PITCHYAW, Command.DO_SET_CAM_TRIGG_DIST, Command.DO_DIGICAM_CONTROL,
        Command.IMAGE_START_CAPTURE,
    )
}  # fmt: skip


@pytest.mark.parametrize(
    "command", sorted({*(int(command) for command in Command), 0, 30, 181, 184, 206, 530, 65535} - KNOWN)
)
def test_every_other_command_is_refused_by_its_number(command: int) -> None:
    for frame in (Frame.COMMAND, Frame.ABOVE_HOME):
        item = MissionItem(command, frame, (1.0, 0.0, 0.0, 0.0), HOME.lat_deg, HOME.lon_deg, 50.0)
        with pytest.raises(FormatError, match=rf"^item 4: .*command {command}\b"):
            camera_flight(flown(at(100), item))


def change(item: MissionItem, number: int, value: float) -> MissionItem:
    p1, p2, p3, p4 = (value if k == number else kept for k, kept in enumerate(item.params, start=1))
    return replace(item, params=(p1, p2, p3, p4))


@pytest.mark.parametrize(
    ("items", "match"),
    [
        ((change(at(100), 1, 3.0),), "item 3: a waypoint with a hold time or a radius cannot be converted"),
        ((change(at(100), 2, 3.0),), "item 3: a waypoint with a hold time or a radius"),
        ((change(at(100), 3, -3.0),), "item 3: a waypoint with"),
        ((change(at(100), 4, math.inf),), "item 3: the heading"),
        ((replace(at(100), autocontinue=False),), "item 3: this item waits for the pilot"),
        ((replace(at(100), frame=Frame.ABOVE_TERRAIN),), "item 3: its height is above the terrain"),
        ((replace(at(100), alt_m=math.nan),), "item 3: its height is not a finite number"),
        ((replace(at(100), lat_deg=91.0),), "item 3: latitude 91"),
        ((replace(at(100), lon_deg=math.nan),), "item 3: latitude 47.*longitude nan"),
        ((change_speed(5.0, kind=SpeedType.CLIMB),), "item 3: only changes of the ground speed can be converted"),
        ((change_speed(math.nan),), "item 3: only changes of the ground speed can be converted"),
        ((change_speed(0.0),), "item 3: only changes of the ground speed can be converted"),
        ((item_of(PointMount(-90.0, yaw_deg=20.0)),), "item 3: the camera is yawed"),
        ((item_of(PointMount(math.nan)),), "item 3: the camera angle"),
        ((item_of(PointGimbal(-90.0, 20.0)),), "item 3: the camera is yawed"),
        ((item_of(PointGimbal(-90.0, flags=2)),), "item 3: the camera is yawed"),
        ((item_of(PointGimbal(-90.0, 0.0, 5.0)),), "item 3: a gimbal that moves at a rate, or a second gimbal"),
        ((item_of(PointGimbal(-90.0, gimbal=2)),), "item 3: a gimbal that moves at a rate, or a second"),
        ((change(trigger_camera_every(5.0), 3, 0.0),), "item 3: the distance-based trigger does not start immediately"),
        ((change(trigger_camera_every(5.0), 1, -1.0),), "item 3: the distance"),
        ((item_of(TakePicture(photos=2)),), "item 3: only single photos can be converted"),
        ((item_of(TakePicture(zoom=2.0)),), "item 3: only single photos can be converted"),
        ((item_of(StartPictures(interval_s=2.0)),), "item 3: only single photos can be converted"),
        ((look_at(47.0, -8.0, 0.0, frame=Frame.AMSL),), "item 3: LookAt"),
        ((delay(3.0),), "item 3: Delay"),
        ((return_to_launch(),), "item 3: ReturnToLaunch"),
        ((UP,), "item 3: this take-off comes in flight"),
        ((at(100), DOWN), "item 4: the landing is more than 1 m from the point before it"),
    ],
)
def test_what_points_cannot_express_is_refused(items: tuple[MissionItem, ...], match: str) -> None:
    with pytest.raises(FormatError, match=match) as caught:
        camera_flight(flown(*items))
    assert "\n" not in str(caught.value)


ANY_NUMBER = (
    st.sampled_from([0.0, -0.0, 1.0, -1.0, 16.0, 90.0, 1e-320, 1e30, math.nan, math.inf, -math.inf]) | st.floats()
)
MEDDLED = st.builds(
    MissionItem,
    command=st.sampled_from(sorted(KNOWN)),
    frame=st.sampled_from(Frame),
    params=st.tuples(ANY_NUMBER, ANY_NUMBER, ANY_NUMBER, ANY_NUMBER),
    lat_deg=ANY_NUMBER | st.just(HOME.lat_deg),
    lon_deg=ANY_NUMBER | st.just(HOME.lon_deg),
    alt_m=ANY_NUMBER,
    autocontinue=st.booleans(),
)


@given(
    items=st.lists(
        MEDDLED | st.sampled_from([at(100), at(300), change_speed(5.0), trigger_camera_every(9.0)]), max_size=5
    ),
    position=st.integers(0, 6),
)
def test_whatever_is_in_a_mission_it_is_points_or_one_error(items: list[MissionItem], position: int) -> None:
    """And what becomes of it can be written, or is refused in the same way."""
    honest = list(flown(at(100)).items)
    mission = Mission(HOME, (*honest[:position], *items, *honest[position:]))
    refused = ""
    try:
        flight = camera_flight(mission)
        for point in flight.points:
            assert all(map(math.isfinite, (point.lat_deg, point.lon_deg, point.height_above_home_m, point.speed_m_s)))
        write_litchi(flight)
        check_kmz(write_kmz(flight, M3E, return_height_m=80.0))
    except FormatError as error:
        refused = str(error)
    assert "\n" not in refused


@pytest.mark.parametrize(
    ("mission", "match"),
    [
        (replace(flown(at(100)), home=None), "home: the mission has no home"),
        (replace(flown(at(100)), home=replace(HOME, lat_deg=math.nan)), "home: home is not a valid position"),
        (replace(flown(at(100)), home=replace(HOME, lat_deg=47.26)), "item 1: the take-off is more than 1 m from home"),
        (Mission(HOME, ()), "does not end with a landing"),
        (Mission(HOME, (UP, change_speed(8.0), DOWN)), "fewer than two points"),
        (Mission(HOME, (UP, change_speed(8.0), at(100))), "does not end with a landing"),
        (Mission(HOME, (change_speed(8.0), at(100), OVER_HOME, DOWN)), "item 2: the mission does not begin with a take-off"),
        (Mission(HOME, (UP, at(100), OVER_HOME, DOWN)), "no speed is set before the first leg"),
        (Mission(HOME, (item_of(TakePicture()), UP)), "item 1: this photo comes before take-off"),
        (Mission(HOME, (*flown(at(100)).items, at(200))), "item 6: an item follows the landing"),
        (Mission(HOME, (UP, change_speed(8.0), at(100), at(0), DOWN, return_to_launch())), "item 6: an item follows the landing"),
    ],
)  # fmt: skip
def test_a_flight_begins_and_ends_at_home(mission: Mission, match: str) -> None:
    with pytest.raises(FormatError, match=match):
        camera_flight(mission)


POINTS = [(46.5, 8.25, 40.0), (46.501, 8.252, 55.5), (46.499, 8.26, 61.0)]
READERS: dict[str, Callable[[str], PointRoute]] = {
    ".gpx": read_gpx_route, ".kml": read_kml_route, ".csv": csv_tables.read_litchi, ".wpml": wpml.read_route,
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
    archive = zipfile.ZipFile(io.BytesIO(write_kmz(flight, DJI_AIRCRAFT.by_name()["dji-m3e"], return_height_m=80.0)))
    texts = {".wpml": archive.read(wpml.DOCUMENT).decode()}
    with contextlib.suppress(FormatError):  # Litchi cannot do every one
        texts[".csv"] = write_litchi(flight)
    for suffix, text in texts.items():
        route = READERS[suffix](text)
        items = [route.mission.items[number - 1] for number in route.numbers]
        assert [(one.lat_deg, one.lon_deg, one.alt_m) for one in items] == [
            (pytest.approx(p.lat_deg, abs=1e-8), pytest.approx(p.lon_deg, abs=1e-8), p.height_above_home_m)
            for p in flight.points
        ]


def test_speeds_that_differ_are_items() -> None:
    text = ROUTES[".csv"](POINTS, 1.0).replace(",0,7.5\n", ",0,4\n", 1)
    route = csv_tables.read_litchi(text)
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
        csv_tables.read_litchi(ROUTES[".csv"](POINTS, 1.0).replace(",0,7.5", ",1,7.5")).mission.items[1].frame
        is Frame.ABOVE_TERRAIN
    )


def test_curves_are_told() -> None:
    text = ROUTES[".wpml"](POINTS, 1.0).replace(
        "</wpml:waypointSpeed>", "</wpml:waypointSpeed><wpml:useStraightLine>0</wpml:useStraightLine>"
    )
    assert "3 curved" in wpml.read_route(text).repairs[0]
    assert "corners" in csv_tables.read_litchi(ROUTES[".csv"](POINTS, 1.0).replace(",90,0,", ",90,5,")).repairs[0]


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
    pitch, distance, photos = None, None, 0
    for number, item in enumerate(route.mission.items, 1):
        if number in route.numbers:
            if number > route.numbers[0]:
                found.append((pitch, photos, distance))
            photos = 0
        elif item.command == Command.DO_GIMBAL_MANAGER_PITCHYAW:
            pitch = item.params[0]
        elif item.command == Command.DO_SET_CAM_TRIGG_DIST:
            assert item.params[2] == 0.0, "the first picture is one of its own"
            distance = item.params[0] or None
        elif item.command == Command.IMAGE_START_CAPTURE:
            photos += 1
    return [*found, (pitch, photos, distance)]


@pytest.mark.parametrize("seed", range(6))
def test_what_the_camera_does_reads_back(seed: int) -> None:
    flight = random_flight(seed)
    archive = zipfile.ZipFile(io.BytesIO(write_kmz(flight, DJI_AIRCRAFT.by_name()["dji-m3e"], return_height_m=80.0)))
    texts = {".wpml": archive.read(wpml.DOCUMENT).decode()}
    with contextlib.suppress(FormatError):
        texts[".csv"] = write_litchi(flight)
    expected, before = [], None
    for point in flight.points:
        begins = point.photo_distance_m is not None and point.photo_distance_m != before
        before = point.photo_distance_m
        expected.append((point.pitch_deg, point.photos + begins, before))
    for suffix, text in texts.items():
        reported = _held(READERS[suffix](text))
        if suffix == ".wpml":  # its last point has no leg after it
            reported, wanted = reported[:-1], expected[:-1]
        else:
            wanted = expected
        assert [row[1:] for row in reported] == [
            (count, None if every is None else pytest.approx(every, abs=1e-3)) for _, count, every in wanted
        ]
        assert [row[0] for row in reported if row[0] is not None] == [
            pytest.approx(pitch) for (pitch, *_), row in zip(wanted, reported, strict=True) if row[0] is not None
        ]


def test_actions_of_litchi() -> None:
    lines = ROUTES[".csv"](POINTS, 1.0).splitlines()
    lines[0] += ",photo_timeinterval,photo_distinterval"
    lines[1] = lines[1].replace(",-1,0" * 15, ",0,2500,5,-45,1,0,4,30" + ",-1,0" * 11) + ",2,-1"
    lines[2], lines[3] = f"{lines[2]},-1,-1", f"{lines[3]},-1,-1"
    items = csv_tables.read_litchi("\n".join(lines)).mission.items
    assert [(int(one.command), *one.params[:3]) for one in items[2:8]] == [
        (93, 2.5, -1.0, -1.0), (1000, -45.0, pytest.approx(float("nan"), nan_ok=True), pytest.approx(float("nan"), nan_ok=True)),
        (115, 30.0, 0.0, 0.0), (2000, 0.0, 0.0, 1.0), (2000, 0.0, 2.0, 0.0), (16, 0.0, 0.0, 0.0),
    ]  # fmt: skip
    assert [one.command for one in items[8:10]] == [Command.CONDITION_YAW, Command.IMAGE_STOP_CAPTURE]

"""The tables of cameras and vehicles: consistent, sourced, and found by any spelling of their names."""

import math
import re

import pytest

from uavcover.errors import InputError
from uavcover.extras.exports.command import dji_aircraft_named
from uavcover.new.catalog import all_cameras, all_vehicles, camera_named, vehicle_named

CAMERAS = {camera.name: camera for camera in all_cameras()}
VEHICLES = {vehicle.name: vehicle for vehicle in all_vehicles()}


def test_there_are_the_cameras_that_people_fly():
    bodies = {camera.title.split(", ")[0] for camera in CAMERAS.values()}
    assert len(bodies) >= 40
    assert {"dji-m3e", "dji-m3m", "dji-m3t", "dji-m30t", "dji-m4e", "dji-p1-24mm", "dji-p1-35mm", "dji-p1-50mm"} <= set(
        CAMERAS
    )
    assert {"sony-a6000-16mm", "sony-a7r4-35mm", "sony-rx1r2", "micasense-rededge-mx", "gopro-hero4"} <= set(CAMERAS)
    assert len(VEHICLES.keys() - {"arducopter", "px4"}) >= 12


@pytest.mark.parametrize("name", CAMERAS)
def test_a_camera_is_consistent_and_sourced(name):
    camera = CAMERAS[name]
    pitch_um = 1000.0 * camera.sensor_across_mm / camera.pixels_across
    assert 1000.0 * camera.sensor_along_mm / camera.pixels_along == pytest.approx(pitch_um, rel=0.02)
    assert camera.sensor_across_mm > camera.sensor_along_mm  # landscape
    assert 0.7 < pitch_um < 18.0
    assert 8.0 < camera.fov_along_deg < camera.fov_across_deg < 110.0
    assert camera.min_interval_s is None or 0.1 <= camera.min_interval_s <= 5.0
    assert len(camera.source) > 12
    # One pixel at a distance of the focal length in pixels is as large as the unit.
    assert camera.focal_px * math.tan(math.radians(0.5 * camera.fov_across_deg)) == pytest.approx(
        0.5 * camera.pixels_across
    )


STATED = {
    r"([\d.]+) mm equivalent": (lambda c: c.focal_length_mm * 43.2666 / diagonal_mm(c), 0.07),
    r"field of view ([\d.]+) degrees": (
        lambda c: 2.0 * math.degrees(math.atan(0.5 * diagonal_mm(c) / c.focal_length_mm)),
        0.08,
    ),
    r"([\d.]+) um\b": (lambda c: 1000.0 * c.sensor_across_mm / c.pixels_across, 0.02),
}
"""What sheets state besides sensor, pixels and lens, how these give it, and how far sheets round it."""


def diagonal_mm(camera):
    return math.hypot(camera.sensor_across_mm, camera.sensor_along_mm)


def test_what_a_sheet_states_beside_sensor_and_lens_agrees_with_them():
    found = 0
    for camera in CAMERAS.values():
        for words, (given, share) in STATED.items():
            for stated in re.findall(words, camera.source):
                assert given(camera) == pytest.approx(float(stated), rel=share), (camera.name, stated)
                found += 1
    assert found >= 25


@pytest.mark.parametrize("name", VEHICLES)
def test_a_vehicle_is_plausible_and_sourced(name):
    vehicle = VEHICLES[name]
    assert vehicle.endurance_s is None or 600.0 <= vehicle.endurance_s <= 4000.0
    for speed in (vehicle.cruise_speed_m_s, vehicle.max_speed_m_s):
        assert speed is None or 3.0 <= speed <= 30.0
    for speed in (vehicle.max_climb_m_s, vehicle.max_descent_m_s):
        assert speed is None or 1.0 <= speed <= 12.0
    assert len(vehicle.source) > 12


def test_known_figures():
    """By hand, from the sheets: 2.5 cm at 93.7 m for the Mavic 3 Enterprise, 4.4 um pixels of the P1."""
    assert 0.025 * CAMERAS["dji-m3e"].focal_px == pytest.approx(93.8, abs=0.1)
    p1 = CAMERAS["dji-p1-35mm"]
    assert 1000.0 * p1.sensor_across_mm / p1.pixels_across == pytest.approx(4.4, rel=0.01)
    assert p1.fov_across_deg == pytest.approx(54.3, abs=0.1)
    assert CAMERAS["sony-a7r4-35mm"].focal_px == pytest.approx(9318.0, rel=1e-3)
    assert VEHICLES["arducopter"].cruise_speed_m_s == 10.0


@pytest.mark.parametrize(
    ("spelling", "name"),
    [
        ("SONY-A7R4-35MM", "sony-a7r4-35mm"), ("Sony A7R IV, 35 mm", "sony-a7r4-35mm"), ("sony a7riv 35mm", "sony-a7r4-35mm"),
        ("m3e", "dji-m3e"), ("Mavic 3 Enterprise", "dji-m3e"), ("skydio 2+", "skydio-2"), ("Boson 320", "flir-boson-320-6.3mm"),
    ],
)  # fmt: skip
def test_a_camera_is_found_by_any_spelling(spelling, name):
    assert camera_named(spelling).name == name


def test_no_spelling_means_two():
    for table, find in ((CAMERAS, camera_named), (VEHICLES, vehicle_named)):
        for row in table.values():
            assert find(row.name) == row
            assert find(row.title) == row


@pytest.mark.parametrize(
    ("find", "wanted", "words"),
    [
        (camera_named, "sony-a7r4", "did you mean sony-a7r4-35mm"),
        (camera_named, "dji-m3", "dji-m3e"),
        (camera_named, "??", "your own TOML file"),
        (camera_named, "", "unknown name ''"),
        (camera_named, "nowhere.toml", "cannot read nowhere.toml"),
        (vehicle_named, "m350 rtk", "dji-m350-rtk"),
        (vehicle_named, "x", "(see uavcover new --vehicle list)"),
        (
            dji_aircraft_named,
            "x",
            "(see uavcover export --drone list)",
        ),  # it named a command without --drone
    ],
)
def test_a_name_that_is_not_known(find, wanted, words):
    with pytest.raises(InputError) as caught:
        find(wanted)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


OWN = "sensor_mm = [13.2, 8.8]\npixels = [5472, 3648]\nfocal_length_mm = 8.8\nmin_interval_s = 1.5\n"


def test_a_camera_and_a_vehicle_of_ones_own(tmp_path):
    (tmp_path / "mine.toml").write_text(OWN, encoding="utf-8")
    camera = camera_named(str(tmp_path / "mine.toml"))
    assert (camera.name, camera.title, camera.min_interval_s) == ("mine", "mine", 1.5)
    (tmp_path / "table.toml").write_text("[my-camera]\n" + OWN, encoding="utf-8")
    assert camera_named(str(tmp_path / "table.toml")).title == "my-camera"
    (tmp_path / "v.toml").write_text('cruise_speed_m_s = 7\nautopilot = "px4"\n', encoding="utf-8")
    assert vehicle_named(str(tmp_path / "v.toml")).cruise_speed_m_s == 7.0


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[", "not valid TOML"),
        ("", "sensor_mm: the key is missing; required keys are"),
        (OWN.replace("pixels", "pixel"), "pixel: unknown key; did you mean pixels?"),
        (OWN.replace("[13.2, 8.8]", "13.2"), "must be two numbers"),
        (OWN.replace("[13.2, 8.8]", "[13.2, 0]"), "must be a number above 0"),
        (OWN.replace("8.8]", '"8.8"]'), "must be a number above 0"),
        (OWN.replace("8.8]", "8.0]"), "are not square"),
        (OWN.replace("5472", "5472.5"), "must be whole numbers"),
        (OWN.replace("= 8.8", "= nan"), "must be a number above 0"),
        (OWN.replace("= 8.8", "= 0.5"), "not the 35 mm equivalent"),
        (OWN.replace("1.5", "-1"), "must be a number above 0"),
        ("[a]\n" + OWN + "[b]\n" + OWN, "has several tables (a, b); keep only one"),
    ],
)  # fmt: skip
def test_a_bad_camera_is_one_line(tmp_path, text, words):
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        camera_named(str(path))
    assert words in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_bad_vehicle_is_one_line(tmp_path):
    path = tmp_path / "v.toml"
    for text, words in (
        ('autopilot = "dji"', "must be ardupilot or px4"),
        ("speed = 3", "unknown key"),
        ("endurance_s = 0", "above 0"),
    ):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(InputError, match=words):
            vehicle_named(str(path))

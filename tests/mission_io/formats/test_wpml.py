"""DJI's WPML: every file keeps the published tables, and reads back to the flight; what it cannot say is refused."""

from dataclasses import replace
from typing import Any

import pytest

from mission_io.errors import FormatError
from mission_io.formats.point_route import CameraFlight
from mission_io.formats.wpml import AbsoluteHeights, DjiAircraft, write_kmz
from tests.mission_io.formats.flights import photos_at_once, random_flight
from tests.mission_io.formats.wpml_tables import check_kmz
from uavcover.extras.exports.command import DJI_AIRCRAFT

M3E = DJI_AIRCRAFT.by_name()["dji-m3e"]


@pytest.mark.parametrize("seed", range(24))
def test_a_flight_reads_back_and_keeps_the_tables(seed: int) -> None:
    flight = random_flight(seed)
    read = check_kmz(write_kmz(flight, M3E, return_height_m=80.0))
    assert len(read.points) == len(flight.points)
    photos = photos_at_once(flight)
    pitch_deg = None
    for number, (found, point) in enumerate(zip(read.points, flight.points, strict=True)):
        assert found.lat_deg == pytest.approx(point.lat_deg, abs=1e-8)
        assert found.lon_deg == pytest.approx(point.lon_deg, abs=1e-8)
        assert found.height_m == point.height_above_home_m
        assert found.speed_m_s == point.speed_m_s
        assert (found.heading_deg is None) == (point.heading_deg is None)
        if point.heading_deg is not None and found.heading_deg is not None:
            assert found.heading_deg % 360.0 == pytest.approx(point.heading_deg, abs=1e-9)
        taken = [a for a in found.actions if a[0] == "reachPoint" and a[2] == "takePhoto"]
        assert len(taken) == photos[number]
        turned = [value for _, _, function, value in found.actions if function == "gimbalRotate"]
        assert turned == ([point.pitch_deg] if point.pitch_deg not in (None, pitch_deg) else [])
        pitch_deg = point.pitch_deg
    # Pictures by distance: on every leg the one group that reaches over it has the flight's distance.
    groups = [
        (k, last, value)
        for k, p in enumerate(read.points)
        for trigger, last, _, value in p.actions
        if trigger == "multipleDistance"
    ]
    for leg in range(len(flight.points) - 1):
        over = [value for first, last, value in groups if first <= leg < last]
        wanted = flight.points[leg].photo_distance_m
        assert over == ([] if wanted is None else [wanted])


def test_it_begins_above_home_and_lands_where_it_ends() -> None:
    flight = random_flight(3)
    config = check_kmz(write_kmz(flight, M3E, return_height_m=95.0)).config
    assert float(config["takeOffSecurityHeight"]) == flight.points[0].height_above_home_m
    assert config["finishAction"] == "autoLand"
    assert config["globalRTHHeight"] == "95"


def test_absolute_heights_are_flown_above_the_ellipsoid() -> None:
    flight = random_flight(7)
    above = [point.height_above_home_m for point in flight.points]
    absolute = AbsoluteHeights([412.5 + m for m in above], [380.25 + m for m in above])
    read = check_kmz(write_kmz(flight, M3E, return_height_m=95.0, absolute=absolute))
    assert read.mode == "WGS84"
    assert [point.height_m for point in read.points] == pytest.approx(absolute.ellipsoid_m, abs=1e-9)
    assert read.template_heights_m == pytest.approx(absolute.amsl_m, abs=1e-9)
    # The climb and the return are above the place of take-off all the same.
    assert float(read.config["takeOffSecurityHeight"]) == above[0]
    assert read.config["globalRTHHeight"] == "95"


def test_equal_flights_are_equal_files() -> None:
    assert write_kmz(random_flight(5), M3E, return_height_m=80.0) == write_kmz(
        random_flight(5), M3E, return_height_m=80.0
    )


@pytest.mark.parametrize(("name", "aircraft"), DJI_AIRCRAFT.by_name().items())
def test_every_aircraft_of_the_table(name: str, aircraft: DjiAircraft) -> None:
    read = check_kmz(write_kmz(random_flight(1), aircraft, return_height_m=80.0))
    assert (int(read.config["droneEnumValue"]), int(read.config["droneSubEnumValue"])) == aircraft.drone
    assert name.startswith("dji-")


def with_first(flight: CameraFlight, **changes: Any) -> CameraFlight:
    return replace(flight, points=(replace(flight.points[0], **changes), *flight.points[1:]))


@pytest.mark.parametrize(
    ("changes", "return_height_m", "match"),
    [
        ({"height_above_home_m": 1.0}, 80.0, r"point 1: the climb ends 1 m above home, but WPML accepts 1\.2 to 1500"),
        ({"height_above_home_m": 1501.0}, 80.0, "point 1: the climb ends 1501 m"),
        ({"speed_m_s": 15.5}, 80.0, r"point 1: the speed is 15\.5 m/s, but the DJI Mavic 3E flies at most"),
        ({"speed_m_s": 0.0}, 80.0, "point 1: the speed is 0 m/s"),
        ({"pitch_deg": -95.0}, 80.0, "point 1: camera pitch -95 degrees"),
        ({}, 1600.0, "return height: 1600 m above home exceeds"),
        ({}, 0.0, "return height"),
    ],
)
def test_what_the_aircraft_cannot_do_is_refused(changes: dict[str, float], return_height_m: float, match: str) -> None:
    flight = random_flight(2)
    with pytest.raises(FormatError, match=match):
        write_kmz(with_first(flight, **changes), M3E, return_height_m=return_height_m)


def test_more_points_than_there_are_numbers() -> None:
    flight = random_flight(2, points=2)
    with pytest.raises(FormatError, match="flight: 65538 points exceed"):
        write_kmz(replace(flight, points=flight.points * 32769), M3E, return_height_m=80.0)

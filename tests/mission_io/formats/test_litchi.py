"""Litchi's CSV: read by the columns' names, each value in its published range; what it cannot say is refused."""

import csv
import io
from dataclasses import replace
from typing import Any

import pyproj
import pytest

from mission_io.errors import FormatError
from mission_io.formats.csv_tables import write_litchi
from mission_io.formats.point_route import CameraFlight
from tests.mission_io.formats.flights import photos_at_once, random_flight

COLUMNS = [
    "latitude", "longitude", "altitude(m)", "heading(deg)", "curvesize(m)", "rotationdir", "gimbalmode",
    "gimbalpitchangle",
    *[f"action{what}{k}" for k in range(1, 16) for what in ("type", "param")],
    "altitudemode", "speed(m/s)", "poi_latitude", "poi_longitude", "poi_altitude(m)", "poi_altitudemode",
    "photo_timeinterval", "photo_distinterval",
]  # fmt: skip
"""Of a mission that Mission Hub exports; their ranges are those of litchiutilities.com/docs/litchiCsv.php."""
RANGES = {
    "latitude": (-90, 90), "longitude": (-180, 180), "altitude(m)": (-200, 500), "heading(deg)": (0, 360),
    "gimbalpitchangle": (-90, 30), "speed(m/s)": (0, 15), "curvesize(m)": (0, 1000),
}  # fmt: skip


def rows_of(text: str) -> list[dict[str, float]]:
    assert "e" not in text.split("\n", 1)[1].lower()
    reader = csv.DictReader(io.StringIO(text))
    rows = [{name: float(value) for name, value in row.items()} for row in reader]
    assert reader.fieldnames == COLUMNS
    for row in rows:
        assert all(low <= row[name] <= high for name, (low, high) in RANGES.items())
        assert row["rotationdir"] in (0, 1)
        assert row["gimbalmode"] in (0, 2)
        assert row["altitudemode"] == row["poi_altitudemode"] == 0
        assert all(row[f"actiontype{k}"] in range(-1, 6) for k in range(1, 16))
        assert row["photo_timeinterval"] == -1
    return rows


@pytest.mark.parametrize("seed", range(24))
def test_a_flight_reads_back(seed: int) -> None:
    flight = random_flight(seed)
    rows = rows_of(write_litchi(flight))
    assert len(rows) == len(flight.points)
    photos = photos_at_once(flight)
    for number, (row, point) in enumerate(zip(rows, flight.points, strict=True)):
        assert row["latitude"] == pytest.approx(point.lat_deg, abs=1e-8)
        assert row["longitude"] == pytest.approx(point.lon_deg, abs=1e-8)
        assert row["altitude(m)"] == point.height_above_home_m
        assert row["speed(m/s)"] == point.speed_m_s
        assert (row["gimbalmode"], row["gimbalpitchangle"]) == (
            (0, 0) if point.pitch_deg is None else (2, point.pitch_deg)
        )
        assert row["photo_distinterval"] == (-1 if point.photo_distance_m is None else point.photo_distance_m)
        assert [row[f"actiontype{k}"] for k in range(1, 16)].count(1) == photos[number]
        if point.heading_deg is not None:
            assert row["heading(deg)"] == point.heading_deg
        elif number + 1 < len(rows):
            after = flight.points[number + 1]
            course, _, _ = pyproj.Geod(ellps="WGS84").inv(point.lon_deg, point.lat_deg, after.lon_deg, after.lat_deg)
            away = (row["heading(deg)"] - course + 180.0) % 360.0 - 180.0
            assert away == pytest.approx(0.0, abs=0.5)  # on the ellipsoid, where the writer takes a sphere


def test_the_heading_of_a_vertical_leg_is_that_of_the_leg_beside_it() -> None:
    flight = random_flight(0, points=3)
    a, b, _ = (replace(point, heading_deg=None) for point in flight.points)
    column = CameraFlight(flight.home, (a, b, replace(b, height_above_home_m=b.height_above_home_m - 30.0)))
    rows = rows_of(write_litchi(column))
    assert rows[0]["heading(deg)"] == rows[1]["heading(deg)"] == rows[2]["heading(deg)"] != 0.0


def with_first(flight: CameraFlight, **changes: Any) -> CameraFlight:
    return replace(flight, points=(replace(flight.points[0], **changes), *flight.points[1:]))


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"height_above_home_m": 500.5}, r"point 1: 500\.5 m above home is invalid; Litchi accepts -200 to 500"),
        ({"height_above_home_m": -201.0}, "point 1: -201 m above home"),
        ({"speed_m_s": 15.5}, "point 1: 15.5 m/s"),
        ({"pitch_deg": 10.0}, "point 1: 10 degrees of camera pitch"),
        ({"photos": 16}, "point 1: a point has 1[67] photos, but the limit of Litchi is 15"),
        ({"lat_deg": 46.0}, r"point 1: .* m to the next point is invalid; Litchi accepts 0\.5 to 2000"),
    ],
)
def test_what_litchi_cannot_do_is_refused(changes: dict[str, float], match: str) -> None:
    with pytest.raises(FormatError, match=match):
        write_litchi(with_first(random_flight(0), **changes))


def test_points_too_near_to_each_other_and_too_many() -> None:
    flight = random_flight(0)
    first = flight.points[0]
    near = replace(first, height_above_home_m=first.height_above_home_m + 0.3)
    with pytest.raises(FormatError, match=r"point 1: 0.3 m to the next point"):
        write_litchi(replace(flight, points=(first, near)))
    with pytest.raises(FormatError, match="flight: the mission has 100 points, but Litchi accepts 2 to 99"):
        write_litchi(random_flight(1, points=100))
    with pytest.raises(FormatError, match="flight: the mission has 1 points"):
        write_litchi(random_flight(1, points=1))
    assert len(rows_of(write_litchi(random_flight(1, points=99)))) == 99

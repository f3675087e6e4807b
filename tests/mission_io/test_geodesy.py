"""Distances and points against pyproj; and the doubts that follow from distances."""

import math
import random
from dataclasses import replace

import pytest
from pyproj import Geod, Transformer

from mission_io.formats.text import doubts_about
from mission_io.model.items import Frame, GeoPoint, Mission, delay, earth_centred_m, ground_distance_m, waypoint
from tests.mission_io.formats.samples import HOME, MISSION

GEOD = Geod(ellps="WGS84")


@pytest.mark.parametrize(
    ("span_deg", "relative", "absolute_m"), [(0.001, 1e-6, 1e-6), (0.1, 1e-6, 1e-3), (3.0, 1e-4, 0.0)]
)
def test_distances_agree_with_pyproj(span_deg: float, relative: float, absolute_m: float) -> None:
    rng = random.Random(5)
    for _ in range(300):
        lat, lon = rng.uniform(-80, 80), rng.uniform(-180, 180)
        lat2, lon2 = lat + rng.uniform(-span_deg, span_deg), lon + rng.uniform(-span_deg, span_deg)
        wanted = GEOD.inv(lon, lat, lon2, lat2)[2]
        assert ground_distance_m(lat, lon, lat2, lon2) == pytest.approx(wanted, rel=relative, abs=absolute_m)


def test_distances_across_the_date_line_and_to_the_other_side() -> None:
    assert ground_distance_m(10.0, 179.999, 10.0, -179.999) == pytest.approx(
        GEOD.inv(179.999, 10.0, -179.999, 10.0)[2], rel=1e-6
    )
    assert ground_distance_m(0.0, 0.0, 0.0, 180.0) == pytest.approx(math.pi * 6378137.0)
    assert ground_distance_m(5.0, 6.0, 5.0, 6.0) == 0.0


def test_points_in_space_agree_with_pyproj() -> None:
    to_space = Transformer.from_crs("EPSG:4979", "EPSG:4978")
    for place in ((33.2, -98.1, 345.0), (-89.0, 12.0, -50.0), (0.0, 180.0, 9000.0)):
        assert earth_centred_m(*place) == pytest.approx(to_space.transform(*place), abs=1e-6)


def test_a_plausible_mission_raises_no_doubts() -> None:
    assert doubts_about(MISSION) == ()
    assert doubts_about(Mission(None, MISSION.items)) == ()


def test_a_place_that_was_never_set_is_doubted() -> None:
    zero = waypoint(0.0, 0.0, 10.0, frame=Frame.ABOVE_HOME)
    assert doubts_about(
        Mission(GeoPoint(0.0, 0.0, 0.0), (*MISSION.items, zero, delay(1.0), replace(zero, command=195)))
    ) == (
        "home is at latitude 0, longitude 0, in the open sea; set the home position",
        "item 9: this waypoint is at latitude 0, longitude 0",
    )


def test_a_route_far_from_home_is_doubted_and_a_swapped_one_is_named() -> None:
    home = GeoPoint(33.2, 60.4, 100.0)
    swapped = waypoint(60.41, 33.21, 30.0, frame=Frame.ABOVE_HOME)
    (doubt,) = doubts_about(Mission(home, (swapped, swapped, replace(swapped, lat_deg=math.nan))))
    assert doubt.startswith("item 1: ")
    assert doubt.endswith(" km from home (the farthest of 2 beyond 100 km); latitude and longitude seem to be swapped")
    (doubt,) = doubts_about(Mission(HOME, (waypoint(33.2, -90.0, 30.0, frame=Frame.AMSL),)))
    far_km = GEOD.inv(HOME.lon_deg, HOME.lat_deg, -90.0, 33.2)[2] / 1000.0
    assert doubt.startswith(
        f"item 1: {far_km:.0f} km from home (the farthest of 1 beyond 100 km); do the route and home belong"
    )

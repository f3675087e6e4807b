"""Surfaces and the heights of legs above them, against brute force, closed forms and pyproj."""

import math
import random

import numpy as np
import pytest
from pyproj import Geod
from scipy.interpolate import RegularGridInterpolator

from mission_io.clearance import heights_along
from mission_io.errors import MisuseError
from mission_io.geodesy import ground_distance_m
from mission_io.items import GeoPoint
from mission_io.legs import Leg, LegKind
from mission_io.surface import FloatArray, GridSurface, steepest_slope_of

GEOD = Geod(ellps="WGS84")


def leg(a: tuple[float, float, float], b: tuple[float, float, float]) -> Leg:
    return Leg(1, LegKind.FLIGHT, GeoPoint(*a), GeoPoint(*b))


def hills(seed: int, size: int = 40) -> GridSurface:
    heights = np.random.default_rng(seed).normal(0.0, 1.0, (size, size)).cumsum(axis=0).cumsum(axis=1)
    return GridSurface(33.0, -98.2, 0.001, heights)


class Cliff:
    """A ground of 0 m with a wall of 100 m that is narrower than any step; it says nothing of its slope."""

    def heights_amsl_m(self, lat_deg: FloatArray, lon_deg: FloatArray) -> FloatArray:
        return np.where(np.abs(lat_deg - 33.0123456) < 1e-5, 100.0, 0.0) + 0.0 * lon_deg


class Needle(Cliff):
    """The same wall with sides as steep as it says."""

    steepest_slope = 100.0

    def heights_amsl_m(self, lat_deg: FloatArray, lon_deg: FloatArray) -> FloatArray:
        return np.maximum(0.0, 100.0 - 100.0 * 110_000.0 * np.abs(lat_deg - 33.0123456)) + 0.0 * lon_deg


def test_a_grid_is_bilinear_and_unknown_outside() -> None:
    ground = hills(1)
    axis = np.arange(40)
    scipys = RegularGridInterpolator((33.0 + 0.001 * axis, -98.2 + 0.001 * axis), ground.heights)
    rng = np.random.default_rng(2)
    lat, lon = rng.uniform(33.0, 33.039, 500), rng.uniform(-98.2, -98.161, 500)
    assert ground.heights_amsl_m(lat, lon) == pytest.approx(scipys(np.column_stack([lat, lon])), abs=1e-9)
    outside = ground.heights_amsl_m(np.array([32.9, 33.02, math.nan]), np.array([-98.19, -98.3, -98.19]))
    assert np.isnan(outside).all()
    with pytest.raises(ValueError, match="read-only"):
        ground.heights[0, 0] = 1.0


def test_a_grid_is_nowhere_steeper_than_it_says() -> None:
    ground = hills(3)
    rng = random.Random(4)
    for _ in range(2000):
        lat, lon = rng.uniform(33.0, 33.039), rng.uniform(-98.2, -98.161)
        lat2, lon2 = lat + rng.uniform(-2e-4, 2e-4), lon + rng.uniform(-2e-4, 2e-4)
        a, b = ground.heights_amsl_m(np.array([lat, lat2]), np.array([lon, lon2]))
        if not math.isnan(b):
            assert abs(b - a) <= ground.steepest_slope * ground_distance_m(lat, lon, lat2, lon2) * (1.0 + 1e-9)
    assert steepest_slope_of(ground) == ground.steepest_slope
    assert steepest_slope_of(Cliff()) is None


@pytest.mark.parametrize("heights", [np.zeros(3), np.zeros((1, 5))])
def test_a_grid_that_is_none_is_refused(heights: FloatArray) -> None:
    with pytest.raises(MisuseError, match="2 rows"):
        GridSurface(0.0, 0.0, 0.1, heights)
    assert GridSurface(0.0, 0.0, 0.1, np.full((2, 2), math.nan)).steepest_slope == 0.0


@pytest.mark.parametrize("length_km", [1.0, 20.0, 50.0])
def test_the_places_of_a_leg_are_on_the_geodesic(length_km: float) -> None:
    rng = random.Random(6)
    for _ in range(20):
        lat, lon, azimuth = rng.uniform(-60, 60), rng.uniform(-180, 180), rng.uniform(0, 360)
        lon2, lat2, _ = GEOD.fwd(lon, lat, azimuth, length_km * 1000.0)
        lats, lons = leg((lat, lon, 0.0), (lat2, lon2, 0.0)).places(np.array([0.0, 0.25, 0.5, 1.0]))
        for fraction, place_lat, place_lon in zip((0.0, 0.25, 0.5, 1.0), lats, lons, strict=True):
            wanted_lon, wanted_lat, _ = GEOD.fwd(lon, lat, azimuth, fraction * length_km * 1000.0)
            _, _, off_m = GEOD.inv(wanted_lon, wanted_lat, place_lon, place_lat)
            start_azimuth, _, distance_m = GEOD.inv(lon, lat, place_lon, place_lat)
            across_m = distance_m * math.sin(math.radians(start_azimuth - azimuth))
            assert abs(across_m) < 0.2
            assert off_m < 0.007 * length_km * 1000.0


@pytest.mark.parametrize("seed", range(6))
def test_bounded_extremes_hold_what_brute_force_finds(seed: int) -> None:
    ground = hills(seed)
    rng = random.Random(seed)
    where = lambda: (rng.uniform(33.001, 33.038), rng.uniform(-98.199, -98.162), rng.uniform(100.0, 300.0))  # noqa: E731
    way = leg(where(), where())
    along = heights_along(way, ground, step_m=50.0, tolerance_m=0.05)
    assert along.error_m is not None
    assert along.error_m <= 0.05
    t = np.linspace(0.0, 1.0, 200_001)
    every = way.altitudes_amsl_m(t) - ground.heights_amsl_m(*way.places(t))
    assert along.lowest_agl_m - along.error_m <= every.min() <= along.lowest_agl_m + 1e-3
    assert along.highest_agl_m - 1e-3 <= every.max() <= along.highest_agl_m + along.error_m
    t_low = np.array([along.lowest_at])
    assert way.altitudes_amsl_m(t_low)[0] - ground.heights_amsl_m(*way.places(t_low))[0] == along.lowest_agl_m


def test_a_wall_between_two_samples_is_found_when_the_slope_is_bounded_and_never_claimed_absent_when_not() -> None:
    way = leg((33.0, -98.2, 120.0), (33.02, -98.2, 120.0))
    sampled = heights_along(way, Cliff(), step_m=100.0)
    assert (sampled.lowest_agl_m, sampled.error_m) == (120.0, None)
    bounded = heights_along(way, Needle(), step_m=100.0, tolerance_m=0.5)
    assert bounded.error_m is not None
    assert bounded.lowest_agl_m == pytest.approx(20.0, abs=0.5)


def test_what_is_not_known_is_said() -> None:
    ground = hills(1)
    out = heights_along(leg((33.01, -98.19, 200.0), (33.01, -98.1, 200.0)), ground)
    assert out.unknown_at is not None
    assert out.error_m is None
    assert 0.3 < out.unknown_at < 0.35
    nowhere = heights_along(leg((10.0, 10.0, 0.0), (10.0, 10.1, 0.0)), ground)
    assert math.isnan(nowhere.lowest_agl_m)
    assert nowhere.unknown_at == 0.0
    holed = GridSurface(33.0, -98.2, 0.001, np.where(np.arange(1600).reshape(40, 40) == 405, math.nan, ground.heights))
    small = heights_along(leg((33.01, -98.2, 200.0), (33.01, -98.17, 200.0)), holed, step_m=1000.0, tolerance_m=0.01)
    assert small.unknown_at is not None
    assert small.error_m is None


def test_a_column_has_no_length_and_no_error() -> None:
    ground = GridSurface(33.0, -98.2, 0.01, np.full((3, 3), 50.0))
    along = heights_along(leg((33.01, -98.19, 60.0), (33.01, -98.19, 90.0)), ground)
    assert (along.lowest_agl_m, along.highest_agl_m, along.error_m) == (10.0, 40.0, 0.0)


def test_steps_that_make_no_sense_are_refused() -> None:
    way = leg((33.0, -98.2, 120.0), (33.02, -98.2, 120.0))
    with pytest.raises(MisuseError, match="have to be above 0"):
        heights_along(way, Cliff(), step_m=0.0)
    with pytest.raises(MisuseError, match="take longer ones"):
        heights_along(leg((0.0, 0.0, 1.0), (0.0, 90.0, 1.0)), Cliff(), step_m=0.01)


def test_the_search_ends_where_a_slope_is_absurd() -> None:
    class Absurd(Cliff):
        steepest_slope = 1e9

    along = heights_along(leg((33.0, -98.2, 120.0), (33.001, -98.2, 120.0)), Absurd(), step_m=10.0, tolerance_m=1e-6)
    assert along.error_m is not None
    assert along.error_m > 1e-6

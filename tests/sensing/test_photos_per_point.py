"""Pictures per point, the best sample distance, and the overlap asked for, against brute force over every picture."""

import dataclasses
import doctest
import itertools

import numpy as np
import pytest
import shapely
from scipy.interpolate import RegularGridInterpolator

from tests.naive import photos as naive
from tests.planner.sites import HIGH_M, LOW_M, ORIGIN, STEP_M, flat, hills, make_site, ridge, tower, with_scenario
from tests.verification.flights import fly_along
from uavcover.model.limits import Obstacles
from uavcover.model.sensor import FrameCamera, NadirCamera, SphereSensor
from uavcover.scenario.site import area_as_drawn, load_site
from uavcover.sensing import photos
from uavcover.sensing.photos import (
    count_photos,
    overlap_rule,
    photo_statistics,
    photos_required,
    planned_poses,
    takes_photos,
)
from uavcover.sensing.site_maps import judging_map
from uavcover.verification.decision import requirement_rows
from uavcover.verification.flown_route import PlannedRoute
from uavcover.verification.verify import FlownTrack, verify_flight

CAMERA = FrameCamera(
    kind="frame-camera", fov_across_deg=62.0, fov_along_deg=47.0, range_m=220.0, pixels_across=4000,
    max_ground_sample_m=0.05, forward_overlap=0.7, side_overlap=0.6,
)  # fmt: skip
SENSORS = {
    "nadir": CAMERA,
    "ahead": dataclasses.replace(CAMERA, pitch_deg=-60.0, mount="stabilised"),
    "to the north-east": dataclasses.replace(CAMERA, pitch_deg=-50.0, mount="stabilised", heading_deg=40.0),
    "every 30 m": dataclasses.replace(CAMERA, forward_overlap=None, trigger_distance_m=30.0),
}
GROUNDS = {"flat": flat, "hills": hills, "ridge": ridge(150.0, 60.0)}


def lines(seed=3, height_m=95.0, spacing_m=40.0):
    """A boustrophedon over the square of the sites, whose corners are a little off."""
    rng = np.random.default_rng(seed)
    corners = [
        (e, n)
        for k, n in enumerate(np.arange(0.0, 201.0, spacing_m))
        for e in ((-20.0, 320.0) if k % 2 == 0 else (320.0, -20.0))
    ]
    off = rng.uniform(-3.0, 3.0, (len(corners), 2))
    return np.column_stack([np.array(corners) + off, rng.uniform(height_m - 8.0, height_m + 8.0, len(corners))])


@pytest.mark.parametrize("ground", GROUNDS)
@pytest.mark.parametrize("sensor", SENSORS)
def test_every_picture_counts_as_by_brute_force(sensor, ground):
    camera = SENSORS[sensor]
    site = make_site(GROUNDS[ground], sensor=camera, cell_m=12.0)
    coverage, route = judging_map(site), lines()
    counted = count_photos(coverage, planned_poses(coverage, [route]))
    looks = coverage.flown_observations(route)
    yaws = np.degrees(np.arctan2(looks.headings[:, 0], looks.headings[:, 1]))
    axis = np.arange(LOW_M, HIGH_M + STEP_M / 2, STEP_M)
    between = RegularGridInterpolator((axis, axis), GROUNDS[ground](axis[None, :], axis[:, None]))
    cells = coverage.grid.cells
    expected, sample_m, doubtful = naive.count(
        camera, lambda at: between(at[:, ::-1]), looks.positions_m, yaws, cells.centre_m, cells.normal
    )
    assert doubtful.mean() < 0.15
    sure = ~doubtful
    np.testing.assert_array_equal(counted.photos[sure], expected[sure])
    shown = sure & (expected > 0)
    assert shown.any()
    np.testing.assert_allclose(counted.ground_sample_m[shown], sample_m[shown], rtol=1e-9)
    assert np.isnan(counted.ground_sample_m[sure & (expected == 0)]).all()
    assert counted.taken == len(looks)
    if sensor == "nadir" and ground == "flat":
        assert counted.photos.max() > 12


def test_a_tower_hides_ground_from_pictures_but_not_its_roof():
    tall = Obstacles(prisms=(tower(130.0, 80.0, 170.0, 120.0, 60.0),))
    camera = SENSORS["to the north-east"]
    with_tower = judging_map(make_site(sensor=camera, obstacles=tall))
    without = judging_map(make_site(sensor=camera))
    counts = [count_photos(c, planned_poses(c, [lines(height_m=110.0)])).photos for c in (with_tower, without)]
    roof = shapely.contains_xy(shapely.box(130.0, 80.0, 170.0, 120.0), with_tower.grid.middles_m)
    assert (counts[0][~roof] <= counts[1][~roof]).all()
    assert (counts[0][~roof] < counts[1][~roof]).sum() > 10


OVERLAPS = (0.0, 0.3, 0.5, 0.6, 0.65, 2.0 / 3.0, 0.7, 0.75, 0.8, 0.85, 0.9, 0.95)


@pytest.mark.parametrize(("forward", "side"), list(itertools.product(OVERLAPS, OVERLAPS)))
@pytest.mark.thinned(strength=1)
def test_the_number_asked_for_is_what_strips_with_these_overlaps_show(forward, side):
    camera = dataclasses.replace(CAMERA, forward_overlap=forward, side_overlap=side)
    if forward == side == 0.0:
        assert photos_required(camera) is None
        assert overlap_rule(camera) is None
    else:
        assert photos_required(camera) == naive.required(forward, side)
        assert f"= {photos_required(camera)} photos" in overlap_rule(camera)


def test_doctests():
    assert doctest.testmod(photos).failed == 0


def test_an_overlap_that_was_not_asked_for_asks_for_nothing():
    assert photos_required(SphereSensor(kind="sphere", range_m=50.0)) is None
    assert photos_required(SENSORS["every 30 m"]) == 2
    assert photos_required(dataclasses.replace(SENSORS["every 30 m"], side_overlap=0.0)) is None
    statistics = photo_statistics(*_counted(dataclasses.replace(SENSORS["every 30 m"], side_overlap=0.0)))
    assert (statistics.asked, statistics.overlap_fraction, statistics.overlap_holds) == (None, None, None)


def _counted(camera, *, spacing_m=40.0):
    coverage = judging_map(make_site(sensor=camera))
    return coverage, count_photos(coverage, planned_poses(coverage, [lines(spacing_m=spacing_m)]))


@pytest.mark.parametrize(("spacing_m", "holds"), [(30.0, True), (150.0, False)])
def test_the_overlap_holds_or_not(spacing_m, holds):
    coverage, counts = _counted(CAMERA, spacing_m=spacing_m)
    statistics = photo_statistics(coverage, counts)
    enough = counts.photos >= 6
    assert statistics.asked == 6
    assert statistics.overlap_fraction == pytest.approx(coverage.fraction(enough))
    assert statistics.overlap_holds is holds
    assert statistics.fewest == counts.photos.min()
    assert statistics.median == np.median(counts.photos)


def test_single_pictures_only():
    def taken(sensor):
        return takes_photos(with_scenario(make_site(), sensor=sensor).scenario)

    assert taken(CAMERA)
    assert taken(NadirCamera(kind="nadir-camera", fov_deg=60.0, range_m=150.0, sensing="at-waypoints"))
    assert not taken(NadirCamera(kind="nadir-camera", fov_deg=60.0, range_m=150.0))
    assert not taken(SphereSensor(kind="sphere", range_m=90.0))
    assert not taken(dataclasses.replace(CAMERA, forward_overlap=None))


def test_several_flights_begin_the_trigger_anew():
    coverage, route = judging_map(make_site(sensor=CAMERA)), lines()
    apart = planned_poses(coverage, [route[:4], route[4:]])
    parts = [planned_poses(coverage, [part]) for part in (route[:4], route[4:])]
    np.testing.assert_array_equal(apart.eyes, np.vstack([part.eyes for part in parts]))
    whole = count_photos(coverage, apart).photos
    np.testing.assert_array_equal(whole, sum(count_photos(coverage, part).photos for part in parts))
    assert planned_poses(coverage, []).eyes.shape == (0, 3)
    assert count_photos(coverage, planned_poses(coverage, [])).photos.max() == 0


def test_the_margin_is_no_part_of_the_drawn_area():
    jacksboro = load_site("jacksboro").scenario
    rings = (
        ((-300.0, -200.0), (300.0, -200.0), (300.0, 200.0), (-300.0, 200.0)),
        ((-50.0, -50.0), (50.0, -50.0), (50.0, 50.0), (-50.0, 50.0)),
    )
    site = load_site(
        dataclasses.replace(
            jacksboro, origin=ORIGIN,
            area=dataclasses.replace(
                jacksboro.area, polygon_lon_lat_deg=None, geojson=None, polygons_lon_lat_deg=None, cell_size_m=20.0,
                polygons_east_north_m=(rings,), margin_m=60.0,
            ),
        )
    )  # fmt: skip
    drawn = shapely.Polygon(rings[0], rings[1:])
    assert area_as_drawn(site).equals(drawn)
    assert site.area.area == pytest.approx((600.0 + 120.0) * (400.0 + 120.0) - 1e4)
    coverage = judging_map(site)
    inside = photos.drawn_cells(coverage)
    assert inside.sum() * coverage.grid.size_m**2 == pytest.approx(drawn.area, rel=0.05)
    assert inside.sum() < coverage.grid.count


@pytest.mark.parametrize(("spacing_m", "holds"), [(30.0, True), (90.0, False)])
def test_a_flight_is_judged_by_its_own_pictures(spacing_m, holds):
    site = make_site(hills, sensor=dataclasses.replace(CAMERA, mount="stabilised"))
    coverage, route = judging_map(site), lines(spacing_m=spacing_m)
    track = fly_along(site, route)
    course = np.diff(track.enu_m, axis=0, append=track.enu_m[-1:])
    course[-1] = course[-2]
    yaw_deg = np.degrees(np.arctan2(course[:, 0], course[:, 1]))
    track = dataclasses.replace(track, attitude_deg=np.column_stack([np.zeros((len(track), 2)), yaw_deg]))
    verdict = verify_flight(site, coverage, [FlownTrack(track, PlannedRoute(route, 1.0))])
    flown, planned = verdict.photos, count_photos(coverage, planned_poses(coverage, [route]))
    assert flown.taken == verdict.report.pictures.taken == len(verdict.observations)
    assert abs(flown.taken - planned.taken) <= 0.02 * planned.taken
    # This track goes through every waypoint, planned pictures pass on the inside: counts differ by a picture here and there.
    assert abs(flown.photos.mean() - planned.photos.mean()) < 0.5
    assert verdict.report.pictures.overlap_holds is holds
    assert any("the required overlap, 6 photos of every point" in line for line in verdict.report.findings) != holds
    # Of a camera whose direction is not known nothing is counted.
    blind = dataclasses.replace(track, attitude_deg=np.full((len(track), 3), np.nan))
    unknown = verify_flight(site, coverage, [FlownTrack(blind, PlannedRoute(route, 1.0))])
    assert unknown.report.pictures.taken == 0
    assert unknown.report.pictures.overlap_fraction == 0.0
    # A sensor without single pictures has no such figures.
    film = with_scenario(site, sensor=dataclasses.replace(site.scenario.sensor, forward_overlap=None))
    assert verify_flight(film, judging_map(film), [FlownTrack(track, None)]).report.pictures is None


@pytest.mark.parametrize(
    ("spacing_m", "blind", "holds"), [(30.0, False, "yes"), (180.0, False, "no"), (30.0, True, "not proved")]
)
def test_an_overlap_that_is_required_decides(spacing_m, blind, holds):
    """From the ground to the ground, so that nothing else is unobserved."""
    site = make_site(hills, sensor=dataclasses.replace(CAMERA, mount="stabilised"))
    required = dataclasses.replace(site.scenario.requirements, min_overlap_fraction=0.9)
    site = with_scenario(site, requirements=required)
    route = lines(spacing_m=spacing_m)
    feet = route[[0, -1]].copy()
    feet[:, 2] = site.ground.heights_m(feet[:, :2])
    track = fly_along(site, np.vstack([feet[:1], route, feet[1:]]), first=1, count=len(route))
    course = np.diff(track.enu_m, axis=0, append=track.enu_m[-1:])
    yaw_deg = np.degrees(np.arctan2(course[:, 0], course[:, 1])) + (np.nan if blind else 0.0)
    track = dataclasses.replace(track, attitude_deg=np.column_stack([np.zeros((len(track), 2)), yaw_deg]))
    report = verify_flight(site, judging_map(site), [FlownTrack(track, PlannedRoute(route, 1.0))]).report
    said = "the required overlap, 6 photos"
    assert any(line.startswith(said) for line in report.reasons) == (holds == "no"), report.doubts
    assert any(line.startswith(said) for line in report.doubts) == (holds == "not proved")
    assert not any("overlap" in line for line in report.findings)
    (row,) = [
        row for row in requirement_rows(site.scenario, report) if row.name.startswith("Area in at least 6 photos")
    ]
    assert row.holds == holds


def test_an_overlap_is_required_of_a_camera_that_asks_for_one():
    site = make_site(hills, sensor=dataclasses.replace(CAMERA, mount="stabilised"))
    required = dataclasses.replace(site.scenario.requirements, min_overlap_fraction=0.9)
    for sensor in (
        NadirCamera(kind="nadir-camera", fov_deg=70.0, range_m=200.0),
        dataclasses.replace(CAMERA, forward_overlap=None, side_overlap=0.0),
    ):
        with pytest.raises(
            ValueError, match="min_overlap_fraction: this key requires a frame camera's forward_overlap"
        ):
            with_scenario(site, sensor=sensor, requirements=required)

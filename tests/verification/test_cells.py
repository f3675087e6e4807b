"""What is known of each cell, also by several sensors, why gaps are gaps, and several tracks as one flight."""

import dataclasses
import math

import numpy as np
import pytest

from tests.planner.sites import flat, ridge, with_scenario
from tests.verification.flights import fly_along, make_site, moved, taken
from uavcover.kernels.sight import OCCLUDED
from uavcover.model.scenario import Uncertainty
from uavcover.model.sensor import NadirCamera, SphereSensor
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.verification.flown_coverage import FlownCoverage, observed_by_any
from uavcover.verification.flown_route import PlannedRoute
from uavcover.verification.verify import FlownTrack, Verdict, verify_flight, verify_track

pytestmark = pytest.mark.usefixtures("attitudes_count")

CAMERA = NadirCamera(kind="nadir-camera", fov_deg=70.0, range_m=200.0, pixels_across=4000)
LINE = np.array([[0.0, 100.0, 80.0], [300.0, 100.0, 80.0]])
THERE_AND_BACK = np.array([[0.0, 100.0, 80.0], [300.0, 100.0, 80.0], [0.0, 100.0, 80.0]])


def verdict_on(site: Site, *paths: np.ndarray, cell_m: float = 10.0) -> Verdict:
    tracks = [FlownTrack(fly_along(site, path)) for path in paths]
    return verify_flight(site, CoverageMap(site, cell_size_m=cell_m), tracks)


def at(verdict: Verdict, east: float, north: float) -> int:
    centre = verdict.coverage.grid.cells.centre_m
    return int(np.argmin(np.hypot(centre[:, 0] - east, centre[:, 1] - north)))


def test_looks_ground_sample_and_incidence_of_cells_below_and_beside_the_track() -> None:
    verdict = verdict_on(make_site(flat, sensor=CAMERA), LINE)
    focal_px = 4000 / (2.0 * math.tan(math.radians(35.0)))
    below, beside = at(verdict, 155.0, 105.0), at(verdict, 155.0, 145.0)
    flown = verdict.flown
    assert flown.passes[below] == flown.passes[beside] == 1
    assert flown.ground_sample_m[below] == pytest.approx(80.0 / focal_px)
    assert flown.ground_sample_m[beside] == pytest.approx(80.0 / focal_px)
    assert flown.nearest_m[below] == pytest.approx(math.hypot(80.0, 5.0), rel=1e-3)
    assert flown.incidence_deg[beside] == pytest.approx(math.degrees(math.atan2(45.0, 80.0)), abs=0.1)
    cells = verdict.report.cells
    assert cells.ground_sample_median_m == pytest.approx(80.0 / focal_px)
    assert (cells.count, cells.seen) == (600, int(flown.observed.sum()))
    assert cells.looks_max == 1
    assert cells.seen_twice_fraction == 0.0


def test_flown_there_and_back_is_two_looks_but_one_near_the_turn() -> None:
    verdict = verdict_on(make_site(flat), THERE_AND_BACK)
    assert verdict.flown.passes[at(verdict, 105.0, 105.0)] == 2
    assert verdict.flown.passes[at(verdict, 295.0, 105.0)] == 1
    assert 0.3 < verdict.report.cells.seen_twice_fraction < verdict.report.coverage_fraction


def test_without_pixels_no_ground_sample_distance_is_told() -> None:
    report = verdict_on(make_site(flat), LINE).report
    assert report.cells.ground_sample_median_m is None
    assert report.cells.incidence_median_deg is not None


def test_coverage_by_time_grows_to_the_coverage() -> None:
    report = verdict_on(make_site(flat), LINE).report
    times = [moment.time_s for moment in report.coverage_by_time]
    fractions = [moment.coverage_fraction for moment in report.coverage_by_time]
    assert times[0] == 100.2  # the first sample belongs to the way to the first waypoint
    assert times[-1] == pytest.approx(130.0)
    assert fractions == sorted(fractions)
    assert 0.0 < fractions[0] < fractions[100] < fractions[-1] == pytest.approx(report.coverage_fraction, abs=1e-12)
    # Half the way shows half of the ground and half a footprint ahead.
    assert fractions[100] == pytest.approx(report.coverage_fraction * (150.0 + 50.0) / 300.0, abs=0.05)


def test_coverage_by_time_begins_at_nothing_where_nothing_is_seen_yet() -> None:
    report = verdict_on(make_site(flat), np.array([[-300.0, 100.0, 80.0], [300.0, 100.0, 80.0]])).report
    fractions = [moment.coverage_fraction for moment in report.coverage_by_time]
    assert fractions[0] == fractions[50] == 0.0
    assert fractions[-1] == pytest.approx(report.coverage_fraction, abs=1e-12)


def test_coverage_by_time_of_a_single_look_is_one_moment_and_of_none_none() -> None:
    site = make_site(flat, sensor=SphereSensor(kind="sphere", range_m=110.0))
    coverage = CoverageMap(site, cell_size_m=10.0)
    for point, moments in ((LINE[0] + [100.0, 0.0, 0.0], 1), (LINE[0] + [100.0, 90.0, 0.0], 0)):
        plan = PlannedRoute(np.array([point]), 0.1)
        report = verify_track(site, coverage, fly_along(site, LINE), plan)
        assert len(report.coverage_by_time) == moments
        assert all(m.coverage_fraction == report.coverage_fraction > 0.1 for m in report.coverage_by_time)
        assert (report.coverage_fraction == 0.0) == (moments == 0)


# Gaps and their reasons


def reasons_at(verdict: Verdict, east: float, north: float) -> tuple[str, bool]:
    cell = at(verdict, east, north)
    (region,) = [region for region in verdict.gaps if cell in region.cells]
    return region.gap.reason, region.gap.coverable


def test_a_gap_called_occluded_is_seen_when_the_occluder_is_taken_away() -> None:
    def wall(height_m: float) -> Site:
        return make_site(ridge(150.0, height_m, 10.0), limits={"max_climb_angle_deg": 85.0}, home=None)

    # 70 m high, 60 m off the track: from 80 m up the ray over its crest meets the ground far behind it.
    path = np.array([[115.0, -100.0, 80.0], [115.0, 300.0, 80.0]])
    with_wall, without = verdict_on(wall(70.0), path), verdict_on(wall(0.0), path)
    behind = at(with_wall, 165.0, 105.0)
    assert not with_wall.flown.observed[behind]
    assert reasons_at(with_wall, 165.0, 105.0) == ("occluded", True)
    assert without.flown.observed[behind]
    occluded = [gap for gap in with_wall.report.gaps if gap.reason == "occluded"]
    assert occluded
    assert not [gap for gap in without.report.gaps if gap.reason == "occluded"]


def test_a_gap_out_of_range_and_one_that_is_too_oblique() -> None:
    sensor = dataclasses.replace(CAMERA, fov_deg=120.0, max_incidence_deg=40.0)
    verdict = verdict_on(make_site(flat, sensor=sensor, ring=((0, 0), (300, 0), (300, 400), (0, 400))), LINE)
    near, far = at(verdict, 155.0, 185.0), at(verdict, 155.0, 395.0)
    assert {gap.reason for gap in verdict.report.gaps} == {"too-oblique", "never-in-range"}
    assert (verdict.flown.outcome[near], verdict.flown.outcome[far]) == (1, 0)
    # South of the track and north of it a strip that is too oblique, and what is behind the northern one.
    assert [(gap.reason, gap.north_m > 100.0) for gap in verdict.report.gaps] == [
        ("never-in-range", True), ("too-oblique", True), ("too-oblique", False),
    ]  # fmt: skip


def test_what_no_allowed_place_sees_is_out_of_limits_and_a_region_of_its_own() -> None:
    fence = ((-150.0, -50.0), (350.0, -50.0), (350.0, 100.0), (-150.0, 100.0))
    verdict = verdict_on(make_site(flat, fence=fence), np.array([[0.0, 40.0, 80.0], [300.0, 40.0, 80.0]]))
    kinds = {(gap.reason, gap.coverable) for gap in verdict.report.gaps}
    assert kinds == {("never-in-range", True), ("out-of-limits", False)}
    areas = [gap.area_m2 for gap in verdict.report.gaps]
    assert areas == sorted(areas, reverse=True)
    missing = sum(areas)
    assert missing == pytest.approx(60_000.0 * (1.0 - verdict.report.coverage_fraction))


# Uncertainty


def test_errors_make_coverage_less_sure_and_more_possible() -> None:
    exact = make_site(flat, cell_m=2.0)
    unsure = with_scenario(
        exact, uncertainty=Uncertainty(position_m=4.0, terrain_m=3.0, height_m=1.0, attitude_deg=1.0)
    )
    sharp, blurred = verdict_on(exact, LINE, cell_m=2.0).report, verdict_on(unsure, LINE, cell_m=2.0).report
    assert sharp.surely_covered_fraction == sharp.possibly_covered_fraction == sharp.coverage_fraction
    assert blurred.coverage_fraction == sharp.coverage_fraction
    # Flat ground: the strip of 2 h tan(35 deg) is narrower by about twice the errors at its edge, and as much wider.
    width = 2.0 * 80.0 * math.tan(math.radians(35.0))
    assert sharp.coverage_fraction == pytest.approx(width / 200.0, abs=0.02)
    assert 10.0 < 200.0 * (sharp.coverage_fraction - blurred.surely_covered_fraction) < 25.0
    assert 10.0 < 200.0 * (blurred.possibly_covered_fraction - sharp.coverage_fraction) < 25.0


def test_sure_coverage_can_be_required() -> None:
    site = make_site(flat, requirements={"min_coverage_of_coverable": 0.5, "min_sure_coverage_of_coverable": 0.5})
    assert verdict_on(site, LINE).report.reasons == ()
    unsure = with_scenario(site, uncertainty=Uncertainty(position_m=15.0))
    report = verdict_on(unsure, LINE).report
    assert not report.passed
    assert "sure coverage" in report.reasons[0]


def test_position_errors_also_blur_what_stands_behind_a_hill() -> None:
    # From 25 m beside the crest and 40 m above it the ray over it falls a little less steeply than the far side does.
    sensor = dataclasses.replace(CAMERA, max_incidence_deg=90.0)
    site = make_site(ridge(150.0, 40.0, 20.0), home=None, cell_m=5.0, sensor=sensor)
    path = np.array([[125.0, -100.0, 80.0], [125.0, 300.0, 80.0]])
    exact = verdict_on(site, path, cell_m=5.0)
    unsure = with_scenario(site, uncertainty=Uncertainty(height_m=8.0))
    blurred = verdict_on(unsure, path, cell_m=5.0)
    behind = blurred.coverage.grid.cells.centre_m[:, 0] > 152.0
    assert (exact.flown.outcome[behind] == OCCLUDED).sum() > 10
    assert (blurred.flown.possible_cells & behind).sum() > (exact.flown.observed & behind).sum()


# Speed


def test_speed_over_ground_is_a_requirement_with_time_and_place() -> None:
    site = make_site(flat, requirements={"min_coverage_of_coverable": 0.0, "max_ground_speed_m_s": 12.0})
    coverage = CoverageMap(site, cell_size_m=10.0)
    steady = fly_along(site, LINE, speed_m_s=12.0)
    report = verify_track(site, coverage, steady, None)
    assert report.reasons == ()
    assert report.max_ground_speed_m_s == pytest.approx(12.0, rel=1e-3)
    times = steady.time_s.copy()
    times[60:] -= 0.4 * (times[60:] - times[60])
    fast = dataclasses.replace(steady, time_s=times)
    report = verify_track(site, coverage, fast, None)
    (violation,) = report.violations
    assert (violation.kind, violation.unit, violation.limit) == ("ground-speed", "m/s", 12.0)
    assert violation.worst == pytest.approx(20.0, rel=1e-3)
    assert violation.excess == pytest.approx(8.0, rel=1e-3)
    assert violation.start_s <= violation.worst_s <= violation.end_s
    assert violation.start_s == pytest.approx(times[60], abs=0.6)
    assert "the speed over ground, 20.0 m/s, exceeds the limit of 12.0 m/s" in report.reasons


def test_deviation_is_a_violation_where_it_is_too_large() -> None:
    site = make_site(flat, requirements={"min_coverage_of_coverable": 0.0, "max_deviation_m": 5.0})
    track = fly_along(site, LINE)
    enu = track.enu_m.copy()
    enu[70:80, 1] += 9.0
    off = moved(site, dataclasses.replace(track, enu_m=enu), (0.0, 0.0, 0.0))
    report = verify_track(site, CoverageMap(site, cell_size_m=10.0), off, PlannedRoute(LINE, 1.0))
    (violation,) = report.violations
    assert (violation.kind, violation.excess) == ("deviation", pytest.approx(4.0, abs=1e-3))
    assert (violation.start_s, violation.end_s) == (track.time_s[70], track.time_s[79])
    assert violation.north_m == pytest.approx(109.0, abs=1e-3)


def test_a_violation_between_two_samples_is_placed_where_it_was_worst() -> None:
    site = make_site(ridge(150.0, 50.0, 10.0), limits={"max_climb_angle_deg": 85.0})
    track = fly_along(site, np.array([[100.0, 100.0, 80.0], [190.0, 100.0, 80.0]]), rate_hz=0.7)
    assert np.abs(track.enu_m[:, 0] - 150.0).min() > 5.0
    (violation,) = verify_track(site, CoverageMap(site, cell_size_m=20.0), track, None).violations
    assert (violation.worst, violation.excess) == (pytest.approx(30.0, abs=0.01), pytest.approx(10.0, abs=0.01))
    assert (violation.east_m, violation.north_m) == (pytest.approx(150.0, abs=0.01), pytest.approx(100.0, abs=0.01))
    assert violation.worst_s == pytest.approx(105.0, abs=0.01)
    assert site.frame is not None
    lat, lon, _ = site.frame.geodetic_from_enu([150.0, 100.0, 80.0])
    assert (violation.lat_deg, violation.lon_deg) == (pytest.approx(lat[0], abs=1e-9), pytest.approx(lon[0], abs=1e-9))


# Several tracks as one flight


def test_two_tracks_count_as_one_flight() -> None:
    site = make_site(flat, requirements={"min_coverage_of_coverable": 0.9})
    south, north = LINE - [0.0, 50.0, 0.0], LINE - [0.0, -50.0, 0.0]
    alone = [verdict_on(site, path).report for path in (south, north)]
    both = verdict_on(site, south, north).report
    # Each alone could have seen the rest where it was not observed; together nothing is missing.
    assert all(any("below the required 90.00 %" in line for line in (*r.reasons, *r.doubts)) for r in alone)
    assert both.reasons == ()
    assert not any("coverage" in doubt for doubt in both.doubts)
    assert both.coverage_fraction > max(report.coverage_fraction for report in alone) + 0.3
    assert both.samples == sum(report.samples for report in alone)
    times = [moment.time_s for moment in both.coverage_by_time]
    assert times == sorted(times)
    # The second begins 4 s after the first has ended; its last look is 29.8 s later.
    assert times[-1] - times[0] == pytest.approx(30.0 + 4.0 + 29.8)


def test_a_track_flown_twice_is_two_looks_and_names_the_track_of_each_violation() -> None:
    site = make_site(flat)
    low = LINE - [0.0, 0.0, 45.0]
    verdict = verdict_on(site, LINE, low)
    assert verdict.flown.passes[at(verdict, 155.0, 105.0)] == 2
    assert [(v.kind, v.track) for v in verdict.report.violations] == [("below-band", 1)]
    assert any(reason.startswith("track 2: violations of the limits: 1") for reason in verdict.report.reasons)


def test_the_first_track_promises_and_each_is_compared_with_its_own_plan() -> None:
    site = make_site(flat)
    coverage = CoverageMap(site, cell_size_m=10.0)
    south, north = LINE - [0.0, 50.0, 0.0], LINE - [0.0, -50.0, 0.0]
    flight = [
        FlownTrack(fly_along(site, south), PlannedRoute(south, 0.9)),
        FlownTrack(fly_along(site, north), PlannedRoute(north, 0.4)),
    ]
    report = verify_flight(site, coverage, flight).report
    assert report.planned_coverage_fraction == 0.9
    assert report.max_deviation_m == pytest.approx(0.0, abs=1e-6)


def test_an_empty_route_in_one_of_the_tracks_changes_nothing_of_the_other() -> None:
    site = make_site(flat)
    coverage = CoverageMap(site, cell_size_m=10.0)
    track = fly_along(site, LINE)
    never = taken(dataclasses.replace(track, current_waypoint=np.zeros(len(track), dtype=np.int64)), np.arange(20))
    alone = verify_flight(site, coverage, [FlownTrack(track)])
    for order in ([FlownTrack(never), FlownTrack(track)], [FlownTrack(track), FlownTrack(never)]):
        both = verify_flight(site, coverage, order)
        np.testing.assert_array_equal(both.flown.observed, alone.flown.observed)


NAN = np.nan


def of(observed: list[bool], first_s: list[float], **changes: list[float]) -> FlownCoverage:
    mask = np.array(observed)
    values = {
        "certain_cells": [False] * 4, "possible_cells": observed, "possible_by_attitude": [False] * 4, "passes": [0] * 4,
        "nearest_m": first_s, "ground_sample_m": [NAN] * 4, "incidence_deg": [NAN] * 4, "outcome": [0] * 4, **changes,
    }  # fmt: skip
    return FlownCoverage(
        observed=mask, first_observed_s=np.array(first_s), **{name: np.array(value) for name, value in values.items()}
    )


def test_a_cell_is_as_the_sensor_saw_it_that_saw_it_best() -> None:
    one = of(
        [True, True, False, False], [5.0, 9.0, NAN, NAN], certain_cells=[True, False, False, False],
        possible_by_attitude=[False, False, True, True], passes=[2, 1, 0, 0], ground_sample_m=[0.02, 0.03, NAN, NAN],
        incidence_deg=[10.0, 50.0, NAN, NAN], outcome=[4, 4, 1, 3],
    )  # fmt: skip
    other = of(
        [False, True, True, False], [NAN, 7.0, 8.0, NAN], certain_cells=[False, True, False, False], passes=[0, 3, 1, 0],
        ground_sample_m=[NAN, 0.05, NAN, NAN], incidence_deg=[NAN, 20.0, 30.0, NAN], outcome=[2, 4, 4, 2],
    )  # fmt: skip
    both = observed_by_any([one, other])
    assert both.observed.tolist() == [True, True, True, False]
    assert both.certain_cells.tolist() == [True, True, False, False]
    assert both.possible_by_attitude.tolist() == [False, False, False, True]
    np.testing.assert_array_equal(both.first_observed_s, [5.0, 7.0, 8.0, NAN])
    np.testing.assert_array_equal(both.passes, [2, 4, 1, 0])
    np.testing.assert_array_equal(both.ground_sample_m, [0.02, 0.03, NAN, NAN])
    np.testing.assert_array_equal(both.incidence_deg, [10.0, 20.0, 30.0, NAN])
    np.testing.assert_array_equal(both.outcome, [4, 4, 4, 3])
    assert observed_by_any([one]).observed.tolist() == one.observed.tolist()

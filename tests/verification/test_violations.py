"""Heights, clearance and the fence: where a flight broke its limits, when, and by how much."""

import math

import numpy as np
import pytest

from tests.planner.sites import ORIGIN, hills, ridge
from tests.verification.flights import Flight, changed, fly_along, make_site, moved, reasons, track_of
from uavcover.model.route import Route
from uavcover.model.track import Track
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.verification.verify import verify_track

pytestmark = pytest.mark.usefixtures("attitudes_count")


def lifted(flight: Flight, stretches: list[tuple[float, float, float]]) -> Track:
    """The track with the height changed by so much from one time to another."""
    enu = flight.track.enu_m.copy()
    for start_s, end_s, by_m in stretches:
        enu[(flight.track.time_s >= start_s) & (flight.track.time_s <= end_s), 2] += by_m
    return track_of(flight.site, enu, time_s=flight.track.time_s, current_waypoint=flight.track.current_waypoint)


def test_violations_are_stretches_with_worst_value_time_and_place(level: Flight) -> None:
    t = level.track.time_s
    on = np.flatnonzero(level.track.current_waypoint >= 1)
    a, b = t[on[20]], t[on[30]]
    c = t[on[50]]
    track = lifted(level, [(a, b, -45.0), (t[on[25]], t[on[25]], -7.0), (c, c, 55.0)])
    report = level.verify(track)
    assert [(v.kind, v.phase) for v in report.violations] == [("below-band", "route"), ("above-band", "route")]
    below, above = report.violations
    # A leg from good to bad belongs to both its ends: the stretch is one sample longer on both sides.
    assert (below.start_s, below.end_s) == (t[on[19]], t[on[31]])
    assert (below.worst, below.limit) == (pytest.approx(80.0 - 52.0, abs=1e-3), 40.0)
    worst = report.violations[0]
    near = track.geodetic[on[24] : on[26] + 1, :2]
    assert (np.abs(near - [worst.lat_deg, worst.lon_deg]).sum(axis=1) < 1e-12).any()
    assert above.start_s == pytest.approx(c, abs=0.3)
    assert (above.worst, above.limit) == (pytest.approx(135.0, abs=1e-3), 120.0)
    assert "violations of the limits: 2 (above-band, below-band)" in reasons(report)
    assert report.min_height_agl_m == pytest.approx(28.0, abs=1e-3)
    assert report.max_height_agl_m == pytest.approx(135.0, abs=1e-3)


def test_a_leg_through_a_hill_between_two_samples() -> None:
    # One sample every 2 s at 10 m/s: the ridge, 10 m wide, stands between two of them.
    site = make_site(
        ridge(150.0, 50.0, 10.0), limits={"max_climb_angle_deg": 85.0}, vehicle={"cruise_speed_m_s": 100.0}
    )
    points = np.array([[0.0, 100.0, 80.0], [141.0, 100.0, 80.0], [159.0, 100.0, 80.0], [300.0, 100.0, 80.0]])
    track = track_of(site, points, time_s=np.array([0.0, 1.0, 2.0, 3.0]), current_waypoint=np.array([1, 1, 1, 1]))
    coverage = CoverageMap(site, cell_size_m=20.0)
    report = verify_track(site, coverage, track, None)
    assert [(v.kind, v.worst, v.start_s, v.end_s) for v in report.violations] == [
        ("below-band", pytest.approx(30.0, abs=0.01), 1.0, 2.0)
    ]
    # Not joined, not judged: the time between is reported as not observed.
    apart = changed(track, time_s=np.array([0.0, 1.0, 31.0, 32.0]))
    report = verify_track(site, coverage, apart, None)
    assert report.violations == ()
    assert report.unobserved_s == 30.0
    (stretch,) = [stretch for stretch in report.unobserved if stretch.reason == "no samples"]
    assert stretch.detail == "30.0 s without samples"
    assert (stretch.start_s, stretch.end_s, stretch.east_m) == (1.0, 31.0, pytest.approx(141.0))
    assert stretch.length_m == pytest.approx(18.0)


def test_take_off_and_landing_are_no_violations_but_low_elsewhere_is(level: Flight) -> None:
    track = level.track
    ground = track.enu_m[:, 2] < 20.0
    assert ground[:5].all()
    assert ground[-5:].all()
    assert level.verify().violations == ()
    # The same climb 20 m beside home is none of the mission's columns; a landing there is one, and told.
    report = level.verify(moved(level.site, track, (-20.0, 0.0, 0.0)))
    (violation,) = report.violations
    assert (violation.kind, violation.phase, violation.limit) == ("clearance", "transit", 20.0)
    assert violation.worst == pytest.approx(0.0, abs=0.01)
    assert violation.start_s == track.time_s[0]
    assert any("landed 20 m from the scenario's home" in finding for finding in report.findings)


def test_transit_is_judged_by_the_clearance_itself(level: Flight) -> None:
    track = level.track
    there = np.flatnonzero((track.enu_m[:, 0] > -60) & (track.enu_m[:, 0] < -40) & (track.current_waypoint < 1))
    t = track.time_s[there]
    lowest = track.enu_m[there, 2].min()
    report = level.verify(lifted(level, [(t[0], t[-1], 20.5 - lowest)]))
    assert report.violations == ()
    report = level.verify(lifted(level, [(t[0], t[-1], 19.5 - lowest)]))
    assert {v.kind for v in report.violations} == {"clearance"}


def test_the_margin_protects_the_transit() -> None:
    flight = Flight(make_site(hills, limits={"height_margin_m": 6.0}))
    report = flight.verify(moved(flight.site, flight.track, (0.0, 0.0, -5.9)))
    assert report.violations == ()
    assert report.reasons == ()


def test_a_route_below_the_transit_clearance_is_joined_straight_above_its_ends() -> None:
    site = make_site(limits={"min_height_agl_m": 10.0, "max_height_agl_m": 40.0, "transit_clearance_m": 30.0})
    ends = [(0.0, 50.0, 15.0), (300.0, 50.0, 15.0)]
    flight = Flight(site, Route(np.array(ends)))
    assert flight.verify().violations == ()
    enu = flight.track.enu_m.copy()
    low = (enu[:, 0] > -50) & (enu[:, 0] < -40)
    enu[low, 2] = 15.0
    report = flight.verify(
        track_of(site, enu, time_s=flight.track.time_s, current_waypoint=flight.track.current_waypoint)
    )
    assert {v.kind for v in report.violations} == {"clearance"}


def test_sea_level_limits() -> None:
    limits = {"min_alt_amsl_m": ORIGIN.alt_amsl_m + 70.0, "max_alt_amsl_m": ORIGIN.alt_amsl_m + 90.0}
    limits["max_transit_height_agl_m"] = 500.0
    flight = Flight(make_site(limits=limits))
    assert flight.verify().violations == ()  # the lower one speaks of the route alone
    t = flight.track.time_s
    on = np.flatnonzero(flight.track.current_waypoint >= 1)
    report = flight.verify(
        lifted(flight, [(t[on[5]], t[on[9]], -12.0), (t[on[20]], t[on[22]], 15.0), (t[20], t[20], 200.0)])
    )
    kinds = [(v.kind, v.phase) for v in report.violations]
    assert kinds == [
        ("above-sea-level-limit", "transit"), ("below-sea-level-limit", "route"), ("above-sea-level-limit", "route"),
    ]  # fmt: skip
    assert report.violations[1].worst == pytest.approx(ORIGIN.alt_amsl_m + 68.0, abs=0.01)
    assert (report.violations[1].start_s, report.violations[1].end_s) == (t[on[5]], t[on[9]])


def test_the_fence_at_samples_and_between_them() -> None:
    bay = (
        (-150.0, -50.0),
        (400.0, -50.0),
        (400.0, 250.0),
        (160.0, 250.0),
        (150.0, 0.0),
        (140.0, 250.0),
        (-150.0, 250.0),
    )
    site = make_site(fence=bay)
    coverage = CoverageMap(site, cell_size_m=50.0)
    points = np.array([[105.0, 200.0, 80.0], [135.0, 200.0, 80.0], [165.0, 200.0, 80.0], [195.0, 200.0, 80.0]])
    time_s = 2.0 * np.arange(4.0)
    track = track_of(site, points, time_s=time_s, current_waypoint=np.array([1, 1, 1, 1]))
    (violation,) = verify_track(site, coverage, track, None).violations
    assert (violation.kind, violation.start_s, violation.end_s) == ("fence", 2.0, 4.0)
    # 200 m up the bay, 8 m to its side, which leans 10 m in 250.
    assert violation.worst == pytest.approx(8.0 * 250.0 / math.hypot(250.0, 10.0), abs=0.15)
    outside = track_of(site, points + np.array([0, 90, 0]), time_s=time_s, current_waypoint=np.array([1, 1, -1, -1]))
    found = [(v.phase, v.worst) for v in verify_track(site, coverage, outside, None).violations if v.kind == "fence"]
    assert found == [("route", pytest.approx(40.0)), ("transit", pytest.approx(40.0))]


def test_a_leg_across_a_bay_concerns_the_two_samples_at_its_ends() -> None:
    bay = (
        (-150.0, -50.0), (400.0, -50.0), (400.0, 250.0), (160.0, 250.0), (150.0, 0.0), (140.0, 250.0), (-150.0, 250.0),
    )  # fmt: skip
    site = make_site(fence=bay)
    # Samples 28 m apart, at 136 m and 164 m on both sides of the bay.
    track = fly_along(site, np.array([[24.0, 200.0, 80.0], [304.0, 200.0, 80.0]]), speed_m_s=20.0, rate_hz=20.0 / 28.0)
    (violation,) = verify_track(site, CoverageMap(site, cell_size_m=50.0), track, None).violations
    before, after = np.flatnonzero((track.enu_m[:, 0] > 130.0) & (track.enu_m[:, 0] < 170.0))
    assert (violation.kind, violation.start_s, violation.end_s) == ("fence", track.time_s[before], track.time_s[after])


def test_ground_that_is_not_known_is_not_called_safe() -> None:
    site = make_site(lambda e, n: np.where((e > 315) & (e < 355), np.nan, 0.0 * n))
    track = fly_along(site, np.array([[0.0, 100.0, 80.0], [400.0, 100.0, 80.0]]))
    report = verify_track(site, CoverageMap(site, cell_size_m=20.0), track, None)
    assert "no elevation data below" in reasons(report)
    assert report.min_height_agl_m == pytest.approx(80.0, abs=0.05)

import itertools
import math

import numpy as np
import pytest

from tests.planning.sites import ORIGIN, flat, hills, ridge
from tests.verification.flights import changed, fly_along, make_site, moved, taken, track_of
from uavcover.coverage.coverage_map import CoverageMap
from uavcover.errors import TrackError
from uavcover.mission_compiler import compile_mission
from uavcover.model.report import VerificationReport
from uavcover.model.route import Route
from uavcover.model.sensor import SphereSensor
from uavcover.model.track import Track
from uavcover.planning.swaths import fly_layout, regular_layout
from uavcover.site import Site
from uavcover.verification.phases import PlannedRoute, observed_stretches, on_route
from uavcover.verification.verify import flown_coverage, verify_track


class Flight:
    """A site, a plan for it, and a perfect flight of the compiled mission, take-off and landing included."""

    def __init__(self, site: Site, route: Route | None = None) -> None:
        self.site = site
        self.coverage = CoverageMap(site, cell_size_m=10.0)
        layout = regular_layout(angle_rad=0.0, lines=3, height_agl_m=80.0, inset=0.0, tolerance_m=10.0)
        route = fly_layout(site, layout) if route is None else route
        compiled = compile_mission(site, route, autopilot="ardupilot")
        self.seen = self.coverage.seen(route.waypoints_m)
        self.planned = PlannedRoute(route.waypoints_m, self.coverage.share(self.seen))
        assert site.home_m is not None
        path = np.vstack([site.home_m, compiled.path_m, site.home_m])
        self.track = fly_along(site, path, first=compiled.first_waypoint_item, count=len(route))

    def verify(self, track: Track | None = None, *, with_plan: bool = True) -> VerificationReport:
        return verify_track(
            self.site, self.coverage, self.track if track is None else track, self.planned if with_plan else None
        )

    def without_waypoints(self) -> Track:
        return changed(self.track, current_waypoint=np.full(len(self.track), -1, dtype=np.int64))


@pytest.fixture(scope="module")
def hilly() -> Flight:
    return Flight(make_site(hills))


@pytest.fixture(scope="module")
def level() -> Flight:
    return Flight(make_site(flat))


def reasons(report: VerificationReport) -> str:
    assert not report.passed
    return "; ".join(report.reasons + report.doubts)


def test_a_perfect_flight_passes(hilly: Flight) -> None:
    report = hilly.verify()
    assert report.passed
    assert report.reasons == ()
    assert report.violations == ()
    assert report.planned_coverage_fraction == hilly.planned.coverage_fraction
    assert report.coverage_fraction == pytest.approx(hilly.planned.coverage_fraction, abs=0.005)
    assert report.max_deviation_m == pytest.approx(0.0, abs=1e-6)
    assert report.unobserved_s == 0.0
    assert report.samples == len(hilly.track)
    assert report.min_height_agl_m is not None
    assert report.max_height_agl_m is not None
    assert 40.0 <= report.min_height_agl_m < 80.0 < report.max_height_agl_m <= 120.0
    assert report.min_transit_clearance_m is not None
    assert report.min_transit_clearance_m >= 20.0


@pytest.mark.parametrize("which", ["both", "geodetic", "local"])
@pytest.mark.parametrize("by", [(200.0, 0.0, 0.0), (0.0, -200.0, 0.0)])
def test_the_same_track_200_m_away_fails(hilly: Flight, which: str, by: tuple[float, float, float]) -> None:
    report = hilly.verify(moved(hilly.site, hilly.track, by, which=which))
    text = reasons(report)
    assert ("contradicts itself" in text) == (which != "both")
    if which == "local":  # the latitudes and longitudes are still those of a good flight, which is what is judged
        assert report.coverage_fraction == pytest.approx(hilly.planned.coverage_fraction, abs=0.005)
        assert "by up to 200.0 m" in text
    else:
        assert "is below the required" in text
        assert report.max_deviation_m == pytest.approx(200.0, rel=0.01)
        assert report.gaps


def test_longitude_and_latitude_swapped(hilly: Flight) -> None:
    swapped = changed(hilly.track, geodetic=hilly.track.geodetic[:, [1, 0, 2]].copy())
    text = reasons(hilly.verify(swapped))
    assert "contradicts itself" in text
    assert "latitude and longitude may be swapped" in text
    assert hilly.verify(swapped).coverage_fraction == 0.0


def test_a_position_that_is_no_place(hilly: Flight) -> None:
    geodetic = hilly.track.geodetic.copy()
    geodetic[7, 0] = np.nan
    with pytest.raises(TrackError, match=r"sample 7 of the track, at .* is no place on Earth"):
        hilly.verify(changed(hilly.track, geodetic=geodetic))


def test_an_empty_track(hilly: Flight) -> None:
    with pytest.raises(TrackError, match="no samples"):
        hilly.verify(taken(hilly.track, np.zeros(0, dtype=int)))


def test_a_small_contradiction_is_no_reason(hilly: Flight) -> None:
    assert hilly.verify(moved(hilly.site, hilly.track, (0.0, 0.0, 0.9), which="local")).passed
    assert "by up to 1.1 m" in reasons(hilly.verify(moved(hilly.site, hilly.track, (0.0, 0.0, 1.1), which="local")))


# Heights


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
    assert "2 violations of the limits (above-band, below-band)" in reasons(report)
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
    points = np.array([[0.0, 200.0, 80.0], [135.0, 200.0, 80.0], [165.0, 200.0, 80.0], [300.0, 200.0, 80.0]])
    track = track_of(site, points, time_s=np.arange(4.0), current_waypoint=np.array([1, 1, 1, 1]))
    (violation,) = verify_track(site, coverage, track, None).violations
    assert (violation.kind, violation.start_s, violation.end_s) == ("fence", 1.0, 2.0)
    # 200 m up the bay, 8 m to its side, which leans 10 m in 250.
    assert violation.worst == pytest.approx(8.0 * 250.0 / math.hypot(250.0, 10.0), abs=0.15)
    outside = track_of(
        site, points + np.array([0, 90, 0]), time_s=np.arange(4.0), current_waypoint=np.array([1, 1, -1, -1])
    )
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
    assert "no elevation data under" in reasons(report)
    assert report.min_height_agl_m == pytest.approx(80.0, abs=0.05)


# Coverage, and what was not observed


def test_a_gap_in_time_is_not_joined(level: Flight) -> None:
    t = level.track.time_s
    on = np.flatnonzero(level.track.current_waypoint >= 1)
    missing = slice(on[60], on[130])
    keep = np.ones(len(t), dtype=bool)
    keep[missing] = False
    report, whole = level.verify(taken(level.track, keep)), level.verify()
    assert report.unobserved_s == pytest.approx(t[on[130]] - t[on[59]])
    assert report.coverage_fraction < whole.coverage_fraction - 0.02
    assert len(report.gaps) > len(whole.gaps)
    # Thinned to one sample in two seconds it is still joined.
    thin = taken(level.track, np.arange(0, len(t), 10))
    assert level.verify(thin).unobserved_s == 0.0
    assert level.verify(thin).coverage_fraction == pytest.approx(whole.coverage_fraction, abs=0.02)


def test_gaps_are_grouped_with_area_and_middle(level: Flight) -> None:
    # Without the middle and the last line two parts of the area stay unseen.
    line_1 = track_of(
        level.site, np.array([[150.0, 100.0, 80.0], [152.0, 100.0, 80.0]]),
        time_s=np.array([0.0, 1.0]), current_waypoint=np.array([1, 1]),
    )  # fmt: skip
    report = level.verify(line_1)
    (gap,) = report.gaps  # all around one footprint
    assert gap.area_m2 == pytest.approx(300 * 200 * (1.0 - report.coverage_fraction))
    assert gap.cells == round(gap.area_m2 / 100.0)
    assert (gap.east_m, gap.north_m) == (pytest.approx(150.0, abs=1.0), pytest.approx(100.0, abs=0.1))
    assert level.site.frame is not None
    lat, lon, _ = level.site.frame.geodetic_from_enu([gap.east_m, gap.north_m, 0.0])
    assert (gap.lat_deg, gap.lon_deg) == (pytest.approx(lat[0]), pytest.approx(lon[0]))
    across = fly_along(level.site, np.array([[130.0, 0.0, 80.0], [130.0, 200.0, 80.0]]), first=0)
    both = level.verify(across)
    assert len(both.gaps) == 2
    assert both.gaps[0].area_m2 > both.gaps[1].area_m2
    assert both.gaps[0].east_m > 130.0 > both.gaps[1].east_m


def test_nothing_seen_before_the_route_counts(level: Flight) -> None:
    only_there = taken(level.track, np.flatnonzero(level.track.current_waypoint <= 0)[:60])
    report = level.verify(only_there)
    assert report.coverage_fraction == 0.0
    assert report.min_height_agl_m is None
    assert report.max_deviation_m is None


def test_first_seen_is_the_time_of_the_flight(level: Flight) -> None:
    flown = flown_coverage(level.coverage, level.track, level.planned)
    on = level.track.time_s[level.track.current_waypoint >= 1]
    assert np.isnan(flown.first_seen_s[~flown.seen]).all()
    times = flown.first_seen_s[flown.seen]
    assert times.min() == on[0]
    assert times.max() <= on[-1]
    # A cell under the second line cannot be seen before the vehicle gets there.
    cell = int(np.argmin(np.linalg.norm(level.coverage.grid.cells.centre_m[:, :2] - [295.0, 195.0], axis=1)))
    nearest = level.track.time_s[np.argmin(np.linalg.norm(level.track.enu_m[:, :2] - [295.0, 167.0], axis=1))]
    assert flown.first_seen_s[cell] == pytest.approx(nearest, abs=8.0)


def naive_seen(flight: Flight, track: Track) -> np.ndarray:
    """Coverage of a track, cell by cell and look by look, flat ground and a cone: no kernel of ours."""
    tan_half = math.tan(math.radians(35.0))
    looks = []
    rows = [k for k in range(len(track)) if track.current_waypoint[k] >= 1]
    for a, b in itertools.pairwise(rows):
        if track.time_s[b] - track.time_s[a] <= 2.0:
            pieces = max(1, math.ceil(float(np.linalg.norm(track.enu_m[b] - track.enu_m[a])) / 10.0 - 1e-9))
            looks += [track.enu_m[a] + k / pieces * (track.enu_m[b] - track.enu_m[a]) for k in range(pieces + 1)]
    seen = []
    for east, north, up in flight.coverage.grid.cells.centre_m:
        hit = False
        for look in looks:
            height = look[2] - up
            across = math.hypot(look[0] - east, look[1] - north)
            slant = math.hypot(across, height)
            hit = hit or (
                across <= height * tan_half and slant <= 200.0 and height / slant >= math.cos(math.radians(75.0))
            )
        seen.append(hit)
    return np.array(seen)


def test_coverage_equals_its_naive_twin(level: Flight) -> None:
    keep = np.ones(len(level.track), dtype=bool)
    keep[np.flatnonzero(level.track.current_waypoint >= 1)[20:190]] = False
    track = taken(level.track, keep)
    flown = flown_coverage(level.coverage, track, level.planned)
    expected = naive_seen(level, track)
    assert 0.3 < expected.mean() < 1.0
    np.testing.assert_array_equal(flown.seen, expected)


# Which part is the route


def test_without_waypoint_numbers_the_places_decide(hilly: Flight) -> None:
    report, whole = hilly.verify(hilly.without_waypoints()), hilly.verify()
    assert report.passed
    assert report.violations == ()
    assert report.coverage_fraction == pytest.approx(whole.coverage_fraction, abs=1e-3)
    assert report.max_deviation_m is not None
    assert report.max_deviation_m < 2.0  # the sample nearest the first waypoint may be the one before it, 2 m apart


def test_the_places_decide_also_when_the_way_home_passes_over_the_first_waypoint() -> None:
    flight = Flight(make_site(), Route(np.array([[0.0, 50, 80], [300, 50, 80], [300, 150, 80], [200, 50, 80]])))
    route = on_route(flight.without_waypoints(), flight.track.enu_m, flight.planned, acceptance_radius_m=3.0)
    told = on_route(flight.track, flight.track.enu_m, flight.planned, acceptance_radius_m=3.0)
    assert route.sum() == pytest.approx(told.sum(), abs=2)
    assert (route & told).sum() >= told.sum() - 1


def test_without_a_plan_and_without_numbers_everything_counts(level: Flight) -> None:
    report = level.verify(level.without_waypoints(), with_plan=False)
    assert report.planned_coverage_fraction is None
    assert report.max_deviation_m is None
    assert {v.kind for v in report.violations} == {"below-band"}  # take-off, transit and landing are below the band
    assert level.verify(with_plan=False).passed


def test_a_flight_that_never_reached_the_first_waypoint_has_no_route(level: Flight) -> None:
    track = taken(level.track, np.flatnonzero(level.track.current_waypoint == 0))
    route = on_route(track, track.enu_m, level.planned, acceptance_radius_m=3.0)
    assert not route.any()
    assert level.verify(track).violations == ()


def test_a_plan_of_one_waypoint_is_passed_once() -> None:
    flight = Flight(make_site(), Route(np.array([[100.0, 50.0, 80.0]])))
    assert (flight.track.current_waypoint == 0).any()
    route = on_route(flight.track, flight.track.enu_m, flight.planned, acceptance_radius_m=3.0)
    assert 1 <= route.sum() <= 3
    assert flight.verify().coverage_fraction == pytest.approx(flight.planned.coverage_fraction, abs=0.02)


def test_stretches_break_at_phases_and_at_gaps() -> None:
    joined = np.array([True, True, False, True, True, True, True])
    mask = np.array([False, True, True, True, False, True, True, False])
    runs = observed_stretches(mask, joined)
    assert [run.tolist() for run in runs] == [[1, 2], [3], [5, 6]]
    assert observed_stretches(np.zeros(8, dtype=bool), joined) == []


# Sensors that look from waypoints; requirements; sites without a place on Earth


def test_a_sensor_that_looks_from_waypoints_counts_those_that_were_reached() -> None:
    sphere = SphereSensor(kind="sphere", range_m=110.0)
    points = np.array([[50.0, 50, 80], [250, 50, 80], [250, 150, 80], [50, 150, 80]])
    flight = Flight(make_site(sensor=sphere), Route(points))
    report = flight.verify()
    assert report.coverage_fraction == pytest.approx(flight.planned.coverage_fraction, abs=0.02)
    enu = flight.track.enu_m.copy()
    near = np.hypot(enu[:, 0] - 250, enu[:, 1] - 150) < 20
    enu[near, 2] += 10.0  # over the third waypoint too high: not reached within twice the 3 m
    missed = flight.verify(
        track_of(flight.site, enu, time_s=flight.track.time_s, current_waypoint=flight.track.current_waypoint)
    )
    assert missed.coverage_fraction < report.coverage_fraction - 0.05
    with pytest.raises(TrackError, match=r"without plan\.json"):
        flight.verify(with_plan=False)
    far = moved(flight.site, flight.track, (0.0, 0.0, 300.0))
    assert flight.verify(far).coverage_fraction == 0.0


def test_a_required_deviation(level: Flight) -> None:
    strict = Flight(make_site(flat, requirements={"max_deviation_m": 4.0, "min_coverage_of_coverable": 0.5}))
    assert strict.verify(moved(strict.site, strict.track, (0.0, 3.0, 0.0))).passed
    assert "the deviation from the planned route, 5.0 m, is above 4.0 m" in reasons(
        strict.verify(moved(strict.site, strict.track, (0.0, 5.0, 0.0)))
    )
    assert "unknown" in reasons(strict.verify(with_plan=False))
    assert level.verify(moved(level.site, level.track, (0.0, 5.0, 0.0))).max_deviation_m == pytest.approx(5.0, abs=0.01)


def test_a_site_without_a_place_on_earth_uses_the_local_columns() -> None:
    site = make_site(on_earth=False, home=None)
    path = np.array([[0.0, 30, 80], [300, 30, 80], [300, 100, 80], [0, 100, 80], [0, 170, 80], [300, 170, 80]])
    report = verify_track(site, CoverageMap(site, cell_size_m=20.0), fly_along(site, path), None)
    assert report.coverage_fraction > 0.9
    assert all(math.isnan(gap.lat_deg) for gap in report.gaps)

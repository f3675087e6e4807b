import itertools
import math

import numpy as np
import pytest

from tests.planner.sites import flat
from tests.verification.flights import Flight, changed, fly_along, make_site, moved, reasons, taken, track_of
from uavcover.errors import TrackError
from uavcover.model.route import Route
from uavcover.model.sensor import SphereSensor
from uavcover.model.track import Track
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.verification.flown_route import observed_stretches, on_route
from uavcover.verification.verify import flown_coverage, verify_track

pytestmark = pytest.mark.usefixtures("attitudes_count")


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
    with pytest.raises(TrackError, match=r"sample 7 of the track, at .* is not a position on Earth"):
        hilly.verify(changed(hilly.track, geodetic=geodetic))


def test_an_empty_track(hilly: Flight) -> None:
    with pytest.raises(TrackError, match="no samples"):
        hilly.verify(taken(hilly.track, np.zeros(0, dtype=int)))


def test_a_small_contradiction_is_no_reason(hilly: Flight) -> None:
    assert hilly.verify(moved(hilly.site, hilly.track, (0.0, 0.0, 0.9), which="local")).passed
    assert "by up to 1.1 m" in reasons(hilly.verify(moved(hilly.site, hilly.track, (0.0, 0.0, 1.1), which="local")))


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
    assert np.isnan(flown.first_observed_s[~flown.observed]).all()
    times = flown.first_observed_s[flown.observed]
    assert times.min() == on[0]
    assert times.max() <= on[-1]
    # A cell under the second line cannot be seen before the vehicle gets there.
    cell = int(np.argmin(np.linalg.norm(level.coverage.grid.cells.centre_m[:, :2] - [295.0, 195.0], axis=1)))
    nearest = level.track.time_s[np.argmin(np.linalg.norm(level.track.enu_m[:, :2] - [295.0, 167.0], axis=1))]
    assert flown.first_observed_s[cell] == pytest.approx(nearest, abs=8.0)


def naive_observed(flight: Flight, track: Track) -> np.ndarray:
    """Coverage of a track, cell by cell and place by place, flat ground and a cone: no kernel of ours."""
    tan_half = math.tan(math.radians(35.0))
    positions = []
    rows = [k for k in range(len(track)) if track.current_waypoint[k] >= 1]
    for a, b in itertools.pairwise(rows):
        if track.time_s[b] - track.time_s[a] <= 2.0:
            pieces = max(1, math.ceil(float(np.linalg.norm(track.enu_m[b] - track.enu_m[a])) / 10.0 - 1e-9))
            positions += [track.enu_m[a] + k / pieces * (track.enu_m[b] - track.enu_m[a]) for k in range(pieces + 1)]
    observed = []
    for east, north, up in flight.coverage.grid.cells.centre_m:
        hit = False
        for position in positions:
            height = position[2] - up
            across = math.hypot(position[0] - east, position[1] - north)
            slant = math.hypot(across, height)
            hit = hit or (
                across <= height * tan_half and slant <= 200.0 and height / slant >= math.cos(math.radians(75.0))
            )
        observed.append(hit)
    return np.array(observed)


def test_coverage_equals_its_naive_twin(level: Flight) -> None:
    keep = np.ones(len(level.track), dtype=bool)
    keep[np.flatnonzero(level.track.current_waypoint >= 1)[20:190]] = False
    track = taken(level.track, keep)
    flown = flown_coverage(level.coverage, track, level.planned)
    expected = naive_observed(level, track)
    assert 0.3 < expected.mean() < 1.0
    np.testing.assert_array_equal(flown.observed, expected)


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
    reported = on_route(flight.track, flight.track.enu_m, flight.planned, acceptance_radius_m=3.0)
    assert route.sum() == pytest.approx(reported.sum(), abs=2)
    assert (route & reported).sum() >= reported.sum() - 1


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


# Sensors that look from waypoints; requirements; sites without a position on Earth


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
    assert "the deviation from the planned route, 5.0 m, exceeds the limit of 4.0 m" in reasons(
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

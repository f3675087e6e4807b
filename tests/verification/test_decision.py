"""Passed, failed or not proved: how much was not observed, where, and what it may have seen."""

import re

import numpy as np
import pytest

from tests.planner.sites import with_scenario
from tests.verification.flights import Flight, changed, fly_along, make_site, taken
from uavcover.model.route import Route
from uavcover.model.scenario import Requirements
from uavcover.model.sensor import SphereSensor
from uavcover.model.track import Track
from uavcover.model.verdict import VerificationReport
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.verification.decision import judged_requirements
from uavcover.verification.verify import verify_track

pytestmark = pytest.mark.usefixtures("attitudes_count")

LINE = np.array([[0.0, 100.0, 80.0], [300.0, 100.0, 80.0]])


def judged(flight: Flight, track: Track, **requirements: float) -> VerificationReport:
    """The verdict under other requirements."""
    site = with_scenario(flight.site, requirements=Requirements(**requirements))
    return verify_track(site, CoverageMap(site, cell_size_m=10.0), track, flight.planned)


def without(track: Track, first: int, seconds: float) -> Track:
    """The track without the samples between one and the one so many seconds later."""
    later = int(np.searchsorted(track.time_s, track.time_s[first] + seconds - 1e-6))
    return taken(track, np.r_[: first + 1, later : len(track)])


def on_route(track: Track) -> np.ndarray:
    return np.flatnonzero(track.current_waypoint >= 1)


# How much of the time


def test_the_share_of_the_routes_time_that_was_not_observed(flight: Flight) -> None:
    on = on_route(flight.track)
    whole_s = float(flight.track.time_s[on[-1]] - flight.track.time_s[on[0]])
    track = without(without(flight.track, int(on[50]), 3.0), int(on[20]), 4.0)
    fraction = 7.0 / whole_s
    for most, verdict in ((fraction * 1.02, "passed"), (fraction * 0.98, "not proved")):
        report = judged(flight, track, max_unobserved_fraction=most, min_coverage_of_coverable=0.5)
        assert report.unobserved_route_fraction == pytest.approx(fraction, rel=1e-3)
        assert (report.verdict, report.unobserved_s) == (verdict, pytest.approx(7.0))
    (doubt,) = report.doubts
    assert doubt.startswith(
        f"{100 * fraction:.1f} % of the time on the route was not observed; the limit is {98 * fraction:g} %; "
    )
    assert f"longest of 2 such intervals: 4.0 s, from {track.time_s[on[20]]:.1f} s at " in doubt


def test_what_was_before_and_after_the_track_is_no_stretch_of_its_time(flight: Flight) -> None:
    on = on_route(flight.track)
    track = without(taken(flight.track, np.arange(on[-20])), int(on[50]), 9.0)
    (doubt,) = [doubt for doubt in judged(flight, track).doubts if "of the time on the route" in doubt]
    assert "longest of 1 such intervals: 9.0 s" in doubt


def test_a_route_of_a_moment_has_a_share_too_and_no_route_none() -> None:
    site = make_site()
    coverage = CoverageMap(site, cell_size_m=20.0)
    track = fly_along(site, LINE)
    for numbers, fraction in ((np.r_[[0] * 50, [1] * 3, [-1] * (len(track) - 53)], 0.0), (np.zeros(len(track)), None)):
        reported = changed(track, current_waypoint=numbers.astype(np.int64))
        assert verify_track(site, coverage, reported, None).unobserved_route_fraction == fraction


def test_without_ways_there_and_home_nothing_of_them_is_missing() -> None:
    site = make_site()
    track = fly_along(site, LINE)
    track = changed(track, current_waypoint=np.ones(len(track), dtype=np.int64))
    report = verify_track(site, CoverageMap(site, cell_size_m=20.0), track, None)
    assert not any("return transits" in doubt for doubt in report.doubts)


def test_of_the_ways_there_and_home_a_fifth_may_be_missing(flight: Flight) -> None:
    track, first = flight.track, int(on_route(flight.track)[0])
    transit_s = float(track.time_s[-1] - track.time_s[0] - (track.time_s[on_route(track)[-1]] - track.time_s[first]))
    for fraction, proved in ((0.18, True), (0.23, False)):
        # In pieces, each of which is short enough.
        gapped, pieces = track, int(np.ceil(fraction * transit_s / 4.0))
        for piece in range(pieces):
            gapped = without(gapped, int(on_route(track)[-1]) + 10 + 8 * piece, fraction * transit_s / pieces)
        report = judged(flight, gapped)
        paths = [doubt for doubt in report.doubts if "of the outbound and return transits was not observed" in doubt]
        assert len(paths) == (0 if proved else 1)
        if not proved:
            assert paths[0].startswith(("23 %", "24 %"))
            assert "of the outbound and return transits was not observed; the limit is 20 %; " in paths[0]
            assert f"longest of {pieces} such intervals" in paths[0]


# Single gaps


@pytest.mark.parametrize(("seconds", "proved"), [(10.0, True), (10.2, False)])
def test_a_single_gap_may_last_10_s(flight: Flight, seconds: float, proved: bool) -> None:
    track = without(flight.track, int(on_route(flight.track)[20]), seconds)
    report = judged(flight, track, max_unobserved_fraction=0.5, min_coverage_of_coverable=0.5)
    assert report.verdict == ("passed" if proved else "not proved")
    if not proved:
        (doubt,) = report.doubts
        assert doubt.startswith("the flight was unobserved for 10.2 s, from ")
        assert doubt.endswith("(10.2 s without samples); the limit is 10 s")


def test_three_gaps_are_told_and_the_others_counted(flight: Flight) -> None:
    on, track = on_route(flight.track), flight.track
    for number, more in (
        (3, None),
        (4, "1 more unobserved intervals exceed the limit"),
        (5, "2 more unobserved intervals exceed the limit"),
    ):
        gapped = track
        for k in reversed(range(number)):
            gapped = without(gapped, int(on[10 + 62 * k]), 11.0)
        report = judged(flight, gapped, max_unobserved_fraction=0.9, min_coverage_of_coverable=0.1)
        long = [doubt for doubt in report.doubts if "the limit is 10 s" in doubt]
        assert len(long) == 3
        assert [doubt for doubt in report.doubts if "more unobserved intervals" in doubt] == (
            [] if more is None else [more]
        )


def test_before_take_off_and_after_landing_nobody_looks(flight: Flight) -> None:
    track = flight.track
    times = track.time_s.copy()
    times[1:] += 60.0
    times[-1] += 60.0
    report = judged(flight, changed(track, time_s=times))
    assert report.verdict == "passed"
    assert report.unobserved_s == 0.0
    assert [stretch.in_flight for stretch in report.unobserved] == [False, False]


# Coverage


def test_coverage_below_what_is_required_fails_unless_what_was_not_observed_may_make_up_for_it() -> None:
    sensor = SphereSensor(kind="sphere", range_m=110.0, sensing="along-path")
    flight = Flight(make_site(sensor=sensor), Route(LINE))
    whole = judged(flight, flight.track, min_coverage_of_coverable=0.1)
    fraction = whole.coverage_of_coverable
    for wanted, verdict in ((fraction, "passed"), (fraction + 0.001, "failed")):
        report = judged(flight, flight.track, min_coverage_of_coverable=wanted)
        assert report.verdict == verdict
    assert report.reasons[0].startswith(f"coverage {100 * fraction:.2f} % of the visible ground is below the required")
    # A share that lacks next to nothing does not read as the one that it lacks.
    nearly = judged(flight, flight.track, min_coverage_of_coverable=fraction + 1e-6).reasons[0]
    assert len(set(re.findall(r"[\d.]+ %", nearly))) == 2
    gapped = without(flight.track, int(on_route(flight.track)[30]), 9.5)
    less = judged(flight, gapped, min_coverage_of_coverable=0.1, max_unobserved_fraction=0.5).coverage_of_coverable
    assert less < fraction - 0.01
    for wanted, verdict in ((0.5 * (less + fraction), "not proved"), (0.95, "failed")):
        report = judged(flight, gapped, min_coverage_of_coverable=wanted, max_unobserved_fraction=0.5)
        assert report.verdict == verdict
        text = (report.doubts if verdict == "not proved" else report.reasons)[0]
        assert text.startswith(
            f"coverage {100 * less:.2f} % of the visible ground is below the required {100 * wanted:.2f} %"
        )
        assert ("unobserved intervals could increase it" in text) == (verdict == "not proved")


# What was judged


def test_the_requirements_and_limits_that_were_judged_are_named(flight: Flight) -> None:
    reported = judged_requirements(flight.site.scenario)
    assert reported["max_gap_s"] == 2.0
    assert reported["min_height_agl_m"] == 40.0
    assert reported["max_transit_height_agl_m"] == 150.0
    assert not any(name.startswith("fence_") for name in reported)

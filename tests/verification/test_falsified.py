"""What cannot have been flown is never passed; what was flown is, in wind, with errors of the positions, at any rate."""

from dataclasses import replace

import numpy as np
import pytest

from tests.planner.sites import hills, make_site, with_scenario
from tests.verification import falsified
from tests.verification.falsified import Falsify
from tests.verification.honest import Weather, flown_by_the_mock
from uavcover.model.track import Track
from uavcover.model.verdict import VerificationReport
from uavcover.planner.baselines.boustrophedon import fly_layout, regular_layout
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.verification.flown_route import PlannedRoute
from uavcover.verification.judged_track import judge_track
from uavcover.verification.verify import verify_track

SEEDS = range(4)


class Field:
    """A site over hills, its plan, and how the mock vehicle flew it in some weather."""

    def __init__(self) -> None:
        self.site = make_site(hills, limits={"height_margin_m": 5.0, "transit_clearance_m": 30.0})
        layout = regular_layout(angle_rad=0.0, lines=3, height_agl_m=80.0, inset=0.0, tolerance_m=10.0)
        self.route = fly_layout(self.site, layout)
        self.coverage = CoverageMap(self.site, cell_size_m=10.0)
        fraction = self.coverage.fraction(self.coverage.observed(self.route.waypoints_m))
        self.planned = PlannedRoute(self.route.waypoints_m, fraction)
        self.flights = {
            "calm": flown_by_the_mock(self.site, self.route),
            "windy": flown_by_the_mock(self.site, self.route, Weather(wind_m_s=10.0, gust_m_s=3.0, gps_m=0.7, seed=5)),
            "px4": flown_by_the_mock(self.site, self.route, Weather(wind_m_s=5.0, seed=2), autopilot="px4"),
        }

    def verify(self, track: Track, site: Site | None = None) -> VerificationReport:
        coverage = self.coverage if site is None else CoverageMap(site, cell_size_m=10.0)
        return verify_track(coverage.site, coverage, track, self.planned)


@pytest.fixture(scope="module")
def field() -> Field:
    return Field()


FLIGHTS = ("calm", "windy", "px4")


def without_numbers(track: Track) -> Track:
    """As another program's log has it."""
    return replace(track, current_waypoint=np.full(len(track), -1, dtype=np.int64))


@pytest.mark.thinned(2)
@pytest.mark.parametrize("name", FLIGHTS)
@pytest.mark.parametrize("foreign", [False, True])
@pytest.mark.parametrize("every", [1, 2, 5, 10])
def test_an_honest_flight_passes_at_any_rate(field: Field, name: str, foreign: bool, every: int) -> None:
    track = field.flights[name]
    track = without_numbers(track) if foreign else track
    report = field.verify(track.taken(np.arange(0, len(track), every)))
    assert report.verdict == "passed", (report.reasons, report.doubts)
    assert report.findings == ()
    assert report.unobserved == ()


@pytest.mark.parametrize("noise_m", [0.15, 0.3, 1.0])
@pytest.mark.parametrize("name", FLIGHTS)
def test_errors_that_differ_from_sample_to_sample_are_those_of_no_estimator(
    field: Field, name: str, noise_m: float
) -> None:
    rng = np.random.default_rng(7)
    track = field.flights[name]
    noisy = falsified.moved_to(field.site, track, track.enu_m + rng.normal(0.0, noise_m, (len(track), 3)))
    report = field.verify(noisy)
    assert report.verdict == "not proved"
    assert any("independent errors" in doubt for doubt in report.doubts)


@pytest.mark.parametrize("noise_m", [0.003, 0.01, 0.05])
@pytest.mark.parametrize("name", FLIGHTS)
def test_noise_from_sample_to_sample_is_no_motion(field: Field, name: str, noise_m: float) -> None:
    rng = np.random.default_rng(7)
    track = field.flights[name]
    report = field.verify(
        falsified.moved_to(field.site, track, track.enu_m + rng.normal(0.0, noise_m, (len(track), 3)))
    )
    assert report.verdict == "passed", (report.reasons, report.doubts)


def test_rounding_at_50_hz_is_no_acceleration(field: Field) -> None:
    track = field.flights["calm"]
    time_s = np.arange(track.time_s[0], track.time_s[-1], 0.02)
    # Smooth between the samples, as the vehicle flies, then rounded as on the wire: 1e-7 degrees and millimetres.
    from scipy.interpolate import CubicSpline

    enu = CubicSpline(track.time_s, track.enu_m)(time_s)
    nearest = np.minimum(np.searchsorted(track.time_s, time_s), len(track) - 1)
    fine = falsified.moved_to(field.site, track.taken(nearest), enu, time_s=time_s)
    geodetic = np.column_stack([np.round(fine.geodetic[:, :2], 7), np.round(fine.geodetic[:, 2], 3)])
    report = field.verify(replace(fine, geodetic=geodetic))
    assert report.verdict == "passed", (report.reasons, report.doubts)


@pytest.mark.thinned(2)
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", FLIGHTS)
@pytest.mark.parametrize(
    "falsify", [*falsified.MOTION, *falsified.UNOBSERVED, *falsified.POSITIONS], ids=lambda f: f.__name__
)
def test_what_nobody_can_have_flown_is_not_passed(field: Field, falsify: Falsify, name: str, seed: int) -> None:
    track = falsify(field.site, field.flights[name], np.random.default_rng(seed))
    report = field.verify(track)
    assert report.verdict != "passed"
    assert not report.passed
    assert report.reasons or report.doubts


@pytest.mark.thinned
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("falsify", [*falsified.MOTION, *falsified.UNOBSERVED], ids=lambda f: f.__name__)
def test_nor_as_the_log_of_another_program(field: Field, falsify: Falsify, seed: int) -> None:
    track = falsify(field.site, field.flights["calm"], np.random.default_rng(seed))
    assert not field.verify(without_numbers(track)).passed


@pytest.mark.thinned
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("falsify", falsified.ATTITUDE, ids=lambda f: f.__name__)
def test_an_attitude_that_cannot_be_believed_sees_nothing_surely(field: Field, falsify: Falsify, seed: int) -> None:
    track = falsify(field.site, field.flights["calm"], np.random.default_rng(seed))
    report = field.verify(track)
    assert report.verdict == "not proved"
    assert report.coverage_fraction < 0.1 < 0.9 < report.possibly_covered_fraction
    assert report.unknown_attitude_looks > 0.9 * (track.current_waypoint >= 1).sum()
    # A gimbal does not share it: what the vehicle's attitude is does not matter then.
    sensor = replace(field.site.scenario.sensor, mount="stabilised")
    assert field.verify(track, with_scenario(field.site, sensor=sensor)).verdict == "passed"


def test_one_glitch_of_the_receiver_costs_a_moment_and_is_told(field: Field) -> None:
    enu = field.flights["calm"].enu_m.copy()
    at = falsified.flying(field.flights["calm"])[300]
    enu[at] += [40.0, 0.0, 60.0]
    report = field.verify(falsified.moved_to(field.site, field.flights["calm"], enu))
    assert report.verdict == "passed", (report.reasons, report.doubts)
    (stretch,) = report.unobserved
    assert stretch.reason == "impossible motion"
    assert stretch.start_s < field.flights["calm"].time_s[at] < stretch.end_s
    assert report.unobserved_s < 1.0
    assert "m/s" in stretch.detail


@pytest.mark.parametrize("from_m_s", [3.5, 5.0, 8.0])
def test_a_hover_without_braking_is_no_jump_of_the_receiver(field: Field, from_m_s: float) -> None:
    """It was forgiven as one, from 5 m/s: over the half seconds around it the velocity changed little enough."""
    track = field.flights["calm"]
    speed = np.linalg.norm(np.gradient(track.enu_m, track.time_s, axis=0), axis=1)
    on = falsified.flying(track)
    here = int(on[np.argmin(np.abs(speed[on] - from_m_s))])
    assert speed[here] == pytest.approx(from_m_s, abs=0.7)
    step_s, count = float(np.median(np.diff(track.time_s))), 200
    order = np.concatenate([np.arange(here), np.full(count, here), np.arange(here, len(track))])
    held = track.taken(order)
    time_s = held.time_s + step_s * np.clip(np.arange(len(held)) - here, 0, count)
    report = field.verify(replace(held, time_s=time_s))
    assert report.verdict == "not proved"
    assert len(report.unobserved) == 2


def test_a_number_that_is_missing_inside_the_route_weakens_no_judgement(field: Field) -> None:
    track = field.flights["calm"]
    on = falsified.flying(track)
    enu = track.enu_m.copy()
    # Slowly down to 35 m above ground, below the band and above the clearance in transit, and up again.
    low = on[200:320]
    enu[low, 2] -= 48.0 * np.sin(np.linspace(0.0, np.pi, len(low)))
    numbers = track.current_waypoint.copy()
    for hidden in (np.empty(0, dtype=np.int64), low, on[150:], on):
        reported = numbers.copy()
        reported[hidden] = -1
        report = field.verify(replace(falsified.moved_to(field.site, track, enu), current_waypoint=reported))
        assert report.verdict == "failed"
        assert "below-band" in {violation.kind for violation in report.violations}


@pytest.mark.parametrize("name", FLIGHTS)
def test_samples_far_apart_prove_something_only_with_an_attitude_that_confirms_them(field: Field, name: str) -> None:
    track = field.flights[name]
    few = track.taken(np.unique(np.searchsorted(track.time_s, np.arange(track.time_s[0], track.time_s[-1], 1.8))))
    far_apart = "s apart and no attitude confirms them"
    assert not any(far_apart in doubt for doubt in field.verify(few).doubts)
    invented = np.random.default_rng(3).normal(0.0, 2.0, (len(few), 2))
    for attitude in (np.full((len(few), 3), np.nan), np.column_stack([invented, few.attitude_deg[:, 2]])):
        report = field.verify(replace(few, attitude_deg=attitude))
        assert report.verdict == "not proved"
        assert any(far_apart in doubt for doubt in report.doubts)


def test_a_flight_that_ended_before_its_route_has_no_place_of_the_plan_to_keep(field: Field) -> None:
    track = field.flights["calm"]
    home_m, first_m = track.enu_m[0, :2], field.planned.waypoints_m[0, :2]
    half = int(np.argmax(np.linalg.norm(track.enu_m[:, :2] - home_m, axis=1) > 0.4 * np.linalg.norm(first_m - home_m)))
    out = track.taken(np.arange(half))
    judged = judge_track(field.site, out, field.planned)
    assert not judged.phases.route.any()
    assert [finding.text for finding in judged.findings if finding.effect != "noted"] == []


def back_from(track: Track, field: Field, fraction: float) -> Track:
    """A flight that turns back after a share of its way to the first waypoint, as a log without numbers has it."""
    first_m = field.planned.waypoints_m[0]
    away_m = np.linalg.norm(track.enu_m - track.enu_m[0], axis=1)
    out = np.arange(int(np.argmax(away_m > fraction * np.linalg.norm(first_m - track.enu_m[0]))))
    there_and_back = track.taken(np.concatenate([out, out[-2::-1]]))
    step_s = float(np.median(np.diff(track.time_s)))
    return without_numbers(replace(there_and_back, time_s=step_s * np.arange(len(there_and_back))))


@pytest.mark.parametrize("fraction", [0.15, 0.5, 0.9])
def test_a_return_before_the_first_waypoint_is_all_transit(field: Field, fraction: float) -> None:
    """Without numbers its nearest point to the route counted as the route, below the height band."""
    back = back_from(field.flights["calm"], field, fraction)
    report = field.verify(back)
    assert report.violations == ()
    assert "no part of the track is on the route" in report.doubts
    # What was not observed may have been further away.
    later_s = 60.0 * (np.arange(len(back)) >= len(back) // 2).astype(float)
    away = replace(back, time_s=back.time_s + later_s)
    assert judge_track(field.site, away, field.planned).phases.route.any()


@pytest.mark.parametrize("falsify", falsified.POSITIONS, ids=lambda f: f.__name__)
def test_a_flight_of_the_route_without_numbers_is_no_early_return(field: Field, falsify: Falsify) -> None:
    track = without_numbers(falsify(field.site, field.flights["calm"], np.random.default_rng(1)))
    assert judge_track(field.site, track, field.planned).phases.route.any()

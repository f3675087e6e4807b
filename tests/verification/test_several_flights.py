"""Two records of one flight count once, two flights stay two, and how near vehicles came to each other."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tests.naive.separation import least_distance
from tests.planner.sites import make_site
from tests.verification.flights import Flight, changed, taken, track_of
from uavcover.model.scenario import Uncertainty
from uavcover.model.track import Track
from uavcover.model.vehicle import Fleet
from uavcover.model.verdict import Effect, Judgement
from uavcover.scenario.site import Site
from uavcover.verification.run_logs import shared_times
from uavcover.verification.several_flights import SameFlight, Separation, judge_separation, same_flight
from uavcover.verification.verify import FlownTrack, Verdict, verify_flight

pytestmark = pytest.mark.usefixtures("attitudes_count")

RNG = np.random.default_rng(5)


def resampled(flight: Flight, step_s: float) -> Track:
    track = flight.track
    times_s = np.arange(track.time_s[0], track.time_s[-1], step_s)
    enu = np.column_stack([np.interp(times_s, track.time_s, axis) for axis in track.enu_m.T])
    number = track.current_waypoint[np.clip(np.searchsorted(track.time_s, times_s), 0, len(track) - 1)]
    return track_of(flight.site, enu, time_s=times_s, current_waypoint=number)


def moved_by(flight: Flight, by_m: np.ndarray) -> Track:
    track = flight.track
    return track_of(
        flight.site, track.enu_m + by_m, time_s=track.time_s, current_waypoint=track.current_waypoint
    )  # fmt: skip


def dated(track: Track, later_s: float) -> Track:
    """With the satellites' time."""
    return changed(track, unix_time_s=1_780_000_000.0 + track.time_s + later_s)


def wandering(flight: Flight, by_m: float, *, step_s: float | None = None) -> Track:
    """A record of another estimator, whose positions wander."""
    track = flight.track if step_s is None else resampled(flight, step_s)
    phase = 2.0 * np.pi * (track.time_s - track.time_s[0])[:, None] / np.array([70.0, 90.0, 110.0])
    off_m = by_m * np.sin(phase) * np.array([0.8, 0.6, 0.2])
    return track_of(flight.site, track.enu_m + off_m, time_s=track.time_s, current_waypoint=track.current_waypoint)


def at_another_pace(flight: Flight) -> Track:
    """The same way again, a little faster here and slower there, as in another wind."""
    track = flight.track
    time_s = track.time_s + 1.5 * np.sin(2.0 * np.pi * (track.time_s - track.time_s[0]) / 40.0)
    return changed(track, time_s=time_s)


RECORDS: dict[str, Callable[[Flight], Track]] = {
    "as it is": lambda f: f.track,
    "by another clock": lambda f: changed(f.track, time_s=f.track.time_s + 1_763_800_000.25),
    "by an earlier clock": lambda f: changed(f.track, time_s=f.track.time_s - 87.3),
    "at another rate": lambda f: resampled(f, 0.13),
    "rounded to a centimetre": lambda f: moved_by(f, RNG.uniform(-0.01, 0.01, f.track.enu_m.shape)),
    "a little noisy": lambda f: moved_by(f, RNG.normal(0.0, 0.08, f.track.enu_m.shape)),
    "shifted by 0.45 m": lambda f: moved_by(f, np.array([0.45, 0.0, 0.0])),
    "a metre higher": lambda f: moved_by(f, np.array([0.0, 0.0, 1.0])),
    "wandering by 1.6 m": lambda f: wandering(f, 1.6),
    "wandering by 6 m at the same times": lambda f: wandering(f, 6.0),
    "wandering by 1.6 m, at another rate and by another clock": lambda f: changed(
        (part := wandering(f, 1.6, step_s=0.13)), time_s=part.time_s + 900.0
    ),
    "wandering by 6 m, received at the same time": lambda f: dated(wandering(f, 6.0, step_s=0.13), 0.0),
    "its first half": lambda f: taken(f.track, np.arange(len(f.track) // 2)),
    "its last third, by another clock": lambda f: changed(
        (part := taken(f.track, np.arange(2 * len(f.track) // 3, len(f.track)))), time_s=part.time_s - 50.0
    ),
    "with a hole": lambda f: taken(f.track, np.flatnonzero((np.arange(len(f.track)) // 100) % 3 != 1)),
}
FLIGHTS: dict[str, Callable[[Flight], Track]] = {
    "a metre beside, a day later": lambda f: dated(moved_by(f, np.array([1.0, 0.0, 0.0])), 86_400.0),
    "in another wind": at_another_pace,
    "at another speed": lambda f: changed(f.track, time_s=100.0 + 1.02 * (f.track.time_s - 100.0)),
    "the other way": lambda f: changed(
        f.track, time_s=(f.track.time_s[-1] - f.track.time_s)[::-1] + 100.0,
        enu_m=f.track.enu_m[::-1].copy(), geodetic=f.track.geodetic[::-1].copy(),
        current_waypoint=np.full(len(f.track), -1, dtype=np.int64),
    ),
}  # fmt: skip


def judged(flight: Flight, *tracks: Track) -> Verdict:
    return verify_flight(flight.site, flight.coverage, [FlownTrack(track, flight.planned) for track in tracks])


@pytest.mark.parametrize("name", RECORDS)
def test_what_two_records_of_one_flight_saw_counts_once(level: Flight, name: str) -> None:
    first = dated(level.track, 0.0)
    alone, both = judged(level, first), judged(level, first, RECORDS[name](level))
    (finding,) = [line for line in both.report.findings if "records of one flight" in line]
    assert "tracks 1 and 2" in finding
    assert both.flown.passes.max() == alone.flown.passes.max()
    np.testing.assert_allclose(both.flown.passes.mean(), alone.flown.passes.mean(), rtol=0.02)
    assert both.report.coverage_fraction == pytest.approx(alone.report.coverage_fraction, abs=0.001)


@pytest.mark.parametrize("name", FLIGHTS)
def test_two_flights_are_two(level: Flight, name: str) -> None:
    first = dated(level.track, 0.0)
    alone, both = judged(level, first), judged(level, first, FLIGHTS[name](level))
    assert not [line for line in both.report.findings if "records of one flight" in line]
    assert both.flown.passes.mean() > 1.8 * alone.flown.passes.mean()


def test_what_one_record_lacks_the_other_has(level: Flight) -> None:
    torn = taken(level.track, np.flatnonzero(np.abs(np.arange(len(level.track)) - len(level.track) // 2) > 150))
    assert judged(level, torn).report.coverage_fraction < 0.9
    whole = changed(level.track, time_s=level.track.time_s + 12.5)
    both = judged(level, torn, whole)
    assert both.report.coverage_fraction == pytest.approx(level.planned.coverage_fraction, abs=0.005)
    assert both.flown.passes.max() == judged(level, level.track).flown.passes.max()
    assert (np.diff([moment.time_s for moment in both.report.coverage_by_time]) > 0.0).all()


def test_a_record_without_attitude_takes_nothing_from_one_with_it(level: Flight) -> None:
    unknown = changed(level.track, attitude_deg=np.full((len(level.track), 3), np.nan))
    assert judged(level, unknown).report.coverage_fraction == 0.0
    alone, both = judged(level, level.track), judged(level, unknown, level.track)
    assert both.report.coverage_fraction == alone.report.coverage_fraction
    assert both.flown.passes.max() == alone.flown.passes.max()


def test_of_three_each_counts_once(level: Flight) -> None:
    alone = judged(level, level.track)
    three = judged(level, level.track, at_another_pace(level), RECORDS["by another clock"](level))
    assert [line[:16] for line in three.report.findings if "records of one" in line] == ["tracks 1 and 3 a"]
    np.testing.assert_allclose(three.flown.passes.mean(), 2.0 * alone.flown.passes.mean(), rtol=0.1)


def same(one_s: np.ndarray, one_m: np.ndarray, other_s: np.ndarray, other_m: np.ndarray) -> SameFlight | None:
    def track(time_s: np.ndarray, enu_m: np.ndarray) -> Track:
        nothing = np.zeros_like(enu_m)
        return Track(time_s.copy(), nothing, enu_m.copy(), nothing.copy(), np.zeros(len(time_s), dtype=np.int64))

    return same_flight(track(one_s, one_m), one_m, track(other_s, other_m), other_m)


def test_records_that_disagree_are_told_and_widen_the_uncertainty(level: Flight) -> None:
    """Of one position error 1.6 m is stated by nobody, and proved by two records."""
    first = dated(level.track, 0.0)
    both = judged(level, first, wandering(level, 1.6))
    assert any("they disagree by up to 1." in line for line in both.report.findings)
    assert both.coverage.site.scenario.uncertainty.position_m > 1.0
    assert judged(level, first, RECORDS["rounded to a centimetre"](level)).coverage is level.coverage


def test_one_vehicle_does_not_fly_at_two_places(level: Flight) -> None:
    far = dated(moved_by(level, np.array([0.0, 60.0, 0.0])), 0.05)
    report = judged(level, dated(level.track, 0.0), changed(far, time_s=far.time_s + 0.05)).report
    assert any("overlap in time at different positions" in line for line in report.doubts)


def test_one_leg_that_both_flew_at_the_same_speed_is_no_record() -> None:
    time_s = np.arange(0.0, 200.0, 0.5)
    leg = np.column_stack([5.0 * time_s, np.zeros_like(time_s), np.full_like(time_s, 50.0)])
    other = leg.copy()
    other[time_s > 60.0, 1] = 3.0 * (time_s[time_s > 60.0] - 60.0)
    assert same(time_s, leg, time_s, other) is None
    assert same(time_s, leg, time_s + 7.0, leg) is not None


def test_what_does_not_move_is_no_flight() -> None:
    time_s = np.arange(0.0, 100.0, 0.5)
    still = np.tile([1.0, 2.0, 3.0], (len(time_s), 1))
    assert same(time_s, still, time_s, still) is None
    assert same(time_s[:1], still[:1], time_s, still) is None


def texts(found: Separation, effect: Effect) -> tuple[str, ...]:
    return Judgement(found.findings).texts(effect)


def site_of(**fleet: Any) -> Site:
    site = make_site()
    settings = {"vehicles": 2, "separation_m": 20.0, "clock_error_s": 0.0, **fleet}
    return dataclasses.replace(site, scenario=dataclasses.replace(site.scenario, fleet=Fleet(**settings)))


def track(time_s: Any, enu_m: Any, *, received: Any = "at once", boot_utc_s: float = 1000.0) -> Track:
    times, positions = np.array(time_s, float), np.array(enu_m, float)
    known = times + boot_utc_s if isinstance(received, str) else np.array(received, float)
    n = len(times)
    return Track(
        time_s=times, geodetic=np.zeros((n, 3)), enu_m=positions, attitude_deg=np.zeros((n, 3)),
        current_waypoint=np.zeros(n, dtype=np.int64), received_utc_s=known,
    )  # fmt: skip


def passing(offset_m: float, *, start_s: float = 0.0, backwards: bool = False, **more: Any) -> Track:
    """Up, along a line of 200 m at 10 m/s, and down."""
    times = np.arange(0.0, 40.01, 0.5)
    east = np.interp(
        times, [0.0, 10.0, 30.0, 40.0], [200.0, 200.0, 0.0, 0.0] if backwards else [0.0, 0.0, 200.0, 200.0]
    )
    up = np.interp(times, [0.0, 10.0, 30.0, 40.0], [0.0, 50.0, 50.0, 0.0])
    return track(times + start_s, np.column_stack([east, np.full(len(times), offset_m), up]), **more)


@pytest.mark.parametrize("seed", range(6))
def test_against_every_moment(seed: int) -> None:
    rng = np.random.default_rng(seed)
    tracks = []
    for boot_s in (1000.0, 1000.0 + rng.uniform(-8.0, 8.0)):
        times = np.cumsum(rng.uniform(0.1, 1.0, size=60))
        positions = np.cumsum(rng.normal(0.0, 4.0, size=(60, 3)), axis=0) + np.array([0.0, 0.0, 60.0])
        tracks.append(track(times, positions, boot_utc_s=boot_s))
    [pair] = judge_separation(site_of(), tracks).pairs
    lists = [(list(t.received_utc_s), [tuple(p) for p in t.enu_m]) for t in tracks]
    least_m, when_s = least_distance(*lists, moments=20_000)
    assert pair.least_m == pytest.approx(least_m, abs=0.05)
    assert pair.least_m <= least_m + 1e-9
    assert abs(pair.utc_s - when_s) < 1.0
    with_errors = judge_separation(site_of(clock_error_s=0.8), tracks).pairs[0]
    shifted_m = min(least_distance(*lists, moments=1000, shift_s=s)[0] for s in np.linspace(-0.8, 0.8, 17))
    assert with_errors.possibly_m <= shifted_m + 1e-6
    assert with_errors.least_m == pair.least_m


def test_too_near_is_told_with_place_time_and_amount() -> None:
    found = judge_separation(site_of(), [passing(0.0), passing(12.0, backwards=True)])
    [violation] = found.violations
    assert (violation.kind, violation.track, violation.other_track) == ("separation", 0, 1)
    assert violation.worst == pytest.approx(12.0)
    assert violation.excess == pytest.approx(8.0)
    assert violation.limit == 20.0
    assert violation.worst_s == pytest.approx(20.0, abs=0.5)
    assert violation.worst_utc_s == pytest.approx(1020.0, abs=0.5)
    assert violation.east_m == pytest.approx(100.0, abs=5.0)
    assert violation.start_s < violation.worst_s < violation.end_s
    assert texts(found, "fails") == (
        "tracks 1 and 2: 12.0 m apart at 20.0 s of the first, but fleet.separation_m is 20 m",
    )


def test_apart_in_space_or_in_time() -> None:
    for other in (passing(25.0, backwards=True), passing(0.0, backwards=True, boot_utc_s=1100.0)):
        found = judge_separation(site_of(), [passing(0.0), other])
        assert (texts(found, "fails"), texts(found, "not proved"), found.violations) == ((), (), ())


def test_vehicles_own_times_tell_nothing() -> None:
    """Equal own times, switched on at other moments: they never met."""
    same_own_time = passing(0.0, backwards=True, boot_utc_s=1015.0)
    found = judge_separation(site_of(separation_m=10.0), [passing(15.0), same_own_time])
    assert texts(found, "fails") == ()
    assert found.pairs[0].least_m == pytest.approx(15.0, abs=0.2)


def test_what_clocks_leave_possible_is_not_proved() -> None:
    times = np.arange(0.0, 30.0, 0.5)
    line = np.column_stack([10.0 * times, np.zeros(60), np.full(60, 50.0)])
    two = [track(times, line), track(times, line, boot_utc_s=1002.5)]  # 25 m behind on the same line
    exact = judge_separation(site_of(), two)
    assert (texts(exact, "fails"), texts(exact, "not proved")) == ((), ())
    vague = judge_separation(site_of(clock_error_s=1.0), two)
    assert texts(vague, "fails") == ()
    assert "but possibly 12.1 m; fleet.separation_m is 20 m" in texts(vague, "not proved")[0]


def test_uncertain_positions_count_twice() -> None:
    site = site_of()
    vague = dataclasses.replace(
        site, scenario=dataclasses.replace(site.scenario, uncertainty=Uncertainty(position_m=4.0))
    )
    tracks = [passing(0.0), passing(25.0)]
    assert texts(judge_separation(site, tracks), "not proved") == ()
    assert len(texts(judge_separation(vague, tracks), "not proved")) == 1


@pytest.mark.parametrize("received", ["missing", "back"])
def test_without_times_of_arrival_nothing_is_proved(received: str) -> None:
    times = passing(0.0).time_s + 1000.0
    wrong = np.full(len(times), np.nan) if received == "missing" else times[::-1]
    found = judge_separation(site_of(), [passing(0.0), passing(500.0, received=wrong)])
    assert found.pairs == ()
    assert "track 2 does not record when its positions" in texts(found, "not proved")[0]


def test_where_samples_are_rare_the_vehicle_may_have_been_elsewhere() -> None:
    whole = passing(60.0)
    kept = np.ones(len(whole), dtype=bool)
    kept[30:50] = False
    found = judge_separation(site_of(), [passing(0.0), whole.taken(kept)])
    assert texts(found, "fails") == ()
    assert len(texts(found, "not proved")) == 1


def test_two_that_stand_beside_each_other_on_the_ground() -> None:
    still = track(np.arange(0.0, 40.0), np.tile([5.0, 0.0, 0.0], (40, 1)))
    waits = track(np.arange(0.0, 20.0), np.zeros((20, 3)))
    assert judge_separation(site_of(), [waits, still]).pairs == ()
    found = judge_separation(site_of(), [passing(0.0), still])
    assert found.pairs[0].least_m == pytest.approx(5.0)  # it stands, and the other one lifts off beside it


def test_one_vehicle_and_two_records_of_one_flight_are_not_judged() -> None:
    tracks = [passing(0.0), passing(1.0)]
    assert judge_separation(site_of(vehicles=1), tracks).pairs == ()
    assert judge_separation(site_of(), tracks, same_flight={(0, 1)}).pairs == ()


def test_late_positions_are_put_where_they_belong() -> None:
    times = np.arange(0.0, 60.0, 0.5)
    rng = np.random.default_rng(3)
    late_s = rng.uniform(0.0, 0.3, size=len(times))
    late_s[40:60] = times[59] - times[40:60] + 0.2  # a gap of the link: all arrive together
    received = np.maximum.accumulate(500.0 + times + 0.05 + late_s)
    found = shared_times(track(times, np.zeros((len(times), 3)), received=received))
    assert found is not None
    assert np.abs(found.taken_utc_s - (500.0 + times)).max() < 0.2
    assert (np.diff(found.taken_utc_s) >= 0.0).all()
    assert (found.taken_utc_s <= received).all()


def test_a_simulation_that_runs_fast_and_waits_in_between() -> None:
    times = np.arange(0.0, 400.0, 0.5)
    received = 500.0 + times / 20.0 + np.where(times > 200.0, 3.0, 0.0)
    found = shared_times(track(times, np.zeros((len(times), 3)), received=received))
    assert found is not None
    assert found.pace == pytest.approx((400.0 / 20.0 + 3.0) / 400.0, rel=0.01)
    far = np.abs(times - 200.0) > 40.0
    assert np.abs(found.taken_utc_s - received)[far].max() < 0.5

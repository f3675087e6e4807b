"""What two records of one flight saw counts once, whatever their clocks, rates and cuts; two flights stay two."""

from collections.abc import Callable

import numpy as np
import pytest

from tests.judging.flights import Flight, changed, make_site, taken, track_of
from tests.planning.sites import flat
from uavcover.judging.same_flight import same_flight
from uavcover.judging.verify import FlownTrack, Verdict, verify_flight
from uavcover.model.track import Track

pytestmark = pytest.mark.usefixtures("attitudes_count")

RNG = np.random.default_rng(5)


@pytest.fixture(scope="module")
def level() -> Flight:
    return Flight(make_site(flat))


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
    "its first half": lambda f: taken(f.track, np.arange(len(f.track) // 2)),
    "its last third, by another clock": lambda f: changed(
        (part := taken(f.track, np.arange(2 * len(f.track) // 3, len(f.track)))), time_s=part.time_s - 50.0
    ),
    "with a hole": lambda f: taken(f.track, np.flatnonzero((np.arange(len(f.track)) // 100) % 3 != 1)),
}
FLIGHTS: dict[str, Callable[[Flight], Track]] = {
    "a metre beside": lambda f: moved_by(f, np.array([1.0, 0.0, 0.0])),
    "a metre higher": lambda f: moved_by(f, np.array([0.0, 0.0, 1.0])),
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
    alone, both = judged(level, level.track), judged(level, level.track, RECORDS[name](level))
    (finding,) = [line for line in both.report.findings if "records of one flight" in line]
    assert "tracks 1 and 2" in finding
    assert both.flown.passes.max() == alone.flown.passes.max()
    np.testing.assert_allclose(both.flown.passes.mean(), alone.flown.passes.mean(), rtol=0.02)
    assert both.report.coverage_fraction == pytest.approx(alone.report.coverage_fraction, abs=0.001)


@pytest.mark.parametrize("name", FLIGHTS)
def test_two_flights_are_two(level: Flight, name: str) -> None:
    alone, both = judged(level, level.track), judged(level, level.track, FLIGHTS[name](level))
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


def test_one_leg_that_both_flew_at_the_same_speed_is_no_record() -> None:
    time_s = np.arange(0.0, 200.0, 0.5)
    leg = np.column_stack([5.0 * time_s, np.zeros_like(time_s), np.full_like(time_s, 50.0)])
    other = leg.copy()
    other[time_s > 60.0, 1] = 3.0 * (time_s[time_s > 60.0] - 60.0)
    assert same_flight(time_s, leg, time_s, other) is None
    assert same_flight(time_s, leg, time_s + 7.0, leg) is not None


def test_what_does_not_move_is_no_flight() -> None:
    time_s = np.arange(0.0, 100.0, 0.5)
    still = np.tile([1.0, 2.0, 3.0], (len(time_s), 1))
    assert same_flight(time_s, still, time_s, still) is None
    assert same_flight(time_s[:1], still[:1], time_s, still) is None

"""What the vehicle extrapolates without a satellite fix is no evidence."""

import numpy as np
import pytest

from tests.verification.flights import Flight, changed, taken

pytestmark = pytest.mark.usefixtures("attitudes_count")


def flown_with(flight: Flight, lost_s: float, *, elsewhere: float = 1.0) -> np.ndarray:
    """Whether there is a fix: it is lost at the middle of the route for some seconds."""
    t = flight.track.time_s
    begin_s = float(t[np.flatnonzero(flight.track.current_waypoint >= 1)].mean())
    return np.where((t >= begin_s) & (t <= begin_s + lost_s), 0.0, elsewhere)


@pytest.mark.parametrize("elsewhere", [1.0, np.nan])
def test_a_long_loss_is_not_observed(level: Flight, elsewhere: float) -> None:
    whole = level.verify()
    assert whole.passed
    report = level.verify(changed(level.track, has_fix=flown_with(level, 22.0, elsewhere=elsewhere)))
    assert report.verdict != "passed"
    (stretch,) = report.unobserved
    assert (stretch.reason, stretch.phase) == ("no satellite fix", "route")
    assert stretch.duration_s == pytest.approx(20.0, abs=0.5)
    assert stretch.detail == f"{stretch.duration_s:.1f} s without a satellite fix"
    assert report.coverage_fraction < whole.coverage_fraction


def test_a_short_loss_and_no_report_are_as_before(level: Flight) -> None:
    whole = level.verify()
    for has_fix in (flown_with(level, 1.9), np.ones(len(level.track)), np.full(len(level.track), np.nan)):
        assert level.verify(changed(level.track, has_fix=has_fix)) == whole


def test_without_any_fix_nothing_is_proved(level: Flight) -> None:
    assert not level.verify(changed(level.track, has_fix=np.zeros(len(level.track)))).passed


@pytest.mark.parametrize("is_lost", [True, False])
def test_take_off_and_begin_of_the_route_within_a_gap_break_no_limit(level: Flight, is_lost: bool) -> None:
    """The vehicle on the ground was the nearest sample to the first waypoint, and so flew the route below its height band."""
    track = level.without_waypoints()
    first, last = (int(np.flatnonzero(level.track.current_waypoint >= 1)[k]) for k in (0, -1))
    at = np.arange(len(track))
    for gone in ((at >= 12) & (at < first + 40), (at > last - 40) & (at < len(track) - 12)):
        lost = changed(track, has_fix=np.where(gone, 0.0, 1.0)) if is_lost else taken(track, np.flatnonzero(~gone))
        report = level.verify(lost)
        assert (report.verdict, report.violations, report.reasons) == ("not proved", (), ())


def test_nothing_fails_without_a_fix(level: Flight) -> None:
    """Two seconds on the ground remained, a whole flight that covered nothing."""
    for track in (level.track, level.without_waypoints()):
        report = level.verify(changed(track, has_fix=np.zeros(len(track))))
        assert (report.verdict, report.violations, report.reasons) == ("not proved", (), ())

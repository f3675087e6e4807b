"""A flight begins and ends on the ground; one that goes on in the air with another counts together with it."""

from dataclasses import replace

import numpy as np
import pytest

from tests.verification import falsified
from tests.verification.flights import Flight, changed, make_site
from uavcover.errors import TrackError
from uavcover.model.track import Track
from uavcover.model.verdict import VerificationReport
from uavcover.verification.flown_route import PlannedRoute
from uavcover.verification.track_doubts import ENDS, TrackEnd, track_ends
from uavcover.verification.verify import FlownTrack, verify_flight

pytestmark = pytest.mark.usefixtures("attitudes_count")


def together(flight: Flight, *tracks: Track) -> VerificationReport:
    planned: PlannedRoute = flight.planned
    return verify_flight(flight.site, flight.coverage, [FlownTrack(track, planned) for track in tracks]).report


def parts(track: Track, *at: int) -> list[Track]:
    return [track.taken(part) for part in np.split(np.arange(len(track)), at)]


def test_from_the_ground_to_the_ground_it_passes(flight: Flight) -> None:
    assert together(flight, flight.track).verdict == "passed"


@pytest.mark.parametrize("seed", range(6))
def test_how_high_it_begins_and_ends_is_told(flight: Flight, seed: int) -> None:
    rng = np.random.default_rng(seed)
    track = flight.track
    begun = falsified.begun_in_the_air(flight.site, track, rng)
    ended = falsified.ended_in_the_air(flight.site, track, rng)
    for cut, which, at in ((begun, "begins", 0), (ended, "ends", -1)):
        report = together(flight, cut)
        assert report.verdict == "not proved"
        (doubt,) = [doubt for doubt in report.doubts if f"the track {which}" in doubt]
        assert f"{cut.enu_m[at, 2]:.1f} m above the ground" in doubt
        reasons = {"begins": "before the first sample", "ends": "after the last sample"}
        assert reasons[which] in {stretch.reason for stretch in report.unobserved}


def test_a_track_that_stops_on_the_route_misses_the_rest_of_it(flight: Flight) -> None:
    on = falsified.flying(flight.track)
    report = together(flight, flight.track.taken(np.arange(on[len(on) // 2])))
    missing = [stretch for stretch in report.unobserved if stretch.reason == "after the last sample"]
    whole_m = float(np.linalg.norm(np.diff(flight.planned.waypoints_m, axis=0), axis=1).sum())
    assert 0.3 * whole_m < missing[0].length_m < 0.8 * whole_m
    # What was not observed may have seen the rest.
    assert report.verdict == "not proved"
    assert any("unobserved intervals could increase it" in doubt for doubt in report.doubts)


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
@pytest.mark.parametrize("pause_s", [0.0, 1.5])
def test_a_continuation_counts_with_the_flight_that_it_goes_on_with(
    flight: Flight, order: tuple[int, int], pause_s: float
) -> None:
    on = falsified.flying(flight.track)
    halves = parts(flight.track, on[100])
    halves[1] = replace(halves[1], time_s=halves[1].time_s + pause_s)
    # Each follows the plan that is left for it.
    reports = [together(flight, half) for half in halves]
    assert all(report.verdict == "not proved" for report in reports)
    both = verify_flight(flight.site, flight.coverage, [FlownTrack(halves[k], flight.planned) for k in order]).report
    beside = ("its end is missing", "its start is missing")
    assert not any(words in doubt for doubt in both.doubts for words in beside)
    assert both.reasons == ()


@pytest.mark.parametrize("wrong", ["too far", "before", "much later"])
def test_one_that_cannot_go_on_with_it_does_not(flight: Flight, wrong: str) -> None:
    on = falsified.flying(flight.track)
    first, second = parts(flight.track, on[100])
    if wrong == "too far":
        second = falsified.moved_to(flight.site, second, second.enu_m + np.array([0.0, 120.0, 0.0]))
    else:
        second = replace(second, time_s=second.time_s + (-30.0 if wrong == "before" else 30.0))
    report = together(flight, first, second)
    assert report.verdict != "passed"
    text = "; ".join(report.doubts)
    if wrong == "much later":
        # It is the same flight, and half a minute of it is missing.
        assert "its end is missing" not in text
        assert "the limit is 10 s" in text
    else:
        assert "its end is missing" in text
        assert "its start is missing" in text


def test_the_ways_there_and_home_have_a_highest_height() -> None:
    flight = Flight(make_site(limits={"max_transit_height_agl_m": 100.0}))
    assert together(flight, flight.track).verdict == "passed"
    enu = flight.track.enu_m.copy()
    there = (enu[:, 0] > -70.0) & (enu[:, 0] < -30.0) & (flight.track.current_waypoint < 1)
    enu[there, 2] += 60.0
    report = together(flight, falsified.moved_to(flight.site, flight.track, enu))
    assert {violation.kind for violation in report.violations} == {"above-transit-height"}
    assert report.verdict == "failed"
    assert report.max_transit_height_agl_m == pytest.approx(float(enu[there, 2].max()), abs=0.5)
    assert report.requirements["max_transit_height_agl_m"] == 100.0


def test_without_a_limit_of_its_own_the_ceiling_leaves_room_above_the_band() -> None:
    scenario = make_site().scenario
    assert scenario.limits.max_transit_height_agl_m is None
    assert scenario.transit_ceiling_agl_m == scenario.limits.max_height_agl_m + 30.0


def test_positions_under_the_ground_are_named(flight: Flight) -> None:
    enu = flight.track.enu_m - [0.0, 0.0, 14.0]
    report = together(flight, falsified.moved_to(flight.site, flight.track, enu))
    assert any("below the ground by up to 14.0 m" in doubt for doubt in report.doubts)
    assert any("begins 14.0 m under the ground" in doubt for doubt in report.doubts)
    assert not report.passed


def test_where_positions_are_deepest_under_the_ground_is_named(flight: Flight) -> None:
    enu = flight.track.enu_m.copy()
    on = falsified.flying(flight.track)[100:141]
    enu[on, 2] -= 95.0 * np.sin(np.linspace(0.0, np.pi, len(on)))
    report = together(flight, falsified.moved_to(flight.site, flight.track, enu))
    (doubt,) = [doubt for doubt in report.doubts if "below the ground" in doubt]
    assert f"by up to 15.0 m at {flight.track.time_s[on[20]]:.1f} s, " in doubt
    # As far under it as home may be is none.
    enu[on, 2] += 5.1 * np.sin(np.linspace(0.0, np.pi, len(on)))
    report = together(flight, falsified.moved_to(flight.site, flight.track, enu))
    assert not any("below the ground" in doubt for doubt in report.doubts)


def test_equal_times_are_refused(flight: Flight) -> None:
    times = flight.track.time_s.copy()
    times[50] = times[49]
    with pytest.raises(TrackError, match=r"sample 50 of the track, at .* is not later than the previous sample"):
        together(flight, changed(flight.track, time_s=times))


# The ends by themselves


def ends_of(
    *, last_up_m: float = 0.0, agl_m: tuple[float, float] = (0.0, 0.0), aside_m: float = 0.0, sink_m_s: float = 2.0
) -> tuple[TrackEnd, TrackEnd]:
    """A track that begins at rest for 5 s and ends sinking, at a height against the first place, aside of it."""
    time_s = np.arange(0.0, 60.0, 0.5)
    enu = np.zeros((time_s.size, 3))
    enu[:, 2] = np.where(time_s < 5.0, 0.0, 50.0)
    landing = time_s > 50.0
    enu[landing, 0] = aside_m
    enu[landing, 2] = last_up_m + sink_m_s * (time_s[-1] - time_s[landing])
    heights = enu[:, 2].copy()
    heights[0], heights[-1] = agl_m
    return track_ends(make_site().scenario, time_s, enu, heights, noise_m=(0.0, 0.0))


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_log_that_is_switched_off_on_touching_down_ends_within_metres_of_the_ground(side: float) -> None:
    # By the terrain, or by where it took off from, if that is the same place; the limit itself is within it.
    for by_terrain_m, by_start_m, aside_m, on_ground in (
        (ENDS.near_terrain_m, 4.0, 0.0, True),
        (2.01, 4.0, 0.0, False),
        (5.0, ENDS.same_height_m, 0.0, True),
        (5.0, 1.01, 0.0, False),
        (5.0, 0.0, 10.0, True),
        (5.0, 0.0, 10.1, False),
        (10.1, 0.0, 0.0, False),
    ):
        begin, end = ends_of(last_up_m=side * by_start_m, agl_m=(0.0, side * by_terrain_m), aside_m=aside_m)
        assert begin.on_ground
        assert (end.on_ground, end.still) == (on_ground, False), (by_terrain_m, by_start_m, aside_m)


def test_at_rest_it_may_be_as_far_from_the_terrain_as_its_home_may() -> None:
    for agl_m, on_ground in ((10.0, True), (-10.0, True), (10.1, False), (-10.1, False), (np.nan, False)):
        _, end = ends_of(last_up_m=30.0, agl_m=(0.0, agl_m), aside_m=10.1, sink_m_s=0.0)
        assert (end.on_ground, end.still) == (on_ground, True)


@pytest.mark.parametrize(("up_m", "aside_m", "on_ground"), [(5.0, 0.0, True), (5.1, 10.0, False), (5.1, 10.1, True)])
def test_an_end_high_above_the_other_at_the_same_place_is_in_the_air(
    up_m: float, aside_m: float, on_ground: bool
) -> None:
    """A record that is cut off in a slow descent looks at rest where its positions are noisy."""
    _, end = ends_of(last_up_m=up_m, agl_m=(0.0, up_m), aside_m=aside_m, sink_m_s=0.0)
    assert (end.on_ground, end.still) == (on_ground, True)


@pytest.mark.parametrize(
    ("path_m", "noise_m", "still"),
    [
        # In two seconds no more than 2 m aside and 0.6 m up or down, and ten times the noise of the positions.
        ((1.9, 0.0, 0.0), (0.0, 0.0), True),
        ((1.5, -1.5, 0.0), (0.0, 0.0), False),
        ((0.0, 0.0, -0.5), (0.0, 0.0), True),
        ((0.0, 0.0, 0.7), (0.0, 0.0), False),
        ((0.0, 2.9, 0.0), (0.1, 0.0), True),
        ((0.0, 3.1, 0.0), (0.1, 0.0), False),
        ((0.0, 3.1, 0.0), (0.0, 9.0), False),
        ((0.0, 0.0, 1.5), (0.0, 0.1), True),
        ((0.0, 0.0, -1.7), (9.0, 0.1), False),
    ],
)
def test_at_rest_it_moves_no_more_than_its_noise(
    path_m: tuple[float, float, float], noise_m: tuple[float, float], still: bool
) -> None:
    time_s = np.arange(0.0, 20.5, 0.5)
    enu = np.outer(np.clip(time_s / 2.0, 0.0, 1.0), path_m)
    there, back = track_ends(make_site().scenario, time_s, enu, enu[:, 2], noise_m=noise_m)
    assert (there.still, back.still) == (still, True)
    there, back = track_ends(make_site().scenario, time_s, enu[::-1], enu[::-1, 2], noise_m=noise_m)
    assert (there.still, back.still) == (True, still)

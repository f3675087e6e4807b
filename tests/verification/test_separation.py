"""How near vehicles came to each other: a twin that looks at every moment, late positions, clocks that nobody knows."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from tests.naive.separation import least_distance
from tests.planner.sites import make_site
from uavcover.model.scenario import Uncertainty
from uavcover.model.track import Track
from uavcover.model.vehicle import Fleet
from uavcover.model.verdict import Effect, Judgement
from uavcover.scenario.site import Site
from uavcover.verification.run_logs import shared_times
from uavcover.verification.separation import Separation, judge_separation


def texts(found: Separation, effect: Effect) -> tuple[str, ...]:
    return Judgement(found.findings).texts(effect)


def site_of(**fleet: Any) -> Site:
    site = make_site()
    settings = {"vehicles": 2, "separation_m": 20.0, "clock_error_s": 0.0, **fleet}
    return dataclasses.replace(site, scenario=dataclasses.replace(site.scenario, fleet=Fleet(**settings)))


def track(time_s: Any, enu_m: Any, *, received: Any = "at once", boot_utc_s: float = 1000.0) -> Track:
    times, places = np.array(time_s, float), np.array(enu_m, float)
    known = times + boot_utc_s if isinstance(received, str) else np.array(received, float)
    n = len(times)
    return Track(
        time_s=times, geodetic=np.zeros((n, 3)), enu_m=places, attitude_deg=np.zeros((n, 3)),
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
        places = np.cumsum(rng.normal(0.0, 4.0, size=(60, 3)), axis=0) + np.array([0.0, 0.0, 60.0])
        tracks.append(track(times, places, boot_utc_s=boot_s))
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

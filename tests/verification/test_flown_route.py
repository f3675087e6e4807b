"""Which planned waypoints a track passed, and what lies between two samples that are not joined."""

import numpy as np
import pytest

from tests.verification.flights import fly_along, make_site, track_of
from uavcover.model.track import Track
from uavcover.model.verdict import Unobserved
from uavcover.verification.flown_route import (
    SAFETY,
    Passing,
    PlannedRoute,
    contradiction,
    length_of_m,
    passing,
    path_after_m,
    path_before_m,
    paths_between_m,
    plan_doubt,
    position_of,
    unobserved_stretches,
)
from uavcover.verification.possible_motion import ImpossibleMove, Motion

PLAN = np.array([[0.0, 0.0, 80.0], [100.0, 0.0, 80.0], [100.0, 50.0, 80.0], [0.0, 50.0, 80.0]])
RADIUS_M = 5.0


def passed_by(*positions: tuple[float, float], plan: np.ndarray = PLAN, broken: tuple[int, ...] = ()) -> Passing:
    enu = np.array([(east, north, 80.0) for east, north in positions])
    joined = np.ones(len(enu) - 1, dtype=bool)
    joined[list(broken)] = False
    return passing(enu, joined, plan, radius_m=RADIUS_M)


# Places


def test_a_waypoint_is_passed_at_the_sample_where_the_leg_that_comes_nearest_begins() -> None:
    found = passed_by((-40, 0), (-2, 3), (60, 0), (100, 0), (100, 50), (40, 50), (0, 50))
    assert found.samples.tolist() == [1, 2, 3, 5]
    assert found.passed.all()
    assert found.nearest_m[1:].tolist() == [0.0, 0.0, 0.0]
    # To the leg from (-2, 3) to (60, 0), not to its end.
    assert found.nearest_m[0] == pytest.approx(abs(-2 * -3 - 3 * 62) / np.hypot(62, 3))


def test_between_two_samples_only_where_they_are_joined() -> None:
    plan = PLAN[:1]
    assert passed_by((-60, 3), (40, 3), plan=plan).samples.tolist() == [0]
    assert passed_by((-60, 3), (40, 3), plan=plan).nearest_m == pytest.approx([3.0])
    apart = passed_by((-60, 3), (40, 3), plan=plan, broken=(0,))
    assert apart.samples.tolist() == [-1]
    assert not apart.passed.any()
    assert apart.nearest_m == pytest.approx([np.hypot(40, 3)])


def test_a_place_beyond_the_end_of_a_leg_is_as_far_as_its_end() -> None:
    found = passed_by((-60, 0), (-9, 0), plan=PLAN[:1])
    assert found.nearest_m == pytest.approx([9.0])
    found = passed_by((9, 0), (60, 0), plan=PLAN[:1])
    assert found.nearest_m == pytest.approx([9.0])


def test_the_radius_itself_is_near() -> None:
    assert passed_by((-60, RADIUS_M), (60, RADIUS_M), plan=PLAN[:1]).passed.all()
    assert not passed_by((-60, RADIUS_M + 0.01), (60, RADIUS_M + 0.01), plan=PLAN[:1]).passed.any()


def test_a_single_sample_passes_where_it_stands() -> None:
    assert passed_by((1, 1), plan=PLAN[:2]).samples.tolist() == [0, -1]


def test_heights_are_not_looked_at() -> None:
    found = passing(PLAN - [0.0, 0.0, 70.0], np.ones(3, dtype=bool), PLAN, radius_m=RADIUS_M)
    assert found.passed.all()
    assert (found.nearest_m == 0.0).all()


def test_as_many_as_can_have_been_passed_in_the_order_of_the_plan() -> None:
    # On the way to the first waypoint it comes by the third; that was not yet its turn.
    early = passed_by((100, 50), (0, 20), (0, 0), (100, 0), (100, 50), (0, 50))
    assert early.samples.tolist() == [1, 2, 3, 4]
    backwards = passed_by((0, 50), (50, 50), (100, 50), (100, 25), (100, 0), (50, 0), (0, 0))
    assert backwards.passed.sum() == 1
    assert (backwards.nearest_m <= RADIUS_M).all()


def test_a_place_that_is_planned_twice_in_a_row_is_passed_twice_by_one_approach() -> None:
    found = passed_by((0, 0), (100, 0), plan=PLAN[[0, 1, 1]])
    assert found.samples.tolist() == [0, 0, 0]


def test_a_waypoint_that_is_passed_again_and_again_counts_once() -> None:
    there, aside = (0, 0), (0, 20)
    found = passed_by(there, (50, 20), (100, 0), (50, 20), there, aside, there, aside, there, (100, 50), plan=PLAN[:3])
    assert found.passed.all()
    assert passed_by(there, (50, 20), (100, 0), (50, 20), there, plan=PLAN[[0, 1, 0]]).samples.tolist() == [0, 1, 3]


# Numbers


@pytest.fixture(scope="module")
def flown() -> Track:
    """A flight of the plan from a place before it to one behind it, at 10 m/s, five times a second."""
    path = np.vstack([[-80.0, 0.0, 80.0], PLAN, [-80.0, 50.0, 80.0]])
    return fly_along(make_site(home=None), path, first=1, count=len(PLAN))


def said_of(track: Track, numbers: np.ndarray, *, broken: slice = slice(0, 0)) -> str | None:
    joined = np.ones(len(track) - 1, dtype=bool)
    joined[broken] = False
    reported = Track(track.time_s, track.geodetic, track.enu_m, track.attitude_deg, numbers.astype(np.int64))
    return contradiction(reported, track.enu_m, joined, PLAN, radius_m=RADIUS_M, speed_m_s=10.0)


def test_numbers_of_the_flight_itself_contradict_nothing(flown: Track) -> None:
    numbers = flown.current_waypoint
    assert set(numbers) == {-1, 0, 1, 2, 3}
    assert said_of(flown, numbers) is None
    assert said_of(flown, np.full(len(flown), -1)) is None


def test_a_number_beyond_the_plan(flown: Track) -> None:
    numbers = np.where(flown.current_waypoint == 3, 4, flown.current_waypoint)
    assert said_of(flown, numbers) == "current_waypoint reaches 4, but the plan has 4 waypoints"


@pytest.mark.parametrize("late_s", [0.0, 1.0, SAFETY.lateness_s - 0.5])
def test_a_number_may_come_late(flown: Track, late_s: float) -> None:
    late = np.roll(flown.current_waypoint, round(late_s * 5.0))
    late[: round(late_s * 5.0)] = -1
    assert said_of(flown, late) is None


@pytest.mark.parametrize("waypoint", [0, 1, 2, 3])
def test_one_that_changes_far_away_from_its_waypoint(flown: Track, waypoint: int) -> None:
    numbers = flown.current_waypoint
    reached = int(np.flatnonzero(numbers == waypoint)[-1]) + 1
    # Four seconds too early: 40 m before the waypoint, less what is near.
    early = numbers.copy()
    early[reached - 20 : reached] = numbers[reached]
    said = said_of(flown, early)
    assert said is not None
    at_s = flown.time_s[reached - 20]
    assert said.startswith(f"current_waypoint changes from {waypoint} to {numbers[reached]} at {at_s:.1f} s, ")
    assert said.endswith(f" m away from waypoint {waypoint}")
    # Three samples are 6 m: within the radius and what is flown between two samples.
    near = numbers.copy()
    near[reached - 3 : reached] = numbers[reached]
    assert said_of(flown, near) is None


def test_one_that_comes_much_too_late(flown: Track) -> None:
    numbers = flown.current_waypoint.copy()
    reached = int(np.flatnonzero(numbers == 0)[-1]) + 1
    numbers[reached : reached + 40] = 0
    said = said_of(flown, numbers)
    assert said is not None
    assert said.endswith(f"changes from 0 to 1 at {flown.time_s[reached + 40]:.1f} s, 32 m away from waypoint 0")


def test_one_that_goes_back(flown: Track) -> None:
    numbers = flown.current_waypoint.copy()
    at = int(np.flatnonzero(numbers == 3)[0]) + 10
    numbers[at:] = np.where(numbers[at:] == 3, 2, numbers[at:])
    assert said_of(flown, numbers) == f"current_waypoint decreases from 3 to 2 at {flown.time_s[at]:.1f} s"


@pytest.mark.parametrize(("samples", "believed"), [(1, True), (4, True), (8, False)])
def test_one_that_a_later_message_has_overtaken(flown: Track, samples: int, believed: bool) -> None:
    """Two datagrams change places: for a fifth of a second the number is the one before."""
    numbers = flown.current_waypoint.copy()
    at = int(np.flatnonzero(numbers == 3)[0]) + 2
    numbers[at : at + samples] = 2
    assert (said_of(flown, numbers) is None) is believed


def test_what_was_not_observed_contradicts_nothing(flown: Track) -> None:
    numbers = flown.current_waypoint.copy()
    at = int(np.flatnonzero(numbers == 1)[-1]) - 30
    numbers[at : at + 31] = 2
    assert said_of(flown, numbers) is not None
    assert said_of(flown, numbers, broken=slice(at - 1, at)) is None
    # Of a gap elsewhere nothing follows for it.
    assert said_of(flown, numbers, broken=slice(at + 20, at + 21)) is not None


@pytest.mark.parametrize("waypoint", [0, 3])
def test_the_first_and_the_last_number_are_changes_too(flown: Track, waypoint: int) -> None:
    numbers = flown.current_waypoint.copy()
    if waypoint == 0:
        # The first waypoint would have been passed 40 m before the track comes there.
        numbers[:] = np.where(numbers == 0, -1, numbers)
        first = int(np.flatnonzero(numbers == 1)[0])
        assert said_of(flown, numbers) is None
        numbers[first - 25 : first] = 1
    else:
        last = int(np.flatnonzero(numbers == 3)[-1])
        numbers[last - 25 : last + 1] = -1
    said = said_of(flown, numbers)
    assert said is not None
    assert said.endswith(f"away from waypoint {waypoint}")


def test_a_first_number_at_the_second_sample_is_a_change_as_well(flown: Track) -> None:
    numbers = np.where(flown.current_waypoint == 0, 1, flown.current_waypoint)
    numbers[0] = -1
    said = said_of(flown, numbers)
    assert said is not None
    assert said.startswith(f"current_waypoint changes from -1 to 1 at {flown.time_s[1]:.1f} s, ")
    assert said.endswith("away from waypoint 0")
    # One from the first sample on says nothing of what was before.
    numbers[0] = 1
    assert said_of(flown, numbers) is None


def test_waypoint_0_may_be_told_by_a_single_sample(flown: Track) -> None:
    numbers = np.where(flown.current_waypoint == 0, -1, flown.current_waypoint)
    numbers[int(np.flatnonzero(numbers == 1)[0]) - 1] = 0
    assert said_of(flown, numbers) is None


# What follows for the plan


def doubt(samples: list[int], nearest_m: list[float]) -> str | None:
    return plan_doubt(Passing(np.array(samples), np.array(nearest_m), RADIUS_M))


def test_a_flight_of_its_plan_is_not_doubted() -> None:
    assert doubt([3, 7, 9, 12], [0.0, 1.0, 5.0, 2.0]) is None
    # Half of a plan, as of a flight that was broken off, or with a waypoint missed here and there.
    assert doubt([3, 7, -1, -1], [0.0, 1.0, 90.0, 200.0]) is None
    assert doubt([3, -1, 9, -1, 12], [0.0, 8.0, 5.0, 8.0, 2.0]) is None


def test_a_track_that_comes_nowhere_near_is_another_flight() -> None:
    said = doubt([-1, -1, -1], [80.0, 61.0, 70.0])
    assert said is not None
    assert said.startswith("none of the 3 planned waypoints was passed (the nearest distance is 61 m")


def test_waypoints_that_do_not_come_in_the_order_of_the_plan() -> None:
    assert doubt([-1, -1, 5, -1], [0.0, 5.0, 1.0, 1.0]) == (
        "only 1 of the 4 planned waypoints that were passed were passed in the planned order"
    )
    assert doubt([3, -1, 5, -1], [0.0, 5.0, 1.0, 1.0]) is None  # half of them do
    assert doubt([3, -1, -1], [0.0, 5.0, 1.0]) is None  # three have no order to speak of


def test_more_missed_than_passed() -> None:
    assert doubt([-1, -1, -1, 5, -1], [30.0, 44.0, 8.0, 1.0, 300.0]) == (
        "the vehicle missed 3 of the first 4 waypoints by up to 44 m"
    )
    assert doubt([-1, -1, 4, 5], [30.0, 44.0, 2.0, 1.0]) is None  # as many as were passed


pytestmark = pytest.mark.usefixtures("attitudes_count")

PLANNED = PlannedRoute(np.column_stack([100.0 * np.arange(5.0), np.zeros(5), np.full(5, 80.0)]), 0.9)
NO_PLAN = PlannedRoute(np.empty((0, 3)), 0.0)


def passed(*samples: int) -> Passing:
    return Passing(np.array(samples), np.zeros(len(samples)), 5.0)


# The ways that may have been flown


def test_the_planned_ways_before_the_first_and_after_the_last_waypoint_that_was_passed() -> None:
    some = passed(-1, -1, 4, 9, -1)
    assert path_before_m(PLANNED, some).tolist() == PLANNED.waypoints_m[:3].tolist()
    assert path_after_m(PLANNED, some).tolist() == PLANNED.waypoints_m[3:].tolist()
    whole = passed(0, 2, 4, 6, 8)
    assert len(path_before_m(PLANNED, whole)) == len(path_after_m(PLANNED, whole)) == 1
    none = passed(-1, -1, -1, -1, -1)
    assert len(path_before_m(PLANNED, none)) == len(path_after_m(PLANNED, none)) == 5


@pytest.mark.parametrize("plan", [None, NO_PLAN])
def test_without_a_plan_no_way_is_known(plan: PlannedRoute | None) -> None:
    assert path_before_m(plan, None).shape == path_after_m(plan, None).shape == (0, 3)
    enu = np.array([[0.0, 0.0, 80.0], [30.0, 40.0, 80.0]])
    (path,) = paths_between_m(enu, np.array([False]), np.array([True, True]), plan, None)
    assert path.tolist() == enu.tolist()
    assert length_of_m(path) == 50.0


def between(samples: Passing, *gaps: int, route: slice = slice(None)) -> list[list[float]]:
    """East of each place of the ways over the gaps of a track of nine samples, 50 m apart."""
    enu = np.column_stack([50.0 * np.arange(9.0), np.ones(9), np.full(9, 80.0)])
    joined = np.ones(8, dtype=bool)
    joined[list(gaps)] = False
    on = np.zeros(9, dtype=bool)
    on[route] = True
    return [path[:, 0].tolist() for path in paths_between_m(enu, joined, on, PLANNED, samples)]


def test_over_a_gap_the_way_leads_over_the_waypoints_in_between() -> None:
    # Passed: 0 at sample 0, 1 at 2, and 4 at 8; 2 and 3 are missing.
    some = passed(0, 2, -1, -1, 8)
    assert between(some, 3) == [[150.0, 200.0, 300.0, 200.0]]
    assert between(some, 0) == [[0.0, 50.0]]
    # A waypoint that was passed right before the gap is behind, one that was passed behind it ahead.
    assert between(some, 2) == [[100.0, 200.0, 300.0, 150.0]]
    assert between(some, 1) == [[50.0, 100.0]]
    assert between(some, 3, 7) == [[150.0, 200.0, 300.0, 200.0], [350.0, 200.0, 300.0, 400.0]]
    assert between(passed(-1, -1, 6, 7, 8), 2) == [[100.0, 0.0, 100.0, 150.0]]
    assert between(passed(0, 1, 2, -1, -1), 5) == [[250.0, 300.0, 400.0, 300.0]]


def test_only_gaps_on_the_route_may_have_seen_something() -> None:
    every = passed(0, 2, 4, 6, 8)
    assert between(every, 1, 3, 6, route=slice(3, 6)) == [[150.0, 200.0]]
    assert len(between(every, 2, 5, route=slice(3, 6))) == 2  # from it and to it
    # The first two waypoints lie in a gap of what seems a transit: coverage there failed instead of not being proved.
    assert between(passed(-1, -1, 4, 6, 8), 1, route=slice(4, 9)) == [[50.0, 0.0, 100.0, 100.0]]
    assert len(between(passed(-1, -1, 4, 6, 8), 0, 1, 2, route=slice(4, 9))) == 1


# Stretches


def found(
    *, moves: tuple[ImpossibleMove, ...] = (), gaps: tuple[int, ...] = (4,), kept: range = range(9)
) -> list[Unobserved]:
    """Nine samples: at rest, along 4 legs of 30 m, and at rest again."""
    east = np.array([0.0, 0.0, 0.0, 30.0, 60.0, 90.0, 120.0, 120.0, 120.0])
    enu = np.column_stack([east, 0.0 * east, np.where((east > 0.0) & (east < 120.0), 40.0, 0.0)])
    site = make_site()
    track = track_of(site, enu, time_s=10.0 * np.arange(9.0), current_waypoint=np.ones(9, dtype=np.int64))
    joined = np.ones(8, dtype=bool)
    joined[list(gaps)] = False
    route = np.zeros(9, dtype=bool)
    route[4:6] = True
    motion = Motion(joined, np.ones(9, dtype=bool), moves, (0.0, 0.0), 0.0)
    return list(unobserved_stretches(site, track, enu, joined, route, motion, np.array(kept)))


def test_a_stretch_has_its_times_place_length_and_phase() -> None:
    (stretch,) = found()
    assert (stretch.start_s, stretch.end_s, stretch.duration_s) == (40.0, 50.0, 10.0)
    assert (stretch.east_m, stretch.north_m, stretch.length_m) == (60.0, 0.0, 30.0)
    site = make_site()
    assert site.frame is not None
    lat, lon, _ = site.frame.geodetic_from_enu([60.0, 0.0, 40.0])
    assert (stretch.lat_deg, stretch.lon_deg) == (lat[0], lon[0])
    assert (stretch.reason, stretch.detail, stretch.phase) == ("no samples", "10.0 s without samples", "route")
    assert [stretch.phase for stretch in found(gaps=(2, 3, 5, 6))] == ["transit", "route", "route", "transit"]


def test_before_it_moves_and_after_it_came_to_rest_it_is_not_in_flight() -> None:
    stretches = found(gaps=tuple(range(8)))
    assert [stretch.in_flight for stretch in stretches] == [False, False, True, True, True, True, False, False]


@pytest.mark.parametrize(
    ("first", "last", "hit"), [(3, 4, False), (3, 5, True), (4, 5, True), (4, 9, True), (5, 6, False)]
)
def test_an_impossible_move_within_it_is_the_reason(first: int, last: int, hit: bool) -> None:
    (stretch,) = found(moves=(ImpossibleMove(first, last, "speed", 90.0, 23.0),))
    if hit:
        assert stretch.reason == "impossible motion"
        assert stretch.detail == "impossible motion: speed 90.0 m/s; at most 23.0 m/s is possible"
    else:
        assert stretch.reason == "no samples"


def test_moves_are_counted_in_the_track_as_it_was_told() -> None:
    # Samples 2 to 11 of the file; the move from 6 to 7 is the gap behind the fifth of them.
    move = ImpossibleMove(6, 7, "speed", 90.0, 23.0)
    assert [stretch.reason for stretch in found(moves=(move,), kept=range(2, 11))] == ["impossible motion"]
    assert [stretch.reason for stretch in found(moves=(move,), kept=range(4, 13))] == ["no samples"]


def test_a_place_is_told_in_degrees_where_there_are_any() -> None:
    assert position_of(make_site(), np.array([0.0, 0.0, 0.0])) == "36.500000, -84.200000"
    assert position_of(make_site(on_earth=False), np.array([12.4, -7.6, 3.0])) == "12 m east, -8 m north"

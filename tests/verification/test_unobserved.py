"""What lies between two samples that are not joined: when, where, why, and which way it may have led."""

import numpy as np
import pytest

from tests.verification.flights import make_site, track_of
from uavcover.model.verdict import Unobserved
from uavcover.verification.flown_route import (
    Passing,
    PlannedRoute,
    length_of_m,
    place_of,
    unobserved_stretches,
    way_after_m,
    way_before_m,
    ways_between_m,
)
from uavcover.verification.possible_motion import ImpossibleMove, Motion

pytestmark = pytest.mark.usefixtures("attitudes_count")

PLAN = PlannedRoute(np.column_stack([100.0 * np.arange(5.0), np.zeros(5), np.full(5, 80.0)]), 0.9)
NO_PLAN = PlannedRoute(np.empty((0, 3)), 0.0)


def passed(*samples: int) -> Passing:
    return Passing(np.array(samples), np.zeros(len(samples)), 5.0)


# The ways that may have been flown


def test_the_planned_ways_before_the_first_and_after_the_last_waypoint_that_was_passed() -> None:
    some = passed(-1, -1, 4, 9, -1)
    assert way_before_m(PLAN, some).tolist() == PLAN.waypoints_m[:3].tolist()
    assert way_after_m(PLAN, some).tolist() == PLAN.waypoints_m[3:].tolist()
    whole = passed(0, 2, 4, 6, 8)
    assert len(way_before_m(PLAN, whole)) == len(way_after_m(PLAN, whole)) == 1
    none = passed(-1, -1, -1, -1, -1)
    assert len(way_before_m(PLAN, none)) == len(way_after_m(PLAN, none)) == 5


@pytest.mark.parametrize("plan", [None, NO_PLAN])
def test_without_a_plan_no_way_is_known(plan: PlannedRoute | None) -> None:
    assert way_before_m(plan, None).shape == way_after_m(plan, None).shape == (0, 3)
    enu = np.array([[0.0, 0.0, 80.0], [30.0, 40.0, 80.0]])
    (way,) = ways_between_m(enu, np.array([False]), np.array([True, True]), plan, None)
    assert way.tolist() == enu.tolist()
    assert length_of_m(way) == 50.0


def between(samples: Passing, *gaps: int, route: slice = slice(None)) -> list[list[float]]:
    """East of each place of the ways over the gaps of a track of nine samples, 50 m apart."""
    enu = np.column_stack([50.0 * np.arange(9.0), np.ones(9), np.full(9, 80.0)])
    joined = np.ones(8, dtype=bool)
    joined[list(gaps)] = False
    on = np.zeros(9, dtype=bool)
    on[route] = True
    return [way[:, 0].tolist() for way in ways_between_m(enu, joined, on, PLAN, samples)]


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
    assert place_of(make_site(), np.array([0.0, 0.0, 0.0])) == "36.500000, -84.200000"
    assert place_of(make_site(on_earth=False), np.array([12.4, -7.6, 3.0])) == "12 m east, -8 m north"

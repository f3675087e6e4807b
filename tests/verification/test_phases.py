"""Which samples are the planned route: by the numbers, by the places where these show more, and by the places alone."""

import numpy as np
import pytest

from tests.verification.flights import make_site, track_of
from uavcover.verification.flown_route import Passing, PlannedRoute, on_route

SAMPLES = 40
PLAN = PlannedRoute(np.column_stack([20.0 * np.arange(1.0, 8.0), np.zeros(7), np.full(7, 80.0)]), 0.9)
ALONG_M = np.column_stack([4.0 * np.arange(SAMPLES), np.zeros(SAMPLES), np.full(SAMPLES, 80.0)])


def span_of(
    reported: dict[tuple[int, int], int],
    passed: dict[int, int] | None = None,
    *,
    believed: bool = True,
    plan: PlannedRoute | None = PLAN,
    enu_m: np.ndarray = ALONG_M,
) -> tuple[int, int] | None:
    """First and last sample of the route, by numbers told from one sample to another, and samples that passed waypoints."""
    numbers = np.full(len(enu_m), -1)
    for (first, last), number in reported.items():
        numbers[first : last + 1] = number
    positions = None
    if passed is not None:
        samples = np.full(len(PLAN.waypoints_m), -1)
        for waypoint, sample in passed.items():
            samples[waypoint] = sample
        positions = Passing(samples, np.zeros(samples.size), 5.0)
    track = track_of(make_site(), enu_m, time_s=np.arange(float(len(enu_m))), current_waypoint=numbers)
    route = on_route(track, enu_m, plan, acceptance_radius_m=3.0, passed=positions, believed=believed)
    chosen = np.flatnonzero(route)
    if chosen.size == 0:
        return None
    assert (np.diff(chosen) == 1).all()
    return int(chosen[0]), int(chosen[-1])


def test_from_the_way_to_waypoint_1_to_the_last_number() -> None:
    assert span_of({(2, 9): 0, (10, 19): 1, (20, 25): 2}) == (10, 25)
    # Whatever stands in between.
    assert span_of({(10, 12): 1, (13, 15): 0, (20, 25): 2}) == (10, 25)
    assert span_of({(2, 30): 0}) is None
    assert span_of({(10, 25): 1}, {0: 10, 1: 25}) == (10, 25)


TOLD = {(10, 14): 3, (15, 20): 4}


@pytest.mark.parametrize(
    ("passed", "span"),
    [
        ({3: 15}, (10, 20)),
        ({2: 6, 3: 15}, (10, 20)),  # the waypoint behind which the numbers begin
        ({1: 4, 3: 15}, (10, 20)),  # one, which may be by chance
        ({1: 10, 3: 15}, (10, 20)),
        ({0: 2, 3: 15}, (2, 20)),  # the beginning of the route
        ({0: 2, 1: 4, 3: 15}, (2, 20)),
        ({1: 4, 2: 6, 3: 15}, (10, 20)),
        ({0: 10, 3: 15}, (10, 20)),
        ({3: 15, 4: 22}, (10, 20)),  # one, which may be by chance
        ({3: 15, 4: 20, 5: 25}, (10, 20)),
        ({3: 15, 4: 22, 5: 25}, (10, 25)),
        ({3: 15, 5: 25, 4: 22, 6: 30}, (10, 30)),
        ({3: 15, 6: 30}, (10, 30)),  # the end of the route
        ({2: 22, 3: 25}, (10, 20)),  # of the part that was flown already
        ({3: 25, 4: 26}, (10, 20)),
        ({0: 2, 1: 4, 4: 22, 5: 25}, (2, 25)),
    ],
)
def test_where_the_places_show_more_of_the_plan_that_belongs_to_it(
    passed: dict[int, int], span: tuple[int, int]
) -> None:
    assert span_of(TOLD, passed) == span


def test_two_waypoints_before_the_numbers_begin() -> None:
    late = {(10, 14): 5, (15, 20): 6}
    assert span_of(late, {1: 4, 3: 6, 5: 15}) == (4, 20)
    assert span_of(late, {3: 6, 5: 15}) == (10, 20)
    assert span_of(late, {3: 6, 4: 7, 5: 15}) == (10, 20)


def test_behind_the_last_number_the_end_of_the_plan_is_where_it_led_anyhow() -> None:
    assert span_of({(10, 20): 6}, {5: 10, 6: 22}) == (10, 20)


def test_numbers_that_never_reach_1_are_overruled_by_two_waypoints() -> None:
    assert span_of({(2, 30): 0}, {0: 5, 1: 12, 3: 21}) == (5, 21)
    assert span_of({(2, 30): 0}, {0: 5, 1: 12}) == (5, 12)
    assert span_of({(2, 30): 0}, {0: 5}) is None
    assert span_of({(2, 30): 0}, {}) is None


# Places alone: the plan leads from 20 m to 140 m east, and the samples are 4 m apart.


def test_numbers_that_are_not_believed_say_nothing() -> None:
    assert span_of(TOLD, believed=False) == (5, 35)
    assert span_of({}) == (5, 35)


def test_without_a_plan_everything_counts() -> None:
    assert span_of({}, plan=None) == (0, SAMPLES - 1)
    assert span_of({}, plan=PlannedRoute(np.empty((0, 3)), 0.0)) == (0, SAMPLES - 1)
    assert span_of(TOLD, plan=None) == (10, 20)


def test_a_plan_of_one_waypoint_is_where_it_was_nearest_whatever_the_numbers_say() -> None:
    assert span_of(TOLD, plan=PlannedRoute(PLAN.waypoints_m[:1], 0.1)) == (5, 5)


def test_there_and_back_the_first_approach_begins_and_the_last_one_ends() -> None:
    there_and_back = np.vstack([ALONG_M, ALONG_M[::-1]])
    assert span_of({}, enu_m=there_and_back) == (5, 2 * SAMPLES - 1 - 35)
    # One that comes nearer later is not the first; a metre nearer is no other approach.
    later = there_and_back.copy()
    later[:SAMPLES, 1] = 2.0
    assert span_of({}, enu_m=later) == (5, 2 * SAMPLES - 1 - 35)
    later[:SAMPLES, 1] = 4.0
    assert span_of({}, enu_m=later) == (2 * SAMPLES - 1 - 35, 2 * SAMPLES - 1 - 5)


def test_flown_backwards_it_is_the_same_stretch() -> None:
    assert span_of({}, enu_m=ALONG_M[::-1].copy()) == (4, 34)

"""Which waypoints count as passed, where a track left its route, and what is left of it."""

import numpy as np
import pytest

from uavcover.flight.progress import Passage
from uavcover.flight.resume import ResumePoint, find_resume_point, remaining_route
from uavcover.model.track import Track

ROUTE_M = np.array([(0.0, 0.0, 50.0), (100.0, 0.0, 50.0), (100.0, 40.0, 50.0), (0.0, 40.0, 50.0)])
FAR_M = np.array([50.0, 300.0, 80.0])


def passage_of(*moments: tuple[int, tuple[float, float, float]], radius_m: float = 3.0) -> Passage:
    passage = Passage(ROUTE_M, radius_m=radius_m)
    for number, position_m in moments:
        passage.take(number, np.array(position_m))
    return passage


def test_going_on_one_by_one_counts_wherever_the_vehicle_turns():
    wide = [(k, tuple(FAR_M)) for k in (-1, 0, 1, 2, 3)]
    assert passage_of(*wide).reached == 3


def test_a_place_near_the_waypoint_counts():
    assert passage_of((0, (0.0, 2.0, 50.0))).reached == 1
    assert passage_of((0, (0.0, 4.0, 50.0))).reached == 0


def test_a_jump_passes_nothing():
    jumped = passage_of((0, tuple(FAR_M)), (1, tuple(FAR_M)), (3, tuple(FAR_M)), (3, tuple(ROUTE_M[3])))
    assert jumped.reached == 1


def test_a_missed_message_counts_what_was_flown_past():
    observed = passage_of((0, tuple(ROUTE_M[0])), (2, tuple(ROUTE_M[1])), (2, (100.0, 39.0, 50.0)))
    assert observed.reached == 3


def test_two_waypoints_close_together_are_passed_between_two_positions():
    """The vehicle turns just inside the radius: neither position is there, and the item between them was never told."""
    observed = passage_of(
        (0, tuple(ROUTE_M[0])), (1, (90.0, 0.0, 50.0)), (3, (100.0, 3.0, 50.0)), (3, (97.0, 39.0, 50.0))
    )
    assert observed.reached == 3


@pytest.mark.parametrize(("position", "reached"), [(ROUTE_M[3], 4), (FAR_M, 3)], ids=["there", "elsewhere"])
def test_the_last_one_counts_where_the_vehicle_goes_on_to_something_else(position, reached):
    flown = [(k, tuple(ROUTE_M[k])) for k in range(3)]
    assert passage_of(*flown, (3, tuple(FAR_M)), (-1, tuple(position))).reached == reached


def test_passing_by_on_the_way_home_counts_nothing():
    stopped = passage_of(
        (0, tuple(ROUTE_M[0])), (1, (50.0, 0.0, 50.0)), (-1, (60.0, 0.0, 50.0)), (-1, tuple(ROUTE_M[1]))
    )
    assert stopped.reached == 1


def test_belief_never_counts_back_or_beyond_the_end():
    passage = passage_of((0, tuple(ROUTE_M[0])))
    passage.believe(3)
    passage.believe(2)
    assert passage.reached == 3
    passage.believe(9)
    assert passage.reached == 4
    assert passage.complete


SLOPED_M = np.array([(0.0, 0.0, 50.0), (100.0, 0.0, 50.0), (100.0, 40.0, 60.0), (0.0, 40.0, 50.0)])


def flown(
    *parts: tuple[int, tuple[float, float, float], tuple[float, float, float]], lost: slice | None = None
) -> Track:
    """Straight parts at 10 m/s and 10 Hz, each with its waypoint number."""
    rows = []
    for number, begin, end in parts:
        count = max(2, int(np.linalg.norm(np.subtract(end, begin))) + 1)
        rows += [(number, *position) for position in np.linspace(begin, end, count).tolist()]
    table = np.array(rows)
    time_s = 100.0 + 0.1 * np.arange(len(table))
    if lost is not None:
        table, time_s = np.delete(table, lost, axis=0), np.delete(time_s, lost)
    positions = table[:, 1:].copy()
    return Track(time_s, positions.copy(), positions, np.zeros((len(table), 3)), table[:, 0].astype(np.int64))


def legs(count: int) -> list[tuple[int, tuple[float, ...], tuple[float, ...]]]:
    """The way there and the first ``count`` legs, whole."""
    there = (0, (-50.0, 0.0, 60.0), tuple(SLOPED_M[0]))
    return [there, *((k, tuple(SLOPED_M[k - 1]), tuple(SLOPED_M[k])) for k in range(1, count + 1))]


def found(*parts, **options) -> ResumePoint:
    return find_resume_point(flown(*parts, **options), SLOPED_M, radius_m=3.0)


def test_a_whole_flight_leaves_nothing():
    broken = found(*legs(3), (-1, tuple(SLOPED_M[3]), (-50.0, 0.0, 60.0)))
    assert broken.waypoint == 4
    assert len(remaining_route(SLOPED_M, broken, radius_m=3.0, observes_along_legs=True)) == 0


def test_a_flight_that_never_came_to_the_route_leaves_all_of_it():
    broken = found((-1, (-50.0, 0.0, 0.0), (-50.0, 0.0, 60.0)), (0, (-50.0, 0.0, 60.0), (-20.0, 0.0, 60.0)))
    assert broken == ResumePoint(0, 0.0)
    assert (remaining_route(SLOPED_M, broken, radius_m=3.0, observes_along_legs=True) == SLOPED_M).all()


def test_a_leg_that_was_left_is_gone_on_with_a_little_before_that_place():
    broken = found(*legs(0), (1, tuple(SLOPED_M[0]), (60.0, 1.0, 50.0)), (-1, (60.0, 1.0, 50.0), (60.0, 80.0, 0.0)))
    assert broken.waypoint == 1
    assert broken.flown_m == pytest.approx(60.0, abs=0.1)
    left = remaining_route(SLOPED_M, broken, radius_m=3.0, observes_along_legs=True)
    assert left[0] == pytest.approx([60.0 - 6.0 - 5.0, 0.0, 50.0], abs=0.1)
    assert (left[1:] == SLOPED_M[1:]).all()
    assert (remaining_route(SLOPED_M, broken, radius_m=3.0, observes_along_legs=False) == SLOPED_M[1:]).all()


def test_who_drifts_off_the_leg_has_not_flown_it():
    away = (1, (30.0, 0.0, 50.0), (90.0, 60.0, 50.0))
    assert found(*legs(0), (1, tuple(SLOPED_M[0]), (30.0, 0.0, 50.0)), away).flown_m == pytest.approx(39.0, abs=1.0)


def test_what_was_not_recorded_for_a_while_is_believed_but_not_a_jump():
    whole = legs(3)
    silent = found(*whole, lost=slice(60, 240))
    assert silent.waypoint == 4
    assert found(*legs(1), (3, tuple(SLOPED_M[1]), (60.0, 90.0, 50.0))).waypoint == 2


def test_a_route_left_right_at_a_waypoint_begins_there():
    broken = found(*legs(2))
    assert broken.waypoint == 3
    assert broken.flown_m == pytest.approx(0.0, abs=0.2)
    assert (remaining_route(SLOPED_M, broken, radius_m=3.0, observes_along_legs=True) == SLOPED_M[2:]).all()

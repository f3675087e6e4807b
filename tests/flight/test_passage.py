"""Which waypoints count as passed."""

import numpy as np
import pytest

from uavcover.flight.progress import Passage

ROUTE_M = np.array([(0.0, 0.0, 50.0), (100.0, 0.0, 50.0), (100.0, 40.0, 50.0), (0.0, 40.0, 50.0)])
FAR_M = np.array([50.0, 300.0, 80.0])


def passage_of(*moments: tuple[int, tuple[float, float, float]], radius_m: float = 3.0) -> Passage:
    passage = Passage(ROUTE_M, radius_m=radius_m)
    for number, place_m in moments:
        passage.take(number, np.array(place_m))
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
    seen = passage_of((0, tuple(ROUTE_M[0])), (2, tuple(ROUTE_M[1])), (2, (100.0, 39.0, 50.0)))
    assert seen.reached == 3


def test_two_waypoints_close_together_are_passed_between_two_positions():
    """The vehicle turns just inside the radius: neither position is there, and the item between them was never told."""
    seen = passage_of((0, tuple(ROUTE_M[0])), (1, (90.0, 0.0, 50.0)), (3, (100.0, 3.0, 50.0)), (3, (97.0, 39.0, 50.0)))
    assert seen.reached == 3


@pytest.mark.parametrize(("place", "reached"), [(ROUTE_M[3], 4), (FAR_M, 3)], ids=["there", "elsewhere"])
def test_the_last_one_counts_where_the_vehicle_goes_on_to_something_else(place, reached):
    flown = [(k, tuple(ROUTE_M[k])) for k in range(3)]
    assert passage_of(*flown, (3, tuple(FAR_M)), (-1, tuple(place))).reached == reached


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

"""Speed over ground, distance from the plan, and whether the pace of a track can be that of its mission."""

import numpy as np
import pytest

from tests.verification.flights import make_site, track_of
from uavcover.model.track import Track
from uavcover.model.vehicle import Vehicle
from uavcover.verification.flown_route import PlannedRoute
from uavcover.verification.safety import commanded_pace_doubt, deviations_m, ground_speeds_m_s

VEHICLE = Vehicle(cruise_speed_m_s=10.0, max_climb_m_s=4.0, max_descent_m_s=3.0)
LONG_LEG = PlannedRoute(np.array([[0.0, 0.0, 80.0], [100.0, 0.0, 80.0]]), 0.5)


def track(time_s: np.ndarray, enu_m: np.ndarray) -> Track:
    return track_of(make_site(), enu_m, time_s=time_s, current_waypoint=np.ones(len(time_s), dtype=np.int64))


def steady(velocity: tuple[float, float, float], seconds: float = 60.0) -> tuple[np.ndarray, np.ndarray]:
    time_s = np.arange(0.0, seconds, 0.5)
    return time_s, np.outer(time_s, velocity)


def doubt(
    time_s: np.ndarray, enu_m: np.ndarray, plan: PlannedRoute | None = None, *, gaps: tuple[int, ...] = ()
) -> str | None:
    joined = np.ones(len(time_s) - 1, dtype=bool)
    joined[list(gaps)] = False
    return commanded_pace_doubt(track(time_s, enu_m), enu_m, joined, VEHICLE, plan)


# Speed


def test_the_speed_is_the_way_of_the_second_around_a_sample() -> None:
    time_s = np.array([0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 10.0, 11.0, 20.0])
    along = np.array([0.0, 1.0, 2.0, 4.0, 6.0, 9.0, 12.0, 20.0, 27.0, 90.0])
    enu = np.column_stack([0.6 * along, -0.8 * along, 5.0 * along])
    joined = np.array([True] * 6 + [False, True, False])
    speeds = ground_speeds_m_s(track(time_s, enu), enu, joined)
    # Half a second to each side, and at the ends of what was observed the half that there is; heights do not count.
    assert speeds[:7] == pytest.approx([4.0, 4.0 / 0.75, 6.0, 8.0, 10.0, 8.0 / 0.75, 12.0])
    assert speeds[7:9] == pytest.approx([7.0, 7.0])
    assert np.isnan(speeds[9])


def test_the_deviation_is_known_on_the_route_alone() -> None:
    enu = np.array([[0.0, 5.0, 80.0], [50.0, 5.0, 80.0], [50.0, 0.0, 92.0], [103.0, 4.0, 80.0]])
    route = np.array([False, True, True, True])
    found = deviations_m(enu, route, LONG_LEG)
    assert found is not None
    assert np.isnan(found[0])
    assert found[1:] == pytest.approx([5.0, 12.0, 5.0])
    assert deviations_m(enu, ~np.ones(4, dtype=bool), LONG_LEG) is None
    assert deviations_m(enu, route, None) is None
    assert deviations_m(enu, route, PlannedRoute(np.empty((0, 3)), 0.0)) is None


# Pace


@pytest.mark.parametrize(
    ("velocity", "words"),
    [
        ((10.0, 0.0, 0.0), None),
        ((14.4, 0.0, 0.0), None),
        ((0.0, -14.6, 0.0), "flies at 14.6 m/s for several seconds instead of the planned 10 m/s"),
        ((0.0, 0.0, 5.9), None),
        ((2.0, 0.0, 6.1), "climbs at 6.1 m/s for several seconds instead of the planned 4 m/s"),
        ((0.0, 0.0, -4.7), None),
        ((2.0, 0.0, -4.8), "descends at 4.8 m/s for several seconds instead of the planned 3 m/s"),
    ],
)
def test_a_sustained_pace_beyond_what_is_commanded(velocity: tuple[float, float, float], words: str | None) -> None:
    said = doubt(*steady(velocity))
    assert said is None if words is None else said is not None and words in said


def test_a_gust_is_no_pace() -> None:
    time_s = np.arange(0.0, 120.0, 0.5)
    speed = np.where((time_s > 50.0) & (time_s < 53.0), 16.0, 10.0)
    enu = np.column_stack([np.cumsum(speed) * 0.5, 0.0 * time_s, 80.0 + 0.0 * time_s])
    assert doubt(time_s, enu) is None


def test_ways_across_a_gap_and_shorter_ones_than_5_s_are_not_looked_at() -> None:
    time_s, enu = steady((16.0, 0.0, 0.0), seconds=20.5)
    assert doubt(time_s, enu) is not None
    # Every 4.5 s a gap.
    assert doubt(time_s, enu, gaps=(8, 17, 26, 35)) is None
    assert doubt(*steady((16.0, 0.0, 0.0), seconds=5.0)) is None
    assert doubt(*steady((16.0, 0.0, 0.0), seconds=5.5)) is not None


def test_a_leg_that_was_not_flown_has_no_pace() -> None:
    """A flight that turns home before its first long leg ends flies as slowly as its climb."""
    time_s, enu_m = steady((3.0, 0.0, 0.0))
    joined = np.ones(len(time_s) - 1, dtype=bool)
    for passed, slow in (([True, True], True), ([True, False], False), ([False, False], False)):
        said = commanded_pace_doubt(track(time_s, enu_m), enu_m, joined, VEHICLE, LONG_LEG, passed=np.array(passed))
        assert (said is not None) == slow


@pytest.mark.parametrize(("speed_m_s", "slow"), [(3.9, True), (4.1, False)])
def test_one_that_never_comes_near_the_planned_pace(speed_m_s: float, slow: bool) -> None:
    said = doubt(*steady((0.0, speed_m_s, 0.0)), LONG_LEG)
    if slow:
        assert said is not None
        assert "never flies faster than 3.9 m/s instead of the planned 10.0 m/s; its clock" in said
    else:
        assert said is None
    # For a moment is enough.
    time_s, enu = steady((0.0, 3.9, 0.0))
    enu[60:75, 1] += np.linspace(0.0, 10.0, 15)
    enu[75:, 1] += 10.0
    assert doubt(time_s, enu, LONG_LEG) is None


def test_legs_too_short_to_come_to_speed_and_steep_ones_ask_for_less() -> None:
    slowly = steady((0.0, 1.7, 0.0))
    for end_m, slow in (
        ((99.0, 0.0, 80.0), False),
        ((60.0, 80.0, 80.0), True),
        ((100.0, 0.0, 180.0), False),  # 25 s for the climb: 4 m/s over ground
        ((100.0, 0.0, 130.0), True),  # 12.5 s: 8 m/s
        ((100.0, 0.0, 0.0), False),  # 27 s for the descent: 3.7 m/s
        ((100.0, 0.0, 50.0), True),  # as fast as level
    ):
        plan = PlannedRoute(np.array([[0.0, 0.0, 80.0], end_m]), 0.5)
        assert (doubt(*slowly, plan) is not None) == slow, end_m
    # The fastest leg is what counts.
    both = PlannedRoute(np.array([[0.0, 0.0, 80.0], [100.0, 0.0, 180.0], [200.0, 0.0, 180.0]]), 0.5)
    assert doubt(*slowly, both) is not None
    assert doubt(*slowly, PlannedRoute(LONG_LEG.waypoints_m[:1], 0.5)) is None
    assert doubt(*slowly, None) is None

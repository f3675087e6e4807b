"""What a vehicle can do at most, where exactly a motion is beyond it, and the pace of a mission."""

import numpy as np
import pytest

from tests.verification.flights import make_site, track_of
from uavcover.model.track import Track
from uavcover.model.vehicle import Vehicle, Wind
from uavcover.verification.flown_route import PlannedRoute
from uavcover.verification.measured_motion import NOISE_MEDIANS, Windows
from uavcover.verification.possible_motion import ImpossibleMove, Motion, MotionLimits, judge_motion, motion_limits
from uavcover.verification.safety import commanded_pace_doubt, deviations_m, ground_speeds_m_s

LIMITS = MotionLimits(speed_m_s=20.0, climb_m_s=10.0, descent_m_s=6.0, acceleration_m_s2=6.0)
LEAN_35_M_S2 = pytest.approx(9.80665 * 0.70021, rel=1e-4)


@pytest.mark.parametrize(
    ("vehicle", "wind_m_s", "speed_m_s"),
    [
        ({}, 0.0, 15.0 + 8.0),
        ({}, 12.0, 15.0 + 12.0),
        ({"max_airspeed_m_s": 20.0}, 0.0, 20.0 + 2.0),
        ({"max_airspeed_m_s": 12.0}, 5.0, 15.0 + 5.0),
    ],
)
def test_the_largest_speed_over_ground(vehicle: dict[str, float], wind_m_s: float, speed_m_s: float) -> None:
    assert motion_limits(Vehicle(**vehicle), Wind(speed_m_s=wind_m_s)).speed_m_s == pytest.approx(speed_m_s)


def test_the_largest_vertical_speeds_and_accelerations() -> None:
    limits = motion_limits(Vehicle(max_climb_m_s=5.0, max_descent_m_s=1.5), Wind())
    assert (limits.climb_m_s, limits.descent_m_s, limits.acceleration_m_s2) == (12.0, 5.0, LEAN_35_M_S2)
    assert motion_limits(Vehicle(acceleration_m_s2=3.0), Wind()).acceleration_m_s2 == LEAN_35_M_S2
    assert motion_limits(Vehicle(acceleration_m_s2=5.0), Wind()).acceleration_m_s2 == 10.0


def test_an_impossible_move_in_words() -> None:
    assert str(ImpossibleMove(3, 5, "climb", 12.34, 10.0)) == "climb 12.3 m/s; at most 10.0 m/s is possible"
    assert str(ImpossibleMove(3, 5, "acceleration", 9.0, 6.0)).startswith("acceleration 9.0 m/s2; at most 6.0 m/s2")
    assert str(ImpossibleMove(3, 5, "out of reach", 90.0, 20.0)).startswith("speed 90.0 m/s; at most 20.0 m/s")


# Speed and acceleration


def judged(time_s: np.ndarray, enu_m: np.ndarray, *, max_gap_s: float = 2.0) -> Motion:
    return judge_motion(time_s, enu_m, LIMITS, max_gap_s=max_gap_s)


@pytest.mark.parametrize("rate_hz", [1, 5, 20])
@pytest.mark.parametrize(
    ("velocity", "kind", "limit"),
    [
        ((20.5, 0.0, 0.0), "speed", 20.0),
        ((12.5, -16.3, 0.0), "speed", 20.0),
        ((0.0, 0.0, 10.5), "climb", 10.0),
        ((1.0, 0.0, -6.5), "climb", 6.0),
        ((19.9, 0.0, 0.0), None, 0.0),
        ((0.0, 0.0, 9.9), None, 0.0),
        ((0.0, 0.0, -5.9), None, 0.0),
    ],
)
def test_a_little_faster_than_it_can_is_impossible_and_a_little_slower_is_not(
    velocity: tuple[float, float, float], kind: str | None, limit: float, rate_hz: int
) -> None:
    time_s = np.arange(0.0, 30.0, 1.0 / rate_hz)
    motion = judged(time_s, np.outer(time_s, velocity))
    if kind is None:
        assert motion.moves == ()
        assert motion.joined.all()
        assert motion.evidence.all()
        return
    (move,) = motion.moves
    assert (move.first, move.last, move.kind, move.limit) == (0, len(time_s) - 1, kind, limit)
    assert move.worst == pytest.approx(max(np.hypot(*velocity[:2]) if kind == "speed" else 0.0, abs(velocity[2])))
    assert not motion.joined.any()
    # Something has to stand for the flight: its first sample.
    assert np.flatnonzero(motion.evidence).tolist() == [0]


@pytest.mark.parametrize("velocity", [(20.0, 0.0, 0.0), (0.0, -20.0, 0.0), (0.0, 0.0, 10.0), (0.0, 0.0, -6.0)])
def test_the_limit_itself_is_possible(velocity: tuple[float, float, float]) -> None:
    time_s = np.arange(0.0, 30.0)
    assert judged(time_s, np.outer(time_s, velocity)).moves == ()


def test_a_turn_that_it_can_fly_is_possible() -> None:
    time_s = np.arange(0.0, 40.0, 0.1)
    angle, radius_m = 2.0 * np.pi * time_s / 10.0, 5.9 * (10.0 / 2.0 / np.pi) ** 2
    assert (
        judged(time_s, np.column_stack([radius_m * np.cos(angle), radius_m * np.sin(angle), 0.0 * time_s])).moves == ()
    )


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize(("brake_m_s2", "possible"), [(5.8, True), (6.4, False), (15.0, False)])
def test_a_brake_beyond_the_limit_is_marked_where_it_is(axis: int, brake_m_s2: float, possible: bool) -> None:
    time_s = np.arange(0.0, 40.0, 0.1)
    # Down it may be 6 m/s at most.
    fast = 15.0 if axis < 2 else -5.9
    ends_s = 20.0 + abs(fast) / brake_m_s2
    speed = np.sign(fast) * np.clip(abs(fast) - brake_m_s2 * (time_s - 20.0), 0.0, abs(fast))
    enu = np.zeros((time_s.size, 3))
    enu[:, axis] = np.cumsum(speed) * 0.1
    motion = judged(time_s, enu)
    if possible:
        assert motion.moves == ()
        return
    (move,) = motion.moves
    assert (move.kind, move.limit) == ("acceleration", 6.0)
    assert move.worst == pytest.approx(brake_m_s2, rel=0.1)
    assert 17.5 < time_s[move.first] < 20.3
    assert ends_s - 0.3 < time_s[move.last] < ends_s + 2.5


def test_samples_at_max_gap_are_joined_and_further_ones_are_not() -> None:
    time_s = np.array([0.0, 2.0, 4.0, 6.25, 8.25])
    motion = judged(time_s, np.outer(time_s, [3.0, 0.0, 0.0]))
    assert motion.joined.tolist() == [True, True, False, True]
    assert motion.evidence.all()
    assert motion.moves == ()


# What can be reached


def stretches(*parts: tuple[float, float, tuple[float, float, float]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Parts from one time to another at rest at a place each; with the number of the part of each sample."""
    times = [np.arange(begin, end + 0.05, 0.1) for begin, end, _ in parts]
    positions = [np.tile(position, (len(time), 1)) for time, (_, _, position) in zip(times, parts, strict=True)]
    number = np.repeat(np.arange(len(parts)), [len(time) for time in times])
    return np.concatenate(times), np.vstack(positions), number


@pytest.mark.parametrize(
    ("position", "reached"),
    [
        ((204.0, 0.0, 0.0), True),  # 20 m/s for 10 s, and a jump of 5 m
        ((0.0, -206.0, 0.0), False),
        ((0.0, 0.0, 104.0), True),  # 10 m/s up
        ((0.0, 0.0, 106.0), False),
        ((0.0, 0.0, -64.0), True),  # 6 m/s down
        ((0.0, 0.0, -66.0), False),
    ],
)
@pytest.mark.parametrize("after", [True, False])
def test_a_stretch_that_cannot_be_reached_in_the_gap_is_no_evidence(
    position: tuple[float, float, float], reached: bool, after: bool
) -> None:
    parts = [(0.0, 20.0, (0.0, 0.0, 0.0)), (30.0, 35.0, position)]
    if not after:
        # The shorter one first: seen from the longer one the way to it leads back.
        parts = [(0.0, 5.0, (0.0, 0.0, 0.0)), (15.0, 35.0, position)]
    time_s, enu, number = stretches(*parts)
    motion = judged(time_s, enu)
    short = 1 if after else 0
    assert motion.evidence.tolist() == [bool(reached or part != short) for part in number]
    if reached:
        assert motion.moves == ()
        return
    (move,) = motion.moves
    chosen = np.flatnonzero(number == short)
    assert (move.first, move.last, move.kind, move.limit) == (chosen[0], chosen[-1], "out of reach", 20.0)
    # Against the limit of its own direction, as a speed over ground.
    most = 20.0 if position[2] == 0.0 else 10.0 if position[2] > 0.0 else 6.0
    assert move.worst == pytest.approx((max(map(abs, position)) - 5.0) / 10.0 * 20.0 / most)


def test_what_comes_behind_an_unreachable_stretch_is_asked_for_from_the_last_one_that_counts() -> None:
    far = (2000.0, 0.0, 0.0)
    time_s, enu, number = stretches(
        (0.0, 5.0, far), (10.0, 14.0, (30.0, 0.0, 0.0)), (20.0, 50.0, (0.0, 0.0, 0.0)),
        (60.0, 65.0, far), (70.0, 75.0, (10.0, 0.0, 0.0)),
    )  # fmt: skip
    motion = judged(time_s, enu)
    assert motion.evidence.tolist() == [bool(part in (1, 2, 4)) for part in number]
    assert [move.kind for move in motion.moves] == ["out of reach", "out of reach"]
    assert [int(number[move.first]) for move in motion.moves] == [0, 3]


def test_a_single_sample_far_away_hangs_in_the_air() -> None:
    time_s = np.arange(0.0, 20.0, 0.5)
    enu = np.outer(time_s, [5.0, 0.0, 0.0])
    enu[20] += [0.0, 30.0, 0.0]
    motion = judged(time_s, enu)
    assert not motion.evidence[20]
    assert motion.evidence[:15].all()
    assert motion.evidence[26:].all()
    assert len(motion.moves) == 1
    assert motion.moves[0].first <= 19 < 21 <= motion.moves[0].last


def test_two_jumps_within_a_second_are_one_place_and_further_apart_two() -> None:
    for apart_s, count in ((1.2, 1), (1.6, 2)):
        time_s = np.arange(0.0, 60.0, 0.1)
        enu = np.outer(time_s, [4.0, 0.0, 0.0])
        enu[(time_s > 20.0) & (time_s < 20.0 + apart_s), 1] = 4.0
        assert len(judged(time_s, enu).moves) == count


# Noise


def test_windows_are_the_nearest_samples_at_least_their_length_away() -> None:
    time_s = np.array([0.0, 0.4, 1.0, 1.5, 2.1, 3.0])
    enu = np.column_stack([3.0 * time_s**2, 0.0 * time_s, -2.0 * time_s**2])
    windows = Windows.of(time_s, enu, window_s=1.0)
    assert windows.middle.tolist() == [2, 3]
    assert windows.before.tolist() == [0, 1]
    assert windows.after.tolist() == [4, 5]
    # Divided differences of a parabola are its acceleration, however far apart the samples are.
    np.testing.assert_allclose(windows.level_m_s2, 6.0)
    np.testing.assert_allclose(windows.vertical_m_s2, 4.0)
    np.testing.assert_allclose(windows.spans_s2, [1.0 * 1.1, 1.1 * 1.5])
    # None across a gap.
    gap = np.array([True, True, True, False, True])
    assert Windows.of(time_s, enu, window_s=1.0, joined=gap).middle.size == 0


def test_noise_is_the_median_where_it_moves_and_is_allowed_for_up_to_a_ceiling() -> None:
    time_s = np.arange(0.0, 40.0, 0.2)
    enu = np.column_stack([np.maximum(0.0, time_s - 20.0) * 5.0, 0.0 * time_s, 0.0 * time_s])
    zigzag = np.where(np.arange(time_s.size) % 2, 0.06, -0.06)
    moving = enu + np.where(time_s > 20.0, zigzag, 0.0)[:, None] * [0.0, 1.0, 0.5]
    windows = Windows.of(time_s, moving, window_s=0.2)
    # From one side to the other and back again: four times the amplitude.
    assert windows.noise_m == (pytest.approx(0.24), pytest.approx(0.12))
    assert windows.allowance_m(0) == pytest.approx(NOISE_MEDIANS * 0.24)
    np.testing.assert_allclose(windows.allowance_m_s2(1), NOISE_MEDIANS * 0.12 / windows.spans_s2)
    # At rest there is nothing to measure it by.
    resting = np.where(time_s > 20.0, 0.0, zigzag)[:, None] * [0.0, 1.0, 0.5]
    assert Windows.of(time_s, resting, window_s=0.2).noise_m == (0.0, 0.0)
    wild = Windows.of(
        time_s, enu + np.where(time_s > 20.0, 100.0 * zigzag, 0.0)[:, None] * [0.0, 1.0, 0.0], window_s=0.2
    )
    # An error of 2 m that wanders within 30 s: 1.18 x 2 x 2 m x sqrt(0.2 / 30), six times, and the rounding.
    assert wild.allowance_m(0) == pytest.approx(6.0 * 1.18 * 4.0 * np.sqrt(0.2 / 30.0) + 0.25)


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

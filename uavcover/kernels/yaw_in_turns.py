"""Heading of the vehicle along a flown line: it yaws at a limited rate while it flies on.

PX4 also limits how fast that rate changes (HeadingSmoothing): a turn by 90 degrees takes 4.2 s instead of 1.5.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.flight_time import Pace, circle_speed, stopping_speed
from uavcover.kernels.jit import allocating_kernel, kernel

_AT_ONCE_DEG = 5.0
"""Smaller turns on a leg happen at once. With 20 degrees, a plan over 40 m claimed 0.5 points more."""

_STEP_DEG = 3.0
"""Largest step of a turn on a leg; the heading is that of the middle of each step. Smaller steps give the same coverage; steps
of 10 degrees give up to 0.4 points less, steps of 60 degrees a point."""

_LEAST_M = 1e-6
_MOST_STEPS = math.ceil(360.0 / _STEP_DEG) + 1
"""On one leg: half of them for half a turn. If the vehicle yaws the other way when a leg begins, it goes on by 90 degrees, and
back."""

_LACKING, _MADE_UP, _LACKING_LONGER = 0.45, 0.7, 2.0
"""Fraction of its set speed that PX4 lacks when a leg begins, fraction of that which speed along the leg makes up for, and in
how many times the time of settling it is over: as in the mock vehicle, whose flights take PX4's time
(docs/results/flight_time.md)."""

_SLOWEST_M_S = 0.3
"""At the end of a leg, if the remaining distance requires less."""

_TIME_STEP_S = 0.02
_ALIGNED_DEG = 0.25
"""With a limited yaw acceleration, a turn ends when less than this remains and it is slow enough to stop."""


class TurnedLine(NamedTuple):
    """A line with pieces on which the vehicle yaws.

    Attributes:
        positions_m: (m, 3) ENU, the positions of the line and more on its legs.
        headings: (m - 1, 2) heading on each piece, east and north, of any length.
        numbers: (k,) of the original positions among them.
    """

    positions_m: NDArray[np.float64]
    headings: NDArray[np.float64]
    numbers: NDArray[np.int64]


class Pieces(NamedTuple):
    """Motion on the k - 1 pieces of a line.

    Attributes:
        headings: (k - 1, 2) target heading east and north; (0, 0): none, and a camera has none there.
        steps_s: (k - 1,) seconds of each piece of a corner; 0 for a leg.
        lengths_m: (k - 1,) flown length of a leg.
        begins_m_s: (k - 1,) speed at the begin of a leg.
    """

    headings: NDArray[np.float64]
    steps_s: NDArray[np.float64]
    lengths_m: NDArray[np.float64]
    begins_m_s: NDArray[np.float64]


@allocating_kernel
def turned_line(
    pace: Pace, positions_m: NDArray[np.float64], pieces: Pieces, before: NDArray[np.float64]
) -> TurnedLine:
    """The line with headings that follow its directions; on pieces that are too short, they are late.

    Args:
        pace: of the vehicle. With a constant yaw rate, it accelerates on a leg up to cruise speed, so that turns are late rather
            than early. With a limited yaw acceleration, it flies as PX4 does.
        positions_m: (k, 3) ENU of the line.
        pieces: their motion.
        before: (2,) heading before; (0, 0): along the first piece.
    """
    k, at_once = positions_m.shape[0], math.radians(_AT_ONCE_DEG)
    most_positions = k + _MOST_STEPS * np.count_nonzero(pieces.steps_s == 0.0)
    positions, headings = np.empty((most_positions, 3)), np.empty((most_positions, 2))
    numbers = np.zeros(k, dtype=np.int64)
    positions[0] = positions_m[0]
    count = 1
    points = before[0] != 0.0 or before[1] != 0.0
    yaw, rate = math.atan2(before[0], before[1]), 0.0
    last_course = yaw
    for piece in range(k - 1):
        east, north, step_s = pieces.headings[piece, 0], pieces.headings[piece, 1], pieces.steps_s[piece]
        if east != 0.0 or north != 0.0:
            course, begin_m_s, length_m = math.atan2(east, north), pieces.begins_m_s[piece], pieces.lengths_m[piece]
            turn = course - yaw if points else 0.0
            turn -= math.tau * np.rint(turn / math.tau)
            if not points:
                last_course = course
            yaw, points = course - turn, True
            motion = _Motion(begin_m_s, begin_m_s, length_m)
            if pace.yaw_acceleration_deg_s2 < math.inf:
                end_m_s = pieces.begins_m_s[piece + 1] if piece + 2 < k else pace.cruise_m_s
                motion = _Motion(begin_m_s * math.cos(course - last_course), end_m_s, length_m)
            last_course = course
            seconds = step_s if step_s > 0.0 else _seconds(pace, begin_m_s, length_m)
            if abs(turn) > min(at_once, math.radians(pace.yaw_rate_deg_s) * seconds) or rate != 0.0 or step_s > 0.0:
                distances_m, parts, reached, rate = _turn(pace, turn, rate, motion, step_s)
                rest = reached
                if step_s == 0.0:
                    for step in range(distances_m.size):
                        fraction = max(0.0, min(1.0, distances_m[step] / max(length_m, _LEAST_M)))
                        for axis in range(3):
                            at = positions_m[piece, axis]
                            positions[count, axis] = at + fraction * (positions_m[piece + 1, axis] - at)
                        headings[count - 1] = _towards(yaw + parts[step])
                        count += 1
                    rest = parts[distances_m.size]
                if rest != turn:
                    east, north = _towards(yaw + rest)
                yaw += reached
            else:
                yaw = course
        positions[count] = positions_m[piece + 1]
        headings[count - 1] = east, north
        numbers[piece + 1] = count
        count += 1
    return TurnedLine(positions[:count].copy(), headings[: count - 1].copy(), numbers)


@kernel
def _towards(yaw: float) -> tuple[float, float]:
    return math.sin(yaw), math.cos(yaw)


class _Motion(NamedTuple):
    """Motion on a leg.

    Attributes:
        begin_m_s: speed along it at its begin.
        end_m_s: speed at its end.
        length_m: of it.
    """

    begin_m_s: float
    end_m_s: float
    length_m: float


@allocating_kernel
def _turn(
    pace: Pace, turn: float, rate: float, motion: _Motion, step_s: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], float, float]:
    """Yaw on a leg or on a piece of a corner, radians, as far as the turn gets.

    Args:
        pace: of the vehicle.
        turn: the whole turn.
        rate: radians per second, at the begin.
        motion: of the leg.
        step_s: seconds of a piece of a corner; 0 on a leg.

    Returns:
        (n,) metres of the leg at which a heading ends; (n + 1,) the part of the turn at the middle of each of them and of the
        rest of
        the leg; the finished part of the turn, and the final rate.
    """
    if pace.yaw_acceleration_deg_s2 == math.inf:
        distances_m, parts, reached = _even_turn(pace, turn, motion, step_s)
        return distances_m, parts, reached, 0.0
    return _ramped_turn(pace, turn, rate, motion, step_s)


@allocating_kernel
def _even_turn(
    pace: Pace, turn: float, motion: _Motion, step_s: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """A turn at a constant rate, in equal steps."""
    rate = math.radians(pace.yaw_rate_deg_s)
    seconds = step_s if step_s > 0.0 else _seconds(pace, motion.begin_m_s, motion.length_m)
    reached = turn if abs(turn) <= rate * seconds else math.copysign(rate * seconds, turn)
    steps = max(1, math.ceil(math.degrees(abs(turn)) / _STEP_DEG - 1e-9))
    distances_m, parts = np.empty(steps), np.empty(steps + 1)
    done = 0
    while done < steps and (done + 1) / steps * abs(turn) <= abs(reached):
        distances_m[done] = _distance_m(pace, motion.begin_m_s, (done + 1) * (abs(turn) / steps / rate))
        parts[done] = (done + 0.5) / steps * turn
        done += 1
    parts[done] = turn if reached == turn else 0.5 * (done / steps * turn + reached)
    return distances_m[:done].copy(), parts[: done + 1].copy(), reached


@allocating_kernel
def _ramped_turn(
    pace: Pace, turn: float, rate: float, motion: _Motion, step_s: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], float, float]:
    """The fastest turn that comes to rest at its end, in small time steps.

    The vehicle flies on as PX4 does: it follows its set speed late, and its acceleration changes with its jerk.
    """
    most, acceleration = math.radians(pace.yaw_rate_deg_s), math.radians(pace.yaw_acceleration_deg_s2)
    aligned = math.radians(_ALIGNED_DEG)
    distances_m, parts = np.empty(_MOST_STEPS), np.empty(_MOST_STEPS + 1)
    lacking = _LACKING * (1.0 - _MADE_UP * max(0.0, motion.begin_m_s) / pace.cruise_m_s)
    speed, pull, distance_m = motion.begin_m_s, 0.0, 0.0
    time_s, reached, shown, done = 0.0, 0.0, 0.0, 0
    while distance_m < motion.length_m if step_s == 0.0 else time_s < step_s:
        dt = _TIME_STEP_S if step_s == 0.0 else min(_TIME_STEP_S, step_s - time_s)
        wanted = math.copysign(min(most, math.sqrt(2.0 * acceleration * abs(turn - reached))), turn - reached)
        rate += max(-acceleration * dt, min(wanted - rate, acceleration * dt))
        reached += rate * dt
        time_s += dt
        set_m_s = min(pace.cruise_m_s, stopping_speed(pace, motion.length_m - distance_m, motion.end_m_s))
        if pace.settling_s > 0.0:
            set_m_s *= 1.0 - lacking * math.exp(-_LACKING * time_s / (_LACKING_LONGER * pace.settling_s))
        missing = max(set_m_s, _SLOWEST_M_S) - speed
        pulls = math.copysign(min(pace.acceleration_m_s2, math.sqrt(2.0 * pace.jerk_m_s3 * abs(missing))), missing)
        pull += max(-pace.jerk_m_s3 * dt, min(pulls - pull, pace.jerk_m_s3 * dt))
        speed += pull * dt
        distance_m += speed * dt
        is_over = abs(turn - reached) < aligned and rate * rate <= 2.0 * acceleration * aligned
        if is_over:
            reached, rate = turn, 0.0
        if (is_over or math.degrees(abs(reached - shown)) >= _STEP_DEG) and done < _MOST_STEPS - 1:
            distances_m[done], parts[done] = distance_m, 0.5 * (shown + reached)
            shown = reached
            done += 1
        if is_over:
            break
    parts[done] = 0.5 * (shown + reached)
    return distances_m[:done].copy(), parts[: done + 1].copy(), reached, rate


@allocating_kernel
def braked_speeds_m_s(pace: Pace, headings: NDArray[np.float64], before: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) speeds at which PX4 begins (n, 2) ways after a corner; the first one follows the (2,) way before.

    They agree with the flight time, and never exceed cruise speed or the speed from which it can stop. They start from rest for a
    vertical way, and if it or the previous one is shorter than the acceptance radius.
    """
    out = np.empty(headings.shape[0])
    east, north = before[0], before[1]
    for k in range(out.size):
        from_m, to_m = math.hypot(east, north), math.hypot(headings[k, 0], headings[k, 1])
        cosine = -1.0
        if min(from_m, to_m) >= pace.corner_radius_m:
            cosine = (east / from_m) * (headings[k, 0] / to_m) + (north / from_m) * (headings[k, 1] / to_m)
        out[k] = min(pace.cruise_m_s, circle_speed(pace, cosine), stopping_speed(pace, to_m, 0.0))
        east, north = headings[k, 0], headings[k, 1]
    return out


@kernel
def _distance_m(pace: Pace, begin_m_s: float, seconds: float) -> float:
    """Distance after a time from the begin of a leg, metres."""
    rising_s = min(seconds, (pace.cruise_m_s - begin_m_s) / pace.acceleration_m_s2)
    return (begin_m_s + 0.5 * pace.acceleration_m_s2 * rising_s) * rising_s + pace.cruise_m_s * (seconds - rising_s)


@kernel
def _seconds(pace: Pace, begin_m_s: float, distance_m: float) -> float:
    """Time for a distance from the begin of a leg."""
    rising_m = (pace.cruise_m_s**2 - begin_m_s**2) / (2.0 * pace.acceleration_m_s2)
    risen_m_s = math.sqrt(begin_m_s**2 + 2.0 * pace.acceleration_m_s2 * min(distance_m, rising_m))
    return (risen_m_s - begin_m_s) / pace.acceleration_m_s2 + max(0.0, distance_m - rising_m) / pace.cruise_m_s

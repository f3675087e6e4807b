"""Where the nose points along a line that is flown: it turns at a limited rate, and the vehicle flies on meanwhile."""

import math
from typing import NamedTuple

import numpy as np

from uavcover.kernels.arrays import FloatArray, IntArray
from uavcover.kernels.flight_time import Pace, circle_speed

YAW_RATE_DEG_S = 60.0
"""ATC_SLEW_YAW of ArduCopter 4.7 and MPC_YAWRAUTO_MAX of PX4 from 1.15 on (45 before), by default."""

_AT_ONCE_DEG = 5.0
"""On a leg, less of a turn is made at once. With 20 degrees a plan over 40 m claimed 0.5 points more."""

_STEP_DEG = 3.0
"""Of a turn on a leg, at most; the nose points to the middle of each step. A turn shows the same in smaller steps; in steps of 10
degrees up to 0.4 points of a plan less, of 60 a point."""

_LEAST_M = 1e-6


class TurnedLine(NamedTuple):
    """A line with pieces where the nose turns.

    Attributes:
        places_m: (m, 3) ENU, those of the line and more on its legs.
        headings: (m - 1, 2) where the nose points on each piece, east and north, of any length.
        numbers: (k,) of the places of the line among them.
    """

    places_m: FloatArray
    headings: FloatArray
    numbers: IntArray


class Pieces(NamedTuple):
    """How the k - 1 pieces of a line are flown.

    Attributes:
        ways: (k - 1, 2) direction east and north to which the nose turns; (0, 0): to none, and a camera has none there.
        steps_s: (k - 1,) seconds of each piece of a corner; 0 for a leg.
        lengths_m: (k - 1,) that are flown on a leg.
        begins_m_s: (k - 1,) speed with which a leg begins.
    """

    ways: FloatArray
    steps_s: FloatArray
    lengths_m: FloatArray
    begins_m_s: FloatArray


def turned_line(pace: Pace, places_m: FloatArray, pieces: Pieces, before: FloatArray) -> TurnedLine:
    """The line on which the nose follows the ways at :data:`YAW_RATE_DEG_S`; where a piece is too short, it is late.

    Args:
        pace: of the vehicle; on a leg it speeds up with its acceleration until it cruises, so that it turns late, not early.
        places_m: (k, 3) ENU of the line.
        pieces: how it is flown.
        before: (2,) where the nose points before; (0, 0): along the first piece.
    """
    rate, at_once = math.radians(YAW_RATE_DEG_S), math.radians(_AT_ONCE_DEG)
    nose = math.atan2(before[0], before[1]) if before.any() else None
    places, headings, numbers = [places_m[0]], [], [0]
    courses = np.arctan2(pieces.ways[:, 0], pieces.ways[:, 1]).tolist()
    has_way = (np.hypot(pieces.ways[:, 0], pieces.ways[:, 1]) > 0.0).tolist()
    steps_s, lengths_m, begins_m_s = (each.tolist() for each in pieces[1:])
    for k, (course, is_known, step_s) in enumerate(zip(courses, has_way, steps_s, strict=True)):
        heading = pieces.ways[k]
        if is_known:
            turn = 0.0 if nose is None else math.remainder(course - nose, math.tau)
            reached_s = step_s if step_s > 0.0 else _seconds(pace, begins_m_s[k], lengths_m[k])
            most = rate * reached_s
            reached = turn if abs(turn) <= most else math.copysign(most, turn)
            if step_s == 0.0 and abs(turn) > min(at_once, most):
                shares, turned = _turn_on_leg(pace, lengths_m[k], begins_m_s[k], turn, reached)
                places += [places_m[k] + share * (places_m[k + 1] - places_m[k]) for share in shares]
                headings += [_towards(course - turn + part) for part in turned[:-1]]
                heading = heading if reached == turn else _towards(course - turn + turned[-1])
            elif reached != turn:
                heading = _towards(course - turn + reached)
            nose = course - turn + reached
        places.append(places_m[k + 1])
        headings.append(heading)
        numbers.append(len(places) - 1)
    return TurnedLine(np.array(places), np.array(headings).reshape(-1, 2), np.array(numbers))


def braked_speeds_m_s(pace: Pace, ways: FloatArray, before: FloatArray) -> FloatArray:
    """(n,) speeds at which PX4 begins (n, 2) ways, each behind a corner, the first one behind the (2,) way before.

    As the flight time has it; never above that of cruise. Where a way is straight up or down, from rest.
    """
    ways = np.vstack([before, ways])
    level_m = np.hypot(ways[:, 0], ways[:, 1])
    unit = ways / np.maximum(level_m, _LEAST_M)[:, None]
    cosine = np.where(np.minimum(level_m[:-1], level_m[1:]) > _LEAST_M, (unit[:-1] * unit[1:]).sum(axis=1), -1.0)
    return np.minimum(pace.cruise_m_s, [circle_speed(pace, each) for each in cosine.tolist()])


def _towards(nose: float) -> FloatArray:
    return np.array([math.sin(nose), math.cos(nose)])


def _turn_on_leg(
    pace: Pace, length_m: float, begin_m_s: float, turn: float, reached: float
) -> tuple[list[float], list[float]]:
    """How the nose turns on a leg, radians, by as much as is reached of a turn; the whole turn, unless the leg is too short.

    Returns:
        shares of the leg's length at which a heading ends; the part of the turn that each has, and one more for the rest of it.
    """
    count = max(1, math.ceil(math.degrees(abs(turn)) / _STEP_DEG - 1e-9))
    done = [k for k in range(count) if (k + 1) / count * abs(turn) <= abs(reached)]
    seconds = abs(turn) / count / math.radians(YAW_RATE_DEG_S)
    shares = [_way_m(pace, begin_m_s, (k + 1) * seconds) / max(length_m, _LEAST_M) for k in done]
    rest = turn if reached == turn else 0.5 * (len(done) / count * turn + reached)
    return [min(share, 1.0) for share in shares], [*((k + 0.5) / count * turn for k in done), rest]


def _way_m(pace: Pace, begin_m_s: float, seconds: float) -> float:
    """Metres so long after the beginning of a leg."""
    rising_s = min(seconds, (pace.cruise_m_s - begin_m_s) / pace.acceleration_m_s2)
    return (begin_m_s + 0.5 * pace.acceleration_m_s2 * rising_s) * rising_s + pace.cruise_m_s * (seconds - rising_s)


def _seconds(pace: Pace, begin_m_s: float, way_m: float) -> float:
    """Seconds of so many metres from the beginning of a leg."""
    rising_m = (pace.cruise_m_s**2 - begin_m_s**2) / (2.0 * pace.acceleration_m_s2)
    risen_m_s = math.sqrt(begin_m_s**2 + 2.0 * pace.acceleration_m_s2 * min(way_m, rising_m))
    return (risen_m_s - begin_m_s) / pace.acceleration_m_s2 + max(0.0, way_m - rising_m) / pace.cruise_m_s

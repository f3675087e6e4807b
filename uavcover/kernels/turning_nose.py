"""Where the nose points along a line that is flown: it turns at a limited rate, and the vehicle flies on meanwhile."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.flight_time import Pace, circle_speed
from uavcover.kernels.jit import kernel

YAW_RATE_DEG_S = 60.0
"""ATC_SLEW_YAW of ArduCopter 4.7 and MPC_YAWRAUTO_MAX of PX4 from 1.15 on (45 before), by default."""

_AT_ONCE_DEG = 5.0
"""On a leg, less of a turn is made at once. With 20 degrees a plan over 40 m claimed 0.5 points more."""

_STEP_DEG = 3.0
"""Of a turn on a leg, at most; the nose points to the middle of each step. A turn shows the same in smaller steps; in steps of 10
degrees up to 0.4 points of a plan less, of 60 a point."""

_LEAST_M = 1e-6
_MOST_STEPS = math.ceil(180.0 / _STEP_DEG)


class TurnedLine(NamedTuple):
    """A line with pieces where the nose turns.

    Attributes:
        places_m: (m, 3) ENU, those of the line and more on its legs.
        headings: (m - 1, 2) where the nose points on each piece, east and north, of any length.
        numbers: (k,) of the places of the line among them.
    """

    places_m: NDArray[np.float64]
    headings: NDArray[np.float64]
    numbers: NDArray[np.int64]


class Pieces(NamedTuple):
    """How the k - 1 pieces of a line are flown.

    Attributes:
        ways: (k - 1, 2) direction east and north to which the nose turns; (0, 0): to none, and a camera has none there.
        steps_s: (k - 1,) seconds of each piece of a corner; 0 for a leg.
        lengths_m: (k - 1,) that are flown on a leg.
        begins_m_s: (k - 1,) speed with which a leg begins.
    """

    ways: NDArray[np.float64]
    steps_s: NDArray[np.float64]
    lengths_m: NDArray[np.float64]
    begins_m_s: NDArray[np.float64]


@kernel
def turned_line(pace: Pace, places_m: NDArray[np.float64], pieces: Pieces, before: NDArray[np.float64]) -> TurnedLine:
    """The line on which the nose follows the ways at :data:`YAW_RATE_DEG_S`; where a piece is too short, it is late.

    Args:
        pace: of the vehicle; on a leg it speeds up with its acceleration until it cruises, so that it turns late, not early.
        places_m: (k, 3) ENU of the line.
        pieces: how it is flown.
        before: (2,) where the nose points before; (0, 0): along the first piece.
    """
    rate, at_once = math.radians(YAW_RATE_DEG_S), math.radians(_AT_ONCE_DEG)
    k = places_m.shape[0]
    most_places = k + _MOST_STEPS * np.count_nonzero(pieces.steps_s == 0.0)
    places, headings = np.empty((most_places, 3)), np.empty((most_places, 2))
    numbers = np.zeros(k, dtype=np.int64)
    places[0] = places_m[0]
    count = 1
    points = before[0] != 0.0 or before[1] != 0.0
    nose = math.atan2(before[0], before[1])
    for piece in range(k - 1):
        east, north, step_s = pieces.ways[piece, 0], pieces.ways[piece, 1], pieces.steps_s[piece]
        if east != 0.0 or north != 0.0:
            course, begin_m_s, length_m = math.atan2(east, north), pieces.begins_m_s[piece], pieces.lengths_m[piece]
            turn = course - nose if points else 0.0
            turn -= math.tau * np.rint(turn / math.tau)
            most = rate * (step_s if step_s > 0.0 else _seconds(pace, begin_m_s, length_m))
            reached = turn if abs(turn) <= most else math.copysign(most, turn)
            nose, points = course - turn, True
            end = nose + reached
            if step_s == 0.0 and abs(turn) > min(at_once, most):
                steps = max(1, math.ceil(math.degrees(abs(turn)) / _STEP_DEG - 1e-9))
                seconds = abs(turn) / steps / rate
                done = 0
                while done < steps and (done + 1) / steps * abs(turn) <= abs(reached):
                    share = min(1.0, _way_m(pace, begin_m_s, (done + 1) * seconds) / max(length_m, _LEAST_M))
                    for axis in range(3):
                        at = places_m[piece, axis]
                        places[count, axis] = at + share * (places_m[piece + 1, axis] - at)
                    towards = nose + (done + 0.5) / steps * turn
                    headings[count - 1] = math.sin(towards), math.cos(towards)
                    count += 1
                    done += 1
                if reached != turn:
                    towards = nose + 0.5 * (done / steps * turn + reached)
                    east, north = math.sin(towards), math.cos(towards)
            elif reached != turn:
                east, north = math.sin(end), math.cos(end)
            nose = end
        places[count] = places_m[piece + 1]
        headings[count - 1] = east, north
        numbers[piece + 1] = count
        count += 1
    return TurnedLine(places[:count].copy(), headings[: count - 1].copy(), numbers)


@kernel
def braked_speeds_m_s(pace: Pace, ways: NDArray[np.float64], before: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) speeds at which PX4 begins (n, 2) ways, each behind a corner, the first one behind the (2,) way before.

    As the flight time has it; never above that of cruise. Where a way is straight up or down, from rest.
    """
    out = np.empty(ways.shape[0])
    east, north = before[0], before[1]
    for k in range(out.size):
        from_m, to_m = math.hypot(east, north), math.hypot(ways[k, 0], ways[k, 1])
        cosine = -1.0
        if min(from_m, to_m) > _LEAST_M:
            cosine = (east / from_m) * (ways[k, 0] / to_m) + (north / from_m) * (ways[k, 1] / to_m)
        out[k] = min(pace.cruise_m_s, circle_speed(pace, cosine))
        east, north = ways[k, 0], ways[k, 1]
    return out


@kernel
def _way_m(pace: Pace, begin_m_s: float, seconds: float) -> float:
    """Metres so long after the beginning of a leg."""
    rising_s = min(seconds, (pace.cruise_m_s - begin_m_s) / pace.acceleration_m_s2)
    return (begin_m_s + 0.5 * pace.acceleration_m_s2 * rising_s) * rising_s + pace.cruise_m_s * (seconds - rising_s)


@kernel
def _seconds(pace: Pace, begin_m_s: float, way_m: float) -> float:
    """Seconds of so many metres from the beginning of a leg."""
    rising_m = (pace.cruise_m_s**2 - begin_m_s**2) / (2.0 * pace.acceleration_m_s2)
    risen_m_s = math.sqrt(begin_m_s**2 + 2.0 * pace.acceleration_m_s2 * min(way_m, rising_m))
    return (risen_m_s - begin_m_s) / pace.acceleration_m_s2 + max(0.0, way_m - rising_m) / pace.cruise_m_s

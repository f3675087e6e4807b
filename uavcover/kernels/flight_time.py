"""Flight time along a route: legs with limited speed, acceleration and jerk, and the waypoints in between.

Each leg counts from rest to rest, and each waypoint subtracts the time saved by not stopping there. So time is a sum over legs
and over waypoints with their two legs, and a search can count a change of the route locally.

A waypoint is passed in one of two ways, as the autopilots do:

- BLENDED, ArduCopter: each leg is a motion from rest to rest. The next one begins before the last one ends, as early as the
  corner stays inside a radius, the speed below that of both legs, and the acceleration inside its limits
  (SCurve::advance_target_along_track).
- BRAKED, PX4: it brakes to the speed at which the corner fits into the acceptance radius, and from which it can stop at the next
  waypoint (math::trajectory::computeXYSpeedFromWaypoints); the waypoint is passed where the radius begins.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.jit import allocating_kernel, kernel

Position = tuple[float, float, float]

BLENDED = 0
BRAKED = 1

_LEAST_M = 1e-6
"""Shorter legs, or shorter horizontal or vertical parts of them, do not count as movement."""

_BISECTIONS = 24
_SETTLING_GAIN = 0.7
"""Fraction of the settling time that a waypoint passed at full speed saves; of PX4, see docs/results/flight_time.md."""


class Pace(NamedTuple):
    """Kinematic limits of a vehicle.

    Attributes:
        cruise_m_s: over ground, where wind and climb allow it.
        climb_m_s: largest speed up.
        descent_m_s: largest speed down.
        airspeed_m_s: largest speed through the air, above that of the wind; infinite: wind does not matter.
        wind_east_m_s: east component of the direction towards which the wind blows.
        wind_north_m_s: north component.
        acceleration_m_s2: over ground; infinite: speeds change at once.
        vertical_acceleration_m_s2: up and down.
        jerk_m_s3: rate of change of the acceleration.
        corner: how a waypoint is passed, BLENDED or BRAKED.
        corner_radius_m: of the corner.
        smoothing_s: delay of each leg because the jerk does not change at once.
        settling_s: delay of a long leg because the vehicle follows its set speed late.
        settling_tc_s: time constant of that.
        vertical_change_m_s: largest change of the vertical speed at a waypoint that needs no braking.
        takeoff_m_s: speed of the first metres of the climb from the ground.
        takeoff_slow_m: length of this part.
        land_m_s: speed of the last metres of the landing.
        land_slow_m: length of this part.
        land_band_m: band above it in which the speed changes from that of the descent.
        yaw_rate_deg_s: largest yaw rate.
        yaw_acceleration_deg_s2: rate of change of the yaw rate; infinite: at once.
    """

    cruise_m_s: float
    climb_m_s: float
    descent_m_s: float
    airspeed_m_s: float = math.inf
    wind_east_m_s: float = 0.0
    wind_north_m_s: float = 0.0
    acceleration_m_s2: float = math.inf
    vertical_acceleration_m_s2: float = math.inf
    jerk_m_s3: float = math.inf
    corner: int = BLENDED
    corner_radius_m: float = 2.0
    smoothing_s: float = 0.0
    settling_s: float = 0.0
    settling_tc_s: float = 1.0
    vertical_change_m_s: float = math.inf
    takeoff_m_s: float = math.inf
    takeoff_slow_m: float = 0.0
    land_m_s: float = math.inf
    land_slow_m: float = 0.0
    land_band_m: float = 0.0
    yaw_rate_deg_s: float = 60.0
    yaw_acceleration_deg_s2: float = math.inf


class _Leg(NamedTuple):
    """A leg for the motion model: unit vector, length, and the limits along it."""

    east: float
    north: float
    up: float
    length_m: float
    speed_m_s: float
    acceleration_m_s2: float


@kernel
def speed_over_ground(pace: Pace, east: float, north: float) -> float:
    """Speed along a direction (unit vector): cruise speed, or less if the wind limits it."""
    if pace.airspeed_m_s == math.inf:
        return pace.cruise_m_s
    along = pace.wind_east_m_s * east + pace.wind_north_m_s * north
    across = pace.wind_north_m_s * east - pace.wind_east_m_s * north
    return min(pace.cruise_m_s, along + math.sqrt(pace.airspeed_m_s**2 - across**2))


@allocating_kernel
def speeds_over_ground(pace: Pace, directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) speeds along (n, 2) unit vectors, east and north."""
    out = np.empty(directions.shape[0])
    for k in range(out.size):
        out[k] = speed_over_ground(pace, directions[k, 0], directions[k, 1])
    return out


@kernel
def _leg(pace: Pace, p: Position, q: Position) -> _Leg:
    de, dn, du = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    horizontal = math.hypot(de, dn)
    length = math.sqrt(de * de + dn * dn + du * du)
    if length < _LEAST_M:
        return _Leg(0.0, 0.0, 0.0, 0.0, 1.0, 1.0)
    speed, acceleration = math.inf, math.inf
    if horizontal >= _LEAST_M:
        level = horizontal / length
        speed = speed_over_ground(pace, de / horizontal, dn / horizontal) / level
        acceleration = pace.acceleration_m_s2 / level
    if abs(du) >= _LEAST_M or horizontal < _LEAST_M:
        steep = abs(du) / length
        speed = min(speed, (pace.climb_m_s if du > 0.0 else pace.descent_m_s) / steep)
        acceleration = min(acceleration, pace.vertical_acceleration_m_s2 / steep)
    return _Leg(de / length, dn / length, du / length, length, speed, acceleration)


@kernel
def _ramp_s(speed: float, acceleration: float, jerk: float) -> float:
    """Seconds from rest to a speed; half of them times the speed is the distance."""
    if speed >= acceleration * (acceleration / jerk):
        return speed / acceleration + acceleration / jerk
    return 2.0 * math.sqrt(speed / jerk)


@kernel
def _peak_speed(leg: _Leg, jerk: float) -> float:
    """The largest speed on a leg from rest to rest."""
    speed, a, length = leg.speed_m_s, leg.acceleration_m_s2, leg.length_m
    if speed * _ramp_s(speed, a, jerk) <= length:
        return speed
    if length < 2.0 * a * (a / jerk) ** 2:
        return float((0.5 * length * math.sqrt(jerk)) ** (2.0 / 3.0))
    late = a / jerk
    return 0.5 * a * (math.sqrt(late * late + 4.0 * length / a) - late)


@kernel
def _ramp_state(time: float, leg: _Leg, peak: float, jerk: float) -> tuple[float, float, float]:
    """Distance, speed and acceleration after a time from rest, in the first half of the ramp to the peak speed."""
    most = min(leg.acceleration_m_s2, math.sqrt(peak * jerk))
    rise = most / jerk
    if time < rise:
        return jerk * time**3 / 6.0, 0.5 * jerk * time * time, jerk * time
    rest = time - rise
    return (
        most * rise * rise / 6.0 + 0.5 * most * rise * rest + 0.5 * most * rest * rest,
        0.5 * most * rise + most * rest,
        most,
    )


@kernel
def stopping_speed(pace: Pace, distance: float, end: float) -> float:
    """The speed from which the speed ``end`` is reached over ``distance``, as PX4 counts it (computeMaxSpeedFromDistance)."""
    a = pace.acceleration_m_s2
    lag = 4.0 * a * a / pace.jerk_m_s3
    return 0.5 * (math.sqrt(lag * lag + 4.0 * (2.0 * a * distance + end * end)) - lag)


@kernel
def _braked_leg(pace: Pace, distance: float, most: float, begin: float, end: float) -> tuple[float, float]:
    """Seconds and peak speed over a way from one speed to another, braking as PX4 does.

    The speed v while braking keeps v^2 + v 4 a^2 / j = 2 a x + const. over the rest x of the way, so the time for it is
    dv / a + (2 a / j) log(v / end).
    """
    a, jerk = pace.acceleration_m_s2, pace.jerk_m_s3
    late = a / jerk
    room = distance + begin * (begin - a * late) / (2.0 * a) + end * (end + 4.0 * a * late) / (2.0 * a)
    peak = 0.5 * a * (math.sqrt(max(0.0, 6.25 * late * late + 4.0 * room / a)) - 2.5 * late)
    peak = min(most, max(peak, begin, end))
    begin, end = min(begin, peak), min(end, peak)
    faster = _ramp_s(peak - begin, a, jerk)
    slower = (peak - end) / a + 2.0 * late * math.log(peak / end)
    slowing = ((peak - end) * (peak + end) + 4.0 * a * late * (peak - end)) / (2.0 * a)
    return faster + slower + (distance - 0.5 * (peak + begin) * faster - slowing) / peak, peak


@kernel
def _settling_s(pace: Pace, leg: _Leg) -> float:
    return pace.settling_s * (1.0 - math.exp(-leg.length_m / (leg.speed_m_s * pace.settling_tc_s)))


@kernel
def _braked_rest_s(pace: Pace, leg: _Leg) -> float:
    """Seconds of a leg from rest to the edge of the waypoint's radius, braking for a stop."""
    distance = max(leg.length_m - pace.corner_radius_m, 0.05 * pace.corner_radius_m)
    return _braked_leg(pace, distance, leg.speed_m_s, 0.0, stopping_speed(pace, pace.corner_radius_m, 0.0))[0]


@kernel
def leg_time(pace: Pace, p: Position, q: Position) -> float:
    """Seconds from rest at p to rest at q; without a limit of acceleration, at full speed all the way."""
    leg = _leg(pace, p, q)
    if leg.length_m == 0.0:
        return 0.0
    if pace.acceleration_m_s2 == math.inf or leg.acceleration_m_s2 == math.inf:
        return leg.length_m / leg.speed_m_s
    if pace.corner == BRAKED and math.hypot(leg.east, leg.north) > _LEAST_M:
        return _braked_rest_s(pace, leg) + _settling_s(pace, leg)
    peak = _peak_speed(leg, pace.jerk_m_s3)
    return leg.length_m / peak + _ramp_s(peak, leg.acceleration_m_s2, pace.jerk_m_s3) + pace.smoothing_s


@kernel
def _blended_saving(pace: Pace, a: _Leg, b: _Leg) -> float:
    """Seconds by which leg b begins before leg a ends; the corner's apex is in the middle of them."""
    jerk = pace.jerk_m_s3
    peak_a, peak_b = _peak_speed(a, jerk), _peak_speed(b, jerk)
    low = 0.0
    high = 0.5 * min(_ramp_s(peak_a, a.acceleration_m_s2, jerk), _ramp_s(peak_b, b.acceleration_m_s2, jerk))
    slower = min(a.speed_m_s, b.speed_m_s) * (1.0 + 1e-9)
    trial = high
    for _ in range(_BISECTIONS):
        distance_a, speed_a, acc_a = _ramp_state(trial, a, peak_a, jerk)
        distance_b, speed_b, acc_b = _ramp_state(trial, b, peak_b, jerk)
        off = math.sqrt(
            (b.east * distance_b - a.east * distance_a) ** 2
            + (b.north * distance_b - a.north * distance_a) ** 2
            + (b.up * distance_b - a.up * distance_a) ** 2
        )
        speed = math.sqrt(
            (b.east * speed_b + a.east * speed_a) ** 2
            + (b.north * speed_b + a.north * speed_a) ** 2
            + (b.up * speed_b + a.up * speed_a) ** 2
        )
        over = math.hypot(b.east * acc_b - a.east * acc_a, b.north * acc_b - a.north * acc_a)
        upright = abs(b.up * acc_b - a.up * acc_a)
        if (
            off <= pace.corner_radius_m
            and speed <= slower
            and over <= 2.0 * pace.acceleration_m_s2
            and upright <= pace.vertical_acceleration_m_s2
        ):
            if trial == high:
                return 2.0 * high
            low = trial
        else:
            high = trial
        trial = 0.5 * (low + high)
    return 2.0 * low


@kernel
def circle_speed(pace: Pace, cosine: float) -> float:
    """Speed of PX4 on a circle that meets both legs of a corner at the radius.

    v^2 = a / 2 * radius * tan(half the angle between the legs); the cosine is that of the turn.
    """
    tangent = math.sqrt(max(0.0, 1.0 + cosine) / max(1e-12, 1.0 - cosine))
    return math.sqrt(0.5 * pace.acceleration_m_s2 * pace.corner_radius_m * tangent)


@kernel
def _braked_saving(pace: Pace, a: _Leg, b: _Leg) -> float:
    """Seconds saved by passing the corner between two legs, compared with a stop."""
    level_a, level_b = math.hypot(a.east, a.north), math.hypot(b.east, b.north)
    if level_a <= _LEAST_M or level_b <= _LEAST_M:
        return 0.0
    radius = pace.corner_radius_m
    cosine = max(-1.0, min(1.0, (a.east * b.east + a.north * b.north) / (level_a * level_b)))
    speed = 0.0
    if b.length_m * level_b >= radius:
        speed = min(
            circle_speed(pace, cosine),
            stopping_speed(pace, b.length_m * level_b, 0.0),
            a.speed_m_s,
            b.speed_m_s,
        )
        change = abs(b.up - a.up)
        if change * speed > pace.vertical_change_m_s:
            speed = pace.vertical_change_m_s / change
    end = max(speed, stopping_speed(pace, radius, speed))
    begin = max(0.0, end * cosine)
    saved = 0.0
    for leg in (a, b):
        distance = max(leg.length_m - radius + radius * cosine, 0.05 * radius)
        passed, peak = _braked_leg(pace, distance, leg.speed_m_s, min(begin, leg.speed_m_s), min(end, leg.speed_m_s))
        settled = _SETTLING_GAIN * _settling_s(pace, leg) * min(1.0, begin / peak)
        saved += 0.5 * (_braked_rest_s(pace, leg) - passed + settled)
    return saved


@kernel
def turn_time(pace: Pace, p: Position, q: Position, r: Position) -> float:
    """Extra seconds of passing q compared with a stop, which its two legs count: 0 or less."""
    if pace.acceleration_m_s2 == math.inf:
        return 0.0
    a, b = _leg(pace, p, q), _leg(pace, q, r)
    if a.length_m == 0.0 or b.length_m == 0.0 or max(a.acceleration_m_s2, b.acceleration_m_s2) == math.inf:
        return 0.0
    if pace.corner == BRAKED:
        return -_braked_saving(pace, a, b)
    return -_blended_saving(pace, a, b)


@allocating_kernel
def leg_times(pace: Pace, route: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n - 1,) seconds on each leg of an (n, 3) route, from rest to rest."""
    out = np.zeros(max(route.shape[0] - 1, 0))
    for k in range(out.size):
        out[k] = leg_time(
            pace, (route[k, 0], route[k, 1], route[k, 2]), (route[k + 1, 0], route[k + 1, 1], route[k + 1, 2])
        )
    return out


@allocating_kernel
def turn_times(pace: Pace, route: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) extra seconds of passing each waypoint compared with a stop, at most 0; 0 at both ends."""
    out = np.zeros(route.shape[0])
    for k in range(1, route.shape[0] - 1):
        out[k] = turn_time(
            pace,
            (route[k - 1, 0], route[k - 1, 1], route[k - 1, 2]),
            (route[k, 0], route[k, 1], route[k, 2]),
            (route[k + 1, 0], route[k + 1, 1], route[k + 1, 2]),
        )
    return out


@allocating_kernel
def flight_time(pace: Pace, route: NDArray[np.float64]) -> float:
    """Seconds along an (n, 3) route, from rest at its first waypoint to rest at its last one."""
    return float(leg_times(pace, route).sum() + turn_times(pace, route).sum())


@kernel
def takeoff_time(pace: Pace, height_m: float) -> float:
    """Seconds from the ground straight up to rest at a height."""
    slow = min(height_m, pace.takeoff_slow_m)
    seconds = slow / min(pace.takeoff_m_s, pace.climb_m_s)
    return seconds + leg_time(pace, (0.0, 0.0, 0.0), (0.0, 0.0, height_m - slow))


@kernel
def landing_time(pace: Pace, height_m: float) -> float:
    """Seconds from rest at a height straight down to the ground.

    Over the band above the last metres the speed changes in proportion to the height, so the time for the whole of it is
    band / (v - w) log(v / w).
    """
    fast, slow = pace.descent_m_s, min(pace.land_m_s, pace.descent_m_s)
    lowest = min(height_m, pace.land_slow_m)
    band = min(height_m - lowest, pace.land_band_m)
    seconds = lowest / slow + (height_m - lowest - band) / fast
    if band > 0.0:
        above = slow + (fast - slow) * band / pace.land_band_m
        seconds += band / slow if above == slow else band / (above - slow) * math.log(above / slow)
    return seconds


@kernel
def mission_time(pace: Pace, path: NDArray[np.float64]) -> float:
    """Seconds of a whole flight along a (k, 3) path that begins and ends on the ground.

    The first leg is the take-off and the last one the landing, both straight up and down.
    """
    n = path.shape[0]
    return float(
        takeoff_time(pace, path[1, 2] - path[0, 2])
        + flight_time(pace, path[1 : n - 1])
        + landing_time(pace, path[n - 2, 2] - path[n - 1, 2])
    )

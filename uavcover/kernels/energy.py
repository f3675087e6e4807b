"""Battery use of a flight, in seconds of hovering. A full battery has as many seconds as the vehicle can hover.

The power of a multirotor, as a multiple of its hovering power, has these parts:

- induced: Glauert's momentum theory of a rotor in forward flight (Leishman, Principles of Helicopter Aerodynamics, 2.14); it
  falls with the airspeed;
- profile: the drag of the blades, which grows with the airspeed (Zeng, Xu, Zhang 2019, doi 10.1109/TWC.2019.2902559, Eq. 12);
- drag of the rotors, linear in the airspeed (Martin, Salaün 2010, doi 10.1109/ROBOT.2010.5509538), and of the body, quadratic;
- climb: weight times vertical speed; a descent gives back a part;
- the electronics.

Drag and climb count per thrust, with the rotors' losses as in hovering. Energy is a sum over legs and waypoints, like flight time
(``kernels/flight_time.py``), so a search or a split computes both in the same way.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.flight_time import (
    Pace,
    Position,
    landing_time,
    leg_time,
    speed_over_ground,
    takeoff_time,
    turn_time,
)
from uavcover.kernels.jit import allocating_kernel, kernel

_GRAVITY_M_S2 = 9.80665
_LEAST_M = 1e-6


class Power(NamedTuple):
    """Parameters of the power of flight.

    Attributes:
        induced_m_s: induced velocity in hover.
        profile_share: fraction of the rotors' power in hover that the drag of the blades takes.
        tip_m_s: speed of the blades' tips.
        drag_1_s: drag of the rotors: acceleration per metre per second of airspeed.
        drag_1_m: drag of the body: acceleration per square of the airspeed.
        idle_share: fraction of the power in hover that the electronics draw.
        descent_gain: fraction of the potential energy that a descent gives back.
        gust_m_s: standard deviation of the wind in each horizontal direction.
    """

    induced_m_s: float
    profile_share: float
    tip_m_s: float
    drag_1_s: float
    drag_1_m: float
    idle_share: float
    descent_gain: float
    gust_m_s: float


@kernel
def power_fraction(power: Power, airspeed_m_s: float, climb_m_s: float) -> float:
    """Power as a multiple of that in hover, at a horizontal airspeed with a vertical speed, without gusts."""
    hover, v = power.induced_m_s, airspeed_m_s
    half = 0.5 * v * v
    induced_m_s = math.sqrt(math.sqrt(half * half + hover**4) - half)  # v_i^4 + V^2 v_i^2 = v_h^4
    drag_m_s = (power.drag_1_s + power.drag_1_m * v) * v * v / _GRAVITY_M_S2
    upwards_m_s = climb_m_s if climb_m_s > 0.0 else power.descent_gain * climb_m_s
    blades = power.profile_share * (1.0 + 3.0 * (v / power.tip_m_s) ** 2)  # Zeng et al., Eq. 12
    rotors = blades + (1.0 - power.profile_share) * (induced_m_s + drag_m_s + upwards_m_s) / hover
    return max(0.0, rotors) * (1.0 - power.idle_share) + power.idle_share


@kernel
def in_wind(pace: Pace, east_m_s: float, north_m_s: float) -> Pace:
    """The same vehicle in another wind, given by the direction towards which it blows."""
    return Pace(
        pace.cruise_m_s, pace.climb_m_s, pace.descent_m_s, pace.airspeed_m_s, east_m_s, north_m_s,
        pace.acceleration_m_s2, pace.vertical_acceleration_m_s2, pace.jerk_m_s3, pace.corner, pace.corner_radius_m,
        pace.smoothing_s, pace.settling_s, pace.settling_tc_s, pace.vertical_change_m_s, pace.takeoff_m_s,
        pace.takeoff_slow_m, pace.land_m_s, pace.land_slow_m, pace.land_band_m, pace.yaw_rate_deg_s,
        pace.yaw_acceleration_deg_s2,
    )  # fmt: skip


@kernel
def _fraction_at(power: Power, pace: Pace, east_m_s: float, north_m_s: float, climb_m_s: float) -> float:
    """Mean power in wind and gusts at a velocity over ground, from the mean square of the airspeed."""
    east, north = east_m_s - pace.wind_east_m_s, north_m_s - pace.wind_north_m_s
    squared = east * east + north * north + 2.0 * power.gust_m_s**2
    return float(power_fraction(power, math.sqrt(squared), climb_m_s))


@kernel
def _speeding_up(power: Power, pace: Pace, east_m_s: float, north_m_s: float, climb_m_s: float) -> float:
    """Mean power while the velocity grows evenly from rest, by Simpson's rule."""
    rest = _fraction_at(power, pace, 0.0, 0.0, 0.0)
    half = _fraction_at(power, pace, 0.5 * east_m_s, 0.5 * north_m_s, 0.5 * climb_m_s)
    full = _fraction_at(power, pace, east_m_s, north_m_s, climb_m_s)
    return (rest + 4.0 * half + full) / 6.0


@kernel
def leg_energy(power: Power, pace: Pace, p: Position, q: Position) -> float:
    """Seconds of hovering that the leg from rest at p to rest at q uses.

    The time is that of :func:`leg_time`. The speed grows evenly, stays constant and falls evenly, so that the length is right.
    """
    east, north, up = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    length = math.sqrt(east * east + north * north + up * up)
    if length < _LEAST_M:
        return 0.0
    time = leg_time(pace, p, q)
    level = math.hypot(east, north)
    speed = math.inf
    if level >= _LEAST_M:
        speed = speed_over_ground(pace, east / level, north / level) * length / level
    if abs(up) >= _LEAST_M:
        speed = min(speed, (pace.climb_m_s if up > 0.0 else pace.descent_m_s) * length / abs(up))
    ramps = time - length / speed  # two ramps of this length, each half as long as the same time at full speed
    if time < 2.0 * ramps:
        speed, ramps = 2.0 * length / time, 0.5 * time
    scale = speed / length
    e, n, u = east * scale, north * scale, up * scale
    return float(
        2.0 * ramps * _speeding_up(power, pace, e, n, u) + (time - 2.0 * ramps) * _fraction_at(power, pace, e, n, u)
    )


@kernel
def turn_energy(power: Power, pace: Pace, p: Position, q: Position, r: Position) -> float:
    """Energy of passing q beyond that of a stop there, which its two legs count: 0 or less.

    Overlapping legs save time near rest: exactly so if power is linear in speed.
    """
    return float(turn_time(pace, p, q, r) * _fraction_at(power, pace, 0.0, 0.0, 0.0))


@kernel
def takeoff_energy(power: Power, pace: Pace, height_m: float) -> float:
    """From the ground straight up to rest at a height."""
    time = takeoff_time(pace, height_m)
    return time * _fraction_at(power, pace, 0.0, 0.0, height_m / time) if time > 0.0 else 0.0


@kernel
def landing_energy(power: Power, pace: Pace, height_m: float) -> float:
    """From rest at a height straight down to the ground."""
    time = landing_time(pace, height_m)
    return time * _fraction_at(power, pace, 0.0, 0.0, -height_m / time) if time > 0.0 else 0.0


@allocating_kernel
def vertical_energies(
    power: Power, pace: Pace, winds_m_s: NDArray[np.float64], height_m: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(w,) seconds of hovering of a take-off to a height and (w,) of the landing, in (w, 2) winds."""
    up, down = np.empty(winds_m_s.shape[0]), np.empty(winds_m_s.shape[0])
    for w in range(winds_m_s.shape[0]):
        there = in_wind(pace, winds_m_s[w, 0], winds_m_s[w, 1])
        up[w], down[w] = takeoff_energy(power, there, height_m), landing_energy(power, there, height_m)
    return up, down


@allocating_kernel
def path_energies(
    power: Power, pace: Pace, winds_m_s: NDArray[np.float64], path: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Seconds of hovering along an (n, 3) path in (w, 2) winds.

    Returns:
        (w, n - 1) of each leg from rest to rest, and (w, n) of passing each waypoint beyond a stop; 0 at the ends.
    """
    n, winds = path.shape[0], winds_m_s.shape[0]
    legs, turns = np.zeros((winds, max(n - 1, 0))), np.zeros((winds, n))
    for w in range(winds):
        there = in_wind(pace, winds_m_s[w, 0], winds_m_s[w, 1])
        for k in range(n - 1):
            p, q = (path[k, 0], path[k, 1], path[k, 2]), (path[k + 1, 0], path[k + 1, 1], path[k + 1, 2])
            legs[w, k] = leg_energy(power, there, p, q)
            if k > 0:
                turns[w, k] = turn_energy(power, there, (path[k - 1, 0], path[k - 1, 1], path[k - 1, 2]), p, q)
    return legs, turns


@allocating_kernel
def star_energies(
    power: Power, pace: Pace, winds_m_s: NDArray[np.float64], centre: Position, positions: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(w, n) seconds of hovering from a centre to (n, 3) positions and (w, n) back, in (w, 2) winds."""
    n, winds = positions.shape[0], winds_m_s.shape[0]
    out, back = np.empty((winds, n)), np.empty((winds, n))
    for w in range(winds):
        there = in_wind(pace, winds_m_s[w, 0], winds_m_s[w, 1])
        for k in range(n):
            p = (positions[k, 0], positions[k, 1], positions[k, 2])
            out[w, k], back[w, k] = leg_energy(power, there, centre, p), leg_energy(power, there, p, centre)
    return out, back

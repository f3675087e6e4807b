"""Guidance along straight legs: the speed at each corner, and the velocity to demand now.

A corner is flown inside the acceptance radius r. The velocity vector turns by the angle t under the acceleration a, which
bends the path over v^2 sin(t/2) / a before and after the corner; so v = sqrt(a r / sin(t/2)) keeps the bend inside r.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

from uavcover.mock.dynamics import Airframe, Vector
from uavcover.mock.tuning import GUIDANCE


@dataclass(frozen=True, slots=True)
class Speeds:
    """Speeds of flight: over ground along a leg, upwards and downwards, metres per second."""

    cruise_m_s: float
    climb_m_s: float
    descent_m_s: float


@dataclass(frozen=True, slots=True)
class Stop:
    """A point of a route."""

    position_m: Vector  # east, north, up
    radius_m: float  # acceptance radius
    must_halt: bool  # whether to come to rest here


def along_speed(direction: Vector, speeds: Speeds) -> float:
    """Largest speed along a unit vector that keeps all three limits."""
    most = math.inf
    level = math.hypot(direction[0], direction[1])
    if level > 1e-9:
        most = speeds.cruise_m_s / level
    if direction[2] > 1e-9:
        most = min(most, speeds.climb_m_s / direction[2])
    elif direction[2] < -1e-9:
        most = min(most, speeds.descent_m_s / -direction[2])
    return most


def passing_speeds(start_m: Vector, stops: Sequence[Stop], airframe: Airframe) -> list[float]:
    """Largest speed at which each stop may be passed, so that corners and later stops are kept; metres per second."""
    acceleration = min(airframe.max_acceleration_m_s2, airframe.max_vertical_acceleration_m_s2)
    points = [start_m, *(stop.position_m for stop in stops)]
    legs = [direction_and_length(a, b) for a, b in itertools.pairwise(points)]
    result = [0.0] * len(stops)
    for i in range(len(stops) - 2, -1, -1):
        stop, (here, _), (there, length) = stops[i], legs[i], legs[i + 1]
        if stop.must_halt:
            continue
        cosine = sum(a * b for a, b in zip(here, there, strict=True))
        half_sine = math.sqrt(max(0.0, 0.5 * (1.0 - cosine)))  # sin(t / 2)
        corner = (
            math.inf
            if half_sine < 1e-6
            else math.sqrt(GUIDANCE.corner_share * acceleration * stop.radius_m / half_sine)
        )
        room = max(0.0, length - stop.radius_m - stops[i + 1].radius_m)
        result[i] = min(corner, math.sqrt(result[i + 1] ** 2 + 2.0 * GUIDANCE.braking_share * acceleration * room))
    return result


def velocity_along(
    position_m: Vector, start_m: Vector, stop: Stop, *, passing_m_s: float, speeds: Speeds, airframe: Airframe
) -> Vector:
    """The velocity to want on the leg from ``start_m`` to ``stop``: along it, and back to it when beside it.

    Args:
        position_m: where the vehicle is.
        start_m: where the leg starts.
        stop: where it ends.
        passing_m_s: speed to have at its end.
        speeds: the speeds to keep.
        airframe: limits of its dynamics.
    """
    unit, length = direction_and_length(start_m, stop.position_m)
    if length < 0.05:
        return velocity_to(position_m, stop.position_m, speeds=speeds, airframe=airframe)
    offset = (position_m[0] - start_m[0], position_m[1] - start_m[1], position_m[2] - start_m[2])
    done = offset[0] * unit[0] + offset[1] * unit[1] + offset[2] * unit[2]
    rest = length - done
    if rest <= 0.0:  # past the end and not yet inside the radius: come back to it
        return velocity_to(position_m, stop.position_m, speeds=speeds, airframe=airframe)
    gain = -GUIDANCE.cross_track_gain_1_s
    back = (
        gain * (offset[0] - done * unit[0]),
        gain * (offset[1] - done * unit[1]),
        gain * (offset[2] - done * unit[2]),
    )
    room = rest if stop.must_halt else max(0.0, rest - stop.radius_m)
    forward = min(along_speed(unit, speeds), _speed_with_room(room, passing_m_s, unit, airframe))
    # When far beside the leg, first come back to it.
    aside = math.sqrt(back[0] ** 2 + back[1] ** 2 + back[2] ** 2)
    if aside > speeds.cruise_m_s:
        back = tuple(b * speeds.cruise_m_s / aside for b in back)  # type: ignore[assignment]
        forward = 0.0
    return _keeping((back[0] + forward * unit[0], back[1] + forward * unit[1], back[2] + forward * unit[2]), speeds)


def velocity_to(position_m: Vector, target_m: Vector, *, speeds: Speeds, airframe: Airframe) -> Vector:
    """The velocity that brings a body to rest at a point, and keeps it there."""
    unit, length = direction_and_length(position_m, target_m)
    speed = min(along_speed(unit, speeds), _speed_with_room(length, 0.0, unit, airframe))
    return (speed * unit[0], speed * unit[1], speed * unit[2])


def direction_and_length(start: Vector, end: Vector) -> tuple[Vector, float]:
    """Unit vector and distance from one point to another; a zero vector when they are the same."""
    x, y, z = end[0] - start[0], end[1] - start[1], end[2] - start[2]
    length = math.sqrt(x * x + y * y + z * z)
    if length < 1e-9:
        return (0.0, 0.0, 0.0), 0.0
    return (x / length, y / length, z / length), length


def _speed_with_room(room_m: float, end_m_s: float, unit: Vector, airframe: Airframe) -> float:
    """Speed from which braking to ``end_m_s`` takes ``room_m``; proportional to the room close to a halt."""
    level = math.hypot(unit[0], unit[1])
    acceleration = min(
        airframe.max_acceleration_m_s2 / max(level, 1e-9),
        airframe.max_vertical_acceleration_m_s2 / max(abs(unit[2]), 1e-9),
    )
    braking = math.sqrt(end_m_s**2 + 2.0 * GUIDANCE.braking_share * acceleration * room_m)
    return min(braking, end_m_s + GUIDANCE.approach_gain_1_s * room_m)


def _keeping(velocity: Vector, speeds: Speeds) -> Vector:
    """A velocity brought inside the speeds."""
    x, y, z = velocity
    level = math.hypot(x, y)
    if level > speeds.cruise_m_s:
        x, y = x * speeds.cruise_m_s / level, y * speeds.cruise_m_s / level
    return (x, y, max(-speeds.descent_m_s, min(z, speeds.climb_m_s)))

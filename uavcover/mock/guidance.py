"""Guidance along straight legs: the speed at each corner, and the velocity to demand now.

A corner is flown inside the acceptance radius r. The velocity vector turns by the angle t under the acceleration a, which
bends the path over v^2 sin(t/2) / a before and after the corner; so v = sqrt(a r / sin(t/2)) keeps the bend inside r.

An autopilot leads the vehicle along a mission's legs by moving a position that it follows. ``BlendedLegs`` is ArduCopter's way:
each leg is a motion from rest to rest with limited acceleration and jerk, and the next one begins before the last one ends.
``BrakedLegs`` is PX4's: it steers to the next waypoint with a speed from which the corner can be flown. Both move in steps and
know nothing of the planner's formulas for their time.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

from uavcover.mock.behaviour import BODY, GUIDANCE, Speeds
from uavcover.mock.dynamics import Airframe, Vector
from uavcover.model.vehicle import AutopilotMotion


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
            else math.sqrt(GUIDANCE.corner_fraction * acceleration * stop.radius_m / half_sine)
        )
        room = max(0.0, length - stop.radius_m - stops[i + 1].radius_m)
        result[i] = min(corner, math.sqrt(result[i + 1] ** 2 + 2.0 * GUIDANCE.braking_fraction * acceleration * room))
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
    braking = math.sqrt(end_m_s**2 + 2.0 * GUIDANCE.braking_fraction * acceleration * room_m)
    return min(braking, end_m_s + GUIDANCE.approach_gain_1_s * room_m)


def _keeping(velocity: Vector, speeds: Speeds) -> Vector:
    """A velocity brought inside the speeds."""
    x, y, z = velocity
    level = math.hypot(x, y)
    if level > speeds.cruise_m_s:
        x, y = x * speeds.cruise_m_s / level, y * speeds.cruise_m_s / level
    return (x, y, max(-speeds.descent_m_s, min(z, speeds.climb_m_s)))


@dataclass(frozen=True, slots=True)
class Leg:
    """A leg to fly: where it ends, and how fast it may be flown."""

    end_m: Vector
    speeds: Speeds


class Legs:
    """Guide of a vehicle along legs from a position of rest.

    Attributes:
        passed: how many of them are done.
    """

    def __init__(self, motion: AutopilotMotion, legs: Sequence[Leg]) -> None:
        self.passed = 0
        self._motion, self._legs = motion, tuple(legs)
        self._behind_m = 0.0

    def wanted_velocity(self, position_m: Vector) -> Vector:
        """The velocity to command, one step later: the led position's, ahead by its acceleration, and back to it."""
        lag = (self._behind_m - GUIDANCE.lag_m) / (GUIDANCE.stands_lag_m - GUIDANCE.lag_m)
        self._advance(BODY.step_s * max(0.0, min(1.0, 1.0 - lag)))
        position, velocity, acceleration = self._state()
        speed = math.sqrt(sum(v * v for v in velocity))
        off = tuple(a - b for a, b in zip(position, position_m, strict=True))
        self._behind_m = sum(o * v for o, v in zip(off, velocity, strict=True)) / speed if speed > 0.1 else 0.0
        x, y, z = (
            v + a / GUIDANCE.velocity_gain_1_s + GUIDANCE.follow_gain_1_s * max(-5.0, min(5.0, o))
            for o, v, a in zip(off, velocity, acceleration, strict=True)
        )
        return (x, y, z)

    def _advance(self, seconds: float) -> None:
        """Move the position that leads."""
        raise NotImplementedError

    def _state(self) -> tuple[Vector, Vector, Vector]:
        """Position, velocity and acceleration to follow."""
        raise NotImplementedError


def legs_of(motion: AutopilotMotion, start_m: Vector, legs: Sequence[Leg]) -> Legs:
    """Guide along legs from a position of rest."""
    if motion.corner == "blended":
        return BlendedLegs(motion, start_m, legs)
    return BrakedLegs(motion, start_m, legs)


class _RestToRest:
    """One leg from rest to rest; its states are added up from the jerk.

    Attributes:
        elapsed_s: since it began.
        total_s: that it takes.
    """

    def __init__(self, motion: AutopilotMotion, start_m: Vector, leg: Leg) -> None:
        self.unit, self.length_m = direction_and_length(start_m, leg.end_m)
        self.start_m, self.elapsed_s, self.total_s = start_m, 0.0, 0.0
        self._ramp: list[tuple[float, float, float]] = [(0.0, 0.0, 0.0)]
        self._cruise_s, self._slower = 0.0, 1.0
        if self.length_m < GUIDANCE.least_m:
            return
        level, steep = math.hypot(self.unit[0], self.unit[1]), abs(self.unit[2])
        most = min(motion.acceleration_m_s2 / max(level, 1e-9), motion.vertical_acceleration_m_s2 / max(steep, 1e-9))
        self.speed_m_s = along_speed(self.unit, leg.speeds)
        low, high = 0.0, self.speed_m_s
        self._ramp = _ramp(high, most, motion.jerk_m_s3)
        if 2.0 * self._ramp[-1][0] > self.length_m:
            for _ in range(14):
                middle = 0.5 * (low + high)
                low, high = (
                    (low, middle)
                    if 2.0 * _ramp(middle, most, motion.jerk_m_s3)[-1][0] > self.length_m
                    else (middle, high)
                )
            self._ramp = _ramp(low, most, motion.jerk_m_s3)
        distance_m, peak_m_s, _ = self._ramp[-1]
        self._cruise_s = (self.length_m - 2.0 * distance_m) / peak_m_s
        quickest_s = 2.0 * self.ramp_s + self._cruise_s
        self.total_s = quickest_s + motion.smoothing_s
        self._slower = quickest_s / self.total_s

    @property
    def ramp_s(self) -> float:
        """Seconds to its largest speed."""
        return (len(self._ramp) - 1) * BODY.step_s

    @property
    def rest_s(self) -> float:
        """Seconds until its end."""
        return self.total_s - self.elapsed_s

    @property
    def slowing(self) -> bool:
        """Whether it is coming to rest."""
        return self.rest_s * self._slower <= self.ramp_s

    def state(self, seconds: float) -> tuple[float, float, float]:
        """Distance, speed and acceleration at a time."""
        time = max(0.0, seconds) * self._slower
        if time <= self.ramp_s:
            return self._on_ramp(time)
        if time <= self.ramp_s + self._cruise_s:
            distance_m, speed_m_s, _ = self._ramp[-1]
            return distance_m + speed_m_s * (time - self.ramp_s), speed_m_s, 0.0
        distance_m, speed_m_s, acceleration = self._on_ramp(max(0.0, 2.0 * self.ramp_s + self._cruise_s - time))
        return self.length_m - distance_m, speed_m_s, -acceleration

    def _on_ramp(self, time: float) -> tuple[float, float, float]:
        before = min(int(time / BODY.step_s), len(self._ramp) - 1)
        distance_m, speed_m_s, acceleration = self._ramp[before]
        rest = time - before * BODY.step_s
        return distance_m + speed_m_s * rest, speed_m_s + acceleration * rest, acceleration


def _ramp(speed_m_s: float, acceleration_m_s2: float, jerk_m_s3: float) -> list[tuple[float, float, float]]:
    """(way, speed, acceleration) in steps from rest to a speed."""
    states = [(0.0, 0.0, 0.0)]
    distance = speed = acceleration = 0.0
    while speed < speed_m_s:
        fall = acceleration * acceleration / (2.0 * jerk_m_s3) >= speed_m_s - speed
        change = -jerk_m_s3 * BODY.step_s if fall else jerk_m_s3 * BODY.step_s
        acceleration = max(0.05 * acceleration_m_s2, min(acceleration_m_s2, acceleration + change))
        faster = min(speed_m_s, speed + acceleration * BODY.step_s)
        distance += 0.5 * (speed + faster) * BODY.step_s
        speed = faster
        states.append((distance, speed, acceleration))
    return states


class BlendedLegs(Legs):
    """ArduCopter's legs: the motions of two legs add up where one blends into the next."""

    def __init__(self, motion: AutopilotMotion, start_m: Vector, legs: Sequence[Leg]) -> None:
        super().__init__(motion, legs)
        self._starts = [start_m, *(leg.end_m for leg in legs)]
        self._last: _RestToRest | None = None
        self._this = self._made(0)
        self._next = self._made(1)
        self._blending, self._wait_s = False, 0.0

    def _advance(self, seconds: float) -> None:
        this = self._this
        if this is None:
            return
        if self._last is not None:
            self._last.elapsed_s = min(self._last.total_s, self._last.elapsed_s + seconds)
        this.elapsed_s = min(this.total_s, this.elapsed_s + seconds)
        if self._blending and self._next is not None:
            self._next.elapsed_s = min(self._next.total_s, self._next.elapsed_s + seconds)
        elif self._next is not None and (self._wait_s > 0.0 or self._may_begin(this, self._next)):
            self._wait_s += seconds
            self._blending = self._wait_s > self._motion.smoothing_s
        # In the middle of the corner the next leg takes over.
        if this.rest_s <= 0.0 or (self._blending and self._next is not None and self._next.elapsed_s >= this.rest_s):
            self.passed += 1
            self._last, self._this, self._next = this, self._next, self._made(self.passed + 1)
            self._blending, self._wait_s = False, 0.0

    def _may_begin(self, this: _RestToRest, after: _RestToRest) -> bool:
        if not this.slowing or this.rest_s > after.ramp_s or min(this.length_m, after.length_m) < GUIDANCE.least_m:
            return False
        half_s = 0.5 * this.rest_s
        distance, speed, acceleration = this.state(this.elapsed_s + half_s)
        onward, speed_after, acceleration_after = after.state(half_s)
        short = this.length_m - distance
        off = [b * onward - a * short for a, b in zip(this.unit, after.unit, strict=True)]
        moving = [a * speed + b * speed_after for a, b in zip(this.unit, after.unit, strict=True)]
        pull = [a * acceleration + b * acceleration_after for a, b in zip(this.unit, after.unit, strict=True)]
        return (
            math.hypot(*off) < self._motion.corner_radius_m
            and math.hypot(*moving) <= 1.001 * min(this.speed_m_s, after.speed_m_s)
            and math.hypot(*pull[:2]) < 2.001 * self._motion.acceleration_m_s2
            and abs(pull[2]) < 1.001 * self._motion.vertical_acceleration_m_s2
        )

    def _state(self) -> tuple[Vector, Vector, Vector]:
        this = self._this
        if this is None:
            return self._starts[-1], (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        position = list(this.start_m)
        velocity, acceleration = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
        for one in (self._last, this, self._next if self._blending else None):
            if one is None:
                continue
            distance, speed, change = one.state(one.elapsed_s)
            distance -= one.length_m if one is self._last else 0.0
            for axis in range(3):
                position[axis] += one.unit[axis] * distance
                velocity[axis] += one.unit[axis] * speed
                acceleration[axis] += one.unit[axis] * change
        return (
            (position[0], position[1], position[2]),
            (velocity[0], velocity[1], velocity[2]),
            (acceleration[0], acceleration[1], acceleration[2]),
        )

    def _made(self, number: int) -> _RestToRest | None:
        if number >= len(self._legs):
            return None
        return _RestToRest(self._motion, self._starts[number], self._legs[number])


class BrakedLegs(Legs):
    """PX4's legs: a position that steers to the next waypoint, its acceleration and jerk limited."""

    def __init__(self, motion: AutopilotMotion, start_m: Vector, legs: Sequence[Leg]) -> None:
        super().__init__(motion, legs)
        self._position, self._velocity, self._acceleration = start_m, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        self._leg_s, self._kept = 0.0, 0.0

    def _advance(self, seconds: float) -> None:
        self._leg_s += seconds
        while self.passed < len(self._legs) and self._reached(self._legs[self.passed].end_m):
            speed = math.hypot(self._velocity[0], self._velocity[1])
            self._leg_s, self._kept = 0.0, self._kept_fraction(speed)
            self.passed += 1
        wanted = self._wanted() if self.passed < len(self._legs) else (0.0, 0.0, 0.0)
        missing = tuple(w - v for w, v in zip(wanted, self._velocity, strict=True))
        size = math.hypot(*missing)
        jerk = self._motion.jerk_m_s3
        fraction = min(self._motion.acceleration_m_s2, math.sqrt(2.0 * jerk * size)) / max(size, 1e-9)
        change = tuple(fraction * one - a for one, a in zip(missing, self._acceleration, strict=True))
        most = jerk * seconds / max(math.hypot(*change), 1e-9)
        ax, ay, az = (a + min(1.0, most) * c for a, c in zip(self._acceleration, change, strict=True))
        vx, vy, vz = (v + a * seconds for v, a in zip(self._velocity, (ax, ay, az), strict=True))
        x, y, z = (p + v * seconds for p, v in zip(self._position, (vx, vy, vz), strict=True))
        self._acceleration, self._velocity, self._position = (ax, ay, az), (vx, vy, vz), (x, y, z)

    def _state(self) -> tuple[Vector, Vector, Vector]:
        return self._position, self._velocity, self._acceleration

    def _reached(self, end_m: Vector) -> bool:
        x, y, z = self._position
        beside_m = math.hypot(end_m[0] - x, end_m[1] - y)
        return beside_m <= self._motion.corner_radius_m and abs(end_m[2] - z) <= GUIDANCE.height_radius_m

    def _kept_fraction(self, speed_m_s: float) -> float:
        """Fraction of its speed along the next leg."""
        if self.passed + 1 >= len(self._legs) or speed_m_s < 0.1:
            return 0.0
        unit, _ = direction_and_length(self._position, self._legs[self.passed + 1].end_m)
        along = self._velocity[0] * unit[0] + self._velocity[1] * unit[1]
        _, length = direction_and_length(self._legs[self.passed].end_m, self._legs[self.passed + 1].end_m)
        most = min(self._legs[self.passed + 1].speeds.cruise_m_s, self._speed_to(length, 0.0))
        # The next leg may have no length: the waypoint where photos begin stands twice in a mission.
        return max(0.0, min(1.0, along / most)) if most > 0.0 else 0.0

    def _wanted(self) -> Vector:
        leg, motion = self._legs[self.passed], self._motion
        unit, length = direction_and_length(self._position, leg.end_m)
        if length < GUIDANCE.least_m:
            return (0.0, 0.0, 0.0)
        level = math.hypot(unit[0], unit[1])
        speed = along_speed(unit, leg.speeds)
        if level > 0.05:
            speed = min(speed, self._speed_to(length * level, self._passing_speed(unit, leg)) / level)
        else:
            speed = min(speed, self._speed_to(length, 0.0))
        # It follows its set speed late, the more the less of it was kept at the last waypoint.
        if level > 0.05 and motion.settling_s > 0.0:
            late = GUIDANCE.late_fraction * math.exp(
                -GUIDANCE.late_fraction * self._leg_s / (GUIDANCE.longer_ratio * motion.settling_s)
            )
            speed *= 1.0 - (1.0 - GUIDANCE.kept_fraction * self._kept) * late
        return (speed * unit[0], speed * unit[1], speed * unit[2])

    def _passing_speed(self, unit: Vector, leg: Leg) -> float:
        if self.passed + 1 >= len(self._legs):
            return 0.0
        motion, after = self._motion, self._legs[self.passed + 1]
        onward, length = direction_and_length(leg.end_m, after.end_m)
        level, level_after = math.hypot(unit[0], unit[1]), math.hypot(onward[0], onward[1])
        if level_after * length < motion.corner_radius_m:
            return 0.0
        cosine = (unit[0] * onward[0] + unit[1] * onward[1]) / (level * level_after)
        between = math.pi - math.acos(max(-1.0, min(1.0, cosine)))
        circle = 0.5 * motion.acceleration_m_s2 * motion.corner_radius_m * math.tan(min(0.5 * between, 1.5707))
        speed = min(math.sqrt(circle), self._speed_to(length * level_after, 0.0), along_speed(onward, after.speeds))
        change = abs(onward[2] - unit[2])
        if motion.vertical_change_m_s is not None and change * speed > motion.vertical_change_m_s:
            speed = motion.vertical_change_m_s / change
        return speed

    def _speed_to(self, distance_m: float, end_m_s: float) -> float:
        """The speed from which ``end_m_s`` is reached over a way, with the delay until the brakes hold."""
        a, delay = self._motion.acceleration_m_s2, 4.0 * self._motion.acceleration_m_s2**2 / self._motion.jerk_m_s3
        return max(end_m_s, 0.5 * (math.sqrt(delay**2 + 4.0 * (2.0 * a * distance_m + end_m_s**2)) - delay))

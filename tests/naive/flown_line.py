"""How ArduCopter passes waypoints, by small steps of time: two motions from rest to rest that add up."""

import itertools
import math
from types import SimpleNamespace

import numpy as np

from tests.naive.flight_time import blended_saving, leg, peak_speed, ramp


def arducopter(vehicle):
    """Its pace with its own defaults, from the vehicle of a scenario file."""
    return SimpleNamespace(
        cruise_m_s=vehicle["cruise_speed_m_s"], climb_m_s=vehicle["max_climb_m_s"], descent_m_s=vehicle["max_descent_m_s"],
        airspeed_m_s=math.inf, wind_east_m_s=0.0, wind_north_m_s=0.0, acceleration_m_s2=vehicle.get("acceleration_m_s2", 2.5),
        vertical_acceleration_m_s2=1.0, jerk_m_s3=vehicle.get("jerk_m_s3", 1.0), corner=0, corner_radius_m=2.0, smoothing_s=0.3,
    )  # fmt: skip


def passed_corners(points, pace, steps=20):
    """For each inner point the places, in even steps of time, from where the next leg begins to where the last one ends.

    And the seconds of one step, of each.
    """
    motions = [_motion(pace, a, b) for a, b in itertools.pairwise(points)]
    corners, steps_s = [], []
    for point, (one, paths_a, slow_a), (two, paths_b, slow_b) in zip(points[1:], motions, motions[1:], strict=False):
        blend = max(0.0, blended_saving(pace, one, two) / math.sqrt(slow_a * slow_b) - pace.smoothing_s)
        positions = []
        for k in range(steps + 1):
            since = blend * k / steps
            short, onward = np.interp((blend - since) * slow_a, *paths_a), np.interp(since * slow_b, *paths_b)
            positions.append([p - short * a + onward * b for p, a, b in zip(point, one[0], two[0], strict=True)])
        corners.append(positions)
        steps_s.append(blend / steps)
    return np.array(corners), np.array(steps_s)


def reached_positions(points, radius_m=2.0, height_radius_m=0.8, step_m=0.01):
    """Where PX4 has reached each point but the first: in small steps towards it, until it is near on the map and in height."""
    position, positions = np.asarray(points[0], dtype=float), []
    for point in np.asarray(points, dtype=float)[1:]:
        while math.dist(position[:2], point[:2]) > radius_m or abs(position[2] - point[2]) > height_radius_m:
            step = point - position
            position = position + step * min(1.0, step_m / np.linalg.norm(step))
        positions.append(position)
    return np.array(positions)


def yaw(line, steps_s, cruise_m_s, before):
    """Where the nose points on each piece of a line: along it, but below 5 % of the cruise speed where it pointed before.

    Args:
        line: its points.
        steps_s: seconds of each piece; 0 where that is a leg.
        cruise_m_s: of the vehicle.
        before: heading before the line begins.
    """
    headings = []
    for a, b, seconds in zip(line, line[1:], steps_s, strict=False):
        over_ground = math.dist(a[:2], b[:2])
        if over_ground > 0.0 and over_ground >= 0.05 * cruise_m_s * seconds:
            before = ((b[0] - a[0]) / over_ground, (b[1] - a[1]) / over_ground)
        headings.append(before)
    return headings


def px4_begins(line, before, cruise_m_s, acceleration_m_s2=3.0, radius_m=2.0):
    """Speed with which PX4 begins each leg: that of a circle that touches both legs of the corner ``radius_m`` from it.

    It stops at the ends of legs that are shorter than that.
    """
    speeds = []
    for a, b in itertools.pairwise(np.asarray(line, dtype=float)):
        onward = (b - a)[:2]
        if min(np.linalg.norm(before), np.linalg.norm(onward)) < radius_m:
            speeds.append(0.0)
        else:
            angle = math.acos(
                np.clip(np.dot(before, onward) / np.linalg.norm(before) / np.linalg.norm(onward), -1.0, 1.0)
            )
            circle_m = radius_m / max(1e-9, math.tan(0.5 * angle))
            stops = _from_which(np.linalg.norm(onward), 0.0, acceleration_m_s2, 4.0)
            speeds.append(min(cruise_m_s, math.sqrt(0.5 * acceleration_m_s2 * circle_m), stops))
        before = onward
    return speeds


def turning(
    line,
    steps_s,
    steps,
    begins_m_s,
    before,
    cruise_m_s,
    acceleration_m_s2,
    rate_deg_s=60.0,
    step_s=0.01,
    lengths_m=None,
    yaw_acceleration_deg_s2=math.inf,
):
    """The line in small steps of time, while the nose turns no faster than it can: finer places, and the nose between them.

    Args:
        line: its points.
        steps_s: seconds of each piece; 0 where that is a leg, on which the vehicle speeds up until it cruises.
        steps: where the nose shall point on each piece; (0, 0): nowhere.
        begins_m_s: speed at the beginning of each leg.
        before: where the nose points before the line begins.
        cruise_m_s: of the vehicle.
        acceleration_m_s2: likewise.
        rate_deg_s: of the nose.
        step_s: of time.
        lengths_m: of the legs as they are flown; none: as they are.
        yaw_acceleration_deg_s2: how fast the rate changes.
    """
    line, turns_rad_s, last_path = np.asarray(line, dtype=float), 0.0, before if np.any(before) else steps[0]
    yaw = math.atan2(before[0], before[1]) if np.any(before) else None
    positions, yaws = [line[0]], []
    for k, (a, b, seconds, step, speed) in enumerate(zip(line, line[1:], steps_s, steps, begins_m_s, strict=False)):
        if not np.any(step):
            positions.append(b)
            yaws.append((0.0, 0.0))
            continue
        wanted = math.atan2(step[0], step[1])
        yaw = wanted if yaw is None else yaw
        if seconds > 0.0:
            yaw = _nearer(yaw, wanted, math.radians(rate_deg_s) * seconds)
        else:
            length_m, done_m, shown = math.dist(a, b) if lengths_m is None else lengths_m[k], 0.0, yaw
            px4 = None
            if yaw_acceleration_deg_s2 < math.inf:
                onward = begins_m_s[k + 1] if k + 1 < len(steps) else cruise_m_s
                px4 = _Px4Leg(speed * _cosine(last_path, step), onward, length_m, cruise_m_s, acceleration_m_s2)
            last_path = step
            while done_m < length_m and yaw != wanted:
                if px4 is not None:
                    limits = math.radians(rate_deg_s), math.radians(yaw_acceleration_deg_s2)
                    yaw, turns_rad_s = _driven(yaw, turns_rad_s, wanted, *limits, step_s)
                    done_m = px4.go(step_s)
                else:
                    yaw = _nearer(yaw, wanted, math.radians(rate_deg_s) * step_s)
                    speed = min(cruise_m_s, speed + acceleration_m_s2 * step_s)
                    done_m += speed * step_s
                has_turned = abs(math.remainder(yaw - shown, math.tau)) > math.radians(2.0)
                if (has_turned or yaw == wanted) and done_m < length_m:
                    positions.append(a + done_m / length_m * (b - a))
                    middle = shown + 0.5 * math.remainder(yaw - shown, math.tau)
                    yaws.append((math.sin(middle), math.cos(middle)))
                    shown = yaw
        positions.append(b)
        yaws.append((math.sin(yaw), math.cos(yaw)))
    return np.array(positions), yaws


class _Px4Leg:
    """A leg of PX4 in small steps of time: late behind its set speed, its acceleration and jerk limited, braking for its end."""

    jerk, settling_s = 4.0, 3.2

    def __init__(self, begin_m_s, end_m_s, length_m, cruise_m_s, acceleration_m_s2):
        self.speed, self.end_m_s, self.length_m = begin_m_s, end_m_s, length_m
        self.cruise_m_s, self.most = cruise_m_s, acceleration_m_s2
        self.lacks = 0.45 - 0.45 * 0.7 * max(0.0, begin_m_s) / cruise_m_s
        self.done_m = self.time_s = self.pull = 0.0

    def go(self, step_s):
        """The way along it a step later."""
        self.time_s += step_s
        most_m_s = min(self.cruise_m_s, _from_which(self.length_m - self.done_m, self.end_m_s, self.most, self.jerk))
        wanted = max(0.3, most_m_s * (1.0 - self.lacks * math.exp(-0.45 * self.time_s / (2.0 * self.settling_s))))
        missing = wanted - self.speed
        pull = math.copysign(min(self.most, math.sqrt(2.0 * self.jerk * abs(missing))), missing)
        self.pull += np.clip(pull - self.pull, -self.jerk * step_s, self.jerk * step_s)
        self.speed += self.pull * step_s
        self.done_m += self.speed * step_s
        return self.done_m


def _from_which(distance_m, end_m_s, acceleration_m_s2, jerk_m_s3):
    """The speed v with (v² - end²) / 2 a + 2 a v / j = way: from which PX4 still gets to the speed at the end."""
    low, high = 0.0, 1_000.0
    for _ in range(50):
        v = 0.5 * (low + high)
        step = (v * v - end_m_s**2) / (2.0 * acceleration_m_s2) + 2.0 * acceleration_m_s2 / jerk_m_s3 * v
        low, high = (v, high) if step < distance_m else (low, v)
    return low


def _cosine(one, other):
    size = np.linalg.norm(one) * np.linalg.norm(other)
    return float(np.dot(one, other) / size) if size > 0.0 else 1.0


def yaw_behind(before, steps, steps_s, rate_deg_s=60.0):
    """Where the nose points behind pieces of so many seconds, on which it turns to these ways as fast as it can."""
    yaw = math.atan2(before[0], before[1])
    for step, seconds in zip(steps, steps_s, strict=True):
        yaw = _nearer(yaw, math.atan2(step[0], step[1]), math.radians(rate_deg_s) * seconds)
    return math.sin(yaw), math.cos(yaw)


def _driven(yaw, rate, wanted, most, acceleration, step_s):
    """The nose and its rate a step later: full power towards where it is wanted, full brake where it would go beyond it."""
    off = math.remainder(wanted - yaw, math.tau)
    behind = off - 0.5 * rate * abs(rate) / acceleration
    rate = max(-most, min(rate + math.copysign(acceleration * step_s, behind), most))
    yaw += rate * step_s
    off = math.remainder(wanted - yaw, math.tau)
    return (wanted, 0.0) if abs(off) < math.radians(0.3) and abs(rate) < math.radians(4.0) else (yaw, rate)


def _nearer(yaw, wanted, most):
    """The angle, closer to the wanted one by ``most`` at most, the short way round."""
    off = math.remainder(wanted - yaw, math.tau)
    return wanted if abs(off) <= most else yaw + math.copysign(most, off)


def _motion(pace, a, b):
    one = leg(pace, a, b)
    peak = peak_speed(one[1], one[2], one[3], pace.jerk_m_s3)
    states = ramp(peak, one[3], pace.jerk_m_s3)
    times, steps = [state[0] for state in states], [state[1] for state in states]
    quickest = 2.0 * times[-1] + (one[1] - 2.0 * steps[-1]) / peak
    return one, (times, steps), quickest / (quickest + pace.smoothing_s)

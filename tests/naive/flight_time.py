"""Times of flight by small steps of time and speed: legs from rest to rest, and what passing a waypoint saves."""

import itertools
import math
from bisect import bisect_left

STEP_S = 0.02


def leg(pace, a, b):
    """Unit vector, length, and the largest speed and acceleration along it, each found by the axis that limits it."""
    length = math.dist(a, b)
    unit = [(y - x) / length for x, y in zip(a, b, strict=True)]
    level, steep = math.hypot(unit[0], unit[1]), abs(unit[2])
    speeds, accelerations = [], []
    if level > 0.0:
        speeds.append(ground_speed(pace, unit[0] / level, unit[1] / level) / level)
        accelerations.append(pace.acceleration_m_s2 / level)
    if steep > 0.0:
        speeds.append((pace.climb_m_s if unit[2] > 0.0 else pace.descent_m_s) / steep)
        accelerations.append(pace.vertical_acceleration_m_s2 / steep)
    return unit, length, min(speeds), min(accelerations)


def ground_speed(pace, east, north):
    """With wind: the largest ground speed along the leg whose airspeed is allowed, found by halving."""

    def airspeed(speed):
        return math.hypot(speed * east - pace.wind_east_m_s, speed * north - pace.wind_north_m_s)

    low, high = 0.0, pace.cruise_m_s
    if airspeed(high) <= pace.airspeed_m_s:
        return high
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if airspeed(middle) > pace.airspeed_m_s else (middle, high)
    return low


def ramp(speed, acceleration, jerk):
    """(time, way, speed, acceleration) in small steps from rest to a speed, the jerk limited."""
    states = [(0.0, 0.0, 0.0, 0.0)]
    time = distance = v = a = 0.0
    # The acceleration falls again when what is left of the speed is what it loses by falling.
    while v < speed and (a > 0.0 or time == 0.0):
        falling = a * a / (2.0 * jerk) >= speed - v
        new = max(0.0, a - jerk * STEP_S) if falling else min(acceleration, a + jerk * STEP_S)
        middle = 0.5 * (a + new)
        distance += v * STEP_S + 0.5 * middle * STEP_S**2
        v += middle * STEP_S
        time, a = time + STEP_S, new
        states.append((time, distance, v, a))
    return states


def peak_speed(length, speed, acceleration, jerk):
    low, high = 0.0, speed
    if 2.0 * ramp(speed, acceleration, jerk)[-1][1] <= length:
        return speed
    for _ in range(12):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if 2.0 * ramp(middle, acceleration, jerk)[-1][1] <= length else (low, middle)
    return low


def braked(pace, distance, most, begin, end):
    """Seconds and peak speed of a way from one speed to another, braking by the rule of PX4, added up over small speeds."""
    a, jerk = pace.acceleration_m_s2, pace.jerk_m_s3

    def faster(peak):
        last = ramp(peak - begin, a, jerk)[-1] if peak > begin else (0.0, 0.0)
        return last[0], begin * last[0] + last[1]

    def slower(peak):
        # (v^2 + v 4 a^2 / j) falls by 2 a over each metre.
        time = gone = 0.0
        steps = 60
        for k in range(steps):
            v = end + (peak - end) * (k + 0.5) / steps
            metres = (2.0 * v + 4.0 * a * a / jerk) * (peak - end) / steps / (2.0 * a)
            time, gone = time + metres / v, gone + metres
        return time, gone

    # The peak of the closed form counts a full ramp, also for small changes of speed.
    low, high = max(begin, end), most
    for _ in range(20):
        middle = 0.5 * (low + high)
        full = 0.5 * (middle + begin) * ((middle - begin) / a + a / jerk)
        low, high = (middle, high) if full + slower(middle)[1] <= distance else (low, middle)
    peak = max(min(most, low), min(begin, most), min(end, most))
    (t1, s1), (t2, s2) = faster(peak), slower(peak)
    return t1 + t2 + (distance - s1 - s2) / peak, peak


def flight_time(points, pace):
    pairs = [None if math.dist(a, b) == 0.0 else leg(pace, a, b) for a, b in itertools.pairwise(points)]
    total = sum(leg_time(pace, one) for one in pairs if one)
    for a, b in itertools.pairwise(pairs):
        if a and b and pace.acceleration_m_s2 < math.inf:
            total -= saving(pace, a, b)
    return total


def leg_time(pace, one):
    unit, length, speed, acceleration = one
    if pace.acceleration_m_s2 == math.inf:
        return length / speed
    if pace.corner == 1 and math.hypot(unit[0], unit[1]) > 1e-6:
        distance = max(length - pace.corner_radius_m, 0.05 * pace.corner_radius_m)
        return braked(pace, distance, speed, 0.0, stopping(pace, pace.corner_radius_m, 0.0))[0] + settling(pace, one)
    peak = peak_speed(length, speed, acceleration, pace.jerk_m_s3)
    up = ramp(peak, acceleration, pace.jerk_m_s3)[-1]
    return 2.0 * up[0] + (length - 2.0 * up[1]) / peak + pace.smoothing_s


def stopping(pace, distance, end):
    """Halving: the speed that falls to ``end`` over the way."""
    a, lag = pace.acceleration_m_s2, 4.0 * pace.acceleration_m_s2**2 / pace.jerk_m_s3
    low, high = 0.0, 1000.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if middle**2 + lag * middle <= 2.0 * a * distance + end**2 else (low, middle)
    return low


def settling(pace, one):
    return pace.settling_s * (1.0 - math.exp(-one[1] / (one[2] * pace.settling_tc_s)))


def saving(pace, a, b):
    return braked_saving(pace, a, b) if pace.corner == 1 else blended_saving(pace, a, b)


def blended_saving(pace, a, b):
    peaks = [peak_speed(one[1], one[2], one[3], pace.jerk_m_s3) for one in (a, b)]
    ramps = [ramp(peak, one[3], pace.jerk_m_s3) for peak, one in zip(peaks, (a, b), strict=True)]
    half = 0.5 * min(ramps[0][-1][0], ramps[1][-1][0])
    best = 0.0
    for k in range(201):
        time = half * k / 200
        (_, s1, v1, a1), (_, s2, v2, a2) = (at(states, time) for states in ramps)
        off = math.dist([s1 * x for x in a[0]], [s2 * x for x in b[0]])
        speed = math.hypot(*(v1 * x + v2 * y for x, y in zip(a[0], b[0], strict=True)))
        change = [a2 * y - a1 * x for x, y in zip(a[0], b[0], strict=True)]
        if (
            off > pace.corner_radius_m
            or speed > 1.001 * min(a[2], b[2])
            or math.hypot(*change[:2]) > 2.001 * pace.acceleration_m_s2
            or abs(change[2]) > 1.001 * pace.vertical_acceleration_m_s2
        ):
            break
        best = 2.0 * time
    return best


def at(states, time):
    return states[min(len(states) - 1, bisect_left(states, (time,)))]


def braked_saving(pace, a, b):
    level = [math.hypot(*one[0][:2]) for one in (a, b)]
    if min(level) <= 1e-6:
        return 0.0
    radius = pace.corner_radius_m
    cosine = sum(x * y for x, y in zip(a[0][:2], b[0][:2], strict=True)) / (level[0] * level[1])
    angle = math.acos(max(-1.0, min(1.0, cosine)))
    speed = 0.0
    if b[1] * level[1] >= radius:
        circle_m = math.inf if angle < 1e-9 else radius / math.tan(0.5 * angle)
        speed = min(
            math.sqrt(0.5 * pace.acceleration_m_s2 * circle_m), stopping(pace, b[1] * level[1], 0.0), a[2], b[2]
        )
        speed = min(speed, pace.vertical_change_m_s / max(1e-12, abs(b[0][2] - a[0][2])))
    end = max(speed, stopping(pace, radius, speed))
    begin = max(0.0, end * math.cos(angle))
    total = 0.0
    for one in (a, b):
        distance = max(one[1] - radius + radius * math.cos(angle), 0.05 * radius)
        passed, peak = braked(pace, distance, one[2], min(begin, one[2]), min(end, one[2]))
        stopped = leg_time(pace, one) - settling(pace, one)
        total += 0.5 * (stopped - passed + 0.7 * settling(pace, one) * min(1.0, begin / peak))
    return total

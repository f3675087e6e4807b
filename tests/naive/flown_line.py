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
    for point, (one, ways_a, slow_a), (two, ways_b, slow_b) in zip(points[1:], motions, motions[1:], strict=False):
        blend = max(0.0, blended_saving(pace, one, two) / math.sqrt(slow_a * slow_b) - pace.smoothing_s)
        places = []
        for k in range(steps + 1):
            since = blend * k / steps
            short, onward = np.interp((blend - since) * slow_a, *ways_a), np.interp(since * slow_b, *ways_b)
            places.append([p - short * a + onward * b for p, a, b in zip(point, one[0], two[0], strict=True)])
        corners.append(places)
        steps_s.append(blend / steps)
    return np.array(corners), np.array(steps_s)


def reached_places(points, radius_m=2.0, height_radius_m=0.8, step_m=0.01):
    """Where PX4 has reached each point but the first: in small steps towards it, until it is near on the map and in height."""
    place, places = np.asarray(points[0], dtype=float), []
    for point in np.asarray(points, dtype=float)[1:]:
        while math.dist(place[:2], point[:2]) > radius_m or abs(place[2] - point[2]) > height_radius_m:
            way = point - place
            place = place + way * min(1.0, step_m / np.linalg.norm(way))
        places.append(place)
    return np.array(places)


def nose(line, steps_s, cruise_m_s, before):
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


def _motion(pace, a, b):
    one = leg(pace, a, b)
    peak = peak_speed(one[1], one[2], one[3], pace.jerk_m_s3)
    states = ramp(peak, one[3], pace.jerk_m_s3)
    times, ways = [state[0] for state in states], [state[1] for state in states]
    quickest = 2.0 * times[-1] + (one[1] - 2.0 * ways[-1]) / peak
    return one, (times, ways), quickest / (quickest + pace.smoothing_s)

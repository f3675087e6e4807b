"""The line that an autopilot flies through waypoints, and its position when a waypoint counts as passed.

A sensor that observes from waypoints observes from these positions.

ArduCopter: each leg is a motion from rest to rest, and the next one begins before the last one ends. In a corner the two add up,
and the vehicle passes inside it, within ``corner_radius_m`` (:mod:`uavcover.kernels.flight_time`, BLENDED; AC_WPNav and SCurve of
ArduPilot). PX4 accepts a waypoint ``corner_radius_m`` before it. Without a home, or if the speed changes at once, the line is
straight.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from uavcover.kernels.arrays import BoolArray, FloatArray, IntArray, read_only
from uavcover.kernels.coverage import photo_positions
from uavcover.kernels.flight_time import BLENDED, BRAKED, Pace, speeds_over_ground, turn_times
from uavcover.kernels.yaw_in_turns import Pieces, braked_speeds_m_s, turned_line
from uavcover.scenario.site import Site
from uavcover.scenario.vehicles import pace_of
from uavcover.sensing.sensors import trigger_distance_m, turns_with_legs

_CORNER_POINTS = 17
"""Points of a rounded corner; the middle one is where the waypoint counts as passed.

With seven, the camera turns 10° less there than in flight.
"""

_LEAST_OFF_M = 0.02
"""A path that passes its waypoint this closely goes through it."""

_TURNING_FRACTION = 0.05
"""Fraction of the cruise speed below which the yaw is held (AC_PosControl::calculate_yaw_and_rate_yaw)."""

_HEIGHT_RADIUS_M = 0.8
"""A waypoint of PX4 is reached within this height (NAV_MC_ALT_RAD)."""

_LEAST_M = 1e-6
_LEAST_S = 1e-9


class RoundedCorners(NamedTuple):
    """Paths around waypoints.

    Attributes:
        positions_m: (n, points, 3) ENU, from leg to leg, in even steps of time.
        step_s: (n,) seconds between two of them.
    """

    positions_m: FloatArray
    step_s: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class FlownLine:
    """A line that is flown.

    Attributes:
        positions_m: (k, 3) ENU.
        headings: (k - 1, 2) heading on each of its pieces, east and north, of any length.
    """

    positions_m: FloatArray
    headings: FloatArray


def line_flown(site: Site, route_m: FloatArray) -> FlownLine:
    """The line flown along an (n, 3) ENU route, from the middle of its first corner to that of its last.

    The first and last corners depend on the transit, which is unknown here; they make no difference if the line is close to its
    legs. PX4 turns towards the next waypoint before it reaches the current one and flies approximately through it; the route ends
    where the last waypoint is accepted. For a sensor that turns with the legs, the line has pieces on which the vehicle yaws
    (:mod:`uavcover.kernels.yaw_in_turns`).
    """
    turns = turns_with_legs(site.scenario.sensor.sight)
    if _is_braked(site) and len(route_m) > 0:
        return _braked_line(site, route_m, turns=turns)
    corners = _corners(site, route_m)
    if corners is None or len(route_m) == 1:
        return FlownLine(route_m, np.diff(route_m[:, :2], axis=0))
    middle = _CORNER_POINTS // 2
    rounded = np.linalg.norm(corners.positions_m[:, middle] - route_m, axis=1) > _LEAST_OFF_M
    # All positions of each corner, or only the waypoint if it is passed exactly.
    numbers = np.arange(_CORNER_POINTS)
    kept = rounded[:, None] | (numbers == middle)
    corners.positions_m[~rounded, middle] = route_m[~rounded]
    positions = corners.positions_m[kept]
    steps = np.diff(positions[:, :2], axis=0)
    # Of each piece of the line; a leg after a corner has no fixed time.
    steps_s = np.where(rounded[:, None] & (numbers < _CORNER_POINTS - 1), corners.step_s[:, None], 0.0)[kept][:-1]
    slow = np.hypot(steps[:, 0], steps[:, 1]) < _TURNING_FRACTION * pace_of(site).cruise_m_s * steps_s
    there = heading_there(site, route_m[0])
    headings = _kept(np.vstack([there, steps]), np.append(False, slow))[1:]
    sizes = kept.sum(axis=1)
    first = sizes[0] - 1 - sizes[0] // 4
    last = len(positions) - sizes[-1] + 1 + sizes[-1] // 4
    if turns:
        # A leg begins at the speed of the corner's end, or from rest after a stop.
        size_m = np.linalg.norm(np.diff(positions, axis=0), axis=1)
        speeds_m_s = np.where(steps_s > 0.0, size_m / np.maximum(steps_s, _LEAST_S), 0.0)
        begins_m_s = np.minimum(np.append(0.0, speeds_m_s[:-1]), pace_of(site).cruise_m_s)
        pieces = Pieces(headings, steps_s, size_m, begins_m_s)
        positions, headings, numbers = turned_line(pace_of(site), positions, pieces, there)
        first, last = int(numbers[first]), int(numbers[last - 1]) + 1
    return FlownLine(np.ascontiguousarray(positions[first:last]), headings[first : last - 1])


def _braked_line(site: Site, route_m: FloatArray, *, turns: bool) -> FlownLine:
    """The line of PX4 along an (n, 3) route, n >= 1, with pieces of yaw if that matters.

    The vehicle yaws towards the next waypoint as soon as one is accepted. A leg that is barely longer than the radius leaves
    little time.
    """
    passed_m = positions_passed_m(site, route_m)
    positions = np.vstack([route_m[:-1], passed_m[-1:]])
    steps = np.diff(positions[:, :2], axis=0)
    if not turns or len(steps) == 0:
        return FlownLine(positions, steps)
    pace, there = pace_of(site), heading_there(site, route_m[0])
    courses = np.where(np.hypot(steps[:, :1], steps[:, 1:]) > 0.0, route_m[1:, :2] - passed_m[:-1, :2], 0.0)
    lengths_m = np.linalg.norm(np.diff(passed_m, axis=0), axis=1)
    begins_m_s = braked_speeds_m_s(pace, np.diff(route_m[:, :2], axis=0), there)
    turned = turned_line(pace, positions, Pieces(courses, np.zeros(len(steps)), lengths_m, begins_m_s), there)
    return FlownLine(turned.positions_m, turned.headings)


def _kept(values: FloatArray, missing: BoolArray) -> FloatArray:
    """(k, 2) values with missing ones replaced by the last present one; the first one is present."""
    before = np.maximum.accumulate(np.where(missing, 0, np.arange(len(values))))
    return np.ascontiguousarray(values[before])


def positions_passed_m(site: Site, route_m: FloatArray) -> FloatArray:
    """(n, 3) positions at which each waypoint of an (n, 3) ENU route counts as passed.

    PX4 accepts it where the leg comes within ``corner_radius_m`` of it on the map, near its height.
    """
    if not corners_matter(site):
        return route_m
    if site.home_m is not None and _is_braked(site):
        return _reached_m(pace_of(site), _above_home_m(site, site.home_m), route_m)
    corners = _corners(site, route_m)
    return route_m if corners is None else np.ascontiguousarray(corners.positions_m[:, _CORNER_POINTS // 2])


def _reached_m(pace: Pace, begin_m: FloatArray, route_m: FloatArray) -> FloatArray:
    """(n, 3) positions at which (n, 3) waypoints are accepted, each on the straight line from the last one."""
    positions, position = np.empty_like(route_m), begin_m
    for k, point in enumerate(route_m):
        level, rise = math.hypot(point[0] - position[0], point[1] - position[1]), abs(point[2] - position[2])
        short = min(1.0, pace.corner_radius_m / max(level, _LEAST_M), _HEIGHT_RADIUS_M / max(rise, _LEAST_M))
        position = point + short * (position - point)
        positions[k] = position
    return positions


def _above_home_m(site: Site, home_m: FloatArray) -> FloatArray:
    """(3,) the top of the climb above home."""
    return np.array([home_m[0], home_m[1], home_m[2] + site.scenario.vehicle.takeoff_height_m])


def corners_flown(site: Site, route_m: FloatArray) -> FloatArray | None:
    """(n, points, 3) corners of an (n, 3) ENU route; at both ends only the half on the route.

    None if they are not flown as ArduCopter does.
    """
    corners = _corners(site, route_m)
    if corners is None:
        return None
    positions, middle = corners.positions_m, _CORNER_POINTS // 2
    positions[0, :middle], positions[-1, middle + 1 :] = positions[0, middle], positions[-1, middle]
    return positions


def photos_on(line_m: FloatArray, trigger_m: float) -> tuple[IntArray, FloatArray]:
    """Trigger points along a line, by distance.

    Args:
        line_m: (k, 3) ENU.
        trigger_m: between two photos.

    Returns:
        (m,) the piece of the line that each is taken on, and (m, 3) positions.
    """
    pieces, fractions = photo_positions(line_m, trigger_m)
    onward_m = line_m[np.minimum(pieces + 1, len(line_m) - 1)] - line_m[pieces]
    return pieces, np.ascontiguousarray(line_m[pieces] + fractions[:, None] * onward_m)


def heading_there(site: Site, first_m: FloatArray) -> FloatArray:
    """(2,) direction east and north from home to the (3,) first waypoint. (0, 0) without a home."""
    return np.zeros(2) if site.home_m is None else np.asarray(first_m[:2] - site.home_m[:2])


def corners_matter(site: Site) -> bool:
    """Whether corners are not flown exactly and affect the observations.

    Flights over 40 m observed up to 3.1 points less than the straight lines of their plans, and over 250 to 500 m up to 0.6
    (docs/results/kinds.md). If the limits apply only to waypoints, as in the paper, straight lines count.
    """
    held = site.scenario.limits.applies_to != "waypoints"
    return held and site.home_m is not None and math.isfinite(pace_of(site).acceleration_m_s2)


def _is_braked(site: Site) -> bool:
    return corners_matter(site) and pace_of(site).corner == BRAKED


def _corners(site: Site, route_m: FloatArray) -> RoundedCorners | None:
    """Corner at each waypoint of an (n, 3) route; None where waypoints are passed exactly.

    Transits are straight, from the top of the climb above home.
    """
    home_m, pace = site.home_m, pace_of(site)
    if home_m is None or not corners_matter(site) or pace.corner != BLENDED or len(route_m) == 0:
        return None
    top = np.array([[home_m[0], home_m[1], home_m[2] + site.scenario.vehicle.takeoff_height_m]])
    corners = rounded_corners(pace, np.vstack([top, route_m, top]))
    if trigger_distance_m(site.scenario) is not None:
        # The mission contains the waypoint at which photos begin twice, and stops there.
        corners.positions_m[0] = route_m[0]
    return corners


def rounded_corners(pace: Pace, points_m: FloatArray) -> RoundedCorners:
    """Blended corners at the n - 2 inner ones of (n, 3) points.

    Args:
        pace: of the vehicle, BLENDED.
        points_m: ENU.
    """
    steps = np.diff(points_m, axis=0)
    length = np.linalg.norm(steps, axis=1)
    unit = steps / np.maximum(length, _LEAST_M)[:, None]
    ramp = _Ramps(pace, unit, length)
    # Time before its end at which a leg may let the next one begin; it is tested when the time of smoothing has passed.
    begins_s = -turn_times(pace, read_only(points_m))[1:-1]
    slower = np.sqrt(ramp.slower[:-1] * ramp.slower[1:])
    blend_s = np.maximum(0.0, begins_s / slower - pace.smoothing_s)
    fractions = np.linspace(0.0, 1.0, _CORNER_POINTS)
    short_m = ramp.distances_m(slice(None, -1), blend_s[:, None] * (1.0 - fractions))
    onward_m = ramp.distances_m(slice(1, None), blend_s[:, None] * fractions)
    corners = points_m[1:-1, None] - short_m[:, :, None] * unit[:-1, None] + onward_m[:, :, None] * unit[1:, None]
    return RoundedCorners(corners, blend_s / (_CORNER_POINTS - 1))


class _Ramps:
    """The motions of legs from rest.

    Attributes:
        slower: (n,) factor by which each is slower than its jerk allows.
    """

    def __init__(self, pace: Pace, unit: FloatArray, length_m: FloatArray) -> None:
        level, steep = np.hypot(unit[:, 0], unit[:, 1]), np.abs(unit[:, 2])
        level_least, steep_least = np.maximum(level, _LEAST_M), np.maximum(steep, _LEAST_M)
        over_ground = speeds_over_ground(pace, unit[:, :2] / level_least[:, None])
        vertical = np.where(unit[:, 2] > 0.0, pace.climb_m_s, pace.descent_m_s)
        speed = np.minimum(over_ground / level_least, vertical / steep_least)
        most = np.minimum(pace.acceleration_m_s2 / level_least, pace.vertical_acceleration_m_s2 / steep_least)
        self._jerk = pace.jerk_m_s3
        # The largest speed from which a leg comes to rest at its end, with and without a time of constant acceleration.
        late = most / self._jerk
        longer = 0.5 * most * (np.sqrt(late * late + 4.0 * length_m / most) - late)
        shorter = (0.5 * length_m * math.sqrt(self._jerk)) ** (2.0 / 3.0)
        reached = np.where(length_m < 2.0 * most * late * late, shorter, longer)
        self._peak = np.maximum(np.minimum(speed, reached), _LEAST_M)
        self._most = np.minimum(most, np.sqrt(self._peak * self._jerk))
        self._rise_s = self._most / self._jerk
        self._ramp_s = self._peak / self._most + self._rise_s
        quickest_s = length_m / self._peak + self._ramp_s
        self.slower = quickest_s / (quickest_s + pace.smoothing_s)

    def distances_m(self, legs: slice, seconds: FloatArray) -> FloatArray:
        """(k, m) metres along k legs after (k, m) seconds from rest."""
        ramp_s, peak = self._ramp_s[legs, None], self._peak[legs, None]
        time = np.minimum(seconds * self.slower[legs, None], ramp_s)
        first = self._first_half_m(legs, np.minimum(time, ramp_s - time))
        return np.where(time <= 0.5 * ramp_s, first, peak * (time - 0.5 * ramp_s) + first)

    def _first_half_m(self, legs: slice, time: FloatArray) -> FloatArray:
        rise, most = self._rise_s[legs, None], self._most[legs, None]
        rest = time - rise
        steady = most * (rise * rise / 6.0 + 0.5 * rise * rest + 0.5 * rest * rest)
        return np.where(rest < 0.0, self._jerk * time**3 / 6.0, steady)

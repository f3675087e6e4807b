"""Turns at waypoints as they are flown: wings begin them early or end them late, PX4's multirotors cut the corner."""

import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np

from mission_io.model.items import Command, Mission
from uavcover.extras.check.findings import CheckFinding, FlownPath, Segment
from uavcover.extras.check.tuning import PATH
from uavcover.extras.check.world import Aircraft
from uavcover.kernels.arrays import FloatArray

_FRACTIONS = (0.0, 0.34, 0.67, 1.0)


def turns_of(path: FlownPath, mission: Mission, aircraft: Aircraft) -> FlownPath:
    """Paths flown beside the legs at corners, one path for both ways of passing each.

    Wings lean into the turn before the waypoint, along an arc that touches both legs (ArduPlane from WP_RADIUS or its L1 distance
    on, PX4 from its switch distance on); or they pass the waypoint first, turn as tightly as they can, and come back to the leg.
    A multirotor of PX4 goes on when it is within its acceptance radius. ArduCopter passes within 2 m, which is not looked at.
    """
    found: list[Segment] = []
    legs = [segment for segment in path.distinct if np.isfinite(segment.enu_m).all() and len(segment.enu_m) > 1]
    for one, two in itertools.pairwise(legs):
        if _is_corner(one, two):
            found += _turns(one, two, mission, aircraft)
        elif aircraft.has_wings and _leaves_circle(one, two):
            found += _exits(one, two)
    return FlownPath(tuple(found), ())


def in_turns(
    judge: Callable[[FlownPath], Sequence[CheckFinding]], turns: FlownPath, legs: Sequence[CheckFinding]
) -> list[CheckFinding]:
    """Findings of turns that exceed a limit where the legs beside them do not."""
    broken = {(one.kind, number) for one in legs if one.weight == "breaks" for number in range(*_reach(one))}
    return [
        dataclasses.replace(one, what=f"in the turn at this item: {one.what}")
        for one in judge(turns)
        if one.weight == "breaks" and not any((one.kind, number) in broken for number in range(*_reach(one)))
    ]


def _reach(finding: CheckFinding) -> tuple[int, int]:
    first, last = finding.items or (0, 0)
    return first, last + 1


def _is_corner(one: Segment, two: Segment) -> bool:
    flown = one.phase in ("route", "return") and two.phase in ("route", "return", "landing")
    meet = float(np.linalg.norm(one.enu_m[-1] - two.enu_m[0])) < 0.5
    return flown and meet and one.is_straight and two.is_straight and one.wait_s == 0.0


def _leaves_circle(one: Segment, two: Segment) -> bool:
    meet = float(np.linalg.norm(one.enu_m[-1] - two.enu_m[0])) < 0.5
    circles = not one.is_straight and one.items[0] == one.items[1] and len(one.enu_m) >= PATH.circle_points
    return circles and meet and two.is_straight and two.phase in ("route", "return", "landing")


def _exits(circle: Segment, leg: Segment) -> list[Segment]:
    """Wings leave a circle where they head for the next place, and not where they came to it.

    ArduPlane flies on from there (parameter 4 of 1) or comes back to the line from the centre (0): both ways, and lines between.
    """
    points = circle.enu_m[: PATH.circle_points, :2]
    center = 0.5 * (points.min(axis=0) + points.max(axis=0))
    radius_m = float(np.hypot(*(points[0] - center)))
    to = leg.enu_m[-1]
    offset = to[:2] - center
    distance_m = float(np.hypot(*offset))
    if distance_m <= radius_m:
        return []
    first, second = points[0] - center, points[1] - center
    left = math.copysign(1.0, float(first[0] * second[1] - first[1] * second[0]))  # anticlockwise
    off = -left * math.acos(radius_m / distance_m)
    spoke = radius_m / distance_m * np.array([
        offset[0] * math.cos(off) - offset[1] * math.sin(off), offset[0] * math.sin(off) + offset[1] * math.cos(off)
    ])  # fmt: skip
    up_m = leg.enu_m[0, 2]
    return [
        Segment(leg.items, "route", np.array([[*(center + part * spoke), up_m], to]), leg.speed_m_s, is_straight=False)
        for part in _FRACTIONS
    ]


def _turns(one: Segment, two: Segment, mission: Mission, aircraft: Aircraft) -> list[Segment]:
    corner = one.enu_m[-1]
    before, after = one.enu_m[0] - corner, two.enu_m[-1] - corner
    in_m, out_m = (float(np.hypot(*offset[:2])) for offset in (before, after))
    if min(in_m, out_m) < 1.0:
        return []
    u, v = -before[:2] / in_m, after[:2] / out_m
    turn_deg = math.degrees(math.atan2(float(u[0] * v[1] - u[1] * v[0]), float(u @ v)))  # to the left is positive
    if abs(turn_deg) < PATH.straight_deg:
        return []
    rises = before[2] / in_m, after[2] / out_m
    radius_m = aircraft.turn_radius_at(one.speed_m_s)
    cut_m = _cut_m(abs(turn_deg), radius_m, one.items[1], mission, aircraft)
    lines = []
    if cut_m > 0.0 and abs(turn_deg) < PATH.about_deg:
        # PX4's multirotors are at the waypoint's own height before they go on (NAV_MC_ALT_RAD).
        climbs = rises if aircraft.has_wings else (0.0, rises[1])
        lines.append(_early(corner, u, turn_deg, min(cut_m, in_m, out_m), climbs))
    if radius_m > 0.0:
        lines.append(_late(corner, u, v, turn_deg, radius_m, out_m, rises[1]))
    items = (one.items[0], two.items[1])
    return [Segment(items, "route", line, two.speed_m_s, is_straight=False) for line in lines]


def _cut_m(turn_deg: float, radius_m: float, number: int, mission: Mission, aircraft: Aircraft) -> float:
    """Distance before the waypoint at which the next leg begins."""
    item = mission.items[number - 1] if 1 <= number <= len(mission.items) else None
    own_m = 0.0
    if item is not None and item.command == Command.NAV_WAYPOINT and math.isfinite(item.params[1]):
        own_m = max(0.0, item.params[1])
    if not aircraft.has_wings:
        return (own_m or aircraft.acceptance_m) if aircraft.autopilot == "px4" else 0.0
    needed_m = radius_m * math.tan(math.radians(min(turn_deg, PATH.about_deg)) / 2.0)
    # ArduPlane: turn_distance(wp_radius, angle) shrinks it for turns of less than 90 degrees.
    switch_m = (own_m or aircraft.acceptance_m) * min(1.0, turn_deg / 90.0)
    return max(needed_m, switch_m)


def _early(corner: FloatArray, u: FloatArray, turn_deg: float, cut_m: float, rises: tuple[float, float]) -> FloatArray:
    """An arc that touches the legs ``cut_m`` before and after a corner."""
    half = math.radians(abs(turn_deg)) / 2.0
    radius_m = cut_m / math.tan(half)
    left = math.copysign(1.0, turn_deg)
    begin = corner[:2] - u * cut_m
    center = begin + np.array([-u[1], u[0]]) * left * radius_m
    turned = np.radians(_steps_deg(abs(turn_deg)))
    spoke = begin - center
    points = center + np.column_stack([
        spoke[0] * np.cos(turned) - left * spoke[1] * np.sin(turned),
        left * spoke[0] * np.sin(turned) + spoke[1] * np.cos(turned),
    ])  # fmt: skip
    fraction = turned / turned[-1]
    ups = corner[2] + cut_m * (rises[0] * (1.0 - fraction) ** 2 + rises[1] * fraction**2)
    return np.column_stack([points, ups])


def _late(
    corner: FloatArray, u: FloatArray, v: FloatArray, turn_deg: float, radius_m: float, out_m: float, rise: float
) -> FloatArray:
    """Turn after the waypoint: an arc as tight as possible until the path leads back to the leg, and the path back."""
    left = math.copysign(1.0, turn_deg)
    center = corner[:2] + np.array([-u[1], u[0]]) * left * radius_m
    turned = np.radians(_steps_deg(min(abs(turn_deg) + PATH.back_deg, 355.0)))
    spoke = corner[:2] - center
    arc = center + np.column_stack([
        spoke[0] * np.cos(turned) - left * spoke[1] * np.sin(turned),
        left * spoke[0] * np.sin(turned) + spoke[1] * np.cos(turned),
    ])  # fmt: skip
    away = arc - corner[:2]
    beside = -left * (v[0] * away[:, 1] - v[1] * away[:, 0])  # outside of the turn is positive
    over = np.flatnonzero((turned > math.radians(abs(turn_deg))) & (beside <= 0.0))
    if len(over):
        arc = arc[: over[0] + 1]
    along = (arc - corner[:2]) @ v
    last_beside = float(beside[len(arc) - 1])
    if last_beside > 0.0:
        back = corner[:2] + v * (float(along[-1]) + last_beside / math.tan(math.radians(PATH.back_deg)))
        arc = np.vstack([arc, back])
        along = np.append(along, (back - corner[:2]) @ v)
    ups = corner[2] + rise * np.clip(along, 0.0, out_m)
    return np.column_stack([arc, ups])


def _steps_deg(turn_deg: float) -> FloatArray:
    return np.linspace(0.0, turn_deg, max(2, math.ceil(turn_deg / PATH.step_deg) + 1))


def straight(begin_m: FloatArray, end_m: FloatArray, *, step_m: float) -> FloatArray:
    """Points on a straight line, ``step_m`` apart or nearer, both ends included."""
    pieces = max(1, math.ceil(math.hypot(*(end_m - begin_m)[:2]) / step_m))
    return np.asarray(begin_m + np.linspace(0.0, 1.0, pieces + 1)[:, None] * (end_m - begin_m))


def spline(
    begin_m: FloatArray, end_m: FloatArray, begin_vector_m: FloatArray, end_vector_m: FloatArray, *, step_m: float
) -> FloatArray:
    """Points on the curve that ArduPilot flies to a spline waypoint: a cubic Hermite polynomial.

    Source: ArduPilot, libraries/AP_Math/SplineCurve.cpp, set_origin_and_destination and update_solution: the two vectors are
    scaled down together where their lengths sum to more than ``PATH.spline_factor`` chords.
    """
    chord_m = float(np.linalg.norm(end_m - begin_m))
    if chord_m == 0.0:
        return np.array([begin_m, end_m])
    vectors_m = float(np.linalg.norm(begin_vector_m) + np.linalg.norm(end_vector_m))
    scale = min(1.0, PATH.spline_factor * chord_m / vectors_m) if vectors_m > 0.0 else 1.0
    v0, v1 = begin_vector_m * scale, end_vector_m * scale
    longest_m = chord_m + float(np.linalg.norm(v0) + np.linalg.norm(v1))  # no shorter than the curve
    t = np.linspace(0.0, 1.0, max(8, math.ceil(longest_m / step_m)) + 1)[:, None]
    square = -3.0 * begin_m - 2.0 * v0 + 3.0 * end_m - v1
    cube = 2.0 * begin_m + v0 - 2.0 * end_m + v1
    return np.asarray(begin_m + v0 * t + square * t**2 + cube * t**3)


def circle(
    center_m: FloatArray, radius_m: float, begin_m: FloatArray, *, turns: float, end_height_m: float, clockwise: bool
) -> FloatArray:
    """Points on a circle from ``begin_m``, outside by no more than 0.1 % of the radius, the height changing evenly.

    Args:
        center_m: (3,) or (2,) its centre.
        radius_m: its radius.
        begin_m: (3,) a place; the circle begins nearest to it, at its height.
        turns: how often.
        end_height_m: height at the end.
        clockwise: seen from above.
    """
    away = begin_m[:2] - center_m[:2]
    first = math.atan2(away[0], away[1]) if np.hypot(*away) > 0.0 else 0.0  # from north, clockwise
    sweep = 2.0 * math.pi * turns * (1.0 if clockwise else -1.0)
    corners = max(2, math.ceil(72 * turns) + 1)
    angles = first + np.linspace(0.0, sweep, corners)
    reach = radius_m * 1.0004  # chords of five degrees come nowhere nearer than the radius less half a thousandth
    heights = np.linspace(begin_m[2], end_height_m, corners)
    return np.column_stack([center_m[0] + reach * np.sin(angles), center_m[1] + reach * np.cos(angles), heights])

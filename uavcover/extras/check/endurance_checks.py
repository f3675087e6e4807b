"""Check the duration in the worst wind, and whether a fixed wing can climb and turn as its mission requires."""

import itertools
import math

import numpy as np

from uavcover.extras.check.findings import CheckFinding, FlownPath, Segment, joined
from uavcover.extras.check.tuning import CHECKS
from uavcover.extras.check.world import Aircraft, Limits, World
from uavcover.kernels import flight_time as kernels
from uavcover.kernels.flight_time import Pace
from uavcover.model.vehicle import MOTIONS
from uavcover.scenario.vehicles import moving_pace


def flight_time_s(path: FlownPath, aircraft: Aircraft, wind_m_s: float) -> float:
    """Seconds from take-off to the end, in constant wind from the worst of twelve directions; infinite where wind wins."""
    directions = range(CHECKS.directions if wind_m_s > 0.0 else 1)
    times = [_time_s(path, aircraft, wind_m_s, 2.0 * math.pi * k / CHECKS.directions) for k in directions]
    return max(times)


def endurance_findings(path: FlownPath, aircraft: Aircraft, limits: Limits) -> tuple[float, list[CheckFinding]]:
    """The time of the mission, and whether the battery lasts for it."""
    seconds = flight_time_s(path, aircraft, limits.wind_m_s)
    wind = f" in {limits.wind_m_s:g} m/s of wind" if limits.wind_m_s > 0.0 else ""
    if not math.isfinite(seconds):
        what = f"the aircraft makes no progress against {limits.wind_m_s:g} m/s of wind"
        return seconds, [CheckFinding(kind="wind", weight="breaks", what=what, do="fly in less wind")]
    if limits.wind_m_s > 0.0 and not aircraft.has_wings and aircraft.max_airspeed_m_s is None:
        what = f"the flight in {limits.wind_m_s:g} m/s of wind cannot be judged: the maximum airspeed is unknown"
        do = "specify --vehicle with a name, or with a TOML file that contains max_speed_m_s"
        found = CheckFinding(kind="wind", weight="unknown", what=what, do=do)
        return seconds, [found, *_battery_findings(seconds, aircraft, ", without wind")]
    return seconds, _battery_findings(seconds, aircraft, wind)


def _battery_findings(seconds: float, aircraft: Aircraft, wind: str) -> list[CheckFinding]:
    if aircraft.endurance_s is None:
        return []
    usable_s = aircraft.endurance_s * (1.0 - aircraft.reserve_fraction)
    if seconds <= usable_s:
        return []
    what = (
        f"the mission takes {seconds / 60.0:.1f} min{wind}; the battery lasts {usable_s / 60.0:.1f} min with "
        f"{100.0 * aircraft.reserve_fraction:.0f} % held in reserve"
    )
    do = "split the mission, or fly it faster"
    return [CheckFinding(kind="battery", weight="breaks", by=seconds - usable_s, unit="s", what=what, do=do)]


def _time_s(path: FlownPath, aircraft: Aircraft, wind_m_s: float, to_rad: float) -> float:
    wind = np.array([math.sin(to_rad), math.cos(to_rad)]) * wind_m_s
    total = 0.0
    before: Segment | None = None
    for segment in path.segments:
        points = segment.known_m
        if len(points) < 2:
            continue
        pace = _pace(segment, aircraft, wind)
        if aircraft.has_wings or not segment.is_straight:
            total += _steady_s(points, segment, aircraft, wind)
        elif segment.phase == "take-off":
            total += kernels.takeoff_time(pace, max(0.0, float(points[-1, 2] - points[0, 2])))
        elif segment.phase == "landing":
            total += kernels.landing_time(pace, max(0.0, float(points[0, 2] - points[-1, 2])))
        else:
            ends = np.ascontiguousarray(points[[0, -1]])
            if _slowest_m_s(ends, segment, aircraft, wind) < CHECKS.least_speed_m_s:
                return math.inf
            total += float(kernels.leg_times(pace, ends).sum())
            if (
                before is not None
                and before.is_straight
                and before.wait_s == 0.0
                and before.speed_m_s == segment.speed_m_s
            ):
                corner = np.ascontiguousarray(np.vstack([before.enu_m[0], ends]))
                if before.phase == "route" and np.isfinite(corner).all():
                    total += float(kernels.turn_times(pace, corner).sum())
        total += segment.wait_s
        before = segment
    return total


def _pace(segment: Segment, aircraft: Aircraft, wind: np.ndarray) -> Pace:
    return moving_pace(
        MOTIONS[aircraft.autopilot],
        cruise_m_s=segment.speed_m_s,
        climb_m_s=aircraft.max_climb_m_s,
        descent_m_s=aircraft.max_descent_m_s,
        airspeed_m_s=aircraft.max_airspeed_m_s,
        wind_m_s=(float(wind[0]), float(wind[1])),
    )


def _speeds_m_s(directions: np.ndarray, segment: Segment, aircraft: Aircraft, wind: np.ndarray) -> np.ndarray:
    """Speeds over ground along (n, 2) unit vectors. Wings hold their airspeed, a multirotor its ground speed if it can."""
    along = directions @ wind
    across = directions[:, 0] * wind[1] - directions[:, 1] * wind[0]
    airspeed = segment.speed_m_s if aircraft.has_wings else aircraft.max_airspeed_m_s
    if airspeed is None:
        return np.full(len(directions), segment.speed_m_s)
    can = along + np.sqrt(np.maximum(airspeed**2 - across**2, 0.0))
    can = np.where(np.abs(across) > airspeed, 0.0, can)
    return can if aircraft.has_wings else np.minimum(can, segment.speed_m_s)


def _slowest_m_s(points: np.ndarray, segment: Segment, aircraft: Aircraft, wind: np.ndarray) -> float:
    steps = np.diff(points[:, :2], axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    moving = lengths > 1e-6
    if not moving.any():
        return math.inf
    return float(_speeds_m_s(steps[moving] / lengths[moving, None], segment, aircraft, wind).min())


def _steady_s(points: np.ndarray, segment: Segment, aircraft: Aircraft, wind: np.ndarray) -> float:
    """Seconds along a curve at steady speed, no faster than it may climb and descend."""
    if _slowest_m_s(points, segment, aircraft, wind) < CHECKS.least_speed_m_s:
        return math.inf
    steps = np.diff(points, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    directions = steps[:, :2] / np.maximum(lengths, 1e-9)[:, None]
    forward = np.where(
        lengths > 1e-6, lengths / np.maximum(_speeds_m_s(directions, segment, aircraft, wind), 1e-9), 0.0
    )
    rise = np.where(steps[:, 2] > 0.0, steps[:, 2] / aircraft.max_climb_m_s, -steps[:, 2] / aircraft.max_descent_m_s)
    return float(np.maximum(forward, rise).sum())


def speed_findings(path: FlownPath, aircraft: Aircraft) -> list[CheckFinding]:
    """Segments whose speed is more than the vehicle makes, or than any multirotor where its own is unknown."""
    most, who, do = aircraft.max_airspeed_m_s, "the vehicle flies", "command a lower speed"
    if most is None and not aircraft.has_wings:
        most, who, do = CHECKS.fastest_multirotor_m_s, "multirotors fly", f"{do}, or name a faster vehicle (--vehicle)"
    if most is None:
        return []
    found = [
        CheckFinding(
            kind="speed", weight="breaks", items=segment.items, by=segment.speed_m_s - most, unit="m/s",
            what=f"the mission commands {segment.speed_m_s:g} m/s, but {who} at most {most:g} m/s", do=do,
        )
        for segment in path.distinct
        if segment.speed_m_s > most + 1e-6
    ]  # fmt: skip
    return joined(found, lambda one: one.what)


def wing_findings(path: FlownPath, world: World, aircraft: Aircraft) -> list[CheckFinding]:
    """Legs that wings cannot follow: too steep, or turns that need more room than the legs have."""
    if not aircraft.has_wings:
        return []
    steep, tight = [], []
    legs = [segment for segment in path.segments if segment.is_straight and np.isfinite(segment.enu_m).all()]
    for segment in legs:
        if segment.phase != "route":
            continue
        step = segment.enu_m[-1] - segment.enu_m[0]
        flat_m, rise_m = float(np.hypot(*step[:2])), float(step[2])
        rate = aircraft.max_climb_m_s if rise_m > 0.0 else aircraft.max_descent_m_s
        missing_m = abs(rise_m) - flat_m * rate / segment.speed_m_s
        if missing_m > 1.0:
            words = "climb" if rise_m > 0.0 else "descent"
            what = (
                f"the leg has a {words} of {abs(rise_m):.0f} m over {flat_m:.0f} m; at its end, the vehicle is "
                f"{missing_m:.0f} m short"
            )
            do = "lengthen the leg, or first circle to the required height (LOITER_TO_ALT)"
            found = segment.found("climb", missing_m, what=what, do=do, weight="breaks" if rise_m > 0.0 else "look")
            steep.append(found.at(world.geodetic(segment.enu_m[-1])))
    for one, two in itertools.pairwise(legs):
        if one.items[1] == two.items[0] and one.phase == two.phase == "route":
            tight += _tight_turn(one, two, world, aircraft)
    return [*steep, *joined(tight, lambda found: found.kind)]


def _tight_turn(one: Segment, two: Segment, world: World, aircraft: Aircraft) -> list[CheckFinding]:
    a, b = ((each.enu_m[-1] - each.enu_m[0])[:2] for each in (one, two))
    length_a, length_b = float(np.hypot(*a)), float(np.hypot(*b))
    if min(length_a, length_b) < 1e-6:
        return []
    angle = math.acos(min(1.0, max(-1.0, float(a @ b) / (length_a * length_b))))
    radius_m = aircraft.turn_radius_at(one.speed_m_s)
    needed_m = radius_m * math.tan(min(angle, math.radians(170.0)) / 2.0)
    aside_m = radius_m * (1.0 - math.cos(angle))
    if needed_m <= min(length_a, length_b):
        return []
    what = (
        f"the legs are too short for a turn of {math.degrees(angle):.0f} degrees with a radius of {radius_m:.0f} m; "
        f"the aircraft flies up to {aside_m:.0f} m beside the next leg"
    )
    found = two.found("turn", aside_m, what=what, do="increase the distance between the waypoints", weight="look")
    return [found.at(world.geodetic(one.enu_m[-1]))]

"""Propose rally points that give a safe return from every second of a planned flight, where such positions exist."""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import shapely

from mission_io.model.items import Frame, FramedPoint
from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.missions.failsafe_checks import judge_paths
from uavcover.missions.failsafe_path import direct_return
from uavcover.missions.failsafe_states import FlightStates
from uavcover.missions.return_advice import (
    OwnReturns,
    ReturnAdvice,
    destinations,
    flight_states,
    return_limits,
    settings_of,
)
from uavcover.model.vehicle import AutopilotName
from uavcover.scenario.site import Site, once, rally_en

MOST_POINTS = 5
"""Both autopilots take more; a pilot has to know them."""
_RINGS_M, _DIRECTIONS = (0.0, 60.0, 120.0, 200.0), 8
_APART_M = 25.0
_STEEPEST = 0.15
"""Rise per metre of ground to land on."""
_FOOT_M = 4.0
_FROM_FENCE_M, _FROM_HOME_M = 10.0, 20.0
_MOST_CANDIDATES, _MOST_MOMENTS = 40, 400
_MORE_HEIGHTS_M = (0.0, 40.0)
"""A rally point of ArduPilot is a least height of the return to it as well."""
_SLACK_M = 1.0


def with_rally(returns: OwnReturns) -> tuple[OwnReturns, ReturnAdvice]:
    """The returns of a flight with rally points, judged: home at a safe height, and proposed ones if requested."""
    site = returns.site
    proposed = _above_home(site, _proposed(site, returns.path_m, returns.autopilot))
    returns = replace(returns, rally=proposed)
    advice = returns.advice({})
    if site.home_m is None or not math.isfinite(advice.safe_return_height_m):
        return returns, advice
    (home,) = _above_home(site, site.home_m[None])
    height = max(advice.return_height_m, math.ceil(advice.safe_return_height_m))
    return replace(returns, rally=(replace(home, alt_m=float(height)), *proposed)), advice


def _proposed(site: Site, path_m: FloatArray, autopilot: AutopilotName) -> FloatArray:
    """(r, 3) ENU rally points beside home; sorties are compiled several times, and searched for once."""
    given = site.scenario.planner.rally
    if not isinstance(given, str):
        places = rally_en(site.scenario, site.frame)
        return np.array([next(_with_heights(site, place, autopilot)) for place in places], float).reshape(-1, 3)
    if given != "auto":
        return np.empty((0, 3))
    known, key = _known(site), (path_m.tobytes(), autopilot)
    if key not in known:
        known[key] = propose_rally(site, path_m, autopilot=autopilot)
    return known[key]


@once
def _known(_site: Site) -> dict[tuple[bytes, str], FloatArray]:
    """Rally points that were proposed before, by path and autopilot."""
    return {}


def _above_home(site: Site, places_m: FloatArray) -> tuple[FramedPoint, ...]:
    """(r, 3) ENU places above home."""
    if site.frame is None or site.home_m is None or not len(places_m):
        return ()
    lat, lon, alt = site.frame.geodetic_from_enu(places_m)
    above = alt - site.alts_amsl_m(site.home_m[None])[0]
    return tuple(
        FramedPoint(float(a), float(o), round(float(up), 3), Frame.ABOVE_HOME)
        for a, o, up in zip(lat, lon, above, strict=True)
    )


def propose_rally(site: Site, path_m: FloatArray, *, autopilot: AutopilotName) -> FloatArray:
    """(r, 3) ENU rally points for a (k, 3) ENU path.

    None where returns home are safe, or no point makes them safer.

    Greedy: each time the point that leaves the fewest moments with an unsafe return, by the autopilot's own selection.
    """
    moments = _thinned(flight_states(site, path_m))
    chosen = np.empty((0, 3))
    bad = _unsafe(site, path_m, moments, chosen, autopilot)
    candidates = _candidates(site, moments, bad, autopilot) if bad.any() else chosen
    while bad.any() and len(chosen) < MOST_POINTS and len(candidates):
        left = [
            _unsafe(site, path_m, moments, np.vstack([chosen, point]), autopilot) for point in candidates[:, None, :]
        ]
        counts = [int(one.sum()) for one in left]
        best = int(np.argmin(counts))
        if counts[best] >= int(bad.sum()):
            break
        chosen, bad = np.vstack([chosen, candidates[best]]), left[best]
        away = np.hypot(*(candidates[:, :2] - candidates[best, :2]).T)
        candidates = candidates[away > _APART_M]
    return chosen


def _thinned(states: FlightStates) -> FlightStates:
    keep = np.unique(np.linspace(0, len(states.times_s) - 1, _MOST_MOMENTS).astype(np.int64))
    ahead = None if states.ahead_m is None else states.ahead_m[keep]
    return FlightStates(
        states.places_m[keep], states.velocities_m_s[keep], states.times_s[keep], states.legs[keep], ahead
    )


def _unsafe(
    site: Site, path_m: FloatArray, states: FlightStates, rally_m: FloatArray, autopilot: AutopilotName
) -> BoolArray:
    """(n,) moments with an unsafe commanded return."""
    settings, limits = settings_of(site, autopilot), return_limits(site)
    to = destinations(site, path_m, rally_m, autopilot)
    paths = direct_return(settings, states, to, limits.ground_alts_m)
    return judge_paths([paths], settings, states, to, limits).is_unsafe


def _candidates(site: Site, states: FlightStates, bad: BoolArray, autopilot: AutopilotName) -> FloatArray:
    """(c, 3) ENU places to land on, below and beside the flight where its return is unsafe."""
    begins = states.places_m[bad, :2]
    angles = np.arange(_DIRECTIONS) * (math.tau / _DIRECTIONS)
    around = [np.zeros(2)]
    around += [radius * np.array([math.cos(a), math.sin(a)]) for radius in _RINGS_M[1:] for a in angles]
    places = (begins[:, None, :] + np.array(around)[None]).reshape(-1, 2)
    _, first = np.unique(np.round(places / _APART_M), axis=0, return_index=True)
    places = places[np.sort(first)]
    places = places[_may_land(site, places)]
    places = (
        places[np.unique(np.linspace(0, len(places) - 1, _MOST_CANDIDATES).astype(np.int64))] if len(places) else places
    )
    found = [row for place in places for row in _with_heights(site, place, autopilot)]
    return np.array(found, float).reshape(-1, 3)


def _with_heights(site: Site, place: FloatArray, autopilot: AutopilotName) -> Iterator[tuple[float, float, float]]:
    """A landing place as the autopilot's rally points: PX4 lands at their height, ArduPilot returns at it or higher."""
    east, north = place
    ground = float(site.ground.heights_m(place[None])[0])
    if autopilot == "px4":
        yield (east, north, ground)
        return
    clearance = site.scenario.limits.transit_clearance_m + site.scenario.limits.height_margin_m + _SLACK_M
    home_up = 0.0 if site.home_m is None else float(site.home_m[2])
    for more in _MORE_HEIGHTS_M:
        above_home = math.ceil(ground + clearance + more - home_up)  # whole metres are stored
        if more == 0.0 or clearance + more <= site.scenario.transit_ceiling_agl_m:
            yield (east, north, home_up + above_home)


def _may_land(site: Site, places: FloatArray) -> BoolArray:
    """(n,) level enough ground inside the fence, away from home, zones and obstacles."""
    ground = site.ground
    good = np.isfinite(ground.heights_m(places))
    for offset in ((0.0, 0.0), (_FOOT_M, 0.0), (-_FOOT_M, 0.0), (0.0, _FOOT_M), (0.0, -_FOOT_M)):
        slope = np.hypot(*ground.gradients(places + np.array(offset)).T)
        good &= np.isfinite(slope) & (slope <= _STEEPEST)
    points = shapely.points(places)
    good &= shapely.covers(site.fence.buffer(-_FROM_FENCE_M), points)
    if site.home_m is not None:
        good &= np.hypot(*(places - site.home_m[:2]).T) >= _FROM_HOME_M
    for zone in site.zones:
        good &= ~shapely.intersects(zone.grown(zone.entry.margin_m), points)
    beside = site.scenario.obstacles.clearance_beside_m
    for prism in site.prisms:
        good &= shapely.distance(prism.footprint.polygon, points) >= beside
    return np.asarray(good)

"""Judge the autopilot's own returns from every second of a planned flight, and propose rally points that make them safe."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely

from mission_io.model.items import Frame, FramedPoint, GeoPoint
from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.missions.failsafe_checks import ReturnLimits, judge_paths, judge_returns
from uavcover.missions.failsafe_path import direct_return
from uavcover.missions.failsafes import (
    IN_PLACE,
    Destinations,
    FailsafeSettings,
    FlightStates,
    UnsafeReturn,
    failsafe_settings,
    states_along,
)
from uavcover.model.vehicle import AutopilotName
from uavcover.scenario.site import Site, once, rally_en

_STEP_M = 5.0
"""Returns begin at least this often along the path; at up to 5 m/s that is every second."""


@dataclass(frozen=True, slots=True)
class ReturnAdvice:
    """Whether the autopilot's own returns are safe, from every second along the path and not from waypoints alone."""

    return_height_m: float  # height above home that was checked
    # numbers of the planned waypoints from which, or from the leg to which, the return is unsafe. The transit counts as
    # the leg to waypoint 0, the transit home as part of the last waypoint.
    unsafe_waypoints: tuple[int, ...]
    # return height from which all returns keep the transit clearance; infinite where ground is unknown
    safe_return_height_m: float
    no_fly: tuple[str, ...] = ()  # names of the no-fly zones that returns enter
    # from where to where, and why; ``first_leg`` and ``last_leg`` are numbers of planned waypoints here
    unsafe: tuple[UnsafeReturn, ...] = ()
    assumed: tuple[str, ...] = ()  # names of the parameters that are taken as the autopilot's defaults

    @property
    def sentences(self) -> tuple[str, ...]:
        """Unsafe returns, from where to where, as text; without landings in place, which no plan can make safe."""
        return tuple(map(_sentence, (one for one in self.unsafe if one.destination != IN_PLACE)))

    @property
    def needed_height_m(self) -> float:
        """The return height to set: what was checked, or more where that makes returns over the terrain safe."""
        low = any(one.danger in ("terrain", "obstacle") and one.destination != IN_PLACE for one in self.unsafe)
        if not low or not math.isfinite(self.safe_return_height_m):
            return self.return_height_m
        return max(self.return_height_m, math.ceil(self.safe_return_height_m))

    @property
    def remedy(self) -> str:
        """Remedy for unsafe returns, as text."""
        if self.needed_height_m > self.return_height_m:
            return (
                f"set the autopilot's return height to at least {self.needed_height_m:.0f} m (vehicle.return_height_m), or let "
                "plan --rally auto propose rally points"
            )
        if not math.isfinite(self.safe_return_height_m):
            return "no return height is safe, because some ground below it is unknown; use a larger elevation file"
        return "no height makes these returns safe; try plan --rally auto, or use Ctrl-C, which plans a detour"


def _sentence(one: UnsafeReturn) -> str:
    east, north, _ = one.position_m
    why = ", ".join(str(response) for response in one.responses)
    return (
        f"from waypoint {one.first_leg} ({one.begin_s:.0f} s) to waypoint {one.last_leg} ({one.end_s:.0f} s): {one.what}, "
        f"at {east:.0f} m east, {north:.0f} m north ({why})"
    )


def settings_of(
    site: Site, autopilot: AutopilotName, parameters: Mapping[str, float] | None = None
) -> FailsafeSettings:
    """The vehicle's parameters, and what the scenario says of it where they are unknown."""
    vehicle = site.scenario.vehicle
    known = {
        "return_height_m": vehicle.return_height_m,
        "cruise_m_s": vehicle.cruise_speed_m_s,
        "climb_m_s": vehicle.max_climb_m_s,
        "descent_m_s": vehicle.max_descent_m_s,
    }
    return failsafe_settings(autopilot, parameters or {}, known=known)


def flight_states(site: Site, path_m: FloatArray, *, begin_s: float = 0.0) -> FlightStates:
    """The moments of a (k, 3) ENU path, a second or ``_STEP_M`` apart, whichever is less."""
    vehicle = site.scenario.vehicle
    steps = np.diff(path_m, axis=0)
    level = np.hypot(steps[:, 0], steps[:, 1]) / vehicle.cruise_speed_m_s
    upright = np.where(steps[:, 2] > 0.0, steps[:, 2] / vehicle.max_climb_m_s, -steps[:, 2] / vehicle.max_descent_m_s)
    times_s = begin_s + np.concatenate([[0.0], np.cumsum(np.maximum(level, upright))])
    line = np.column_stack([path_m[:, :2], site.alts_amsl_m(path_m)])
    return states_along(line, times_s, step_m=min(_STEP_M, site.ground.surface.step_m), step_s=1.0)


def return_limits(site: Site) -> ReturnLimits:
    """Limits by which the returns of a site are judged."""
    limits = site.scenario.limits
    return ReturnLimits(
        frame=site.frame, heights=site.ground, ground=site.ground, zones=site.flown_zones, obstacles=site.scenario.obstacles,
        prisms=site.prisms, fence=site.fence, clearance_m=limits.transit_clearance_m,
        endurance_s=site.scenario.vehicle.hover_s,
    )  # fmt: skip


def destinations(site: Site, path_m: FloatArray, rally_m: FloatArray, autopilot: AutopilotName) -> Destinations:
    """Home and rally points (r, 3) ENU of a site, for a (k, 3) ENU path that ends above home."""
    home = np.zeros(3) if site.home_m is None else site.home_m

    def alts(points: FloatArray) -> FloatArray:
        return np.column_stack([points[:, :2], site.alts_amsl_m(points)]) if len(points) else points.reshape(0, 3)

    # Compiled missions end with a landing: PX4 knows it as one, ArduPilot only behind a DO_LAND_START.
    landing = len(path_m) - 1 if autopilot == "px4" else None
    return Destinations(alts(home[None])[0], alts(rally_m), alts(path_m), site.fence, landing)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class OwnReturns:
    """The returns of a compiled flight, to be judged by any parameters: the vehicle's, and again when they change."""

    site: Site  # the scenario on its ground
    path_m: FloatArray  # (k, 3) ENU, the whole flight between the columns above home
    first_waypoint: int  # row of the first planned waypoint in it
    waypoint_count: int  # how many planned waypoints follow
    autopilot: AutopilotName  # who returns
    rally: tuple[FramedPoint, ...] = ()  # rally points that the vehicle holds
    begin_s: float = 0.0  # when the path begins

    def advice(
        self,
        parameters: Mapping[str, float],  # names and values as the vehicle has them
        *,
        rally: Sequence[FramedPoint] | None = None,  # the rally points that it holds now; None: as uploaded
        home: GeoPoint | None = None,  # where its home is now; None: as planned
    ) -> ReturnAdvice:
        """Judge everything that the autopilot does by itself along the path, by a vehicle's parameters."""
        site, frame = self.site, self.site.frame
        if home is not None and frame is not None:
            moved = frame.enu_from_geodetic(home.lat_deg, home.lon_deg, home.alt_amsl_m)[0]
            site = replace(site, home_m=moved)
        states = flight_states(site, self.path_m, begin_s=self.begin_s)
        rally_m = rally_positions_m(site, self.rally if rally is None else rally)
        to = destinations(site, self.path_m, rally_m, self.autopilot)
        judged = judge_returns(settings_of(site, self.autopilot, parameters), states, to, return_limits(site))

        def number(leg: int) -> int:
            return min(max(leg - self.first_waypoint, 0), self.waypoint_count - 1)

        away = [one for one in judged.unsafe if one.destination != IN_PLACE]
        unsafe_waypoints = set[int]()
        for one in away:
            if one.danger != "zone":
                inside = (states.times_s >= one.begin_s) & (states.times_s <= one.end_s)
                unsafe_waypoints |= {number(int(leg)) for leg in np.unique(states.legs[inside])}
        return ReturnAdvice(
            return_height_m=judged.settings["return_height_m"],
            unsafe_waypoints=tuple(sorted(unsafe_waypoints)),
            safe_return_height_m=judged.safe_return_height_m,
            no_fly=tuple(sorted({one.name for one in away if one.danger == "zone"})),
            unsafe=tuple(
                replace(one, first_leg=number(one.first_leg), last_leg=number(one.last_leg)) for one in judged.unsafe
            ),
            assumed=judged.settings.assumed,
        )


def rally_positions_m(site: Site, rally: Sequence[FramedPoint]) -> FloatArray:
    """(r, 3) ENU of rally points as the autopilot takes them; NaN without a position on Earth."""
    if site.frame is None or not rally:
        return np.full((len(rally), 3), np.nan)
    home_alt = 0.0 if site.home_m is None else float(site.alts_amsl_m(site.home_m[None])[0])
    positions = []
    for point in rally:
        ground = site.ground_alt_amsl_m(point.lat_deg, point.lon_deg)
        base = {Frame.AMSL: 0.0, Frame.ABOVE_TERRAIN: math.nan if ground is None else ground}.get(point.frame, home_alt)
        positions.append((point.lat_deg, point.lon_deg, base + point.alt_m))
    lat, lon, alt = np.array(positions).T
    return np.asarray(site.frame.enu_from_geodetic(lat, lon, alt), float)


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
    """The returns of a flight with rally points, judged: home at the return height to set, and proposed ones if requested."""
    site = returns.site
    proposed = _above_home(site, _proposed(site, returns.path_m, returns.autopilot))
    returns = replace(returns, rally=proposed)
    advice = returns.advice({})
    if site.home_m is None or not math.isfinite(advice.safe_return_height_m):
        return returns, advice
    (home,) = _above_home(site, site.home_m[None])
    return replace(returns, rally=(replace(home, alt_m=advice.needed_height_m), *proposed)), advice


def _proposed(site: Site, path_m: FloatArray, autopilot: AutopilotName) -> FloatArray:
    """(r, 3) ENU rally points beside home; sorties are compiled several times, and searched for once."""
    given = site.scenario.planner.rally
    if not isinstance(given, str):
        positions = rally_en(site.scenario, site.frame)
        return np.array([next(_with_heights(site, p, autopilot)) for p in positions], float).reshape(-1, 3)
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


def _above_home(site: Site, positions_m: FloatArray) -> tuple[FramedPoint, ...]:
    """(r, 3) ENU places above home."""
    if site.frame is None or site.home_m is None or not len(positions_m):
        return ()
    lat, lon, alt = site.frame.geodetic_from_enu(positions_m)
    above = alt - site.alts_amsl_m(site.home_m[None])[0]
    return tuple(
        FramedPoint(float(a), float(o), round(float(up), 3), Frame.ABOVE_HOME)
        for a, o, up in zip(lat, lon, above, strict=True)
    )


def propose_rally(site: Site, path_m: FloatArray, *, autopilot: AutopilotName) -> FloatArray:
    """(r, 3) ENU rally points for a (k, 3) ENU path.

    Empty if returns home are safe, or no point makes them safer.

    Greedy: always choose the point that leaves the fewest moments with an unsafe return, by the autopilot's own selection.
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
        states.positions_m[keep], states.velocities_m_s[keep], states.times_s[keep], states.legs[keep], ahead
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
    begins = states.positions_m[bad, :2]
    angles = np.arange(_DIRECTIONS) * (math.tau / _DIRECTIONS)
    around = [np.zeros(2)]
    around += [radius * np.array([math.cos(a), math.sin(a)]) for radius in _RINGS_M[1:] for a in angles]
    positions = (begins[:, None, :] + np.array(around)[None]).reshape(-1, 2)
    _, first = np.unique(np.round(positions / _APART_M), axis=0, return_index=True)
    positions = positions[np.sort(first)]
    positions = positions[_may_land(site, positions)]
    if len(positions):
        positions = positions[np.unique(np.linspace(0, len(positions) - 1, _MOST_CANDIDATES).astype(np.int64))]
    found = [row for position in positions for row in _with_heights(site, position, autopilot)]
    return np.array(found, float).reshape(-1, 3)


def _with_heights(site: Site, position: FloatArray, autopilot: AutopilotName) -> Iterator[tuple[float, float, float]]:
    """A landing place as the autopilot's rally points: PX4 lands at their height, ArduPilot returns at it or higher."""
    east, north = position
    ground = float(site.ground.heights_m(position[None])[0])
    if autopilot == "px4":
        yield (east, north, ground)
        return
    clearance = site.scenario.limits.transit_clearance_m + site.scenario.limits.height_margin_m + _SLACK_M
    home_up = 0.0 if site.home_m is None else float(site.home_m[2])
    for more in _MORE_HEIGHTS_M:
        above_home = math.ceil(ground + clearance + more - home_up)  # whole metres are stored
        if more == 0.0 or clearance + more <= site.scenario.transit_ceiling_agl_m:
            yield (east, north, home_up + above_home)


def _may_land(site: Site, positions: FloatArray) -> BoolArray:
    """(n,) level enough ground inside the fence, away from home, zones and obstacles."""
    ground = site.ground
    good = np.isfinite(ground.heights_m(positions))
    for offset in ((0.0, 0.0), (_FOOT_M, 0.0), (-_FOOT_M, 0.0), (0.0, _FOOT_M), (0.0, -_FOOT_M)):
        slope = np.hypot(*ground.gradients(positions + np.array(offset)).T)
        good &= np.isfinite(slope) & (slope <= _STEEPEST)
    points = shapely.points(positions)
    good &= shapely.covers(site.fence.buffer(-_FROM_FENCE_M), points)
    if site.home_m is not None:
        good &= np.hypot(*(positions - site.home_m[:2]).T) >= _FROM_HOME_M
    for zone in site.zones:
        good &= ~shapely.intersects(zone.grown(zone.entry.margin_m), points)
    beside = site.scenario.obstacles.clearance_beside_m
    for prism in site.prisms:
        good &= shapely.distance(prism.footprint.polygon, points) >= beside
    return np.asarray(good)

"""Failsafes of an autopilot, the destinations of a vehicle, and the paths of its returns, as data.

Rules and names of parameters are in ``data/failsafes.toml``. Positions are (east, north, height above sea level), because
autopilots keep a level above the sea.
"""

import math
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources
from types import MappingProxyType
from typing import Any, Literal, get_args

import numpy as np
import shapely

from uavcover.errors import UavcoverError
from uavcover.kernels.arrays import BoolArray, FloatArray, IntArray
from uavcover.model.vehicle import AutopilotName

Action = Literal[
    "none", "hold", "land", "return", "retrace", "retrace-land", "mission-landing", "hold-land", "terminate"
]
"""``retrace``: back along the flown path, else return (or land); ``mission-landing``: to the mission's landing, else return."""

_SETTING_KEYS, _RULE_KEYS = {"names", "default"}, {"trigger", "parameter", "default", "other", "actions"}
_RULE_OPTIONS = {"continues", "enabled_by"}
_TABLE = "data/failsafes.toml"


@dataclass(frozen=True, slots=True)
class Response:
    """Failsafe response of a vehicle."""

    action: Action  # what it does
    # the reason, as text; "commanded" for a return that the pilot or the ground station requests
    trigger: str
    parameter: str = ""  # that decides it; empty where it is commanded
    value: int = 0  # of that parameter
    is_assumed: bool = False  # whether the value is the autopilot's default, because the vehicle's is unknown

    def __str__(self) -> str:
        if not self.parameter:
            return self.trigger
        return f"{self.trigger} ({self.parameter} {self.value}{', its default' if self.is_assumed else ''})"


@dataclass(frozen=True, slots=True)
class FailsafeSettings:
    """The parameters of one vehicle, by their meaning."""

    autopilot: AutopilotName  # whose parameters they are
    values: Mapping[str, float]  # by the names of ``settings`` in ``data/failsafes.toml``, in metres, seconds and m/s
    # what it does by itself or when commanded; responses that change nothing are omitted
    responses: tuple[Response, ...]
    assumed: tuple[str, ...]  # names of the parameters whose defaults stand in for unknown values

    def __getitem__(self, name: str) -> float:
        """A value by the name of its setting."""
        return self.values[name]


def failsafe_settings(
    autopilot: AutopilotName, parameters: Mapping[str, float], *, known: Mapping[str, float] | None = None
) -> FailsafeSettings:
    """List the failsafe responses of a vehicle.

    Args:
        autopilot: whose parameters they are.
        parameters: names and values as the vehicle has them; may be empty or incomplete.
        known: values of settings that stand in for missing parameters instead of the autopilot's defaults, such as the speeds
            and the return height of a scenario.
    """
    table = _tables()[autopilot]
    values: dict[str, float] = {}
    assumed: list[str] = []
    for name, row in table["settings"].items():
        found = [parameters[one] * scale for one, scale in row["names"].items() if one in parameters]
        if found and math.isfinite(found[-1]):
            values[name] = float(found[-1])
        elif known is not None and name in known:
            values[name] = float(known[name])
        else:
            values[name] = float(row["default"])
            assumed.append(next(iter(row["names"])))
    responses = [Response("return", "commanded")]
    for rule in table["failsafes"]:
        name = rule["parameter"]
        if name not in parameters and name not in assumed:
            assumed.append(name)
        value = round(parameters.get(name, rule["default"]))
        action: Action = rule["actions"].get(str(value), rule["other"])
        needed = rule.get("enabled_by")
        parameter, mask = rule.get("continues", ("", 0))
        goes_on = bool(round(parameters.get(parameter, 0.0)) & mask)
        if action != "none" and not goes_on and not (needed and not parameters.get(needed, 0.0)):
            responses.append(Response(action, rule["trigger"], name, value, name not in parameters))
    return FailsafeSettings(autopilot, MappingProxyType(values), tuple(responses), tuple(assumed))


def failsafe_parameter_groups(autopilot: AutopilotName) -> list[list[str]]:
    """The parameters to request from a vehicle, which has at most one of each group."""
    table = _tables()[autopilot]
    groups = [list(row["names"]) for row in table["settings"].values()]
    singles = {rule["parameter"] for rule in table["failsafes"]}
    singles |= {rule["continues"][0] for rule in table["failsafes"] if "continues" in rule}
    return groups + [[name] for name in sorted(singles)]


@cache
def _tables() -> Mapping[str, Any]:
    text = (resources.files("uavcover") / _TABLE).read_text(encoding="utf-8")
    tables: Mapping[str, Any] = tomllib.loads(text)
    for autopilot, table in tables.items():
        _check(autopilot, table)
    return tables


def _check(autopilot: str, table: Mapping[str, Any]) -> None:
    """Refuse a table with missing or unknown keys."""
    for name, row in table["settings"].items():
        if set(row) != _SETTING_KEYS or not row["names"] or not all(scale > 0.0 for scale in row["names"].values()):
            raise UavcoverError(f"{_TABLE}: {autopilot}.settings.{name}: set names, factors above 0 and a default")
    for rule in table["failsafes"]:
        where = f"{_TABLE}: {autopilot} failsafe {rule.get('parameter', '?')}"
        if not (_RULE_KEYS <= set(rule) <= _RULE_KEYS | _RULE_OPTIONS):
            raise UavcoverError(f"{where}: the keys are {', '.join(sorted(_RULE_KEYS | _RULE_OPTIONS))}")
        unknown = {rule["other"], *rule["actions"].values()} - set(get_args(Action))
        if unknown:
            raise UavcoverError(f"{where}: {sorted(unknown)[0]!r} is not an action; use {', '.join(get_args(Action))}")


Stage = Literal["stop", "climb", "return", "descend", "land", "mission"]
"""``descend`` is a descent that does not expect the ground; ``land`` one that does; ``mission`` joins legs of the mission."""

HOME, IN_PLACE = -1, -2
"""Destinations that are no rally points."""

CEILING_BIT = 1
_CIRCLE_BIT, _POLYGON_BIT, _FLOOR_BIT = 2, 4, 8
_NEARER_BY_M, _TOO_NEAR_HOME_M = 2.0, 10.0  # PX4: MIN_DIST_THRESHOLD, and a safe point this near is home


@dataclass(frozen=True, slots=True, eq=False)
class FlightStates:
    """n moments of a flight."""

    positions_m: FloatArray  # (n, 3) east, north, height above sea level
    velocities_m_s: FloatArray  # (n, 2) east, north
    times_s: FloatArray  # (n,) since take-off
    legs: IntArray  # (n,) vertex of the route that the vehicle flies to
    ahead_m: FloatArray | None = None  # (n,) way to that vertex, before which the vehicle slows down; None: it flies on


@dataclass(frozen=True, slots=True, eq=False)
class Destinations:
    """Destinations of a vehicle, in positions as in :class:`FlightStates`."""

    home_m: FloatArray  # (3,) on the ground
    rally_m: FloatArray  # (r, 3)
    route_m: FloatArray  # (m, 3) vertices of the flown mission, take-off's top to landing's top
    # area that the vehicle's fence allows, by its polygons; None without polygons
    fence: shapely.Geometry | None = None
    landing: int | None = None  # vertex of the route where the mission's landing begins; None without one

    @property
    def items_m(self) -> FloatArray:
        """(m, 3) vertices of the mission, and its landing at home's height where it has one."""
        if self.landing is None:
            return self.route_m
        return np.vstack([self.route_m, [*self.route_m[-1, :2], self.home_m[2]]])


@dataclass(frozen=True, slots=True, eq=False)
class FailsafePaths:
    """Paths that the vehicle flies from each of n moments, for one kind of response."""

    responses: tuple[Response, ...]  # that lead to these paths
    points_m: FloatArray  # (n, k, 3) vertices; legs without length where a stage is omitted
    stages: tuple[Stage, ...]  # k - 1 of them
    destinations: IntArray  # (n,) number of a rally point, ``HOME`` or ``IN_PLACE``
    duration_s: FloatArray  # (n,) until it lands or holds
    tail_m: FloatArray | None = None  # (m, 3) legs of the mission that follow; None without them
    joins: IntArray | None = None  # (n,) first vertex of the tail that is flown to
    note: str = ""  # what else the paths depend on, as text

    def path_m(self, moment: int) -> FloatArray:
        """(j, 3) the whole path from one moment, without legs that have no length."""
        points = self.points_m[moment]
        if self.tail_m is not None and self.joins is not None:
            points = np.vstack([points, self.tail_m[self.joins[moment] :]])
        moved = np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-6
        return np.asarray(points[np.concatenate([[True], moved])], float)


def states_along(line_m: FloatArray, times_s: FloatArray, *, step_m: float, step_s: float) -> FlightStates:
    """Moments along a (k, 3) line that is flown at (k,) times, both ends of every leg among them.

    Args:
        line_m: east, north, height above sea level.
        times_s: when each vertex is passed.
        step_m: largest distance between two moments.
        step_s: largest time between them.
    """
    steps, spans = np.diff(line_m, axis=0), np.diff(times_s)
    lengths = np.linalg.norm(steps, axis=1)
    counts = np.maximum(1, np.ceil(np.maximum(lengths / step_m, spans / step_s))).astype(np.int64)
    leg = np.repeat(np.arange(len(steps)), counts + 1)
    first = np.cumsum(counts + 1) - (counts + 1)
    t = (np.arange(len(leg)) - first[leg]) / counts[leg]
    velocities = steps[leg, :2] / np.maximum(spans[leg], 1e-9)[:, None]
    level = np.hypot(steps[leg, 0], steps[leg, 1])
    return FlightStates(
        line_m[leg] + t[:, None] * steps[leg], velocities, times_s[leg] + t * spans[leg], leg + 1, (1.0 - t) * level
    )


def ardupilot_destination(get: FailsafeSettings, to: Destinations, begin_m: FloatArray) -> tuple[IntArray, FloatArray]:
    """Number (n,) and position (n, 3) of the nearest rally point, or home, as ArduCopter selects it from (n, 3) positions."""
    home, number = to.home_m, np.full(len(begin_m), HOME)
    position = np.tile(home, (len(begin_m), 1))
    valid = np.flatnonzero(_is_rally_valid(get, to))
    if not len(valid):
        return number, position
    away = np.stack([_away_m(begin_m, rally) for rally in to.rally_m[valid]], axis=1)
    nearest, distance = away.argmin(axis=1), away.min(axis=1)
    limit = get["rally_limit_m"]
    taken = (distance <= limit) if limit > 0.0 else np.ones(len(begin_m), dtype=bool)
    if round(get["rally_with_home"]):
        taken &= distance < _away_m(begin_m, home)
    number[taken], position[taken] = valid[nearest[taken]], to.rally_m[valid[nearest[taken]]]
    return number, position


def _is_rally_valid(get: FailsafeSettings, to: Destinations) -> BoolArray:
    """(r,) inside every fence that is enabled: ArduCopter leaves out the others."""
    rally, home = to.rally_m, to.home_m
    valid = np.asarray(np.isfinite(rally).all(axis=1))
    if not round(get["fence_enabled"]):
        return valid
    kinds, above_home = round(get["fence_kinds"]), rally[:, 2] - home[2]
    if kinds & CEILING_BIT:
        valid &= above_home <= get["fence_top_m"]
    if kinds & _FLOOR_BIT:
        valid &= above_home >= get["fence_floor_m"]
    if kinds & _CIRCLE_BIT:
        valid &= _away_m(rally, home) <= get["fence_radius_m"]
    if kinds & _POLYGON_BIT and to.fence is not None:
        valid &= shapely.covers(to.fence, shapely.points(rally[:, :2]))
    return np.asarray(valid)


def px4_destination(
    get: FailsafeSettings, to: Destinations, begin_m: FloatArray
) -> tuple[IntArray, FloatArray, BoolArray]:
    """Nearest of home, mission landing and safe points, as PX4 selects it from (n, 3) positions by RTL_TYPE 0, 1 and 3.

    A landing pattern before the landing is left to the caller.

    Returns:
        Number (n,), place (n, 3), and whether it is the mission's landing (n,); its number is that of home.
    """
    home, count = to.home_m, len(begin_m)
    number, position, at_landing = np.full(count, HOME), np.tile(home, (count, 1)), np.zeros(count, dtype=bool)
    kind = round(get["return_type"])
    least = np.full(count, np.inf) if kind == 1 else _away_m(begin_m, home)
    if kind in (1, 3) and to.landing == len(to.route_m) - 1:
        landing = to.items_m[-1]
        away = _away_m(begin_m, landing)
        at_landing = away + _NEARER_BY_M < least
        least, position[at_landing] = np.where(at_landing, away, least), landing
    for k, rally in enumerate(to.rally_m):
        if not np.isfinite(rally).all() or math.dist(rally[:2], home[:2]) <= _TOO_NEAR_HOME_M:
            continue
        away = _away_m(begin_m, rally)
        nearer = away + _NEARER_BY_M < least
        least, number = np.where(nearer, away, least), np.where(nearer, k, number)
        position[nearer], at_landing = rally, at_landing & ~nearer
    return number, position, at_landing


def _away_m(positions_m: FloatArray, other_m: FloatArray) -> FloatArray:
    """(n,) horizontal."""
    return np.asarray(np.hypot(positions_m[:, 0] - other_m[0], positions_m[:, 1] - other_m[1]), float)


# Intervals of legs from which a return is unsafe, with the reason, as data.

Danger = Literal["terrain", "descent", "unknown ground", "obstacle", "fence", "zone", "battery"]


@dataclass(frozen=True, slots=True, kw_only=True)
class UnsafeReturn:
    """Consecutive moments from which one response is unsafe in one respect."""

    responses: tuple[Response, ...]  # that lead there
    danger: Danger  # in which respect
    begin_s: float  # first moment, since take-off
    end_s: float  # last moment
    first_leg: int  # vertex of the route that the vehicle flies to at the first moment
    last_leg: int  # at the last one
    # worst value: least height above ground; metres of missing clearance, outside the fence or inside the zone; seconds
    # of flight
    value: float
    limit: float  # the allowed value
    position_m: tuple[float, float, float]  # (east, north, up) where it is worst
    worst_s: float  # the moment whose path is worst
    destination: int  # number of the rally point there, ``HOME`` or ``IN_PLACE``
    name: str = ""  # of the obstacle or zone
    note: str = ""  # what the path depends on

    @property
    def what(self) -> str:
        """The problem as text, without the moments and the position."""
        to = {HOME: "home", IN_PLACE: "down at the current position"}.get(
            self.destination, f"to rally point {self.destination + 1}"
        )
        path = f"the path {to}{f', {self.note},' if self.note else ''}"
        match self.danger:
            case "terrain" if self.value < 0.0:
                return f"{path} goes {-self.value:.1f} m below the ground"
            case "terrain":
                return f"{path} is {self.value:.1f} m above ground; at least {self.limit:.1f} m is required"
            case "descent" if self.value < 0.0:
                return f"{path} descends {-self.value:.1f} m below the ground at flying speed"
            case "descent":
                return f"{path} comes within {self.value:.1f} m of the ground at flying speed"
            case "unknown ground":
                return f"{path} leads over unknown ground"
            case "obstacle":
                return f"{path} comes {self.value:.1f} m too close to obstacle {self.name!r}"
            case "fence":
                return f"{path} leads {self.value:.1f} m outside the fence"
            case "zone":
                return f"{path} leads {self.value:.1f} m into no-fly zone {self.name!r}"
            case "battery":
                return f"{path} ends after {self.value:.0f} s, but the battery lasts only {self.limit:.0f} s"


def joined_returns(unsafe: Iterable[UnsafeReturn]) -> list[UnsafeReturn]:
    """Join intervals of different responses with the same path from the same legs; keep the worst figures."""
    found: dict[tuple[object, ...], UnsafeReturn] = {}
    for one in unsafe:
        key = (one.danger, one.destination, one.name, one.note, one.first_leg, one.last_leg)
        other = found.get(key)
        if other is None:
            found[key] = one
            continue
        worse = one if abs(one.value - one.limit) > abs(other.value - other.limit) else other
        found[key] = replace(
            worse, responses=(*other.responses, *one.responses), begin_s=min(one.begin_s, other.begin_s),
            end_s=max(one.end_s, other.end_s),
        )  # fmt: skip
    return list(found.values())

"""Check the autopilot's own paths like legs, and report the intervals in which they are unsafe."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import shapely

from uavcover.kernels.arrays import BoolArray, FloatArray, IntArray
from uavcover.kernels.obstacle_breach import tops_near_m
from uavcover.missions.failsafe_path import predict
from uavcover.missions.failsafes import (
    HOME,
    Danger,
    Destinations,
    FailsafePaths,
    FailsafeSettings,
    FlightStates,
    Stage,
    UnsafeReturn,
    joined_returns,
)
from uavcover.model.limits import Obstacles
from uavcover.scenario.airspace.zones import ZoneCheck
from uavcover.scenario.obstacles import Prism, leg_breaches
from uavcover.scenario.site import prepared
from uavcover.terrain.frames import LocalFrame
from uavcover.terrain.ground import Ground

CONTACT_M = 1.0
"""Least height above ground where the vehicle stops, climbs, or waits above its destination."""
_NEAR_DESTINATION_M = 30.0
"""A return no longer than this belongs to the landing."""
_PIECE_M = 1000.0
"""A level line of this length deviates by 2 cm from the straight one in space."""
_HEIGHT_TOLERANCE_M = 0.05
_EARTH_RADIUS_M = 6.371e6
_FENCE_TOLERANCE_M = 0.1


class HeightSource(Protocol):
    """Heights along legs, as of :meth:`Ground.leg_height_ranges_m`."""

    def leg_height_ranges_m(self, line_m: FloatArray, /) -> FloatArray:
        """(n - 1, 4) least height above ground, its parameter, largest height, its parameter."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ReturnLimits:
    """Limits for the paths."""

    frame: LocalFrame | None  # of the positions; None where up is the height above sea level
    heights: HeightSource  # above what the paths keep their clearance
    ground: Ground  # with its obstacles, and where the vehicle lands
    zones: ZoneCheck  # no-fly zones
    obstacles: Obstacles  # clearances
    prisms: tuple[Prism, ...]  # the obstacles, by number
    fence: shapely.Geometry | None  # allowed area; None without a fence
    clearance_m: float  # least height above ground of a return
    endurance_s: float | None = None  # longest flight; None: unknown

    def ground_alts_m(self, east_north_m: FloatArray) -> FloatArray:
        """Heights of the ground above sea level (n,) at (n, 2) positions."""
        return np.asarray(self.ground.heights_m(east_north_m) + self._level_alts_m(east_north_m), float)

    def enu_m(self, positions_m: FloatArray) -> FloatArray:
        """(n, 3) ENU of positions with heights above sea level; NaN stays NaN."""
        return np.column_stack([positions_m[:, :2], positions_m[:, 2] - self._level_alts_m(positions_m)])

    def _level_alts_m(self, positions_m: FloatArray) -> FloatArray:
        """Heights above sea level (n,) of the level plane through the origin: the Earth falls away below it.

        A sphere of the mean radius: off by 1 cm at 5 km, by 15 cm at 20 km.
        """
        if self.frame is None:
            return np.zeros(len(positions_m))
        fall = (positions_m[:, 0] ** 2 + positions_m[:, 1] ** 2) / (2.0 * _EARTH_RADIUS_M)
        return np.asarray(self.frame.alt_amsl_m + fall, float)


@dataclass(frozen=True, slots=True, eq=False)
class ReturnJudgement:
    """Safety of the returns from every moment."""

    unsafe: tuple[UnsafeReturn, ...]  # worst first within each response
    is_unsafe: BoolArray  # (n,) moments with any danger
    # above the destination for PX4, above home for ArduPilot: the lowest return height that clears the terrain from
    # everywhere; infinite where ground is unknown
    safe_return_height_m: float
    settings: FailsafeSettings  # by which it was judged


def judge_returns(
    settings: FailsafeSettings, states: FlightStates, to: Destinations, limits: ReturnLimits
) -> ReturnJudgement:
    """Judge everything that a multirotor may do by itself from every moment of a flight."""
    return judge_paths(predict(settings, states, to, limits.ground_alts_m), settings, states, to, limits)


def judge_paths(
    predicted: Sequence[FailsafePaths],
    settings: FailsafeSettings,
    states: FlightStates,
    to: Destinations,
    limits: ReturnLimits,
) -> ReturnJudgement:
    """Judge predicted paths from every moment of a flight."""
    unsafe: list[UnsafeReturn] = []
    bad = np.zeros(len(states.times_s), dtype=bool)
    safe_m = 0.0
    for paths in predicted:
        judged = _Judged(paths, states, limits)
        unsafe += judged.intervals()
        bad |= judged.is_unsafe
        if "return" in paths.stages:
            reference = to.home_m[2]
            if settings.autopilot == "px4" and len(to.rally_m):
                chosen = np.vstack([to.rally_m, to.home_m])[paths.destinations]
                reference = chosen[:, 2]
            safe_m = max(safe_m, judged.safe_return_height_m(reference))
    return ReturnJudgement(tuple(joined_returns(unsafe)), bad, safe_m, settings)


class _Judged:
    """The dangers of the paths of one response; for each, (n,) whether it exists, its size and its position."""

    def __init__(self, paths: FailsafePaths, states: FlightStates, limits: ReturnLimits) -> None:
        self._paths, self._states, self._limits = paths, states, limits
        points, self._stages = _cut(paths.points_m, paths.stages)
        if paths.tail_m is not None and paths.joins is not None and self._stages[-1] != "mission":
            points = np.concatenate([points, paths.tail_m[paths.joins][:, None]], axis=1)
            self._stages = (*self._stages, "mission")
        self._n, self._k = points.shape[:2]
        gaps = np.full((self._n, 1, 3), np.nan)
        flat = np.concatenate([points, gaps], axis=1).reshape(-1, 3)
        self._alts = points[:, :, 2]
        self._line = limits.enu_m(flat)
        self._ranges = limits.heights.leg_height_ranges_m(self._line)
        self._found: list[tuple[Danger, BoolArray, FloatArray, FloatArray, FloatArray, str]] = []
        self._terrain()
        self._obstacles()
        self._fence()
        self._zones()
        self._battery()

    @property
    def is_unsafe(self) -> BoolArray:
        """(n,) whether any danger was found."""
        return np.asarray(np.logical_or.reduce([found[1] for found in self._found]))

    def intervals(self) -> Iterator[UnsafeReturn]:
        """One for each danger and each run of moments, the worst of each."""
        states, paths = self._states, self._paths
        for danger, bad, badness, values, positions, name in self._found:
            numbers = np.flatnonzero(bad)
            # fewer moments do not separate two intervals, because at a waypoint the vehicle stops elsewhere
            for run in np.split(numbers, np.flatnonzero(np.diff(numbers) > 3) + 1):
                if not len(run):
                    continue
                k = int(run[np.argmax(badness[run])])
                east, north, up = positions[k]
                yield UnsafeReturn(
                    responses=paths.responses, danger=danger, begin_s=float(states.times_s[run[0]]),
                    end_s=float(states.times_s[run[-1]]), first_leg=int(states.legs[run[0]]), last_leg=int(states.legs[run[-1]]),
                    value=float(values[k]), limit=self._limit_of(danger), position_m=(float(east), float(north), float(up)),
                    worst_s=float(states.times_s[k]), destination=int(paths.destinations[k]), name=name, note=paths.note,
                )  # fmt: skip

    def safe_return_height_m(self, reference_amsl_m: FloatArray | float) -> float:
        """The return height above a reference that clears the ground and the obstacles below all returns."""
        legs = [k for k, stage in enumerate(self._stages) if stage == "return"]
        low = np.minimum(self._lows()[:, legs], self._over_tops_m(legs) + self._limits.clearance_m)
        if np.isnan(low).any():
            return math.inf
        alts = np.maximum(self._alts[:, :-1], self._alts[:, 1:])[:, legs]
        needed = (alts - low).max(axis=1) + self._limits.clearance_m - reference_amsl_m
        far = self._level_m()[:, legs].sum(axis=1) > _NEAR_DESTINATION_M
        return float(np.max(needed[far], initial=0.0))

    def _over_tops_m(self, legs: list[int]) -> FloatArray:
        """(n, legs) height over the obstacles near some legs, beyond the clearance above them; infinite without any."""
        if not self._limits.prisms:
            return np.full((self._n, len(legs)), np.inf)
        pairs, _ = self._pairs(legs)
        lines = np.ascontiguousarray(np.concatenate([pairs[:, 0, :2], pairs[:, 1, :2]], axis=1))
        wanted = self._limits.obstacles
        tops = tops_near_m(self._limits.ground.surface.obstacles, lines, wanted.clearance_beside_m)
        over = pairs[:, :, 2].min(axis=1) - tops - wanted.clearance_above_m
        return np.asarray(over.reshape(self._n, len(legs)), float)

    def _limit_of(self, danger: Danger) -> float:
        limits = {"terrain": self._limits.clearance_m, "descent": CONTACT_M, "battery": self._limits.endurance_s or 0.0}
        return limits.get(danger, 0.0)

    def _lows(self) -> FloatArray:
        """(n, k - 1) least heights above ground of the legs."""
        rows = np.vstack([self._ranges, np.full((1, 4), np.nan)])
        return np.asarray(rows[:, 0].reshape(self._n, self._k + 1)[:, : self._k - 1])

    def _level_m(self) -> FloatArray:
        points = self._line.reshape(self._n, self._k + 1, 3)[:, : self._k, :2]
        return np.asarray(np.hypot(*np.moveaxis(np.diff(points, axis=1), 2, 0)))

    def _worst_position(self, leg: IntArray) -> FloatArray:
        """(n, 3) the lowest place of one leg of each path."""
        row = np.arange(self._n) * (self._k + 1) + leg
        t = self._ranges[row, 1][:, None]
        a, b = self._line[row], self._line[row + 1]
        return np.asarray(np.where(np.isfinite(t), a + t * (b - a), 0.5 * (a + b)), float)

    def _terrain(self) -> None:
        low, level = self._lows(), self._level_m()
        flies = [k for k, stage in enumerate(self._stages) if stage in ("return", "mission")]
        slow = [k for k, stage in enumerate(self._stages) if stage in ("stop", "climb", "descend")]
        everything: list[tuple[Danger, list[int], float]] = [
            ("terrain", flies, self._limits.clearance_m),
            ("descent", slow, CONTACT_M),
        ]
        for danger, legs, limit in everything:
            if not legs:
                continue
            heights = low[:, legs]
            unknown = ~np.isfinite(heights)
            worst = np.where(unknown, np.inf, heights).argmin(axis=1)
            least = np.where(unknown, np.inf, heights).min(axis=1)
            wanted = np.full(self._n, limit)
            if danger == "terrain":
                near = level[:, legs].sum(axis=1) <= _NEAR_DESTINATION_M
                wanted[near] = CONTACT_M
            tolerance = _HEIGHT_TOLERANCE_M + self._limits.ground.cut_error_m
            positions = self._worst_position(np.array(legs)[worst])
            self._found.append((danger, least < wanted - tolerance, wanted - least, least, positions, ""))
            # Where the vehicle itself is over unknown ground, its route is reported.
            nowhere = np.asarray(unknown.any(axis=1) & np.isfinite(low[:, 0]))
            first = np.array(legs)[unknown.argmax(axis=1)]
            self._found.append(
                ("unknown ground", nowhere, np.ones(self._n), np.zeros(self._n), self._worst_position(first), "")
            )

    def _pairs(self, legs: Sequence[int]) -> tuple[FloatArray, IntArray]:
        """(m, 2, 3) chosen legs of all paths, and the paths (m,) that they belong to."""
        points = self._line.reshape(self._n, self._k + 1, 3)
        pairs = np.stack([points[:, legs], points[:, np.array(legs) + 1]], axis=2)
        return pairs.reshape(-1, 2, 3), np.repeat(np.arange(self._n), len(legs))

    def _judged_legs(self) -> list[int]:
        """All legs except the vertical one in which it lands at home, as the mission does."""
        lands = self._stages[-1] == "land" and bool((self._paths.destinations == HOME).all())
        return list(range(self._k - 1 - lands))

    def _obstacles(self) -> None:
        if not self._limits.prisms:
            return
        pairs, owner = self._pairs(self._judged_legs())
        rows = leg_breaches(self._limits.ground, pairs.reshape(-1, 3), self._limits.obstacles)[0::2]
        positions = pairs[:, 0] + rows[:, 2:3] * (pairs[:, 1] - pairs[:, 0])
        for number in np.unique(rows[rows[:, 1] > _HEIGHT_TOLERANCE_M, 0]):
            depth = np.where(rows[:, 0] == number, rows[:, 1], 0.0)
            self._add_deepest("obstacle", depth, positions, owner, self._limits.prisms[int(number)].footprint.name)

    def _add_deepest(
        self, danger: Danger, depth: FloatArray, positions: FloatArray, owner: IntArray, name: str
    ) -> None:
        """A danger by its depths (m,) at places (m, 3) of legs that belong to paths (m,)."""
        order = np.lexsort((-depth, owner))
        first = order[np.concatenate([[True], np.diff(owner[order]) > 0])]
        deepest, where = np.zeros(self._n), np.zeros((self._n, 3))
        deepest[owner[first]], where[owner[first]] = depth[first], positions[first]
        self._found.append((danger, deepest > _HEIGHT_TOLERANCE_M, deepest, deepest, where, name))

    def _fence(self) -> None:
        if self._limits.fence is None:
            return
        fence = prepared(self._limits.fence)
        points = self._line.reshape(self._n, self._k + 1, 3)[:, : self._k]
        starts_inside = shapely.covers(fence, shapely.points(points[:, 0, :2]))
        # a route that leaves the fence has its own report: its returns begin at its position, not where it would stop.
        stops_outside = ~np.asarray(shapely.covers(fence, shapely.points(points[:, 1, :2])))
        at_stop = (points[:, :, :2] == points[:, 1:2, :2]).all(axis=2) & stops_outside[:, None]
        level = np.where(at_stop[..., None], points[:, :1, :2], points[:, :, :2])
        lines = np.asarray(shapely.linestrings(level))
        moves = shapely.length(lines) > 0.0
        leaves = starts_inside & moves
        leaves[leaves] = ~shapely.covers(fence, lines[leaves])
        depth, where = np.zeros(self._n), points[:, -1].copy()
        for k in np.flatnonzero(leaves):
            outside = shapely.difference(lines[k], fence)
            corners = shapely.get_coordinates(shapely.segmentize(outside, 5.0))
            if len(corners):
                away = shapely.distance(fence, shapely.points(corners))
                depth[k], where[k, :2] = float(away.max()), corners[int(away.argmax())]
        self._found.append(("fence", depth > _FENCE_TOLERANCE_M, depth, depth, where, ""))

    def _zones(self) -> None:
        zones = self._limits.zones
        if not zones.zones:
            return
        pairs, owner = self._pairs(self._judged_legs())
        inside = {
            (breach.leg, breach.zone) for breach in zones.position_breaches(pairs[:: len(self._judged_legs()), 0])
        }
        line = np.concatenate([pairs, np.full((len(pairs), 1, 3), np.nan)], axis=1).reshape(-1, 3)
        depths: dict[int, tuple[FloatArray, FloatArray]] = {}
        for breach in zones.leg_breaches(line):
            leg = breach.leg // 3
            if (int(owner[leg]), breach.zone) in inside:
                continue  # the mission itself is in the zone there
            depth, positions = depths.setdefault(breach.zone, (np.zeros(len(pairs)), np.zeros((len(pairs), 3))))
            depth[leg] = breach.depth_m
            positions[leg] = pairs[leg, 0] + breach.at * (pairs[leg, 1] - pairs[leg, 0])
        for number, (depth, positions) in sorted(depths.items()):
            self._add_deepest("zone", depth, positions, owner, zones.zones[number].name)

    def _battery(self) -> None:
        end_s = self._limits.endurance_s
        if end_s is None:
            return
        landed = self._states.times_s + self._paths.duration_s
        points = self._line.reshape(self._n, self._k + 1, 3)
        self._found.append(("battery", landed > end_s, landed, landed, points[:, self._k - 1], ""))


def _cut(points: FloatArray, stages: tuple[Stage, ...]) -> tuple[FloatArray, tuple[Stage, ...]]:
    """The same paths with long legs in pieces, because the Earth is not flat."""
    columns, kinds = [points[:, :1]], list[Stage]()
    for k, stage in enumerate(stages):
        a, b = points[:, k], points[:, k + 1]
        longest = float(np.hypot(*(b[:, :2] - a[:, :2]).T).max(initial=0.0))
        pieces = max(1, math.ceil(longest / _PIECE_M))
        t = (np.arange(1, pieces + 1) / pieces)[None, :, None]
        columns.append(a[:, None] + t * (b - a)[:, None])
        kinds += [stage] * pieces
    return np.concatenate(columns, axis=1), tuple(kinds)

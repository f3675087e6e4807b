"""The path that an autopilot flies by itself, from any moment of a flight: ArduCopter 4.7 and PX4 1.17.

Written from the autopilots' sources (named in ``data/failsafes.toml``). The mock vehicle has its own implementation, so that a
flight on it tests this one.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from uavcover.kernels.arrays import BoolArray, FloatArray, IntArray
from uavcover.missions.failsafes import (
    CEILING_BIT,
    HOME,
    IN_PLACE,
    Destinations,
    FailsafePaths,
    FailsafeSettings,
    FlightStates,
    Response,
    Stage,
    ardupilot_destination,
    px4_destination,
)

GroundHeights = Callable[[FloatArray], FloatArray]
"""Heights of the ground above sea level (n,) at (n, 2) positions; NaN where unknown."""


def predict(
    settings: FailsafeSettings, states: FlightStates, to: Destinations, ground: GroundHeights
) -> list[FailsafePaths]:
    """The paths of every response that the parameters enable; equal ones together.

    Args:
        settings: meaning of the parameters.
        states: begin of the paths.
        to: their destinations.
        ground: heights of the ground, for landings and for returns over terrain.
    """
    by_action: dict[tuple[str, bool], list[Response]] = {}
    for response in settings.responses:
        holds = settings.autopilot == "px4" and bool(response.parameter) and settings["hold_first_s"] > 0.0
        by_action.setdefault((response.action, holds), []).append(response)
    found: list[FailsafePaths] = []
    for (action, holds), responses in by_action.items():
        model = _Model(settings, states, to, ground, holds=holds)
        for paths in model.paths(action):
            found.append(replace(paths, responses=tuple(responses)))
    return found


def direct_return(
    settings: FailsafeSettings, states: FlightStates, to: Destinations, ground: GroundHeights
) -> FailsafePaths:
    """The return straight to home or a rally point, as when it is commanded."""
    paths = _Model(settings, states, to, ground, holds=False).direct()
    return replace(paths, responses=(Response("return", "commanded"),))


def wings_return(
    settings: FailsafeSettings,  # meaning of the parameters; for ArduPlane the return height and those of rally points
    states: FlightStates,  # from where
    to: Destinations,  # where to
    ground: GroundHeights,  # heights of the ground
    *,
    climb_slope: float,  # rise per metre
    descent_slope: float,  # fall per metre
) -> FailsafePaths:
    """The commanded return of a fixed-wing aircraft: it climbs or descends on the way, and circles above the destination."""
    model = _Model(settings, states, to, ground, holds=False)
    number, target, wanted = model.wings_destination()
    at = states.positions_m
    slopes = np.where(wanted > at[:, 2], climb_slope, descent_slope)
    distance = np.hypot(*(target[:, :2] - at[:, :2]).T)
    fraction = np.minimum(1.0, np.abs(wanted - at[:, 2]) / np.maximum(slopes * distance, 1e-9))
    reached = at[:, 2] + np.copysign(1.0, wanted - at[:, 2]) * np.minimum(np.abs(wanted - at[:, 2]), slopes * distance)
    knee = np.column_stack([at[:, :2] + fraction[:, None] * (target[:, :2] - at[:, :2]), reached])
    points = np.stack([at, knee, _lifted(target, reached)], axis=1)
    seconds = distance / max(settings["cruise_m_s"], 0.1)
    return FailsafePaths((Response("return", "commanded"),), points, ("return", "return"), number, seconds)


class _Model:
    """One autopilot's responses from given moments."""

    def __init__(
        self, settings: FailsafeSettings, states: FlightStates, to: Destinations, ground: GroundHeights, *, holds: bool
    ) -> None:
        self._get, self._states, self._to, self._ground = settings, states, to, ground
        self._is_px4, self._holds = settings.autopilot == "px4", holds
        self._at = states.positions_m
        self._n = len(self._at)
        self._stop = self._stopping_points()

    def paths(self, action: str) -> list[FailsafePaths]:
        """Paths of one action; several where the outcome depends on something not known beforehand."""
        match action:
            case "land":
                return [self._column("land")]
            case "terminate":
                return [self._column("land", note="the motors stop and the vehicle falls")]
            case "hold" | "hold-land":
                return [self._column("stop")]
            case "retrace":
                return self._smart_paths(self._direct_paths())
            case "retrace-land":
                return self._smart_paths([self._column("land")])
            case "mission-landing" if self._to.landing is not None:
                return [self._join_landing(climbs=False)]
        return self._px4_paths() if self._is_px4 else self._direct_paths()

    def _smart_paths(self, otherwise: list[FailsafePaths]) -> list[FailsafePaths]:
        """SmartRTL, and ArduCopter's reaction to a full buffer or a bad position; only the latter without a buffer."""
        if min(self._get["smart_points"], self._get["smart_accuracy_m"]) <= 0.0:
            return otherwise
        return [self._retrace(), *(replace(one, note=one.note or "if there is no SmartRTL path") for one in otherwise)]

    def _px4_paths(self) -> list[FailsafePaths]:
        """Paths of a return, by its type.

        Two where the item count before the landing, or a landing pattern's position, decides.
        """
        landing = self._to.landing
        match round(self._get["return_type"]):
            case 2:
                return [self._reversed() if landing is None else self._onward()]
            case 4:
                return [self._reversed()] if landing is None else [self._onward(), self._reversed()]
            case 1 | 3 if landing is not None and landing < len(self._to.route_m) - 1:
                return [
                    self._join_landing(climbs=True),
                    replace(self.direct(), note="if home or a safe point is nearer"),
                ]
        return self._direct_paths()

    def _direct_paths(self) -> list[FailsafePaths]:
        if not self._is_px4 and round(self._get["height_type"]) == 1:
            over = replace(self.direct(over_terrain=True), note="over terrain (RTL_ALT_TYPE 1)")
            return [over, replace(self.direct(), note="without terrain data on the vehicle")]
        return [self.direct()]

    def direct(self, *, over_terrain: bool = False) -> FailsafePaths:
        """Up, level to the destination, down."""
        number, target, by_mission = self._destination()
        origin = self._stop if self._holds or not self._is_px4 else self._at
        if self._is_px4:
            up = self._px4_return_alt(target, origin)
            # A climb is at the place of the command; without one it turns while it brakes, and goes straight from there.
            origin = np.where((up > origin[:, 2])[:, None], origin, self._stop)
        else:
            up = self._ardupilot_return_alt(target, over_terrain=over_terrain)
        climbed = _lifted(origin, up)
        if over_terrain:
            level = self._over_terrain(origin, target, up)
            climbed = level[:, 0]
        else:
            level = np.stack([climbed, _lifted(target, up)], axis=1)
        # The mission's landing ignores RTL_DESCEND_ALT and RTL_LAND_DELAY.
        final = np.where(by_mission, level[:, -1, 2], self._final_alt(target, level[:, -1, 2]))
        ends = _lifted(target, final)
        lands = self._lands() | by_mission
        bottom = np.where(lands, self._landing_alt(target), final)
        points = np.concatenate(
            [
                np.stack([self._at, self._stop, origin], axis=1),
                level,
                np.stack([ends, _lifted(target, bottom)], axis=1),
            ],
            axis=1,
        )
        legs: list[Stage] = ["return"] * (level.shape[1] - 1)
        return self._made(points, ("stop", "stop", "climb", *legs, "descend", "land"), number)

    def _made(
        self, points: FloatArray, stages: Sequence[Stage], destinations: IntArray, note: str = "",
        tail: FloatArray | None = None, joins: IntArray | None = None,
    ) -> FailsafePaths:  # fmt: skip
        waits = self._get["loiter_s"] if not self._is_px4 else max(0.0, self._get["land_delay_s"])
        seconds = self._seconds(points) + (waits if "return" in stages else 0.0)
        seconds += self._get["hold_first_s"] if self._holds else 0.0
        if tail is not None and joins is not None:
            left = np.concatenate([np.cumsum(self._seconds_between(tail[:-1], tail[1:])[::-1])[::-1], [0.0]])
            seconds = seconds + left[joins] + self._seconds(np.stack([points[:, -1], tail[joins]], axis=1))
        return FailsafePaths((), points, tuple(stages), destinations, seconds, tail, joins, note)

    def _seconds(self, points: FloatArray) -> FloatArray:
        """(n,) flying time along (n, k, 3) points."""
        return np.asarray(np.sum([self._seconds_between(a, b) for a, b in _pairs(points)], axis=0), float)

    def _seconds_between(self, a: FloatArray, b: FloatArray) -> FloatArray:
        get = self._get
        speed = get["cruise_m_s"] if self._is_px4 else get["return_speed_m_s"] or get["cruise_m_s"]
        rise = b[:, 2] - a[:, 2]
        slow = np.minimum(10.0, np.maximum(0.0, -rise))
        level = np.hypot(*(b[:, :2] - a[:, :2]).T) / max(speed, 0.1)
        up, down = np.maximum(rise, 0.0), np.maximum(-rise, 0.0)
        vertical = up / max(get["climb_m_s"], 0.1) + (down - slow) / max(get["descent_m_s"], 0.1)
        vertical += slow / max(min(get["land_m_s"], get["descent_m_s"]), 0.1)
        return np.asarray(np.maximum(level, vertical), float)

    def _stopping_points(self) -> FloatArray:
        """(n, 3) positions at which it comes to rest."""
        velocity = self._states.velocities_m_s
        speed, a = np.hypot(*velocity.T), self._get["acceleration_m_s2"]
        if self._is_px4:
            distance = speed * (speed / (2.0 * a) + a / self._get["jerk_m_s3"])
        else:
            kp = 1.0  # PSC_POSXY_P
            distance = np.where(speed < a / kp, speed / kp, 0.5 * a / kp**2 + speed**2 / (2.0 * a))
        if self._states.ahead_m is not None:
            distance = np.minimum(distance, self._states.ahead_m)
        unit = velocity / np.maximum(speed, 1e-9)[:, None]
        return np.column_stack([self._at[:, :2] + distance[:, None] * unit, self._at[:, 2]])

    def _column(self, stage: Stage, note: str = "") -> FailsafePaths:
        """It stops, and lands or stays there."""
        end = _lifted(self._stop, self._landing_alt(self._stop)) if stage == "land" else self._stop
        points = np.stack([self._at, self._stop, end], axis=1)
        return self._made(points, ("stop", stage), np.full(self._n, IN_PLACE), note)

    def _retrace(self) -> FailsafePaths:
        """SmartRTL: back along the flown path to 2 m above where it was armed. Loops that it may leave out are not known."""
        start, route = self._to.home_m, self._to.route_m
        line = np.vstack([start, route])
        line[0, 2] = route[0, 2]
        low = np.array([[*start[:2], start[2] + 2.0]])  # mode_smart_rtl.cpp: where it begins to land
        final = self._landing_alt(start[None]) if self._lands() else self._final_alt(start[None], low[:, 2])
        tail = np.vstack([line[::-1], low, _lifted(low, final)])
        joins = np.clip(
            len(line) - 1 - self._states.legs, 0, len(tail) - 1
        )  # the vertex before the one that it flies to
        points = np.stack([self._at, self._stop, tail[joins]], axis=1)
        note = "back along the flown path; SmartRTL may take a shortcut"
        return self._made(points, ("stop", "mission"), np.full(self._n, HOME), note, tail, joins)

    def _reversed(self) -> FailsafePaths:
        """PX4: back through the mission's items to its first, and down at home."""
        items = self._to.items_m[::-1]
        home = self._to.home_m
        over = np.array([*home[:2], items[-1, 2]])
        tail = np.vstack([items, over, [*home[:2], self._landing_alt(home[None])[0]]])
        # In its mission it goes to the item before the one that it flies to; after a hold to the nearest, a landing among them.
        joins = self._nearest(items) if self._holds else np.clip(len(items) - self._states.legs, 0, len(items) - 1)
        points = np.stack([self._at, self._stop, tail[joins]], axis=1)
        note = "back along the route"
        return self._made(points, ("stop", "mission"), np.full(self._n, HOME), note, tail, joins)

    def _onward(self) -> FailsafePaths:
        """PX4: on through the mission's items to its landing, without its waits."""
        tail = self._to.items_m.copy()
        joins = self._nearest(tail) if self._holds else np.clip(self._states.legs, 0, len(tail) - 1)
        origin = self._stop if self._holds else self._at
        first = tail[joins]
        first[joins == len(tail) - 1, 2] = origin[joins == len(tail) - 1, 2]  # level to above the landing
        tail[-1:, 2] = self._landing_alt(tail[-1:])
        points = np.stack([self._at, origin, first], axis=1)
        return self._made(points, ("stop", "mission"), np.full(self._n, HOME), "onward along the mission", tail, joins)

    def _nearest(self, items: FloatArray) -> IntArray:
        """(n,) number of the item that is nearest in space to where it holds."""
        return np.asarray(np.linalg.norm(self._stop[:, None] - items[None], axis=2).argmin(axis=1), np.int64)

    def _join_landing(self, *, climbs: bool) -> FailsafePaths:
        """Straight to the begin of the mission's landing; PX4 climbs before."""
        tail = np.vstack([self._to.route_m[self._to.landing or 0 :], self._to.items_m[-1]])
        tail[-1, 2] = self._landing_alt(tail[-1:])[0]
        begin = np.broadcast_to(tail[0], (self._n, 3))
        origin = self._stop if self._holds or not self._is_px4 else self._at
        up = self._at[:, 2]
        if climbs:
            up = self._px4_return_alt(np.broadcast_to(self._to.items_m[-1], (self._n, 3)), origin)
        points = np.stack([self._at, self._stop, origin, _lifted(origin, up), begin], axis=1)
        joins, number = np.zeros(self._n, dtype=np.int64), np.full(self._n, HOME)
        stages: tuple[Stage, ...] = ("stop", "stop", "climb", "return")
        return self._made(points, stages, number, "to the mission's landing", tail, joins)

    def _lands(self) -> bool:
        return self._get["land_delay_s"] >= 0.0 if self._is_px4 else self._get["final_height_m"] <= 0.0

    def _final_alt(self, target: FloatArray, from_alt: FloatArray) -> FloatArray:
        """(n,) height at which it waits above the destination, or goes on to land."""
        if self._is_px4:
            if self._get["land_delay_s"] == 0.0:
                return from_alt
            return np.asarray(np.minimum(target[:, 2] + self._get["descend_height_m"], from_alt))
        final = self._get["final_height_m"]
        # ArduPilot issue 31968: above home, wherever the destination is.
        return from_alt if final <= 0.0 else np.full(len(target), self._to.home_m[2] + final)

    def _landing_alt(self, at: FloatArray) -> FloatArray:
        ground = self._ground(at[:, :2])
        return np.asarray(np.where(np.isfinite(ground), ground, self._to.home_m[2]), float)

    def wings_destination(self) -> tuple[IntArray, FloatArray, FloatArray]:
        """Number, (n, 3) place, and (n,) height above sea level at which wings fly there."""
        number, target, _ = self._destination()
        up = target[:, 2] + self._get["return_height_m"]
        if self._is_px4:
            return number, target, np.maximum(up, self._at[:, 2])
        if self._get["return_height_m"] < 0.0:  # RTL_ALTITUDE of ArduPlane
            up = self._at[:, 2]
        return number, target, np.where(number == HOME, up, target[:, 2])

    def _destination(self) -> tuple[IntArray, FloatArray, BoolArray]:
        """Number and (n, 3) position of the destination of a return, and whether it is the mission's landing."""
        if self._is_px4:
            return px4_destination(self._get, self._to, self._stop if self._holds else self._at)
        return *ardupilot_destination(self._get, self._to, self._at), np.zeros(self._n, dtype=bool)

    def _ardupilot_return_alt(self, target: FloatArray, *, over_terrain: bool) -> FloatArray:
        """(n,) height above sea level of the return; above the terrain where it follows that."""
        get, home_alt = self._get, self._to.home_m[2]
        base = np.full(self._n, home_alt)
        target_base = base
        if over_terrain:
            base, target_base = self._ground(self._at[:, :2]), self._ground(target[:, :2])
        current = self._at[:, 2] - base
        least = np.maximum(0.3, current + max(0.0, get["climb_min_m"]))  # RTL_ALT_MIN of ArduCopter
        wanted = np.maximum.reduce(
            [np.maximum(target[:, 2] - target_base, 0.0), np.full(self._n, get["return_height_m"]), least]
        )
        if get["cone_slope"] >= 0.5:  # RTL_MIN_CONE_SLOPE
            distance = np.hypot(*(target[:, :2] - self._stop[:, :2]).T)
            wanted = np.minimum(wanted, np.maximum(distance * get["cone_slope"], least))
        if round(get["fence_enabled"]) and round(get["fence_kinds"]) & CEILING_BIT:
            over = wanted + target_base - home_alt - (get["fence_top_m"] - get["fence_margin_m"])
            wanted = wanted - np.maximum(over, 0.0)
        wanted = np.maximum(wanted, current)
        return np.asarray(wanted if over_terrain else wanted + home_alt)

    def _px4_return_alt(self, target: FloatArray, origin: FloatArray) -> FloatArray:
        get = self._get
        highest = target[:, 2] + get["return_height_m"]
        half = get["cone_half_angle_deg"]
        if half <= 0.0:
            return np.maximum(origin[:, 2], highest)
        distance, accept = np.hypot(*(target[:, :2] - origin[:, :2]).T), get["acceptance_m"]
        cone = target[:, 2] + distance / math.tan(math.radians(min(max(half, 1.0), 89.0)))
        wanted = np.where(distance <= get["cone_radius_m"], np.minimum(cone, highest), highest)
        wanted = np.maximum(wanted, target[:, 2] + 2.0 * accept)
        wanted = np.where(distance <= accept, target[:, 2] + 2.0 * distance, wanted)
        return np.maximum(np.minimum(wanted, highest), origin[:, 2])

    def _over_terrain(self, origin: FloatArray, target: FloatArray, height: FloatArray) -> FloatArray:
        """(n, p, 3) a line at (n,) heights above the terrain."""
        longest = float(np.hypot(*(target[:, :2] - origin[:, :2]).T).max(initial=0.0))
        t = np.linspace(0.0, 1.0, 2 + math.ceil(longest / 30.0))[None, :, None]
        level = (1.0 - t) * origin[:, None, :2] + t * target[:, None, :2]
        ground = self._ground(level.reshape(-1, 2)).reshape(level.shape[:2])
        return np.concatenate([level, (ground + height[:, None])[..., None]], axis=2)


def _lifted(positions: FloatArray, alts_m: FloatArray) -> FloatArray:
    """(n, 3) the same positions at other heights."""
    return np.column_stack([positions[:, :2], np.broadcast_to(alts_m, len(positions))])


def _pairs(points: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    return [(points[:, k], points[:, k + 1]) for k in range(points.shape[1] - 1)]

"""The check of a mission: everything that is judged, in one place."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import shapely

from mission_io.model.items import Command, Frame, GeoPoint, Mission, MissionItem
from mission_io.model.places import FAR_FROM_HOME_M, MEAN_RADIUS_M, ground_distance_m
from uavcover.extras.check.aircraft import Aircraft
from uavcover.extras.check.boundary_checks import distance_findings, fence_findings, zone_findings
from uavcover.extras.check.endurance_checks import endurance_findings, speed_findings, wing_findings
from uavcover.extras.check.findings import CheckFinding, joined
from uavcover.extras.check.flown_path import flown_path
from uavcover.extras.check.ground_checks import height_findings
from uavcover.extras.check.item_values import impossible_numbers, value_findings
from uavcover.extras.check.limits import FenceSource, Limits, Surroundings, local_fence
from uavcover.extras.check.obstacle_checks import obstacle_findings, with_obstacles
from uavcover.extras.check.places import Doubt, Heights, believed, places_of
from uavcover.extras.check.return_checks import (
    Lines,
    OwnReturn,
    cut,
    lowest_of,
    places_along,
    return_findings,
    with_gaps,
)
from uavcover.extras.check.segments import FlownPath
from uavcover.extras.check.tuning import CHECKS, WORLD
from uavcover.extras.check.turns import in_turns, turns_of
from uavcover.extras.check.world import World
from uavcover.kernels.arrays import FloatArray
from uavcover.model.judgement import Judgement, VerdictName
from uavcover.model.no_fly import NoFly
from uavcover.model.obstacles import Obstacle
from uavcover.new.tuning import TERRAIN
from uavcover.scenario.airspace.zones import local_zones
from uavcover.scenario.obstacles import Prism
from uavcover.terrain.frames import LocalFrame
from uavcover.terrain.ground import Ground

_CIRCLES = (Command.NAV_LOITER_UNLIM, Command.NAV_LOITER_TURNS, Command.NAV_LOITER_TIME)

Bounds = tuple[float, float, float, float]
GroundReader = Callable[[LocalFrame, Bounds], Ground]
"""A height surface in a local frame, within west, south, east, north in metres."""
SurfaceReader = Callable[[LocalFrame, Bounds, Ground], Ground]
"""Reader of the surface model over a ground."""
ZoneReader = Callable[[Bounds], Sequence[NoFly]]
"""No-fly zones near west, south, east, north in degrees."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckRequest:
    """Subject and limits of a check.

    Attributes:
        mission: as its file has it.
        aircraft: who flies it.
        limits: what it has to keep.
        fence: the fence, none for none.
        home: latitude and longitude of the take-off position; none: the mission's.
        pilot: latitude and longitude of the pilot; none: at home.
        obstacles: in longitude and latitude.
        own_return: what is known of the autopilot's own returns.
    """

    mission: Mission
    aircraft: Aircraft
    limits: Limits
    fence: FenceSource | None = None
    home: tuple[float, float] | None = None
    pilot: tuple[float, float] | None = None
    obstacles: tuple[Obstacle, ...] = ()
    own_return: OwnReturn = field(default_factory=lambda: OwnReturn(parameters={}))


@dataclass(frozen=True, eq=False, slots=True)
class Checked:
    """The outcome.

    Attributes:
        findings: everything found; what breaks first.
        path: as it would be flown; none where home is unknown.
        world: its surroundings; none where home is unknown.
        time_s: of the whole flight; infinite where the wind stops it.
        around: fence, zones and obstacles; none where home is unknown.
    """

    findings: tuple[CheckFinding, ...]
    path: FlownPath | None
    world: World | None
    time_s: float
    around: Surroundings | None = None

    @property
    def judgement(self) -> Judgement:
        """The decision: failed where a limit is broken, not proved where something could not be answered."""
        return Judgement(tuple(one.decides for one in self.findings))

    @property
    def verdict(self) -> VerdictName:
        """Passed, failed or not proved."""
        return self.judgement.verdict

    def with_findings(self, more: Sequence[CheckFinding]) -> "Checked":
        """The same with more findings."""
        return replace(self, findings=_sorted([*self.findings, *more]))


def check_mission(
    request: CheckRequest,
    heights: Heights,
    read_ground: GroundReader,
    read_zones: ZoneReader,
    read_surface: SurfaceReader | None = None,
    *,
    doubt: Doubt = believed,
) -> Checked:
    """Judge a mission at its full length.

    Args:
        request: what, and by what.
        heights: of the ground at single places.
        read_ground: the ground around the mission.
        read_zones: the no-fly zones around it.
        read_surface: a surface model over that ground; none without one.
        doubt: why a height of the ground is not believed, and missing in ``heights`` and ``read_ground`` therefore.

    Raises:
        UavcoverError: elevation data or zones cannot be read.
    """
    mission, aircraft, limits = request.mission, request.aircraft, request.limits
    places = places_of(mission, heights, aircraft.autopilot, home=request.home, doubt=doubt)
    findings = [*places.findings, *_frame_findings(mission, aircraft)]
    impossible = impossible_numbers(mission)
    findings += impossible or value_findings(mission, aircraft, places.home)
    if places.home is None or impossible:
        return Checked(_sorted(findings), None, None, 0.0)
    world, prisms = _world(request, places.home, places.skipped, read_ground, read_surface)
    path = flown_path(mission, world, aircraft, skipped=places.skipped)
    surroundings = replace(_surroundings(request, world, path, read_zones), prisms=prisms)
    findings += path.findings
    findings += with_hints(height_findings(path, world, limits), mission, world, limits)
    turns = turns_of(path, mission, aircraft)
    findings += in_turns(lambda each: height_findings(each, world, limits), turns, findings)
    checks: tuple[Callable[[FlownPath], list[CheckFinding]], ...] = (
        lambda each: fence_findings(each, world, surroundings.fence),
        lambda each: zone_findings(each, world, surroundings),
        lambda each: obstacle_findings(each, world, surroundings),
    )
    for judge in checks:
        of_legs = judge(path)
        findings += [*of_legs, *in_turns(judge, turns, of_legs)]
    findings += distance_findings(path, world, limits)
    findings += return_findings(mission, path, world, limits, aircraft, surroundings, request.own_return)
    if surroundings.pilot_m is not None:
        findings += sight_findings(path, world, surroundings.pilot_m)
    findings += speed_findings(path, aircraft)
    findings += wing_findings(path, world, aircraft)
    time_s, tired = endurance_findings(path, aircraft, limits)
    return Checked(_sorted([*findings, *tired]), path, world, time_s, surroundings)


def _sorted(findings: list[CheckFinding]) -> tuple[CheckFinding, ...]:
    order = {"breaks": 0, "unknown": 1, "look": 2}
    return tuple(sorted(findings, key=lambda one: (order[one.weight], one.items or (0, 0))))


def _frame_findings(mission: Mission, aircraft: Aircraft) -> list[CheckFinding]:
    over = [n for n, item in enumerate(mission.items, 1) if item.frame is Frame.ABOVE_TERRAIN]
    if not over:
        return []
    items = (over[0], over[-1])
    if aircraft.autopilot == "px4":
        return [
            CheckFinding(
                kind="frame", weight="breaks", items=items, what="PX4 does not support heights above the terrain",
                do="use heights above home (frame 3) or above sea level (frame 0)",
            )
        ]  # fmt: skip
    return [
        CheckFinding(
            kind="frame", weight="look", items=items,
            what="heights above the terrain require terrain data on the vehicle; without it, the mission stops there",
            do="send it with uavcover terrain --dat or uavcover terrain-server, and set TERRAIN_ENABLE to 1",
        )
    ]  # fmt: skip


def _world(
    request: CheckRequest,
    home: GeoPoint,
    skipped: frozenset[int],
    read_ground: GroundReader,
    read_surface: SurfaceReader | None,
) -> tuple[World, tuple[Prism, ...]]:
    """The ground wherever the mission may come, and the obstacles on it."""
    frame = LocalFrame(home.lat_deg, home.lon_deg, home.alt_amsl_m)
    lat_lon = [(home.lat_deg, home.lon_deg), *([] if request.pilot is None else [request.pilot])]
    # A rally point may lie in the ground data, or on another continent: then its finding says that the ground is unknown.
    lat_lon += [
        (point.lat_deg, point.lon_deg)
        for point in request.own_return.rally
        if ground_distance_m(home.lat_deg, home.lon_deg, point.lat_deg, point.lon_deg) < FAR_FROM_HOME_M
    ]
    around_m = WORLD.around_m + 2.0 * request.aircraft.loiter_radius_m
    splines = False
    for number, item in enumerate(request.mission.items, 1):
        if number in skipped or not item.has_position or not math.isfinite(item.lat_deg + item.lon_deg):
            continue
        if (item.lat_deg, item.lon_deg) != (0.0, 0.0):
            lat_lon.append((item.lat_deg, item.lon_deg))
        splines |= item.command == Command.NAV_SPLINE_WAYPOINT
        if item.command in _CIRCLES:
            around_m = max(
                around_m, WORLD.around_m + 2.0 * abs(item.params[2] if math.isfinite(item.params[2]) else 0.0)
            )
    lats, lons = np.array(lat_lon).T
    en = frame.enu_from_geodetic(lats, lons, home.alt_amsl_m)[:, :2]
    if splines and len(en) > 1:
        around_m = max(around_m, 0.6 * float(np.hypot(*np.diff(en, axis=0).T).max()))
    west, south = en.min(axis=0) - around_m
    east, north = en.max(axis=0) + around_m
    bounds = (float(west), float(south), float(east), float(north))
    clearance_m = request.limits.obstacle_clearance_m
    bare = read_ground(frame, bounds)
    ground, prisms = with_obstacles(bare, request.obstacles, frame, bounds, clearance_m)
    surface = None if read_surface is None else read_surface(frame, bounds, bare)
    return World(frame, ground, surface), prisms


def _surroundings(request: CheckRequest, world: World, path: FlownPath, read_zones: ZoneReader) -> Surroundings:
    known = [segment.enu_m[np.isfinite(segment.enu_m).all(axis=1)] for segment in path.segments]
    places = np.vstack([np.zeros((1, 3)), *known])
    lat, lon, _ = world.frame.geodetic_from_enu(places)
    entries = read_zones((float(lon.min()), float(lat.min()), float(lon.max()), float(lat.max())))
    box = shapely.box(*places[:, :2].min(axis=0), *places[:, :2].max(axis=0)).buffer(1.0)
    pilot = (0.0, 0.0) if request.pilot is None else world.place(*request.pilot)
    eye = world.above_ground([pilot], WORLD.eye_m)[0]
    return Surroundings(
        fence=local_fence(request.fence, world, request.aircraft.autopilot),
        zones=local_zones(entries, world.frame, box),
        pilot_m=eye if np.isfinite(eye).all() else None,
        obstacle_clearance_m=request.limits.obstacle_clearance_m,
    )


_FOOT_M = 0.3048


def with_hints(findings: Sequence[CheckFinding], mission: Mission, world: World, limits: Limits) -> list[CheckFinding]:
    """Findings about heights with the likely reason, where another unit or another frame would keep the band."""
    return [_with_hint(one, mission, world, limits) if one.kind in ("ground", "height") else one for one in findings]


def _with_hint(finding: CheckFinding, mission: Mission, world: World, limits: Limits) -> CheckFinding:
    first, last = finding.items or (1, 0)
    items = [
        (n, mission.items[n - 1])
        for n in range(max(1, first), last + 1)
        if mission.items[n - 1].has_position
        and math.isfinite(mission.items[n - 1].alt_m)
        and mission.items[n - 1].lat_deg != 0.0
    ]
    wrong = [(n, item) for n, item in items if not _fits(_agl_m(item, world, item.frame, item.alt_m), limits)]
    if not wrong:
        return finding
    for words, change in _CHANGES.items():
        if all(change(item, world, limits) for _, item in wrong):
            return dataclasses.replace(finding, what=f"{finding.what}; {words}")
    return finding


def _agl_m(item: MissionItem, world: World, frame: Frame, alt_m: float) -> float:
    """Height above ground of an item's place with its number read in another way."""
    if frame is Frame.ABOVE_TERRAIN:
        return alt_m
    east, north = world.place(item.lat_deg, item.lon_deg)
    alt = alt_m + (world.home_alt_amsl_m if frame is Frame.ABOVE_HOME else 0.0)
    return float(world.ground.heights_agl_m(world.at_alts([[east, north]], alt))[0])


def _fits(height_agl_m: float, limits: Limits) -> bool:
    most = WORLD.most_m if limits.max_height_agl_m is None else limits.max_height_agl_m
    return limits.min_height_agl_m - WORLD.slack_m <= height_agl_m <= most + WORLD.slack_m


def _as_amsl(item: MissionItem, world: World, limits: Limits) -> bool:
    return item.frame is not Frame.AMSL and _fits(_agl_m(item, world, Frame.AMSL, item.alt_m), limits)


def _as_above_home(item: MissionItem, world: World, limits: Limits) -> bool:
    return item.frame is Frame.AMSL and _fits(_agl_m(item, world, Frame.ABOVE_HOME, item.alt_m), limits)


def _as_above_terrain(item: MissionItem, _: World, limits: Limits) -> bool:
    return item.frame is not Frame.ABOVE_TERRAIN and _fits(item.alt_m, limits)


def _as_feet(item: MissionItem, world: World, limits: Limits) -> bool:
    return _fits(_agl_m(item, world, item.frame, item.alt_m * _FOOT_M), limits)


def _as_metres(item: MissionItem, world: World, limits: Limits) -> bool:
    return _fits(_agl_m(item, world, item.frame, item.alt_m / _FOOT_M), limits)


_CHANGES = {
    "its value is plausible as a height above sea level: check the frame": _as_amsl,
    "its value is plausible as a height above home: check the frame": _as_above_home,
    "its value is plausible in feet: check the unit": _as_feet,
    "its value is plausible as a height above the terrain: check the frame": _as_above_terrain,
    "it is plausible if the height is in feet instead of metres": _as_metres,
}


_BENDING = 1.0 - 1.0 / (4.0 / 3.0)
"""Radio waves bend with the Earth as if it were 4/3 as large (ITU-R P.834)."""


def sight_findings(path: FlownPath, world: World, pilot_m: FloatArray) -> list[CheckFinding]:
    """Segments that terrain, trees or roofs hide from the pilot, or from the radio beside him."""
    under_m = -float(world.clearances_m(pilot_m)[0])
    if under_m > TERRAIN.hides_m:
        return [
            CheckFinding(
                kind="sight", weight="look", by=under_m, unit="m",
                what=f"the pilot is under trees or a roof {under_m:.0f} m above eye level and cannot observe the flight",
                do="choose an open position (--pilot)",
            ).at(world.geodetic(pilot_m))
        ]  # fmt: skip
    hidden = []
    what_hides = "ground" if world.surface is None else "ground, trees or roofs"
    for segment in path.distinct:
        if segment.phase not in ("route", "return"):
            continue
        places = places_along(segment)
        lowest, _, begin = lowest_of(world, _bent_lines(pilot_m, places))
        if lowest < -CHECKS.clearance_tolerance_m:
            hidden.append(
                CheckFinding(
                    kind="sight",
                    weight="look",
                    items=segment.items,
                    by=-lowest,
                    unit="m",
                    what=f"hidden from the pilot and the radio by {what_hides} {-lowest:.0f} m high in the line of sight",
                    do="choose another position (--pilot), fly higher, or use a spotter",
                ).at(world.geodetic(places[begin])),
            )
    return joined(hidden, lambda one: one.kind)


def _bent_lines(pilot_m: FloatArray, places_m: FloatArray) -> Lines:
    """Lines from the pilot to (n, 3) places, as radio waves see the ground between them."""
    away = places_m - pilot_m
    distances_m = np.hypot(away[:, 0], away[:, 1])
    owner, t = cut(np.maximum(2, np.ceil(distances_m / CHECKS.return_line_piece_m)).astype(np.int64))
    lines = pilot_m + t[:, None] * away[owner]
    lines[:, 2] += t * (1.0 - t) * distances_m[owner] ** 2 / (2.0 * MEAN_RADIUS_M) * _BENDING
    return with_gaps(lines, owner)

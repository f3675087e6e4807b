"""The check of a mission: everything that is judged, in one place."""

import functools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import shapely

from mission_io.formats.text import FAR_FROM_HOME_M
from mission_io.model.items import MEAN_RADIUS_M, Command, Frame, GeoPoint, Mission, MissionItem, ground_distance_m
from uavcover.extras.check.clearance_checks import (
    distance_findings,
    fence_findings,
    height_findings,
    obstacle_findings,
    with_obstacles,
    zone_findings,
)
from uavcover.extras.check.endurance_checks import endurance_findings, speed_findings, wing_findings
from uavcover.extras.check.findings import CheckFinding, FlownPath, joined
from uavcover.extras.check.flown_path import flown_path
from uavcover.extras.check.item_checks import Doubt, Heights, believed, impossible_numbers, positions_of, value_findings
from uavcover.extras.check.return_checks import (
    Lines,
    OwnReturn,
    cut,
    lowest_of,
    positions_along,
    return_findings,
    with_gaps,
)
from uavcover.extras.check.tuning import CHECKS, WORLD
from uavcover.extras.check.turns import in_turns, turns_of
from uavcover.extras.check.world import Aircraft, FenceSource, Limits, Surroundings, World, local_fence
from uavcover.kernels.arrays import FloatArray
from uavcover.model.limits import NoFly, Obstacle
from uavcover.model.verdict import Judgement, VerdictName
from uavcover.new.quantities import TERRAIN
from uavcover.scenario.airspace.zones import local_zones
from uavcover.scenario.obstacles import Prism
from uavcover.terrain.frames import Bounds, LocalFrame
from uavcover.terrain.ground import Ground

_CIRCLES = (Command.NAV_LOITER_UNLIM, Command.NAV_LOITER_TURNS, Command.NAV_LOITER_TIME)

GroundReader = Callable[[LocalFrame, Bounds], Ground]
"""A height surface in a local frame, within west, south, east, north in metres."""
SurfaceReader = Callable[[LocalFrame, Bounds, Ground], Ground]
"""Reader of the surface model over a ground."""
ZoneReader = Callable[[Bounds], Sequence[NoFly]]
"""No-fly zones near west, south, east, north in degrees."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckRequest:
    """Subject and limits of a check."""

    mission: Mission  # as its file has it
    aircraft: Aircraft  # who flies it
    limits: Limits  # its limits
    fence: FenceSource | None = None  # the fence, if any
    home: tuple[float, float] | None = None  # latitude and longitude of the take-off position; None: the mission's
    pilot: tuple[float, float] | None = None  # latitude and longitude of the pilot; None: at home
    obstacles: tuple[Obstacle, ...] = ()  # in longitude and latitude
    # the autopilot's own returns
    own_return: OwnReturn = field(default_factory=OwnReturn)


@dataclass(frozen=True, eq=False, slots=True)
class Checked:
    """Result of a check."""

    findings: tuple[CheckFinding, ...]  # all findings, broken limits first
    path: FlownPath | None  # as it would be flown; None where home is unknown
    world: World | None  # its surroundings; None where home is unknown
    time_s: float  # of the whole flight; infinite where the wind stops it
    around: Surroundings | None = None  # fence, zones and obstacles; None where home is unknown

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
    request: CheckRequest,  # what, and by what
    heights: Heights,  # of the ground at single places
    read_ground: GroundReader,  # the ground around the mission
    read_zones: ZoneReader,  # the no-fly zones around it
    read_surface: SurfaceReader | None = None,  # a surface model over that ground; None without one
    *,
    # why a height of the ground is not believed, and missing in ``heights`` and ``read_ground`` therefore
    doubt: Doubt = believed,
) -> Checked:
    """Judge a mission at its full length. Raises UavcoverError: elevation data or zones cannot be read."""
    mission, aircraft, limits = request.mission, request.aircraft, request.limits
    positions = positions_of(mission, heights, aircraft.autopilot, home=request.home, doubt=doubt)
    findings = [*positions.findings, *_frame_findings(mission, aircraft)]
    impossible = impossible_numbers(mission)
    findings += impossible or value_findings(mission, aircraft, positions.home)
    if positions.home is None or impossible:
        return Checked(_sorted(findings), None, None, 0.0)
    world, prisms = _world(request, positions.home, positions.skipped, read_ground, read_surface)
    fence = local_fence(request.fence, world, aircraft.autopilot)
    path = flown_path(mission, world, aircraft, request.own_return, fence, skipped=positions.skipped)
    surroundings = replace(_surroundings(request, world, path, read_zones), fence=fence, prisms=prisms)
    findings += path.findings
    findings += with_hints(height_findings(path, world, limits), mission, world, limits)
    turns = turns_of(path, mission, aircraft)
    findings += in_turns(lambda each: height_findings(each, world, limits), turns, findings)
    for check in (fence_findings, zone_findings, obstacle_findings):
        judge = functools.partial(check, world=world, around=surroundings)
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
            what="heights above the terrain require terrain data on the vehicle; without it, the mission stops at this item",
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
    # a rally point may lie in the ground data, or on another continent: then its finding says that the ground is unknown.
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
        if item.command in _CIRCLES and math.isfinite(item.params[2]):
            around_m = max(around_m, WORLD.around_m + 2.0 * abs(item.params[2]))
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
    positions = np.vstack([np.zeros((1, 3)), *(segment.known_m for segment in path.segments)])
    lat, lon, _ = world.frame.geodetic_from_enu(positions)
    entries = read_zones((float(lon.min()), float(lat.min()), float(lon.max()), float(lat.max())))
    box = shapely.box(*positions[:, :2].min(axis=0), *positions[:, :2].max(axis=0)).buffer(1.0)
    pilot = (0.0, 0.0) if request.pilot is None else world.position(*request.pilot)
    eye = world.above_ground([pilot], WORLD.eye_m)[0]
    return Surroundings(
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
    wrong = [
        item
        for item in mission.items[max(0, first - 1) : last]
        if item.has_position
        and math.isfinite(item.alt_m)
        and item.lat_deg != 0.0
        and not _fits(_agl_m(item, world, item.frame, item.alt_m), limits)
    ]
    plausible = [
        [words for words, frame, alt_m in _readings(item) if _fits(_agl_m(item, world, frame, alt_m), limits)]
        for item in wrong
    ]
    for words in plausible[0] if wrong else ():
        if all(words in each for each in plausible):
            return replace(finding, what=f"{finding.what}; {words}")
    return finding


def _agl_m(item: MissionItem, world: World, frame: Frame, alt_m: float) -> float:
    """Height above ground of an item's place with its number read in another way."""
    if frame is Frame.ABOVE_TERRAIN:
        return alt_m
    east, north = world.position(item.lat_deg, item.lon_deg)
    alt = alt_m + (world.home_alt_amsl_m if frame is Frame.ABOVE_HOME else 0.0)
    return float(world.ground.heights_agl_m(world.at_alts([[east, north]], alt))[0])


def _fits(height_agl_m: float, limits: Limits) -> bool:
    most = WORLD.most_m if limits.max_height_agl_m is None else limits.max_height_agl_m
    return limits.min_height_agl_m - WORLD.slack_m <= height_agl_m <= most + WORLD.slack_m


def _readings(item: MissionItem) -> Iterator[tuple[str, Frame, float]]:
    """Other readings of an item's height: in words, the frame, the number."""
    if item.frame is Frame.AMSL:
        yield "its value is plausible as a height above home: check the frame", Frame.ABOVE_HOME, item.alt_m
    else:
        yield "its value is plausible as a height above sea level: check the frame", Frame.AMSL, item.alt_m
    yield "its value is plausible in feet: check the unit", item.frame, item.alt_m * _FOOT_M
    if item.frame is not Frame.ABOVE_TERRAIN:
        yield "its value is plausible as a height above the terrain: check the frame", Frame.ABOVE_TERRAIN, item.alt_m
    yield "its value is plausible if it is in feet instead of metres: check the unit", item.frame, item.alt_m / _FOOT_M


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
        positions = positions_along(segment)
        lowest, _, begin = lowest_of(world, _bent_lines(pilot_m, positions))
        if lowest < -CHECKS.clearance_tolerance_m:
            what = f"hidden from the pilot and the radio: {what_hides} rise {-lowest:.0f} m above the line of sight"
            do = "choose another position (--pilot), fly higher, or use a spotter"
            found = segment.found("sight", -lowest, what=what, do=do, weight="look")
            hidden.append(found.at(world.geodetic(positions[begin])))
    return joined(hidden, lambda one: one.kind)


def _bent_lines(pilot_m: FloatArray, positions_m: FloatArray) -> Lines:
    """Lines from the pilot to (n, 3) positions, as radio waves observe the ground between them."""
    away = positions_m - pilot_m
    distances_m = np.hypot(away[:, 0], away[:, 1])
    owner, t = cut(np.maximum(2, np.ceil(distances_m / CHECKS.return_line_piece_m)).astype(np.int64))
    lines = pilot_m + t[:, None] * away[owner]
    lines[:, 2] += t * (1.0 - t) * distances_m[owner] ** 2 / (2.0 * MEAN_RADIUS_M) * _BENDING
    return with_gaps(lines, owner)

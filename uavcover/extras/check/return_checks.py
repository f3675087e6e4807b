"""Judge an autopilot's own returns from every part of the path, and the rally points, against all limits of the mission."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from mission_io.model.items import Command, Frame, FramedPoint, Mission
from uavcover.extras.check.findings import CheckFinding, FlownPath, Segment, Weight, along_m, positions_at
from uavcover.extras.check.tuning import CHECKS
from uavcover.extras.check.world import Aircraft, Limits, LocalFence, Surroundings, World
from uavcover.kernels.arrays import FloatArray, IntArray
from uavcover.missions.failsafe_checks import ReturnLimits, judge_paths, judge_returns
from uavcover.missions.failsafe_path import direct_return, wings_return
from uavcover.missions.failsafes import (
    IN_PLACE,
    Danger,
    Destinations,
    FailsafePaths,
    FailsafeSettings,
    FlightStates,
    UnsafeReturn,
    failsafe_settings,
)
from uavcover.model.limits import Obstacles
from uavcover.scenario.airspace.zones import ZoneCheck

_LANDING_STARTS = (188, 189)
"""DO_RETURN_PATH_START and DO_LAND_START."""
_KINDS: Mapping[Danger, str] = {"fence": "return-fence", "obstacle": "return-obstacle", "zone": "return-no-fly"}
_HEIGHT_NAMES = {("ardupilot", False): "RTL_ALT", ("ardupilot", True): "RTL_ALTITUDE"}


@dataclass(frozen=True, slots=True, kw_only=True)
class OwnReturn:
    """Known facts about the autopilot's own returns."""

    # of the vehicle, by the autopilot's names; what is missing has its default
    parameters: Mapping[str, float] = field(default_factory=dict)
    rally: Sequence[FramedPoint] = ()  # the rally points


def return_findings(
    mission: Mission, path: FlownPath, world: World, limits: Limits, aircraft: Aircraft, around: Surroundings, own: OwnReturn,
) -> list[CheckFinding]:  # fmt: skip
    """Parts of the path from which the autopilot's own return exceeds a limit, and rally points that do."""
    rally_m = _rally_positions(own.rally, world, aircraft)
    fence = allowed_area(around.fence)
    found = rally_findings(own.rally, rally_m, world, limits, fence, world.home_alt_amsl_m + aircraft.return_height_m)
    segments = [segment for segment in path.distinct if segment.phase == "route" and len(segment.known_m)]
    if not segments:
        return found
    settings = _settings(aircraft, own)
    states = _states(segments, world)
    ends = np.array([segment.known_m[-1] for segment in segments])
    to = Destinations(
        np.array([0.0, 0.0, world.home_alt_amsl_m]), rally_m, np.column_stack([ends[:, :2], world.alts_amsl_m(ends)]),
        fence, _landing(mission, segments, aircraft),
    )  # fmt: skip
    clearance_m = around.obstacle_clearance_m
    returns = ReturnLimits(
        frame=world.frame, heights=world, ground=world.ground, zones=ZoneCheck(around.zones, world.ground, world.frame),
        obstacles=Obstacles(clearance_beside_m=clearance_m, clearance_above_m=clearance_m), prisms=around.prisms, fence=fence,
        clearance_m=limits.min_height_agl_m,
    )  # fmt: skip
    if aircraft.has_wings:
        judged = judge_paths([_commanded(aircraft, settings, states, to, world)], settings, states, to, returns)
    else:
        judged = judge_returns(settings, states, to, returns)
    enough_m = judged.safe_return_height_m
    return found + [_finding(one, segments, world, settings, aircraft, enough_m) for one in judged.unsafe]


def mission_return(
    at_m: FloatArray, world: World, aircraft: Aircraft, own: OwnReturn, fence: LocalFence
) -> tuple[FailsafePaths, FailsafeSettings]:
    """The path of a RETURN_TO_LAUNCH item from rest at (3,) east, north, height above sea level; and its parameters."""
    settings = _settings(aircraft, own)
    home_m = np.array([0.0, 0.0, world.home_alt_amsl_m])
    to = Destinations(home_m, _rally_positions(own.rally, world, aircraft), at_m[None], allowed_area(fence))
    at_rest = FlightStates(at_m[None], np.zeros((1, 2)), np.zeros(1), np.zeros(1, np.int64))
    return _commanded(aircraft, settings, at_rest, to, world), settings


def _commanded(
    aircraft: Aircraft, settings: FailsafeSettings, states: FlightStates, to: Destinations, world: World
) -> FailsafePaths:
    def ground_alts_m(east_north_m: FloatArray) -> FloatArray:
        return world.alts_amsl_m(world.above_ground(east_north_m, 0.0))

    if not aircraft.has_wings:
        return direct_return(settings, states, to, ground_alts_m)
    climb, descent = (rate / aircraft.cruise_speed_m_s for rate in (aircraft.max_climb_m_s, aircraft.max_descent_m_s))
    return wings_return(settings, states, to, ground_alts_m, climb_slope=climb, descent_slope=descent)


def _states(segments: Sequence[Segment], world: World) -> FlightStates:
    """A moment every second along all segments."""
    positions, velocities, times, legs, ahead = [], [], [], [], []
    now = 0.0
    for number, segment in enumerate(segments):
        line = segment.known_m
        length_m = along_m(line)[-1]
        speed = max(segment.speed_m_s, 0.1)
        count = max(1, math.ceil(length_m / min(CHECKS.return_step_m, speed * CHECKS.return_step_s)))
        at = np.linspace(0.0, length_m, count + 1)
        here = positions_at(at, line)
        offset = np.gradient(here[:, :2], axis=0)
        length = np.maximum(np.hypot(*offset.T), 1e-9)[:, None]
        positions.append(here)
        velocities.append(np.where(length > 1e-6, offset / length * speed, 0.0))
        times.append(now + at / speed)
        ahead.append(np.maximum(0.0, length_m - at))
        legs.append(np.full(len(here), number))
        now += length_m / speed + segment.wait_s
    enu = np.vstack(positions)
    return FlightStates(
        np.column_stack([enu[:, :2], world.alts_amsl_m(enu)]), np.vstack(velocities), np.concatenate(times),
        np.concatenate(legs), np.concatenate(ahead),
    )  # fmt: skip


def _settings(aircraft: Aircraft, own: OwnReturn) -> FailsafeSettings:
    """The vehicle's parameters; what they leave open is as the aircraft has it, and so is the return height."""
    known = {
        "cruise_m_s": aircraft.cruise_speed_m_s, "climb_m_s": aircraft.max_climb_m_s, "descent_m_s": aircraft.max_descent_m_s,
        "return_height_m": aircraft.return_height_m,
    }  # fmt: skip
    if aircraft.has_wings and aircraft.autopilot == "ardupilot":
        known |= {"rally_limit_m": 5000.0, "rally_with_home": 0.0}
    settings = failsafe_settings(aircraft.autopilot, own.parameters, known=known)
    return replace(settings, values={**settings.values, "return_height_m": aircraft.return_height_m})


def _landing(mission: Mission, segments: Sequence[Segment], aircraft: Aircraft) -> int | None:
    """The segment at whose end the mission's landing begins, as the autopilot understands it."""
    starts = _LANDING_STARTS
    if aircraft.autopilot == "px4":
        starts = (189, int(Command.NAV_LAND))
    number = next((n for n, item in enumerate(mission.items, 1) if item.command in starts), None)
    if number is None:
        return None
    return next((k for k, segment in enumerate(segments) if segment.items[1] >= number), len(segments) - 1)


def _finding(
    one: UnsafeReturn, segments: Sequence[Segment], world: World, settings: FailsafeSettings, aircraft: Aircraft,
    enough_m: float,
) -> CheckFinding:  # fmt: skip
    name = _HEIGHT_NAMES.get((aircraft.autopilot, aircraft.has_wings), "RTL_RETURN_ALT")
    assumed, height = "", "use elevation data that covers the returns"
    if aircraft.return_height_from:
        assumed = f"; {name} is assumed to be {aircraft.return_height_from}, {settings['return_height_m']:g} m"
    if enough_m < CHECKS.far_m:
        height = f"set {name} to {math.ceil(enough_m)} m or more, and specify it with --return-height"
    do = {
        "terrain": height,
        "descent": "raise the rally point, or the height at which the return ends, above the ground there",
        "unknown ground": "use elevation data that covers the returns",
        "obstacle": f"set a higher {name} and specify it with --return-height, or take off elsewhere",
        "fence": "enlarge the fence, or end the mission with a return transit and disable automatic returns",
        "zone": "take off elsewhere, choose another return altitude, or end the mission with a return transit",
        "battery": "plan a shorter mission, or add a rally point",
    }[one.danger]
    by = one.limit - one.value if one.danger in ("terrain", "descent") else one.value
    # Over a house it lands on the house, in any mission: for the pilot to know.
    weight: Weight = (
        "look" if one.destination == IN_PLACE else "unknown" if one.danger == "unknown ground" else "breaks"
    )
    why = ", ".join(str(response) for response in one.responses)
    first, last = segments[one.first_leg].items[0], segments[one.last_leg].items[1]
    return CheckFinding(
        kind=_KINDS.get(one.danger, "return"), weight=weight, items=(first, last), by=max(by, 0.0), unit="m",
        what=f"{one.what} after {one.begin_s:.0f} to {one.end_s:.0f} s of the route; return: {why}{assumed}", do=do,
    ).at(world.geodetic(one.position_m))  # fmt: skip


def allowed_area(fence: LocalFence) -> shapely.Geometry | None:
    """The area that a fence leaves; None without a fence."""
    if fence == LocalFence():
        return None
    circles = [(shapely.Point(e, n).buffer(r, quad_segs=256), stays) for e, n, r, stays in fence.circles]
    inside: list[BaseGeometry] = [*fence.inside, *(circle for circle, stays in circles if stays)]
    area: BaseGeometry = shapely.box(-CHECKS.far_m, -CHECKS.far_m, CHECKS.far_m, CHECKS.far_m)
    if inside:
        area = shapely.union_all(inside) if fence.any_inside else shapely.intersection_all(inside)
    outside = [*fence.outside, *(circle for circle, stays in circles if not stays)]
    return area.difference(shapely.union_all(outside)) if outside else area


def _rally_positions(rally: Sequence[FramedPoint], world: World, aircraft: Aircraft) -> FloatArray:
    """(r, 3) east, north, height above sea level; NaN for one that the autopilot does not take."""
    positions = np.full((len(rally), 3), np.nan)
    for k, point in enumerate(rally):
        en = world.position(point.lat_deg, point.lon_deg)
        if point.frame is Frame.AMSL:
            up = point.alt_m
        elif point.frame is Frame.ABOVE_TERRAIN:
            ground = world.alts_amsl_m(world.above_ground([en], 0.0))[0]
            up = float(ground) + point.alt_m if aircraft.autopilot == "ardupilot" else math.nan
        else:
            up = world.home_alt_amsl_m + point.alt_m
        positions[k] = (*en, up)
    return positions


def rally_findings(
    rally: Sequence[FramedPoint], rally_m: FloatArray, world: World, limits: Limits, fence: shapely.Geometry | None,
    return_alt_amsl_m: float,
) -> list[CheckFinding]:  # fmt: skip
    """Rally points inside the ground, at the wrong reference of heights, or outside the fence.

    Args:
        rally: as given.
        rally_m: (r, 3) the same: east, north, height above sea level.
        world: the ground.
        limits: with the largest height above ground.
        fence: allowed area.
        return_alt_amsl_m: where it returns anyway; a rally point is never too high below it.
    """
    found = []
    ground = world.alts_amsl_m(world.above_ground(rally_m[:, :2], 0.0)) if len(rally) else np.empty(0)
    for number, (point, (east, north, alt), at) in enumerate(zip(rally, rally_m, ground, strict=True), 1):
        high = alt - at
        highest = max(limits.max_height_agl_m or math.inf, return_alt_amsl_m - at)
        amsl = point.frame is Frame.ABOVE_HOME and abs(point.alt_m - at) <= highest < high
        where = (point.lat_deg, point.lon_deg, float(alt) if math.isfinite(alt) else world.home_alt_amsl_m)
        problems: list[tuple[Weight, float, str, str]] = []
        if not math.isfinite(high):
            problems.append(("unknown", 0.0, "its height, or the ground height there, is unknown", "specify both"))
        elif high < -CHECKS.ground_tolerance_m:
            problems.append(("breaks", -high, f"it is {-high:.0f} m below the ground", "use a height above the ground"))
        elif amsl:
            what = f"{point.alt_m:.0f} m above home is {high:.0f} m above ground; the value seems to be a height above sea level"
            problems.append(("breaks", high - highest, what, "specify it above home (frame 3), or in frame 0"))
        elif high > highest:
            problems.append(("breaks", high - highest, f"it is {high:.0f} m above ground", "use a lower height"))
        if fence is not None and not bool(shapely.covers(fence, shapely.Point(east, north))):
            away = float(shapely.distance(fence, shapely.Point(east, north)))
            problems.append(("breaks", away, f"it is {away:.0f} m outside the fence", "move it inside the fence"))
        for weight, by, what, do in problems:
            one = CheckFinding(
                kind="rally", weight=weight, by=float(by), unit="m", what=f"rally point {number}: {what}", do=do
            )
            found.append(one.at(where))
    return found


def positions_along(segment: Segment) -> FloatArray:
    """(n, 3) positions of a segment, ``CHECKS.return_line_step_m`` apart or nearer."""
    line = segment.known_m
    if len(line) < 2:
        return line
    reached = along_m(line)
    count = max(1, math.ceil(reached[-1] / CHECKS.return_line_step_m))
    at = np.union1d(np.linspace(0.0, reached[-1], count + 1), reached if len(line) <= 3 else reached[[0, -1]])
    return positions_at(at, line)


@dataclass(frozen=True, eq=False, slots=True)
class Lines:
    """Many lines in one array, so that each question about them is asked once."""

    points_m: FloatArray  # (m, 3) ENU; a row of NaN ends each line
    owner: IntArray  # (m,) number of the line that a row belongs to

    def __add__(self, other: "Lines") -> "Lines":
        """Lines of both, those of the same number beside each other."""
        owner = np.concatenate([self.owner, other.owner])
        order = np.argsort(owner, kind="stable")
        return Lines(np.vstack([self.points_m, other.points_m])[order], owner[order])


def cut(pieces: IntArray) -> tuple[IntArray, FloatArray]:
    """For lines of ``pieces`` (n,) pieces: the line number and the fraction 0..1 of each of their points, ends included."""
    ends = np.repeat(pieces, pieces + 1)
    owner = np.repeat(np.arange(len(pieces)), pieces + 1)
    begins = np.cumsum(pieces + 1) - (pieces + 1)
    k = np.arange(len(owner)) - begins[owner]
    return owner, np.where(k == ends, 1.0, k * (1.0 / ends))


def with_gaps(points_m: FloatArray, owner: IntArray) -> Lines:
    """Points (m, 3) of lines, by their numbers (m,) in order, as lines."""
    last = np.flatnonzero(np.diff(owner, append=-1)) + 1
    return Lines(np.insert(points_m, last, np.nan, axis=0), np.insert(owner, last, owner[last - 1]))


def lowest_of(world: World, lines: Lines) -> tuple[float, FloatArray, int]:
    """Least height above ground of some lines, its position, and the line number; infinite if no height is known."""
    points = lines.points_m
    if len(points) < 2:
        return math.inf, np.zeros(3), 0
    ranges = world.leg_height_ranges_m(points)
    if not np.isfinite(ranges[:, 0]).any():
        return math.inf, np.zeros(3), 0
    k = int(np.nanargmin(ranges[:, 0]))
    position = points[k] + ranges[k, 1] * (points[k + 1] - points[k])
    return float(ranges[k, 0]), position, int(lines.owner[k])

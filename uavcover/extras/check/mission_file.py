"""The workflow of ``uavcover check``: somebody's mission file and elevation data in, findings out."""

import contextlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

from mission_io.errors import FormatError
from mission_io.formats import csv_tables, files, plan, wpml
from mission_io.formats.csv_tables import words_of
from mission_io.formats.text import doubts_about_fence, text_from_bytes
from mission_io.model.enums import AutopilotId, VehicleKind, kind_of
from mission_io.model.items import Command, Fence, FramedPoint, Mission
from mission_io.model.plain_text import counted
from uavcover.cli.new import ElevationData
from uavcover.errors import InputError, ScenarioError
from uavcover.extras.check.check import Checked, CheckRequest, check_mission
from uavcover.extras.check.check_elevation import ROUTE_SUFFIXES, open_check_elevation, read_route_file
from uavcover.extras.check.clearance_checks import with_obstacles
from uavcover.extras.check.findings import CheckFinding
from uavcover.extras.check.planned_view import MissionView, ViewQuery, planned_view
from uavcover.extras.check.return_checks import OwnReturn
from uavcover.extras.check.world import (
    BANK_DEG,
    KINDS,
    Aircraft,
    FenceSource,
    Kind,
    Limits,
    default_aircraft,
    radius_of_bank_m,
)
from uavcover.missions.failsafes import failsafe_settings
from uavcover.model.limits import NoFly, Obstacle, window_of
from uavcover.model.vehicle import AutopilotName, autopilot_name
from uavcover.model.verdict import VerdictName
from uavcover.new.catalog import VEHICLES, VehicleType
from uavcover.run.user import User
from uavcover.scenario.airspace.zone_file import read_zones
from uavcover.scenario.areas.area_file import AreaQuery, read_area
from uavcover.scenario.obstacles import read_obstacles
from uavcover.scenario.scenario_file import load_scenario
from uavcover.terrain.frames import Bounds, LocalFrame
from uavcover.terrain.ground import Ground

MISSION_SUFFIXES = (".plan", ".waypoints", ".txt", ".mission", ".csv", *ROUTE_SUFFIXES)
_MOST_POINTS = {
    ".csv": (csv_tables.LITCHI_WAYPOINTS, "Litchi"),
    ".kmz": (wpml.MOST_POINTS, "WPML"),
    ".wpml": (wpml.MOST_POINTS, "WPML"),
}
_FENCE_FILES = (".plan", ".waypoints", ".txt", ".fen")


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckQuery:
    """Request of the user."""

    file: Path  # the mission
    elevation: ElevationData  # the elevation data of the ground
    surface: tuple[str, ...] = ()  # files of a surface model, with trees and roofs, that flights keep clear of too
    fence: Path | None = None  # file of a fence, or of an area to stay inside; None: the mission file's own
    rally: Path | None = None  # file of rally points; None: the mission file's own
    parameters: Path | None = None  # file of the vehicle's parameters; None: the autopilot's defaults
    no_fly: tuple[str, ...] = ()  # files of no-fly zones
    flight_window_utc: tuple[str, str] | None = None  # when it is flown; None: at any time
    vehicle: str | None = None  # a vehicle by name; None: the autopilot's defaults
    autopilot: str | None = None  # "ardupilot" or "px4"; None: the file's, or ArduPilot
    kind: str | None = None  # how the aircraft moves; None: the file's, or what its commands suggest
    home: tuple[float, float] | None = None  # take-off position; None: the file's
    pilot: tuple[float, float] | None = None  # where the pilot stands; None: at home
    return_height_m: float | None = None  # the autopilot's return altitude above home; None: its default
    speed_m_s: float | None = None  # None: the vehicle's
    bank_deg: float | None = None  # of wings in turns; None: the autopilot's default
    endurance_s: float | None = None  # None: the vehicle's
    reserve_fraction: float = 0.2  # of the endurance
    limits: Limits = field(default_factory=Limits)  # of heights, distance and wind
    view: ViewQuery | None = None  # the required coverage; None: not checked
    obstacles: Path | None = None  # file of obstacles with heights
    most_items: int | None = None  # that the vehicle or its controller takes; None: not judged
    trust_dem: bool = False  # whether heights are taken as they are where they do not look like ground


@dataclass(frozen=True, eq=False, slots=True)
class CheckOutcome:
    """Result of a check."""

    checked: Checked  # the findings, also of what would be observed, and the path
    aircraft: Aircraft  # whose speeds and returns were counted on
    view: MissionView | None = None  # the expected coverage; None where it is not checked, or nothing is flown

    @property
    def verdict(self) -> VerdictName:
        """Passed, failed or not proved."""
        return self.checked.verdict


@dataclass(frozen=True, slots=True)
class ReadMission:
    """A mission file as it is judged."""

    mission: Mission  # its mission
    fence: Fence | None = None  # its fence, None where it has none
    autopilot: AutopilotName | None = None  # whom it was made for; None: it does not say
    kind: Kind | None = None  # of aircraft; None: it does not say
    repairs: tuple[str, ...] = ()  # what was repaired to read it
    return_height_m: float | None = None  # above home, where the file states it
    speed_m_s: float | None = None  # cruise speed, where the file states it
    points: tuple[int, ...] = ()  # of a route, the item that each of its points became
    # latitude and longitude of a home without a height, which is none to ``mission``
    home: tuple[float, float] | None = None
    rally: tuple[FramedPoint, ...] = ()  # its rally points


def check(query: CheckQuery, user: User) -> CheckOutcome:
    """Read the inputs, judge the mission, and propose repairs.

    Raises:
        UavcoverError: a file cannot be read or used.
        FormatError: the mission file is none.
    """
    read = read_mission_file(query.file)
    query = _with_files_beside(query, read)
    for repair in read.repairs:
        user.warn(f"{query.file}: repaired: {repair}")
    if read.points:
        user.say(
            f"point 1 of {query.file} is item {read.points[0]}, and the last point ({len(read.points)}) is item {read.points[-1]}"
        )
    if read.fence is not None:
        for doubt in doubts_about_fence(read.fence):
            user.warn(f"{query.file}: doubtful: {doubt}")
    if not read.mission.items:
        raise InputError(f"{query.file}: the mission has no items; use a file with mission items")
    aircraft = aircraft_of(query, read)
    home = read.home if query.home is None else query.home
    elevation = open_check_elevation(query.elevation, query.surface, read.mission, home, user, trusted=query.trust_dem)
    request = CheckRequest(
        mission=read.mission, aircraft=aircraft, limits=query.limits, home=home, pilot=query.pilot,
        fence=read.fence if query.fence is None else _read_fence(query.fence),
        obstacles=_read_obstacles(query.obstacles), own_return=own_return_of(query, read),
    )  # fmt: skip

    def zones(near: Bounds) -> Sequence[NoFly]:
        found: list[NoFly] = []
        for file in query.no_fly:
            entries, notes = read_zones(NoFly(file=str(Path(file).resolve())), near=near)
            found += entries
            for note in notes:
                user.say(note)
        requested = query.flight_window_utc
        window = None if requested is None else window_of(*requested, "--at")
        counting = [zone for zone in found if zone.in_force(window)]
        timed = sum(zone.has_times for zone in counting)
        if len(counting) < len(found):
            ignored = len(found) - len(counting)
            verb = "was" if ignored == 1 else "were"
            user.say(f"{ignored} of {counted(len(found), 'no-fly zone')}, inactive at that time, {verb} ignored")
        elif timed and window is None:
            zones = counted(timed, "no-fly zone has a schedule, but was", "no-fly zones have schedules, but were")
            user.say(f"{zones} treated as always active; give the time with --at")
        return counting

    surface = None if elevation.over is None else elevation.read_surface
    checked = check_mission(
        request, elevation.heights_amsl_m, elevation.read_ground, zones, surface, doubt=elevation.doubt
    )
    checked = checked.with_findings(_too_many(query, read))
    if query.view is None:
        return CheckOutcome(checked, aircraft)
    obstacles = request.obstacles, query.limits.obstacle_clearance_m

    def looked_at(frame: LocalFrame, bounds_m: Bounds) -> tuple[Ground, Ground | None]:
        bare = elevation.read_ground(frame, bounds_m)
        higher = None if elevation.over is None else elevation.read_higher(frame, bounds_m, bare)
        top, _ = with_obstacles(higher or bare, obstacles[0], frame, bounds_m, obstacles[1], foot=bare)
        return top, None if higher is None else bare

    view = planned_view(query.view, read.mission, checked, aircraft, looked_at)
    return CheckOutcome(checked if view is None else checked.with_findings(view.findings), aircraft, view)


def own_return_of(query: CheckQuery, read: ReadMission) -> OwnReturn:
    """Parameters and rally points for the autopilot's own returns."""
    return OwnReturn(
        parameters={} if query.parameters is None else read_parameter_file(query.parameters),
        rally=read.rally if query.rally is None else _read_rally(query.rally),
    )


def _with_files_beside(query: CheckQuery, read: ReadMission) -> CheckQuery:
    """The query with the fence and the rally points that a run folder has beside its ``mission.waypoints``."""
    if read.fence is not None or read.rally or planned_vehicle(query.file) is None:
        return query
    fence, rally = (query.file.with_name(name) for name in ("fence.waypoints", "rally.waypoints"))
    return replace(
        query, fence=query.fence or (fence if fence.is_file() else None),
        rally=query.rally or (rally if rally.is_file() else None),
    )  # fmt: skip


def _too_many(query: CheckQuery, read: ReadMission) -> list[CheckFinding]:
    """Whether the vehicle, or the controller that the file is for, accepts this number of items or points."""
    found = []
    controller = _MOST_POINTS.get(query.file.suffix.lower())
    if read.points and controller is not None and len(read.points) > controller[0]:
        most, name = controller
        found.append(
            (f"the mission has {len(read.points)} points, but {name} accepts at most {most}", len(read.points) - most)
        )
    count = len(read.mission.items)
    if query.most_items is not None and count > query.most_items:
        found.append((f"the mission has {count} items; the limit is {query.most_items}", count - query.most_items))
    do = "split it with --fix --max-items N -o FILE"
    return [CheckFinding(kind="items", weight="breaks", by=float(over), what=what, do=do) for what, over in found]


def read_mission_file(path: Path) -> ReadMission:
    """Read a mission of any known format.

    Raises:
        InputError: there is no such file, or it is of no known format.
        FormatError: it is not what its name says.
    """
    if not path.is_file():
        raise InputError(f"{path}: {'is a folder' if path.is_dir() else 'no such file'}; use a mission file")
    suffix = path.suffix.lower()
    if suffix not in MISSION_SUFFIXES:
        raise InputError(f"{path}: {suffix or 'no suffix'} is not supported; use one of {', '.join(MISSION_SUFFIXES)}")
    route = read_route_file(path)
    if route is not None:
        return ReadMission(
            route.mission, kind="multirotor", repairs=route.repairs, return_height_m=route.return_height_m,
            speed_m_s=route.speed_m_s, points=route.numbers,
        )  # fmt: skip
    if suffix == ".plan":
        try:
            decoded = text_from_bytes(path.read_bytes())
            document = plan.read(decoded.text)
        except FormatError as error:
            raise FormatError(
                error.what, where=f"{path}: {error.where}" if error.where else str(path), advice=error.advice
            ) from error
        fence = document.fence if document.fence != Fence() else None
        return ReadMission(
            document.mission, fence, _autopilot_of(document.mav_autopilot), _kind_of(document.vehicle_type, document.mission),
            (*decoded.repairs, *document.repairs), home=_home_without_height(document), rally=document.rally.points,
        )  # fmt: skip
    read = files.read_file(path)
    if read.mission is None:
        raise InputError(f"{path}: the file contains a fence or rally points, but no mission; use it with --fence")
    return ReadMission(read.mission, None, None, _kind_of(None, read.mission), read.repairs)


def _home_without_height(document: plan.PlanFile) -> tuple[float, float] | None:
    """Start of a plan whose home has no height, as QGroundControl saves it without terrain data: the ground there counts."""
    home = document.extras.get("mission", {}).get("plannedHomePosition")
    return (float(home[0]), float(home[1])) if document.mission.home is None and isinstance(home, list) else None


def aircraft_of(query: CheckQuery, read: ReadMission) -> Aircraft:
    """The aircraft: the autopilot's defaults, over them data sheet or plan, the vehicle's parameters, the user's own values.

    Raises:
        InputError: a name is not known.
    """
    planned = planned_vehicle(query.file)
    vehicle = planned if query.vehicle is None else VEHICLES.named(query.vehicle)
    stated = vehicle.autopilot if vehicle is not None else None
    autopilot = autopilot_name(query.autopilot, stated or read.autopilot or "ardupilot")
    kind: Kind = read.kind or "multirotor"
    if query.kind is not None:
        kinds: dict[str, Kind] = {name: name for name in KINDS}
        if query.kind not in kinds:
            raise InputError(f"--flies-as: unknown vehicle type {query.kind!r}; use {', '.join(KINDS)}")
        kind = kinds[query.kind]
    own = default_aircraft(autopilot, kind)
    sheet = vehicle or VehicleType("", "")
    known = {} if query.parameters is None else _set_by(read_parameter_file(query.parameters), autopilot, own)

    def first(*values: float | None, default: float) -> float:
        return next((value for value in values if value is not None), default)

    cruise_m_s = first(
        query.speed_m_s, read.speed_m_s, known.get("cruise_m_s"), sheet.cruise_speed_m_s, default=own.cruise_speed_m_s
    )
    bank_deg = BANK_DEG[autopilot] if query.bank_deg is None else query.bank_deg
    parts = ["your options"] * (query.speed_m_s is not None) + [str(query.parameters)] * any(
        name.endswith("_m_s") for name in known
    )
    parts += [sheet.title] if vehicle is not None else []
    stated_m = (query.return_height_m, known.get("return_height_m"), read.return_height_m)
    planned_m = None if planned is None else planned.return_height_m
    return_height_from = own.return_height_from if planned_m is None else "as planned"
    return replace(
        own,
        speeds_from=", then ".join([*parts, f"the defaults of {'PX4' if autopilot == 'px4' else 'ArduPilot'}"]),
        cruise_speed_m_s=cruise_m_s,
        turn_radius_m=radius_of_bank_m(cruise_m_s, bank_deg) if own.has_wings else 0.0,
        acceptance_m=own.acceptance_m * (cruise_m_s / own.cruise_speed_m_s if own.has_wings else 1.0),
        max_climb_m_s=first(known.get("climb_m_s"), sheet.max_climb_m_s, default=own.max_climb_m_s),
        max_descent_m_s=first(known.get("descent_m_s"), sheet.max_descent_m_s, default=own.max_descent_m_s),
        max_airspeed_m_s=sheet.max_speed_m_s,
        return_height_m=first(*stated_m, planned_m, default=own.return_height_m),
        return_height_from=return_height_from if stated_m == (None, None, None) else "",
        endurance_s=query.endurance_s if query.endurance_s is not None else sheet.endurance_s,
        reserve_fraction=query.reserve_fraction,
    )


_NOT_SET: Mapping[str, float] = MappingProxyType(
    dict.fromkeys(("cruise_m_s", "climb_m_s", "descent_m_s", "return_height_m"), math.nan)
)
_PLANE_RETURN: Mapping[str, float] = MappingProxyType({"ALT_HOLD_RTL": 0.01, "RTL_ALTITUDE": 1.0})
"""ArduPlane's names of the return height, newest last, each with the factor to metres."""


def _set_by(parameters: Mapping[str, float], autopilot: AutopilotName, own: Aircraft) -> dict[str, float]:
    """Speeds and return height that a vehicle's parameters set, by the names in ``data/failsafes.toml``."""
    values = failsafe_settings(autopilot, parameters, known=_NOT_SET).values
    if own.has_wings:
        plane = [parameters[name] * scale for name, scale in _PLANE_RETURN.items() if name in parameters]
        height_m = values["return_height_m"] if autopilot == "px4" else (plane or [math.nan])[-1]
        values = {"return_height_m": height_m}
    return {name: values[name] for name in _NOT_SET if math.isfinite(values.get(name, math.nan))}


def planned_vehicle(mission: Path) -> VehicleType | None:
    """The vehicle that a run's mission file was planned for, from the scenario beside it; None for other files.

    Raises:
        ScenarioError: the scenario cannot be used.
    """
    folder = mission.resolve().parent
    if not (folder / "plan.json").is_file() or not (folder / "scenario.toml").is_file():
        return None
    scenario = load_scenario(folder / "scenario.toml")
    own = scenario.vehicle
    return VehicleType(
        name="plan", title=f"the plan in {mission.parent}", endurance_s=own.endurance_s, autopilot=own.autopilot,
        cruise_speed_m_s=own.cruise_speed_m_s, max_speed_m_s=own.max_airspeed_m_s, max_climb_m_s=own.max_climb_m_s,
        max_descent_m_s=own.max_descent_m_s, acceleration_m_s2=own.acceleration_m_s2,
        return_height_m=own.return_height_m,
    )  # fmt: skip


def _autopilot_of(mav_autopilot: int) -> AutopilotName | None:
    return {int(AutopilotId.ARDUPILOT): "ardupilot", int(AutopilotId.PX4): "px4"}.get(mav_autopilot)  # type: ignore[return-value]


def _kind_of(vehicle_type: int | None, mission: Mission) -> Kind | None:
    if vehicle_type is not None:
        named: dict[VehicleKind, Kind] = {VehicleKind.PLANE: "fixed-wing", VehicleKind.VTOL: "vtol"}
        kind = named.get(kind_of(vehicle_type))
        if kind is not None:
            return kind
    commands = {item.command for item in mission.items}
    if commands & {Command.NAV_VTOL_TAKEOFF, Command.NAV_VTOL_LAND}:
        return "vtol"
    return "multirotor" if vehicle_type is not None else None


def _read_obstacles(path: Path | None) -> tuple[Obstacle, ...]:
    if path is None:
        return ()
    if not path.is_file():
        raise InputError(f"--obstacles: {path}: no such file; use polygons with heights (.geojson, .kml)")
    try:
        return read_obstacles(path)
    except (ScenarioError, InputError) as error:
        raise InputError(f"--obstacles: {str(error).removeprefix('obstacles.file: ')}") from error


def _read_rally(path: Path) -> tuple[FramedPoint, ...]:
    read = files.read_file(path) if path.is_file() else None
    if read is None or read.rally is None:
        raise InputError(
            f"--rally: {path}: {'no such file' if read is None else 'the file contains no rally points'}; use a rally file"
        )
    return read.rally.points


def read_parameter_file(path: Path) -> dict[str, float]:
    """Read a parameter file of a ground station: a name and a number a line, or QGroundControl's five columns.

    Raises:
        InputError: there is no such file, or a line is neither.
    """
    if not path.is_file():
        raise InputError(f"--parameters: {path}: no such file; use a parameter file saved by a ground station")
    found: dict[str, float] = {}
    for number, line in enumerate(text_from_bytes(path.read_bytes()).text.splitlines(), 1):
        content = line.split("#")[0].strip()
        if not content:
            continue
        words: tuple[str, ...] = ()
        for count in (2, 5):
            with contextlib.suppress(FormatError):
                words = words or words_of(content, count).words
        name, value = (words[2], words[3]) if len(words) == 5 else words if len(words) == 2 else ("", "")
        try:
            found[name] = float(value)
        except ValueError:
            raise InputError(
                f"--parameters: {path}: line {number}: {line.strip()!r} is not a name and a number"
            ) from None
    return found


def _read_fence(path: Path) -> FenceSource:
    if path.suffix.lower() in _FENCE_FILES:
        if not path.is_file():
            raise InputError(f"--fence: {path}: no such file; use a fence or an area")
        read = files.read_file(path)
        if read.fence is None or read.fence == Fence():
            raise InputError(
                f"--fence: {path}: the file contains no fence; use a file with a fence, or with an area that the vehicle "
                "must stay inside"
            )
        return read.fence
    return read_area(AreaQuery(source=str(path))).parts

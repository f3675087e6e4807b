"""The chosen route of a run as files for other software: missions, and flights for controllers that take few points."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from mission_io.formats.csv_tables import LITCHI_WAYPOINTS, write_litchi
from mission_io.formats.files import FORMATS
from mission_io.formats.point_route import CameraFlight, camera_flight
from mission_io.formats.wpml import AbsoluteHeights, DjiAircraft, write_kmz
from uavcover.errors import InfeasibleError, InputError, OutputError, TerrainError
from uavcover.kernels.flight_time import landing_time, leg_times, takeoff_time
from uavcover.missions.flights import compile_flights, compile_sorties, export_content
from uavcover.missions.mission_compiler import CompiledMission, Sortie, compile_mission
from uavcover.missions.path_cost import longest_flight_text
from uavcover.missions.return_advice import ReturnAdvice
from uavcover.model.area import RasterTerrain
from uavcover.model.route import Route
from uavcover.model.vehicle import AutopilotName
from uavcover.plugins import registered
from uavcover.run.documents import read_planned
from uavcover.run.file_group import numbered, settle
from uavcover.run.folder import RunFolder
from uavcover.scenario.site import Site
from uavcover.scenario.vehicles import pace_of
from uavcover.terrain.frames import Undulation

CONTROLLER_POINTS: Final[Mapping[str, int]] = {"wpml": 200, "litchi": LITCHI_WAYPOINTS}
"""Formats of controllers that fly points, stopping at each, and how many points they are given unless the user says.

DJI's controllers are reported to take 100 to 250 points, Litchi takes 99 (:mod:`mission_io.formats.csv_tables`).
"""
_FEWEST_POINTS = 4
"""Above home, a leg, above home again."""


def mission_formats() -> tuple[str, ...]:
    """The formats of missions and flights, those of third parties last."""
    return (*FORMATS, *CONTROLLER_POINTS, *registered("uavcover.exporters"))


TAKEOFF_HEIGHTS: Final = "takeoff"
ELLIPSOID_HEIGHTS: Final = "ellipsoid"


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportRequest:
    """Request of an export."""

    file_format: str  # one of `mission_formats`
    out: Path  # the file to write; several files have numbers before the suffix
    sortie: int | None = None  # which flight of a plan that is flown as several; None: all, one file each
    autopilot: AutopilotName | None = None  # for whom; default: the scenario's
    most_points: int | None = None  # how many points a file may have; None: as many as the format's controller takes
    aircraft: DjiAircraft | None = None  # for ``wpml``, and for ``print``: what flies it
    # for ``wpml``: "takeoff", above the place of take-off, or "ellipsoid", above the ellipsoid of WGS 84
    heights: str = TAKEOFF_HEIGHTS
    force: bool = False  # whether files are replaced

    @property
    def stops(self) -> bool:
        """Whether it is flown by a controller that stops at each point."""
        return self.file_format in CONTROLLER_POINTS or self.aircraft is not None


@dataclass(frozen=True, slots=True)
class FlightFile:
    """A flight in a format."""

    content: bytes  # of the file
    items: int  # mission items, or points for controllers that fly points
    flight_time_s: float  # from take-off to landing
    highest_m: float  # its highest point above home
    photos: bool | None = None  # whether a controller's file takes photos; None for missions, whose items say it
    warnings: tuple[str, ...] = ()  # what a pilot has to know who lets a controller return by itself, one line each
    return_height_m: float | None = None  # height above home for a return by the controller itself; None for missions


@dataclass(frozen=True, slots=True)
class ExportedFile:
    """A file that was written: where, and its flight."""

    path: Path
    flight: FlightFile


def export_mission(run: RunFolder, request: ExportRequest) -> tuple[ExportedFile, ...]:
    """Write the chosen route of a run to one file, or to one file for each flight.

    Each of them takes off and lands at home on legs that are checked like those of sorties. All files are written, or none.

    Raises:
        InputError: the run, the format or an option cannot be used.
        OutputError: a file already exists, would be left over from an older export, or cannot be written.
        InfeasibleError: a leg exceeds a limit, or no flight of so few points reaches a part of the route.
        mission_io.errors.FormatError: the format cannot express the mission.
    """
    _check(request)
    site, planned = read_planned(run if request.sortie is None else run.flight(request.sortie))
    refuse_unlike(site, run, request.sortie)
    flights = flight_files(site, planned.route, request, vehicles=planned.vehicles)
    names = [request.out.name if len(flights) == 1 else numbered(request.out, k + 1) for k in range(len(flights))]
    several = request.stops or request.most_points is not None or len(flights) > 1
    older = _names_of_older_exports(request.out) if several else []
    contents = {name: flight.content for name, flight in zip(names, flights, strict=True)}
    write_exported(request.out, contents, force=request.force, older=older)
    return tuple(ExportedFile(request.out.parent / name, flight) for name, flight in zip(names, flights, strict=True))


def refuse_unlike(site: Site, run: RunFolder, sortie: int | None) -> None:
    """Refuse one export of flights from several homes. Raises InputError: the vehicles of the site differ."""
    if sortie is None and site.scenario.vehicles:
        raise InputError(
            f"{run}: the vehicles differ, so each flight has its own home; export one flight at a time, with --sortie N"
        )


def flight_files(site: Site, route: Route, request: ExportRequest, *, vehicles: int = 1) -> list[FlightFile]:
    """The contents of the files of an export, one for each flight; errors as of :func:`export_mission`."""
    autopilot = request.autopilot or site.scenario.vehicle.autopilot
    if request.stops or request.most_points is not None or request.sortie is None:
        flights = [sortie.compiled for sortie in flights_for(site, route, request, vehicles=vehicles)]
    else:
        flights = [compile_mission(site, route, autopilot=autopilot)]
    name = site.scenario.name
    titles = [name if len(flights) == 1 else f"{name}, flight {k + 1}" for k in range(len(flights))]
    return [
        _flight_file(site, compiled, request, autopilot, title) for compiled, title in zip(flights, titles, strict=True)
    ]


def flights_for(site: Site, route: Route, request: ExportRequest, *, vehicles: int = 1) -> Sequence[Sortie]:
    """The flights of a route for the target of a request: the same for its files and for its page on paper.

    Raises:
        InfeasibleError: a leg exceeds a limit, or no flight of so few points reaches a part of the route.
    """
    autopilot = request.autopilot or site.scenario.vehicle.autopilot
    if request.stops:
        return _flights_with_stops(site, route, request, autopilot, vehicles)
    if request.most_points is None:
        return compile_flights(site, route, autopilot=autopilot, vehicles=vehicles)
    return compile_sorties(site, route, autopilot=autopilot, most_points=request.most_points, vehicles=vehicles)


def write_exported(out: Path, contents: Mapping[str, bytes], *, force: bool, older: Sequence[str] = ()) -> None:
    """Write the files of an export beside each other, all or none.

    Args:
        out: the requested file.
        contents: the files by their names.
        force: whether files that are there are replaced.
        older: names of files that must be replaced, or they would be taken for parts of this export.

    Raises:
        OutputError: a file already exists and ``force`` is not set, one of an older export would be left, or one cannot be
            written; then all is as it was.
    """
    folder = RunFolder(out.parent)
    with folder.reserved(contents, force=force):
        left = [name for name in older if name not in contents]
        if left:
            raise OutputError(
                f"{out.parent / left[0]}: this file belongs to another export and could be mistaken for a part of "
                f"this one ({', '.join(contents)}); delete it, or choose another name"
            )
        try:
            folder.write_together(contents)
        finally:
            settle(
                folder.path
            )  # an interrupted group is finished or undone here: no later command opens this folder as a run


def _names_of_older_exports(out: Path) -> list[str]:
    first = 1
    found = [out.name] if out.exists() else []
    while (out.parent / numbered(out, first)).exists():
        found.append(numbered(out, first))
        first += 1
    return found


def _check(request: ExportRequest) -> None:
    if request.file_format not in mission_formats():
        raise InputError(f"--format: {request.file_format!r} is not one of {', '.join(mission_formats())}")
    if request.file_format == "wpml" and request.aircraft is None:
        raise InputError("--format wpml requires an aircraft, such as --drone dji-m3e; see export --drone list")
    if request.file_format != "wpml" and request.aircraft is not None:
        raise InputError(f"--drone: this option requires --format wpml, not {request.file_format}")
    if request.heights not in (TAKEOFF_HEIGHTS, ELLIPSOID_HEIGHTS):
        raise InputError(f"--heights: must be takeoff or ellipsoid, not {request.heights!r}")
    if request.heights == ELLIPSOID_HEIGHTS and request.file_format != "wpml":
        raise InputError(f"--heights ellipsoid: this option requires --format wpml, not {request.file_format}")
    if request.file_format == "wpml" and request.out.suffix.lower() != ".kmz":
        raise InputError(
            f"-o: {request.out} is not a .kmz file, which DJI's apps require; use a name such as mission.kmz"
        )
    most = request.most_points
    if most is not None and most < _FEWEST_POINTS:
        raise InputError(f"--max-waypoints-per-file: {most} waypoints are too few for a leg with its transits")
    if most is not None and request.file_format == "litchi" and most > LITCHI_WAYPOINTS:
        raise InputError(f"--max-waypoints-per-file: Litchi supports at most {LITCHI_WAYPOINTS} waypoints, not {most}")


def _flight_file(
    site: Site, compiled: CompiledMission, request: ExportRequest, autopilot: AutopilotName, title: str
) -> FlightFile:
    highest_m = compiled.max_height_above_home_m
    if request.file_format not in CONTROLLER_POINTS:
        content = export_content(compiled, request.file_format, autopilot=autopilot, name=title)
        return FlightFile(content, len(compiled.mission.items), compiled.flight_time_s, highest_m)
    flight = camera_flight(compiled.mission, pitch_deg=site.scenario.sensor.pitch_deg)
    advice = compiled.return_advice
    height_m = advice.return_height_m
    if math.isfinite(advice.safe_return_height_m):
        height_m = max(height_m, math.ceil(advice.safe_return_height_m))
    if request.aircraft is None:
        content = write_litchi(flight).encode()
    else:
        absolute = _absolute_heights(site, flight) if request.heights == ELLIPSOID_HEIGHTS else None
        content = write_kmz(flight, request.aircraft, return_height_m=height_m, absolute=absolute)
    return FlightFile(
        content,
        len(flight.points),
        time_with_stops_s(site, compiled, autopilot),
        highest_m,
        photos=any(point.photos or point.photo_distance_m is not None for point in flight.points),
        warnings=_warnings_of_return(advice, height_m),
        return_height_m=height_m,
    )


def _absolute_heights(site: Site, flight: CameraFlight) -> AbsoluteHeights:
    """Heights of a flight's points above sea level (EGM96) and above the ellipsoid.

    Raises:
        InputError: PROJ has no geoid grid, or the plan's sea level is another one.
    """
    terrain = site.scenario.terrain
    if isinstance(terrain, RasterTerrain) and terrain.vertical_datum == "EGM2008":
        raise InputError(
            "--heights ellipsoid: the plan's heights are above EGM2008, but DJI's file requires heights above EGM96 "
            "and the ellipsoid; export with --heights takeoff, or plan with elevation data in EGM96"
        )
    try:
        undulation = Undulation()
        home_m = site.ground_alt_amsl_m(*_home_lat_lon(site))
        lats, lons = (np.array([getattr(point, axis) for point in flight.points]) for axis in ("lat_deg", "lon_deg"))
        above_m = undulation.heights_m(lats, lons)
    except TerrainError as error:
        raise InputError(f"--heights ellipsoid: {str(error).removeprefix('terrain.vertical_datum: ')}") from error
    if home_m is None:
        raise InputError("--heights ellipsoid: the plan has no position on Earth; export with --heights takeoff")
    amsl_m = [home_m + point.height_above_home_m for point in flight.points]
    ellipsoid_m = [height_m + float(more_m) for height_m, more_m in zip(amsl_m, above_m, strict=True)]
    return AbsoluteHeights([round(m, 3) for m in amsl_m], [round(m, 3) for m in ellipsoid_m])


def _home_lat_lon(site: Site) -> tuple[float, float]:
    if site.frame is None or site.home_m is None:
        raise InputError("--heights ellipsoid: the plan has no position on Earth; export with --heights takeoff")
    lat, lon, _ = site.frame.geodetic_from_enu(site.home_m)
    return float(lat[0]), float(lon[0])


def _warnings_of_return(advice: ReturnAdvice, height_m: float) -> tuple[str, ...]:
    """Warn where a return by the controller itself, straight home at a height above home, is not safe."""
    found = []
    if not math.isfinite(advice.safe_return_height_m):
        found.append(
            f"a straight return at {height_m:g} m crosses ground without elevation data; let the aircraft return along the route"
        )
    if advice.no_fly:
        found.append(
            f"a straight return enters no-fly zone {', '.join(advice.no_fly)}; let the aircraft return along the route"
        )
    return tuple(found)


def _flights_with_stops(
    site: Site, route: Route, request: ExportRequest, autopilot: AutopilotName, vehicles: int
) -> Sequence[Sortie]:
    """Flights of few points that a vehicle which stops at each of them completes inside its endurance."""
    most = request.most_points or CONTROLLER_POINTS["wpml" if request.aircraft is not None else request.file_format]
    longest_s = site.scenario.vehicle.longest_flight_s
    for _ in range(8):
        sorties: Sequence[Sortie] = compile_sorties(
            site, route, autopilot=autopilot, most_points=most, vehicles=vehicles
        )
        times_s = [time_with_stops_s(site, sortie.compiled, autopilot) for sortie in sorties]
        worst = max(range(len(sorties)), key=times_s.__getitem__)
        if longest_s is None or times_s[worst] <= longest_s:
            return sorties
        # Fewer points a file: as many as would fit if the time were even.
        most = min(most - 1, int(len(sorties[worst].compiled.path_m) * longest_s / times_s[worst]))
        if most < _FEWEST_POINTS:
            break
    raise InfeasibleError(
        f"a flight that stops at each point takes {times_s[worst]:.0f} s, but "
        f"{longest_flight_text(site.scenario.vehicle)}; plan with fewer waypoints (--max-waypoints), or a "
        "smaller area"
    )


def time_with_stops_s(site: Site, compiled: CompiledMission, autopilot: AutopilotName) -> float:
    """Flight time of a mission with a stop at each point, from the ground to the ground."""
    pace, path_m = pace_of(site, autopilot), compiled.path_m
    home_up_m = 0.0 if site.home_m is None else float(site.home_m[2])
    return float(
        takeoff_time(pace, float(path_m[0, 2]) - home_up_m)
        + leg_times(pace, path_m).sum()
        + landing_time(pace, float(path_m[-1, 2]) - home_up_m)
    )

"""``uavcover check``: anybody's mission, judged before it is flown."""

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from uavcover.cli import options
from uavcover.cli.new import At, DemOptions, Dsm, TrustDem
from uavcover.cli.options import option

if TYPE_CHECKING:
    from uavcover.extras.check.planned_view import ViewQuery
    from uavcover.extras.check.world import Limits


@dataclass(frozen=True, slots=True)
class AircraftOptions:
    """Options for the aircraft."""

    vehicle: Annotated[str | None, option("Vehicle: a name (see new --vehicle list) or a TOML file.", "NAME")] = None
    autopilot: Annotated[
        str | None, option("Autopilot for the mission; default: as in the file, or ardupilot.", "ardupilot|px4")
    ] = None
    flies_as: Annotated[
        str | None, option("Vehicle type: multirotor, fixed-wing or vtol; default: as in the file.", "KIND")
    ] = None
    speed: Annotated[str | None, option("Ground speed; default: from the vehicle or autopilot.", "SPEED")] = None
    bank: Annotated[
        float | None, option("Bank angle of a fixed-wing aircraft in turns; default: from the autopilot.", "DEGREES")
    ] = None
    battery: Annotated[str | None, option("Flight time on a full battery, such as 25min.", "TIME")] = None
    reserve: Annotated[float, option("Battery reserve in percent.", "PERCENT")] = 20.0
    return_height: Annotated[
        str | None,
        option("Return height above home (RTL_ALT, RTL_RETURN_ALT); default: the autopilot's default.", "LENGTH"),
    ] = None
    parameters: Annotated[
        Path | None,
        option(
            "--parameters",
            "Parameter file of a ground station, for returns and failsafes; default: the autopilot's defaults.",
            "FILE",
        ),
    ] = None


@dataclass(frozen=True, slots=True)
class LimitOptions:
    """Options for the limits."""

    min_height: Annotated[str, option("Minimum height above ground between take-off and landing.", "LENGTH")] = "10m"
    max_height: Annotated[str, option("Maximum height above ground, or none for no limit.", "LENGTH")] = "120m"
    max_above_home: Annotated[str | None, option("Maximum height above home.", "LENGTH")] = None
    max_distance: Annotated[str | None, option("Maximum distance from home.", "LENGTH")] = None
    obstacle_clearance: Annotated[str, option("Minimum distance from obstacles.", "LENGTH")] = "10m"
    wind: Annotated[str | None, option("Wind speed, assumed from the worst direction, such as 8m/s.", "SPEED")] = None

    def limits(self) -> "Limits":
        """The given limits."""
        from uavcover.errors import InputError
        from uavcover.extras.check.world import Limits
        from uavcover.new.quantities import length_m, speed_m_s

        def length(text: str | None, option: str, example: str) -> float | None:
            return None if text is None or text == "none" else length_m(text, option=option, example=example)

        low, high = length(self.min_height, "--min-height", "10m"), length(self.max_height, "--max-height", "120m")
        if low is not None and high is not None and low > high:
            raise InputError(f"--min-height: {low:g} m is greater than --max-height ({high:g} m); use a lower value")
        return Limits(
            min_height_agl_m=0.0 if low is None else low,
            max_height_agl_m=high,
            max_above_home_m=length(self.max_above_home, "--max-above-home", "120m"),
            max_distance_m=length(self.max_distance, "--max-distance", "500m"),
            obstacle_clearance_m=length_m(self.obstacle_clearance, option="--obstacle-clearance", example="10m"),
            wind_m_s=0.0 if self.wind is None else speed_m_s(self.wind, option="--wind", example="8m/s"),
        )


@dataclass(frozen=True, slots=True)
class AroundOptions:
    """Options for the surroundings."""

    dsm: Dsm = None
    trust_dem: TrustDem = False
    fence: Annotated[
        Path | None,
        option("Fence (.plan, .waypoints, .fen) or area to stay inside; default: the fence in the .plan.", "FILE"),
    ] = None
    rally: Annotated[
        Path | None, option("Rally points (.plan, .waypoints); default: the rally points in the .plan.", "FILE")
    ] = None
    no_fly: Annotated[
        list[str] | None, option("No-fly zones (same formats as uavcover new). Can be repeated.", "FILE")
    ] = None
    at: At = None
    obstacles: Annotated[
        Path | None, option("Obstacles: polygons with height_m (.geojson) or heights (.kml, .kmz).", "FILE")
    ] = None
    home: Annotated[str | None, option("Take-off position; default: the home in the file.", "LAT,LON")] = None
    pilot: Annotated[str | None, option("Position of the pilot and radio; default: home.", "LAT,LON")] = None


@dataclass(frozen=True, slots=True)
class ViewOptions:
    """Options for the required photos."""

    area: Annotated[str | None, option("Area to cover (same formats as uavcover new). Requires --camera.")] = None
    camera: Annotated[str | None, option("Camera: a name (see new --camera list) or a TOML file.", "NAME")] = None
    gsd: Annotated[str | None, option("Maximum ground sample distance of photos that count.", "LENGTH")] = None
    overlap: Annotated[str | None, option("Required forward and side overlap in percent.", "F/S")] = None
    coverage: Annotated[float | None, option("Required coverage of the area, 0 to 1.")] = None
    camera_pitch: Annotated[
        float, option("Camera pitch if the mission does not set it; -90 is straight down.", "DEGREES")
    ] = -90.0
    picture_every: Annotated[
        str | None,
        option("Distance or interval at which the camera triggers itself, such as 10m or 2s.", "LENGTH|TIME"),
    ] = None

    def query(self) -> "ViewQuery | None":
        """The given area and requirements; None without an area."""
        from uavcover.errors import InputError
        from uavcover.extras.check.planned_photos import Series
        from uavcover.extras.check.planned_view import ViewQuery
        from uavcover.new.quantities import length_m, time_s
        from uavcover.scenario.areas.area_file import AreaQuery

        if self.area is None:
            for name in ("camera", "gsd", "overlap", "coverage", "picture_every"):
                if getattr(self, name) is not None:
                    raise InputError(f"--{name.replace('_', '-')}: this option requires --area, the area to cover")
            return None
        if self.camera is None:
            raise InputError("--area: this option requires --camera; see uavcover new --camera list")
        if self.coverage is not None and not 0.0 < self.coverage <= 1.0:
            raise InputError(f"--coverage: must be above 0 and at most 1, not {self.coverage:g}")
        if not -90.0 <= self.camera_pitch <= 0.0:
            raise InputError(f"--camera-pitch: must be -90 (straight down) to 0 (ahead), not {self.camera_pitch:g}")
        every, always = self.picture_every, None
        if every is not None:
            by_time = every.strip().endswith(("s", "min"))
            always = (
                Series(interval_s=time_s(every, option="--picture-every", example="2s"))
                if by_time
                else Series(distance_m=length_m(every, option="--picture-every", example="10m"))
            )
        return ViewQuery(
            area=AreaQuery(source=self.area), camera=self.camera, overlap=self.overlap, coverage=self.coverage,
            gsd_m=None if self.gsd is None else length_m(self.gsd, option="--gsd", example="2.5cm"),
            pitch_deg=self.camera_pitch, always=always,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class WrittenOptions:
    """Options for files besides the table."""

    map_file: Annotated[
        Path | None, option("--map", "Map of the path and findings: .html, or .geojson for map programs.", "FILE")
    ] = None
    fix: Annotated[
        bool,
        option(
            "--fix", "Raise low waypoints, add some where a leg hits the ground and split long missions. Requires -o."
        ),
    ] = False
    out: Annotated[
        Path | None, option("-o", "--out", "Output file for the repaired mission, which is checked again.", "FILE")
    ] = None
    max_items: Annotated[
        int | None,
        option(
            "Maximum number of mission items that the vehicle can store. With --fix, longer missions are split.", "N"
        ),
    ] = None
    force: options.Force = False


def check(
    file: Annotated[
        Path,
        typer.Argument(
            help="Mission file: .plan, .waypoints, .mission, .csv (items or Litchi), .kmz (DJI), .gpx or .kml."
        ),
    ],
    *,
    dem: DemOptions,
    around: AroundOptions,
    aircraft: AircraftOptions,
    limit: LimitOptions,
    view: ViewOptions,
    written: WrittenOptions,
    output: options.Output,
) -> int:
    """Check any mission against the terrain, along the full length of every leg.

    The exit code is 0 if the mission passed, 1 if it exceeds a limit or cannot be judged because elevation data is
    missing, and 2 if a file cannot be read. With --fix, findings, --json and the exit code describe the repaired
    mission.
    """
    from uavcover.errors import InputError
    from uavcover.extras.check.check_page import document_of, print_findings, refuse_map, worst_verdict, write_map
    from uavcover.extras.check.mission_file import CheckQuery
    from uavcover.extras.check.mission_file import check as check_file
    from uavcover.extras.check.repair import refuse_repair_into, repair_mission
    from uavcover.new.quantities import flight_window, lat_lon, length_m, speed_m_s, time_s

    console = output.console()
    if not dem.dem:
        raise InputError("--dem: specify elevation data, such as a raster, a folder or a pattern of tiles")
    if not 0.0 <= aircraft.reserve < 100.0:
        raise InputError(f"--reserve: must be between 0 and 99 percent, not {aircraft.reserve:g}")
    if written.max_items is not None and written.max_items < 8:
        raise InputError(f"--max-items: must be 8 or more, not {written.max_items}")
    if aircraft.bank is not None and not 5.0 <= aircraft.bank <= 80.0:
        raise InputError(f"--bank: must be between 5 and 80 degrees, not {aircraft.bank:g}")
    if written.map_file is not None:
        refuse_map(written.map_file, force=written.force)
    if written.out is not None and not written.fix:
        raise InputError("-o: this option requires --fix")
    fixed = refuse_repair_into(file, written.out, force=written.force) if written.fix else None
    height, speed, battery = aircraft.return_height, aircraft.speed, aircraft.battery
    query = CheckQuery(
        flight_window_utc=None if around.at is None else flight_window(around.at, option="--at"),
        file=file, elevation=dem.data(), surface=tuple(around.dsm or ()), fence=around.fence,
        rally=around.rally, parameters=aircraft.parameters,
        no_fly=tuple(around.no_fly or ()), obstacles=around.obstacles,
        vehicle=aircraft.vehicle,
        autopilot=aircraft.autopilot, kind=aircraft.flies_as,
        home=None if around.home is None else lat_lon(around.home, option="--home"),
        pilot=None if around.pilot is None else lat_lon(around.pilot, option="--pilot"),
        return_height_m=None if height is None else length_m(height, option="--return-height", example="60m"),
        speed_m_s=None if speed is None else speed_m_s(speed, option="--speed", example="8m/s"),
        bank_deg=aircraft.bank,
        endurance_s=None if battery is None else time_s(battery, option="--battery", example="25min"),
        reserve_fraction=aircraft.reserve / 100.0, limits=limit.limits(),
        view=view.query(),
        most_items=written.max_items, trust_dem=around.trust_dem,
    )  # fmt: skip
    outcome = check_file(query, console)
    print_findings(outcome, console)
    outcomes = [(query, outcome)]
    if fixed is not None:
        for part in repair_mission(query, outcome.checked, fixed, console, force=written.force):
            outcomes = [each for each in outcomes if each[0] is not query]
            console.say(f"{part}:")
            again = dataclasses.replace(query, file=part)
            outcomes.append((again, check_file(again, console)))
            print_findings(outcomes[-1][1], console)
    query, outcome = outcomes[0]
    if written.map_file is not None:
        if written.map_file.suffix.lower() == ".html":
            from uavcover.extras.check.check_page import write_check_page

            write_check_page(query, outcome, written.map_file)
        else:
            write_map(outcome, written.map_file, force=written.force)
        console.say(f"wrote {written.map_file}")
    document = document_of(query, outcome)
    if len(outcomes) > 1:
        document = {
            "verdict": worst_verdict([each for _, each in outcomes]),
            "parts": [document_of(*each) for each in outcomes],
        }
    console.result(document)
    return 0 if document["verdict"] == "passed" else 1

"""``uavcover export``: the chosen route of a run as files for other software."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mission_io.formats.wpml import IMAGE_FORMATS, DjiAircraft
from uavcover.cli import options
from uavcover.cli.options import option
from uavcover.errors import InputError
from uavcover.new.catalog import Catalog, checked_row, number_of

if TYPE_CHECKING:
    from uavcover.cli.console import Console
    from uavcover.extras.exports.export import ExportedFile, ExportRequest
    from uavcover.run.folder import RunFolder


@dataclass(frozen=True, slots=True)
class ControllerOptions:
    """Options of a controller's flights."""

    drone: Annotated[
        str | None,
        option("Aircraft for wpml and print: a name, a TOML file, or list to show the names.", "NAME"),
    ] = None
    heights: Annotated[
        str,
        option(
            "Height reference in wpml files: takeoff or ellipsoid (WGS 84, for RTK; requires a geoid grid).", "WHAT"
        ),
    ] = "takeoff"
    most_points: Annotated[
        int | None,
        option(
            "--max-waypoints-per-file",
            "Split the route into files of at most N waypoints. Default: 200 for wpml, 99 for litchi.",
            "N",
        ),
    ] = None


@dataclass(frozen=True, slots=True)
class PrintOptions:
    """Options of a print-out that only the pilot knows."""

    pilot: Annotated[str, option("Name of the pilot on the printed page.", "TEXT")] = ""
    contact: Annotated[str, option("Emergency contact on the printed page.", "TEXT")] = ""
    weather: Annotated[str, option("Weather window on the printed page.", "TEXT")] = ""


def export(
    run: Annotated[Path | None, typer.Argument(help="Run folder with a plan.")] = None,
    *,
    file_format: Annotated[
        str | None,
        option(
            "--format",
            "Format: waypoints, plan, kml, geojson, csv, gpx, mavproxy-fence, mavproxy-rally, wpml (DJI), litchi "
            "or print (a printable HTML page).",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        option("-o", "--out", "Output file. If there are several, a number is added before the suffix.", "FILE"),
    ] = None,
    sortie: options.Sortie = None,
    autopilot: options.Autopilot = None,
    controller: ControllerOptions,
    paper: PrintOptions,
    force: options.Force = False,
    output: options.Output,
) -> int:
    """Export the route to another format: a mission file, DJI KMZ, Litchi CSV, GPX or a printable page."""
    from uavcover.errors import InputError
    from uavcover.extras.exports.export import CONTROLLER_POINTS, ExportRequest, export_mission, mission_formats
    from uavcover.model.vehicle import autopilot_name
    from uavcover.run.folder import RunFolder

    console = output.console()
    if controller.drone == "list":
        return _list(console)
    if run is None or file_format is None or out is None:
        raise InputError(
            "export: specify a run folder, --format and -o, such as: uavcover export run --format gpx -o run.gpx"
        )
    if file_format not in (*mission_formats(), "print"):
        known = ", ".join((*mission_formats(), "print"))
        raise InputError(f"--format: {file_format!r} is not one of {known}")
    request = ExportRequest(
        file_format=file_format, out=out, sortie=sortie,
        autopilot=None if autopilot is None else autopilot_name(autopilot, "ardupilot"),
        most_points=controller.most_points, heights=controller.heights,
        aircraft=None if controller.drone is None else DJI_AIRCRAFT.named(controller.drone), force=force,
    )  # fmt: skip
    if file_format == "print":
        return _print(console, RunFolder(run), request, paper)
    for name, value in asdict(paper).items():
        if value:
            raise InputError(f"--{name}: this option requires --format print, not {file_format}")
    written = export_mission(RunFolder(run), request)
    what = "points" if file_format in CONTROLLER_POINTS else "items"
    for file in written:
        about = f" ({file.flight.items} {what}, {file.flight.flight_time_s / 60.0:.1f} min)" if len(written) > 1 else ""
        console.say(f"wrote {file.path}{about}")
    if file_format in CONTROLLER_POINTS:
        _print_how_it_flies(console, file_format, written)
    rows = [
        {
            "file": str(file.path), "items": file.flight.items, "flight_time_s": file.flight.flight_time_s,
            "highest_above_home_m": file.flight.highest_m, "warnings": list(file.flight.warnings),
        }
        for file in written
    ]  # fmt: skip
    console.result({**rows[0], "format": file_format, "files": rows})
    return 0


def _print(console: "Console", run: "RunFolder", request: "ExportRequest", paper: PrintOptions) -> int:
    from uavcover.errors import InputError
    from uavcover.extras.exports.print_page import print_plan

    if request.out.suffix.lower() not in (".html", ".htm"):
        raise InputError(
            f"-o: {request.out}: the format print writes an HTML page; use the suffix .html, and save the page as "
            "PDF from a browser"
        )
    flights = print_plan(run, request, asdict(paper))
    console.say(f"wrote {request.out}")
    console.result({"file": str(request.out), "format": "print", "flights": flights})
    return 0


def _print_how_it_flies(console: "Console", file_format: str, written: "tuple[ExportedFile, ...]") -> None:
    """Report what a list of points cannot contain, and the pilot's tasks."""
    console.say("heights are relative to the take-off position: start on the ground at the plan's home")
    console.say("the aircraft stops at each point; it lands from the last point, straight above home")
    console.say(
        f"the highest point is {max(file.flight.highest_m for file in written):.0f} m above home; set the app's "
        "height limit to at least this height"
    )
    if not any(file.flight.photos for file in written):
        console.say("the scenario has no trigger distance, so the mission takes no photos; trigger the camera manually")
    heights_m = [file.flight.return_height_m for file in written if file.flight.return_height_m is not None]
    where = "in the file" if file_format == "wpml" else "to be set in the app"
    console.say(f"return height ({where}): {max(heights_m):g} m above home")
    for line in dict.fromkeys(line for file in written for line in file.flight.warnings):
        console.warn(line)
    if file_format == "litchi":
        console.say('set in Mission Hub: Path Mode "Straight Lines", Heading Mode "Custom (WD)", Finish Action "Land"')


def _list(console: "Console") -> int:

    console.say(f"{'aircraft':20}{'drone':>8}{'payload':>9}{'camera pitch':>16}{'largest':>9}  title")
    aircraft = DJI_AIRCRAFT.by_name()
    for name, one in aircraft.items():
        low_deg, high_deg = one.pitch_range_deg
        console.say(
            f"{name:20}{f'{one.drone[0]}/{one.drone[1]}':>8}{one.payload:>9}{f'{low_deg:g} to {high_deg:g}':>16}"
            f"{f'{one.max_speed_m_s:g} m/s':>9}  {one.title}"
        )
    console.result({"aircraft": list(aircraft)})
    return 0


_KEYS = ("drone", "payload", "payload_position", "image_format", "pitch_range_deg", "max_speed_m_s")


def _aircraft(_name: str, row: Mapping[str, Any], where: str) -> DjiAircraft:
    checked_row(row, where=where, required=_KEYS, optional=())
    lenses = str(row["image_format"])
    unknown = [lens for lens in lenses.split(",") if lens not in IMAGE_FORMATS]
    if unknown:
        raise InputError(f"{where}: image_format: {unknown[0]!r} is not one of {', '.join(IMAGE_FORMATS)}")
    low_deg, high_deg = (_number(value, "pitch_range_deg", where) for value in _two(row, "pitch_range_deg", where))
    if not -180.0 <= low_deg < high_deg <= 180.0:
        raise InputError(f"{where}: pitch_range_deg: write the lower angle first, such as [-90, 30]")
    kind, subkind = (_whole(value, "drone", where) for value in _two(row, "drone", where))
    speed_m_s = number_of(row, "max_speed_m_s", where=where)
    return DjiAircraft(
        title=str(row["title"]),
        drone=(kind, subkind),
        payload=_whole(row["payload"], "payload", where),
        payload_position=_whole(row["payload_position"], "payload_position", where),
        image_format=lenses,
        pitch_range_deg=(low_deg, high_deg),
        max_speed_m_s=0.0 if speed_m_s is None else speed_m_s,
    )


DJI_AIRCRAFT = Catalog("dji.toml", "--drone", _aircraft, command="export")


def _two(row: Mapping[str, Any], key: str, where: str) -> list[Any]:
    value = row[key]
    if not isinstance(value, list) or len(value) != 2:
        raise InputError(f"{where}: {key}: expected two numbers, not {value!r}")
    return value


def _whole(value: Any, key: str, where: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= 65535:
        raise InputError(f"{where}: {key}: expected a whole number from 0 to 65535, not {value!r}")
    return value


def _number(value: Any, key: str, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{where}: {key}: expected a number, not {value!r}")
    return float(value)

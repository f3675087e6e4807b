"""``uavcover new``: from an area, elevation data and a camera to a scenario."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from uavcover.cli import options
from uavcover.cli.options import option
from uavcover.cli.survey_options import SurveyOptions

if TYPE_CHECKING:
    from uavcover.cli.console import Console


def new(
    area: Annotated[
        str | None,
        typer.Argument(
            help=(
                "Area to cover: a GeoJSON, KML, KMZ, GeoPackage, Shapefile, WKT, .plan or .poly file; "
                "WEST,SOUTH,EAST,NORTH; or LAT,LON,RADIUS."
            ),
        ),
    ] = None,
    *,
    out: Annotated[
        Path | None, option("-o", "--out", "Scenario file to write; default: named after the area.", "FILE.toml")
    ] = None,
    survey: SurveyOptions,
    autopilot: options.Autopilot = None,
    force: options.Force = False,
    output: options.Output,
) -> int:
    """Create a scenario file from an area, an elevation model and a camera, and print the derived values.

    The file explains each key in a comment. To show known cameras or vehicles, use --camera list or --vehicle list.
    """
    from uavcover.errors import InputError, OutputError

    console = output.console()
    if "list" in (survey.camera, survey.vehicle):
        return _list(console, cameras=survey.camera == "list", vehicles=survey.vehicle == "list")
    from uavcover.new.command import new_scenarios, say_design, say_estimate
    from uavcover.new.survey import name_of  # the lists need no planner
    from uavcover.run.user import to_paste

    if area is None:
        raise InputError("new: specify an area, such as area.kml, with --dem dem.tif --camera NAME --gsd 2.5cm")
    path = out if out is not None else Path(f"{name_of(Path(area).stem)}.toml")
    if path.suffix.lower() != ".toml":
        raise InputError(f"-o: {path} is not a .toml file; use a name such as survey.toml")
    if not path.parent.is_dir():
        raise OutputError(f"{path}: the folder {path.parent} does not exist; create it first")
    _refuse_to_replace([path], force=force)
    scenarios = new_scenarios(survey.request(area, autopilot=autopilot), console, folder=path.parent)
    paths = [path.with_stem("-".join(part for part in (path.stem, each.view.name) if part)) for each in scenarios]
    _refuse_to_replace(paths, force=force)
    for scenario, file in zip(scenarios, paths, strict=True):
        file.write_text(scenario.text, encoding="utf-8")
    document = say_design(scenarios[0], console)
    estimates = [say_estimate(scenario, console) for scenario in scenarios]
    for file in paths:
        console.say(f"wrote {file}")
    console.suggest(*(to_paste("plan", file, "-o", file.stem, "--budget", "60s") for file in paths))
    flights = [{"scenario": str(file), **estimate} for file, estimate in zip(paths, estimates, strict=True)]
    console.result({**document, **flights[0], "flights": flights})
    return 0


def _refuse_to_replace(paths: list[Path], *, force: bool) -> None:
    from uavcover.errors import OutputError

    for path in paths:
        if path.exists() and not force:
            raise OutputError(f"{path} already exists; use --force to overwrite it, or choose another name with -o")


def _list(console: "Console", *, cameras: bool, vehicles: bool) -> int:
    from uavcover.new.catalog import all_cameras, all_vehicles

    document: dict[str, Any] = {}
    if cameras:
        console.say(f"{'camera':32}{'pixels':>14}{'sensor':>16}{'lens':>10}{'interval':>10}  title")
        for camera in all_cameras():
            interval = f"{camera.min_interval_s:g} s" if camera.min_interval_s is not None else "unknown"
            console.say(
                f"{camera.name:32}{f'{camera.pixels_across} x {camera.pixels_along}':>14}"
                f"{f'{camera.sensor_across_mm:.4g} x {camera.sensor_along_mm:.4g}':>16}{f'{camera.focal_length_mm:g} mm':>10}"
                f"{interval:>10}  {camera.title}"
            )
        document["cameras"] = [camera.name for camera in all_cameras()]
    if vehicles:
        console.say(f"{'vehicle':20}{'endurance':>12}{'usual':>9}{'largest':>9}{'climb':>9}{'descent':>9}  title")
        for one in all_vehicles():
            air = "unknown" if one.endurance_s is None else f"{one.endurance_s / 60.0:.0f} min"
            speeds = "".join(
                f"{'unknown' if speed is None else f'{speed:g} m/s':>9}"
                for speed in (one.cruise_speed_m_s, one.max_speed_m_s, one.max_climb_m_s, one.max_descent_m_s)
            )
            console.say(f"{one.name:20}{air:>12}{speeds}  {one.title}")
        document["vehicles"] = [one.name for one in all_vehicles()]
    console.result(document)
    return 0

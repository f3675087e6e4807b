"""``uavcover judge-photos``: what pictures show of an area, whoever took them."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from uavcover.cli import options
from uavcover.cli.survey_options import SurveyOptions


def judge_photos(
    photos: Annotated[
        list[Path],
        typer.Argument(
            help="Folders of pictures (.jpg, .tif, .dng); geo.txt, images.json, .MRK, .csv; logs: .bin, .tlog, .ulg."
        ),
    ],
    *,
    area: Annotated[
        str | None, typer.Option("--area", help="What should be seen, as new takes it: a file, or LAT,LON,RADIUS.")
    ] = None,
    scenario: Annotated[
        Path | None,
        typer.Option("--scenario", help="A scenario file or run folder instead of an area.", metavar="FILE|RUN"),
    ] = None,
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for the verdict.", metavar="FOLDER")] = Path(
        "photos"
    ),
    survey: SurveyOptions,
    takeoff: Annotated[
        str | None,
        typer.Option("--takeoff", help="Where the vehicle took off: heights above it count.", metavar="LAT,LON"),
    ] = None,
    geoid_height: Annotated[
        float | None,
        typer.Option(
            "--geoid-height", help="Of the sea level above the ellipsoid, where PROJ has no grid.", metavar="METRES"
        ),
    ] = None,
    position_error: Annotated[
        float, typer.Option("--position-error", help="Of places that tell none.", metavar="METRES")
    ] = 3.0,
    height_error: Annotated[
        float, typer.Option("--height-error", help="Of heights that tell none.", metavar="METRES")
    ] = 10.0,
    angle_error: Annotated[
        float, typer.Option("--angle-error", help="Of the camera's angles, where they are told.", metavar="DEGREES")
    ] = 2.0,
    coverage: Annotated[
        float, typer.Option("--coverage", help="Share of what can be seen that some picture has to show.")
    ] = 0.98,
    refly: Annotated[bool, typer.Option("--refly/--no-refly", help="Plan the flight for what is missing.")] = True,
    budget: Annotated[
        str | None, typer.Option("--budget", help="Time for planning that flight, such as 30s.", metavar="TIME")
    ] = "20s",
    force: options.Force = False,
    output: options.Output,
) -> int:
    """Count in how many pictures each point is, hidden ground left out, and plan the flight for what is missing.

    The camera is the pictures' own, unless --camera names one. Exit 1 when too little is shown.
    """
    from uavcover.errors import InputError
    from uavcover.intake.quantities import lat_lon
    from uavcover.judging.photos.placing import Assumptions
    from uavcover.run.folder import RunFolder
    from uavcover.run.judge_photos import judge_photos
    from uavcover.run.photo_judgement import PhotoRequest

    if (area is None) == (scenario is None):
        raise InputError("judge-photos: give either --area (with --dem), or --scenario")
    if scenario is not None and survey.given():
        raise InputError(f"judge-photos: {survey.given()[0]} belongs to --area; the scenario says it already")
    for option, value in (
        ("--position-error", position_error), ("--height-error", height_error), ("--angle-error", angle_error),
    ):  # fmt: skip
        if not 0.0 <= value < 1000.0:
            raise InputError(f"{option}: {value:g} is out of range; give 0 or more")
    console = output.console()
    assumed = Assumptions(
        horizontal_m=position_error, vertical_m=height_error, attitude_deg=angle_error, geoid_height_m=geoid_height
    )
    request = PhotoRequest(
        photos=photos, area=None if area is None else survey.request(area, autopilot=None), scenario=scenario,
        assumed=assumed, takeoff=None if takeoff is None else lat_lon(takeoff, option="--takeoff"), coverage=coverage,
        refly=refly, budget_s=options.seconds(budget), force=force,
    )  # fmt: skip
    verdict, document = judge_photos(request, RunFolder(out), console, command=sys.argv)
    console.result(document)
    return 0 if verdict.document["passed"] else 1

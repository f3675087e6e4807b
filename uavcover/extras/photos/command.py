"""``uavcover judge-photos``: coverage of an area by photos of any origin."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from uavcover.cli import options
from uavcover.cli.new import PhotoOptions, SearchOptions, SurveyOptions, list_curves
from uavcover.cli.options import option


def judge_photos(
    photos: Annotated[
        list[Path] | None,
        typer.Argument(
            help=(
                "Folders of photos (.jpg, .tif, .dng), position files (geo.txt, images.json, .MRK, .csv) and "
                "logs (.bin, .tlog, .ulg)."
            )
        ),
    ] = None,
    *,
    area: Annotated[str | None, option("Area to cover (same formats as uavcover new).")] = None,
    scenario: Annotated[Path | None, option("Scenario file or run folder, instead of --area.", "FILE|RUN")] = None,
    out: Annotated[Path, option("-o", "--out", "Folder for the verdict.", "FOLDER")] = Path("photos"),
    survey: SurveyOptions,
    belief: PhotoOptions,
    search: SearchOptions,
    coverage: Annotated[
        float | None, option("Required coverage of the visible ground. Default: the scenario's value, or 0.98.")
    ] = None,
    refly: Annotated[bool, option("--refly/--no-refly", "Plan a flight for the missing photos.")] = True,
    budget: Annotated[
        str | None, option("Time limit for planning the flight for missing photos, such as 30s.", "TIME")
    ] = "20s",
    page: Annotated[
        Path | None, option("--report", "Also write an HTML page with a map and tables.", "FILE.html")
    ] = None,
    gpkg: Annotated[
        Path | None, option("Also write footprints, positions and gaps to a GeoPackage.", "FILE.gpkg")
    ] = None,
    force: options.Force = False,
    output: options.Output,
) -> int:
    """Count the photos of each point, without hidden ground, and plan a flight for the missing photos.

    The camera is derived from the photos unless you set --camera. The exit code is 1 if the photos show too little.
    """
    from uavcover.errors import InputError
    from uavcover.extras.photos.judge_photos import judge_photos
    from uavcover.extras.photos.photo_judgement import PhotoRequest
    from uavcover.extras.photos.placing import Assumptions
    from uavcover.run.folder import RunFolder

    console = output.console()
    if search.detection == "list":
        return list_curves(console)
    if not photos:
        raise InputError("judge-photos: specify folders of photos, lists of photos or logs, such as DCIM/")
    if (area is None) == (scenario is None):
        raise InputError("judge-photos: specify either --area (with --dem), or --scenario")
    if scenario is not None and survey.given():
        raise InputError(f"judge-photos: {survey.given()[0]} requires --area; the scenario already defines it")
    request = PhotoRequest(
        photos=photos, area=None if area is None else survey.request(area, autopilot=None), scenario=scenario,
        assumed=Assumptions(**belief.assumed()), takeoff=belief.position(), coverage=coverage,
        mount_known=area is None or survey.mount is not None,
        refly=refly, budget_s=options.seconds(budget), force=force, detection=search.curve(), pod=search.pod,
        max_blur_px=belief.max_blur,
    )  # fmt: skip
    if gpkg is not None:
        from uavcover.extras.photos.photo_page import check_geopackage, write_geopackage

        check_geopackage(gpkg, force=force)
    if page is not None:
        from uavcover.extras.photos.photo_page import refuse_to_replace, save_photo_report

        refuse_to_replace(page, force=force)
    verdict, document = judge_photos(request, RunFolder(out), console, command=sys.argv)
    if page is not None:
        save_photo_report(verdict, page, console, force=force)
        document["report"] = str(page)
    if gpkg is not None:
        write_geopackage(verdict, gpkg, console, force=force)
        document["geopackage"] = str(gpkg)
    console.result(document)
    return 0 if verdict.document["passed"] else 1

"""``uavcover plan``: from a scenario to a Pareto set, a chosen route and its mission files."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from uavcover.cli import BEGUN_S, options
from uavcover.cli.options import option
from uavcover.cli.survey_options import SurveyOptions

if TYPE_CHECKING:
    from uavcover.cli.console import Console
    from uavcover.scenario.site import Site


@dataclass(frozen=True, slots=True)
class Search:
    """Search options, the choice of the route, and the autopilot of the mission files."""

    algorithm: Annotated[
        str | None,
        option(
            "Algorithm: memetic, local-search, imodbo, modbo, nsga2, moead, pymoo:NSGA3 or your own "
            "module:Class. Default: the scenario's algorithm."
        ),
    ] = None
    budget: Annotated[str | None, option("Time limit, such as 30s or 5m, instead of a number of evaluations.")] = None
    evaluations: Annotated[
        int | None, option("Number of route evaluations. 50 proposals of the local search count as one.")
    ] = None
    max_waypoints: Annotated[
        int | None, option("Maximum number of waypoints of the route, or of nodes if the encoding is waypoints.")
    ] = None
    parts: Annotated[
        str | None,
        option("Number of parts into which a large area is divided, or auto. Default: the scenario's value.", "N|auto"),
    ] = None
    waypoint_price: Annotated[
        float | None,
        option(
            "Penalty for each waypoint, in seconds, or in metres if the objective is length. A higher "
            "penalty gives fewer waypoints."
        ),
    ] = None
    select: Annotated[
        str | None,
        option(
            "Rule that selects the route: weighted[:w1,w2,w3], knee, max-coverage, coverage>=X or index:N. "
            "Optional conditions: ,sorties<=N ,vehicles<=N ,done<=40m.",
            "RULE",
        ),
    ] = None
    bounds: Annotated[
        str | None,
        option("Time to compute bounds after the search, such as 30s. A bound is a limit that no route can beat."),
    ] = None
    rally: Annotated[
        str | None,
        option(
            "Rally points. auto: propose them if the autopilot's own return is unsafe. home: use only home. "
            "Default: the scenario's value.",
            "auto|home",
        ),
    ] = None
    autopilot: options.Autopilot = None
    vehicles: options.Vehicles = None
    workers: Annotated[int | None, option("Number of threads. It does not change the result.")] = None
    scheduler: options.Scheduler = None
    memory: Annotated[
        str | None,
        option(
            "Memory limit on this machine, such as 4GiB or 800MiB. If necessary, a large area is divided "
            "into more parts, and fewer are searched at a time.",
            "SIZE",
        ),
    ] = None
    seed: options.Seed = None


def plan(
    scenario: Annotated[
        str,
        typer.Argument(
            help="A scenario file, the name of a bundled scenario (see doctor), or an area with --dem and --camera."
        ),
    ],
    run: Annotated[Path, option("-o", "--out", "Folder for the results (the run folder).", "RUN")],
    *,
    search: Search,
    survey: SurveyOptions,
    force: options.ForcePlan = False,
    output: options.Output,
) -> int:
    """Plan a route that observes the area, and write its mission files.

    If you pass an area instead of a scenario, the command creates the scenario as `uavcover new` does and writes it to
    RUN/scenario.toml. Press Ctrl-C to stop the search and write the best route so far. The exit code is then 130.
    """
    from uavcover.new.quantities import memory_bytes
    from uavcover.planner.command import PlanRequest, plan_into
    from uavcover.planner.plan_words import upload_in_words
    from uavcover.run.folder import RunFolder
    from uavcover.run.user import to_paste

    console = output.console()
    request = PlanRequest(
        begun_s=BEGUN_S, scenario=_site(scenario, survey, console, autopilot=search.autopilot),
        folder=run, command=sys.argv, force=force, seed=search.seed,
        evaluations=search.evaluations, budget_s=options.seconds(search.budget), algorithm=search.algorithm,
        parts=_parts(search.parts), max_waypoints=search.max_waypoints, waypoint_price=search.waypoint_price,
        rally=_rally(search.rally),
        select=search.select, vehicles=search.vehicles, autopilot=search.autopilot, workers=search.workers,
        bounds_s=options.seconds(search.bounds, option="--bounds"), scheduler=search.scheduler,
        memory_bytes=None if search.memory is None else memory_bytes(search.memory, option="--memory"),
    )  # fmt: skip
    outcome = plan_into(request, console, check_site=lambda _: None)
    if outcome.document["mission_files"]:
        upload = upload_in_words(RunFolder(run), outcome.document["fleet"], len(outcome.sorties))
        console.suggest(upload, to_paste("pareto", run))
    else:
        console.suggest(to_paste("pareto", run))
    console.result(outcome.document)
    return outcome.exit_code


def _parts(text: str | None) -> "int | Literal['auto'] | None":
    """The number of parts, or "auto"; none where it was not given."""
    from uavcover.errors import InputError

    if text is None:
        return None
    if text == "auto":
        return "auto"
    if not (text.isascii() and text.isdigit()) or int(text) < 1:
        raise InputError(f"--parts: must be auto or a number of parts (at least 1), not {text!r}")
    return int(text)


def _rally(text: str | None) -> "Literal['auto', 'home'] | None":
    """Choice of rally points; none without the option."""
    from uavcover.errors import InputError

    if text not in (None, "auto", "home"):
        raise InputError(f"--rally: must be auto or home, not {text!r}")
    return text  # type: ignore[return-value]


def _site(source: str, survey: SurveyOptions, console: "Console", *, autopilot: str | None) -> "str | Site":
    """The scenario, or an area as a scenario on its ground."""
    from uavcover.errors import InputError
    from uavcover.scenario.areas.area_file import is_area_file

    if not is_area_file(source):
        if given := [option for option in survey.given() if option not in ("--no-fly", "--at", "--trust-dem")]:
            raise InputError(f"{source}: this is a scenario; use {', '.join(given)} with an area, such as area.kml")
        changed = survey.no_fly or survey.at is not None or survey.trust_dem
        return _with_options(source, survey, console) if changed else source
    from uavcover.new.command import new_scenario, say_design, say_estimate

    new = new_scenario(survey.request(source, autopilot=autopilot), console, folder=Path())
    say_design(new, console)
    say_estimate(new, console)
    return new.site


def _with_options(source: str, survey: SurveyOptions, console: "Console") -> "Site":
    """The scenario on its ground, with the zones of more files, another time of flight, and its heights confirmed."""
    from dataclasses import replace

    from uavcover.model.area import RasterTerrain
    from uavcover.new.quantities import flight_window
    from uavcover.new.tuning import TEXT
    from uavcover.scenario.scenario_file import load_scenario, with_no_fly
    from uavcover.scenario.site import load_site

    scenario = load_scenario(source)
    more = scenario
    if files := survey.no_fly:
        more = with_no_fly(scenario, files, margin_m=TEXT.no_fly_margin_m)
        console.say(f"--no-fly: added {len(more.no_fly) - len(scenario.no_fly)} of the zones in {', '.join(files)}")
    if survey.at is not None:
        more = replace(more, flight_window_utc=flight_window(survey.at, option="--at"))
    if survey.trust_dem and isinstance(more.terrain, RasterTerrain):
        more = replace(more, terrain=replace(more.terrain, trust_heights=True))
    return load_site(more)

"""``uavcover plan``, ``pareto`` and ``select``: from a scenario to a Pareto set, a chosen route and its mission files."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from uavcover import BEGUN_S
from uavcover.cli import options
from uavcover.cli.new import SurveyOptions
from uavcover.cli.options import option

if TYPE_CHECKING:
    from uavcover.cli.console import Console
    from uavcover.model.route import MissionSize
    from uavcover.planner.pareto_file import ParetoRow
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
    from uavcover.planner.plan_messages import upload_text
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
        upload = upload_text(RunFolder(run), outcome.document["fleet"], len(outcome.sorties))
        console.suggest(upload, to_paste("pareto", run))
    else:
        console.suggest(to_paste("pareto", run))
    console.result(outcome.document)
    return outcome.exit_code


def _parts(text: str | None) -> "int | Literal['auto'] | None":
    """The number of parts, or "auto"; None where it was not given."""
    from uavcover.errors import InputError

    if text is None:
        return None
    if text == "auto":
        return "auto"
    if not (text.isascii() and text.isdigit()) or int(text) < 1:
        raise InputError(f"--parts: must be auto or a number of parts (at least 1), not {text!r}")
    return int(text)


def _rally(text: str | None) -> "Literal['auto', 'home'] | None":
    """Choice of rally points; None without the option."""
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
    from uavcover.new.command import new_scenario, print_design, print_estimate

    new = new_scenario(survey.request(source, autopilot=autopilot), console, folder=Path())
    print_design(new, console)
    print_estimate(new, console)
    return new.site


def _with_options(source: str, survey: SurveyOptions, console: "Console") -> "Site":
    """The scenario on its ground, with the zones of more files, another time of flight, and its heights confirmed."""
    from dataclasses import replace

    from uavcover.model.area import RasterTerrain
    from uavcover.new.quantities import TEXT, flight_window
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


# ``uavcover select``: another member of the Pareto set.


def select(
    run: Annotated[Path, typer.Argument(help="Run folder with a plan.")],
    rule: Annotated[
        str,
        typer.Argument(
            help=(
                "Rule that selects the route: weighted[:w1,w2,w3], knee, max-coverage, coverage>=0.95 or index:N (a "
                "row of `uavcover pareto`). Optional conditions: ,sorties<=N ,vehicles<=N ,done<=40m."
            ),
            metavar="RULE",
        ),
    ],
    *,
    autopilot: options.Autopilot = None,
    force: Annotated[
        bool, option("--force", "Replace the route even if it was flown. It is moved to RUN/older-N.")
    ] = False,
    output: options.Output,
) -> int:
    """Select another route of the Pareto set, and rewrite plan.json and the mission files.

    If no route meets the rule, the command writes the best route and exits with 1.
    """
    import dataclasses

    from uavcover.errors import InputError
    from uavcover.model.vehicle import autopilot_name
    from uavcover.planner.command import choose
    from uavcover.planner.plan_files import print_fleet
    from uavcover.planner.plan_messages import (
        figures_header,
        figures_text,
        print_missions,
        print_older,
        print_size,
        upload_text,
    )
    from uavcover.planner.selection_rule import parse_rule
    from uavcover.run.documents import read_planned
    from uavcover.run.folder import RunFolder, flown_in

    console = output.console()
    parse_rule(rule)
    folder = RunFolder(run)
    site, _ = read_planned(folder)
    if autopilot is not None and site.scenario.vehicles:
        raise InputError("--autopilot: each [[vehicle]] has its own autopilot; omit this option")
    name = autopilot_name(autopilot, site.scenario.vehicle.autopilot)
    with folder.reserved(flown_in(folder), force=force):
        plan, flights, older = choose(folder, site, rule, autopilot=name, command=sys.argv)
    print_older(console, older)
    index = plan.members.index(plan.chosen)
    console.say(figures_header(site.scenario.objective))
    console.say(figures_text(f"index:{index}", plan.chosen, site.scenario.objective))
    sorties = flights if len(flights) > 1 else ()
    print_missions(console, folder, flights[0].compiled if len(flights) == 1 else None, sorties)
    fleet = folder.read_json("plan.json", made_by="uavcover plan")["fleet"]
    print_fleet(console, fleet)
    print_size(console, plan)
    if not plan.rule_met:
        console.warn(f"no route meets {plan.rule}; wrote the best one. Lower the requirement, or raise --budget")
    if flights:
        console.suggest(upload_text(folder, fleet, len(sorties)))
    console.result(
        {
            "run": str(run), "index": index, "rule": plan.rule, "rule_met": plan.rule_met,
            "metrics": dataclasses.asdict(plan.chosen.metrics), "mission_files": bool(flights), "sorties": len(sorties),
            "mission": None if plan.chosen.mission is None else dataclasses.asdict(plan.chosen.mission),
        }
    )  # fmt: skip
    return 0 if plan.rule_met else 1


def pareto(
    run: Annotated[Path, typer.Argument(help="Run folder with a plan.")],
    *,
    plot: Annotated[Path | None, option("Plot the routes to a .png, .svg or .pdf file.", "FILE.png")] = None,
    force: options.Force = False,
    output: options.Output,
) -> int:
    """List the routes of a plan with coverage, waypoints, length, time and sorties, or draw them."""
    from uavcover.errors import OutputError
    from uavcover.planner.pareto_file import read_pareto
    from uavcover.planner.plan_messages import sizes_by_vehicles_text
    from uavcover.run.documents import bounds_text
    from uavcover.run.folder import RunFolder
    from uavcover.run.user import percent, to_paste

    console = output.console()
    folder = RunFolder(run)
    members = read_pareto(folder.existing("pareto.csv", made_by="uavcover plan"))
    plan = folder.read_json("plan.json", made_by="uavcover plan")
    if plot is not None and plot.exists() and not force:
        raise OutputError(f"{plot} already exists; use --force to overwrite it, or choose another name")
    by_energy = plan.get("objective") == "energy" and all(m.mission_energy_hover_s is not None for m in members)
    header = f"{'energy':>9}" if by_energy else ""
    sized = any(member.mission is not None for member in members)
    header += f"{'sorties':>9}{'vehicles':>10}{'done':>9}" if sized else ""
    console.say(f"{'index':>7}{'coverage':>10}{'waypoints':>11}{'length':>12}{'time':>9}{header}  made by")
    for member in members:
        energy = f"{member.mission_energy_hover_s:>7.0f} s" if by_energy else ""
        console.say(
            f"{'*' if member.chosen else ' '}{member.index:>6}{percent(member.coverage_of_coverable):>10}"
            f"{member.waypoint_count:>11}{member.path_length_m:>10.0f} m{member.time_s:>7.0f} s{energy}"
            f"{_size_text(member.mission) if sized else ''}  {member.made_by}"
        )
    console.say(
        f"*: the route in plan.json; coverage: of the visible ground{'; energy: in seconds of hovering' if by_energy else ''}"
        f"{'; done: from the first take-off to the last landing' if sized else ''}"
    )
    if sized and any(member.mission is None for member in members):
        console.say(
            "-: no sorties found, or not computed because the set is large; a rule such as max-coverage,sorties<=3 "
            "evaluates all routes"
        )
    if line := sizes_by_vehicles_text((plan.get("mission") or {}).get("by_vehicles", [])):
        console.say(line)
    for line in bounds_text(plan.get("bounds", {})):
        console.say(line)
    if plot is not None:
        from uavcover.report.plots import save_pareto_plot

        save_pareto_plot(members, plan, plot)
        console.say(f"wrote {plot}")
    console.suggest(to_paste("select", run, "RULE"))
    console.result(
        {
            "run": str(run),
            "bounds": plan.get("bounds", {}),
            "members": [_document(member) for member in members],
            "plot": None if plot is None else str(plot),
        }
    )
    return 0


def _size_text(size: "MissionSize | None") -> str:
    """Three columns of the table."""
    if size is None:
        return f"{'-':>9}{'-':>10}{'-':>9}"
    return f"{size.sorties:>9}{size.vehicles:>10}{size.makespan_s:>7.0f} s"


def _document(member: "ParetoRow") -> dict[str, Any]:
    """A member with the names of its columns."""
    import dataclasses

    document = dataclasses.asdict(member)
    size = document.pop("mission") or {"sorties": None, "vehicles": None, "makespan_s": None}
    return {**document, **size}

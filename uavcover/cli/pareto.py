"""``uavcover pareto``: the trade-off of a plan."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from uavcover.cli import options
from uavcover.cli.options import option

if TYPE_CHECKING:
    from uavcover.model.route import MissionSize
    from uavcover.planner.pareto_file import ParetoRow

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
    from uavcover.planner.plan_files import say_fleet
    from uavcover.planner.plan_words import (
        figures_header,
        figures_in_words,
        say_missions,
        say_older,
        say_size,
        upload_in_words,
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
    say_older(console, older)
    index = plan.members.index(plan.chosen)
    console.say(figures_header(site.scenario.objective))
    console.say(figures_in_words(f"index:{index}", plan.chosen, site.scenario.objective))
    sorties = flights if len(flights) > 1 else ()
    say_missions(console, folder, flights[0].compiled if len(flights) == 1 else None, sorties)
    fleet = folder.read_json("plan.json", made_by="uavcover plan")["fleet"]
    say_fleet(console, fleet)
    say_size(console, plan)
    if not plan.rule_met:
        console.warn(f"no route meets {plan.rule}; wrote the best one. Lower the requirement, or raise --budget")
    if flights:
        console.suggest(upload_in_words(folder, fleet, len(sorties)))
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
    from uavcover.planner.plan_words import sizes_by_vehicles_in_words
    from uavcover.run.documents import bounds_in_words
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
            f"{_size_in_words(member.mission) if sized else ''}  {member.made_by}"
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
    if line := sizes_by_vehicles_in_words((plan.get("mission") or {}).get("by_vehicles", [])):
        console.say(line)
    for line in bounds_in_words(plan.get("bounds", {})):
        console.say(line)
    if plot is not None:
        from uavcover.report.figures import save_pareto_plot

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


def _size_in_words(size: "MissionSize | None") -> str:
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

"""``uavcover select``: another member of the Pareto set."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from uavcover.cli import options


def select(
    run: Annotated[Path, typer.Argument(help="Run folder with a plan.")],
    rule: Annotated[
        str,
        typer.Argument(
            help=(
                "Rule that selects the route: weighted[:w1,w2,w3], knee, max-coverage, coverage>=0.95 or "
                "index:N (a row of `uavcover pareto`). You can add conditions: ,sorties<=N ,vehicles<=N "
                ",done<=40m."
            ),
            metavar="RULE",
        ),
    ],
    *,
    autopilot: options.Autopilot = None,
    force: Annotated[
        bool,
        typer.Option(
            "--force",
            help="Replace a flown route. It moves to RUN/older-N with its flight.",
        ),
    ] = False,
    output: options.Output,
) -> int:
    """Select another route of the Pareto set, and rewrite plan.json and the mission files.

    If no route meets the rule, the command writes the best route and exits with 1.
    """
    import dataclasses

    from uavcover.errors import InputError
    from uavcover.model.vehicle import autopilot_name
    from uavcover.planner.fleet_document import say_fleet
    from uavcover.planner.plan_words import (
        figures_header,
        figures_in_words,
        say_missions,
        say_older,
        say_size,
        upload_in_words,
    )
    from uavcover.planner.select import choose
    from uavcover.planner.selection_rule import parse_rule
    from uavcover.run.folder import RunFolder, flown_in
    from uavcover.run.planned import read_planned

    console = output.console()
    parse_rule(rule)
    folder = RunFolder(run)
    site, _ = read_planned(folder)
    if autopilot is not None and site.scenario.vehicles:
        raise InputError("--autopilot: each [[vehicle]] has its own autopilot; omit the option")
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
        console.warn(
            f"no route meets {plan.rule}; wrote the best one: lower the requirement, or plan with a larger --budget"
        )
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

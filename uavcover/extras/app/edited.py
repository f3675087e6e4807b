"""``uavcover edit``: a plan with the user's own waypoints, checked and written as any other."""

import json
import sys
import time
from pathlib import Path
from typing import Annotated, Any

import typer

from uavcover.cli import options


def edit(
    run: Annotated[Path, typer.Argument(help="Run folder with the original route, which does not change.")],
    waypoints: Annotated[
        Path,
        typer.Argument(
            help=("JSON file with a list of [longitude, latitude, height above ground in m], in flying order.")
        ),
    ],
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for the results (the run folder).", metavar="RUN")],
    *,
    autopilot: options.Autopilot = None,
    force: options.ForcePlan = False,
    output: options.Output,
) -> int:
    """Check a plan with your own waypoints, and write it with its mission files.

    The command checks every leg, the transit and the return. The new plan states that it was edited.
    """
    from uavcover.errors import InfeasibleError, InputError
    from uavcover.extras.app.scene import Scene
    from uavcover.missions.flights import compile_flights
    from uavcover.missions.mission_files import one_or_several
    from uavcover.missions.part_routes import judge_route
    from uavcover.model.route import Plan, Route
    from uavcover.model.vehicle import autopilot_name
    from uavcover.planner.plan_files import save_plan
    from uavcover.run.folder import OF_A_PLAN, PLAN_FILES, RunFolder
    from uavcover.run.planned import read_planned
    from uavcover.run.user import to_paste
    from uavcover.scenario.vehicle_areas import groups_of

    console = output.console()
    began_s = time.monotonic()
    site, planned = read_planned(RunFolder(run))
    if groups_of(site.scenario):
        raise InputError(
            f"{run}: each vehicle has its own part of the area, and such a plan cannot be edited; plan with one vehicle"
        )
    try:
        given: Any = json.loads(waypoints.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{waypoints}: the file cannot be read as JSON ({error}); use a list of waypoints") from error
    route = Route(Scene(site, run).enu(given))
    member = judge_route(site, route, "edited", margin_m=0.0)
    if member.violation > 0.0:
        from uavcover.planner.front import why_infeasible

        raise InfeasibleError(why_infeasible(site, [member]))
    name = autopilot_name(autopilot, site.scenario.vehicle.autopilot)
    flights = compile_flights(site, route, autopilot=name) if site.frame is not None and site.home_m is not None else ()
    plan = Plan(
        chosen=member, members=(member,), baselines=(), rule="edited", rule_met=True, algorithm="edited", evaluations=0,
        wall_s=time.monotonic() - began_s,
    )  # fmt: skip
    folder = RunFolder(out)
    compiled, sorties = one_or_several(site, flights)
    with folder.reserved((*PLAN_FILES, *OF_A_PLAN), force=force):
        save_plan(
            folder, site, plan, compiled=compiled, autopilot=name, seed=site.scenario.planner.seed, command=sys.argv,
            sorties=sorties,
        )  # fmt: skip
    metrics = member.metrics
    console.say(
        f"edited: {100.0 * metrics.coverage_of_coverable:.2f} % of the visible ground, {metrics.waypoint_count} "
        f"waypoints, {metrics.path_length_m:.0f} m; the previous plan has {len(planned.route)} waypoints"
    )
    console.suggest(to_paste("plan-upload", out, "--to", "udp:127.0.0.1:14550"))
    console.result(
        {
            "run": str(out), "coverage_of_coverable": metrics.coverage_of_coverable, "waypoint_count": metrics.waypoint_count,
            "path_length_m": metrics.path_length_m, "sorties": len(sorties), "mission_files": bool(flights),
        }
    )  # fmt: skip
    return 0

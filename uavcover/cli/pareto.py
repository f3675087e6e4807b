"""``uavcover pareto``: the trade-off of a plan."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from uavcover.cli import options

if TYPE_CHECKING:
    from uavcover.model.route import MissionSize
    from uavcover.planner.pareto_file import ParetoRow


def pareto(
    run: Annotated[Path, typer.Argument(help="Run folder with a plan.")],
    *,
    plot: Annotated[
        Path | None, typer.Option(help="Draw the set to a .png, .svg or .pdf file.", metavar="FILE.png")
    ] = None,
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
        raise OutputError(f"{plot}: this file would be overwritten; use --force, or another name")
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
        f"* is in plan.json; coverage is of the visible ground{'; energy in seconds of hovering' if by_energy else ''}"
        f"{'; done: from the first take-off to the last landing' if sized else ''}"
    )
    if sized and any(member.mission is None for member in members):
        console.say(
            "-: no flights found, or not computed for a large set; a rule such as max-coverage,sorties<=3 evaluates all routes"
        )
    if line := sizes_by_vehicles_in_words((plan.get("mission") or {}).get("by_vehicles", [])):
        console.say(line)
    for line in bounds_in_words(plan.get("bounds", {})):
        console.say(line)
    if plot is not None:
        from uavcover.report.figures import save_pareto_plot

        save_pareto_plot(members, plan, plot)
        console.say(f"written: {plot}")
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

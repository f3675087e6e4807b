"""``uavcover pareto``: the trade-off of a plan."""

from pathlib import Path
from typing import Annotated

import typer

from uavcover.cli import options


def pareto(
    run: Annotated[Path, typer.Argument(help="Run folder with a plan.")],
    *,
    plot: Annotated[Path | None, typer.Option(help="Draw it; .png, .svg or .pdf.", metavar="FILE.png")] = None,
    force: options.Force = False,
    output: options.Output,
) -> int:
    """List the Pareto set of a plan: coverage, waypoints, length and time of every member; or draw it."""
    import dataclasses

    from uavcover.errors import OutputError
    from uavcover.run.documents import bounds_in_words, read_pareto
    from uavcover.run.folder import RunFolder
    from uavcover.run.user import percent, to_paste

    console = output.console()
    folder = RunFolder(run)
    members = read_pareto(folder.existing("pareto.csv", made_by="uavcover plan"))
    plan = folder.read_json("plan.json", made_by="uavcover plan")
    if plot is not None and plot.exists() and not force:
        raise OutputError(f"{plot}: would be overwritten; use --force, or another name")
    by_energy = plan.get("objective") == "energy" and all(m.mission_energy_hover_s is not None for m in members)
    header = f"{'energy':>9}" if by_energy else ""
    console.say(f"{'index':>7}{'coverage':>10}{'waypoints':>11}{'length':>12}{'time':>9}{header}  made by")
    for member in members:
        energy = f"{member.mission_energy_hover_s:>7.0f} s" if by_energy else ""
        console.say(
            f"{'*' if member.chosen else ' '}{member.index:>6}{percent(member.coverage_of_coverable):>10}"
            f"{member.waypoint_count:>11}{member.path_length_m:>10.0f} m{member.time_s:>7.0f} s{energy}  {member.made_by}"
        )
    console.say(
        f"* is in plan.json; coverage is of what can be seen{'; energy in seconds of hovering' if by_energy else ''}"
    )
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
            "members": [dataclasses.asdict(member) for member in members],
            "plot": None if plot is None else str(plot),
        }
    )
    return 0

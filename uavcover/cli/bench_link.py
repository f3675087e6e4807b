"""``uavcover bench link``: missions over links that lose datagrams, against MAVSDK."""

from pathlib import Path
from typing import Annotated

import typer

from uavcover.cli import options


def bench_link(
    *,
    clients: Annotated[
        str | None, typer.Option(help="Some of simulated,native,mavsdk; default: all.", metavar="A,B")
    ] = None,
    losses: Annotated[
        str, typer.Option(help="Shares of the datagrams that get lost, each way.", metavar="X,Y")
    ] = "0,0.05,0.1,0.2,0.3,0.4",
    delay_ms: Annotated[
        float, typer.Option("--delay", help="How long each datagram is under way, in milliseconds.", min=0.0)
    ] = 1.0,
    seeds: Annotated[int, typer.Option(help="Runs of each cell; their numbers, from 0, are their seeds.", min=1)] = 50,
    at_a_time: Annotated[
        int, typer.Option("--at-a-time", help="Transfers over UDP at once, where datagrams get lost.", min=1)
    ] = 16,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="Folder of the results; runs in it are kept.", metavar="DIR")
    ] = None,
    output: options.Output,
) -> int:
    """Upload and download 100 items with vehicles that time out as ArduPilot and PX4 do, and count what worked.

    Clients: ours in simulated time, ours over UDP, MAVSDK's over UDP. Stop it when you like: what is done is kept, and
    the same command goes on. Results: outcomes.csv (every transfer), link.csv and link.md (every cell).
    """
    from uavcover.benchmarks.link.runs import read_outcomes, run_missing, trials
    from uavcover.benchmarks.link.trials import CLIENTS, cells_of, csv_lines, markdown
    from uavcover.errors import InputError
    from uavcover.run.folder import write_text

    console = output.console()
    if out is None:
        raise InputError("-o/--out: name the folder of the results, as: uavcover bench link -o link")
    chosen = options.names("--clients", clients, CLIENTS)
    try:
        shares = [float(text) for text in losses.split(",")]
    except ValueError:
        raise InputError(f"--losses: {losses!r} are not numbers; write them as 0,0.1,0.3") from None
    if not all(0.0 <= share < 1.0 for share in shares):
        raise InputError(f"--losses: {losses!r} are not all from 0 to below 1")
    wanted = trials(clients=chosen, losses=shares, delay_s=delay_ms / 1e3, seeds=seeds)
    done = {outcome.trial for outcome in read_outcomes(out)}
    missing = sum(trial not in done for trial in wanted)
    console.say(f"{len(wanted)} transfers, {len(wanted) - missing} of them already in {out}")
    try:
        with console.progress("transfers", total=missing) as bar:
            for number, outcome in enumerate(run_missing(out, wanted, at_a_time=at_a_time), start=1):
                bar.update(number, note=f"{number} of {missing}, last {outcome.trial.client} {outcome.trial.loss:.0%}")
    except KeyboardInterrupt:
        console.warn(f"stopped; the transfers that are done are in {out}: the same command goes on")
        raise
    cells = cells_of(read_outcomes(out))
    write_text(out / "link.csv", "\n".join(csv_lines(cells)) + "\n")
    write_text(out / "link.md", markdown(cells) + "\n")
    console.say(markdown(cells))
    console.result(
        {"transfers": len(wanted), "made": missing, "wrong_unnoticed": sum(cell.wrong_unnoticed for cell in cells)}
    )
    return 0

"""``uavcover bench paper``: the paper's simulation, Tables 5 and 6, Figures 7 to 11."""

from pathlib import Path
from typing import Annotated

import typer

from uavcover.cli import options


def bench_paper(
    *,
    readings: Annotated[
        str | None, typer.Option(help="Some of the readings, as R2-ray,planar; default: all.", metavar="A,B")
    ] = None,
    runs: Annotated[int, typer.Option(help="Runs of each; their numbers, from 1, are their seeds.", min=1)] = 5,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="Folder of the results; runs in it are kept.", metavar="DIR")
    ] = None,
    population: Annotated[int, typer.Option(help="Beetles.", min=20)] = 50,
    iterations: Annotated[int, typer.Option(help="Iterations of each run.", min=1)] = 500,
    processes: Annotated[
        int | None, typer.Option(help="Runs at a time; default: one for each core.", min=1, metavar="N")
    ] = None,
    list_names: Annotated[bool, typer.Option("--list", help="Print the readings and end.")] = False,
    output: options.Output,
) -> int:
    """Run MODBO and IMODBO on the paper's simulation, under five readings of its sensor.

    Stop it when you like: what is done is kept, and the same command goes on. Results: tables.md (Tables 5 and 6 beside
    the paper's, and which reading fits), runs.csv, the routes, figure7.png and figures8-11-READING.png.
    """
    from uavcover.benchmarks.paper.results import write_results
    from uavcover.benchmarks.paper.runs import ALGORITHMS, READINGS, make_runs, paper_runs
    from uavcover.benchmarks.runs import KeptRuns, available_cores
    from uavcover.errors import InputError

    console = output.console()
    if list_names:
        for reading in READINGS.values():
            console.say(f"{reading.name:12} {reading.meaning}")
        console.result({"readings": list(READINGS)})
        return 0
    chosen = options.names("--readings", readings, READINGS)
    if out is None:
        raise InputError("-o/--out: name the folder of the results, as: uavcover bench paper -o paper")
    folder = KeptRuns(out, {"population": population, "iterations": iterations})
    with folder.reserved():
        wanted = paper_runs(chosen, ALGORITHMS, runs)
        missing = [run for run in wanted if not folder.has(run.key)]
        console.say(f"{len(wanted)} runs, {len(wanted) - len(missing)} of them already in {out}")
        made = make_runs(
            folder, missing, population=population, iterations=iterations, processes=processes or available_cores()
        )
        try:
            with console.progress("runs", total=len(missing)) as bar:
                for done, run in enumerate(made, start=1):
                    bar.update(done, note=f"{done} of {len(missing)}, last {run.key}")
        except KeyboardInterrupt:
            console.warn(f"stopped; the runs that are done are in {out}: the same command goes on")
            raise
        files = write_results(folder)
    for file in files:
        console.say(f"written: {file}")
    console.result({"runs": len(wanted), "made": len(missing), "files": [str(file) for file in files]})
    return 0

"""``uavcover bench mmf``: optimizers on the 24 functions of the paper, and its tables and figures."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from uavcover.cli import options


@dataclass(frozen=True, slots=True)
class RunSize:
    """How much each run does and returns."""

    population: Annotated[int, typer.Option(help="Candidates of each iteration.", min=1)] = 200
    iterations: Annotated[int, typer.Option(help="Iterations of each run.", min=1)] = 500
    archive: Annotated[int, typer.Option(help="Most solutions that a run returns.", min=1)] = 200


def bench_mmf(
    *,
    functions: Annotated[
        str | None, typer.Option(help="Some of the functions, as MMF1,MMF14_a; default: all.", metavar="A,B")
    ] = None,
    algorithms: Annotated[
        str | None,
        typer.Option(
            help="Some of the algorithms, as imodbo,pymoo:NSGA3,my_module:MyClass; default: all of ours.", metavar="X,Y"
        ),
    ] = None,
    runs: Annotated[int, typer.Option(help="Runs of each; their numbers, from 1, are their seeds.", min=1)] = 10,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="Folder of the results; runs in it are kept.", metavar="DIR")
    ] = None,
    size: RunSize,
    processes: Annotated[
        int | None, typer.Option(help="Runs at a time; default: one for each core.", min=1, metavar="N")
    ] = None,
    list_names: Annotated[bool, typer.Option("--list", help="Print the names and end.")] = False,
    output: options.Output,
) -> int:
    """Run optimizers on the 24 multimodal functions, and tabulate IGD, IGDx, CR, PSP and hypervolume.

    Stop it when you like: what is done is kept, and the same command goes on. Results: summary.csv, tables.md with
    the paper's figures beside, runs.csv, comparisons.csv, figure3.png to figure6.png, and sets/FUNCTION/ALGORITHM/RUN.csv.
    """
    from uavcover.benchmarks.mmf.problems import PROBLEMS
    from uavcover.benchmarks.mmf.results import write_results
    from uavcover.benchmarks.mmf.runs import Budget, MmfFolder, contender_names, make_runs, missing_runs
    from uavcover.benchmarks.runs import available_cores
    from uavcover.errors import InputError

    console = output.console()
    if list_names:
        console.say(f"functions:  {' '.join(PROBLEMS)}")
        console.say(f"algorithms: {' '.join(contender_names())}")
        console.result({"functions": list(PROBLEMS), "algorithms": contender_names()})
        return 0
    chosen_functions = options.names("--functions", functions, PROBLEMS)
    chosen_algorithms = options.names("--algorithms", algorithms, contender_names(options.listed(algorithms)))
    if out is None:
        raise InputError("-o/--out: name the folder of the results, as: uavcover bench mmf -o mmf")
    folder, budget = MmfFolder(out), Budget(size.population, size.iterations, size.archive)
    with folder.reserved(budget):
        missing = missing_runs(folder, functions=chosen_functions, algorithms=chosen_algorithms, runs=runs)
        wanted = len(chosen_functions) * len(chosen_algorithms) * runs
        console.say(f"{wanted} runs, {wanted - len(missing)} of them already in {out}")
        try:
            with console.progress("runs", total=len(missing)) as bar:
                made = make_runs(folder, missing, budget, processes=processes or available_cores())
                for done, run in enumerate(made, start=1):
                    bar.update(done, note=f"{done} of {len(missing)}, last {run}")
        except KeyboardInterrupt:
            console.warn(f"stopped; the runs that are done are in {out}: the same command goes on")
            raise
        files = write_results(folder, budget)
    for file in files:
        console.say(f"written: {file}")
    console.result({"runs": wanted, "made": len(missing), "files": [str(file) for file in files]})
    return 0

"""``uavcover bench coverage``: planners and baselines on the bundled scenarios."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from uavcover.cli import options


@dataclass(frozen=True, slots=True)
class SeedsAndTimes:
    """How often and for how long each planner runs."""

    seeds: Annotated[int, typer.Option(help="Runs of each planner; their numbers, from 1, are their seeds.", min=1)] = (
        10
    )
    seeds_long: Annotated[
        int, typer.Option("--seeds-long", help="Runs with budgets above 100 s.", min=1, metavar="N")
    ] = 3
    times: Annotated[str, typer.Option("--time", help="Budgets in seconds of processor time.", metavar="S,T")] = (
        "10,60,300"
    )


def bench_coverage(
    *,
    scenarios: Annotated[
        str | None, typer.Option(help="Some of the scenarios, as paper-r1,jacksboro; default: all.", metavar="A,B")
    ] = None,
    algorithms: Annotated[
        str | None, typer.Option(help="Some of the contenders, as memetic,nsga2; default: all.", metavar="X,Y")
    ] = None,
    each: SeedsAndTimes,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="Folder of the results; runs in it are kept.", metavar="DIR")
    ] = None,
    processes: Annotated[
        int | None, typer.Option(help="Runs at a time; default: one for each core.", min=1, metavar="N")
    ] = None,
    list_names: Annotated[bool, typer.Option("--list", help="Print the names and end.")] = False,
    output: options.Output,
) -> int:
    """Compare the planner with baselines and other optimizers, at equal processor time and at equal evaluations.

    Stop it when you like: what is done is kept, and the same command goes on; what tells most comes first. A run with a
    long budget tells the shorter ones as well. Results: table.md, runs.csv and coverage.png.
    """
    from uavcover.benchmarks.coverage.contenders import CONTENDERS
    from uavcover.benchmarks.coverage.judging import CASES
    from uavcover.benchmarks.coverage.results import write_results
    from uavcover.benchmarks.coverage.runs import make_runs, wanted_runs
    from uavcover.benchmarks.runs import KeptRuns, available_cores
    from uavcover.errors import InputError

    console = output.console()
    if list_names:
        console.say(f"scenarios:  {' '.join(CASES)}")
        console.say(f"algorithms: {' '.join(CONTENDERS)}")
        console.result({"scenarios": list(CASES), "algorithms": list(CONTENDERS)})
        return 0
    chosen_scenarios = options.names("--scenarios", scenarios, CASES)
    chosen_algorithms = options.names("--algorithms", algorithms, CONTENDERS)
    times_s = _seconds(each.times)
    if out is None:
        raise InputError("-o/--out: name the folder of the results, as: uavcover bench coverage -o coverage")
    folder = KeptRuns(out, {"benchmark": "coverage"})
    with folder.reserved():
        wanted = wanted_runs(
            scenarios=chosen_scenarios,
            algorithms=chosen_algorithms,
            seeds=each.seeds,
            seeds_long=each.seeds_long,
            times_s=times_s,
        )
        missing = [run for run in wanted if not folder.has(run.key)]
        console.say(f"{len(wanted)} runs, {len(wanted) - len(missing)} of them already in {out}")
        whole_s, done_s, begin = sum(run.guessed_s for run in missing), 0.0, time.monotonic()
        try:
            with console.progress("runs", total=len(missing)) as bar:
                made = make_runs(folder, missing, times_s=times_s, processes=processes or available_cores())
                for done, run in enumerate(made, start=1):
                    done_s += run.guessed_s
                    left_min = (whole_s / done_s - 1.0) * (time.monotonic() - begin) / 60.0
                    bar.update(done, note=f"{done} of {len(missing)}, about {left_min:.0f} min left, last {run.key}")
        except KeyboardInterrupt:
            write_results(folder, command=_command(scenarios, algorithms, each))
            console.warn(f"stopped; the runs that are done are in {out}, with their table: the same command goes on")
            raise
        files = write_results(folder, command=_command(scenarios, algorithms, each))
    for file in files:
        console.say(f"written: {file}")
    console.result({"runs": len(wanted), "made": len(missing), "files": [str(file) for file in files]})
    return 0


def _seconds(text: str) -> list[float]:
    from uavcover.errors import InputError

    try:
        times_s = [float(part) for part in text.split(",")]
    except ValueError:
        times_s = []
    if not times_s or not all(0.0 < value < 1e6 for value in times_s):
        raise InputError(f"--time: {text!r} are not seconds above 0; write them as 10,60")
    return sorted(set(times_s))


def _command(scenarios: str | None, algorithms: str | None, each: SeedsAndTimes) -> str:
    parts = ["uavcover bench coverage"]
    if scenarios is not None:
        parts.append(f"--scenarios {scenarios}")
    if algorithms is not None:
        parts.append(f"--algorithms {algorithms}")
    return " ".join([*parts, f"--seeds {each.seeds} --time {each.times} -o DIR"])

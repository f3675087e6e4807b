"""``uavcover bench``: the benchmarks of this project, each a command of its own."""

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from uavcover.cli import options
from uavcover.cli.main import ending_well
from uavcover.cli.options import Overview, one_by_one, option
from uavcover.errors import InputError

if TYPE_CHECKING:
    from uavcover.cli.console import Console
    from uavcover.extras.benchmarks.runs import KeptRuns

bench = typer.Typer(
    cls=Overview,
    help=("Run this project's benchmarks. You can stop a benchmark at any time and run it again to continue."),
    rich_markup_mode=None,
)

ResultsFolder = Annotated[Path | None, option("-o", "--out", "Folder for the results. Existing runs are kept.", "DIR")]
Processes = Annotated[int | None, option("Number of parallel runs; default: one per core.", "N", min=1)]


@dataclass(frozen=True, slots=True)
class SeedsAndTimes:
    """Number and duration of runs for each planner."""

    seeds: Annotated[int, option("Number of runs for each planner. Seeds start at 1.", min=1)] = 10
    seeds_long: Annotated[int, option("Number of runs for time budgets above 100 s.", "N", min=1)] = 3
    times: Annotated[str, option("--time", "Time budgets, in seconds of processor time.", "S,T")] = "10,60,300"
    equal_evaluations: Annotated[
        bool,
        option(
            "--equal-evaluations/--no-equal-evaluations",
            "Also run without a time limit, with the number of evaluations that each scenario sets.",
        ),
    ] = True


def bench_coverage(
    *,
    scenarios: Annotated[
        str | None, option("Scenarios to run, such as paper-r1,jacksboro; default: all.", "A,B")
    ] = None,
    algorithms: Annotated[
        str | None, option("Algorithms to compare, such as memetic,nsga2; default: all.", "X,Y")
    ] = None,
    each: SeedsAndTimes,
    out: ResultsFolder = None,
    processes: Processes = None,
    scheduler: options.Scheduler = None,
    list_names: Annotated[bool, option("--list", "Print the available names and exit.")] = False,
    output: options.Output,
) -> int:
    """Compare the planner with baselines and other optimizers, at equal processor time and at equal evaluations.

    You can stop the benchmark at any time and repeat the command to continue. The most informative runs come first. A
    run with a long budget also provides the results of shorter budgets. Results: table.md, runs.csv and coverage.png.
    """
    from uavcover.extras.benchmarks.coverage.judging import CASES
    from uavcover.extras.benchmarks.coverage.results import write_results
    from uavcover.extras.benchmarks.coverage.runs import CONTENDERS, make_runs, wanted_runs
    from uavcover.extras.benchmarks.runs import KeptRuns

    console = output.console()
    if list_names:
        console.say(f"scenarios:  {' '.join(CASES)}")
        console.say(f"algorithms: {' '.join(CONTENDERS)}")
        console.result({"scenarios": list(CASES), "algorithms": list(CONTENDERS)})
        return 0
    chosen_scenarios = options.names("--scenarios", scenarios, CASES)
    chosen_algorithms = options.names("--algorithms", algorithms, CONTENDERS)
    times_s = _seconds(each.times)
    out = _given(out, "coverage -o coverage")
    folder = KeptRuns(out, {"benchmark": "coverage"})
    with folder.reserved():
        wanted = wanted_runs(
            scenarios=chosen_scenarios,
            algorithms=chosen_algorithms,
            seeds=each.seeds,
            seeds_long=each.seeds_long,
            times_s=times_s,
            equal_evaluations=each.equal_evaluations,
        )
        missing = [run for run in wanted if not folder.has(str(run))]
        console.say(f"runs: {len(wanted)}; already in {out}: {len(wanted) - len(missing)}")
        whole_s, done_s, begin = sum(run.guessed_s for run in missing), 0.0, time.monotonic()
        try:
            with console.progress("runs", total=len(missing)) as bar:
                made = make_runs(folder, missing, times_s=times_s, processes=processes, scheduler=scheduler)
                for done, run in enumerate(made, start=1):
                    done_s += run.guessed_s
                    left_min = (whole_s / done_s - 1.0) * (time.monotonic() - begin) / 60.0
                    bar.update(done, note=f"{done} of {len(missing)}, about {left_min:.0f} min left, last {run}")
        except KeyboardInterrupt:
            write_results(folder, command=_command(scenarios, algorithms, each))
            console.warn(f"stopped; completed runs and their table are in {out}; run the command again to continue")
            raise
        files = write_results(folder, command=_command(scenarios, algorithms, each))
    return _said(console, files, runs=len(wanted), made=len(missing))


def _given(out: Path | None, example: str) -> Path:
    if out is None:
        raise InputError(f"-o/--out: specify a folder for the results, for example: uavcover bench {example}")
    return out


def _show(console: "Console", what: str, made: Iterable[object], total: int) -> None:
    with console.progress(what, total=total) as bar:
        for done, name in enumerate(made, start=1):
            bar.update(done, note=f"{done} of {total}, last {name}")


def _follow(console: "Console", what: str, made: Iterable[object], total: int, *, kept_in: Path) -> None:
    """Show each that is made; if the user stops it, say how to continue."""
    try:
        _show(console, what, made, total)
    except KeyboardInterrupt:
        console.warn(f"stopped; completed {what} are in {kept_in}; run the command again to continue")
        raise


def _said(console: "Console", files: Sequence[Path], *, runs: int, made: int) -> int:
    for file in files:
        console.say(f"wrote {file}")
    console.result({"runs": runs, "made": made, "files": [str(file) for file in files]})
    return 0


def _seconds(text: str) -> list[float]:
    try:
        times_s = [float(part) for part in text.split(",")]
    except ValueError:
        times_s = []
    if not times_s or not all(0.0 < value < 1e6 for value in times_s):
        raise InputError(f"--time: must be a list of times above 0 s, such as 10,60, not {text!r}")
    return sorted(set(times_s))


def _command(scenarios: str | None, algorithms: str | None, each: SeedsAndTimes) -> str:
    parts = ["uavcover bench coverage"]
    if scenarios is not None:
        parts.append(f"--scenarios {scenarios}")
    if algorithms is not None:
        parts.append(f"--algorithms {algorithms}")
    parts.append(f"--seeds {each.seeds} --seeds-long {each.seeds_long} --time {each.times}")
    if not each.equal_evaluations:
        parts.append("--no-equal-evaluations")
    return " ".join([*parts, "-o DIR"])


def bench_link(
    *,
    clients: Annotated[str | None, option("Clients to compare: simulated,native,mavsdk; default: all.", "A,B")] = None,
    losses: Annotated[
        str, option("Fractions of datagrams to lose in each direction.", "X,Y")
    ] = "0,0.05,0.1,0.2,0.3,0.4",
    delay_ms: Annotated[float, option("--delay", "Delay of each datagram, in milliseconds.", min=0.0)] = 1.0,
    seeds: Annotated[int, option("Number of runs for each client and loss fraction. Seeds start at 0.", min=1)] = 50,
    at_a_time: Annotated[int, option("Number of simultaneous UDP transfers in runs with losses.", min=1)] = 16,
    out: ResultsFolder = None,
    output: options.Output,
) -> int:
    """Upload and download 100 items over links that lose datagrams, and count the successful transfers.

    The simulated vehicles use the timeouts of ArduPilot and PX4. The clients are mission_io in simulated time,
    mission_io over UDP and MAVSDK over UDP. You can stop the benchmark at any time and repeat the command to continue.
    Results: outcomes.csv with every transfer, link.csv and link.md.
    """
    from uavcover.extras.benchmarks.link.peers import CLIENTS, Cell, cells_of, markdown
    from uavcover.extras.benchmarks.link.runs import read_outcomes, run_missing, trials
    from uavcover.extras.benchmarks.runs import csv_text
    from uavcover.run.folder import write_text

    console = output.console()
    out = _given(out, "link -o link")
    chosen = options.names("--clients", clients, CLIENTS)
    try:
        fractions = [float(text) for text in losses.split(",")]
    except ValueError:
        raise InputError(f"--losses: must be a list of numbers such as 0,0.1,0.3, not {losses!r}") from None
    if not all(0.0 <= fraction < 1.0 for fraction in fractions):
        raise InputError(f"--losses: each number must be at least 0 and below 1, not {losses!r}")
    wanted = trials(clients=chosen, losses=fractions, delay_s=delay_ms / 1e3, seeds=seeds)
    done = {outcome.trial for outcome in read_outcomes(out)}
    missing = sum(trial not in done for trial in wanted)
    console.say(f"transfers: {len(wanted)}; already in {out}: {len(wanted) - missing}")
    made = (each.trial for each in run_missing(out, wanted, at_a_time=at_a_time))
    _follow(console, "transfers", (f"{trial.client} {trial.loss:.0%}" for trial in made), missing, kept_in=out)
    cells = cells_of(read_outcomes(out))
    write_text(out / "link.csv", csv_text([field.name for field in fields(Cell)], map(astuple, cells)))
    write_text(out / "link.md", markdown(cells) + "\n")
    for line in markdown(cells).splitlines():
        console.say(line)
    console.result(
        {"transfers": len(wanted), "made": missing, "wrong_unnoticed": sum(cell.wrong_unnoticed for cell in cells)}
    )
    return 0


def bench_areas(
    data: Annotated[Path, typer.Argument(help="The folder AC300 of the AreaCoverage dataset.", metavar="DATA")],
    *,
    names: Annotated[str | None, option("Areas to plan, such as AC1_0000,AC15_0019; default: all.", "A,B")] = None,
    budget_s: Annotated[
        float, option("--budget", "Search time per area, in seconds of processor time.", min=1.0)
    ] = 40.0,
    capacity_s: Annotated[
        float | None, option("--capacity", "Longest flight, in seconds: 1200 as published; default: no limit.", min=1.0)
    ] = None,
    out: ResultsFolder = None,
    processes: Processes = None,
    output: options.Output,
) -> int:
    """Plan the areas with holes of the AreaCoverage dataset, and compare the routes with the published ones.

    You can stop the benchmark at any time and repeat the command to continue. Results: areas.csv.
    """
    from uavcover.extras.benchmarks.areas import area_names, plan_areas, summary, table_lines
    from uavcover.extras.benchmarks.runs import KeptRuns, available_cores

    console = output.console()
    out = _given(out, "areas AC300 -o areas")
    chosen = options.names("--names", names, area_names(data))
    capacity = {} if capacity_s is None else {"capacity_s": capacity_s}
    folder = KeptRuns(out, {"benchmark": "areas", "budget_s": budget_s, **capacity})
    cores = processes or available_cores()
    return _compare(
        console, folder, "areas", chosen, table_lines, summary,
        plan=lambda missing: plan_areas(
            folder, missing, data=data, budget_s=budget_s, capacity_s=capacity_s, processes=cores
        ),
    )  # fmt: skip


def bench_cetsp(
    data: Annotated[
        Path,
        typer.Argument(help="Folder with copies of d-krupke/close-enough-tsp and leizy1008/MA-CETSP.", metavar="DATA"),
    ],
    *,
    names: Annotated[str | None, option("Instances to plan, such as bubbles1,d493_or2; default: all.", "A,B")] = None,
    budget_s: Annotated[
        float, option("--budget", "Search time per instance, in seconds of processor time.", min=1.0)
    ] = 60.0,
    out: ResultsFolder = None,
    processes: Processes = None,
    output: options.Output,
) -> int:
    """Plan tours that observe discs of one radius (close-enough TSP), and compare them with the best known ones.

    You can stop the benchmark at any time and repeat the command to continue. Results: cetsp.csv.
    """
    from uavcover.extras.benchmarks.cetsp import plan_instances, read_instances, summary, table_lines
    from uavcover.extras.benchmarks.runs import KeptRuns, available_cores

    console = output.console()
    out = _given(out, "cetsp DATA -o cetsp")
    instances = read_instances(data)
    chosen = options.names("--names", names, instances)
    folder = KeptRuns(out, {"benchmark": "cetsp", "budget_s": budget_s})
    cores = processes or available_cores()

    def plan(missing: list[str]) -> Iterator[object]:
        return plan_instances(folder, [instances[name] for name in missing], budget_s=budget_s, processes=cores)

    return _compare(console, folder, "instances", chosen, table_lines, summary, plan=plan)


def _compare(
    console: "Console", folder: "KeptRuns", what: str, chosen: list[str],
    table_lines: "Callable[[KeptRuns], list[str]]", summary: "Callable[[KeptRuns], str]", *,
    plan: Callable[[list[str]], Iterator[object]],
) -> int:  # fmt: skip
    from uavcover.run.folder import write_text

    with folder.reserved():
        missing = [name for name in chosen if not folder.has(name)]
        console.say(f"{what}: {len(chosen)}; already in {folder.path}: {len(chosen) - len(missing)}")
        try:
            _show(console, what, plan(missing), len(missing))
        finally:
            if folder.done():
                table = folder.path / f"{folder.settings['benchmark']}.csv"
                write_text(table, "\n".join(table_lines(folder)) + "\n")
    console.say(summary(folder))
    console.result({what: len(chosen), "made": len(missing), "summary": summary(folder)})
    return 0


@dataclass(frozen=True, slots=True)
class RunSize:
    """Size of each run and of its result."""

    population: Annotated[int, option("Number of candidates per iteration.", min=1)] = 200
    iterations: Annotated[int, option("Number of iterations per run.", min=1)] = 500
    archive: Annotated[int, option("Maximum number of solutions that a run returns.", min=1)] = 200


def bench_mmf(
    *,
    functions: Annotated[str | None, option("Functions to run, such as MMF1,MMF14_a; default: all.", "A,B")] = None,
    algorithms: Annotated[
        str | None,
        option(
            "Algorithms to compare, such as imodbo,pymoo:NSGA3,my_module:MyClass; default: all built-in algorithms.",
            "X,Y",
        ),
    ] = None,
    runs: Annotated[int, option("Number of runs. Seeds start at 1.", min=1)] = 10,
    out: ResultsFolder = None,
    size: RunSize,
    processes: Processes = None,
    scheduler: options.Scheduler = None,
    list_names: Annotated[bool, option("--list", "Print the available names and exit.")] = False,
    output: options.Output,
) -> int:
    """Run optimizers on the 24 multimodal functions, and compute IGD, IGDx, CR, PSP and hypervolume.

    You can stop the benchmark at any time and repeat the command to continue. Results: summary.csv, tables.md with the
    values of the paper, runs.csv, comparisons.csv, figure3.png to figure6.png, and sets/FUNCTION/ALGORITHM/RUN.csv.
    """
    from uavcover.extras.benchmarks.mmf.problems import PROBLEMS
    from uavcover.extras.benchmarks.mmf.runs import (
        Budget,
        MmfFolder,
        contender_names,
        make_runs,
        missing_runs,
        try_each,
    )
    from uavcover.extras.benchmarks.mmf.tables import write_results

    console = output.console()
    if list_names:
        console.say(f"functions:  {' '.join(PROBLEMS)}")
        console.say(f"algorithms: {' '.join(contender_names())}")
        console.result({"functions": list(PROBLEMS), "algorithms": contender_names()})
        return 0
    chosen_functions = options.names("--functions", functions, PROBLEMS)
    chosen_algorithms = options.names("--algorithms", algorithms, contender_names(options.listed(algorithms)))
    out = _given(out, "mmf -o mmf")
    folder, budget = MmfFolder(out), Budget(size.population, size.iterations, size.archive)
    try_each(chosen_algorithms, budget)
    with folder.reserved(budget):
        missing = missing_runs(folder, functions=chosen_functions, algorithms=chosen_algorithms, runs=runs)
        wanted = len(chosen_functions) * len(chosen_algorithms) * runs
        console.say(f"runs: {wanted}; already in {out}: {wanted - len(missing)}")
        made = make_runs(folder, missing, budget, processes=processes, scheduler=scheduler)
        _follow(console, "runs", made, len(missing), kept_in=out)
        files = write_results(folder, budget)
    return _said(console, files, runs=wanted, made=len(missing))


def bench_paper(
    *,
    readings: Annotated[
        str | None, option("Interpretations of the sensor, such as R2-ray,planar; default: all.", "A,B")
    ] = None,
    runs: Annotated[int, option("Number of runs. Seeds start at 1.", min=1)] = 5,
    out: ResultsFolder = None,
    population: Annotated[int, option("Number of beetles.", min=20)] = 50,
    iterations: Annotated[int, option("Number of iterations per run.", min=1)] = 500,
    processes: Processes = None,
    list_names: Annotated[bool, option("--list", "Print the available interpretations and exit.")] = False,
    output: options.Output,
) -> int:
    """Run MODBO and IMODBO on the simulation of the paper, with five interpretations of its sensor.

    You can stop the benchmark at any time and repeat the command to continue. Results: tables.md with Tables 5 and 6
    and the values of the paper, runs.csv, the routes, figure7.png and figures8-11-READING.png.
    """
    from uavcover.extras.benchmarks.paper import READINGS, make_runs, paper_runs, write_results
    from uavcover.extras.benchmarks.runs import KeptRuns, available_cores

    console = output.console()
    if list_names:
        for reading in READINGS.values():
            console.say(f"{reading.name:12} {reading.meaning}")
        console.result({"readings": list(READINGS)})
        return 0
    chosen = options.names("--readings", readings, READINGS)
    out = _given(out, "paper -o paper")
    folder = KeptRuns(out, {"population": population, "iterations": iterations})
    with folder.reserved():
        wanted = paper_runs(chosen, runs)
        missing = [run for run in wanted if not folder.has(str(run))]
        console.say(f"runs: {len(wanted)}; already in {out}: {len(wanted) - len(missing)}")
        made = make_runs(
            folder, missing, population=population, iterations=iterations, processes=processes or available_cores()
        )
        _follow(console, "runs", made, len(missing), kept_in=out)
        files = write_results(folder)
    return _said(console, files, runs=len(wanted), made=len(missing))


_BENCHMARKS: dict[str, tuple[Callable[..., int], str]] = {
    "areas": (bench_areas, "areas with holes from the AreaCoverage dataset, compared with the published routes"),
    "cetsp": (bench_cetsp, "close-enough TSP: discs observed from waypoints, compared with the best known tours"),
    "coverage": (bench_coverage, "planners and baselines on the bundled scenarios, with equal time budgets"),
    "link": (bench_link, "mission transfers over links that lose datagrams, compared with MAVSDK"),
    "mmf": (bench_mmf, "the paper's 24 functions: Tables 3 and 4, statistical tests, figures"),
    "paper": (bench_paper, "the paper's simulation: Tables 5 and 6, Figures 7 to 11"),
}

for _name, (_run, _short) in _BENCHMARKS.items():
    bench.command(_name, short_help=_short, rich_help_panel="Measure")(ending_well(one_by_one(_run)))


@bench.callback()
def _group() -> None:
    """Keep ``mmf`` a command also while it is the only one."""

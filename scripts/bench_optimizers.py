"""Measure the optimizers: own time per evaluation against pymoo's NSGA-II run natively in pymoo, and memory over 5,000 rounds.

Usage: .venv/bin/python scripts/bench_optimizers.py [--algorithms A,B] [--rounds N] [--repeats N] [--memory A,B]
           [-o docs/results/optimizers.md]

Own time is CPU time of this process without the function's: `ask`, `tell` and the final `pareto_set` of ours, all of pymoo's
`minimize` but the evaluation. Every repetition runs everything once, so a ratio compares neighbours in time; the median of
the repetitions is reported. One BLAS thread. Memory is measured by a process for each algorithm.
"""

import os

os.environ |= dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")

import argparse
import csv
import datetime
import gc
import json
import platform
import shlex
import statistics
import subprocess
import sys
import time
import tracemalloc
from importlib import metadata
from multiprocessing.pool import ThreadPool
from pathlib import Path

from pymoo.algorithms.moo.nsga2 import NSGA2
from pymoo.functions import is_compiled
from pymoo.optimize import minimize

from scripts.options import file_to_write, names_of
from uavcover.extras.benchmarks.mmf.problems import PROBLEMS
from uavcover.extras.benchmarks.mmf.pymoo_problems import MmfInPymoo
from uavcover.optimizers import ALGORITHMS
from uavcover.optimizers.ask_tell import AskTellOptimizer
from uavcover.optimizers.pymoo.adapters import PymooOptimizer

POPULATION = 200
FUNCTIONS = ("MMF1", "MMF14", "MMF15")
NATIVE = "pymoo NSGA-II"
MEMORY_ROUNDS = (500, 2500, 5000)
MEMORY_POPULATION = 20


class TimedProblem(MmfInPymoo):
    """An MMF problem that adds up the CPU time of its function."""

    function_s = 0.0

    def _evaluate(self, x, out, *args, **settings):
        started = time.process_time()
        super()._evaluate(x, out, *args, **settings)
        self.function_s += time.process_time() - started


def native_us(function: str, rounds: int, seed: int) -> float:
    """Own microseconds per evaluation of pymoo's NSGA-II with its default operators, in pymoo."""
    problem = TimedProblem(function)
    started = time.process_time()
    minimize(problem, NSGA2(pop_size=POPULATION), ("n_gen", rounds), seed=seed)
    return 1e6 * (time.process_time() - started - problem.function_s) / (POPULATION * rounds)


def built(name: str, function: str, *, population: int, rounds: int, seed: int) -> AskTellOptimizer:
    """One of ours for a function of the suite; those that take one objective get the first."""
    problem = PROBLEMS[function]
    return ALGORITHMS[name](
        problem.lower,
        problem.upper,
        n_objectives=ALGORITHMS[name].most_objectives or problem.n_objectives,
        population_size=population,
        max_iterations=rounds,
        seed=seed,
    )


def own_us(name: str, function: str, rounds: int, seed: int) -> float:
    """Own microseconds per evaluation of one of ours."""
    evaluate, width = PROBLEMS[function].evaluate, ALGORITHMS[name].most_objectives
    own_s, started = 0.0, time.process_time()
    optimizer = built(name, function, population=POPULATION, rounds=rounds, seed=seed)
    while not optimizer.should_stop:
        x = optimizer.ask()
        own_s += time.process_time() - started
        values = evaluate(x)[:, :width]
        started = time.process_time()
        optimizer.tell(values)
    optimizer.pareto_set()
    own_s += time.process_time() - started
    return 1e6 * own_s / (POPULATION * rounds)


def times(names: list[str], rounds: int, repeats: int) -> dict[tuple[str, str], list[float]]:
    """(algorithm, function) -> microseconds per evaluation of each repetition, taken turn by turn."""
    measured: dict[tuple[str, str], list[float]] = {}
    for function in FUNCTIONS:
        for name in names:  # compile the kernels
            own_us(name, function, 3, 0)
        native_us(function, 3, 0)
    for seed in range(1, repeats + 1):
        for function in FUNCTIONS:
            measured.setdefault((NATIVE, function), []).append(native_us(function, rounds, seed))
            for name in names:
                measured.setdefault((name, function), []).append(own_us(name, function, rounds, seed))
            print(f"repetition {seed} of {repeats}: {function}", file=sys.stderr, flush=True)
    return measured


def report_memory(name: str) -> None:
    """Print traced and resident KiB after each of `MEMORY_ROUNDS`, as JSON; for a process of its own."""
    optimizer = built(name, "MMF1", population=MEMORY_POPULATION, rounds=MEMORY_ROUNDS[-1], seed=1)
    evaluate, width = PROBLEMS["MMF1"].evaluate, ALGORITHMS[name].most_objectives
    found = []
    while not optimizer.should_stop:
        optimizer.tell(evaluate(optimizer.ask())[:, :width])
        if optimizer.iteration == 10:  # kernels are compiled by now
            tracemalloc.start()
        if optimizer.iteration in MEMORY_ROUNDS:
            gc.collect()
            pages = int(Path("/proc/self/statm").read_text().split()[1])
            resident_kib = pages * os.sysconf("SC_PAGE_SIZE") / 1024
            found.append((tracemalloc.get_traced_memory()[0] / 1024, resident_kib))
    print(json.dumps(found))


def memory(name: str) -> list[tuple[float, float]]:
    """(traced, resident) KiB after each of `MEMORY_ROUNDS`, in a process of its own."""
    command = [sys.executable, __file__, "--report-memory", name]
    found = json.loads(subprocess.run(command, stdout=subprocess.PIPE, check=True).stdout)
    print(f"memory: {name}: {found}", file=sys.stderr, flush=True)
    return [(traced, resident) for traced, resident in found]


def time_table(measured: dict[tuple[str, str], list[float]]) -> list[tuple[str, str, float, float]]:
    """(algorithm, function, median us, median ratio to the native run of the same repetition)."""
    return [
        (
            name,
            function,
            statistics.median(values),
            statistics.median(own / native for own, native in zip(values, measured[NATIVE, function], strict=True)),
        )
        for (name, function), values in measured.items()
    ]


def memory_lines(remembered: dict[str, list[tuple[float, float]]]) -> list[str]:
    """The table of memory, as Markdown."""
    lines = [
        "",
        f"## Memory over {MEMORY_ROUNDS[-1]} rounds (MMF1, population {MEMORY_POPULATION})",
        "",
        "KiB held after so many rounds (tracemalloc, from round 10 on), and the growth of the resident memory between the",
        "first and the last of them.",
        "",
        "| algorithm | " + " | ".join(str(rounds) for rounds in MEMORY_ROUNDS) + " | resident grows by |",
        "|---|" + "---|" * (len(MEMORY_ROUNDS) + 1),
    ]
    for name, found in remembered.items():
        traced = " | ".join(f"{kib:.0f}" for kib, _ in found)
        lines.append(f"| {name} | {traced} | {found[-1][1] - found[0][1]:.0f} |")
    return lines


def main() -> None:
    """Measure, print, and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--algorithms", type=names_of(ALGORITHMS), default=",".join(ALGORITHMS), help="names, by commas"
    )
    parser.add_argument("--rounds", type=int, default=500)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument(
        "--memory",
        type=names_of(["", *ALGORITHMS]),
        help="names whose memory is measured, by commas; all of ours when left out",
    )
    parser.add_argument("-o", "--out", type=file_to_write, help="Markdown file to write; a .csv goes beside it")
    parser.add_argument("--report-memory", metavar="NAME", help=argparse.SUPPRESS)
    wanted = parser.parse_args()
    if wanted.report_memory:
        report_memory(wanted.report_memory)
        return
    names = wanted.algorithms
    ours = [name for name in names if not issubclass(ALGORITHMS[name], PymooOptimizer)]
    if wanted.memory is not None:
        ours = [name for name in wanted.memory if name]
    with ThreadPool(2) as pool:
        remembered = dict(zip(ours, pool.map(memory, ours, chunksize=1), strict=True))
    table = time_table(times(names, wanted.rounds, wanted.repeats))
    by_key = {(name, function): (us, ratio) for name, function, us, ratio in table}

    lines = [
        f"## Own time per evaluation (population {POPULATION}, {wanted.rounds} rounds, median of {wanted.repeats})",
        "",
        f"Microseconds, and in brackets the ratio to {NATIVE} run natively in the same repetition.",
        "",
        "| algorithm | " + " | ".join(FUNCTIONS) + " |",
        "|---|" + "---|" * len(FUNCTIONS),
    ]
    for name in [NATIVE, *names]:
        figures = [by_key[name, function] for function in FUNCTIONS]
        lines.append(f"| {name} | " + " | ".join(f"{us:.1f} ({ratio:.2f})" for us, ratio in figures) + " |")
    if remembered:
        lines += memory_lines(remembered)
    print("\n".join(lines))
    if wanted.out is not None:
        command = shlex.join(["scripts/bench_optimizers.py", *sys.argv[1:]])
        head = [
            "# The optimizers, measured",
            "",
            f"Command: `.venv/bin/python {command}`, {datetime.date.today().isoformat()}, uavcover "
            f"{metadata.version('uavcover')}, pymoo {metadata.version('pymoo')} "
            f"({'with' if is_compiled() else 'without'} its compiled modules), Python {platform.python_version()}, numpy "
            f"{metadata.version('numpy')}, {os.cpu_count()} cores ({platform.machine()}), shared with "
            "other work; one BLAS thread.",
            "",
        ]
        wanted.out.write_text("\n".join(head + lines) + "\n")
        rows: list[tuple[str, str, str, float]] = []
        for name, function, us, ratio in table:
            rows += [(name, function, "own_us_per_evaluation", us), (name, function, "ratio_to_pymoo_nsga2", ratio)]
        for name, found in remembered.items():
            for rounds, (traced, resident) in zip(MEMORY_ROUNDS, found, strict=True):
                rows += [(name, "MMF1", f"traced_kib_after_{rounds}", traced)]
                rows += [(name, "MMF1", f"resident_kib_after_{rounds}", resident)]
        with wanted.out.with_suffix(".csv").open("w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([("algorithm", "function", "what", "value"), *rows])


if __name__ == "__main__":
    main()

"""What each part of imodbo-niching is worth: every part taken away alone, on the 24 problems of the MMF suite.

Usage: .venv/bin/python scripts/ablate_niching.py [-o docs/results/niching_ablation.md] [--seeds 3] [--part 0/1]

Population and archive 200, 500 rounds. Each run is a row of the .csv beside the table; run again after a stop, it goes on with
what is missing. ``--part 1/2`` does every second case, so two processes can share the work (into two files); ``--part 0/0``
only writes the table from the .csv.
"""

import argparse
import csv
import datetime
import statistics
from collections.abc import Iterator
from pathlib import Path

from scripts.options import file_to_write
from uavcover.extras.benchmarks.mmf.problems import PROBLEMS, MmfProblem
from uavcover.extras.benchmarks.mmf.reference_sets import reference_sets
from uavcover.extras.benchmarks.mmf.summary import CONSTANT_VARIABLES, cover_rate, pareto_sets_proximity
from uavcover.optimizers.ablations import CHOICE_VARIANTS, SEARCH_VARIANTS
from uavcover.optimizers.imodbo_niching import ImodboNiching
from uavcover.optimizers.indicators import inverted_generational_distance
from uavcover.optimizers.interface import ParetoSet

WHOLE = "all parts"
VARIANTS = (WHOLE, *SEARCH_VARIANTS, *CHOICE_VARIANTS)
COLUMNS = ("function", "seed", "variant", "psp", "igd", "cover_rate")

Row = dict[str, str]


def searched(variant: type[ImodboNiching], problem: MmfProblem, seed: int) -> ImodboNiching:
    """The optimizer after its whole budget."""
    optimizer = variant(
        problem.lower,
        problem.upper,
        n_objectives=problem.n_objectives,
        local_sets_wanted=problem.local_sets_wanted,
        population_size=200,
        max_iterations=500,
        archive_size=200,
        seed=seed,
    )
    while not optimizer.should_stop:
        optimizer.tell(problem.evaluate(optimizer.ask()))
    return optimizer


def row(problem: MmfProblem, seed: int, variant: str, best: ParetoSet) -> Row:
    """The indicators of one result."""
    reference, ignored = reference_sets(problem.name), CONSTANT_VARIABLES.get(problem.name, ())
    values = (
        problem.name, seed, variant,
        f"{pareto_sets_proximity(reference.pareto_set, best.x, ignored=ignored):.6g}",
        f"{inverted_generational_distance(reference.pareto_front, best.objectives):.6g}",
        f"{cover_rate(reference.pareto_set, best.x, ignored=ignored):.6g}",
    )  # fmt: skip
    return dict(zip(COLUMNS, map(str, values), strict=True))


def rows_of(problem: MmfProblem, seed: int, done: set[str]) -> Iterator[Row]:
    """The variants that are not done yet; those of the choice share one search."""
    if not done.issuperset({WHOLE, *CHOICE_VARIANTS}):
        whole = searched(ImodboNiching, problem, seed)
        yield row(problem, seed, WHOLE, whole.pareto_set())
        for name, variant in CHOICE_VARIANTS.items():
            chooser = variant.from_state(whole.state_dict() | {"algorithm": variant.__name__})
            yield row(problem, seed, name, chooser.pareto_set())
    for name, variant in SEARCH_VARIANTS.items():
        if name not in done and (problem.local_sets_wanted or name != "-shadow"):
            yield row(problem, seed, name, searched(variant, problem, seed).pareto_set())


def table(rows: list[Row]) -> list[str]:
    """Mean PSP and mean IGD of each variant over those of all parts, on the seeds that both have."""
    values = {(r["function"], r["variant"], r["seed"]): (float(r["psp"]), float(r["igd"])) for r in rows}
    lines = ["| function | PSP | " + " | ".join(VARIANTS[1:]) + " |", "|---" * (len(VARIANTS) + 1) + "|"]
    ratios: dict[str, list[float]] = {name: [] for name in VARIANTS[1:]}
    for function in PROBLEMS:
        whole = {seed: pair for (f, v, seed), pair in values.items() if (f, v) == (function, WHOLE)}
        if not whole:
            continue
        cells = [function, f"{statistics.mean(psp for psp, _ in whole.values()):.4g}"]
        for name in VARIANTS[1:]:
            without = {seed: pair for (f, v, seed), pair in values.items() if (f, v) == (function, name)}
            both = sorted(whole.keys() & without.keys())
            if not both:
                cells.append("")
                continue
            psp, igd = (
                statistics.mean(without[seed][k] for seed in both) / statistics.mean(whole[seed][k] for seed in both)
                for k in (0, 1)
            )
            ratios[name].append(psp)
            cells.append(f"{psp:.2f}, {igd:.2f}")
        lines.append("| " + " | ".join(cells) + " |")
    means = [f"{statistics.geometric_mean(r):.2f}" if r else "" for r in ratios.values()]
    return [*lines, "| geometric mean of PSP | | " + " | ".join(means) + " |"]


def part_of(text: str) -> tuple[int, int]:
    """PART/PARTS, the first part is 0; of 0/0 nothing is run, and the page is written."""
    part, _, parts = text.partition("/")
    if not (part.isdecimal() and parts.isdecimal()) or int(part) >= max(1, int(parts)):
        raise argparse.ArgumentTypeError(f"{text}: give PART/PARTS, from 0/PARTS on, such as 1/4")
    return int(part), int(parts)


def main() -> None:
    """Do what is missing, write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=file_to_write, default=Path("docs/results/niching_ablation.md"))
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--part", type=part_of, default="0/1", help="which share of the cases, of how many")
    arguments = parser.parse_args()
    part, parts = arguments.part
    path: Path = arguments.output.with_suffix(".csv")
    rows = list(csv.DictReader(path.read_text().splitlines())) if path.exists() else []
    cases = [(problem, seed) for seed in range(arguments.seeds) for problem in PROBLEMS.values()]
    for number, (problem, seed) in enumerate(cases):
        if not parts or number % parts != part:
            continue
        done = {r["variant"] for r in rows if (r["function"], r["seed"]) == (problem.name, str(seed))}
        for new in rows_of(problem, seed, done):
            if new["variant"] in done:
                continue
            rows.append(new)
            with path.open("a", newline="") as file:
                writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
                if file.tell() == 0:
                    writer.writeheader()
                writer.writerow(new)
            print(", ".join(new.values()), flush=True)
    seeds = sorted({int(r["seed"]) for r in rows})
    text = [
        "# What each part of imodbo-niching is worth",
        "",
        f"`scripts/ablate_niching.py`, {datetime.datetime.now(tz=datetime.UTC).date()}; population and archive 200, 500 rounds,",
        f"seeds {', '.join(map(str, seeds))} ({len(rows)} results). Beside the mean PSP of all parts, for each part taken away",
        "alone: mean PSP, mean IGD, as ratios to those of all parts on the same seeds; empty: not run, or the same algorithm. A",
        "PSP ratio below 1 or an IGD ratio above 1: the part is worth having there.",
        "The parts are the classes of `uavcover/optimizers/ablations.py`.",
        "",
        *table(rows),
    ]
    arguments.output.write_text("\n".join(text) + "\n")


if __name__ == "__main__":
    main()

"""Tune the local search again: every number of ``planning/search/tuning.py`` halved and doubled, against what it is.

Usage: .venv/bin/python scripts/tune_search.py [-o docs/results/tuning.md] [--seeds 3] [--evaluations 500] [--only goal.hottest]

For each scenario and seed a first population is made once. The local search then goes on from it, with so many evaluations and
the same random numbers, once with each number changed. The routes that it finds are judged as the planner does: the shortest one
that sees what is asked for (``goal``, ``moves``), or what sees most with so many waypoints (``free_order``). A number is worth a
second look where one of its changes wins with nearly every seed. Stages that end at 1, one after the other, are not scaled;
a change that makes shares add up to 1 or more is left out. Rows are kept in the .csv beside the page; run again after a stop, it
goes on.
"""

import argparse
import dataclasses
import datetime
import statistics
import sys
import time
from collections.abc import Iterator, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parents[1])

from scripts.ablate_planner import Bench
from scripts.kept_rows import Row, read_rows, write_rows
from scripts.options import file_to_write, one_of
from uavcover.kernels.annealing import Moves
from uavcover.model.route import Route
from uavcover.planning.front import Candidate, Snapshots, judge_members
from uavcover.planning.planner import Effort, plan_routes
from uavcover.planning.search.improve import improve
from uavcover.planning.search.optimizer_search import SearchRun
from uavcover.planning.search.tuning import TUNED, SearchTuning
from uavcover.planning.selection_rule import parse_rule
from uavcover.routes.objectives import evaluate_routes
from uavcover.scenario.site import load_site
from uavcover.sensing.coverage_map import CoverageMap

CASES = {
    "jacksboro": ("coverage>=0.98", 0, ("moves", "goal")),
    "ridge-obstacles": ("coverage>=0.98", 0, ("moves", "goal")),
    "paper-r1": ("max-coverage", 40, ("moves", "free_order")),
}
"""For each scenario its rule, how many waypoints there may be (0: any number), and the numbers that matter there."""
FACTORS = (0.5, 2.0)
FIRST_EVALUATIONS = 80
COLUMNS = (
    "scenario",
    "seed",
    "evaluations",
    "number",
    "factor",
    "coverage",
    "length_m",
    "waypoints",
    "version",
    "date",
)


def scaled(value: Any, factor: float) -> Any:
    """A number, or several, times a factor; none where that makes no sense."""
    if isinstance(value, tuple):
        return None if value[-1] == 1.0 and list(value) == sorted(value) else tuple(factor * v for v in value)
    return max(1, round(factor * value)) if isinstance(value, int) else factor * value


def variants(parts: Sequence[str]) -> Iterator[tuple[str, float, SearchTuning]]:
    """Each number of these parts with its name, changed by each factor."""
    for part in parts:
        numbers = getattr(TUNED, part)
        names = Moves._fields if isinstance(numbers, Moves) else [field.name for field in dataclasses.fields(numbers)]
        for name in names:
            for factor in FACTORS:
                value = scaled(getattr(numbers, name), factor)
                if value is None or value == getattr(numbers, name):
                    continue
                if isinstance(numbers, Moves):
                    changed: Any = numbers._replace(**{name: value})
                    if sum(changed) - changed.smallest_step >= 1.0:
                        continue
                elif isinstance(value, float) and value >= 1.0 > getattr(numbers, name):
                    continue
                else:
                    changed = dataclasses.replace(numbers, **{name: value})
                yield f"{part}.{name}", factor, dataclasses.replace(TUNED, **{part: changed})


def beginning(bench: Bench) -> list[Candidate]:
    """A first population, judged."""
    snapshots = Snapshots(())
    settings = dataclasses.replace(bench.settings, algorithm="imodbo")
    plan_routes(
        bench.site,
        settings=settings,
        select_rule=bench.rule,
        effort=Effort(FIRST_EVALUATIONS, None, time.process_time),
        snapshots=snapshots,
    )
    routes = [route for route, _ in snapshots.last]
    evaluated = evaluate_routes(bench.coarse, routes)
    return [
        Candidate((route, ""), objectives, float(violation))
        for route, objectives, (violation,) in zip(routes, evaluated.objectives, evaluated.violations, strict=True)
    ]


def result(
    bench: Bench, candidates: Sequence[Candidate], evaluations: int, tuning: SearchTuning
) -> tuple[float, float, int]:
    """Coverage, length and number of waypoints of the route that is chosen after a local search."""
    effort = Effort(evaluations, None, time.process_time)
    done = improve(
        bench.coarse, bench.fine, candidates, SearchRun(effort=effort, started=0.0), settings=bench.settings,
        rule=parse_rule(bench.rule), evaluations_done=0, tuning=tuning,
    )  # fmt: skip
    routes: list[Route] = [*(candidate.route[0] for candidate in candidates), *done.routes]
    members = [m for m in judge_members(bench.fine, [(route, "") for route in routes], None) if m.violation <= 0.0]
    if bench.asked is None:
        few = [m for m in members if m.metrics.waypoint_count <= bench.settings.max_waypoints]
        best = max(few, key=lambda m: (m.metrics.coverage_of_coverable, -m.metrics.path_length_m))
    else:
        enough = [m for m in members if m.metrics.coverage_of_coverable >= bench.asked]
        best = min(enough or members, key=lambda m: m.metrics.path_length_m)
    return best.metrics.coverage_of_coverable, best.metrics.path_length_m, best.metrics.waypoint_count


def bench_of(scenario: str, seed: int) -> Bench:
    """A scenario, to be flown on the shortest way."""
    rule, most, _ = CASES[scenario]
    site = load_site(scenario).minimising("length")
    settings = dataclasses.replace(site.scenario.planner, seed=seed, **({"max_waypoints": most} if most else {}))
    coarse = CoverageMap(site, cell_size_m=site.scenario.planning_cell_size_m)
    fine = coarse if rule == "max-coverage" else CoverageMap(site, cell_size_m=site.scenario.area.cell_size_m)
    return Bench(site, settings, rule, parse_rule(rule).required_coverage, coarse, fine)


def page(rows: Sequence[Row], command: str) -> str:
    """The table: for each number, what its changes do to the length, or to the coverage, seed by seed."""
    lines = [
        "# The tuned numbers of the local search, halved and doubled", "",
        f"Command: `{command}`, {rows[-1]['date']}, uavcover {metadata.version('uavcover')}. What is changed, and how it is "
        "judged, is said at the top of the script; every run is a row of the .csv.", "",
        "| scenario | number | factor | seeds | against what it is | better, worse |", "|---|---|---:|---:|---:|---|",
    ]  # fmt: skip
    for scenario, (rule, _, _) in CASES.items():
        column, sign = ("coverage", 1.0) if rule == "max-coverage" else ("length_m", -1.0)
        here = [row for row in rows if row["scenario"] == scenario]
        base = {row["seed"]: float(row[column]) for row in here if not row["number"]}
        for number, factor in dict.fromkeys((row["number"], row["factor"]) for row in here if row["number"]):
            mine = [row for row in here if (row["number"], row["factor"]) == (number, factor)]
            changes = [float(row[column]) / base[row["seed"]] - 1.0 for row in mine]
            better, worse = (sum(s * sign * change > 1e-9 for change in changes) for s in (1.0, -1.0))
            lines.append(
                f"| {scenario} | `{number}` | {factor} | {len(mine)} | {statistics.mean(changes):+.2%} | {better}, {worse} |"
            )
    return "\n".join(lines) + "\n"


def main() -> None:
    """Run what is missing, then write the page."""
    parts = dict.fromkeys(part for _, _, parts in CASES.values() for part in parts)
    names = [*parts, *dict.fromkeys(name for name, _, _ in variants([*parts]))]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=file_to_write, default=Path("docs/results/tuning.md"))
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--evaluations", type=int, default=500)
    parser.add_argument("--scenario", choices=list(CASES))
    parser.add_argument("--only", type=one_of(names), help="a part or a number, such as goal or goal.hottest")
    arguments = parser.parse_args()
    table = arguments.out.with_suffix(".csv")
    rows = read_rows(table)
    done = {(row["scenario"], row["seed"], row["number"], row["factor"]) for row in rows}
    for scenario, (_, _, parts) in CASES.items():
        for seed in range(1, arguments.seeds + 1):
            wanted = [("", 1.0, TUNED), *variants(parts)]
            wanted = [v for v in wanted if not v[0] or arguments.only in (None, v[0], v[0].partition(".")[0])]
            missing = [v for v in wanted if (scenario, str(seed), v[0], str(v[1])) not in done]
            if arguments.scenario not in (None, scenario) or not missing:
                continue
            bench = bench_of(scenario, seed)
            candidates = beginning(bench)
            for number, factor, tuning in missing:
                found = result(bench, candidates, arguments.evaluations, tuning)
                values = (scenario, seed, arguments.evaluations, number, factor, *found, metadata.version("uavcover"))
                rows.append(dict(zip(COLUMNS, map(str, (*values, datetime.date.today())), strict=True)))
                print(rows[-1], flush=True)
                write_rows(table, COLUMNS, rows)
    command = f".venv/bin/python scripts/tune_search.py --seeds {arguments.seeds} --evaluations {arguments.evaluations}"
    arguments.out.write_text(page(rows, command))


if __name__ == "__main__":
    main()

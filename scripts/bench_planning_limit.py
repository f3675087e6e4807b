"""What the local search and the optimizer contribute, at equal processor time, and how fast the local search is.

Usage: .venv/bin/python scripts/bench_planning_limit.py [-o docs/results/planning_limit.md] [--seeds 3] [--only NAME[:MOST]]

One thread; the budget is processor time, so that other work on the machine does not count. Coverage is judged on the area's own
cells and, for jacksboro, on a hold-out that no planner saw: cells of half that size, shifted by half of one. Each finished run
is a row of the .csv beside the table; run again after a stop, it goes on with what is missing.
"""

import argparse
import csv
import dataclasses
import datetime
import os
import platform
import statistics
import time
from importlib import metadata
from pathlib import Path

import numpy as np

from scripts.options import file_to_write, one_of
from uavcover.extras.benchmarks.coverage.judging import HoldOut
from uavcover.kernels.annealing import Prices, Schedule, anneal
from uavcover.planning.baselines.boustrophedon import best_height_agl_m, plain_boustrophedon
from uavcover.planning.baselines.swaths import fly_layout
from uavcover.planning.encodings import WaypointEncoding
from uavcover.planning.planner import Effort, plan_routes
from uavcover.planning.search.route_problem import route_problem, state_of
from uavcover.planning.search.tuning import TUNED
from uavcover.scenario.site import load_site
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.sensors import reach_at_height_m

CASES = (
    ("jacksboro", "coverage>=0.98", 0, 6.0, ("memetic", "local-search", "imodbo")),
    ("paper-r1", "max-coverage", 60, 10.0, ("memetic", "local-search", "imodbo")),
    ("paper-r1", "max-coverage", 40, 30.0, ("memetic",)),
    ("paper-R2", "max-coverage", 60, 10.0, ("memetic",)),
    ("paper-planar", "max-coverage", 60, 10.0, ("memetic",)),
)
"""Scenario, rule, most waypoints (0: the scenario's), budget in seconds of processor time, algorithms."""
COLUMNS = (
    "scenario", "rule", "max_waypoints", "budget_cpu_s", "algorithm", "seed", "version", "date", "evaluations", "made_by",
    "coverage", "holdout_coverage", "violation", "waypoints", "length_m", "fewest_full", "fewest_full_length_m",
    "best_baseline_length_m",
)  # fmt: skip

Row = dict[str, str]


def run_case(scenario: str, rule: str, most: int, algorithm: str, seed: int, budget_s: float) -> Row:
    """One run as a row."""
    site = load_site(scenario).minimising("length")
    changes = {"algorithm": algorithm, "seed": seed} | ({"max_waypoints": most} if most else {})
    settings = dataclasses.replace(site.scenario.planner, **changes)
    effort = Effort(settings.evaluations, budget_s, time.process_time)
    plan = plan_routes(site, settings=settings, select_rule=rule, effort=effort)
    chosen = plan.chosen.metrics
    full = [m for m in plan.members if m.metrics.coverage_of_coverable >= 1.0 - 1e-12]
    fewest = min(full, key=lambda m: (m.metrics.waypoint_count, m.metrics.path_length_m), default=None)
    asked = float(rule.removeprefix("coverage>=")) if rule.startswith("coverage>=") else 1.0 - 1e-9
    reached = [b.metrics.path_length_m for b in plan.baselines if b.metrics.coverage_of_coverable >= asked]
    values = (
        scenario, rule, most, budget_s, algorithm, seed, metadata.version("uavcover"),
        datetime.date.today().isoformat(), plan.evaluations, plan.chosen.origin, chosen.coverage_of_coverable,
        HoldOut(site).coverage_of_coverable(plan.chosen.route.waypoints_m) if scenario == "jacksboro" else "",
        plan.chosen.violation, chosen.waypoint_count, chosen.path_length_m,
        fewest.metrics.waypoint_count if fewest else "", fewest.metrics.path_length_m if fewest else "",
        min(reached) if reached else "",
    )  # fmt: skip
    return dict(zip(COLUMNS, map(str, values), strict=True))


def measure_speed(scenario: str, proposals: int) -> tuple[float, float]:
    """Proposals a second of processor time, and how many of them one full count of the cells costs."""
    site = load_site(scenario).minimising("length")
    coverage = CoverageMap(site, cell_size_m=site.scenario.planning_cell_size_m)
    reach_m = reach_at_height_m(site.scenario.sensor, best_height_agl_m(site))
    problem = route_problem(coverage, margin_m=0.0, reach_m=reach_m)
    if site.scenario.planner.encoding == "swaths":
        route = fly_layout(site, plain_boustrophedon(site))
    else:
        encoding = WaypointEncoding(site, capacity=40, order="improved", reference_m=np.zeros(3))
        genes = np.random.default_rng(1).uniform(encoding.lower, encoding.upper)
        genes[3::4] = 1.0
        route = encoding.decode(genes)
    capacity = max(60, 3 * len(route))
    state = state_of(problem, route, capacity=capacity)
    prices = Prices(1.0, 0.03 * reach_m, 10.0 * route.length_m, 1.0)
    heat = 4e-4 * route.length_m
    rng = np.random.default_rng(1)
    anneal(
        problem.numbers,
        prices,
        Schedule(proposals // 10, heat, heat, 0.4 * reach_m, 2, capacity, TUNED.moves),
        state,
        rng,
    )
    begin = time.process_time()
    anneal(
        problem.numbers, prices, Schedule(proposals, heat, heat, 0.4 * reach_m, 2, capacity, TUNED.moves), state, rng
    )
    each_s = (time.process_time() - begin) / proposals
    coverage.seen(route.waypoints_m)
    begin = time.process_time()
    for _ in range(20):
        coverage.seen(route.waypoints_m)
    return 1.0 / each_s, (time.process_time() - begin) / 20 / each_s


def summarise(rows: list[Row]) -> list[str]:
    """The Markdown table: means, and the worst."""
    lines = [
        "| scenario, rule, budget | most waypoints | algorithm | seeds | coverage (worst) | hold-out (worst) | waypoints "
        "| length (worst) | fewest that see all, their length | best baseline |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for key in dict.fromkeys(map(_case, rows)):
        mine = [row for row in rows if _case(row) == key]
        scenario, most, budget_s, algorithm = key
        case = f"{scenario}, {mine[0]['rule']}, {float(budget_s):g} s"
        lines.append(_line(case, most if most != "0" else "-", algorithm, mine))
    return lines


def _case(row: Row) -> tuple[str, str, str, str]:
    """What runs that are comparable have in common."""
    return row["scenario"], row["max_waypoints"], row["budget_cpu_s"], row["algorithm"]


def _line(case: str, most: str, algorithm: str, mine: list[Row]) -> str:
    def numbers(column: str) -> list[float]:
        return [float(row[column]) for row in mine if row[column]]

    coverage, holdout, length = numbers("coverage"), numbers("holdout_coverage"), numbers("length_m")
    full = [f"{row['fewest_full']}, {float(row['fewest_full_length_m']):.1f}" for row in mine if row["fewest_full"]]
    baseline = numbers("best_baseline_length_m")
    cells = (
        case, most, algorithm, str(len(mine)), f"{100 * statistics.mean(coverage):.2f} % ({100 * min(coverage):.2f})",
        f"{100 * statistics.mean(holdout):.2f} % ({100 * min(holdout):.2f})" if holdout else "-",
        f"{statistics.mean(numbers('waypoints')):.1f}", f"{statistics.mean(length):.1f} ({max(length):.1f})",
        "; ".join(full) or "none", f"{min(baseline):.1f}" if baseline else "-",
    )  # fmt: skip
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """Run what is missing, then write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--out", type=file_to_write, default=Path("docs/results/planning_limit.md"))
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument(
        "--only",
        type=one_of([name for case in CASES for name in (case[0], f"{case[0]}:{case[2]}")]),
        help="one scenario, or one of its numbers of waypoints",
    )
    arguments = parser.parse_args()
    table = arguments.out.with_suffix(".csv")
    rows = list(csv.DictReader(table.open())) if table.exists() else []
    done = {(*_case(row), row["seed"]) for row in rows}
    for seed in range(1, arguments.seeds + 1):
        for scenario, rule, most, budget_s, algorithms in CASES:
            for algorithm in algorithms:
                wanted = arguments.only in (None, scenario, f"{scenario}:{most}")
                if not wanted or (scenario, str(most), str(budget_s), algorithm, str(seed)) in done:
                    continue
                rows.append(run_case(scenario, rule, most, algorithm, seed, budget_s))
                print(rows[-1], flush=True)
                with table.open("w", newline="") as file:
                    writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
                    writer.writeheader()
                    writer.writerows(rows)
    speeds = [
        f"By processor time too, with a load average of {os.getloadavg()[0]:.0f} on {os.cpu_count()} cores:",
        "",
        "| scenario | proposals a second | one full count of the cells costs as much as |",
        "|---|---|---|",
    ]
    for scenario in ("paper-r1", "paper-R2", "paper-planar", "jacksboro"):
        rate, full = measure_speed(scenario, 20_000)
        speeds.append(f"| {scenario} | {rate:,.0f} | {full:.0f} proposals |")
    head = [
        "# What optimizer and local search contribute",
        "",
        f"Command: `.venv/bin/python scripts/bench_planning_limit.py --seeds SEEDS --only SCENARIO:MOST` as in the table, "
        f"{datetime.date.today().isoformat()}, uavcover {metadata.version('uavcover')}, Python "
        f"{platform.python_version()}.",
        "One thread, equal processor time; the budget holds for baselines, optimizer and local search. Means over the",
        "seeds, in brackets the worst. Lengths in metres (jacksboro) or the paper's units. Every run is a row of the .csv; those",
        "of 3 s were made before balanced lines began the local search.",
        "",
    ]
    arguments.out.write_text("\n".join([*head, *summarise(rows), "", *speeds]) + "\n")


if __name__ == "__main__":
    main()

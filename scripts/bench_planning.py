"""What the planner reaches: IMODBO and MODBO over seeds, beside the boustrophedon, on the bundled scenarios.

Usage: .venv/bin/python scripts/bench_planning.py [-o docs/results/planning.md] [--seeds 5]

Figures are judged on the area's own cells. Each finished run is a row of the .csv beside the table; run again after a stop, it
goes on with what is missing.
"""

import argparse
import csv
import datetime
import platform
import statistics
from importlib import metadata
from pathlib import Path

from scripts.options import file_to_write
from uavcover.model.route import RouteMember
from uavcover.planning.selection_rule import parse_rule, select
from uavcover.run.plan_search import SearchRequest
from uavcover.run.plan_search import plan as plan_site
from uavcover.scenario.site import load_site

CASES = (
    ("jacksboro", "coverage>=0.98", 2000),
    ("jacksboro", "coverage>=0.98", 4000),
    ("paper-R2", "weighted:0.6,0.2,0.2", 25000),
    ("paper-r1", "weighted:0.6,0.2,0.2", 25000),
    ("paper-planar", "weighted:0.6,0.2,0.2", 25000),
)
ALGORITHMS = ("imodbo", "modbo")
COLUMNS = (
    "scenario", "rule", "evaluations", "algorithm", "seed", "made_by", "coverage", "waypoints", "length_m",
    "most_coverage", "most_coverage_waypoints", "tuned_length_m", "plain_coverage", "plain_length_m",
)  # fmt: skip

Row = dict[str, str]


def run_case(scenario: str, rule: str, evaluations: int, algorithm: str, seed: int) -> Row:
    """One run as a row."""
    site = load_site(scenario).minimising("length")
    request = SearchRequest(seed=seed, evaluations=evaluations, algorithm=algorithm, select=rule, workers=1)
    plan = plan_site(site, request)
    chosen, most = plan.chosen.metrics, plan.members[select(plan.members, parse_rule("max-coverage")).index].metrics
    plain = [b.metrics for b in plan.baselines if b.origin == "boustrophedon"]
    tuned = _shortest([b for b in plan.baselines if b.origin != "boustrophedon"], rule)
    values = (
        scenario, rule, evaluations, algorithm, seed, plan.chosen.origin, chosen.coverage_of_coverable, chosen.waypoint_count,
        chosen.path_length_m, most.coverage_of_coverable, most.waypoint_count,
        "" if tuned is None else tuned.metrics.path_length_m,
        plain[0].coverage_of_coverable if plain else "", plain[0].path_length_m if plain else "",
    )  # fmt: skip
    return dict(zip(COLUMNS, map(str, values), strict=True))


def _shortest(members: list[RouteMember], rule: str) -> RouteMember | None:
    if not members:
        return None
    choice = select(members, parse_rule(rule))
    return members[choice.index] if choice.met else None


def summarise(rows: list[Row]) -> list[str]:
    """The Markdown table: mean and standard deviation over seeds."""
    lines = [
        "| scenario, rule | evaluations | algorithm | seeds | coverage | waypoints | length | best of the tuned boustrophedons |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for scenario, rule, evaluations in CASES:
        for algorithm in ALGORITHMS:
            mine = [
                row
                for row in rows
                if (row["scenario"], row["evaluations"], row["algorithm"]) == (scenario, str(evaluations), algorithm)
            ]
            if mine:
                tuned = mine[0]["tuned_length_m"]
                lines.append(
                    f"| {scenario}, {rule} | {evaluations} | {algorithm} | {len(mine)} | "
                    f"{_mean(mine, 'coverage', 100, 2)} % | {_mean(mine, 'waypoints', 1, 1)} | {_mean(mine, 'length_m', 1, 1)} | "
                    + (f"{float(tuned):.0f} |" if tuned else "- |")
                )
    return lines


def _mean(rows: list[Row], column: str, factor: float, digits: int) -> str:
    values = [factor * float(row[column]) for row in rows]
    spread = statistics.stdev(values) if len(values) > 1 else 0.0
    return f"{statistics.mean(values):.{digits}f} ± {spread:.{digits}f}"


def main() -> None:
    """Run what is missing, then write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--out", type=file_to_write, default=Path("docs/results/planning.md"))
    parser.add_argument("--seeds", type=int, default=5)
    arguments = parser.parse_args()
    table = arguments.out.with_suffix(".csv")
    rows = list(csv.DictReader(table.open())) if table.exists() else []
    done = {(r["scenario"], r["evaluations"], r["algorithm"], r["seed"]) for r in rows}
    for scenario, rule, evaluations in CASES:
        for algorithm in ALGORITHMS:
            for seed in range(1, arguments.seeds + 1):
                if (scenario, str(evaluations), algorithm, str(seed)) in done:
                    continue
                rows.append(run_case(scenario, rule, evaluations, algorithm, seed))
                print(rows[-1], flush=True)
                with table.open("w", newline="") as file:
                    writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
                    writer.writeheader()
                    writer.writerows(rows)
    head = [
        "# What the planner reaches",
        "",
        f"Command: `.venv/bin/python scripts/bench_planning.py -o {arguments.out} --seeds {arguments.seeds}`, ",
        f"{datetime.date.today().isoformat()}, uavcover {metadata.version('uavcover')}, Python "
        f"{platform.python_version()}.",
        "Mean ± standard deviation over the seeds; lengths in metres (jacksboro) or the paper's units. Every run is a row of the",
        ".csv beside this page.",
        "",
    ]
    arguments.out.write_text("\n".join(head + summarise(rows)) + "\n")


if __name__ == "__main__":
    main()

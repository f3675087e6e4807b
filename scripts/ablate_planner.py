"""What could make IMODBO contribute to the local search: feedback, recombination, beginning anew; at equal processor time.

Usage: .venv/bin/python scripts/ablate_planner.py [-o docs/results/planner_ablation.md] [--seeds 5] [--budget 10] [--only NAME]

Each variant has the same processor time of one thread, for everything but the judging of what it found. Each finished run is a
row of the .csv beside the table; run again after a stop, it goes on with what is missing.

- local-search: no move of IMODBO, only its sampled first population.
- memetic: IMODBO first, for a tenth of the time, as `uavcover plan` does.
- anew: memetic for half of the time, and once more from what it found.
- feedback: the same, but between the halves IMODBO moves a population of the improved routes, for a tenth of the time.
- recombined: the same, but between the halves pairs of the improved routes are cut and put together, for a tenth.
"""

import argparse
import dataclasses
import datetime
import itertools
import math
import platform
import statistics
import sys
import time
from collections.abc import Callable, Sequence
from importlib import metadata
from pathlib import Path

import numpy as np

if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parents[1])

from scripts.kept_rows import Row, read_rows, write_rows
from scripts.options import file_to_write
from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.tours import short_tour
from uavcover.model.route import Route
from uavcover.model.scenario import PlannerSettings
from uavcover.optimizers import ALGORITHMS
from uavcover.planning.encodings import WaypointEncoding
from uavcover.planning.front import Candidate, Snapshots, judge_members
from uavcover.planning.planner import Effort, plan_routes
from uavcover.planning.search.improve import improve
from uavcover.planning.search.optimizer_search import SearchRun, rounds_of, search
from uavcover.planning.selection_rule import parse_rule
from uavcover.routes.leg_checks import measure_violations
from uavcover.routes.objectives import evaluate_routes
from uavcover.scenario.site import Site, load_site
from uavcover.sensing.coverage_map import CoverageMap

CASES = (
    ("paper-r1", "max-coverage", 40, ("local-search", "memetic", "anew", "feedback", "recombined")),
    ("jacksboro", "coverage>=0.98", 0, ("local-search", "memetic", "anew", "recombined")),
)
COLUMNS = (
    "scenario", "variant", "seed", "budget_cpu_s", "version", "date", "coverage", "waypoints", "length_m", "fed", "best_fed",
)  # fmt: skip
FIRST_SHARE, FEEDBACK_SHARE, RECOMBINED_SHARE = 0.5, 0.1, 0.1
PARENTS, CHILDREN = 12, 20
MISSING_PRICE = 3.0
"""Of coverage in a beginning along the path, as in :mod:`uavcover.planning.search.goal_search`."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Bench:
    """One run's scenario and goal.

    Attributes:
        site: the scenario on its ground.
        settings: with seed and capacity.
        rule: by which a route is chosen.
        asked: the coverage it asks for; none: the most.
        coarse: the planner's cells.
        fine: the cells that judge.
    """

    site: Site
    settings: PlannerSettings
    rule: str
    asked: float | None
    coarse: CoverageMap
    fine: CoverageMap

    def merit(self, route: Route) -> float:
        """Small for a good beginning: length with a price on what is missing, or what is not seen."""
        seen = self.coarse.share_of_coverable(self.coarse.seen(route.waypoints_m))
        return -seen if self.asked is None else route.length_m * (1.0 + MISSING_PRICE * max(0.0, self.asked - seen))

    def keeps_limits(self, route: Route) -> bool:
        """Whether a route may be flown at all."""
        margin_m = self.site.scenario.limits.height_margin_m
        return measure_violations(self.site, route.waypoints_m, margin_m=margin_m).total <= 0.0


def planned(bench: Bench, algorithm: str, budget_s: float) -> list[Route]:
    """What the planner finds."""
    settings = dataclasses.replace(bench.settings, algorithm=algorithm)
    snapshots = Snapshots(())
    effort = Effort(settings.evaluations, budget_s, time.process_time)
    plan_routes(bench.site, settings=settings, select_rule=bench.rule, effort=effort, snapshots=snapshots)
    return [route for route, _ in snapshots.last]


def improved(bench: Bench, routes: Sequence[Route], budget_s: float) -> list[Route]:
    """Local search of routes, from a random stream of its own."""
    effort = Effort(bench.settings.evaluations, budget_s, time.process_time)
    evaluated = evaluate_routes(bench.coarse, routes)
    candidates = [
        Candidate((route, ""), objectives, float(violation))
        for route, objectives, (violation,) in zip(routes, evaluated.objectives, evaluated.violations, strict=True)
    ]
    done = improve(
        bench.coarse, bench.fine, candidates, SearchRun(effort=effort, started=time.process_time()),
        settings=dataclasses.replace(bench.settings, seed=bench.settings.seed + 1000), rule=parse_rule(bench.rule),
        evaluations_done=0,
    )  # fmt: skip
    return [*routes, *done.routes]


def fed_back(bench: Bench, routes: Sequence[Route], budget_s: float) -> list[Route]:
    """Routes that IMODBO finds from a population of the best that there are."""
    capacity, size = bench.settings.max_waypoints, bench.settings.population_size
    encoding = WaypointEncoding(bench.site, capacity=capacity, order="improved", reference_m=np.zeros(3))
    best = sorted((route for route in routes if len(route) <= capacity), key=bench.merit)[:size]
    effort, started = Effort(0, budget_s, time.process_time), time.process_time()
    rounds = rounds_of(
        effort, started, encoding=encoding, coverage=bench.coarse, population_size=size, executor=None
    )  # fmt: skip
    optimizer = ALGORITHMS["imodbo"](
        encoding.lower, encoding.upper, n_objectives=3, n_constraints=1, population_size=size, max_iterations=rounds,
        archive_size=max(100, size), seed=bench.settings.seed, initial=np.array([encoding.near(r) for r in best]),
    )  # fmt: skip
    search(
        optimizer, SearchRun(effort=effort, started=started), rounds=rounds, encoding=encoding, coverage=bench.coarse,
        at_least_one_round=True, goal=bench.asked,
    )  # fmt: skip
    return [encoding.decode(genes) for genes in optimizer.pareto_set().x]


def recombined(bench: Bench, routes: Sequence[Route], budget_s: float) -> list[Route]:
    """The best children of pairs of the best routes."""
    begin, rng = time.process_time(), np.random.default_rng(bench.settings.seed)
    parents = sorted(routes, key=bench.merit)[:PARENTS]
    pairs = list(itertools.permutations(range(len(parents)), 2))
    free_order = bench.site.scenario.sensor.sensing == "at-waypoints"
    found: list[tuple[float, int, Route]] = []
    while pairs and time.process_time() - begin < budget_s:
        a, b = pairs[int(rng.integers(len(pairs)))]
        child = halves(bench, parents[a], parents[b], rng) if free_order else stretches(parents[a], parents[b], rng)
        if child is not None and bench.keeps_limits(child):
            found.append((bench.merit(child), len(found), child))
    return [child for _, _, child in sorted(found)[:CHILDREN]]


def halves(bench: Bench, a: Route, b: Route, rng: np.random.Generator) -> Route | None:
    """Waypoints of one on one side of a line, of the other on the other side, in a short tour; none when these are too many."""
    west, south, east, north = bench.site.area.bounds
    angle = rng.uniform(0.0, 2.0 * math.pi)
    normal = np.array([math.cos(angle), math.sin(angle)])
    offset = float(normal @ rng.uniform([west, south], [east, north]))
    points = np.vstack(
        [a.waypoints_m[a.waypoints_m[:, :2] @ normal <= offset], b.waypoints_m[b.waypoints_m[:, :2] @ normal > offset]]
    )
    if not 1 < len(points) <= bench.settings.max_waypoints:
        return None
    return Route(np.ascontiguousarray(points[short_tour(points)]))


def stretches(a: Route, b: Route, rng: np.random.Generator) -> Route | None:
    """Lines of one up to a border across the lines, lines of the other behind it; none where the border leaves nothing of one."""
    across = across_lines(a)
    first, second = (_rising(route.waypoints_m, across) for route in (a, b))
    low, high = float((first[:, :2] @ across).min()), float((first[:, :2] @ across).max())
    border = rng.uniform(low, high)
    cut_a = int(np.argmax(first[:, :2] @ across > border))
    # Between two lines either may go on from the other's end: the border is left where the joining leg is shortest.
    behind = np.flatnonzero(np.abs(second[:, :2] @ across - border) < 0.1 * (high - low))
    if cut_a < 2 or behind.size == 0:
        return None
    cut_b = int(behind[np.argmin(np.linalg.norm(second[behind] - first[cut_a - 1], axis=1))])
    return Route(np.vstack([first[:cut_a], second[cut_b + 1 :]])) if cut_b < len(second) - 2 else None


def across_lines(route: Route) -> FloatArray:
    """(2,) unit vector east, north at right angles to where most of the way goes."""
    legs = np.diff(route.waypoints_m[:, :2], axis=0)
    lengths = np.hypot(legs[:, 0], legs[:, 1])
    double = 2.0 * np.arctan2(legs[:, 1], legs[:, 0])
    along = 0.5 * math.atan2(float(lengths @ np.sin(double)), float(lengths @ np.cos(double)))
    return np.array([-math.sin(along), math.cos(along)])


def _rising(points: FloatArray, across: FloatArray) -> FloatArray:
    places = points[:, :2] @ across
    return points if places[0] <= places[-1] else np.ascontiguousarray(points[::-1])


def run_case(scenario: str, rule: str, most: int, variant: str, seed: int, budget_s: float) -> Row:
    """One run as a row."""
    site = load_site(scenario).minimising("length")
    settings = dataclasses.replace(site.scenario.planner, seed=seed, **({"max_waypoints": most} if most else {}))
    coarse = CoverageMap(site, cell_size_m=site.scenario.planning_cell_size_m)
    fine = coarse if rule == "max-coverage" else CoverageMap(site, cell_size_m=site.scenario.area.cell_size_m)
    bench = Bench(site, settings, rule, parse_rule(rule).required_coverage, coarse, fine)
    between: dict[str, tuple[float, Callable[[Bench, Sequence[Route], float], list[Route]]]] = {
        "anew": (0.0, lambda *_: []),
        "feedback": (FEEDBACK_SHARE, fed_back),
        "recombined": (RECOMBINED_SHARE, recombined),
    }
    fed: list[Route] = []
    first_best = math.nan
    if variant in between:
        share, make = between[variant]
        routes = planned(bench, "memetic", FIRST_SHARE * budget_s)
        if share > 0.0:
            fed = make(bench, routes, share * budget_s)
            first_best = min(map(bench.merit, routes))
        routes = improved(bench, [*routes, *fed], (1.0 - FIRST_SHARE - share) * budget_s)
    else:
        routes = planned(bench, variant, budget_s)
    members = [m for m in judge_members(fine, [(route, "") for route in routes], None) if m.violation <= 0.0]
    if bench.asked is None:
        chosen = max(members, key=lambda m: (m.metrics.coverage_of_coverable, -m.metrics.path_length_m))
    else:
        enough = [m for m in members if m.metrics.coverage_of_coverable >= bench.asked]
        chosen = min(enough or members, key=lambda m: m.metrics.path_length_m)
    ratio = min(map(bench.merit, fed)) / first_best if fed else math.nan
    values = (
        scenario, variant, seed, budget_s, metadata.version("uavcover"), datetime.date.today().isoformat(),
        chosen.metrics.coverage_of_coverable, chosen.metrics.waypoint_count, chosen.metrics.path_length_m, len(fed),
        "" if math.isnan(ratio) else ratio,
    )  # fmt: skip
    return dict(zip(COLUMNS, map(str, values), strict=True))


def summarise(rows: list[Row]) -> list[str]:
    """The Markdown table: means, the worst, and seed by seed against the memetic planner."""
    lines = [
        "| scenario | variant | seeds | coverage (worst) | waypoints | length (worst) | against memetic, same seed "
        "| won, lost |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for scenario, rule, _, variants in CASES:
        column, sign = ("coverage", 1.0) if rule == "max-coverage" else ("length_m", -1.0)
        base = {
            row["seed"]: float(row[column])
            for row in rows
            if (row["scenario"], row["variant"]) == (scenario, "memetic")
        }
        for variant in variants:
            mine = [row for row in rows if (row["scenario"], row["variant"]) == (scenario, variant)]
            if not mine:
                continue
            coverage = [100.0 * float(row["coverage"]) for row in mine]
            length = [float(row["length_m"]) for row in mine]
            ratios = [float(row[column]) / base[row["seed"]] for row in mine if row["seed"] in base]
            won = sum(sign * (ratio - 1.0) > 0.0 for ratio in ratios)
            lost = sum(sign * (ratio - 1.0) < 0.0 for ratio in ratios)
            against = f"{100 * (statistics.mean(ratios) - 1.0):+.2f} %" if ratios and variant != "memetic" else "-"
            score = f"{won}, {lost}" if variant != "memetic" else "-"
            lines.append(
                f"| {scenario}, {rule} | {variant} | {len(mine)} | {statistics.mean(coverage):.2f} % ({min(coverage):.2f}) "
                f"| {statistics.mean(float(row['waypoints']) for row in mine):.1f} "
                f"| {statistics.mean(length):.1f} ({max(length):.1f}) | {against} | {score} |"
            )
    return lines


def main() -> None:
    """Run what is missing, then write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=file_to_write, default=Path("docs/results/planner_ablation.md"))
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--budget", type=float, default=10.0)
    parser.add_argument("--only", choices=[case[0] for case in CASES])
    arguments = parser.parse_args()
    table = arguments.out.with_suffix(".csv")
    rows = read_rows(table)
    done = {(row["scenario"], row["variant"], row["seed"]) for row in rows}
    for seed in range(1, arguments.seeds + 1):
        for scenario, rule, most, variants in CASES:
            for variant in variants:
                if arguments.only not in (None, scenario) or (scenario, variant, str(seed)) in done:
                    continue
                rows.append(run_case(scenario, rule, most, variant, seed, arguments.budget))
                print(rows[-1], flush=True)
                write_rows(table, COLUMNS, rows)
    head = [
        "# What could make IMODBO contribute to the local search",
        "",
        f"Command: `.venv/bin/python scripts/ablate_planner.py --seeds {arguments.seeds} --budget {arguments.budget:g}`, "
        f"{datetime.date.today().isoformat()}, uavcover {metadata.version('uavcover')}, Python "
        f"{platform.python_version()}.",
        "One thread, equal processor time for all but judging. Lengths in metres (jacksboro) or the paper's units. Every run is",
        "a row of the .csv; there `best_fed` is the best of what came between the halves against the best before it (merit:",
        "coverage, or length with a price on what is missing). What the variants do: `scripts/ablate_planner.py`.",
        "",
    ]
    arguments.out.write_text("\n".join([*head, *summarise(rows)]) + "\n")


if __name__ == "__main__":
    main()

"""What a time budget is spent on, and what it brings: planning in one piece on one thread, the budget counted in processor time.

Usage: .venv/bin/python scripts/bench_budget.py [SCENARIO.toml|NAME ...] [--budgets 10,30,60] [--seeds 1] [--boustrophedon]

A small plan comes first, so that compiled code is loaded. ``begins`` is when the first proposal of the local search is made and
``searching`` the time in proposals alone, without judging routes. The route is judged once more on cells of 0.77 of the size,
which nothing was planned on; with --boustrophedon the quickest tuned ones of a scan, line by line, stand below.
"""

import argparse
import dataclasses
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parents[1])

from scripts.options import numbers, scenario_name
from uavcover.kernels import annealing
from uavcover.model.route import Route
from uavcover.planning.baselines.boustrophedon import fewest_lines
from uavcover.planning.planner import Effort, plan_routes
from uavcover.planning.selection_rule import parse_rule
from uavcover.routes.flight_costs import mission_time_s
from uavcover.scenario.scenario_file import load_scenario
from uavcover.scenario.site import Site, load_site
from uavcover.sensing.coverage_map import CoverageMap, planning_map

ELSEWHERE = 0.77
"""Cells that nothing was planned on, as a share of the own cells' size."""

_NEAR = (0.996, 0.998, 1.0, 1.002)
"""Goals of the scans for boustrophedons, as shares of the coverage asked for: what sees as much elsewhere may see less here."""

_SHOWN = 20

now = time.process_time


class Searching:
    """Time in proposals of the local search, and when the first one was made."""

    def __init__(self, anneal: Callable[..., Any]) -> None:
        self._anneal = anneal
        self.first_s: float | None = None
        self.spent_s = 0.0

    def __call__(self, *given: Any) -> Any:
        """The same as ``anneal``, measured."""
        begin = now()
        self.first_s = begin if self.first_s is None else self.first_s
        try:
            return self._anneal(*given)
        finally:
            self.spent_s += now() - begin


def elsewhere(site: Site) -> Callable[[Route], float]:
    """Share of what can be covered that a route sees on other cells."""
    cells = CoverageMap(site, cell_size_m=ELSEWHERE * site.scenario.area.cell_size_m)
    return lambda route: cells.share_of_coverable(cells.seen(route.waypoints_m))


def tuned_boustrophedons(site: Site, asked: float) -> list[tuple[float, float]]:
    """(mission time, coverage on other cells) of tuned boustrophedons for several goals around the one asked for."""
    coarse, seen = planning_map(site), elsewhere(site)
    coverable = coarse.share(coarse.coverable)
    goals = [min(1.0, near * asked) * coverable for near in _NEAR]
    found = {each.route.waypoints_m.tobytes(): each for goal in goals for each in fewest_lines(coarse, goal)}
    ranked = sorted(
        ((mission_time_s(site, each.route), each.route) for each in found.values() if each.violation <= 0.0),
        key=lambda pair: pair[0],
    )
    return [(time_s, seen(route)) for time_s, route in ranked[:_SHOWN]]


def measured(name: str, budget_s: float, seed: int) -> str:
    """A row of the table."""
    site = load_site(load_scenario(name))
    settings, rule = dataclasses.replace(site.scenario.planner, seed=seed), site.scenario.select
    search = annealing.anneal
    watched = Searching(search)
    annealing.anneal = watched
    try:
        begin = now()
        plan = plan_routes(site, settings=settings, select_rule=rule, effort=Effort(10**9, budget_s, now))
        used_s = now() - begin
    finally:
        annealing.anneal = search
    metrics, begins_s = plan.chosen.metrics, (watched.first_s or begin) - begin
    return (
        f"| {name} | {budget_s:g} s | {seed} | {used_s:.1f} s | {begins_s:.1f} s | {watched.spent_s:.1f} s "
        f"({100.0 * watched.spent_s / budget_s:.0f} %) | {100.0 * metrics.coverage_of_coverable:.2f} % "
        f"| {100.0 * elsewhere(site)(plan.chosen.route):.2f} % | {metrics.mission_time_s or metrics.cost:,.0f} "
        f"| {metrics.waypoint_count} |"
    )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("scenarios", nargs="*", type=scenario_name, default=["ridge-25km2"])
    parser.add_argument("--budgets", type=numbers, default="10,30,60", help="seconds, with commas")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--boustrophedon", action="store_true", help="scan for the tuned boustrophedon as well")
    options = parser.parse_args()
    warm = load_site(load_scenario("jacksboro"))
    plan_routes(
        warm, settings=warm.scenario.planner, select_rule=warm.scenario.select, effort=Effort(45, None, lambda: 0.0)
    )
    print("| scenario | budget | seed | used | begins | searching | coverage | other cells | mission | waypoints |")
    print("|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|")
    for name in options.scenarios:
        for budget in options.budgets:
            for seed in range(1, options.seeds + 1):
                print(measured(name, budget, seed), flush=True)
        if options.boustrophedon:
            site = load_site(load_scenario(name))
            for mission_s, seen in tuned_boustrophedons(
                site, parse_rule(site.scenario.select).required_coverage or 1.0
            ):
                print(f"boustrophedon-tuned of {name}: {mission_s:,.0f} s, {100.0 * seen:.2f} % on other cells")


if __name__ == "__main__":
    main()

"""What planning costs: a change against a full evaluation, memory, growth with cells and area, two cores against one.

Usage: .venv/bin/python scripts/bench/planner.py -o PAGE.md [--part cost|memory|two-cores]

Times of ``cost`` are processor time of one thread, the shortest of four turns; ``two-cores`` is wall time, so it wants a quiet
machine: the load average stands beside it. Each finished case is a row of the .csv beside the table; run again after a stop, it
goes on with what is missing. ``--part`` measures one part anew.
"""

import argparse
import csv
import dataclasses
import datetime
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from scripts.options import file_to_write
from uavcover.kernels.annealing import Schedule, Weights, anneal
from uavcover.missions.objectives import evaluate_routes
from uavcover.model.area import Area
from uavcover.model.limits import Home
from uavcover.model.route import Route
from uavcover.model.scenario import Origin, Scenario
from uavcover.planner.baselines.adaptive_swaths import adaptive_swaths, can_be_adapted
from uavcover.planner.baselines.boustrophedon import (
    best_height_agl_m,
    fly_layout,
    long_side_angle_rad,
    plain_boustrophedon,
)
from uavcover.planner.baselines.initial_routes import NodeRows, fly_rows
from uavcover.planner.search.local_search import CHAINS, Chain, PaceByClock, Work
from uavcover.planner.search.route_problem import RouteProblem, route_problem, state_of
from uavcover.planner.search.tuning import TUNED
from uavcover.scenario.scenario_file import dump_scenario, load_scenario
from uavcover.scenario.site import Site, load_site
from uavcover.sensing.cells import make_scattered_cells
from uavcover.sensing.coverage_map import CoverageMap

S1 = "ridge-25km2"
BUNDLED = (S1, "jacksboro", "ridge-obstacles", "paper-r1", "paper-R2", "paper-planar")
CELL_SIZES_M = (20.0, 10.0, 5.0)
MAP_SIDES_M = (1250.0, 2500.0, 5000.0, 10_000.0)
LARGE = ((5000.0, 5.0), (10_000.0, 10.0))
"""Sides and cell sizes of maps of a million cells."""
MIDDLE = Origin(lat_deg=36.4960, lon_deg=-84.2083, alt_amsl_m=400.0)
"""Of the maps of several sizes: 10 km x 10 km with a fence around lie inside the bundled heights."""

TURNS, PROPOSALS = 4, 10_000
HEATS = (0.04, 0.005, 5e-4)
"""Temperatures as shares of the sensor's radius: hot, middle and cold, as the local search goes through them."""
BUDGET_S = 20.0
PAIRS, STRETCH_S = 5, 4.0

COST = ("case", "cells", "waypoints", "maps_s", "evaluation_ms", "proposal_us", "chain_mib")
MEMORY = ("case", "cells", "budget_s", "peak_mib", "wall_s", "cpu_s")
TWO_CORES = ("case", "pairs", "one_per_s", "two_per_s", "ratio", "lowest", "highest", "possible")
PARTS = ("cost", "memory", "two-cores")
COLUMNS = ("part", "version", "date", "load", *dict.fromkeys((*COST, *MEMORY, *TWO_CORES)))

Row = dict[str, str]
Cases = dict[str, Callable[[], Row]]


def window(side_m: float, cell_m: float) -> Scenario:
    """The ridge scenario on another square of the same heights."""
    half_m = 0.5 * side_m
    ring = ((-half_m, -half_m), (half_m, -half_m), (half_m, half_m), (-half_m, half_m))
    return dataclasses.replace(
        load_scenario(S1),
        name=f"ridge-{side_m:g}m-{cell_m:g}m",
        area=Area(cell_size_m=cell_m, polygon_east_north_m=ring),
        origin=MIDDLE,
        home=Home(east_m=0.0, north_m=0.0),
    )


def searched_cell_m(site: Site) -> float:
    """Size of the cells that the local search counts on."""
    scenario = site.scenario
    along_path = scenario.sensor.looks_along_path
    return scenario.area.cell_size_m if along_path else scenario.planning_cell_size_m


def searched_map(site: Site, cell_m: float) -> CoverageMap:
    """The cells that the local search counts on."""
    if site.scenario.sensor.looks_along_path:
        return CoverageMap(site, cell_size_m=cell_m, cut=make_scattered_cells)
    return CoverageMap(site, cell_size_m=cell_m)


def usual_route(site: Site) -> Route:
    """What the local search begins with: balanced or straight lines, or 42 nodes."""
    if not site.scenario.sensor.looks_along_path:
        return fly_rows(site, NodeRows(rows=6, columns=7, stagger=0.5, height_fraction=0.5))
    if can_be_adapted(site):
        routes = adaptive_swaths(site, long_side_angle_rad(site.area))
        return routes[len(routes) // 2]
    return fly_layout(site, plain_boustrophedon(site))


def chain_on(coverage: CoverageMap) -> Chain:
    """A chain as :mod:`uavcover.planner.search.goal_search` begins one, at a middle temperature."""
    site = coverage.site
    reach_m = max(site.scenario.sensor.half_width_m(best_height_agl_m(site)), coverage.grid.cells.size_m)
    problem: RouteProblem = route_problem(coverage, margin_m=0.0, reach_m=reach_m)
    route = usual_route(site)
    capacity = 3 * len(route) + 100
    state = state_of(problem, route, capacity=capacity)
    weights = Weights(problem.metres_per_cost(route), 0.03 * reach_m, 10.0 * route.length_m, 0.995)
    hottest, _, coldest = (fraction * reach_m for fraction in HEATS)
    return Chain(problem, state, weights, hottest, coldest, 0.4 * reach_m, 2, capacity)


def measure_cost(name: str, site: Site, cell_m: float) -> Row:
    """Processor time of one full evaluation and of one proposal, side by side, and what a chain keeps."""
    begin = time.process_time()
    coverage = CoverageMap(site, cell_size_m=cell_m)
    coverage.coverable  # noqa: B018 a property that is computed once
    maps_s = time.process_time() - begin
    chain, rng = chain_on(searched_map(site, cell_m)), np.random.default_rng(1)
    route = chain.route
    evaluations, proposals = [], []
    for turn in range(TURNS + 1):
        begin = time.process_time()
        evaluate_routes(coverage, [route])
        middle = time.process_time()
        for fraction in HEATS:
            heat = fraction * chain.hottest / HEATS[0]
            schedule = Schedule(PROPOSALS, heat, heat, chain.step_m, chain.fewest, chain.most, TUNED.moves)
            anneal(chain.problem.numbers, chain.weights, schedule, chain.state, rng)
        if turn > 0:  # the first one waits for the compiler
            evaluations.append(middle - begin)
            proposals.append((time.process_time() - middle) / (PROPOSALS * len(HEATS)))
    chain_mib = sum(array.nbytes for array in chain.state) / 2**20
    values = (
        name, coverage.grid.count, len(route), maps_s, 1e3 * min(evaluations), 1e6 * min(proposals), chain_mib,
    )  # fmt: skip
    return dict(zip(COST, map(str, values), strict=True))


def measure_memory(name: str, scenario: Scenario) -> Row:
    """Peak resident memory of ``plan --budget`` in a process of its own, compiled code loaded from the cache."""
    side_m = scenario.area.polygon_east_north_m[2][0] * 2.0 if scenario.area.polygon_east_north_m else 0.0
    cells = round(side_m / scenario.area.cell_size_m) ** 2
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "scenario.toml"
        file.write_text(dump_scenario(scenario))
        command = [sys.executable, "-m", "uavcover", "plan", str(file), "--budget", f"{BUDGET_S:g}s", "-q", "-o"]
        begin = time.perf_counter()
        process = subprocess.Popen([*command, str(Path(folder) / "run")], stderr=subprocess.DEVNULL)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        wall_s = time.perf_counter() - begin
        if process.returncode not in (0, 1):
            raise SystemExit(f"{name}: plan ended with exit code {process.returncode}")
    values = (name, cells, BUDGET_S, usage.ru_maxrss / 1024, wall_s, usage.ru_utime + usage.ru_stime)
    return dict(zip(MEMORY, map(str, values), strict=True))


class TimedThreads(ThreadPoolExecutor):
    """Two threads that note the processor time of what is mapped over them.

    Attributes:
        all_s: of everything.
        longest_s: of the longer one of each pair, which the other one waits for.
    """

    def __init__(self) -> None:
        super().__init__(2)
        self.all_s = 0.0
        self.longest_s = 0.0

    def map(self, fn: Callable[..., Any], *iterables: Iterable[Any], **options: Any) -> Iterator[Any]:
        """As of any executor."""

        def timed(*arguments: Any) -> tuple[Any, float]:
            begin = time.thread_time()
            return fn(*arguments), time.thread_time() - begin

        done = list(super().map(timed, *iterables, **options))
        times = [each_s for _, each_s in done]
        self.all_s += sum(times)
        self.longest_s += max(times)
        return iter([result for result, _ in done])


def proposals_in(chains: list[Chain], executor: Executor | None) -> int:
    """Proposals that the local search makes in STRETCH_S of wall time."""
    begin = time.monotonic()
    work = Work(
        chains[0].problem, PaceByClock(time.monotonic, begin + STRETCH_S), [np.random.default_rng(k) for k in range(CHAINS)],
        executor, lambda: False, lambda _: None,
    )  # fmt: skip
    work.run(chains, until=1.0)
    return work.proposals


def measure_two_cores(name: str) -> Row:
    """Proposals of the same chains on one thread and on two, turn by turn."""
    site = load_site(name).minimising("length")
    coverage = searched_map(site, searched_cell_m(site))
    rates: list[tuple[float, float]] = []
    serial_s = 0.0
    proposals_in([chain_on(coverage) for _ in range(CHAINS)], None)  # waits for the compiler
    with TimedThreads() as threads:
        for _ in range(PAIRS):
            one = proposals_in([chain_on(coverage) for _ in range(CHAINS)], None) / STRETCH_S
            chains = [chain_on(coverage) for _ in range(CHAINS)]
            begin = time.thread_time()
            two = proposals_in(chains, threads) / STRETCH_S
            serial_s += time.thread_time() - begin
            rates.append((one, two))
    ratios = [two / one for one, two in rates]
    values = (
        name, PAIRS, statistics.median(one for one, _ in rates), statistics.median(two for _, two in rates),
        statistics.median(ratios), min(ratios), max(ratios),
        (threads.all_s + serial_s) / (threads.longest_s + serial_s),
    )  # fmt: skip
    return dict(zip(TWO_CORES, map(str, values), strict=True))


def cases() -> dict[str, Cases]:
    """What there is to measure: parts, cases, and what measures each."""

    def cost(name: str, scenario: str | Scenario, cell_m: float | None) -> Row:
        site = load_site(scenario).minimising("length")
        return measure_cost(name, site, searched_cell_m(site) if cell_m is None else cell_m)

    costs: Cases = {S1: partial(cost, S1, S1, None)}
    for side_m, cell_m in (*((5000.0, cell_m) for cell_m in CELL_SIZES_M), *((side_m, 10.0) for side_m in MAP_SIDES_M)):
        name = window_name(side_m, cell_m)
        costs.setdefault(name, partial(cost, name, window(side_m, cell_m), cell_m))
    costs |= {name: partial(cost, name, name, None) for name in BUNDLED}
    memory: Cases = {
        window_name(side_m, cell_m): partial(measure_memory, window_name(side_m, cell_m), window(side_m, cell_m))
        for side_m, cell_m in LARGE
    }
    two_cores: Cases = {name: partial(measure_two_cores, name) for name in (S1, "jacksboro", "paper-r1")}
    return {"cost": costs, "memory": memory, "two-cores": two_cores}


def window_name(side_m: float, cell_m: float) -> str:
    """For people, and a key of the table."""
    return f"{side_m / 1000:g} x {side_m / 1000:g} km, {cell_m:g} m"


def number(row: Row, column: str) -> float:
    """A number of a row."""
    return float(row[column])


def cost_lines(rows: dict[str, Row], names: list[str]) -> list[str]:
    """A table of costs."""
    lines = [
        "| scenario | cells | waypoints | maps | full evaluation | proposal | their ratio | proposals a second "
        "| a chain keeps |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for row in (rows[name] for name in names if name in rows):
        full_ms, each_us = number(row, "evaluation_ms"), number(row, "proposal_us")
        lines.append(
            f"| {row['case']} | {int(row['cells']):,} | {row['waypoints']} | {number(row, 'maps_s'):.2f} s | {full_ms:.3g} ms "
            f"| {each_us:.1f} us | {1e3 * full_ms / each_us:,.0f} | {1e6 / each_us:,.0f} | {number(row, 'chain_mib'):.1f} MiB |"
        )
    return lines


def summarise(rows: list[Row]) -> list[str]:
    """The tables."""
    by_part = {part: {row["case"]: row for row in rows if row["part"] == part} for part in PARTS}
    costs = by_part["cost"]
    lines = ["## A proposal of the local search against a full evaluation", ""]
    lines += [*cost_lines(costs, list(BUNDLED)), ""]
    lines += ["Smaller cells on the same map:", ""]
    lines += [*cost_lines(costs, [window_name(5000.0, cell_m) for cell_m in CELL_SIZES_M]), ""]
    lines += ["Larger maps of the same cells:", ""]
    lines += [*cost_lines(costs, [window_name(side_m, 10.0) for side_m in MAP_SIDES_M]), ""]
    lines += [
        "`maps`: cutting the area into cells and trying from where each can be seen at all, once for a plan (a plan has two or",
        "three such maps). A proposal is the mean of a hot, a middle and a cold chain.",
        "",
        f"## Memory of `uavcover plan --budget {BUDGET_S:g}s`",
        "",
        "| scenario | cells | peak resident memory | wall time | processor time |",
        "|---|---|---|---|---|",
    ]
    for row in by_part["memory"].values():
        lines.append(
            f"| {row['case']} | {int(row['cells']):,} | {number(row, 'peak_mib'):.0f} MiB | {number(row, 'wall_s'):.0f} s "
            f"| {number(row, 'cpu_s'):.0f} s |"
        )
    lines += [
        "",
        "Of the whole process, interpreter, libraries and compiled code included (about 180 MiB before anything is read). What",
        "comes after the budget (judging, sorties, mission files) is in the times.",
        "",
        "## Two cores against one",
        "",
        f"Proposals in {STRETCH_S:g} s of wall time, the same two chains on one thread and on two, turn by turn. On a machine",
        "with other work that says little; `possible` is what their processor time allows: all of it, by the sum of the longer",
        "chain of each batch and of what is done between batches.",
        "",
        "| scenario | pairs | one core, a second | two cores, a second | ratio, median | lowest, highest | possible "
        "| load average |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in by_part["two-cores"].values():
        lines.append(
            f"| {row['case']} | {row['pairs']} | {number(row, 'one_per_s'):,.0f} | {number(row, 'two_per_s'):,.0f} "
            f"| {number(row, 'ratio'):.2f} | {number(row, 'lowest'):.2f}, {number(row, 'highest'):.2f} "
            f"| {number(row, 'possible'):.2f} | {row['load']} |"
        )
    return lines


def write(out: Path, rows: list[Row]) -> None:
    """The tables, and the rows beside them."""
    with out.with_suffix(".csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    dates = sorted({row["date"] for row in rows})
    head = [
        "# What planning costs",
        "",
        f"Command: `.venv/bin/python scripts/bench/planner.py`, {' to '.join(dict.fromkeys((dates[0], dates[-1])))}, uavcover "
        f"{metadata.version('uavcover')}, Python {platform.python_version()}, numpy {np.__version__}, "
        f"{os.cpu_count()} cores ({platform.machine()}).",
        "Costs are processor time of one thread, the shortest of four turns, compiled code loaded. Every case is a row of",
        "the .csv, with the load average before it.",
        "",
    ]
    out.write_text("\n".join([*head, *summarise(rows)]) + "\n")


def main() -> None:
    """Measure what is missing; the tables are written after every case."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=file_to_write, required=True)
    parser.add_argument("--part", choices=PARTS, help="measure this part anew, and no other")
    arguments = parser.parse_args()
    table = arguments.out.with_suffix(".csv")
    rows: list[Row] = list(csv.DictReader(table.open())) if table.exists() else []
    rows = [row for row in rows if row["part"] != arguments.part]
    done = {(row["part"], row["case"]) for row in rows}
    for part, wanted in cases().items():
        for name, measure in wanted.items():
            if arguments.part not in (None, part) or (part, name) in done:
                continue
            load = f"{os.getloadavg()[0]:.1f}"
            head = (part, metadata.version("uavcover"), datetime.date.today().isoformat(), load)
            rows.append({**dict(zip(COLUMNS, head, strict=False)), **measure()})
            print(rows[-1], flush=True)
            write(arguments.out, rows)
    if rows:
        write(arguments.out, rows)


if __name__ == "__main__":
    main()

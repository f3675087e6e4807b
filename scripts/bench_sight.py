"""What is known around the cells saves the local search: legs listed with it and without it, side by side in one run.

Usage: .venv/bin/python scripts/bench_sight.py [SCENARIO.toml|NAME ...] [--legs 1000]

The legs are those of a boustrophedon with few lines, their ends moved at random. Each is listed with all that is known around
the cells, without the skylines of obstacles, and without how steeply the ground rises. It must see the same squares each time,
but for some at the very edge of a picture, one in ten thousand at most.
"""

import argparse
import itertools
import sys
import time
from pathlib import Path

if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parents[1])

import numpy as np

from scripts.options import scenario_name
from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.cells import NO_RISE, Cells
from uavcover.kernels.nadir_visibility import cone_cells
from uavcover.kernels.picture_visibility import picture_cells
from uavcover.kernels.route_state import RouteState, list_visible
from uavcover.kernels.search_problem import SearchProblem
from uavcover.kernels.skyline import NO_SKYLINES
from uavcover.planning.baselines.boustrophedon import fewest_lines
from uavcover.planning.search.route_problem import RouteProblem, state_of
from uavcover.planning.search.search_cells import scattered_problem
from uavcover.planning.selection_rule import parse_rule
from uavcover.scenario.scenario_file import load_scenario
from uavcover.scenario.site import load_site
from uavcover.sensing.cells import make_scattered_cells
from uavcover.sensing.coverage_map import CoverageMap, planning_map

_MOVED_M = 15.0, 15.0, 3.0
_ROUNDS = 5
_MOST_OTHER = 1e-4


def with_cells(problem: SearchProblem, cells: Cells) -> SearchProblem:
    """The problem on other cells."""
    return problem._replace(
        cells=cells,
        cone_cells=cone_cells(problem.surface, problem.sight, cells),
        picture_cells=picture_cells(problem.surface, problem.sight, cells),
    )


def listed(problem: SearchProblem, state: RouteState, legs: FloatArray) -> tuple[float, list[set[int]]]:
    """Seconds of processor time to list the squares that each of (n, 2, 3) legs sees, and these."""
    found: list[set[int]] = []
    spent_s = 0.0
    for p, q in legs.tolist():
        begin = time.process_time()
        list_visible(problem, state, 0, tuple(p), tuple(q))
        spent_s += time.process_time() - begin
        runs = state.runs[state.slot[0], : state.sizes[state.slot[0]]].reshape(-1, 2)
        found.append(set(itertools.chain.from_iterable(itertools.starmap(range, runs.tolist()))))
    return spent_s, found


def measured(name: str, count: int) -> str:
    """A row of the table."""
    site = load_site(load_scenario(name))
    asked = parse_rule(site.scenario.select).required_coverage or 1.0
    route = next(fewest_lines(planning_map(site), asked)).route
    problem: RouteProblem = scattered_problem(
        CoverageMap(site, cell_size_m=site.scenario.area.cell_size_m, cut=make_scattered_cells)
    )
    rng = np.random.default_rng(1)
    ends = np.stack([route.waypoints_m[:-1], route.waypoints_m[1:]], axis=1)
    legs = ends[rng.integers(len(ends), size=count)]
    legs = legs + rng.normal(size=legs.shape) * _MOVED_M
    cells = problem.numbers.cells
    variants = {
        "all": problem.numbers,
        "no skylines": with_cells(problem.numbers, cells._replace(skylines=NO_SKYLINES)),
        "no rises": with_cells(problem.numbers, cells._replace(rise=NO_RISE)),
    }
    state = state_of(problem, route, capacity=len(route))
    squares = [listed(numbers, state, legs)[1] for numbers in variants.values()]
    for variant, found in zip(variants, squares, strict=True):
        other = sum(len(a ^ b) for a, b in zip(squares[0], found, strict=True))
        if other > _MOST_OTHER * sum(map(len, found)):
            raise SystemExit(f"{name}: with {variant} legs see {other} other squares; please report this")
    # Round by round, and of each the fastest: others use the machine too.
    rounds = [[listed(numbers, state, legs)[0] for numbers in variants.values()] for _ in range(_ROUNDS)]
    fastest = np.min(rounds, axis=0)
    told = len(cells.skylines.bounds)
    return (
        f"| {name} | {len(cells.centre_m):,} | {told:,} | {'yes' if len(cells.rise) else 'no'} "
        f"| {1e6 * fastest[0] / count:.0f} µs | {fastest[1] / fastest[0]:.2f} | {fastest[2] / fastest[0]:.2f} |"
    )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("scenarios", nargs="*", type=scenario_name, default=["ridge-obstacles"])
    parser.add_argument("--legs", type=int, default=1000)
    options = parser.parse_args()
    print("| scenario | cells | with a skyline | rises | a leg | without skylines: times | without rises: times |")
    print("|---|---:|---:|---|---:|---:|---:|")
    for name in options.scenarios:
        print(measured(name, options.legs), flush=True)


if __name__ == "__main__":
    main()

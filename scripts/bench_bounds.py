"""Bounds, set covers and tours of the paper's scenarios, and bounds on path length: docs/results/bounds.md and .csv.

    .venv/bin/python scripts/bench_bounds.py --time 120 --out docs/results
    .venv/bin/python scripts/bench_bounds.py --paths --time 60

Proofs on lattices of two spacings, by branch and bound for so many seconds a question; covers that take no solver; their tours
beside LKH's, where elkai is installed. One BLAS thread.
"""

import os

os.environ |= dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")

import argparse
import csv
import importlib.util
import time

import numpy as np

from scripts.options import existing_folder, one_of
from uavcover.extras.bounds.bounds import least_path_length_m
from uavcover.extras.bounds.ground_prices import lattice_parts, price_ground
from uavcover.kernels.route import path_length
from uavcover.kernels.tours import short_tour
from uavcover.planning.selection_rule import parse_rule
from uavcover.planning.set_cover.candidates import Candidates, Reduced, lattice_candidates, reduce
from uavcover.planning.set_cover.solvers import CoverProgram, SolverEffort, greedy_cover, searched_cover
from uavcover.scenario.site import load_site
from uavcover.sensing.coverage_map import CoverageMap, judging_map

SCENARIOS = ("paper-R2", "paper-r1", "paper-planar")
COUNTS = {"paper-R2": 14, "paper-r1": 40, "paper-planar": 30}
SHORTEST_FOUND_M = {"jacksboro": 6260.2, "ridge-25km2": 149136.0, "ridge-obstacles": 6256.6}
"""Of the routes that the planner has found (docs/results/coverage); what a bound on path length is held against."""
COLUMNS = ("scenario", "lattice_m", "places", "question", "relaxation", "at_best", "found", "lkh", "wall_s")
SEARCH_STEPS = 100_000


def lkh_length(points: np.ndarray) -> float | None:
    """Length of LKH's open tour, to a 100,000th of the longest distance; none without elkai."""
    if importlib.util.find_spec("elkai") is None:
        return None
    import elkai

    n = len(points)
    distance = np.zeros((n + 1, n + 1))
    distance[:n, :n] = np.linalg.norm(points[:, None] - points[None], axis=2)
    closed = elkai.DistanceMatrix(np.rint(distance * 1e5 / distance.max()).astype(int).tolist()).solve_tsp(runs=10)[:-1]
    at = closed.index(n)
    return float(path_length(np.ascontiguousarray(points[closed[at + 1 :] + closed[:at]])))


def rows_of(name: str, spacing_m: float, time_s: float) -> list[dict[str, object]]:
    """What is found and proved on one lattice."""
    site = load_site(name)
    coverage = CoverageMap(site, cell_size_m=site.scenario.area.cell_size_m)
    began = time.monotonic()
    candidates = lattice_candidates(coverage, spacing_m=spacing_m)
    reduced = reduce(candidates)
    program = CoverProgram(reduced)
    base: dict[str, object] = {"scenario": name, "lattice_m": spacing_m, "places": len(candidates.places_m)}
    rows = [base | {"question": "lattice", "found": len(reduced.numbers), "wall_s": time.monotonic() - began}]
    rows += covers(base, candidates, reduced)
    relaxed = SolverEffort(time_s=time_s, nodes=0)
    for question, ask in (
        ("fewest for all", lambda effort: program.fewest_places(program.reachable, effort)),
        ("fewest for 98 %", lambda effort: program.fewest_places(0.98 * program.reachable, effort)),
        (f"most with {COUNTS[name]}", lambda effort: program.most_coverage(COUNTS[name], effort)),
    ):
        began = time.monotonic()
        least, answer = ask(relaxed).bound, ask(SolverEffort(time_s=time_s))
        found: object = None
        if answer.chosen is not None:
            found = candidates.coverage_of(answer.chosen) if question.startswith("most") else len(answer.chosen)
        rows.append(
            base | {"question": question, "relaxation": least, "at_best": answer.bound, "found": found,
                    "wall_s": time.monotonic() - began}
        )  # fmt: skip
        if question == "fewest for all" and answer.chosen is not None:
            rows.append(tour(base, "tour of the exact cover", candidates.places_m[answer.chosen]))
    return rows


def covers(base: dict[str, object], candidates: Candidates, reduced: Reduced) -> list[dict[str, object]]:
    """Covers that take no solver."""
    rows: list[dict[str, object]] = []
    began = time.monotonic()
    greedy = greedy_cover(reduced, 1.0)
    rows.append(base | {"question": "greedy cover", "found": len(greedy), "wall_s": time.monotonic() - began})
    rows.append(tour(base, "tour of the greedy cover", candidates.places_m[greedy]))
    for seed in range(3):
        began = time.monotonic()
        found = searched_cover(reduced, steps=SEARCH_STEPS, rng=np.random.default_rng(seed))
        wall_s = time.monotonic() - began
        rows.append(base | {"question": f"searched cover, seed {seed}", "found": len(found), "wall_s": wall_s})
        rows.append(tour(base, f"tour of the searched cover, seed {seed}", candidates.places_m[found]))
    return rows


def tour(base: dict[str, object], question: str, points: np.ndarray) -> dict[str, object]:
    """A short tour of points, beside LKH's."""
    began = time.monotonic()
    length = float(path_length(np.ascontiguousarray(points[short_tour(points)])))
    wall_s = time.monotonic() - began
    return base | {"question": question, "found": length, "lkh": lkh_length(points), "wall_s": wall_s}


def path_row(name: str, time_s: float) -> str:
    """Both bounds on path length of a scenario, in Markdown."""
    site = load_site(name)
    coverage, share = judging_map(site), parse_rule(site.scenario.select).required_coverage
    quick_m, parts = least_path_length_m(coverage, share), lattice_parts(coverage, time_s)
    began = time.process_time()
    ground = None if parts is None else price_ground(coverage, share, parts=parts)
    cpu_s = time.process_time() - began
    priced_m = 0.0 if ground is None else ground.least_length_m(share)
    found_m = SHORTEST_FOUND_M[name]
    gaps = " | ".join(
        f"{100.0 * (found_m / limit - 1.0):.1f} %" if limit > 0.0 else "" for limit in (quick_m, priced_m)
    )
    lattice = "" if parts is None else f"{coverage.grid.cells.size_m / parts:g} m"
    look = "" if ground is None else f"{ground.first_look_m:.0f} m"
    limits = f"{quick_m:.0f} | {priced_m:.0f} | {gaps}"
    return f"| {name} | {100.0 * share:g} % | {found_m:.0f} | {limits} | {lattice} | {look} | {cpu_s:.0f} |"


def table(rows: list[dict[str, object]]) -> str:
    """The rows in Markdown."""
    lines = ["| scenario | lattice | question | at least / at most: relaxation | branch and bound | found | LKH | s |",
             "|---|---|---|---|---|---|---|---|"]  # fmt: skip
    for row in rows:
        cells = [row.get(key) for key in ("relaxation", "at_best", "found", "lkh", "wall_s")]
        shown = ["" if value is None else f"{value:.4g}" if isinstance(value, float) else str(value) for value in cells]
        lattice = f"{row['lattice_m']} m, {row['places']:,}"
        lines.append(f"| {row['scenario']} | {lattice} | {row['question']} | " + " | ".join(shown) + " |")
    return "\n".join(lines)


def main() -> None:
    """Everything, written after every scenario."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--time", type=float, default=120.0, help="seconds of branch and bound for each question")
    parser.add_argument("--lattices", type=float, nargs="+", default=[0.25, 0.125])
    parser.add_argument("--out", type=existing_folder, help="folder of the table and its CSV; not for --paths")
    known = one_of(SHORTEST_FOUND_M)
    parser.add_argument(
        "--paths", nargs="*", type=known, metavar="SCENARIO", help="bounds on path length instead: print them"
    )
    arguments = parser.parse_args()
    if arguments.paths is not None:
        print(
            "| scenario | coverage | found m | by area | by prices | gap by area | gap by prices | lattice | first look | CPU s |"
        )
        print("|---|---|---|---|---|---|---|---|---|---|")
        for name in arguments.paths or SHORTEST_FOUND_M:
            print(path_row(name, arguments.time), flush=True)
        return
    if arguments.out is None:
        parser.error("--out FOLDER is needed")
    rows: list[dict[str, object]] = []
    for spacing_m in arguments.lattices:
        for name in SCENARIOS:
            rows += rows_of(name, spacing_m, arguments.time)
            print(rows[-1], flush=True)
            with (arguments.out / "bounds.csv").open("w", newline="") as file:
                writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
                writer.writeheader()
                writer.writerows(rows)
            (arguments.out / "bounds_table.md").write_text(table(rows) + "\n")


if __name__ == "__main__":
    main()

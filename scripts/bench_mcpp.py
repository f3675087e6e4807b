"""Coverage of grids by several robots: our walks against those of LS-MCPP and TMSTC*, by the costs of their authors.

Usage: .venv/bin/python scripts/bench_mcpp.py [--ls-mcpp FOLDER] [--tmstc FOLDER] [--theirs FOLDER] [-o docs/results/mcpp.md]
       [--only NAME] [--steps 300 1500] [--same-time] [--seed 1]

``--ls-mcpp`` is a copy of ``reso1/LS-MCPP`` (it has ``data/instances/*.mcpp`` and ``data/gridmaps/*.map``), ``--tmstc`` one of
``CourierLo/TMSTC-Star`` (``map/*.png``, ``map/*.pgm`` and the folders in it). Nothing of these repositories is in this one.

``--theirs`` has what their programs found: ``NAME/HOW.json`` for each instance (``/`` in names is ``-``), with ``seconds`` of
processor time, ``walks`` as lists of [column, row], one for each robot, and, where their program tells it, ``makespan``, which
must be what we count. ``HOW`` is shown in the table: the variant of the program and its effort. ``--problems`` writes
``NAME.json`` with ``robots`` and ``places`` of each instance into a folder, for who runs their programs.

The problem is one: every cell is to be visited, each robot begins and ends at its own cell, moves lead to one of four
neighbours, moves and turns cost what their authors say (``scripts/mcpp/published.py``), and the costliest walk is to be cheap.
Walks of either side are judged by code that the search does not use (``scripts/mcpp/problems.py``). TMSTC* leaves the ways
between a robot's place and its part of the tour to the robots: the cheapest ways are counted. The search is
``scripts/mcpp/annealing.py``; nothing in it depends on the instance, and its effort is a number of steps for each cell.
Compiling it takes half a minute, once for all instances, and is not counted. With ``--same-time`` the search also gets as many
steps as fit into the processor time of the best of theirs, by the speed of a short run before. Rows are kept in the .csv beside
the page; run again after a stop, it goes on.
"""

import argparse
import dataclasses
import datetime
import heapq
import itertools
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parents[1])

from scripts.kept_rows import Row, read_rows, write_rows
from scripts.mcpp.annealing import shortest_walks
from scripts.mcpp.problems import HEADINGS, Place, Problem, grid_of
from scripts.mcpp.published import LS_MCPP, read_ls_mcpp, read_tmstc
from scripts.options import existing_folder, file_to_write

COLUMNS = ("of", "name", "cells", "robots", "bound", "by", "makespan", "total", "cpu_s", "seed", "date")
_STATED = 0.01
"""What a makespan that a program tells may differ by: it may be rounded."""
_SAME_TIME = "ours, same time"
_PILOT_STEPS = 20
"""For each cell, of the run that tells how fast the search is."""
_SHARE_OF_TIME = 0.9
"""That is planned with: the search is slower where it is hot, and the short run is hot for as long as the long one."""


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """What another program found.

    Attributes:
        by: its variant and effort.
        seconds: of processor time.
        walks: of all robots.
        makespan: as the program says; none where it does not.
    """

    by: str
    seconds: float
    walks: Sequence[Sequence[Place]]
    makespan: float | None


def file_name(name: str) -> str:
    """Of an instance, as a folder."""
    return name.replace("/", "-")


def read_found(folder: Path, problem: Problem) -> list[Found]:
    """All results of other programs for an instance."""
    found = []
    for file in sorted((folder / file_name(problem.name)).glob("*.json")):
        told = json.loads(file.read_text(encoding="utf-8"))
        walks = [closed(problem, [(x, y) for x, y in walk], k) for k, walk in enumerate(told["walks"])]
        found.append(Found(file.stem, told["seconds"], walks, told.get("makespan")))
    return found


def closed(problem: Problem, walk: list[Place], number: int) -> list[Place]:
    """A walk from its robot and back: where it begins or ends elsewhere, with the cheapest way."""
    robot = problem.robots[number]
    if not walk:
        return [robot]
    if walk[0] != robot:
        walk = cheapest_way(problem, [robot], walk)
    if walk[-1] != robot:
        walk = cheapest_way(problem, walk, [robot])
    return walk


def cheapest_way(problem: Problem, first: list[Place], then: list[Place]) -> list[Place]:
    """Two pieces of a walk as one, with the cheapest moves and turns between them."""

    def heading(before: Place, behind: Place) -> int:
        return HEADINGS.index((behind[0] - before[0], behind[1] - before[1]))

    come = heading(first[-2], first[-1]) if len(first) > 1 else problem.facing
    leave = heading(then[0], then[1]) if len(then) > 1 else None
    order = itertools.count()
    waiting: list[tuple[float, int, bool, Place, int | None, list[Place]]] = [(0.0, 0, False, first[-1], come, [])]
    settled: set[tuple[Place, int | None]] = set()
    while True:
        cost, _, done, place, facing, way = heapq.heappop(waiting)
        if done:
            return [*first, *way, *then[1:]]
        if (place, facing) in settled:
            continue
        settled.add((place, facing))
        if place == then[0]:
            turn = 0.0 if leave is None else problem.turn(facing, leave)
            heapq.heappush(waiting, (cost + turn, next(order), True, place, facing, way))
        for number, (u, v) in enumerate(HEADINGS):
            following = (place[0] + u, place[1] + v)
            price = problem.prices.get(frozenset((place, following)))
            if price is not None:
                onwards = cost + price + problem.turn(facing, number)
                heapq.heappush(waiting, (onwards, next(order), False, following, number, [*way, following]))


def ours(problem: Problem, steps: int, seed: int) -> Found:
    """Our walks, with so many steps for each cell."""
    grid, places = grid_of(problem)
    number = {place: cell for cell, place in enumerate(places)}
    roots = [number[robot] for robot in problem.robots]
    begun = time.process_time()
    walks = shortest_walks(grid, np.array(places), roots, steps * len(places), seed)
    took_s = time.process_time() - begun
    return Found(f"ours, {steps}", took_s, [[places[cell] for cell in walk] for walk in walks], None)


def ours_in_time(problem: Problem, seconds: float, seed: int) -> Found:
    """Our walks, with as many steps for each cell as so much processor time has room for; one at least."""
    begun_s, pilot_s = (ours(problem, steps, seed).seconds for steps in (1, _PILOT_STEPS))
    each_s = max(pilot_s - begun_s, 1e-9) / (_PILOT_STEPS - 1)
    found = ours(problem, max(1, int((_SHARE_OF_TIME * seconds - begun_s) / each_s)), seed)
    return dataclasses.replace(found, by=_SAME_TIME)


def best_of(rows: Sequence[Row]) -> Row | None:
    """Of all rows of other programs the cheapest makespan; of equal ones the fastest."""
    theirs = [row for row in rows if not row["by"].startswith("ours")]
    return min(theirs, key=lambda row: (float(row["makespan"]), float(row["cpu_s"])), default=None)


def judged(of: str, problem: Problem, found: Found, seed: int) -> Row:
    """A row of the table.

    Raises:
        ValueError: the walks are none, or do not cost what the program that found them said.
    """
    costs = problem.costs(found.walks)
    if found.makespan is not None and abs(max(costs) - found.makespan) > _STATED:
        raise ValueError(f"{problem.name}, {found.by}: we count {max(costs)}, the program {found.makespan}")
    places = {place for move in problem.prices for place in move}
    return {
        "of": of,
        "name": problem.name,
        "cells": str(len(places)),
        "robots": str(len(problem.robots)),
        "bound": repr(problem.bound()),
        "by": found.by,
        "makespan": repr(max(costs)),
        "total": repr(sum(costs)),
        "cpu_s": f"{found.seconds:.3g}",
        "seed": str(seed) if found.by.startswith("ours") else "",
        "date": str(datetime.date.today()),
    }


def warm_up() -> None:
    """Compile the search."""
    places = [(x, y) for x in range(4) for y in range(3)]
    moves = {frozenset((a, (a[0] + u, a[1] + v))) for a in places for u, v in HEADINGS}
    prices = {move: 1.0 for move in moves if move <= set(places)}
    ours(Problem("small", prices, [(0, 0), (3, 2)], 0.5, 1.0, 1), 100, 1)


def problems_of(args: argparse.Namespace) -> list[tuple[str, Problem]]:
    """What is asked for."""
    found = []
    if args.ls_mcpp:
        found += [("LS-MCPP", read_ls_mcpp(args.ls_mcpp / "data", name)) for name in LS_MCPP]
    if args.tmstc:
        maps = args.tmstc / "map"
        files = [file for ending in ("png", "pgm") for file in maps.rglob(f"*.{ending}") if "results" not in file.parts]
        # Some maps are there twice, as .png and as .pgm.
        names = {file.with_suffix("").relative_to(maps): file.relative_to(maps).as_posix() for file in sorted(files)}
        found += [("TMSTC*", read_tmstc(maps, name)) for _, name in sorted(names.items())]
    return [(of, problem) for of, problem in found if args.only in (None, problem.name)]


def page(rows: Sequence[Row], command: str) -> str:
    """Markdown: for each publication the best of theirs beside each effort of ours."""
    lines = ["# Coverage of grids by several robots: against LS-MCPP and TMSTC*", "", command, ""]
    for of in dict.fromkeys(row["of"] for row in rows):
        some = [row for row in rows if row["of"] == of]
        efforts = list(dict.fromkeys(row["by"] for row in some if row["by"].startswith("ours")))
        lines += [f"## {of}", ""]
        head = " | ".join(
            effort if effort == _SAME_TIME else f"{effort.replace(', ', ', with ')} steps a cell" for effort in efforts
        )
        lines += [f"| instance | cells | robots | no less than | theirs | by | took | {head} |"]
        lines += ["|---|---:|---:|---:|---:|---|---:|" + "---:|" * len(efforts)]
        for name in dict.fromkeys(row["name"] for row in some):
            of_name = {row["by"]: row for row in some if row["name"] == name}
            best = best_of(list(of_name.values()))
            any_row = next(iter(of_name.values()))
            cells = [name, any_row["cells"], any_row["robots"], f"{float(any_row['bound']):.1f}"]
            cells += (
                ["", "", ""] if best is None else [f"{float(best['makespan']):.1f}", best["by"], f"{best['cpu_s']} s"]
            )
            for effort in efforts:
                row = of_name.get(effort)
                if row is None:
                    cells.append("")
                    continue
                gain = "" if best is None else f" ({float(row['makespan']) / float(best['makespan']) - 1.0:+.1%})"
                cells.append(f"{float(row['makespan']):.1f}{gain}, {row['cpu_s']} s")
            lines.append("| " + " | ".join(cells) + " |")
        lines.append("")
    return "\n".join(lines)


def main() -> None:
    """Solve what is not in the .csv yet, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ls-mcpp", type=existing_folder)
    parser.add_argument("--tmstc", type=existing_folder)
    parser.add_argument("--theirs", type=existing_folder)
    parser.add_argument("--problems", type=existing_folder)
    parser.add_argument("-o", "--out", type=file_to_write, default=Path("docs/results/mcpp.md"))
    parser.add_argument("--only")
    parser.add_argument("--steps", type=int, nargs="*", default=[300, 1500])
    parser.add_argument("--same-time", action="store_true")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    kept = args.out.with_suffix(".csv")
    rows = read_rows(kept)
    done = {(row["name"], row["by"]) for row in rows}
    problems = problems_of(args)
    if args.only and not problems:
        parser.error(f"--only {args.only}: no such instance; give --ls-mcpp or --tmstc the folder that it is in")
    if problems and not args.problems:
        warm_up()
    for of, problem in problems:
        if args.problems:
            told = {"robots": problem.robots, "places": sorted({place for move in problem.prices for place in move})}
            (args.problems / f"{file_name(problem.name)}.json").write_text(json.dumps(told), encoding="utf-8")
            continue
        new = (
            [found for found in read_found(args.theirs, problem) if (problem.name, found.by) not in done]
            if args.theirs
            else []
        )
        new += [ours(problem, steps, args.seed) for steps in args.steps if (problem.name, f"ours, {steps}") not in done]
        for found in new:
            rows.append(judged(of, problem, found, args.seed))
            print(*(rows[-1][key] for key in ("name", "bound", "by", "makespan", "cpu_s")), flush=True)
        best = best_of([row for row in rows if row["name"] == problem.name])
        if args.same_time and best is not None and (problem.name, _SAME_TIME) not in done:
            rows.append(judged(of, problem, ours_in_time(problem, float(best["cpu_s"]), args.seed), args.seed))
            print(*(rows[-1][key] for key in ("name", "bound", "by", "makespan", "cpu_s")), flush=True)
        write_rows(kept, COLUMNS, rows)
    if rows:
        steps = " ".join(map(str, args.steps))
        command = (
            "Command: `.venv/bin/python scripts/bench_mcpp.py --ls-mcpp LS-MCPP --tmstc TMSTC-Star --theirs THEIRS --steps "
            f"{steps}`, "
            f"{datetime.date.today()}. What is compared, and how, is said at the top of the script; all rows are in mcpp.csv."
        )
        args.out.write_text(page(rows, command), encoding="utf-8")


if __name__ == "__main__":
    main()

"""Walks over grids (scripts/mcpp), against the optimum of small ones, and what scripts/bench_mcpp.py reads."""

import heapq
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from scripts.bench_mcpp import closed, page, read_found
from scripts.mcpp.annealing import shortest_walks
from scripts.mcpp.problems import HEADINGS, NORTH, Place, Problem, connected, grid_of
from scripts.mcpp.published import read_ls_mcpp, read_tmstc

ANY_PRICE, DIAGONAL = (1.0, 3.0), [(0, 0), (2, 2)]


def problem(drawn: str, robots: Sequence[Place], *, seed: int | None = None, facing: int | None = NORTH) -> Problem:
    """Of a drawing, the lowest row first: ``#`` cannot be visited. Prices are 1, or random ones."""
    rows = drawn.split()
    places = {(x, y) for y, row in enumerate(rows) for x, mark in enumerate(row) if mark != "#"}
    rng = np.random.default_rng(seed)
    prices = {
        frozenset((a, b)): 1.0 if seed is None else float(rng.uniform(*ANY_PRICE))
        for a in sorted(places)
        for b in ((a[0] + 1, a[1]), (a[0], a[1] + 1))
        if b in places
    }
    return Problem("drawn", prices, robots, quarter=0.5, half=1.0, facing=facing)


def solved(of: Problem, steps: int, seed: int = 1) -> list[list[Place]]:
    grid, places = grid_of(of)
    roots = [places.index(robot) for robot in of.robots]
    return [[places[cell] for cell in walk] for walk in shortest_walks(grid, np.array(places), roots, steps, seed)]


def optimum(of: Problem) -> float:
    """The cheapest longest walk of two robots: for each of them the cheapest walk that visits each set of places, by Dijkstra."""
    grid, places = grid_of(of)
    every = (1 << len(places)) - 1
    least = []
    for robot in of.robots:
        root = places.index(robot)
        waiting: list[tuple[float, int, int, int]] = [(0.0, root, -1, 1 << root)]
        cheapest = np.full(every + 1, np.inf)
        settled: set[tuple[int, int, int]] = set()
        while waiting:
            cost, cell, heading, visited = heapq.heappop(waiting)
            if (cell, heading, visited) in settled:
                continue
            settled.add((cell, heading, visited))
            if cell == root:
                cheapest[visited] = min(cheapest[visited], cost)
            for onwards in range(4):
                near = int(grid.near[cell, onwards])
                if near >= 0:
                    turn = grid.start[onwards] if heading < 0 else grid.turn[heading, onwards]
                    price = float(grid.price[cell, onwards] + turn)
                    heapq.heappush(waiting, (cost + price, near, onwards, visited | 1 << near))
        least.append(cheapest)
    first, second = least
    # A walk may visit more than its share: the cheapest of all that visit these places.
    for cheapest in least:
        for bit in range(len(places)):
            without = np.flatnonzero((np.arange(every + 1) >> bit) & 1 == 0)
            cheapest[without] = np.minimum(cheapest[without], cheapest[without | 1 << bit])
    return float(np.maximum(first, second[::-1]).min())


@pytest.mark.parametrize(
    ("drawn", "robots", "seed"),
    [
        ("...  ... ...", DIAGONAL, None),
        ("... .#. ...", DIAGONAL, None),
        ("... ... ...", [(0, 0), (0, 0)], None),
        ("... ... ...", DIAGONAL, 1),
        (".... .#.. ..#.", [(0, 0), (3, 0)], 2),
        ("..... .#### .....", [(0, 0), (0, 1)], None),
        (".......... .#########", [(0, 0), (1, 0)], 3),
        (".......... #########.", [(0, 0), (4, 0)], None),
        ("..", [(0, 0), (1, 0)], None),
    ],
)
def test_walks_are_as_short_as_can_be_on_small_grids(drawn: str, robots: list[Place], seed: int | None) -> None:
    of = problem(drawn, robots, seed=seed)
    best = min(max(of.costs(solved(of, 20_000, seed=each))) for each in (1, 2, 3))
    assert best == pytest.approx(optimum(of))
    assert of.bound() <= best + 1e-9


def rooms(seed: int) -> Problem:
    rng = np.random.default_rng(seed)
    rows = [[("#" if rng.random() < 0.15 else ".") for _ in range(14)] for _ in range(12)]
    rows[0][:3] = "..."
    drawn = problem(" ".join(map("".join, rows)), [(0, 0), (1, 0), (2, 0)], seed=seed)
    places = connected({place for move in drawn.prices for place in move}, [(0, 0)])
    prices = {move: price for move, price in drawn.prices.items() if move <= places}
    return Problem("rooms", prices, [(0, 0), (1, 0), (2, 0)], drawn.quarter, drawn.half, drawn.facing)


def test_walks_are_legal_and_no_robot_is_left_with_the_work() -> None:
    of = rooms(seed=3)
    before, after = (of.costs(solved(of, steps)) for steps in (0, 100_000))
    assert max(after) < 0.75 * max(before)
    assert min(after) > 0.9 * max(after)


def test_equal_seeds_give_equal_walks() -> None:
    of = rooms(seed=4)
    assert solved(of, 5_000, seed=7) == solved(of, 5_000, seed=7)
    assert solved(of, 5_000, seed=7) != solved(of, 5_000, seed=8)


def test_costs_count_turns_from_where_the_robot_faces() -> None:
    of = problem("... ...", [(0, 0)])
    assert of.cost([(0, 0), (0, 1), (0, 0)]) == 2.0 + 1.0
    assert of.cost([(0, 0), (1, 0), (1, 1), (0, 1), (0, 0)]) == 4.0 + 4 * 0.5
    assert problem("... ...", [(0, 0)], facing=None).cost([(0, 0), (1, 0), (0, 0)]) == 2.0 + 1.0
    assert of.cost([(0, 0)]) == 0.0


@pytest.mark.parametrize(
    ("walk", "told"),
    [
        ([(0, 0), (1, 0), (0, 0)], "2 places are not visited, one of them .0, 1."),
        ([(0, 0), (0, 1), (1, 0), (1, 1), (0, 1), (0, 0)], "no move from"),
        ([(0, 0), (1, 0), (1, 1), (0, 1)], "not that of the robot"),
        ([(1, 0), (1, 1), (0, 1), (0, 0), (1, 0)], "not that of the robot"),
    ],
)
def test_walks_that_are_none_are_refused(walk: list[Place], told: str) -> None:
    with pytest.raises(ValueError, match=told):
        problem(".. ..", [(0, 0)]).costs([walk])


MAP = "type octile\nheight 4\nwidth 3\nmap\n..@\n...\n@@@\n..@\n"


def test_instances_of_ls_mcpp_are_read(tmp_path: Path) -> None:
    (tmp_path / "instances" / "far").mkdir(parents=True)
    (tmp_path / "gridmaps" / "far").mkdir(parents=True)
    for name in ("near", "far", "far/0.000-0"):
        (tmp_path / "gridmaps" / f"{name}.map").write_text(MAP)
    near = "map: near\nroot: [[0, 0], [2, 1],\n   [2, 1]]\nweighted: True\nweight_seed: 5\nincomplete: False\n"
    (tmp_path / "instances" / "near.mcpp").write_text(near)
    (tmp_path / "instances" / "far.mcpp").write_text("map: far\nroot: [[2, 2]]\nweighted: False\n")
    (tmp_path / "instances" / "far" / "0.000-0.mcpp").write_text("map: far\nroot: [[1, 3]]\nweighted: False")
    of = read_ls_mcpp(tmp_path, "near")
    assert of.robots == [(0, 0), (2, 1)]
    assert {place for move in of.prices for place in move} == {(0, 0), (1, 0), (0, 1), (1, 1), (2, 1)}
    # Each move is drawn from both ends, and the second one counts; (0, 3) to (1, 3) are drawn, but out of reach.
    drawn = np.random.RandomState(5).uniform(1, 3, size=12)
    assert of.prices[frozenset(((0, 0), (1, 0)))] == drawn[3]
    assert of.prices[frozenset(((1, 1), (2, 1)))] == drawn[9]
    assert read_ls_mcpp(tmp_path, "far").name == "far/0.000-0"
    assert read_ls_mcpp(tmp_path, "far").prices == {frozenset(((0, 3), (1, 3))): 1.0}


def test_maps_of_tmstc_are_read(tmp_path: Path) -> None:
    pixels = np.full((65, 60), 255, dtype=np.uint8)
    pixels[60:] = 0  # half a cell at the lower edge, which is the first row
    pixels[3, 25] = 0  # a block of cells goes
    Image.fromarray(pixels[::-1]).save(tmp_path / "small.png")
    of = read_tmstc(tmp_path, "small.png")
    places = {place for move in of.prices for place in move}
    assert places == {(x, y) for x in range(6) for y in range(6)} - {(2, 0), (3, 0), (2, 1), (3, 1)}
    assert of.robots == [(0, 0), (0, 5), (5, 0), (5, 5), (3, 3)]
    assert of.cost([(0, 0), (1, 0), (1, 1), (1, 0), (0, 0)]) == 4 + 2 * 3


def test_walks_of_others_are_led_to_their_robots_and_judged(tmp_path: Path) -> None:
    of = problem("... ... ...", [(0, 0), (2, 2)])
    piece = [(1, 1), (1, 2), (0, 2)]
    assert closed(of, piece, 0) == [(0, 0), (0, 1), (1, 1), (1, 2), (0, 2), (0, 1), (0, 0)]
    assert closed(of, [], 1) == [(2, 2)]
    (tmp_path / "drawn").mkdir()
    told = {"seconds": 1.5, "walks": [piece, [[2, 2]]], "makespan": 9.0}
    (tmp_path / "drawn" / "method.json").write_text(json.dumps(told))
    (found,) = read_found(tmp_path, of)
    assert (found.by, found.seconds, found.makespan, len(found.walks)) == ("method", 1.5, 9.0, 2)
    assert all(abs(u) + abs(v) == 1 for u, v in HEADINGS)


def test_the_page_has_the_best_of_others_beside_ours() -> None:
    row = {"of": "X", "name": "a", "cells": "9", "robots": "2", "bound": "4.5", "total": "", "seed": "", "date": ""}
    rows = [
        row | {"by": "one", "makespan": "10.0", "cpu_s": "1"},
        row | {"by": "two", "makespan": "8.0", "cpu_s": "2"},
        row | {"by": "ours, 300", "makespan": "6.0", "cpu_s": "0.5"},
    ]
    assert "| a | 9 | 2 | 4.5 | 8.0 | two | 2 s | 6.0 (-25.0%), 0.5 s |" in page(rows, "")

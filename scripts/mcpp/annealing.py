"""The search: robots take the loops beside them, then loops are cut out and inserted anew, at a temperature that falls."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scripts.mcpp.inserting import Mood, Search, insert, search_memory
from scripts.mcpp.loops import (
    NO_LOOP,
    Loop,
    cut_beside,
    cut_bridge,
    cut_corner,
    cut_crossing,
    loop_of,
    turn_between,
)
from scripts.mcpp.walks import NONE, Grid, Walks, add_visit, closed_cost, compiled, join, no_walks

_LONGEST_LOOP = 2000
_PATHS, _LONGEST_PATH = 0.01, 200
"""Share of the steps that look for a robot further away, and moves to it."""
_CROSSINGS, _BRIDGES = 0.6, 0.7
"""Of the steps at a cell that is visited twice, and of those, where a walk goes there and back."""
_CORNERS = (0.03, 0.3)
"""Of the other steps: at a cell that is visited once, and more often."""
_LOOKS = 50
"""Times that the walks are kept, if none were better."""


class Schedule(NamedTuple):
    """How the search cools; costs in units of a mean move.

    The default was the best of eight on twelve generated grids: free, with obstacles, rooms, a corridor.

    Attributes:
        hot, cold: first and last temperature.
        wide, narrow: first and last width of :class:`scripts.mcpp.inserting.Mood`.
    """

    hot: float = 0.7
    cold: float = 0.1
    wide: float = 20.0
    narrow: float = 1.0


def shortest_walks(
    grid: Grid, places: NDArray[np.int64], roots: Sequence[int], steps: int, seed: int, schedule: Schedule | None = None
) -> list[list[int]]:
    """Closed walks that visit every cell, the costliest as cheap as it could be made.

    Args:
        grid: its cells, all of them connected to a root.
        places: (n, 2) column and row of each cell.
        roots: cell where each robot begins and ends.
        steps: of the search.
        seed: of its random numbers: the same one, the same walks.
        schedule: how it cools.

    Returns:
        cells of each robot in order, the first one again at the end; one that stays at its root has only that.
    """
    rng, search = np.random.default_rng(seed), search_memory(len(places))
    walks, loops = _blocks(grid, places, roots)
    _grow(grid, walks, search, loops, rng)
    unit = float(grid.price[grid.near != NONE].mean()) if (grid.near != NONE).any() else 1.0
    cooling = unit * np.array(schedule or Schedule())
    best, every = walks, max(1, steps // _LOOKS)
    for begin in range(0, steps, every):
        _anneal(grid, walks, search, cooling, (begin, min(begin + every, steps), steps), rng)
        if best is walks or walks.cost.max() <= best.cost.max():
            best = Walks(*(each.copy() for each in walks))
    return [_cells(grid, best, robot) for robot in range(len(roots))]


def _cells(grid: Grid, walks: Walks, robot: int) -> list[int]:
    """A walk in the direction that begins cheaper."""
    root = int(walks.root[robot])
    cells, visit = [int(walks.cell[root])], int(walks.ahead[root])
    while visit != root:
        cells.append(int(walks.cell[visit]))
        visit = int(walks.ahead[visit])
    if len(cells) == 1:
        return cells
    cells.append(cells[0])
    forwards, backwards = walks.head[root], walks.head[walks.behind[root]] ^ 2
    return cells if grid.start[forwards] <= grid.start[backwards] else cells[::-1]


def _blocks(grid: Grid, places: NDArray[np.int64], roots: Sequence[int]) -> tuple[Walks, NDArray[np.int64]]:
    """Loops of two by two cells where they are whole, else of one cell; the first robot in a loop has it as its walk.

    Returns:
        the walks, and (n,) a visit of each cell.
    """
    walks, loops = no_walks(len(places), len(roots)), np.full(len(places), NONE, dtype=np.int64)
    blocks: dict[tuple[int, int], list[int]] = {}
    for cell, (column, row) in enumerate(places.tolist()):
        blocks.setdefault((column // 2, row // 2), []).append(cell)
    for block in blocks.values():
        ring = sorted(block, key=lambda cell: (places[cell, 1] % 2, (places[cell].sum()) % 2))
        for cell in ring:
            loops[cell] = add_visit(walks, cell, NONE)
        whole = len(ring) == 4 and all(b in grid.near[a] for a, b in zip(ring, ring[1:] + ring[:1], strict=True))
        for a, b in zip(ring, ring[1:] + ring[:1], strict=True) if whole else ():
            join(grid, walks, loops[a], loops[b])
    for robot, root in enumerate(roots):
        visit = loops[root] if walks.robot[loops[root]] == NONE else add_visit(walks, root, robot)
        walks.root[robot] = each = visit
        while walks.robot[each] == NONE:
            walks.robot[each] = robot
            each = walks.ahead[each]
    return walks, loops


@compiled
def _grow(grid: Grid, walks: Walks, search: Search, loops: NDArray[np.int64], rng: np.random.Generator) -> None:
    """The robot with the cheapest walk takes the next loop beside it, until nobody is beside one."""
    robots, cells = walks.root.size, loops.size
    # Cells of each robot as a list, in the order in which it got them.
    following, first, last = np.full(cells, NONE), np.full(robots, NONE), np.full(robots, NONE)
    taken = np.zeros(cells, dtype=np.bool_)
    for robot in range(robots):
        visit = root = walks.root[robot]
        walks.cost[robot] = closed_cost(grid, walks, root)
        while True:
            cell = walks.cell[visit]
            if not taken[cell]:
                taken[cell] = True
                following[cell] = first[robot]
                first[robot] = cell
                last[robot] = cell if last[robot] == NONE else last[robot]
            visit = walks.ahead[visit]
            if visit == root:
                break
    while True:
        robot = NONE
        for each in range(robots):
            if first[each] != NONE and (robot == NONE or walks.cost[each] < walks.cost[robot]):
                robot = each
        if robot == NONE:
            return
        free = NONE
        for heading in range(4):
            near = grid.near[first[robot], heading]
            if near != NONE and not taken[near]:
                free = near
        if free == NONE:
            first[robot] = following[first[robot]]
            continue
        loop = loop_of(grid, walks, loops[free], NONE, 0.0, True)
        visit = loop.first
        for _ in range(loop.size):
            cell = walks.cell[visit]
            taken[cell] = True
            following[last[robot]] = cell
            last[robot] = cell
            visit = walks.ahead[visit]
        insert(grid, walks, search, loop, Mood(1e-9, 1.0, robot, 0), rng)


@compiled
def _anneal(
    grid: Grid, walks: Walks, search: Search, cooling: NDArray[np.float64], steps: tuple[int, int, int],
    rng: np.random.Generator,
) -> None:  # fmt: skip
    """Some of the steps of a search: from one, up to another, of so many."""
    hot, cold, wide, narrow = cooling[0], cooling[1], cooling[2], cooling[3]
    begin, end, total = steps
    cells = walks.first_here.size
    temperature, width = hot, wide
    for step in range(begin, end):
        if (step - begin) % 1024 == 0:
            temperature = hot * (cold / hot) ** (step / total)
            width = wide * (narrow / wide) ** (step / total)
        longest = int(min(2.0 / (rng.random() + 1e-9), _LONGEST_LOOP))
        reach = int(min(4.0 / (rng.random() + 1e-9), _LONGEST_PATH)) if rng.random() < _PATHS else 0
        if walks.sizes[0] < 2 * reach + 8:
            reach = 0
            if walks.sizes[0] < 8:
                continue
        loop = _cut_somewhere(grid, walks, int(rng.random() * cells), longest, temperature, rng)
        if loop.size > 0:
            insert(grid, walks, search, loop, Mood(temperature, width, NONE, reach), rng)


@compiled
def _any_visit(walks: Walks, cell: int, rng: np.random.Generator) -> int:
    visit = walks.first_here[cell]
    if walks.times[cell] > 1:
        for _ in range(int(rng.random() * walks.times[cell])):
            visit = walks.next_here[visit]
    return visit


@compiled
def _cut_somewhere(
    grid: Grid, walks: Walks, cell: int, longest: int, temperature: float, rng: np.random.Generator
) -> Loop:
    """A loop that begins at a cell, in one of the ways; none where there is none, or when a part was turned round instead."""
    visit = _any_visit(walks, cell, rng)
    robot, heading = walks.robot[visit], walks.head[visit]
    if heading == NONE:
        return NO_LOOP
    next_cell, several = walks.cell[walks.ahead[visit]], walks.times[cell] > 1
    if several and rng.random() < _CROSSINGS:
        back = walks.first_here[next_cell]
        while back != NONE and (walks.robot[back] != robot or walks.cell[walks.ahead[back]] != cell):
            back = walks.next_here[back]
        if back != NONE and rng.random() < _BRIDGES:
            return cut_bridge(grid, walks, visit, back, longest)
        again = _any_visit(walks, cell, rng)
        if again == visit or walks.robot[again] != robot:
            return NO_LOOP
        return cut_crossing(grid, walks, visit, again, longest)
    if rng.random() < (_CORNERS[1] if several else _CORNERS[0]):
        return cut_corner(grid, walks, visit)
    side = heading ^ (1 if rng.random() < 0.5 else 3)
    here, there = grid.near[cell, side], grid.near[next_cell, side]
    other = NONE if here == NONE or there == NONE else walks.first_here[here]
    while other != NONE:
        if walks.robot[other] == robot and walks.head[other] != NONE:
            if walks.cell[walks.behind[other]] == there:
                return cut_beside(grid, walks, visit, other, longest)
            if walks.cell[walks.ahead[other]] == there:
                turn_between(grid, walks, visit, other, longest, temperature, rng)
                return NO_LOOP
        other = walks.next_here[other]
    return NO_LOOP

"""Where a loop may be inserted into a walk, what each way costs, and how it is done.

Every loop may go back to where it was cut out, so the best way under noise is a step of simulated annealing by itself (a heat
bath: the choice has the Boltzmann distribution, by Gumbel's noise).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scripts.mcpp.loops import Loop
from scripts.mcpp.walks import (
    NONE,
    Grid,
    Walks,
    add_visit,
    bend,
    bend_at,
    compiled,
    join,
    link,
    move_at,
    move_visit,
    remove_visit,
    turn_round,
)

NOT_FOUND, DROPPED, BESIDE, CROSSING, BRIDGE, CORNER, PATH = range(7)
_STEEPEST = 30.0
_ON_WAY = 3
"""Robots that are looked at along paths from one loop."""


class Mood(NamedTuple):
    """How choosy an insertion is.

    Attributes:
        temperature: of the noise, in costs.
        width: difference of the costs of two walks at which the longer one matters e times as much.
        whose: the only robot that may get the loop; NONE: anybody.
        reach: moves to a robot that is not beside the loop; less than 2: none is looked for.
    """

    temperature: float
    width: float
    whose: int
    reach: int


class Place(NamedTuple):
    """A way to insert a loop.

    Attributes:
        kind: NOT_FOUND, DROPPED, BESIDE, CROSSING, BRIDGE, CORNER or PATH.
        at: visit of the walk; BESIDE: where the move begins that is replaced.
        visit: of the loop; BESIDE: where its move begins that is replaced.
        backwards: whether the loop is turned round first.
        cost: that the walk gets.
        energy: that decides, with noise.
    """

    kind: int
    at: int
    visit: int
    backwards: bool
    cost: float
    energy: float


class Search(NamedTuple):
    """Working memory of a search for paths, owned by one caller: by cell.

    Attributes:
        seen: (n,) loop that a cell was last reached from.
        back: (n,) heading to the loop.
        depth: (n,) moves to it.
        visit: (n,) of the loop, where they end.
        queue: (n,) cells in the order in which they were reached.
    """

    seen: NDArray[np.int64]
    back: NDArray[np.int64]
    depth: NDArray[np.int64]
    visit: NDArray[np.int64]
    queue: NDArray[np.int64]


def search_memory(cells: int) -> Search:
    """For a grid of so many cells."""
    return Search(*(np.zeros(cells, dtype=np.int64) for _ in range(5)))


@compiled
def _energy(walks: Walks, loop: Loop, mood: Mood, robot: int, cost: float, rng: np.random.Generator) -> float:
    """What it is worth that a robot gets a loop; the longer a walk, the more every change of it matters."""
    noise = mood.temperature * math.log(-math.log(rng.random()))
    if loop.robot == NONE or robot == loop.robot:
        return loop.change + cost + noise
    width, one, other = mood.width, walks.cost[loop.robot], walks.cost[robot]
    longer = max(one, other)
    now = math.exp((one - longer) / width) + math.exp((other - longer) / width)
    then = math.exp(min((one + loop.change - longer) / width, _STEEPEST))
    then += math.exp(min((other + cost - longer) / width, _STEEPEST))
    return width * (then - now) + noise


@compiled
def _better(
    walks: Walks, loop: Loop, mood: Mood, best: Place, kind: int, at: int, visit: int, backwards: bool, cost: float,
    rng: np.random.Generator,
) -> Place:  # fmt: skip
    """The best place so far, or this one."""
    energy = _energy(walks, loop, mood, walks.robot[at], cost, rng)
    return Place(kind, at, visit, backwards, cost, energy) if energy < best.energy else best


@compiled
def _may_get(walks: Walks, mood: Mood, visit: int) -> bool:
    """Whether a visit is of a walk that may get the loop that was looked at last."""
    robot = walks.robot[visit]
    if walks.mark[visit] == walks.sizes[1] or robot == NONE:
        return False
    return mood.whose == NONE or robot == mood.whose


@compiled
def _beside(
    grid: Grid, walks: Walks, loop: Loop, mood: Mood, best: Place, visit: int, rng: np.random.Generator
) -> Place:
    """Beside the move that begins at a visit of the loop: both moves become two across."""
    following, heading = walks.ahead[visit], walks.head[visit]
    if heading == NONE:
        return best
    cell, next_cell = walks.cell[visit], walks.cell[following]
    into, out = walks.head[walks.behind[visit]], walks.head[following]
    opened = bend_at(grid, walks, visit) + bend_at(grid, walks, following) + grid.price[cell, heading]
    for side in (heading ^ 1, heading ^ 3):
        here, there = grid.near[cell, side], grid.near[next_cell, side]
        if here == NONE or there == NONE:
            continue
        across = grid.price[cell, side] + grid.price[next_cell, side] - opened - grid.price[here, heading]
        other = walks.first_here[here]
        while other != NONE:
            if _may_get(walks, mood, other) and walks.head[other] != NONE:
                before, behind = walks.behind[other], walks.ahead[other]
                if walks.cell[behind] == there:
                    cost = across - bend_at(grid, walks, other) - bend_at(grid, walks, behind)
                    cost += bend(grid, walks, other, walks.head[before], side ^ 2)
                    cost += grid.turn[side ^ 2, into ^ 2] + grid.turn[out ^ 2, side]
                    cost += bend(grid, walks, behind, side, walks.head[behind])
                    best = _better(walks, loop, mood, best, BESIDE, other, visit, True, loop.cost + cost, rng)
                if walks.cell[before] == there:
                    cost = across - bend_at(grid, walks, other) - bend_at(grid, walks, before)
                    cost += bend(grid, walks, before, walks.head[walks.behind[before]], side ^ 2)
                    cost += grid.turn[side ^ 2, out] + grid.turn[into, side]
                    cost += bend(grid, walks, other, side, walks.head[other])
                    best = _better(walks, loop, mood, best, BESIDE, before, visit, False, loop.cost + cost, rng)
            other = walks.next_here[other]
    return best


@compiled
def _crossing(
    grid: Grid, walks: Walks, loop: Loop, mood: Mood, best: Place, visit: int, rng: np.random.Generator
) -> Place:
    """At a cell that both visit: the walk goes round the loop when it is there."""
    into, out = walks.head[walks.behind[visit]], walks.head[visit]
    other = NONE if out == NONE else walks.first_here[walks.cell[visit]]
    while other != NONE:
        if _may_get(walks, mood, other):
            come, leave = walks.head[walks.behind[other]], walks.head[other]
            for backwards in (False, True):
                first, last = (into ^ 2, out ^ 2) if backwards else (out, into)
                cost = loop.cost - bend_at(grid, walks, visit) - bend_at(grid, walks, other)
                if leave == NONE:
                    cost += bend(grid, walks, other, last, first)
                else:
                    cost += bend(grid, walks, other, come, first) + grid.turn[last, leave]
                best = _better(walks, loop, mood, best, CROSSING, other, visit, backwards, cost, rng)
        other = walks.next_here[other]
    return best


@compiled
def _bridge_bends(grid: Grid, walks: Walks, at: int, visit: int, leave: int, arrive: int, backwards: bool) -> float:
    """The turns at both ends of a bridge from a walk to a loop, less those that were there."""
    cost = -bend_at(grid, walks, at) - bend_at(grid, walks, visit)
    if walks.head[at] == NONE:
        cost += bend(grid, walks, at, leave ^ 2, leave)
    else:
        cost += bend(grid, walks, at, walks.head[walks.behind[at]], leave) + grid.turn[leave ^ 2, walks.head[at]]
    into, out = walks.head[walks.behind[visit]], walks.head[visit]
    if out == NONE:
        return cost + grid.turn[arrive, arrive ^ 2]
    first, last = (into ^ 2, out ^ 2) if backwards else (out, into)
    return cost + grid.turn[arrive, first] + grid.turn[last, arrive ^ 2]


@compiled
def _bridge(
    grid: Grid, walks: Walks, loop: Loop, mood: Mood, best: Place, visit: int, rng: np.random.Generator
) -> Place:
    """From a neighbouring cell: there, round the loop, and back."""
    cell = walks.cell[visit]
    for heading in range(4):
        near = grid.near[cell, heading]
        other = NONE if near == NONE else walks.first_here[near]
        while other != NONE:
            if _may_get(walks, mood, other):
                moves = grid.price[cell, heading] + grid.price[near, heading ^ 2]
                for backwards in (False, True):
                    bends = _bridge_bends(grid, walks, other, visit, heading ^ 2, heading ^ 2, backwards)
                    cost = loop.cost + moves + bends
                    best = _better(walks, loop, mood, best, BRIDGE, other, visit, backwards, cost, rng)
            other = walks.next_here[other]
    return best


@compiled
def _corner(grid: Grid, walks: Walks, loop: Loop, mood: Mood, best: Place, rng: np.random.Generator) -> Place:
    """Of a single cell: a corner of a walk moves there from a cell that others visit too."""
    cell = walks.cell[loop.first]
    for heading in range(4):
        side = (heading + 1) & 3
        one, other = grid.near[cell, heading], grid.near[cell, side]
        from_cell = NONE if one == NONE or other == NONE else grid.near[one, side]
        if from_cell == NONE or walks.times[from_cell] < 2:
            continue
        visit = walks.first_here[from_cell]
        while visit != NONE:
            before, behind = walks.behind[visit], walks.ahead[visit]
            into, out = NONE, NONE
            if walks.cell[before] == one and walks.cell[behind] == other:
                into, out = heading ^ 2, side
            elif walks.cell[before] == other and walks.cell[behind] == one:
                into, out = side ^ 2, heading
            if into != NONE and _may_get(walks, mood, visit) and walks.root[walks.robot[visit]] != visit:
                was = walks.head[before], walks.head[visit]
                cost = -move_at(grid, walks, before) - move_at(grid, walks, visit) - bend_at(grid, walks, visit)
                cost -= bend_at(grid, walks, before) + bend_at(grid, walks, behind)
                walks.head[before], walks.head[visit] = into, out  # for a moment
                cost += bend_at(grid, walks, before) + bend_at(grid, walks, behind) + grid.turn[into, out]
                walks.head[before], walks.head[visit] = was
                cost += grid.price[walks.cell[before], into] + grid.price[cell, out]
                best = _better(walks, loop, mood, best, CORNER, visit, loop.first, False, cost, rng)
            visit = walks.next_here[visit]
    return best


@compiled
def _path(
    grid: Grid, walks: Walks, search: Search, loop: Loop, mood: Mood, best: Place, rng: np.random.Generator
) -> Place:
    """From a walk that costs less than the one that had the loop, over cells of others and back: breadth first from the loop."""
    number, filled, found = walks.sizes[1], 0, 0
    visit = loop.first
    while True:
        cell = walks.cell[visit]
        if search.seen[cell] != number:
            search.seen[cell], search.back[cell], search.depth[cell] = number, NONE, 0
            search.visit[cell], search.queue[filled] = visit, cell
            filled += 1
        visit = walks.ahead[visit]
        if visit == loop.first:
            break
    at = 0
    while at < filled and found < _ON_WAY and search.depth[search.queue[at]] < mood.reach:
        cell = search.queue[at]
        at += 1
        begin = int(rng.random() * 4)
        for k in range(4):
            heading = (begin + k) & 3
            near = grid.near[cell, heading]
            if near == NONE or search.seen[near] == number:
                continue
            search.seen[near], search.back[near], search.depth[near] = number, heading ^ 2, search.depth[cell] + 1
            search.visit[near], search.queue[filled] = search.visit[cell], near
            filled += 1
            other = walks.first_here[near] if search.depth[near] > 1 else NONE
            while other != NONE:
                robot = walks.robot[other]
                if _may_get(walks, mood, other) and robot != loop.robot and walks.cost[robot] < walks.cost[loop.robot]:
                    found += 1
                    visit = search.visit[near]
                    cost, arrive = _way(grid, search, near)
                    cost += loop.cost + _bridge_bends(grid, walks, other, visit, search.back[near], arrive, False)
                    best = _better(walks, loop, mood, best, PATH, other, visit, False, cost, rng)
                    break
                other = walks.next_here[other]
    return best


@compiled
def _way(grid: Grid, search: Search, cell: int) -> tuple[float, int]:
    """The moves from a cell to the loop and back, with the turns between, and the heading of the last one there."""
    cost, heading = 0.0, search.back[cell]
    while True:
        cell_there = grid.near[cell, heading]
        cost += grid.price[cell, heading] + grid.price[cell_there, heading ^ 2]
        onwards = search.back[cell_there]
        if onwards == NONE:
            return cost, heading
        cost += grid.turn[heading, onwards] + grid.turn[onwards ^ 2, heading ^ 2]
        cell, heading = cell_there, onwards


@compiled
def insert(grid: Grid, walks: Walks, search: Search, loop: Loop, mood: Mood, rng: np.random.Generator) -> bool:
    """Put the loop that was looked at last where it is best under noise; whether there was a place."""
    best = Place(NOT_FOUND, NONE, NONE, False, 0.0, np.inf)
    if loop.spare and mood.whose == NONE:
        noise = mood.temperature * math.log(-math.log(rng.random()))
        best = Place(DROPPED, NONE, NONE, False, 0.0, loop.change + noise)
    if loop.size == 1 and mood.whose == NONE:
        best = _corner(grid, walks, loop, mood, best, rng)
    if mood.reach > 1:
        best = _path(grid, walks, search, loop, mood, best, rng)
    bridges = loop.on_bridge or loop.size <= 2 or rng.random() < 0.1
    visit = loop.first
    while True:
        best = _beside(grid, walks, loop, mood, best, visit, rng)
        best = _crossing(grid, walks, loop, mood, best, visit, rng)
        if bridges:
            best = _bridge(grid, walks, loop, mood, best, visit, rng)
        visit = walks.ahead[visit]
        if visit == loop.first:
            break
    if best.kind == NOT_FOUND:
        return False
    if loop.robot != NONE:
        walks.cost[loop.robot] += loop.change
    if best.kind == DROPPED:
        for _ in range(loop.size):
            following = walks.ahead[visit]
            remove_visit(walks, visit)
            visit = following
        return True
    robot = walks.robot[best.at]
    walks.cost[robot] += best.cost
    for _ in range(loop.size):
        walks.robot[visit] = robot
        visit = walks.ahead[visit]
    if best.backwards:
        turn_round(walks, best.visit)
    _insert_at(grid, walks, search, best)
    return True


@compiled
def _insert_at(grid: Grid, walks: Walks, search: Search, place: Place) -> None:
    at, visit, following = place.at, place.visit, walks.ahead[place.at]
    heading = walks.head[at]
    if place.kind == CORNER:
        before, cell = walks.behind[at], walks.cell[visit]
        remove_visit(walks, visit)
        move_visit(walks, at, cell)
        join(grid, walks, before, at)
        join(grid, walks, at, following)
    elif place.kind == BESIDE:
        # The loop's move ends where the walk's begins, or it was turned round and begins there.
        first = visit if place.backwards else walks.ahead[visit]
        last = walks.behind[first]
        join(grid, walks, at, first)
        join(grid, walks, last, following)
    elif place.kind == CROSSING:
        first, first_heading = walks.ahead[visit], walks.head[visit]
        if heading == NONE:
            last = walks.behind[visit]
            link(walks, last, at, walks.head[last])
            remove_visit(walks, visit)
        else:
            link(walks, visit, following, heading)
        link(walks, at, first, first_heading)
    else:
        robot = walks.robot[at]
        last = visit
        if walks.head[visit] != NONE:
            last, before = add_visit(walks, walks.cell[visit], robot), walks.behind[visit]
            link(walks, before, last, walks.head[before])
        back = at
        if heading != NONE:
            back = add_visit(walks, walks.cell[at], robot)
            link(walks, back, following, heading)
        there = at
        if place.kind == PATH:
            cell = walks.cell[at]
            while search.depth[cell] > 1:
                cell = grid.near[cell, search.back[cell]]
                on, off = add_visit(walks, cell, robot), add_visit(walks, cell, robot)
                join(grid, walks, there, on)
                join(grid, walks, off, back)
                there, back = on, off
        join(grid, walks, there, visit)
        join(grid, walks, last, back)

"""Loops are cut out of walks in four ways, each the reverse of a way to insert them (``inserting.py``)."""

import math
from typing import NamedTuple

import numpy as np

from scripts.mcpp.walks import (
    NONE,
    Grid,
    Walks,
    add_visit,
    bend,
    bend_at,
    closed_cost,
    compiled,
    join,
    link,
    move_at,
    move_visit,
    remove_visit,
    set_alone,
    turn_path_round,
)


class Loop(NamedTuple):
    """A piece that belongs nowhere.

    Attributes:
        first: one of its visits: the one where it was cut.
        size: how many visits.
        cost: of going round once.
        spare: whether every cell of it is visited by others too.
        robot: whose walk it was cut out of, NONE: nobody's.
        change: of the cost of that walk.
        on_bridge: whether it was cut off at a bridge: moves there and back between two cells.
    """

    first: int
    size: int
    cost: float
    spare: bool
    robot: int
    change: float
    on_bridge: bool


@compiled
def loop_of(grid: Grid, walks: Walks, first: int, robot: int, change: float, on_bridge: bool) -> Loop:
    """Mark the visits of a loop, and look at it.

    Args:
        grid: its cells.
        walks: everything.
        first: a visit of it.
        robot: whose walk it was cut out of.
        change: of the cost of that walk, and of the loop, by the cut.
        on_bridge: as in :class:`Loop`.
    """
    walks.sizes[1] += 1
    number, size, visit = walks.sizes[1], 0, first
    while True:
        cell = walks.cell[visit]
        walks.mark[visit] = number
        if walks.cell_mark[cell] != number:
            walks.cell_mark[cell] = number
            walks.cell_visits[cell] = 0
        walks.cell_visits[cell] += 1
        size += 1
        visit = walks.ahead[visit]
        if visit == first:
            break
    spare = True
    while spare:
        cell = walks.cell[visit]
        spare = walks.times[cell] > walks.cell_visits[cell]
        visit = walks.ahead[visit]
        if visit == first:
            break
    cost = closed_cost(grid, walks, first)
    return Loop(first, size, cost, spare, robot, change - cost, on_bridge)


@compiled
def _shorter(walks: Walks, first: int, last: int, other_first: int, other_last: int, longest: int) -> int:
    """Which of the two paths of a walk ends first, 1 or 2, without its root; 0: none within so many moves."""
    root = walks.root[walks.robot[first]]
    one, other = first, other_first
    one_free, other_free = one != root, other != root
    for _ in range(longest):
        if one_free:
            if one == last:
                return 1
            one = walks.ahead[one]
            one_free = one != root
        if other_free:
            if other == other_last:
                return 2
            other = walks.ahead[other]
            other_free = other != root
        if not one_free and not other_free:
            return 0
    return 0


NO_LOOP = Loop(NONE, 0, 0.0, False, NONE, 0.0, False)


@compiled
def cut_beside(grid: Grid, walks: Walks, visit: int, back: int, longest: int) -> Loop:
    """Cut where a walk comes by in the other direction: two moves side by side become two across.

    Args:
        grid: its cells.
        walks: everything.
        visit: where the one move begins.
        back: where the other one ends, beside it.
        longest: of the loop.
    """
    a, b, c, d = visit, walks.ahead[visit], back, walks.behind[back]
    side = _shorter(walks, b, d, c, a, longest)
    if side == 0:
        return NO_LOOP
    if side == 2:
        a, b, c, d = d, c, b, a
    before = bend_at(grid, walks, a) + bend_at(grid, walks, b) + bend_at(grid, walks, c) + bend_at(grid, walks, d)
    before += move_at(grid, walks, a) + move_at(grid, walks, d)
    join(grid, walks, a, c)
    join(grid, walks, d, b)
    after = bend_at(grid, walks, a) + bend_at(grid, walks, b) + bend_at(grid, walks, c) + bend_at(grid, walks, d)
    after += move_at(grid, walks, a) + move_at(grid, walks, d)
    return loop_of(grid, walks, d, walks.robot[a], after - before, False)


@compiled
def cut_crossing(grid: Grid, walks: Walks, visit: int, again: int, longest: int) -> Loop:
    """Cut where a walk comes to the same cell again: each part keeps one of the visits."""
    side = _shorter(walks, walks.ahead[visit], again, walks.ahead[again], visit, longest)
    if side == 0:
        return NO_LOOP
    if side == 2:
        visit, again = again, visit
    before = bend_at(grid, walks, visit) + bend_at(grid, walks, again)
    following, heading = walks.ahead[visit], walks.head[visit]
    link(walks, visit, walks.ahead[again], walks.head[again])
    link(walks, again, following, heading)
    after = bend_at(grid, walks, visit) + bend_at(grid, walks, again)
    return loop_of(grid, walks, again, walks.robot[visit], after - before, False)


@compiled
def cut_bridge(grid: Grid, walks: Walks, visit: int, back: int, longest: int) -> Loop:
    """Cut where a walk makes the same move there and back: both moves go, and one visit at either end.

    Args:
        grid: its cells.
        walks: everything.
        visit: where the move there begins.
        back: where the move back begins, at the cell where the other ends.
        longest: of the loop.
    """
    a, b, c, d = visit, walks.ahead[visit], back, walks.ahead[back]
    side = _shorter(walks, b, c, d, a, longest)
    if side == 0:
        return NO_LOOP
    if side == 2:
        a, b, c, d = c, d, a, b
    robot = walks.robot[a]
    before = bend_at(grid, walks, a) + bend_at(grid, walks, b) + move_at(grid, walks, a) + move_at(grid, walks, c)
    if d != a:
        before += bend_at(grid, walks, d)
    if c != b:
        before += bend_at(grid, walks, c)
    kept = a
    if d == a:
        set_alone(walks, a)
    elif walks.root[robot] == d:
        kept, last = d, walks.behind[a]
        link(walks, last, d, walks.head[last])
        remove_visit(walks, a)
    else:
        link(walks, a, walks.ahead[d], walks.head[d])
        remove_visit(walks, d)
    if c == b:
        set_alone(walks, b)
    else:
        last = walks.behind[c]
        link(walks, last, b, walks.head[last])
        remove_visit(walks, c)
    after = bend_at(grid, walks, kept) + bend_at(grid, walks, b)
    return loop_of(grid, walks, b, robot, after - before, True)


@compiled
def cut_corner(grid: Grid, walks: Walks, visit: int) -> Loop:
    """Cut a corner off: the walk goes round the other way, over a cell that is visited already; the corner is a loop of one."""
    before, behind = walks.behind[visit], walks.ahead[visit]
    into, out = walks.head[before], walks.head[visit]
    cell, robot = walks.cell[visit], walks.robot[visit]
    if walks.root[robot] == visit or (into ^ out) & 1 == 0:
        return NO_LOOP
    other = grid.near[walks.cell[before], out]
    if other == NONE:
        return NO_LOOP
    was = bend_at(grid, walks, before) + bend_at(grid, walks, visit) + bend_at(grid, walks, behind)
    was += move_at(grid, walks, before) + move_at(grid, walks, visit)
    move_visit(walks, visit, other)
    walks.head[before], walks.head[visit] = out, into
    now = bend_at(grid, walks, before) + bend_at(grid, walks, visit) + bend_at(grid, walks, behind)
    now += move_at(grid, walks, before) + move_at(grid, walks, visit)
    return loop_of(grid, walks, add_visit(walks, cell, robot), robot, now - was, False)


@compiled
def turn_between(
    grid: Grid, walks: Walks, visit: int, beside: int, longest: int, temperature: float, rng: np.random.Generator
) -> bool:
    """Where a walk comes by in the same direction: what lies between is walked the other way round, if that is accepted.

    Args:
        grid: its cells.
        walks: everything.
        visit: where the one move begins.
        beside: where the other one begins.
        longest: moves between them, at the shorter side.
        temperature: of the acceptance (Metropolis).
        rng: draws.
    """
    a, b, c, d = visit, walks.ahead[visit], beside, walks.ahead[beside]
    one, other = b, d
    for _ in range(longest):
        if one == c or other == a:
            break
        one, other = walks.ahead[one], walks.ahead[other]
    if one != c and other != a:
        return False
    across = NONE
    for heading in range(4):
        if grid.near[walks.cell[a], heading] == walks.cell[c]:
            across = heading
    change = grid.price[walks.cell[a], across] + grid.price[walks.cell[b], across]
    change -= move_at(grid, walks, a) + move_at(grid, walks, c)
    change -= bend_at(grid, walks, a) + bend_at(grid, walks, b) + bend_at(grid, walks, c) + bend_at(grid, walks, d)
    change += bend(grid, walks, a, walks.head[walks.behind[a]], across)
    change += bend(grid, walks, c, across, walks.head[walks.behind[c]] ^ 2)
    change += bend(grid, walks, b, walks.head[b] ^ 2, across) + bend(grid, walks, d, across, walks.head[d])
    if change > 0.0 and rng.random() >= math.exp(-change / temperature):
        return False
    walks.cost[walks.robot[a]] += change
    if one == c:
        turn_path_round(walks, b, c)
        link(walks, a, c, across)
        link(walks, b, d, across)
    else:
        turn_path_round(walks, d, a)
        link(walks, c, a, across ^ 2)
        link(walks, d, b, across ^ 2)
    return True

"""Closed walks over the cells of a grid, one for each robot, as linked lists of visits that change in a few steps.

A visit is one time that a walk is at a cell; a cell may be visited by several walks, and several times by one. A walk begins
and ends at the visit of its robot's own cell, its root, which stays. A loop is a closed list of visits without a root: a piece
that was cut out of a walk and belongs nowhere yet. Headings are 0 east, 1 north, 2 west, 3 south; ``heading ^ 2`` is the
opposite.
"""

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

compiled = numba.njit(nogil=True)
"""Machine code for this process alone: what numba keeps on disk does not know when a function in another file changes."""

NONE = -1


class Grid(NamedTuple):
    """What cells there are, and what moves cost.

    Attributes:
        near: (n, 4) number of the next cell in each heading; NONE where there is none.
        price: (n, 4) of that move.
        turn: (4, 4) from one heading to another, symmetric and the same for opposite headings.
        start: (4,) of the first move, by its heading.
    """

    near: NDArray[np.int64]
    price: NDArray[np.float64]
    turn: NDArray[np.float64]
    start: NDArray[np.float64]


class Walks(NamedTuple):
    """All walks and loops. Made by :func:`no_walks`, changed by the functions of this package, one thread at a time.

    Attributes:
        cell: (v,) of each visit; NONE: this number is free.
        ahead, behind: (v,) the next visit and the one before; itself where it is alone.
        head: (v,) heading of the move to the next visit; NONE where it is alone.
        robot: (v,) whose walk; of a loop: whose it was, NONE for nobody.
        next_here, prev_here: (v,) other visits of the same cell, as a list.
        first_here: (n,) where that list begins.
        times: (n,) visits of each cell.
        free: (v,) numbers without a visit, a stack of ``sizes[0]``.
        sizes: (2,) free numbers, and loops that were looked at so far.
        mark: (v,) the last loop that a visit was seen in.
        cell_mark, cell_visits: (n,) the same of a cell, and how often that loop visits it.
        cost: (k,) of each robot's walk.
        root: (k,) its first visit.
    """

    cell: NDArray[np.int64]
    ahead: NDArray[np.int64]
    behind: NDArray[np.int64]
    head: NDArray[np.int64]
    robot: NDArray[np.int64]
    next_here: NDArray[np.int64]
    prev_here: NDArray[np.int64]
    first_here: NDArray[np.int64]
    times: NDArray[np.int64]
    free: NDArray[np.int64]
    sizes: NDArray[np.int64]
    mark: NDArray[np.int64]
    cell_mark: NDArray[np.int64]
    cell_visits: NDArray[np.int64]
    cost: NDArray[np.float64]
    root: NDArray[np.int64]


def no_walks(cells: int, robots: int) -> Walks:
    """Nothing is visited yet; there is room for far more visits than good walks have."""
    visits = 8 * cells + 64 * (robots + 1)

    def filled(size: int, value: int = NONE) -> NDArray[np.int64]:
        return np.full(size, value, dtype=np.int64)

    return Walks(
        cell=filled(visits), ahead=filled(visits), behind=filled(visits), head=filled(visits), robot=filled(visits),
        next_here=filled(visits), prev_here=filled(visits), first_here=filled(cells), times=filled(cells, 0),
        free=np.arange(visits)[::-1].copy(), sizes=np.array([visits, 0]), mark=filled(visits, 0),
        cell_mark=filled(cells, 0), cell_visits=filled(cells, 0), cost=np.zeros(robots), root=filled(robots),
    )  # fmt: skip


@compiled
def add_visit(walks: Walks, cell: int, robot: int) -> int:
    """A new visit, alone."""
    walks.sizes[0] -= 1
    visit = walks.free[walks.sizes[0]]
    walks.robot[visit] = robot
    set_alone(walks, visit)
    _list_here(walks, visit, cell)
    return visit


@compiled
def remove_visit(walks: Walks, visit: int) -> None:
    """Nothing leads to it any more."""
    _unlist(walks, visit)
    walks.cell[visit] = NONE
    walks.robot[visit] = NONE
    walks.free[walks.sizes[0]] = visit
    walks.sizes[0] += 1


@compiled
def move_visit(walks: Walks, visit: int, cell: int) -> None:
    """The same visit at another cell; headings are the caller's."""
    _unlist(walks, visit)
    _list_here(walks, visit, cell)


@compiled
def _list_here(walks: Walks, visit: int, cell: int) -> None:
    first = walks.first_here[cell]
    walks.cell[visit] = cell
    walks.next_here[visit], walks.prev_here[visit] = first, NONE
    if first != NONE:
        walks.prev_here[first] = visit
    walks.first_here[cell] = visit
    walks.times[cell] += 1


@compiled
def _unlist(walks: Walks, visit: int) -> None:
    before, behind = walks.prev_here[visit], walks.next_here[visit]
    if before == NONE:
        walks.first_here[walks.cell[visit]] = behind
    else:
        walks.next_here[before] = behind
    if behind != NONE:
        walks.prev_here[behind] = before
    walks.times[walks.cell[visit]] -= 1


@compiled
def set_alone(walks: Walks, visit: int) -> None:
    """No moves."""
    walks.ahead[visit] = walks.behind[visit] = visit
    walks.head[visit] = NONE


@compiled
def link(walks: Walks, visit: int, following: int, heading: int) -> None:
    """The move from one to the next."""
    walks.ahead[visit] = following
    walks.behind[following] = visit
    walks.head[visit] = heading


@compiled
def join(grid: Grid, walks: Walks, visit: int, following: int) -> None:
    """The move from one to the next, at a neighbouring cell."""
    for heading in range(4):
        if grid.near[walks.cell[visit], heading] == walks.cell[following]:
            link(walks, visit, following, heading)


@compiled
def bend(grid: Grid, walks: Walks, visit: int, into: int, out: int) -> float:
    """The turn at a visit that is come to with one heading and left with another; at a root the start in the better direction."""
    if into == NONE or out == NONE:
        return 0.0
    robot = walks.robot[visit]
    if robot != NONE and walks.root[robot] == visit:
        return min(grid.start[out], grid.start[into ^ 2])
    return grid.turn[into, out]


@compiled
def bend_at(grid: Grid, walks: Walks, visit: int) -> float:
    """The turn at a visit as it is."""
    return bend(grid, walks, visit, walks.head[walks.behind[visit]], walks.head[visit])


@compiled
def move_at(grid: Grid, walks: Walks, visit: int) -> float:
    """The move to the next visit."""
    heading = walks.head[visit]
    return 0.0 if heading == NONE else grid.price[walks.cell[visit], heading]


@compiled
def closed_cost(grid: Grid, walks: Walks, visit: int) -> float:
    """Of the walk or loop that a visit is in."""
    total, each = 0.0, visit
    while True:
        total += bend_at(grid, walks, each) + move_at(grid, walks, each)
        each = walks.ahead[each]
        if each == visit:
            return total


@compiled
def turn_round(walks: Walks, visit: int) -> None:
    """A walk or loop in the other direction."""
    each, before = visit, walks.head[walks.behind[visit]]
    while True:
        following, heading = walks.ahead[each], walks.head[each]
        walks.ahead[each], walks.behind[each] = walks.behind[each], following
        walks.head[each] = NONE if before == NONE else before ^ 2
        each, before = following, heading
        if each == visit:
            return


@compiled
def turn_path_round(walks: Walks, first: int, last: int) -> None:
    """The moves between two visits of a walk in the other direction; those to and from outside are the caller's."""
    each, before = first, NONE
    while True:
        following, heading = walks.ahead[each], walks.head[each]
        walks.ahead[each], walks.behind[each] = walks.behind[each], following
        walks.head[each] = NONE if before == NONE else before ^ 2
        if each == last:
            return
        each, before = following, heading

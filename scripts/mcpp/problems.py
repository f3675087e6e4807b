"""Problems of coverage by several robots on a grid, and what walks cost; nothing of the search is used here.

A walk is a list of places (column, row), each beside the one before. Its cost is the sum of the prices of its moves and turns.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from scripts.mcpp.walks import NONE, Grid

Place = tuple[int, int]
HEADINGS = ((1, 0), (0, 1), (-1, 0), (0, -1))
NORTH = 1
"""Where rows count upwards, as both publications have it."""


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """What is to be visited, by whom, and what it costs.

    Attributes:
        name: of the instance.
        prices: of the move between two places, in either direction; places that are in none do not exist.
        robots: where each begins and ends.
        quarter: price of a turn by 90 degrees.
        half: price of a turn by 180 degrees.
        facing: heading of all robots before their first move; none: the first move needs no turn.
    """

    name: str
    prices: Mapping[frozenset[Place], float]
    robots: Sequence[Place]
    quarter: float
    half: float
    facing: int | None

    def turn(self, before: int | None, heading: int) -> float:
        """From one heading to another."""
        return 0.0 if before is None else (0.0, self.quarter, self.half, self.quarter)[(heading - before) % 4]

    def cost(self, walk: Sequence[Place]) -> float:
        """Of a walk.

        Raises:
            ValueError: a move leads to a place that is not beside the one before, or over an edge that does not exist.
        """
        total, heading = 0.0, self.facing
        for (x, y), (u, v) in itertools.pairwise(walk):
            move = frozenset(((x, y), (u, v)))
            if (u - x, v - y) not in HEADINGS or move not in self.prices:
                raise ValueError(f"no move from {(x, y)} to {(u, v)}")
            following = HEADINGS.index((u - x, v - y))
            total += self.prices[move] + self.turn(heading, following)
            heading = following
        return total

    def costs(self, walks: Sequence[Sequence[Place]]) -> list[float]:
        """Of the walks of all robots.

        Raises:
            ValueError: a place is not visited, a move is impossible, or a walk does not begin and end at its robot.
        """
        for walk, robot in zip(walks, self.robots, strict=True):
            if walk[0] != robot or walk[-1] != robot:
                raise ValueError(f"a walk from {walk[0]} to {walk[-1]} is not that of the robot at {robot}")
        missed = {place for move in self.prices for place in move} - {place for walk in walks for place in walk}
        if missed:
            raise ValueError(f"{len(missed)} places are not visited, one of them {min(missed)}")
        return [self.cost(walk) for walk in walks]

    def bound(self) -> float:
        """No longest walk is cheaper: every place where no robot begins is come to, by its cheapest move at least."""
        cheapest: dict[Place, float] = {}
        for move, price in self.prices.items():
            for place in move.difference(self.robots):
                cheapest[place] = min(price, cheapest.get(place, price))
        return sum(cheapest.values()) / len(self.robots)


def connected(places: set[Place], begins: Sequence[Place]) -> set[Place]:
    """Those that can be reached from a beginning."""
    waiting = [place for place in begins if place in places]
    found = set(waiting)
    while waiting:
        x, y = waiting.pop()
        near = [place for u, v in HEADINGS if (place := (x + u, y + v)) in places and place not in found]
        found.update(near)
        waiting += near
    return found


def grid_of(problem: Problem) -> tuple[Grid, list[Place]]:
    """The same as arrays, and the place of each cell."""
    places = sorted({place for move in problem.prices for place in move}, key=lambda place: place[::-1])
    number = {place: k for k, place in enumerate(places)}
    near, price = np.full((len(places), 4), NONE, dtype=np.int64), np.zeros((len(places), 4))
    for (x, y), cell in number.items():
        for heading, (u, v) in enumerate(HEADINGS):
            move = frozenset(((x, y), (x + u, y + v)))
            if move in problem.prices:
                near[cell, heading], price[cell, heading] = number[x + u, y + v], problem.prices[move]
    turn = np.array([[problem.turn(a, b) for b in range(4)] for a in range(4)])
    start = np.array([problem.turn(problem.facing, b) for b in range(4)])
    return Grid(near, price, turn, start), places

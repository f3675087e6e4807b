"""MOGWO: the multi-objective grey wolf optimizer, and the hypercubes of its archive.

Equations are numbered as in Mirjalili, Mirjalili and Lewis, "Grey wolf optimizer", Advances in Engineering Software 69, 2014.
The archive and the choice of leaders are those of the multi-objective version: Mirjalili, Saremi, Mirjalili and Coelho,
"Multi-objective grey wolf optimizer: a novel algorithm for multi-criterion optimization", Expert Systems with Applications
47, 2016, section 3, and the authors' published code where the text is silent. The archive is thinned, and leaders are chosen,
by how many solutions share a cell of objective space.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from uavcover.kernels.arrays import FloatArray, IntArray
from uavcover.optimizers.archive import Archive
from uavcover.optimizers.ask_tell import AskTellOptimizer
from uavcover.optimizers.interface import Solutions


def cells(objectives: FloatArray, *, n_grid: int, inflation: float) -> IntArray:
    """Cell of each solution; cells that hold something are numbered from 0.

    Along each objective the range, made wider by ``inflation`` times itself at both ends, gets ``n_grid - 1`` evenly spaced
    borders; so there are ``n_grid`` intervals, the first and last of which have no outer end.

    Args:
        objectives: ``(k, m)``, k >= 1.
        n_grid: intervals per objective, >= 3.
        inflation: alpha, >= 0.

    Returns:
        ``(k,)`` cell numbers, 0 to the number of occupied cells - 1.

    >>> cells(np.array([[0.0, 1.0], [0.01, 0.99], [1.0, 0.0]]), n_grid=10, inflation=0.1).tolist()
    [0, 0, 1]
    """
    low, high = objectives.min(axis=0), objectives.max(axis=0)
    margin = inflation * (high - low)
    borders = np.linspace(low - margin, high + margin, n_grid - 1)
    place = np.zeros(len(objectives), np.int64)
    for j in range(objectives.shape[1]):
        interval = np.searchsorted(borders[:, j], objectives[:, j], side="right")
        # number pairs densely at once, so that many objectives do not overflow
        place = np.unique(place * n_grid + interval, return_inverse=True)[1].astype(np.int64)
    return place


def thinned(cell: IntArray, keep: int, *, rng: np.random.Generator) -> IntArray:
    """Rows that remain when a random member of the most crowded cell is removed, one at a time.

    Draws ``random((r, 2))``, r = rows to remove: which of the equally crowded cells, and which of its members.

    Args:
        cell: ``(k,)`` the cell of each row, as `cells` numbers them.
        keep: how many to keep.
        rng: source of random numbers.

    Returns:
        ``(min(k, keep),)`` row numbers, ascending.
    """
    if len(cell) <= keep:
        return np.arange(len(cell), dtype=np.int64)
    order = np.argsort(cell, kind="stable")
    members = [rows.tolist() for rows in np.split(order, np.cumsum(np.bincount(cell))[:-1])]
    counts = [len(rows) for rows in members]
    for which, member in rng.random((len(cell) - keep, 2)).tolist():
        most = max(counts)
        crowded = [i for i, count in enumerate(counts) if count == most]
        chosen = crowded[int(which * len(crowded))]
        members[chosen].pop(int(member * most))
        counts[chosen] -= 1
    return np.array(sorted(row for rows in members for row in rows), dtype=np.int64)


@dataclass(frozen=True, slots=True, eq=False)
class LeaderChoice:
    """The archive by cells, ready to draw leaders from.

    Attributes:
        by_cell: ``(k,)`` row numbers, those of cell 0 first.
        starts: ``(c,)`` where each cell begins in ``by_cell``.
        counts: ``(c,)`` members of each cell.
        place: ``(k,)`` where each row stands in ``by_cell``.
        cell: ``(k,)`` the cell of each row.
        pressure: beta.
    """

    by_cell: IntArray
    starts: IntArray
    counts: IntArray
    place: IntArray
    cell: IntArray
    pressure: float

    @classmethod
    def of(cls, cell: IntArray, *, pressure: float) -> "LeaderChoice":
        """For rows in these cells ``(k,)``, k >= 1, with selection pressure beta."""
        by_cell = np.argsort(cell, kind="stable").astype(np.int64)
        counts = np.bincount(cell).astype(np.int64)
        place = np.empty_like(by_cell)
        place[by_cell] = np.arange(len(cell))
        return cls(by_cell, np.cumsum(counts) - counts, counts, place, cell, pressure)

    def drawn(self, count: int, taken: IntArray, rng: np.random.Generator) -> IntArray:
        """For each of ``count`` wolves a row that it has not taken yet.

        A cell is drawn in proportion to its count ** -beta (the roulette P = c / N of the paper, with the pressure of the
        authors' code), then one of its members. What a wolf has taken does not count. Draws ``random((count, 2))``.

        Args:
            count: wolves, g.
            taken: ``(g, j)`` different rows each wolf already has; if the archive holds no others, nothing is barred.
            rng: source of random numbers.

        Returns:
            ``(g,)`` row numbers.
        """
        which, member = rng.random((count, 2)).T
        if taken.shape[1] >= len(self.cell):
            taken = taken[:, :0]
        left = np.tile(self.counts, (count, 1))
        wolves = np.arange(count)
        for column in taken.T:
            left[wolves, self.cell[column]] -= 1
        with np.errstate(divide="ignore"):
            weights = np.where(left > 0, left.astype(np.float64) ** -self.pressure, 0.0)
        steps = weights.cumsum(axis=1)
        end = steps[:, -1]
        mark = np.minimum(which * end, np.nextafter(end, 0.0))  # below the end, also after rounding
        chosen = (steps <= mark[:, None]).sum(axis=1)
        position = self.starts[chosen] + (member * left[wolves, chosen]).astype(np.int64)
        # step over those of the same cell that are taken, in ascending order
        for barred in np.sort(self.place[taken], axis=1).T:
            position += (self.cell[self.by_cell[barred]] == chosen) & (barred <= position)
        chosen_rows: IntArray = self.by_cell[position]
        return chosen_rows


def encircle(x: FloatArray, leader: FloatArray, *, a: float, rng: np.random.Generator) -> FloatArray:
    """Positions to which one leader draws its wolves.

    Draws ``random((n, d))`` for r1, then for r2.

    Args:
        x: ``(n, d)`` positions X(t).
        leader: ``(n, d)`` alpha, beta or delta of each.
        a: falls from 2 to 0 over the rounds.
        rng: source of random numbers.

    Returns:
        ``(n, d)``: X1, X2 or X3.
    """
    big_a = 2 * a * rng.random(x.shape) - a  # Eq. 3.3
    c = 2 * rng.random(x.shape)  # Eq. 3.4
    distance = np.abs(c * leader - x)  # Eq. 3.5
    return leader - big_a * distance  # Eq. 3.6


class MOGWO(AskTellOptimizer):
    """Grey wolves that follow three leaders from the least crowded cells of a grid; arguments as `AskTellOptimizer`.

    Wolves go where they are sent, better or not; the archive is the memory. Table 2 has beta = 10, the original 4. Its gamma
    belongs to the authors' code, which removes from a cell drawn by count ** gamma; here the most crowded cell loses a member,
    as their text says, because with gamma = 2 the archive loses the ends of the front (figures in docs/explanation/imodbo.md).
    """

    n_grid: ClassVar[int] = 10  # Table 2
    grid_inflation: ClassVar[float] = 0.1  # alpha, Table 2
    leader_pressure: ClassVar[float] = 10.0  # beta, Table 2

    _wolves: FloatArray  # (n, d) positions X(t)

    def _sample(self, rng: np.random.Generator) -> FloatArray:
        return self._box.uniform(self._population_size, rng)

    def _move(self, rng: np.random.Generator) -> FloatArray:
        a = 2 - 2 * self._iteration / self._max_iterations
        best = self._archive.solutions
        choice = LeaderChoice.of(self._cells(best), pressure=self.leader_pressure)
        taken = np.empty((self._population_size, 0), np.int64)
        pulled = np.zeros_like(self._wolves)
        for _ in range(3):  # delta, beta, alpha: different ones as long as there are any
            row = choice.drawn(self._population_size, taken, rng)
            taken = np.column_stack([taken, row])
            pulled += encircle(self._wolves, best.x[row], a=a, rng=rng)
        return pulled / 3  # Eq. 3.7

    def _cells(self, solutions: Solutions) -> IntArray:
        return cells(solutions.objectives, n_grid=self.n_grid, inflation=self.grid_inflation)

    def _archive_with(self, evaluated: Solutions) -> Archive:
        merged = self._archive.non_dominated_with(evaluated)
        kept = thinned(self._cells(merged), self._archive.capacity, rng=self._rngs["moves"])
        return Archive(merged.rows(kept), self._archive.capacity)

    def _learn(self, evaluated: Solutions) -> None:
        self._wolves = evaluated.x

    def _memory(self) -> dict[str, npt.NDArray[Any]]:
        return {} if self._iteration == 0 else {"wolves": self._wolves}

    def _recall(self, memory: dict[str, npt.NDArray[Any]]) -> None:
        self._wolves = memory["wolves"]

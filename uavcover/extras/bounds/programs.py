"""Programs that bounds are proved with: prices of ground by linear programs, and exact set covers.

Prices are the most for the required ground with which no sampled move gains too much. Set covers are linear and mixed-integer
programs on a reduced table, which HiGHS solves through scipy.
"""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import scipy
from numpy.typing import NDArray

from uavcover.extras.bounds.bound_heights import margin_cells
from uavcover.extras.bounds.relief import Relief, rates_by_node
from uavcover.kernels.arrays import BoolArray, FloatArray, IntArray
from uavcover.planner.set_cover import Reduced
from uavcover.sensing.coverage_map import CoverageMap

_BLOCKS_A_REACH = 3.2
"""Smaller blocks gain in the program, and lose as much in the proof: their prices are rougher."""
_FEWEST_CELLS = 3
"""Along the side of a block."""
_HEADINGS = 16
_NEARLY = 1.003
"""A rate that is not worth another round of the program."""
_IDLE = 0.9
"""A move that gains less is omitted of the next round."""
_LOOKS_AT_ONCE = 150

Rows: TypeAlias = Any
"""Compressed rows (scipy.sparse.csr_array), whose stubs know no stacking of them."""


def headings_over_half_a_turn(count: int) -> FloatArray:
    """(count, 2) unit vectors; a rate is the same both ways."""
    angles = math.pi / count * np.arange(count)
    return np.column_stack([np.cos(angles), np.sin(angles)])


def middles_of_bins(count: int) -> FloatArray:
    """(count, 2) middles of equal bins all around."""
    angles = 2.0 * math.pi / count * (np.arange(count) + 0.5)
    return np.column_stack([np.cos(angles), np.sin(angles)])


class PriceProgram:
    """Prices of a square metre at the nodes of blocks, bilinear between them.

    Variables: the price at each node, the price of what may stay unseen, and that of the first look.

    Attributes:
        per_m2: (across, across) prices at the nodes of blocks; rows go north.
        parts: squares of the relief along the side of a cell.
        first_look_m: what any sampled place observes is worth at most this.
    """

    def __init__(self, coverage: CoverageMap, weight_m2: FloatArray, relief: Relief, fraction: float) -> None:
        cells = coverage.grid.cells
        self._cells_a_block = max(
            _FEWEST_CELLS,
            math.ceil(max(cells.lattice.shape) / 64),  # at most 64 blocks across
            math.floor(relief.reach / (_BLOCKS_A_REACH * cells.size_m)),
        )
        self.across = math.ceil(max(cells.lattice.shape) / self._cells_a_block) + 2
        self._relief, self._margin = relief, margin_cells(coverage)
        self.parts = round(cells.size_m / relief.side)
        self._size_m = cells.size_m
        self._row, self._column = np.nonzero(cells.lattice >= 0)
        number = cells.lattice[self._row, self._column]
        wanted = weight_m2[number] > 0.0
        self._row, self._column, number = self._row[wanted], self._column[wanted], number[wanted]
        self.weight_m2 = weight_m2[number]
        self.priced: BoolArray = self.by_squares(np.ones(len(number))) > 0.0
        middle = self._basis(0.5, 0.5)
        self._nodes = np.flatnonzero(middle.sum(axis=0) > 0.0)
        worth = middle.sum(axis=0)[self._nodes]
        # A square metre of the map is so much ground around each node.
        self._ground = (middle.T @ (self.weight_m2 / cells.size_m**2))[self._nodes] / worth
        self._worth = np.concatenate([worth * cells.size_m**2, [-(1.0 - fraction) * self.weight_m2.sum(), -1.0]])
        self._rows: list[Rows] = []
        self._scale = np.zeros(0)
        self._moves: list[IntArray] = []
        self._looks: IntArray = np.zeros(0, dtype=np.int64)
        self.per_m2, self.first_look_m = np.zeros((self.across, self.across)), 0.0

    def look_at(self, where: IntArray, scale: FloatArray) -> None:
        """Add the middles of squares (p, 2), where rates are held below 1 / scale (p,)."""
        new = self._rows_of(where)
        first = len(self._scale)
        self._scale = np.concatenate([self._scale, scale])
        if not self._rows:
            self._rows = new
            every_second = np.arange(0, len(where), 2)
            self._moves = [every_second if m % 2 == 0 else every_second[:0] for m in range(_HEADINGS)]
            self._looks = np.argsort(-new[-1].sum(axis=1))[:_LOOKS_AT_ONCE]
            return
        self._rows = [scipy.sparse.vstack([a, b], format="csr") for a, b in zip(self._rows, new, strict=True)]
        self._moves = [np.union1d(moves, np.arange(first, len(self._scale))) for moves in self._moves]

    def rates_at(self, where: IntArray) -> FloatArray:
        """(p,) the largest rate at the middle of squares (p, 2), at these prices."""
        rows = self._rows_of(where)
        found: FloatArray = np.max([each @ self.per_m2.ravel()[self._nodes] for each in rows[:-1]], axis=0)
        return found

    def solve(self) -> None:
        """A start with few of the moves, and those added that gain too much, until none does."""
        for _ in range(4):
            found = self._solve_chosen()
            per_m2, look_m = np.maximum(found[:-2], 0.0), float(found[-1])
            gains = [(rows @ per_m2) * self._scale for rows in self._rows[:-1]]
            looks = self._rows[-1] @ per_m2
            added = 0
            for m, gain in enumerate(gains):
                too_much = np.flatnonzero(gain > _NEARLY)
                added += len(np.setdiff1d(too_much, self._moves[m]))
                self._moves[m] = np.union1d(self._moves[m][gain[self._moves[m]] > _IDLE], too_much)
            observed = np.flatnonzero(looks > _NEARLY * look_m)
            most = observed[np.argsort(-looks[observed])[:_LOOKS_AT_ONCE]]
            self._looks = np.union1d(self._looks[looks[self._looks] > _IDLE * look_m], most)
            if not added and not len(observed):
                break
        flat = np.zeros(self.across**2)
        flat[self._nodes] = per_m2
        self.per_m2, self.first_look_m = flat.reshape(self.across, self.across), look_m

    def of_cells(self, field: FloatArray) -> FloatArray:
        """(cells,) what a field (rows, columns) of all cells of the relief has for each cell with a weight."""
        found: FloatArray = field[self._row + self._margin, self._column + self._margin]
        return found

    def by_squares(self, values: FloatArray) -> FloatArray:
        """(rows, columns) of the relief's squares: what their cells (cells,) have; 0 without one."""
        field = np.zeros(tuple(count // self.parts for count in self._relief.allowed.shape))
        field[self._row + self._margin, self._column + self._margin] = values
        return field.repeat(self.parts, axis=0).repeat(self.parts, axis=1)

    def worth_m(self) -> tuple[FloatArray, FloatArray]:
        """(cells,) price of each cell with a weight, and its price if all of it cost as much as its most expensive corner."""
        flat, area_m2 = self.per_m2.ravel(), self._size_m**2
        corners = np.stack([self._basis(i, j) @ flat for i in (0.0, 1.0) for j in (0.0, 1.0)])
        return (self._basis(0.5, 0.5) @ flat) * area_m2, corners.max(axis=0) * area_m2

    def at_nodes(self) -> FloatArray:
        """Prices at the nodes of the relief, as if all ground there were priced."""
        axes = []
        for count in self._relief.allowed.shape:
            along = (np.arange(count + 1) / self.parts - self._margin) / self._cells_a_block
            first = np.clip(np.floor(along).astype(np.int64), 0, self.across - 2)
            axes.append((first, np.clip(along - first, 0.0, 1.0)))
        (i, up), (j, along) = axes
        p, up = self.per_m2, up[:, None]
        south = (1.0 - along) * p[np.ix_(i, j)] + along * p[np.ix_(i, j + 1)]
        north = (1.0 - along) * p[np.ix_(i + 1, j)] + along * p[np.ix_(i + 1, j + 1)]
        out: FloatArray = (1.0 - up) * south + up * north
        return out

    def _rows_of(self, where: IntArray) -> list[Rows]:
        """For each heading, what a metre gains for each price; and last what is observed."""
        room, headings = 150 * len(where) + 1000, headings_over_half_a_turn(_HEADINGS)
        corner = self._margin * self._size_m
        while True:
            starts, columns, data = rates_by_node(
                self._relief, self.priced, np.ascontiguousarray(where), middles_of_bins(192), headings,
                (corner, corner), self._cells_a_block * self._size_m, self.across, room,
            )  # fmt: skip
            if starts[0] == 0:
                break
            room *= 2
        shape = (len(where), self.across**2)
        new = [scipy.sparse.csr_array((data[:, m], columns, starts), shape=shape) for m in range(_HEADINGS + 1)]
        return [rows[:, self._nodes] for rows in new]

    def _basis(self, up: float, along: float) -> Rows:
        """(cells, nodes) how much each node counts at a place of each cell; 0 to 1 from its south-west corner."""
        k = self._cells_a_block
        fraction_n, fraction_e = (self._row % k + up) / k, (self._column % k + along) / k
        nodes, parts = [], []
        for i in (0, 1):
            for j in (0, 1):
                nodes.append((self._row // k + i) * self.across + self._column // k + j)
                parts.append((fraction_n if i else 1.0 - fraction_n) * (fraction_e if j else 1.0 - fraction_e))
        count = len(self._row)
        rows = np.repeat(np.arange(count), 4)
        return scipy.sparse.csr_array(
            (np.column_stack(parts).ravel(), (rows, np.column_stack(nodes).ravel())), shape=(count, self.across**2)
        )

    def _solve_chosen(self) -> FloatArray:
        chosen = [
            scipy.sparse.csr_array(scipy.sparse.diags_array(self._scale[moves]) @ rows[moves])
            for rows, moves in zip(self._rows[:-1], self._moves, strict=True)
            if len(moves)
        ]
        moves, looks = scipy.sparse.vstack(chosen, format="csr"), self._rows[-1][self._looks]
        count = len(self._nodes)
        prices = scipy.sparse.identity(count, format="csr")

        def with_two_more(rows: Rows, unobserved: FloatArray | float, look: float) -> Rows:
            two = np.column_stack([np.broadcast_to(unobserved, rows.shape[0]), np.full(rows.shape[0], look)])
            return scipy.sparse.hstack([rows, scipy.sparse.csr_array(two)], "csr")

        matrix = scipy.sparse.vstack(
            [
                with_two_more(moves, 0.0, 0.0),
                with_two_more(looks, 0.0, -1.0),
                with_two_more(prices, -self._ground, 0.0),
            ],
            format="csr",
        )
        limits = np.zeros(matrix.shape[0])
        limits[: moves.shape[0]] = 1.0
        # In units in which all numbers are about 1: a square metre's price is one over the width of what is observed.
        width_m = 2.0 * self._relief.reach
        unit = np.full(count + 2, 1.0 / width_m)
        unit[-1] = width_m
        by = np.ones(matrix.shape[0])
        by[moves.shape[0] : moves.shape[0] + looks.shape[0]] = 1.0 / width_m
        scaled = scipy.sparse.csr_array(scipy.sparse.diags_array(by) @ matrix @ scipy.sparse.diags_array(unit))
        scale = float(self._worth[:-2].sum()) / width_m
        found: FloatArray = most_worth(self._worth * unit / scale, scaled, limits, common=2) * unit
        return found


# Linear programs with few variables and many rows: Mehrotra's predictor-corrector interior point method.
#
# S. Mehrotra, On the implementation of a primal-dual interior point method, SIAM Journal on Optimization 2 (1992).
# The normal equations have a row for each variable. For the prices of a path bound this takes a second where HiGHS
# takes a minute.

_EXACT = 1e-3


class _Point(NamedTuple):
    """Variables, the slack of rows, and the duals of rows and of variables; or changes of all four."""

    x: FloatArray
    slack: FloatArray
    dual: FloatArray
    reduced: FloatArray

    def moved(self, by: "_Point", primal: float, dual: float) -> "_Point":
        return _Point(
            self.x + primal * by.x, self.slack + primal * by.slack,
            self.dual + dual * by.dual, self.reduced + dual * by.reduced,
        )  # fmt: skip

    def product(self) -> float:
        return float(self.x @ self.reduced + self.slack @ self.dual) / (len(self.x) + len(self.slack))

    def room(self, by: "_Point") -> tuple[float, float]:
        """Fractions of a change, 1 at most, at which the first number of the primal side is 0, and of the dual side."""
        return min(_room(self.x, by.x), _room(self.slack, by.slack)), min(
            _room(self.dual, by.dual), _room(self.reduced, by.reduced)
        )


def _room(values: FloatArray, changes: FloatArray) -> float:
    falling = changes < 0.0
    return float(min(1.0, (-values[falling] / changes[falling]).min(initial=1.0)))


class _Newton:
    """The linear system at a point, factored once for the predictor and the corrector: a band, and variables beside it."""

    def __init__(self, worth: FloatArray, matrix: Rows, limits: FloatArray, common: int, at: _Point) -> None:
        self._matrix, self._at = matrix, at
        self._across = scipy.sparse.csr_array(matrix.T)
        self.dual_gap = worth + at.reduced - self._across @ at.dual
        self.primal_gap = limits - matrix @ at.x - at.slack
        self._banded = banded = len(worth) - common
        normal = scipy.sparse.csr_array(self._across @ scipy.sparse.diags_array(at.dual / at.slack) @ matrix)
        entries = scipy.sparse.coo_array(normal[:banded, :banded])
        below = entries.row - entries.col
        band = np.zeros((int(below.max(initial=0)) + 1, banded))
        lower = below >= 0
        band[below[lower], entries.col[lower]] = entries.data[lower]
        band[0] += (at.reduced / at.x)[:banded]
        self._factor = scipy.linalg.cholesky_banded(band, overwrite_ab=True, lower=True)
        self._beside = normal[:banded, banded:].toarray()
        self._from_beside = self._in_band(self._beside)
        corner = normal[banded:, banded:].toarray() + np.diag((at.reduced / at.x)[banded:])
        self._corner = scipy.linalg.cho_factor(corner - self._beside.T @ self._from_beside)

    def _in_band(self, right: FloatArray) -> FloatArray:
        found: FloatArray = scipy.linalg.cho_solve_banded((self._factor, True), right)
        return found

    def change(self, to_reduced: FloatArray, to_dual: FloatArray) -> _Point:
        """The change that closes both gaps, and changes the products of variables, and of rows, by these."""
        at = self._at
        right = self.dual_gap + to_reduced / at.x - self._across @ ((to_dual - at.dual * self.primal_gap) / at.slack)
        first = self._in_band(right[: self._banded])
        last = scipy.linalg.cho_solve(self._corner, right[self._banded :] - self._beside.T @ first)
        x = np.concatenate([first - self._from_beside @ last, last])
        slack = self.primal_gap - self._matrix @ x
        return _Point(x, slack, (to_dual - at.dual * slack) / at.slack, (to_reduced - at.reduced * x) / at.x)


def most_worth(worth: FloatArray, matrix: Rows, limits: FloatArray, *, common: int) -> FloatArray:
    """Nearly the x >= 0 of most worth @ x with matrix @ x <= limits, to about a thousandth.

    All numbers should be near 1.

    Args:
        worth: (n,) of each variable.
        matrix: (m, n).
        limits: (m,) at least 0.
        common: how many of the last variables, 1 or more, may stand in a row with any other. It takes little time if the others
            stand with near ones alone.
    """
    m, n = matrix.shape
    at = _Point(np.ones(n), np.ones(m), np.ones(m), np.ones(n))
    for _ in range(60):
        newton = _Newton(worth, matrix, limits, common, at)
        value = float(worth @ at.x)
        gap = max(np.abs(newton.primal_gap).max(), np.abs(newton.dual_gap).max())
        if gap < _EXACT and abs(value - float(limits @ at.dual)) < _EXACT * (1.0 + abs(value)):
            break
        ahead = newton.change(-at.x * at.reduced, -at.slack * at.dual)
        reached = at.moved(ahead, *at.room(ahead)).product()
        centre = at.product() * (reached / at.product()) ** 3
        step = newton.change(
            centre - at.x * at.reduced - ahead.x * ahead.reduced, centre - at.slack * at.dual - ahead.slack * ahead.dual
        )
        primal, dual = at.room(step)
        at = at.moved(step, 0.995 * primal, 0.995 * dual)
    return at.x


_INTEGRAL = 1e-6
"""Tolerance of HiGHS: a bound may be below the whole number that it means by this."""
_COVERED = 1e-9


@dataclass(frozen=True, slots=True)
class SolverEffort:
    """Limits on the effort for an exact answer."""

    time_s: float | None = None  # wall time; the outcome then depends on the machine
    nodes: int | None = None  # of branch and bound, which depends on nothing; 0: the linear relaxation alone


@dataclass(frozen=True, slots=True, eq=False)
class CoverSolution:
    """Solution of a program, with its proved bound."""

    chosen: NDArray[np.int64] | None  # (k,) numbers of the places found, None when none were found in the time
    # no choice of these places needs fewer places, or observes more; None: nothing was proved in the time
    bound: float | None


class CoverProgram:
    """Linear and mixed-integer programs on a reduced table."""

    def __init__(self, reduced: Reduced) -> None:
        self._reduced = reduced
        by_position = scipy.sparse.csr_array(
            (np.ones(reduced.classes.size), reduced.classes, reduced.start),
            shape=(reduced.numbers.size, reduced.weight.size),
        )
        self._matrix = scipy.sparse.csr_array(by_position.T)

    @property
    def reachable(self) -> float:
        """Fraction of the visible ground that the places observe together, 0..1."""
        return self._reduced.reachable

    def fewest_positions(self, coverage: float, effort: SolverEffort) -> CoverSolution:
        """The fewest points that observe a fraction of the coverable area; with all of ``reachable`` this is set cover.

        Args:
            coverage: 0..reachable.
            effort: how long.
        """
        if coverage <= 0.0:
            return CoverSolution(np.empty(0, dtype=np.int64), 0.0)
        rows, c = self._matrix.shape
        if coverage >= self.reachable - _COVERED:
            return self._counted(self._solve(np.ones(c), self._matrix, np.ones(rows), c, effort))
        matrix = self._with_observed(np.append(np.zeros(c), self._reduced.weight))
        lower = np.append(np.zeros(rows), coverage - _COVERED)
        return self._counted(self._solve(np.append(np.ones(c), np.zeros(rows)), matrix, lower, c, effort))

    def most_coverage(self, count: int, effort: SolverEffort) -> CoverSolution:
        """At most ``count`` places with the largest fraction of the coverable area; the bound is that share."""
        rows, c = self._matrix.shape
        matrix = self._with_observed(np.append(-np.ones(c), np.zeros(rows)))
        lower = np.append(np.zeros(rows), -float(count))
        chosen, least = self._solve(np.append(np.zeros(c), -self._reduced.weight), matrix, lower, c, effort)
        return CoverSolution(chosen, None if least is None else min(-least, self.reachable))

    def _with_observed(self, last: FloatArray) -> Rows:
        """The table with a variable for each class, and a last row.

        A class of cells counts as observed as far as its variable says, which is at most the number of places that observe it.
        """
        observed = scipy.sparse.hstack([self._matrix, -scipy.sparse.eye_array(self._matrix.shape[0])])
        return scipy.sparse.vstack([observed, scipy.sparse.csr_array(last[None])])

    def _counted(self, outcome: tuple[NDArray[np.int64] | None, float | None]) -> CoverSolution:
        """Round a bound on a number of places, which is an integer."""
        chosen, bound = outcome
        return CoverSolution(chosen, None if bound is None else float(np.ceil(bound - _INTEGRAL)))

    def _solve(
        self, cost: FloatArray, matrix: Rows, lower: FloatArray, binaries: int, effort: SolverEffort
    ) -> tuple[NDArray[np.int64] | None, float | None]:
        """Points and proved bound of: least cost with matrix x >= lower, 0 <= x <= 1, the first ``binaries`` whole."""
        constraints = scipy.optimize.LinearConstraint(matrix, lb=lower)
        relaxed = effort.nodes == 0
        options: Any = {} if effort.time_s is None else {"time_limit": max(0.0, effort.time_s)}
        if effort.nodes:
            options["node_limit"] = effort.nodes
        whole = np.zeros(cost.size, dtype=np.int64)
        whole[:binaries] = 0 if relaxed else 1
        result = scipy.optimize.milp(
            cost, constraints=constraints, integrality=whole, bounds=scipy.optimize.Bounds(0.0, 1.0), options=options
        )
        if relaxed:
            return None, float(result.fun) if result.success else None
        bound = result.mip_dual_bound
        chosen = None if result.x is None else self._reduced.numbers[np.flatnonzero(result.x[:binaries] > 0.5)]
        return chosen, float(bound) if bound is not None and np.isfinite(bound) else None

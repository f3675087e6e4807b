"""Exact answers on given places, by linear and mixed-integer programs (HiGHS through scipy)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels import set_cover as kernels
from uavcover.planning.set_cover.candidates import Candidates

FloatArray = NDArray[np.float64]

_INTEGRAL = 1e-6
"""How far a bound may be below a whole number that it means: the tolerance of HiGHS."""
_COVERED = 1e-9


@dataclass(frozen=True, slots=True)
class SolverEffort:
    """How long an exact answer may take.

    Attributes:
        time_s: wall time; the outcome then depends on the machine.
        nodes: of branch and bound, which depends on nothing; 0: the linear relaxation alone.
    """

    time_s: float | None = None
    nodes: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """What a program found and proved.

    Attributes:
        chosen: (k,) numbers of the places found, None when none were found in the time.
        bound: no choice of these places needs fewer places, or sees more; None: nothing was proved in the time.
    """

    chosen: NDArray[np.int64] | None
    bound: float | None


class CoverProgram:
    """The programs of some candidates: places that another one replaces are left out, cells with the same places are one.

    Attributes:
        numbers: (c,) which places are left.
    """

    def __init__(self, candidates: Candidates) -> None:
        from scipy import sparse

        worth = candidates.weight > 0.0
        start, cells = _only(candidates.start, candidates.cells, worth)
        keep = kernels.undominated(start, cells, candidates.weight.size)
        self.numbers = np.flatnonzero(keep)
        back, places = kernels.transposed(start, cells, candidates.weight.size)
        new_number = np.cumsum(keep) - 1
        classes: dict[bytes, int] = {}
        rows: list[NDArray[np.int64]] = []
        weight: list[float] = []
        for cell in np.flatnonzero(worth):
            seen_by = places[back[cell] : back[cell + 1]]
            row = new_number[seen_by[keep[seen_by]]].astype(np.int64)
            if row.size == 0:
                continue
            number = classes.setdefault(row.tobytes(), len(rows))
            if number == len(rows):
                rows.append(row)
                weight.append(0.0)
            weight[number] += float(candidates.weight[cell])
        self._weight = np.array(weight)
        indptr = np.concatenate([[0], np.cumsum([row.size for row in rows])]).astype(np.int64)
        indices = np.concatenate(rows) if rows else np.empty(0, dtype=np.int64)
        self._matrix = sparse.csr_array(
            (np.ones(indices.size), indices, indptr), shape=(len(rows), self.numbers.size)
        )

    @property
    def reachable(self) -> float:
        """Share of what can be covered that the places see together, 0..1."""
        return float(self._weight.sum())

    def fewest_places(self, coverage: float, effort: SolverEffort) -> Answer:
        """As few places as see a share of what can be covered; the whole ``reachable`` share is the set cover problem.

        Args:
            coverage: 0..reachable.
            effort: how long.
        """
        from scipy import sparse

        if coverage <= 0.0:
            return Answer(np.empty(0, dtype=np.int64), 0.0)
        rows, c = self._matrix.shape
        if coverage >= self.reachable - _COVERED:
            return self._counted(self._solve(np.ones(c), self._matrix, np.ones(rows), c, effort))
        # A class of cells counts as seen as far as its variable says, which is at most the number of places that see it.
        matrix = sparse.vstack(
            [sparse.hstack([self._matrix, -sparse.eye_array(rows)]), sparse.csr_array(np.append(np.zeros(c), self._weight)[None])]
        )
        lower = np.append(np.zeros(rows), coverage - _COVERED)
        return self._counted(self._solve(np.append(np.ones(c), np.zeros(rows)), matrix, lower, c, effort))

    def most_coverage(self, count: int, effort: SolverEffort) -> Answer:
        """The places, at most ``count``, that see most of what can be covered; the bound is that share."""
        from scipy import sparse

        rows, c = self._matrix.shape
        matrix = sparse.vstack(
            [sparse.hstack([self._matrix, -sparse.eye_array(rows)]), sparse.csr_array(np.append(-np.ones(c), np.zeros(rows))[None])]
        )
        lower = np.append(np.zeros(rows), -float(count))
        chosen, least = self._solve(np.append(np.zeros(c), -self._weight), matrix, lower, c, effort)
        return Answer(chosen, None if least is None else min(-least, self.reachable))

    def _counted(self, outcome: tuple[NDArray[np.int64] | None, float | None]) -> Answer:
        """A number of places is whole."""
        chosen, bound = outcome
        return Answer(chosen, None if bound is None else float(np.ceil(bound - _INTEGRAL)))

    def _solve(
        self, cost: FloatArray, matrix: object, lower: FloatArray, binaries: int, effort: SolverEffort
    ) -> tuple[NDArray[np.int64] | None, float | None]:
        """Places and proved bound of: least cost with matrix x >= lower, 0 <= x <= 1, the first ``binaries`` whole."""
        from scipy.optimize import Bounds, LinearConstraint, milp

        constraints = LinearConstraint(matrix, lb=lower)  # type: ignore[arg-type]
        relaxed = effort.nodes == 0
        options: dict[str, float] = {}
        if effort.time_s is not None:
            options["time_limit"] = max(0.0, effort.time_s)
        if effort.nodes:
            options["node_limit"] = effort.nodes
        whole = np.zeros(cost.size)
        whole[:binaries] = 0.0 if relaxed else 1.0
        result = milp(cost, constraints=constraints, integrality=whole, bounds=Bounds(0.0, 1.0), options=options)
        if relaxed:
            return None, float(result.fun) if result.success else None
        bound = result.mip_dual_bound
        chosen = None if result.x is None else self.numbers[np.flatnonzero(result.x[:binaries] > 0.5)]
        return chosen, float(bound) if bound is not None and np.isfinite(bound) else None


def _only(
    start: NDArray[np.int64], cells: NDArray[np.int32], worth: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """The sets without cells that count for nothing."""
    keep = worth[cells]
    before = np.concatenate([[0], np.cumsum(keep)])
    return before[start], cells[keep]

"""Linear programs with few variables and many rows: Mehrotra's predictor-corrector interior point method.

S. Mehrotra, On the implementation of a primal-dual interior point method, SIAM Journal on Optimization 2 (1992). The normal
equations have a row for each variable. For the prices of a path bound this takes a second where HiGHS takes a minute.
"""

from typing import NamedTuple

import numpy as np
import scipy.linalg
import scipy.sparse

from uavcover.kernels.arrays import FloatArray

_MOST_STEPS = 60
_EXACT = 1e-3


class _Point(NamedTuple):
    """Variables, what the rows leave of their limits, and the duals of rows and of variables; or changes of all four."""

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
        """Shares of a change, 1 at most, at which the first number of the primal side is 0, and of the dual side."""
        return min(_room(self.x, by.x), _room(self.slack, by.slack)), min(
            _room(self.dual, by.dual), _room(self.reduced, by.reduced)
        )


def _room(values: FloatArray, changes: FloatArray) -> float:
    falling = changes < 0.0
    return float(min(1.0, (-values[falling] / changes[falling]).min(initial=1.0)))


class _Newton:
    """The linear system at a point, factored once for the predictor and the corrector: a band, and variables beside it."""

    def __init__(
        self, worth: FloatArray, matrix: scipy.sparse.csr_array, limits: FloatArray, common: int, at: _Point
    ) -> None:
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


def most_worth(worth: FloatArray, matrix: scipy.sparse.csr_array, limits: FloatArray, *, common: int) -> FloatArray:
    """Nearly the x >= 0 of most worth @ x with matrix @ x <= limits, to about a thousandth; all numbers should be near 1.

    Args:
        worth: (n,) of each variable.
        matrix: (m, n).
        limits: (m,) at least 0.
        common: how many of the last variables, 1 or more, may stand in a row with any other. It takes little time if the others
            stand with near ones alone.
    """
    m, n = matrix.shape
    at = _Point(np.ones(n), np.ones(m), np.ones(m), np.ones(n))
    for _ in range(_MOST_STEPS):
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

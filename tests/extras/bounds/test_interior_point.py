"""Linear programs with few variables and many rows, beside HiGHS."""

import numpy as np
import pytest
import scipy.optimize
import scipy.sparse

from uavcover.extras.bounds.programs import most_worth


@pytest.mark.parametrize(("near", "common"), [(2, 1), (5, 2), (40, 2)])
def test_as_much_worth_as_highs_finds(near: int, common: int) -> None:
    rng = np.random.default_rng(near)
    count, rows = 40, 160
    matrix = np.zeros((rows, count + common))
    for row, first in enumerate(rng.integers(0, count, rows)):
        last = min(first + near, count)
        matrix[row, first:last] = rng.uniform(0.2, 1.0, last - first)
    matrix[:, count:] = -rng.uniform(0.0, 0.2, (rows, common)) * (rng.random((rows, common)) < 0.5)
    # Every variable has a limit.
    matrix = np.vstack([matrix, np.eye(count + common)])
    limits = rng.uniform(0.5, 1.5, len(matrix))
    worth = np.concatenate([rng.uniform(0.5, 1.5, count), -rng.uniform(0.5, 1.5, common)])
    found = most_worth(worth, scipy.sparse.csr_array(matrix), limits, common=common)
    exact = scipy.optimize.linprog(-worth, matrix, limits, bounds=(0.0, None))
    assert exact.status == 0
    assert (found > 0.0).all()
    assert (matrix @ found <= limits + 0.005).all()
    assert float(worth @ found) == pytest.approx(-float(exact.fun or 0.0), rel=0.003)

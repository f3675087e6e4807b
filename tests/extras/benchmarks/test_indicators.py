import moocore
import numpy as np
import pytest
from pymoo.indicators.igd import IGD

from uavcover.errors import OptimizerError
from uavcover.extras.benchmarks.indicators import hypervolume, inverted_generational_distance


@pytest.mark.parametrize("m", [2, 3])
@pytest.mark.parametrize("n", [1, 2, 30])
def test_hypervolume_equals_that_of_moocore(m, n):
    rng = np.random.default_rng(10 * m + n)
    for objectives in (rng.random((n, m)) * 1.2, rng.integers(0, 4, (n, m)).astype(float) / 3):
        reference = np.linspace(0.9, 1.1, m)
        assert hypervolume(objectives, reference) == pytest.approx(moocore.hypervolume(objectives, ref=reference))


def test_hypervolume_by_hand():
    assert hypervolume([[1, 2, 0], [2, 1, 1]], [3, 3, 2]) == 5.0  # 2*1*2, and 2*1 minus the shared 1, for height 1
    assert hypervolume(np.empty((0, 2)), [1, 1]) == 0.0
    assert hypervolume([[1.0, 0.0]], [1, 1]) == 0.0  # on the reference is not below it


def test_igd_equals_that_of_pymoo():
    rng = np.random.default_rng(2)
    front, objectives = rng.random((50, 3)), rng.random((20, 3))
    assert inverted_generational_distance(front, objectives) == pytest.approx(IGD(front)(objectives))


@pytest.mark.parametrize(
    ("objectives", "reference"),
    [([[1.0]], [2.0]), ([[1.0, 1.0]], [2.0]), ([1.0, 1.0], [2.0, 2.0]), ([[1.0, np.nan]], [2.0, 2.0])],
)
def test_hypervolume_refuses_bad_input(objectives, reference):
    with pytest.raises(OptimizerError):
        hypervolume(objectives, reference)


@pytest.mark.parametrize("objectives", [np.empty((0, 2)), [[1.0]], [1.0, 2.0]])
def test_igd_refuses_bad_input(objectives):
    with pytest.raises(OptimizerError):
        inverted_generational_distance([[0.0, 1.0]], objectives)

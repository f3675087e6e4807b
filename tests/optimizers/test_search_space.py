import numpy as np
import pytest
from scipy.stats import qmc

from uavcover.errors import OptimizerError
from uavcover.optimizers.ask_tell import Box


@pytest.mark.parametrize(
    ("lower", "upper", "message"),
    [
        ([], [], "one entry per variable"),
        ([0, 0], [1], "one entry per variable"),
        (0.0, 1.0, "one entry per variable"),
        ([0, 2], [1, 1], "variable 1 are inverted"),
        ([0, np.nan], [1, 1], r"lower bounds: entry \(1,\) is nan"),
        ([0, 0], [1, np.inf], r"upper bounds: entry \(1,\) is inf"),
        ([-1.7e308], [1.7e308], "too far apart"),
        (["a"], [1], "lower bounds: this is not an array of numbers"),
    ],
)
def test_bounds_that_make_no_sense_are_refused(lower, upper, message):
    with pytest.raises(OptimizerError, match=message):
        Box.checked(lower, upper)


@pytest.mark.parametrize("n", [1, 7, 50])
def test_latin_hypercube_puts_exactly_one_sample_in_each_stratum(n):
    box = Box.checked([-3.0, 10.0, 0.0], [-1.0, 30.0, 1.0])
    x = box.latin_hypercube(n, np.random.default_rng(n))
    strata = np.floor((x - box.lower) / (box.upper - box.lower) * n)
    assert (np.sort(strata, axis=0) == np.arange(n)[:, None]).all()
    assert box.contains(x)


def test_samples_reach_all_of_the_box_and_leave_a_fixed_variable_alone():
    box = Box.checked([-3.0, 5.0], [-1.0, 5.0])
    x = box.uniform(500, np.random.default_rng(0))
    assert box.contains(x)
    assert x[:, 0].min() < -2.95
    assert x[:, 0].max() > -1.05
    assert (x[:, 1] == 5.0).all()


def test_what_leaves_the_box_is_put_on_the_bound_it_crossed():
    box = Box.checked([0.0, 0.0], [1.0, 1.0])
    assert box.clipped(np.array([[-2.0, 0.5], [0.25, 9.0]])).tolist() == [[0.0, 0.5], [0.25, 1.0]]


@pytest.mark.parametrize("n", [1, 2, 37])
@pytest.mark.parametrize("variables", [1, 5])
def test_latin_hypercube_is_that_of_scipy(n, variables):
    box = Box.checked([0.0] * variables, [1.0] * variables)
    own_seed = int(np.random.default_rng(n).integers(2**63))
    expected = qmc.LatinHypercube(variables, rng=own_seed).random(n)
    np.testing.assert_array_equal(box.latin_hypercube(n, np.random.default_rng(n)), expected)

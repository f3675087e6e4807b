import numpy as np
import pytest

from tests.naive import reach as naive
from uavcover.extras.bounds.relief import farthest_looks


@pytest.mark.parametrize("seed", range(8))
def test_farthest_looks_agree_with_trying_every_square(seed):
    rng = np.random.default_rng(seed)
    tops = rng.uniform(60.0, 180.0, (9, 11))
    tops[rng.uniform(size=tops.shape) < 0.1] = np.nan
    centres = np.column_stack(
        [rng.uniform(-40.0, 140.0, 30), rng.uniform(-30.0, 120.0, 30), rng.uniform(0.0, 200.0, 30)]
    )
    found = farthest_looks(centres, tops, -20.0, -10.0, 12.5, 0.7, 60.0)
    assert found == pytest.approx(naive.farthest_looks(centres, tops, -20.0, -10.0, 12.5, 0.7, 60.0))
    assert found.max() > 0.0

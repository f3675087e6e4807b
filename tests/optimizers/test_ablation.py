"""Each variant differs from its base in exactly one of the three improvements."""

import numpy as np
import pytest

from tests.optimizers.problems import two_spheres
from uavcover.optimizers import ALGORITHMS

LHS, DYNAMIC, DISTURBED = "lhs", "dynamic", "sine-cosine"


def improvements(algorithm):
    optimizer = algorithm([-1.0] * 3, [2.0] * 3, n_objectives=2, population_size=12, max_iterations=10, seed=5)
    found = set()
    strata = np.floor((optimizer.ask() + 1.0) / 3.0 * 12).astype(int)
    if (np.sort(strata, axis=0) == np.arange(12)[:, None]).all():
        found.add(LHS)
    optimizer.tell(two_spheres(optimizer.ask()))
    if optimizer._roller_coefficients() != (0.2, 0.2):
        found.add(DYNAMIC)
    x = np.ones((4, 3))
    before = np.random.default_rng(0)
    optimizer._walk_small_beetles(x, optimizer._area_around(x), before)
    plain = np.random.default_rng(0)
    plain.standard_normal((4, 1))
    plain.random((4, 3))
    if before.bit_generator.state != plain.bit_generator.state:  # r2 and r3 were drawn, too
        found.add(DISTURBED)
    return found


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("modbo", set()),
        ("modbo+lhs", {LHS}),
        ("modbo+dynamic", {DYNAMIC}),
        ("modbo+sine-cosine", {DISTURBED}),
        ("imodbo-lhs", {DYNAMIC, DISTURBED}),
        ("imodbo-dynamic", {LHS, DISTURBED}),
        ("imodbo-sine-cosine", {LHS, DYNAMIC}),
        ("imodbo", {LHS, DYNAMIC, DISTURBED}),
    ],
)
def test_which_improvements_a_variant_has(name, expected):
    assert improvements(ALGORITHMS[name]) == expected

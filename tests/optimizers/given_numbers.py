"""Random numbers that a test gives, so that an update can be computed by hand."""

import numpy as np
import pytest


class GivenNumbers:
    """Stands in for a Generator: hands out what it was given, and checks who asks for what."""

    def __init__(self, *draws):
        self.draws = list(draws)

    def _next(self, name, shape):
        expected, values = self.draws.pop(0)
        array = np.array(values)
        assert (name, shape) == (expected, array.shape)
        return array

    def random(self, shape):
        return self._next("random", shape)

    def standard_normal(self, shape):
        return self._next("standard_normal", shape)

    def integers(self, low, high, shape):
        assert (low, high) == (0, 181)
        return self._next("integers", shape)


def near(values):
    return pytest.approx(np.array(values), abs=1e-12)

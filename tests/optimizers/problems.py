"""Small problems with known answers, as functions of ``(n, d)`` rows."""

import numpy as np


def two_spheres(x):
    """Distance to 0 and to 1, squared: every point on the diagonal between them is Pareto-optimal."""
    return np.column_stack([(x**2).sum(axis=1), ((x - 1) ** 2).sum(axis=1)])


def outside_the_corner(x):
    """Two constraints: violated where x0 < 0.25, and where x1 < 0.25."""
    return 0.25 - x[:, :2]


def minimise(optimizer, objectives, violations=None):
    while not optimizer.should_stop:
        x = optimizer.ask()
        optimizer.tell(objectives(x), None if violations is None else violations(x))
    return optimizer.pareto_set()

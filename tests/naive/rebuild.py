"""The shortest way over a place in all of some discs, by trying places on their edges and on the straight line."""

import numpy as np


def best_between(a, b, discs, steps=4_000):
    """Length of the way from a to b over the best place that was tried; infinite where none is in all discs."""
    fraction = np.linspace(0.0, 1.0, steps)[:, None]
    angle = np.linspace(0.0, 2.0 * np.pi, steps)
    tried = [np.array(a) + fraction * (np.array(b) - np.array(a))]
    tried += [np.column_stack([e + r * np.cos(angle), n + r * np.sin(angle)]) for e, n, r in discs]
    positions = np.vstack(tried)
    for e, n, r in discs:
        positions = positions[np.hypot(positions[:, 0] - e, positions[:, 1] - n) <= r * (1.0 + 1e-12)]
    return min((np.hypot(*(positions - a).T) + np.hypot(*(positions - b).T)).tolist(), default=np.inf)

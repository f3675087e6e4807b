"""The obvious way to the shortest tour: all orders."""

import itertools

import numpy as np


def length(points, order):
    return float(np.linalg.norm(np.diff(points[list(order)], axis=0), axis=1).sum())


def shortest_open_tour(points):
    """Length of the shortest open tour of a few (n, 3) points."""
    return min(length(points, order) for order in itertools.permutations(range(len(points))))


def nearest(distance, count):
    return [
        sorted((j for j in range(len(row)) if j != i), key=lambda j: (row[j], j))[:count]
        for i, row in enumerate(distance)
    ]

"""Slow, obvious twin of :mod:`uavcover.kernels.shortest_path`: all paths over all corners, by shapely and Dijkstra."""

import itertools

import numpy as np
import shapely
from scipy.sparse.csgraph import dijkstra


def shortest_length(region, a, b):
    """Of the shortest way over all corners of the region, whether they stick into it or not; infinite where there is none."""
    nodes = np.vstack([a, b, shapely.get_coordinates(region)])
    roomy = region.buffer(1e-6)
    length = np.zeros((len(nodes), len(nodes)))
    for i, j in itertools.combinations(range(len(nodes)), 2):
        if roomy.covers(shapely.LineString([nodes[i], nodes[j]])):
            length[i, j] = length[j, i] = np.hypot(*(nodes[i] - nodes[j]))
    return dijkstra(length, indices=0)[1]

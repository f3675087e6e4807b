"""Rates of gain from the boundary of what is seen, moved a little: no formula of the proof is used."""

import math

import numpy as np


def height(nodes, side, e, n):
    """Heights between the nodes of a lattice whose squares are cut from south-west to north-east."""
    j, i = np.floor(e / side).astype(int), np.floor(n / side).astype(int)
    x, y = e / side - j, n / side - i
    sw, se, nw, ne = nodes[i, j], nodes[i, j + 1], nodes[i + 1, j], nodes[i + 1, j + 1]
    return np.where(x >= y, sw + x * (se - sw) + y * (ne - se), sw + x * (ne - nw) + y * (nw - sw))


def end_of_view(relief, e, n, angles):
    """East and north of the last ground that is seen along each direction, by halving."""
    ue, un = np.cos(angles), np.sin(angles)
    low, high = np.zeros_like(angles), np.full_like(angles, relief.reach)
    if relief.tangent > 0.0:
        top = height(relief.top_m, relief.side, np.array(e), np.array(n))
        for _ in range(50):
            r = 0.5 * (low + high)
            up = height(relief.ground_m, relief.side, e + r * ue, n + r * un)
            observed = r <= relief.tangent * (top - up)
            low, high = np.where(observed, r, low), np.where(observed, high, r)
    return np.stack([e + high * ue, n + high * un])


def gain(relief, price_m2, position, heading, count=1500):
    """What a metre along a heading sees anew and loses, half of each, with the price (e, n) -> price of a square metre."""
    angles = (np.arange(count) + 0.5) * 2.0 * math.pi / count
    (e, n), (he, hn), step = position, (math.cos(heading), math.sin(heading)), 1e-4
    along = (end_of_view(relief, e + step * he, n + step * hn, angles) - end_of_view(relief, e, n, angles)) / step
    around = (end_of_view(relief, e, n, angles + step) - end_of_view(relief, e, n, angles - step)) / (2.0 * step)
    passed = np.abs(along[0] * around[1] - along[1] * around[0])
    return 0.5 * float((price_m2(*end_of_view(relief, e, n, angles)) * passed).sum()) * 2.0 * math.pi / count

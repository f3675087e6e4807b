"""Definitions of dominance, fronts and crowding, written down literally."""

import math


def dominates(f_p, violation_p, f_q, violation_q):
    if violation_p < violation_q:
        return True
    if violation_p > violation_q:
        return False
    return all(a <= b for a, b in zip(f_p, f_q, strict=True)) and any(a < b for a, b in zip(f_p, f_q, strict=True))


def non_dominated_ranks(objectives, total_violation):
    """Peel off the rows that nothing left dominates, again and again."""
    ranks = [None] * len(objectives)
    left = set(range(len(objectives)))
    front = 0
    while left:
        best = {
            p
            for p in left
            if not any(dominates(objectives[q], total_violation[q], objectives[p], total_violation[p]) for q in left)
        }
        for p in best:
            ranks[p] = front
        left -= best
        front += 1
    return ranks


def crowding_distance(objectives, rows=None):
    """Distances of the chosen ``rows`` among themselves, gaps relative to the span of *all* objectives."""
    rows = list(range(len(objectives))) if rows is None else rows
    distance = dict.fromkeys(rows, 0.0)
    for j in range(len(objectives[0]) if len(objectives) else 0):
        values = [float(f[j]) for f in objectives]
        half_span = max(values) / 2 - min(values) / 2
        if half_span == 0:
            continue
        order = sorted(rows, key=lambda i, values=values: (values[i], i))
        distance[order[0]] = distance[order[-1]] = math.inf
        for left, middle, right in zip(order, order[1:], order[2:], strict=False):
            distance[middle] += (values[right] / 2 - values[left] / 2) / half_span
    return distance


def least_crowded(objectives, keep):
    rows = list(range(len(objectives)))
    while len(rows) > keep:
        distance = crowding_distance(objectives, rows)
        rows.remove(min(rows, key=lambda i: (distance[i], -i)))
    return rows


def first_occurrences(rows):
    observed = []
    first = []
    for row in rows:
        values = [float(value) for value in row]
        first.append(values not in observed)
        observed.append(values)
    return first

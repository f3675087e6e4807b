"""Tours by trying every order; lengths by summing distances."""

import itertools
import math


def path_length(points):
    return sum(math.dist(a, b) for a, b in itertools.pairwise(points))


def nearest_neighbour_order(points, reference):
    left = list(range(len(points)))
    order, at = [], reference
    while left:
        nearest = min(left, key=lambda i: (sum((x - y) ** 2 for x, y in zip(points[i], at, strict=True)), i))
        order.append(nearest)
        left.remove(nearest)
        at = points[nearest]
    return order


def best_open_tour_length(points, first):
    rest = [i for i in range(len(points)) if i != first]
    return min(path_length([points[i] for i in (first, *order)]) for order in itertools.permutations(rest))


def distance_to_polyline(point, polyline):
    """By ternary search: the distance along a straight segment has one minimum."""
    best = min((math.dist(point, corner) for corner in polyline), default=math.inf)
    for a, b in itertools.pairwise(polyline):
        low, high = 0.0, 1.0
        for _ in range(100):
            third = (high - low) / 3.0
            left, right = (
                math.dist(point, [x + t * (y - x) for x, y in zip(a, b, strict=True)])
                for t in (low + third, high - third)
            )
            low, high = (low, high - third) if left < right else (low + third, high)
        best = min(best, left)
    return best

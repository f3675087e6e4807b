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


def shortest_between(along, lower, upper, first):
    """Length of the shortest line between two bounds: Dijkstra's over the ends of both that see each other. O(n^3)."""
    positions = [
        (along[0], first),
        *((x, z) for x, ends in zip(along[1:], zip(lower[1:], upper[1:], strict=True), strict=True) for z in ends),
    ]

    def observes(p, q):
        fraction = [(x - p[0]) / (q[0] - p[0]) for x in along]
        return all(
            low - 1e-9 <= p[1] + t * (q[1] - p[1]) <= high + 1e-9
            for t, low, high in zip(fraction, lower, upper, strict=True)
            if 0.0 < t < 1.0
        )

    best = {positions[0]: 0.0}
    for q in positions[1:]:  # from left to right
        best[q] = min((best[p] + math.dist(p, q) for p in best if p[0] < q[0] and observes(p, q)), default=math.inf)
    return min(best[position] for position in positions if position[0] == along[-1])


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

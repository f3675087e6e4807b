"""Tours by trying every order; lengths by summing distances."""

import itertools
import math


def path_length(points):
    return sum(math.dist(a, b) for a, b in itertools.pairwise(points))


def leg_time(pace, a, b):
    """With wind: the largest ground speed along the leg whose airspeed is allowed, found by halving."""
    way = math.dist(a[:2], b[:2])
    rise = b[2] - a[2]
    vertical = max(rise / pace.climb_m_s, -rise / pace.descent_m_s)
    if way == 0.0:
        return vertical
    direction = [(b[i] - a[i]) / way for i in range(2)]
    wind = (pace.wind_east_m_s, pace.wind_north_m_s)

    def airspeed(speed):
        return math.hypot(*(speed * d - w for d, w in zip(direction, wind, strict=True)))

    speed = pace.cruise_m_s
    if airspeed(speed) > pace.airspeed_m_s:
        low, high = 0.0, speed
        for _ in range(80):
            speed = 0.5 * (low + high)
            low, high = (low, speed) if airspeed(speed) > pace.airspeed_m_s else (speed, high)
    return max(way / speed, vertical)


def flight_time(points, pace):
    total = sum(leg_time(pace, a, b) for a, b in itertools.pairwise(points))
    for a, b, c in zip(points, points[1:], points[2:], strict=False):
        velocities = []
        for p, q in ((a, b), (b, c)):
            time = leg_time(pace, p, q)
            velocities.append([(q[i] - p[i]) / time if time else 0.0 for i in range(2)])
        total += math.dist(*velocities) / (2.0 * pace.acceleration_m_s2)
    return total


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

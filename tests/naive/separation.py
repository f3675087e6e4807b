"""How near two vehicles came to each other, by looking at many moments one by one."""

import math


def position_at(times: list[float], positions: list[tuple[float, float, float]], t: float) -> tuple[float, ...]:
    """Straight between two samples; where it was first, or last, outside of them."""
    if t <= times[0]:
        return positions[0]
    for k in range(1, len(times)):
        if t <= times[k]:
            fraction = 1.0 if times[k] == times[k - 1] else (t - times[k - 1]) / (times[k] - times[k - 1])
            return tuple(a + fraction * (b - a) for a, b in zip(positions[k - 1], positions[k], strict=True))
    return positions[-1]


def least_distance(one: tuple, other: tuple, *, moments: int, shift_s: float = 0.0) -> tuple[float, float]:
    """Least distance of two lists of times and places while both are recorded, and when; the other's clock is shifted."""
    begin, end = max(one[0][0], other[0][0]), min(one[0][-1], other[0][-1])
    best = (math.inf, begin)
    for k in range(moments + 1):
        t = begin + (end - begin) * k / moments
        best = min(best, (math.dist(position_at(*one, t), position_at(*other, t + shift_s)), t))
    return best

"""Set covers by trying everything."""

import itertools

import numpy as np


def covered(sets, chosen):
    return set().union(*(sets[k] for k in chosen)) if len(chosen) else set()


def worth(sets, weight, chosen):
    return float(sum(weight[item] for item in covered(sets, chosen)))


def fewest(sets, weight, enough):
    """Fewest sets that cover a weight of at least ``enough``; None when all together do not."""
    for count in range(len(sets) + 1):
        if any(worth(sets, weight, some) >= enough for some in itertools.combinations(range(len(sets)), count)):
            return count
    return None


def most(sets, weight, count):
    return max(worth(sets, weight, some) for some in itertools.combinations(range(len(sets)), min(count, len(sets))))


def greedily(sets, weight, enough, most_sets):
    chosen: list[int] = []
    while len(chosen) < most_sets and worth(sets, weight, chosen) < enough:
        gains = [worth(sets, weight, [*chosen, k]) - worth(sets, weight, chosen) for k in range(len(sets))]
        best = int(np.argmax(np.round(gains, 9)))
        if gains[best] <= 1e-9:
            break
        chosen.append(best)
    return chosen


def undominated(sets):
    return [
        bool(own) and not any(own < other or (own == other and j < k) for j, other in enumerate(sets) if j != k)
        for k, own in enumerate(sets)
    ]

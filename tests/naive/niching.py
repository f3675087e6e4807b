"""Definitions of niches, spread and medoids, written down literally."""

import math

from tests.naive.dominance import dominates


def niche_survivors(x, objectives, start, radius, slack, spacing):
    alive = list(range(start))
    for i in range(start, len(x)):
        stays = True
        for j in sorted(alive):
            apart = math.dist(x[i], x[j])
            competes = apart <= radius or any(
                abs(a - b) > s for a, b, s in zip(objectives[i], objectives[j], slack, strict=True)
            )
            if dominates(objectives[j], 0, objectives[i], 0):
                if competes:
                    stays = False
            elif dominates(objectives[i], 0, objectives[j], 0):
                if competes:
                    alive.remove(j)
            elif apart == 0:
                stays = False
            elif apart <= spacing:
                alive.remove(j)
            if not stays:
                break
        if stays:
            alive.append(i)
    return [i in alive for i in range(len(x))]


def last_apart(x, spacing):
    kept = []
    for i in reversed(range(len(x))):
        if all(math.dist(x[i], x[q]) > spacing for q in kept):
            kept.append(i)
    return [i in kept for i in range(len(x))]


def dominated_near(x, objectives, other_x, other_objectives, radius):
    return [
        any(math.dist(a, b) <= radius and dominates(g, 0, f, 0) for b, g in zip(other_x, other_objectives, strict=True))
        for a, f in zip(x, objectives, strict=True)
    ]


def spread_out(points, first, count):
    chosen = list(first)
    while len(chosen) < count:
        away = [min(math.dist(p, points[c]) for c in chosen) for p in points]
        if max(away) <= 0:
            break
        chosen.append(away.index(max(away)))
    return chosen


def cost(x, f, x_weights, f_weights, medoids):
    total = 0.0
    for points, weights in ((x, x_weights), (f, f_weights)):
        total += sum(w * min(math.dist(p, points[c]) for c in medoids) for p, w in zip(points, weights, strict=True))
    return total


def two_space_medoids(x, f, x_weights, f_weights, first, fixed, passes):
    """Try every swap by its whole cost."""
    medoids = list(first)
    for _ in range(passes):
        before = list(medoids)
        for candidate in range(len(x)):
            if candidate in medoids:
                continue
            swaps = [[*medoids[:q], candidate, *medoids[q + 1 :]] for q in range(fixed, len(medoids))]
            costs = [cost(x, f, x_weights, f_weights, swap) for swap in swaps]
            if costs and min(costs) - cost(x, f, x_weights, f_weights, medoids) < -1e-12:
                medoids = swaps[costs.index(min(costs))]
        if medoids == before:
            break
    return medoids

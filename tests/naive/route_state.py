"""Counts of a route by looking from every sample at every cell; limits leg by leg with fine steps."""

import itertools
import math

from tests.naive import coverage as naive_coverage
from uavcover.kernels.search_problem import ALONG_PATH


def segment_observations(sensing, route, spacing):
    """The places from which each segment looks."""
    if sensing != ALONG_PATH or len(route) == 1:
        return [[point] for point in route]
    return [naive_coverage.sample_path([a, b], spacing) for a, b in itertools.pairwise(route)]


def list_cells(surface, sight, cells, observations):
    """Numbers of the cells that any of the observations along one leg sees; the vehicle heads along it."""
    heading = [b - a for a, b in zip(observations[0][:2], observations[-1][:2], strict=True)]
    positions = zip(cells.centre_m.tolist(), cells.normal.tolist(), strict=True)
    return {
        number
        for number, (centre, normal) in enumerate(positions)
        if any(naive_coverage.observes(surface, sight, look, centre, normal, heading) for look in observations)
    }


def surely_shown(surface, sight, cells, p, q, trigger, steps=40):
    """Numbers of the cells in view from everywhere on some stretch of the leg p-q that is as long as the trigger's distance.

    Its middle is on the leg, its ends may be beyond it, straight on. Stretches begin in small steps; the leg is not vertical.
    """
    heading = [q[0] - p[0], q[1] - p[1]]
    fraction = 0.5 * trigger / math.hypot(*heading)
    long = max(1, math.ceil(steps / (2 * fraction)))

    def at(t):
        return [a + t * (b - a) for a, b in zip(p, q, strict=True)]

    found = set()
    for number, (centre, normal) in enumerate(zip(cells.centre_m.tolist(), cells.normal.tolist(), strict=True)):
        for k in range(long + 1):
            looks = [at(k / long + fraction * s) for s in (-1.0, 1.0, 0.0, -0.5, 0.5)]
            if all(naive_coverage.observes(surface, sight, look, centre, normal, heading) for look in looks):
                found.add(number)
                break
    return found


def counts(problem, route):
    """By how many segments each cell is seen, and the weight of those that are seen."""
    found = [0] * len(problem.square)
    for observations in segment_observations(problem.sensing, [tuple(point) for point in route], problem.spacing_m):
        for cell in list_cells(problem.surface, problem.sight, problem.cells, observations):
            found[cell] += 1
    fractions = problem.weight[problem.square].tolist()
    return found, sum(weight for weight, count in zip(fractions, found, strict=True) if count >= problem.needed)


def inside_ring(ring, east, north):
    """By the sum of the angles under which the edges are seen."""
    total = 0.0
    for (ae, an), (be, bn) in zip(ring, [*ring[1:], ring[0]], strict=True):
        a, b = math.atan2(an - north, ae - east), math.atan2(bn - north, be - east)
        total += math.remainder(b - a, 2.0 * math.pi)
    return abs(total) > math.pi

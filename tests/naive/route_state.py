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


def list_cells(surface, sight, cells, looks):
    """Numbers of the cells that any of the looks along one leg sees; the vehicle heads along it."""
    heading = [b - a for a, b in zip(looks[0][:2], looks[-1][:2], strict=True)]
    places = zip(cells.centre_m.tolist(), cells.normal.tolist(), strict=True)
    return {
        number
        for number, (centre, normal) in enumerate(places)
        if any(naive_coverage.sees(surface, sight, look, centre, normal, heading) for look in looks)
    }


def counts(problem, route):
    """By how many segments each cell is seen, and the weight of those that are seen."""
    found = [0] * len(problem.square)
    for looks in segment_observations(problem.sensing, [tuple(point) for point in route], problem.spacing_m):
        for cell in list_cells(problem.surface, problem.sight, problem.cells, looks):
            found[cell] += 1
    shares = problem.weight[problem.square].tolist()
    return found, sum(weight for weight, count in zip(shares, found, strict=True) if count >= problem.needed)


def inside_ring(ring, east, north):
    """By the sum of the angles under which the edges are seen."""
    total = 0.0
    for (ae, an), (be, bn) in zip(ring, [*ring[1:], ring[0]], strict=True):
        a, b = math.atan2(an - north, ae - east), math.atan2(bn - north, be - east)
        total += math.remainder(b - a, 2.0 * math.pi)
    return abs(total) > math.pi

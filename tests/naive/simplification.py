"""Naive twin of uavcover.kernels.route_state_cost: every exchange is made on a copy, and all of it counted and checked again."""

import itertools
import math

import numpy as np

from tests.naive.route_state import counts
from uavcover.kernels.path_cost import route_cost
from uavcover.kernels.search_problem import allowed_leg, allowed_position


def take_out(problem, route, fewest, least_coverage, most_lost):
    """The list of waypoints that stay of a list of waypoints."""
    for k in range(len(route) - 1, -1, -1):
        if len(route) > fewest:
            route = better(problem, route, route[:k] + route[k + 1 :], least_coverage, most_lost)
    return route


def merge(problem, route, fewest, least_coverage, most_lost):
    """Likewise, with neighbours in one place."""
    for k in range(len(route) - 2, -1, -1):
        if len(route) > fewest and k + 1 < len(route):
            between = tuple(0.5 * (a + b) for a, b in zip(route[k], route[k + 1], strict=True))
            route = better(problem, route, [*route[:k], between, *route[k + 2 :]], least_coverage, most_lost)
    return route


def better(problem, before, after, least_coverage, most_lost):
    """The second route where it may take the place of the first one."""
    if cost(problem, after) > cost(problem, before):
        return before
    new = [k for k, position in enumerate(after) if position not in before]
    if not all(allowed_position(problem, after[k]) for k in new):
        return before
    for k in new:
        others = after[:k] + after[k + 1 :]
        if problem.apart_m > 0.0 and any(math.dist(after[k], other) < problem.apart_m for other in others):
            return before
    legs = set(itertools.pairwise(before))
    if not all(allowed_leg(problem, p, q) for p, q in itertools.pairwise(after) if (p, q) not in legs):
        return before
    (_, old), (_, observed) = counts(problem, before), counts(problem, after)
    return after if observed - old >= -most_lost and observed >= least_coverage else before


def cost(problem, route):
    return route_cost(problem.surface, problem.path_cost, np.array(route))

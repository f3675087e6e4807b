"""Splits a route into flights from one home: the least total time for the order of its waypoints (Prins 2004).

The split procedure is that of doi 10.1016/S0305-0548(03)00158-8: the least cost of all up to waypoint j is the least, over the
waypoints i where the last flight may begin, of the cost of all before i and of the flight i .. j.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.flight_time import turn_time
from uavcover.kernels.jit import kernel
from uavcover.kernels.way_cost import WayCost, time_home, time_there


class FlightCosts(NamedTuple):
    """What a flight costs that begins or ends at each of (n,) waypoints.

    Attributes:
        so_far_s: (n,) flight time from the first waypoint, without turns.
        turns_s: (n,) of all turns up to and at the waypoint.
        there_s: (n,) from home on the ground; infinite where no flight may begin.
        back_s: (n,) to home, landed; infinite where no flight may end.
        alone_s: (n,) of a flight to this waypoint only.
        there_items: (n,) mission items before the waypoint, home among them.
        back_items: (n,) behind it.
        each_items: of every waypoint.
        shared: 1 when a flight begins at the last waypoint of the previous one, 0 when at the next waypoint.
        endurance_s: of one flight.
        item_limit: of one mission.
        barred: (m, 2) first and last waypoints of flights that are excluded.
    """

    so_far_s: NDArray[np.float64]
    turns_s: NDArray[np.float64]
    there_s: NDArray[np.float64]
    back_s: NDArray[np.float64]
    alone_s: NDArray[np.float64]
    there_items: NDArray[np.int64]
    back_items: NDArray[np.int64]
    each_items: int
    shared: int
    endurance_s: float
    item_limit: float
    barred: NDArray[np.int64]


@kernel
def flight_s(costs: FlightCosts, first: int, last: int) -> float:
    """Seconds of the flight along waypoints first..last; infinite where it may not be flown."""
    turns = costs.turns_s[last - 1] - costs.turns_s[first] if first < last else 0.0
    route = costs.so_far_s[last] - costs.so_far_s[first] + turns
    time = costs.there_s[first] + route + costs.back_s[last]
    if first == last and time < math.inf:
        time = costs.alone_s[last]
    items = costs.there_items[first] + costs.each_items * (last - first + 1) + costs.back_items[last]
    if not time <= costs.endurance_s or items > costs.item_limit:
        return math.inf
    for k in range(costs.barred.shape[0]):
        if costs.barred[k, 0] == first and costs.barred[k, 1] == last:
            return math.inf
    return float(time)


@kernel
def split(costs: FlightCosts) -> tuple[float, NDArray[np.int64]]:
    """The split of least total time.

    Returns:
        its seconds, infinite where no split is possible; and (n,) where the flight that ends at each waypoint begins.
    """
    n = costs.so_far_s.size
    cost = np.full(n + 1, math.inf)
    cost[0] = 0.0
    begun = np.zeros(n, dtype=np.int64)
    for last in range(costs.shared, n):
        best = math.inf
        for first in range(last - costs.shared, -1, -1):
            if costs.each_items * (last - first + 1) > costs.item_limit:
                break
            if cost[first] < math.inf:
                total = cost[first] + flight_s(costs, first, last)
                if total <= best and total < math.inf:
                    best = total
                    begun[last] = first
        cost[last + 1 - costs.shared] = best
    return cost[n - costs.shared], begun


@kernel
def straight_ends(
    way: WayCost, route: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Seconds from home to each of (n, 3) waypoints, home from it, and there and back, by straight lines, with their turns."""
    n = route.shape[0]
    there, back, alone = np.empty(n), np.empty(n), np.empty(n)
    home = way.column_top
    for k in range(n):
        q = (route[k, 0], route[k, 1], route[k, 2])
        there[k], back[k] = time_there(way, q), time_home(way, q)
        alone[k] = there[k] + back[k]
        if way.stop_at_first == 0:
            alone[k] += turn_time(way.pace, home, q, home)
            if k < n - 1:
                there[k] += turn_time(way.pace, home, q, (route[k + 1, 0], route[k + 1, 1], route[k + 1, 2]))
        if k > 0:
            back[k] += turn_time(way.pace, (route[k - 1, 0], route[k - 1, 1], route[k - 1, 2]), q, home)
    return there, back, alone

"""Cost of a path in metres, seconds or energy, with wind, climbs and turns, and of its waypoints.

The cost of a mission begins and ends on the ground at home. During a search, transits are straight lines from above home, plus
the average extra cost of checked transits near each end, which climb over terrain and avoid zones. Reported costs use the checked
transits (:func:`uavcover.missions.objectives.mission_cost`).

A route that is too long for one flight is split for the least total time in the order of its waypoints, with the procedure of
Prins (2004), doi 10.1016/S0305-0548(03)00158-8.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.energy import Power, landing_energy, leg_energy, takeoff_energy, turn_energy
from uavcover.kernels.flight_time import Pace, Position, landing_time, leg_time, takeoff_time, turn_time
from uavcover.kernels.jit import allocating_kernel, kernel
from uavcover.kernels.surface import Surface, height_above

LENGTH = 0
TIME = 1
ENERGY = 2

HOVERING = Power(1.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0)
"""Constant hovering power at any speed, so that energy equals time."""


class Detours(NamedTuple):
    """Extra costs of checked transits compared with straight ones, interpolated on a lattice.

    Attributes:
        more: (rows, columns, 4) extra cost to a position at the lower height from home, and from it to home, and the same at the
            upper height; (0, 0, 4) if unknown.
        east0_m, north0_m: of the first position.
        east_m: between two columns.
        north_m: between two rows.
        low_agl_m: the lower height.
        high_agl_m: the upper height.
    """

    more: NDArray[np.float64]
    east0_m: float = 0.0
    north0_m: float = 0.0
    east_m: float = 1.0
    north_m: float = 1.0
    low_agl_m: float = 0.0
    high_agl_m: float = 1.0


_NO_COSTS = np.zeros((0, 0, 4))
_NO_COSTS.flags.writeable = False  # kernels are compiled separately for writable and read-only arrays
NO_DETOURS = Detours(_NO_COSTS)
"""Transits are straight lines."""


class PathCost(NamedTuple):
    """The cost to minimise.

    Attributes:
        unit: LENGTH, metres of the path; TIME, seconds of flight; or ENERGY, seconds of hovering.
        pace: of the vehicle.
        deviation_price: per metre of a waypoint above or below the middle of the band (Eq. 7), in that unit.
        middle_agl_m: the middle of the band.
        mission: 1 if time or energy is that of the whole mission, with take-off, transit and landing.
        climb_out_top: position above home where transit begins and ends.
        climb_out_m: its height above home.
        stop_at_first: 1 if the vehicle stops at its first waypoint, where the photos begin.
        waypoint_price: of every waypoint, in that unit.
        power: of the vehicle, for ENERGY.
        detours: extra costs of transits, in that unit.
    """

    unit: int
    pace: Pace
    deviation_price: float
    middle_agl_m: float
    mission: int = 0
    climb_out_top: Position = (0.0, 0.0, 0.0)
    climb_out_m: float = 0.0
    stop_at_first: int = 0
    waypoint_price: float = 0.0
    power: Power = HOVERING
    detours: Detours = NO_DETOURS


SHORTEST = PathCost(LENGTH, Pace(1.0, 1.0, 1.0), 0.0, 0.0)
"""Only the length counts."""


@kernel
def leg_cost(cost: PathCost, p: Position, q: Position) -> float:
    """Cost of the leg from p to q, without its ends."""
    if cost.unit == TIME:
        return leg_time(cost.pace, p, q)
    if cost.unit == ENERGY:
        return leg_energy(cost.power, cost.pace, p, q)
    return math.sqrt((p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2 + (p[2] - q[2]) ** 2)


@kernel
def turn_cost(cost: PathCost, p: Position, q: Position, r: Position) -> float:
    """Cost of the turn at q."""
    if cost.unit == TIME:
        return turn_time(cost.pace, p, q, r)
    return turn_energy(cost.power, cost.pace, p, q, r) if cost.unit == ENERGY else 0.0


@kernel
def position_cost(surface: Surface, cost: PathCost, p: Position) -> float:
    """Cost of a single waypoint."""
    if cost.deviation_price == 0.0:
        return cost.waypoint_price
    return cost.waypoint_price + cost.deviation_price * abs(height_above(surface, p[0], p[1], p[2]) - cost.middle_agl_m)


@kernel
def time_there(cost: PathCost, p: Position) -> float:
    """Seconds from the ground at home to rest at p."""
    return takeoff_time(cost.pace, cost.climb_out_m) + leg_time(cost.pace, cost.climb_out_top, p)


@kernel
def time_home(cost: PathCost, p: Position) -> float:
    """Seconds from rest at p to the ground at home."""
    return leg_time(cost.pace, p, cost.climb_out_top) + landing_time(cost.pace, cost.climb_out_m)


@kernel
def _cost_there(cost: PathCost, p: Position) -> float:
    """Cost of the flight from the ground at home to rest at p, in time or energy."""
    if cost.unit == ENERGY:
        return takeoff_energy(cost.power, cost.pace, cost.climb_out_m) + leg_cost(cost, cost.climb_out_top, p)
    return time_there(cost, p)


@kernel
def _cost_home(cost: PathCost, p: Position) -> float:
    """Cost of the flight from rest at p to the ground at home, in time or energy."""
    if cost.unit == ENERGY:
        return leg_cost(cost, p, cost.climb_out_top) + landing_energy(cost.power, cost.pace, cost.climb_out_m)
    return time_home(cost, p)


@kernel
def _detour_cost(surface: Surface, detours: Detours, p: Position, direction: int) -> float:
    """Extra cost of the transit to p, 0, or home from it, 1, compared with a straight one."""
    rows, columns = detours.more.shape[0], detours.more.shape[1]
    if rows < 2 or columns < 2:
        return 0.0
    x = min(max((p[0] - detours.east0_m) / detours.east_m, 0.0), columns - 1.0)
    y = min(max((p[1] - detours.north0_m) / detours.north_m, 0.0), rows - 1.0)
    j, i = min(int(x), columns - 2), min(int(y), rows - 2)
    x -= j
    y -= i
    agl_m = height_above(surface, p[0], p[1], p[2])
    # 0 if the ground is unknown.
    high = (min(agl_m, detours.high_agl_m) - detours.low_agl_m) / (detours.high_agl_m - detours.low_agl_m)
    high = high if high > 0.0 else 0.0
    total = 0.0
    for level in range(2):
        k = 2 * level + direction
        south = (1.0 - x) * detours.more[i, j, k] + x * detours.more[i, j + 1, k]
        north = (1.0 - x) * detours.more[i + 1, j, k] + x * detours.more[i + 1, j + 1, k]
        total += (high if level == 1 else 1.0 - high) * ((1.0 - y) * south + y * north)
    return total


@kernel
def stretch_cost(surface: Surface, cost: PathCost, stretch: NDArray[np.float64], begins: bool, ends: bool) -> float:
    """Cost of an (n, 3) stretch of a route: legs, turns and waypoints; with transit at its ends.

    Args:
        surface: the ground.
        cost: the cost.
        stretch: its waypoints.
        begins: whether its first waypoint is that of the route.
        ends: whether its last waypoint is that of the route.
    """
    total = 0.0
    n = stretch.shape[0]
    for k in range(n):
        q = (stretch[k, 0], stretch[k, 1], stretch[k, 2])
        total += position_cost(surface, cost, q)
        if k > 0:
            p = (stretch[k - 1, 0], stretch[k - 1, 1], stretch[k - 1, 2])
            total += leg_cost(cost, p, q)
            if k < n - 1:
                total += turn_cost(cost, p, q, (stretch[k + 1, 0], stretch[k + 1, 1], stretch[k + 1, 2]))
    if cost.mission == 1 and n > 0:
        home = cost.climb_out_top
        if begins:
            first = (stretch[0, 0], stretch[0, 1], stretch[0, 2])
            total += _cost_there(cost, first) + _detour_cost(surface, cost.detours, first, 0)
            if cost.stop_at_first == 0 and n > 1:
                total += turn_cost(cost, home, first, (stretch[1, 0], stretch[1, 1], stretch[1, 2]))
        if ends:
            last = (stretch[n - 1, 0], stretch[n - 1, 1], stretch[n - 1, 2])
            total += _cost_home(cost, last) + _detour_cost(surface, cost.detours, last, 1)
            if n > 1:
                total += turn_cost(cost, (stretch[n - 2, 0], stretch[n - 2, 1], stretch[n - 2, 2]), last, home)
    return total


@kernel
def route_cost(surface: Surface, cost: PathCost, route: NDArray[np.float64]) -> float:
    """Cost of a whole (n, 3) route, or of its mission if the cost is that of the mission."""
    whole = route.shape[0] >= 0  # true: numba compiles a version of its own for a value that it reads
    return stretch_cost(surface, cost, route, whole, whole)


class FlightEnergies(NamedTuple):
    """Seconds of hovering of a flight that begins or ends at each of n waypoints, in w winds; no limit if w is 0.

    Attributes:
        so_far_s: (w, n) from the first waypoint, without turns.
        turns_s: (w, n) of all turns up to and at the waypoint.
        there_s: (w, n) from home on the ground.
        back_s: (w, n) to home, landed.
        alone_s: (w, n) of a flight to this waypoint only.
        usable_s: of one battery.
    """

    so_far_s: NDArray[np.float64]
    turns_s: NDArray[np.float64]
    there_s: NDArray[np.float64]
    back_s: NDArray[np.float64]
    alone_s: NDArray[np.float64]
    usable_s: float


_SPLIT_MARGIN_S = 1e-3
"""Sums in different orders differ by less."""

_NONE = np.empty((0, 0))
NO_ENERGIES = FlightEnergies(_NONE, _NONE, _NONE, _NONE, _NONE, math.inf)
"""Without an endurance."""


class FlightCosts(NamedTuple):
    """Costs of a flight that begins or ends at each of (n,) waypoints.

    Attributes:
        so_far_s: (n,) flight time from the first waypoint, without turns.
        turns_s: (n,) of all turns up to and at the waypoint.
        there_s: (n,) from home on the ground; infinite if no flight may begin.
        back_s: (n,) to home, landed; infinite if no flight may end.
        alone_s: (n,) of a flight to this waypoint only.
        there_items: (n,) mission items before the waypoint, including home.
        back_items: (n,) after it.
        each_items: of every waypoint.
        shared: 1 if a flight begins at the last waypoint of the previous one, 0 if at the next waypoint.
        endurance_s: of one flight.
        item_limit: of one mission.
        barred: (m, 2) first and last waypoints of flights that are excluded.
        energies: of these flights.
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
    energies: FlightEnergies = NO_ENERGIES


@kernel
def battery_s(energies: FlightEnergies, first: int, last: int) -> float:
    """Seconds of hovering that the flight along waypoints first..last uses in the worst wind; 0 without winds."""
    worst = 0.0
    for w in range(energies.so_far_s.shape[0]):
        if first == last:
            worst = max(worst, energies.alone_s[w, last])
            continue
        route = energies.so_far_s[w, last] - energies.so_far_s[w, first]
        route += energies.turns_s[w, last - 1] - energies.turns_s[w, first]
        worst = max(worst, energies.there_s[w, first] + route + energies.back_s[w, last])
    return worst


@kernel
def flight_s(costs: FlightCosts, first: int, last: int) -> float:
    """Seconds of the flight along waypoints first..last; infinite if it is not permitted."""
    time = _seconds(costs, first, last)
    items = costs.there_items[first] + costs.each_items * (last - first + 1) + costs.back_items[last]
    if not time <= costs.endurance_s or items > costs.item_limit:
        return math.inf
    for k in range(costs.barred.shape[0]):
        if costs.barred[k, 0] == first and costs.barred[k, 1] == last:
            return math.inf
    if battery_s(costs.energies, first, last) > costs.energies.usable_s:
        return math.inf
    return time


@kernel
def _seconds(costs: FlightCosts, first: int, last: int) -> float:
    """The same, whether it may be flown or not; infinite where it may not begin or end there."""
    turns = costs.turns_s[last - 1] - costs.turns_s[first] if first < last else 0.0
    route = costs.so_far_s[last] - costs.so_far_s[first] + turns
    time = costs.there_s[first] + route + costs.back_s[last]
    if first == last and time < math.inf:
        time = costs.alone_s[last]
    return float(time)


@allocating_kernel
def _quickest_begins(costs: FlightCosts) -> NDArray[np.float64]:
    """(1 + w, n) seconds and energies that a flight from the best waypoint up to each takes more to it than the route does."""
    n, energies = costs.so_far_s.size, costs.energies
    winds = energies.so_far_s.shape[0]
    quickest = np.empty((1 + winds, n))
    for k in range(n):
        quickest[0, k] = costs.there_s[k] - costs.so_far_s[k] - costs.turns_s[k]
        for w in range(winds):
            quickest[1 + w, k] = energies.there_s[w, k] - energies.so_far_s[w, k] - energies.turns_s[w, k]
        if k > 0:
            for w in range(1 + winds):
                quickest[w, k] = min(quickest[w, k], quickest[w, k - 1])
    return quickest


@kernel
def _earliest(costs: FlightCosts, quickest: NDArray[np.float64], last: int) -> int:
    """The first waypoint at which a flight to ``last`` may begin, if at all."""
    low, high = 0, last
    while low < high:
        middle = (low + high) // 2
        if _too_far(costs, quickest, middle, last):
            low = middle + 1
        else:
            high = middle
    return low


@kernel
def _too_far(costs: FlightCosts, quickest: NDArray[np.float64], first: int, last: int) -> bool:
    """Whether no flight from a waypoint up to ``first`` gets to a later one and home, by its items, time or energy."""
    energies = costs.energies
    if costs.each_items * (last - first + 1) > costs.item_limit:
        return True
    time = quickest[0, first] + costs.so_far_s[last] + costs.turns_s[last - 1] + costs.back_s[last]
    if time > costs.endurance_s + _SPLIT_MARGIN_S:
        return True
    for w in range(energies.so_far_s.shape[0]):
        used = (
            quickest[1 + w, first]
            + energies.so_far_s[w, last]
            + energies.turns_s[w, last - 1]
            + energies.back_s[w, last]
        )
        if used > energies.usable_s + _SPLIT_MARGIN_S:
            return True
    return False


@allocating_kernel
def split(costs: FlightCosts) -> tuple[float, NDArray[np.int64]]:
    """The split of least total time.

    The least cost of all up to waypoint j is the least, over the waypoints i where the last flight may begin, of the cost of all
    before i and of the flight i .. j. On long routes most waypoints are too early for any flight to j, and are not looked at.

    Returns:
        its seconds, infinite where no split is possible; and (n,) where the flight that ends at each waypoint begins.
    """
    n = costs.so_far_s.size
    cost = np.full(n + 1, math.inf)
    cost[0] = 0.0
    begun = np.zeros(n, dtype=np.int64)
    quickest = _quickest_begins(costs)
    for last in range(costs.shared, n):
        best = math.inf
        for first in range(_earliest(costs, quickest, last), last - costs.shared + 1):
            if cost[first] + _seconds(costs, first, last) < best:
                total = cost[first] + flight_s(costs, first, last)
                if total < best:
                    best = total
                    begun[last] = first
        cost[last + 1 - costs.shared] = best
    return cost[n - costs.shared], begun


@allocating_kernel
def straight_ends(
    cost: PathCost, route: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Seconds from home to each of (n, 3) waypoints, home from it, and there and back, by straight lines, with their turns."""
    n = route.shape[0]
    there, back, alone = np.empty(n), np.empty(n), np.empty(n)
    home = cost.climb_out_top
    for k in range(n):
        q = (route[k, 0], route[k, 1], route[k, 2])
        there[k], back[k] = time_there(cost, q), time_home(cost, q)
        alone[k] = there[k] + back[k]
        if cost.stop_at_first == 0:
            alone[k] += turn_time(cost.pace, home, q, home)
            if k < n - 1:
                there[k] += turn_time(cost.pace, home, q, (route[k + 1, 0], route[k + 1, 1], route[k + 1, 2]))
        if k > 0:
            back[k] += turn_time(cost.pace, (route[k - 1, 0], route[k - 1, 1], route[k - 1, 2]), q, home)
    return there, back, alone

"""Cut one route into sorties: ours against PyVRP and OR-tools, which may also change the order and the direction of every leg.

Usage: .venv/bin/python scripts/bench_sorties.py [-o docs/results/sorties.md] [--seconds 30] [--only ridge-25km2]

PyVRP and OR-tools are no dependencies of the package: `pip install pyvrp ortools` first. The parts are the legs of the plain
boustrophedon, each flown once in either direction. Time is way at cruise speed, straight from home, along legs and back, without
turns and climbs; no sortie is longer than the longest of ours. Ours are those of the mission compiler, which minimises its own,
fuller cost over the cuts of the given order; and the same behind the planner's search for another order, which flies all legs and
its links between them. They are judged by the simple cost; "compiled" is the time of all flights from ground to ground that the
mission compiler makes of an order, with turns, climbs, ways over the terrain and the reserve of every battery; of the sorties of
a solver in the best order and directions, cut anew. Our search for an order and the solvers, which begin from nothing, get so
many seconds of processor time of one thread each.
"""

import argparse
import dataclasses
import datetime
import importlib.util
import itertools
import math
import time
from collections.abc import Callable, Sequence
from importlib import metadata
from itertools import pairwise
from pathlib import Path

import numpy as np

from scripts.options import file_to_write
from uavcover.kernels.arrays import FloatArray, IntArray
from uavcover.model.route import Route
from uavcover.planning.baselines.boustrophedon import plain_boustrophedon
from uavcover.planning.baselines.swaths import fly_layout
from uavcover.planning.sortie_order.order_costs import OrderCosts
from uavcover.planning.sortie_order.reorder import OrderEffort, reordered
from uavcover.planning.sortie_order.stretches import stretches_of
from uavcover.routes.flight_costs import straight_flight_costs
from uavcover.routes.sorties import compile_sorties
from uavcover.scenario.scenario_file import load_scenario
from uavcover.scenario.site import Site, load_site
from uavcover.sensing.coverage_map import judging_maps

TICKS_PER_S = 10
"""Solvers count in whole numbers."""
CASES = (("ridge-25km2", 3000.0), ("ridge-obstacles", 700.0), ("jacksboro", 600.0))
"""Scenarios and the endurance of a full battery, in seconds."""
_MORE_SORTIES = 3
_MOST_JOINED = 5
_SEED = 1
"""Of the search for an order."""
_WALL = 20.0
"""A machine with other work may take so many times as long by the clock."""


class Parts:
    """The legs of a route, each in both directions, and the seconds from one to the other.

    Attributes:
        limit_s: longest sortie.
        flown_s: (2n,) along each leg; 2k is leg k as it stands in the route, 2k + 1 the other way.
        between_s: (2n, 2n) from the end of one to the beginning of another.
        there_s: (2n,) from home.
        back_s: (2n,) to home.
    """

    def __init__(self, route_m: FloatArray, home_en: FloatArray, cruise_m_s: float, limit_s: float) -> None:
        ahead = np.arange(len(route_m) - 1)
        begin = np.column_stack([ahead, ahead + 1]).ravel()
        end = np.column_stack([ahead + 1, ahead]).ravel()
        self.limit_s = limit_s
        self.flown_s = np.linalg.norm(route_m[begin] - route_m[end], axis=1) / cruise_m_s
        self.between_s = np.linalg.norm(route_m[end][:, None] - route_m[begin][None], axis=2) / cruise_m_s
        self.there_s = np.linalg.norm(route_m[begin, :2] - home_en, axis=1) / cruise_m_s
        self.back_s = np.linalg.norm(route_m[end, :2] - home_en, axis=1) / cruise_m_s

    def seconds(self, sortie: Sequence[int]) -> float:
        """Of one sortie, given its legs."""
        way = math.fsum(self.between_s[a, b] for a, b in pairwise(sortie))
        return (
            way
            + float(self.flown_s[list(sortie)].sum())
            + float(self.there_s[sortie[0]])
            + float(self.back_s[sortie[-1]])
        )

    def total_s(self, sorties: Sequence[Sequence[int]]) -> float:
        """Of all sorties, which must fly every leg once.

        Raises:
            ValueError: they do not, or one is too long.
        """
        flown = sorted(leg // 2 for sortie in sorties for leg in sortie)
        if flown != list(range(len(self.flown_s) // 2)):
            raise ValueError("a leg is left out, or flown twice")
        times = [self.seconds(sortie) for sortie in sorties]
        if max(times) > self.limit_s + len(self.flown_s) / TICKS_PER_S:
            raise ValueError(f"a sortie of {max(times):.0f} s")
        return math.fsum(times)


def ticks(seconds: FloatArray | float) -> IntArray:
    """Whole numbers for the solvers."""
    return np.rint(np.asarray(seconds) * TICKS_PER_S).astype(np.int64)


def by_pyvrp(parts: Parts, sorties: int, seconds: float) -> list[list[int]] | None:
    """The sorties that PyVRP finds."""
    import pyvrp

    model = pyvrp.Model()
    home = model.add_location(0.0, 0.0)
    model.add_depot(home)
    places = [model.add_location(0.0, 0.0) for _ in parts.flown_s]
    for leg in range(len(places) // 2):
        group = model.add_client_group(required=True)
        for part in (2 * leg, 2 * leg + 1):
            model.add_client(
                places[part], service_duration=int(ticks(parts.flown_s[part])), required=False, group=group
            )
    model.add_vehicle_type(
        num_available=sorties + _MORE_SORTIES,
        shift_duration=int(ticks(parts.limit_s)) + 1,
        unit_distance_cost=0,
        unit_duration_cost=1,
    )
    there, back, between = ticks(parts.there_s), ticks(parts.back_s), ticks(parts.between_s)
    for a, start in enumerate(places):
        model.add_edge(home, start, 0, int(there[a]))
        model.add_edge(start, home, 0, int(back[a]))
        for b, end in enumerate(places):
            if a != b:
                model.add_edge(start, end, 0, int(between[a, b]))
    until = time.process_time() + seconds
    result = model.solve(lambda _: time.process_time() > until, seed=1, display=False)
    if not result.is_feasible():
        return None
    return [[int(visit.idx) for visit in route if visit.is_client()] for route in result.best.routes()]


def by_ortools(parts: Parts, sorties: int, seconds: float) -> list[list[int]] | None:
    """The sorties that OR-tools finds: savings, then guided local search."""
    from ortools.constraint_solver import pywrapcp, routing_enums_pb2

    n, vehicles = len(parts.flown_s), sorties + _MORE_SORTIES
    costs = np.zeros((n + 1, n + 1), dtype=np.int64)
    costs[0, 1:] = ticks(parts.there_s)
    costs[1:, 0] = ticks(parts.flown_s + parts.back_s)
    costs[1:, 1:] = ticks(parts.flown_s[:, None] + parts.between_s)
    np.fill_diagonal(costs, 0)
    manager = pywrapcp.RoutingIndexManager(n + 1, vehicles, 0)
    model = pywrapcp.RoutingModel(manager)
    transit = model.RegisterTransitMatrix(costs.tolist())
    model.SetArcCostEvaluatorOfAllVehicles(transit)
    model.AddDimension(transit, 0, int(ticks(parts.limit_s)) + 1, True, "time")
    for leg in range(n // 2):
        pair = [manager.NodeToIndex(2 * leg + 1), manager.NodeToIndex(2 * leg + 2)]
        model.AddDisjunction(pair, 10_000_000, 1)
    parameters = pywrapcp.DefaultRoutingSearchParameters()
    parameters.first_solution_strategy = routing_enums_pb2.FirstSolutionStrategy.SAVINGS
    parameters.local_search_metaheuristic = routing_enums_pb2.LocalSearchMetaheuristic.GUIDED_LOCAL_SEARCH
    parameters.time_limit.FromMilliseconds(int(1000.0 * _WALL * seconds))
    until = time.process_time() + seconds
    model.AddSearchMonitor(model.solver().CustomLimit(lambda: time.process_time() > until))
    solution = model.SolveWithParameters(parameters)
    if solution is None:
        return None
    found: list[list[int]] = []
    for vehicle in range(vehicles):
        index, sortie = model.Start(vehicle), []
        while not model.IsEnd(index):
            index = solution.Value(model.NextVar(index))
            if not model.IsEnd(index):
                sortie.append(manager.IndexToNode(index) - 1)
        if sortie:
            found.append(sortie)
    return found


def best_cuts_s(parts: Parts) -> float:
    """The least time of all ways to cut the route in its own order, by dynamic programming."""
    legs = len(parts.flown_s) // 2
    least_s = [0.0] + [math.inf] * legs
    for end in range(1, legs + 1):
        for begin in range(end - 1, -1, -1):
            sortie_s = parts.seconds([2 * leg for leg in range(begin, end)])
            if sortie_s <= parts.limit_s:
                least_s[end] = min(least_s[end], least_s[begin] + sortie_s)
            elif parts.flown_s[2 * begin : 2 * end : 2].sum() > parts.limit_s:
                break
    return least_s[-1]


SOLVERS: dict[str, Callable[[Parts, int, float], list[list[int]] | None]] = {"PyVRP": by_pyvrp, "OR-tools": by_ortools}


def with_endurance(name: str, endurance_s: float) -> Site:
    """A bundled scenario, flown with batteries that last so long."""
    scenario = load_scenario(name)
    vehicle = dataclasses.replace(scenario.vehicle, endurance_s=endurance_s)
    return load_site(dataclasses.replace(scenario, vehicle=vehicle))


def _cut(site: Site, route: Route) -> tuple[Parts, list[list[int]]]:
    """The legs of a route, and those of each sortie."""
    assert site.home_m is not None
    parts = Parts(route.waypoints_m, site.home_m[:2], site.scenario.vehicle.cruise_speed_m_s, math.inf)
    cuts = [(s.first, s.last) for s in compile_sorties(site, route, autopilot="ardupilot")]
    return parts, [[2 * leg for leg in range(first, last)] for first, last in cuts]


def _compiled_s(site: Site, route: Route) -> float:
    """Seconds of all flights of a route, from ground to ground."""
    return math.fsum(s.compiled.flight_time_s for s in compile_sorties(site, route, autopilot="ardupilot"))


def _compiled_order_s(site: Site, route: Route, sorties: Sequence[Sequence[int]]) -> str:
    """The same of a solver's sorties, one behind the other as is best; nothing where they cannot be joined or are too many."""
    stretches = stretches_of(site, route)
    if stretches.count != len(route) - 1 or len(sorties) > _MOST_JOINED:
        return ""
    costs = OrderCosts(site, stretches, straight_flight_costs(site, route.waypoints_m, way_items=2))
    ways = [(np.array(sortie), np.array(sortie)[::-1] ^ 1) for sortie in sorties]
    orders = [np.concatenate(chosen) for some in itertools.permutations(ways) for chosen in itertools.product(*some)]
    best = min(orders, key=costs.total_s)
    return (
        f"{_compiled_s(site, stretches.joined(best)):.0f} s" if math.isfinite(costs.total_s(best)) else "not possible"
    )


def rows_of(name: str, endurance_s: float, seconds: float) -> list[str]:
    """Lines of the table, for one scenario."""
    site = with_endurance(name, endurance_s)
    route = fly_layout(site, plain_boustrophedon(site))
    assert site.home_m is not None
    started = time.process_time()
    parts, ours = _cut(site, route)
    took_s = time.process_time() - started
    effort = OrderEffort(0, _SEED, used=lambda: (time.process_time() - started - took_s) / seconds)
    other = reordered(site, judging_maps(site), route, effort, asked=None)
    order_took_s = time.process_time() - started
    new_parts, new = (parts, ours) if other is None else _cut(site, other)
    limit_s = max(max(map(parts.seconds, ours)), max(map(new_parts.seconds, new)))
    parts.limit_s = new_parts.limit_s = limit_s
    total_s, new_s = parts.total_s(ours), new_parts.total_s(new)
    lead = f"| {name} | {endurance_s:g} s | {len(route) - 1} | {parts.limit_s:.0f} s"
    least_s = best_cuts_s(parts)
    lines = [
        f"{lead} | ours, this order | {len(ours)} | {total_s:.0f} s | {new_s / total_s - 1.0:+.1%} | "
        f"{_compiled_s(site, route):.0f} s | {took_s:.1f} s |",
        f"{lead} | ours, any order | {len(new)} | {new_s:.0f} s | | "
        f"{_compiled_s(site, route if other is None else other):.0f} s | {order_took_s:.1f} s |",
        f"{lead} | best cuts of this order | | {least_s:.0f} s | {new_s / least_s - 1.0:+.1%} | | |",
    ]
    for solver, solve in SOLVERS.items():
        found = solve(parts, len(ours), seconds)
        said = "- | none found |" if found is None else f"{len(found)} | {parts.total_s(found):.0f} s |"
        gain = "" if found is None else f"{new_s / parts.total_s(found) - 1.0:+.1%}"
        compiled = "" if found is None else _compiled_order_s(site, route, found)
        lines.append(f"{lead} | {solver} | {said} {gain} | {compiled} | {seconds:g} s |")
    return lines


def main() -> None:
    """Write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=file_to_write, default=Path("docs/results/sorties.md"))
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--only", choices=[name for name, _ in CASES])
    args = parser.parse_args()
    for package in ("pyvrp", "ortools"):
        if importlib.util.find_spec(package) is None:
            parser.error(f"{package}: the package is not here; pip install pyvrp ortools")
    lines = [
        "# Sorties against routing solvers",
        "",
        f"Command: `.venv/bin/python scripts/bench_sorties.py --seconds {args.seconds:g}`, {datetime.date.today()}, uavcover "
        f"{metadata.version('uavcover')}, PyVRP {metadata.version('pyvrp')}, OR-tools {metadata.version('ortools')}. What is "
        "compared is said at the top of the script.",
        "",
        "| scenario | battery | legs | longest sortie | by | sorties | in the air | ours, any order, against | compiled | took |",
        "|---|---:|---:|---:|---|---:|---:|---:|---:|---:|",
    ]
    for name, endurance_s in CASES:
        if args.only in (None, name):
            lines += rows_of(name, endurance_s, args.seconds)
            print("\n".join(lines[-5:]), flush=True)
    args.out.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()

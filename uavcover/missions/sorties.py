"""Split a planned route into several flights, for the least total transit or the earliest last landing."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from uavcover.errors import InfeasibleError
from uavcover.kernels.flight_time import landing_time, takeoff_time
from uavcover.kernels.sight import horizontal_reach
from uavcover.kernels.way_cost import FlightCosts, battery_s, split
from uavcover.missions.fleet_cuts import FlightsOfVehicles, fleet_cuts, unlike_cuts
from uavcover.missions.mission_compiler import CompiledMission, MissionTooLongError, compile_mission
from uavcover.missions.objectives import checked, flight_costs_along_transits, flights_of_split, tighter, without
from uavcover.missions.way_cost import battery_in_words, longest_flight_in_words
from uavcover.model.route import Route
from uavcover.model.vehicle import AutopilotName
from uavcover.scenario.site import Site
from uavcover.scenario.vehicles import pace_of
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.sensors import whatever_heading


@dataclass(frozen=True, slots=True, eq=False)
class Sortie:
    """One flight of a planned route."""

    first: int  # number of its first waypoint in the whole route
    last: int  # number of its last waypoint; for sensing along the path, the next sortie begins there too
    route: Route  # its waypoints
    compiled: CompiledMission  # its mission, from take-off at home to landing there
    vehicle: int = 1  # who flies it, from 1
    # its planned take-off, since the first take-off of all; none where there is no schedule
    start_s: float | None = None


def compile_sorties(
    site: Site,  # the scenario on its ground
    route: Route,  # the planned route
    *,
    autopilot: AutopilotName,  # the autopilot whose limits apply
    # how many points of its path a flight may have, transits included; none: any number
    most_points: int | None = None,
    vehicles: int = 1,  # how many fly at the same time
    # share of the time between two landings at one home that is left between the starts of two vehicles; with less than
    # 1 the flights are more even, and other pairs than neighbours must not land together
    spacing_share: float = 1.0,
) -> tuple[Sortie, ...]:
    """Compile a route as one flight, or as several with their own transits where endurance or item count require it.

    The order of the waypoints is kept. Dynamic programming over all possible splits minimises the total flight time. For several
    vehicles the route is cut so that they are done soonest (``missions/fleet_cuts.py``).

    Raises:
        InputError: the scenario has no position on Earth or no home.
        InfeasibleError: a leg breaks a limit, or a part of the route cannot be reached inside the endurance (says which).
    """
    refusal = InfeasibleError("no split into sorties meets the limits")
    flyer = _Flyer(site, autopilot, most_points)
    if vehicles == 1 or len(route) < 2:
        try:
            return (Sortie(0, len(route) - 1, route, flyer.compiled(route)),)
        except MissionTooLongError as error:
            if len(route) < 2:
                raise
            refusal = error

    def cut(costs: Sequence[FlightCosts]) -> FlightsOfVehicles | None:
        found = _cuts(costs[0], site, vehicles, spacing_share)
        return None if found is None else [(first, last, 0) for first, last in found]

    return _cut_and_compiled([flyer], route, cut, refusal)


def compile_unlike_sorties(
    sites: Sequence[Site], route: Route, *, spacing_share: float = 1.0, one_at_a_time: bool = False
) -> tuple[Sortie, ...]:
    """Compile a route as flights of vehicles that differ, each from its own home, so that they are done soonest.

    Args:
        sites: of each vehicle, vehicle 1 first.
        route: the planned route.
        spacing_share: as of :func:`compile_sorties`, for vehicles whose homes are no farther apart than paths are planned.
        one_at_a_time: whether no vehicle flies before the one before it has landed.

    Raises:
        InfeasibleError: a leg breaks a limit, or no vehicle reaches a part of the route inside its endurance (says which).
    """
    fleet = sites[0].scenario.fleet

    def cut(costs: Sequence[FlightCosts]) -> FlightsOfVehicles | None:
        spacing_s = spacing_share * max(
            _spacing_s(each, site, len(sites)) for each, site in zip(costs, sites, strict=True)
        )
        ready_s = [spacing_s * before for before in sharing_home(sites, fleet.planned_separation_m)]
        return unlike_cuts(costs, turnaround_s=fleet.turnaround_s, ready_s=ready_s, one_at_a_time=one_at_a_time)

    flyers = [_Flyer(site, site.scenario.vehicle.autopilot, None) for site in sites]
    if len(route) < 2:
        return _one_of(flyers, route)
    return _cut_and_compiled(flyers, route, cut, InfeasibleError("no split into sorties meets the limits"))


def check_reach(sites: Sequence[Site], coverage: CoverageMap, required: float | None) -> None:
    """Refuse an area of which no flights reach enough, before a route is searched for.

    Counted is the least that a flight to a cell takes: take-off, the straight line to where the sensor may see it and back at
    cruise speed, and landing.

    Args:
        sites: of the vehicles, each with its home.
        coverage: the cells to be seen, with those that can be.
        required: share of these; none: anything.

    Raises:
        InfeasibleError: fewer are within reach, or nothing can be seen from allowed heights at all.
    """
    site, coverable = sites[0], coverage.coverable
    weight_m2 = coverage.grid.weight_m2[coverable]
    if not weight_m2.size:
        raise InfeasibleError(
            "area: no part of the area can be observed from within the fence and the height band; check "
            "sensor.range_m, the heights in [limits], and the no-fly zones"
        )
    if any(each.home_m is None or each.scenario.vehicle.longest_flight_s is None for each in sites):
        return
    centres_m = coverage.grid.cells.centre_m[coverable, :2]
    least_s, room_s = np.full(len(weight_m2), math.inf), np.full(len(weight_m2), -math.inf)
    for each in sites:
        vehicle, pace, home = each.scenario.vehicle, pace_of(each), each.home_m
        if home is None or vehicle.longest_flight_s is None:
            continue
        away_m = np.hypot(*(centres_m - home[:2]).T) - horizontal_reach(whatever_heading(coverage.sight))
        column_s = takeoff_time(pace, vehicle.takeoff_height_m) + landing_time(pace, vehicle.takeoff_height_m)
        seconds = column_s + 2.0 * np.maximum(away_m, 0.0) / vehicle.cruise_speed_m_s
        least_s = np.minimum(least_s, seconds)
        room_s = np.maximum(room_s, vehicle.longest_flight_s - seconds)
    share = float(weight_m2[room_s >= 0.0].sum() / weight_m2.sum())
    if share > 0.0 and share >= (required or 0.0):
        return
    raise InfeasibleError(
        f"flights from [home] reach only {share:.0%} of the visible ground, but {required or 1.0:.0%} is required: a "
        f"flight to the farthest cells takes at least {least_s.max():.0f} s, but "
        f"{longest_flight_in_words(site.scenario.vehicle)}; move [home] nearer, plan a smaller area, or require less "
        "coverage (--select)"
    )


@dataclass(frozen=True, slots=True)
class _Flyer:
    """A vehicle, or all vehicles that are alike."""

    site: Site
    autopilot: AutopilotName
    most_points: int | None

    def costs(self, route: Route) -> FlightCosts:
        return flight_costs_along_transits(self.site, route, self.autopilot, self.most_points)

    def compiled(self, route: Route) -> CompiledMission:
        compiled = compile_mission(self.site, route, autopilot=self.autopilot)
        if self.most_points is not None and len(compiled.path_m) > self.most_points:
            raise MissionTooLongError(
                f"the flight has {len(compiled.path_m)} points including transits; the limit is {self.most_points}"
            )
        return compiled


def sharing_home(sites: Sequence[Site], near_m: float) -> list[int]:
    """Number of vehicles before each one that start at its home, or beside it."""
    homes = [site.home_m for site in sites]
    return [
        sum(
            home is not None and other is not None and float(np.linalg.norm(home - other)) < near_m
            for other in homes[:number]
        )
        for number, home in enumerate(homes)
    ]


def _one_of(flyers: Sequence[_Flyer], route: Route) -> tuple[Sortie, ...]:
    """A route of one waypoint, by the vehicle that is done soonest."""
    found: list[Sortie] = []
    refusal = InfeasibleError("the scenario has no vehicle")
    for number, flyer in enumerate(flyers, start=1):
        try:
            found.append(Sortie(0, len(route) - 1, route, flyer.compiled(route), vehicle=number))
        except InfeasibleError as error:
            refusal = error
    if not found:
        raise refusal
    return (min(found, key=lambda sortie: sortie.compiled.flight_time_s),)


def _cut_and_compiled(
    flyers: Sequence[_Flyer],
    route: Route,
    cut: Callable[[Sequence[FlightCosts]], FlightsOfVehicles | None],
    refusal: InfeasibleError,
) -> tuple[Sortie, ...]:
    """Compiled flights of a split. What the compiler refuses is left out of the next split."""
    costs = [flyer.costs(route) for flyer in flyers]
    compiled: dict[tuple[int, int, int], CompiledMission] = {}
    all_checked: set[int] = set()
    for attempt in range(200):  # new splits after the compiler has refused a flight of the previous one
        flights = cut(costs)
        if flights is None:
            reasons = dict.fromkeys(
                _why_not(flyer.site, each, refusal) for flyer, each in zip(flyers, costs, strict=True)
            )
            raise InfeasibleError("; or ".join(reasons)) from refusal
        for first, last, number in flights:
            if (first, last, number) in compiled:
                continue
            flyer, own = flyers[number], costs[number]
            try:
                compiled[first, last, number] = flyer.compiled(Route(route.waypoints_m[first : last + 1]))
            except MissionTooLongError as error:
                # The compiler includes costs that the estimate does not.
                refusal, costs[number] = error, without(own, first, last)
                # flights excluded one by one for being too long, before the room of every flight is reduced
                if attempt >= 60:
                    costs[number] = tighter(costs[number])
                break
            except InfeasibleError as error:
                # a transit that breaks a limit bars only its own waypoint from beginning or ending a flight, and no
                # other. Transits are checked one by one, and only where it matters.
                refusal, own = error, own if number in all_checked else checked(own, flyer.site, route)
                all_checked.add(number)
                costs[number] = without(own, first, last)
                break
        else:
            return tuple(
                Sortie(
                    first, last, Route(route.waypoints_m[first : last + 1]), compiled[first, last, number], number + 1
                )
                for first, last, number in flights
            )
    raise InfeasibleError(f"cannot split the route into sorties: {refusal}") from refusal


def _cuts(costs: FlightCosts, site: Site, vehicles: int, spacing_share: float) -> Sequence[tuple[int, int]] | None:
    """First and last waypoint of each flight of the split that is done soonest; none when no split exists."""
    if vehicles > 1:
        return fleet_cuts(
            costs, vehicles=vehicles, turnaround_s=site.scenario.fleet.turnaround_s,
            spacing_s=spacing_share * _spacing_s(costs, site, vehicles),
        )  # fmt: skip
    total_s, begun = split(costs)
    if not math.isfinite(total_s):
        return None
    return flights_of_split(begun, costs.shared)


def _spacing_s(costs: FlightCosts, site: Site, vehicles: int) -> float:
    """Approximate time between landings of two vehicles at one home, so that the second comes late enough."""
    fleet = site.scenario.fleet
    flight_s = min(costs.endurance_s, float(costs.so_far_s[-1]) / vehicles)
    column_s = float(landing_time(pace_of(site), site.scenario.vehicle.takeoff_height_m))
    return 2.0 * (fleet.timing_error_fraction * flight_s + fleet.start_error_s) + fleet.pad_s + column_s


def _why_not(site: Site, costs: FlightCosts, refusal: InfeasibleError) -> str:
    """Message naming the part of a route that no flight reaches, and by how much."""
    step = costs.shared
    firsts = np.arange(len(costs.so_far_s) - step)

    def part(first: int) -> str:
        return f"the leg to waypoint {first + 1}" if step else f"waypoint {first}"

    least = (
        costs.there_s[firsts] + (costs.so_far_s[firsts + step] - costs.so_far_s[firsts]) + costs.back_s[firsts + step]
    )
    worst = int(np.argmax(np.where(np.isfinite(least), least, -math.inf)))
    if least[worst] > costs.endurance_s:
        return (
            f"{part(worst)}: a sortie with this part alone takes {least[worst]:.0f} s including transits, but "
            f"{longest_flight_in_words(site.scenario.vehicle)}; move [home] nearer, or plan a smaller area"
        )
    used = np.array([battery_s(costs.energies, int(first), int(first) + step) for first in firsts])
    worst = int(np.argmax(used))
    if used[worst] > costs.energies.usable_s:
        return (
            f"{part(worst)}: a sortie with this part alone uses {battery_in_words(site, float(used[worst]))}; move "
            "[home] nearer, plan a smaller area, or fly in less wind"
        )
    items = costs.there_items[firsts] + costs.each_items * (step + 1) + costs.back_items[firsts + step]
    most = int(np.argmax(items))
    if items[most] > costs.item_limit:
        return (
            f"{part(most)}: a sortie with this part alone has {items[most]} points or items; the limit is "
            f"{costs.item_limit:g}"
        )
    return f"cannot split the route into sorties: {refusal}"

"""The flights of a planned route: its split, vehicles, take-off times, mission size and files."""

import dataclasses
import math
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from mission_io.formats import wpl
from mission_io.formats.files import FORMATS, mission_text
from mission_io.formats.plan import PlanFile
from uavcover.errors import InfeasibleError, InputError
from uavcover.kernels.flight_time import landing_time
from uavcover.kernels.path_cost import FlightCosts, battery_s, split
from uavcover.missions.fleet_cuts import FlightsOfVehicles, fleet_cuts, unlike_cuts
from uavcover.missions.fleet_schedule import makespan_s, scheduled, scheduled_unlike
from uavcover.missions.mission_compiler import AUTOPILOTS, CompiledMission, MissionTooLongError, Sortie, compile_mission
from uavcover.missions.objectives import checked, flight_costs_along_transits, flights_of_split, tighter, without
from uavcover.missions.path_cost import battery_text, longest_flight_text
from uavcover.model.route import MissionSize, Route
from uavcover.model.vehicle import AutopilotName
from uavcover.plugins import load
from uavcover.scenario.site import Site, once
from uavcover.scenario.vehicles import groups_of, pace_of, vehicle_sites

_SPACING_FRACTIONS = (1.0, 0.5)
"""Spacings of the starts for which a fleet's route is split; the split with the shortest makespan wins
(scripts/bench/fleet.py)."""


def compile_flights(
    site: Site, route: Route, *, autopilot: AutopilotName | None = None, vehicles: int | None = None
) -> tuple[Sortie, ...]:
    """The missions of a planned route: one, or several where endurance, items or vehicles ask for it.

    Args:
        site: the scenario on its ground.
        route: the planned route.
        autopilot: default: the scenario's. Different vehicles have their own.
        vehicles: how many fly, where they are identical; default: the scenario's.

    Raises:
        InputError: the scenario has no position on Earth or no home, or the route was planned for other parts of the area.
        InfeasibleError: a leg exceeds a limit, or a part of the route cannot be reached inside the endurance (says which).
    """
    name = autopilot or site.scenario.vehicle.autopilot
    count = site.scenario.fleet.vehicles if vehicles is None else vehicles
    if site.scenario.vehicles:
        sites = vehicle_sites(site)
        groups = groups_of(site.scenario) or (tuple(range(1, len(sites) + 1)),)
        if len(groups) != len(route.parts):
            raise InputError(
                f"the route has {len(route.parts)} parts, but the vehicles of {site.scenario.name} cover "
                f"{len(groups)} parts of the area; plan the route again"
            )
        # The spacing is between starts at one home.
        fractions = _SPACING_FRACTIONS if any(sharing_home(sites, site.scenario.fleet.planned_separation_m)) else (1.0,)
        unlike = [scheduled_unlike(site, _of_groups(site, groups, route, spacing_fraction=each)) for each in fractions]
        return min(unlike, key=lambda flights: makespan_s(site, flights))
    if count == 1:
        return compile_sorties(site, route, autopilot=name)
    if count != site.scenario.fleet.vehicles:
        site = site.flown_by(count)
    best = _cut_for(count, site, route, autopilot=name)
    # Landings at one home are far apart, so a mission may end sooner with fewer vehicles or a single one.
    for fewer in range(count - 1, 0, -1):
        found = _cut_for(fewer, site, route, autopilot=name)
        if makespan_s(site, found) > makespan_s(site, best):
            break
        best = min(best, found, key=lambda flights: makespan_s(site, flights))
    return best


def _cut_for(vehicles: int, site: Site, route: Route, *, autopilot: AutopilotName) -> tuple[Sortie, ...]:
    """The flights of a route that is split for several vehicles of one kind."""
    tried = [
        scheduled(
            site,
            compile_sorties(site, route, autopilot=autopilot, vehicles=vehicles, spacing_fraction=fraction),
            autopilot=autopilot,
        )
        for fraction in (_SPACING_FRACTIONS if vehicles > 1 else _SPACING_FRACTIONS[:1])
    ]
    return min(tried, key=lambda flights: makespan_s(site, flights))


def _of_groups(
    site: Site, groups: Sequence[Sequence[int]], route: Route, *, spacing_fraction: float
) -> tuple[Sortie, ...]:
    """The sorties of all parts of a route, each split for the vehicles that observe that part.

    Waypoint numbers are of the whole route.
    """
    sites, one_at_a_time = vehicle_sites(site), site.scenario.fleet.one_at_a_time
    found: list[Sortie] = []
    for group, part, begins in zip(groups, route.parts, (0, *route.begins), strict=True):
        own = [sites[number - 1] for number in group]
        if len(own) == 1:
            flights = compile_sorties(own[0], part, autopilot=own[0].scenario.vehicle.autopilot)
        else:
            flights = compile_unlike_sorties(own, part, spacing_fraction=spacing_fraction, one_at_a_time=one_at_a_time)
        found += [
            dataclasses.replace(
                flight, first=begins + flight.first, last=begins + flight.last, vehicle=group[flight.vehicle - 1]
            )
            for flight in flights
        ]
    return tuple(found)


def size_of(site: Site, flights: Sequence[Sortie]) -> MissionSize:
    """Size of a mission whose flights are compiled."""
    flyers = {flight.vehicle for flight in flights}
    vehicles = 1 if site.scenario.has_launch_points else len(flyers)
    return MissionSize(sorties=len(flights), vehicles=vehicles, makespan_s=makespan_s(site, flights))


@once
def _sizes(_site: Site) -> dict[Hashable, MissionSize | None]:
    """Sizes of missions that were computed before, by route, autopilot and number of vehicles."""
    return {}


def mission_size(
    site: Site, route: Route, *, autopilot: AutopilotName | None = None, vehicles: int | None = None
) -> MissionSize | None:
    """Size of a route's mission, split, allocated and timed as :func:`compile_flights` does; computed once.

    Args:
        site: the scenario on its ground.
        route: keeps the limits.
        autopilot: for whom; default: the scenario's.
        vehicles: how many may fly, where they are identical; default: the scenario's.

    Returns:
        none where nothing can be flown: without a position on Earth or a home, or where no cut keeps the limits of a flight.
    """
    if site.frame is None or site.home_m is None:
        return None
    known = _sizes(site)
    name = autopilot or site.scenario.vehicle.autopilot
    count = site.scenario.fleet.vehicles if vehicles is None else vehicles
    key = (route.waypoints_m.tobytes(), route.begins, name, count)
    if key not in known:
        try:
            known[key] = size_of(site, compile_flights(site, route, autopilot=name, vehicles=count))
        except InfeasibleError:
            known[key] = None
    return known[key]


def one_or_several(site: Site, flights: Sequence[Sortie]) -> tuple[CompiledMission | None, tuple[Sortie, ...]]:
    """The mission of a run with one flight, otherwise its sorties. Flights of different vehicles always are sorties."""
    if len(flights) == 1 and not site.scenario.vehicles:
        return flights[0].compiled, ()
    return None, tuple(flights)


def mission_texts(compiled: CompiledMission, *, autopilot: AutopilotName, name: str) -> dict[str, str]:
    """The texts of MISSION_FILES by their names."""
    home = compiled.mission.home
    if home is None:
        raise InputError("the mission has no home")
    return {
        "mission.waypoints": wpl.write_mission(compiled.mission),
        "fence.waypoints": wpl.write_fence(compiled.fence, home),
        "rally.waypoints": wpl.write_rally(compiled.rally, home),
        "mission.plan": export_text(compiled, "plan", autopilot=autopilot, name=name),
        "mission.kml": export_text(compiled, "kml", autopilot=autopilot, name=name),
    }


class Exporter(Protocol):
    """A format of other software: an entry point of the group ``uavcover.exporters``; its name is that of the format."""

    def __call__(self, compiled: CompiledMission, *, autopilot: AutopilotName, name: str) -> bytes:
        """The content of a file for a compiled mission and its title."""


def export_content(compiled: CompiledMission, file_format: str, *, autopilot: AutopilotName, name: str) -> bytes:
    """A compiled mission in one of the formats of :mod:`mission_io.formats.files`, or in one of an installed exporter.

    Raises:
        InputError: another format, or an exporter that cannot be loaded.
    """
    if file_format in FORMATS:
        return export_text(compiled, file_format, autopilot=autopilot, name=name).encode()
    write: Exporter = load("uavcover.exporters", file_format)
    return write(compiled, autopilot=autopilot, name=name)


def export_text(compiled: CompiledMission, file_format: str, *, autopilot: AutopilotName, name: str) -> str:
    """A compiled mission in one of the formats of :mod:`mission_io.formats.files`.

    Raises:
        InputError: another format.
    """
    if file_format not in FORMATS:
        raise InputError(f"unknown format {file_format!r}; use {', '.join(FORMATS)}")
    lists = PlanFile(compiled.mission, compiled.fence, compiled.rally, AUTOPILOTS[autopilot].mav_autopilot)
    return mission_text(file_format, lists, name=name)


def compile_sorties(
    site: Site,  # the scenario on its ground
    route: Route,  # the planned route
    *,
    autopilot: AutopilotName,  # the autopilot whose limits apply
    # how many points of its path a flight may have, transits included; None: any number
    most_points: int | None = None,
    vehicles: int = 1,  # how many fly at the same time
    # fraction of the time between two landings at one home that is left between the starts of two vehicles; with less than 1 the
    # flights are more even, and other pairs than neighbours must not land together
    spacing_fraction: float = 1.0,
) -> tuple[Sortie, ...]:
    """Compile a route as one flight, or as several with their own transits where endurance or item count require it.

    The order of the waypoints is kept. Dynamic programming over all possible splits minimises the total flight time. For several
    vehicles the route is cut so that they are done soonest (``missions/fleet_cuts.py``).

    Raises:
        InputError: the scenario has no position on Earth or no home.
        InfeasibleError: a leg exceeds a limit, or a part of the route cannot be reached inside the endurance (says which).
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
        found = _cuts(costs[0], site, vehicles, spacing_fraction)
        return None if found is None else [(first, last, 0) for first, last in found]

    return _cut_and_compiled([flyer], route, cut, refusal)


def compile_unlike_sorties(
    sites: Sequence[Site], route: Route, *, spacing_fraction: float = 1.0, one_at_a_time: bool = False
) -> tuple[Sortie, ...]:
    """Compile a route as flights of different vehicles, each from its own home, so that they are done soonest.

    Args:
        sites: of each vehicle, vehicle 1 first.
        route: the planned route.
        spacing_fraction: as for :func:`compile_sorties`, for vehicles whose homes are at most the planned path spacing apart.
        one_at_a_time: whether no vehicle flies before the one before it has landed.

    Raises:
        InfeasibleError: a leg exceeds a limit, or no vehicle reaches a part of the route inside its endurance (says which).
    """
    fleet = sites[0].scenario.fleet

    def cut(costs: Sequence[FlightCosts]) -> FlightsOfVehicles | None:
        spacing_s = spacing_fraction * max(
            _spacing_s(each, site, len(sites)) for each, site in zip(costs, sites, strict=True)
        )
        ready_s = [spacing_s * before for before in sharing_home(sites, fleet.planned_separation_m)]
        return unlike_cuts(costs, turnaround_s=fleet.turnaround_s, ready_s=ready_s, one_at_a_time=one_at_a_time)

    flyers = [_Flyer(site, site.scenario.vehicle.autopilot, None) for site in sites]
    if len(route) < 2:
        return _one_of(flyers, route)
    return _cut_and_compiled(flyers, route, cut, InfeasibleError("no split into sorties meets the limits"))


@dataclass(frozen=True, slots=True)
class _Flyer:
    """A vehicle, or all identical vehicles."""

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
    """A route of one waypoint, by the vehicle that finishes first."""
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
    """Compiled flights of a split. What the compiler refuses is omitted of the next split."""
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
                # a transit that exceeds a limit bars only its own waypoint from beginning or ending a flight, and no other.
                # Transits are checked one by one, and only where it matters.
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


def _cuts(costs: FlightCosts, site: Site, vehicles: int, spacing_fraction: float) -> Sequence[tuple[int, int]] | None:
    """First and last waypoint of each flight of the split with the shortest makespan; None without a split."""
    if vehicles > 1:
        return fleet_cuts(
            costs, vehicles=vehicles, turnaround_s=site.scenario.fleet.turnaround_s,
            spacing_s=spacing_fraction * _spacing_s(costs, site, vehicles),
        )  # fmt: skip
    total_s, begun = split(costs)
    if not math.isfinite(total_s):
        return None
    return flights_of_split(begun, costs.shared)


def _spacing_s(costs: FlightCosts, site: Site, vehicles: int) -> float:
    """Approximate time between landings of two vehicles at one home, so that the second comes late enough."""
    fleet = site.scenario.fleet
    flight_s = min(costs.endurance_s, float(costs.so_far_s[-1]) / vehicles)
    vertical_s = float(landing_time(pace_of(site), site.scenario.vehicle.takeoff_height_m))
    return 2.0 * (fleet.timing_error_fraction * flight_s + fleet.start_error_s) + fleet.pad_s + vertical_s


def _why_not(site: Site, costs: FlightCosts, refusal: InfeasibleError) -> str:
    """Message with the part of a route that no flight reaches, and the excess."""
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
            f"{longest_flight_text(site.scenario.vehicle)}; move [home] nearer, or plan a smaller area"
        )
    used = np.array([battery_s(costs.energies, int(first), int(first) + step) for first in firsts])
    worst = int(np.argmax(used))
    if used[worst] > costs.energies.usable_s:
        return (
            f"{part(worst)}: a sortie with this part alone uses {battery_text(site, float(used[worst]))}; move "
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

"""The flights of a planned route with vehicles and take-off times, what they come to, and their files."""

import dataclasses
import math
from collections.abc import Hashable, Sequence
from typing import Protocol

from mission_io.formats import wpl
from mission_io.formats.files import FORMATS, mission_text
from mission_io.formats.plan import PlanFile
from uavcover.errors import InfeasibleError, InputError
from uavcover.missions.fleet_schedule import schedule, timeline_of
from uavcover.missions.mission_compiler import AUTOPILOTS, CompiledMission
from uavcover.missions.sorties import Sortie, compile_sorties, compile_unlike_sorties, sharing_home
from uavcover.model.route import MissionSize, Route
from uavcover.model.vehicle import AutopilotName
from uavcover.plugins import load
from uavcover.scenario.site import Site, once
from uavcover.scenario.vehicles import groups_of, vehicle_sites

_SPACING_SHARES = (1.0, 0.5)
"""Spacings of the starts for which a fleet's route is cut; the cut that is done soonest is flown (scripts/bench/fleet.py)."""


def compile_flights(
    site: Site, route: Route, *, autopilot: AutopilotName | None = None, vehicles: int | None = None
) -> tuple[Sortie, ...]:
    """The missions of a planned route: one, or several where endurance, items or vehicles ask for it (see ``sorties``).

    Args:
        site: the scenario on its ground.
        route: the planned route.
        autopilot: for whom; default: the scenario's. Vehicles that differ have their own.
        vehicles: how many fly, where they are alike; default: the scenario's.

    Raises:
        InputError: the scenario has no position on Earth or no home, or the route was planned for other parts of the area.
        InfeasibleError: a leg breaks a limit, or a part of the route cannot be reached inside the endurance (says which).
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
        shares = _SPACING_SHARES if any(sharing_home(sites, site.scenario.fleet.planned_separation_m)) else (1.0,)
        unlike = [scheduled_unlike(site, _of_groups(site, groups, route, spacing_share=share)) for share in shares]
        return min(unlike, key=lambda flights: makespan_s(site, flights))
    if count == 1:
        return compile_sorties(site, route, autopilot=name)
    if count != site.scenario.fleet.vehicles:
        site = site.flown_by(count)
    best = _cut_for(count, site, route, autopilot=name)
    # Landings at one home are far apart: cut for fewer vehicles, or flown by one, a mission may be over sooner.
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
            compile_sorties(site, route, autopilot=autopilot, vehicles=vehicles, spacing_share=share),
            autopilot=autopilot,
        )
        for share in (_SPACING_SHARES if vehicles > 1 else _SPACING_SHARES[:1])
    ]
    return min(tried, key=lambda flights: makespan_s(site, flights))


def _of_groups(
    site: Site, groups: Sequence[Sequence[int]], route: Route, *, spacing_share: float
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
            flights = compile_unlike_sorties(own, part, spacing_share=spacing_share, one_at_a_time=one_at_a_time)
        found += [
            dataclasses.replace(
                flight, first=begins + flight.first, last=begins + flight.last, vehicle=group[flight.vehicle - 1]
            )
            for flight in flights
        ]
    return tuple(found)


def scheduled(site: Site, flights: Sequence[Sortie], *, autopilot: AutopilotName) -> tuple[Sortie, ...]:
    """The flights with the vehicle that flies each and its take-off, so that all keep apart (``missions/fleet_schedule.py``)."""
    timelines = [timeline_of(site, flight, autopilot=autopilot) for flight in flights]
    starts = schedule(timelines, site.scenario.fleet)
    return tuple(
        dataclasses.replace(flight, vehicle=start.vehicle + 1, start_s=start.start_s)
        for flight, start in zip(flights, starts, strict=True)
    )


def scheduled_unlike(site: Site, flights: Sequence[Sortie]) -> tuple[Sortie, ...]:
    """The flights of vehicles that differ, each with its vehicle already, with take-offs at which all keep apart."""
    fleet, sites = site.scenario.fleet, vehicle_sites(site)
    if fleet.one_at_a_time:
        return _one_after_the_other(flights, fleet.turnaround_s)
    timelines = []
    for flight in flights:
        own = sites[flight.vehicle - 1]
        timelines.append(timeline_of(own, flight, autopilot=own.scenario.vehicle.autopilot))
    starts = schedule(timelines, fleet, vehicle_of=[flight.vehicle - 1 for flight in flights])
    return tuple(
        dataclasses.replace(flight, start_s=start.start_s) for flight, start in zip(flights, starts, strict=True)
    )


def _one_after_the_other(flights: Sequence[Sortie], turnaround_s: float) -> tuple[Sortie, ...]:
    """Schedule flights with this pause between landing and take-off.

    All flights from one home come before those from the next.
    """
    start_s, found = 0.0, {}
    for k in sorted(range(len(flights)), key=lambda k: (flights[k].vehicle, k)):
        found[k] = dataclasses.replace(flights[k], start_s=start_s)
        start_s += flights[k].compiled.flight_time_s + turnaround_s
    return tuple(found[k] for k in range(len(flights)))


def makespan_s(site: Site, flights: Sequence[Sortie]) -> float:
    """Planned time from the first take-off to the last landing. Flights without take-off times are those of one vehicle."""
    if all(flight.start_s is None for flight in flights):
        times_s = [flight.compiled.flight_time_s for flight in flights]
        return math.fsum(times_s) + site.scenario.fleet.turnaround_s * (len(flights) - 1)
    return max((flight.start_s or 0.0) + flight.compiled.flight_time_s for flight in flights)


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
        vehicles: how many may fly, where they are alike; default: the scenario's.

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
    """The mission of a run that is one flight, else its sorties. Flights of vehicles that differ always are sorties."""
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

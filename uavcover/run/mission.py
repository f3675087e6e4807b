"""From a planned route to missions, and to the files of other software."""

from collections.abc import Sequence
from dataclasses import replace

from mission_io.formats import wpl
from mission_io.formats.files import FORMATS, mission_text
from mission_io.formats.plan import PlanFile
from uavcover.errors import InputError
from uavcover.model.route import Route
from uavcover.model.vehicle import AutopilotName
from uavcover.routes.mission_compiler import AUTOPILOTS, CompiledMission, compile_mission
from uavcover.routes.sorties import Sortie, compile_sorties, compile_unlike_sorties
from uavcover.run.fleet import makespan_s, scheduled, scheduled_unlike
from uavcover.scenario.site import Site
from uavcover.scenario.vehicle_parts import groups_of
from uavcover.scenario.vehicle_site import vehicle_sites

_SPACING_SHARES = (1.0, 0.5)
"""Spacings of the starts for which a fleet's route is cut; the cut that is done soonest is flown (scripts/bench_fleet.py)."""


def compile_plan(site: Site, route: Route, *, autopilot: AutopilotName | None = None) -> CompiledMission:
    """The mission of a planned route, every leg checked; see :func:`uavcover.routes.mission_compiler.compile_mission`."""
    return compile_mission(site, route, autopilot=autopilot or site.scenario.vehicle.autopilot)


def compile_flights(
    site: Site, route: Route, *, autopilot: AutopilotName | None = None, vehicles: int | None = None
) -> tuple[Sortie, ...]:
    """The missions of a planned route: one, or several where endurance, items or vehicles ask for it (`uavcover.routes.sorties`).

    Args:
        site: the scenario on its ground.
        route: the planned route.
        autopilot: for whom; default: the scenario's. Vehicles that differ have their own.
        vehicles: how many fly; default: the scenario's.
    """
    name = autopilot or site.scenario.vehicle.autopilot
    count = site.scenario.fleet.vehicles if vehicles is None else vehicles
    if site.scenario.vehicles:
        sites = vehicle_sites(site)
        groups = groups_of(site.scenario) or (tuple(range(1, len(sites) + 1)),)
        if len(groups) != len(route.parts):
            raise InputError(
                f"the route has {len(route.parts)} parts, and the vehicles of {site.scenario.name} see {len(groups)} parts of "
                "the area; plan it again"
            )
        unlike = [
            scheduled_unlike(site, _of_groups(site, groups, route, spacing_share=share)) for share in _SPACING_SHARES
        ]
        return min(unlike, key=makespan_s)
    if count == 1:
        return compile_sorties(site, route, autopilot=name)
    tried = [
        scheduled(
            site, compile_sorties(site, route, autopilot=name, vehicles=count, spacing_share=share), autopilot=name
        )
        for share in _SPACING_SHARES
    ]
    return min(tried, key=makespan_s)


def _of_groups(
    site: Site, groups: Sequence[Sequence[int]], route: Route, *, spacing_share: float
) -> tuple[Sortie, ...]:
    """The sorties of all parts of a route, each cut for the vehicles that see that part; numbers are those of the whole route."""
    sites, one_at_a_time = vehicle_sites(site), site.scenario.fleet.one_at_a_time
    found: list[Sortie] = []
    for group, part, begins in zip(groups, route.parts, (0, *route.begins), strict=True):
        own = [sites[number - 1] for number in group]
        if len(own) == 1:
            flights = compile_sorties(own[0], part, autopilot=own[0].scenario.vehicle.autopilot)
        else:
            flights = compile_unlike_sorties(own, part, spacing_share=spacing_share, one_at_a_time=one_at_a_time)
        found += [
            replace(flight, first=begins + flight.first, last=begins + flight.last, vehicle=group[flight.vehicle - 1])
            for flight in flights
        ]
    return tuple(found)


def one_or_several(site: Site, flights: Sequence[Sortie]) -> tuple[CompiledMission | None, tuple[Sortie, ...]]:
    """The mission of a run that is one flight, and its sorties where it is not: flights of vehicles that differ always are."""
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


def export_text(compiled: CompiledMission, file_format: str, *, autopilot: AutopilotName, name: str) -> str:
    """A compiled mission in one of the formats of :mod:`mission_io.formats.files`.

    Raises:
        InputError: another format.
    """
    if file_format not in FORMATS:
        raise InputError(f"format {file_format!r} is not one of {', '.join(FORMATS)}")
    lists = PlanFile(compiled.mission, compiled.fence, compiled.rally, AUTOPILOTS[autopilot].mav_autopilot)
    return mission_text(file_format, lists, name=name)

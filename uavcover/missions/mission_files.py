"""From a planned route to missions, and to the files of other software."""

from collections.abc import Sequence
from typing import Protocol

from mission_io.formats import wpl
from mission_io.formats.files import FORMATS, mission_text
from mission_io.formats.plan import PlanFile
from uavcover.errors import InputError
from uavcover.missions.mission_compiler import AUTOPILOTS, CompiledMission, compile_mission
from uavcover.missions.sorties import Sortie
from uavcover.model.route import Route
from uavcover.model.vehicle import AutopilotName
from uavcover.plugins import load
from uavcover.scenario.site import Site


def compile_plan(site: Site, route: Route, *, autopilot: AutopilotName | None = None) -> CompiledMission:
    """The mission of a planned route, every leg checked; see :func:`uavcover.missions.mission_compiler.compile_mission`."""
    return compile_mission(site, route, autopilot=autopilot or site.scenario.vehicle.autopilot)


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

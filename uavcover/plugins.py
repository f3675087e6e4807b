"""Extension points: entry points of ``pyproject.toml`` through which extras and third-party packages add features."""

import logging
from collections.abc import Mapping
from functools import cache
from importlib import metadata
from types import MappingProxyType
from typing import Any, Final

from uavcover.errors import InputError

_log = logging.getLogger(__name__)

GROUPS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "uavcover.commands": "commands: groups of the overview with their commands (uavcover.cli.main.Groups)",
        "uavcover.clients": "clients for --client: a module with open_client(link, own_system=...)",
        "uavcover.bounds": "provers of bounds: a module with proved(site, plan, time_s=...) and least_length_m(site, rule)",
        "uavcover.evidence": "other evidence of flights than tracks, for verify: the module uavcover.extras.photos.any_flight",
        "uavcover.fleets": "several vehicles at the same time: the module uavcover.extras.fleet",
        "uavcover.large_areas": "planning by parts (uavcover.planner.plan_search.LargeAreas)",
        "uavcover.exporters": "formats for export: a function with the signature of uavcover.missions.flights.Exporter",
        "uavcover.sensors": (
            "sensors: a class derived from a built-in one (uavcover.model.sensor), or a function that returns its table"
        ),
        "uavcover.area_readers": "formats of areas by suffix, without its dot: a function of text and name (AreaDocument)",
        "uavcover.log_readers": "formats of flight logs by suffix, without its dot: a function of the path (LoggedRows)",
        "uavcover.algorithms": "optimizers by name: a class with ask and tell (docs/reference/optimizers.md)",
        "uavcover.zone_readers": "formats of no-fly zones (uavcover.scenario.airspace.zone_file.ZoneReader)",
    }
)
"""The extension points, and the kind of their entries."""
_OWN = "uavcover"


@cache
def registered(group: str) -> Mapping[str, metadata.EntryPoint]:
    """The entry points of a group by name; another package cannot take uavcover's own names."""
    found = sorted(metadata.entry_points(group=group), key=lambda entry: (package_of(entry) != _OWN, entry.name))
    named: dict[str, metadata.EntryPoint] = {}
    for entry in found:
        named.setdefault(entry.name, entry)
    return MappingProxyType(named)


def load(group: str, name: str) -> Any:
    """The object of an entry point. Raises InputError: it is not registered, or cannot be loaded."""
    entry = registered(group).get(name)
    if entry is None:
        raise InputError(f"{name} is not installed; installed {group}: {', '.join(registered(group)) or 'nothing'}")
    try:
        return entry.load()
    except Exception as error:
        raise InputError(
            f"{name}: {entry.value} of package {package_of(entry)} cannot be loaded ({error}); update or uninstall that package"
        ) from error


@cache
def loaded(group: str) -> Mapping[str, Any]:
    """Every object of a group that can be loaded, by name; a broken package is logged and omitted."""
    objects: dict[str, Any] = {}
    for name in registered(group):
        try:
            objects[name] = load(group, name)
        except InputError as error:
            _log.warning("%s", error)
    return MappingProxyType(objects)


def package_of(entry: metadata.EntryPoint) -> str:
    """The name of the package that registers an entry point."""
    return "?" if entry.dist is None else entry.dist.name

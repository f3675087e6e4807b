"""Addresses of the vehicles of a command: from its options, or from the vehicles' scenario."""

from collections.abc import Sequence
from typing import NamedTuple

from mission_io.model.plain_text import counted
from uavcover.errors import InputError
from uavcover.model.scenario import Scenario
from uavcover.run.folder import RunFolder
from uavcover.scenario.scenario_file import load_scenario


class VehiclePlace(NamedTuple):
    """Where a vehicle is."""

    url: str  # its link
    system_id: int | None = None  # which one on it; none where it is the only one


def given_places(urls: Sequence[str] | None, systems: Sequence[int] | None) -> list[VehiclePlace]:
    """The vehicles that ``--to`` and ``--system`` name, vehicle 1 first; none where no ``--to`` is given.

    One link with several systems is that of all of them; one system is that of each link.

    Raises:
        InputError: there are other numbers of both, or one vehicle is named twice.
    """
    urls, systems = urls or (), systems or ()
    if urls and len(urls) != len(systems) and 1 not in (len(urls), len(systems)) and systems:
        raise InputError(
            f"--system is given {len(systems)} times, but --to {len(urls)} times; give one --system for each --to, "
            "or one --to for all"
        )
    if systems and not urls:
        if len(systems) > 1:
            raise InputError("--system selects a vehicle on a link; specify the link with --to")
        return []
    count = max(len(urls), len(systems))
    all_urls = [*urls] if len(urls) == count else [*urls] * count
    all_systems = [*systems] if len(systems) == count else [*systems, None][:1] * count
    places = [VehiclePlace(url, system) for url, system in zip(all_urls, all_systems, strict=True)]
    require_different(places)
    return places


def require_different(places: Sequence[VehiclePlace]) -> None:
    """Refuse two vehicles at one address; each ``mock:`` is a vehicle of its own.

    Raises:
        InputError: two have the same address, or share one link and one system id.
    """
    for number, (url, system_id) in enumerate(places):
        on_it = [] if url.startswith("mock:") else [place for place in places[:number] if place.url == url]
        if any(None in (system_id, place.system_id) for place in on_it):
            raise InputError(
                f"--to: {url} is used {1 + len(on_it)} times; each vehicle needs its own link, or its own --system on that link"
            )
        if VehiclePlace(url, system_id) in on_it:
            raise InputError(f"--system: {system_id} at {url} is used twice; each vehicle needs its own system ID")


def links_of_run(run: RunFolder, given: Sequence[VehiclePlace], *, sortie: int | None) -> list[VehiclePlace]:
    """The given addresses, or those that the scenario of a run names.

    Args:
        run: with a plan.
        given: by :func:`given_places`.
        sortie: number of the one that is meant; none: all of the run.

    Raises:
        InputError: none was given, and the scenario does not name those of all vehicles that fly.
    """
    if given:
        return list(given)
    folder = run if sortie is None else run.flight(sortie)
    scenario = load_scenario(folder.existing("scenario.toml", made_by="uavcover plan"))
    if folder.read_json("plan.json", made_by="uavcover plan").get("fleet") is not None:
        return _links_of(scenario)
    # One flight of a fleet: a sortie's scenario has its own vehicle, and what closes gaps is flown by vehicle 1.
    vehicle = (scenario.vehicles or (scenario.vehicle,))[0]
    if vehicle.link is None:
        raise InputError(f"--to is missing, and the vehicle of {folder} has no link in its scenario; specify --to")
    return [VehiclePlace(vehicle.link, vehicle.system_id)]


def links_of_scenario(source: str, given: Sequence[VehiclePlace], *, sortie: int | None) -> list[VehiclePlace]:
    """The same for a scenario that is not planned yet, a file or a bundled one.

    Raises:
        InputError: the same, or their number is not that of the vehicles.
    """
    scenario = load_scenario(source)
    if not given:
        return _links_of(scenario)
    if scenario.vehicles and len(given) != len(scenario.vehicles) and not (len(given) == 1 and sortie is not None):
        raise InputError(
            f"--to is given {counted(len(given), 'time')}, but {source} defines "
            f"{len(scenario.vehicles)} different vehicles; specify a link for each, vehicle 1 first"
        )
    return list(given)


def _links_of(scenario: Scenario) -> list[VehiclePlace]:
    """The links of the vehicles of a scenario, vehicle 1 first. Raises InputError: one is missing."""
    if not scenario.vehicles:
        if scenario.vehicle.link is None:
            raise InputError("--to is missing, and [vehicle] has no link; specify one of them")
        if scenario.fleet.vehicles > 1:
            raise InputError(
                f"--to is missing, and [vehicle] has one link for {scenario.fleet.vehicles} vehicles; use --to for "
                "each, or a [[vehicle]] with its own link for each"
            )
        return [VehiclePlace(scenario.vehicle.link, scenario.vehicle.system_id)]
    missing = [number for number, vehicle in enumerate(scenario.vehicles, start=1) if vehicle.link is None]
    if missing:
        raise InputError(
            f"--to is missing, and [[vehicle]] number {missing[0]} has no link; use --to for each vehicle, or add a "
            "link to each [[vehicle]]"
        )
    return [VehiclePlace(vehicle.link, vehicle.system_id) for vehicle in scenario.vehicles if vehicle.link is not None]

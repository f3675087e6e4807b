"""Where the vehicles of a scenario are, when a command is not told."""

from collections.abc import Sequence

from uavcover.errors import InputError
from uavcover.model.scenario import Scenario
from uavcover.run.folder import RunFolder
from uavcover.scenario.scenario_file import load_scenario


def links_of_run(run: RunFolder, given: Sequence[str] | None, *, sortie: int | None) -> list[str]:
    """The links that were given, or those that the scenario of a run names.

    Args:
        run: with a plan.
        given: by ``--to``, vehicle 1 first.
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
    link = (scenario.vehicles or (scenario.vehicle,))[0].link
    if link is None:
        raise InputError(f"--to: is missing, and the vehicle of {folder} has no link in its scenario; give --to")
    return [link]


def links_of_scenario(source: str, given: Sequence[str] | None, *, sortie: int | None) -> list[str]:
    """The same for a scenario that is not planned yet, a file or a bundled one.

    Raises:
        InputError: likewise, or their number is not that of the vehicles.
    """
    scenario = load_scenario(source)
    if not given:
        return _links_of(scenario)
    if scenario.vehicles and len(given) != len(scenario.vehicles) and not (len(given) == 1 and sortie is not None):
        raise InputError(
            f"--to: is given {len(given)} times, and {source} lists {len(scenario.vehicles)} vehicles that differ; give the link "
            "of each, vehicle 1 first"
        )
    return list(given)


def _links_of(scenario: Scenario) -> list[str]:
    """The links of the vehicles of a scenario, vehicle 1 first.

    Raises:
        InputError: one is missing.
    """
    if not scenario.vehicles:
        if scenario.vehicle.link is None:
            raise InputError("--to: is missing, and [vehicle] has no link; give one of them")
        if scenario.fleet.vehicles > 1:
            raise InputError(
                f"--to: is missing, and [vehicle] has one link for {scenario.fleet.vehicles} vehicles; give --to for each, or a "
                "[[vehicle]] with its own link for each"
            )
        return [scenario.vehicle.link]
    missing = [number for number, vehicle in enumerate(scenario.vehicles, start=1) if vehicle.link is None]
    if missing:
        raise InputError(
            f"--to: is missing, and [[vehicle]] number {missing[0]} has no link; give --to for each vehicle, or a link in each "
            "[[vehicle]]"
        )
    return [vehicle.link for vehicle in scenario.vehicles if vehicle.link is not None]

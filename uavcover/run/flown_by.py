"""Which vehicle of a run flew a log, where the vehicles differ."""

from pathlib import Path

from uavcover.errors import InputError
from uavcover.model.scenario import Scenario
from uavcover.run.folder import RunFolder
from uavcover.run.user import to_paste
from uavcover.scenario.scenario_file import load_scenario
from uavcover.scenario.site import Site
from uavcover.scenario.vehicle_site import vehicle_sites


def is_alike(own: Scenario, other: Scenario) -> bool:
    """Whether two vehicles have the same settings, home and sensor."""
    return (own.vehicle, own.home, own.sensor) == (other.vehicle, other.home, other.sensor)


def site_for(log: Path, run: RunFolder, site: Site) -> Site:
    """The site of the vehicle that flew a log: where vehicles differ, that of the plan beside it.

    Raises:
        InputError: nothing tells which vehicle flew it.
    """
    if not site.scenario.vehicles:
        return site
    inside = log.resolve().is_relative_to(run.path.resolve())
    if not inside:
        raise InputError(
            f"{log}: the vehicles of {run} differ, and the log does not show which one flew it: judge it with the "
            f"plan of that vehicle: {to_paste('verify', f'{run}/sortie-N', '--log', log)}"
        )
    beside = RunFolder(log.parent).file("scenario.toml")
    scenario = load_scenario(beside) if beside.exists() else site.scenario
    # Only who flew and from where is the sortie's; limits and ground are those of the whole run.
    for own in vehicle_sites(site):
        if is_alike(own.scenario, scenario):
            return own
    raise InputError(f"{beside}: the vehicle or home is not one of {run.file('scenario.toml')}; plan again")

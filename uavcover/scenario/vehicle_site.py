"""The sites of vehicles that differ: the same ground and area, with the home and the settings of each."""

import dataclasses

from uavcover.errors import UavcoverError
from uavcover.model.scenario import Origin, Scenario
from uavcover.scenario.site import Site, load_site, once


def vehicle_scenario(site: Site, number: int) -> Scenario:
    """The scenario of one of several vehicles that differ: one [vehicle] and its [home], in the frame of all.

    Args:
        site: of all vehicles.
        number: of the vehicle, from 1.
    """
    scenario, frame = site.scenario, site.frame
    own = scenario.vehicles[number - 1]
    origin = scenario.origin
    if frame is not None:
        origin = Origin(lat_deg=frame.lat_deg, lon_deg=frame.lon_deg, alt_amsl_m=frame.alt_amsl_m)
    return dataclasses.replace(
        scenario,
        vehicle=dataclasses.replace(own, home=None, area=None, sensor=None),
        home=own.home,
        sensor=own.sensor or scenario.sensor,
        origin=origin,
        vehicles=(),
        fleet=dataclasses.replace(scenario.fleet, one_at_a_time=False),
    )


@once
def vehicle_sites(site: Site) -> tuple[Site, ...]:
    """The site of each vehicle, vehicle 1 first; none where all are alike.

    Raises:
        ScenarioError, TerrainError: a home is in a no-fly zone, by an obstacle, outside the fence or the elevation data; the
            text begins with the vehicle.
    """
    return tuple(_built(site, number) for number in range(1, len(site.scenario.vehicles) + 1))


def _built(site: Site, number: int) -> Site:
    try:
        return load_site(vehicle_scenario(site, number))
    except UavcoverError as error:
        launched = site.scenario.has_launch_points and number > 1
        which = f"[[launch_point]] number {number - 1}" if launched else f"[[vehicle]] number {number}"
        raise type(error)(f"{which}: {error}") from error

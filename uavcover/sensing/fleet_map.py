"""Cells of a fleet whose vehicles may have different sensors: an observation by any vehicle counts."""

import numpy as np

from uavcover.scenario.site import Site
from uavcover.scenario.vehicle_parts import own_sensors
from uavcover.scenario.vehicle_site import vehicle_sites
from uavcover.sensing.coverage_map import CoverageMap, judging_map


def map_for(site: Site, own: Site) -> CoverageMap:
    """The cells of a site as the sensor of one of its vehicles sees them.

    Args:
        site: of all vehicles.
        own: of the vehicle: the same ground and area.
    """
    if own.scenario.sensor != site.scenario.sensor:
        return judging_map(own)
    whole = judging_map(site)
    _ = whole.coverable  # found once, and not by each vehicle again
    return whole.flown_from(own)


def fleet_map(site: Site) -> CoverageMap:
    """The cells that results are judged on; those that the sensor of any vehicle can see are coverable."""
    if not own_sensors(site.scenario):
        return judging_map(site)
    key = "fleet_map"
    if key not in site.derived:
        together = judging_map(site).flown_from(site)
        maps = [map_for(site, own) for own in vehicle_sites(site)]
        together.coverable = np.logical_or.reduce([each.coverable for each in maps], axis=0)
        site.derived[key] = together
    made: CoverageMap = site.derived[key]
    return made

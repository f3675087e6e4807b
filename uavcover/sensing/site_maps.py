"""The maps of a site, each built once: for the search, and for judging results."""

import numpy as np

from uavcover.scenario.site import Site, once
from uavcover.scenario.vehicles import own_sensors, vehicle_sites
from uavcover.sensing.block_map import BlockMap
from uavcover.sensing.cells import (
    cut_for,
    is_judged_on_smaller_cells,
    judged_cell_size_m,
    make_other_cells,
    make_refined_cells,
)
from uavcover.sensing.coverage_map import CoverageMap


@once
def judging_map(site: Site) -> CoverageMap:
    """The cells that results are judged on: in one piece, or in blocks where the site says so."""
    if site.block_cells is not None:
        return BlockMap(site, site.block_cells)
    return CoverageMap(site, cell_size_m=judged_cell_size_m(site), cut=cut_for(site))


def judging_maps(site: Site) -> list[CoverageMap]:
    """Maps on which a search rates a route: :func:`judging_map`, and finer ones for cells of the scenario's size.

    These only for a sensor that looks along the path, and where memory allows. Built once for a site.
    """
    if not site.scenario.sensor.looks_along_path or is_judged_on_smaller_cells(site):
        return [judging_map(site)]
    finer = finer_map(site)
    return [judging_map(site)] if finer is None else [judging_map(site), finer]


def planning_map(site: Site) -> CoverageMap:
    """The cells that a planner uses, the area's own if they are of the same size. Built once for a site."""
    return _map_of(site, site.scenario.planning_cell_size_m)


def sampling_map(site: Site, *, most_cells: int) -> CoverageMap:
    """:func:`planning_map`, or one of larger cells where it has more than ``most_cells``; the latter is not kept.

    Each cell is looked at in one place, so larger ones are a thinner sample of the ground.
    """
    cell_size_m = (site.area.area / most_cells) ** 0.5
    if cell_size_m <= site.scenario.planning_cell_size_m:
        return planning_map(site)
    return CoverageMap(site, cell_size_m=cell_size_m, cut=cut_for(site))


_MOST_FINER_CELLS = 600_000
"""Above this number, the own cells are many enough against overfitting.

On 25 km² finer ones took 4 s before a search could begin.
"""


def finer_map(site: Site) -> CoverageMap | None:
    """Other places, on which what is found is tried once more; none where memory, or limits of waypoints, forbid.

    Cells of half the size, whose places include those of the judged cells; or other places, where judged cells are smaller than
    the scenario's already.
    """
    if site.scenario.limits.applies_to == "waypoints":
        return None
    if is_judged_on_smaller_cells(site):
        return _other_places(site)
    if judging_map(site).grid.count * 4 > _MOST_FINER_CELLS:
        return None
    return _refined(site)


@once
def _refined(site: Site) -> CoverageMap:
    return CoverageMap(site, cell_size_m=0.5 * judged_cell_size_m(site), cut=make_refined_cells)


@once
def _other_places(site: Site) -> CoverageMap:
    return CoverageMap(site, cell_size_m=judged_cell_size_m(site), cut=make_other_cells)


@once
def _maps(_site: Site) -> dict[float, CoverageMap]:
    """Maps that were built before, by the size of their cells."""
    return {}


def _map_of(site: Site, cell_size_m: float) -> CoverageMap:
    maps = _maps(site)
    if cell_size_m == judged_cell_size_m(site):
        return judging_map(site)
    if cell_size_m not in maps:
        maps[cell_size_m] = CoverageMap(site, cell_size_m=cell_size_m, cut=cut_for(site))
    return maps[cell_size_m]


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


@once
def fleet_map(site: Site) -> CoverageMap:
    """The cells that results are judged on; those that the sensor of any vehicle can see are coverable."""
    if not own_sensors(site.scenario):
        return judging_map(site)
    maps = [map_for(site, own) for own in vehicle_sites(site)]
    return judging_map(site).flown_from(site, np.logical_or.reduce([each.coverable for each in maps], axis=0))

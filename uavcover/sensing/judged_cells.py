"""Size of the cells on which results are judged.

A cell counts by one place in it, so the coverage of an area of few cells is a small sample: with 8,500 cells its standard
deviation is 0.05 points, and a search finds routes that just these places flatter. Where the ground of a few cells weighs as much
as that of many, as on cliffs, it is half a point. So an area of few cells is judged on smaller ones.
"""

import math

from uavcover.model.terrain import SineCosineTerrain
from uavcover.scenario.site import Site, once
from uavcover.sensing.cells import make_sampled_cells

MOST_PLACES = 160_000
"""This number is enough for any ground."""

_PROBED = 10_000


@once
def judged_cell_size_m(site: Site) -> float:
    """Side of the cells that results are judged on: ``area.cell_size_m``, or less, so that there are ``area.fewest_places``.

    What counts is how many places of equal weight would be as good a sample: (sum of w)^2 / (sum of w^2). The paper's cells are
    their centres, and stay as they are.
    """
    area = site.scenario.area
    if isinstance(site.scenario.terrain, SineCosineTerrain):
        return area.cell_size_m
    return cell_size_for(site, fewest=area.fewest_places, most=MOST_PLACES, largest_m=area.cell_size_m)


def is_judged_on_smaller_cells(site: Site) -> bool:
    """Whether the cells that results are judged on are smaller than ``area.cell_size_m``."""
    return judged_cell_size_m(site) < site.scenario.area.cell_size_m


def cell_size_for(site: Site, *, fewest: int, most: int, largest_m: float) -> float:
    """Side of cells that sample the ground as well as ``fewest`` equal cells, if ``most`` suffice for that.

    Args:
        site: the scenario on its ground.
        fewest: cells of equal weight.
        most: number of cells.
        largest_m: the side is not larger.
    """
    area_m2 = site.area.area
    cells = area_m2 / largest_m**2
    if fewest == 0 or cells >= most:
        return largest_m
    wanted = min(fewest / evenness(site), most)
    return largest_m if cells >= wanted else math.sqrt(area_m2 / wanted)


@once
def evenness(site: Site) -> float:
    """Share 0..1 of a site's cells: equal cells of this share are as good a sample."""
    size_m = max(site.scenario.area.cell_size_m, math.sqrt(site.area.area / _PROBED))
    weight = make_sampled_cells(site, size_m).weight_m2
    return float(weight.sum() ** 2 / (weight**2).sum() / weight.size)

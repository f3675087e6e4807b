"""What was not seen, grouped into connected regions."""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from uavcover.coverage.coverage_map import CoverageMap
from uavcover.model.report import Gap


def find_gaps(coverage: CoverageMap, seen: NDArray[np.bool_]) -> list[Gap]:
    """Groups of coverable cells that were not seen, touching by side or corner; the largest first."""
    cells = coverage.grid.cells
    missing = ~seen & coverage.coverable
    lattice = np.zeros(cells.lattice.shape, dtype=bool)
    inside = cells.lattice >= 0
    lattice[inside] = missing[cells.lattice[inside]]
    labels, count = ndimage.label(lattice, structure=np.ones((3, 3)))
    label_of_cell = np.zeros(coverage.grid.count, dtype=np.int64)
    label_of_cell[cells.lattice[inside]] = labels[inside]
    gaps = []
    for label in range(1, count + 1):
        members = np.flatnonzero(label_of_cell == label)
        weight = coverage.grid.weight_m2[members]
        middle = np.average(cells.centre_m[members], axis=0, weights=weight)
        lat, lon = float("nan"), float("nan")
        if coverage.site.frame is not None:
            lats, lons, _ = coverage.site.frame.geodetic_from_enu(middle)
            lat, lon = float(lats[0]), float(lons[0])
        gaps.append(
            Gap(
                cells=int(members.size), area_m2=float(weight.sum()), lat_deg=lat, lon_deg=lon,
                east_m=float(middle[0]), north_m=float(middle[1]),
            )
        )  # fmt: skip
    return sorted(gaps, key=lambda gap: -gap.area_m2)

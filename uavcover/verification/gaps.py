"""What was not seen, grouped into connected regions."""

import numpy as np
from numpy.typing import NDArray

from uavcover.coverage.coverage_map import CoverageMap
from uavcover.model.report import Gap


def find_gaps(coverage: CoverageMap, seen: NDArray[np.bool_]) -> list[Gap]:
    """Groups of coverable cells that were not seen, touching by side or corner; the largest first."""
    # Importing scipy.ndimage takes most of a second, which commands that judge nothing need not wait for.
    from scipy import ndimage

    cells = coverage.grid.cells
    missing = ~seen & coverage.coverable
    lattice = np.zeros(cells.lattice.shape, dtype=bool)
    inside = cells.lattice >= 0
    lattice[inside] = missing[cells.lattice[inside]]
    labels, count = ndimage.label(lattice, structure=np.ones((3, 3)))
    label_of_cell = np.zeros(coverage.grid.count, dtype=np.int64)
    label_of_cell[cells.lattice[inside]] = labels[inside]
    members = np.flatnonzero(label_of_cell)
    label, weight = label_of_cell[members] - 1, coverage.grid.weight_m2[members]
    number = np.bincount(label, minlength=count)
    area = np.bincount(label, weights=weight, minlength=count)
    middle = np.column_stack(
        [
            np.bincount(label, weights=weight * cells.centre_m[members, axis], minlength=count) / area
            for axis in range(3)
        ]
    )
    lat, lon = np.full(count, np.nan), np.full(count, np.nan)
    if coverage.site.frame is not None:
        lat, lon, _ = coverage.site.frame.geodetic_from_enu(middle)
    gaps = [
        Gap(
            cells=int(number[k]), area_m2=float(area[k]), lat_deg=float(lat[k]), lon_deg=float(lon[k]),
            east_m=float(middle[k, 0]), north_m=float(middle[k, 1]),
        )
        for k in range(count)
    ]  # fmt: skip
    return sorted(gaps, key=lambda gap: -gap.area_m2)

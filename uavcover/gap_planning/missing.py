"""The cells that are still to be seen, as kernels take them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavcover.coverage.coverage_map import CoverageMap
from uavcover.coverage.level_looks import LevelLooks
from uavcover.kernels import coverage as kernels
from uavcover.kernels.coverage import Cells
from uavcover.kernels.sight import Sight

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class MissingCells:
    """Part of the cells of a map, with numbers of their own.

    Attributes:
        coverage: the whole map.
        cells: the part, cut out of the lattice.
        weight_m2: (m,) ground area of each.
    """

    coverage: CoverageMap
    cells: Cells
    weight_m2: FloatArray

    @classmethod
    def of(cls, coverage: CoverageMap, missing: BoolArray) -> "MissingCells":
        """Those marked in ``missing`` (cells,), at least one."""
        whole = coverage.grid.cells
        chosen = np.zeros(whole.lattice.shape, dtype=bool)
        inside = whole.lattice >= 0
        chosen[inside] = missing[whole.lattice[inside]]
        rows, columns = np.flatnonzero(chosen.any(axis=1)), np.flatnonzero(chosen.any(axis=0))
        cut = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
        numbers = whole.lattice[cut][chosen[cut]]
        lattice = np.full(chosen[cut].shape, -1, dtype=np.int32)
        lattice[chosen[cut]] = np.arange(numbers.size, dtype=np.int32)
        cells = Cells(
            whole.east0_m + whole.size_m * int(columns[0]), whole.north0_m + whole.size_m * int(rows[0]), whole.size_m,
            lattice, np.ascontiguousarray(whole.centre_m[numbers]), np.ascontiguousarray(whole.normal[numbers]),
            np.ascontiguousarray(whole.horizon[numbers]),
        )  # fmt: skip
        return cls(coverage, cells, coverage.grid.weight_m2[numbers])

    def seen_by(self, looks: LevelLooks, sight: Sight) -> BoolArray:
        """(m,) whether each is seen by any of the looks."""
        surface = self.coverage.site.ground.surface
        return kernels.seen_from_points(surface, sight, self.cells, looks.places_m, looks.headings)

    def seen_on(self, route_m: FloatArray, sight: Sight) -> BoolArray:
        """(m,) whether each is seen on an (n, 3) ENU route, by the sensing rule of the scenario."""
        return self.seen_by(self.coverage.looks(route_m), sight)

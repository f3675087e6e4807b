"""The cells of an area, on a square lattice: ``lattice`` maps its rows and columns to cell numbers, -1 where there is no cell."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.horizon import SECTORS
from uavcover.kernels.skyline import NO_SKYLINES, Skylines

NO_RISE = np.empty((0, 3, SECTORS), dtype=np.float32)
NO_RISE.flags.writeable = False


class Cells(NamedTuple):
    """The cells of an area.

    Attributes:
        east0_m: east of the centre of lattice column 0.
        north0_m: north of the centre of lattice row 0.
        size_m: side of a cell.
        lattice: (rows, columns) int32, number of the cell or -1.
        centre_m: (n, 3) centres on the ground, or on the roof of what stands there.
        normal: (n, 3) unit normals of the ground, or of the roof.
        horizon: (n,) tangent of the slope above which no obstacle in the sensor's reach can hide the cell; 0 where none is near.
        scatter_m: no centre is farther than this from its place on the lattice, on the map.
        rise: (n, 3, 16) of :func:`uavcover.kernels.horizon.rises` within the sensor's reach; (0, 3, 16) where it is not known.
        skylines: of the cells that obstacles may hide.
    """

    east0_m: float
    north0_m: float
    size_m: float
    lattice: NDArray[np.int32]
    centre_m: NDArray[np.float64]
    normal: NDArray[np.float64]
    horizon: NDArray[np.float64]
    scatter_m: float = 0.0
    rise: NDArray[np.float32] = NO_RISE
    skylines: Skylines = NO_SKYLINES

"""The array types of this package, declared once; docstrings give shapes and units."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
ByteArray = NDArray[np.uint8]

Point = tuple[float, float, float]
"""East, north, up, metres."""


def read_only(numbers: ArrayLike) -> FloatArray:
    """Numbers as a read-only C-contiguous array, because kernels that only read are compiled only for such arrays."""
    array = np.ascontiguousarray(numbers, dtype=float).view()
    array.flags.writeable = False
    return array

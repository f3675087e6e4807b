"""The array types of this package, declared once; docstrings give shapes and units. What arrays lack without SciPy."""

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


def highest_around(values: FloatArray, rows: int, columns: int) -> FloatArray:
    """(n, m) the highest of (n, m) values in a window around each; the edges count only what is there.

    Equal to ``scipy.ndimage.maximum_filter`` without its 0.3 s to load, which each plan on steep ground would wait for.

    Args:
        values: without NaN.
        rows: height of the window, centred on row ``rows // 2`` of it.
        columns: width of the window, the same.
    """
    for size in (columns, rows):
        wide = np.pad(values.T, ((size // 2, size - 1 - size // 2), (0, 0)), constant_values=-np.inf)
        length = 1
        while 2 * length <= size:
            wide = np.maximum(wide[:-length], wide[length:])
            length *= 2
        # Now each has the highest of ``length`` from there on: two of these make a window.
        values = np.maximum(wide[: len(wide) - size + length], wide[size - length :])
    return values

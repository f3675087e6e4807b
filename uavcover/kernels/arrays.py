"""The array types of this package, declared once; docstrings give shapes and units."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
ByteArray = NDArray[np.uint8]

Point = tuple[float, float, float]
"""East, north, up, metres."""

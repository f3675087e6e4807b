"""What the latest routes see: a search judges the same route several times over, and the planner judges it once more."""

import threading
from collections import OrderedDict
from collections.abc import Callable

import numpy as np

from uavcover.kernels.arrays import BoolArray, FloatArray

_MOST_CELLS = 16_000_000
"""Of all routes together: as many bytes."""


class RecentlySeen:
    """The cells that the latest routes see, by route; the oldest go first."""

    def __init__(self, *, most_cells: int = _MOST_CELLS) -> None:
        self._most_cells = most_cells
        self._seen: OrderedDict[bytes, BoolArray] = OrderedDict()
        self._cells = 0
        # Routes are judged side by side.
        self._lock = threading.Lock()

    def get(self, route_m: FloatArray, find: Callable[[], BoolArray]) -> BoolArray:
        """(cells,) what an (n, 3) route sees, read-only; ``find`` is called where that is not known."""
        key = np.ascontiguousarray(route_m, dtype=float).tobytes()
        with self._lock:
            known = self._seen.get(key)
        if known is not None:
            return known
        found = find()
        found.flags.writeable = False
        with self._lock:
            if key not in self._seen:
                self._seen[key] = found
                self._cells += found.size
            while self._cells > self._most_cells:
                self._cells -= self._seen.popitem(last=False)[1].size
        return found

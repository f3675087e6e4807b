"""Cache of the cells that the latest routes observe. A search rates the same route several times, the planner once more."""

import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.arrays import FloatArray

Found = TypeVar("Found", bound=NDArray[Any])

_MOST_CELLS = 16_000_000
"""Cells of all routes together: as many bytes."""


class RecentlySeen:
    """The cells that the latest routes see, by route; the oldest go first."""

    def __init__(self, *, most_cells: int = _MOST_CELLS) -> None:
        self._most_cells = most_cells
        self._seen: OrderedDict[bytes, Any] = OrderedDict()
        self._cells = 0
        # Routes are judged side by side.
        self._lock = threading.Lock()

    def knows(self, route_m: FloatArray) -> bool:
        """Whether it is known what an (n, 3) route sees."""
        with self._lock:
            return _key(route_m) in self._seen

    def get(self, route_m: FloatArray, find: Callable[[], Found]) -> Found:
        """(cells,) what an (n, 3) route sees, or (bytes,) of it, read-only; ``find`` is called where that is not known."""
        key = _key(route_m)
        with self._lock:
            known: Found | None = self._seen.get(key)
        if known is not None:
            return known
        found = find()
        self.keep(route_m, found)
        return found

    def keep(self, route_m: FloatArray, found: NDArray[Any]) -> None:
        """Keep what an (n, 3) route sees."""
        key = _key(route_m)
        found.flags.writeable = False
        with self._lock:
            if key not in self._seen:
                self._seen[key] = found
                self._cells += found.size
            while self._cells > self._most_cells:
                self._cells -= self._seen.popitem(last=False)[1].size


def _key(route_m: FloatArray) -> bytes:
    return np.ascontiguousarray(route_m, dtype=float).tobytes()

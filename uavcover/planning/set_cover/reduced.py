"""The same choice with fewer places: what another place replaces is left out, and cells that count for nothing."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels import set_cover as kernels
from uavcover.planning.set_cover.candidates import Candidates

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Reduced:
    """A table of :mod:`uavcover.kernels.set_cover`: sets of classes of cells that the same places see.

    Attributes:
        numbers: (c,) the places that are left, as numbers of the candidates.
        start: (c + 1,).
        classes: numbers of classes, rising for each place.
        weight: (m,) share of each class in what can be covered at all, above 0; each is seen by some place.
    """

    numbers: NDArray[np.int64]
    start: NDArray[np.int64]
    classes: NDArray[np.int32]
    weight: FloatArray

    @property
    def reachable(self) -> float:
        """Share of what can be covered that all places together see, 0..1."""
        return float(self.weight.sum())


def reduce(candidates: Candidates) -> Reduced:
    """No choice among the candidates sees more than one as large among the places that are left.

    A place whose cells another one sees too is left out; cells that the same places see become one class.
    """
    count = candidates.weight.size
    start, cells = _with_cells(candidates.start, candidates.cells, candidates.weight > 0.0)
    numbers = np.flatnonzero(kernels.undominated(start, cells, count))
    start, cells = _some_sets(start, cells, numbers)
    back, places = kernels.transposed(start, cells, count)
    classes: dict[bytes, int] = {}
    class_of = np.full(count, -1, dtype=np.int32)
    # One cell stands for its class: the first, so that classes rise where cells do.
    stands = np.zeros(count, dtype=bool)
    weight: list[float] = []
    for cell in np.flatnonzero(np.diff(back)):
        number = classes.setdefault(places[back[cell] : back[cell + 1]].tobytes(), len(weight))
        if number == len(weight):
            weight.append(0.0)
            stands[cell] = True
        class_of[cell] = number
        weight[number] += float(candidates.weight[cell])
    start, cells = _with_cells(start, cells, stands)
    return Reduced(numbers, start, class_of[cells], np.array(weight))


def _with_cells(
    start: NDArray[np.int64], cells: NDArray[np.int32], keep: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """The table with the cells alone that ``keep`` (n,) marks."""
    kept = keep[cells]
    before = np.concatenate([[0], np.cumsum(kept)])
    return before[start], cells[kept]


def _some_sets(
    start: NDArray[np.int64], cells: NDArray[np.int32], numbers: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """The table of some of the sets, rising numbers."""
    sizes = np.diff(start)
    keep = np.zeros(sizes.size, dtype=bool)
    keep[numbers] = True
    return np.concatenate([[0], np.cumsum(sizes[numbers])]), cells[np.repeat(keep, sizes)]

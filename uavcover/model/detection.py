"""Probability that one look finds the object, as measured or assumed."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from uavcover.kernels.detection import DetectionTable

Independent = Literal["sides", "pictures", "none"]
INDEPENDENT: tuple[Independent, ...] = ("sides", "pictures", "none")


@dataclass(frozen=True, slots=True, eq=False)
class DetectionCurve:
    """The probability that a look finds the target, over ground sample distance and angle off the vertical.

    Attributes:
        name: in the table that comes with the package, or of the file.
        title: for people.
        source: where the values are from.
        table: of it.
        independent: which looks at one place count as independent chances: the best from each side (``sides``), every photo
            (``pictures``), or only the best of all (``none``).
        is_example: whether it comes with the package: a rule of thumb that was not measured for these photos.
    """

    name: str
    title: str
    source: str
    table: DetectionTable
    independent: Independent = "sides"
    is_example: bool = False

    @property
    def half_at_m(self) -> float:
        """The coarsest ground sample distance with which half of the looks straight down find the target; NaN: none."""
        found = np.flatnonzero(self.table.probability[0] >= 0.5)
        return float(self.table.sample_m[found[-1]]) if found.size else float("nan")

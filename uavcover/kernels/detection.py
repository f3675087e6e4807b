"""How probably a look finds what is searched for, and what several looks at one place come to.

A look is one picture that shows the place. Its probability is read from a table over ground sample distance and angle off the
vertical. The first has the obliqueness of the ground in it (:func:`uavcover.kernels.sight.ground_sample_m`); the second stands
for what rises from the ground and hides more the flatter the view is.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.jit import allocating_kernel, kernel

SIDES = 5
"""From above (within ``ABOVE_WITHIN_DEG`` of the vertical), or from the north, the east, the south or the west."""
ABOVE_WITHIN_DEG = 45.0


class DetectionTable(NamedTuple):
    """Probabilities that one look finds the target; read-only arrays.

    Attributes:
        sample_m: (k,) ground sample distances, increasing.
        off_vertical_deg: (m,) angles of the line of sight off the vertical, increasing from 0.
        probability: (m, k).
    """

    sample_m: NDArray[np.float64]
    off_vertical_deg: NDArray[np.float64]
    probability: NDArray[np.float64]


def detection_table(
    sample_m: NDArray[np.float64], off_vertical_deg: NDArray[np.float64], probability: NDArray[np.float64]
) -> DetectionTable:
    """A table of read-only copies."""
    table = DetectionTable(
        *(np.array(part, dtype=float, order="C") for part in (sample_m, off_vertical_deg, probability))
    )
    for part in table:
        part.flags.writeable = False
    return table


NO_DETECTION = detection_table(np.empty(0), np.empty(0), np.empty((0, 0)))


class Looks(NamedTuple):
    """What the looks at each of (n,) cells come to; (0,) and (0, SIDES) where nobody asks.

    Attributes:
        missed: (n,) probability that all of them miss the target, each look independent of the others.
        best: (n, SIDES) probability of the best look from each side.
    """

    missed: NDArray[np.float64]
    best: NDArray[np.float64]


def no_looks(count: int) -> Looks:
    """At ``count`` cells."""
    return Looks(np.ones(count), np.zeros((count, SIDES)))


@allocating_kernel
def look_probability(table: DetectionTable, sample_m: float, off_vertical_deg: float) -> float:
    """Probability that a look finds the target: bilinear in the table.

    Finer than its first ground sample distance counts as that one; coarser than the last, or flatter than the last angle: 0.
    """
    samples, angles = table.sample_m, table.off_vertical_deg
    if not (sample_m <= samples[-1] and off_vertical_deg <= angles[-1]):
        return 0.0
    j = min(max(int(np.searchsorted(samples, sample_m)) - 1, 0), max(samples.size - 2, 0))
    i = min(max(int(np.searchsorted(angles, off_vertical_deg)) - 1, 0), max(angles.size - 2, 0))
    right, below = min(j + 1, samples.size - 1), min(i + 1, angles.size - 1)
    width, height = samples[right] - samples[j], angles[below] - angles[i]
    x = min(1.0, max(0.0, (sample_m - samples[j]) / width)) if width > 0.0 else 0.0
    y = min(1.0, max(0.0, (off_vertical_deg - angles[i]) / height)) if height > 0.0 else 0.0
    upper = (1.0 - x) * table.probability[i, j] + x * table.probability[i, right]
    lower = (1.0 - x) * table.probability[below, j] + x * table.probability[below, right]
    return float((1.0 - y) * upper + y * lower)


@kernel
def note_look(table: DetectionTable, looks: Looks, cell: int, sample_m: float, de: float, dn: float, du: float) -> None:
    """Add a look from (de, dn, du), metres from the cell, to ``looks``."""
    off_vertical_deg = math.degrees(math.atan2(math.hypot(de, dn), du))
    found = look_probability(table, sample_m, off_vertical_deg)
    side = 0
    if off_vertical_deg > ABOVE_WITHIN_DEG:
        side = 1 + math.floor(math.degrees(math.atan2(de, dn)) / 90.0 + 0.5) % 4
    looks.missed[cell] *= 1.0 - found
    looks.best[cell, side] = max(looks.best[cell, side], found)

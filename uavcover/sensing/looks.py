"""Group photos into looks: photos from one position in one direction count once, for any number of files.

A reconstruction needs views from different places. Bands of a multispectral camera, bursts, and photos of a vehicle that hovers
show the ground from one place, so together they count once.
"""

from collections.abc import Sequence

import numpy as np

from uavcover.kernels.arrays import FloatArray, IntArray
from uavcover.model.scenario import Scenario
from uavcover.sensing.sensors import trigger_distance_m

SPACING_FRACTION = 0.25
"""Photos closer than this fraction of the forward spacing are one look."""
_MOST_OF_SPACING = 0.5
"""However uncertain places are, photos farther apart than this fraction of the forward spacing are two looks."""
_ALIKE_DEG = 30.0
"""Views that differ by less have a like direction."""
_LONGEST_CAPTURE_M = 20.0
"""Files of one capture lie closer: its bands are up to 1 s apart, at up to 20 m/s. An id that covers more is no capture's."""


def look_distance_m(scenario: Scenario, error_m: FloatArray) -> FloatArray:
    """(n,) distance within which a photo is one look with another of like direction.

    It is the larger of its position error and a fraction of the forward spacing.

    Args:
        scenario: with the camera, and its forward spacing where there is one.
        error_m: (n,) errors of the photos' places.
    """
    spacing_m = trigger_distance_m(scenario)
    if spacing_m is None:
        return error_m
    return np.clip(error_m, SPACING_FRACTION * spacing_m, _MOST_OF_SPACING * spacing_m)


def looks_of(
    places_m: FloatArray, axes: FloatArray, closer_m: FloatArray, captures: Sequence[str | None] | None = None
) -> IntArray:
    """(n,) number of the look that each photo belongs to, counted from 0 in order of the first photo of each.

    A photo belongs to the first look whose first photo is closer than ``closer_m`` across the view, with a like direction;
    heights along the view do not make another look. Photos of one capture id are one look.

    Args:
        places_m: (n, 3) ENU positions.
        axes: (n, 3) unit vectors along the views.
        closer_m: (n,) distances, see :func:`look_distance_m`.
        captures: (n,) capture ids; none where a photo has none.

    >>> places = np.array([[0.0, 0.0, 80.0], [0.1, 0.0, 80.0], [20.0, 0.0, 80.0], [20.0, 0.5, 95.0]])
    >>> looks_of(places, np.tile([0.0, 0.0, -1.0], (4, 1)), np.full(4, 5.0)).tolist()
    [0, 0, 1, 1]
    """
    count = len(places_m)
    found = np.full(count, -1, dtype=np.int64)
    first = np.empty(count, dtype=np.int64)
    looks = 0
    of_capture = _captures(places_m, captures)
    known: dict[int, int] = {}
    alike = np.cos(np.radians(_ALIKE_DEG))
    for k in range(count):
        if of_capture[k] in known:
            found[k] = known[of_capture[k]]
            continue
        leaders = first[:looks]
        offsets = places_m[leaders] - places_m[k]
        along = np.einsum("ij,ij->i", offsets, axes[leaders])
        across2 = np.einsum("ij,ij->i", offsets, offsets) - along * along
        same = np.flatnonzero((across2 <= closer_m[k] ** 2) & (axes[leaders] @ axes[k] >= alike))
        if same.size:
            found[k] = same[0]
        else:
            found[k], first[looks] = looks, k
            looks += 1
        if of_capture[k] >= 0:
            known[of_capture[k]] = int(found[k])
    return found


def _captures(places_m: FloatArray, captures: Sequence[str | None] | None) -> list[int]:
    """(n,) the number of each photo's capture, -1 without one: also for ids of more than one place."""
    numbers: dict[str, list[int]] = {}
    for k, capture in enumerate(captures or ()):
        if capture is not None:
            numbers.setdefault(capture, []).append(k)
    out = [-1] * len(places_m)
    for number, members in enumerate(numbers.values()):
        spread_m = np.linalg.norm(places_m[members] - places_m[members[0]], axis=1).max()
        if spread_m <= _LONGEST_CAPTURE_M:
            for k in members:
                out[k] = number
    return out

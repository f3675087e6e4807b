"""When the samples of a track were taken, on the clock of the ground station that received them.

A vehicle's own time begins when it is switched on, so it says nothing about other vehicles. What all share is the clock on which
their positions arrived. A position may arrive late, and never early: near every sample, the one that was least late tells how the
two clocks stand to each other.
"""

from dataclasses import dataclass

import numpy as np

from uavcover.kernels.arrays import FloatArray
from uavcover.model.track import Track

_WINDOW_S = 30.0
"""So far before and after a sample the least late one is looked for, vehicle time: clocks drift, and simulations wait."""


@dataclass(frozen=True, slots=True, eq=False)
class SharedTimes:
    """The samples of a track on the shared clock.

    Attributes:
        taken_utc_s: (n,) when each sample was taken, not decreasing.
        pace: seconds of the shared clock in a second of vehicle time; below 1 for a simulation that runs fast.
    """

    taken_utc_s: FloatArray
    pace: float


def shared_times(track: Track) -> SharedTimes | None:
    """The samples of a track on the shared clock; none where times of arrival are missing, or go back."""
    received, own = track.received_utc_s, track.time_s
    if len(track) < 2 or not np.isfinite(received).all() or (np.diff(received) < 0.0).any():
        return None
    pace = float((received[-1] - received[0]) / (own[-1] - own[0]))
    if not pace > 0.0:
        return None
    late_s = received - pace * own
    first = np.searchsorted(own, own - _WINDOW_S)
    last = np.searchsorted(own, own + _WINDOW_S, side="right")
    least = np.array([late_s[a:b].min() for a, b in zip(first, last, strict=True)])
    return SharedTimes(np.maximum.accumulate(np.minimum(pace * own + least, received)), pace)

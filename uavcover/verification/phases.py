"""Which part of a track is the planned route, and which stretches of it were really observed."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavcover.model.track import Track

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class PlannedRoute:
    """What verification may know of the plan: where it led and what it promised.

    Attributes:
        waypoints_m: (n, 3) ENU.
        coverage_fraction: share of the area that the plan promised to see, 0..1.
    """

    waypoints_m: FloatArray
    coverage_fraction: float


def on_route(track: Track, enu_m: FloatArray, planned: PlannedRoute | None) -> BoolArray:
    """(n,) whether each sample lies between the first and the last planned waypoint.

    By ``current_waypoint`` where the track has it: on the way to waypoint 1 or later. Otherwise from the sample nearest
    the first planned waypoint to the one nearest the last. Without a plan the whole track counts.
    """
    if (track.current_waypoint >= 0).any():
        last = int(track.current_waypoint.max())
        return np.asarray(track.current_waypoint >= min(1, last))
    if planned is None or len(planned.waypoints_m) == 0:
        return np.ones(len(track), dtype=bool)
    first = int(np.argmin(np.linalg.norm(enu_m - planned.waypoints_m[0], axis=1)))
    final = int(np.argmin(np.linalg.norm(enu_m - planned.waypoints_m[-1], axis=1)))
    mask = np.zeros(len(track), dtype=bool)
    mask[min(first, final) : max(first, final) + 1] = True
    return mask


def observed_stretches(track: Track, mask: BoolArray, *, max_gap_s: float) -> list[NDArray[np.int64]]:
    """Runs of sample numbers inside ``mask`` whose neighbours are at most ``max_gap_s`` apart.

    What lies between two runs was not observed: it is neither seen nor safe by assumption.
    """
    chosen = np.flatnonzero(mask)
    if chosen.size == 0:
        return []
    breaks = (np.diff(chosen) > 1) | (np.diff(track.time_s[chosen]) > max_gap_s)
    return [np.asarray(run, dtype=np.int64) for run in np.split(chosen, np.flatnonzero(breaks) + 1)]

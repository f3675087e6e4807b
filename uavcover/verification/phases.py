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


def on_route(track: Track, enu_m: FloatArray, planned: PlannedRoute | None, *, acceptance_radius_m: float) -> BoolArray:
    """(n,) whether each sample lies between the first and the last planned waypoint.

    By ``current_waypoint`` where the track has it: on the way to waypoint 1 or later. A vehicle goes on to the next
    waypoint within its acceptance radius, so the route begins and ends up to that far from its ends. A track that never
    got beyond the way to waypoint 0 has no sample on the route, except that a plan of one waypoint is passed once.

    A track that never says which waypoint it flies to is judged by its places: from where it first came nearest to the
    first planned waypoint to where it last came nearest to the last one; "near" is the smallest distance and the
    acceptance radius. Without a plan the whole track counts.

    Args:
        track: what was flown.
        enu_m: (n, 3) its positions.
        planned: the plan, if there is one.
        acceptance_radius_m: of the vehicle.
    """
    single = planned is not None and len(planned.waypoints_m) == 1
    if (track.current_waypoint >= 0).any() and not single:
        return np.asarray(track.current_waypoint >= 1)
    if planned is None or len(planned.waypoints_m) == 0:
        return np.ones(len(track), dtype=bool)
    mask = np.zeros(len(track), dtype=bool)
    first = _nearest(enu_m, planned.waypoints_m[0], acceptance_radius_m)
    last = len(track) - 1 - _nearest(enu_m[::-1], planned.waypoints_m[-1], acceptance_radius_m)
    mask[min(first, last) : max(first, last) + 1] = True
    return mask


def _nearest(enu_m: FloatArray, point_m: FloatArray, radius_m: float) -> int:
    """Number of the nearest sample of the first approach that comes as near to a (3,) point as any, give or take."""
    distance = np.linalg.norm(enu_m - point_m, axis=1)
    near = distance <= distance.min() + radius_m
    begin = int(np.argmax(near))
    end = begin + int(np.argmin(near[begin:])) if not near[begin:].all() else len(near)
    return begin + int(np.argmin(distance[begin:end]))


def observed_stretches(track: Track, mask: BoolArray, *, max_gap_s: float) -> list[NDArray[np.int64]]:
    """Runs of sample numbers inside ``mask`` whose neighbours are at most ``max_gap_s`` apart.

    What lies between two runs was not observed: it is neither seen nor safe by assumption.
    """
    chosen = np.flatnonzero(mask)
    if chosen.size == 0:
        return []
    breaks = (np.diff(chosen) > 1) | (np.diff(track.time_s[chosen]) > max_gap_s)
    return [np.asarray(run, dtype=np.int64) for run in np.split(chosen, np.flatnonzero(breaks) + 1)]

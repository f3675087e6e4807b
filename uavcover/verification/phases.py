"""Find the part of a track that is the planned route, and its observed stretches."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.model.track import Track
from uavcover.verification.waypoints_passed import Passing


@dataclass(frozen=True, slots=True, eq=False)
class PlannedRoute:
    """The part of a plan that verification may use: its waypoints and its promised coverage."""

    waypoints_m: FloatArray  # (n, 3) ENU positions
    coverage_fraction: float  # fraction of the area that the plan promised to cover, 0..1


def on_route(
    track: Track,
    enu_m: FloatArray,
    planned: PlannedRoute | None,
    *,
    acceptance_radius_m: float,
    passed: Passing | None = None,
    believed: bool = True,
) -> BoolArray:
    """(n,) whether each sample lies between the first and the last planned waypoint; one stretch.

    By ``current_waypoint`` where the track has it and it is credible: from the first sample heading for waypoint 1 or later to
    the last such sample, with any numbers in between. A vehicle turns to the next waypoint within its acceptance radius,
    so the route begins and ends up to that far from its ends. Where the positions show that more of the plan was flown
    before or after, that belongs to the route too: a missing number must not relax the judgement. A track that never got
    beyond waypoint 0 has no sample on the route, except that a plan of one waypoint is passed once.

    Otherwise by positions: from the first nearest approach to the first planned waypoint to the last nearest approach to the
    last one, where "near" means the smallest distance plus the acceptance radius. Without a plan the whole track counts.

    Args:
        track: what was flown.
        enu_m: (n, 3) its positions.
        planned: the plan, if there is one.
        acceptance_radius_m: of the vehicle.
        passed: where the track passed the planned waypoints, if known.
        believed: whether the numbers agree with the positions.
    """
    mask = np.zeros(len(track), dtype=bool)
    numbers = track.current_waypoint
    single = planned is not None and len(planned.waypoints_m) == 1
    if (numbers >= 0).any() and not single and believed:
        numbered = np.flatnonzero(numbers >= 1)
        span = [int(numbered[0]), int(numbered[-1])] if numbered.size else []
        for sample in _beyond(numbers, span, passed):
            span = [min([*span, sample]), max([*span, sample])]
        if span:
            mask[span[0] : span[1] + 1] = True
        return mask
    if planned is None or len(planned.waypoints_m) == 0:
        return np.ones(len(track), dtype=bool)
    first = _nearest(enu_m, planned.waypoints_m[0], acceptance_radius_m)
    last = len(track) - 1 - _nearest(enu_m[::-1], planned.waypoints_m[-1], acceptance_radius_m)
    mask[min(first, last) : max(first, last) + 1] = True
    return mask


def _beyond(numbers: NDArray[np.int64], span: list[int], passed: Passing | None) -> list[int]:
    """Samples outside the span at which planned waypoints were passed that the numbers do not show.

    One waypoint can be passed by chance, as on a straight flight home; two in order, or the end of the route, belong to it.
    """
    if passed is None:
        return []
    waypoints = np.flatnonzero(passed.passed)
    at = passed.samples[waypoints]
    if not span:
        return [int(at[0]), int(at[-1])] if waypoints.size >= 2 else []
    first_told, last_told = int(numbers[span[0]]), int(numbers[span[1]])
    before = at[(at < span[0]) & (waypoints < first_told - 1)]
    after = at[(at > span[1]) & (waypoints >= last_told)]
    ends = waypoints[(at > span[1]) & (waypoints >= last_told)]
    found = [int(before[0])] if before.size >= 2 or (before.size and waypoints[0] == 0) else []
    if after.size >= 2 or (after.size and last_told < len(passed.samples) - 1 and ends[-1] == len(passed.samples) - 1):
        found.append(int(after[-1]))
    return found


def _nearest(enu_m: FloatArray, point_m: FloatArray, radius_m: float) -> int:
    """Number of the nearest sample of the first approach about as near to a (3,) point as any."""
    distance = np.linalg.norm(enu_m - point_m, axis=1)
    near = distance <= distance.min() + radius_m
    begin = int(np.argmax(near))
    end = begin + int(np.argmin(near[begin:])) if not near[begin:].all() else len(near)
    return begin + int(np.argmin(distance[begin:end]))


def observed_stretches(mask: BoolArray, joined: BoolArray) -> list[NDArray[np.int64]]:
    """Runs of sample numbers inside ``mask`` (n,), each ``joined`` (n - 1,) to the next.

    What lies between two runs was not observed: neither coverage nor safety is assumed there.
    """
    chosen = np.flatnonzero(mask)
    if chosen.size == 0:
        return []
    breaks = (np.diff(chosen) > 1) | ~joined[chosen[:-1]]
    return [np.asarray(run, dtype=np.int64) for run in np.split(chosen, np.flatnonzero(breaks) + 1)]

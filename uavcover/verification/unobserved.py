"""Unobserved stretches of a flight, and what may have been seen from them."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.arrays import BoolArray, FloatArray, IntArray
from uavcover.model.track import Track
from uavcover.model.verdict import Unobserved, UnobservedReason
from uavcover.scenario.site import Site
from uavcover.verification.possible_motion import MAX_JUMP_M, Motion
from uavcover.verification.waypoints_passed import Passing

# Find the part of a track that is the planned route, and its observed stretches.


@dataclass(frozen=True, slots=True, eq=False)
class PlannedRoute:
    """The part of a plan that verification may use: its waypoints and its promised coverage."""

    waypoints_m: FloatArray  # (n, 3) ENU positions
    coverage_fraction: float  # fraction of the area that the plan promised to cover, 0..1


def on_route(
    track: Track,  # what was flown
    enu_m: FloatArray,  # (n, 3) its positions
    planned: PlannedRoute | None,  # the plan, if there is one
    *,
    acceptance_radius_m: float,  # of the vehicle
    passed: Passing | None = None,  # where the track passed the planned waypoints, if known
    believed: bool = True,  # whether the numbers agree with the positions
) -> BoolArray:
    """(n,) whether each sample lies between the first and the last planned waypoint; one stretch.

    By ``current_waypoint`` where the track has it and it is credible: from the first sample heading for waypoint 1 or later to
    the last such sample, with any numbers in between. A vehicle turns to the next waypoint within its acceptance radius,
    so the route begins and ends up to that far from its ends. Where the positions show that more of the plan was flown
    before or after, that belongs to the route too: a missing number must not relax the judgement. A track that never got
    beyond waypoint 0 has no sample on the route, except that a plan of one waypoint is passed once.

    Otherwise by positions: from the first nearest approach to the first planned waypoint to the last nearest approach to the
    last one, where "near" means the smallest distance plus the acceptance radius. Without a plan the whole track counts.
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


def place_of(site: Site, enu_m: FloatArray) -> str:
    """A position as text: latitude and longitude, or local metres where the scenario is not georeferenced."""
    if site.frame is None:
        return f"{enu_m[0]:.0f} m east, {enu_m[1]:.0f} m north"
    lat, lon, _ = site.frame.geodetic_from_enu(enu_m)
    return f"{float(lat[0]):.6f}, {float(lon[0]):.6f}"


def unobserved_stretches(
    site: Site, track: Track, enu_m: FloatArray, joined: BoolArray, route: BoolArray, motion: Motion, kept: IntArray
) -> Iterator[Unobserved]:
    """The unobserved stretches between samples that are not joined.

    Args:
        site: the scenario on its ground.
        track: the samples that are evidence.
        enu_m: (n, 3) their positions.
        joined: (n - 1,) legs that were observed.
        route: (n,) which samples belong to the planned route.
        motion: motion of the track as recorded.
        kept: (n,) numbers of the samples in the track as recorded.
    """
    # Before its first move and after its last one the vehicle stands on the ground.
    moved = np.flatnonzero(np.linalg.norm(enu_m - enu_m[0], axis=1) > MAX_JUMP_M)
    moving = np.flatnonzero(np.linalg.norm(enu_m - enu_m[-1], axis=1) > MAX_JUMP_M)
    for k in np.flatnonzero(~joined):
        seconds = float(track.time_s[k + 1] - track.time_s[k])
        moves = [move for move in motion.moves if move.first < kept[k + 1] and move.last > kept[k]]
        reason: UnobservedReason = "impossible motion" if moves else "no samples"
        yield stretch_at(
            site, enu_m[k], reason=reason,
            detail=f"impossible motion: {moves[0]}" if moves else f"{seconds:.1f} s without samples",
            span_s=(float(track.time_s[k]), float(track.time_s[k + 1])),
            length_m=float(np.linalg.norm(enu_m[k + 1] - enu_m[k])), on_route=bool(route[k] or route[k + 1]),
            in_flight=bool(moved.size and moving.size and k + 1 >= moved[0] and k <= moving[-1]),
        )  # fmt: skip


def stretch_at(
    site: Site, enu_m: FloatArray, *, reason: UnobservedReason, detail: str, span_s: tuple[float, float],
    length_m: float, on_route: bool, in_flight: bool = True,
) -> Unobserved:  # fmt: skip
    """An unobserved stretch that begins at a (3,) position; ``span_s`` is its first and last moment."""
    lat, lon = np.full(1, np.nan), np.full(1, np.nan)
    if site.frame is not None:
        lat, lon, _ = site.frame.geodetic_from_enu(enu_m)
    return Unobserved(
        reason=reason, detail=detail, start_s=span_s[0], end_s=span_s[1], length_m=length_m,
        lat_deg=float(lat[0]), lon_deg=float(lon[0]), east_m=float(enu_m[0]), north_m=float(enu_m[1]),
        phase="route" if on_route else "transit", in_flight=in_flight,
    )  # fmt: skip


def way_before_m(planned: PlannedRoute | None, passed: Passing | None) -> FloatArray:
    """(k, 3) the planned route up to the first waypoint that was passed; empty without a plan."""
    if planned is None or passed is None:
        return np.empty((0, 3))
    reached = np.flatnonzero(passed.passed)
    return planned.waypoints_m[: int(reached[0]) + 1] if reached.size else planned.waypoints_m


def way_after_m(planned: PlannedRoute | None, passed: Passing | None) -> FloatArray:
    """(k, 3) the planned route from the last waypoint that was passed; empty without a plan."""
    if planned is None or passed is None:
        return np.empty((0, 3))
    reached = np.flatnonzero(passed.passed)
    return planned.waypoints_m[int(reached[-1]) :] if reached.size else planned.waypoints_m


def ways_between_m(
    enu_m: FloatArray, joined: BoolArray, route: BoolArray, planned: PlannedRoute | None, passed: Passing | None
) -> Iterator[FloatArray]:
    """A (k, 3) path for each unobserved stretch of the route: straight, or through the planned waypoints in between."""
    for k in np.flatnonzero(~joined & (route[:-1] | route[1:])):
        between = np.empty((0, 3))
        if planned is not None and passed is not None:
            done = np.flatnonzero((passed.samples >= 0) & (passed.samples <= k))
            ahead = np.flatnonzero(passed.samples > k)
            first = int(done[-1]) + 1 if done.size else 0
            last = int(ahead[0]) if ahead.size else len(planned.waypoints_m)
            between = planned.waypoints_m[first : max(first, last)]
        yield np.vstack([enu_m[k], between, enu_m[k + 1]])


def length_of_m(path_m: FloatArray) -> float:
    """Length of an (n, 3) path."""
    return float(np.linalg.norm(np.diff(path_m, axis=0), axis=1).sum())

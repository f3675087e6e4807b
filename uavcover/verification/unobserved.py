"""Unobserved stretches of a flight, and what may have been seen from them."""

from collections.abc import Iterator

import numpy as np

from uavcover.kernels.arrays import BoolArray, FloatArray, IntArray
from uavcover.model.track import Track
from uavcover.model.verdict import Unobserved, UnobservedReason
from uavcover.scenario.site import Site
from uavcover.verification.phases import PlannedRoute
from uavcover.verification.possible_motion import MAX_JUMP_M, Motion
from uavcover.verification.waypoints_passed import Passing


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

"""Keep flights apart in space and time: find the starts that bring two flights too close, and the positions.

A vehicle may be early or late: at its start by ``start_error_s``, and on its way by a share of the time since take-off. Wherever
two paths come nearer than the separation, the times at which the two vehicles may be there must not overlap; so every such pair
of pieces excludes an interval of the difference between the two starts, and all of them together say which starts are safe. A
vehicle also stands at home for a while before its take-off and after its landing. ``tests/naive/fleet.py`` looks at every moment.
"""

import math
from dataclasses import dataclass

import numpy as np

from uavcover.kernels.arrays import FloatArray, IntArray
from uavcover.missions.timeline import Timeline
from uavcover.model.vehicle import Fleet

_LONGEST_PIECE_M = 10.0
_ROOM_S = 1e-6
"""Beside an excluded interval, so that rounding does not fall back into it."""


@dataclass(frozen=True, slots=True, eq=False)
class PathPieces:
    """A flight as short straight pieces, each with the time in which the vehicle may be there."""

    begin_m: FloatArray  # (n, 3) ENU metres
    end_m: FloatArray  # (n, 3) ENU metres
    earliest_s: FloatArray  # (n,) since the planned take-off
    latest_s: FloatArray  # (n,) since the planned take-off


def pieces_of(timeline: Timeline, fleet: Fleet) -> PathPieces:
    """A flight in pieces of at most ten metres, with its time on the ground at home before and after."""
    times, places = timeline.time_s, timeline.place_m
    lengths = np.linalg.norm(np.diff(places, axis=0), axis=1)
    parts = np.maximum(1, np.ceil(lengths / _LONGEST_PIECE_M)).astype(int)
    leg = np.repeat(np.arange(len(parts)), parts)
    number = np.arange(len(leg)) - np.repeat(np.cumsum(parts) - parts, parts)
    begin, end = number / parts[leg], (number + 1) / parts[leg]

    def at(values: FloatArray, share: FloatArray) -> FloatArray:
        share = share.reshape(-1, *[1] * (values.ndim - 1))
        return np.asarray((1.0 - share) * values[leg] + share * values[leg + 1])

    begin_s, end_s = at(times, begin), at(times, end)
    begin_s = np.concatenate([[-fleet.pad_s], begin_s, [times[-1]]])
    end_s = np.concatenate([[0.0], end_s, [times[-1] + fleet.pad_s]])
    return PathPieces(
        begin_m=np.vstack([places[:1], at(places, begin), places[-1:]]),
        end_m=np.vstack([places[:1], at(places, end), places[-1:]]),
        earliest_s=begin_s - late_s(begin_s, fleet),
        latest_s=end_s + late_s(end_s, fleet),
    )


def late_s(time_s: FloatArray, fleet: Fleet) -> FloatArray:
    """Seconds by which a vehicle may be early or late at a planned time since its take-off."""
    return np.asarray(fleet.timing_error_fraction * np.maximum(time_s, 0.0) + fleet.start_error_s)


def unsafe_starts(a: PathPieces, b: PathPieces, fleet: Fleet) -> FloatArray:
    """Excluded differences of two starts.

    Returns:
        (k, 2) open intervals of b's start less a's in seconds, sorted, without overlaps.
    """
    first, second, _ = near_pieces(a, b, fleet.planned_separation_m)
    return merged(np.column_stack([a.earliest_s[first] - b.latest_s[second], a.latest_s[first] - b.earliest_s[second]]))


class UnsafeStarts:
    """:func:`unsafe_starts` of pairs of flights, each found once.

    Args:
        fleet: what keeps the vehicles apart.
    """

    def __init__(self, fleet: Fleet) -> None:
        self._fleet = fleet
        self._pieces: dict[Timeline, PathPieces] = {}
        self._found: dict[tuple[Timeline, Timeline], FloatArray] = {}

    def between(self, a: Timeline, b: Timeline) -> FloatArray:
        """As :func:`unsafe_starts`."""
        if (a, b) not in self._found:
            self._found[a, b] = found = unsafe_starts(self._of(a), self._of(b), self._fleet)
            self._found[b, a] = -found[::-1, ::-1]
        return self._found[a, b]

    def _of(self, timeline: Timeline) -> PathPieces:
        if timeline not in self._pieces:
            self._pieces[timeline] = pieces_of(timeline, self._fleet)
        return self._pieces[timeline]


def merged(intervals: FloatArray) -> FloatArray:
    """(m, 2) open intervals as (k, 2) sorted ones that do not overlap."""
    if len(intervals) == 0:
        return np.empty((0, 2))
    ordered = intervals[np.argsort(intervals[:, 0], kind="stable")]
    reach = np.maximum.accumulate(ordered[:, 1])
    begins = np.concatenate([[True], ordered[1:, 0] >= reach[:-1]])
    last = np.concatenate([np.flatnonzero(begins)[1:] - 1, [len(ordered) - 1]])
    return np.column_stack([ordered[begins, 0], reach[last]])


def safe_start_s(intervals: FloatArray, wanted_s: float) -> float:
    """The least safe difference of two starts that is not below the wanted one; see :func:`unsafe_starts`."""
    k = int(np.searchsorted(intervals[:, 0], wanted_s, side="left")) - 1
    if k >= 0 and wanted_s < intervals[k, 1]:
        return float(intervals[k, 1]) + _ROOM_S
    return wanted_s


def near_pieces(a: PathPieces, b: PathPieces, separation_m: float) -> tuple[IntArray, IntArray, FloatArray]:
    """Pairs of pieces that are nearer than the separation: their numbers, (m,) each, and their distances."""
    from scipy.spatial import cKDTree  # a third of a second to load, and one vehicle needs none

    half_a = 0.5 * np.linalg.norm(a.end_m - a.begin_m, axis=1)
    half_b = 0.5 * np.linalg.norm(b.end_m - b.begin_m, axis=1)
    reach_m = separation_m + float(half_a.max() + half_b.max())
    tree_a, tree_b = cKDTree(0.5 * (a.begin_m + a.end_m)), cKDTree(0.5 * (b.begin_m + b.end_m))
    lists = tree_a.query_ball_tree(tree_b, reach_m)
    first = np.repeat(np.arange(len(lists)), [len(near) for near in lists])
    second = np.array([k for near in lists for k in near], dtype=np.int64)
    distance_m = segment_distances_m(a.begin_m[first], a.end_m[first], b.begin_m[second], b.end_m[second])
    kept = distance_m < separation_m
    return first[kept], second[kept], distance_m[kept]


def segment_distances_m(p0: FloatArray, p1: FloatArray, q0: FloatArray, q1: FloatArray) -> FloatArray:
    """(n,) distances between straight pieces p0 p1 and q0 q1, each (n, 3).

    The nearest two points are inside both pieces, or one of them is an end.
    """
    if len(p0) == 0:
        return np.empty(0)
    u, v, w = p1 - p0, q1 - q0, p0 - q0
    uu, uv, vv = (np.einsum("ij,ij->i", x, y) for x, y in ((u, u), (u, v), (v, v)))
    uw, vw = np.einsum("ij,ij->i", u, w), np.einsum("ij,ij->i", v, w)
    found = np.minimum(_from_points_m(p0, q0, v, vv), _from_points_m(p1, q0, v, vv))
    found = np.minimum(found, np.minimum(_from_points_m(q0, p0, u, uu), _from_points_m(q1, p0, u, uu)))
    size = uu * vv - uv * uv
    with np.errstate(divide="ignore", invalid="ignore"):
        s, t = (uv * vw - vv * uw) / size, (uu * vw - uv * uw) / size
        inside = (size > 1e-12 * uu * vv) & (s >= 0.0) & (s <= 1.0) & (t >= 0.0) & (t <= 1.0)
        across = np.linalg.norm(w + s[:, None] * u - t[:, None] * v, axis=1)
    return np.asarray(np.where(inside, np.minimum(found, across), found))


def _from_points_m(points: FloatArray, begin: FloatArray, along: FloatArray, squared: FloatArray) -> FloatArray:
    """(n,) distances of points from pieces that begin there and go along so."""
    to = points - begin
    share = np.einsum("ij,ij->i", to, along) / np.where(squared > 0.0, squared, math.inf)
    return np.asarray(np.linalg.norm(to - np.clip(share, 0.0, 1.0)[:, None] * along, axis=1))

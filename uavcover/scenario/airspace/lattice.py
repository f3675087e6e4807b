"""Shortest paths over a lattice of permitted positions, where straight legs do not keep the limits.

On ground that is steeper than a leg may climb, such a path follows contours, or climbs in zigzags.
"""

import itertools
import math
from collections.abc import Callable

import numpy as np
import scipy
import shapely

from uavcover.kernels.arrays import BoolArray, FloatArray, IntArray
from uavcover.scenario.airspace.zones import Polygons
from uavcover.terrain.frames import Bounds

_FRACTIONS = (0.02, 0.5, 0.98)
"""Positions of a point of the lattice, near both ends and in the middle of its height band."""

_LINKS = ((0, 1), (1, 0), (1, 1), (1, -1), (1, 2), (2, 1), (1, -2), (2, -1), (1, 3), (3, 1), (1, -3), (3, -1))
"""Neighbours of a lattice point, and their opposites: some link is within 9 degrees of any contour."""

_UPRIGHT = 3.0
"""Cost of a metre straight up or down, in metres: multirotors climb and descend at about a third of their cruise speed."""

_NEAR_SPOTS = 24
"""Lattice points that are linked with the end of a path."""

_TRIED_TOGETHER, _KEPT_COLUMNS = 16, 16
"""Last legs of a path that are checked at once, the shortest paths first; and columns whose paths are kept."""


class Lattice:
    """Positions inside a band of heights, with the legs between them that keep the limits.

    Attributes:
        positions_m: (n, 3) the positions.
        links: (k, 2) numbers of those that a leg joins.
    """

    def __init__(
        self,
        polygon: Polygons,  # permitted ground
        around_m: Bounds,  # what is to be reached: west, south, east, north
        band_m: Callable[[FloatArray], tuple[FloatArray, FloatArray]],  # lowest and highest up (n,) at (n, 2) positions
        # (n,) whether the legs between (n, 3) positions keep the limits; neighbours in the list are close to each other
        allowed: Callable[[FloatArray, FloatArray], BoolArray],
        *,
        spots: int,  # points on the map
    ) -> None:
        self._allowed = allowed
        self._paths: dict[bytes, tuple[FloatArray, FloatArray, IntArray]] = {}
        # Ways far beyond what is to be reached are no use: neither in a wide fence, nor around a part of a large area.
        beyond_m = 0.5 * math.dist(around_m[:2], around_m[2:])
        inside = polygon.intersection(shapely.box(*around_m).buffer(beyond_m))
        west, south, east, north = around_m if inside.is_empty else inside.bounds
        # A long strip of ground gets no more rows and columns than fit.
        step_m = max(math.sqrt((east - west) * (north - south) / spots), max(east - west, north - south) / spots)
        columns, rows = (math.floor(side / step_m) + 1 for side in (east - west, north - south))
        grid = np.meshgrid(west + step_m * np.arange(columns), south + step_m * np.arange(rows))
        spots_m = np.column_stack([axis.ravel() for axis in grid])
        low, high = band_m(spots_m)
        open_to = (low <= high) & shapely.contains_xy(polygon, spots_m[:, 0], spots_m[:, 1])
        number = np.where(open_to, np.cumsum(open_to) - 1, -1).reshape(rows, columns)
        ups_m = low[:, None] + np.array(_FRACTIONS) * (high - low)[:, None]
        levels = len(_FRACTIONS)
        self.positions_m = np.column_stack([np.repeat(spots_m[open_to], levels, axis=0), ups_m[open_to].ravel()])
        pairs: list[IntArray] = []
        for right, up in _LINKS:
            right_of, left_of = (number[:, max(0, sign * right) : columns + min(0, sign * right)] for sign in (1, -1))
            a = left_of[max(0, -up) : rows - max(0, up)].ravel()
            b = right_of[max(0, up) : rows + min(0, up)].ravel()
            both = (a >= 0) & (b >= 0)
            pairs += [
                levels * np.column_stack([a[both], b[both]]) + np.array([i, j])
                for i, j in itertools.product(range(levels), repeat=2)
            ]
        self.links = self._flyable(self.positions_m, np.vstack(pairs))

    def _flyable(self, positions_m: FloatArray, pairs: IntArray) -> IntArray:
        """The (k, 2) pairs of (n, 3) positions with a leg that keeps the limits."""
        return pairs[self._allowed(positions_m[pairs[:, 0]], positions_m[pairs[:, 1]])]

    def linked_with(self, ends_m: FloatArray, pairs: IntArray) -> tuple[FloatArray, IntArray, FloatArray]:
        """Positions with (m, 3) more at their end, links with those of the new ones, and the lengths of the links.

        Args:
            ends_m: each is linked with positions near it.
            pairs: (k, 2) numbers of new positions that may be linked with each other.
        """
        positions_m = np.vstack([self.positions_m, ends_m])
        away = np.linalg.norm(self.positions_m[None, :, :2] - ends_m[:, None, :2], axis=2)
        near = np.argsort(away, axis=1, kind="stable")[:, : _NEAR_SPOTS * len(_FRACTIONS)]
        to_ends = np.column_stack(
            [near.ravel(), np.repeat(len(self.positions_m) + np.arange(len(ends_m)), near.shape[1])]
        )
        links = np.vstack([self.links, self._flyable(positions_m, np.vstack([to_ends, pairs]))])
        return positions_m, links, np.linalg.norm(positions_m[links[:, 0]] - positions_m[links[:, 1]], axis=1)

    def path(self, climb_out_m: FloatArray, end_climb_out_m: FloatArray) -> FloatArray | None:
        """The shortest (n, 3) path from a vertical column to the first position of another; None if there is none.

        It begins at any of the (k, 3) positions of the column, best at the first, and may end with a vertical leg.
        """
        positions_m, far, before = self._paths_from(climb_out_m)
        away = np.linalg.norm(self.positions_m[:, :2] - end_climb_out_m[0, :2], axis=1)
        near = np.argsort(away, kind="stable")[: _NEAR_SPOTS * len(_FRACTIONS)]
        last_legs_m = np.linalg.norm(positions_m[near, None] - end_climb_out_m, axis=2)
        lengths = far[near, None] + last_legs_m + _UPRIGHT * np.abs(end_climb_out_m[:, 2] - end_climb_out_m[0, 2])
        shortest = np.argsort(lengths, axis=None, kind="stable")
        shortest = shortest[np.isfinite(lengths.ravel()[shortest])]
        for first in range(0, len(shortest), _TRIED_TOGETHER):
            numbers, levels = np.unravel_index(shortest[first : first + _TRIED_TOGETHER], lengths.shape)
            allowed = np.flatnonzero(self._allowed(positions_m[near[numbers]], end_climb_out_m[levels]))
            if len(allowed) > 0:
                number, level = near[numbers[allowed[0]]], levels[allowed[0]]
                break
        else:
            return None
        path, begin = [int(number)], len(self.positions_m)
        while path[-1] != begin:
            path.append(int(before[path[-1]]))
        from_home = path[:-1] if path[-2] > begin else path
        line_m = np.vstack([positions_m[from_home[::-1]], end_climb_out_m[level]])
        return np.vstack([self.with_few_corners(line_m), end_climb_out_m[: min(level, 1)]])

    def _paths_from(self, climb_out_m: FloatArray) -> tuple[FloatArray, FloatArray, IntArray]:
        """Positions with the (k, 3) ones of a column at their end, their distances from it, and the position before each.

        Many paths have the same column at home, so the last results are kept.
        """
        key = climb_out_m.tobytes()
        if (kept := self._paths.get(key)) is not None:
            return kept
        positions_m, links, length = self.linked_with(climb_out_m, np.zeros((0, 2), dtype=np.int64))
        begin = len(self.positions_m)
        upright = np.column_stack([np.full(len(climb_out_m) - 1, begin), np.arange(begin + 1, len(positions_m))])
        rises = _UPRIGHT * np.abs(climb_out_m[1:, 2] - climb_out_m[0, 2])
        both, lengths = np.vstack([links, upright]), np.concatenate([length, rises])
        shape = len(positions_m), len(positions_m)
        graph = scipy.sparse.csr_matrix((lengths, (both[:, 0], both[:, 1])), shape=shape)
        far, before = scipy.sparse.csgraph.dijkstra(graph, directed=False, indices=[begin], return_predecessors=True)
        if len(self._paths) >= _KEPT_COLUMNS:
            self._paths.clear()
        found = positions_m, far[0], before[0]
        self._paths[key] = found
        return found

    def with_few_corners(self, path_m: FloatArray) -> FloatArray:
        """An (n, 3) path with the longest legs from each position that keep the limits."""
        kept = [0]
        while kept[-1] < len(path_m) - 1:
            rest = path_m[kept[-1] + 1 :]
            reached = np.flatnonzero(self._allowed(np.broadcast_to(path_m[kept[-1]], rest.shape), rest))
            kept.append(kept[-1] + 1 + (int(reached[-1]) if len(reached) else 0))
        return path_m[kept]

"""Cells that change from unobserved to observed, stored compactly. Arrays only. Arrays only.

The colours of all cells once a second would be most of the file, and nearly all of them would repeat. Instead, the cells are cut
into square tiles, and a tile gets new colours only in seconds in which one of its cells was seen for the first time.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.arrays import FloatArray
from uavcover.recording.layout import NOT_COVERABLE_RGB, SCENE, SEEN_RGB, UNSEEN_RGB
from uavcover.recording.scene import extent_m, scene_bounds_m
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.terrain.ground import hillshade, shaded


@dataclass(frozen=True, eq=False)
class Tile:
    """A group of cells with their colours over time."""

    cells: NDArray[np.int64]  # (n,) numbers of cells
    vertices_m: FloatArray  # (4 n, 3) ENU metres, four corners of each cell, slightly above the ground
    triangles: NDArray[np.uint32]  # (2 n, 3) uint32 numbers of vertices, counter-clockwise seen from above
    time_s: FloatArray  # (k,) when the colours change; the first is the start of the flight
    rgba: NDArray[np.uint32]  # (k, n) uint32 colours, 0xRRGGBBAA

    @property
    def vertex_rgba(self) -> NDArray[np.uint32]:
        """(k, 4 n) colours of the vertices."""
        return np.repeat(self.rgba, 4, axis=1)


def lift_m(coverage: CoverageMap) -> float:
    """Height above ground at which cells are drawn, above the drawn terrain; lines use twice that."""
    return 0.1 * coverage.grid.cells.size_m + 0.001 * extent_m(scene_bounds_m(coverage.site))


def tick_times_s(start_s: float, end_s: float) -> FloatArray:
    """(k,) times from the start of a flight to its end, ``SCENE.tick_s`` apart; the last is the end itself."""
    ticks = np.arange(start_s, end_s, SCENE.tick_s)
    return np.append(ticks[ticks < end_s], end_s)


def shown_from_s(first_seen_s: FloatArray, ticks_s: FloatArray) -> FloatArray:
    """(cells,) tick from which each cell is shown as observed; infinite where ``first_seen_s`` is not finite."""
    tick = np.searchsorted(ticks_s, first_seen_s, side="left")
    return np.append(ticks_s, np.inf)[np.where(np.isfinite(first_seen_s), tick, ticks_s.size)]


def coverage_tiles(coverage: CoverageMap, shown_s: FloatArray, start_s: float) -> list[Tile]:
    """Divide the cells of a map into tiles, in order of row and column.

    Args:
        coverage: the cells.
        shown_s: (cells,) time at which each cell changes, infinite for never.
        start_s: start of the flight.
    """
    brightness = hillshade(coverage.site.ground.gradients(coverage.grid.cells.centre_m[:, :2]))
    seen = _packed(shaded(SEEN_RGB, brightness))
    unseen = _packed(shaded(UNSEEN_RGB, brightness))
    unseen = np.where(coverage.coverable, unseen, _packed(shaded(NOT_COVERABLE_RGB, brightness)))
    corners_m = _corners_m(coverage)
    square = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.uint32)
    index = coverage.grid.cells.lattice
    tiles = []
    for row in range(0, index.shape[0], SCENE.tile_side_cells):
        for column in range(0, index.shape[1], SCENE.tile_side_cells):
            block = index[row : row + SCENE.tile_side_cells, column : column + SCENE.tile_side_cells].ravel()
            cells = block[block >= 0].astype(np.int64)
            if cells.size == 0:
                continue
            shown = shown_s[cells]
            times = np.unique(np.append(shown[np.isfinite(shown)], start_s))
            turned = shown[None, :] <= times[:, None]
            triangles = 4 * np.arange(cells.size, dtype=np.uint32)[:, None, None] + square
            tiles.append(
                Tile(
                    cells=cells,
                    vertices_m=corners_m[cells].reshape(-1, 3),
                    triangles=triangles.reshape(-1, 3),
                    time_s=times,
                    rgba=np.where(turned, seen[cells], unseen[cells]).astype(np.uint32),
                )
            )
    return tiles


def _corners_m(coverage: CoverageMap) -> FloatArray:
    """(cells, 4, 3) south-west, south-east, north-east, north-west corner of each cell, lifted; ENU metres."""
    cells = coverage.grid.cells
    half_m = 0.5 * cells.size_m
    offsets = half_m * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    places = coverage.grid.middles_m[:, None] + offsets
    up = coverage.site.ground.heights_m(places.reshape(-1, 2)).reshape(-1, 4)
    # a corner can lie outside the data although the centre does not.
    up = np.where(np.isfinite(up), up, cells.centre_m[:, None, 2])
    return np.concatenate([places, (up + lift_m(coverage))[..., None]], axis=2)


def _packed(rgb: NDArray[np.uint8]) -> NDArray[np.uint32]:
    wide = rgb.astype(np.uint32)
    packed = (wide[:, 0] << 24) | (wide[:, 1] << 16) | (wide[:, 2] << 8) | 255
    return np.asarray(packed, dtype=np.uint32)

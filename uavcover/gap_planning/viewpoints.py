"""Few places from which all of the missing cells are seen: a greedy set cover over a grid of allowed places."""

import math

import numpy as np
import shapely
from numpy.typing import NDArray

from uavcover.coverage.level_looks import LevelLooks
from uavcover.coverage.sensors import reach_at_height_m, turns_with_legs
from uavcover.gap_planning.missing import MissingCells
from uavcover.kernels.sight import Sight
from uavcover.planning.baselines import best_height_agl_m
from uavcover.site import Site

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_SPACING_REACHES = 0.4
"""Candidates stand this many reaches apart."""
_AROUND_REACHES = (0.0, 0.35, 0.7, 0.95)
_AROUND_DIRECTIONS = 12
_AROUND_SHARES = (0.5, 0.0, 1.0)
_HEADINGS = 8


def grid_places(site: Site, missing: MissingCells) -> FloatArray:
    """(k, 3) places in a grid over the missing cells and their surroundings, at the height that sees widest.

    The last column is the height above ground.
    """
    height = best_height_agl_m(site)
    reach = max(reach_at_height_m(site.scenario.sensor, height), site.scenario.area.cell_size_m)
    step = _SPACING_REACHES * reach
    centres = missing.cells.centre_m[:, :2]
    low, high = centres.min(axis=0) - reach, centres.max(axis=0) + reach
    east, north = np.meshgrid(
        *(low[axis] + (np.arange(math.ceil((high[axis] - low[axis]) / step)) + 0.5) * step for axis in (0, 1))
    )
    places = np.column_stack([east.ravel(), north.ravel()])
    # Importing scipy.spatial takes a while, which other commands need not wait for.
    from scipy.spatial import cKDTree

    near = np.isfinite(cKDTree(centres).query(places, distance_upper_bound=reach)[0])
    places = places[near & inside_fence(site, places)]
    return np.column_stack([places, np.full(len(places), height)])


def places_around(site: Site, cells_m: FloatArray) -> FloatArray:
    """(k, 3) places above and around (m, 3) cells at several heights of the band; the last column is above ground."""
    limits = site.scenario.limits
    low, high = limits.min_height_agl_m + limits.height_margin_m, limits.max_height_agl_m - limits.height_margin_m
    found = []
    for share in _AROUND_SHARES:
        height = low + share * (high - low)
        reach = reach_at_height_m(site.scenario.sensor, height)
        for radius in _AROUND_REACHES:
            for angle in np.arange(_AROUND_DIRECTIONS if radius else 1) * (2.0 * math.pi / _AROUND_DIRECTIONS):
                by = radius * reach * np.array([math.cos(angle), math.sin(angle)])
                found.append(np.column_stack([cells_m[:, :2] + by, np.full(len(cells_m), height)]))
    places = np.vstack(found)
    return places[inside_fence(site, places[:, :2])]


def inside_fence(site: Site, places_m: FloatArray) -> BoolArray:
    """(k,) whether each of (k, 2) places is inside the fence by the vehicle's acceptance radius, over known ground."""
    inner = site.fence.buffer(-site.scenario.vehicle.acceptance_radius_m)
    inside = shapely.contains_xy(inner, places_m[:, 0], places_m[:, 1])
    return np.asarray(inside & np.isfinite(site.ground.heights_m(places_m)), dtype=bool)


def cover(site: Site, missing: MissingCells, places_agl_m: FloatArray, sight: Sight, wanted: BoolArray) -> FloatArray:
    """Some of (k, 3) places that together see of the ``wanted`` (m,) cells what all of them see.

    Always the one that sees the most ground not yet seen (greedy set cover: at most ln(m) + 1 times as many as needed).

    Returns:
        (j, 3) places with their heights above ground, in the order of choice.
    """
    from scipy import sparse

    ups = site.ground.ups_m(places_agl_m[:, :2], places_agl_m[:, 2])
    eyes = np.column_stack([places_agl_m[:, :2], ups])
    columns = [np.flatnonzero(missing.seen_by(_any_way(eye, sight), sight) & wanted) for eye in eyes]
    ends = np.concatenate([[0], np.cumsum([len(part) for part in columns])])
    cells = np.concatenate(columns) if columns else np.empty(0, dtype=np.int64)
    hits = sparse.csr_array((np.ones(len(cells)), cells, ends), shape=(len(columns), len(wanted)))
    left = np.where(wanted, missing.weight_m2, 0.0)
    chosen: list[int] = []
    while len(chosen) < len(columns):
        gain = hits @ left
        best = int(np.argmax(gain))
        if gain[best] <= 0.0:
            break
        chosen.append(best)
        left[columns[best]] = 0.0
    return places_agl_m[np.array(chosen, dtype=np.int64)]


def _any_way(place_m: FloatArray, sight: Sight) -> LevelLooks:
    """Looks from a (3,) ENU place: in several directions where it matters which way the vehicle comes.

    What such a place shows is too much then; the route that is laid through it decides.
    """
    if not turns_with_legs(sight):
        return LevelLooks.towards_north(place_m)
    return LevelLooks.by_yaw(np.tile(place_m, (_HEADINGS, 1)), 360.0 / _HEADINGS * np.arange(_HEADINGS, dtype=float))

"""A surface model (trees, roofs) beside a ground model: what is flown over and what is looked at."""

import dataclasses
import logging
import math
import re

import numpy as np

from uavcover.errors import ScenarioError, TerrainError
from uavcover.kernels.arrays import FloatArray
from uavcover.model.area import RasterTerrain
from uavcover.model.scenario import Scenario
from uavcover.scenario.scenario_file import surface_source
from uavcover.terrain.elevation_file import read_ground
from uavcover.terrain.frames import Bounds, LocalFrame, finish_frame, positions_of_nodes_m
from uavcover.terrain.ground import Ground, ground_of_nodes
from uavcover.terrain.terrain_source import FILES

_log = logging.getLogger(__name__)

_COMPARED = 40_000
_NOISE_M = 2.0
"""A surface may lie this much under the ground on level ground, and on a slope as much more as half a pixel rises."""
_MOST_BELOW, _SOME_BELOW, _FEW_BELOW = 0.05, 0.01, 0.0003
_MORE_BELOW = 3.0
"""Times as many places under the ground as above it."""
_NEVER_NEARER_M = 20.0
_FOOT_M, _LIKE_FEET = 0.3048, 0.02
_ROUNDING_M, _SAME_M = 1e-4, 1e-3


def with_surface_over(scenario: Scenario, frame: LocalFrame, bounds_m: Bounds, bare: Ground) -> Ground | None:
    """The ground of a scenario with its surface model over it; None without one.

    Args:
        scenario: as loaded.
        frame: its local frame.
        bounds_m: west, south, east, north of the ground.
        bare: the ground alone.

    Raises:
        TerrainError, ScenarioError: the surface model cannot be used, or not over this ground.
    """
    terrain = scenario.terrain
    source = surface_source(terrain) if isinstance(terrain, RasterTerrain) else None
    if source is None or not isinstance(terrain, RasterTerrain):
        return None
    try:
        surface = read_ground(
            source, terrain.surface_vertical_datum or terrain.vertical_datum, frame=frame, bounds_m=bounds_m,
            grid_step_m=terrain.grid_step_m,
        )  # fmt: skip
    except TerrainError as error:
        raise of_surface(error) from error
    ground = higher_of(bare, surface, bounds_m=bounds_m, alt_amsl_offset_m=frame.alt_amsl_m)
    margin_m = scenario.limits.height_margin_m
    if ground.error_m > max(FILES.max_error_m, margin_m):
        raise ScenarioError(
            "terrain.surface_file: between the pixels of the finer model, the other model is up to "
            f"{ground.error_m:.1f} m higher, but limits.height_margin_m is {margin_m:g} m; set it to at least "
            f"{ground.error_m + 0.05:.1f}"
        )
    return ground


def check_home_is_open(terrain: RasterTerrain, ground: Ground, home_en: FloatArray, home_up_m: float) -> None:
    """Refuse a home under trees or a roof.

    A vehicle could not climb there, and heights above home would be wrong.

    Args:
        terrain: of the scenario.
        ground: with the surface model.
        home_en: (2,) east and north of the home.
        home_up_m: of the bare ground there.

    Raises:
        TerrainError, ScenarioError: it is so, or not known.
    """
    above_m = float(ground.heights_m(home_en)[0]) - home_up_m
    if not np.isfinite(above_m):
        raise TerrainError(f"home: the surface model has no height at the take-off position ({ground.source})")
    if above_m > terrain.surface_hides_m:
        raise ScenarioError(
            f"home: the surface there is {above_m:.1f} m above the ground, but terrain.surface_hides_m is "
            f"{terrain.surface_hides_m:g} (there are trees or a roof, or surface_file has another vertical datum); "
            "take off from open ground"
        )


def higher_of(ground: Ground, surface: Ground, *, bounds_m: Bounds, alt_amsl_offset_m: float) -> Ground:
    """The higher of a ground and a surface model, on the pixels of the finer of the two.

    Where the ground has no data the surface alone is taken; where the surface has none, there is no data.

    Args:
        ground: the bare ground.
        surface: the surface model, in the same local frame.
        bounds_m: west, south, east, north of both.
        alt_amsl_offset_m: from up at the origin to height above sea level, to compare units.

    Returns:
        A ground whose ``error_m`` also covers how far either of the two rises above it between pixels.

    Raises:
        TerrainError: the two do not fit each other: swapped, in another unit or above another datum, or without common places.
    """
    refuse_misfit(ground, surface, bounds_m=bounds_m, alt_amsl_offset_m=alt_amsl_offset_m)
    surface_is_finer = surface.surface.step_m <= ground.surface.step_m
    base, other = (surface, ground) if surface_is_finer else (ground, surface)
    up = np.empty_like(base.surface.up_m)
    rows, columns = up.shape
    block = max(1, 1_000_000 // columns)
    for first in range(0, rows, block):
        part = slice(first, min(first + block, rows))
        own = base.surface.up_m[part].ravel()
        row, column = np.divmod(np.arange(own.size), columns)
        nodes = np.column_stack([column, row + first]).astype(float)
        there = _up_at_nodes_m(other, positions_of_nodes_m(base.surface.grid, nodes, own), bounds_m)
        surface_m, ground_m = (own, there) if surface_is_finer else (there, own)
        up[part] = np.where(np.isfinite(ground_m), np.maximum(surface_m, ground_m), surface_m).reshape(-1, columns)
    grid = base.surface.grid
    if grid.lean_per_m > 0.0:
        grid = finish_frame(grid, up)
    higher = ground_of_nodes(
        up, grid, step_m=base.surface.step_m, source=f"{surface.source}, over {ground.source}",
        vertical_datum=ground.vertical_datum, sha256=ground.sha256,
        cut_error_m=max(ground.cut_error_m, surface.cut_error_m),
    )  # fmt: skip
    error_m = max(ground.error_m, surface.error_m) + _rises_above_m(higher, (ground, surface), bounds_m)
    return dataclasses.replace(higher, error_m=error_m, surface_sha256=surface.sha256)


def of_surface(error: TerrainError) -> TerrainError:
    """An error of reading elevation data, with the scenario's keys of the surface model."""
    text = re.sub(r"\bterrain\.(crs|band|height_unit|vertical_datum)\b", r"terrain.surface_\1", str(error))
    return TerrainError(text if text.startswith("terrain.surface_") else f"terrain.surface_file: {text}")


def _up_at_nodes_m(ground: Ground, positions_m: FloatArray, bounds_m: Bounds) -> FloatArray:
    """(k,) up coordinate of a ground on the plumb lines of (k, 3) positions. At their east and north without a height."""
    known = np.isfinite(positions_m[:, 2])
    up = np.full(len(positions_m), np.nan)
    up[~known] = ground.heights_m(positions_m[~known, :2]) if not known.all() else math.nan
    west, south, east, north = bounds_m
    inwards = _ROUNDING_M * np.sign((0.5 * (west + east), 0.5 * (south + north)) - positions_m[:, :2])
    # Files of one extent end at the same place, which rounding puts outside of one of them.
    for nudge in (0.0, inwards):
        lacking = np.isnan(up) & known
        moved = positions_m.copy()
        moved[:, :2] += nudge
        if lacking.any():
            up[lacking] = moved[lacking, 2] - ground.heights_agl_m(moved[lacking])
    return up


def _scattered(bounds_m: Bounds) -> FloatArray:
    """(n, 2) places spread evenly over a box, in no step of any grid."""
    west, south, east, north = bounds_m
    number = np.arange(_COMPARED) + 0.5
    fractions = np.column_stack([number / _COMPARED, np.mod(number * 0.5 * (np.sqrt(5.0) - 1.0), 1.0)])
    return np.asarray((west, south) + fractions * (east - west, north - south))


def _rises_above_m(higher: Ground, models: tuple[Ground, Ground], bounds_m: Bounds) -> float:
    positions = _scattered(bounds_m)
    up = higher.heights_m(positions)
    above = [model.heights_m(positions) - up for model in models]
    return max(float(np.max(part, initial=0.0, where=np.isfinite(part))) for part in above)


def refuse_other_heights(ground_amsl_m: FloatArray, surface_amsl_m: FloatArray, *, surface: str) -> None:
    """Refuse a surface model that is nowhere near the ground.

    Args:
        ground_amsl_m: (n,) heights of the ground, NaN without one.
        surface_amsl_m: (n,) heights of the surface at the same places.
        surface: names it in errors.

    Raises:
        TerrainError: with what to set.
    """
    known = np.isfinite(ground_amsl_m) & np.isfinite(surface_amsl_m)
    if known.sum() < 100:
        raise TerrainError(
            f"terrain.surface_file: {surface} and terrain.file do not overlap around the area; use a surface model "
            "of the same location"
        )
    ground_m, surface_m = ground_amsl_m[known], surface_amsl_m[known]
    difference = surface_m - ground_m
    nearest, usual, farthest = (float(value) for value in np.percentile(difference, (1.0, 50.0, 99.0)))
    if farthest >= -_NOISE_M and nearest <= _NEVER_NEARER_M:
        return
    side = "under" if usual < 0.0 else "above"
    where = f"terrain.surface_file: {surface} lies {abs(usual):.1f} m {side} the ground in terrain.file"
    ratio = float(np.median(surface_m / np.where(np.abs(ground_m) < _SAME_M, _SAME_M, ground_m)))
    if abs(ratio * _FOOT_M - 1.0) < _LIKE_FEET or abs(ratio / _FOOT_M - 1.0) < _LIKE_FEET:
        which, key = ("surface", "surface_height_unit") if ratio > 1.0 else ("ground", "height_unit")
        raise TerrainError(
            f'{where}, at {ratio:.2f} times its height; the {which} seems to be in feet; set terrain.{key} to "ft"'
        )
    raise TerrainError(
        f"{where} ({nearest:.1f} to {farthest:.1f} m at 98 % of the nodes); their vertical datums or units seem to "
        "differ; set terrain.surface_vertical_datum or surface_height_unit"
    )


def refuse_misfit(ground: Ground, surface: Ground, *, bounds_m: Bounds, alt_amsl_offset_m: float) -> None:
    """Refuse a surface model of another location or height datum than the ground, or one exchanged with it.

    Args:
        ground: the bare ground.
        surface: the surface model, in the same local frame.
        bounds_m: west, south, east, north of both.
        alt_amsl_offset_m: from up at the origin to height above sea level, to compare units.

    Raises:
        TerrainError: with the reason.
    """
    if ground.sha256 and ground.sha256 == surface.sha256:
        raise TerrainError(
            "terrain.surface_file: this is the same file as terrain.file; use the file with trees and roofs, or remove this key"
        )
    positions = _scattered(bounds_m)
    ground_m, surface_m = ground.heights_m(positions), surface.heights_m(positions)
    refuse_other_heights(ground_m + alt_amsl_offset_m, surface_m + alt_amsl_offset_m, surface=surface.source)
    known = np.isfinite(ground_m) & np.isfinite(surface_m)
    difference = (surface_m - ground_m)[known]
    slopes = np.nan_to_num(np.hypot(*ground.gradients(positions[known]).T))
    allowed_m = _NOISE_M + 0.5 * max(ground.surface.step_m, surface.surface.step_m) * slopes
    # What stands on a ground is above it; where more is under it, the two are exchanged, or one is older than the other.
    fraction = float(np.mean(difference < -allowed_m))
    mostly_below = fraction > _MORE_BELOW * float(np.mean(difference > allowed_m))
    lowest_m = -float(difference.min())
    if fraction > _MOST_BELOW or (fraction > _SOME_BELOW and mostly_below):
        raise TerrainError(
            f"terrain.surface_file: {surface.source} lies below the ground in terrain.file at {100.0 * fraction:.0f} % "
            f"of the nodes, by up to {lowest_m:.1f} m; check that the files are not swapped (file: the ground; "
            "surface_file: the surface with trees and roofs), and that location and datum agree"
        )
    if fraction > _FEW_BELOW and mostly_below:
        _log.warning(
            "terrain.surface_file: %s lies below the ground in terrain.file at %.2f %% of the nodes, by up to %.1f "
            "m, and above it less often; check that the files are not swapped; flights stay above both",
            surface.source, 100.0 * fraction, lowest_m,
        )  # fmt: skip

"""Summarise a surface model beside the ground: objects, their heights, and the hidden ground."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import rasterio.errors
import shapely

from uavcover.errors import InputError, TerrainError
from uavcover.kernels.arrays import FloatArray
from uavcover.new.terrain_look import TerrainLook, possible_datums
from uavcover.new.tuning import TERRAIN
from uavcover.scenario.surface_model import of_surface, refuse_other_heights
from uavcover.terrain.elevation_file import read_heights_amsl_m
from uavcover.terrain.terrain_source import TerrainSource


@dataclass(frozen=True, slots=True)
class SurfaceLook:
    """Summary of a surface model over an area.

    Attributes:
        source: its files.
        vertical_datum: of its heights, where it is not that of the ground.
        highest_amsl_m: highest place of the surface in and around the area.
        tallest_m: largest height of the surface above the ground there.
        hidden_share: share of the area's ground that it hides, 0..1.
        above_ground_m: height above the ground, (n,) at (n, 2) places in the frame of the terrain's look.
    """

    source: TerrainSource
    vertical_datum: str | None
    highest_amsl_m: float
    tallest_m: float
    hidden_share: float
    above_ground_m: Callable[[FloatArray], FloatArray]

    def is_open(self, east_north_m: FloatArray) -> np.ndarray:
        """(n,) whether nothing stands at (n, 2) places; False where it is not known."""
        return np.asarray(self.above_ground_m(east_north_m) <= TERRAIN.hides_m)


def read_as_needed(source: TerrainSource, *, crs: str | None, height_unit: str | None) -> TerrainSource:
    """The source with the coordinate system and the unit that its file does not state itself.

    Raises:
        TerrainError: the file cannot be read.
    """
    try:
        with source.opened() as dataset:
            lacks_crs, lacks_unit = dataset.crs is None, not dataset.units[0]
    except (rasterio.errors.RasterioError, OSError) as error:
        reason = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise TerrainError(
            f"{source}: the file cannot be read as elevation data ({reason}); use a raster of heights"
        ) from error
    return replace(source, crs=crs if lacks_crs else None, height_unit=height_unit if lacks_unit else None)


def surface_datum(source: TerrainSource, ground_datum: str) -> str:
    """The vertical datum of a surface model: that of the ground, where its file does not say another one.

    Raises:
        TerrainError: the file cannot be read, or names a datum that is not known.
    """
    try:
        datums = possible_datums(source)
    except TerrainError as error:
        raise of_surface(error) from error
    return ground_datum if ground_datum in datums or len(datums) > 1 else datums[0]


def look_at_surface(
    source: TerrainSource, ground: TerrainSource, look: TerrainLook, *, ground_datum: str, around_m: float
) -> SurfaceLook:
    """Look at what stands on the ground of an area.

    Args:
        source: the surface model.
        ground: the ground model.
        look: at the ground.
        ground_datum: vertical datum of the ground.
        around_m: how far around the area it matters.

    Raises:
        TerrainError: the file cannot be used.
        InputError: it has no heights in a part of the area.
    """
    datum = surface_datum(source, ground_datum)

    def heights(file: TerrainSource, file_datum: str, places: FloatArray) -> FloatArray:
        lat, lon, _ = look.frame.geodetic_from_enu(np.column_stack([places, np.zeros(len(places))]))
        return read_heights_amsl_m(file, file_datum, lat, lon)

    def surface_m(places: FloatArray) -> FloatArray:
        try:
            return heights(source, datum, places)
        except TerrainError as error:
            raise of_surface(error) from error

    def above_ground_m(places: FloatArray) -> FloatArray:
        return np.asarray(surface_m(places) - heights(ground, ground_datum, places))

    zone = look.area.convex_hull.buffer(around_m)
    west, south, east, north = zone.bounds
    grid = np.stack(
        np.meshgrid(np.linspace(west, east, TERRAIN.surface_grid), np.linspace(south, north, TERRAIN.surface_grid)),
        axis=-1,
    ).reshape(-1, 2)
    grid = grid[shapely.contains_xy(zone, grid[:, 0], grid[:, 1])]
    top = surface_m(grid)
    bare = heights(ground, ground_datum, grid)
    inside = shapely.contains_xy(look.area, grid[:, 0], grid[:, 1])
    lacking = inside & np.isnan(top)
    if lacking.any():
        lat, lon, _ = look.frame.geodetic_from_enu([[*grid[lacking][0], 0.0]])
        raise InputError(
            f"--dsm: {source} has no height in {100.0 * lacking.sum() / inside.sum():.0f} % of the area, first at "
            f"latitude {lat[0]:.5f}, longitude {lon[0]:.5f}; use a surface model that covers it, or omit --dsm"
        )
    refuse_other_heights(bare, top, surface=source.name)
    above = top - bare
    known = above[inside & np.isfinite(above)]
    return SurfaceLook(
        source, None if datum == ground_datum else datum, float(np.nanmax(top)), max(0.0, float(np.nanmax(above))),
        float((known > TERRAIN.hides_m).mean()) if known.size else 0.0, above_ground_m,
    )  # fmt: skip

"""Examine elevation data: whether it reaches the area, how steep it is, and where a vehicle can take off."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import rasterio.errors
import shapely
from pyproj import CRS
from pyproj.exceptions import ProjError

from uavcover.errors import InputError, NoElevationError, TerrainError
from uavcover.kernels.arrays import FloatArray
from uavcover.model.area import Rings
from uavcover.new.quantities import TERRAIN
from uavcover.scenario.surface_model import of_surface, refuse_other_heights
from uavcover.terrain.elevation_file import read_height_amsl_m, read_heights_amsl_m
from uavcover.terrain.frames import ELLIPSOID, SEA_LEVEL_DATUMS, LocalFrame, lons_beside
from uavcover.terrain.terrain_source import TerrainSource


@dataclass(frozen=True, slots=True)
class TerrainLook:
    """Summary of the elevation data over an area."""

    frame: LocalFrame  # a local frame in the middle of the area
    area: shapely.MultiPolygon  # the area in it, metres
    area_m2: float  # its size
    lowest_amsl_m: float  # lowest ground in and around it
    highest_amsl_m: float  # highest ground there
    slope_deg: float  # slope that 95 % of its ground stays below
    # length, rounded up, of the largest gap in the elevation data that lies in holes of the area alone; 0 without one
    gap_m: float
    datums: tuple[str, ...]  # the vertical datums that the file may have; one when it names it


def look_at_terrain(
    file: TerrainSource, parts: tuple[Rings, ...], *, where: str, around_m: float, datum: str | None
) -> TerrainLook:
    """Examine the ground of an area.

    Args:
        file: the elevation data.
        parts: the area, rings of (longitude, latitude).
        where: names the area in errors.
        around_m: distance around it within which the ground matters.
        datum: vertical datum of the file; None: the stated or assumed one.

    Raises:
        TerrainError: the file cannot be used.
        InputError: the area is not on the elevation data, or too large.
    """
    datums = possible_datums(file) if datum is None else (datum,)
    frame = _middle(parts)
    area = _in_frame(parts, frame)
    west, south, east, north = area.bounds
    if max(east - west, north - south) > 1000.0 * TERRAIN.largest_km:
        raise InputError(
            f"{where}: the area measures {0.001 * (east - west):.0f} km by {0.001 * (north - south):.0f} km, but the "
            f"limit is {TERRAIN.largest_km:g} km; use a part of it (--feature, or a smaller polygon)"
        )
    _require_ground(file, datums[0], parts, where=where, frame=frame, area=area)
    zone = area.convex_hull.buffer(around_m)
    positions = _grid(zone, TERRAIN.grid)
    heights = _heights(file, datums[0], frame, positions)
    known = np.isfinite(heights)
    inside = np.asarray(shapely.contains_xy(area, positions[:, 0], positions[:, 1])) & known
    sampled = positions[inside] if inside.any() else shapely.get_coordinates(area.representative_point())
    slopes = _slopes_deg(file, datums[0], frame, sampled)
    slope = float(np.nanpercentile(slopes, 95.0)) if np.isfinite(slopes).any() else 0.0
    gap_m = _gaps_in_holes_m(file, datums[0], frame, area, where=where)
    return TerrainLook(
        frame, area, float(area.area), float(np.nanmin(heights)), float(np.nanmax(heights)), slope, gap_m, datums
    )  # fmt: skip


def _gaps_in_holes_m(
    file: TerrainSource, datum: str, frame: LocalFrame, area: shapely.MultiPolygon, *, where: str
) -> float:
    """Length of the largest data gap that lies, except for its rim, outside the area.

    A gap inside it is refused.

    Raises:
        InputError: there is no elevation under a part of the area.
    """
    west, south, east, north = area.bounds
    easts, norths = np.linspace(west, east, TERRAIN.gap_grid), np.linspace(south, north, TERRAIN.gap_grid)
    positions = np.stack(np.meshgrid(easts, norths), axis=-1).reshape(-1, 2)
    gaps = np.isnan(_heights(file, datum, frame, positions)) & shapely.contains_xy(
        area.convex_hull, positions[:, 0], positions[:, 1]
    )
    if not gaps.any():
        return 0.0
    covered = shapely.contains_xy(area, positions[:, 0], positions[:, 1]).reshape(TERRAIN.gap_grid, TERRAIN.gap_grid)
    from scipy import ndimage  # a third of a second to load, and most elevation data has no gaps

    labels, _ = ndimage.label(gaps.reshape(TERRAIN.gap_grid, TERRAIN.gap_grid), structure=np.ones((3, 3)))
    steps_m = np.array([norths[1] - norths[0], easts[1] - easts[0]])
    largest_m = 0.0
    for number, position in enumerate(ndimage.find_objects(labels), start=1):
        gap = labels[position] == number
        length_m = TERRAIN.round_m * math.ceil(float(max(np.array(gap.shape) * steps_m)) / TERRAIN.round_m + 2.0)
        inside = gap & covered[position]
        if inside.mean(where=gap) > TERRAIN.rim_fraction:
            if length_m > file.fill_no_data_m:
                row, column = np.argwhere(inside)[0] + (position[0].start, position[1].start)
                lat, lon, _ = frame.geodetic_from_enu([[easts[column], norths[row], 0.0]])
                raise InputError(
                    f"{where}: {file} has no elevation at latitude {lat[0]:.5f}, longitude {lon[0]:.5f}, inside the "
                    f"area; interpolate the gap with --fill-lakes {length_m:g}m, treat it as the sea with "
                    "--water-height 0m, exclude it from the area, or use other data"
                )
        else:
            largest_m = max(largest_m, length_m)
    return largest_m


def known_margin_m(file: TerrainSource, look: TerrainLook, wanted_m: float) -> float:
    """The largest part of a margin around the area, in quarters, within which the elevation data has no end."""
    for quarters in (4, 3, 2, 1):
        grown = shapely.segmentize(look.area.convex_hull.buffer(0.25 * quarters * wanted_m, join_style="mitre"), 50.0)
        if np.isfinite(_heights(file, look.datums[0], look.frame, shapely.get_coordinates(grown))).all():
            return 0.25 * quarters * wanted_m
    return 0.0


def position_for_home(
    file: TerrainSource,  # the elevation data
    look: TerrainLook,  # at the terrain
    *,
    avoid: shapely.Geometry | None = None,  # where it must not be, (east, north) metres in the frame of the look
    # whether nothing stands at (n, 2) places; None: everywhere
    is_open: Callable[[FloatArray], np.ndarray] | None = None,
) -> tuple[float, float]:
    """Latitude and longitude of the lowest position at the area's edge where the ground is level enough for take-off.

    Raises:
        InputError: there is no known ground at its edge, or all of it is to be avoided.
    """
    file = replace(file, water_height_m=None)  # home is never on open water
    rings = [part.exterior for part in shapely.get_parts(look.area)]
    step_m = max(5.0, sum(ring.length for ring in rings) / TERRAIN.edge_steps)
    positions = np.vstack([shapely.get_coordinates(shapely.segmentize(ring, step_m)) for ring in rings])
    heights = _heights(file, look.datums[0], look.frame, positions)
    slopes = _slopes_deg(file, look.datums[0], look.frame, positions)
    known = np.isfinite(heights) & np.isfinite(slopes)
    if avoid is not None and known.any():
        known &= ~shapely.intersects_xy(avoid, positions[:, 0], positions[:, 1])
        if not known.any():
            raise InputError(
                "--home: the whole edge of the area is in no-fly zones or outside the fence; specify a position as --home LAT,LON"
            )
    if is_open is not None and known.any():
        known &= is_open(positions)
        if not known.any():
            raise InputError(
                "--home: trees and roofs of the surface model cover the whole edge of the area; specify a position "
                "in the open as --home LAT,LON"
            )
    if not known.any():
        raise InputError("--home: there is no elevation data at the edge of the area; specify --home LAT,LON")
    level = known & (slopes <= max(TERRAIN.home_slope_deg, float(np.min(slopes[known])) + 1.0))
    best = positions[level][int(np.argmin(heights[level]))]
    lat, lon, _ = look.frame.geodetic_from_enu([[best[0], best[1], 0.0]])
    return round(float(lat[0]), 6), round(float(lon[0]), 6)


def possible_datums(file: TerrainSource) -> tuple[str, ...]:
    """Datums that the heights of a file may refer to: the named one, or all at sea level.

    Raises:
        TerrainError: the file cannot be used.
    """
    fitting: list[str] = []
    refusal: TerrainError | None = None
    for datum in SEA_LEVEL_DATUMS:
        try:
            read_heights_amsl_m(file, datum, np.zeros(1), np.zeros(1))  # anywhere: what it opens is checked
            fitting.append(datum)
        except TerrainError as error:
            refusal = refusal or error
    if refusal is not None and not fitting:
        if not _is_above_ellipsoid(file):
            raise refusal
        read_heights_amsl_m(file, ELLIPSOID, np.zeros(1), np.zeros(1))
        fitting.append(ELLIPSOID)
    return tuple(fitting)


def _is_above_ellipsoid(file: TerrainSource) -> bool:
    try:
        with file.opened() as dataset:
            crs = None if dataset.crs is None else CRS.from_wkt(dataset.crs.to_wkt())
    except (TerrainError, ProjError, rasterio.errors.RasterioError, OSError):
        return False
    return crs is not None and not crs.is_compound and len(crs.axis_info) == 3


def _middle(parts: tuple[Rings, ...]) -> LocalFrame:
    first = np.asarray(parts[0][0])
    lons = np.concatenate([np.asarray(rings[0])[:, 0] for rings in parts])
    lats = np.concatenate([np.asarray(rings[0])[:, 1] for rings in parts])
    lons = lons_beside(lons, first[0, 0])
    middle = 0.5 * float(lons.min() + lons.max())
    return LocalFrame(0.5 * float(lats.min() + lats.max()), math.remainder(middle, 360.0), 0.0)


def _in_frame(parts: tuple[Rings, ...], frame: LocalFrame) -> shapely.MultiPolygon:
    polygons = [[shapely.Polygon(frame.en_from_lon_lat(ring)) for ring in rings] for rings in parts]
    united = shapely.union_all([outer.difference(shapely.union_all(holes)) for outer, *holes in polygons])
    return shapely.MultiPolygon([part for part in shapely.get_parts(united) if isinstance(part, shapely.Polygon)])


def _require_ground(
    file: TerrainSource,
    datum: str,
    parts: tuple[Rings, ...],
    *,
    where: str,
    frame: LocalFrame,
    area: shapely.MultiPolygon,
) -> None:
    """Refuse an area outside the elevation data; distinguish swapped axes from a wrong file."""
    positions = shapely.get_coordinates(area.convex_hull)
    known = np.isfinite(_heights(file, datum, frame, positions))
    if known.all():
        return
    corner = np.asarray(parts[0][0])[:1]
    if not known.any():
        lat, lon = np.array([frame.lat_deg]), np.array([frame.lon_deg])
        swapped = abs(frame.lon_deg) <= 90.0 and bool(np.isfinite(read_heights_amsl_m(file, datum, lon, lat)).all())
        if swapped:
            raise InputError(f"{where}: the area lies on {file} only with swapped axes; use --swap-axes")
        inside = read_heights_amsl_m(file, datum, lat, lon)
        if not np.isfinite(inside).all():
            raise InputError(
                f"{where}: the area at latitude {corner[0, 1]:.4f}, longitude {corner[0, 0]:.4f} is outside the "
                f"elevation data {file} ({_reach(file, datum, frame)}); use data for that location, or specify the "
                "coordinate system of the area with --crs"
            )
    lons, lats = frame.lon_lat_from_en(positions).T
    at = int(np.argmin(known))
    raise InputError(
        f"{where}: the area reaches beyond the elevation data {file} at latitude {lats[at]:.5f}, longitude "
        f"{lons[at]:.5f}; use data that covers it (several tiles as one: gdalbuildvrt), or a smaller area; if the "
        "missing part is open water, set its height above sea level with --water-height 0m"
    )


def _reach(file: TerrainSource, datum: str, frame: LocalFrame) -> str:
    """Extent of the data, in words."""
    try:
        read_height_amsl_m(file, datum, lat_deg=frame.lat_deg, lon_deg=frame.lon_deg)
    except NoElevationError as error:
        return error.extent
    return "no data"


def _grid(zone: shapely.Polygon, side: int) -> FloatArray:
    west, south, east, north = zone.bounds
    easts, norths = np.meshgrid(np.linspace(west, east, side), np.linspace(south, north, side))
    positions = np.column_stack([easts.ravel(), norths.ravel()])
    return np.asarray(positions[shapely.contains_xy(zone, positions[:, 0], positions[:, 1])])


def _heights(file: TerrainSource, datum: str, frame: LocalFrame, positions: FloatArray) -> FloatArray:
    lon, lat = frame.lon_lat_from_en(positions).T
    return read_heights_amsl_m(file, datum, lat, lon)


def _slopes_deg(file: TerrainSource, datum: str, frame: LocalFrame, positions: FloatArray) -> FloatArray:
    reach = TERRAIN.slope_reach_m
    steps = np.array([(reach, 0.0), (-reach, 0.0), (0.0, reach), (0.0, -reach)])
    around = _heights(file, datum, frame, (positions[:, None, :] + steps).reshape(-1, 2)).reshape(-1, 4)
    rise = np.hypot(around[:, 0] - around[:, 1], around[:, 2] - around[:, 3]) / (2.0 * reach)
    return np.degrees(np.arctan(rise))


# Summarise a surface model beside the ground: objects, their heights, and the hidden ground.


@dataclass(frozen=True, slots=True)
class SurfaceLook:
    """Summary of a surface model over an area."""

    source: TerrainSource  # its files
    vertical_datum: str | None  # of its heights, where it is not that of the ground
    highest_amsl_m: float  # highest place of the surface in and around the area
    tallest_m: float  # largest height of the surface above the ground there
    hidden_fraction: float  # fraction of the area's ground that it hides, 0..1
    # height above the ground, (n,) at (n, 2) places in the frame of the terrain's look
    above_ground_m: Callable[[FloatArray], FloatArray]

    def is_open(self, east_north_m: FloatArray) -> np.ndarray:
        """(n,) whether nothing stands at (n, 2) places; False if unknown."""
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
        raise TerrainError(f"{source}: cannot read elevation data ({reason}); use a raster of heights") from error
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

    def surface_m(positions: FloatArray) -> FloatArray:
        try:
            return _heights(source, datum, look.frame, positions)
        except TerrainError as error:
            raise of_surface(error) from error

    def above_ground_m(positions: FloatArray) -> FloatArray:
        return np.asarray(surface_m(positions) - _heights(ground, ground_datum, look.frame, positions))

    grid = _grid(look.area.convex_hull.buffer(around_m), TERRAIN.surface_grid)
    top = surface_m(grid)
    bare = _heights(ground, ground_datum, look.frame, grid)
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

"""Reference systems: the local east-north-up frame (pyproj's topocentric pipeline), pixels in it, vertical datums, units.

Heights: the frame takes heights above mean sea level (AMSL) where geometry needs heights above the ellipsoid. Within one
frame the difference, the geoid undulation, is treated as constant. The error is small: undulation changes by centimetres
per kilometre, and a constant offset of 100 m scales horizontal distances by 100 m / 6378 km = 1.6e-5 (16 mm per km).
"""

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial.chebyshev import chebpts1, chebvander
from numpy.typing import ArrayLike
from pyproj import CRS, Transformer
from pyproj.exceptions import ProjError
from pyproj.transformer import TransformerGroup

from mission_io.data_tables import data_table
from mission_io.model.items import MEAN_RADIUS_M
from uavcover.errors import InputError, TerrainError
from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.grid import GridFrame, growth_on_grid, positions_on_grid, steepest_of_finite


@dataclass(frozen=True, slots=True, kw_only=True)
class _Pixels:
    straight_within_m: float
    lattice: int
    wider: float
    longest_piece_m: float
    curve_length_m: float
    safe: float
    strip_nodes: int
    up_degree: int


PIXELS = data_table(_Pixels, "uavcover/data/terrain.toml", "pixels")


@dataclass(frozen=True)
class LocalFrame:
    """A right-handed east-north-up frame in metres, tangent to the Earth at its origin (WGS 84)."""

    lat_deg: float  # latitude of the origin, -90..90
    lon_deg: float  # longitude of the origin, -180..180
    alt_amsl_m: float  # height of the origin above mean sea level

    def __post_init__(self) -> None:
        if not (-90.0 <= self.lat_deg <= 90.0):
            raise InputError(f"origin: latitude {self.lat_deg} is outside -90 to 90 (swapped with longitude?)")
        if not (-180.0 <= self.lon_deg <= 180.0):
            raise InputError(f"origin: longitude must be between -180 and 180, not {self.lon_deg}")
        if not np.isfinite(self.alt_amsl_m):
            raise InputError("origin: the height above sea level is not a finite number")

    @cached_property
    def _pipeline(self) -> Transformer:
        return Transformer.from_pipeline(
            "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84 "
            f"+step +proj=topocentric +ellps=WGS84 +lat_0={float(self.lat_deg)!r} "
            f"+lon_0={float(self.lon_deg)!r} +h_0={float(self.alt_amsl_m)!r}"
        )

    def enu_from_geodetic(
        self, lat_deg: ArrayLike | float, lon_deg: ArrayLike | float, alt_amsl_m: ArrayLike | float
    ) -> FloatArray:
        """Local coordinates of geodetic positions.

        Args:
            lat_deg: (n,) latitudes, degrees.
            lon_deg: (n,) longitudes, degrees.
            alt_amsl_m: (n,) heights above mean sea level, metres.

        Returns:
            (n, 3) east, north, up in metres; non-finite where the input is.
        """
        if isinstance(lat_deg, float) and isinstance(lon_deg, float) and isinstance(alt_amsl_m, float):
            # a vehicle's place comes many times a second, and pyproj is five times as fast for one without arrays.
            return np.array([self._pipeline.transform(float(lon_deg), float(lat_deg), float(alt_amsl_m))])
        lat, lon, alt = np.broadcast_arrays(
            *(np.atleast_1d(np.asarray(a, float)) for a in (lat_deg, lon_deg, alt_amsl_m))
        )
        east, north, up = self._pipeline.transform(lon, lat, alt)
        return np.column_stack([east, north, up])

    def en_from_lon_lat(self, lon_lat_deg: ArrayLike) -> FloatArray:
        """(n, 2) east, north of (n, 2) longitudes and latitudes, degrees, at the height of the origin."""
        lon, lat = np.asarray(lon_lat_deg, float).reshape(-1, 2).T
        return np.asarray(self.enu_from_geodetic(lat, lon, self.alt_amsl_m)[:, :2])

    def geodetic_from_enu(self, enu_m: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Geodetic positions of local coordinates: the inverse of :meth:`enu_from_geodetic`.

        Args:
            enu_m: (n, 3) east, north, up in metres.

        Returns:
            latitudes (n,) in degrees, longitudes (n,) in degrees, heights above mean sea level (n,) in metres.
        """
        enu = np.atleast_2d(np.asarray(enu_m, float))
        if len(enu) == 1:
            east, north, up = enu[0].tolist()
            one_lon, one_lat, one_alt = self._pipeline.transform(east, north, up, direction="INVERSE")
            return np.array([one_lat]), np.array([one_lon]), np.array([one_alt])
        lon, lat, alt = self._pipeline.transform(enu[:, 0], enu[:, 1], enu[:, 2], direction="INVERSE")
        return np.asarray(lat, float), np.asarray(lon, float), np.asarray(alt, float)

    def lon_lat_from_en(self, en_m: FloatArray) -> FloatArray:
        """(n, 2) longitudes and latitudes, degrees, of (n, 2) east, north at the height of the origin."""
        lat, lon, _ = self.geodetic_from_enu(np.column_stack([en_m, np.zeros(len(en_m))]))
        return np.column_stack([lon, lat])


def lons_beside(lon_deg: FloatArray, middle_deg: float) -> FloatArray:
    """(n,) longitudes in degrees without the jump at 180: within 180 of one of them."""
    return np.asarray(middle_deg + np.mod(lon_deg - middle_deg + 180.0, 360.0) - 180.0)


Bounds = tuple[float, float, float, float]
"""West, south, east and north, in metres or degrees."""

ToPixels = Callable[[FloatArray, FloatArray], FloatArray]
"""(n, 2) column and row, integers at pixel centres, of latitudes (n,) and longitudes (n,)."""

FromPixels = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""Latitudes (n,) and longitudes (n,) of (n, 2) columns and rows."""


def fit_frame(to_pixels: ToPixels, frame: LocalFrame, bounds_m: Bounds, *, level_up_m: float) -> GridFrame:
    """Fit columns and rows of a raster to the local frame.

    Values that depend on node heights (pieces, leeway) are added by :func:`finish_frame`.

    Args:
        to_pixels: exact columns and rows.
        frame: the local frame.
        bounds_m: west, south, east, north of the requested ground.
        level_up_m: up coordinate of the fit, to which plumb lines lead.

    Raises:
        TerrainError: the raster's coordinate system does not reach there.
    """
    west, south, east, north = bounds_m
    middle = np.array([0.5 * (west + east), 0.5 * (south + north)])
    scale = 0.5 * max(east - west, north - south, 1.0) * PIXELS.wider
    across = chebpts1(PIXELS.lattice)
    unit = np.column_stack([axis.ravel() for axis in np.meshgrid(across, across)])
    lat, lon, _ = frame.geodetic_from_enu(np.column_stack([middle + scale * unit, np.full(len(unit), level_up_m)]))
    pixels = to_pixels(lat, lon)
    if not np.isfinite(pixels).all():
        raise TerrainError("its coordinate system does not cover all of the scenario's area")
    terms = np.ascontiguousarray(np.linalg.lstsq(_cubic(unit), pixels, rcond=None)[0].T)
    terms.flags.writeable = False
    lean_per_m = 1.0 / (MEAN_RADIUS_M + frame.alt_amsl_m)
    lean = lean_per_m * float(np.hypot(*(np.abs(middle) + scale)))
    return GridFrame(
        float(middle[0]), float(middle[1]), scale, terms, level_up_m, lean_per_m, lean, 0.0, 0.0, 0.0, math.inf, 0.0
    )


def _cubic(xy: FloatArray) -> FloatArray:
    """(n, 10) terms of :data:`uavcover.kernels.grid.TERMS` at (n, 2) positions."""
    x, y = xy.T
    return np.column_stack([np.ones(len(xy)), x, y, x * x, x * y, y * y, x**3, x * x * y, x * y * y, y**3])


def finish_frame(grid: GridFrame, up_m: FloatArray) -> GridFrame:
    """Add the bounds on slopes and pieces over these (rows, columns) nodes."""
    lowest, highest = float(np.nanmin(up_m)), float(np.nanmax(up_m))
    axis = grid.scale_m * np.linspace(-1.0, 1.0, 9)
    lattice = np.array([
        (grid.east0_m + e, grid.north0_m + n, up) for e in axis for n in axis for up in (lowest, highest)
    ])  # fmt: skip
    growths = np.array([growth_on_grid(grid, *position) for position in lattice])
    columns, rows = growths[:, 0, :2], growths[:, 1, :2]
    per_column, per_row = (np.hypot(*part.T) for part in (columns, rows))
    skew = float(np.max(np.abs((columns * rows).sum(axis=1)) / (per_column * per_row))) * PIXELS.safe
    grid = grid._replace(
        per_column=float(per_column.max()) * PIXELS.safe,
        per_row=float(per_row.max()) * PIXELS.safe,
        skew=min(1.0, skew + 1e-6),
    )
    bend = _bend_per_m(grid, lattice, growths) * PIXELS.safe
    steepest = steepest_of_finite(up_m, grid)
    piece_m = PIXELS.longest_piece_m
    if bend * steepest > 0.0:
        piece_m = min(piece_m, math.sqrt(8.0 * PIXELS.straight_within_m / (bend * steepest)))
    # A line across the fitted square deviates by its curvature, and the ground by its lean.
    aside_m = bend * (2.0 * math.sqrt(2.0) * grid.scale_m) ** 2 / 8.0 + grid.lean * (highest - lowest)
    return grid._replace(piece_m=piece_m, leeway=aside_m * max(grid.per_column, grid.per_row))


def _bend_per_m(grid: GridFrame, lattice_m: FloatArray, growths: FloatArray) -> float:
    """Largest curvature of straight lines on the grid, 1 / metres on the map."""
    angles = np.arange(12) * math.pi / 12.0
    level = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(12)])
    steep = np.vstack([level * (1.0, 1.0, 0.0) * math.sqrt(0.5) + (0.0, 0.0, s * math.sqrt(0.5)) for s in (-1.0, 1.0)])
    worst = 0.0
    for direction in np.vstack([level, steep]):
        half = 0.5 * PIXELS.curve_length_m * direction
        before, here, after = (positions_on_grid(grid, lattice_m + shift) for shift in (-half, np.zeros(3), half))
        aside = np.linalg.solve(growths[:, :, :2], (here - 0.5 * (before + after))[:, :, None])[:, :, 0]
        worst = max(worst, float(np.hypot(*aside.T).max()))
    return 8.0 * worst / PIXELS.curve_length_m**2


def node_ups_m(from_pixels: FromPixels, frame: LocalFrame, heights_amsl_m: FloatArray) -> FloatArray:
    """Up coordinates (rows, columns) of nodes with these heights above sea level.

    On a plumb line, up is linear in height. The remainder is smooth over columns and rows, so polynomials through a few
    positions suffice; pyproj at each of 30 million nodes would take a minute. By strips, because there may be many.
    """
    rows, columns = heights_amsl_m.shape
    points = chebpts1(2 * PIXELS.up_degree)
    grid_c, grid_r = np.meshgrid(0.5 * (points + 1.0) * (columns - 1), 0.5 * (points + 1.0) * (rows - 1))
    lat, lon = from_pixels(np.column_stack([grid_c.ravel(), grid_r.ravel()]))
    sea = frame.enu_from_geodetic(lat, lon, 0.0)[:, 2]
    per_metre = (frame.enu_from_geodetic(lat, lon, 1_000.0)[:, 2] - sea) / 1_000.0
    inverse = np.linalg.pinv(chebvander(points, PIXELS.up_degree))
    along, across = (chebvander(np.linspace(-1.0, 1.0, size), PIXELS.up_degree) for size in (rows, columns))
    factor, level = (inverse @ each.reshape(grid_c.shape) @ inverse.T for each in (per_metre, sea))
    ups = np.empty(heights_amsl_m.shape)
    step = max(1, PIXELS.strip_nodes // columns)
    for first in range(0, rows, step):
        strip = slice(first, first + step)
        ups[strip] = along[strip] @ factor @ across.T
        ups[strip] *= heights_amsl_m[strip]
        ups[strip] += along[strip] @ level @ across.T
    return ups


def nodes_between(grid: GridFrame, up_m: FloatArray, bounds_m: Bounds) -> tuple[tuple[int, int], tuple[int, int]]:
    """First column and one past the last, and the same of the rows, between west, south, east, north."""
    west, south, east, north = bounds_m
    corners = np.array([(e, n, grid.level_up_m) for e in (west, east) for n in (south, north)])
    box = positions_on_grid(grid, corners)
    first = np.maximum(np.floor(box.min(axis=0) - grid.leeway).astype(int), 0)
    last = np.minimum(np.ceil(box.max(axis=0) + grid.leeway).astype(int) + 1, up_m.shape[::-1])
    return (int(first[0]), int(last[0])), (int(first[1]), int(last[1]))


def nodes_inside_m(grid: GridFrame, up_m: FloatArray, bounds_m: Bounds) -> FloatArray:
    """(k, 3) ENU positions of the nodes between west, south, east, north; NaN ups without data."""
    west, south, east, north = bounds_m
    columns, rows = (np.arange(*ends) for ends in nodes_between(grid, up_m, bounds_m))
    wanted = np.array([axis.ravel() for axis in np.meshgrid(columns, rows)], dtype=float).T.reshape(-1, 2)
    positions = positions_of_nodes_m(grid, wanted, up_m[rows[:, None], columns].reshape(-1))
    e, n = positions[:, 0], positions[:, 1]
    return positions[(e >= west) & (e <= east) & (n >= south) & (n <= north)]


def positions_of_nodes_m(grid: GridFrame, columns_rows: FloatArray, ups_m: FloatArray) -> FloatArray:
    """(k, 3) ENU positions of nodes by (k, 2) columns and rows and (k,) up coordinates.

    Where there is no data the up coordinate stays NaN, and east and north are those at the level of the grid.
    """
    middle = np.array([grid.east0_m, grid.north0_m])
    positions = np.column_stack([np.tile(middle, (len(columns_rows), 1)), ups_m])
    positions[:, 2] = np.where(np.isfinite(ups_m), ups_m, grid.level_up_m)
    # Newton's method: columns and rows are nearly linear in east and north.
    inverse = np.linalg.inv(growth_on_grid(grid, grid.east0_m, grid.north0_m, grid.level_up_m)[:, :2])
    for _ in range(12):
        positions[:, :2] += (columns_rows - positions_on_grid(grid, positions)) @ inverse.T
    positions[:, 2] = ups_m
    return positions


# Vertical datums and units of heights.

_FOOT_M, _SURVEY_FOOT_M = 0.3048, 1200.0 / 3937.0
_UNITS_M = {
    **dict.fromkeys(("m", "metre", "meter", "metres", "meters"), 1.0),
    **dict.fromkeys(("dm", "decimetre", "decimeter"), 0.1),
    **dict.fromkeys(("cm", "centimetre", "centimeter"), 0.01),
    **dict.fromkeys(("ft", "foot", "feet", "international foot"), _FOOT_M),
    **dict.fromkeys(("us-ft", "ftus", "us survey foot", "foot_us", "us survey feet"), _SURVEY_FOOT_M),
}
SEA_LEVEL_DATUMS = {"EGM96": ("egm96", "5773"), "EGM2008": ("egm2008", "3855")}
ELLIPSOID = "WGS84-ellipsoid"
DATUMS = (*SEA_LEVEL_DATUMS, ELLIPSOID)
_WITHOUT_HEIGHT, _ABOVE_EGM96 = 4979, "EPSG:4326+5773"


class Undulation:
    """Height of the EGM96 sea level, which autopilots use, above the WGS 84 ellipsoid, from a grid of PROJ."""

    def __init__(self) -> None:
        """Looks for the grid; nothing is fetched. Raises TerrainError: PROJ does not have it; names it."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of the grid that is not there, which the error names
            group = TransformerGroup(_WITHOUT_HEIGHT, _ABOVE_EGM96, always_xy=True, allow_ballpark=False)
        if not group.transformers or not group.best_available:
            grids = [grid.short_name for operation in group.unavailable_operations for grid in operation.grids]
            raise TerrainError(
                f'terrain.vertical_datum: heights above the ellipsoid ("{ELLIPSOID}") require the geoid grid '
                f"{grids[0] if grids else 'of EGM96'}, which PROJ does not have on this machine; download it (projsync --file "
                f"{grids[0] if grids else 'us_nga_egm96_15.tif'}), or convert the file (gdalwarp with -t_srs EPSG:4326+5773)"
            )
        self._to_sea_level = group.transformers[0]

    def heights_m(self, lat_deg: FloatArray, lon_deg: FloatArray) -> FloatArray:
        """(n,) heights of the sea level above the ellipsoid at geodetic positions.

        Raises:
            TerrainError: the grid does not reach there.
        """
        try:
            _, _, above = self._to_sea_level.transform(lon_deg, lat_deg, np.zeros(np.shape(lat_deg)), errcheck=True)
        except ProjError as error:
            raise TerrainError(f"terrain.vertical_datum: no geoid grid covers the elevation data ({error})") from error
        return -np.asarray(above, dtype=float)


def datum_named(text: str) -> str:
    """One of ``DATUMS``, from the user's spelling. Raises InputError: the name is unknown."""
    known = {datum.casefold(): datum for datum in DATUMS} | {"ellipsoid": ELLIPSOID}
    if text.casefold() not in known:
        raise InputError(f"--vertical-datum: must be EGM96 (SRTM), EGM2008 (Copernicus) or ellipsoid, not {text!r}")
    return known[text.casefold()]


def refuse_feet_by_guess(path: object, horizontal: CRS) -> None:
    """Require the unit of heights if it is not stated and positions are in feet, because heights often are, too.

    Raises:
        TerrainError: the system is in feet.
    """
    axis = horizontal.axis_info[0]
    if 0.3 < axis.unit_conversion_factor < 0.31:
        raise TerrainError(
            f"{path}: the coordinate system {horizontal.name} is in feet, but the file does not state the unit of its heights; "
            'set terrain.height_unit (--height-unit) to "ft", "us-ft" or "m"'
        )


def unit_of_heights_m(path: object, crs: CRS, vertical_datum: str, unit: str | None) -> float:
    """The unit of the heights in metres, once datum and unit are checked.

    Args:
        path: names the file in errors.
        crs: of the file.
        vertical_datum: that of the scenario.
        unit: of the heights, as the file or the scenario has it; None: that of the system, or metres.

    Raises:
        TerrainError: the file names another datum or unit, or a unit that is not known.
    """
    unit_m = _UNITS_M.get((unit or "m").lower().strip())
    if unit_m is None:
        raise TerrainError(f"{path}: the heights are in {unit!r}; convert them to metres first")
    if crs.is_compound:
        vertical = crs.sub_crs_list[1]
        words = f"{vertical.name} {vertical.to_authority()}".lower()
        if not any(word in words for word in SEA_LEVEL_DATUMS.get(vertical_datum, ())):
            raise _contradiction(path, vertical_datum, vertical.name)
        axis = vertical.axis_info[0]
        if unit and abs(axis.unit_conversion_factor / unit_m - 1.0) > 1e-3:
            raise TerrainError(
                f"{path}: the file states both {unit!r} and {axis.unit_name!r} as the unit of its heights; convert "
                "them to metres first"
            )
        unit_m = float(axis.unit_conversion_factor)
    elif len(crs.axis_info) == 3 and vertical_datum != ELLIPSOID:
        raise _contradiction(path, vertical_datum, f"heights above the ellipsoid of {crs.name}")
    return unit_m


def _contradiction(path: object, vertical_datum: str, found: str) -> TerrainError:
    return TerrainError(
        f"terrain.vertical_datum: the scenario says {vertical_datum}, but the file says {found} ({path}); correct the "
        "scenario, or convert the file (gdalwarp with -t_srs EPSG:4326+5773 for EGM96, EPSG:4326+3855 for EGM2008)"
    )

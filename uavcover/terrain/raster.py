"""Elevation files, by rasterio: any format and any CRS, brought to a regular grid in the local frame."""

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
import rasterio.errors
from numpy.typing import NDArray
from pyproj import CRS, Transformer
from pyproj.exceptions import ProjError
from rasterio.windows import Window

from uavcover.errors import TerrainError
from uavcover.frames import LocalFrame
from uavcover.terrain.ground import Ground, grid_ground

FloatArray = NDArray[np.float64]

LOWEST_PLAUSIBLE_M, HIGHEST_PLAUSIBLE_M = -500.0, 9000.0
MAX_NODES = 25_000_000
_SEA_LEVEL_DATUMS = {"EGM96": ("egm96", "5773"), "EGM2008": ("egm2008", "3855")}


@dataclass(frozen=True, eq=False)
class _Raster:
    """An open file and what was checked of it."""

    path: Path
    dataset: Any
    to_source: Transformer
    vertical_datum: str

    def sample_m(self, lat_deg: FloatArray, lon_deg: FloatArray) -> FloatArray:
        """Heights (n,) at geodetic places, bilinear between pixel centres; NaN where a pixel has no data."""
        x, y = self.to_source.transform(lon_deg, lat_deg)
        x, y = np.asarray(x, float), np.asarray(y, float)
        inverse = ~self.dataset.transform
        column = inverse.a * x + inverse.b * y + inverse.c - 0.5
        row = inverse.d * x + inverse.e * y + inverse.f - 0.5
        inside = (column >= 0.0) & (row >= 0.0) & (column <= self.dataset.width - 1) & (row <= self.dataset.height - 1)
        out = np.full(x.shape, np.nan)
        if not inside.any():
            return out
        column, row = column[inside], row[inside]
        first_column, first_row = int(column.min()), int(row.min())
        window = Window(
            first_column, first_row,
            min(self.dataset.width, int(column.max()) + 2) - first_column,
            min(self.dataset.height, int(row.max()) + 2) - first_row,
        )  # fmt: skip
        pixels = self._read(window)
        column, row = column - first_column, row - first_row
        j = np.minimum(column.astype(int), max(pixels.shape[1] - 2, 0))
        i = np.minimum(row.astype(int), max(pixels.shape[0] - 2, 0))
        u, v = column - j, row - i
        j1, i1 = np.minimum(j + 1, pixels.shape[1] - 1), np.minimum(i + 1, pixels.shape[0] - 1)
        upper = pixels[i, j] + u * (pixels[i, j1] - pixels[i, j])
        lower = pixels[i1, j] + u * (pixels[i1, j1] - pixels[i1, j])
        out[inside] = upper + v * (lower - upper)
        return out

    def _read(self, window: Window) -> FloatArray:
        with _readable(self.path):
            masked = self.dataset.read(1, window=window, masked=True)
        scaled = masked.astype(float) * self.dataset.scales[0] + self.dataset.offsets[0]
        pixels = np.asarray(scaled.filled(np.nan), dtype=float)
        pixels[~np.isfinite(pixels)] = np.nan
        wrong = (pixels < LOWEST_PLAUSIBLE_M) | (pixels > HIGHEST_PLAUSIBLE_M)
        if wrong.any():
            row, column = np.argwhere(wrong)[0] + (window.row_off, window.col_off)
            raise TerrainError(
                f"{self.path}: a height of {pixels[wrong][0]:g} m in row {row}, column {column}; if that value "
                "marks missing data, declare it as the no-data value of the file (gdal_edit.py -a_nodata)"
            )
        return pixels


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    try:
        yield
    except (rasterio.errors.RasterioError, OSError) as error:
        reason = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
        raise TerrainError(f"{path}: cannot be read as elevation data ({reason})") from error


@contextmanager
def _open(path: Path, vertical_datum: str) -> Iterator[_Raster]:
    if not path.is_file():
        raise TerrainError(f"{path}: no such file (terrain.file is relative to the scenario file)")
    if path.stat().st_size == 0:
        raise TerrainError(f"{path}: the file is empty")
    if vertical_datum not in _SEA_LEVEL_DATUMS:
        raise TerrainError(
            f"terrain.vertical_datum: heights above the {vertical_datum} are not heights above sea level, which "
            "autopilots want; convert the file first (for example gdalwarp with -t_srs EPSG:4326+5773)"
        )
    with _readable(path), rasterio.open(path) as dataset:
        if dataset.crs is None:
            raise TerrainError(
                f"{path}: has no coordinate reference system; assign the right one (gdal_edit.py -a_srs)"
            )
        try:
            crs = CRS.from_wkt(dataset.crs.to_wkt())
            horizontal = crs.sub_crs_list[0] if crs.is_compound else crs
            # Without a ballpark: a datum that cannot be reached exactly would be off by up to hundreds of metres, unsaid.
            to_source = Transformer.from_crs(4326, horizontal, always_xy=True, allow_ballpark=False)
        except ProjError as error:
            reason = str(error).strip().splitlines()[0]
            raise TerrainError(
                f"{path}: positions cannot be brought to its coordinate reference system ({reason}); assign or convert to a "
                "known one (gdalwarp -t_srs EPSG:4326)"
            ) from error
        _check_vertical(path, crs, vertical_datum, dataset.units[0])
        _check_pixel_size(path, horizontal, dataset)
        yield _Raster(path, dataset, to_source, vertical_datum)


def _check_vertical(path: Path, crs: CRS, vertical_datum: str, unit: str | None) -> None:
    if unit and unit.lower() not in {"m", "metre", "meter", "metres", "meters"}:
        raise TerrainError(f"{path}: heights are in {unit!r}; convert them to metres first")
    if crs.is_compound:
        vertical = crs.sub_crs_list[1]
        words = f"{vertical.name} {vertical.to_authority()}".lower()
        if not any(word in words for word in _SEA_LEVEL_DATUMS[vertical_datum]):
            raise _contradiction(path, vertical_datum, vertical.name)
        axis = vertical.axis_info[0]
        if axis.unit_conversion_factor != 1.0:
            raise TerrainError(f"{path}: heights are in {axis.unit_name!r}; convert them to metres first")
    elif len(crs.axis_info) == 3:
        raise _contradiction(path, vertical_datum, f"heights above the ellipsoid of {crs.name}")


def _contradiction(path: Path, vertical_datum: str, found: str) -> TerrainError:
    return TerrainError(
        f"terrain.vertical_datum: the scenario says {vertical_datum}, the file says {found} ({path}); correct the scenario, "
        "or convert the file (gdalwarp with -t_srs EPSG:4326+5773 for EGM96, EPSG:4326+3855 for EGM2008)"
    )


def _check_pixel_size(path: Path, crs: CRS, dataset: Any) -> None:
    # A south-up file has a negative height.
    width, height = (abs(side) for side in dataset.res)
    top = float(np.abs(_corners(dataset)[1]).max())
    if crs.is_projected and min(width, height) * crs.axis_info[0].unit_conversion_factor < 0.01:
        raise TerrainError(
            f"{path}: pixels of {width:g} x {height:g} in a projected system ({crs.name}): these look like degrees taken "
            "for metres; assign the right coordinate reference system (gdal_edit.py -a_srs EPSG:4326)"
        )
    if crs.is_geographic and (top > 90.5 or width > 10.0):
        raise TerrainError(
            f"{path}: reaches latitude {top:g} with pixels of {width:g} degrees: these look like metres taken for "
            "degrees; assign the right coordinate reference system (gdal_edit.py -a_srs)"
        )


def read_height_amsl_m(path: Path, vertical_datum: str, *, lat_deg: float, lon_deg: float) -> float:
    """Height above sea level of one place in an elevation file, bilinear between its pixels.

    Raises:
        TerrainError: the file cannot be used, or has no data there.
    """
    with _open(path, vertical_datum) as raster:
        height = float(raster.sample_m(np.array([lat_deg]), np.array([lon_deg]))[0])
        if not np.isfinite(height):
            raise TerrainError(f"{path}: no elevation at {lat_deg}, {lon_deg} ({_extent(raster)})")
        return height


def read_ground(
    path: Path,
    vertical_datum: str,
    *,
    frame: LocalFrame,
    bounds_m: tuple[float, float, float, float],
    grid_step_m: float | None,
) -> Ground:
    """Elevation data as a grid in the local frame.

    Each node takes the height of the source, bilinear between its pixel centres, at the geodetic place whose ENU east and
    north are the node's. The origin of the frame is a node.

    Args:
        path: a file that rasterio reads.
        vertical_datum: EGM96 or EGM2008; anything else is refused.
        frame: the local frame.
        bounds_m: west, south, east, north that the grid must reach; nodes outside the data are no-data.
        grid_step_m: spacing of the nodes; default half the smaller side of a source pixel.

    Raises:
        TerrainError: the file cannot be used, or the grid would be too large.
    """
    with _open(path, vertical_datum) as raster:
        step = grid_step_m if grid_step_m is not None else 0.5 * _pixel_side_m(raster, frame)
        west, south, east, north = bounds_m
        if not np.isfinite(step):
            raise TerrainError(
                f"{path}: its coordinate system does not reach the origin of the scenario ({_extent(raster)})"
            )
        wide, high = (east - west) / step + 3.0, (north - south) / step + 3.0
        if wide * high > MAX_NODES:
            raise TerrainError(
                f"terrain.grid_step_m: {wide:.0f} x {high:.0f} nodes of {step:g} m are more than {MAX_NODES:,}; "
                "set a larger step (in metres) or a smaller area"
            )
        columns = np.arange(np.floor(west / step) - 1, np.ceil(east / step) + 2)
        rows = np.arange(np.floor(south / step) - 1, np.ceil(north / step) + 2)
        e, n = np.meshgrid(columns * step, rows * step)
        up = np.zeros(e.size)
        # East and north of a place depend a little on its height, by height difference times distance over the Earth's
        # radius. Each round makes the rest smaller by about distance / radius.
        for _ in range(3):
            known = np.where(np.isfinite(up), up, 0.0)
            lat, lon, _alt = frame.geodetic_from_enu(np.column_stack([e.ravel(), n.ravel(), known]))
            up = frame.enu_from_geodetic(lat, lon, raster.sample_m(lat, lon))[:, 2]
        return grid_ground(
            np.where(np.isfinite(up), up, np.nan).reshape(e.shape),
            east0_m=float(columns[0] * step), north0_m=float(rows[0] * step), step_m=step,
            source=f"{path.name} ({_extent(raster)})", vertical_datum=vertical_datum, sha256=_sha256(path),
        )  # fmt: skip


def _pixel_side_m(raster: _Raster, frame: LocalFrame) -> float:
    """The smaller side of a source pixel at the origin of the frame, metres."""
    x, y = raster.to_source.transform(frame.lon_deg, frame.lat_deg)
    transform = raster.dataset.transform
    corners_x = np.array([x, x + transform.a, x + transform.b])
    corners_y = np.array([y, y + transform.d, y + transform.e])
    lon, lat = raster.to_source.transform(corners_x, corners_y, direction="INVERSE")
    enu = frame.enu_from_geodetic(np.asarray(lat), np.asarray(lon), frame.alt_amsl_m)
    return float(min(np.hypot(*(enu[1, :2] - enu[0, :2])), np.hypot(*(enu[2, :2] - enu[0, :2]))))


def _corners(dataset: Any) -> tuple[FloatArray, FloatArray]:
    """The four outer corners (4,), (4,) of a file in its own coordinates, also when it is rotated or south-up."""
    transform = dataset.transform
    columns = np.array([0.0, dataset.width, 0.0, dataset.width])
    rows = np.array([0.0, 0.0, dataset.height, dataset.height])
    return (
        transform.a * columns + transform.b * rows + transform.c,
        transform.d * columns + transform.e * rows + transform.f,
    )


def _extent(raster: _Raster) -> str:
    lon, lat = raster.to_source.transform(*_corners(raster.dataset), direction="INVERSE")
    return f"data from {min(lat):.4f}, {min(lon):.4f} to {max(lat):.4f}, {max(lon):.4f}"


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()

"""Rasters of the local frame as GeoTIFF, by rasterio."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import rasterio
from numpy.typing import NDArray
from pyproj import CRS, Transformer
from rasterio.io import MemoryFile

from uavcover.kernels.arrays import FloatArray
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.terrain.frames import LocalFrame


@dataclass(frozen=True, slots=True, eq=False)
class Band:
    """One layer."""

    name: str  # description of the band
    unit: str  # of its values, or what they stand for
    values: FloatArray  # (rows, columns), rows going north, NaN where there is none


def cells_geotiff(coverage: CoverageMap, frame: LocalFrame, layers: Sequence[tuple[str, str, NDArray[Any]]]) -> bytes:
    """A GeoTIFF of what is known of each cell of a map.

    Args:
        coverage: the cells.
        frame: of its site.
        layers: name, unit and (cells,) values of each band.
    """
    cells = coverage.grid.cells
    inside = cells.lattice >= 0

    def on_lattice(values: NDArray[Any]) -> FloatArray:
        out = np.full(cells.lattice.shape, np.nan)
        out[inside] = values[cells.lattice[inside]]
        return out

    return geotiff(
        frame,
        [Band(name, unit, on_lattice(values)) for name, unit, values in layers],
        east0_m=cells.east0_m,
        north0_m=cells.north0_m,
        up_m=float(cells.centre_m[:, 2].mean()),
        step_m=cells.size_m,
    )


def geotiff(
    frame: LocalFrame, bands: Sequence[Band], *, east0_m: float, north0_m: float, up_m: float, step_m: float
) -> bytes:
    """A GeoTIFF (float32, NaN is no data) of square cells in the local frame, north up.

    It is in the azimuthal equidistant projection about the frame's origin. That map lies on the ellipsoid and the frame does
    not: its axes are fitted through three corners of the raster at the height of the ground, which leaves millimetres to
    centimetres over ten kilometres.

    Args:
        frame: the local frame.
        bands: of equal shape, at least one.
        east0_m: east of the centre of column 0.
        north0_m: north of the centre of row 0.
        up_m: height of the ground in the frame, for the fit.
        step_m: side of a cell.
    """
    rows, columns = bands[0].values.shape
    crs = CRS.from_proj4(f"+proj=aeqd +lat_0={frame.lat_deg!r} +lon_0={frame.lon_deg!r} +datum=WGS84 +units=m")
    west, south = east0_m - 0.5 * step_m, north0_m - 0.5 * step_m
    east, north = west + columns * step_m, south + rows * step_m
    lat, lon, _ = frame.geodetic_from_enu(np.array([[west, north, up_m], [east, north, up_m], [west, south, up_m]]))
    x, y = Transformer.from_crs(crs.geodetic_crs, crs, always_xy=True).transform(lon, lat)
    transform = rasterio.Affine(
        (x[1] - x[0]) / columns, (x[2] - x[0]) / rows, x[0], (y[1] - y[0]) / columns, (y[2] - y[0]) / rows, y[0]
    )
    with MemoryFile() as memory:
        with memory.open(
            driver="GTiff", width=columns, height=rows, count=len(bands), dtype="float32", nodata=math.nan,
            crs=rasterio.crs.CRS.from_wkt(crs.to_wkt("WKT1_GDAL")), transform=transform, compress="deflate", predictor=3,
        ) as raster:  # fmt: skip
            for number, band in enumerate(bands, start=1):
                raster.write(band.values[::-1].astype(np.float32), number)
                raster.set_band_description(number, band.name)
                raster.update_tags(number, unit=band.unit)
        return bytes(memory.read())

"""Elevation files of made-up rugged relief, in any raster that pyproj knows, and how far a ground is from them."""

import math
from dataclasses import dataclass

import numpy as np
import rasterio
from pyproj import Transformer
from rasterio.transform import Affine

from tests.naive.file_ground import FileGround, ecef_of, geodetic_of


@dataclass(frozen=True, slots=True)
class Position:
    """A raster somewhere on Earth; ``turn_deg`` is by how much its rows are turned in its own system."""

    name: str
    lat_deg: float
    lon_deg: float
    epsg: int
    turn_deg: float = 0.0


POSITIONS = (
    Position("degrees, equator", 0.02, 36.8, 4326),
    Position("degrees, 36 N", 36.48, -84.21, 4326),
    Position("degrees, 60 N", 60.1, 10.3, 4326),
    Position("degrees, 45 S", -45.2, 169.4, 4326),
    Position("UTM, central meridian", 47.2, 9.02, 32632),
    Position("UTM, 2.9 degrees aside", 47.2, 11.9, 32632),
    Position("UTM, 2.9 degrees aside, turned 3", 47.2, 11.9, 32632, 3.0),
    Position("UTM, 60 N, turned -3", 60.1, 6.2, 32632, -3.0),
    Position("UTM south, turned 40", -45.2, 169.4, 32759, 40.0),
    Position("Lambert azimuthal (Europe)", 63.0, 26.0, 3035),
)


def fractal_m(rng, rows, columns, *, pixel_m, steepest):
    """(rows, columns) heights whose spectrum falls with the frequency; the steepest cell has the tangent given."""
    size = max(rows, columns)
    power = np.hypot(*np.meshgrid(np.fft.rfftfreq(size), np.fft.fftfreq(size)))
    power[0, 0] = 1.0
    phases = np.exp(2j * math.pi * rng.random(power.shape))
    field = np.fft.irfft2(phases * power**-2.3, s=(size, size))[:rows, :columns]
    across, along = np.abs(np.diff(field, axis=1)), np.abs(np.diff(field, axis=0))
    rise = np.hypot(np.maximum(across[1:], across[:-1]), np.maximum(along[:, 1:], along[:, :-1])).max()
    return 600.0 + (field - field.mean()) * steepest * pixel_m / rise


def write_dem(path, rng, *, lat_deg, lon_deg, epsg, pixel_m, size_m, turn_deg=0.0, steepest=1.0):
    """A file around a place with pixels of about ``pixel_m``, turned in its own system; a steepest of 1 is 45 degrees."""
    to_file = Transformer.from_crs(4326, epsg, always_xy=True)
    x, y = to_file.transform(lon_deg, lat_deg)
    # The unit of the system in metres here, along both of its axes.
    lon, lat = to_file.transform([x, x + 1e-5, x], [y, y, y + 1e-5], direction="INVERSE")
    positions = ecef_of(np.array(lat), np.array(lon), np.zeros(3))
    metres = np.linalg.norm(positions[1:] - positions[0], axis=1) / 1e-5
    width, height = pixel_m / metres
    c, s = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))
    transform = Affine(c * width, s * width, x, s * height, -c * height, y)
    # However the raster lies, it reaches the corners of the area.
    half_lat = 0.5 * size_m / 111_000.0
    half_lon = half_lat / math.cos(math.radians(lat_deg))
    corners = to_file.transform(
        [lon_deg - half_lon, lon_deg + half_lon] * 2, [lat_deg - half_lat] * 2 + [lat_deg + half_lat] * 2
    )
    reach = max(abs(k) for corner in zip(*corners, strict=True) for k in ~transform @ corner)
    count = 2 * math.ceil(1.03 * reach) + 8
    transform @= Affine.translation(-count / 2, -count / 2)
    heights = fractal_m(rng, count, count, pixel_m=pixel_m, steepest=steepest).astype(np.float32)
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        width=count,
        height=count,
        count=1,
        crs=f"EPSG:{epsg}",
        transform=transform,
        dtype="float32",
    ) as file:
        file.write(heights, 1)
    return path


def largest_difference_m(ground, path, rng, *, origin, size_m, count=40_000, most_agl_m=150.0):
    """Largest difference between heights above ground in the local frame and those above the file, at random places.

    The places are drawn in the local frame and brought to the Earth by formulas of the tests' own. Half of them are on the
    ground within a hair, where rays end, half anywhere up to ``most_agl_m``.
    """
    lat0, lon0 = math.radians(origin[0]), math.radians(origin[1])
    axes = np.array([
        [-math.sin(lon0), math.cos(lon0), 0.0],
        [-math.sin(lat0) * math.cos(lon0), -math.sin(lat0) * math.sin(lon0), math.cos(lat0)],
        [math.cos(lat0) * math.cos(lon0), math.cos(lat0) * math.sin(lon0), math.sin(lat0)],
    ])  # fmt: skip
    positions = np.zeros((count, 3))
    positions[:, :2] = rng.uniform(-0.5 * size_m, 0.5 * size_m, (count, 2))
    positions[:, 2] = ground.heights_m(positions[:, :2])
    positions[count // 2 :, 2] += rng.uniform(0.0, most_agl_m, count - count // 2)
    lat, lon, alt = geodetic_of(ecef_of(*origin) + positions @ axes)
    truth = alt - FileGround(path).height_m(lat, lon)
    assert np.isfinite(truth).all()
    return float(np.abs(ground.heights_agl_m(positions) - truth).max())

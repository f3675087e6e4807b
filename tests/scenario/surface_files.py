"""A ground model and a surface model of one place: a slope, with a wood, a house and noise of centimetres on it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rasterio
from pyproj import Transformer
from rasterio.transform import Affine

EPSG = 32632
WEST_M, NORTH_M, SIDE_M = 448_000.0, 5_200_600.0, 600.0
WOOD = (250.0, 420.0, 150.0, 400.0)
"""West, east, south, north from the south-western corner of the files, metres."""
HOUSE = (120.0, 135.0, 300.0, 312.0)
WOOD_M, HOUSE_M = 22.0, 9.0


@dataclass(frozen=True)
class Models:
    """The two files."""

    ground: Path
    surface: Path


def ground_height_m(east, north):
    """Height above sea level of the true ground at metres from the south-western corner."""
    return 500.0 + 0.12 * east + 0.05 * north + 4.0 * np.sin(east / 60.0) * np.cos(north / 45.0)


def stands_m(east, north):
    """Height of what stands there."""
    out = np.zeros(np.broadcast(east, north).shape)
    for (west, right, south, top), height in ((WOOD, WOOD_M), (HOUSE, HOUSE_M)):
        out = np.where((east > west) & (east < right) & (north > south) & (north < top), height, out)
    return out


def write_models(folder, *, ground_pixel_m=2.0, surface_pixel_m=2.0, noise_m=0.05, shift_m=0.0, factor=1.0):
    """Write both; ``shift_m`` and ``factor`` change the heights of the surface model."""
    rng = np.random.default_rng(20_261_123)
    ground = _write(folder / "dtm.tif", ground_pixel_m, ground_height_m)

    def surface_m(east, north):
        noise = noise_m * rng.standard_normal(np.broadcast(east, north).shape)
        return factor * (ground_height_m(east, north) + stands_m(east, north) + noise + shift_m)

    return Models(ground, _write(folder / "dsm.tif", surface_pixel_m, surface_m))


def _write(path, pixel_m, height_m):
    count = round(SIDE_M / pixel_m)
    east = (np.arange(count) + 0.5) * pixel_m
    north = SIDE_M - (np.arange(count) + 0.5) * pixel_m
    heights = height_m(*np.meshgrid(east, north)).astype(np.float32)
    transform = Affine(pixel_m, 0.0, WEST_M, 0.0, -pixel_m, NORTH_M)
    with rasterio.open(
        path, "w", driver="GTiff", width=count, height=count, count=1, crs=f"EPSG:{EPSG}", transform=transform,
        dtype="float32",
    ) as file:  # fmt: skip
        file.write(heights, 1)
    return path


def lon_lat(east, north):
    """Longitude and latitude of metres from the south-western corner of the files."""
    to_degrees = Transformer.from_crs(EPSG, 4326, always_xy=True)
    return to_degrees.transform(WEST_M + east, NORTH_M - SIDE_M + north)


def scenario_text(*, home=(180.0, 180.0), area=(160.0, 460.0, 160.0, 440.0), terrain="", limits="", more=""):
    """A survey of part of the place; home and area (west, east, south, north) in metres from the corner."""
    west, east, south, north = area
    ring = [list(lon_lat(e, n)) for e, n in ((west, south), (east, south), (east, north), (west, north))]
    lon, lat = lon_lat(*home)
    return f"""
name = "wood"
select = "coverage>=0.9"
[area]
polygon_lon_lat_deg = {ring}
cell_size_m = 5.0
[terrain]
kind = "raster"
file = "dtm.tif"
vertical_datum = "EGM96"
{terrain}
[home]
lat_deg = {lat}
lon_deg = {lon}
[sensor]
kind = "nadir-camera"
fov_deg = 70.0
range_m = 200.0
[limits]
min_height_agl_m = 40.0
max_height_agl_m = 90.0
height_margin_m = 2.0
fence_margin_m = 60.0
{limits}
[vehicle]
cruise_speed_m_s = 10.0
{more}
"""

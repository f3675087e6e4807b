"""Heights above the ground of an elevation file, from rasterio and pyproj alone: no surface, frame or kernel of the package.

The Earth is computed here too: the ellipsoid of WGS 84 by its textbook formulas. Heights above sea level stand where the
formulas want heights above the ellipsoid, as everywhere in the package.
"""

import itertools
import json
import math

import numpy as np
import rasterio
from pyproj import CRS, Transformer

A_M, F = 6_378_137.0, 1.0 / 298.257223563
E2 = F * (2.0 - F)


def ecef_of(lat_deg, lon_deg, alt_m):
    """(n, 3) earth-centred places."""
    lat, lon, alt = np.radians(lat_deg), np.radians(lon_deg), np.asarray(alt_m, float)
    n = A_M / np.sqrt(1.0 - E2 * np.sin(lat) ** 2)
    flat = (n + alt) * np.cos(lat)
    return np.stack([flat * np.cos(lon), flat * np.sin(lon), (n * (1.0 - E2) + alt) * np.sin(lat)], axis=-1)


def geodetic_of(ecef):
    """Latitudes and longitudes in degrees, heights, of (n, 3) earth-centred places, by fixed-point iteration."""
    x, y, z = np.moveaxis(np.asarray(ecef, float), -1, 0)
    flat = np.hypot(x, y)
    lat = np.arctan2(z, flat * (1.0 - E2))
    for _ in range(12):
        n = A_M / np.sqrt(1.0 - E2 * np.sin(lat) ** 2)
        lat = np.arctan2(z + E2 * n * np.sin(lat), flat)
    n = A_M / np.sqrt(1.0 - E2 * np.sin(lat) ** 2)
    return np.degrees(lat), np.degrees(np.arctan2(y, x)), flat * np.cos(lat) + z * np.sin(lat) - A_M**2 / n


class FileGround:
    """The bilinear surface between the centres of the pixels of an elevation file."""

    def __init__(self, path):
        with rasterio.open(path) as dataset:
            crs = CRS.from_wkt(dataset.crs.to_wkt())
            self._to_file = Transformer.from_crs(4326, crs.sub_crs_list[0] if crs.is_compound else crs, always_xy=True)
            self._inverse = ~dataset.transform
            pixels = dataset.read(1, masked=True).astype(float)
            self._pixels = (pixels * dataset.scales[0] + dataset.offsets[0]).filled(np.nan)

    def height_m(self, lat_deg, lon_deg):
        """Height above sea level at places of any shape; NaN where there is none."""
        x, y = self._to_file.transform(np.ravel(lon_deg), np.ravel(lat_deg))
        inverse = self._inverse
        column = inverse.a * x + inverse.b * y + inverse.c - 0.5
        row = inverse.d * x + inverse.e * y + inverse.f - 0.5
        rows, columns = self._pixels.shape
        out = np.full(column.size, np.nan)
        inside = (column >= 0) & (row >= 0) & (column <= columns - 1) & (row <= rows - 1)
        j = np.minimum(np.floor(column[inside]).astype(int), columns - 2)
        i = np.minimum(np.floor(row[inside]).astype(int), rows - 2)
        u, v, z = column[inside] - j, row[inside] - i, self._pixels
        north = z[i, j] * (1.0 - u) + z[i, j + 1] * u
        south = z[i + 1, j] * (1.0 - u) + z[i + 1, j + 1] * u
        out[inside] = north * (1.0 - v) + south * v
        return out.reshape(np.shape(lat_deg))


def leg_ranges_m(ground_m, points, *, step_m):
    """(n - 1, 2) lowest and highest height above ground along straight legs between geodetic points, looked at every step.

    Args:
        ground_m: height above sea level of latitudes and longitudes.
        points: (n, 3) latitude, longitude in degrees, height above sea level.
        step_m: along the leg.
    """
    positions = ecef_of(*np.asarray(points, float).T)
    out = []
    for a, b in itertools.pairwise(positions):
        t = np.linspace(0.0, 1.0, max(2, math.ceil(float(np.linalg.norm(b - a)) / step_m) + 1))
        lat, lon, alt = geodetic_of(a + t[:, None] * (b - a))
        above = alt - ground_m(lat, lon)
        out.append((above.min(), above.max()))
    return np.array(out).reshape(-1, 2)


def plan_points(path):
    """(n, 3) latitudes, longitudes and heights above sea level of the waypoints of a plan.json."""
    waypoints = json.loads(path.read_text(encoding="utf-8"))["waypoints"]
    return np.array([[w["lat_deg"], w["lon_deg"], w["alt_amsl_m"]] for w in waypoints])


def enu_points(path):
    """(n, 3) latitudes, longitudes and heights of the same waypoints, from their local coordinates and the origin alone."""
    plan = json.loads(path.read_text(encoding="utf-8"))
    lat, lon = math.radians(plan["origin"]["lat_deg"]), math.radians(plan["origin"]["lon_deg"])
    origin = ecef_of(plan["origin"]["lat_deg"], plan["origin"]["lon_deg"], plan["origin"]["alt_amsl_m"])
    east = np.array([-math.sin(lon), math.cos(lon), 0.0])
    north = np.array([-math.sin(lat) * math.cos(lon), -math.sin(lat) * math.sin(lon), math.cos(lat)])
    up = np.array([math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)])
    enu = np.array([[w["east_m"], w["north_m"], w["up_m"]] for w in plan["waypoints"]])
    return np.column_stack(geodetic_of(origin + enu @ np.stack([east, north, up])))


def mission_points(path):
    """(n, 3) latitudes, longitudes and heights above sea level of the waypoints (command 16) of a .waypoints file, in order.

    Line 0 is home; heights in frame 3 are above it.
    """
    rows = [line.split("\t") for line in path.read_text(encoding="utf-8").splitlines()[1:] if line]
    home_m = float(rows[0][10])
    out = []
    for row in rows[1:]:
        if int(row[3]) == 16:
            assert int(row[2]) in (0, 3)
            out.append((float(row[8]), float(row[9]), float(row[10]) + (home_m if int(row[2]) == 3 else 0.0)))
    return np.array(out)

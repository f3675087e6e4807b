"""What the pictures of a plan show, from its files alone: own places on the Earth, own trigger, own rays, other cells.

Nothing of the package is used. Places come from latitude, longitude and height in ``plan.json`` through pyproj into the elevation
file's own system, which has to be metric there and true to scale; the camera trigger is flown in small steps; cells are half as
large as the scenario's and moved against them.
"""

import itertools
import json
import math
import tomllib
from pathlib import Path

import numpy as np
import rasterio
from pyproj import Transformer

_STEP_M = 0.01
_SAMPLES = 60
_GRAZING_M = 0.02
"""A ray may dip this far below the ground: it is sampled, and ends on a surface of triangles and saddles."""


class Dem:
    """A bilinear surface over the pixel centres of a file, north up, in metres."""

    def __init__(self, path):
        with rasterio.open(path) as file:
            self.values = file.read(1).astype(float)
            self.crs = file.crs
            self.west, self.north, self.pixel_m = file.transform.c, file.transform.f, file.transform.a

    def at(self, x, y):
        column = (np.asarray(x) - self.west) / self.pixel_m - 0.5
        row = (self.north - np.asarray(y)) / self.pixel_m - 0.5
        i, j = np.floor(row).astype(int), np.floor(column).astype(int)
        s, t = row - i, column - j
        z = self.values
        return (z[i, j] * (1 - t) + z[i, j + 1] * t) * (1 - s) + (z[i + 1, j] * (1 - t) + z[i + 1, j + 1] * t) * s


def trigger(route, distance_m, step_m=_STEP_M):
    """Places of pictures and headings (east, north): fly on in small steps, shoot when the last picture is far enough away."""
    places, headings = [], []
    for a, b in itertools.pairwise([tuple(map(float, point)) for point in route]):
        over_ground = math.dist(a[:2], b[:2])
        if over_ground == 0.0:
            continue
        heading = ((b[0] - a[0]) / over_ground, (b[1] - a[1]) / over_ground)
        if not places:
            places, headings = [a], [heading]
        steps = max(1, math.ceil(over_ground / step_m))
        for k in range(1, steps + 1):
            here = tuple(p + k / steps * (q - p) for p, q in zip(a, b, strict=True))
            if math.dist(here[:2], places[-1][:2]) >= distance_m - 1e-9:
                places.append(here)
                headings.append(heading)
    return np.array(places), np.array(headings)


def picture_distance_m(scenario):
    """Between two pictures: said, or by the overlap of pictures of flat ground from the lowest height."""
    sensor = scenario["sensor"]
    if "trigger_distance_m" in sensor:
        return sensor["trigger_distance_m"]
    tilt, half = math.radians(90.0 + sensor.get("pitch_deg", -90.0)), math.radians(sensor["fov_along_deg"] / 2)
    height = scenario["limits"]["min_height_agl_m"]
    return (1.0 - sensor["forward_overlap"]) * height * (math.tan(tilt + half) - math.tan(tilt - half))


def cells(dem, ring, size_m):
    """Centres (n, 3), upward unit normals and areas of cells of half the size, moved by a third of it."""
    ring = np.asarray(ring, dtype=float)
    half = size_m / 2
    low, high = ring.min(axis=0), ring.max(axis=0)
    x, y = np.meshgrid(*(np.arange(low[k] + half / 3, high[k], half) for k in (0, 1)))
    x, y = x.ravel(), y.ravel()
    inside = np.zeros(len(x), dtype=bool)
    for (ax, ay), (bx, by) in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        if ay != by:
            inside ^= ((ay > y) != (by > y)) & (x < (bx - ax) * (y - ay) / (by - ay) + ax)
    x, y = x[inside], y[inside]
    step = 0.01
    slope_x = (dem.at(x + step, y) - dem.at(x - step, y)) / (2 * step)
    slope_y = (dem.at(x, y + step) - dem.at(x, y - step)) / (2 * step)
    long = np.sqrt(1 + slope_x**2 + slope_y**2)
    normals = np.column_stack([-slope_x, -slope_y, np.ones_like(x)]) / long[:, None]
    return np.column_stack([x, y, dem.at(x, y)]), normals, half * half * long


def seen(dem, sensor, centres, normals, places, headings):
    """(n,) whether any picture shows each cell."""
    across = math.tan(math.radians(sensor["fov_across_deg"] / 2)) * (1 - sensor.get("side_overlap", 0.0))
    along = math.tan(math.radians(sensor["fov_along_deg"] / 2))
    pitch = math.radians(sensor.get("pitch_deg", -90.0))
    steepest = math.cos(math.radians(sensor.get("max_incidence_deg", 85.0)))
    shares = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    found = np.zeros(len(centres), dtype=bool)
    for eye, (he, hn) in zip(places, headings, strict=True):
        left = np.flatnonzero(~found)
        ray = centres[left] - eye
        forward, right = ray[:, 0] * he + ray[:, 1] * hn, ray[:, 0] * hn - ray[:, 1] * he
        depth = forward * math.cos(pitch) + ray[:, 2] * math.sin(pitch)
        top = -forward * math.sin(pitch) + ray[:, 2] * math.cos(pitch)
        long = np.linalg.norm(ray, axis=1)
        facing = -(ray * normals[left]).sum(axis=1)
        inside = (depth > 0) & (np.abs(right) <= across * depth) & (np.abs(top) <= along * depth)
        inside &= (long <= sensor["range_m"]) & (facing >= steepest * long)
        left, ray = left[inside], ray[inside]
        line = eye + shares[None, :, None] * ray[:, None, :]
        clear = (line[..., 2] - dem.at(line[..., 0], line[..., 1]) >= -_GRAZING_M).all(axis=1)
        found[left[clear]] = True
    return found


def true_coverage(run):
    """Share of the area's ground that the pictures of a plan show; and how many pictures there are."""
    run = Path(run)
    scenario = tomllib.loads((run / "scenario.toml").read_text())
    plan = json.loads((run / "plan.json").read_text())
    file = Path(scenario["terrain"]["file"])
    dem = Dem(file if file.is_absolute() else run / file)
    return coverage_of(dem, scenario, plan["waypoints"], plan["origin"])


def coverage_of(dem, scenario, waypoints, origin):
    """The same of waypoints with ``lat_deg``, ``lon_deg`` and ``alt_amsl_m``."""
    to_file = Transformer.from_crs(4326, dem.crs, always_xy=True)
    route = np.array([
        (*to_file.transform(point["lon_deg"], point["lat_deg"]), point["alt_amsl_m"]) for point in waypoints
    ])  # fmt: skip
    x0, y0 = to_file.transform(origin["lon_deg"], origin["lat_deg"])
    ring = np.array(scenario["area"]["polygon_east_north_m"]) + np.array((x0, y0))
    centres, normals, areas = cells(dem, ring, scenario["area"]["cell_size_m"])
    places, headings = trigger(route, picture_distance_m(scenario))
    shown = seen(dem, scenario["sensor"], centres, normals, places, headings)
    return float(areas[shown].sum() / areas.sum()), len(places)

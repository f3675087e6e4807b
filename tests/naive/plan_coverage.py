"""What a plan sees, from its files alone: own places on the Earth, own trigger, own rays, other cells.

Nothing of the package is used. Places come from latitude, longitude and height in ``plan.json`` through pyproj into the elevation
file's own system, which has to be metric there and true to scale; the camera trigger is flown in small steps; cells are half as
large as the scenario's and moved against them. The line is the one that ArduCopter flies beside its waypoints, or PX4
through them.
"""

import itertools
import json
import math
import tomllib
from pathlib import Path

import numpy as np
import rasterio
import shapely
from pyproj import Transformer
from scipy.spatial import cKDTree

from tests.naive.flown_line import arducopter, passed_corners, px4_begins, reached_positions, turning, yaw, yaw_behind

_STEP_M = 0.01
_SAMPLES = 80

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


def trigger(route, distance_m, step_m=_STEP_M, yaws=None):
    """Places of pictures and headings (east, north): fly on in small steps, shoot when the last picture is far enough away."""
    positions, headings = [], []
    for leg, (a, b) in enumerate(itertools.pairwise([tuple(map(float, point)) for point in route])):
        over_ground = math.dist(a[:2], b[:2])
        if over_ground == 0.0:
            continue
        heading = ((b[0] - a[0]) / over_ground, (b[1] - a[1]) / over_ground) if yaws is None else yaws[leg]
        if not positions:
            positions, headings = [a], [heading]
        steps = max(1, math.ceil(over_ground / step_m))
        for k in range(1, steps + 1):
            here = tuple(p + k / steps * (q - p) for p, q in zip(a, b, strict=True))
            if math.dist(here[:2], positions[-1][:2]) >= distance_m - 1e-9:
                # A step too far each time would be metres in the end: halve it until the place is known.
                near, far = (k - 1) / steps, k / steps
                for _ in range(30):
                    middle = 0.5 * (near + far)
                    here = tuple(p + middle * (q - p) for p, q in zip(a, b, strict=True))
                    is_due = math.dist(here[:2], positions[-1][:2]) >= distance_m - 1e-9
                    near, far = (near, middle) if is_due else (middle, far)
                here = tuple(p + far * (q - p) for p, q in zip(a, b, strict=True))
                positions.append(here)
                headings.append(heading)
    return np.array(positions), np.array(headings)


def along(route, spacing_m, yaws=None):
    """Places and headings all along the legs, both ends of each included: at a waypoint a sensor looks along both legs."""
    positions, headings = [], []
    for leg, (a, b) in enumerate(itertools.pairwise(np.asarray(route, dtype=float))):
        over_ground = math.dist(a[:2], b[:2])
        heading = (b - a)[:2] / over_ground if over_ground > 0.0 else np.zeros(2)
        if yaws is not None:
            heading = yaws[leg]
        for t in np.linspace(0.0, 1.0, max(1, math.ceil(math.dist(a, b) / spacing_m - 1e-9)) + 1):
            positions.append(a + t * (b - a))
            headings.append(heading)
    return np.array(positions), np.array(headings)


def spacing_m(scenario):
    """Between two looks along the path: said, or a third of half of what is seen (a twelfth of photos that do not turn)."""
    sensor, limits = scenario["sensor"], scenario["limits"]
    if "sample_spacing_m" in sensor:
        return sensor["sample_spacing_m"]
    low = limits["min_height_agl_m"]
    match sensor["kind"]:
        case "disc":
            half = sensor["radius_m"]
        case "sphere":
            half = math.sqrt(max(sensor["range_m"] ** 2 - (0.5 * (low + limits["max_height_agl_m"])) ** 2, 900.0))
        case "nadir-camera":
            half = low * math.tan(math.radians(0.5 * sensor["fov_deg"]))
        case _:
            half = low * math.tan(math.radians(0.5 * min(sensor["fov_across_deg"], sensor["fov_along_deg"])))
            half /= 4.0 if "heading_deg" in sensor else 1.0
    return min(10.0, half / 3.0)


def photo_distance_m(scenario):
    """Between two pictures: said, or by the overlap of pictures of flat ground from the lowest height; None: no trigger."""
    sensor = scenario["sensor"]
    if "trigger_distance_m" in sensor:
        return sensor["trigger_distance_m"]
    if "forward_overlap" not in sensor:
        return None
    tilt, half = math.radians(90.0 + sensor.get("pitch_deg", -90.0)), math.radians(sensor["fov_along_deg"] / 2)
    height = scenario["limits"]["min_height_agl_m"]
    return (1.0 - sensor["forward_overlap"]) * height * (math.tan(tilt + half) - math.tan(tilt - half))


def flown_looks(scenario, route, top):
    """As :func:`looks`, along the line that ArduCopter flies from above home, round the waypoints and back.

    PX4 has reached a waypoint before it is there: the route ends there.
    """
    if scenario["vehicle"].get("autopilot") == "px4":
        reached = reached_positions([top, *route])
        if _looks_from_waypoints(scenario["sensor"]):
            return looks(scenario, reached)
        return _px4_looks(scenario, route, reached, np.asarray(route[0])[:2] - top[:2])
    pace = arducopter(scenario["vehicle"])
    corners, steps_s = passed_corners([top, *route, top], pace)
    if _looks_from_waypoints(scenario["sensor"]):
        return looks(scenario, corners[:, corners.shape[1] // 2])
    triggered = photo_distance_m(scenario) is not None
    if triggered:
        corners[0] = route[0]  # it stops where its pictures begin
    half = corners.shape[1] // 2
    line = corners.reshape(-1, 3)
    pieces_s = np.column_stack([np.tile(steps_s[:, None], 2 * half), np.zeros(len(steps_s))]).ravel()
    there = np.asarray(route[0])[:2] - top[:2]
    there = there / np.linalg.norm(there)
    yaws = yaw(line, pieces_s, pace.cruise_m_s, there)
    # How its ends are passed depends on the ways there and home: only what is nearly on a leg counts.
    ends = half + half // 2
    first, last = 2 * half if triggered else ends, len(line) - ends
    before = yaw_behind(there, yaws[:first], pieces_s[:first])
    line, yaws, pieces_s = line[first:last], yaws[first : last - 1], pieces_s[first : last - 1]
    if _turns(scenario["sensor"]):
        # A leg begins with the speed of the last step of the corner.
        begins = [0.0 if triggered else pace.cruise_m_s]
        for a, b, seconds in zip(line, line[1:], pieces_s, strict=False):
            begins.append(min(pace.cruise_m_s, math.dist(a, b) / seconds) if seconds > 0.0 else 0.0)
        line, yaws = turning(line, pieces_s, yaws, begins, before, pace.cruise_m_s, pace.acceleration_m_s2)
    positions, headings = looks(scenario, line, yaws)
    if triggered and "heading_deg" not in scenario["sensor"]:
        headings[0] = there
    return positions, headings


def _px4_looks(scenario, route, reached, there):
    """Through the waypoints to where the last one is reached; the nose turns to the next one from where one is reached."""
    sensor, vehicle = scenario["sensor"], scenario["vehicle"]
    route = np.asarray(route, dtype=float)
    line = np.array([*route[:-1], reached[-1]])
    if not _turns(sensor):
        return looks(scenario, line)
    cruise_m_s, acceleration_m_s2 = vehicle["cruise_speed_m_s"], vehicle.get("acceleration_m_s2", 3.0)
    paths, lengths_m = [], []
    for k in range(len(route) - 1):
        is_upright = math.dist(line[k][:2], line[k + 1][:2]) == 0.0
        paths.append((0.0, 0.0) if is_upright else (route[k + 1] - reached[k])[:2])
        lengths_m.append(math.dist(reached[k], reached[k + 1]))
    begins = px4_begins(route, there, cruise_m_s, acceleration_m_s2)
    legs = np.zeros(len(paths))
    finer, yaws = turning(
        line,
        legs,
        paths,
        begins,
        there,
        cruise_m_s,
        acceleration_m_s2,
        lengths_m=lengths_m,
        yaw_acceleration_deg_s2=20.0,
    )  # MPC_YAWRAUTO_ACC
    positions, headings = looks(scenario, finer, yaws)
    if photo_distance_m(scenario) is not None:
        headings[0] = there / np.linalg.norm(there)
    return positions, headings


def _turns(sensor):
    """Whether it looks where the nose points."""
    return sensor["kind"] == "frame-camera" and "heading_deg" not in sensor


def _looks_from_waypoints(sensor):
    return sensor.get("sensing", "along-path" if "camera" in sensor["kind"] else "at-waypoints") == "at-waypoints"


def looks(scenario, route, yaws=None):
    """Where the sensor looks from, and its headings: along each leg, or as it is said of each."""
    sensor = scenario["sensor"]
    distance_m = photo_distance_m(scenario)
    if _looks_from_waypoints(sensor):
        positions, headings = np.asarray(route, dtype=float), np.full((len(route), 2), np.nan)
    elif distance_m is not None:
        positions, headings = trigger(route, distance_m, yaws=yaws)
    else:
        positions, headings = along(route, spacing_m(scenario), yaws)
    if "heading_deg" in sensor:
        path = math.radians(sensor["heading_deg"])
        headings = np.tile([math.sin(path), math.cos(path)], (len(positions), 1))
    return positions, headings


def cells(dem, area, prisms, size_m, fewest=0):
    """Centres (n, 3), upward unit normals and areas of cells of half the size, moved by a third of it; roofs are flat.

    Where a number of them is wanted, so many at least, each at a random place of its square: the pixels of the elevation file are
    a lattice too, and one cell in five or ten at the same place of its pixel is no fair sample of a cliff one pixel wide.
    """
    west, south, east, north = area.bounds
    half = min(size_m / 2, math.sqrt(area.area / fewest)) if fewest else size_m / 2
    x, y = np.meshgrid(np.arange(west + half / 3, east + half, half), np.arange(south + half / 3, north + half, half))
    if fewest:
        x, y = np.array([x, y]) + half / 3 + np.random.default_rng(1).uniform(-half, 0.0, (2, *x.shape))
    x, y = x.ravel(), y.ravel()
    inside = shapely.contains_xy(area, x, y)
    x, y = x[inside], y[inside]
    step = 0.01
    slope_x = (dem.at(x + step, y) - dem.at(x - step, y)) / (2 * step)
    slope_y = (dem.at(x, y + step) - dem.at(x, y - step)) / (2 * step)
    z = dem.at(x, y)
    for footprint, top in prisms:
        roof = shapely.contains_xy(footprint, x, y)
        roof &= z < top  # where two overlap, the higher one is seen
        z[roof], slope_x[roof], slope_y[roof] = top, 0.0, 0.0
    long = np.sqrt(1 + slope_x**2 + slope_y**2)
    normals = np.column_stack([-slope_x, -slope_y, np.ones_like(x)]) / long[:, None]
    return np.column_stack([x, y, z]), normals, half * half * long


def _in_view(sensor, ray, normal, heading):
    """Which of the (n, 3) rays from the sensor to the ground it takes in: ground that faces it, but for the paper's disc."""
    kind = sensor["kind"]
    long = np.linalg.norm(ray, axis=1)
    if kind == "disc":
        return np.hypot(ray[:, 0], ray[:, 1]) <= sensor["radius_m"]
    facing = -(ray * normal).sum(axis=1)
    if kind == "sphere":
        return (long <= sensor["range_m"]) & (facing > 0.0)
    near = (long <= sensor["range_m"]) & (long > 0.0)
    near &= facing >= math.cos(math.radians(sensor.get("max_incidence_deg", 75.0))) * long
    if kind == "nadir-camera":
        return near & (-ray[:, 2] >= math.cos(math.radians(sensor["fov_deg"] / 2)) * long)
    if np.isnan(heading).any() or not np.any(heading):
        return np.zeros(len(ray), dtype=bool)
    across = math.tan(math.radians(sensor["fov_across_deg"] / 2)) * (1 - sensor.get("side_overlap", 0.0))
    upright = math.tan(math.radians(sensor["fov_along_deg"] / 2))
    pitch = math.radians(sensor.get("pitch_deg", -90.0))
    forward, right = ray[:, :2] @ heading, ray[:, 0] * heading[1] - ray[:, 1] * heading[0]
    depth = forward * math.cos(pitch) + ray[:, 2] * math.sin(pitch)
    top = -forward * math.sin(pitch) + ray[:, 2] * math.cos(pitch)
    return near & (depth > 0) & (np.abs(right) <= across * depth) & (np.abs(top) <= upright * depth)


def observed(dem, prisms, sensor, centres, normals, positions, headings):
    """(n,) whether the sensor sees each cell from any of the places."""
    fractions = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    found = np.zeros(len(centres), dtype=bool)
    tree = cKDTree(centres[:, :2])
    widest = sensor.get("range_m", sensor.get("radius_m"))
    for eye, heading in zip(positions, headings, strict=True):
        left = np.array(tree.query_ball_point(eye[:2], widest), dtype=int)
        left = left[~found[left]]
        if not len(left):
            continue
        ray = centres[left] - eye
        inside = _in_view(sensor, ray, normals[left], heading)
        left, ray = left[inside], ray[inside]
        if sensor["kind"] != "disc":
            line = eye + fractions[None, :, None] * ray[:, None, :]
            clear = (line[..., 2] - dem.at(line[..., 0], line[..., 1]) >= -_GRAZING_M).all(axis=1)
            for footprint, top in prisms:
                low = line[..., 2] < top - _GRAZING_M
                near = np.flatnonzero(clear & low.any(axis=1))
                if len(near):
                    within = shapely.contains_xy(footprint, line[near][..., 0], line[near][..., 1]) & low[near]
                    clear[near[within.any(axis=1)]] = False
            left = left[clear]
        found[left] = True
    return found


def _ground_of(scenario, folder):
    """The elevation file, the area and the prisms of a scenario file, in the system of the elevation file."""

    def path(name):
        return Path(name) if Path(name).is_absolute() else Path(folder) / name

    dem = Dem(path(scenario["terrain"]["file"]))
    to_file = Transformer.from_crs(4326, dem.crs, always_xy=True)

    def of_geojson(name):
        document = json.loads(path(name).read_text())
        features = document["features"] if document["type"] == "FeatureCollection" else [document]
        for feature in features:
            shape = shapely.geometry.shape(feature.get("geometry", feature))
            yield shapely.transform(shape, to_file.transform, interleaved=False), feature.get("properties") or {}

    area = scenario["area"]
    if "geojson" in area:
        ground = shapely.union_all([shape for shape, _ in of_geojson(area["geojson"])])
    else:
        zero = to_file.transform(scenario["origin"]["lon_deg"], scenario["origin"]["lat_deg"])
        ground = shapely.Polygon(np.array(area["polygon_east_north_m"]) + np.array(zero))
    prisms = []
    if "file" in scenario.get("obstacles", {}):
        for shape, properties in of_geojson(scenario["obstacles"]["file"]):
            corner = shapely.get_coordinates(shapely.segmentize(shape, 0.5))
            within = np.array([(x, y) for x, y in _lattice(shape) if shape.contains(shapely.Point(x, y))] + [*corner])
            prisms.append((shape, float(dem.at(*within.T).max()) + properties["height_m"]))
    return dem, ground, prisms, to_file


def _lattice(shape, step_m=1.0):
    west, south, east, north = shape.bounds
    return itertools.product(np.arange(west, east, step_m), np.arange(south, north, step_m))


def coverage_of(scenario, folder, waypoints, fewest_cells=0):
    """Share of the area's ground that waypoints see, and the number of looks.

    Args:
        scenario: a scenario file as a dictionary.
        folder: its files lie there.
        waypoints: with ``lat_deg``, ``lon_deg`` and ``alt_amsl_m``.
        fewest_cells: none: a lattice of half the scenario's cell size; else so many at least, at random places.
    """
    dem, ground, prisms, to_file = _ground_of(scenario, folder)
    route = np.array([
        (*to_file.transform(point["lon_deg"], point["lat_deg"]), point["alt_amsl_m"]) for point in waypoints
    ])  # fmt: skip
    centres, normals, areas = cells(dem, ground, prisms, scenario["area"]["cell_size_m"], fewest_cells)
    home = scenario.get("home")
    if home is None or scenario["limits"].get("applies_to") == "waypoints":
        positions, headings = looks(scenario, route)
    else:
        east, north = to_file.transform(home["lon_deg"], home["lat_deg"])
        top = np.array([east, north, float(dem.at(east, north)) + scenario["vehicle"]["takeoff_height_m"]])
        positions, headings = flown_looks(scenario, route, top)
    shown = observed(dem, prisms, scenario["sensor"], centres, normals, positions, headings)
    return float(areas[shown].sum() / areas.sum()), len(positions)


def true_coverage(run):
    """The same of the plan of a run folder whose scenario has its area in metres."""
    run = Path(run)
    scenario = tomllib.loads((run / "scenario.toml").read_text())
    plan = json.loads((run / "plan.json").read_text())
    return coverage_of(scenario | {"origin": plan["origin"]}, run, plan["waypoints"])

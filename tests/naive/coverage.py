"""What a sensor sees, by its definition: angles as angles, every cell against every place."""

import itertools
import math

import numpy as np

from tests.naive import obstacles as naive_obstacles
from tests.naive import surface as naive_surface
from uavcover.kernels.cells import GRAZING_M
from uavcover.kernels.sight import CONE, DISC, FRUSTUM, MIDPOINT, RAY, SPHERE
from uavcover.kernels.surface import SINE_COSINE


def height(surface, east, north):
    if surface.kind == SINE_COSINE:
        return naive_surface.analytic_height(surface.step_m, east, north)
    nodes = surface.up_m.tolist()
    return naive_surface.height(nodes, surface.grid, east, north, float)


def _angle_deg(a, b):
    dot = sum(x * y for x, y in zip(a, b, strict=True))
    return math.degrees(math.acos(max(-1.0, min(1.0, dot / (math.hypot(*a) * math.hypot(*b))))))


def in_camera_frame(sight, ray, heading):
    """A ray turned into the axes of a level vehicle's camera: right, top of the picture, depth."""
    he, hn = heading if math.isnan(sight.heading_e) else (sight.heading_e, sight.heading_n)
    # Turn the heading to the north, then the camera's axis from its pitch to the horizon.
    yaw = math.atan2(he, hn)
    east = ray[0] * math.cos(yaw) - ray[1] * math.sin(yaw)
    north = ray[0] * math.sin(yaw) + ray[1] * math.cos(yaw)
    pitch = math.atan2(sight.sin_pitch, sight.cos_pitch)
    return (
        east,
        ray[2] * math.cos(pitch) - north * math.sin(pitch),
        north * math.cos(pitch) + ray[2] * math.sin(pitch),
    )


def ground_sample_m(focal_px, distance, off_axis_deg, incidence_deg):
    """A pixel's solid angle cos^3 / f^2, spread over ground at that distance and incidence."""
    solid = math.cos(math.radians(off_axis_deg)) ** 3 / focal_px**2
    return math.sqrt(distance**2 * solid / math.cos(math.radians(incidence_deg)))


def in_view(sight, eye, centre, normal, heading=(0.0, 1.0)):
    ray = [e - c for e, c in zip(eye, centre, strict=True)]
    if sight.kind == DISC:
        return math.hypot(ray[0], ray[1]) <= sight.reach_m
    distance = math.hypot(*ray)
    if distance > sight.reach_m:
        return False
    if sight.kind == SPHERE:
        return True
    half_fov = math.degrees(math.atan(sight.tan_half_fov))
    if sight.kind == CONE:
        off_axis = _angle_deg(ray, (0.0, 0.0, 1.0))
        inside = off_axis <= half_fov
    else:
        assert sight.kind == FRUSTUM
        if math.isnan(sight.heading_e) and tuple(heading) == (0.0, 0.0):
            return False
        right, top, depth = in_camera_frame(sight, [-x for x in ray], heading)
        off_axis = math.degrees(math.atan2(math.hypot(right, top), depth))
        half_along = math.degrees(math.atan(sight.tan_half_along))
        inside = (
            depth > 0.0
            and abs(math.degrees(math.atan2(right, depth))) <= half_fov
            and abs(math.degrees(math.atan2(top, depth))) <= half_along
        )
    incidence = _angle_deg(ray, normal)
    if not inside or incidence > math.degrees(math.acos(sight.cos_max_incidence)):
        return False
    if sight.sample_focal_m == math.inf:
        return True
    # For one pixel of focal length.
    return incidence < 90.0 and ground_sample_m(1.0, distance, off_axis, incidence) <= sight.sample_focal_m


def in_line_of_sight(surface, sight, eye, centre):
    if sight.line_of_sight == MIDPOINT:
        east, north, up = (0.5 * (e + c) for e, c in zip(eye, centre, strict=True))
        return up >= height(surface, east, north)
    if sight.line_of_sight == RAY:
        if naive_obstacles.enters(naive_obstacles.prisms_of(surface.obstacles), eye, centre) > 1e-9:
            return False
        if surface.kind == SINE_COSINE:
            east, north, up = np.linspace(eye, centre, 401).T
            ground = surface.step_m * np.sin(north / surface.step_m) * np.cos(east / surface.step_m)
            return bool((up - ground >= -GRAZING_M).all())
        low, _ = naive_surface.height_range_above(surface.up_m.tolist(), surface.grid, list(eye), list(centre), float)
        return low >= -GRAZING_M
    return True


def observes(surface, sight, eye, centre, normal, heading=(0.0, 1.0)):
    if not all(math.isfinite(x) for x in eye):
        return False
    return in_view(sight, eye, centre, normal, heading) and in_line_of_sight(surface, sight, eye, centre)


def first_observed(surface, sight, cells, eyes, headings):
    first = []
    observations = list(zip(eyes.tolist(), headings.tolist(), strict=True))
    for centre, normal in zip(cells.centre_m.tolist(), cells.normal.tolist(), strict=True):
        observed_by = [
            k for k, (eye, heading) in enumerate(observations) if observes(surface, sight, eye, centre, normal, heading)
        ]
        first.append(observed_by[0] if observed_by else -1)
    return first


def sample_path(route, spacing):
    """Each leg in the fewest equal pieces not longer than ``spacing``."""
    route = [tuple(point) for point in route]
    points = route[:1]
    for a, b in itertools.pairwise(route):
        pieces = 1
        while math.dist(a, b) / pieces > spacing * (1 + 1e-9):
            pieces += 1
        points += [tuple(x + k / pieces * (y - x) for x, y in zip(a, b, strict=True)) for k in range(1, pieces)] + [b]
    return points


def observed_often(surface, sight, cells, eyes, headings, needed, apart_m):
    """Number of the look with which each cell has that many, taken in order and none too near to one that counts."""
    found = []
    for centre, normal in zip(cells.centre_m.tolist(), cells.normal.tolist(), strict=True):
        counted = []
        number = -1
        for k, (eye, heading) in enumerate(zip(eyes.tolist(), headings.tolist(), strict=True)):
            if number < 0 and observes(surface, sight, eye, centre, normal, heading):
                if all(math.dist(eye, other) >= apart_m for other in counted):
                    counted.append(eye)
                if len(counted) == needed:
                    number = k
        found.append(number)
    return found

"""What a sensor sees, by its definition: angles as angles, every cell against every place."""

import itertools
import math

from tests.naive import obstacles as naive_obstacles
from tests.naive import surface as naive_surface
from uavcover.kernels.coverage import CONE, DISC, GRAZING_M, MIDPOINT, RAY, SPHERE
from uavcover.kernels.surface import SINE_COSINE


def height(surface, east, north):
    if surface.kind == SINE_COSINE:
        return naive_surface.analytic_height(surface.step_m, east, north)
    nodes = surface.up_m.tolist()
    return naive_surface.height(nodes, surface.east0_m, surface.north0_m, surface.step_m, east, north)


def _angle_deg(a, b):
    dot = sum(x * y for x, y in zip(a, b, strict=True))
    return math.degrees(math.acos(max(-1.0, min(1.0, dot / (math.hypot(*a) * math.hypot(*b))))))


def in_view(sight, eye, centre, normal):
    ray = [e - c for e, c in zip(eye, centre, strict=True)]
    if sight.kind == DISC:
        return math.hypot(ray[0], ray[1]) <= sight.reach_m
    if math.hypot(*ray) > sight.reach_m:
        return False
    if sight.kind == SPHERE:
        return True
    assert sight.kind == CONE
    off_nadir = _angle_deg(ray, (0.0, 0.0, 1.0))
    incidence = _angle_deg(ray, normal)
    half_fov = math.degrees(math.atan(sight.tan_half_fov))
    return off_nadir <= half_fov and incidence <= math.degrees(math.acos(sight.cos_max_incidence))


def in_line_of_sight(surface, sight, eye, centre):
    if sight.line_of_sight == MIDPOINT:
        east, north, up = (0.5 * (e + c) for e, c in zip(eye, centre, strict=True))
        return up >= height(surface, east, north)
    if sight.line_of_sight == RAY:
        if naive_obstacles.enters(naive_obstacles.prisms_of(surface.obstacles), eye, centre) > 1e-9:
            return False
        if surface.kind == SINE_COSINE:
            heights = naive_surface.sampled_heights(lambda e, n: height(surface, e, n), eye, centre, 400)
            return min(heights) >= -GRAZING_M
        low, _ = naive_surface.height_range_above(
            surface.up_m.tolist(), surface.east0_m, surface.north0_m, surface.step_m, eye, centre
        )
        return low >= -GRAZING_M
    return True


def sees(surface, sight, eye, centre, normal):
    if not all(math.isfinite(x) for x in eye):
        return False
    return in_view(sight, eye, centre, normal) and in_line_of_sight(surface, sight, eye, centre)


def first_seen(surface, sight, cells, eyes):
    first = []
    for centre, normal in zip(cells.centre_m.tolist(), cells.normal.tolist(), strict=True):
        seen_by = [k for k, eye in enumerate(eyes.tolist()) if sees(surface, sight, eye, centre, normal)]
        first.append(seen_by[0] if seen_by else -1)
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

"""Prisms by shapely: lines cut at their tops, footprints as polygons, clearances by trying many places."""

import functools
import math

import numpy as np
import shapely


def prisms_of(obstacles):
    """(footprint, top) pairs of the kernels' numbers; every ring is an outline, inside of which even-odd counts."""
    first = obstacles.first_edge.tolist()
    rings = [obstacles.edges_m[first[k] : first[k + 1]].tolist() for k in range(obstacles.top_m.size)]
    return [
        (footprint_of(tuple(map(tuple, edges))), top)
        for edges, top in zip(rings, obstacles.top_m.tolist(), strict=True)
    ]


@functools.cache
def footprint_of(edges):
    """Every ray is tried against the same few footprints: each is made once."""
    rings = shapely.polygonize([shapely.LineString([edge[:2], edge[2:]]) for edge in edges])
    footprint = shapely.Polygon()
    for outline in sorted({shapely.Polygon(part.exterior) for part in rings.geoms}, key=lambda p: -p.area):
        footprint = footprint.symmetric_difference(outline)
    return footprint


def lower_part(p, q, limit):
    """The part of the line p-q that is lower than ``limit``, as a line on the map; none when no part is."""
    if min(p[2], q[2]) >= limit:
        return None
    t0 = (p[2] - limit) / (p[2] - q[2]) if p[2] >= limit else 0.0
    t1 = (limit - p[2]) / (q[2] - p[2]) if q[2] >= limit else 1.0
    ends = [(p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])) for t in (t0, t1)]
    return shapely.Point(ends[0]) if ends[0] == ends[1] else shapely.LineString(ends)


def enters(prisms, p, q):
    """How many metres on the map of the line p-q lie inside prisms (footprint, top); for a vertical line 1 when it does."""
    inside = 0.0
    for footprint, top in prisms:
        part = lower_part(p, q, top)
        if part is None:
            continue
        if isinstance(part, shapely.Point):
            inside = max(inside, float(footprint.contains(part)))
        else:
            inside = max(inside, part.intersection(footprint).length if part.length else 0.0)
    return inside


def clearance_beside(prisms, p, q, above):
    """Least distance on the map from a footprint of the part of the line that is lower than ``above`` over its top."""
    parts = [(footprint, lower_part(p, q, top + above)) for footprint, top in prisms]
    return min((footprint.distance(part) for footprint, part in parts if part is not None), default=math.inf)


def lacking(footprint, top, p, q, beside, above, positions=4001):
    """What the line lacks of one prism: the smaller of aside and higher; trying places along it."""
    t = np.linspace(0.0, 1.0, positions)[:, None]
    points = np.asarray(p) + t * (np.asarray(q) - np.asarray(p))
    distance = shapely.distance(footprint, shapely.points(points[:, :2]))
    low, near = points[:, 2] < top + above, distance < beside
    if not (low & near).any():
        return 0.0
    higher = float((top + above - points[near, 2]).max())
    aside = float((beside - distance[low]).max())
    return higher if (distance[low] == 0.0).any() else min(higher, aside)


def horizon(prisms, position, reach):
    """Tangent of the steepest slope from a place up to a top within reach."""
    slopes = [0.0]
    for footprint, top in prisms:
        distance = footprint.boundary.distance(shapely.Point(position[:2]))
        if top > position[2] and distance <= reach:
            slopes.append((top - position[2]) / distance if distance > 0.0 else math.inf)
    return max(slopes)

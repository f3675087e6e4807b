"""Parallel flight lines over an area: their number, positions, heights and direction."""

import math
from dataclasses import dataclass

import numpy as np
import shapely

from uavcover.kernels.arrays import FloatArray
from uavcover.model.route import Route
from uavcover.planner.terrain_following import lay_over_terrain
from uavcover.scenario.site import Site

SAME_DIRECTION_RAD = math.radians(3.0)
"""Lines that differ by less are tried once."""


@dataclass(frozen=True, slots=True, eq=False)
class SwathLayout:
    """A boustrophedon over the area with its own gaps and heights."""

    angle_rad: float  # direction of the lines, counter-clockwise from east
    # (k + 1,) relative widths: before the first line, between lines, after the last. Half a gap at both ends.
    gaps: FloatArray
    heights_agl_m: FloatArray  # (k,) wanted height above ground of each line
    # how far the lines stop before the border of the area, as a share of the sensor's reach on flat ground
    inset: float
    tolerance_m: float  # how far the straight legs may leave the wanted height
    # which of the four ways to fly it: bit 0 begins at the other end of the first line, bit 1 with the last line
    start: int = 0
    # how far east and north all lines are moved, for a camera that looks at the ground beside them
    shift_m: tuple[float, float] = (0.0, 0.0)


def regular_layout(
    *, angle_rad: float, lines: int, height_agl_m: float, inset: float, tolerance_m: float, start: int = 0
) -> SwathLayout:
    """Equal gaps, half of one at both borders, and one height: the plain boustrophedon."""
    gaps = np.ones(lines + 1)
    gaps[[0, -1]] = 0.5
    return SwathLayout(angle_rad, gaps, np.full(lines, height_agl_m), inset, tolerance_m, start)


def angle_of_heading_rad(heading_deg: float) -> float:
    """Direction of lines counter-clockwise from east, -pi/2..pi/2, from a heading clockwise from north."""
    return math.remainder(math.radians(90.0 - heading_deg), math.pi)


def heading_of_angle_deg(angle_rad: float) -> float:
    """Heading of lines clockwise from north, 0 to below 180, from their direction counter-clockwise from east."""
    return (90.0 - math.degrees(angle_rad)) % 180.0


def long_side_angle_rad(area: shapely.Polygon | shapely.MultiPolygon) -> float:
    """Direction of the longer side of the smallest rectangle around an area, -pi/2..pi/2."""
    rectangle = shapely.get_coordinates(shapely.minimum_rotated_rectangle(area))
    sides = np.diff(rectangle, axis=0)[:2]
    east, north = sides[int(np.argmax(np.hypot(sides[:, 0], sides[:, 1])))]
    return math.remainder(math.atan2(north, east), math.pi)


def edge_angles_rad(area: shapely.Polygon | shapely.MultiPolygon) -> list[float]:
    """Directions of the edges of an area, -pi/2..pi/2, those with the most metres of border first.

    Edges whose directions differ by less than :data:`SAME_DIRECTION_RAD` count together, as the longest of them.
    """
    rings = [
        shapely.get_coordinates(ring) for part in shapely.get_parts(area) for ring in (part.exterior, *part.interiors)
    ]
    sides = np.vstack([np.diff(ring, axis=0) for ring in rings])
    lengths = np.hypot(sides[:, 0], sides[:, 1])
    angles: list[float] = []
    metres: list[float] = []
    for side in np.argsort(-lengths, kind="stable").tolist():
        angle = math.remainder(math.atan2(sides[side, 1], sides[side, 0]), math.pi)
        near = [k for k, each in enumerate(angles) if is_same_direction(each, angle)]
        if near:
            metres[near[0]] += float(lengths[side])
        else:
            angles.append(angle)
            metres.append(float(lengths[side]))
    return [angles[k] for k in np.argsort(-np.array(metres), kind="stable").tolist()]


def is_same_direction(one_rad: float, other_rad: float) -> bool:
    """Whether two directions of lines, which have no front and back, nearly agree."""
    return abs(math.remainder(one_rad - other_rad, math.pi)) < SAME_DIRECTION_RAD


def width_across_m(site: Site, angle_rad: float) -> float:
    """Width of the area perpendicular to a direction, metres."""
    corners = shapely.get_coordinates(site.area.convex_hull)
    return float(np.ptp(corners @ np.array([-math.sin(angle_rad), math.cos(angle_rad)])))


def fly_layout(site: Site, layout: SwathLayout) -> Route:
    """The route of a layout, laid over the terrain.

    Each line runs over the whole extent of the area inside its strip. Concave areas and holes are flown across; a strip
    between two parts of an area that nothing lies in has no line.
    """
    to_lines = to_lines_frame(layout.angle_rad)
    borders, west_ends, east_ends = line_extents(site, layout)
    polyline: list[tuple[float, float]] = []
    wanted: list[float] = []
    for west, east, across, height_agl_m in zip(
        west_ends.tolist(), east_ends.tolist(), borders.tolist(), layout.heights_agl_m.tolist(), strict=True
    ):
        if west > east:
            continue
        inset = layout.inset * site.scenario.sensor.half_width_m(height_agl_m)
        # Never past the middle of the line.
        inset = min(inset, 0.5 * (east - west) - 0.5) if east - west > 1.0 else 0.0
        ends = [(west + inset, across), (east - inset, across)]
        polyline.extend(ends if len(polyline) % 4 == 0 else ends[::-1])
        wanted.extend([height_agl_m] * 2)
    points = np.array(polyline)
    heights = np.array(wanted)
    if layout.start & 1:
        # The other end of every line first.
        points = points.reshape(-1, 2, 2)[:, ::-1].reshape(-1, 2)
    if layout.start & 2:
        points, heights = points[::-1], heights[::-1]
    return Route(lay_over_terrain(site, points @ to_lines + layout.shift_m, heights, tolerance_m=layout.tolerance_m))


def to_lines_frame(angle_rad: float) -> FloatArray:
    """(2, 2) matrix M: M p is a point p along and across a direction, q M is a point q on the map."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[c, s], [-s, c]])


def area_edges(site: Site, angle_rad: float) -> FloatArray:
    """(n, 4) edges of the area, x1 y1 x2 y2 along and across a direction."""
    to_lines = to_lines_frame(angle_rad)
    rings = [shapely.get_coordinates(shapely.get_exterior_ring(part)) for part in shapely.get_parts(site.area)]
    return np.vstack([np.hstack([ring[:-1], ring[1:]]) for ring in (ring @ to_lines.T for ring in rings)])


def line_extents(site: Site, layout: SwathLayout) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Extents of lines: (k,) across, and (k,) first and last point of the area along each strip. Inf, -inf if empty."""
    edges = area_edges(site, layout.angle_rad)
    first, last = edges[:, 1].min(), edges[:, 1].max()
    borders = first + (last - first) * np.cumsum(layout.gaps)[:-1] / layout.gaps.sum()
    strips = np.concatenate([[first], 0.5 * (borders[1:] + borders[:-1]), [last]])
    extents = extents_between(edges, strips)
    return borders, extents[:, 0], extents[:, 1]


def extents_between(edges: FloatArray, strips: FloatArray) -> FloatArray:
    """Smallest and largest x (k, 2) of (n, 4) edges x1 y1 x2 y2 between (k + 1,) rising y. Inf, -inf for nothing."""
    x1, y1, x2, y2 = edges.T
    low, high = strips[:-1, None], strips[1:, None]
    dy = y2 - y1
    slanted = dy != 0.0
    run = np.where(slanted, dy, 1.0)
    t_low, t_high = (low - y1) / run, (high - y1) / run
    start = np.where(slanted, np.clip(np.minimum(t_low, t_high), 0.0, 1.0), 0.0)
    end = np.where(slanted, np.clip(np.maximum(t_low, t_high), 0.0, 1.0), 1.0)
    inside = np.where(slanted, start < end, (y1 >= low) & (y1 <= high))
    ends = np.stack([x1 + start * (x2 - x1), x1 + end * (x2 - x1)])
    west = np.where(inside, ends, np.inf).min(axis=(0, 2))
    east = np.where(inside, ends, -np.inf).max(axis=(0, 2))
    return np.column_stack([west, east])

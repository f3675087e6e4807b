"""Contour-aligned lines: flight lines that follow the terrain's contours, a baseline for energy on mountains.

A line along a contour climbs little, and climbing is expensive. CAPG (Shao, Mao and Xu 2025, RA-L 10(12)) flies contours in
an order found by a travelling salesperson problem. Contours are dense on steep ground and sparse on flat ground. These lines
take the direction of the contours but keep an even distance: they are level lines of a function whose gradient is as close
as possible, in the mean square, to a unit vector across the contours.
"""

import dataclasses
import math
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass

import contourpy
import numpy as np
import shapely

from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.path_cost import route_cost
from uavcover.missions.path_cost import path_cost_of
from uavcover.model.route import Route
from uavcover.planner.baselines.boustrophedon import Baseline, best_height_agl_m, evaluated, long_side_angle_rad
from uavcover.planner.terrain_following import (
    PLAIN_TOLERANCE_M,
    allowed_band_m,
    finite_heights,
    in_good_order,
    lay_over_terrain,
)
from uavcover.scenario.site import Site, once
from uavcover.sensing.coverage_map import CoverageMap

NAME = "contour-lines"
TUNED = "contour-lines-tuned"

_STEP_REACHES = 0.25
_MOST_NODES = 250_000
_MARGIN_REACHES = 2.0
"""Step of the height lattice, and its reach beyond the area, in reaches of the sensor."""

_FLATTEST = 1e-3
"""Ground whose root mean square slope is less has no contours to follow."""

_STRAIGHT_FRACTION = 0.1
"""Lines are laid straight where they leave their bends by no more than this fraction of the reach."""

_SHORTEST_REACHES = 0.5
"""Shorter pieces of lines, which the border of the area cuts off, are omitted."""

_AT_WAYPOINTS = math.sqrt(2.0)
"""Side of the square that is observed whole from its middle, in reaches."""

_SMOOTHINGS = (1.0, 2.0)
_STRAIGHTENINGS = (0.05, 0.3, 1.5)
_LINES = (0.85, 1.0, 1.15, 1.3, 1.5, 1.75, 2.0)
_INSETS = (0.0, 0.5)


@dataclass(frozen=True, slots=True, eq=False)
class LineField:
    """A function on a lattice; its level lines are flight lines."""

    east_m: FloatArray  # (c,) columns
    north_m: FloatArray  # (r,) rows
    across_m: FloatArray  # (r, c) its values: metres across the lines, as far as they keep their distance


@dataclass(frozen=True, slots=True)
class ContourLayout:
    """Layout of contour-aligned lines."""

    smoothing: float  # over how many reaches of the sensor the ground is smoothed before its contours are followed
    straightening: float  # how much the main direction counts beside the contours' own; large: straight lines
    lines: float  # relative number of lines: 1 for as many as flat ground needs
    height_agl_m: float  # wanted height above ground
    inset: float  # how far the lines stay inside the border of the area, as a fraction of the sensor's reach
    tolerance_m: float  # how far the straight legs may leave the wanted height


def plain_layout(site: Site) -> ContourLayout:
    """Lines side by side at the height with the widest strip, without overlap on flat ground."""
    return ContourLayout(_SMOOTHINGS[0], _STRAIGHTENINGS[1], 1.0, best_height_agl_m(site), 0.0, PLAIN_TOLERANCE_M)


def line_field(site: Site, *, reach_m: float, smoothing: float, straightening: float) -> LineField:
    """The function whose level lines follow the contours.

    The direction across the contours is the main axis of the structure tensor, the smoothed products of the slopes: the same on
    both sides of a ridge. It is taken with the sign that agrees with the main axis of the whole area. The function comes nearest
    to having these unit vectors as its gradient: a Poisson equation, solved by cosine transforms.

    Args:
        site: the scenario on its ground. Where there is no data the nearest heights count.
        reach_m: of the sensor.
        smoothing: see :class:`ContourLayout`.
        straightening: see :class:`ContourLayout`.
    """
    from scipy.ndimage import distance_transform_edt, gaussian_filter  # a fifth of a second to load

    east, north = _lattice(site, reach_m)
    step_m = float(east[1] - east[0])
    nodes = np.column_stack([axis.ravel() for axis in np.meshgrid(east, north)])
    up = site.ground.heights_m(nodes).reshape(north.size, east.size)
    unknown = ~np.isfinite(up)
    if unknown.any() and not unknown.all():
        row, column = distance_transform_edt(unknown, return_distances=False, return_indices=True)
        up = up[row, column]
    sigma = smoothing * reach_m / step_m
    slope_n, slope_e = np.gradient(gaussian_filter(np.nan_to_num(up), 0.5 * sigma, mode="nearest"), step_m)
    tensor = [gaussian_filter(a * b, sigma, mode="nearest") for a, b in (
        (slope_e, slope_e), (slope_e, slope_n), (slope_n, slope_n))]  # fmt: skip
    ee, en, nn = (float(part.mean()) for part in tensor)
    if math.sqrt(ee + nn) < _FLATTEST:
        main: float = long_side_angle_rad(site.area) + 0.5 * math.pi
        ee, en, nn = math.cos(main) ** 2, math.cos(main) * math.sin(main), math.sin(main) ** 2
    else:
        main = float(_main_axis_rad(np.array(ee), np.array(en), np.array(nn)))
    weight = straightening * (ee + nn)
    angle = _main_axis_rad(
        tensor[0] + weight * math.cos(main) ** 2,
        tensor[1] + weight * math.cos(main) * math.sin(main),
        tensor[2] + weight * math.sin(main) ** 2,
    )
    sign = np.where(np.cos(angle - main) < 0.0, -1.0, 1.0)
    return LineField(east, north, nearest_potential(sign * np.cos(angle), sign * np.sin(angle), step_m))


def _main_axis_rad(ee: FloatArray, en: FloatArray, nn: FloatArray) -> FloatArray:
    """Direction of the larger eigenvector of symmetric tensors, counter-clockwise from east, -pi/2..pi/2."""
    return np.asarray(0.5 * np.arctan2(2.0 * en, ee - nn))


def _lattice(site: Site, reach_m: float) -> tuple[FloatArray, FloatArray]:
    """(c,) east and (r,) north of a lattice over the area and around it."""
    margin_m = _MARGIN_REACHES * reach_m
    west, south, east, north = site.area.bounds
    width, height = east - west + 2.0 * margin_m, north - south + 2.0 * margin_m
    step_m = max(_STEP_REACHES * reach_m, math.sqrt(width * height / _MOST_NODES))
    columns, rows = (math.ceil(extent / step_m) + 1 for extent in (width, height))
    return west - margin_m + step_m * np.arange(float(columns)), south - margin_m + step_m * np.arange(float(rows))


def nearest_potential(across_e: FloatArray, across_n: FloatArray, step_m: float) -> FloatArray:
    """The function whose gradient comes nearest to a field of vectors, in the mean square; its mean is 0.

    Args:
        across_e: (r, c) east of the vectors at the nodes; rows go north, columns east.
        across_n: (r, c) north of them.
        step_m: between nodes.

    Returns:
        (r, c) values; differences between neighbours are least squares from the field's means between them.
    """
    from scipy.fft import dctn, idctn

    along_rows = 0.5 * step_m * (across_e[:, 1:] + across_e[:, :-1])
    along_columns = 0.5 * step_m * (across_n[1:] + across_n[:-1])
    # The normal equations of the least squares: a Laplacian with reflecting borders, diagonal for cosines (DCT-II).
    right = np.zeros_like(across_e)
    right[:, 1:] += along_rows
    right[:, :-1] -= along_rows
    right[1:] += along_columns
    right[:-1] -= along_columns
    rows, columns = right.shape
    laplacian = (2.0 - 2.0 * np.cos(np.pi * np.arange(rows) / rows))[:, None] + (
        2.0 - 2.0 * np.cos(np.pi * np.arange(columns) / columns)
    )
    laplacian[0, 0] = 1.0
    transformed = dctn(right, type=2, norm="ortho") / laplacian
    transformed[0, 0] = 0.0
    return np.asarray(idctn(transformed, type=2, norm="ortho"))


@once
def _fields(_site: Site) -> dict[tuple[float, float, float], LineField]:
    """Fields that were computed before, by reach, smoothing and straightening."""
    return {}


def fly_contours(site: Site, layout: ContourLayout) -> Route:
    """The route of a layout: its lines in a short order, the cheaper way round, laid over the terrain.

    A sensor that looks from the waypoints has enough on each line that the squares it covers whole touch.
    """
    reach_m = _reach_m(site, layout.height_agl_m)
    fields, key = _fields(site), (reach_m, layout.smoothing, layout.straightening)
    if key not in fields:
        fields[key] = line_field(site, reach_m=reach_m, smoothing=layout.smoothing, straightening=layout.straightening)
    lines = _pieces(site, layout, fields[key], reach_m)
    if not site.scenario.sensor.looks_along_path:
        lines = [_with_positions(line, _AT_WAYPOINTS * reach_m) for line in lines]
    polyline = np.vstack(in_good_order([np.column_stack([line, np.zeros(len(line))]) for line in lines], None))[:, :2]
    path_cost, surface = path_cost_of(site), site.ground.surface
    both = [_laid(site, np.ascontiguousarray(line), layout) for line in (polyline, polyline[::-1])]
    return Route(min(both, key=lambda points: float(route_cost(surface, path_cost, points))))


def _with_positions(line: FloatArray, apart_m: float) -> FloatArray:
    """(k, 2) positions along a line at most the permitted distance apart, with both ends."""
    string = shapely.LineString(line)
    count = max(1, math.ceil(string.length / apart_m - 1e-9))
    positions = shapely.line_interpolate_point(string, np.linspace(0.0, string.length, count + 1))
    return np.asarray(shapely.get_coordinates(positions))


def _laid(site: Site, polyline_m: FloatArray, layout: ContourLayout) -> FloatArray:
    if site.scenario.limits.applies_to == "legs":
        wanted = np.full(len(polyline_m), layout.height_agl_m)
        return lay_over_terrain(site, polyline_m, wanted, tolerance_m=layout.tolerance_m)
    low, high = allowed_band_m(site, polyline_m)
    up = site.ground.heights_m(polyline_m) + layout.height_agl_m
    return finite_heights(np.column_stack([polyline_m, np.clip(up, low, np.maximum(low, high))]))


def _reach_m(site: Site, height_agl_m: float) -> float:
    return max(site.scenario.sensor.half_width_m(height_agl_m), site.scenario.area.cell_size_m)


def _pieces(site: Site, layout: ContourLayout, field: LineField, reach_m: float) -> list[FloatArray]:
    """(k, 2) level lines inside the area, one at least."""
    area = site.area
    inner = area.buffer(-layout.inset * reach_m)
    flown = area if inner.is_empty else inner
    low, high = _extent_m(field, area)
    strip_m = (_AT_WAYPOINTS if not site.scenario.sensor.looks_along_path else 2.0) * reach_m
    count = max(1, math.ceil(layout.lines * (high - low) / strip_m - 1e-9))
    generator = contourpy.contour_generator(field.east_m, field.north_m, field.across_m)
    shortest_m = _SHORTEST_REACHES * reach_m
    found: list[FloatArray] = []
    longest: tuple[float, list[FloatArray]] = (-1.0, [])
    for level in low + (np.arange(count) + 0.5) * (high - low) / count:
        whole = shapely.MultiLineString([np.asarray(line) for line in generator.lines(float(level))])
        cut = shapely.get_parts(shapely.intersection(whole, flown))
        lines = shapely.MultiLineString([line for line in cut if line.geom_type == "LineString" and line.length > 0.0])
        for line in shapely.get_parts(shapely.line_merge(lines)):
            corners = shapely.get_coordinates(line.simplify(_STRAIGHT_FRACTION * reach_m))
            longest = max(longest, (line.length, [corners]), key=lambda item: item[0])
            if line.length >= shortest_m:
                found.append(corners)
    if found or longest[1]:
        return found or longest[1]
    east, north = shapely.get_coordinates(area.representative_point())[0].tolist()
    return [np.array([[east - 0.5, north], [east + 0.5, north]])]


def _extent_m(field: LineField, area: shapely.Polygon | shapely.MultiPolygon) -> tuple[float, float]:
    """Smallest and largest value of the function in the area, at nodes and along its border."""
    shapely.prepare(area)
    nodes = np.meshgrid(field.east_m, field.north_m)
    inside = field.across_m[shapely.contains_xy(area, *nodes)]
    border = shapely.get_coordinates(shapely.segmentize(area.boundary, float(field.east_m[1] - field.east_m[0])))
    column = np.interp(border[:, 0], field.east_m, np.arange(field.east_m.size))
    row = np.interp(border[:, 1], field.north_m, np.arange(field.north_m.size))
    c, r = (np.minimum(at.astype(int), size - 2) for at, size in (
        (column, field.east_m.size), (row, field.north_m.size)))  # fmt: skip
    x, y, z = column - c, row - r, field.across_m
    around = (1 - y) * ((1 - x) * z[r, c] + x * z[r, c + 1]) + y * ((1 - x) * z[r + 1, c] + x * z[r + 1, c + 1])
    values = np.concatenate([inside, around])
    return float(values.min()), float(values.max())


def layouts_to_try(site: Site) -> Iterator[list[ContourLayout]]:
    """Layouts of a scan, those of one direction field together; the plain one first."""
    plain = plain_layout(site)
    limits = site.scenario.limits
    middle_agl_m = 0.5 * (limits.min_height_agl_m + limits.max_height_agl_m)
    yield [plain]
    for straightening in sorted(_STRAIGHTENINGS, key=lambda fraction: fraction != plain.straightening):
        for smoothing in _SMOOTHINGS:
            yield [
                dataclasses.replace(
                    plain, smoothing=smoothing, straightening=straightening, lines=lines, height_agl_m=height, inset=inset
                )
                for height in sorted({plain.height_agl_m, 0.5 * (plain.height_agl_m + middle_agl_m)}, reverse=True)
                for lines in _LINES
                for inset in _INSETS
            ]  # fmt: skip


def contour_lines(
    coverage: CoverageMap, executor: Executor | None = None, should_stop: Callable[[], bool] = lambda: False
) -> list[Baseline]:
    """Contour-aligned lines of a scan over directions, height, spacing and inset, evaluated; the plain ones first.

    Args:
        coverage: on the planner's cells.
        executor: evaluates routes in parallel.
        should_stop: called between batches; the plain ones are always there.
    """
    found: list[Baseline] = []
    for batch in layouts_to_try(coverage.site):
        if found and should_stop():
            break
        routes = [fly_contours(coverage.site, layout) for layout in batch]
        found += evaluated(coverage, TUNED if found else NAME, routes, executor)
    return found

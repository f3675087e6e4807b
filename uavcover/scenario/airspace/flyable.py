"""Permitted ground for planned legs: the fence without the no-fly zones that meet a range of heights.

If steps of the ground divide the rest, legs stay in one part of it.

For the search a zone counts over its whole outline where it meets the heights anywhere over it; legs are tested against floor and
ceiling themselves (:mod:`uavcover.scenario.airspace.zones`). To fly below a floor, the height band has to end below it.
"""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.kernels.surface import GRID, Surface
from uavcover.model.limits import FlightLimits
from uavcover.scenario.airspace.zones import Polygons, Zone, is_over_or_under
from uavcover.scenario.obstacles import rings_m
from uavcover.scenario.site import Site, once
from uavcover.terrain.frames import Bounds, nodes_between, positions_of_nodes_m
from uavcover.terrain.ground import Ground

# Lines of no-fly zones in space, for displays.


def zone_lines_m(site: Site, zone: Zone, bounds_m: tuple[float, float, float, float]) -> list[FloatArray]:
    """(m, 3) lines of a no-fly zone inside the displayed bounds: rings at floor and ceiling, and vertical lines at its corners.

    Without a floor it begins at the ground; without a ceiling it is drawn up to the highest height of transits.

    Args:
        site: for ground and heights.
        zone: to draw.
        bounds_m: west, south, east, north of what is displayed.
    """
    west, south, east, north = bounds_m
    shown = zone.outline.intersection(shapely.box(west, south, east, north))
    entry, lines = zone.entry, []
    for part in shapely.get_parts(shown):
        for ring in rings_m(part) if isinstance(part, shapely.Polygon) else ():
            positions = np.asarray(
                # lines follow the ground in pieces: this number along the longer side of the display
                shapely.LineString(ring).segmentize(max(east - west, north - south) / 60).coords
            )
            ground = site.ground.heights_m(positions)
            known = np.isfinite(ground)
            positions, ground = positions[known], ground[known]
            if len(positions) < 2:
                continue
            low = _zone_end_m(site, ground, entry.floor_agl_m, entry.floor_amsl_m, np.minimum, 0.0)
            top_agl_m = site.scenario.transit_ceiling_agl_m
            high = _zone_end_m(site, ground, entry.ceiling_agl_m, entry.ceiling_amsl_m, np.maximum, top_agl_m)
            low, high = np.maximum(low, ground), np.maximum(high, ground)
            lines += [np.column_stack([positions, low]), np.column_stack([positions, high])]
            corners = np.flatnonzero((positions[:, None] == ring[:, :2]).all(axis=2).any(axis=1))
            lines += [np.array([[*positions[k], low[k]], [*positions[k], high[k]]]) for k in corners]
    return lines


def _zone_end_m(
    site: Site, ground_m: FloatArray, agl_m: float | None, amsl_m: float | None, of_two: np.ufunc, default_agl_m: float
) -> FloatArray:
    """(n,) up coordinate of a floor or a ceiling above ground at these heights."""
    ends = [] if agl_m is None else [ground_m + agl_m]
    if amsl_m is not None:
        ends.append(np.full(len(ground_m), amsl_m - site.alt_amsl_offset_m))
    return np.asarray(of_two.reduce(np.array(ends or [ground_m + default_agl_m])))


# Find ground steps that no leg can pass: between two nodes they are higher than the height band is wide.
#
# A leg across a cliff that is low enough above its top is too high above its foot. A route stays on one side of such steps.

_LEAST_FRACTION = 0.005
"""Smallest fraction of a region: a smaller part behind steps, such as a ledge, is ignored."""

_WIDTH_TO_M = 0.1
"""Accuracy of a width."""


def parts_between_steps(ground: Ground, region: Polygons, *, width_m: float, slope: float) -> list[shapely.Polygon]:
    """The parts of a region between steps of the ground; empty if all divided ground is below ``_LEAST_FRACTION``.

    Args:
        ground: its nodes are looked at; other grounds have no steps.
        region: on the map.
        width_m: of the band of heights.
        slope: tangent of the steepest leg.
    """
    steps = _steps(ground.surface, region, width_m, slope)
    if steps is None:
        return []
    least_m2 = _LEAST_FRACTION * region.area
    parts = [part for part in polygons_in(region.difference(steps)) if part.area >= least_m2]
    if len(parts) <= len(polygons_in(region)):
        return []
    # A step that can be flown around is not a hole: legs are checked, and paths around many steps would be slow.
    return [_without_small_holes(part, region, least_m2) for part in parts]


def least_width_m(
    ground: Ground, region: Polygons, parts: list[shapely.Polygon], *, width_m: float, slope: float
) -> float:
    """The width of the height band at which steps no longer separate any parts of a region.

    Args:
        ground: its nodes are looked at.
        region: on the map.
        parts: of :func:`parts_between_steps`.
        width_m: at which they are parted.
        slope: tangent of the steepest leg.
    """
    positions = [part.representative_point() for part in parts]
    low, high = width_m, width_m + _highest_step_m(ground.surface, region.bounds)
    while high - low > _WIDTH_TO_M:
        middle = 0.5 * (low + high)
        steps = _steps(ground.surface, region, middle, slope)
        left = [region] if steps is None else polygons_in(region.difference(steps))
        together = any(all(part.intersects(position) for position in positions) for part in left)
        low, high = (low, middle) if together else (middle, high)
    return high


def polygons_in(shape: shapely.Geometry) -> list[shapely.Polygon]:
    """The polygons of a shape, without its lines and points."""
    return [part for part in shapely.get_parts(shape) if isinstance(part, shapely.Polygon) and not part.is_empty]


def _without_small_holes(part: shapely.Polygon, region: Polygons, least_m2: float) -> shapely.Polygon:
    holes = [ring for ring in part.interiors if shapely.Polygon(ring).area >= least_m2]
    filled = shapely.Polygon(part.exterior, holes).intersection(region)
    return max(polygons_in(filled), key=lambda each: each.area)


def _steps(surface: Surface, region: Polygons, width_m: float, slope: float) -> shapely.Geometry | None:
    """The ground beside steps inside the bounds of a region, with few corners; None where there is no step."""
    if surface.kind != GRID or region.is_empty:
        return None
    grid = surface.grid
    column_m, row_m = 1.0 / grid.per_column, 1.0 / grid.per_row
    if surface.steepest * max(column_m, row_m) <= width_m + slope * min(column_m, row_m):
        return None
    columns, rows = nodes_between(grid, surface.up_m, region.bounds)
    ups = surface.up_m[rows[0] : rows[1], columns[0] : columns[1]]
    across = np.abs(np.diff(ups, axis=1)) > width_m + slope * column_m
    along = np.abs(np.diff(ups, axis=0)) > width_m + slope * row_m
    # A step is that of all pixels that have it as a side.
    steep = across[:-1] | across[1:] | along[:, :-1] | along[:, 1:]
    if not steep.any():
        return None
    apart_m = 0.75 * max(column_m, row_m)
    found = shapely.union_all(_runs(surface, steep, columns[0], rows[0]))
    grown = found.buffer(apart_m, join_style="mitre")
    # in distances between nodes: outlines this much simpler than those of pixels
    return grown.simplify(0.7 * max(column_m, row_m))


def _runs(surface: Surface, steep: BoolArray, first_column: int, first_row: int) -> list[shapely.Geometry]:
    """A quadrangle for each run of marked pixels of a row."""
    padded = np.zeros((steep.shape[0], steep.shape[1] + 2), dtype=np.int8)
    padded[:, 1:-1] = steep
    turns = np.diff(padded, axis=1)
    rows, begins = np.nonzero(turns == 1)
    _, ends = np.nonzero(turns == -1)
    corners = np.stack([
        np.column_stack([begins, rows]), np.column_stack([ends, rows]),
        np.column_stack([ends, rows + 1]), np.column_stack([begins, rows + 1]),
    ], axis=1) + np.array([first_column, first_row], dtype=float)  # fmt: skip
    flat = corners.reshape(-1, 2)
    positions = positions_of_nodes_m(surface.grid, flat, np.full(len(flat), math.nan))
    return [shapely.Polygon(corners) for corners in positions[:, :2].reshape(-1, 4, 2)]


def _highest_step_m(surface: Surface, bounds_m: Bounds) -> float:
    columns, rows = nodes_between(surface.grid, surface.up_m, bounds_m)
    ups = surface.up_m[rows[0] : rows[1], columns[0] : columns[1]]
    return float(max(np.nanmax(np.abs(np.diff(ups, axis=axis)), initial=0.0) for axis in (0, 1)))


_ROUNDING_M = 0.05
"""Extra distance of planned legs, for rounding."""
_MANY_CORNERS = 40
_SIMPLER_BY_M = 2.0
_SAMPLES_ACROSS = 150
_BETWEEN_SAMPLES_M = 5.0
"""Ground between two samples may be this much higher or lower, where not every pixel is looked at."""


@dataclass(frozen=True, slots=True, eq=False)
class FlyableArea:
    """Permitted ground for the planned route."""

    polygon: shapely.Polygon  # one piece of the fence, zones with their margins cut out
    closed: tuple[Zone, ...] = ()  # the zones that close the height band over some of the fence
    # those of them with a floor or a ceiling inside of the band, so that a narrower band would open some of them
    partly: tuple[Zone, ...] = ()
    cut_off: bool = False  # whether zones cut off other pieces of the fence
    undivided: shapely.Polygon | None = None  # the piece and those beyond steps of the ground; None without such steps


@once
def flyable_area(site: Site) -> FlyableArea:
    """Permitted ground for the planned route; the whole fence without no-fly zones and steps that divide the ground.

    A part of an area has that of the whole: their routes are flown as one.
    """
    return _flyable_area(site) if site.whole is None else flyable_area(site.whole)


@once
def transit_area(site: Site) -> Polygons:
    """Permitted ground for transits at all of their heights: the fence without the zones that meet one of them."""
    low, high = _transit_heights_m(site)
    return _without(site, [zone for zone in site.zones if _meets(site, zone, low, high)])


def transit_area_between_walls(site: Site) -> Polygons:
    """Permitted ground for transits at one of their heights. Zones that they may pass under or over are not cut out."""
    return _without(site, [zone for zone in site.zones if is_wall(site, zone)])


def is_wall(site: Site, zone: Zone) -> bool:
    """Whether no leg of any mission passes over or under a zone."""
    return _fills(site, zone, *_transit_heights_m(site))


def _transit_heights_m(site: Site) -> tuple[float, float]:
    limits = site.scenario.limits
    return min(limits.transit_clearance_m, limits.min_height_agl_m), site.scenario.transit_ceiling_agl_m


def _flyable_area(site: Site) -> FlyableArea:
    limits = site.scenario.limits
    low, high = limits.min_height_agl_m, limits.max_height_agl_m
    closed = tuple(zone for zone in site.zones if _meets(site, zone, low, high))
    if not closed:
        return _between_steps(site, FlyableArea(site.fence))
    pieces = polygons_in(_without(site, closed))
    there = len(pieces)
    # Only ground that can be reached from home counts, not pieces behind zones that no transit passes under or over.
    walls = [zone for zone in site.zones if is_wall(site, zone)]
    reached = [piece for piece in polygons_in(_without(site, walls)) if _holds_home(site, piece)]
    if reached:
        pieces = [piece for piece in pieces if reached[0].intersects(piece.representative_point())]
    partly = tuple(zone for zone in closed if not _fills(site, zone, low, high))
    if not pieces:
        return FlyableArea(shapely.Polygon(), closed, partly, cut_off=there > 0)
    best = _most_of_area(site, pieces)
    return _between_steps(site, FlyableArea(best, closed, partly, cut_off=there > 1))


def _between_steps(site: Site, area: FlyableArea) -> FlyableArea:
    """Of the parts of an area between ground steps, the one with most of the reachable visible ground."""
    limits = site.scenario.limits
    if limits.applies_to == "waypoints":
        return area
    slope, width_m = _climb_and_band(limits)
    parts = parts_between_steps(site.ground, area.polygon, width_m=width_m, slope=slope)
    if not parts:
        return area
    low_m, high_m = _transit_heights_m(site)
    of_transits = parts_between_steps(
        site.ground, site.fence, width_m=high_m - low_m - 2.0 * limits.height_margin_m, slope=slope
    )
    from_home = [part for part in of_transits if _holds_home(site, part)]
    reached = [part for part in parts if not from_home or from_home[0].intersects(part.representative_point())]
    return dataclasses.replace(area, polygon=_most_of_area(site, reached or parts), undivided=area.polygon)


def wide_enough_m(site: Site) -> float:
    """The width of the height band, without margins, at which legs cross the steps that divide the flyable area."""
    slope, width_m = _climb_and_band(site.scenario.limits)
    undivided = flyable_area(site).undivided or shapely.Polygon()
    parts = parts_between_steps(site.ground, undivided, width_m=width_m, slope=slope)
    return least_width_m(site.ground, undivided, parts, width_m=width_m, slope=slope)


def _climb_and_band(limits: FlightLimits) -> tuple[float, float]:
    """Tangent of the steepest leg, and the width of the height band without its margins."""
    slope = math.tan(math.radians(limits.max_climb_angle_deg))
    return slope, limits.max_height_agl_m - limits.min_height_agl_m - 2.0 * limits.height_margin_m


def _most_of_area(site: Site, pieces: Sequence[shapely.Polygon]) -> shapely.Polygon:
    return max(pieces, key=lambda piece: (shapely.area(piece.intersection(site.area)), piece.area))


def _holds_home(site: Site, piece: shapely.Polygon) -> bool:
    return site.home_m is None or bool(piece.intersects(shapely.Point(site.home_m[:2])))


def _without(site: Site, zones: list[Zone] | tuple[Zone, ...]) -> Polygons:
    """The fence without zones, their margins and a little more."""
    if not zones:
        return site.fence
    left = site.fence.difference(shapely.union_all([_with_few_corners(zone) for zone in zones]))
    return left if isinstance(left, Polygons) else shapely.MultiPolygon(polygons_in(left))


def _with_few_corners(zone: Zone) -> shapely.Geometry:
    """A zone with its margin. If it has many corners: fewer, and up to 4 m more room, because each is a corner of detours."""
    reach_m = zone.entry.margin_m + _ROUNDING_M
    if zone.circle is not None or shapely.get_num_coordinates(zone.outline) <= _MANY_CORNERS:
        return zone.grown(reach_m)
    return zone.grown(reach_m + _SIMPLER_BY_M).simplify(_SIMPLER_BY_M)


def _meets(site: Site, zone: Zone, low_agl_m: float, high_agl_m: float) -> bool:
    """Whether a zone may contain any place at these heights above ground inside the fence."""
    ground = _ground_amsl_m(site, zone)
    if ground is None:
        return False
    heights_m = (ground[0] + low_agl_m, ground[1] + high_agl_m)
    return not is_over_or_under(zone.entry, (low_agl_m, high_agl_m), heights_m, -site.scenario.limits.height_margin_m)


def _fills(site: Site, zone: Zone, low_agl_m: float, high_agl_m: float) -> bool:
    """Whether a zone contains every place over its outline at these heights above ground."""
    ground = _ground_amsl_m(site, zone)
    if ground is None:
        return False
    entry, margin = zone.entry, site.scenario.limits.height_margin_m
    floors = [(entry.floor_agl_m, low_agl_m), (entry.floor_amsl_m, ground[0] + low_agl_m)]
    ceilings = [(entry.ceiling_agl_m, high_agl_m), (entry.ceiling_amsl_m, ground[1] + high_agl_m)]
    above_floor = [lowest >= floor - margin for floor, lowest in floors if floor is not None]
    below_top = [highest <= ceiling + margin for ceiling, highest in ceilings if ceiling is not None]
    return (not above_floor or any(above_floor)) and (not below_top or any(below_top))


def _ground_amsl_m(site: Site, zone: Zone) -> tuple[float, float] | None:
    """Lowest and highest ground above sea level under a zone inside the fence; None where they do not meet."""
    under = zone.grown(zone.entry.margin_m + _ROUNDING_M).intersection(site.fence)
    if under.is_empty:
        return None
    entry = zone.entry
    if entry.floor_amsl_m is None and entry.ceiling_amsl_m is None:
        return -math.inf, math.inf  # no altitude limit depends on it
    positions = _positions_in(under, site.ground.surface.step_m)
    ups = site.ground.heights_m(positions)
    known = np.isfinite(ups)
    if not known.any():
        return -math.inf, math.inf
    alts = site.alts_amsl_m(np.column_stack([positions[known], ups[known]]))
    return float(alts.min()) - _BETWEEN_SAMPLES_M, float(alts.max()) + _BETWEEN_SAMPLES_M


def _positions_in(shape: shapely.Geometry, step_m: float) -> FloatArray:
    """(k, 2) a lattice of places in a shape, and its corners."""
    west, south, east, north = shapely.bounds(shape)
    step = max(step_m, (east - west) / _SAMPLES_ACROSS, (north - south) / _SAMPLES_ACROSS)
    axes = np.arange(west, east + step, step), np.arange(south, north + step, step)
    lattice = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    inside = lattice[shapely.intersects_xy(shape, lattice[:, 0], lattice[:, 1])]
    return np.vstack([inside, shapely.get_coordinates(shape)])

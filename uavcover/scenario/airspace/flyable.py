"""Permitted ground for planned legs: the fence without the no-fly zones that meet a range of heights.

Where steps of the ground part what is left (:mod:`uavcover.scenario.ground_steps`), they may be in one part of it.

For the search a zone counts over its whole outline where it meets the heights anywhere over it; legs are tested against floor and
ceiling themselves (:mod:`uavcover.scenario.airspace.zones`). To fly below a floor, the height band has to end below it.
"""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from uavcover.kernels.arrays import FloatArray
from uavcover.scenario.airspace.zones import Polygons, Zone
from uavcover.scenario.ground_steps import least_width_m, parts_between_steps, polygons_in
from uavcover.scenario.site import Site, once

_ROUNDING_M = 0.05
"""Planned legs stay this much farther away than they have to, so that rounding does not matter."""
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
    # width of the height band, margins not counted, at which legs get over the steps of the ground that part the piece
    # from others; none where there are no such steps
    wide_enough_m: float | None = None


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
    # Only what can be reached from home counts: pieces behind zones that no transit passes under or over are not.
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
    slope = math.tan(math.radians(limits.max_climb_angle_deg))
    width_m = limits.max_height_agl_m - limits.min_height_agl_m - 2.0 * limits.height_margin_m
    parts = parts_between_steps(site.ground, area.polygon, width_m=width_m, slope=slope)
    if not parts:
        return area
    low_m, high_m = _transit_heights_m(site)
    of_transits = parts_between_steps(
        site.ground, site.fence, width_m=high_m - low_m - 2.0 * limits.height_margin_m, slope=slope
    )
    from_home = [part for part in of_transits if _holds_home(site, part)]
    reached = [part for part in parts if not from_home or from_home[0].intersects(part.representative_point())]
    wide_enough_m = least_width_m(site.ground, area.polygon, parts, width_m=width_m, slope=slope)
    return dataclasses.replace(area, polygon=_most_of_area(site, reached or parts), wide_enough_m=wide_enough_m)


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
    entry, margin = zone.entry, site.scenario.limits.height_margin_m
    floors = [(entry.floor_agl_m, high_agl_m), (entry.floor_amsl_m, ground[1] + high_agl_m)]
    ceilings = [(entry.ceiling_agl_m, low_agl_m), (entry.ceiling_amsl_m, ground[0] + low_agl_m)]
    under = [highest <= floor - margin for floor, highest in floors if floor is not None]
    over = [lowest >= ceiling + margin for ceiling, lowest in ceilings if ceiling is not None]
    return not ((under and all(under)) or (over and all(over)))


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
    """Lowest and highest ground above sea level under a zone inside the fence; none where they do not meet."""
    under = zone.grown(zone.entry.margin_m + _ROUNDING_M).intersection(site.fence)
    if under.is_empty:
        return None
    entry = zone.entry
    if entry.floor_amsl_m is None and entry.ceiling_amsl_m is None:
        return -math.inf, math.inf  # no altitude limit depends on it
    places = _places_in(under, site.ground.surface.step_m)
    ups = site.ground.heights_m(places)
    known = np.isfinite(ups)
    if not known.any():
        return -math.inf, math.inf
    alts = site.alts_amsl_m(np.column_stack([places[known], ups[known]]))
    return float(alts.min()) - _BETWEEN_SAMPLES_M, float(alts.max()) + _BETWEEN_SAMPLES_M


def _places_in(shape: shapely.Geometry, step_m: float) -> FloatArray:
    """(k, 2) a lattice of places in a shape, and its corners."""
    west, south, east, north = shapely.bounds(shape)
    step = max(step_m, (east - west) / _SAMPLES_ACROSS, (north - south) / _SAMPLES_ACROSS)
    axes = np.arange(west, east + step, step), np.arange(south, north + step, step)
    lattice = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    inside = lattice[shapely.intersects_xy(shape, lattice[:, 0], lattice[:, 1])]
    return np.vstack([inside, shapely.get_coordinates(shape)])

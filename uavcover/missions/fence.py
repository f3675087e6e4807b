"""The fence that is uploaded: the keep-in polygon, and no-fly zones as exclusions.

Fences of ArduPilot and PX4 have no floors and no ceilings for single polygons or circles: an exclusion holds at every height. So
a zone that the mission passes over or under is left out. The keep-in fence is one polygon, the union of those the scenario gives:
ArduPilot wants a vehicle inside of all its inclusions unless FENCE_OPTIONS says otherwise, PX4 inside of any.
"""

from dataclasses import dataclass
from itertools import chain

import numpy as np
import shapely

from mission_io.model.items import Fence, FenceCircle, FencePolygon, LatLon
from uavcover.kernels.arrays import FloatArray
from uavcover.scenario.airspace.zones import Polygons, Zone
from uavcover.scenario.site import Site, once
from uavcover.terrain.frames import LocalFrame

_MOST_CORNERS = 70
"""Corners of an exclusion zone: ArduPilot keeps few hundred corners of a fence in all, and at most 255 of a polygon."""


@dataclass(frozen=True, slots=True, eq=False)
class MissionFence:
    """A fence for a mission."""

    fence: Fence  # one inclusion polygon, then exclusions
    zones: tuple[Zone, ...]  # the no-fly zones among the exclusions
    left_out: tuple[Zone, ...]  # those that the mission passes over or under, or inside whose hole it is


def fence_of(site: Site, frame: LocalFrame, path_m: FloatArray) -> MissionFence:
    """The fence for a mission along a (k, 3) ENU path from and to the column above home."""
    exclusions = _exclusions(site)
    path = shapely.LineString(path_m[:, :2])
    passed = np.zeros(len(site.zones), dtype=bool)
    near = exclusions.index.query(path, predicate="intersects")
    passed[near] = [_is_over(site.zones[number], path) for number in near]
    key = passed.tobytes()
    if key not in exclusions.fences:
        keep_in = shapely.orient_polygons(site.fence)
        polygons = [_polygon(frame, keep_in.exterior, inclusion=True)]
        polygons += [_polygon(frame, ring, inclusion=False) for ring in keep_in.interiors]
        kept = [number for number in range(len(site.zones)) if not passed[number]]
        exclusions.fences[key] = MissionFence(
            Fence(
                tuple(chain(polygons, *(exclusions.polygons[number] for number in kept))),
                tuple(chain(*(exclusions.circles[number] for number in kept))),
            ),
            tuple(site.zones[number] for number in kept),
            tuple(zone for zone, is_passed in zip(site.zones, passed, strict=True) if is_passed),
        )
    return exclusions.fences[key]


@dataclass(frozen=True, slots=True, eq=False)
class _Exclusions:
    """The zones of a site as exclusions of a fence."""

    index: shapely.STRtree  # of their outlines without holes; of circles, of the polygons around them
    polygons: list[tuple[FencePolygon, ...]]  # of each zone
    circles: list[tuple[FenceCircle, ...]]  # of each zone
    fences: dict[bytes, MissionFence]  # those that were made, by the zones that a mission passes over or under


@once
def _exclusions(site: Site) -> _Exclusions:
    """The exclusions of a site, for all its missions."""
    solids: list[shapely.Geometry] = []
    polygons: list[tuple[FencePolygon, ...]] = []
    circles: list[tuple[FenceCircle, ...]] = []
    for zone in site.zones:
        solid = shapely.union_all([shapely.Polygon(part.exterior) for part in shapely.get_parts(zone.outline)])
        solids.append(solid)
        if zone.circle is not None and site.frame is not None:
            east, north, radius = zone.circle
            (center,) = _places(site.frame, np.array([[east, north]]))
            circles.append((FenceCircle(center, radius, inclusion=False),))
            polygons.append(())
        elif site.frame is not None:
            parts = shapely.get_parts(shapely.orient_polygons(_with_few_corners(zone, solid)))
            circles.append(())
            polygons.append(
                tuple(
                    _polygon(site.frame, part.exterior, inclusion=False)
                    for part in parts
                    if isinstance(part, shapely.Polygon)
                )
            )
    return _Exclusions(shapely.STRtree(solids), polygons, circles, {})


def _is_over(zone: Zone, path: shapely.LineString) -> bool:
    """Whether a path that meets the outline of a zone, of a circle the polygon around it, meets the zone."""
    return zone.circle is None or path.distance(shapely.Point(zone.circle[:2])) <= zone.circle[2]


def _with_few_corners(zone: Zone, solid: shapely.Geometry) -> shapely.Geometry:
    """A zone with fewer corners, grown to hold the whole zone, by less than the margin that the mission keeps."""
    reach_m = 0.4 * zone.entry.margin_m
    if shapely.get_num_coordinates(solid) <= _MOST_CORNERS or reach_m <= 0.0 or not isinstance(solid, Polygons):
        return solid
    return solid.buffer(reach_m, join_style="mitre", mitre_limit=1.5).simplify(reach_m)


def _polygon(frame: LocalFrame, ring: shapely.LinearRing, *, inclusion: bool) -> FencePolygon:
    return FencePolygon(tuple(_places(frame, np.asarray(ring.coords)[:-1, :2])), inclusion)


def _places(frame: LocalFrame, corners_m: FloatArray) -> list[LatLon]:
    lat, lon, _ = frame.geodetic_from_enu(np.column_stack([corners_m, np.zeros(len(corners_m))]))
    return [LatLon(float(a), float(o)) for a, o in zip(lat, lon, strict=True)]

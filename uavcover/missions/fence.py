"""The fence that is uploaded: the keep-in polygon, and no-fly zones as exclusions.

Fences of ArduPilot and PX4 have no floors and no ceilings for single polygons or circles: an exclusion holds at every height. So
a zone that the mission passes over or under is left out. The keep-in fence is one polygon, the union of those the scenario gives:
ArduPilot wants a vehicle inside of all its inclusions unless FENCE_OPTIONS says otherwise, PX4 inside of any.
"""

from dataclasses import dataclass

import numpy as np
import shapely

from mission_io.model.areas import Fence, FenceCircle, FencePolygon, LatLon
from uavcover.kernels.arrays import FloatArray
from uavcover.scenario.airspace.zones import Polygons, Zone
from uavcover.scenario.site import Site
from uavcover.terrain.frames import LocalFrame

_MOST_CORNERS = 70
"""Corners of an exclusion zone: ArduPilot keeps few hundred corners of a fence in all, and at most 255 of a polygon."""


@dataclass(frozen=True, slots=True, eq=False)
class MissionFence:
    """A fence for a mission.

    Attributes:
        fence: one inclusion polygon, then exclusions.
        zones: the no-fly zones among the exclusions.
        left_out: those that the mission passes over or under, or inside whose hole it is.
    """

    fence: Fence
    zones: tuple[Zone, ...]
    left_out: tuple[Zone, ...]


def fence_of(site: Site, frame: LocalFrame, path_m: FloatArray) -> MissionFence:
    """The fence for a mission along a (k, 3) ENU path from and to the column above home."""
    keep_in = shapely.orient_polygons(site.fence)
    polygons = [_polygon(frame, keep_in.exterior, inclusion=True)]
    polygons += [_polygon(frame, ring, inclusion=False) for ring in keep_in.interiors]
    circles: list[FenceCircle] = []
    kept: list[Zone] = []
    left_out: list[Zone] = []
    path = shapely.LineString(path_m[:, :2])
    for zone in site.zones:
        solid = shapely.union_all([shapely.Polygon(part.exterior) for part in shapely.get_parts(zone.outline)])
        if (zone.circle is None and path.distance(solid) <= 0.0) or _is_over_circle(zone, path):
            left_out.append(zone)
            continue
        kept.append(zone)
        if zone.circle is not None:
            east, north, radius = zone.circle
            (center,) = _places(frame, np.array([[east, north]]))
            circles.append(FenceCircle(center, radius, inclusion=False))
        else:
            parts = [
                part for part in shapely.get_parts(_with_few_corners(zone, solid)) if isinstance(part, shapely.Polygon)
            ]
            polygons += [_polygon(frame, shapely.orient_polygons(part).exterior, inclusion=False) for part in parts]
    return MissionFence(Fence(tuple(polygons), tuple(circles)), tuple(kept), tuple(left_out))


def _is_over_circle(zone: Zone, path: shapely.LineString) -> bool:
    return zone.circle is not None and path.distance(shapely.Point(zone.circle[:2])) <= zone.circle[2]


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

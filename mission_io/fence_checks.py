"""How far legs stray out of a fence, measured on the plane that touches the Earth in the middle of the fence."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum

import numpy as np
import shapely

from mission_io.areas import Fence, FencePolygon, LatLon
from mission_io.geodesy import earth_centred_m
from mission_io.items import GeoPoint
from mission_io.legs import Leg
from mission_io.surface import FloatArray

_LONGEST_CHORD_M = 200.0
_TOUCHING_M = 1e-3


class Inclusion(Enum):
    """What several inclusion areas mean together: autopilots, and their settings, differ."""

    INSIDE_ALL = "inside all"
    INSIDE_ANY = "inside any"


@dataclass(frozen=True, slots=True)
class Breach:
    """A leg that leaves an inclusion area or enters an exclusion area.

    Attributes:
        outside_m: How far it strays beyond the border at most.
        lat_deg: Where that is.
        lon_deg: Where that is.
        what: Which part of the fence, for people.
    """

    outside_m: float
    lat_deg: float
    lon_deg: float
    what: str


class FenceGround:
    """A fence laid out flat. Distances are true to 1 part in 10,000 up to 100 km from its middle."""

    def __init__(self, fence: Fence, inclusion: Inclusion = Inclusion.INSIDE_ALL) -> None:
        places = [v for polygon in fence.polygons for v in polygon.vertices] + [c.center for c in fence.circles]
        self._frame = _TangentPlane(places[0] if places else LatLon(0.0, 0.0))
        self._inclusion = inclusion
        inside: list[tuple[str, shapely.Geometry]] = []
        self._outside: list[tuple[str, shapely.Geometry, float]] = []
        for number, polygon in enumerate(fence.polygons):
            name, shape = f"fence polygon {number}", self._polygon(polygon)
            if polygon.inclusion:
                inside.append((name, shape))
            else:
                self._outside.append((name, shape, 0.0))
        self._circles = [(f"fence circle {n}", c) for n, c in enumerate(fence.circles) if c.inclusion]
        self._outside += [
            (f"fence circle {n}", shapely.Point(self._frame.point_m(c.center)), c.radius_m)
            for n, c in enumerate(fence.circles)
            if not c.inclusion
        ]
        self._inside = inside

    def breaches(self, leg: Leg) -> Iterator[Breach]:
        """Where a leg is on the wrong side of the fence, the worst place for each part of it."""
        t = np.linspace(0.0, 1.0, max(2, math.ceil(leg.ground_m / _LONGEST_CHORD_M) + 1))
        lat_deg, lon_deg = leg.places(t)
        line_m = self._frame.points_m(lat_deg, lon_deg)
        line = shapely.LineString(line_m) if leg.ground_m > 0.0 else shapely.Point(line_m[0])
        strays = [*self._strays_from_polygons(line), *self._strays_from_circles(line)]
        if self._inclusion is Inclusion.INSIDE_ANY and (self._inside or self._circles):
            strays = [*self._strays_from_union(line)]
        for what, distance_m, place_m in [*strays, *self._intrusions(line)]:
            if distance_m > _TOUCHING_M:
                place = self._frame.place(place_m)
                yield Breach(distance_m, place.lat_deg, place.lon_deg, what)

    def _strays_from_polygons(self, line: shapely.Geometry) -> Iterator[tuple[str, float, tuple[float, float]]]:
        for name, shape in self._inside:
            yield from _farthest_outside(f"outside of {name}", shapely.difference(line, shape), shape)

    def _strays_from_circles(self, line: shapely.Geometry) -> Iterator[tuple[str, float, tuple[float, float]]]:
        corners = shapely.get_coordinates(line)
        for name, circle in self._circles:
            distances_m = np.hypot(*(corners - self._frame.point_m(circle.center)).T)
            worst = int(np.argmax(distances_m))  # the farthest place of a straight line is one of its ends
            place_m = (float(corners[worst, 0]), float(corners[worst, 1]))
            yield f"outside of {name}", float(distances_m[worst]) - circle.radius_m, place_m

    def _strays_from_union(self, line: shapely.Geometry) -> Iterator[tuple[str, float, tuple[float, float]]]:
        discs = [
            shapely.Point(self._frame.point_m(c.center)).buffer(c.radius_m, quad_segs=256) for _, c in self._circles
        ]
        union = shapely.union_all([*(shape for _, shape in self._inside), *discs])
        yield from _farthest_outside("outside of every inclusion area", shapely.difference(line, union), union)

    def _intrusions(self, line: shapely.Geometry) -> Iterator[tuple[str, float, tuple[float, float]]]:
        for name, shape, radius_m in self._outside:
            if radius_m > 0.0:
                nearest = shapely.get_coordinates(shapely.shortest_line(line, shape))[0]
                depth_m = radius_m - float(shapely.distance(line, shape))
                yield f"inside of {name}", depth_m, (float(nearest[0]), float(nearest[1]))
            else:
                yield from _farthest_outside(
                    f"inside of {name}", shapely.intersection(line, shape), shapely.boundary(shape)
                )

    def _polygon(self, polygon: FencePolygon) -> shapely.Geometry:
        return shapely.Polygon([self._frame.point_m(vertex) for vertex in polygon.vertices])


def _farthest_outside(
    what: str, part: shapely.Geometry, border: shapely.Geometry
) -> Iterator[tuple[str, float, tuple[float, float]]]:
    """The corner of a part of the leg that is farthest from the border, when there is a part."""
    if shapely.is_empty(part):
        return
    corners = shapely.get_coordinates(shapely.segmentize(part, 1.0) if float(shapely.length(part)) < 1e5 else part)
    distances_m = np.atleast_1d(shapely.distance(shapely.points(corners), border))
    worst = int(np.argmax(distances_m))
    yield what, float(distances_m[worst]), (float(corners[worst, 0]), float(corners[worst, 1]))


class _TangentPlane:
    """East and north of a place, in metres, by points in space (Cartesian ENU)."""

    def __init__(self, origin: LatLon) -> None:
        self._origin_m = np.array(earth_centred_m(origin.lat_deg, origin.lon_deg))
        lat, lon = math.radians(origin.lat_deg), math.radians(origin.lon_deg)
        east = (-math.sin(lon), math.cos(lon), 0.0)
        north = (-math.sin(lat) * math.cos(lon), -math.sin(lat) * math.sin(lon), math.cos(lat))
        self._axes = np.array([east, north])
        self._origin = origin

    def point_m(self, place: LatLon | GeoPoint) -> tuple[float, float]:
        """East and north of one place."""
        east, north = self._axes @ (np.array(earth_centred_m(place.lat_deg, place.lon_deg)) - self._origin_m)
        return float(east), float(north)

    def points_m(self, lat_deg: FloatArray, lon_deg: FloatArray) -> FloatArray:
        """(n, 2) east and north of (n,) places."""
        return np.array([self.point_m(LatLon(*place)) for place in zip(lat_deg, lon_deg, strict=True)])

    def place(self, point_m: tuple[float, float]) -> LatLon:
        """The place of a point, for people: to a metre within some kilometres."""
        x, y, z = self._origin_m + np.array(point_m) @ self._axes
        lat = math.atan2(z, math.hypot(x, y) * (1.0 - 0.00669437999014))
        return LatLon(math.degrees(lat), math.degrees(math.atan2(y, x)))

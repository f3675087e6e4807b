"""Limits by which a mission is judged."""

from dataclasses import dataclass

import numpy as np
import shapely

from mission_io.model.areas import Fence, LatLon
from uavcover.errors import InputError
from uavcover.extras.check.world import World
from uavcover.kernels.arrays import FloatArray
from uavcover.model.area import Rings
from uavcover.model.vehicle import AutopilotName
from uavcover.scenario.airspace.zones import Zone
from uavcover.scenario.obstacles import Prism


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Limits of heights and distances; None is no limit."""

    min_height_agl_m: float = 10.0  # least height above ground between take-off and landing, and on the way home
    max_height_agl_m: float | None = 120.0  # largest height above ground
    max_above_home_m: float | None = None  # largest height above home
    max_distance_m: float | None = None  # largest horizontal distance from home
    wind_m_s: float = 0.0  # wind, from whichever side is worst
    obstacle_clearance_m: float = 10.0  # least distance from obstacles, beside and above them


@dataclass(frozen=True, eq=False, slots=True)
class LocalFence:
    """A fence in the local frame: east and north, metres."""

    inside: tuple[shapely.Polygon, ...] = ()  # polygons to stay inside
    outside: tuple[shapely.Polygon, ...] = ()  # polygons to stay outside
    circles: tuple[tuple[float, float, float, bool], ...] = ()  # east, north, radius, whether to stay inside
    any_inside: bool = False  # whether being inside one of the shapes is enough (PX4), or all of them count (ArduPilot)


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class Surroundings:
    """Surroundings of a mission."""

    fence: LocalFence = LocalFence()  # its fence
    zones: tuple[Zone, ...] = ()  # no-fly zones that come near
    pilot_m: FloatArray | None = None  # (3,) ENU eye of the pilot, who has the radio; none: not judged
    prisms: tuple[Prism, ...] = ()  # obstacles on the ground, by their numbers in it
    obstacle_clearance_m: float = 10.0  # least distance from them, beside and above


FenceSource = Fence | tuple[Rings, ...]
"""A vehicle's fence, or polygons of (longitude, latitude) rings to stay inside."""


def local_fence(source: FenceSource | None, world: World, autopilot: AutopilotName) -> LocalFence:
    """A fence in the local frame.

    ArduPilot wants a place inside every inclusion (AC_PolyFence_loader::breached), PX4 inside any (Geofence::checkPolygons).

    Raises:
        InputError: a polygon crosses itself.
    """
    if source is None:
        return LocalFence()
    if not isinstance(source, Fence):
        parts = [
            shapely.Polygon(_ring(outer, world), [_ring(hole, world) for hole in holes]) for outer, *holes in source
        ]
        return LocalFence(inside=tuple(_valid(part, n) for n, part in enumerate(parts)), any_inside=True)
    polygons = [
        (_valid(shapely.Polygon(_corners(one.vertices, world)), number), one.inclusion)
        for number, one in enumerate(source.polygons)
    ]
    circles = tuple(
        (*world.place(one.center.lat_deg, one.center.lon_deg), one.radius_m, one.inclusion) for one in source.circles
    )
    return LocalFence(
        inside=tuple(polygon for polygon, inclusion in polygons if inclusion),
        outside=tuple(polygon for polygon, inclusion in polygons if not inclusion),
        circles=circles,
        any_inside=autopilot == "px4",
    )


def _valid(polygon: shapely.Polygon, number: int) -> shapely.Polygon:
    if not polygon.is_valid:
        reason = shapely.is_valid_reason(polygon).split("[")[0].strip().lower()
        raise InputError(f"--fence: polygon {number}: it crosses or touches itself ({reason}); draw it again")
    return polygon


def _ring(ring: "tuple[tuple[float, float], ...]", world: World) -> FloatArray:
    lon, lat = np.asarray(ring, float).T
    return np.asarray(world.frame.enu_from_geodetic(lat, lon, world.home_alt_amsl_m)[:, :2])


def _corners(vertices: tuple[LatLon, ...], world: World) -> FloatArray:
    return _ring(tuple((one.lon_deg, one.lat_deg) for one in vertices), world)

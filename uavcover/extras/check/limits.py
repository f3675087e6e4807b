"""Limits by which a mission is judged."""

from dataclasses import dataclass

import shapely

from uavcover.kernels.arrays import FloatArray
from uavcover.scenario.airspace.zones import Zone
from uavcover.scenario.obstacles import Prism


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Limits of heights and distances; None is no limit.

    Attributes:
        min_height_agl_m: least height above ground between take-off and landing, and on the way home.
        max_height_agl_m: largest height above ground.
        max_above_home_m: largest height above home.
        max_distance_m: largest horizontal distance from home.
        wind_m_s: wind, from whichever side is worst.
        obstacle_clearance_m: least distance from obstacles, beside and above them.
    """

    min_height_agl_m: float = 10.0
    max_height_agl_m: float | None = 120.0
    max_above_home_m: float | None = None
    max_distance_m: float | None = None
    wind_m_s: float = 0.0
    obstacle_clearance_m: float = 10.0


@dataclass(frozen=True, eq=False, slots=True)
class LocalFence:
    """A fence in the local frame: east and north, metres.

    Attributes:
        inside: polygons to stay inside.
        outside: polygons to stay outside.
        circles: east, north, radius, whether to stay inside.
        any_inside: whether being inside one of the shapes is enough (PX4), or all of them count (ArduPilot).
    """

    inside: tuple[shapely.Polygon, ...] = ()
    outside: tuple[shapely.Polygon, ...] = ()
    circles: tuple[tuple[float, float, float, bool], ...] = ()
    any_inside: bool = False


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class Surroundings:
    """Surroundings of a mission.

    Attributes:
        fence: its fence.
        zones: no-fly zones that come near.
        pilot_m: (3,) ENU eye of the pilot, who has the radio; none: not judged.
        prisms: obstacles on the ground, by their numbers in it.
        obstacle_clearance_m: least distance from them, beside and above.
    """

    fence: LocalFence = LocalFence()
    zones: tuple[Zone, ...] = ()
    pilot_m: FloatArray | None = None
    prisms: tuple[Prism, ...] = ()
    obstacle_clearance_m: float = 10.0

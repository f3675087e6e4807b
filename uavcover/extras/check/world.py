"""Terms of a check: the aircraft, its limits, and its surroundings in a local frame around home."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Literal

import numpy as np
import shapely
from numpy.typing import ArrayLike

from mission_io.model.items import Fence, LatLon
from uavcover.errors import InputError
from uavcover.kernels.arrays import FloatArray
from uavcover.model.area import Rings
from uavcover.model.vehicle import GRAVITY_M_S2, MOTIONS, AutopilotName
from uavcover.scenario.airspace.zones import Zone
from uavcover.scenario.obstacles import Prism
from uavcover.terrain.frames import LocalFrame
from uavcover.terrain.ground import Ground

Kind = Literal["multirotor", "fixed-wing", "vtol"]
KINDS: Final[tuple[Kind, ...]] = ("multirotor", "fixed-wing", "vtol")
BANK_DEG: Final[Mapping[AutopilotName, float]] = MappingProxyType({"ardupilot": 45.0, "px4": 50.0})
"""LIM_ROLL_CD (ROLL_LIMIT_DEG) and FW_R_LIM."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Aircraft:
    """An aircraft and its autopilot's settings."""

    autopilot: AutopilotName = "ardupilot"  # whose meaning the commands have
    kind: Kind = "multirotor"  # how it moves
    cruise_speed_m_s: float = 10.0  # over ground for a multirotor, through the air for the others
    max_climb_m_s: float = 2.5  # largest upward speed
    max_descent_m_s: float = 1.5  # largest downward speed
    max_airspeed_m_s: float | None = None  # largest speed through the air; None: wind does not slow a multirotor
    return_height_m: float = 15.0  # height above home of the autopilot's own return
    return_height_from: str = "at its default"  # as text; empty where the vehicle or the user states it
    loiter_radius_m: float = 10.0  # radius of a circle whose item states none
    turn_radius_m: float = 0.0  # smallest radius of a turn at cruise speed; 0 for a multirotor
    acceptance_m: float = 0.0  # how far before a waypoint the next leg is taken, where its item does not say
    endurance_s: float | None = None  # time in the air; None: unknown
    reserve_fraction: float = 0.2  # fraction of it that a flight leaves
    speeds_from: str = "the autopilot's defaults"  # where the speeds are from, as text

    @property
    def speeds_text(self) -> str:
        """The speeds that times are reckoned with, and where they are from."""
        words = f"{self.cruise_speed_m_s:g} m/s, climb {self.max_climb_m_s:g} m/s, descent {self.max_descent_m_s:g} m/s"
        if not self.has_wings:
            words += f", acceleration {MOTIONS[self.autopilot].acceleration_m_s2:g} m/s2"
        return f"{words}; from {self.speeds_from}"

    @property
    def has_wings(self) -> bool:
        """Whether it flies between waypoints on wings."""
        return self.kind != "multirotor"

    def turn_radius_at(self, speed_m_s: float) -> float:
        """Smallest radius of a turn at a speed: with one bank it grows with the square."""
        return self.turn_radius_m * (speed_m_s / self.cruise_speed_m_s) ** 2


def default_aircraft(autopilot: AutopilotName, kind: Kind) -> Aircraft:
    """An aircraft with the parameters that its autopilot comes with.

    ArduCopter: WPNAV_SPEED, WPNAV_SPEED_UP, WPNAV_SPEED_DN, RTL_ALT, CIRCLE_RADIUS; ArduPlane: AIRSPEED_CRUISE, TECS_CLMB_MAX,
    TECS_SINK_MAX, ALT_HOLD_RTL, WP_LOITER_RAD, LIM_ROLL_CD, NAVL1_PERIOD; PX4: MPC_XY_CRUISE, MPC_Z_V_AUTO_UP, MPC_Z_V_AUTO_DN,
    FW_AIRSPD_TRIM, FW_T_CLMB_R_SP, FW_T_SINK_R_SP, RTL_RETURN_ALT, NAV_LOITER_RAD, FW_R_LIM, NPFG_PERIOD, NAV_ACC_RAD.
    """
    if kind == "multirotor":
        if autopilot == "px4":
            return Aircraft(
                autopilot=autopilot, cruise_speed_m_s=5.0, max_climb_m_s=3.0, max_descent_m_s=1.5, return_height_m=30.0,
                loiter_radius_m=80.0, acceptance_m=10.0,
            )  # fmt: skip
        return Aircraft(autopilot=autopilot)
    radius_m = radius_of_bank_m(15.0, BANK_DEG[autopilot])
    if autopilot == "px4":  # npfg's switch distance: 0.32 * 10 s / pi * 0.7 * 15 m/s
        return Aircraft(
            autopilot=autopilot, kind=kind, cruise_speed_m_s=15.0, max_climb_m_s=3.0, max_descent_m_s=2.0, return_height_m=60.0,
            loiter_radius_m=80.0, turn_radius_m=radius_m, acceptance_m=10.7,
        )  # fmt: skip
    return Aircraft(  # the L1 distance: 17 s / pi * 0.75 * 15 m/s; WP_RADIUS, 90 m, is more
        autopilot=autopilot, kind=kind, cruise_speed_m_s=15.0, max_climb_m_s=5.0, max_descent_m_s=5.0, return_height_m=100.0,
        loiter_radius_m=60.0, turn_radius_m=radius_m, acceptance_m=61.0,
    )  # fmt: skip


def radius_of_bank_m(speed_m_s: float, bank_deg: float) -> float:
    """Radius of a level turn at a bank: v^2 / (g tan bank)."""
    return speed_m_s**2 / (GRAVITY_M_S2 * math.tan(math.radians(bank_deg)))


@dataclass(frozen=True, eq=False)
class World:
    """The local frame of a mission, whose origin is home on the ground."""

    frame: LocalFrame  # origin at home
    # the height surface in that frame, with obstacles: heights above the terrain, home and zones count from it
    ground: Ground
    # a surface model, with trees and roofs, that the path must keep clear of too; None without one
    surface: Ground | None = None

    @property
    def home_alt_amsl_m(self) -> float:
        """Height of the ground at home, above sea level."""
        return self.frame.alt_amsl_m

    def position(self, lat_deg: float, lon_deg: float) -> tuple[float, float]:
        """East and north of a position, metres."""
        east, north, _ = self.frame.enu_from_geodetic(lat_deg, lon_deg, self.frame.alt_amsl_m)[0]
        return float(east), float(north)

    def at_alts(self, east_north_m: ArrayLike, alt_amsl_m: ArrayLike) -> FloatArray:
        """(n, 3) ENU places at (n, 2) positions with heights above sea level (n,)."""
        en = np.atleast_2d(np.asarray(east_north_m, float))
        alt = np.broadcast_to(np.asarray(alt_amsl_m, float), len(en))
        enu = np.column_stack([en, alt - self.frame.alt_amsl_m])
        for _ in range(3):  # a metre up is a metre of height but for the curvature of the Earth: it converges at once
            enu[:, 2] += alt - self.alts_amsl_m(enu)
        return enu

    def above_ground(self, east_north_m: ArrayLike, height_agl_m: ArrayLike) -> FloatArray:
        """(n, 3) ENU places at (n, 2) positions with heights above ground (n,); NaN up where the ground is unknown."""
        en = np.atleast_2d(np.asarray(east_north_m, float))
        heights = np.ascontiguousarray(np.broadcast_to(np.asarray(height_agl_m, float), len(en)))
        return np.column_stack([en, self.ground.ups_m(en, heights)])

    def leg_height_ranges_m(self, line_m: ArrayLike) -> FloatArray:
        """Heights along the full length of every leg of an (n, 3) ENU line.

        Returns:
            (n - 1, 4) least height above the ground and above the surface model, its parameter along the leg 0..1, largest
            height above the ground, its parameter. Rows of NaN where a leg leaves the surface model, or without one the
            ground; where only the ground is unknown, all heights are above the surface.
        """
        ranges = self.ground.leg_height_ranges_m(line_m)
        if self.surface is None:
            return ranges
        over = self.surface.leg_height_ranges_m(line_m)
        has_ground = np.isfinite(ranges).all(axis=1)
        nearer = has_ground & (over[:, 0] < ranges[:, 0])
        ranges[nearer, :2] = over[nearer, :2]
        alone = ~has_ground | ~np.isfinite(over).all(axis=1)
        ranges[alone] = over[alone]
        return ranges

    def clearances_m(self, positions_m: ArrayLike) -> FloatArray:
        """(n,) heights of (n, 3) ENU places above the higher of ground and surface model; NaN as along legs."""
        heights = self.ground.heights_agl_m(positions_m)
        if self.surface is None:
            return heights
        over = self.surface.heights_agl_m(positions_m)
        return np.where(np.isfinite(heights), np.minimum(heights, over), over)

    def alts_amsl_m(self, enu_m: FloatArray) -> FloatArray:
        """Heights above sea level (n,) of (n, 3) ENU places."""
        return np.asarray(self.frame.geodetic_from_enu(enu_m)[2], float)

    def geodetic(self, enu_m: ArrayLike) -> tuple[float, float, float]:
        """Latitude and longitude in degrees and height above sea level of one ENU place."""
        lat, lon, alt = self.frame.geodetic_from_enu(np.asarray(enu_m, float).reshape(1, 3))
        return float(lat[0]), float(lon[0]), float(alt[0])


# Limits by which a mission is judged.


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
    pilot_m: FloatArray | None = None  # (3,) ENU eye of the pilot, who has the radio; None: not judged
    prisms: tuple[Prism, ...] = ()  # obstacles on the ground, by their numbers in it
    obstacle_clearance_m: float = 10.0  # least distance from them, beside and above


FenceSource = Fence | tuple[Rings, ...]
"""A vehicle's fence, or polygons of (longitude, latitude) rings to stay inside."""


def local_fence(source: FenceSource | None, world: World, autopilot: AutopilotName) -> LocalFence:
    """A fence in the local frame.

    ArduPilot wants a place inside every inclusion (AC_PolyFence_loader::breached), PX4 inside any (Geofence::checkPolygons).

    Raises:
        InputError: a polygon crosses itself, or has fewer than three corners.
    """
    if source is None:
        return LocalFence()
    if not isinstance(source, Fence):
        ring = world.frame.en_from_lon_lat
        parts = [shapely.Polygon(ring(outer), [ring(hole) for hole in holes]) for outer, *holes in source]
        return LocalFence(inside=tuple(_valid(part, n) for n, part in enumerate(parts)), any_inside=True)
    polygons = [
        (_valid(_polygon(one.vertices, world, number), number), one.inclusion)
        for number, one in enumerate(source.polygons)
    ]
    circles = tuple(
        (*world.position(one.center.lat_deg, one.center.lon_deg), one.radius_m, one.inclusion) for one in source.circles
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
        raise InputError(f"--fence: polygon {number} crosses or touches itself ({reason}); draw it again")
    return polygon


def _polygon(vertices: tuple[LatLon, ...], world: World, number: int) -> shapely.Polygon:
    if len(vertices) < 3:
        raise InputError(f"--fence: polygon {number} has {len(vertices)} of the at least 3 corners; draw it again")
    return shapely.Polygon(world.frame.en_from_lon_lat([(one.lon_deg, one.lat_deg) for one in vertices]))

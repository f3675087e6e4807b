"""Surroundings of a mission: its local frame around home, the ground, and the obstacles on it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from uavcover.kernels.arrays import FloatArray
from uavcover.terrain.frames import LocalFrame
from uavcover.terrain.ground import Ground


@dataclass(frozen=True, eq=False)
class World:
    """The local frame of a mission, whose origin is home on the ground."""

    frame: LocalFrame  # origin at home
    # the height surface in that frame, with obstacles: heights above the terrain, home and zones count from it
    ground: Ground
    # a surface model, with trees and roofs, that the path must keep clear of too; none without one
    surface: Ground | None = None

    @property
    def home_alt_amsl_m(self) -> float:
        """Height of the ground at home, above sea level."""
        return self.frame.alt_amsl_m

    def place(self, lat_deg: float, lon_deg: float) -> tuple[float, float]:
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

    def clearances_m(self, places_m: ArrayLike) -> FloatArray:
        """(n,) heights of (n, 3) ENU places above the higher of ground and surface model; NaN as along legs."""
        heights = self.ground.heights_agl_m(places_m)
        if self.surface is None:
            return heights
        over = self.surface.heights_agl_m(places_m)
        return np.where(np.isfinite(heights), np.minimum(heights, over), over)

    def alts_amsl_m(self, enu_m: FloatArray) -> FloatArray:
        """Heights above sea level (n,) of (n, 3) ENU places."""
        return np.asarray(self.frame.geodetic_from_enu(enu_m)[2], float)

    def geodetic(self, enu_m: ArrayLike) -> tuple[float, float, float]:
        """Latitude and longitude in degrees and height above sea level of one ENU place."""
        lat, lon, alt = self.frame.geodetic_from_enu(np.asarray(enu_m, float).reshape(1, 3))
        return float(lat[0]), float(lon[0]), float(alt[0])

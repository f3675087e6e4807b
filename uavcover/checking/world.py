"""Where a mission is flown: its local frame around home, and the ground."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from uavcover.kernels.arrays import FloatArray
from uavcover.scenario.frames import LocalFrame
from uavcover.scenario.ground import Ground


@dataclass(frozen=True, eq=False)
class World:
    """The local frame of a mission, whose origin is home on the ground.

    Attributes:
        frame: origin at home.
        ground: the height surface in that frame.
    """

    frame: LocalFrame
    ground: Ground

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

    def alts_amsl_m(self, enu_m: FloatArray) -> FloatArray:
        """Heights above sea level (n,) of (n, 3) ENU places."""
        return np.asarray(self.frame.geodetic_from_enu(enu_m)[2], float)

    def geodetic(self, enu_m: ArrayLike) -> tuple[float, float, float]:
        """Latitude and longitude in degrees and height above sea level of one ENU place."""
        lat, lon, alt = self.frame.geodetic_from_enu(np.asarray(enu_m, float).reshape(1, 3))
        return float(lat[0]), float(lon[0]), float(alt[0])

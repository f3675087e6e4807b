"""Looks of a sensor on a level vehicle: from where, and which way the vehicle heads there."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class LevelLooks:
    """Looks in flying order.

    Attributes:
        places_m: (k, 3) ENU.
        headings: (k, 2) east and north, of any length; (0, 0) where the vehicle heads nowhere.
    """

    places_m: FloatArray
    headings: FloatArray

    def __len__(self) -> int:
        return int(self.places_m.shape[0])

    @classmethod
    def towards_north(cls, places_m: FloatArray) -> "LevelLooks":
        """From (k, 3) ENU places, heading north: for sensors that see the same whatever the heading."""
        places = np.ascontiguousarray(places_m, dtype=float).reshape(-1, 3)
        return cls(places, np.tile([0.0, 1.0], (len(places), 1)))

    @classmethod
    def by_yaw(cls, places_m: FloatArray, yaw_deg: FloatArray) -> "LevelLooks":
        """From (k, 3) ENU places, heading as (k,) yaws say, clockwise from north; where one is not known, nowhere."""
        places = np.ascontiguousarray(places_m, dtype=float).reshape(-1, 3)
        yaw = np.radians(yaw_deg)
        return cls(places, np.nan_to_num(np.column_stack([np.sin(yaw), np.cos(yaw)])))

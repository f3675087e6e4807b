"""The local east-north-up frame of a scenario, by pyproj's topocentric pipeline.

Heights: the frame takes heights above mean sea level (AMSL) where geometry needs heights above the ellipsoid. Within one
frame the difference, the geoid undulation, is treated as constant. The error is small: undulation changes by centimetres
per kilometre, and a constant offset of 100 m scales horizontal distances by 100 m / 6378 km = 1.6e-5 (16 mm per km).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from pyproj import Transformer

from uavcover.errors import InputError
from uavcover.kernels.arrays import FloatArray


@dataclass(frozen=True)
class LocalFrame:
    """A right-handed east-north-up frame in metres, tangent to the Earth at its origin (WGS 84)."""

    lat_deg: float  # latitude of the origin, -90..90
    lon_deg: float  # longitude of the origin, -180..180
    alt_amsl_m: float  # height of the origin above mean sea level

    def __post_init__(self) -> None:
        if not (-90.0 <= self.lat_deg <= 90.0):
            raise InputError(f"origin: latitude {self.lat_deg} is outside -90 to 90 (swapped with longitude?)")
        if not (-180.0 <= self.lon_deg <= 180.0):
            raise InputError(f"origin: longitude must be between -180 and 180, not {self.lon_deg}")
        if not np.isfinite(self.alt_amsl_m):
            raise InputError("origin: the height above sea level is not a finite number")

    @cached_property
    def _pipeline(self) -> Transformer:
        return Transformer.from_pipeline(
            "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84 "
            f"+step +proj=topocentric +ellps=WGS84 +lat_0={float(self.lat_deg)!r} "
            f"+lon_0={float(self.lon_deg)!r} +h_0={float(self.alt_amsl_m)!r}"
        )

    def enu_from_geodetic(
        self, lat_deg: ArrayLike | float, lon_deg: ArrayLike | float, alt_amsl_m: ArrayLike | float
    ) -> FloatArray:
        """Local coordinates of geodetic positions.

        Args:
            lat_deg: (n,) latitudes, degrees.
            lon_deg: (n,) longitudes, degrees.
            alt_amsl_m: (n,) heights above mean sea level, metres.

        Returns:
            (n, 3) east, north, up in metres; non-finite where the input is.
        """
        if isinstance(lat_deg, float) and isinstance(lon_deg, float) and isinstance(alt_amsl_m, float):
            # a vehicle's place comes many times a second, and pyproj is five times as fast for one without arrays.
            return np.array([self._pipeline.transform(float(lon_deg), float(lat_deg), float(alt_amsl_m))])
        lat, lon, alt = np.broadcast_arrays(
            *(np.atleast_1d(np.asarray(a, float)) for a in (lat_deg, lon_deg, alt_amsl_m))
        )
        east, north, up = self._pipeline.transform(lon, lat, alt)
        return np.column_stack([east, north, up])

    def en_from_lon_lat(self, lon_lat_deg: ArrayLike) -> FloatArray:
        """(n, 2) east, north of (n, 2) longitudes and latitudes, degrees, at the height of the origin."""
        lon, lat = np.asarray(lon_lat_deg, float).reshape(-1, 2).T
        return np.asarray(self.enu_from_geodetic(lat, lon, self.alt_amsl_m)[:, :2])

    def geodetic_from_enu(self, enu_m: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Geodetic positions of local coordinates: the inverse of :meth:`enu_from_geodetic`.

        Args:
            enu_m: (n, 3) east, north, up in metres.

        Returns:
            latitudes (n,) in degrees, longitudes (n,) in degrees, heights above mean sea level (n,) in metres.
        """
        enu = np.atleast_2d(np.asarray(enu_m, float))
        if len(enu) == 1:
            east, north, up = enu[0].tolist()
            one_lon, one_lat, one_alt = self._pipeline.transform(east, north, up, direction="INVERSE")
            return np.array([one_lat]), np.array([one_lon]), np.array([one_alt])
        lon, lat, alt = self._pipeline.transform(enu[:, 0], enu[:, 1], enu[:, 2], direction="INVERSE")
        return np.asarray(lat, float), np.asarray(lon, float), np.asarray(alt, float)

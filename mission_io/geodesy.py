"""Places on WGS 84 as points in space, and distances between them."""

import math

EQUATOR_RADIUS_M = 6378137.0
ECCENTRICITY_SQUARED = (2.0 - 1.0 / 298.257223563) / 298.257223563
"""WGS 84 (NIMA TR8350.2): semi-major axis and first eccentricity squared, from the flattening."""


def earth_centred_m(lat_deg: float, lon_deg: float, height_m: float = 0.0) -> tuple[float, float, float]:
    """A place as x, y, z from the centre of the Earth; ``height_m`` is above the ellipsoid."""
    lat, lon = math.radians(lat_deg), math.radians(lon_deg)
    normal_m = EQUATOR_RADIUS_M / math.sqrt(1.0 - ECCENTRICITY_SQUARED * math.sin(lat) ** 2)
    across_m = (normal_m + height_m) * math.cos(lat)
    up_m = (normal_m * (1.0 - ECCENTRICITY_SQUARED) + height_m) * math.sin(lat)
    return across_m * math.cos(lon), across_m * math.sin(lon), up_m


def ground_distance_m(lat_a_deg: float, lon_a_deg: float, lat_b_deg: float, lon_b_deg: float) -> float:
    """The distance over ground between two places, at sea level.

    The chord through the Earth, bent with the mean curvature between them: below 500 km it agrees with the geodesic to
    1 part in 10,000, and below 20 km to a millimetre and 1 part in a million (tested against pyproj).
    """
    a, b = earth_centred_m(lat_a_deg, lon_a_deg), earth_centred_m(lat_b_deg, lon_b_deg)
    chord_m = math.dist(a, b)
    radius_m = 0.5 * (math.hypot(*a) + math.hypot(*b))
    return 2.0 * radius_m * math.asin(min(1.0, chord_m / (2.0 * radius_m)))

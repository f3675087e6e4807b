"""Flights of all kinds for the writers of controllers' formats, from a seed."""

import numpy as np

from mission_io.formats.point_route import CameraFlight, CameraPoint
from mission_io.model.items import GeoPoint

POSITIONS = ((47.25, -8.5), (-33.9, 151.2), (0.0, 0.0), (-16.5, 179.9999), (89.2, 12.0), (71.0, -179.9999))
"""Where flights are: on both sides of every meridian that matters, and near a pole."""


def random_flight(seed: int, *, points: int = 12, speed_m_s: tuple[float, float] = (1.0, 15.0)) -> CameraFlight:
    """Legs of some 100 metres, heights below and above home, headings, angles, pictures at points and by distance."""
    rng = np.random.default_rng(seed)
    lat0, lon0 = POSITIONS[seed % len(POSITIONS)]
    metre = 1.0 / 111_000.0
    distance_m: float | None = None
    pitch_deg: float | None = None
    found = []
    for number in range(points):
        lat = lat0 + number * 60.0 * metre + rng.uniform(-20.0, 20.0) * metre
        lon = lon0 + rng.uniform(-80.0, 80.0) * metre / max(np.cos(np.radians(lat)), 0.01)
        if rng.random() < 0.3:
            distance_m = None if rng.random() < 0.4 else float(rng.uniform(2.0, 40.0))
        if rng.random() < 0.4:
            pitch_deg = float(rng.uniform(-90.0, 0.0))
        found.append(
            CameraPoint(
                lat_deg=lat, lon_deg=(lon + 180.0) % 360.0 - 180.0,
                height_above_home_m=float(rng.uniform(2.0, 120.0) if number == 0 else rng.uniform(-150.0, 450.0)),
                speed_m_s=float(rng.uniform(*speed_m_s)),
                heading_deg=None if rng.random() < 0.5 else float(rng.uniform(0.0, 360.0)),
                pitch_deg=pitch_deg, photos=int(rng.integers(0, 3)), photo_distance_m=distance_m,
            )
        )  # fmt: skip
    return CameraFlight(GeoPoint(found[0].lat_deg, found[0].lon_deg, float(rng.uniform(-20.0, 3000.0))), tuple(found))


def photos_at_once(flight: CameraFlight) -> list[int]:
    """How many pictures each point takes: its own, and the first one where pictures by distance begin or change."""
    before = [None, *(point.photo_distance_m for point in flight.points[:-1])]
    return [
        point.photos + (point.photo_distance_m is not None and point.photo_distance_m != last)
        for point, last in zip(flight.points, before, strict=True)
    ]

"""Doubts about a mission that a file can hold but hardly anybody means: a place at 0, 0, a route far from home."""

import math

from mission_io.geodesy import ground_distance_m
from mission_io.items import Command, GeoPoint, Mission

FAR_FROM_HOME_M = 100_000.0
"""Beyond this a place is doubted; no electric multicopter flies so far."""


def doubts_about(mission: Mission, *, far_from_home_m: float = FAR_FROM_HOME_M) -> tuple[str, ...]:
    """One line for each thing that is probably a mistake; empty when nothing is.

    A route far from home is told apart from one whose latitudes and longitudes are swapped. Doubts are no errors: the
    mission is what the file says.
    """
    home = mission.home
    doubts: list[str] = []
    if home is not None and home.lat_deg == 0.0 and home.lon_deg == 0.0:
        doubts.append("home is at latitude 0, longitude 0, where nobody flies; was it never set?")
        home = None
    far: list[tuple[int, float]] = []
    swapped = 0
    for number, item in enumerate(mission.items, start=1):
        if not item.has_position or not (math.isfinite(item.lat_deg) and math.isfinite(item.lon_deg)):
            continue
        if item.lat_deg == 0.0 and item.lon_deg == 0.0:
            if item.command == Command.NAV_WAYPOINT:
                doubts.append(f"item {number}: a waypoint at latitude 0, longitude 0")
            continue
        if home is None:
            continue
        distance_m = ground_distance_m(home.lat_deg, home.lon_deg, item.lat_deg, item.lon_deg)
        if distance_m > far_from_home_m:
            far.append((number, distance_m))
            swapped += _near_when_swapped(home, item.lat_deg, item.lon_deg, far_from_home_m)
    if far:
        number, distance_m = max(far, key=lambda entry: entry[1])
        what = "latitude and longitude are swapped" if swapped == len(far) else "is it another place's route, or home?"
        rank = f"the farthest of {len(far)} beyond {far_from_home_m / 1000.0:.0f} km"
        doubts.append(f"item {number}: {distance_m / 1000.0:.0f} km from home, {rank}; {what}")
    return tuple(doubts)


def _near_when_swapped(home: GeoPoint, lat_deg: float, lon_deg: float, limit_m: float) -> bool:
    return abs(lon_deg) <= 90.0 and ground_distance_m(home.lat_deg, home.lon_deg, lon_deg, lat_deg) <= limit_m

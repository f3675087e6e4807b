"""Whether the places of a mission are where it can be meant: home, items, and the elevation data belong together."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from mission_io.model.items import Command, GeoPoint, Mission
from mission_io.model.places import FAR_FROM_HOME_M, ground_distance_m
from uavcover.extras.check.findings import CheckFinding, Weight
from uavcover.extras.check.tuning import PATH
from uavcover.kernels.arrays import FloatArray
from uavcover.model.vehicle import AutopilotName

Heights = Callable[[FloatArray, FloatArray], FloatArray]
"""Heights of the ground above sea level at latitudes and longitudes, NaN where there is none."""
Doubt = Callable[[float, float], str]
"""Reason to distrust the height at a latitude and longitude; empty if there is none."""

OTHER_DATA = (
    "use other elevation data, or mark its missing heights (gdal_edit.py -a_nodata); if the data is "
    "correct, add --trust-dem"
)
"""Remedy for heights that do not look like ground."""


@dataclass(frozen=True, slots=True)
class MissionPlaces:
    """Positions of a mission."""

    home: GeoPoint | None  # on the ground; none where that is not known, and nothing can be judged
    skipped: frozenset[int]  # numbers of items whose place cannot be meant
    findings: tuple[CheckFinding, ...]  # what is wrong with places


def believed(_lat_deg: float, _lon_deg: float) -> str:
    """Every height is believed."""
    return ""


def places_of(
    mission: Mission,  # whose places
    heights: Heights,  # of the ground
    autopilot: AutopilotName,  # PX4 flies to 0, 0; ArduPilot stays where it is
    *,
    # latitude and longitude of the take-off position; none: the mission's, or its first place
    home: tuple[float, float] | None = None,
    doubt: Doubt = believed,  # why heights are missing that the elevation data has
) -> MissionPlaces:
    """Look at home and at the places of the items."""
    findings: list[CheckFinding] = []
    numbers = [
        n for n, item in enumerate(mission.items, 1) if item.has_position and _is_place(item.lat_deg, item.lon_deg)
    ]
    lat = np.array([mission.items[n - 1].lat_deg for n in numbers])
    lon = np.array([mission.items[n - 1].lon_deg for n in numbers])
    ground = _heights(heights, lat, lon)
    at = _home_place(mission, home, lat, lon, findings)
    if at is None:
        what, do = "no mission item has a position", "use a mission that contains waypoints"
        findings.append(CheckFinding(kind="place", weight="unknown", what=what, do=do))
        return MissionPlaces(None, frozenset(), tuple(findings))
    height = float(_heights(heights, np.array([at[0]]), np.array([at[1]]))[0])
    if not math.isfinite(height) and (why := doubt(*at)):
        what = f"home, the reference of the heights, is on {why}"
        findings.append(_at("suspect-ground", "unknown", 0, at, what=what, do=OTHER_DATA))
        return MissionPlaces(None, frozenset(), tuple(findings))
    if not math.isfinite(height):
        findings.append(_home_elsewhere(at, heights, known=bool(np.isfinite(ground).any())))
        return MissionPlaces(None, frozenset(), tuple(findings))
    if home is None and mission.home is not None and at == (mission.home.lat_deg, mission.home.lon_deg):
        _compare_home(mission.home.alt_amsl_m, at, height, findings)
    skipped = _far_items(at, heights, dict(zip(numbers, zip(lat, lon, ground, strict=True), strict=True)), findings)
    _zeros(mission, autopilot, findings)
    return MissionPlaces(GeoPoint(at[0], at[1], height), frozenset(skipped), tuple(findings))


def _at(
    kind: str, weight: Weight, number: int, lat_lon_deg: tuple[float, float], *, what: str, do: str
) -> CheckFinding:
    lat, lon = map(float, lat_lon_deg)
    return CheckFinding(kind=kind, weight=weight, items=(number, number), lat_deg=lat, lon_deg=lon, what=what, do=do)


def _is_place(lat_deg: float, lon_deg: float) -> bool:
    return math.isfinite(lat_deg) and math.isfinite(lon_deg) and (lat_deg, lon_deg) != (0.0, 0.0)


def _heights(heights: Heights, lat: FloatArray, lon: FloatArray) -> FloatArray:
    """Heights of places that may be anywhere; those that are no places on Earth have none."""
    out = np.full(len(lat), np.nan)
    real = (np.abs(lat) <= 90.0) & (np.abs(lon) <= 180.0)
    # Places near to each other at once: far ones in one window would read all between them.
    parts: dict[tuple[float, float], list[int]] = {}
    for k in np.flatnonzero(real).tolist():
        parts.setdefault((lat[k] // PATH.near_deg, lon[k] // PATH.near_deg), []).append(k)
    for numbers in parts.values():
        out[numbers] = heights(lat[numbers], lon[numbers])
    return out


def _home_place(
    mission: Mission, home: tuple[float, float] | None, lat: FloatArray, lon: FloatArray, findings: list[CheckFinding]
) -> tuple[float, float] | None:
    if home is not None:
        return home
    if mission.home is not None and _is_place(mission.home.lat_deg, mission.home.lon_deg):
        return mission.home.lat_deg, mission.home.lon_deg
    if not len(lat):
        return None
    what = "the mission has no home, so take-off was assumed below its first position"
    findings.append(_at("home", "look", 0, (lat[0], lon[0]), what=what, do="specify home with --home LAT,LON"))
    return float(lat[0]), float(lon[0])


def _home_elsewhere(at: tuple[float, float], heights: Heights, *, known: bool) -> CheckFinding:
    swapped = abs(at[1]) <= 90.0 and math.isfinite(float(_heights(heights, np.array([at[1]]), np.array([at[0]]))[0]))
    if swapped:
        what, do = "latitude and longitude of home seem to be swapped", "swap the two values"
    elif known:
        what = "home lies outside the elevation data, but the route lies inside"
        do = "specify the take-off position with --home LAT,LON"
    else:
        what, do = "the mission lies outside the elevation data", "use elevation data for its location"
    return _at("place", "breaks", 0, at, what=what, do=do)


def _compare_home(stated_m: float, at: tuple[float, float], height_m: float, findings: list[CheckFinding]) -> None:
    if math.isfinite(stated_m) and abs(stated_m - height_m) > PATH.home_difference_m:
        what = (
            f"home is {stated_m:.0f} m above sea level in the file, but the ground there is {height_m:.0f} m; "
            "heights above home were measured from the ground"
        )
        found = _at("home", "look", 0, at, what=what, do="compare the vertical datums, or move home")
        findings.append(replace(found, alt_amsl_m=stated_m, by=abs(stated_m - height_m), unit="m"))


def _far_items(
    at: tuple[float, float],
    heights: Heights,
    items: dict[int, tuple[float, float, float]],
    findings: list[CheckFinding],
) -> list[int]:
    skipped = []
    for number, (lat, lon, ground_m) in items.items():
        if math.isfinite(ground_m) and ground_distance_m(*at, lat, lon) <= FAR_FROM_HOME_M:
            continue
        swapped_m = _heights(heights, np.array([lon]), np.array([lat]))[0] if abs(lon) <= 90.0 else math.nan
        distance_m = ground_distance_m(*at, lat, lon)
        if math.isfinite(swapped_m):
            what, do = "latitude and longitude seem to be swapped", "swap the two values"
        elif distance_m > FAR_FROM_HOME_M:
            what, do = f"{distance_m / 1000.0:.0f} km from home", "correct its position"
        else:
            continue  # near, over unknown ground: the legs tell
        skipped.append(number)
        found = _at("place", "breaks", number, (lat, lon), what=what, do=f"{do}; this item was ignored")
        findings.append(replace(found, by=distance_m, unit="m"))
    return skipped


def _zeros(mission: Mission, autopilot: AutopilotName, findings: list[CheckFinding]) -> None:
    for number, item in enumerate(mission.items, 1):
        if item.has_position and item.lat_deg == 0.0 and item.lon_deg == 0.0 and item.command == Command.NAV_WAYPOINT:
            weight: Weight = "breaks" if autopilot == "px4" else "look"
            what = "this waypoint is at latitude 0, longitude 0"
            what += "" if autopilot == "px4" else ": ArduPilot holds its position"
            findings.append(
                _at("place", weight, number, (0.0, 0.0), what=what, do="specify its position, or remove it")
            )

"""DJI's WPML: a KMZ archive with ``wpmz/template.kml``, which apps edit, and ``wpmz/waylines.wpml``, which is flown.

Elements and their values are those of the tables that DJI publishes (github.com/dji-sdk/Cloud-API-Doc, v1.11.3, DJI WPML).
What keeps to the checked legs, and why:

- Heights are above the place of take-off (``relativeToStartPoint``), or above the ellipsoid of WGS 84 (``WGS84``) where the
  caller knows these. The climb and the return are above the take-off in both.
- The first point is straight above home, at the height that the aircraft climbs to first (``takeOffSecurityHeight``), and the
  last one is straight above the landing, where it lands on the spot (``autoLand``): nothing is flown but legs of the file.
- It flies straight lines and stops at each point (``toPointAndStopWithDiscontinuityCurvature``): other turns cut corners.
- Without the remote control it goes on (``goContinue``) and comes home along the same legs.
"""

import io
import math
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass

from mission_io.errors import FormatError
from mission_io.formats.camera_flight import CameraFlight
from mission_io.formats.text import rendered

MOST_POINTS = 65536
"""Numbers of points go from 0 to 65535; what apps and aircraft take is less."""
IMAGE_FORMATS = ("wide", "zoom", "ir", "narrow_band", "visible")
"""Lenses that pictures are kept of."""
_MOST_TRANSITIONAL_M_S = 15.0
_SECURITY_HEIGHTS_M = (1.2, 1500.0)
_STAMP = (1980, 1, 1, 0, 0, 0)
"""The time of the archive's files: equal missions are equal files."""


@dataclass(frozen=True, slots=True)
class DjiAircraft:
    """An aircraft with its camera, as WPML names it.

    Attributes:
        title: For people.
        drone: Its type and subtype.
        payload: The type of its camera.
        payload_position: Where the camera is mounted; 0 is the main gimbal.
        image_format: Which lenses' pictures are kept: one of IMAGE_FORMATS, or several with commas.
        pitch_range_deg: Angles that its gimbal reaches.
        max_speed_m_s: Largest speed over ground.
    """

    title: str
    drone: tuple[int, int]
    payload: int
    payload_position: int
    image_format: str
    pitch_range_deg: tuple[float, float]
    max_speed_m_s: float


@dataclass(frozen=True, slots=True)
class AbsoluteHeights:
    """Heights of the points of a flight, one each.

    Attributes:
        amsl_m: Above the sea level of EGM96.
        ellipsoid_m: Above the ellipsoid of WGS 84.
    """

    amsl_m: Sequence[float]
    ellipsoid_m: Sequence[float]


def write_kmz(
    flight: CameraFlight,
    aircraft: DjiAircraft,
    *,
    return_height_m: float,
    absolute: AbsoluteHeights | None = None,
) -> bytes:
    """Write a flight as a KMZ archive.

    Args:
        flight: What to fly.
        aircraft: What flies it.
        return_height_m: Height above home that the aircraft climbs to before it returns by itself.
        absolute: Heights of the points that do not depend on where it takes off; None: they are flown above the take-off.

    Raises:
        FormatError: the aircraft or the format cannot do it, with the point.
    """
    _check(flight, aircraft, return_height_m)
    facts = {
        "aircraft": aircraft,
        "return_height_m": return_height_m,
        # The way to the first point is the climb alone, so the speed of that way, which has a limit of its own, is no matter.
        "transitional_m_s": min(flight.points[0].speed_m_s, _MOST_TRANSITIONAL_M_S),
        "is_absolute": absolute is not None,
        "points": _points(flight, absolute),
    }
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as kmz:
        for name in ("template.kml", "waylines.wpml"):
            entry = zipfile.ZipInfo(f"wpmz/{name}", _STAMP)
            entry.compress_type = zipfile.ZIP_DEFLATED
            kmz.writestr(entry, rendered("dji.wpml.jinja", is_template=name == "template.kml", **facts).encode())
    return archive.getvalue()


def _check(flight: CameraFlight, aircraft: DjiAircraft, return_height_m: float) -> None:
    if len(flight.points) > MOST_POINTS:
        raise FormatError(f"{len(flight.points)} points; the limit of WPML is {MOST_POINTS}", where="flight")
    low_m, high_m = _SECURITY_HEIGHTS_M
    climb_m = flight.points[0].height_above_home_m
    if not low_m <= climb_m <= high_m:
        what = f"the climb ends {climb_m:g} m above home; WPML accepts {low_m:g} to {high_m:g}"
        raise FormatError(what, where="point 1", advice="change vehicle.takeoff_height_m, or move home")
    if not 0.0 < return_height_m <= high_m:
        what = f"{return_height_m:g} m above home; the limit of WPML is {high_m:g}"
        raise FormatError(what, where="return height", advice="move home")
    low_deg, high_deg = aircraft.pitch_range_deg
    for number, point in enumerate(flight.points, start=1):
        where = f"point {number}"
        if not 0.0 < point.speed_m_s <= aircraft.max_speed_m_s:
            what = f"{point.speed_m_s:g} m/s; the {aircraft.title} flies at most {aircraft.max_speed_m_s:g}"
            raise FormatError(what, where=where, advice="plan with a lower vehicle.cruise_speed_m_s")
        if point.pitch_deg is not None and not low_deg <= point.pitch_deg <= high_deg:
            what = f"the camera pitch is {point.pitch_deg:g} degrees; the {aircraft.title} allows {low_deg:g} to {high_deg:g}"
            raise FormatError(what, where=where, advice="plan with another sensor.pitch_deg")


@dataclass(frozen=True, slots=True)
class _Action:
    """Turn the gimbal to a pitch, or take a photo whose name ends like this."""

    pitch_deg: float | None = None
    suffix: str = ""


@dataclass(frozen=True, slots=True)
class _ActionGroup:
    """Actions on reaching a point, or every ``distance_m`` from the first point to the last."""

    number: int
    first: int
    last: int
    actions: Sequence[_Action]
    distance_m: float | None = None


def _points(flight: CameraFlight, absolute: AbsoluteHeights | None) -> list[dict[str, object]]:
    """Each point with its height in the template, the flown one, its heading from -180 to 180 degrees, and its actions."""
    relative_m = [point.height_above_home_m for point in flight.points]
    heights_m, flown_m = (relative_m, relative_m) if absolute is None else (absolute.amsl_m, absolute.ellipsoid_m)
    return [
        {
            "point": point, "height_m": height_m, "flown_m": executed_m, "groups": groups,
            "heading_deg": None if point.heading_deg is None else math.remainder(point.heading_deg, 360.0),
        }
        for point, height_m, executed_m, groups in zip(
            flight.points, heights_m, flown_m, _action_groups(flight), strict=True
        )
    ]  # fmt: skip


def _action_groups(flight: CameraFlight) -> list[list[_ActionGroup]]:
    """The action groups that begin at each point, numbered through the file."""
    found: list[list[_ActionGroup]] = [[] for _ in flight.points]
    number = 0
    pitch_deg: float | None = None
    distance_m: float | None = None
    for index, point in enumerate(flight.points):
        turns = point.pitch_deg is not None and point.pitch_deg != pitch_deg
        pitch_deg = point.pitch_deg if turns else pitch_deg
        begins = point.picture_distance_m is not None and point.picture_distance_m != distance_m
        pictures = point.pictures + begins  # where pictures by distance begin, one is taken at once
        actions = [_Action(pitch_deg)] * turns + [_Action(suffix=f"point{index + 1}")] * pictures
        if actions:
            found[index].append(_ActionGroup(number, index, index, actions))
            number += 1
        if begins:
            actions = [_Action(suffix="distance")]
            last = _last_of_stretch(flight, index)
            found[index].append(_ActionGroup(number, index, last, actions, point.picture_distance_m))
            number += 1
        distance_m = point.picture_distance_m
    return found


def _last_of_stretch(flight: CameraFlight, first: int) -> int:
    """The point at which photos at the distance of point ``first`` end."""
    for index in range(first + 1, len(flight.points)):
        if flight.points[index].picture_distance_m != flight.points[first].picture_distance_m:
            return index
    return len(flight.points) - 1

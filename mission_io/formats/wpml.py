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
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from mission_io.errors import FormatError
from mission_io.formats.camera_flight import CameraFlight, CameraPoint
from mission_io.formats.text import degrees_text, plain_decimal, xml_text

MOST_POINTS = 65536
"""Numbers of points go from 0 to 65535; what apps and aircraft take is less."""
IMAGE_FORMATS = ("wide", "zoom", "ir", "narrow_band", "visible")
"""Lenses that pictures are kept of."""
_MOST_TRANSITIONAL_M_S = 15.0
_SECURITY_HEIGHTS_M = (1.2, 1500.0)
_STAMP = (1980, 1, 1, 0, 0, 0)
"""The time of the archive's files: equal missions are equal files."""
_HEAD = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:wpml="http://www.dji.com/wpmz/1.0.2">
<Document>
"""
_TAIL = "</Folder>\n</Document>\n</kml>\n"
_RELATIVE = "relativeToStartPoint"
_TURN_MODE = "toPointAndStopWithDiscontinuityCurvature"


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
    speed = plain_decimal(flight.points[0].speed_m_s, "point 1, speed")
    heights = _heights(flight, absolute)
    waylines = _document(_mission_config(flight, aircraft, return_height_m), [
        _element("wpml:templateId", 0),
        _element("wpml:executeHeightMode", _RELATIVE if absolute is None else "WGS84"),
        _element("wpml:waylineId", 0),
        _element("wpml:autoFlightSpeed", speed),
        *_placemarks(flight, aircraft, heights, template=False),
    ])  # fmt: skip
    template = _document(_mission_config(flight, aircraft, None), [
        _element("wpml:templateType", "waypoint"),
        _element("wpml:templateId", 0),
        _group("wpml:waylineCoordinateSysParam", [
            _element("wpml:coordinateMode", "WGS84"),
            _element("wpml:heightMode", _RELATIVE if absolute is None else "EGM96"),
        ]),
        _element("wpml:autoFlightSpeed", speed),
        _element("wpml:globalHeight", plain_decimal(heights[0][0], "point 1")),
        # The actions of the points turn the gimbal; "manual" keeps its angle between them.
        _element("wpml:gimbalPitchMode", "manual"),
        _heading(None, "wpml:globalWaypointHeadingParam"),
        _element("wpml:globalWaypointTurnMode", _TURN_MODE),
        _element("wpml:globalUseStraightLine", 1),
        _group("wpml:payloadParam", [
            _element("wpml:payloadPositionIndex", aircraft.payload_position),
            _element("wpml:imageFormat", aircraft.image_format),
        ]),
        *_placemarks(flight, aircraft, heights, template=True),
    ])  # fmt: skip
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as kmz:
        for name, text in (("template.kml", template), ("waylines.wpml", waylines)):
            entry = zipfile.ZipInfo(f"wpmz/{name}", _STAMP)
            entry.compress_type = zipfile.ZIP_DEFLATED
            kmz.writestr(entry, text.encode())
    return archive.getvalue()


def _check(flight: CameraFlight, aircraft: DjiAircraft, return_height_m: float) -> None:
    if len(flight.points) > MOST_POINTS:
        raise FormatError(f"{len(flight.points)} points, WPML numbers {MOST_POINTS}", where="flight")
    low_m, high_m = _SECURITY_HEIGHTS_M
    climb_m = flight.points[0].height_above_home_m
    if not low_m <= climb_m <= high_m:
        what = f"the climb ends {climb_m:g} m above home, WPML takes {low_m:g} to {high_m:g}"
        raise FormatError(what, where="point 1", advice="change vehicle.takeoff_height_m, or move home")
    if not 0.0 < return_height_m <= high_m:
        what = f"{return_height_m:g} m above home, WPML takes up to {high_m:g}"
        raise FormatError(what, where="return height", advice="move home")
    low_deg, high_deg = aircraft.pitch_range_deg
    for number, point in enumerate(flight.points, start=1):
        where = f"point {number}"
        if not 0.0 < point.speed_m_s <= aircraft.max_speed_m_s:
            what = f"{point.speed_m_s:g} m/s, the {aircraft.title} flies {aircraft.max_speed_m_s:g} at most"
            raise FormatError(what, where=where, advice="plan with a lower vehicle.cruise_speed_m_s")
        if point.pitch_deg is not None and not low_deg <= point.pitch_deg <= high_deg:
            what = f"the camera looks {point.pitch_deg:g} degrees, that of the {aircraft.title} {low_deg:g} to {high_deg:g}"
            raise FormatError(what, where=where, advice="plan with another sensor.pitch_deg")


def _mission_config(flight: CameraFlight, aircraft: DjiAircraft, return_height_m: float | None) -> Iterable[str]:
    """Settings of the whole flight; the return height belongs into the file that is flown, and not into the template."""
    first = flight.points[0]
    # The way to the first point is the climb alone, so the speed of that way, which has a limit of its own, is no matter.
    transitional_m_s = min(first.speed_m_s, _MOST_TRANSITIONAL_M_S)
    kind, subkind = aircraft.drone
    yield _element("wpml:flyToWaylineMode", "safely")
    yield _element("wpml:finishAction", "autoLand")
    yield _element("wpml:exitOnRCLost", "goContinue")
    yield _element("wpml:executeRCLostAction", "hover")
    yield _element("wpml:takeOffSecurityHeight", plain_decimal(first.height_above_home_m, "point 1"))
    yield _element("wpml:globalTransitionalSpeed", plain_decimal(transitional_m_s, "point 1, speed"))
    if return_height_m is not None:
        yield _element("wpml:globalRTHHeight", plain_decimal(return_height_m, "return height"))
    yield _group("wpml:droneInfo", [_element("wpml:droneEnumValue", kind), _element("wpml:droneSubEnumValue", subkind)])
    yield _group("wpml:payloadInfo", [
        _element("wpml:payloadEnumValue", aircraft.payload),
        _element("wpml:payloadPositionIndex", aircraft.payload_position),
    ])  # fmt: skip


def _heights(flight: CameraFlight, absolute: AbsoluteHeights | None) -> list[tuple[float, float]]:
    """For each point its height in the template, and the flown one; equal for heights above take-off."""
    if absolute is None:
        return [(point.height_above_home_m, point.height_above_home_m) for point in flight.points]
    return list(zip(absolute.amsl_m, absolute.ellipsoid_m, strict=True))


def _placemarks(
    flight: CameraFlight, aircraft: DjiAircraft, heights_m: Sequence[tuple[float, float]], *, template: bool
) -> list[str]:
    groups = _action_groups(flight, aircraft)
    return [
        _placemark(index, point, heights_m[index], groups[index], template=template)
        for index, point in enumerate(flight.points)
    ]


def _placemark(
    index: int, point: CameraPoint, heights_m: tuple[float, float], groups: list[str], *, template: bool
) -> str:
    where = f"point {index + 1}"
    place = f"{degrees_text(point.lon_deg, where)},{degrees_text(point.lat_deg, where)}"
    height, executed = (plain_decimal(height_m, where) for height_m in heights_m)
    speed = _element("wpml:waypointSpeed", plain_decimal(point.speed_m_s, where))
    turn = _group("wpml:waypointTurnParam", [
        _element("wpml:waypointTurnMode", _TURN_MODE),
        _element("wpml:waypointTurnDampingDist", 0),
    ])  # fmt: skip
    content = [_group("Point", [_element("coordinates", place)]), _element("wpml:index", index)]
    if template:
        content += [
            # Apps read "height" in the template's mode; both elements are required, and where that is relative both are equal.
            _element("wpml:ellipsoidHeight", executed),
            _element("wpml:height", height),
            _element("wpml:useGlobalHeight", 0),
            _element("wpml:useGlobalSpeed", 0),
            speed,
            _element("wpml:useGlobalHeadingParam", 0),
            _heading(point.heading_deg, "wpml:waypointHeadingParam"),
            _element("wpml:useGlobalTurnParam", 0),
        ]
    else:
        content += [
            _element("wpml:executeHeight", executed),
            speed,
            _heading(point.heading_deg, "wpml:waypointHeadingParam"),
        ]
    return _group("Placemark", [*content, turn, _element("wpml:useStraightLine", 1), *groups])


def _heading(heading_deg: float | None, tag: str) -> str:
    """Along the legs, or held at a heading, which WPML counts from -180 to 180 degrees."""
    mode, angle_deg = "followWayline", 0.0
    if heading_deg is not None:
        mode, angle_deg = "smoothTransition", math.remainder(heading_deg, 360.0)
    return _group(tag, [
        _element("wpml:waypointHeadingMode", mode),
        _element("wpml:waypointHeadingAngle", plain_decimal(angle_deg, "heading")),
        _element("wpml:waypointHeadingPathMode", "followBadArc"),
    ])  # fmt: skip


def _action_groups(flight: CameraFlight, aircraft: DjiAircraft) -> list[list[str]]:
    """The action groups that begin at each point, numbered through the file."""
    found: list[list[str]] = [[] for _ in flight.points]
    number = 0
    pitch_deg: float | None = None
    distance_m: float | None = None
    for index, point in enumerate(flight.points):
        actions: list[str] = []
        if point.pitch_deg is not None and point.pitch_deg != pitch_deg:
            actions.append(_turn_gimbal(0, point.pitch_deg, aircraft))
            pitch_deg = point.pitch_deg
        begins = point.picture_distance_m is not None and point.picture_distance_m != distance_m
        for _ in range(point.pictures + begins):  # where pictures by distance begin, one is taken at once
            actions.append(_take_picture(len(actions), f"point{index + 1}", aircraft))
        if actions:
            found[index].append(
                _action_group(number, (index, index), [_element("wpml:actionTriggerType", "reachPoint")], actions)
            )
            number += 1
        if begins and point.picture_distance_m is not None:
            trigger = [
                _element("wpml:actionTriggerType", "multipleDistance"),
                _element("wpml:actionTriggerParam", plain_decimal(point.picture_distance_m, f"point {index + 1}")),
            ]
            last = _last_of_stretch(flight, index)
            found[index].append(_action_group(number, (index, last), trigger, [_take_picture(0, "distance", aircraft)]))
            number += 1
        distance_m = point.picture_distance_m
    return found


def _last_of_stretch(flight: CameraFlight, first: int) -> int:
    """The point at which photos at the distance of point ``first`` end."""
    for index in range(first + 1, len(flight.points)):
        if flight.points[index].picture_distance_m != flight.points[first].picture_distance_m:
            return index
    return len(flight.points) - 1


def _action_group(number: int, reach: tuple[int, int], trigger: list[str], actions: list[str]) -> str:
    return _group("wpml:actionGroup", [
        _element("wpml:actionGroupId", number),
        _element("wpml:actionGroupStartIndex", reach[0]),
        _element("wpml:actionGroupEndIndex", reach[1]),
        _element("wpml:actionGroupMode", "sequence"),
        _group("wpml:actionTrigger", trigger),
        *actions,
    ])  # fmt: skip


def _turn_gimbal(number: int, pitch_deg: float, aircraft: DjiAircraft) -> str:
    return _action(number, "gimbalRotate", [
        _element("wpml:gimbalHeadingYawBase", "north"),
        _element("wpml:gimbalRotateMode", "absoluteAngle"),
        _element("wpml:gimbalPitchRotateEnable", 1),
        _element("wpml:gimbalPitchRotateAngle", plain_decimal(pitch_deg, "pitch")),
        _element("wpml:gimbalRollRotateEnable", 0),
        _element("wpml:gimbalRollRotateAngle", 0),
        _element("wpml:gimbalYawRotateEnable", 0),
        _element("wpml:gimbalYawRotateAngle", 0),
        _element("wpml:gimbalRotateTimeEnable", 0),
        _element("wpml:gimbalRotateTime", 0),
        _element("wpml:payloadPositionIndex", aircraft.payload_position),
    ])  # fmt: skip


def _take_picture(number: int, suffix: str, aircraft: DjiAircraft) -> str:
    return _action(number, "takePhoto", [
        _element("wpml:fileSuffix", suffix),
        _element("wpml:payloadPositionIndex", aircraft.payload_position),
        _element("wpml:payloadLensIndex", aircraft.image_format),
        _element("wpml:useGlobalPayloadLensIndex", 0),
    ])  # fmt: skip


def _action(number: int, function: str, parameters: list[str]) -> str:
    return _group("wpml:action", [
        _element("wpml:actionId", number),
        _element("wpml:actionActuatorFunc", function),
        _group("wpml:actionActuatorFuncParam", parameters),
    ])  # fmt: skip


def _document(config: Iterable[str], folder: list[str]) -> str:
    return _HEAD + "\n".join([_group("wpml:missionConfig", config), "<Folder>", *folder]) + "\n" + _TAIL


def _group(tag: str, content: Iterable[str]) -> str:
    return "\n".join([f"<{tag}>", *content, f"</{tag}>"])


def _element(tag: str, content: str | int) -> str:
    return f"<{tag}>{xml_text(str(content))}</{tag}>"

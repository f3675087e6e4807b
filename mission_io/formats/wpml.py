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

import dataclasses
import io
import math
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree import ElementTree

from mission_io.errors import FormatError
from mission_io.formats.point_route import CameraFlight, PointRoute, RouteStop, StopCamera, route_from_stops
from mission_io.formats.text import child_text, local_name, number_in, rendered, xml_root
from mission_io.model.items import Frame, MissionItem, land, return_to_launch
from mission_io.model.plain_text import counted

# DJI's WPML, the document ``wpmz/waylines.wpml`` of a KMZ, as a mission (developer.dji.com/doc/cloud-api-tutorial, WPML).

DOCUMENT = "wpmz/waylines.wpml"
"""Its name in the archive."""
TEMPLATE = "wpmz/template.kml"
"""What planning programs keep beside it: the settings from which they make it, not the flight."""
_FRAMES = {"relativeToStartPoint": Frame.ABOVE_HOME, "realTimeFollowSurface": Frame.ABOVE_TERRAIN}


def read_route(text: str) -> PointRoute:
    """Read the only wayline.

    Heights are above the start (executeHeightMode relativeToStartPoint) or above the surface (realTimeFollowSurface); those
    above the ellipsoid of WGS 84 are refused, because the geoid is not known here. The aircraft first climbs to
    takeOffSecurityHeight or the first point's height. Curved turns become sharp, with a message.

    Raises:
        FormatError: no WPML, several waylines, another reference of heights, or a value that is none, with its point.
    """
    root, repairs = xml_root(text)
    config = next((each for each in root.iter() if local_name(each) == "missionConfig"), None)
    folders = [each for each in root.iter() if local_name(each) == "Folder"]
    if config is None or len(folders) != 1:
        what = "the file has no missionConfig" if config is None else f"{len(folders)} waylines"
        raise FormatError(what, where="waylines.wpml", advice="export a single wayline")
    folder = folders[0]
    mode = child_text(folder, "executeHeightMode") or ""
    if mode not in _FRAMES:
        raise FormatError(
            f"the height mode is {mode[:40] or 'nothing'!r}", where="executeHeightMode",
            advice="plan with heights above the take-off position (relativeToStartPoint)",
        )  # fmt: skip
    overall = child_text(folder, "autoFlightSpeed")
    marks = folder.findall("{*}Placemark")
    cameras = cameras_of(marks)
    stops = [
        _stop(mark, n, _FRAMES[mode], overall, camera)
        for n, (mark, camera) in enumerate(zip(marks, cameras, strict=True), start=1)
    ]
    curved = sum(child_text(mark, "useStraightLine") == "0" for mark in marks)
    messages = [
        *repairs,
        *([f"{counted(curved, 'curved leg was', 'curved legs were')} read as straight"] if curved else []),
    ]
    security, back = child_text(config, "takeOffSecurityHeight"), child_text(config, "globalRTHHeight")
    return route_from_stops(
        stops, end=_end(child_text(config, "finishAction"), stops), repairs=messages,
        return_height_m=None if not back else number_in(back, "globalRTHHeight"),
        takeoff_height_m=None if not security else number_in(security, "takeOffSecurityHeight"),
    )  # fmt: skip


def _stop(mark: ElementTree.Element, number: int, frame: Frame, overall: str | None, camera: StopCamera) -> RouteStop:
    where = f"point {number}"
    point = mark.find("{*}Point")
    numbers = [] if point is None else (child_text(point, "coordinates") or "").split(",")
    if len(numbers) < 2:
        raise FormatError("the point has no longitude and latitude", where=where)
    lon, lat = (number_in(part, where) for part in numbers[:2])
    speed = child_text(mark, "waypointSpeed") or overall
    return RouteStop(
        lat, lon, number_in(child_text(mark, "executeHeight"), f"{where}, executeHeight"), frame,
        None if not speed else number_in(speed, f"{where}, waypointSpeed"), camera,
    )  # fmt: skip


def _end(action: str | None, stops: list[RouteStop]) -> list[MissionItem]:
    if action == "goHome":
        return [return_to_launch()]
    if action == "autoLand" and stops:
        return [land(stops[-1].lat_deg, stops[-1].lon_deg, frame=Frame.ABOVE_HOME)]
    return []


# Action groups of DJI's WPML: camera actions at the points of a wayline and between them.
#
# Elements and values are those of DJI's table "action group" (github.com/dji-sdk/Cloud-API-Doc, WPML common elements).


@dataclass(slots=True)
class _Group:
    first: int
    last: int
    trigger: str
    every: float | None
    deeds: list[tuple[str, dict[str, str]]]


def cameras_of(marks: Sequence[ElementTree.Element]) -> list[StopCamera]:
    """Actions at each placemark of a wayline.

    A group of ``multipleDistance`` or ``multipleTiming`` with a ``takePhoto`` takes photos from its first point to its last. A
    heading is held where the point says ``smoothTransition``.

    Raises:
        FormatError: a number that is none, with its point.
    """
    index_of = {}
    for k, mark in enumerate(marks):
        stated = child_text(mark, "index")
        index_of[int(number_in(stated, f"point {k + 1}, index")) if stated else k] = k
    cameras = [StopCamera(heading_deg=_heading_deg(mark, k + 1)) for k, mark in enumerate(marks)]
    for number, mark in enumerate(marks, start=1):
        for element in mark.findall("{*}actionGroup"):
            group = _group(element, f"point {number}, actionGroup")
            first, last = index_of.get(group.first, number - 1), index_of.get(group.last, len(marks) - 1)
            _apply(group, first, last, cameras, f"point {number}")
    return cameras


def _group(element: ElementTree.Element, where: str) -> _Group:
    trigger = element.find("{*}actionTrigger")
    trigger = element if trigger is None else trigger
    every = child_text(trigger, "actionTriggerParam")
    first, last = (
        int(number_in(child_text(element, name) or "-1", f"{where}, {name}"))
        for name in ("actionGroupStartIndex", "actionGroupEndIndex")
    )
    deeds = []
    for action in element.findall("{*}action"):
        of = action.find("{*}actionActuatorFuncParam")
        parameters = {} if of is None else {local_name(each): (each.text or "").strip() for each in of}
        deeds.append((child_text(action, "actionActuatorFunc") or "", parameters))
    return _Group(
        first, last, child_text(trigger, "actionTriggerType") or "", number_in(every, where) if every else None, deeds
    )


def _apply(group: _Group, first: int, last: int, cameras: list[StopCamera], where: str) -> None:
    photos = sum(name in ("takePhoto", "orientedShoot") for name, _ in group.deeds)
    if group.trigger in ("multipleDistance", "multipleTiming"):
        if photos and group.every is not None and group.every > 0.0:
            for k in range(first, last):
                if group.trigger == "multipleDistance":
                    cameras[k] = dataclasses.replace(cameras[k], distance_m=group.every)
                else:
                    cameras[k] = dataclasses.replace(cameras[k], interval_s=group.every)
        return
    camera = cameras[first]
    camera = dataclasses.replace(camera, photos=camera.photos + photos)
    for name, parameters in group.deeds:
        if name in ("gimbalRotate", "gimbalEvenlyRotate", "orientedShoot"):
            turns = parameters.get("gimbalPitchRotateEnable", "1") != "0"
            if turns and parameters.get("gimbalPitchRotateAngle"):
                pitch_deg = number_in(parameters["gimbalPitchRotateAngle"], f"{where}, gimbalPitchRotateAngle")
                camera = dataclasses.replace(camera, pitch_deg=pitch_deg)
        if name in ("rotateYaw", "orientedShoot") and parameters.get("aircraftHeading"):
            heading_deg = number_in(parameters["aircraftHeading"], f"{where}, aircraftHeading")
            camera = dataclasses.replace(camera, heading_deg=heading_deg)
        if name == "hover" and parameters.get("hoverTime"):
            hover_s = max(0.0, number_in(parameters["hoverTime"], f"{where}, hoverTime"))
            camera = dataclasses.replace(camera, hover_s=camera.hover_s + hover_s)
    cameras[first] = camera


def _heading_deg(mark: ElementTree.Element, number: int) -> float | None:
    held = mark.find("{*}waypointHeadingParam")
    if held is None or child_text(held, "waypointHeadingMode") != "smoothTransition":
        return None
    angle = child_text(held, "waypointHeadingAngle")
    return number_in(angle, f"point {number}, waypointHeadingAngle") if angle else None


MOST_POINTS = 65536
"""Numbers of points go from 0 to 65535; what apps and aircraft take is less."""
IMAGE_FORMATS = ("wide", "zoom", "ir", "narrow_band", "visible")
"""Lenses that photos are kept of."""
_SECURITY_HEIGHTS_M = (1.2, 1500.0)
_STAMP = (1980, 1, 1, 0, 0, 0)
"""The time of the archive's files: equal missions are equal files."""


@dataclass(frozen=True, slots=True)
class DjiAircraft:
    """An aircraft with its camera, as WPML names it."""

    title: str  # shown to the user
    drone: tuple[int, int]  # its type and subtype
    payload: int  # the type of its camera
    payload_position: int  # where the camera is mounted; 0 is the main gimbal
    image_format: str  # which lenses' photos are kept: one of IMAGE_FORMATS, or several with commas
    pitch_range_deg: tuple[float, float]  # angles that its gimbal reaches
    max_speed_m_s: float  # largest speed over ground


@dataclass(frozen=True, slots=True)
class AbsoluteHeights:
    """Heights of the points of a flight, one each."""

    amsl_m: Sequence[float]  # above the sea level of EGM96
    ellipsoid_m: Sequence[float]  # above the ellipsoid of WGS 84


def write_kmz(
    flight: CameraFlight,  # what to fly
    aircraft: DjiAircraft,  # what flies it
    *,
    return_height_m: float,  # height above home that the aircraft climbs to before it returns by itself
    # heights of the points that do not depend on where it takes off; None: they are flown above the take-off
    absolute: AbsoluteHeights | None = None,
) -> bytes:
    """Write a flight as a KMZ archive. Raises FormatError: the aircraft or the format cannot do it, with the point."""
    _check(flight, aircraft, return_height_m)
    facts = {
        "aircraft": aircraft,
        "return_height_m": return_height_m,
        # The way to the first point is the climb alone, so the speed of that way, which has a limit of its own, is no matter.
        "transitional_m_s": min(flight.points[0].speed_m_s, 15.0),
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
        raise FormatError(f"{len(flight.points)} points exceed the WPML limit of {MOST_POINTS}", where="flight")
    low_m, high_m = _SECURITY_HEIGHTS_M
    climb_m = flight.points[0].height_above_home_m
    if not low_m <= climb_m <= high_m:
        what = f"the climb ends {climb_m:g} m above home, but WPML accepts {low_m:g} to {high_m:g} m"
        raise FormatError(what, where="point 1", advice="change vehicle.takeoff_height_m, or move home")
    if not 0.0 < return_height_m <= high_m:
        what = f"{return_height_m:g} m above home exceeds the WPML limit of {high_m:g} m"
        raise FormatError(what, where="return height", advice="move home")
    low_deg, high_deg = aircraft.pitch_range_deg
    for number, point in enumerate(flight.points, start=1):
        where = f"point {number}"
        if not 0.0 < point.speed_m_s <= aircraft.max_speed_m_s:
            what = (
                f"the speed is {point.speed_m_s:g} m/s, but the {aircraft.title} flies at most "
                f"{aircraft.max_speed_m_s:g} m/s"
            )
            raise FormatError(what, where=where, advice="plan with a lower vehicle.cruise_speed_m_s")
        if point.pitch_deg is not None and not low_deg <= point.pitch_deg <= high_deg:
            what = f"camera pitch {point.pitch_deg:g} degrees; the {aircraft.title} allows {low_deg:g} to {high_deg:g}"
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
        begins = point.photo_distance_m is not None and point.photo_distance_m != distance_m
        photos = point.photos + begins  # where photos by distance begin, one is taken at once
        actions = [_Action(pitch_deg)] * turns + [_Action(suffix=f"point{index + 1}")] * photos
        if actions:
            found[index].append(_ActionGroup(number, index, index, actions))
            number += 1
        if begins:
            actions = [_Action(suffix="distance")]
            last = _last_of_stretch(flight, index)
            found[index].append(_ActionGroup(number, index, last, actions, point.photo_distance_m))
            number += 1
        distance_m = point.photo_distance_m
    return found


def _last_of_stretch(flight: CameraFlight, first: int) -> int:
    """The point at which photos at the distance of point ``first`` end."""
    for index in range(first + 1, len(flight.points)):
        if flight.points[index].photo_distance_m != flight.points[first].photo_distance_m:
            return index
    return len(flight.points) - 1

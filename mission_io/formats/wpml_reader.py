"""DJI's WPML, the document ``wpmz/waylines.wpml`` of a KMZ, as a mission (developer.dji.com/doc/cloud-api-tutorial, WPML)."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree import ElementTree

from mission_io.errors import FormatError
from mission_io.formats.point_route import (
    PointRoute,
    RouteStop,
    child_text,
    local_name,
    number_in,
    route_from_stops,
    xml_root,
)
from mission_io.formats.route_cameras import StopCamera
from mission_io.model.items import Frame, MissionItem, land, return_to_launch

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
        raise FormatError(what, where="waylines.wpml", advice="export one wayline")
    folder = folders[0]
    mode = child_text(folder, "executeHeightMode") or ""
    if mode not in _FRAMES:
        raise FormatError(
            f"the height mode is {mode[:40] or 'nothing'!r}", where="executeHeightMode",
            advice="plan with heights above the take-off position (relativeToStartPoint)",
        )  # fmt: skip
    overall = child_text(folder, "autoFlightSpeed")
    marks = [each for each in folder if local_name(each) == "Placemark"]
    cameras = cameras_of(marks)
    stops = [
        _stop(mark, n, _FRAMES[mode], overall, camera)
        for n, (mark, camera) in enumerate(zip(marks, cameras, strict=True), start=1)
    ]
    curved = sum(child_text(mark, "useStraightLine") == "0" for mark in marks)
    messages = [*repairs, *([f"{curved} legs are curved; they are read as straight"] if curved else [])]
    security, back = child_text(config, "takeOffSecurityHeight"), child_text(config, "globalRTHHeight")
    return route_from_stops(
        stops, end=_end(child_text(config, "finishAction"), stops), repairs=messages,
        return_height_m=None if not back else number_in(back, "globalRTHHeight"),
        takeoff_height_m=None if not security else number_in(security, "takeOffSecurityHeight"),
    )  # fmt: skip


def _stop(mark: ElementTree.Element, number: int, frame: Frame, overall: str | None, camera: StopCamera) -> RouteStop:
    where = f"point {number}"
    point = next((each for each in mark if local_name(each) == "Point"), None)
    numbers = [] if point is None else (child_text(point, "coordinates") or "").split(",")
    if len(numbers) < 2:
        raise FormatError("the point has no longitude,latitude", where=where)
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


# Action groups of DJI's WPML: what the camera does at the points of a wayline, and between them.
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

    A group of ``multipleDistance`` or ``multipleTiming`` with a ``takePhoto`` takes pictures from its first point to its last. A
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
        for element in mark:
            if local_name(element) == "actionGroup":
                group = _group(element, f"point {number}, actionGroup")
                first, last = index_of.get(group.first, number - 1), index_of.get(group.last, len(marks) - 1)
                _apply(group, first, last, cameras, f"point {number}")
    return cameras


def _group(element: ElementTree.Element, where: str) -> _Group:
    trigger = next((each for each in element if local_name(each) == "actionTrigger"), element)
    every = child_text(trigger, "actionTriggerParam")
    first, last = (
        int(number_in(child_text(element, name) or "-1", f"{where}, {name}"))
        for name in ("actionGroupStartIndex", "actionGroupEndIndex")
    )
    deeds = []
    for action in element:
        if local_name(action) == "action":
            of = next((each for each in action if local_name(each) == "actionActuatorFuncParam"), None)
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
    camera = dataclasses.replace(camera, pictures=camera.pictures + photos)
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
    held = next((each for each in mark if local_name(each) == "waypointHeadingParam"), None)
    if held is None or child_text(held, "waypointHeadingMode") != "smoothTransition":
        return None
    angle = child_text(held, "waypointHeadingAngle")
    return number_in(angle, f"point {number}, waypointHeadingAngle") if angle else None

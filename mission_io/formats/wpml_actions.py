"""Action groups of DJI's WPML: what the camera does at the points of a wayline, and between them.

Elements and values are those of DJI's table "action group" (github.com/dji-sdk/Cloud-API-Doc, WPML common elements).
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree import ElementTree

from mission_io.formats.point_route import child_text, local_name, number_in
from mission_io.formats.route_cameras import StopCamera


@dataclass(slots=True)
class _Group:
    first: int
    last: int
    trigger: str
    every: float | None
    deeds: list[tuple[str, dict[str, str]]]


def cameras_of(marks: Sequence[ElementTree.Element]) -> list[StopCamera]:
    """What is done at each placemark of a wayline.

    A group of ``multipleDistance`` or ``multipleTiming`` with a ``takePhoto`` takes pictures from its first point to its last. A
    heading is held where the point says ``smoothTransition``.

    Raises:
        FormatError: a number that is none, with its point.
    """
    index_of = {}
    for k, mark in enumerate(marks):
        told = child_text(mark, "index")
        index_of[int(number_in(told, f"point {k + 1}, index")) if told else k] = k
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

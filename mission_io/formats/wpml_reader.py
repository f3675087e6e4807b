"""DJI's WPML, the document ``wpmz/waylines.wpml`` of a KMZ, as a mission (developer.dji.com/doc/cloud-api-tutorial, WPML)."""

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
from mission_io.formats.wpml_actions import cameras_of
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
    takeOffSecurityHeight or the first point's height. Curved turns are told and become sharp.

    Raises:
        FormatError: no WPML, several waylines, another reference of heights, or a value that is none, with its point.
    """
    root, repairs = xml_root(text)
    config = next((each for each in root.iter() if local_name(each) == "missionConfig"), None)
    folders = [each for each in root.iter() if local_name(each) == "Folder"]
    if config is None or len(folders) != 1:
        what = "no missionConfig" if config is None else f"{len(folders)} waylines"
        raise FormatError(what, where="waylines.wpml", advice="export one wayline")
    folder = folders[0]
    mode = child_text(folder, "executeHeightMode") or ""
    if mode not in _FRAMES:
        raise FormatError(
            f"heights are of the mode {mode[:40] or 'nothing'!r}", where="executeHeightMode",
            advice="plan with heights above the take-off place (relativeToStartPoint)",
        )  # fmt: skip
    overall = child_text(folder, "autoFlightSpeed")
    marks = [each for each in folder if local_name(each) == "Placemark"]
    cameras = cameras_of(marks)
    stops = [
        _stop(mark, n, _FRAMES[mode], overall, camera)
        for n, (mark, camera) in enumerate(zip(marks, cameras, strict=True), start=1)
    ]
    curved = sum(child_text(mark, "useStraightLine") == "0" for mark in marks)
    told = [*repairs, *([f"{curved} legs are curved; they are taken as straight"] if curved else [])]
    security, back = child_text(config, "takeOffSecurityHeight"), child_text(config, "globalRTHHeight")
    return route_from_stops(
        stops, end=_end(child_text(config, "finishAction"), stops), repairs=told,
        return_height_m=None if not back else number_in(back, "globalRTHHeight"),
        takeoff_height_m=None if not security else number_in(security, "takeOffSecurityHeight"),
    )  # fmt: skip


def _stop(mark: ElementTree.Element, number: int, frame: Frame, overall: str | None, camera: StopCamera) -> RouteStop:
    where = f"point {number}"
    point = next((each for each in mark if local_name(each) == "Point"), None)
    numbers = [] if point is None else (child_text(point, "coordinates") or "").split(",")
    if len(numbers) < 2:
        raise FormatError("has no longitude,latitude", where=where)
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

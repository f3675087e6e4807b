"""What DJI publishes of WPML, as data, and a check of a KMZ file against it that shares nothing with the writer.

The tables are those of github.com/dji-sdk/Cloud-API-Doc, v1.11.3, docs/en/60.api-reference/00.dji-wpml (template-kml,
waylines-wpml and common-element), in our words: for each element its kind, its values, and when it is required.
"""

import io
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

KML, WPML = "{http://www.opengis.net/kml/2.2}", "{http://www.dji.com/wpmz/1.0.2}"
Check = Callable[[str], bool]
Fields = Mapping[str, "Field"]


@dataclass(frozen=True)
class Field:
    """An element: a check of its text, or the fields it holds; whether it may be left out, and be there more than once."""

    check: Check | None = None
    holds: Fields = field(default_factory=dict)
    required: bool = True
    many: bool = False


def whole(low: int, high: int) -> Field:
    return Field(lambda text: text.lstrip("-").isdigit() and low <= int(text) <= high)


def number(low: float, high: float, *, above: bool = False) -> Field:
    return Field(lambda text: "e" not in text.lower() and (low < float(text) if above else low <= float(text)) <= high)


def one_of(*values: str) -> Field:
    return Field(lambda text: text in values)


def optional(one: Field) -> Field:
    return Field(one.check, one.holds, required=False, many=one.many)


def several(**fields: Field) -> Fields:
    return fields


ANY_NUMBER = number(-1e6, 1e6)
BOOL = one_of("0", "1")
ID = whole(0, 65535)
SPEED = number(0.0, 25.0, above=True)
LENSES = Field(lambda text: set(text.split(",")) <= {"wide", "zoom", "ir", "narrow_band", "visible"})
TURNS = one_of(
    "coordinateTurn", "toPointAndStopWithDiscontinuityCurvature", "toPointAndStopWithContinuityCurvature",
    "toPointAndPassWithContinuityCurvature",
)  # fmt: skip
DRONES = {
    "89": ["0"], "60": ["0"], "67": ["0", "1"], "77": ["0", "1", "2"], "91": ["0", "1"],
    "99": ["0", "1"],  # Matrice 4E and 4T, of the edition at developer.dji.com
}  # fmt: skip
PAYLOADS = ["42", "43", "52", "53", "61", "66", "67", "68", "80", "81", "82", "83", "88", "89", "65534"]

HEADING = several(
    waypointHeadingMode=one_of("followWayline", "manually", "fixed", "smoothTransition", "towardPOI"),
    waypointHeadingAngle=optional(number(-180.0, 180.0)),  # required with smoothTransition
    waypointPoiPoint=optional(Field(lambda text: len(text.split(",")) == 3)),  # required with towardPOI
    waypointHeadingPathMode=one_of("clockwise", "counterClockwise", "followBadArc"),
)
TURN = several(waypointTurnMode=TURNS, waypointTurnDampingDist=optional(number(0.0, 1e4)))
POSITION = whole(0, 2)
ACTION_PARAMETERS = {
    "takePhoto": several(
        payloadPositionIndex=POSITION, fileSuffix=Field(str.isprintable), payloadLensIndex=LENSES,
        useGlobalPayloadLensIndex=BOOL,
    ),
    "gimbalRotate": several(
        payloadPositionIndex=POSITION, gimbalHeadingYawBase=one_of("north"), gimbalRotateMode=one_of("absoluteAngle"),
        gimbalPitchRotateEnable=BOOL, gimbalPitchRotateAngle=number(-120.0, 60.0),
        gimbalRollRotateEnable=BOOL, gimbalRollRotateAngle=ANY_NUMBER, gimbalYawRotateEnable=BOOL,
        gimbalYawRotateAngle=ANY_NUMBER, gimbalRotateTimeEnable=BOOL, gimbalRotateTime=number(0.0, 1e4),
    ),
}  # fmt: skip
ACTION_GROUP = Field(
    holds=several(
        actionGroupId=ID, actionGroupStartIndex=ID, actionGroupEndIndex=ID, actionGroupMode=one_of("sequence"),
        actionTrigger=Field(
            holds=several(
                actionTriggerType=one_of("reachPoint", "betweenAdjacentPoints", "multipleTiming", "multipleDistance"),
                actionTriggerParam=optional(number(0.0, 1e6, above=True)),
            )
        ),
        action=Field(
            holds=several(
                actionId=ID, actionActuatorFunc=one_of(*ACTION_PARAMETERS),
                actionActuatorFuncParam=Field(holds={"*": Field()}),  # by the function, see ACTION_PARAMETERS
            ),
            many=True,
        ),
    ),
    required=False,
    many=True,
)  # fmt: skip
POINT = Field(holds=several(coordinates=Field(lambda text: _is_position(text))))
CONFIG = several(
    flyToWaylineMode=one_of("safely", "pointToPoint"),
    finishAction=one_of("goHome", "noAction", "autoLand", "gotoFirstWaypoint"),
    exitOnRCLost=one_of("goContinue", "executeLostAction"),
    executeRCLostAction=optional(one_of("goBack", "landing", "hover")),  # required with executeLostAction
    takeOffSecurityHeight=number(1.2, 1500.0),
    globalTransitionalSpeed=number(0.0, 15.0),
    droneInfo=Field(holds=several(droneEnumValue=one_of(*DRONES), droneSubEnumValue=whole(0, 2))),
    payloadInfo=Field(holds=several(payloadEnumValue=one_of(*PAYLOADS), payloadPositionIndex=POSITION)),
)
WAYLINES_PLACEMARK = several(
    Point=POINT, index=ID, executeHeight=ANY_NUMBER, waypointSpeed=SPEED, waypointHeadingParam=Field(holds=HEADING),
    waypointTurnParam=Field(holds=TURN), useStraightLine=optional(BOOL), actionGroup=ACTION_GROUP,
)  # fmt: skip
TEMPLATE_PLACEMARK = several(
    Point=POINT, index=ID, useGlobalHeight=BOOL, ellipsoidHeight=optional(ANY_NUMBER), height=optional(ANY_NUMBER),
    useGlobalSpeed=BOOL, waypointSpeed=optional(SPEED), useGlobalHeadingParam=BOOL,
    waypointHeadingParam=optional(Field(holds=HEADING)), useGlobalTurnParam=BOOL,
    waypointTurnParam=optional(Field(holds=TURN)), useStraightLine=optional(BOOL),
    gimbalPitchAngle=optional(ANY_NUMBER), actionGroup=ACTION_GROUP,
)  # fmt: skip
WAYLINES = several(
    missionConfig=Field(holds={**CONFIG, "globalRTHHeight": number(0.0, 1500.0, above=True)}),
    Folder=Field(
        holds=several(
            templateId=ID, waylineId=ID, autoFlightSpeed=SPEED,
            executeHeightMode=one_of("WGS84", "relativeToStartPoint", "realTimeFollowSurface"),
            Placemark=Field(holds=WAYLINES_PLACEMARK, many=True),
        )
    ),
)  # fmt: skip
TEMPLATE = several(
    author=Field(str.isprintable, required=False), createTime=optional(whole(0, 10**14)),
    updateTime=optional(whole(0, 10**14)), missionConfig=Field(holds=CONFIG),
    Folder=Field(
        holds=several(
            templateType=one_of("waypoint"), templateId=ID, autoFlightSpeed=SPEED,
            waylineCoordinateSysParam=Field(
                holds=several(
                    coordinateMode=one_of("WGS84"),
                    heightMode=one_of("EGM96", "relativeToStartPoint", "aboveGroundLevel", "realTimeFollowSurface"),
                    positioningType=optional(one_of("GPS", "RTKBaseStation", "QianXun", "Custom")),
                )
            ),
            payloadParam=optional(Field(holds=several(payloadPositionIndex=POSITION, imageFormat=LENSES))),
            globalWaypointTurnMode=TURNS, globalUseStraightLine=optional(BOOL),
            gimbalPitchMode=one_of("manual", "usePointSetting"), globalHeight=ANY_NUMBER,
            globalWaypointHeadingParam=optional(Field(holds=HEADING)),
            Placemark=Field(holds=TEMPLATE_PLACEMARK, many=True),
        )
    ),
)  # fmt: skip
OF_KML = {"Point", "coordinates", "Folder", "Placemark"}
"""Elements of KML itself; all others are DJI's."""


def _is_position(text: str) -> bool:
    lon, lat = map(float, text.split(","))
    return -180.0 <= lon <= 180.0 and -90.0 <= lat <= 90.0


def name_of(element: ET.Element) -> str:
    """The name without its namespace, which must be the right one."""
    space, _, name = element.tag.rpartition("}")
    assert space + "}" == (KML if name in OF_KML else WPML), element.tag
    return name


def check_fields(parent: ET.Element, fields: Fields, path: str) -> None:
    """Every element below is known, has an allowed value, and is there as often as it has to be."""
    names = [name_of(child) for child in parent]
    for name, one in fields.items():
        assert not one.required or name in names, f"{path}: {name} is required"
        assert one.many or names.count(name) <= 1, f"{path}: {name} is there twice"
    for child, name in zip(parent, names, strict=True):
        here = f"{path}/{name}"
        assert name in fields, f"{here}: is in no table"
        if name == "actionActuatorFuncParam":
            function = parent.findtext(f"{WPML}actionActuatorFunc", "")
            check_fields(child, ACTION_PARAMETERS[function], here)
        elif fields[name].holds:
            check_fields(child, fields[name].holds, here)
        else:
            check = fields[name].check
            assert len(child) == 0, here
            assert check is not None, here
            assert check(child.text or ""), f"{here}: {child.text!r}"


def check_conditions(root: ET.Element) -> None:
    """The rules of the tables that hold between elements."""
    for heading in [*root.iter(f"{WPML}waypointHeadingParam"), *root.iter(f"{WPML}globalWaypointHeadingParam")]:
        mode = heading.findtext(f"{WPML}waypointHeadingMode")
        assert mode != "smoothTransition" or heading.find(f"{WPML}waypointHeadingAngle") is not None
        assert mode != "towardPOI" or heading.find(f"{WPML}waypointPoiPoint") is not None
    for config in root.iter(f"{WPML}missionConfig"):
        lost = config.findtext(f"{WPML}exitOnRCLost")
        assert lost != "executeLostAction" or config.find(f"{WPML}executeRCLostAction") is not None
        info = config.find(f"{WPML}droneInfo")
        assert info is not None
        kind, subkind = (info.findtext(f"{WPML}{name}", "") for name in ("droneEnumValue", "droneSubEnumValue"))
        assert subkind in DRONES[kind]
    for placemark in root.iter(f"{KML}Placemark"):
        turn = placemark.find(f"{WPML}waypointTurnParam")
        mode = "" if turn is None else turn.findtext(f"{WPML}waypointTurnMode", "")
        if turn is not None and ("Pass" in mode or mode == "coordinateTurn"):
            assert float(turn.findtext(f"{WPML}waypointTurnDampingDist", "0")) > 0.0
        assert "WithContinuity" not in mode or placemark.find(f"{WPML}useStraightLine") is not None
        for flag, names in (
            ("useGlobalHeight", ("ellipsoidHeight", "height")), ("useGlobalSpeed", ("waypointSpeed",)),
            ("useGlobalHeadingParam", ("waypointHeadingParam",)), ("useGlobalTurnParam", ("waypointTurnParam",)),
        ):  # fmt: skip
            if placemark.findtext(f"{WPML}{flag}") == "0":
                assert all(placemark.find(f"{WPML}{name}") is not None for name in names)
    for (folder,) in [list(root.iter(f"{KML}Folder"))]:
        indices = [int(element.text or "") for element in folder.findall(f"{KML}Placemark/{WPML}index")]
        assert indices == list(range(len(indices)))
        groups = [int(element.text or "") for element in folder.iter(f"{WPML}actionGroupId")]
        assert groups == list(range(len(groups)))
        for group in folder.iter(f"{WPML}actionGroup"):
            first, last = (int(group.findtext(f"{WPML}actionGroup{end}Index", "")) for end in ("Start", "End"))
            assert first <= last < len(indices)
            actions = [int(element.text or "") for element in group.iter(f"{WPML}actionId")]
            assert actions == list(range(len(actions)))
            trigger = group.findtext(f"{WPML}actionTrigger/{WPML}actionTriggerType", "")
            assert trigger.startswith("multiple") == (
                group.find(f"{WPML}actionTrigger/{WPML}actionTriggerParam") is not None
            )


@dataclass(frozen=True)
class ReadPoint:
    """A point as the file has it; actions are (trigger, last point, function, value)."""

    lat_deg: float
    lon_deg: float
    height_m: float
    speed_m_s: float
    heading_deg: float | None
    actions: tuple[tuple[str, int, str, float], ...]


def read_points(root: ET.Element, height: str) -> list[ReadPoint]:
    points = []
    for placemark in root.iter(f"{KML}Placemark"):
        lon, lat = map(float, placemark.findtext(f"{KML}Point/{KML}coordinates", "").split(","))
        heading = placemark.find(f"{WPML}waypointHeadingParam")
        assert heading is not None
        held = heading.findtext(f"{WPML}waypointHeadingMode") == "smoothTransition"
        actions = []
        for group in placemark.iter(f"{WPML}actionGroup"):
            trigger = group.findtext(f"{WPML}actionTrigger/{WPML}actionTriggerType", "")
            every = float(group.findtext(f"{WPML}actionTrigger/{WPML}actionTriggerParam", "0"))
            last = int(group.findtext(f"{WPML}actionGroupEndIndex", ""))
            for action in group.iter(f"{WPML}action"):
                function = action.findtext(f"{WPML}actionActuatorFunc", "")
                pitch = action.findtext(f"{WPML}actionActuatorFuncParam/{WPML}gimbalPitchRotateAngle", "0")
                actions.append((trigger, last, function, float(pitch) if function == "gimbalRotate" else every))
        points.append(
            ReadPoint(
                lat, lon, float(placemark.findtext(f"{WPML}{height}", "")),
                float(placemark.findtext(f"{WPML}waypointSpeed", "")),
                float(heading.findtext(f"{WPML}waypointHeadingAngle", "")) if held else None, tuple(actions),
            )
        )  # fmt: skip
    return points


@dataclass(frozen=True)
class ReadKmz:
    """A KMZ file that keeps the tables: settings, the points that are flown, their heights' mode, and those of the template."""

    config: Mapping[str, str]
    points: list[ReadPoint]
    mode: str
    template_heights_m: list[float]


def check_kmz(content: bytes) -> ReadKmz:
    """Hold a KMZ file against the tables; its two documents must say the same.

    Raises:
        AssertionError: it breaks a rule; names the element.
    """
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        assert archive.testzip() is None
        assert archive.namelist() == ["wpmz/template.kml", "wpmz/waylines.wpml"]
        template, waylines = (ET.fromstring(archive.read(name)) for name in archive.namelist())
    found = []
    modes = waylines.findtext(f".//{WPML}executeHeightMode"), template.findtext(f".//{WPML}heightMode")
    assert modes in {("relativeToStartPoint", "relativeToStartPoint"), ("WGS84", "EGM96")}
    relative = modes[0] == "relativeToStartPoint"
    for root, tables, height in (
        (template, TEMPLATE, "height" if relative else "ellipsoidHeight"), (waylines, WAYLINES, "executeHeight"),
    ):  # fmt: skip
        assert root.tag == f"{KML}kml"
        (document,) = root
        assert document.tag == f"{KML}Document"
        check_fields(document, tables, "Document")
        check_conditions(root)
        found.append(read_points(root, height))
    assert found[0] == found[1]
    config = next(waylines.iter(f"{WPML}missionConfig"))
    amsl_m = [float(each.text or "") for each in template.iter(f"{WPML}height")]
    if relative:
        assert amsl_m == [point.height_m for point in found[1]]
    settings = {element.tag.removeprefix(WPML): element.text or "" for element in config.iter()}
    return ReadKmz(settings, found[1], modes[0] or "", amsl_m)

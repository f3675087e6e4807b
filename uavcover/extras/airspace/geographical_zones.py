"""Geographical zones for unmanned aircraft as authorities publish them: JSON of EUROCAE ED-269 and ED-318.

ED-269: ``features``, each with a list ``geometry`` of volumes. ED-318 is GeoJSON: heights in ``layer`` of a geometry, the radius
of a circle in ``extent`` of a Point. Zones of type NO_RESTRICTION are omitted; all others count, also those that may be flown
with an authorisation or under conditions.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from mission_io.errors import FormatError
from mission_io.formats.text import Node, parse_json
from mission_io.model.plain_text import counted
from uavcover.model.area import Ring, Rings
from uavcover.model.limits import DAYS
from uavcover.scenario.airspace.zone_file import METRES, ReadZone, ReadZones, ZoneReader, height_key, shown

# Times of zones in ED-269 (``applicability``) and ED-318 (``limitedApplicability``), as the periods of a scenario.
#
# Both have a list of periods, each with a first and a last moment and a ``schedule`` of days and hours. What a schedule
# counts by the sun or by holidays, and hours without a time zone, cannot be counted here: such a period holds all day.

_HOUR = re.compile(r"(\d{1,2}:\d{2}(?::\d{2}(?:\.\d+)?)?)(Z|[+-]\d{2}:\d{2})")
_YES = ("YES", "TRUE")
_EVERY_DAY = "ANY"


@dataclass(frozen=True, slots=True)
class Applicability:
    """Times in which a zone is in force, by the keys of a scenario."""

    from_utc: str | None = None  # its begin, None where it is open
    until_utc: str | None = None  # its end, None where it is open
    active: tuple[str, ...] = ()  # its periods; empty: all the time between these two
    whole_days: bool = False  # whether a schedule could not be read, and counts all day


def read_applicability(about: Node, key: str) -> Applicability:
    """The times of a zone; without any it is always in force."""
    value = about.value.get(key) if isinstance(about.value, dict) else None
    tables = [one for one in (value if isinstance(value, list) else [value]) if isinstance(one, dict)]
    if not tables:
        return Applicability()
    periods: list[str] = []
    whole_days = False
    for table in tables:
        interval, words = _interval(table), _schedule(table)
        if words is None:
            whole_days, words = True, [""]
        periods += [" ".join(part for part in (interval, word) if part) for word in words]
    if "" in periods:
        return Applicability(whole_days=whole_days)
    if len(periods) == 1 and "/" in periods[0] and " " not in periods[0]:
        begin, end = (None if part == ".." else part for part in periods[0].split("/", 1))
        return Applicability(begin, end, whole_days=whole_days)
    return Applicability(active=tuple(dict.fromkeys(periods)), whole_days=whole_days)


def _interval(table: dict[str, Any]) -> str:
    """First and last moment of a period; empty where it is permanent."""
    if str(table.get("permanent", "NO")).upper() in _YES:
        return ""
    ends = [str(table.get(key) or "..").strip() for key in ("startDateTime", "endDateTime")]
    return "" if ends == ["..", ".."] else "/".join(ends)


def _schedule(table: dict[str, Any]) -> list[str] | None:
    """Days and hours of a period, one text each; None where they cannot be read."""
    value = table.get("schedule")
    entries = value if isinstance(value, list) else [value] if value else []
    found = [_daily(entry) for entry in entries]
    if None in found:
        return None
    return [words for words in found if words is not None] or [""]


def _daily(entry: Any) -> str | None:
    """Days and hours of one entry; None where they cannot be read."""
    if not isinstance(entry, dict) or entry.get("startEvent") or entry.get("endEvent"):
        return None
    days = entry.get("day") or [_EVERY_DAY]
    names = [str(day).strip().upper()[:3] for day in (days if isinstance(days, list) else [days])]
    if not all(name in DAYS or name == _EVERY_DAY for name in names):
        return None
    words = [] if _EVERY_DAY in names else [",".join(dict.fromkeys(names))]
    times = [entry.get(key) for key in ("startTime", "endTime")]
    if times != [None, None]:
        begin, end = (_HOUR.fullmatch(str(time).strip()) for time in times)
        if begin is None or end is None or begin[2] != end[2]:
            return None
        words.append(f"{begin[1]}-{end[1]}{begin[2]}")
    return " ".join(words)


_FREE = "NO_RESTRICTION"


def is_ed269(root: Any) -> bool:
    """Whether a document has features with a list of volumes."""
    return any(isinstance(feature.get("geometry"), list) for feature in _feature_tables(root))


def is_ed318(root: Any) -> bool:
    """Whether a GeoJSON document has a geometry with ``layer`` or ``extent``."""

    def layered(geometry: Any) -> bool:
        if not isinstance(geometry, dict):
            return False
        inner = geometry.get("geometries")
        return (
            "layer" in geometry or "extent" in geometry or (isinstance(inner, list) and any(layered(g) for g in inner))
        )

    return any(layered(feature.get("geometry")) for feature in _feature_tables(root))


def _read(text: str, suffix: str) -> ReadZones | None:
    """The zones of a text; a text file of another suffix than JSON's need not be JSON."""
    if not suffix.endswith("json") and not text.lstrip().startswith(("{", "[")):
        return None
    root = parse_json(text, "document")
    return read_ed269(root) if is_ed269(root.value) else read_ed318(root) if is_ed318(root.value) else None


READER = ZoneReader((".json", ".geojson", ".txt", ".air", ".openair"), _read)


def _feature_tables(root: Any) -> list[dict[str, Any]]:
    if isinstance(root, dict):
        root = root.get("features", [root])
    return [one for one in root if isinstance(one, dict)] if isinstance(root, list) else []


def read_ed269(root: Node) -> ReadZones:
    """The zones of an ED-269 document. Raises FormatError: with the place in the document that cannot be understood."""
    features = root if isinstance(root.value, list) else root.get("features")
    found: list[ReadZone] = []
    free = by_day = 0
    for feature in features.nodes():
        if _text(feature, "restriction") == _FREE:
            free += 1
            continue
        times = read_applicability(feature, "applicability")
        by_day += times.whole_days
        for volume in feature.get("geometry").nodes():
            unit = _text(volume, "uomDimensions") or "M"
            where = f"{volume.where} ({shown(_name(feature))})"
            heights = _ends(
                volume, ("lowerLimit", "lowerVerticalReference", "upperLimit", "upperVerticalReference"), unit, where
            )
            shape = volume.get("horizontalProjection")
            found.append(_zone(feature, heights, times, _shape(shape, shape, unit)))
    return ReadZones(tuple(found), _notes(free, by_day))


def read_ed318(root: Node) -> ReadZones:
    """The zones of an ED-318 document. Raises FormatError: with the place in the document that cannot be understood."""
    features = root.get("features").nodes() if "features" in root.value else [root]
    found: list[ReadZone] = []
    free = by_day = 0
    for feature in features:
        properties = feature.get("properties")
        if _text(properties, "type") == _FREE:
            free += 1
            continue
        times = read_applicability(properties, "limitedApplicability")
        by_day += times.whole_days
        for geometry in _geometries(feature.get("geometry")):
            heights: dict[str, float] = {}
            if isinstance(geometry.value, dict) and "layer" in geometry.value:
                layer = geometry.get("layer")
                where = f"{layer.where} ({shown(_name(properties))})"
                keys = ("lower", "lowerReference", "upper", "upperReference")
                heights = _ends(layer, keys, _text(layer, "uom") or "M", where)
            for part in _parts(geometry):
                circle = part.get("extent") if _text(part, "type") == "Point" else part
                found.append(_zone(properties, heights, times, _shape(part, circle, "M")))
    return ReadZones(tuple(found), _notes(free, by_day))


def _notes(free: int, by_day: int) -> tuple[str, ...]:
    notes = [f"ignored {counted(free, 'zone')} of type {_FREE}"] if free else []
    if by_day:
        notes.append(
            f"{counted(by_day, 'zone')} treated as active all day, because the schedules depend on the sun or holidays, "
            "or lack a time zone"
        )
    return tuple(notes)


def _zone(
    about: Node,
    heights: dict[str, float],
    times: Applicability,
    shape: Rings | tuple[float, float, float],
) -> ReadZone:
    names = frozenset(text for key in ("identifier", "name") if (text := _text(about, key)))
    circle = shape if len(shape) == 3 and isinstance(shape[0], float) else None
    rings = () if circle is not None else (shape,)
    return ReadZone(
        _name(about), names, heights, polygons=rings, rings_may_be_open=True, circle=circle,  # type: ignore[arg-type]
        from_utc=times.from_utc, until_utc=times.until_utc, active=times.active,
    )  # fmt: skip


def _name(about: Node) -> str:
    return _text(about, "name") or _text(about, "identifier") or "(no name)"


def _text(node: Node, key: str) -> str:
    """A text, or of a list of texts by language the first; empty without one."""
    value = node.value.get(key) if isinstance(node.value, dict) else None
    if isinstance(value, list) and value:
        value = value[0].get("text") if isinstance(value[0], dict) else value[0]
    return str(value).strip() if isinstance(value, str | int) else ""


def _ends(node: Node, keys: tuple[str, str, str, str], unit: str, where: str) -> dict[str, float]:
    """Floor and ceiling; what is missing or null is open."""
    heights: dict[str, float] = {}
    for end, value_key, reference_key in (("floor", keys[0], keys[1]), ("ceiling", keys[2], keys[3])):
        if node.optional(value_key, lambda one: one, Node(None, "")).value is not None:
            value = node.get(value_key).number()
            heights |= height_key(end, value, unit, _text(node, reference_key) or "AGL", where=where)
    return heights


def _geometries(geometry: Node) -> Iterator[Node]:
    if _text(geometry, "type") == "GeometryCollection":
        for one in geometry.get("geometries").nodes():
            yield from _geometries(one)
    else:
        yield geometry


def _parts(geometry: Node) -> Iterator[Node]:
    """A geometry, or each polygon of a MultiPolygon."""
    if _text(geometry, "type") != "MultiPolygon":
        yield geometry
        return
    for part in geometry.get("coordinates").nodes():
        yield Node({"type": "Polygon", "coordinates": part.value}, geometry.where)


def _shape(node: Node, circle: Node, unit: str) -> Rings | tuple[float, float, float]:
    """The rings of a polygon, or longitude, latitude and radius of a circle."""
    kind = node.get("type").text()
    if kind == "Polygon":
        return tuple(_ring(ring) for ring in node.get("coordinates").nodes())
    if kind == "Circle" or (kind == "Point" and _text(circle, "subType").casefold() == "circle"):
        position = node.get("center" if kind == "Circle" else "coordinates").nodes()
        if len(position) < 2:
            raise FormatError("a position must be longitude and latitude", where=node.where, advice="correct it")
        radius_unit = (_text(circle, "uom") or unit).upper()
        if radius_unit not in METRES:
            raise FormatError(f"{radius_unit[:20]!r} is not a unit of length", where=node.where, advice="use m or ft")
        radius_m = circle.get("radius").number() * METRES[radius_unit]
        return position[0].number(), position[1].number(), radius_m
    raise FormatError(f"{kind[:30]!r} is not a supported shape", where=node.where, advice="use a polygon or a circle")


def _ring(ring: Node) -> Ring:
    positions = [position.nodes() for position in ring.nodes()]
    if any(len(position) < 2 for position in positions):
        raise FormatError("a position must be longitude and latitude", where=ring.where, advice="correct it")
    return tuple((position[0].number(), position[1].number()) for position in positions)

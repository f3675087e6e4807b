"""Text of mission files: format, encoding, numbers, XML and JSON, with lists of repairs and doubts.

Numbers are written as the shortest plain decimals that read back as the same number.
"""

import codecs
import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from functools import cache
from typing import TYPE_CHECKING, Any, TypeVar
from xml.etree import ElementTree
from xml.parsers import expat
from xml.sax.saxutils import escape

from mission_io.autopilots.autopilot import ARDUPILOT
from mission_io.autopilots.mission_lists import MissionList, items_of
from mission_io.errors import FormatError
from mission_io.model.items import (
    Command,
    Fence,
    GeoPoint,
    LatLon,
    Mission,
    MissionType,
    RallyPoints,
    ground_distance_m,
)

if TYPE_CHECKING:
    import jinja2

_WIDE = ((codecs.BOM_UTF32_LE, "utf-32"), (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"))


@dataclass(frozen=True, slots=True)
class MissionFile:
    """Content of a mission file; None for a list that it does not have."""

    mission: Mission | None = None  # its mission
    fence: Fence | None = None  # its fence
    rally: RallyPoints | None = None  # its rally points
    repairs: tuple[str, ...] = ()  # what had to be repaired to read the file, one line each

    @property
    def lists(self) -> tuple[MissionList, ...]:
        """The lists of the file, empty ones included: mission, fence, rally points."""
        return tuple(one for one in (self.mission, self.fence, self.rally) if one is not None)

    def has(self, mission_type: MissionType) -> bool:
        """Whether the file has this list."""
        return {MissionType.MISSION: self.mission, MissionType.FENCE: self.fence, MissionType.RALLY: self.rally}[
            mission_type
        ] is not None

    @property
    def filled_lists(self) -> tuple[MissionList, ...]:
        """The lists that hold at least one item."""
        return tuple(one for one in self.lists if items_of(one, ARDUPILOT)[isinstance(one, Mission) :])

    def doubts(self) -> tuple[str, ...]:
        """Probable mistakes, such as a route far from home, or a return point outside the fence, one line each."""
        of_mission = () if self.mission is None else doubts_about(self.mission)
        return of_mission if self.fence is None else (*of_mission, *doubts_about_fence(self.fence))


@dataclass(frozen=True, slots=True)
class FileText:
    """The text of a file."""

    text: str  # without a byte order mark and with LF line ends
    repairs: tuple[str, ...]  # what was repaired, one line each


def text_from_bytes(data: bytes) -> FileText:
    """Decode a file: UTF-8; UTF-16 and UTF-32 with a byte order mark; Latin-1 for anything else.

    Raises:
        FormatError: zero bytes, so it is not text, or damaged UTF-16.
    """
    for mark, encoding in _WIDE:
        if data.startswith(mark):
            try:
                clean = clean_text(data.decode(encoding))
            except UnicodeDecodeError:
                raise FormatError(
                    f"invalid {encoding.upper()}", where="file", advice="save the file as UTF-8"
                ) from None
            return FileText(clean.text, (f"decoded from {encoding.upper()}", *clean.repairs))
    if b"\0" in data:
        where = f"byte {data.index(0)}"
        raise FormatError("the file has a zero byte, so it is not text", where=where, advice="choose another file")
    try:
        return clean_text(data.decode("utf-8"))
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        clean = clean_text(data.decode("latin-1"))
        return FileText(clean.text, (f"line {line}: not UTF-8; the file was read as Latin-1", *clean.repairs))


def clean_text(text: str) -> FileText:
    """The same text without a byte order mark and with LF line ends."""
    repairs: list[str] = []
    if text.startswith("\ufeff"):
        repairs.append("removed a byte order mark")
        text = text[1:]
    if "\r" in text:
        repairs.append("changed the line ends to LF")
        text = text.replace("\r\n", "\n").replace("\r", "\n")
    return FileText(text, tuple(repairs))


_LONGEST_NUMBER = 400  # the smallest double has 341 characters without an exponent


def plain_decimal(value: float, where: str) -> str:
    """The shortest decimal without an exponent that reads back as ``value``.

    Raises:
        FormatError: NaN or infinity, which no reader of these files accepts.
    """
    if value == 0.0:
        return "0"
    text = repr(float(value))
    if "e" in text:
        text = format(Decimal(text), "f")
    elif text[-1] in "nf":
        raise FormatError(f"{value} cannot be written", where=where, advice="use a finite number")
    return text[:-2] if text.endswith(".0") else text


def degrees_text(value_deg: float, where: str) -> str:
    """Degrees with eight decimals, one more than MAVLink carries. Raises FormatError: NaN or infinity."""
    if not math.isfinite(value_deg):
        raise FormatError(f"{value_deg} is not a valid coordinate", where=where, advice="specify degrees")
    text = f"{value_deg:.8f}"
    return "0.00000000" if text == "-0.00000000" else text


def plain_float(text: str) -> float:
    """A number in plain or exponent form, ``nan`` or ``inf``. Raises ValueError: another text, also ``1_000``."""
    if "_" in text or not text.isascii():
        raise ValueError(f"{text!r} is not a plain number")
    return float(text)


def finite_number(text: str, where: str) -> float:
    """Parse a number in plain or exponent form. Raises FormatError: not a finite number."""
    try:
        value = plain_float(text) if len(text) <= _LONGEST_NUMBER else math.nan
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise FormatError(f"{text[:20]!r} is not a finite number", where=where)
    return value


def is_position(lat_deg: float, lon_deg: float) -> bool:
    """Whether these are a latitude and a longitude."""
    return -90.0 <= lat_deg <= 90.0 and -180.0 <= lon_deg <= 180.0


def check_position(lat_deg: float, lon_deg: float, where: str) -> None:
    """Refuse an invalid latitude or longitude. Raises FormatError: with ``where``."""
    if not is_position(lat_deg, lon_deg):
        advice = "write latitude first" if abs(lon_deg) <= 90.0 and abs(lat_deg) <= 180.0 else ""
        what = f"latitude {lat_deg:g}, longitude {lon_deg:g} is not a valid position"
        raise FormatError(what, where=where, advice=advice)


_NOT_IN_XML = re.compile(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def xml_text(text: str) -> str:
    """Text as the content of an XML element or of an attribute in double quotes.

    Raises:
        FormatError: a character that XML cannot hold in any form, such as a control character or half a character.
    """
    if bad := _NOT_IN_XML.search(text):
        raise FormatError(
            f"the name contains {bad.group()!r}, which XML does not allow", where="name", advice="omit it"
        )
    return escape(text, {'"': "&quot;"})


@cache
def _environment() -> "jinja2.Environment":
    import jinja2  # takes a while, and readers do without
    from markupsafe import Markup

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("mission_io.formats", ""),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["xml"] = lambda text: Markup(xml_text(text))
    environment.globals |= {"number": plain_decimal, "degrees": degrees_text}
    return environment


def rendered(template: str, **facts: object) -> str:
    """An XML document from a template of this folder. Every text is escaped; ``xml`` also refuses what XML cannot hold.

    Raises:
        FormatError: such a text, or a number that is not finite.
    """
    return _environment().get_template(template).render(facts)


def xml_root(text: str) -> tuple[ElementTree.Element, tuple[str, ...]]:
    """The root of an XML document, and repairs of its text.

    Raises:
        FormatError: invalid XML, or a document type, whose entities let a small file expand to gigabytes.
    """
    clean = clean_text(text)

    def refuse(*_: object) -> None:
        raise FormatError("the file has a document type (DOCTYPE)", where="XML", advice="remove it")

    parser = expat.ParserCreate("utf-8")
    parser.StartDoctypeDeclHandler = refuse
    data = parse_xml(clean.text, parser)
    try:
        return ElementTree.fromstring(data), clean.repairs
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise FormatError(f"invalid XML: {error}", where="XML") from None


def parse_xml(text: str, parser: expat.XMLParserType) -> bytes:
    """Parse a document; return its bytes. Raises FormatError: invalid XML, with the line."""
    try:
        data = text.encode("utf-8")
        parser.Parse(data, True)
    except UnicodeEncodeError:
        raise FormatError(
            "the text contains an incomplete character (a lone surrogate)",
            where="text",
            advice="save the file as UTF-8",
        ) from None
    except expat.ExpatError as error:
        raise FormatError(f"invalid XML: {expat.errors.messages[error.code]}", where=f"line {error.lineno}") from None
    return data


def local_name(element: ElementTree.Element) -> str:
    """The name of an element without its namespace."""
    return str(element.tag).rpartition("}")[2]


def child_text(element: ElementTree.Element, name: str) -> str | None:
    """The text of the first child of a name, in any namespace; None without one."""
    text = element.findtext(f"{{*}}{name}")
    return None if text is None else text.strip()


def number_in(text: str | None, where: str) -> float:
    """A finite number of a document. Raises FormatError: it is missing or not a number."""
    try:
        value = plain_float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise FormatError(f"expected a number, not {(text or 'nothing')[:40]!r}", where=where)
    return value


# JSON documents whose values know their path, so that an error can name it.

ResultT = TypeVar("ResultT")

_LARGEST = 1e300
"""Larger numbers are treated as mistakes (1e999 would read as infinite)."""


@dataclass(frozen=True, slots=True)
class Node:
    """A value in the document with its location."""

    value: Any
    where: str

    def get(self, key: str) -> "Node":
        """The value of a required key."""
        if not isinstance(self.value, Mapping):
            raise FormatError("expected an object", where=self.where)
        if key not in self.value:
            raise FormatError("the key is missing", where=f"{self.where}.{key}")
        return Node(self.value[key], f"{self.where}.{key}")

    def optional(self, key: str, read_node: "Callable[[Node], ResultT]", default: ResultT) -> ResultT:
        """The value of an optional key."""
        missing = isinstance(self.value, Mapping) and key not in self.value
        return default if missing else read_node(self.get(key))

    def nodes(self) -> list["Node"]:
        """The entries of a list."""
        if not isinstance(self.value, list):
            raise FormatError("expected a list", where=self.where)
        return [Node(value, f"{self.where}[{index}]") for index, value in enumerate(self.value)]

    def number(self) -> float:
        """A number as a double."""
        if isinstance(self.value, bool) or not isinstance(self.value, int | float) or abs(self.value) > _LARGEST:
            raise FormatError(f"expected a number, not {_shown(self.value)}", where=self.where)
        return float(self.value)

    def whole(self) -> int:
        """A number without a fraction."""
        value = self.number()
        if value != int(value):
            raise FormatError(f"expected a whole number, not {value}", where=self.where)
        return int(value)

    def truth(self) -> bool:
        """True or false."""
        if not isinstance(self.value, bool):
            raise FormatError("expected true or false", where=self.where)
        return self.value

    def text(self) -> str:
        """A string."""
        if not isinstance(self.value, str):
            raise FormatError("expected a string", where=self.where)
        return self.value

    def floats(self, size: int) -> list[float]:
        """A list of a given number of numbers."""
        nodes = self.nodes()
        if len(nodes) != size:
            raise FormatError(f"expected {size} numbers, not {len(nodes)}", where=self.where)
        return [node.number() for node in nodes]


def parse_json(text: str, name: str) -> Node:
    """Parse a document, whose root is called ``name`` in errors.

    Raises:
        FormatError: invalid JSON, nesting too deep, or NaN and other numbers that JSON does not have.
    """
    try:
        return Node(json.loads(text, parse_constant=_refuse_constant), name)
    except RecursionError:
        raise FormatError("the JSON is nested too deeply", where=name) from None
    except json.JSONDecodeError as error:
        raise FormatError(f"cannot read the file as JSON: {error.msg}", where=f"line {error.lineno}") from None
    except ValueError as error:
        raise FormatError(f"cannot read a number: {error}"[:80], where=name) from None


def _refuse_constant(name: str) -> float:
    raise ValueError(name)


def _shown(value: Any) -> str:
    """A value in short form, even one with a million entries or digits."""
    if isinstance(value, str):
        return repr(value[:20])
    if isinstance(value, int | float) and not isinstance(value, bool):
        return "a number that is too large"
    return {dict: "an object", list: "a list", bool: "true or false"}.get(type(value), "null")


# Doubts: valid values that are probably mistakes, such as a position at 0, 0, or a route far from home.


def doubts_about_fence(fence: Fence) -> tuple[str, ...]:
    """Probable mistakes, one line each, such as a return point where the vehicle breaches the fence."""
    point = fence.return_point
    if point is None:
        return ()
    polygons = [(area.inclusion, _is_in_ring(point.lat_deg, point.lon_deg, area.vertices)) for area in fence.polygons]
    circles = [
        (
            area.inclusion,
            ground_distance_m(point.lat_deg, point.lon_deg, area.center.lat_deg, area.center.lon_deg) <= area.radius_m,
        )
        for area in fence.circles
    ]
    allowed = [inside for inclusion, inside in (*polygons, *circles) if inclusion]
    where = f"the return point, latitude {point.lat_deg:.6f}, longitude {point.lon_deg:.6f}, is"
    if allowed and not any(allowed):
        return (f"{where} outside the fence, so a vehicle that flies there after a breach leaves the fence again",)
    if any(inside for inclusion, inside in (*polygons, *circles) if not inclusion):
        return (f"{where} in an area that the fence excludes",)
    return ()


def _is_in_ring(lat_deg: float, lon_deg: float, ring: Sequence[LatLon]) -> bool:
    """Whether a position is in a ring, by the edges that a line to the east crosses; longitudes count the short way."""
    inside = False
    for begin, end in zip(ring, (*ring[1:], *ring[:1]), strict=True):
        if (begin.lat_deg > lat_deg) != (end.lat_deg > lat_deg):
            east, west = (math.remainder(corner.lon_deg - lon_deg, 360.0) for corner in (begin, end))
            at = east + (lat_deg - begin.lat_deg) / (end.lat_deg - begin.lat_deg) * (west - east)
            inside ^= at > 0.0
    return inside


FAR_FROM_HOME_M = 100_000.0
"""Positions further away are doubted; no electric multicopter flies that far."""


def doubts_about(mission: Mission) -> tuple[str, ...]:
    """Probable mistakes, one line each.

    Swapped latitudes and longitudes are distinguished from a route that is far from home. A doubt is not an error: the
    mission stays as the file says.
    """
    home = mission.home
    doubts: list[str] = []
    if home is not None and home.lat_deg == 0.0 and home.lon_deg == 0.0:
        doubts.append("home is at latitude 0, longitude 0, in the open sea; set the home position")
        home = None
    far: list[tuple[int, float]] = []
    swapped = 0
    for number, item in enumerate(mission.items, start=1):
        if not item.has_position or not (math.isfinite(item.lat_deg) and math.isfinite(item.lon_deg)):
            continue
        if item.lat_deg == 0.0 and item.lon_deg == 0.0:
            if item.command == Command.NAV_WAYPOINT:
                doubts.append(f"item {number}: this waypoint is at latitude 0, longitude 0")
            continue
        if home is None:
            continue
        distance_m = ground_distance_m(home.lat_deg, home.lon_deg, item.lat_deg, item.lon_deg)
        if distance_m > FAR_FROM_HOME_M:
            far.append((number, distance_m))
            swapped += _near_when_swapped(home, item.lat_deg, item.lon_deg)
    if far:
        number, distance_m = max(far, key=lambda entry: entry[1])
        what = (
            "latitude and longitude seem to be swapped"
            if swapped == len(far)
            else "do the route and home belong to different locations?"
        )
        rank = f"the farthest of {len(far)} beyond {FAR_FROM_HOME_M / 1000.0:.0f} km"
        doubts.append(f"item {number}: {distance_m / 1000.0:.0f} km from home ({rank}); {what}")
    return tuple(doubts)


def _near_when_swapped(home: GeoPoint, lat_deg: float, lon_deg: float) -> bool:
    return abs(lon_deg) <= 90.0 and ground_distance_m(home.lat_deg, home.lon_deg, lon_deg, lat_deg) <= FAR_FROM_HOME_M

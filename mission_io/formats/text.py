"""Mission files: what they hold, their text with a list of repairs, and numbers in decimal notation.

Numbers are written as the shortest plain decimals that read back as the same number.
"""

import codecs
import math
import re
from dataclasses import dataclass
from decimal import Decimal
from functools import cache
from typing import TYPE_CHECKING
from xml.sax.saxutils import escape

from mission_io.autopilots.autopilot import ARDUPILOT, MissionList, items_of
from mission_io.errors import FormatError
from mission_io.model.areas import Fence, RallyPoints
from mission_io.model.items import Mission, MissionType
from mission_io.model.places import doubts_about, doubts_about_fence

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
        raise FormatError("the file has a zero byte, so it is not text", where=where, advice="choose a mission file")
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


def finite_number(text: str, where: str) -> float:
    """Parse a number in plain or exponent form. Raises FormatError: not a finite number."""
    try:
        value = float(text) if len(text) <= _LONGEST_NUMBER and "_" not in text and text.isascii() else math.nan
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise FormatError(f"{text[:20]!r} is not a finite number", where=where)
    return value


def is_place(lat_deg: float, lon_deg: float) -> bool:
    """Whether these are a latitude and a longitude."""
    return -90.0 <= lat_deg <= 90.0 and -180.0 <= lon_deg <= 180.0


def check_place(lat_deg: float, lon_deg: float, where: str) -> None:
    """Refuse an invalid latitude or longitude. Raises FormatError: with ``where``."""
    if not is_place(lat_deg, lon_deg):
        advice = "write latitude first" if abs(lon_deg) <= 90.0 and abs(lat_deg) <= 180.0 else ""
        what = f"latitude {lat_deg:g}, longitude {lon_deg:g} is not a valid position"
        raise FormatError(what, where=where, advice=advice)


_NOT_IN_XML = re.compile(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def xml_text(text: str, *, where: str = "name") -> str:
    """Text as the content of an XML element or of an attribute in double quotes.

    Raises:
        FormatError: a character that XML cannot hold in any form, such as a control character or half a character.
    """
    bad = _NOT_IN_XML.search(text)
    if bad is not None:
        raise FormatError(
            f"the {where} contains {bad.group()!r}, which XML does not allow", where=where, advice="omit it"
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

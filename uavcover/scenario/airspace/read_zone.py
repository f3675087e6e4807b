"""A zone as a file of zones has it, before it is checked; and the units of such files."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from pyproj import CRS

from mission_io.errors import FormatError
from uavcover.model.area import Rings
from uavcover.scenario.areas.features import WGS84

METRES: Final = {"M": 1.0, "FT": 0.3048, "F": 0.3048, "KM": 1000.0, "NM": 1852.0, "FL": 30.48}
"""Units of heights and lengths."""

_LOWEST_PRESSURE_M = 550.0
"""A flight level is a pressure: where 950 hPa reduced to sea level is measured, it lies so much lower than in the standard
atmosphere, at 1050 hPa about 300 m higher ..."""
_COLD_SHARE = 0.15
"""... and in air 40 degrees colder than the standard one everything is 15 % lower."""


@dataclass(frozen=True, slots=True)
class ReadZone:
    """A zone of a file: polygons, or a circle."""

    name: str  # for people
    names: frozenset[str]  # names and identifiers by which it can be ignored
    heights: dict[str, float]  # its floors and ceilings by the scenario's keys, such as ``floor_agl_m``
    polygons: tuple[Rings, ...] = ()  # each its outer ring and its holes
    crs: CRS = WGS84  # the system of the polygons
    rings_may_be_open: bool = False  # whether the last corner need not repeat the first
    circle: tuple[float, float, float] | None = None  # longitude, latitude in degrees and radius in metres
    from_utc: str | None = None  # when it begins
    until_utc: str | None = None  # when it ends
    active: tuple[str, ...] = ()  # the periods between these two, as the scenario has them


@dataclass(frozen=True, slots=True)
class ReadZones:
    """The zones of a file, and what was left out, one line each."""

    zones: tuple[ReadZone, ...]
    notes: tuple[str, ...] = field(default=())


@dataclass(frozen=True, slots=True)
class ZoneReader:
    """A format of zones: an entry point of the group ``uavcover.zone_readers``."""

    suffixes: tuple[str, ...]  # of its files, in lower case with the dot
    # takes the text of a file and its suffix; none where the text is not of this format. A text of this format that
    # cannot be read is a `mission_io.errors.FormatError`.
    read: Callable[[str, str], ReadZones | None]


def shown(name: str) -> str:
    """A name in short form and on one line, for messages."""
    return " ".join(name[:200].split())[:60]


def height_key(end: str, value: float, unit: str, datum: str, *, where: str) -> dict[str, float]:
    """A floor or a ceiling by the scenario's key; empty where the zone has no such end.

    A flight level becomes the lowest height above sea level that it can have, for a floor; a ceiling, which can be higher in
    high pressure, becomes none.

    Args:
        end: "floor" or "ceiling".
        value: the number.
        unit: of METRES.
        datum: "AGL" or "AMSL", or other words for them; "STD" for flight levels.
        where: names the zone and the line in errors.

    Raises:
        FormatError: unit or datum are not known.
    """
    if unit.upper() not in METRES:
        raise FormatError(f"{unit[:20]!r} is not a supported unit of height", where=where, advice="use m, ft or FL")
    height_m = value * METRES[unit.upper()]
    if unit.upper() == "FL" or datum.upper() == "STD":
        if end == "ceiling":
            return {}
        return {"floor_amsl_m": max(0.0, (1.0 - _COLD_SHARE) * height_m - _LOWEST_PRESSURE_M)}
    if datum.upper() in {"AGL", "GND", "SFC", "ASFC", "HEI"}:
        return {} if end == "floor" and height_m <= 0.0 else {f"{end}_agl_m": height_m}
    if datum.upper() in {"AMSL", "MSL", "ALT"}:
        return {f"{end}_amsl_m": height_m}
    raise FormatError(
        f"{datum[:20]!r} is not a supported height reference", where=where,
        advice="use AGL or AMSL, or name the zone in ignore",
    )  # fmt: skip

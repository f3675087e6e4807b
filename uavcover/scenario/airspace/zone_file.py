"""Read no-fly zones from files of any known format, as entries of a scenario, and the interface of such formats."""

import dataclasses
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from pyproj import CRS

from mission_io.errors import FormatError
from mission_io.formats import plan
from mission_io.formats.text import text_from_bytes
from uavcover.errors import InputError
from uavcover.model.area import Rings
from uavcover.model.limits import NoFly
from uavcover.plugins import loaded
from uavcover.scenario.areas.area_file import (
    MAX_BYTES,
    SUFFIXES,
    RingReading,
    joined,
    read_document,
    read_polygons,
    rings_of,
)
from uavcover.scenario.areas.features import WGS84
from uavcover.terrain.frames import Bounds

METRES: Final = {"M": 1.0, "FT": 0.3048, "F": 0.3048, "KM": 1000.0, "NM": 1852.0, "FL": 30.48}
"""Units of heights and lengths."""

_LOWEST_PRESSURE_M = 550.0
"""A flight level is a pressure level. At 950 hPa, reduced to sea level, it is lower by this than in the standard atmosphere; at
1050 hPa it is about 300 m higher ..."""
_COLD_FRACTION = 0.15
"""... and in air 40 degrees colder than the standard one everything is 15 % lower."""


@dataclass(frozen=True, slots=True)
class ReadZone:
    """A zone of a file: polygons, or a circle."""

    name: str  # shown to the user
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
    """The zones of a file, and what was omitted, one line each."""

    zones: tuple[ReadZone, ...]
    notes: tuple[str, ...] = field(default=())


@dataclass(frozen=True, slots=True)
class ZoneReader:
    """A format of zones: an entry point of the group ``uavcover.zone_readers``."""

    suffixes: tuple[str, ...]  # of its files, in lower case with the dot
    # takes the text of a file and its suffix; None where the text is not of this format. A text of this format that cannot be
    # read is a `mission_io.errors.FormatError`.
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
        where: zone and line, for errors.

    Raises:
        FormatError: the unit or datum is unknown.
    """
    if unit.upper() not in METRES:
        raise FormatError(f"{unit[:20]!r} is not a supported unit of height", where=where, advice="use m, ft or FL")
    height_m = value * METRES[unit.upper()]
    if unit.upper() == "FL" or datum.upper() == "STD":
        if end == "ceiling":
            return {}
        return {"floor_amsl_m": max(0.0, (1.0 - _COLD_FRACTION) * height_m - _LOWEST_PRESSURE_M)}
    if datum.upper() in {"AGL", "GND", "SFC", "ASFC", "HEI"}:
        return {} if end == "floor" and height_m <= 0.0 else {f"{end}_agl_m": height_m}
    if datum.upper() in {"AMSL", "MSL", "ALT"}:
        return {f"{end}_amsl_m": height_m}
    raise FormatError(
        f"{datum[:20]!r} is not a supported height reference", where=where,
        advice="use AGL or AMSL, or name the zone in ignore",
    )  # fmt: skip


_HEIGHTS: Final = ("floor_agl_m", "floor_amsl_m", "ceiling_agl_m", "ceiling_amsl_m")
_TIMES: Final = ("from_utc", "until_utc")

NEAR_KM = 20.0
"""Zones of a file farther from area, home and fence are omitted."""

_LARGEST_RADIUS_M = 1_000_000.0


def read_zones(
    entry: NoFly, *, folder: Path = Path(), near: Bounds | None = None
) -> tuple[tuple[NoFly, ...], tuple[str, ...]]:
    """Read the zones of an entry that names a file, each with its own outline.

    Also return what was omitted, one line each.

    Args:
        entry: names the file; its floors, ceilings and times are those of zones whose file has none.
        folder: base of a relative path.
        near: west, south, east, north in degrees of what is flown; zones far from it are omitted. None keeps them all.

    Raises:
        InputError: one line that names the file and the zone, what is wrong there, and the way out.
    """
    path = folder / (entry.file or "")
    read = _read(path)
    unknown = sorted(set(entry.ignore) - {name for zone in read.zones for name in zone.names})
    if unknown:
        raise InputError(
            f"{path}: ignore names the zone {unknown[0]!r}, which is not in the file; write the name or identifier "
            "as it appears in the file"
        )
    wanted = [zone for zone in read.zones if not zone.names & set(entry.ignore)]
    notes = [f"{path.name}: {note}" for note in read.notes]
    if not read.zones and not read.notes:
        raise InputError(f"{path}: the file contains no zones; use a file with polygons or circles")
    # Files of whole countries: what is far away is not even checked.
    close = [(number, zone) for number, zone in enumerate(wanted, start=1) if near is None or _is_near(zone, near)]
    found = []
    for number, zone in close:
        own, repairs = _entry_of(entry, zone, f"{path}, zone {number} ({shown(zone.name)})")
        found.append(own)
        notes += repairs
    if len(close) < len(wanted):
        notes.append(
            f"{path.name}: ignored {len(wanted) - len(close)} of {len(wanted)} zones, because they are more than "
            f"{NEAR_KM:g} km away"
            + ("" if close else "; are longitude and latitude swapped, or is this file for another location?")
        )
    return tuple(found), tuple(notes)


def zone_suffixes() -> tuple[str, ...]:
    """Suffixes of zone files: those of areas, and those of the installed readers."""
    own = dict.fromkeys(suffix for reader in _readers() for suffix in reader.suffixes)
    return (*SUFFIXES, *(suffix for suffix in own if suffix not in SUFFIXES))


def _readers() -> tuple[ZoneReader, ...]:
    return tuple(loaded("uavcover.zone_readers").values())


def _read(path: Path) -> ReadZones:
    suffix = path.suffix.lower()
    suffixes = zone_suffixes()
    if not path.is_file() or suffix not in suffixes:
        what = (
            "no such file"
            if not path.exists()
            else "this is a folder"
            if path.is_dir()
            else f"{suffix or 'no suffix'} is not a supported zone format"
        )
        raise InputError(f"{path}: {what}; use one of {', '.join(suffixes)}")
    if suffix == ".plan" or any(suffix in reader.suffixes for reader in _readers()):
        try:
            if path.stat().st_size > MAX_BYTES:
                raise InputError(f"{path}: the file exceeds {MAX_BYTES:,} bytes; save only the zones near the flight")
            text = text_from_bytes(path.read_bytes()).text
            own = _of_text(text, suffix)
        except FormatError as error:
            advice = "" if error.advice else "; save it again with the program that wrote it"
            raise InputError(f"{path}: {error}{advice}") from error
        except OSError as error:
            raise InputError(f"{path}: the file cannot be read ({error.strerror or type(error).__name__})") from error
        if own is not None:
            return own
    return _of_features(path)


def _of_text(text: str, suffix: str) -> ReadZones | None:
    """The zones of a text in a format of airspace; None for one of areas."""
    if suffix == ".plan":
        return _of_plan(text)
    if suffix not in SUFFIXES and not text.strip():
        raise FormatError("the file is empty", where="line 1", advice="save the file again")
    for reader in _readers():
        found = reader.read(text, suffix) if suffix in reader.suffixes else None
        if found is not None:
            return found
    if suffix not in SUFFIXES:
        raise FormatError(
            "this is not an OpenAir file, because no record begins with AC", where="line 1",
            advice="use a file with zones",
        )  # fmt: skip
    return None


def _of_plan(text: str) -> ReadZones:
    """The exclusions of the fence of a ``.plan`` file."""
    fence = plan.read_to_keep(text).fence
    zones = [
        ReadZone(
            f"exclusion {n}", frozenset(), {}, rings_may_be_open=True,
            polygons=((tuple((position.lon_deg, position.lat_deg) for position in one.vertices),),),
        )
        for n, one in enumerate((one for one in fence.polygons if not one.inclusion), start=1)
    ]  # fmt: skip
    zones += [
        ReadZone(
            f"exclusion circle {n}", frozenset(), {}, circle=(one.center.lon_deg, one.center.lat_deg, one.radius_m)
        )
        for n, one in enumerate((one for one in fence.circles if not one.inclusion), start=1)
    ]
    return ReadZones(tuple(zones))


def _of_features(path: Path) -> ReadZones:
    """Polygons of a file of areas; those of GeoJSON may have the scenario's keys as properties."""
    document = read_document(path, None)
    if document.unclosed:
        raise InputError(f"{path}: {document.unclosed[0]}; repeat its first corner at the end")
    if document.crs is None:
        raise InputError(f"{path}: the file does not state its coordinate system; save it as GeoJSON")
    zones = []
    for number, feature in enumerate(document.features, start=1):
        name = feature.name or f"zone {number}"
        where = f"{path}, feature {number} ({name})"
        heights, times = _properties(feature.properties, where)
        zones.append(
            ReadZone(
                name, frozenset({feature.name}) - {""}, heights, feature.polygons, document.crs,
                document.rings_may_be_open, None, *times, _periods(feature.properties, where),
            )
        )  # fmt: skip
    notes = (f"ignored {document.others}, which are not polygons",) if document.others else ()
    if not zones:
        raise InputError(
            f"{path}: the file contains no polygons{f' (only {document.others})' if document.others else ''}; use a "
            "file with zones"
        )
    return ReadZones(tuple(zones), (*document.notes, *notes))


def _properties(properties: Mapping[str, Any], where: str) -> tuple[dict[str, float], tuple[str | None, str | None]]:
    heights = {key: properties[key] for key in _HEIGHTS if properties.get(key) is not None}
    for key, value in heights.items():
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise InputError(f"{where}: {key} must be a number of metres, not {json.dumps(value)[:30]}")
    begin, end = (None if properties.get(key) is None else str(properties[key]) for key in _TIMES)
    return {key: float(value) for key, value in heights.items()}, (begin, end)


def _periods(properties: Mapping[str, Any], where: str) -> tuple[str, ...]:
    """The property ``active``: a period, or a list of them."""
    value = properties.get("active")
    periods = [] if value is None else value if isinstance(value, list) else [value]
    if not all(isinstance(period, str) for period in periods):
        raise InputError(f'{where}: active must be a list of periods such as ["MON-FRI 08:00-17:00Z"]')
    return tuple(periods)


def _entry_of(entry: NoFly, zone: ReadZone, where: str) -> tuple[NoFly, list[str]]:
    """A zone of a file as an entry, with its own heights and times or those of the entry.

    Also return what was repaired.

    Raises:
        InputError: one line that begins with ``where``.
    """
    changes: dict[str, Any] = {key: zone.heights.get(key) for key in _HEIGHTS} if zone.heights else {}
    if zone.from_utc is not None or zone.until_utc is not None or zone.active:
        changes |= {"from_utc": zone.from_utc, "until_utc": zone.until_utc, "active": zone.active}
    changes |= {"file": None, "ignore": (), "make_valid": False, "name": zone.name}
    notes: list[str] = []
    if zone.circle is not None:
        lon, lat, radius_m = zone.circle
        if not 0.0 < radius_m <= _LARGEST_RADIUS_M:
            raise InputError(f"{where}: the radius must be 0 to {_LARGEST_RADIUS_M:,.0f} m, not {radius_m:g} m")
        changes |= {"center_lon_lat_deg": (lon, lat), "radius_m": radius_m}
    else:
        reading = RingReading(zone.crs, zone.rings_may_be_open, make_valid=entry.make_valid)
        try:
            read = [read_polygons(rings, reading, where) for rings in zone.polygons]
        except InputError as error:
            # The advice is for areas on the command line.
            text = (
                str(error).replace("use --make-valid", "set make_valid = true").replace("--crs EPSG:NUMBER", "ogr2ogr")
            )
            raise InputError(text) from error
        polygons = [polygon for found, _ in read for polygon in found]
        notes = [note for _, repairs in read for note in repairs]
        changes["polygons_lon_lat_deg"] = tuple(_open(rings_of(polygon)) for polygon in joined(polygons))
    try:
        return dataclasses.replace(entry, **changes), notes
    except ValueError as error:
        raise InputError(f"{where}: {error}; correct it, or name the zone in ignore") from error


def _open(rings: Rings) -> Rings:
    """Rings without the repeated last corner."""
    return tuple(ring[:-1] if ring[0] == ring[-1] else ring for ring in rings)


def _is_near(zone: ReadZone, near: Bounds) -> bool:
    """Whether a zone may be near; a zone in another coordinate system, or with numbers that are none, may be."""
    west, south, east, north = near
    reach_km = NEAR_KM
    positions = [position for rings in zone.polygons for position in rings[0]]
    if zone.circle is not None:
        positions = [zone.circle[:2]]
        reach_km += abs(zone.circle[2]) / 1000.0
    lons, lats = np.array(positions, dtype=float).reshape(-1, 2).T
    if not zone.crs.equals(WGS84) or len(lons) == 0 or not (np.isfinite(lons).all() and np.abs(lats).max() <= 90.0):
        return True
    middle = 0.5 * (west + east)
    # Continuous from the first corner on, and that one beside the middle.
    steps = np.concatenate([[0.0], np.cumsum((np.diff(lons) + 180.0) % 360.0 - 180.0)])
    lons = (lons[0] - middle + 180.0) % 360.0 - 180.0 + middle + steps
    aside = reach_km / 111.0  # km per degree
    along = aside / max(math.cos(math.radians(min(max(abs(north), abs(south)) + aside, 89.9))), 1e-3)
    return bool(
        lons.max() >= west - along and lons.min() <= east + along
        and lats.max() >= south - aside and lats.min() <= north + aside
    )  # fmt: skip

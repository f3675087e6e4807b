"""OpenAir, the format of gliding for airspace: one record a line, commands of two letters.

Which records there are: the description of its author of 1998 (winpilot.com) and Naviter's extension of 2024. Lengths are in
nautical miles, heights in feet where no unit is written.
"""

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from pyproj import Geod

from mission_io.errors import FormatError
from mission_io.model.plain_text import counted
from uavcover.scenario.airspace.zone_file import ReadZone, ReadZones, ZoneReader, height_key, shown

OPEN_TO_ALL = frozenset({"E", "F", "G"})
"""Classes of airspace without clearance."""

_NAUTICAL_MILE_M = 1852.0
_MOST_CORNERS = 20_000
_EARTH = Geod(ellps="WGS84")
_HALF = r"(\d+(?:\.\d+)?)(?::(\d+(?:\.\d+)?))?(?::(\d+(?:\.\d+)?))?\s*([{}])"
_POSITION = re.compile(rf"\s*{_HALF.format('NS')}[\s,]*{_HALF.format('EW')}\s*", re.IGNORECASE)
_HEIGHT = re.compile(r"(-?\d+(?:\.\d+)?)\s*(ft|f|m)?\s*(agl|gnd|sfc|asfc|amsl|msl|alt)?\.?", re.IGNORECASE)
_LEVEL = re.compile(r"FL\s*(\d+(?:\.\d+)?)", re.IGNORECASE)
_RECORD = re.compile(r"\s*(A[A-Z]|D[A-Z]|V|S[BP]|T[OC])\b\s*(.*)")
_MOMENT = r"\d{4}-\d{2}-\d{2}T\d{2}:\d{2}(?::\d{2})?Z"
_INTERVAL = re.compile(rf"{_MOMENT}/(?:{_MOMENT}|\.\.)|\.\./{_MOMENT}")
_NOT_GEOMETRY = frozenset({"AT", "AF", "AG", "AI", "AX", "AY", "SB", "SP", "TO", "TC"})


@dataclass(slots=True)
class _Zone:
    """Lines of a zone read so far."""

    line: int
    kind: str
    name: str = ""
    heights: dict[str, float] = field(default_factory=dict)
    corners: list[tuple[float, float]] = field(default_factory=list)
    circle: tuple[float, float, float] | None = None
    center: tuple[float, float] | None = None
    clockwise: bool = True
    periods: list[str] = field(default_factory=list)
    always: bool = False

    @property
    def where(self) -> str:
        return f"line {self.line}, zone {shown(self.name) or '(no name)'}"


def looks_like_openair(text: str) -> bool:
    """Whether the first record of a text is one of OpenAir."""
    for line in text.splitlines():
        if line.strip() and not line.lstrip().startswith("*"):
            return bool(_RECORD.match(line))
    return False


def read_openair(text: str) -> ReadZones:
    """The zones of a file. Those of the classes E, F and G are omitted.

    Raises:
        FormatError: with the line that cannot be understood.
    """
    found: list[ReadZone] = []
    left_out: Counter[str] = Counter()
    for zone in _zones(text):
        if zone.kind.upper() in OPEN_TO_ALL:
            left_out[zone.kind.upper()] += 1
            continue
        if zone.circle is None and len({*zone.corners}) < 3:
            raise FormatError(
                f"the zone has {len({*zone.corners})} different corners, but needs at least 3",
                where=zone.where,
                advice="remove it, or draw it again",
            )
        if zone.circle is not None and zone.corners:
            raise FormatError(
                "the zone has both a circle (DC) and corners", where=zone.where, advice="divide it into two zones"
            )
        found.append(
            ReadZone(
                zone.name or f"zone on line {zone.line}", frozenset({zone.name}) - {""}, zone.heights,
                polygons=() if zone.circle else ((tuple(zone.corners),),), rings_may_be_open=True, circle=zone.circle,
                active=() if zone.always else tuple(zone.periods),
            )
        )  # fmt: skip
    notes = tuple(
        f"ignored {counted(n, 'zone')} of class {kind}, {'which is' if n == 1 else 'which are'} open to all"
        for kind, n in sorted(left_out.items())
    )
    return ReadZones(tuple(found), notes)


READER = ZoneReader(
    (".txt", ".air", ".openair"), lambda text, _: read_openair(text) if looks_like_openair(text) else None
)


def _zones(text: str) -> Iterator[_Zone]:
    zone: _Zone | None = None
    for number, whole in enumerate(text.splitlines(), start=1):
        line = whole.split("*")[0].strip()
        if not line:
            continue
        match = _RECORD.fullmatch(line)
        if match is None:
            raise FormatError(f"{line[:40]!r} is not an OpenAir record", where=f"line {number}", advice="remove it")
        command, rest = match[1], match[2].strip()
        if command == "AC":
            if zone is not None:
                yield zone
            zone = _Zone(number, rest)
        elif zone is None:
            if command not in _NOT_GEOMETRY and command != "V":
                raise FormatError(
                    f"the record {command} precedes the first AC",
                    where=f"line {number}",
                    advice="begin every zone with AC",
                )
        else:
            _take(zone, command, rest, f"line {number}, zone {shown(zone.name) or '(no name)'}")
    if zone is not None:
        yield zone


def _take(zone: _Zone, command: str, rest: str, where: str) -> None:
    """Add one record to a zone."""
    if command == "AN":
        zone.name = rest
    elif command == "AA":
        # The extension's activation times: an interval, whose open ends are NONE; what else is written there is as text.
        interval = "/".join(".." if part.upper() == "NONE" else part for part in rest.split("/"))
        zone.periods.append(interval)
        zone.always |= _INTERVAL.fullmatch(interval) is None
    elif command in ("AL", "AH"):
        zone.heights |= _height("floor" if command == "AL" else "ceiling", rest, where)
    elif command == "V":
        _assign(zone, rest, where)
    elif command == "DP":
        zone.corners.append(_position(rest, where))
    elif command == "DC":
        lon, lat = _center(zone, where)
        zone.circle = (lon, lat, _numbers(rest, 1, where)[0] * _NAUTICAL_MILE_M)
    elif command == "DA":
        radius, begin, end = _numbers(rest, 3, where)
        zone.corners += _arc(_center(zone, where), (radius * _NAUTICAL_MILE_M,) * 2, (begin, end), zone.clockwise)
    elif command == "DB":
        zone.corners += _arc_between(zone, rest, where)
    elif command not in _NOT_GEOMETRY:
        raise FormatError(f"unsupported record {command[:20]}", where=where, advice="use DP, DA, DB or DC")
    if len(zone.corners) > _MOST_CORNERS:
        raise FormatError(
            f"the zone has more than {_MOST_CORNERS:,} corners", where=where, advice="draw it with fewer corners"
        )


def _height(end: str, text: str, where: str) -> dict[str, float]:
    word = text.strip()
    if word.upper() in {"SFC", "GND", "SURFACE", "GROUND"}:
        return {} if end == "floor" else {"ceiling_agl_m": 0.0}
    if word.upper() in {"UNL", "UNLIM", "UNLIMITED", "UNLTD"}:
        return {}
    level = _LEVEL.fullmatch(word)
    if level is not None:
        return height_key(end, float(level[1]), "FL", "STD", where=where)
    match = _HEIGHT.fullmatch(word)
    if match is None:
        raise FormatError(
            f"{word[:30]!r} is not a height", where=where, advice="write 1500ft AMSL, 120m AGL, FL65, GND or UNL"
        )
    return height_key(end, float(match[1]), match[2] or "ft", match[3] or "AMSL", where=where)


def _assign(zone: _Zone, text: str, where: str) -> None:
    key, _, value = (part.strip() for part in text.partition("="))
    if key.upper() == "X":
        zone.center = _position(value, where)
    elif key.upper() == "D" and value in ("+", "-"):
        zone.clockwise = value == "+"
    elif key.upper() not in ("W", "Z", "T"):
        raise FormatError(f"unsupported variable {text[:20]!r}", where=where, advice="use V X=position, V D=+ or V D=-")


def _position(text: str, where: str) -> tuple[float, float]:
    match = _POSITION.fullmatch(text)
    if match is None:
        raise FormatError(f"{text[:40]!r} is not a position", where=where, advice="write 46:30:15 N 007:24:00 E")
    lat, lon = _angle(match.groups()[:4], 90.0, where), _angle(match.groups()[4:], 180.0, where)
    return lon, lat


def _angle(parts: tuple[str | None, ...], most: float, where: str) -> float:
    degrees, minutes, seconds = (float(part or 0.0) for part in parts[:3])
    value = degrees + minutes / 60.0 + seconds / 3600.0
    if minutes >= 60.0 or seconds >= 60.0 or value > most:
        raise FormatError(
            f"{degrees:g}:{minutes:g}:{seconds:g} is not an angle", where=where, advice="correct the position"
        )
    return -value if (parts[3] or "").upper() in ("S", "W") else value


def _center(zone: _Zone, where: str) -> tuple[float, float]:
    if zone.center is None:
        raise FormatError("the arc or circle has no centre", where=where, advice="add V X=position before it")
    return zone.center


def _numbers(text: str, count: int, where: str) -> list[float]:
    parts = re.split(r"[\s,]+", text.strip())
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        numbers = []
    if len(numbers) != count or not np.isfinite(numbers).all() or numbers[0] <= 0.0:
        raise FormatError(
            f"expected {count} numbers, the first a radius in nautical miles, not {text[:30]!r}", where=where,
            advice="correct the record",
        )  # fmt: skip
    return numbers


def _arc_between(zone: _Zone, text: str, where: str) -> list[tuple[float, float]]:
    """The arc from one place to another around the centre; the ends are as they are written."""
    match = re.fullmatch(rf"({_POSITION.pattern}),?({_POSITION.pattern})", text, re.IGNORECASE)
    if match is None:
        raise FormatError(
            f"{text[:60]!r} is not a pair of positions", where=where, advice="write DB position, position"
        )
    ends = [_position(match[1], where), _position(match[10], where)]
    lon, lat = _center(zone, where)
    bearings, _, radii = _EARTH.inv([lon] * 2, [lat] * 2, [end[0] for end in ends], [end[1] for end in ends])
    if min(radii) < 1.0 or max(radii) > 1.25 * min(radii):
        raise FormatError(
            f"the ends of the arc are {radii[0]:.0f} m and {radii[1]:.0f} m from its centre instead of equally far", where=where,
            advice="correct the centre (V X=) or the ends",
        )  # fmt: skip
    between = _arc((lon, lat), (radii[0], radii[1]), (bearings[0], bearings[1]), zone.clockwise)
    return [ends[0], *between[1:-1], ends[1]]


def _arc(
    center: tuple[float, float], radii_m: tuple[float, float], bearings_deg: tuple[float, float], clockwise: bool
) -> list[tuple[float, float]]:
    """Corners along an arc; its radius changes evenly where it is another one at the end."""
    begin, end = bearings_deg
    turn = (end - begin) % 360.0 if clockwise else -((begin - end) % 360.0)
    turn = turn or (360.0 if clockwise else -360.0)
    # one degree between the corners of an arc: their chords leave it by 0.004 % of the radius
    count = max(2, int(np.ceil(abs(turn))) + 1)
    lons, lats, _ = _EARTH.fwd(
        np.full(count, center[0]), np.full(count, center[1]), begin + np.linspace(0.0, turn, count),
        np.linspace(radii_m[0], radii_m[1], count),
    )  # fmt: skip
    return list(zip(map(float, lons), map(float, lats), strict=True))

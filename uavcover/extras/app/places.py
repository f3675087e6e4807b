"""Positions as people type them: decimal degrees, degrees and minutes and seconds, UTM, MGRS."""

import math
import re

from pyproj import Transformer

from uavcover.errors import InputError

_DECIMAL = re.compile(r"([-+]?\d{1,3}(?:\.\d+)?)\s*°?\s*([NSns])?\s*[,; ]\s*([-+]?\d{1,3}(?:\.\d+)?)\s*°?\s*([EWew])?")
_SEXAGESIMAL = re.compile(
    r"(\d{1,3})\s*[°d ]\s*(\d{1,2}(?:\.\d+)?)\s*(?:['′m ]\s*(?:(\d{1,2}(?:\.\d+)?)\s*(?:\"|″|''|s)?)?)?\s*([NSEWnsew])"
)
_UTM = re.compile(
    r"(\d{1,2})\s*([C-HJ-NP-Xc-hj-np-x])\s+(\d{5,7}(?:\.\d+)?)\s*(?:m?\s*E)?[,\s]+(\d{1,8}(?:\.\d+)?)\s*(?:m?\s*N)?",
    re.IGNORECASE,
)
_MGRS = re.compile(r"(\d{1,2})\s*([C-HJ-NP-X])\s*([A-HJ-NP-Z])([A-HJ-NP-V])\s*(\d{0,5})\s*(\d{0,5})", re.IGNORECASE)
_BANDS = "CDEFGHJKLMNPQRSTUVWX"
_ROWS = "ABCDEFGHJKLMNPQRSTUV"
_COLUMNS = ("ABCDEFGH", "JKLMNPQR", "STUVWXYZ")
FORMS = "47.37, 8.54 or 47°22'12\"N 8°32'24\"E or 32T 465300 5246800 or 32T MT 65300 46800"


def place_of(text: str) -> tuple[float, float]:
    """Latitude and longitude in degrees of a typed position, WGS 84.

    Raises:
        InputError: it is no position; names the forms.
    """
    words = text.strip()
    for read in (_decimal, _sexagesimal, _mgrs, _utm):
        found = read(words)
        if found is not None:
            lat, lon = found
            if not (math.isfinite(lat) and math.isfinite(lon) and abs(lat) <= 90.0 and abs(lon) <= 180.0):
                raise InputError(
                    f"{words[:60]!r} is not a position on Earth; latitude is between -90 and 90, longitude between -180 and 180"
                )
            return lat, lon
    raise InputError(f"{words[:60]!r} is not a position; enter {FORMS}")


def _decimal(text: str) -> tuple[float, float] | None:
    found = _DECIMAL.fullmatch(text)
    if found is None:
        return None
    lat = float(found[1]) * (-1.0 if (found[2] or "N") in "Ss" else 1.0)
    return lat, float(found[3]) * (-1.0 if (found[4] or "E") in "Ww" else 1.0)


def _sexagesimal(text: str) -> tuple[float, float] | None:
    found = list(_SEXAGESIMAL.finditer(text))
    if len(found) != 2 or _SEXAGESIMAL.sub("", text).strip(" ,;"):
        return None
    values: dict[bool, float] = {}
    for part in found:
        minutes, seconds = float(part[2]), float(part[3] or 0.0)
        if minutes >= 60.0 or seconds >= 60.0:
            return None
        side = part[4].upper()
        values[side in "NS"] = (float(part[1]) + minutes / 60.0 + seconds / 3600.0) * (-1.0 if side in "SW" else 1.0)
    return (values[True], values[False]) if len(values) == 2 else None


def _utm(text: str) -> tuple[float, float] | None:
    found = _UTM.fullmatch(text)
    if found is None or not 1 <= int(found[1]) <= 60:
        return None
    return _from_utm(int(found[1]), found[2].upper(), float(found[3]), float(found[4]))


def _mgrs(text: str) -> tuple[float, float] | None:
    """The middle of the square that an MGRS reference names (its south-west corner where it has five digits each)."""
    found = _MGRS.fullmatch(text)
    if found is None or not 1 <= int(found[1]) <= 60:
        return None
    digits = found[5] + found[6]
    if len(digits) % 2:
        return None
    zone, band, half = int(found[1]), found[2].upper(), len(digits) // 2
    column = _COLUMNS[(zone - 1) % 3].find(found[3].upper())
    if column < 0:
        return None
    size = 10.0 ** (5 - half)
    middle = 0.0 if half == 5 else 0.5 * size
    easting = 100_000.0 * (column + 1) + (int(digits[:half] or 0) * size) + middle
    row = (_ROWS.index(found[4].upper()) - (5 if zone % 2 == 0 else 0)) % 20
    northing = 100_000.0 * row + (int(digits[half:] or 0) * size) + middle
    # Letters of rows repeat every 2000 km: the one inside the latitude band is meant.
    south_deg = -80.0 + 8.0 * _BANDS.index(band)
    for repeat in range(6):
        lat, lon = _from_utm(zone, band, easting, northing + 2_000_000.0 * repeat)
        if south_deg - 1.0 <= lat <= south_deg + (12.0 if band == "X" else 8.0) + 1.0:
            return lat, lon
    return None


def _from_utm(zone: int, band: str, easting: float, northing: float) -> tuple[float, float]:
    code = (32600 if band >= "N" else 32700) + zone
    lon, lat = Transformer.from_crs(code, 4326, always_xy=True).transform(easting, northing)
    return float(lat), float(lon)

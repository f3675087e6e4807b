"""Photos without their files: of lists, tables and flight logs.

Lists are ODM's ``geo.txt`` and ``images.json``, DJI's ``.MRK``, and tables (``.csv``) with a row for each photo.

Facts: the geolocation file in OpenDroneMap's documentation (projection, then name, x, y, z, three angles, two accuracies); the
image log in DJI's manuals of Zenmuse P1 and Matrice 4 (latitude, longitude and ellipsoid height are those of the camera, already
compensated; standard deviations north, east, down in metres).
"""

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pyproj import CRS, Transformer
from pyproj.exceptions import CRSError

from mission_io.data_tables import read_document
from mission_io.errors import FormatError
from mission_io.formats.csv_tables import sniff
from mission_io.formats.text import text_from_bytes
from mission_io.model.plain_text import counted
from uavcover.errors import TrackError
from uavcover.extras.photos.photo import RTK_FIXED, HeightDatum, Photo, finite, moment
from uavcover.kernels.arrays import FloatArray
from uavcover.verification.track_logs.logged_rows import LoggedRows
from uavcover.verification.track_logs.readers import READERS, attitudes_at

_LARGEST = 100_000_000
_DEGREES = CRS.from_epsg(4326)


def read_geo_txt(path: Path) -> list[Photo]:
    """Read ODM's geolocation file, without its angles, which ODM does not use for positions either.

    Raises:
        TrackError: it is not one.
    """
    lines = [(number, line.split()) for number, line in enumerate(_text(path).splitlines(), start=1) if line.strip()]
    if not lines:
        raise TrackError(f"{path}: the file is empty; the first line must name the projection, such as EPSG:4326")
    head = " ".join(lines[0][1])
    crs = _projection(head, path)
    if not (crs.is_geographic or crs.is_projected):
        raise TrackError(f"{path}: line 1: {head[:60]!r} is not a map projection; use one such as EPSG:4326")
    to_degrees = None if crs.is_geographic else Transformer.from_crs(crs, _DEGREES, always_xy=True)
    photos = []
    for number, words in lines[1:]:
        values = [finite(word) for word in words[1:9]]
        if len(values) < 2 or values[0] is None or values[1] is None:
            raise TrackError(f"{path}: line {number}: expected a name, x and y, not {' '.join(words)[:80]!r}")
        lon, lat = (values[0], values[1]) if to_degrees is None else to_degrees.transform(values[0], values[1])
        values += [None] * (8 - len(values))
        photos.append(
            Photo(
                name=words[0], lat_deg=finite(lat), lon_deg=finite(lon), alt_m=values[2],
                horizontal_error_m=values[6] or None, vertical_error_m=values[7] or None,
            )
        )  # fmt: skip
    return photos


def _projection(text: str, path: Path) -> CRS:
    utm = re.fullmatch(r"WGS84 UTM (\d{1,2})([NS])", text.strip(), re.IGNORECASE)
    try:
        if utm is not None:
            return CRS.from_epsg((32600 if utm[2].upper() == "N" else 32700) + int(utm[1]))
        return CRS.from_user_input(text.strip())
    except CRSError as error:
        raise TrackError(
            f"{path}: line 1: {text[:60]!r} is not a projection; use, for example, EPSG:4326, WGS84 UTM 16N or a PROJ string"
        ) from error


def read_images_json(path: Path) -> list[Photo]:
    """Read the list of photos that ODM writes. Raises TrackError: it is none."""
    try:
        rows = json.loads(_text(path))
    except (ValueError, RecursionError) as error:  # ValueError also of numbers with thousands of digits
        raise TrackError(f"{path}: the file is not valid JSON ({str(error)[:100]})") from error
    if not isinstance(rows, list) or not all(isinstance(row, dict) and "filename" in row for row in rows):
        raise TrackError(f"{path}: not an ODM list of photos (filename, latitude, longitude, altitude)")
    photos = []
    for row in rows:
        off_nadir = finite(row.get("pitch"))
        known = off_nadir is not None and finite(row.get("yaw")) is not None
        time_ms = finite(row.get("utc_time"))
        photos.append(
            Photo(
                name=str(row["filename"]), lat_deg=finite(row.get("latitude")), lon_deg=finite(row.get("longitude")),
                alt_m=finite(row.get("altitude")), time_s=None if time_ms is None else 1e-3 * time_ms,
                clock=None if time_ms is None else path.name,
                # ODM turns every maker's pitch so that 0 looks straight down.
                yaw_deg=finite(row.get("yaw")) if known else None,
                pitch_deg=off_nadir - 90.0 if known and off_nadir is not None else None,
                roll_deg=finite(row.get("roll")) if known else None,
                horizontal_error_m=finite(row.get("gps_xy_stddev")), vertical_error_m=finite(row.get("gps_z_stddev")),
                camera=f"{row.get('camera_make', '')} {row.get('camera_model', '')}".strip() or None,
                pixels=_pixels(row), exposure_s=finite(row.get("exposure_time")),
                capture_id=str(row["capture_uuid"]) if row.get("capture_uuid") else None,
            )
        )  # fmt: skip
    return photos


def _pixels(row: Mapping[str, Any]) -> tuple[int, int] | None:
    width, height = finite(row.get("width")), finite(row.get("height"))
    return None if not width or not height else (int(max(width, height)), int(min(width, height)))


_NUMBER = r"([-+]?\d{1,12}(?:\.\d{0,20})?)"
_MRK = re.compile(
    rf"\s*(\d{{1,9}})\s+{_NUMBER}\s+\[(\d{{1,6}})\]\s.*?(?<![-+\d.]){_NUMBER},Lat\s+{_NUMBER},Lon\s+{_NUMBER},Ellh\s+"
    rf"{_NUMBER},\s*{_NUMBER},\s*{_NUMBER}"
)


def read_mrk(path: Path) -> list[Photo]:
    """Read DJI's image log; photos are named by their number. Raises TrackError: it is none."""
    photos = []
    for number, line in enumerate(_text(path).splitlines(), start=1):
        if not line.strip():
            continue
        row = _MRK.match(line) if len(line) <= 500 else None
        if row is None:
            raise TrackError(f"{path}: line {number}: {line[:60]!r} is not a row of a DJI image log")
        values = [float(row[k]) for k in (2, 3, 4, 5, 6, 7, 8, 9)]
        seconds, week, lat, lon, height, north, east, up = values
        photos.append(
            Photo(
                name=f"{int(row[1]):04d}", lat_deg=lat, lon_deg=lon, alt_m=height, datum=HeightDatum.ELLIPSOID,
                time_s=7 * 86_400.0 * week + seconds, clock="GPS", horizontal_error_m=max(north, east), vertical_error_m=up,
            )
        )  # fmt: skip
    return photos


_SEXAGESIMAL = re.compile(
    r"([-+]?)([NSEW]?)\s*(\d{1,3}(?:\.\d+)?)\s*(?:deg|[°d:]|\s)?\s*(?:(\d{1,2}(?:\.\d+)?)\s*['’′m:]?\s*)?"
    r"(?:(\d{1,2}(?:\.\d+)?)\s*(?:[\"”″s]|'')?\s*)?([NSEW]?)",
    re.IGNORECASE | re.ASCII,
)
"""Sign, hemisphere, degrees, minutes, seconds, hemisphere."""
_WITH_UNIT = re.compile(r"(.+?)\s*(?:m|mm|s|deg|°)?\s*((?:above|below) sea level)?", re.IGNORECASE)
_SIXTY = 60.0
_NEGATIVE = {"lat_deg": ("s",), "lon_deg": ("w",), "alt_m": ("below", "negative", "1", "3")}
_ABOVE_ELLIPSOID = ("2", "3", "positive ellipsoid", "negative ellipsoid")
_MAY_BE_ODD = {"exposure_s", "focal_length_mm", "focal_length_35mm", "digital_zoom"}
"""Columns in which ExifTool may print words such as "undef"."""


def read_table(path: Path) -> list[Photo]:
    """Read a table with column names in its first row: at least a name, latitude, longitude and a height.

    Tables of ExifTool (``-csv``) have these, as it prints them (``8 deg 27' 55.22" N``, ``390.7 m Above Sea Level``), or as
    numbers (``-n``). Pitch is that of the camera above the horizon: -90 looks straight down.

    Raises:
        TrackError: it is none, or a number is not one.
    """
    text = _text(path)
    try:
        rows = list(sniff(text).rows(text))
    except FormatError as error:
        raise TrackError(f"{path}: {error}") from error
    if not rows:
        raise TrackError(f"{path}: the file is empty; the first row must name the columns")
    # ExifTool puts groups before names, as in "XMP:GimbalYawDegree".
    heads = [re.sub(r"[^a-z0-9]", "", head.rpartition(":")[2].casefold()) for head in rows[0][1]]

    def columns(named: Mapping[str, list[str]]) -> dict[str, int]:
        return {
            key: heads.index(next(n for n in names if n in heads))
            for key, names in named.items()
            if set(names) & set(heads)
        }

    table = read_document("uavcover/data/photo_columns.toml")
    position, references, texts = columns(table["columns"]), columns(table["references"]), columns(table["texts"])
    lacking = [key for key in ("name", "lat_deg", "lon_deg") if key not in position]
    if not {"alt_m", "alt_ellipsoid_m", "height_above_takeoff_m"} & set(position):
        lacking.append("alt_m")
    if lacking:
        raise TrackError(
            f"{path}: the file has no column for {', '.join(lacking)}; its columns are {', '.join(rows[0][1])[:100]}; "
            "use columns such as name, latitude, longitude, altitude, yaw, pitch, roll"
        )
    tables = position, references, texts
    return [
        _of_row(path, number, *({key: cells[k] if k < len(cells) else "" for key, k in of.items()} for of in tables))
        for number, cells in rows[1:]
    ]


def _of_row(
    path: Path, line: int, cells: Mapping[str, str], references: Mapping[str, str], texts: Mapping[str, str]
) -> Photo:
    numbers: dict[str, float | None] = {}
    for key in cells.keys() - {"name", "time_s"}:
        value = numbers[key] = _number(key, cells[key])
        if value is None and cells[key] not in ("", "-") and key not in _MAY_BE_ODD:
            raise TrackError(f"{path}: line {line}: {key}: {cells[key][:40]!r} is not a number")
        if value is not None and value > 0.0 and references.get(key, "").casefold().startswith(_NEGATIVE.get(key, ())):
            numbers[key] = -value
    above_ellipsoid_m = numbers.pop("alt_ellipsoid_m", None)
    by_ellipsoid = (
        finite(texts.get("rtk")) == RTK_FIXED
        or texts.get("altitude_type", "").casefold() == "rtkalt"
        or references.get("alt_m", "").casefold().startswith(_ABOVE_ELLIPSOID)
    )
    if numbers.get("alt_m") is None:
        numbers["alt_m"] = above_ellipsoid_m
        by_ellipsoid = by_ellipsoid or above_ellipsoid_m is not None
    taken = cells.get("time_s", "")
    time_s, zone_known = (finite(taken), False) if finite(taken) is not None else moment(taken)
    camera = f"{texts.get('make', '')} {texts.get('model', '')}".strip() or None
    clock = " ".join(filter(None, (path.name, camera, texts.get("serial"))))
    return Photo(
        name=cells["name"] or f"row {line}", datum=HeightDatum.ELLIPSOID if by_ellipsoid else HeightDatum.SEA_LEVEL,
        time_s=time_s, clock=None if time_s is None else "UTC" if zone_known else clock, utc_s=time_s if zone_known else None,
        camera=camera, capture_id=texts.get("capture_id") or None, pixels=_pixels(texts), **numbers,  # type: ignore[arg-type]
    )  # fmt: skip


def _number(key: str, cell: str) -> float | None:
    """A number as tables hold it: also in degrees, minutes and seconds, or with a unit."""
    value = finite(cell)
    if value is not None or len(cell) > 60:
        return value
    if key in ("lat_deg", "lon_deg"):
        return _degrees(cell, "NS" if key == "lat_deg" else "EW")
    unit = _WITH_UNIT.fullmatch(cell.partition("(")[0].strip())
    value = finite(unit[1]) if unit else None
    return -abs(value) if value is not None and unit and (unit[2] or "").casefold().startswith("below") else value


def _degrees(cell: str, hemispheres: str) -> float | None:
    found = _SEXAGESIMAL.fullmatch(cell)
    if found is None:
        return None
    sign, before, degrees, minutes, seconds, after = found.groups(default="")
    side = (before + after).upper()
    parts = [float(part or 0.0) for part in (degrees, minutes, seconds)]
    if side not in ("", *hemispheres) or (sign and side) or parts[1] >= _SIXTY or parts[2] > _SIXTY:
        return None
    if (minutes and "." in degrees) or (seconds and "." in minutes):
        return None
    value = parts[0] + parts[1] / 60.0 + parts[2] / 3600.0
    return -value if sign == "-" or side == hemispheres[1] else value


def _text(path: Path) -> str:
    if path.stat().st_size > _LARGEST:
        raise TrackError(f"{path}: the file is too large for a list of photos ({path.stat().st_size} bytes)")
    try:
        return text_from_bytes(path.read_bytes()).text
    except FormatError as error:
        raise TrackError(f"{path}: the file is not text ({error.what})") from error


# Photos in a flight log: ArduPilot's CAM and TRIG, CAMERA_FEEDBACK, PX4's camera_capture.

LOGS = (".bin", ".tlog", ".ulg")


def read_log(path: Path) -> tuple[list[Photo], tuple[str, ...]]:
    """The photos of a log, numbered in order of time, and notes on them.

    The position of a photo is the logged one, otherwise that of the vehicle at the time; its height and the attitude are those of
    the vehicle at that time.

    Raises:
        TrackError: the log is missing, has no positions, or records no photos.
    """
    rows = READERS[path.suffix.lower()](path)
    if rows.photos is None or not len(rows.photos):
        raise TrackError(
            f"{path}: the log records no photos (CAM, TRIG, CAMERA_FEEDBACK, camera_capture); use verify --log"
        )
    photos = _photos(path, rows)
    outside = len(rows.photos) - len(photos)
    words = (
        f"{path.name}: {counted(outside, 'photo was', 'photos were')} taken outside the time of the track and therefore "
        f"{'has no height; it is' if outside == 1 else 'have no height; they are'} not counted",
    )
    return photos, (*rows.warnings, *(words if outside else ()))


def reports_photos(path: Path) -> bool:
    """Whether a log reports any photo. Raises TrackError: it cannot be read."""
    photos = READERS[path.suffix.lower()](path).photos
    return photos is not None and len(photos) > 0


def _photos(path: Path, rows: LoggedRows) -> list[Photo]:
    has_fix = np.isfinite(rows.positions).all(axis=1) & (rows.positions[:, 1:3] != 0.0).any(axis=1)
    positions = rows.positions[has_fix]
    positions = positions[np.argsort(positions[:, 0], kind="stable")]
    reports: FloatArray = np.asarray(rows.photos).reshape(-1, 3)
    reports = reports[np.argsort(reports[:, 0], kind="stable")]
    inside = (
        (reports[:, 0] >= positions[0, 0]) & (reports[:, 0] <= positions[-1, 0])
        if len(positions)
        else np.zeros(len(reports), bool)
    )
    reports = reports[inside]
    if not len(reports):
        raise TrackError(f"{path}: all photos were taken outside the time of the track and therefore have no height")
    lat, lon, alt = (np.interp(reports[:, 0], positions[:, 0], positions[:, k]) for k in (1, 2, 3))
    placed = np.isfinite(reports[:, 1:]).all(axis=1) & (reports[:, 1:] != 0.0).any(axis=1)
    lat, lon = np.where(placed, reports[:, 1], lat), np.where(placed, reports[:, 2], lon)
    attitude = attitudes_at(reports[:, 0], rows.attitudes.reshape(-1, 4))
    return [
        Photo(
            name=f"{path.stem}-{k + 1:04d}", lat_deg=float(lat[k]), lon_deg=float(lon[k]), alt_m=float(alt[k]),
            time_s=float(reports[k, 0]), clock=path.name, vehicle_roll_deg=finite(attitude[k, 0]),
            vehicle_pitch_deg=finite(attitude[k, 1]), vehicle_yaw_deg=finite(attitude[k, 2]),
        )
        for k in range(len(reports))
    ]  # fmt: skip

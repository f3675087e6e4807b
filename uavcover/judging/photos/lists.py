"""Lists of pictures: ODM's ``geo.txt`` and ``images.json``, DJI's ``.MRK``, and tables (``.csv``) with a row for each picture.

Facts: the geolocation file in OpenDroneMap's documentation (projection, then name, x, y, z, three angles, two accuracies); the
image log in DJI's manuals of Zenmuse P1 and Matrice 4 (latitude, longitude and ellipsoid height are those of the camera, already
compensated; standard deviations north, east, down in metres).
"""

import csv
import io
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pyproj import CRS, Transformer
from pyproj.exceptions import CRSError

from mission_io.errors import FormatError
from mission_io.formats.text import text_from_bytes
from uavcover.errors import TrackError
from uavcover.judging.photos.picture import HeightDatum, Picture, finite

_LARGEST = 100_000_000
_SECONDS_A_WEEK = 604_800.0
_DEGREES = CRS.from_epsg(4326)


def read_geo_txt(path: Path) -> list[Picture]:
    """Of ODM's geolocation file; its angles are left out, which ODM does not use for places either.

    Raises:
        TrackError: it is none.
    """
    lines = [(number, line.split()) for number, line in enumerate(_text(path).splitlines(), start=1) if line.strip()]
    if not lines:
        raise TrackError(f"{path}: is empty; the first line names the projection, such as EPSG:4326")
    head = " ".join(lines[0][1])
    crs = _projection(head, path)
    if not (crs.is_geographic or crs.is_projected):
        raise TrackError(f"{path}: line 1: {head[:60]!r} has no places on a map; name a projection such as EPSG:4326")
    to_degrees = None if crs.is_geographic else Transformer.from_crs(crs, _DEGREES, always_xy=True)
    pictures = []
    for number, words in lines[1:]:
        values = [finite(word) for word in words[1:9]]
        if len(values) < 2 or values[0] is None or values[1] is None:
            raise TrackError(f"{path}: line {number}: {' '.join(words)[:80]!r} is not a name, x and y")
        lon, lat = (values[0], values[1]) if to_degrees is None else to_degrees.transform(values[0], values[1])
        values += [None] * (8 - len(values))
        pictures.append(
            Picture(
                name=words[0], lat_deg=finite(lat), lon_deg=finite(lon), alt_m=values[2],
                horizontal_error_m=values[6] or None, vertical_error_m=values[7] or None,
            )
        )  # fmt: skip
    return pictures


def _projection(text: str, path: Path) -> CRS:
    utm = re.fullmatch(r"WGS84 UTM (\d{1,2})([NS])", text.strip(), re.IGNORECASE)
    try:
        if utm is not None:
            return CRS.from_epsg((32600 if utm[2].upper() == "N" else 32700) + int(utm[1]))
        return CRS.from_user_input(text.strip())
    except CRSError as error:
        raise TrackError(
            f"{path}: line 1: {text[:60]!r} is no projection; it is such as EPSG:4326, WGS84 UTM 16N or a PROJ string"
        ) from error


def read_images_json(path: Path) -> list[Picture]:
    """Of the list of pictures that ODM writes.

    Raises:
        TrackError: it is none.
    """
    try:
        rows = json.loads(_text(path))
    except (ValueError, RecursionError) as error:  # ValueError also of numbers with thousands of digits
        raise TrackError(f"{path}: is not JSON ({str(error)[:100]})") from error
    if not isinstance(rows, list) or not all(isinstance(row, dict) and "filename" in row for row in rows):
        raise TrackError(f"{path}: is not ODM's list of pictures: rows with filename, latitude, longitude, altitude")
    pictures = []
    for row in rows:
        off_nadir = finite(row.get("pitch"))
        known = off_nadir is not None and finite(row.get("yaw")) is not None
        time_ms = finite(row.get("utc_time"))
        pictures.append(
            Picture(
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
    return pictures


def _pixels(row: Mapping[str, Any]) -> tuple[int, int] | None:
    width, height = finite(row.get("width")), finite(row.get("height"))
    return None if not width or not height else (int(max(width, height)), int(min(width, height)))


_NUMBER = r"([-+]?\d{1,12}(?:\.\d{0,20})?)"
_MRK = re.compile(
    rf"\s*(\d{{1,9}})\s+{_NUMBER}\s+\[(\d{{1,6}})\]\s.*?(?<![-+\d.]){_NUMBER},Lat\s+{_NUMBER},Lon\s+{_NUMBER},Ellh\s+"
    rf"{_NUMBER},\s*{_NUMBER},\s*{_NUMBER}"
)
_LONGEST_ROW = 500


def read_mrk(path: Path) -> list[Picture]:
    """Of DJI's image log; pictures are named by their number.

    Raises:
        TrackError: it is none.
    """
    pictures = []
    for number, line in enumerate(_text(path).splitlines(), start=1):
        if not line.strip():
            continue
        row = _MRK.match(line) if len(line) <= _LONGEST_ROW else None
        if row is None:
            raise TrackError(f"{path}: line {number}: {line[:60]!r} is no row of DJI's image log")
        values = [float(row[k]) for k in (2, 3, 4, 5, 6, 7, 8, 9)]
        seconds, week, lat, lon, height, north, east, up = values
        pictures.append(
            Picture(
                name=f"{int(row[1]):04d}", lat_deg=lat, lon_deg=lon, alt_m=height, datum=HeightDatum.ELLIPSOID,
                time_s=_SECONDS_A_WEEK * week + seconds, clock="GPS", horizontal_error_m=max(north, east), vertical_error_m=up,
            )
        )  # fmt: skip
    return pictures


_COLUMNS: dict[str, tuple[str, ...]] = {
    "name": ("name", "image", "imagename", "filename", "file", "label", "photo", "sourcefile"),
    "lat_deg": ("lat", "latitude", "gpslatitude", "latdeg", "y"),
    "lon_deg": ("lon", "lng", "long", "longitude", "gpslongitude", "londeg", "x"),
    "alt_m": ("alt", "altitude", "height", "elevation", "gpsaltitude", "altamslm", "altm", "z"),
    "alt_ellipsoid_m": ("ellipsoidalheight", "ellipsoidheight", "ellh", "altellipsoidm"),
    "time_s": ("time", "times", "timestamp", "seconds"),
    "yaw_deg": ("yaw", "yawdeg", "heading", "gimbalyaw", "gimbalyawdegree"),
    "pitch_deg": ("pitch", "pitchdeg", "gimbalpitch", "gimbalpitchdegree"),
    "roll_deg": ("roll", "rolldeg", "gimbalroll", "gimbalrolldegree"),
    "horizontal_error_m": ("horizontalaccuracy", "accuracyhorizontal", "gpsxyaccuracy", "horizontalerrorm"),
    "vertical_error_m": ("verticalaccuracy", "accuracyvertical", "gpszaccuracy", "verticalerrorm"),
}


def read_table(path: Path) -> list[Picture]:
    """Of a table with names of columns in its first row: at least a name, latitude, longitude and a height.

    Pitch is that of the camera above the horizon: -90 looks straight down.

    Raises:
        TrackError: it is none, or a number is not one.
    """
    text = _text(path)
    try:
        dialect: type[csv.Dialect] = csv.Sniffer().sniff(text[:4096], delimiters=",;\t")
    except csv.Error:
        dialect = csv.excel
    try:
        rows = list(csv.reader(io.StringIO(text), dialect))
    except csv.Error as error:
        raise TrackError(
            f"{path}: is no table ({error}); give rows of cells, with names of columns in the first"
        ) from error
    if not rows:
        raise TrackError(f"{path}: is empty; the first row names the columns")
    heads = [re.sub(r"[^a-z0-9]", "", head.casefold()) for head in rows[0]]
    place = {key: next((heads.index(n) for n in names if n in heads), None) for key, names in _COLUMNS.items()}
    lacking = [key for key in ("name", "lat_deg", "lon_deg") if place[key] is None]
    if place["alt_m"] is None and place["alt_ellipsoid_m"] is None:
        lacking.append("alt_m")
    if lacking:
        raise TrackError(
            f"{path}: no column for {', '.join(lacking)}; its columns are {', '.join(rows[0])[:100]}; use names such as "
            "name, latitude, longitude, altitude, yaw, pitch, roll"
        )
    pictures = []
    for number, row in enumerate(rows[1:], start=2):
        if not any(cell.strip() for cell in row):
            continue
        cells = {key: row[k].strip() if k is not None and k < len(row) else "" for key, k in place.items()}
        numbers = {key: finite(cell) for key, cell in cells.items() if key != "name"}
        wrong = [key for key, value in numbers.items() if value is None and cells[key] and key != "time_s"]
        if wrong:
            raise TrackError(f"{path}: row {number}: {wrong[0]}: {cells[wrong[0]][:40]!r} is no number")
        above_ellipsoid = numbers.pop("alt_ellipsoid_m")
        by_ellipsoid = numbers["alt_m"] is None and above_ellipsoid is not None
        if by_ellipsoid:
            numbers["alt_m"] = above_ellipsoid
        datum = HeightDatum.ELLIPSOID if by_ellipsoid else HeightDatum.SEA_LEVEL
        clock = None if numbers["time_s"] is None else path.name
        pictures.append(Picture(name=cells["name"] or f"row {number}", datum=datum, clock=clock, **numbers))  # type: ignore[arg-type]
    return pictures


def _text(path: Path) -> str:
    if path.stat().st_size > _LARGEST:
        raise TrackError(f"{path}: {path.stat().st_size} bytes are too many for a list of pictures")
    try:
        return text_from_bytes(path.read_bytes()).text
    except FormatError as error:
        raise TrackError(f"{path}: is not text ({error.what})") from error

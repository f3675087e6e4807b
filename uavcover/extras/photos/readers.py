"""Photos of folders, files, lists and flight logs, with the metadata of their files.

Metadata is EXIF, and the XMP in which DJI, Parrot, Autel, senseFly and others tell the gimbal's angles. Pillow reads it, which
opens a file without decoding its pixels. XMP properties are found by their local names: makers use the same names in namespaces
of their own. Facts: the tables of photo fields in the manuals of DJI Mavic 3M and Zenmuse P1 (angles in north-east-down, turned
yaw, pitch, roll; "absolute altitude" is geodetic; RtkFlag 50 is a fixed solution), and EXIF 3.0 (GPSAltitudeRef 2 and 3 are
heights above the ellipsoid).
"""

import hashlib
import itertools
import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePath
from typing import Any
from xml.etree import ElementTree

from PIL import ExifTags, Image, UnidentifiedImageError

from mission_io.model.plain_text import counted
from uavcover.errors import TrackError
from uavcover.extras.photos.lists import LOGS, read_geo_txt, read_images_json, read_log, read_mrk, read_table
from uavcover.extras.photos.photo import RTK_FIXED, HeightDatum, Photo, finite, moment

ENDINGS = (".jpg", ".jpeg", ".tif", ".tiff", ".dng")
_JPEG = (".jpg", ".jpeg")
_TAIL, _LONG_TAIL = 65_536, 16_000_000
_CUT_OFF = "the file is truncated; copy it again from the memory card"
_CAPTURE_IDS = ("CaptureUUID", "CaptureId", "CaptureID", "CaptureGUID")
"""Tags that identify one exposure of a multispectral camera or a rig: DJI, Parrot and MicaSense."""
_OFF_NADIR_NAMES = {"Camera:Pitch", "Camera:Roll", "Camera:Yaw"}
"""Tags of Pix4D, senseFly and MicaSense: their pitch is 0 straight down."""


def read_photo(path: Path) -> Photo:
    """Read a photo's metadata. Raises TrackError: it is no photo, or its metadata is damaged."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Pillow warns of damaged tags that are not used, and of large photos
            with Image.open(path) as image:
                exif = image.getexif()
                gps = dict(exif.get_ifd(ExifTags.IFD.GPSInfo))
                details = dict(exif.get_ifd(ExifTags.IFD.Exif))
                size = image.size
                xmp = image.info.get("xmp") or exif.get(ExifTags.Base.XMLPacket)
    except (UnidentifiedImageError, Image.DecompressionBombError) as error:
        raise TrackError(f"{path}: the photo cannot be read ({error})") from error
    except (OSError, ValueError, SyntaxError, TypeError, KeyError, ZeroDivisionError) as error:
        raise TrackError(f"{path}: the metadata is damaged ({type(error).__name__}: {error})") from error
    tags = _xmp(xmp)
    yaw, pitch, roll = _angles(tags)
    alt_m, datum = _height(gps, tags)
    sides = _sides(size, details)
    model = _model(exif)
    time_s, zone_known = _time_s(exif.get(ExifTags.Base.DateTime), details)
    serial = tags.get("DroneSerialNumber") or str(details.get(ExifTags.Base.BodySerialNumber, "")).strip("\x00 ")
    owner = " ".join(filter(None, (model or "a camera", serial)))
    return Photo(
        name=path.name,
        lat_deg=_position(_first(tags, "GpsLatitude"), _degrees(gps, 2, 1, "S")),
        lon_deg=_position(_first(tags, "GpsLongitude", "GpsLongtitude"), _degrees(gps, 4, 3, "W")),
        alt_m=alt_m,
        datum=datum,
        height_above_takeoff_m=_first(tags, "RelativeAltitude"),
        time_s=time_s,
        clock=None if time_s is None else "UTC" if zone_known else f"the clock of {owner}",
        utc_s=time_s if zone_known else _satellites_time_s(gps),
        yaw_deg=yaw,
        pitch_deg=pitch,
        roll_deg=roll,
        vehicle_yaw_deg=_first(tags, "FlightYawDegree", "DroneYawDegree"),
        horizontal_error_m=_horizontal_error_m(gps, tags),
        vertical_error_m=_first(tags, "RtkStdHgt", "GPSZAccuracy") if _is_fixed(tags) else _first(tags, "GPSZAccuracy"),
        speed_m_s=_speed_m_s(tags),
        exposure_s=finite(details.get(ExifTags.Base.ExposureTime)),
        camera=model,
        pixels=sides,
        focal_length_mm=finite(details.get(ExifTags.Base.FocalLength)) or None,
        focal_length_35mm=finite(details.get(ExifTags.Base.FocalLengthIn35mmFilm)) or None,
        capture_id=next((tags[name] for name in _CAPTURE_IDS if tags.get(name)), None),
        digital_zoom=finite(details.get(ExifTags.Base.DigitalZoomRatio)) or None,
        fault=_CUT_OFF if path.suffix.lower() in _JPEG and not _ends(path) else None,
    )


def _ends(path: Path) -> bool:
    """Whether a JPEG has its end, which entropy-coded data cannot hold: a copy that broke off has none."""
    size = path.stat().st_size
    with path.open("rb") as file:
        for tail in (_TAIL, _LONG_TAIL):
            file.seek(max(0, size - tail))
            # Some cameras fill files up with zeros.
            end = file.read().rstrip(b"\x00")
            if end:
                return b"\xff\xd9" in end[-_TAIL:]
    return False


def _xmp(packet: object) -> dict[str, str]:
    """Properties by their local names; those of Pix4D's and senseFly's "Camera" with it in front."""
    if isinstance(packet, str):
        packet = packet.encode()
    if not isinstance(packet, bytes) or len(packet) > 1_000_000:
        return {}
    text = packet.strip(b"\x00 \r\n\t")
    if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
        return {}
    begin, end = text.find(b"<x:xmpmeta"), text.rfind(b"</x:xmpmeta>")
    if begin >= 0 and end >= 0:
        text = text[begin : end + len(b"</x:xmpmeta>")]
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError):
        return {}
    found: dict[str, str] = {}
    for element in root.iter():
        pairs = [*element.attrib.items(), (element.tag, (element.text or "").strip())]
        for name, value in pairs:
            namespace, _, local = name.rpartition("}")
            of_camera = re.search(r"/camera/1\.0/?$", namespace, re.IGNORECASE) is not None
            key = f"Camera:{local}" if of_camera and local in {"Pitch", "Roll", "Yaw"} else local
            if value and key not in found:
                found[key] = value
    return found


def _first(tags: Mapping[str, str], *names: str) -> float | None:
    for name in names:
        if name in tags:
            return finite(tags[name])
    return None


def _position(of_xmp: float | None, of_exif: float | None) -> float | None:
    """XMP has more digits; some makers write 0 there."""
    return of_xmp or of_exif


def _angles(tags: Mapping[str, str]) -> tuple[float | None, float | None, float | None]:
    """Yaw, pitch and roll of the camera."""
    for prefix in ("Gimbal", "Camera"):
        yaw, pitch = _first(tags, f"{prefix}YawDegree"), _first(tags, f"{prefix}PitchDegree")
        if yaw is not None and pitch is not None:
            return yaw, pitch, _first(tags, f"{prefix}RollDegree") or 0.0
    if all(name in tags for name in _OFF_NADIR_NAMES):
        off_nadir = _first(tags, "Camera:Pitch")
        yaw, roll = _first(tags, "Camera:Yaw"), _first(tags, "Camera:Roll")
        if off_nadir is not None and yaw is not None:
            return yaw, off_nadir - 90.0, roll or 0.0
    return None, None, None


def _height(gps: Mapping[int, Any], tags: Mapping[str, str]) -> tuple[float | None, HeightDatum]:
    reference = gps.get(5, 0)
    reference = reference[0] if isinstance(reference, bytes) and reference else reference
    alt_m = finite(gps.get(6))
    # Below, where the reference is odd: 1 under sea level, 3 under the ellipsoid.
    if alt_m is not None and reference in (1, 3):
        alt_m = -abs(alt_m)
    datum = HeightDatum.ELLIPSOID if reference in (2, 3) else HeightDatum.SEA_LEVEL
    absolute = _first(tags, "AbsoluteAltitude")
    if absolute is None:
        return alt_m, datum
    by_rtk = tags.get("AltitudeType", "").lower() == "rtkalt" or _is_fixed(tags)
    return absolute, HeightDatum.ELLIPSOID if by_rtk else datum


def _is_fixed(tags: Mapping[str, str]) -> bool:
    return _first(tags, "RtkFlag") == RTK_FIXED


def _horizontal_error_m(gps: Mapping[int, Any], tags: Mapping[str, str]) -> float | None:
    if _is_fixed(tags):
        north, east = _first(tags, "RtkStdLat"), _first(tags, "RtkStdLon")
        if north is not None and east is not None:
            return max(north, east)
    accuracy = _first(tags, "GPSXYAccuracy")
    return accuracy if accuracy is not None else finite(gps.get(31))


def _speed_m_s(tags: Mapping[str, str]) -> float | None:
    north, east = _first(tags, "FlightXSpeed"), _first(tags, "FlightYSpeed")
    return None if north is None or east is None else (north**2 + east**2) ** 0.5


def _degrees(gps: Mapping[int, Any], value: int, reference: int, negative: str) -> float | None:
    parts = gps.get(value)
    if not isinstance(parts, tuple | list) or not parts:
        return None
    numbers = [finite(part) for part in parts]
    if any(number is None for number in numbers):
        return None
    degrees = sum(number / 60.0**k for k, number in enumerate(numbers) if number is not None)
    return -degrees if str(gps.get(reference, "")).strip("\x00 ").upper().startswith(negative) else degrees


def _time_s(modified: object, details: Mapping[int, Any]) -> tuple[float | None, bool]:
    """Time by the camera's clock, and whether that is Unix time: EXIF 2.31 has a zone (OffsetTimeOriginal)."""
    original = details.get(ExifTags.Base.DateTimeOriginal)
    zone = details.get(ExifTags.Base.OffsetTimeOriginal if original else ExifTags.Base.OffsetTime)
    fraction = str(details.get(ExifTags.Base.SubsecTimeOriginal, "")).strip("\x00 ")
    part = f".{fraction[:9]}" if fraction.isdecimal() and fraction.isascii() else ""
    ahead = re.fullmatch(r"[+-]\d\d:\d\d", str(zone or "").strip("\x00 "))
    return moment(str(original or modified).strip("\x00 ") + part + (ahead[0] if ahead else ""))


def _satellites_time_s(gps: Mapping[int, Any]) -> float | None:
    """Unix time of the receiver's place (GPSDateStamp, GPSTimeStamp: UTC), whole seconds with many cameras."""
    day, _ = moment(str(gps.get(29, "")).strip("\x00 ") + " 00:00:00")
    parts = gps.get(7)
    if day is None or not isinstance(parts, tuple | list) or len(parts) != 3:
        return None
    hours, minutes, seconds = (finite(part) for part in parts)
    if hours is None or minutes is None or seconds is None or not 0.0 <= hours < 24.0:
        return None
    return day + 3600.0 * hours + 60.0 * minutes + seconds


def _sides(size: tuple[int, int], details: Mapping[int, Any]) -> tuple[int, int]:
    """Longer and shorter side as it was taken, also of a smaller copy that keeps its metadata."""
    long, short = max(size), min(size)
    taken = [finite(details.get(tag)) for tag in (ExifTags.Base.ExifImageWidth, ExifTags.Base.ExifImageHeight)]
    if taken[0] and taken[1]:
        taken_long, taken_short = max(taken[0], taken[1]), min(taken[0], taken[1])
        if abs(taken_long / taken_short * short / long - 1.0) <= 0.02:
            return int(taken_long), int(taken_short)
    return long, short


def _model(exif: Image.Exif) -> str | None:
    names = [str(exif.get(tag, "")).strip("\x00 ") for tag in (ExifTags.Base.Make, ExifTags.Base.Model)]
    return " ".join(name for name in names if name) or None


LISTS: dict[str, Callable[[Path], list[Photo]]] = {
    ".txt": read_geo_txt,
    ".json": read_images_json,
    ".mrk": read_mrk,
    ".csv": read_table,
}
GEO_TXT = "geo.txt"


@dataclass(frozen=True, slots=True)
class PhotoSet:
    """All photos of a flight."""

    photos: tuple[Photo, ...]  # in order of time, clock by clock, where all tell it, otherwise of name
    notes: tuple[str, ...]  # notes for the user

    @property
    def sha256(self) -> str:
        """Hash of all data read from the photos: the basis of a verdict on them."""
        return hashlib.sha256("\n".join(map(repr, self.photos)).encode()).hexdigest()


def read_photos(sources: Sequence[Path], *, progress: Callable[[int, int], None] = lambda _d, _t: None) -> PhotoSet:
    """All photos of folders, photo files, lists and flight logs.

    Where a list names a photo that is there as a file, or a folder holds a ``geo.txt``, the list's place counts, and what the
    list does not tell is taken from the file.

    Args:
        sources: the user's paths.
        progress: receives the number of photo files that were read, and of all.

    Raises:
        TrackError: nothing is there, or it cannot be read; names the file.
    """
    files, of_folders, lists, logs = _by_kind(sources)
    notes: list[str] = []
    found: dict[str, Photo] = {}
    for number, path in enumerate(files, start=1):
        photo = _read(path) if path in of_folders else read_photo(path)
        progress(number, len(files))
        if photo.name in found:
            photo = replace(photo, name=path.as_posix())
        found[photo.name] = photo
    if files and not lists and not logs and all(photo.fault is not None for photo in found.values()):
        read_photo(files[0])  # says what is wrong with it
    files_by_name = dict(found)
    for path in lists:
        listed = LISTS[path.suffix.lower()](path)
        notes.append(f"{counted(len(listed), 'photo')} of {path.name}")
        for row in listed:
            # ExifTool's SourceFile is a path.
            file = files_by_name.pop(row.name, None) or files_by_name.pop(PurePath(row.name).name, None)
            name = _new_name(row.name, path, found) if file is None else file.name
            found[name] = replace(_joined(row, file), name=name)
    for path in logs:
        of_log, warnings = read_log(path)
        notes += [f"{counted(len(of_log), 'photo')} of {path.name}", *warnings]
        for photo in of_log:
            name = _new_name(photo.name, path, found)
            found[name] = replace(photo, name=name)
    once = _once(list(found.values()), notes)
    timed = all(photo.time_s is not None for photo in once)
    once.sort(key=lambda one: (one.clock or "", one.time_s or 0.0, one.name) if timed else ("", 0.0, one.name))
    clocks = sorted({photo.clock for photo in once if photo.clock is not None})
    if len(clocks) > 1:
        notes.append(f"times come from {len(clocks)} clocks ({', '.join(clocks[:4])}), each with its own order")
    return PhotoSet(tuple(once), tuple(notes))


def _by_kind(sources: Sequence[Path]) -> tuple[list[Path], set[Path], list[Path], list[Path]]:
    """Picture files, which of them a folder held, lists, and logs."""
    files: list[Path] = []
    of_folders: set[Path] = set()
    lists: list[Path] = []
    logs: list[Path] = []
    for source in sources:
        if source.is_dir():
            inside = sorted(path for path in source.rglob("*") if path.is_file())
            files += [path for path in inside if path.suffix.lower() in ENDINGS and not path.name.startswith("._")]
            of_folders.update(files)
            lists += [path for path in inside if path.name.lower() == GEO_TXT]
        elif not source.is_file():
            raise TrackError(f"{source}: no such file or folder; use a folder of photos, or a list of photos")
        elif source.suffix.lower() in ENDINGS:
            files.append(source)
        elif source.suffix.lower() in LISTS:
            lists.append(source)
        elif source.suffix.lower() in LOGS:
            logs.append(source)
        else:
            known = ", ".join((*ENDINGS, *LISTS, *LOGS))
            raise TrackError(
                f"{source}: {source.suffix or 'no ending'} is neither a photo nor a list of photos; use {known}"
            )
    if not files and not lists and not logs:
        raise TrackError(f"{', '.join(map(str, sources))}: no photos ({', '.join(ENDINGS)}) and no {GEO_TXT} found")
    return files, of_folders, lists, logs


def _read(path: Path) -> Photo:
    """A photo of a folder, which may hold broken ones: these do not count, and are reported."""
    try:
        return read_photo(path)
    except TrackError as error:
        return Photo(name=path.name, fault=str(error).removeprefix(f"{path}: "))


def _new_name(name: str, source: Path, taken: Mapping[str, Photo]) -> str:
    """A name that no other photo has: cards, lists and logs all begin to count at one."""
    names = itertools.chain(
        (name, f"{source.name}: {name}"), (f"{source.name}: {name} ({k})" for k in itertools.count(2))
    )
    return next(one for one in names if one not in taken)


def _joined(row: Photo, file: Photo | None) -> Photo:
    """A row of a list, completed by the photo's file."""
    if file is None:
        return row
    missing = {
        name: getattr(file, name)
        for name in Photo.__slots__
        if getattr(row, name) is None and getattr(file, name) is not None
    }
    # a list that places a photo anew does not move its height above take-off; one height is enough.
    missing.pop("height_above_takeoff_m", None)
    if row.alt_m is None and file.alt_m is not None:
        missing["datum"] = file.datum
    return replace(row, **missing)


def _once(photos: list[Photo], notes: list[str]) -> list[Photo]:
    """Omit further files of one moment, other bands of a multispectral camera, and repeated views from one position.

    Copies of a photo, and photos of a vehicle that hovers or whose receiver stands still, show no more than the first one of
    them.
    """
    moments: set[tuple[object, ...]] = set()
    views: set[tuple[object, ...]] = set()
    kept, bands, copies = [], 0, 0
    for photo in photos:
        position = (photo.lat_deg, photo.lon_deg, photo.alt_m)
        heading = photo.vehicle_yaw_deg if photo.yaw_deg is None else photo.yaw_deg
        moment, view = (*position, photo.time_s), (*position, heading, photo.pitch_deg, photo.roll_deg)
        if None in position or photo.lacks() is not None:
            kept.append(photo)
        elif photo.time_s is not None and moment in moments:
            bands += 1
        elif view in views:
            copies += 1
        else:
            moments.add(moment)
            views.add(view)
            kept.append(photo)
    if bands:
        notes.append(
            f"{bands} of {len(photos)} files have the same position and time as another file (bands of one photo) "
            "and count once"
        )
    if copies:
        notes.append(
            f"{copies} of {len(photos)} photos have the same position and direction as another photo (copies, or a "
            "receiver that did not update); they count once"
        )
    return kept

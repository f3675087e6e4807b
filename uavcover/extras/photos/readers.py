"""Pictures from what people have: folders of photos, lists of photos, flight logs."""

import hashlib
import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePath

import numpy as np

from mission_io.model.plain_text import counted
from uavcover.errors import TrackError
from uavcover.extras.photos.exif import ENDINGS, read_picture
from uavcover.extras.photos.lists import read_geo_txt, read_images_json, read_mrk, read_table
from uavcover.extras.photos.picture import Picture, finite
from uavcover.kernels.arrays import FloatArray
from uavcover.verification.track_logs.assembly import LoggedRows, attitudes_at
from uavcover.verification.track_logs.readers import READERS

# Photos in a flight log: ArduPilot's CAM and TRIG, CAMERA_FEEDBACK, PX4's camera_capture.

LOGS = (".bin", ".tlog", ".ulg")


def read_log(path: Path) -> tuple[list[Picture], tuple[str, ...]]:
    """The photos of a log, numbered in order of time, and what is to be said of it.

    A photo is where the log says that it was taken, or else where the vehicle was then; its height and the vehicle's attitude
    are those of the vehicle at that time.

    Raises:
        TrackError: no such log, without positions, or it records no photos.
    """
    rows = READERS[path.suffix.lower()](path)
    if rows.pictures is None or not len(rows.pictures):
        raise TrackError(
            f"{path}: the log records no photos (CAM, TRIG, CAMERA_FEEDBACK, camera_capture); use verify --log"
        )
    pictures = _pictures(path, rows)
    outside = len(rows.pictures) - len(pictures)
    words = (
        f"{path.name}: {counted(outside, 'photo was', 'photos were')} taken outside the time of the track and therefore "
        f"{'has no height; it is' if outside == 1 else 'have no height; they are'} not counted",
    )
    return pictures, (*rows.warnings, *(words if outside else ()))


def reports_pictures(path: Path) -> bool:
    """Whether a log reports any photo. Raises TrackError: it cannot be read."""
    pictures = READERS[path.suffix.lower()](path).pictures
    return pictures is not None and len(pictures) > 0


def _pictures(path: Path, rows: LoggedRows) -> list[Picture]:
    has_fix = np.isfinite(rows.positions).all(axis=1) & (rows.positions[:, 1:3] != 0.0).any(axis=1)
    positions = rows.positions[has_fix]
    positions = positions[np.argsort(positions[:, 0], kind="stable")]
    reports: FloatArray = np.asarray(rows.pictures).reshape(-1, 3)
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
        Picture(
            name=f"{path.stem}-{k + 1:04d}", lat_deg=float(lat[k]), lon_deg=float(lon[k]), alt_m=float(alt[k]),
            time_s=float(reports[k, 0]), clock=path.name, vehicle_roll_deg=finite(attitude[k, 0]),
            vehicle_pitch_deg=finite(attitude[k, 1]), vehicle_yaw_deg=finite(attitude[k, 2]),
        )
        for k in range(len(reports))
    ]  # fmt: skip


LISTS: dict[str, Callable[[Path], list[Picture]]] = {
    ".txt": read_geo_txt,
    ".json": read_images_json,
    ".mrk": read_mrk,
    ".csv": read_table,
}
GEO_TXT = "geo.txt"


@dataclass(frozen=True, slots=True)
class PictureSet:
    """All photos of a flight."""

    pictures: tuple[Picture, ...]  # in order of time, clock by clock, where all tell it, otherwise of name
    notes: tuple[str, ...]  # what the user should know of how they were read

    @property
    def sha256(self) -> str:
        """Hash of all that was read of the photos: the basis of a verdict on them."""
        return hashlib.sha256("\n".join(map(repr, self.pictures)).encode()).hexdigest()


def read_pictures(sources: Sequence[Path], *, progress: Callable[[int, int], None] = lambda _d, _t: None) -> PictureSet:
    """All photos of folders, photo files, lists and flight logs.

    Where a list names a photo that is there as a file, or a folder holds a ``geo.txt``, the list's place counts, and what the
    list does not tell is taken from the file.

    Args:
        sources: what the user gave.
        progress: receives the number of photo files that were read, and of all.

    Raises:
        TrackError: nothing is there, or it cannot be read; names the file.
    """
    files, of_folders, lists, logs = _by_kind(sources)
    notes: list[str] = []
    found: dict[str, Picture] = {}
    for number, path in enumerate(files, start=1):
        picture = _read(path) if path in of_folders else read_picture(path)
        progress(number, len(files))
        if picture.name in found:
            picture = replace(picture, name=path.as_posix())
        found[picture.name] = picture
    if files and not lists and not logs and all(picture.fault is not None for picture in found.values()):
        read_picture(files[0])  # says what is wrong with it
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
        for picture in of_log:
            name = _new_name(picture.name, path, found)
            found[name] = replace(picture, name=name)
    once = _once(list(found.values()), notes)
    timed = all(picture.time_s is not None for picture in once)
    once.sort(key=lambda one: (one.clock or "", one.time_s or 0.0, one.name) if timed else ("", 0.0, one.name))
    clocks = sorted({picture.clock for picture in once if picture.clock is not None})
    if len(clocks) > 1:
        notes.append(f"times come from {len(clocks)} clocks ({', '.join(clocks[:4])}), each with its own order")
    return PictureSet(tuple(once), tuple(notes))


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


def _read(path: Path) -> Picture:
    """A photo of a folder, which may hold broken ones: these do not count, and are reported."""
    try:
        return read_picture(path)
    except TrackError as error:
        return Picture(name=path.name, fault=str(error).removeprefix(f"{path}: "))


def _new_name(name: str, source: Path, taken: Mapping[str, Picture]) -> str:
    """A name that no other photo has: cards, lists and logs all begin to count at one."""
    names = itertools.chain(
        (name, f"{source.name}: {name}"), (f"{source.name}: {name} ({k})" for k in itertools.count(2))
    )
    return next(one for one in names if one not in taken)


def _joined(row: Picture, file: Picture | None) -> Picture:
    """A row of a list, with what only the photo's file tells."""
    if file is None:
        return row
    missing = {
        name: getattr(file, name)
        for name in Picture.__slots__
        if getattr(row, name) is None and getattr(file, name) is not None
    }
    # a list that places a photo anew does not move its height above take-off; one height is enough.
    missing.pop("height_above_takeoff_m", None)
    if row.alt_m is None and file.alt_m is not None:
        missing["datum"] = file.datum
    return replace(row, **missing)


def _once(pictures: list[Picture], notes: list[str]) -> list[Picture]:
    """Leave out further files of one moment, other bands of a multispectral camera, and repeated views from one position.

    Copies of a photo, and what a vehicle takes that hangs in one place or whose receiver stands still, show no more than the
    first one of them.
    """
    moments: set[tuple[object, ...]] = set()
    views: set[tuple[object, ...]] = set()
    kept, bands, copies = [], 0, 0
    for picture in pictures:
        place = (picture.lat_deg, picture.lon_deg, picture.alt_m)
        heading = picture.vehicle_yaw_deg if picture.yaw_deg is None else picture.yaw_deg
        moment, view = (*place, picture.time_s), (*place, heading, picture.pitch_deg, picture.roll_deg)
        if None in place or picture.lacks() is not None:
            kept.append(picture)
        elif picture.time_s is not None and moment in moments:
            bands += 1
        elif view in views:
            copies += 1
        else:
            moments.add(moment)
            views.add(view)
            kept.append(picture)
    if bands:
        notes.append(
            f"{bands} of {len(pictures)} files have the same position and time as another file (bands of one photo) "
            "and count once"
        )
    if copies:
        notes.append(
            f"{copies} of {len(pictures)} photos have the same position and direction as another photo (copies, or a "
            "receiver that did not update); they count once"
        )
    return kept

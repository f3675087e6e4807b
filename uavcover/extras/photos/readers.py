"""Pictures from what people have: folders of photos, lists of photos, flight logs."""

import hashlib
import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePath

from uavcover.errors import TrackError
from uavcover.extras.photos.exif import ENDINGS, read_picture
from uavcover.extras.photos.lists import read_geo_txt, read_images_json, read_mrk, read_table
from uavcover.extras.photos.logs import ENDINGS as LOGS
from uavcover.extras.photos.logs import read_log
from uavcover.extras.photos.picture import Picture

LISTS: dict[str, Callable[[Path], list[Picture]]] = {
    ".txt": read_geo_txt,
    ".json": read_images_json,
    ".mrk": read_mrk,
    ".csv": read_table,
}
GEO_TXT = "geo.txt"
_SHOWN_CLOCKS = 4


@dataclass(frozen=True, slots=True)
class PictureSet:
    """All photos of a flight.

    Attributes:
        pictures: in order of time, clock by clock, where all tell it, otherwise of name.
        notes: what the user should know of how they were read.
    """

    pictures: tuple[Picture, ...]
    notes: tuple[str, ...]

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
        notes.append(f"{len(listed)} photos of {path.name}")
        for row in listed:
            # ExifTool's SourceFile is a path.
            file = files_by_name.pop(row.name, None) or files_by_name.pop(PurePath(row.name).name, None)
            name = _new_name(row.name, path, found) if file is None else file.name
            found[name] = replace(_joined(row, file), name=name)
    for path in logs:
        of_log, warnings = read_log(path)
        notes += [f"{len(of_log)} photos of {path.name}", *warnings]
        for picture in of_log:
            name = _new_name(picture.name, path, found)
            found[name] = replace(picture, name=name)
    once = _once(list(found.values()), notes)
    timed = all(picture.time_s is not None for picture in once)
    once.sort(key=lambda one: (one.clock or "", one.time_s or 0.0, one.name) if timed else ("", 0.0, one.name))
    clocks = sorted({picture.clock for picture in once if picture.clock is not None})
    if len(clocks) > 1:
        notes.append(
            f"times come from {len(clocks)} clocks ({', '.join(clocks[:_SHOWN_CLOCKS])}): order and speed are "
            "computed for each clock"
        )
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
        raise TrackError(f"{', '.join(map(str, sources))}: there are no photos ({', '.join(ENDINGS)}) and no {GEO_TXT}")
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
    # A list that places a photo anew does not move its height above take-off; one height is enough.
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
            f"{bands} of {len(pictures)} files have the same position and time as another file (bands of one photo): "
            "they count once"
        )
    if copies:
        notes.append(
            f"{copies} of {len(pictures)} photos have the same position and direction as another photo (copies, or a "
            "receiver that did not update): they count once"
        )
    return kept

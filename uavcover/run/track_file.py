"""``track.csv``: the vehicle's messages as samples, written row by row during the flight, and read back with strict checks.

Reserved disk space keeps other programs from taking the room that the record of a flight needs.
"""

import codecs
import contextlib
import errno
import io
import math
import os
import re
import shutil
import tempfile
from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Final, Self

import numpy as np

from mission_io.errors import FormatError
from mission_io.formats.csv_tables import sniff
from mission_io.formats.text import clean_text, plain_float
from uavcover.errors import OutputError, TrackError
from uavcover.kernels.arrays import FloatArray
from uavcover.model.limits import is_flight_time
from uavcover.model.track import (
    COLUMNS,
    MAY_BE_EMPTY,
    OPTIONAL_COLUMNS,
    PHOTOS_COLUMN,
    UNIX_TIME_COLUMN,
    ReadTrack,
    Track,
    TrackSample,
)
from uavcover.run.file_group import NO_ROOM

SAMPLE_BYTES: Final = 2000
"""Size of a sample in track, telemetry log and both recordings together: measured 1.4 kB at 7 samples a second."""
SAMPLES_PER_S: Final = 10.0
"""As often as positions are requested."""
_LONGER, _SPARE_S = 2.0, 900.0
"""Factor for flights that take longer than predicted, and for transit legs."""


def record_bytes(flight_time_s: float) -> int:
    """Maximum size of a flight's record in bytes, from the predicted flight time."""
    return int((_LONGER * flight_time_s + _SPARE_S) * SAMPLES_PER_S * SAMPLE_BYTES)


class SpaceReserve:
    """Space in a folder that is reserved until it is released. A context manager.

    It is a file without a name, so a program that is killed leaves nothing behind. Where the operating system cannot reserve,
    the free space is only looked at.

    Raises:
        OutputError: there is not so much room.
    """

    def __init__(self, folder: Path, size_bytes: int) -> None:
        self._descriptor: int | None = None
        try:
            if hasattr(os, "posix_fallocate"):
                with tempfile.TemporaryFile(dir=folder) as file:
                    os.posix_fallocate(file.fileno(), 0, size_bytes)
                    self._descriptor = os.dup(file.fileno())
            elif shutil.disk_usage(folder).free < size_bytes:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        except OSError as error:
            if error.errno in NO_ROOM:
                raise OutputError(
                    f"{folder}: not enough disk space for the flight record, which may need {size_bytes / 1e6:.0f} "
                    f"MB ({error.strerror}); free some space or choose another folder; the vehicle was not armed"
                ) from None
            if shutil.disk_usage(folder).free < size_bytes:
                raise OutputError(
                    f"{folder}: cannot reserve {size_bytes / 1e6:.0f} MB for the flight record ({error.strerror})"
                ) from None

    @property
    def held(self) -> bool:
        """Whether it still keeps space free."""
        return self._descriptor is not None

    def release(self) -> None:
        """Give the space free; a second time is fine."""
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()


_WAYPOINT = COLUMNS.index("current_waypoint")


class TrackWriter:
    """Writes samples as they come; each row is in the file as soon as it is given. A context manager.

    Args:
        path: the file.
        overwrite: whether a file that is there may be replaced.
        reserve: given free when the disk is full, so that the track goes on.

    Raises:
        OutputError: the file already exists, or cannot be written.
    """

    def __init__(self, path: Path, *, overwrite: bool = False, reserve: SpaceReserve | None = None) -> None:
        self.path = path
        self.count = 0
        self._reserve = reserve
        try:
            self._file = path.open("wb" if overwrite else "xb", buffering=0)
        except FileExistsError:
            raise OutputError(f"{path}: the file already exists: use --force to replace it") from None
        except OSError as error:
            raise OutputError(f"{path}: the file cannot be written: {error.strerror}") from None
        self._write(",".join((*COLUMNS, *OPTIONAL_COLUMNS)))

    def write(self, sample: TrackSample) -> None:
        """Add a sample.

        Raises:
            OutputError: the file cannot be written any more, for instance because the disk is full.
        """
        self._write(
            ",".join(
                [
                    *(_written(float(getattr(sample, name))) for name in COLUMNS[:_WAYPOINT]),
                    str(sample.current_waypoint),
                    *(_written(float(getattr(sample, name))) for name in OPTIONAL_COLUMNS),
                ]
            )
        )
        self.count += 1

    def close(self) -> None:
        """Close the file; closing twice is fine."""
        try:
            self._file.close()
        except OSError as error:
            raise self._failed(error) from None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _write(self, line: str) -> None:
        rest = (line + "\n").encode("ascii")
        while rest:
            try:
                rest = rest[self._file.write(rest) :]
            except OSError as error:
                if self._reserve is not None and self._reserve.held:
                    self._reserve.release()
                    continue
                with contextlib.suppress(OSError):
                    self._file.close()
                raise self._failed(error) from None

    def _failed(self, error: OSError) -> OutputError:
        return OutputError(f"{self.path}: the file cannot be written after {self.count} samples: {error.strerror}")


def read_track(path: Path) -> Track:
    """The track in a file; what :func:`read_track_with_warnings` would warn of is omitted.

    Raises:
        TrackError: see :func:`read_track_with_warnings`.
    """
    return read_track_with_warnings(path).track


def read_track_with_warnings(path: Path) -> ReadTrack:
    """The track in a file, and what was omitted of it.

    Columns may stand in any order and others may stand beside them. Roll, pitch, yaw and the optional columns may be empty: not
    known. A last line that was cut off, as by a crash, is omitted with a warning. Anything else that is wrong is an error, which
    names line and column.

    Raises:
        TrackError: no such file, a column is missing, a value is missing, is not a number or not finite, a latitude or
            longitude is out of range, time does not go on, or there is no sample at all.
    """
    try:
        if (track := _plain_track(path)) is not None:
            return ReadTrack(track, ())
        data = path.read_bytes()
        text = data.decode("utf-16" if data.startswith(_UTF16) else "utf-8-sig")
    except OSError as error:
        raise TrackError(f"{path}: the file cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise TrackError(f"{path}: this is not a text file; specify a track.csv or a flight log") from None
    warnings: list[str] = []
    cut_off = bool(text) and not text.endswith("\n")
    if cut_off:
        text, _, last = text.rpartition("\n")
        warnings.append(f"{path}: the last line is incomplete and was ignored: {last[:40]!r}")
    text = clean_text(text).text
    try:
        dialect = sniff(text)
        rows = dialect.rows(text)
        _, header = next(rows, (1, []))
    except FormatError as error:
        raise TrackError(f"{path}: {error}") from error
    if twice := [name for name in (*COLUMNS, *OPTIONAL_COLUMNS) if header.count(name) > 1]:
        raise TrackError(
            f"{path}: line 1: {header.count(twice[0])} columns are named {twice[0]}; keep only one of them"
        )
    missing = [name for name in COLUMNS if name not in header]
    if missing:
        raise TrackError(
            f"{path}: line 1: the column {missing[0]} is missing (read as {dialect}); a track has {', '.join(COLUMNS)}"
        )
    warnings += [f"{path}: {repair}" for repair in dialect.repairs]
    optional = [name for name in OPTIONAL_COLUMNS if name in header]
    columns = (*COLUMNS, *optional)
    positions = {name: header.index(name) for name in columns}
    try:
        values = np.array(list(_numbers(path, rows, positions)), dtype=float).reshape(-1, len(columns))
    except FormatError as error:
        raise TrackError(f"{path}: {error}") from error
    if len(values) == 0:
        raise TrackError(f"{path}: the track has no samples")
    return ReadTrack(
        Track(
            time_s=values[:, 0].copy(),
            geodetic=values[:, 1:4].copy(),
            enu_m=values[:, 4:7].copy(),
            attitude_deg=values[:, 7:10].copy(),
            current_waypoint=values[:, _WAYPOINT].astype(np.int64),
            **{name: values[:, columns.index(name)].copy() for name in optional},
        ),
        tuple(warnings),
    )


_UTF16: Final = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
_BLOCK_BYTES: Final = 8_000_000
"""A plain table is read in blocks: a log of a thousand rows a second is 250 MB of text in a quarter of an hour."""
_NO_PLAIN_NUMBERS: Final = re.compile(rb"[^-+.,0-9eE\n]")


def _plain_track(path: Path) -> Track | None:
    """The track of a table as :class:`TrackWriter` writes it, block by block; None for any other table, and where it is wrong.

    Then :func:`read_track_with_warnings` reads it row by row, and says what is unusual and where.
    """
    with path.open("rb") as file:
        header = file.readline().decode("utf-8", "replace").rstrip("\n").split(",")
        optional = [name for name in OPTIONAL_COLUMNS if name in header]
        columns = (*COLUMNS, *optional)
        if set(header) != set(columns) or len(header) != len(columns):
            return None
        begin = file.tell()
        count = sum(block.count(b"\n") for block in iter(partial(file.read, _BLOCK_BYTES), b""))
        values = {name: np.full(count, np.nan) for name in columns}
        file.seek(begin)
        first, rest = 0, b""
        while block := file.read(_BLOCK_BYTES):
            whole, line_end, rest = (rest + block).rpartition(b"\n")
            if _NO_PLAIN_NUMBERS.search(whole):
                return None
            # Twice: neighbours share a comma.
            text = (whole + line_end).replace(b",,", b",nan,").replace(b",,", b",nan,").replace(b",\n", b",nan\n")
            try:
                rows = np.loadtxt(io.BytesIO(text), delimiter=",", comments=None, ndmin=2)
            except ValueError:
                return None
            if rows.shape[1] != len(header) or first + len(rows) > count:
                return None
            for name, column in zip(header, rows.T, strict=True):
                values[name][first : first + len(rows)] = column
            first += len(rows)
    if rest or first != count or count == 0 or not _is_plausible(values):
        return None
    known = {name: values[name] for name in optional if np.isfinite(values[name]).any()}
    return Track(
        time_s=values["time_s"],
        geodetic=np.column_stack([values.pop(name) for name in COLUMNS[1:4]]),
        enu_m=np.column_stack([values.pop(name) for name in COLUMNS[4:7]]),
        attitude_deg=np.column_stack([values.pop(name) for name in COLUMNS[7:10]]),
        current_waypoint=values["current_waypoint"].astype(np.int64),
        **known,
    )


def _is_plausible(values: Mapping[str, FloatArray]) -> bool:
    """Whether the columns of a track keep what :func:`_numbers` checks row by row."""
    if any(np.isinf(column).any() for column in values.values()):
        return False
    if any(np.isnan(column).any() for name, column in values.items() if name not in MAY_BE_EMPTY):
        return False
    waypoint, unknown = values["current_waypoint"], np.full(1, np.nan)
    photos, unix_s = values.get(PHOTOS_COLUMN, unknown), values.get(UNIX_TIME_COLUMN, unknown)
    photos, unix_s = photos[np.isfinite(photos)], unix_s[np.isfinite(unix_s)]
    return bool(
        (np.diff(values["time_s"]) > 0.0).all()
        and (np.abs(values["lat_deg"]) <= 90.0).all()
        and (np.abs(values["lon_deg"]) <= 180.0).all()
        and (waypoint == np.floor(waypoint)).all()
        and ((photos >= 0.0) & (photos == np.floor(photos))).all()
        and (unix_s.size == 0 or (is_flight_time(float(unix_s.min())) and is_flight_time(float(unix_s.max()))))
    )


def _numbers(path: Path, rows: Iterable[tuple[int, list[str]]], positions: dict[str, int]) -> Iterable[list[float]]:
    """The values of each row at these columns, in order, each checked."""
    before_s = -math.inf
    for line, row in rows:
        values = [_number(path, line, name, row, position) for name, position in positions.items()]
        time_s, lat_deg, lon_deg = values[:3]
        if time_s <= before_s:
            raise TrackError(f"{path}: line {line}, time_s: {time_s!r} is not later than the previous {before_s!r}")
        if not (abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0):
            raise TrackError(f"{path}: line {line}, lat_deg: {lat_deg!r}, {lon_deg!r} is not a position on Earth")
        if not values[_WAYPOINT].is_integer():
            raise TrackError(f"{path}: line {line}, current_waypoint: {values[_WAYPOINT]!r} is not a whole number")
        named = dict(zip(positions, values, strict=True))
        photos = named.get(PHOTOS_COLUMN, 0.0)
        if not (math.isnan(photos) or (photos >= 0.0 and photos.is_integer())):
            raise TrackError(f"{path}: line {line}, {PHOTOS_COLUMN}: {photos!r} is not a number of photos")
        unix_s = named.get(UNIX_TIME_COLUMN, math.nan)
        if not (math.isnan(unix_s) or is_flight_time(unix_s)):
            raise TrackError(f"{path}: line {line}, {UNIX_TIME_COLUMN}: {unix_s!r} is not a time since 1970")
        before_s = time_s
        yield values


def _written(value: float) -> str:
    """The shortest text that reads as the number; nothing when it is not known."""
    return "" if math.isnan(value) else repr(value)


def _number(path: Path, line: int, name: str, row: list[str], position: int) -> float:
    if position >= len(row):
        raise TrackError(f"{path}: line {line}, {name}: the value is missing; the line has {len(row)} values")
    if name in MAY_BE_EMPTY and not row[position].strip():
        return math.nan
    try:
        value = plain_float(row[position].strip())
    except ValueError:
        raise TrackError(f"{path}: line {line}, {name}: {row[position]!r} is not a number") from None
    if not math.isfinite(value):
        raise TrackError(f"{path}: line {line}, {name}: {row[position]!r} is not a finite number")
    return value

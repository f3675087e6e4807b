"""Reads recordings without a viewer."""

import struct
import tempfile
import warnings
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rerun.chunk import Chunk, RrdReader
from rerun.error_utils import RerunWarning

from uavcover.model.track import COLUMNS, OPTIONAL_COLUMNS, ReadTrack, Track
from uavcover.recording import layout
from uavcover.recording.layout import RecordingError

Columns = dict[str, NDArray[Any]]

_FRAME = struct.Struct("<QQ")


@dataclass(frozen=True, slots=True)
class RecordingRow:
    """Summary of one entity of a recording."""

    entity: str  # its path; the coverage tiles are one row that ends in ``*``
    timelines: tuple[str, ...]  # names of its timelines, empty for static data
    samples: int  # rows in time, or 1 for static data
    start_s: float | None  # first time on the recording's own timeline, none for static data
    end_s: float | None  # last time


def read_recorded_track(path: str | Path) -> Track:
    """Read the track of a recording, exactly as written; see :func:`read_recorded_track_with_warnings`."""
    return read_recorded_track_with_warnings(path).track


def read_recorded_track_with_warnings(path: str | Path) -> ReadTrack:
    """Read the track of a recording, exactly as written.

    If the writer was killed in flight, the track up to about a second before, and a warning.

    Raises:
        RecordingError: unreadable, truncated, or without a track.
    """
    parts: list[Columns] = []
    count: int | None = None
    warning: tuple[str, ...] = ()
    for chunk in _chunks(Path(path)):
        if chunk.entity_path != layout.TRACK:
            continue
        if chunk.is_static:
            count = next((int(values[0]) for values in _columns(chunk, (layout.SAMPLE_COUNT,)).values()), count)
            if _columns(chunk, (layout.UNFINISHED,)):
                warning = (f"{path}: the recording ends in flight; only the recorded part is used",)
        else:
            part = _columns(chunk, (*COLUMNS, *OPTIONAL_COLUMNS))
            parts += [part] if part.keys() >= {*COLUMNS} else []
    if warning and not parts:
        raise RecordingError(f"{path}: the recording ends before its first sample; use track.csv in the same folder")
    if (count is None and not warning) or not parts:
        raise RecordingError(f"{path}: the recording contains no uavcover track")
    columns = {
        name: np.concatenate([part.get(name, np.full(part["time_s"].size, np.nan)) for part in parts])
        for name in (*COLUMNS, *OPTIONAL_COLUMNS)
    }
    order = np.argsort(columns["time_s"], kind="stable")
    if count is not None and order.size != count:
        raise RecordingError(f"{path}: the recording is damaged: only {order.size} of {count} track samples are left")
    columns = {name: values[order] for name, values in columns.items()}
    track = Track(
        time_s=columns["time_s"],
        geodetic=np.column_stack([columns[name] for name in COLUMNS[1:4]]),
        enu_m=np.column_stack([columns[name] for name in COLUMNS[4:7]]),
        attitude_deg=np.column_stack([columns[name] for name in COLUMNS[7:10]]),
        current_waypoint=columns["current_waypoint"].astype(np.int64),
        **{name: columns[name] for name in OPTIONAL_COLUMNS},
    )
    return ReadTrack(track, warning)


def describe_recording(path: str | Path) -> list[RecordingRow]:
    """List the entities of a recording in order of their paths. Raises RecordingError: unreadable or truncated."""
    times_s: dict[str, list[NDArray[np.float64]]] = defaultdict(list)
    timelines: dict[str, set[str]] = defaultdict(set)
    samples: dict[str, int] = defaultdict(int)
    for chunk in _chunks(Path(path)):
        entity = chunk.entity_path
        if entity.startswith(f"{layout.COVERAGE}/"):
            entity = f"{layout.COVERAGE}/*"
        samples[entity] += 0 if chunk.is_static else chunk.num_rows
        timelines[entity].update(() if chunk.is_static else chunk.timeline_names)
        if layout.TIMELINE in timelines[entity] and not chunk.is_static:
            times_s[entity].append(_times_s(chunk))
    rows = []
    for entity in sorted(samples):
        span = np.concatenate(times_s[entity]) if times_s[entity] else np.empty(0)
        start_s, end_s = (float(span.min()), float(span.max())) if span.size else (None, None)
        rows.append(RecordingRow(entity, tuple(sorted(timelines[entity])), max(samples[entity], 1), start_s, end_s))
    return rows


def check_finished(path: Path) -> None:
    """Check that a recording is complete. Raises RecordingError: unreadable or truncated."""
    for _ in _chunks(path):
        return
    raise RecordingError(f"{path}: the recording is empty")


def _chunks(path: Path) -> Iterator[Chunk]:
    """All chunks of the first recording in a file: by its manifest, or one by one in an unfinished file."""
    if not path.is_file():
        raise RecordingError(f"{path}: no such file")
    try:
        with warnings.catch_warnings():
            # Of a file without a manifest rerun warns first; that it cannot be opened then says the same.
            warnings.simplefilter("ignore", RerunWarning)
            reader = RrdReader(path)
            if not reader.recordings():
                raise RecordingError(f"{path}: the file contains no recording")
            chunks = reader.store().stream()
        yield from chunks
    except (ValueError, OSError, RuntimeError) as error:
        left = _chunks_until_cut(path)
        if left:
            yield from left
            return
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise RecordingError(
            f"{path}: this is not a complete rerun recording ({reason}); if the program that wrote it was killed, "
            f"`rerun rrd optimize {path} -o repaired.rrd` recovers the written part"
        ) from error


def _chunks_until_cut(path: Path) -> list[Chunk]:
    """The chunks of an unfinished recording as far as its messages are complete; empty for any other file."""
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore", RerunWarning)
        whole = Path(folder) / "whole.rrd"
        data = path.read_bytes()
        whole.write_bytes(data[: whole_messages(data)])
        try:
            chunks = list(RrdReader(whole).stream())
        except (ValueError, OSError, RuntimeError):
            return []
    begun = any(c.entity_path == layout.TRACK and c.is_static and _columns(c, (layout.UNFINISHED,)) for c in chunks)
    return chunks if begun else []


def whole_messages(data: bytes) -> int:
    """Number of bytes of a recording's header and complete messages.

    Each message follows its kind and its length, both little-endian 64-bit numbers, after a header of 12 bytes
    (rerun-sdk 0.41, the version that wrote it).
    """
    end = 12
    while end + _FRAME.size <= len(data):
        _, length = _FRAME.unpack_from(data, end)
        if end + _FRAME.size + length > len(data):
            break
        end += _FRAME.size + length
    return end


def _columns(chunk: Chunk, names: Iterable[str]) -> Columns:
    """The named components present in a chunk, each (rows,) with one value a row."""
    batch = chunk.to_record_batch()
    present = set(batch.schema.names)
    return {name: batch.column(name).flatten().to_numpy(zero_copy_only=False) for name in names if name in present}


def _times_s(chunk: Chunk) -> NDArray[np.float64]:
    nanoseconds = chunk.to_record_batch().column(layout.TIMELINE).cast("int64").to_numpy(zero_copy_only=False)
    return np.asarray(nanoseconds, float) / 1e9

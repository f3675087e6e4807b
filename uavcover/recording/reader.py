"""Reading a recording without a viewer."""

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

from uavcover.model.track import COLUMNS, Track
from uavcover.recording import layout
from uavcover.recording.errors import RecordingError

Columns = dict[str, NDArray[Any]]


@dataclass(frozen=True, slots=True)
class RecordingRow:
    """What is known of one entity of a recording.

    Attributes:
        entity: its path; the tiles of the coverage are one row that ends in ``*``.
        timelines: names of the timelines it is on, empty for what does not change.
        samples: rows in time, or 1 for what does not change.
        start_s: first time on the recording's own timeline, none for what does not change.
        end_s: last time.
    """

    entity: str
    timelines: tuple[str, ...]
    samples: int
    start_s: float | None
    end_s: float | None


def read_recorded_track(path: str | Path) -> Track:
    """The track of a recording, exactly as it was written.

    Raises:
        RecordingError: no readable recording, cut off, or without a track.
    """
    parts: list[Columns] = []
    count: int | None = None
    for chunk in _chunks(Path(path)):
        if chunk.entity_path != layout.TRACK:
            continue
        if chunk.is_static:
            count = next((int(values[0]) for values in _columns(chunk, (layout.SAMPLE_COUNT,)).values()), count)
        else:
            part = _columns(chunk, COLUMNS)
            parts += [part] if len(part) == len(COLUMNS) else []
    if count is None or not parts:
        raise RecordingError(f"{path}: a recording, but without a track of uavcover")
    columns = {name: np.concatenate([part[name] for part in parts]) for name in COLUMNS}
    order = np.argsort(columns["time_s"], kind="stable")
    if order.size != count:
        raise RecordingError(
            f"{path}: the recording is damaged: {order.size} of {count} samples of the track are there"
        )
    columns = {name: values[order] for name, values in columns.items()}
    return Track(
        time_s=columns["time_s"],
        geodetic=np.column_stack([columns[name] for name in COLUMNS[1:4]]),
        enu_m=np.column_stack([columns[name] for name in COLUMNS[4:7]]),
        attitude_deg=np.column_stack([columns[name] for name in COLUMNS[7:10]]),
        current_waypoint=columns["current_waypoint"].astype(np.int64),
    )


def describe_recording(path: str | Path) -> list[RecordingRow]:
    """What is in a recording, in order of the entities' paths.

    Raises:
        RecordingError: no readable recording, or cut off.
    """
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
    """Make sure that a recording is whole: its writer came to the end.

    Raises:
        RecordingError: no readable recording, or cut off.
    """
    for _ in _chunks(path):
        return
    raise RecordingError(f"{path}: the recording is empty")


def _chunks(path: Path) -> Iterator[Chunk]:
    """All chunks of the first recording in a file, by the manifest at its end."""
    if not path.is_file():
        raise RecordingError(f"{path}: no such file")
    try:
        with warnings.catch_warnings():
            # Of a file without a manifest rerun warns first; that it cannot be opened then says the same.
            warnings.simplefilter("ignore", RerunWarning)
            reader = RrdReader(path)
            if not reader.recordings():
                raise RecordingError(f"{path}: no recording in this file")
            chunks = reader.store().stream()
        yield from chunks
    except (ValueError, OSError, RuntimeError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise RecordingError(
            f"{path}: not a whole rerun recording ({reason}); if its writer was killed, "
            f"`rerun rrd optimize {path} -o repaired.rrd` keeps what was written"
        ) from error


def _columns(chunk: Chunk, names: Iterable[str]) -> Columns:
    """Those of the named components that a chunk has, each (rows,); its rows hold one value each."""
    batch = chunk.to_record_batch()
    present = set(batch.schema.names)
    return {name: batch.column(name).flatten().to_numpy(zero_copy_only=False) for name in names if name in present}


def _times_s(chunk: Chunk) -> NDArray[np.float64]:
    nanoseconds = chunk.to_record_batch().column(layout.TIMELINE).cast("int64").to_numpy(zero_copy_only=False)
    return np.asarray(nanoseconds, float) / 1e9

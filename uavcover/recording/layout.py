"""Layout of a recording, and reading one without a viewer."""

import contextlib
import hashlib
import re
import struct
import tempfile
import warnings
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import rerun as rr
from numpy.typing import ArrayLike, NDArray
from rerun.chunk import Chunk, RrdReader
from rerun.error_utils import RerunWarning
from rerun_bindings import flush_and_cleanup_orphaned_recordings

from mission_io.data_tables import data_table
from uavcover.errors import InputError
from uavcover.model.track import COLUMNS, OPTIONAL_COLUMNS, ReadTrack, Track

if TYPE_CHECKING:
    from uavcover.scenario.site import Site

# Sizes and times of recordings; ``data/recording.toml`` explains each.


@dataclass(frozen=True, slots=True, kw_only=True)
class _Scene:
    max_nodes_per_side: int
    texture_pixels: int
    max_labels: int
    outline_pieces_per_side: int
    tick_s: float
    tile_side_cells: int
    directions: int
    steps: int
    level_cos: float
    vehicle_step_s: float
    heading_fraction: float
    camera_edges: int
    piece_s: float
    longest_name: int


@dataclass(frozen=True, slots=True, kw_only=True)
class _Views:
    played_in_s: float
    tile_pixels: float
    map_pixels: float
    link_window_s: float
    period_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Viewer:
    start_timeout_s: float
    load_timeout_s: float
    poll_s: float
    settle_s: float
    ending_s: float


SCENE = data_table(_Scene, "uavcover/data/recording.toml", "scene")
VIEWS = data_table(_Views, "uavcover/data/recording.toml", "views")
VIEWER = data_table(_Viewer, "uavcover/data/recording.toml", "viewer")


_NOT_IN_ENTRY_NAMES = re.compile(r"[^A-Za-z0-9 _:-]")


class RecordingError(InputError):
    """A recording that cannot be written as asked, read, or shown."""


TIMELINE: Final = "mission_time"
"""Vehicle time, as a duration."""

WORLD: Final = "/world"
TERRAIN: Final = f"{WORLD}/terrain"
AREA: Final = f"{WORLD}/area"
FENCE: Final = f"{WORLD}/fence"
OBSTACLES: Final = f"{WORLD}/obstacles"
NO_FLY: Final = f"{WORLD}/no_fly"
HOME: Final = f"{WORLD}/home"
PLANNED: Final = f"{WORLD}/planned"
WAYPOINTS: Final = f"{PLANNED}/waypoints"
FLOWN: Final = f"{WORLD}/flown"
VEHICLE: Final = f"{WORLD}/vehicle"
HEADING: Final = f"{VEHICLE}/heading"
FOOTPRINT: Final = f"{WORLD}/footprint"
CAMERA: Final = f"{WORLD}/camera"
COVERAGE: Final = f"{WORLD}/coverage"

MAP: Final = "/map"
MAP_FLOWN: Final = f"{MAP}/flown"
MAP_VEHICLE: Final = f"{MAP}/vehicle"

SERIES: Final = "/series"
HEIGHT_AGL: Final = f"{SERIES}/height/above_ground_m"
HEIGHT_MIN: Final = f"{SERIES}/height/lowest_allowed_m"
HEIGHT_MAX: Final = f"{SERIES}/height/highest_allowed_m"
OBSERVED: Final = f"{SERIES}/coverage/seen_percent"
OBSERVED_COVERABLE: Final = f"{SERIES}/coverage/seen_of_coverable_percent"
GROUND_SPEED: Final = f"{SERIES}/speed/ground_m_s"
CLIMB_SPEED: Final = f"{SERIES}/speed/climb_m_s"
BATTERY_PERCENT: Final = f"{SERIES}/battery/left_percent"
BATTERY_V: Final = f"{SERIES}/battery/volts"
LINK_LOST: Final = f"{SERIES}/link/lost_percent"
LINK_RATE: Final = f"{SERIES}/link/messages_a_second"

EVENTS: Final = "/events"
LEGEND: Final = "/legend"
TRACK: Final = "/track"
"""The track in float64, one component for each column of ``track.csv``."""

SAMPLE_COUNT: Final = "sample_count"
"""Static component of ``TRACK``: number of samples written, by which a reader detects a truncated recording."""

UNFINISHED: Final = "unfinished"
"""Static component of ``TRACK`` in a recording made during the flight."""

CELL_NUMBERS: Final = "cell_numbers"
"""Static component of every coverage tile: which cells of the area its points are."""

Rgb = tuple[int, int, int]

NO_FLY_RGB: Final[Rgb] = (224, 36, 160)
OBSTACLE_RGB: Final[Rgb] = (142, 111, 193)
PLANNED_RGB: Final[Rgb] = (255, 255, 255)
FLOWN_RGB: Final[Rgb] = (255, 196, 0)
VEHICLE_RGB: Final[Rgb] = (255, 64, 64)
FOOTPRINT_RGB: Final[Rgb] = (64, 224, 255)
CAMERA_RGB: Final[Rgb] = (170, 240, 255)
AREA_RGB: Final[Rgb] = (120, 190, 255)
FENCE_RGB: Final[Rgb] = (255, 128, 64)
HOME_RGB: Final[Rgb] = (255, 64, 192)
CEILING_RGB: Final[Rgb] = (255, 48, 72)
FLOOR_RGB: Final[Rgb] = (190, 120, 255)
LOST_RGB: Final[Rgb] = (255, 96, 64)
OBSERVED_RGB: Final[Rgb] = (46, 204, 113)
UNOBSERVED_RGB: Final[Rgb] = (118, 124, 140)
NOT_COVERABLE_RGB: Final[Rgb] = (86, 48, 92)


def log_static(recording: rr.RecordingStream, entity: str, *parts: rr.AsComponents) -> None:
    """Log static data.

    Single calls go through a batching thread and columns do not; without waiting for it here, two recordings of one
    flight would hold the same chunks in another order.
    """
    recording.log(entity, *parts, static=True)
    recording.flush()


def nanoseconds(time_s: ArrayLike) -> NDArray[np.timedelta64]:
    """Durations (n,) to the nearest nanosecond."""
    return np.rint(np.asarray(time_s, float) * 1e9).astype("timedelta64[ns]")


def time_column(time_s: ArrayLike) -> rr.TimeColumn:
    """Vehicle times (n,) in seconds on the timeline of recordings."""
    return rr.TimeColumn(TIMELINE, duration=nanoseconds(time_s))


def ui_points(size: float) -> rr.components.Radius:
    """A radius in screen points at any distance; rerun recognises it by its sign."""
    return rr.components.Radius(-size)


def any_values(values: Mapping[str, NDArray[Any]]) -> rr.AnyValues:
    """Components of our own, by name."""
    return rr.AnyValues(True, **values)


def any_value_columns(columns: Mapping[str, NDArray[Any]]) -> rr.ComponentColumnList:
    """Components of our own by name, each (n,) with one value in a row."""
    return rr.AnyValues.columns(True, **columns)


def open_stream(site: "Site", recording_id: str) -> rr.RecordingStream:
    """A stream for a recording of a scenario. The threads of those that were disconnected before end here."""
    flush_and_cleanup_orphaned_recordings()
    return rr.RecordingStream(application_id(site), recording_id=recording_id, send_properties=False)


def application_id(site: "Site") -> str:
    """The application id determines which blueprint the viewer applies, so each scenario has its own.

    Rerun takes ASCII letters, digits, spaces, "-", "_" and ":", and few of them; it would warn of any other name and change it.
    """
    name = site.scenario.name
    plain = _NOT_IN_ENTRY_NAMES.sub("-", name)[: SCENE.longest_name]
    return f"uavcover_{name if plain == name else f'{plain}-{hashlib.sha256(name.encode()).hexdigest()[:8]}'}"


@contextlib.contextmanager
def strict_mode() -> Iterator[None]:
    """Inside the block, wrong calls of rerun raise instead of being logged."""
    before = rr.error_utils.strict_mode()
    rr.set_strict_mode(True)
    try:
        yield
    finally:
        rr.set_strict_mode(before)


Columns = dict[str, NDArray[Any]]

_FRAME = struct.Struct("<QQ")


@dataclass(frozen=True, slots=True)
class RecordingRow:
    """Summary of one entity of a recording."""

    entity: str  # its path; the coverage tiles are one row that ends in ``*``
    timelines: tuple[str, ...]  # names of its timelines, empty for static data
    samples: int  # rows in time, or 1 for static data
    start_s: float | None  # first time on the recording's own timeline, None for static data
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
        if chunk.entity_path != TRACK:
            continue
        if chunk.is_static:
            count = next((int(values[0]) for values in _columns(chunk, (SAMPLE_COUNT,)).values()), count)
            if _columns(chunk, (UNFINISHED,)):
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
        if entity.startswith(f"{COVERAGE}/"):
            entity = f"{COVERAGE}/*"
        samples[entity] += 0 if chunk.is_static else chunk.num_rows
        timelines[entity].update(() if chunk.is_static else chunk.timeline_names)
        if TIMELINE in timelines[entity] and not chunk.is_static:
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
    begun = any(c.entity_path == TRACK and c.is_static and _columns(c, (UNFINISHED,)) for c in chunks)
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
    nanoseconds = chunk.to_record_batch().column(TIMELINE).cast("int64").to_numpy(zero_copy_only=False)
    return np.asarray(nanoseconds, float) / 1e9

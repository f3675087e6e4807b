"""Writes the recording of a whole flight."""

import contextlib
import hashlib
import itertools
import os
import uuid
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from mission_io.model.plain_text import plain_text
from uavcover.errors import OutputError
from uavcover.kernels.arrays import FloatArray
from uavcover.model.route import Route
from uavcover.model.track import Track
from uavcover.recording import flight, layout
from uavcover.recording.blueprint import begin_recording
from uavcover.recording.layout import (
    SCENE,
    RecordingError,
    log_static,
    open_stream,
    strict_mode,
    time_column,
    ui_points,
)
from uavcover.recording.reader import check_finished
from uavcover.recording.vehicle import draw_vehicle, send_vehicle
from uavcover.sensing.coverage_map import CoverageMap

_NAMESPACE = uuid.UUID("2d1f7b1e-7c1f-4a7c-9f0c-2f6b8d6f5a90")


def write_recording(
    path: str | Path,  # the file, ``flight.rrd`` in a run folder
    *,
    coverage: CoverageMap,  # the cells of a site, the ones that ``first_seen_s`` counts
    planned: Route | None,  # the planned sensing route, if there is one
    track: Track,  # the flown track
    # (cells,) vehicle time at which each cell was seen first, NaN or infinite where it never was. With ``first =
    # coverage.first_seen(observations)`` of one observation a sample: ``np.where(first >= 0, track.time_s[first],
    # np.nan)``.
    first_seen_s: NDArray[np.float64],
    events: Iterable[flight.RecordedEvent] = (),  # events of the flight, in any order
    states: Iterable[flight.VehicleState] = (),  # states of battery and link, in any order
    name: str | None = None,  # name of the run, shown in the viewer; default: the scenario's name
) -> None:
    """Write a flight as a recording for the rerun viewer, with its blueprint.

    The file is written beside its final name and renamed when complete. An existing file is
    replaced. Equal arguments give recordings that ``rerun rrd compare`` calls equal (their bytes differ).

    Raises:
        RecordingError: the track is empty or its time does not increase, or ``first_seen_s`` does not fit.
        OutputError: the file cannot be written.
    """
    _check(coverage, track, first_seen_s)
    site = coverage.site
    name = plain_text(name or site.scenario.name)
    span_s = (float(track.time_s[0]), float(track.time_s[-1]))
    recording_id = _recording_id(name, track)
    with _written(Path(path), coverage, planned, name=name, recording_id=recording_id, span_s=span_s) as recording:
        flight.log_coverage(recording, coverage, span_s, first_seen_s)
        flight.log_series(recording, coverage, track)
        draw_vehicle(recording, coverage)
        send_vehicle(recording, coverage, track)
        flight.log_states(recording, sorted(states, key=lambda state: state.time_s))
        flight.log_events(recording, events)
        flight.log_track(recording, track)


@contextlib.contextmanager
def _written(
    path: Path, coverage: CoverageMap, planned: Route | None, *, name: str, recording_id: str, span_s: tuple[float, float],
    paths: Sequence[str] = (layout.FLOWN,),
) -> Iterator[rr.RecordingStream]:  # fmt: skip
    """A recording with its layout and scene; what is logged inside is written when it is complete."""
    with strict_mode():
        recording = open_stream(coverage.site, recording_id)
        memory = recording.memory_recording()
        begin_recording(recording, coverage, planned, name=name, span_s=span_s, paths=paths)
        yield recording
        data = memory.drain_as_bytes()
    write_whole(path, data)


def _check(coverage: CoverageMap, track: Track, first_seen_s: NDArray[np.float64]) -> None:
    if len(track) == 0:
        raise RecordingError("the track has no samples; there is nothing to record")
    standing = np.flatnonzero(~(np.diff(track.time_s) > 0.0))
    if standing.size or not np.isfinite(track.time_s[0]):
        where = int(standing[0]) + 1 if standing.size else 0
        raise RecordingError(f"the time of the track does not increase at sample {where}")
    if first_seen_s.shape != (coverage.grid.count,):
        raise RecordingError(
            f"first_seen_s has shape {first_seen_s.shape}, not one time for each of {coverage.grid.count} cells"
        )
    seen_s = first_seen_s[np.isfinite(first_seen_s)]
    if seen_s.size and not (track.time_s[0] <= seen_s.min() and seen_s.max() <= track.time_s[-1]):
        raise RecordingError(
            f"first_seen_s reaches from {seen_s.min():g} to {seen_s.max():g} s, outside the flight, which lasts from "
            f"{track.time_s[0]:g} to {track.time_s[-1]:g} s"
        )


def _recording_id(name: str, track: Track) -> str:
    """An id unique to the flight and run, and reproducible: recordings with one id would merge in the viewer."""
    digest = hashlib.sha256(name.encode())
    for column in flight.track_columns(track).values():
        digest.update(column.tobytes())
    return str(uuid.uuid5(_NAMESPACE, digest.hexdigest()))


def write_whole(path: Path, data: bytes) -> None:
    """Write beside ``path``, then rename.

    Rerun's own file sink only logs a line when the disk is full, and its next flush blocks forever.
    """
    unfinished = path.with_name(f".{path.name}.{os.getpid()}.unfinished")
    try:
        unfinished.write_bytes(data)
        check_finished(unfinished)
        os.replace(unfinished, path)
    except OSError as error:
        raise OutputError(f"{path}: the recording cannot be written ({error.strerror or error})") from error
    finally:
        with contextlib.suppress(OSError):
            unfinished.unlink(missing_ok=True)


# The recording of a fleet: all flights on one clock, the observed cells, and the separation of the vehicles.

_FLEETS = uuid.UUID("1a0f3a7e-90c6-4c0b-8e7d-54d7a4a5b9c3")
_COLOURS: tuple[layout.Rgb, ...] = (
    layout.FLOWN_RGB, (96, 200, 255), (255, 120, 170), (150, 255, 120), (220, 160, 255), (255, 160, 90),
)  # fmt: skip


def record_fleet(
    path: Path,  # the file
    *,
    coverage: CoverageMap,  # the cells of the site
    planned: Route,  # the whole route
    # by name, (n,) increasing times on the clock that all share, and (n, 3) ENU positions
    tracks: Mapping[str, tuple[FloatArray, FloatArray]],
    # (cells,) time on that clock at which each cell was seen first, NaN where it never was
    first_seen_s: NDArray[np.float64],
) -> None:
    """Write all flights of a fleet as one recording for the rerun viewer; an existing file is replaced.

    Raises:
        RecordingError: there is no track.
        OutputError: the file cannot be written.
    """
    if not tracks:
        raise RecordingError("there is no track to record")
    site = coverage.site
    span_s = (min(float(t[0]) for t, _ in tracks.values()), max(float(t[-1]) for t, _ in tracks.values()))
    paths = [f"{layout.FLOWN}/{_entity(name)}" for name in tracks]
    name = plain_text(f"{site.scenario.name}, {len(tracks)} flights")
    digest = hashlib.sha256(b"".join(t.tobytes() + p.tobytes() for t, p in tracks.values())).hexdigest()
    recording_id = str(uuid.uuid5(_FLEETS, f"{name}{digest}"))
    with _written(
        path, coverage, planned, name=name, recording_id=recording_id, span_s=span_s, paths=paths
    ) as recording:
        flight.log_coverage(recording, coverage, span_s, first_seen_s)
        for number, (title, (time_s, enu_m)) in enumerate(tracks.items()):
            _log_flight(recording, coverage, title, time_s, enu_m, _COLOURS[number % len(_COLOURS)])


def _entity(name: str) -> str:
    return name.replace(" ", "_").replace(",", "")


def _log_flight(
    recording: rr.RecordingStream,
    coverage: CoverageMap,
    name: str,
    time_s: FloatArray,
    enu_m: FloatArray,
    rgb: layout.Rgb,
) -> None:
    entity = _entity(name)
    path, place = f"{layout.FLOWN}/{entity}", f"{layout.VEHICLE}/{entity}"
    log_static(recording, path, rr.LineStrips3D.from_fields(colors=[rgb], radii=ui_points(2.5)))
    log_static(recording, place, rr.Points3D.from_fields(colors=[rgb], radii=ui_points(6.0), labels=[name]))
    recording.send_columns(place, [time_column(time_s)], rr.Points3D.columns(positions=enu_m))
    ends = _pieces(time_s)
    strips = [enu_m[a : b + 1] for a, b in itertools.pairwise(ends)]
    if strips:
        recording.send_columns(path, [time_column(time_s[ends[1:]])], rr.LineStrips3D.columns(strips=strips))
    series = f"{layout.SERIES}/height/{entity}"
    flight.name_series(recording, series, name=name, rgb=rgb)
    flight.send_series(recording, series, time_s, coverage.site.ground.heights_agl_m(enu_m))


def _pieces(time_s: FloatArray) -> Sequence[int]:
    """Samples at which the pieces of a path end."""
    step = np.floor((time_s - time_s[0]) / SCENE.piece_s)
    found = np.append(np.flatnonzero(np.diff(step, prepend=-1.0) > 0), time_s.size - 1)
    return [int(k) for k in np.unique(found)]

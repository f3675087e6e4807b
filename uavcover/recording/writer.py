"""Write recordings: of a whole flight, of a fleet, and one that grows during the flight."""

import contextlib
import hashlib
import itertools
import os
import threading
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
from uavcover.model.track import OPTIONAL_COLUMNS, Track, TrackSample
from uavcover.recording import flight, layout
from uavcover.recording.layout import (
    SCENE,
    VIEWS,
    RecordingError,
    any_value_columns,
    any_values,
    check_finished,
    log_static,
    open_stream,
    strict_mode,
    time_column,
    ui_points,
)
from uavcover.recording.scene import begin_recording
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap, LevelObservations

_NAMESPACE = uuid.UUID("2d1f7b1e-7c1f-4a7c-9f0c-2f6b8d6f5a90")


def write_recording(
    path: str | Path,  # the file, ``flight.rrd`` in a run folder
    *,
    coverage: CoverageMap,  # the cells of a site, the ones that ``first_observed_s`` counts
    planned: Route | None,  # the planned sensing route, if there is one
    track: Track,  # the flown track
    # (cells,) vehicle time at which each cell was seen first, NaN or infinite where it never was. With ``first =
    # coverage.first_observed(observations)`` of one observation a sample: ``np.where(first >= 0, track.time_s[first],
    # np.nan)``.
    first_observed_s: NDArray[np.float64],
    events: Iterable[flight.RecordedEvent] = (),  # events of the flight, in any order
    states: Iterable[flight.VehicleState] = (),  # states of battery and link, in any order
    name: str | None = None,  # name of the run, shown in the viewer; default: the scenario's name
) -> None:
    """Write a flight as a recording for the rerun viewer, with its blueprint.

    The file is written beside its final name and renamed when complete. An existing file is
    replaced. Equal arguments give recordings that ``rerun rrd compare`` calls equal (their bytes differ).

    Raises:
        RecordingError: the track is empty or its time does not increase, or ``first_observed_s`` does not fit.
        OutputError: the file cannot be written.
    """
    _check(coverage, track, first_observed_s)
    site = coverage.site
    name = plain_text(name or site.scenario.name)
    span_s = (float(track.time_s[0]), float(track.time_s[-1]))
    recording_id = _recording_id(name, track)
    with _written(Path(path), coverage, planned, name=name, recording_id=recording_id, span_s=span_s) as recording:
        flight.log_coverage(recording, coverage, span_s, first_observed_s)
        flight.log_series(recording, coverage, track)
        flight.draw_vehicle(recording, coverage)
        flight.send_vehicle(recording, coverage, track)
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
        recording.disconnect()
    _write_whole(path, data)


def _check(coverage: CoverageMap, track: Track, first_observed_s: NDArray[np.float64]) -> None:
    if len(track) == 0:
        raise RecordingError("the track has no samples; there is nothing to record")
    standing = np.flatnonzero(~(np.diff(track.time_s) > 0.0))
    if standing.size or not np.isfinite(track.time_s[0]):
        where = int(standing[0]) + 1 if standing.size else 0
        raise RecordingError(f"the time of the track does not increase at sample {where}")
    if first_observed_s.shape != (coverage.grid.count,):
        raise RecordingError(
            f"first_observed_s has shape {first_observed_s.shape}, not one time for each of {coverage.grid.count} cells"
        )
    observed_s = first_observed_s[np.isfinite(first_observed_s)]
    if observed_s.size and not (track.time_s[0] <= observed_s.min() and observed_s.max() <= track.time_s[-1]):
        raise RecordingError(
            f"first_observed_s reaches from {observed_s.min():g} to {observed_s.max():g} s, outside the flight, which lasts from "
            f"{track.time_s[0]:g} to {track.time_s[-1]:g} s"
        )


def _recording_id(name: str, track: Track) -> str:
    """An id unique to the flight and run, and reproducible: recordings with one id would merge in the viewer."""
    digest = hashlib.sha256(name.encode())
    for column in flight.track_columns(track).values():
        digest.update(column.tobytes())
    return str(uuid.uuid5(_NAMESPACE, digest.hexdigest()))


def _write_whole(path: Path, data: bytes) -> None:
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
    first_observed_s: NDArray[np.float64],
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
        flight.log_coverage(recording, coverage, span_s, first_observed_s)
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
    path, point = f"{layout.FLOWN}/{entity}", f"{layout.VEHICLE}/{entity}"
    log_static(recording, path, rr.LineStrips3D.from_fields(colors=[rgb], radii=ui_points(2.5)))
    log_static(recording, point, rr.Points3D.from_fields(colors=[rgb], radii=ui_points(6.0), labels=[name]))
    recording.send_columns(point, [time_column(time_s)], rr.Points3D.columns(positions=enu_m))
    ends = flight.step_samples(time_s, SCENE.piece_s)
    strips = [enu_m[a : b + 1] for a, b in itertools.pairwise(ends)]
    if strips:
        recording.send_columns(path, [time_column(time_s[ends[1:]])], rr.LineStrips3D.columns(strips=strips))
    series = f"{layout.SERIES}/height/{entity}"
    flight.name_series(recording, series, name=name, rgb=rgb)
    flight.send_series(recording, series, time_s, coverage.site.ground.heights_agl_m(enu_m))


_READ_BYTES = 1 << 16


class LiveRecording:
    """The recording of an ongoing flight.

    Samples, events and states are only queued; a separate thread sends them every ``VIEWS.period_s``, so that no viewer and no
    disk delays the flight. A failure there is kept in ``error`` and ends the recording, not the flight.

    The bytes go through a pipe that is always drained. Rerun's own file sink would block forever when the disk is full.

    Cells change by samples between the first and the last planned waypoint, or by those at the waypoints, for a level camera;
    the recording that replaces this one at the end of the flight shows them as verification does.

    Args:
        path: of the file; an existing one is replaced.
        site: the scenario on its ground.
        coverage: its cells.
        planned: the planned sensing route.
        viewer_url: viewer that shows the flight; None for the file alone.

    Attributes:
        error: why the recording ended before the flight; None while it goes on.
        covered: fraction of the area that was observed so far, 0 to 1.

    Raises:
        OutputError: the file cannot be created.
    """

    def __init__(
        self, path: Path, *, site: Site, coverage: CoverageMap, planned: Route, viewer_url: str | None = None
    ) -> None:
        self.error: str | None = None
        self.covered = 0.0
        self._path, self._coverage = path, coverage
        self._lock, self._sending = threading.Lock(), threading.Lock()
        self._samples: list[TrackSample] = []
        self._events: list[flight.RecordedEvent] = []
        self._states: list[flight.VehicleState] = []
        self._last: TrackSample | None = None
        self._recent_states: list[flight.VehicleState] = []
        self._heading_for = -1
        self._observed = np.zeros(coverage.grid.count, dtype=bool)
        # Compiles the kernel, or loads its machine code: in flight, that would stop every thread for many seconds.
        coverage.observed_by(LevelObservations.by_yaw(planned.waypoints_m[:1], np.zeros(1)))
        try:
            self._file = path.open("wb", buffering=0)
        except OSError as error:
            raise OutputError(f"{path}: the recording cannot be written ({error.strerror or error})") from error
        reading, writing = os.pipe()
        self._copier = threading.Thread(target=self._copy, args=(reading,), daemon=True)
        self._copier.start()
        recording_id = str(uuid.uuid4())
        self._outputs = [open_stream(site, recording_id)]
        self._outputs[0].save(f"/dev/fd/{writing}")
        os.close(writing)
        if viewer_url is not None:
            self._outputs.append(open_stream(site, recording_id))
            self._outputs[1].connect_grpc(viewer_url)
        unobserved = flight.coverage_tiles(coverage, np.full(coverage.grid.count, np.inf), 0.0)
        self._tiles = list(
            zip(unobserved, flight.coverage_tiles(coverage, np.zeros(coverage.grid.count), 0.0), strict=True)
        )
        for output in self._outputs:
            self._begin(output, site, planned)
        self._stop = threading.Event()
        self._sender = threading.Thread(target=self._run, daemon=True)
        self._sender.start()

    def take_sample(self, sample: TrackSample) -> None:
        """Queue a sample of the track."""
        with self._lock:
            self._samples.append(sample)

    def take_event(self, event: flight.RecordedEvent) -> None:
        """Queue an event."""
        with self._lock:
            self._events.append(event)

    def take_state(self, state: flight.VehicleState) -> None:
        """Queue a state of battery and link."""
        with self._lock:
            self._states.append(state)

    def rename(self, path: Path) -> None:
        """Rename the file while it grows. Raises OutputError: it cannot be renamed."""
        try:
            os.replace(self._path, path)
        except OSError as error:
            raise OutputError(f"{path}: the recording cannot be written ({error.strerror or error})") from error
        self._path = path

    def send(self) -> None:
        """Send what is queued; the thread does so every ``VIEWS.period_s``."""
        with self._sending:
            self._send()

    def close(self) -> None:
        """Send the rest and finish the file."""
        self._stop.set()
        self._sender.join()
        for output in self._outputs:
            output.disconnect()
        self._outputs.clear()
        self._copier.join()

    def _begin(self, output: rr.RecordingStream, site: Site, planned: Route) -> None:
        log_static(output, layout.TRACK, any_values({layout.UNFINISHED: np.array([1])}))
        name = plain_text(f"{site.scenario.name} (in flight)")
        begin_recording(output, self._coverage, planned, name=name, span_s=None)
        flight.draw_vehicle(output, self._coverage)
        flight.name_series(output, layout.HEIGHT_AGL, name="above ground, m", rgb=layout.FLOWN_RGB)
        flight.name_series(output, layout.OBSERVED, name="of the area", rgb=layout.OBSERVED_RGB)
        for number, (tile, _) in enumerate(self._tiles):
            log_static(
                output,
                flight.tile_entity(number),
                rr.Mesh3D(
                    vertex_positions=tile.vertices_m, triangle_indices=tile.triangles, vertex_colors=tile.vertex_rgba[0]
                ),
                any_values({layout.CELL_NUMBERS: tile.cells}),
            )

    def _run(self) -> None:
        stopping = False
        while not stopping:
            stopping = self._stop.wait(VIEWS.period_s)
            if self.error is not None:
                continue
            try:
                self.send()
            except Exception as error:  # any error of rerun: the flight goes on
                self.error = f"{self._path}: the live recording ended ({error})"

    def _send(self) -> None:
        with self._lock:
            samples, self._samples = self._samples, []
            events, self._events = self._events, []
            states, self._states = self._states, []
        if samples:
            self._send_samples(samples)
        if states:
            # Losses are counted over an interval, so its states are kept.
            self._recent_states = [*self._recent_states, *states]
            newest_s = states[-1].time_s
            self._recent_states = [s for s in self._recent_states if s.time_s > newest_s - 2.0 * VIEWS.link_window_s]
        for output in self._outputs:
            flight.log_events(output, events)
            if states:
                flight.log_states(output, self._recent_states)
            with contextlib.suppress(RuntimeError):
                output.flush(timeout_sec=VIEWS.period_s)

    def _send_samples(self, samples: list[TrackSample]) -> None:
        new = _track_of(samples)
        # The path continues from the last sample of the previous interval.
        part = new if self._last is None else _track_of([self._last, *samples])
        self._last = samples[-1]
        height_agl_m = self._coverage.site.ground.heights_agl_m(new.enu_m)
        turned = self._turned(new)
        self.covered = fraction = self._coverage.fraction(self._observed)
        for output in self._outputs:
            output.send_columns(layout.TRACK, [time_column(new.time_s)], any_value_columns(flight.track_columns(new)))
            flight.send_vehicle(output, self._coverage, part)
            flight.send_series(output, layout.HEIGHT_AGL, new.time_s, height_agl_m)
            flight.send_series(output, layout.OBSERVED, new.time_s[-1:], np.array([100.0 * fraction]))
            for number, colors in turned:
                output.send_columns(
                    flight.tile_entity(number),
                    [time_column(new.time_s[-1:])],
                    rr.Mesh3D.columns(vertex_colors=colors).partition([colors.size]),
                )

    def _turned(self, new: Track) -> list[tuple[int, NDArray[np.uint32]]]:
        """Numbers and colours of the tiles with newly observed cells."""
        numbers = np.append(self._heading_for, new.current_waypoint)
        self._heading_for = int(numbers[-1])
        if self._coverage.site.scenario.sensor.looks_along_path:
            route = new.current_waypoint >= 1
        else:
            route = (numbers[1:] != numbers[:-1]) & (numbers[:-1] >= 0)
        if not route.any():
            return []
        observed = self._observed | self._coverage.observed_by(
            LevelObservations.by_yaw(new.enu_m[route], new.attitude_deg[route, 2])
        )
        changed = observed & ~self._observed
        self._observed = observed
        return [
            (number, np.repeat(np.where(observed[plain.cells], turned.rgba[-1], plain.rgba[0]), 4).astype(np.uint32))
            for number, (plain, turned) in enumerate(self._tiles)
            if changed[plain.cells].any()
        ]

    def _copy(self, reading: int) -> None:
        """Copy the pipe into the file to its end; drain it even when writing fails."""
        with self._file:
            while data := os.read(reading, _READ_BYTES):
                if self.error is None:
                    try:
                        self._file.write(data)
                    except OSError as error:
                        self.error = f"{self._path}: the live recording cannot be written ({error.strerror or error})"
        os.close(reading)


def _track_of(samples: list[TrackSample]) -> Track:
    def columns(*names: str) -> NDArray[np.float64]:
        return np.array([[getattr(sample, name) for name in names] for sample in samples], dtype=float)

    return Track(
        time_s=columns("time_s")[:, 0],
        geodetic=columns("lat_deg", "lon_deg", "alt_amsl_m"),
        enu_m=columns("east_m", "north_m", "up_m"),
        attitude_deg=columns("roll_deg", "pitch_deg", "yaw_deg"),
        current_waypoint=np.array([sample.current_waypoint for sample in samples], dtype=np.int64),
        **{name: columns(name)[:, 0] for name in OPTIONAL_COLUMNS},
    )

"""A recording that grows during the flight, in a file and, on request, in a viewer."""

import contextlib
import os
import threading
import uuid
from pathlib import Path

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from mission_io.model.plain_text import plain_text
from uavcover.errors import OutputError
from uavcover.model.route import Route
from uavcover.model.track import OPTIONAL_COLUMNS, Track, TrackSample
from uavcover.recording import flight, layout
from uavcover.recording.blueprint import begin_recording
from uavcover.recording.layout import VIEWS, any_value_columns, any_values, log_static, open_stream, time_column
from uavcover.recording.tiles import coverage_tiles
from uavcover.recording.vehicle import draw_vehicle, send_vehicle
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap, LevelObservations

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
        viewer_url: viewer that shows the flight; none for the file alone.

    Attributes:
        error: why the recording ended before the flight; None while it goes on.
        covered: share of the area that was observed so far, 0 to 1.

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
        self._seen = np.zeros(coverage.grid.count, dtype=bool)
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
        unseen = coverage_tiles(coverage, np.full(coverage.grid.count, np.inf), 0.0)
        self._tiles = list(zip(unseen, coverage_tiles(coverage, np.zeros(coverage.grid.count), 0.0), strict=True))
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
        draw_vehicle(output, self._coverage)
        flight.name_series(output, layout.HEIGHT_AGL, name="above ground, m", rgb=layout.FLOWN_RGB)
        flight.name_series(output, layout.SEEN, name="of the area", rgb=layout.SEEN_RGB)
        for number, (tile, _) in enumerate(self._tiles):
            log_static(
                output,
                _tile_entity(number),
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
        self.covered = share = self._coverage.share(self._seen)
        for output in self._outputs:
            output.send_columns(layout.TRACK, [time_column(new.time_s)], any_value_columns(flight.track_columns(new)))
            send_vehicle(output, self._coverage, part)
            flight.send_series(output, layout.HEIGHT_AGL, new.time_s, height_agl_m)
            flight.send_series(output, layout.SEEN, new.time_s[-1:], np.array([100.0 * share]))
            for number, colors in turned:
                output.send_columns(
                    _tile_entity(number),
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
        seen = self._seen | self._coverage.seen_by(
            LevelObservations.by_yaw(new.enu_m[route], new.attitude_deg[route, 2])
        )
        changed = seen & ~self._seen
        self._seen = seen
        return [
            (number, np.repeat(np.where(seen[unseen.cells], turned.rgba[-1], unseen.rgba[0]), 4).astype(np.uint32))
            for number, (unseen, turned) in enumerate(self._tiles)
            if changed[unseen.cells].any()
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


def _tile_entity(number: int) -> str:
    return f"{layout.COVERAGE}/tile_{number:04d}"


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

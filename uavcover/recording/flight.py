"""The changing parts of a recording apart from the vehicle: track, cells, series, events. All are sent as columns."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from mission_io.model.plain_text import plain_text
from uavcover.kernels.arrays import FloatArray
from uavcover.model.track import COLUMNS, OPTIONAL_COLUMNS, Track
from uavcover.recording import layout
from uavcover.recording.layout import VIEWS, any_value_columns, any_values, log_static, time_column
from uavcover.recording.tiles import coverage_tiles, shown_from_s, tick_times_s
from uavcover.sensing.coverage_map import CoverageMap


@dataclass(frozen=True, slots=True)
class RecordedEvent:
    """An event of the flight."""

    time_s: float  # vehicle time
    text: str  # one line
    level: Literal["INFO", "WARN", "ERROR"] = "INFO"  # its severity


@dataclass(frozen=True, slots=True)
class VehicleState:
    """State of vehicle and link at a moment of the flight."""

    time_s: float  # vehicle time
    battery_v: float | None  # voltage; none where unknown
    battery_percent: float | None  # remaining charge; none where unknown
    frames_in: int  # messages that arrived since the link was opened
    frames_lost: int  # lost messages, by gaps in their sequence numbers


def track_columns(track: Track) -> dict[str, NDArray[np.float64] | NDArray[np.int64]]:
    """The columns of ``track.csv``, each (n,), without those that are unknown throughout."""
    arrays = (
        track.time_s,
        *track.geodetic.T,
        *track.enu_m.T,
        *track.attitude_deg.T,
        track.current_waypoint,
    )
    optional = {name: getattr(track, name) for name in OPTIONAL_COLUMNS}
    known = {name: array for name, array in optional.items() if np.isfinite(array).any()}
    columns = dict(zip(COLUMNS, arrays, strict=True)) | known
    return {name: np.ascontiguousarray(array) for name, array in columns.items()}


def log_track(recording: rr.RecordingStream, track: Track) -> None:
    """Log the track in float64, from which it is read back exactly."""
    log_static(recording, layout.TRACK, any_values({layout.SAMPLE_COUNT: np.array([len(track)])}))
    recording.send_columns(layout.TRACK, [time_column(track.time_s)], any_value_columns(track_columns(track)))


def log_coverage(
    recording: rr.RecordingStream, coverage: CoverageMap, span_s: tuple[float, float], first_seen_s: FloatArray
) -> None:
    """Log the cells and the coverage, from the start of the flight to its end."""
    start_s = span_s[0]
    ticks_s = tick_times_s(*span_s)
    shown_s = shown_from_s(first_seen_s, ticks_s)
    for number, tile in enumerate(coverage_tiles(coverage, shown_s, start_s)):
        entity = f"{layout.COVERAGE}/tile_{number:04d}"
        log_static(
            recording,
            entity,
            rr.Mesh3D.from_fields(vertex_positions=tile.vertices_m, triangle_indices=tile.triangles),
            any_values({layout.CELL_NUMBERS: tile.cells}),
        )
        colors = rr.Mesh3D.columns(vertex_colors=tile.vertex_rgba.ravel())
        vertices_per_row = [4 * tile.cells.size] * tile.time_s.size
        recording.send_columns(entity, [time_column(tile.time_s)], colors.partition(vertices_per_row))
    everything = np.ones(coverage.grid.count, dtype=bool)
    for entity, name, judged, rgb in (
        (layout.SEEN, "of the area", everything, layout.SEEN_RGB),
        (layout.SEEN_COVERABLE, "of the visible ground", coverage.coverable, layout.FOOTPRINT_RGB),
    ):
        if judged.any():
            percent = _percent_seen(coverage.grid.weight_m2[judged], shown_s[judged], ticks_s)
            _log_series(recording, entity, ticks_s, percent, name=name, rgb=rgb)


def log_series(recording: rr.RecordingStream, coverage: CoverageMap, track: Track) -> None:
    """Log height above ground with its band, and speeds."""
    limits = coverage.site.scenario.limits
    height_agl_m = coverage.site.ground.heights_agl_m(track.enu_m)
    _log_series(recording, layout.HEIGHT_AGL, track.time_s, height_agl_m, name="above ground, m", rgb=layout.FLOWN_RGB)
    # The band applies from the first to the last planned waypoint; a track without a route shows it throughout.
    on_route = np.flatnonzero(track.current_waypoint >= 1)
    ends = [on_route[0], on_route[-1]] if on_route.size else [0, -1]
    for entity, name, height_m, rgb in (
        (layout.HEIGHT_MIN, "minimum allowed", limits.min_height_agl_m, layout.FLOOR_RGB),
        (layout.HEIGHT_MAX, "maximum allowed", limits.max_height_agl_m, layout.CEILING_RGB),
    ):
        _log_series(recording, entity, track.time_s[ends], np.full(2, height_m), name=name, rgb=rgb)
    if len(track) > 1:
        velocity_m_s = np.gradient(track.enu_m, track.time_s, axis=0)
        ground_m_s = np.hypot(velocity_m_s[:, 0], velocity_m_s[:, 1])
        for entity, name, speed_m_s, rgb in (
            (layout.GROUND_SPEED, "ground speed, m/s", ground_m_s, layout.FLOWN_RGB),
            (layout.CLIMB_SPEED, "climb, m/s", velocity_m_s[:, 2], layout.FOOTPRINT_RGB),
        ):
            _log_series(recording, entity, track.time_s, speed_m_s, name=name, rgb=rgb)


def log_states(recording: rr.RecordingStream, states: Sequence[VehicleState]) -> None:
    """Log battery and link as far as known."""
    if not states:
        return
    time_s = np.array([state.time_s for state in states])
    for entity, name, values, rgb in (
        (layout.BATTERY_PERCENT, "left, percent", [state.battery_percent for state in states], layout.SEEN_RGB),
        (layout.BATTERY_V, "volts", [state.battery_v for state in states], layout.FLOWN_RGB),
    ):
        reported = np.array([np.nan if value is None else value for value in values])
        known = np.isfinite(reported)
        if known.any():
            _log_series(recording, entity, time_s[known], reported[known], name=name, rgb=rgb)
    arrived = np.array([state.frames_in for state in states], dtype=float)
    lost = np.array([state.frames_lost for state in states], dtype=float)
    before = np.searchsorted(time_s, time_s - VIEWS.link_window_s)
    came, went = arrived - arrived[before], lost - lost[before]
    span_s = time_s - time_s[before]
    whole = span_s > 0.0
    shares = 100.0 * went[whole] / np.maximum(came + went, 1.0)[whole]
    for entity, name, values_of, rgb in (
        (layout.LINK_LOST, "lost, percent", shares, layout.LOST_RGB),
        (layout.LINK_RATE, "messages a second", came[whole] / span_s[whole], layout.FOOTPRINT_RGB),
    ):
        _log_series(recording, entity, time_s[whole], values_of, name=name, rgb=rgb)


def log_events(recording: rr.RecordingStream, events: Iterable[RecordedEvent]) -> None:
    """Log events as text, in order of time."""
    ordered: Sequence[RecordedEvent] = sorted(events, key=lambda event: event.time_s)
    if ordered:
        recording.send_columns(
            layout.EVENTS,
            [time_column(np.array([event.time_s for event in ordered]))],
            rr.TextLog.columns(text=[plain_text(e.text) for e in ordered], level=[e.level for e in ordered]),
        )


def name_series(recording: rr.RecordingStream, entity: str, *, name: str, rgb: layout.Rgb) -> None:
    """Log name and colour of a series."""
    log_static(recording, entity, rr.SeriesLines(names=[name], colors=[rgb], widths=[1.5]))


def send_series(recording: rr.RecordingStream, entity: str, time_s: FloatArray, values: FloatArray) -> None:
    """Send values of a series, both (n,)."""
    recording.send_columns(entity, [time_column(time_s)], rr.Scalars.columns(scalars=values))


def _log_series(
    recording: rr.RecordingStream,
    entity: str,
    time_s: FloatArray,
    values: FloatArray,
    *,
    name: str,
    rgb: layout.Rgb,
) -> None:
    name_series(recording, entity, name=name, rgb=rgb)
    send_series(recording, entity, time_s, values)


def _percent_seen(weight_m2: FloatArray, shown_s: FloatArray, ticks_s: FloatArray) -> FloatArray:
    order = np.argsort(shown_s, kind="stable")
    so_far = np.append(0.0, np.cumsum(weight_m2[order]))
    return np.asarray(100.0 * so_far[np.searchsorted(shown_s[order], ticks_s, side="right")] / so_far[-1])

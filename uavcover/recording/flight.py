"""The changing parts of a recording: cells, vehicle, track, series and events. All are sent as columns.

The colours of all cells once a second would be most of the file, and nearly all of them would repeat. Instead, the cells are cut
into square tiles, and a tile gets new colours only in seconds in which one of its cells was seen for the first time.
"""

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from mission_io.model.plain_text import plain_text
from uavcover.kernels.arrays import FloatArray
from uavcover.model.sensor import Sensor
from uavcover.model.sensor_base import CameraTurn, rays_to
from uavcover.model.track import COLUMNS, OPTIONAL_COLUMNS, Track
from uavcover.recording import layout
from uavcover.recording.layout import (
    NOT_COVERABLE_RGB,
    OBSERVED_RGB,
    SCENE,
    UNOBSERVED_RGB,
    VIEWS,
    any_value_columns,
    any_values,
    log_static,
    time_column,
    ui_points,
)
from uavcover.recording.scene import extent_m, lift_m, scene_bounds_m
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.terrain.ground import hillshade, shaded

if TYPE_CHECKING:  # a third of a second to load; functions below do it
    from scipy.spatial.transform import Rotation


@dataclass(frozen=True, eq=False)
class Tile:
    """A group of cells with their colours over time."""

    cells: NDArray[np.int64]  # (n,) numbers of cells
    vertices_m: FloatArray  # (4 n, 3) ENU metres, four corners of each cell, slightly above the ground
    triangles: NDArray[np.uint32]  # (2 n, 3) uint32 numbers of vertices, counter-clockwise seen from above
    time_s: FloatArray  # (k,) when the colours change; the first is the start of the flight
    rgba: NDArray[np.uint32]  # (k, n) uint32 colours, 0xRRGGBBAA

    @property
    def vertex_rgba(self) -> NDArray[np.uint32]:
        """(k, 4 n) colours of the vertices."""
        return np.repeat(self.rgba, 4, axis=1)


def tick_times_s(start_s: float, end_s: float) -> FloatArray:
    """(k,) times from the start of a flight to its end, ``SCENE.tick_s`` apart; the last is the end itself."""
    ticks = np.arange(start_s, end_s, SCENE.tick_s)
    return np.append(ticks[ticks < end_s], end_s)


def shown_from_s(first_observed_s: FloatArray, ticks_s: FloatArray) -> FloatArray:
    """(cells,) tick from which each cell is shown as observed; infinite where ``first_observed_s`` is not finite."""
    tick = np.searchsorted(ticks_s, first_observed_s, side="left")
    return np.append(ticks_s, np.inf)[np.where(np.isfinite(first_observed_s), tick, ticks_s.size)]


def tile_entity(number: int) -> str:
    """Path of a tile by its number."""
    return f"{layout.COVERAGE}/tile_{number:04d}"


def coverage_tiles(coverage: CoverageMap, shown_s: FloatArray, start_s: float) -> list[Tile]:
    """Divide the cells of a map into tiles, in order of row and column.

    Args:
        coverage: the cells.
        shown_s: (cells,) time at which each cell changes, infinite for never.
        start_s: start of the flight.
    """
    brightness = hillshade(coverage.site.ground.gradients(coverage.grid.cells.centre_m[:, :2]))
    observed = _packed(shaded(OBSERVED_RGB, brightness))
    unobserved = _packed(shaded(UNOBSERVED_RGB, brightness))
    unobserved = np.where(coverage.coverable, unobserved, _packed(shaded(NOT_COVERABLE_RGB, brightness)))
    corners_m = _corners_m(coverage)
    square = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.uint32)
    index = coverage.grid.cells.lattice
    tiles = []
    for row in range(0, index.shape[0], SCENE.tile_side_cells):
        for column in range(0, index.shape[1], SCENE.tile_side_cells):
            block = index[row : row + SCENE.tile_side_cells, column : column + SCENE.tile_side_cells].ravel()
            cells = block[block >= 0].astype(np.int64)
            if cells.size == 0:
                continue
            shown = shown_s[cells]
            times = np.unique(np.append(shown[np.isfinite(shown)], start_s))
            turned = shown[None, :] <= times[:, None]
            triangles = 4 * np.arange(cells.size, dtype=np.uint32)[:, None, None] + square
            tiles.append(
                Tile(
                    cells=cells,
                    vertices_m=corners_m[cells].reshape(-1, 3),
                    triangles=triangles.reshape(-1, 3),
                    time_s=times,
                    rgba=np.where(turned, observed[cells], unobserved[cells]).astype(np.uint32),
                )
            )
    return tiles


def _corners_m(coverage: CoverageMap) -> FloatArray:
    """(cells, 4, 3) south-west, south-east, north-east, north-west corner of each cell, lifted; ENU metres."""
    cells = coverage.grid.cells
    half_m = 0.5 * cells.size_m
    offsets = half_m * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    positions = coverage.grid.middles_m[:, None] + offsets
    up = coverage.site.ground.heights_m(positions.reshape(-1, 2)).reshape(-1, 4)
    # a corner can lie outside the data although the centre does not.
    up = np.where(np.isfinite(up), up, cells.centre_m[:, None, 2])
    return np.concatenate([positions, (up + lift_m(coverage))[..., None]], axis=2)


def _packed(rgb: NDArray[np.uint8]) -> NDArray[np.uint32]:
    wide = rgb.astype(np.uint32)
    packed = (wide[:, 0] << 24) | (wide[:, 1] << 16) | (wide[:, 2] << 8) | 255
    return np.asarray(packed, dtype=np.uint32)


def footprints_m(coverage: CoverageMap, eyes_m: FloatArray, axes: FloatArray, tops: FloatArray) -> list[FloatArray]:
    """Outlines on the ground of the sensor's view from (k, 3) ENU positions.

    In each of 48 directions the ground is followed from its intersection with the sensor's axis to where it first leaves
    the sensor's range or opening angle, to within a 40th of the largest reach. Occlusions inside the outline are not cut
    out; the cells show them.

    Args:
        coverage: the cells with their sensor.
        eyes_m: (k, 3) ENU positions of the sensor.
        axes: (k, 3) ENU unit vectors along a camera's viewing direction; other sensors see in all directions.
        tops: (k, 3) unit vectors perpendicular to them, towards the top of the picture.

    Returns:
        k closed rings (49, 3), ENU metres; a ring is empty where the sensor does not reach the ground on its axis, and
        shorter where there is no elevation.
    """
    sensor, sight = coverage.site.scenario.sensor, coverage.sight
    azimuth = np.linspace(0.0, 2.0 * np.pi, SCENE.directions + 1)
    rings: list[FloatArray] = []
    for eye, axis, top in zip(*(np.asarray(rows, float).reshape(-1, 3) for rows in (eyes_m, axes, tops)), strict=True):
        reach_m = sight.reach_m
        middle = eye[:2]
        if sensor.is_camera:
            if -axis[2] < SCENE.level_cos:
                middle = _on_axis_m(coverage, eye, axis)
                reach_m *= 2.0  # across the whole range
            else:
                # To the corner of a picture.
                widest = np.hypot(sight.tan_half_fov, sight.tan_half_along)
                reach_m *= widest / np.sqrt(1.0 + widest**2) / SCENE.level_cos
        radius = np.linspace(0.0, reach_m, SCENE.steps + 1)
        east = middle[0] + np.sin(azimuth)[:, None] * radius
        north = middle[1] + np.cos(azimuth)[:, None] * radius
        up = coverage.site.ground.heights_m(np.column_stack([east.ravel(), north.ravel()])).reshape(east.shape)
        rays = rays_to((east - eye[0], north - eye[1], up - eye[2]), axis, top)
        inside = np.isfinite(up) & sensor.in_view(rays)
        last = np.where(inside.all(axis=1), SCENE.steps, inside.argmin(axis=1) - 1)
        rows = np.flatnonzero(last >= 0)
        column = last[rows]
        rings.append(np.column_stack([east[rows, column], north[rows, column], up[rows, column]]))
    return rings


def _on_axis_m(coverage: CoverageMap, eye_m: FloatArray, axis: FloatArray) -> FloatArray:
    """(2,) first intersection of the axis with the ground, to a 200th of the range, or else below the sensor."""
    along = np.linspace(0.0, coverage.sight.reach_m, 201)[:, None]
    points = eye_m + along * axis
    under = coverage.site.ground.heights_agl_m(points) <= 0.0
    return points[int(under.argmax()), :2] if under.any() else eye_m[:2]


def draw_vehicle(recording: rr.RecordingStream, coverage: CoverageMap) -> None:
    """Log the static parts of the vehicle: its shape, that of the camera's view, and the colours of its lines."""
    site = coverage.site
    heading_m = SCENE.heading_fraction * extent_m(scene_bounds_m(site))
    log_static(
        recording,
        layout.HEADING,
        rr.Arrows3D(vectors=[[heading_m, 0.0, 0.0]], colors=[layout.VEHICLE_RGB], radii=heading_m / 10.0),
        rr.Points3D([[0.0, 0.0, 0.0]], colors=[layout.VEHICLE_RGB], radii=ui_points(6.0)),
    )
    sensor = site.scenario.sensor
    if sensor.is_camera:
        edges = _view_edges(sensor, length_m=0.5 * site.scenario.limits.max_height_agl_m)
        log_static(recording, layout.CAMERA, rr.LineStrips3D(edges, colors=[layout.CAMERA_RGB], radii=ui_points(1.0)))
    for entity, rgb, size in ((layout.FLOWN, layout.FLOWN_RGB, 2.5), (layout.FOOTPRINT, layout.FOOTPRINT_RGB, 2.0)):
        log_static(recording, entity, rr.LineStrips3D.from_fields(colors=[rgb], radii=ui_points(size)))
    if site.frame is not None:
        points = rr.GeoPoints.from_fields(colors=[layout.VEHICLE_RGB], radii=ui_points(6.0))
        log_static(recording, layout.MAP_VEHICLE, points)
        lines = rr.GeoLineStrings.from_fields(colors=[layout.FLOWN_RGB], radii=ui_points(2.5))
        log_static(recording, layout.MAP_FLOWN, lines)


def send_vehicle(recording: rr.RecordingStream, coverage: CoverageMap, track: Track) -> None:
    """Send the vehicle's motion, in the local frame and on the map.

    Args:
        recording: recording in which ``draw_vehicle`` was called.
        coverage: the cells with their sensor.
        track: the flight, or a part of it whose first sample is the last one of the previous part.
    """
    site = coverage.site
    times = [time_column(track.time_s)]
    turns = body_rotations(track.attitude_deg)
    quaternions = turns.as_quat()
    recording.send_columns(
        layout.VEHICLE, times, rr.Transform3D.columns(translation=track.enu_m, quaternion=quaternions)
    )
    sensor = site.scenario.sensor
    turn = sensor.camera_turn(track.attitude_deg)
    if sensor.is_camera:
        camera = rr.Transform3D.columns(translation=track.enu_m, quaternion=_rotations(turn).as_quat())
        recording.send_columns(layout.CAMERA, times, camera)
    ends = step_samples(track.time_s, SCENE.vehicle_step_s)
    pieces = [(a, b + 1) for a, b in itertools.pairwise(ends)]
    steps = [time_column(track.time_s[ends[1:]])]
    if pieces:
        path = [track.enu_m[a:b] for a, b in pieces]
        recording.send_columns(layout.FLOWN, steps, rr.LineStrips3D.columns(strips=path))
    above_m = (0.0, 0.0, 2.0 * lift_m(coverage))
    rings = [ring + above_m for ring in footprints_m(coverage, track.enu_m[ends], turn.axes[ends], turn.tops[ends])]
    recording.send_columns(layout.FOOTPRINT, [time_column(track.time_s[ends])], rr.LineStrips3D.columns(strips=rings))
    if site.frame is None:
        return
    positions = track.geodetic[:, :2]
    recording.send_columns(layout.MAP_VEHICLE, times, rr.GeoPoints.columns(positions=positions))
    if pieces:
        recording.send_columns(
            layout.MAP_FLOWN, steps, rr.GeoLineStrings.columns(line_strings=[positions[a:b] for a, b in pieces])
        )


def body_rotations(attitude_deg: FloatArray) -> "Rotation":
    """Rotations from the body (forward, left, up) to the local frame by (n, 3) roll, pitch, yaw; level where unknown."""
    from scipy.spatial.transform import Rotation

    roll, pitch, yaw = np.nan_to_num(attitude_deg).T
    return Rotation.from_euler("ZYX", np.column_stack([90.0 - yaw, -pitch, roll]), degrees=True)


def _rotations(turn: CameraTurn) -> "Rotation":
    """Rotations from the camera (top, left of the image, against its axis) to the local frame."""
    from scipy.spatial.transform import Rotation

    left = np.cross(turn.tops, turn.axes)
    return Rotation.from_matrix(np.stack([turn.tops, left, -turn.axes], axis=2))


def _view_edges(sensor: Sensor, *, length_m: float) -> list[FloatArray]:
    """Edges and rim of a field of view, downwards from the origin; the top of an image points to x."""
    across, along = sensor.edges.T
    rim = np.column_stack([along * length_m, across * length_m, np.full(len(along), -length_m)])
    return [np.array([[0.0, 0.0, 0.0], corner]) for corner in rim[: -1 : max(1, len(rim) // SCENE.camera_edges)]] + [
        rim
    ]


def step_samples(time_s: FloatArray, step_s: float) -> list[int]:
    """Numbers of the samples at which a step ends: the first, about one every ``step_s``, and the last."""
    step = np.floor((time_s - time_s[0]) / step_s)
    return [int(k) for k in np.unique(np.append(np.flatnonzero(np.diff(step, prepend=-1.0) > 0), time_s.size - 1))]


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
    battery_v: float | None  # voltage; None where unknown
    battery_percent: float | None  # remaining charge; None where unknown
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
    recording: rr.RecordingStream, coverage: CoverageMap, span_s: tuple[float, float], first_observed_s: FloatArray
) -> None:
    """Log the cells and the coverage, from the start of the flight to its end."""
    start_s = span_s[0]
    ticks_s = tick_times_s(*span_s)
    shown_s = shown_from_s(first_observed_s, ticks_s)
    for number, tile in enumerate(coverage_tiles(coverage, shown_s, start_s)):
        entity = tile_entity(number)
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
        (layout.OBSERVED, "of the area", everything, layout.OBSERVED_RGB),
        (layout.OBSERVED_COVERABLE, "of the visible ground", coverage.coverable, layout.FOOTPRINT_RGB),
    ):
        if judged.any():
            percent = _percent_observed(coverage.grid.weight_m2[judged], shown_s[judged], ticks_s)
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
        (layout.BATTERY_PERCENT, "left, percent", [state.battery_percent for state in states], layout.OBSERVED_RGB),
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
    fractions = 100.0 * went[whole] / np.maximum(came + went, 1.0)[whole]
    for entity, name, values_of, rgb in (
        (layout.LINK_LOST, "lost, percent", fractions, layout.LOST_RGB),
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


def _percent_observed(weight_m2: FloatArray, shown_s: FloatArray, ticks_s: FloatArray) -> FloatArray:
    order = np.argsort(shown_s, kind="stable")
    so_far = np.append(0.0, np.cumsum(weight_m2[order]))
    return np.asarray(100.0 * so_far[np.searchsorted(shown_s[order], ticks_s, side="right")] / so_far[-1])

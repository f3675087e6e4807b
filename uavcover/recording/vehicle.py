"""The vehicle in its scene: heading, camera, the path behind it, the footprint on the ground; and the same on the map."""

import itertools
import math

import numpy as np
import rerun as rr
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from uavcover.coverage.camera_turn import CameraTurn, camera_turn
from uavcover.coverage.coverage_map import CoverageMap
from uavcover.model.sensor import Camera, FrameCamera
from uavcover.model.track import Track
from uavcover.recording import layout
from uavcover.recording.footprint import footprints_m
from uavcover.recording.relief import extent_m, scene_bounds_m
from uavcover.recording.stream import log_static, time_column, ui_points
from uavcover.recording.tiles import lift_m

FloatArray = NDArray[np.float64]

STEP_S = 0.5
"""Vehicle time between footprints, and the length of the pieces in which the flown path grows."""

_HEADING_SHARE = 0.06
_CAMERA_EDGES = 8


def draw_vehicle(recording: rr.RecordingStream, coverage: CoverageMap) -> None:
    """Log what of the vehicle does not change: its shape, that of the camera's view, and the colours of its lines."""
    site = coverage.site
    heading_m = _HEADING_SHARE * extent_m(scene_bounds_m(site))
    log_static(
        recording,
        layout.HEADING,
        rr.Arrows3D(vectors=[[heading_m, 0.0, 0.0]], colors=[layout.VEHICLE_RGB], radii=heading_m / 10.0),
        rr.Points3D([[0.0, 0.0, 0.0]], colors=[layout.VEHICLE_RGB], radii=ui_points(6.0)),
    )
    sensor = site.scenario.sensor
    if isinstance(sensor, Camera):
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
    """Send where the vehicle was, in the local frame and on the map.

    Args:
        recording: in which ``draw_vehicle`` was called.
        coverage: the cells with their sensor.
        track: the flight, or a part of it whose first sample is the last one of the part before.
    """
    site = coverage.site
    times = [time_column(track.time_s)]
    turns = body_rotations(track.attitude_deg)
    quaternions = turns.as_quat()
    recording.send_columns(
        layout.VEHICLE, times, rr.Transform3D.columns(translation=track.enu_m, quaternion=quaternions)
    )
    sensor = site.scenario.sensor
    turn = camera_turn(sensor, track.attitude_deg)
    if isinstance(sensor, Camera):
        camera = rr.Transform3D.columns(translation=track.enu_m, quaternion=_rotations(turn).as_quat())
        recording.send_columns(layout.CAMERA, times, camera)
    ends = _step_samples(track.time_s)
    pieces = [(int(a), int(b) + 1) for a, b in itertools.pairwise(ends)]
    steps = [time_column(track.time_s[ends[1:]])]
    if pieces:
        path = [track.enu_m[a:b] for a, b in pieces]
        recording.send_columns(layout.FLOWN, steps, rr.LineStrips3D.columns(strips=path))
    above_m = (0.0, 0.0, 2.0 * lift_m(coverage))
    rings = [ring + above_m for ring in footprints_m(coverage, track.enu_m[ends], turn.axes[ends], turn.tops[ends])]
    recording.send_columns(layout.FOOTPRINT, [time_column(track.time_s[ends])], rr.LineStrips3D.columns(strips=rings))
    if site.frame is None:
        return
    places = track.geodetic[:, :2]
    recording.send_columns(layout.MAP_VEHICLE, times, rr.GeoPoints.columns(positions=places))
    if pieces:
        recording.send_columns(
            layout.MAP_FLOWN, steps, rr.GeoLineStrings.columns(line_strings=[places[a:b] for a, b in pieces])
        )


def body_rotations(attitude_deg: FloatArray) -> Rotation:
    """Rotations from the body (forward, left, up) to the local frame by (n, 3) roll, pitch, yaw; level where unknown."""
    roll, pitch, yaw = np.nan_to_num(attitude_deg).T
    return Rotation.from_euler("ZYX", np.column_stack([90.0 - yaw, -pitch, roll]), degrees=True)


def _rotations(turn: CameraTurn) -> Rotation:
    """Rotations from the camera (top, left of the picture, against its axis) to the local frame."""
    left = np.cross(turn.tops, turn.axes)
    return Rotation.from_matrix(np.stack([turn.tops, left, -turn.axes], axis=2))


def _view_edges(sensor: Camera, *, length_m: float) -> list[FloatArray]:
    """The edges and the rim of a field of view, downwards from the origin; the top of a picture points to x."""
    if isinstance(sensor, FrameCamera):
        right = length_m * math.tan(math.radians(sensor.fov_across_deg / 2.0))
        top = length_m * math.tan(math.radians(sensor.fov_along_deg / 2.0))
        corners = [(top, right), (top, -right), (-top, -right), (-top, right), (top, right)]
        rim = np.array([(x, y, -length_m) for x, y in corners])
        return [np.array([[0.0, 0.0, 0.0], corner]) for corner in rim[:-1]] + [rim]
    turn = np.linspace(0.0, 2.0 * np.pi, 4 * _CAMERA_EDGES + 1)
    radius = length_m * math.tan(math.radians(sensor.fov_deg / 2.0))
    rim = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), np.full(turn.size, -length_m)])
    return [np.array([[0.0, 0.0, 0.0], corner]) for corner in rim[:-1:4]] + [rim]


def _step_samples(time_s: FloatArray) -> NDArray[np.intp]:
    """Numbers of the samples at which a step ends: the first sample, then about one in each ``STEP_S``, the last always."""
    step = np.floor((time_s - time_s[0]) / STEP_S)
    return np.unique(np.append(np.flatnonzero(np.diff(step, prepend=-1.0) > 0), time_s.size - 1))

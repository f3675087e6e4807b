"""The vehicle in the scene and on the map: heading, camera, flown path, and the sensor's footprint.

The footprint is the outline of the sensor's field of view on the ground.
"""

import itertools
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from uavcover.kernels.arrays import FloatArray
from uavcover.model.sensor import Sensor
from uavcover.model.sensor_base import CameraTurn, rays_to
from uavcover.model.track import Track
from uavcover.recording import layout
from uavcover.recording.layout import SCENE, log_static, time_column, ui_points
from uavcover.recording.scene import extent_m, scene_bounds_m
from uavcover.recording.tiles import lift_m
from uavcover.sensing.coverage_map import CoverageMap

if TYPE_CHECKING:  # a third of a second to load; functions below do it
    from scipy.spatial.transform import Rotation


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
    heading_m = SCENE.heading_share * extent_m(scene_bounds_m(site))
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


def _step_samples(time_s: FloatArray) -> NDArray[np.intp]:
    """Numbers of the samples at which a step ends: the first, about one every ``SCENE.vehicle_step_s``, and the last."""
    step = np.floor((time_s - time_s[0]) / SCENE.vehicle_step_s)
    return np.unique(np.append(np.flatnonzero(np.diff(step, prepend=-1.0) > 0), time_s.size - 1))

"""Pictures per point by brute force: every picture against every cell, with angles, and rays that are sampled."""

import math

import numpy as np

RAY_SAMPLES = 1500
GRAZING_M = 0.05


def required(forward, side):
    """Pictures of one line begin every 1 - forward of their length, lines lie every 1 - side of their width; counted out."""
    positions = np.linspace(0.0, 1.0, 2001)

    def fewest(overlap):
        step = 1.0 - overlap
        begins = np.arange(-200, 200) * step
        # Ends half open, a hair inside: a point at the end of one picture is at the beginning of another.
        inside = (positions[:, None] >= begins - 1e-9) & (positions[:, None] < begins + 1.0 - 1e-9)
        return int(inside.sum(axis=1).min())

    return fewest(forward) * fewest(side)


def _rotation(roll_deg, pitch_deg, yaw_deg):
    """Forward, right and down of a vehicle in east, north, up: yaw first, then pitch, then roll."""
    roll, pitch, yaw = map(math.radians, (roll_deg, pitch_deg, yaw_deg))
    forward = np.array([math.sin(yaw), math.cos(yaw), 0.0])
    right = np.array([math.cos(yaw), -math.sin(yaw), 0.0])
    down = np.array([0.0, 0.0, -1.0])
    forward, down = (
        math.cos(pitch) * forward - math.sin(pitch) * down,
        math.sin(pitch) * forward + math.cos(pitch) * down,
    )
    right, down = math.cos(roll) * right + math.sin(roll) * down, -math.sin(roll) * right + math.cos(roll) * down
    return forward, right, down


def count(sensor, heights_m, eyes, yaws_deg, centres, normals):
    """Pictures that show each cell, the best ground sample distance, and which cells are in doubt; see :func:`looks`.

    Returns:
        (n,) pictures, (n,) metres a pixel (infinite: none), and (n,) whether any ray or angle is too close to call.
    """
    photos, best, doubtful = np.zeros(len(centres), int), np.full(len(centres), np.inf), np.zeros(len(centres), bool)
    for _, shown, samples, unclear in looks(sensor, heights_m, eyes, yaws_deg, centres, normals):
        photos[shown] += 1
        best[shown] = np.minimum(best[shown], samples)
        doubtful |= unclear
    return photos, best, doubtful


def looks(sensor, heights_m, eyes, yaws_deg, centres, normals):
    """Of each picture: its number, the cells that it shows, metres a pixel there, and (n,) cells that are too close to call.

    Args:
        sensor: a frame camera on a level vehicle.
        heights_m: of the ground at (k, 2) places.
        eyes: (p, 3) places of the pictures.
        yaws_deg: (p,) of the vehicle.
        centres: (n, 3) of the cells.
        normals: (n, 3) of the ground there.
    """
    fractions = (np.arange(RAY_SAMPLES) + 0.5) / RAY_SAMPLES
    tilt = math.radians(90.0 + sensor.pitch_deg)
    half_across, half_along = math.radians(sensor.fov_across_deg / 2.0), math.radians(sensor.fov_along_deg / 2.0)
    pixel_rad_at_axis = 2.0 * math.tan(half_across) / sensor.pixels_across
    for number, (eye, yaw_deg) in enumerate(zip(eyes, yaws_deg, strict=True)):
        forward, right, down = _rotation(0.0, 0.0, yaw_deg if sensor.heading_deg is None else sensor.heading_deg)
        axis = math.sin(tilt) * forward + math.cos(tilt) * down
        top = math.cos(tilt) * forward - math.sin(tilt) * down
        ray = centres - eye
        distance = np.linalg.norm(ray, axis=1)
        depth, across, along = ray @ axis, ray @ right, ray @ top
        incidence = np.degrees(np.arccos(np.clip(-(ray * normals).sum(axis=1) / distance, -1.0, 1.0)))
        spare = np.min(
            [
                half_across - np.abs(np.arctan2(across, depth)),
                half_along - np.abs(np.arctan2(along, depth)),
                np.radians(sensor.max_incidence_deg - incidence),
                (sensor.range_m - distance) / sensor.range_m,
            ],
            axis=0,
        )
        inside = spare >= 0.0
        line = eye + fractions[None, :, None] * ray[inside][:, None, :]
        clear_m = (line[..., 2] - heights_m(line[..., :2].reshape(-1, 2)).reshape(line.shape[:2]))[:, :-8].min(axis=1)
        doubtful = np.abs(spare) < 1e-9
        doubtful[np.flatnonzero(inside)[np.abs(clear_m) < GRAZING_M]] = True
        shown = np.flatnonzero(inside)[clear_m >= 0.0]
        # A pixel covers depth times its angle across the ray, and more where the ground is oblique to it.
        facing = -(ray[shown] * normals[shown]).sum(axis=1)
        sample = depth[shown] * pixel_rad_at_axis * np.sqrt(depth[shown] / facing)
        yield number, shown, sample, doubtful

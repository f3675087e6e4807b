"""Where the edges of pictures meet the ground."""

import numpy as np

from uavcover.extras.photos.placing import PlacedPictures
from uavcover.kernels.arrays import FloatArray
from uavcover.model.sensor import FrameCamera
from uavcover.scenario.ground import Ground

_A_SIDE = 4
_STEPS = 400
_HALVINGS = 20


def footprint_m(
    placed: PlacedPictures, number: int, sensor: FrameCamera, ground: Ground, *, reach_m: float
) -> FloatArray:
    """(k, 3) ENU, the places where the edge of a picture first meets the ground, in order around it.

    Rays that meet no ground within ``reach_m`` are left out; fewer than three places are no footprint.
    """
    eye, axis, top = placed.eyes_m[number], placed.axes[number], placed.tops[number]
    right = np.cross(axis, top)
    across = np.tan(np.radians(0.5 * sensor.fov_across_deg))
    along = np.tan(np.radians(0.5 * sensor.fov_along_deg))
    share = np.linspace(-1.0, 1.0, _A_SIDE + 1)[:-1]
    one = np.ones(_A_SIDE)
    x = np.concatenate([share, one, -share, -one]) * across
    y = np.concatenate([-one, share, one, -share]) * along
    rays = axis + x[:, None] * right + y[:, None] * top
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    distances = np.linspace(0.0, reach_m, _STEPS + 1)
    line = eye + distances[None, :, None] * rays[:, None, :]
    above = ground.heights_agl_m(line.reshape(-1, 3)).reshape(line.shape[:2])
    below = above < 0.0  # ground that is not known (NaN) stops no ray
    met = below.any(axis=1)
    first = np.argmax(below, axis=1)[met]
    low, high = distances[np.maximum(first - 1, 0)], distances[first]
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        under = ground.heights_agl_m(eye + middle[:, None] * rays[met]) < 0.0
        low, high = np.where(under, low, middle), np.where(under, middle, high)
    places: FloatArray = eye + high[:, None] * rays[met]
    return places

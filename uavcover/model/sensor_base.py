"""The interface of a sensor: its view for the kernels, its footprint on flat ground, how it is turned and triggered."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, TypeVar

import numpy as np

from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.kernels.sight import Sight

Sensing = Literal["at-waypoints", "along-path"]
LineOfSight = Literal["ray", "midpoint"]
Mount = Literal["fixed", "stabilised"]


@dataclass(frozen=True, slots=True)
class FlatPhoto:
    """Flat ground in view of a frame camera on a level vehicle: ``near_m`` to ``far_m`` ahead, negative is behind."""

    near_m: float  # near end of the photo's middle line, ahead of the vehicle
    far_m: float  # far end of it
    half_width_m: float  # half the photo's width where it is widest, what an overlap leaves of it

    @property
    def length_m(self) -> float:
        """Length of the photo's middle line."""
        return self.far_m - self.near_m


@dataclass(frozen=True, slots=True, eq=False)
class CameraTurn:
    """Directions of a camera, one row for each observation."""

    axes: FloatArray  # (k, 3) unit vectors in ENU along the viewing direction
    tops: FloatArray  # (k, 3) unit vectors perpendicular to them, towards the top of the photo
    known: BoolArray  # (k,) whether the required attitude is known; otherwise level and nose ahead are assumed


class Rays(NamedTuple):
    """Rays from a sensor to places on the ground, in metres; arrays of one shape."""

    depth: FloatArray  # part along the axis of the camera
    across: FloatArray  # part along the right of the photo, of either sign
    along: FloatArray  # part along the top of the photo, of either sign
    horizontal2: FloatArray  # squared length on the map
    distance2: FloatArray  # squared length


def rays_to(offsets: Iterable[FloatArray], axis: FloatArray, top: FloatArray) -> Rays:
    """Rays by their three parts to east, north and up, in the axes of a camera: (..., 3) unit vectors in ENU."""
    de, dn, du = offsets
    right, horizontal2 = np.cross(axis, top), de**2 + dn**2
    depth, across, along = (de * unit[..., 0] + dn * unit[..., 1] + du * unit[..., 2] for unit in (axis, right, top))
    return Rays(depth, across, along, horizontal2, horizontal2 + du**2)


class SensorBase(ABC):
    """A sensor. The defaults here are those of a sensor without a camera axis.

    A third-party package derives its sensor from one in ``model/sensor.py``, which is used to plan routes, and overrides
    :meth:`in_view`, which is used to compute the coverage.
    """

    __slots__ = ()
    kind: str  # name of this sensor in a scenario
    sensing: Sensing  # whether it observes only at the waypoints or along the path
    sample_spacing_m: float | None  # distance between observations along the path; None: by its footprint
    mount: Mount | None = None  # how its axis is mounted; None without an axis
    # heading at which a gimbal holds the top of its photo; None: that of the vehicle, or of no effect
    heading_deg: float | None = None
    # fraction of a photo's length that the next one shows again; None where it is not required
    forward_overlap: float | None = None
    side_overlap: float = 0.0  # fraction of a photo's width that the next swath shows again

    @property
    @abstractmethod
    def sight(self) -> Sight:
        """Its view for the kernels; only this property translates a sensor for them."""

    @abstractmethod
    def half_width_m(self, height_agl_m: float) -> float:
        """Half the swath width on flat ground from a height; 0 when the sensor does not reach the ground."""

    def strip_half_width_m(self, height_agl_m: float, heading_deg: float) -> float:  # noqa: ARG002
        """Half the swath width on flat ground along lines with a heading, in both directions of flight."""
        return self.half_width_m(height_agl_m)

    @abstractmethod
    def in_view(self, rays: Rays) -> BoolArray:
        """Whether places are in range and inside the field of view, without a test of what lies between.

        Limits of incidence and ground sample distance are tested elsewhere.
        """

    def surely_in_view(self, rays: Rays, *, offset_m: float, turn_rad: float) -> BoolArray:  # noqa: ARG002
        """Whether positions are in view from everywhere within an offset, at every turn; with its own view, none."""
        return np.zeros(rays.depth.shape, dtype=bool)

    def possibly_in_view(self, rays: Rays, *, offset_m: float, turn_rad: float) -> BoolArray:  # noqa: ARG002
        """Whether positions may be in view from somewhere within an offset, at some turn; with its own view, all."""
        return np.ones(rays.depth.shape, dtype=bool)

    @property
    def has_own_view(self) -> bool:
        """Whether its view is its own method instead of one that the kernels compute from :attr:`sight`."""
        return getattr(type(self).in_view, _COMPILED, None) is None

    @property
    def looks_along_path(self) -> bool:
        """Whether it observes along the path, and not at the waypoints alone."""
        return self.sensing == "along-path"

    @property
    def reach_m(self) -> float:
        """Upper bound on the horizontal distance of a visible cell."""
        return self.sight.reach_m

    @property
    def slant_range_m(self) -> float | None:
        """Largest distance of a visible cell; None where only the distance on the map counts."""
        return self.sight.reach_m

    @property
    def is_camera(self) -> bool:
        """Whether it looks along an axis, which turns with the vehicle or is held by a gimbal, and takes photos."""
        return self.mount is not None

    @property
    def pitch_deg(self) -> float | None:
        """Angle of its axis to the horizon; None without an axis."""
        return None

    @property
    def turns_with_vehicle(self) -> bool:
        """Whether its view depends on the vehicle's heading."""
        return False

    @property
    def focal_px(self) -> float:
        """Focal length in pixels; NaN if unknown."""
        return math.nan

    @property
    def requires_overlap(self) -> bool:
        """Whether it requires photos to overlap."""
        return bool(self.forward_overlap or self.side_overlap)

    @property
    def whole_photo(self) -> Sight:
        """The view of all of its photo, however coarse."""
        return self.sight

    @property
    def edges(self) -> FloatArray:
        """(k, 2) tangents to the right and to the top of its axis, around the edge of its view; (0, 2) without an axis."""
        return np.empty((0, 2))

    def flat_photo(self, height_agl_m: float) -> FlatPhoto | None:  # noqa: ARG002
        """Flat ground in a rectangular photo from a height; None without one, or no such photo."""
        return None

    def photo_spacing_m(self, lowest_agl_m: float) -> float | None:  # noqa: ARG002
        """Distance between two photos, triggered by distance, for the lowest height of the band; None: not so triggered."""
        return None

    def camera_turn(self, attitude_deg: FloatArray, courses_deg: FloatArray | None = None) -> CameraTurn:
        """Directions of its axis for the attitudes of its vehicle; straight down and known without a camera.

        A fixed camera shares the vehicle's roll, pitch and yaw. A stabilised one is level; the top of its photo keeps its
        heading, or follows the vehicle's yaw.

        Args:
            attitude_deg: (k, 3) roll, pitch and yaw; a row that a fixed camera needs and that is not finite is taken as level.
            courses_deg: (k,) yaws to take where the vehicle's is not known; default: north.
        """
        count, pitch_deg = len(attitude_deg), self.pitch_deg
        if pitch_deg is None:
            return CameraTurn(
                np.tile([0.0, 0.0, -1.0], (count, 1)), np.tile([0.0, 1.0, 0.0], (count, 1)), np.ones(count, bool)
            )
        north_up = np.zeros(count) if courses_deg is None else courses_deg
        if self.mount == "fixed":
            known = np.asarray(np.isfinite(attitude_deg).all(axis=1))
            angles = np.where(known[:, None], attitude_deg, np.column_stack([np.zeros((count, 2)), north_up]))
        else:
            yaw = np.full(count, self.heading_deg) if self.heading_deg is not None else attitude_deg[:, 2]
            known = np.isfinite(yaw)
            angles = np.column_stack([np.zeros((count, 2)), np.where(known, yaw, north_up)])
            # A circular nadir view needs no heading.
            known = known if self.turns_with_vehicle or self.heading_deg is not None else np.ones(count, dtype=bool)
        roll, pitch, yaw = np.radians(angles).T
        # The first and third column of the rotation from body (forward, right, down) to north-east-down, yaw-pitch-roll order.
        forward = (np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), -np.sin(pitch))
        down = (
            np.cos(roll) * np.sin(pitch) * np.cos(yaw) + np.sin(roll) * np.sin(yaw),
            np.cos(roll) * np.sin(pitch) * np.sin(yaw) - np.sin(roll) * np.cos(yaw),
            np.cos(roll) * np.cos(pitch),
        )
        off_nadir = np.radians(90.0 + pitch_deg)
        s, c = np.sin(off_nadir), np.cos(off_nadir)
        axes = _enu([s * f + c * d for f, d in zip(forward, down, strict=True)])
        tops = _enu([c * f - s * d for f, d in zip(forward, down, strict=True)])
        return CameraTurn(axes, tops, known)


_COMPILED = "_is_in_kernels"
Method = TypeVar("Method", bound=Callable[..., Any])


def in_kernels(method: Method) -> Method:
    """Mark a method that the compiled kernels also implement."""
    setattr(method, _COMPILED, True)
    return method


def _enu(north_east_down: list[FloatArray]) -> FloatArray:
    north, east, down = north_east_down
    return np.ascontiguousarray(np.column_stack([east, north, -down]))

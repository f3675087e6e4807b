"""Sensor models: sphere, planar disc (the paper's), nadir camera with a circular view, frame camera with a rectangular image."""

import math
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np

from mission_io.data_tables import STRICT, require, require_positive
from uavcover.errors import ScenarioError
from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.kernels.sight import CONE, DISC, FRUSTUM, MIDPOINT, NO_LINE_OF_SIGHT, RAY, SPHERE, Sight
from uavcover.model.sensor_base import FlatPhoto, LineOfSight, Mount, Rays, Sensing, SensorBase, in_kernels

_LINE_OF_SIGHT = {"ray": RAY, "midpoint": MIDPOINT}


@dataclass(frozen=True, slots=True, kw_only=True)
class SphereSensor(SensorBase):
    """A sensor that observes every cell centre within ``range_m`` in three dimensions and in line of sight (the paper's)."""

    __pydantic_config__: ClassVar = STRICT

    kind: Literal["sphere"]  # name of this sensor in a scenario
    range_m: float  # largest distance from the sensor to the centre of a cell
    sensing: Sensing = "at-waypoints"  # whether it observes only at the waypoints (the paper) or along the path
    line_of_sight: LineOfSight = "ray"  # "ray" against the whole surface, or "midpoint", the paper's Eq. 5.
    # distance between observations along the path; default: a sixth of what is seen across the path, 10 m at most
    sample_spacing_m: float | None = None

    def __post_init__(self) -> None:
        require_positive(self, "range_m", "sample_spacing_m")

    @property
    def sight(self) -> Sight:
        """See :class:`SensorBase`."""
        return Sight(SPHERE, self.range_m, 0.0, -1.0, _LINE_OF_SIGHT[self.line_of_sight])

    def half_width_m(self, height_agl_m: float) -> float:
        """See :class:`SensorBase`."""
        return math.sqrt(max(0.0, self.range_m**2 - height_agl_m**2))

    @in_kernels
    def in_view(self, rays: Rays) -> BoolArray:
        """See :class:`SensorBase`."""
        return np.asarray(rays.distance2 <= self.range_m**2)


@dataclass(frozen=True, slots=True, kw_only=True)
class DiscSensor(SensorBase):
    """A sensor that covers every cell within a horizontal radius, without occlusion.

    It is the planar reading of the paper's ``r = 1``.
    """

    __pydantic_config__: ClassVar = STRICT

    kind: Literal["disc"]  # name of this sensor in a scenario
    radius_m: float  # largest horizontal distance
    sensing: Sensing = "at-waypoints"  # at waypoints or along the path
    # distance between observations along the path; default: a sixth of what is seen across the path, 10 m at most
    sample_spacing_m: float | None = None

    def __post_init__(self) -> None:
        require_positive(self, "radius_m", "sample_spacing_m")

    @property
    def sight(self) -> Sight:
        """See :class:`SensorBase`."""
        return Sight(DISC, self.radius_m, 0.0, -1.0, NO_LINE_OF_SIGHT)

    @property
    def slant_range_m(self) -> float | None:
        """See :class:`SensorBase`."""
        return None

    def half_width_m(self, height_agl_m: float) -> float:  # noqa: ARG002
        """See :class:`SensorBase`."""
        return self.radius_m

    @in_kernels
    def in_view(self, rays: Rays) -> BoolArray:
        """See :class:`SensorBase`."""
        return np.asarray(rays.horizontal2 <= self.radius_m**2)


@dataclass(frozen=True, slots=True, kw_only=True)
class NadirCamera(SensorBase):
    """A camera that points straight down with a circular field of view.

    Planning assumes that it is level. Verification uses the flown roll and pitch, unless a gimbal keeps it level.
    """

    __pydantic_config__: ClassVar = STRICT

    kind: Literal["nadir-camera"]  # name of this sensor in a scenario
    fov_deg: float  # full opening angle of the cone
    range_m: float  # largest slant range
    max_incidence_deg: float = 75.0  # largest angle between the ray and the normal of the ground
    sensing: Sensing = "along-path"  # at waypoints or along the path
    line_of_sight: LineOfSight = "ray"  # "ray" or "midpoint"
    # distance between observations along the path; default: a sixth of what is seen across the path, 10 m at most
    sample_spacing_m: float | None = None
    # "fixed" to the vehicle, whose roll and pitch it shares, or "stabilised" by a gimbal that keeps it level
    mount: Mount = "fixed"
    # pixels along the diameter of the field of view, for ground sample distances; None: unknown
    pixels_across: int | None = None
    max_ground_sample_m: float | None = None  # largest ground sample distance; None: any

    def __post_init__(self) -> None:
        require_positive(self, "range_m", "sample_spacing_m")
        _require_angle("fov_deg", self.fov_deg)
        _require_incidence(self.max_incidence_deg)
        _require_pixels(self)

    @property
    def sight(self) -> Sight:
        """See :class:`SensorBase`."""
        return Sight(
            CONE,
            self.range_m,
            _tan_half(self.fov_deg),
            math.cos(math.radians(self.max_incidence_deg)),
            _LINE_OF_SIGHT[self.line_of_sight],
            sample_focal_m=_sample_focal_m(self.max_ground_sample_m, self.focal_px),
        )

    @property
    def pitch_deg(self) -> float:
        """See :class:`SensorBase`."""
        return -90.0

    @property
    def focal_px(self) -> float:
        """See :class:`SensorBase`."""
        return _focal_px(self.pixels_across, self.fov_deg)

    @property
    def whole_photo(self) -> Sight:
        """See :class:`SensorBase`."""
        return replace(self, max_ground_sample_m=None).sight

    @property
    def edges(self) -> FloatArray:
        """See :class:`SensorBase`."""
        turn, radius = np.linspace(0.0, 2.0 * np.pi, 33), _tan_half(self.fov_deg)
        return np.column_stack([radius * np.sin(turn), radius * np.cos(turn)])

    def half_width_m(self, height_agl_m: float) -> float:
        """See :class:`SensorBase`."""
        slant = math.sqrt(max(0.0, self.range_m**2 - height_agl_m**2))
        # On flat ground the incidence angle is the angle off the vertical.
        half_angle_deg = min(0.5 * self.fov_deg, self.max_incidence_deg)
        deepest = (self.sight.sample_focal_m**2 * height_agl_m) ** (1.0 / 3.0)
        radius = min(slant, height_agl_m * math.tan(math.radians(half_angle_deg)))
        return radius if height_agl_m <= deepest else 0.0

    @in_kernels
    def in_view(self, rays: Rays) -> BoolArray:
        """See :class:`SensorBase`."""
        across2 = rays.distance2 - rays.depth**2
        within = (rays.depth > 0.0) & (across2 <= (rays.depth * _tan_half(self.fov_deg)) ** 2)
        return np.asarray(within & (rays.distance2 <= self.range_m**2))


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameCamera(SensorBase):
    """A camera with a rectangular photo, at any pitch between straight down and straight ahead.

    Planning assumes a level vehicle heading along its legs. Verification uses the flown attitude.
    """

    __pydantic_config__: ClassVar = STRICT

    kind: Literal["frame-camera"]  # name of this sensor in a scenario
    fov_across_deg: float  # full angle between the left and the right side of the photo
    fov_along_deg: float  # full angle between its bottom and its top
    range_m: float  # largest slant range
    # angle of the camera's axis to the horizon: -90 is straight down, -30 is ahead and slightly down
    pitch_deg: float = -90.0
    # heading, clockwise from north, at which a gimbal holds the top of the photo (or the axis, if not straight down); None: that
    # of the vehicle, which follows its legs
    heading_deg: float | None = None
    max_incidence_deg: float = 75.0  # largest angle between the ray and the normal of the ground
    sensing: Sensing = "along-path"  # at waypoints, which requires a heading, or along the path
    line_of_sight: LineOfSight = "ray"  # "ray" or "midpoint"
    # distance between observations along the path, unless photos are taken by distance; default: a sixth of what is
    # seen across or along it, the shorter, 10 m at most
    sample_spacing_m: float | None = None
    # "fixed" to the vehicle, whose roll and pitch it shares, or "stabilised" by a gimbal that keeps it level
    mount: Mount = "fixed"
    # pixels from the left to the right side of the photo, for ground sample distances; None: unknown
    pixels_across: int | None = None
    max_ground_sample_m: float | None = None  # largest ground sample distance; None: any
    # fraction of a photo's length on the ground that the next one shows again, at the lowest height of the band; photos
    # are then taken by distance. None: not required.
    forward_overlap: float | None = None
    # fraction of a photo's width that the next swath shows again: a cell counts only in the central 1 - side_overlap of
    # the photo's width
    side_overlap: float = 0.0
    trigger_distance_m: float | None = None  # distance between two photos, instead of a forward overlap

    def __post_init__(self) -> None:
        require_positive(self, "range_m", "sample_spacing_m")
        _require_angle("fov_across_deg", self.fov_across_deg)
        _require_angle("fov_along_deg", self.fov_along_deg)
        require(
            -90.0 <= self.pitch_deg <= 0.0,
            f"pitch_deg: must be between -90 (straight down) and 0 (horizontal), not {self.pitch_deg}",
        )
        _require_incidence(self.max_incidence_deg)
        _require_pixels(self)
        require(
            self.heading_deg is None or 0.0 <= self.heading_deg < 360.0,
            f"heading_deg: must be at least 0 and below 360 (clockwise from north), not {self.heading_deg}",
        )
        require(
            self.heading_deg is None or self.mount == "stabilised",
            'heading_deg: this key requires mount = "stabilised"; a fixed camera turns with the vehicle, which follows its legs',
        )
        require(
            self.heading_deg is not None or self.sensing == "along-path",
            'heading_deg: this key is required with sensing = "at-waypoints", because no leg defines the heading of the photo',
        )
        self._require_overlaps()

    def _require_overlaps(self) -> None:
        for key, fraction in (("forward_overlap", self.forward_overlap), ("side_overlap", self.side_overlap)):
            require(fraction is None or 0.0 <= fraction < 1.0, f"{key}: must be at least 0 and below 1, not {fraction}")
        require_positive(self, "trigger_distance_m")
        require(
            self.forward_overlap is None or self.trigger_distance_m is None,
            "trigger_distance_m: use either this key or forward_overlap, not both",
        )
        for key, value in (("forward_overlap", self.forward_overlap), ("trigger_distance_m", self.trigger_distance_m)):
            require(
                value is None or self.sensing == "along-path",
                f'{key}: distance triggering requires sensing = "along-path"',
            )

    @property
    def sight(self) -> Sight:
        """See :class:`SensorBase`."""
        off_nadir = math.radians(90.0 + self.pitch_deg)
        heading = math.nan if self.heading_deg is None else math.radians(self.heading_deg)
        return Sight(
            FRUSTUM,
            self.range_m,
            _tan_half(self.fov_across_deg) * (1.0 - self.side_overlap),
            math.cos(math.radians(self.max_incidence_deg)),
            _LINE_OF_SIGHT[self.line_of_sight],
            tan_half_along=_tan_half(self.fov_along_deg),
            cos_pitch=math.sin(off_nadir),
            sin_pitch=-math.cos(off_nadir),
            heading_e=math.sin(heading),
            heading_n=math.cos(heading),
            sample_focal_m=_sample_focal_m(self.max_ground_sample_m, self.focal_px),
        )

    @property
    def turns_with_vehicle(self) -> bool:
        """See :class:`SensorBase`."""
        return self.heading_deg is None

    @property
    def focal_px(self) -> float:
        """See :class:`SensorBase`."""
        return _focal_px(self.pixels_across, self.fov_across_deg)

    @property
    def whole_photo(self) -> Sight:
        """See :class:`SensorBase`."""
        return replace(self, side_overlap=0.0, max_ground_sample_m=None).sight

    @property
    def edges(self) -> FloatArray:
        """See :class:`SensorBase`."""
        across, along = _tan_half(self.fov_across_deg), _tan_half(self.fov_along_deg)
        return np.array([[across, along], [-across, along], [-across, -along], [across, -along], [across, along]])

    def flat_photo(self, height_agl_m: float) -> FlatPhoto | None:
        """See :class:`SensorBase`."""
        sight = self.sight
        off_nadir, half = math.radians(90.0 + self.pitch_deg), math.radians(0.5 * self.fov_along_deg)
        # On flat ground the incidence angle is the angle off the vertical, and "facing" the height.
        slant = min(self.range_m, height_agl_m / max(sight.cos_max_incidence, 1e-12))
        if slant <= height_agl_m:
            return None
        farthest = math.sqrt(slant**2 - height_agl_m**2)
        near = max(height_agl_m * math.tan(off_nadir - half), -farthest)
        far = (
            farthest if off_nadir + half >= 0.5 * math.pi else min(height_agl_m * math.tan(off_nadir + half), farthest)
        )
        deepest = (sight.sample_focal_m**2 * height_agl_m) ** (1.0 / 3.0)
        # Depth of a place x ahead: height cos(off nadir) + x sin(off nadir).
        if -sight.sin_pitch * height_agl_m + near * sight.cos_pitch > deepest:
            return None
        if sight.cos_pitch > 0.0:
            far = min(far, (deepest + sight.sin_pitch * height_agl_m) / sight.cos_pitch)
        if far <= near:
            return None
        ahead = np.linspace(near, far, 41)
        depth = -sight.sin_pitch * height_agl_m + ahead * sight.cos_pitch
        width = np.minimum(sight.tan_half_fov * depth, np.sqrt(np.maximum(farthest**2 - ahead**2, 0.0)))
        return FlatPhoto(near, far, float(width.max()))

    def half_width_m(self, height_agl_m: float) -> float:
        """See :class:`SensorBase`. A photo with a fixed heading is crossed in any direction: half of its shorter side counts."""
        photo = self.flat_photo(height_agl_m)
        if photo is None:
            return 0.0
        return photo.half_width_m if self.heading_deg is None else min(photo.half_width_m, 0.5 * photo.length_m)

    def strip_half_width_m(self, height_agl_m: float, heading_deg: float) -> float:
        """See :class:`SensorBase`. Photos with a fixed heading overlap in a strip whose width depends on the lines' heading.

        Beside the line by ``level_m``, photos are as long along the line as in its middle. From there to their farthest corner
        they get shorter; where they are as long as the distance between two photos the strip ends. If all are shorter, it ends
        at ``level_m``.
        """
        photo = self.flat_photo(height_agl_m)
        if photo is None or self.heading_deg is None:
            return self.half_width_m(height_agl_m)
        turn = math.radians(heading_deg - self.heading_deg)
        across, along = abs(math.cos(turn)), abs(math.sin(turn))
        half_m = photo.half_width_m * across, 0.5 * photo.length_m * along
        corner_m, level_m = sum(half_m), abs(half_m[0] - half_m[1])
        longest_m = min(photo.length_m / max(across, 1e-9), 2.0 * photo.half_width_m / max(along, 1e-9))
        spacing_m = self.photo_spacing_m(height_agl_m) or 0.0
        return corner_m - min(1.0, spacing_m / longest_m) * (corner_m - level_m)

    def photo_spacing_m(self, lowest_agl_m: float) -> float | None:
        """See :class:`SensorBase`. With a forward overlap it is computed where a photo shows least.

        Raises:
            ScenarioError: from there it shows nothing.
        """
        if self.forward_overlap is None:
            return self.trigger_distance_m
        photo = self.flat_photo(lowest_agl_m)
        if photo is None:
            raise ScenarioError(
                f"sensor.forward_overlap: at limits.min_height_agl_m = {lowest_agl_m:g} m, a photo shows no level "
                "ground within the sensor's limits; change pitch_deg, range_m or max_ground_sample_m"
            )
        return (1.0 - self.forward_overlap) * photo.length_m

    @in_kernels
    def in_view(self, rays: Rays) -> BoolArray:
        """See :class:`SensorBase`."""
        sight = self.sight
        across = np.abs(rays.across) <= rays.depth * sight.tan_half_fov
        along = np.abs(rays.along) <= rays.depth * sight.tan_half_along
        return np.asarray(across & along & (rays.distance2 <= self.range_m**2))


def _require_angle(key: str, angle_deg: float) -> None:
    require(0.0 < angle_deg < 180.0, f"{key}: must be between 0 and 180 degrees, not {angle_deg}")


def _require_incidence(max_incidence_deg: float) -> None:
    require(
        0.0 < max_incidence_deg <= 90.0, f"max_incidence_deg: must be between 0 and 90 degrees, not {max_incidence_deg}"
    )


def _require_pixels(sensor: NadirCamera | FrameCamera) -> None:
    require_positive(sensor, "pixels_across", "max_ground_sample_m")
    require(
        sensor.max_ground_sample_m is None or sensor.pixels_across is not None,
        "max_ground_sample_m: this key requires pixels_across, which defines the size of a pixel",
    )


def _tan_half(angle_deg: float) -> float:
    return math.tan(math.radians(angle_deg) / 2.0)


def _focal_px(pixels_across: int | None, across_deg: float) -> float:
    return math.nan if pixels_across is None else pixels_across / (2.0 * _tan_half(across_deg))


def _sample_focal_m(max_ground_sample_m: float | None, focal_px: float) -> float:
    return math.inf if max_ground_sample_m is None else max_ground_sample_m * focal_px


Sensor = SphereSensor | DiscSensor | NadirCamera | FrameCamera

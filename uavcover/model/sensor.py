"""Sensor models: sphere, planar disc (the paper's), nadir camera with a circular view, frame camera with a rectangular image."""

from dataclasses import dataclass
from typing import ClassVar, Literal

from uavcover.model.value_checks import STRICT, require, require_positive

Sensing = Literal["at-waypoints", "along-path"]
LineOfSight = Literal["ray", "midpoint"]
Mount = Literal["fixed", "stabilised"]


@dataclass(frozen=True, slots=True, kw_only=True)
class SphereSensor:
    """A sensor that sees every cell centre within ``range_m`` in three dimensions and in line of sight (the paper's).

    Attributes:
        kind: name of this sensor in a scenario.
        range_m: largest distance from the sensor to the centre of a cell.
        sensing: whether it observes only at the waypoints (the paper) or along the path.
        line_of_sight: "ray" against the whole surface, or "midpoint", the paper's Eq. 5.
        sample_spacing_m: distance between observations along the path; default: a sixth of what is seen across the path, 10 m at
            most.
    """

    __pydantic_config__: ClassVar = STRICT

    kind: Literal["sphere"]
    range_m: float
    sensing: Sensing = "at-waypoints"
    line_of_sight: LineOfSight = "ray"
    sample_spacing_m: float | None = None

    def __post_init__(self) -> None:
        require_positive(range_m=self.range_m)
        _require_spacing(self.sample_spacing_m)


@dataclass(frozen=True, slots=True, kw_only=True)
class DiscSensor:
    """A sensor that covers every cell within a horizontal radius, without occlusion: the planar reading of the paper's ``r = 1``.

    Attributes:
        kind: name of this sensor in a scenario.
        radius_m: largest horizontal distance.
        sensing: at waypoints or along the path.
        sample_spacing_m: distance between observations along the path; default: a sixth of what is seen across the path, 10 m at
            most.
    """

    __pydantic_config__: ClassVar = STRICT

    kind: Literal["disc"]
    radius_m: float
    sensing: Sensing = "at-waypoints"
    sample_spacing_m: float | None = None

    def __post_init__(self) -> None:
        require_positive(radius_m=self.radius_m)
        _require_spacing(self.sample_spacing_m)


@dataclass(frozen=True, slots=True, kw_only=True)
class NadirCamera:
    """A camera that points straight down with a circular field of view.

    Planning assumes that it is level. Verification uses the flown roll and pitch, unless a gimbal keeps it level.

    Attributes:
        kind: name of this sensor in a scenario.
        fov_deg: full opening angle of the cone.
        range_m: largest slant range.
        max_incidence_deg: largest angle between the ray and the normal of the ground.
        sensing: at waypoints or along the path.
        line_of_sight: "ray" or "midpoint".
        sample_spacing_m: distance between observations along the path; default: a sixth of what is seen across the path, 10 m at
            most.
        mount: "fixed" to the vehicle, whose roll and pitch it shares, or "stabilised" by a gimbal that keeps it level.
        pixels_across: pixels along the diameter of the field of view, for ground sample distances; none: unknown.
        max_ground_sample_m: largest ground sample distance; none: any.
    """

    __pydantic_config__: ClassVar = STRICT

    kind: Literal["nadir-camera"]
    fov_deg: float
    range_m: float
    max_incidence_deg: float = 75.0
    sensing: Sensing = "along-path"
    line_of_sight: LineOfSight = "ray"
    sample_spacing_m: float | None = None
    mount: Mount = "fixed"
    pixels_across: int | None = None
    max_ground_sample_m: float | None = None

    def __post_init__(self) -> None:
        require_positive(range_m=self.range_m)
        _require_spacing(self.sample_spacing_m)
        _require_angle("fov_deg", self.fov_deg)
        _require_incidence(self.max_incidence_deg)
        _require_pixels(self.pixels_across, self.max_ground_sample_m)


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameCamera:
    """A camera with a rectangular photo, at any pitch between straight down and straight ahead.

    Planning assumes a level vehicle heading along its legs. Verification uses the flown attitude.

    Attributes:
        kind: name of this sensor in a scenario.
        fov_across_deg: full angle between the left and the right side of the photo.
        fov_along_deg: full angle between its bottom and its top.
        range_m: largest slant range.
        pitch_deg: angle of the camera's axis to the horizon: -90 is straight down, -30 is ahead and slightly down.
        heading_deg: heading, clockwise from north, at which a gimbal holds the top of the photo (or the axis, if not straight
            down); none: that of the vehicle, which follows its legs.
        max_incidence_deg: largest angle between the ray and the normal of the ground.
        sensing: at waypoints, which requires a heading, or along the path.
        line_of_sight: "ray" or "midpoint".
        sample_spacing_m: distance between observations along the path, unless photos are taken by distance; default: a sixth of
            what is seen across or along it, the shorter, 10 m at most.
        mount: "fixed" to the vehicle, whose roll and pitch it shares, or "stabilised" by a gimbal that keeps it level.
        pixels_across: pixels from the left to the right side of the photo, for ground sample distances; none: unknown.
        max_ground_sample_m: largest ground sample distance; none: any.
        forward_overlap: fraction of a photo's length on the ground that the next one shows again, at the lowest height of
            the band; photos are then taken by distance. None: not required.
        side_overlap: fraction of a photo's width that the next swath shows again: a cell counts only in the central
            1 - side_overlap of the photo's width.
        trigger_distance_m: distance between two photos, instead of a forward overlap.
    """

    __pydantic_config__: ClassVar = STRICT

    kind: Literal["frame-camera"]
    fov_across_deg: float
    fov_along_deg: float
    range_m: float
    pitch_deg: float = -90.0
    heading_deg: float | None = None
    max_incidence_deg: float = 75.0
    sensing: Sensing = "along-path"
    line_of_sight: LineOfSight = "ray"
    sample_spacing_m: float | None = None
    mount: Mount = "fixed"
    pixels_across: int | None = None
    max_ground_sample_m: float | None = None
    forward_overlap: float | None = None
    side_overlap: float = 0.0
    trigger_distance_m: float | None = None

    def __post_init__(self) -> None:
        require_positive(range_m=self.range_m)
        _require_spacing(self.sample_spacing_m)
        _require_angle("fov_across_deg", self.fov_across_deg)
        _require_angle("fov_along_deg", self.fov_along_deg)
        require(
            -90.0 <= self.pitch_deg <= 0.0,
            f"pitch_deg: {self.pitch_deg} is outside -90 (straight down)..0 (to the horizon)",
        )
        _require_incidence(self.max_incidence_deg)
        _require_pixels(self.pixels_across, self.max_ground_sample_m)
        require(
            self.heading_deg is None or 0.0 <= self.heading_deg < 360.0,
            f"heading_deg: {self.heading_deg} is outside 0 to below 360, clockwise from north",
        )
        require(
            self.heading_deg is None or self.mount == "stabilised",
            'heading_deg: requires mount = "stabilised"; a fixed camera turns with the vehicle, which follows its legs',
        )
        require(
            self.heading_deg is not None or self.sensing == "along-path",
            'heading_deg: is needed with sensing = "at-waypoints", because no leg defines the heading of the photo',
        )
        self._require_overlaps()

    def _require_overlaps(self) -> None:
        for key, share in (("forward_overlap", self.forward_overlap), ("side_overlap", self.side_overlap)):
            require(share is None or 0.0 <= share < 1.0, f"{key}: {share} is not a share of a photo, 0 to below 1")
        require(self.trigger_distance_m is None or self.trigger_distance_m > 0.0, "trigger_distance_m: must be above 0")
        require(
            self.forward_overlap is None or self.trigger_distance_m is None,
            "trigger_distance_m: give it or forward_overlap, not both",
        )
        for key, value in (("forward_overlap", self.forward_overlap), ("trigger_distance_m", self.trigger_distance_m)):
            require(
                value is None or self.sensing == "along-path",
                f'{key}: distance triggering requires sensing = "along-path"',
            )


def _require_spacing(sample_spacing_m: float | None) -> None:
    if sample_spacing_m is not None:
        require_positive(sample_spacing_m=sample_spacing_m)


def _require_angle(key: str, angle_deg: float) -> None:
    require(0.0 < angle_deg < 180.0, f"{key}: {angle_deg} is outside 0..180 degrees")


def _require_incidence(max_incidence_deg: float) -> None:
    require(0.0 < max_incidence_deg <= 90.0, f"max_incidence_deg: {max_incidence_deg} is outside 0..90 degrees")


def _require_pixels(pixels_across: int | None, max_ground_sample_m: float | None) -> None:
    require(pixels_across is None or pixels_across > 0, "pixels_across: must be above 0")
    require(max_ground_sample_m is None or max_ground_sample_m > 0.0, "max_ground_sample_m: must be above 0")
    require(
        max_ground_sample_m is None or pixels_across is not None,
        "max_ground_sample_m: needs pixels_across, from which the size of a pixel follows",
    )


Camera = NadirCamera | FrameCamera
Sensor = SphereSensor | DiscSensor | NadirCamera | FrameCamera

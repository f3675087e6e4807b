"""What sees: a sphere, the paper's planar disc, or a camera that looks straight down."""

from dataclasses import dataclass
from typing import ClassVar, Literal

from uavcover.model.checks import STRICT, require, require_positive

Sensing = Literal["at-waypoints", "along-path"]
LineOfSight = Literal["ray", "midpoint"]
Mount = Literal["fixed", "stabilised"]


@dataclass(frozen=True, slots=True, kw_only=True)
class SphereSensor:
    """Sees every cell whose centre is within ``range_m`` in three dimensions and in line of sight (the paper's sensor).

    Attributes:
        kind: names this sensor in a scenario.
        range_m: largest distance from the sensor to the centre of a cell.
        sensing: whether it looks only at the waypoints (the paper) or all along the path.
        line_of_sight: "ray" against the whole surface, or "midpoint", the paper's Eq. 5.
        sample_spacing_m: distance between looks when sensing along the path.
    """

    __pydantic_config__: ClassVar = STRICT

    kind: Literal["sphere"]
    range_m: float
    sensing: Sensing = "at-waypoints"
    line_of_sight: LineOfSight = "ray"
    sample_spacing_m: float = 10.0

    def __post_init__(self) -> None:
        require_positive(range_m=self.range_m, sample_spacing_m=self.sample_spacing_m)


@dataclass(frozen=True, slots=True, kw_only=True)
class DiscSensor:
    """Sees every cell within a horizontal radius, whatever lies between: the planar reading of the paper's ``r = 1``.

    Attributes:
        kind: names this sensor in a scenario.
        radius_m: largest horizontal distance.
        sensing: at waypoints or all along the path.
        sample_spacing_m: distance between looks when sensing along the path.
    """

    __pydantic_config__: ClassVar = STRICT

    kind: Literal["disc"]
    radius_m: float
    sensing: Sensing = "at-waypoints"
    sample_spacing_m: float = 10.0

    def __post_init__(self) -> None:
        require_positive(radius_m=self.radius_m, sample_spacing_m=self.sample_spacing_m)


@dataclass(frozen=True, slots=True, kw_only=True)
class NadirCamera:
    """A camera that looks straight down through a round field of view.

    Planning takes it as level. Verification takes the flown track's roll and pitch, unless a gimbal keeps it level.

    Attributes:
        kind: names this sensor in a scenario.
        fov_deg: full opening angle of the cone.
        range_m: largest slant range.
        max_incidence_deg: largest angle between the ray and the normal of the ground.
        sensing: at waypoints or all along the path.
        line_of_sight: "ray" or "midpoint".
        sample_spacing_m: distance between looks when sensing along the path.
        mount: "fixed" to the vehicle, whose roll and pitch it shares, or "stabilised" by a gimbal that keeps it level.
        pixels_across: pixels along the diameter of the field of view, for ground sample distances; none: not known.
    """

    __pydantic_config__: ClassVar = STRICT

    kind: Literal["nadir-camera"]
    fov_deg: float
    range_m: float
    max_incidence_deg: float = 75.0
    sensing: Sensing = "along-path"
    line_of_sight: LineOfSight = "ray"
    sample_spacing_m: float = 10.0
    mount: Mount = "fixed"
    pixels_across: int | None = None

    def __post_init__(self) -> None:
        require(self.pixels_across is None or self.pixels_across > 0, "pixels_across: must be above 0")
        require_positive(range_m=self.range_m, sample_spacing_m=self.sample_spacing_m)
        require(0.0 < self.fov_deg < 180.0, f"fov_deg: {self.fov_deg} is outside 0..180 degrees")
        require(
            0.0 < self.max_incidence_deg <= 90.0,
            f"max_incidence_deg: {self.max_incidence_deg} is outside 0..90 degrees",
        )


Sensor = SphereSensor | DiscSensor | NadirCamera

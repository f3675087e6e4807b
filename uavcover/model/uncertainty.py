"""How well it is known where the vehicle and the ground were."""

from dataclasses import dataclass
from typing import ClassVar

from uavcover.model.checks import STRICT, require, require_not_negative


@dataclass(frozen=True, slots=True, kw_only=True)
class Uncertainty:
    """Largest errors that a verdict has to stand; all 0: what was measured is taken as exact.

    Each is a bound, not a standard deviation, and is taken as constant over the rays of one look.

    Attributes:
        position_m: horizontal error of the flown positions.
        height_m: vertical error of the flown positions.
        terrain_m: vertical error of the elevation data, against the true ground. What the ground in use differs from the data
            is measured and added to it.
        attitude_deg: error of the camera's direction.
    """

    __pydantic_config__: ClassVar = STRICT

    position_m: float = 0.0
    height_m: float = 0.0
    terrain_m: float = 0.0
    attitude_deg: float = 0.0

    def __post_init__(self) -> None:
        require_not_negative(
            position_m=self.position_m,
            height_m=self.height_m,
            terrain_m=self.terrain_m,
            attitude_deg=self.attitude_deg,
        )
        require(self.attitude_deg < 90.0, f"attitude_deg: {self.attitude_deg} is no error of a camera; below 90")

    @property
    def vertical_m(self) -> float:
        """Largest error of a height above ground: of the vehicle and of the terrain together."""
        return self.height_m + self.terrain_m

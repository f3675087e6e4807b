"""Several vehicles of one kind that fly one plan."""

from dataclasses import dataclass
from typing import ClassVar

from uavcover.model.value_checks import STRICT, require, require_not_negative, require_positive


@dataclass(frozen=True, slots=True, kw_only=True)
class Fleet:
    """How many vehicles there are, and what keeps them apart. They are all alike ([vehicle]) and take off and land at [home].

    Attributes:
        vehicles: how many fly at the same time.
        turnaround_s: from a vehicle's landing to its next take-off, with a new battery.
        separation_m: least distance in space between two vehicles in flight, along their planned paths.
        timing_error_fraction: share of the time since its take-off by which a vehicle may be early or late.
        start_error_s: by how much its take-off may be early or late.
        pad_s: how long a vehicle stands at home before its take-off and after its landing; no other one may be near then.
    """

    __pydantic_config__: ClassVar = STRICT

    vehicles: int = 1
    turnaround_s: float = 300.0
    separation_m: float = 20.0
    timing_error_fraction: float = 0.05
    start_error_s: float = 5.0
    pad_s: float = 30.0

    def __post_init__(self) -> None:
        require(1 <= self.vehicles <= 50, f"vehicles: {self.vehicles} is outside 1..50")
        require_not_negative(turnaround_s=self.turnaround_s, start_error_s=self.start_error_s, pad_s=self.pad_s)
        require_positive(separation_m=self.separation_m)
        require(
            0.0 <= self.timing_error_fraction <= 0.5,
            f"timing_error_fraction: {self.timing_error_fraction} is outside 0..0.5",
        )

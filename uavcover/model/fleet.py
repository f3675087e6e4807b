"""Several vehicles that fly one plan: how many there are, and what keeps them apart."""

from dataclasses import dataclass
from typing import ClassVar

from uavcover.model.value_checks import STRICT, require, require_not_negative, require_positive


@dataclass(frozen=True, slots=True, kw_only=True)
class Fleet:
    """Number of vehicles, and their separation.

    All vehicles are equal ([vehicle]) and have take-off pads at and beside [home], unless each has its own [[vehicle]].

    Attributes:
        vehicles: number of vehicles that fly at the same time.
        turnaround_s: time from the landing of a vehicle to its next take-off with a new battery.
        separation_m: smallest distance between two vehicles in flight.
        path_error_m: possible deviation of a vehicle from its planned path. Planned paths are separated by twice this
            distance more.
        timing_error_fraction: fraction of the time since take-off by which a vehicle may be early or late.
        start_error_s: time by which a take-off may be early or late.
        clock_error_s: possible difference between the arrival times of positions from two vehicles, because of link
            delays or several computers. Verification uses it.
        pad_s: time that a vehicle stands at home before take-off and after landing. No other vehicle may be close
            during this time.
        pad_spacing_m: distance between the take-off pads of equal vehicles. The first pad is [home]; a plan names the others.
            Default, and least: `separation_m`, twice `path_error_m` and twice `limits.max_home_error_m`. 0: all vehicles take
            off from [home], one after the other.
        max_pad_slope_deg: steepest ground of a pad.
        one_at_a_time: whether only one vehicle flies at a time. Each takes off `turnaround_s` after the previous
            landing. This always applies to a vehicle with several launch points ([[launch_point]]).
    """

    __pydantic_config__: ClassVar = STRICT

    vehicles: int = 1
    turnaround_s: float = 300.0
    separation_m: float = 20.0
    path_error_m: float = 3.0
    timing_error_fraction: float = 0.05
    start_error_s: float = 5.0
    clock_error_s: float = 0.5
    pad_s: float = 30.0
    pad_spacing_m: float | None = None
    max_pad_slope_deg: float = 15.0
    one_at_a_time: bool = False

    def __post_init__(self) -> None:
        require(1 <= self.vehicles <= 50, f"vehicles: {self.vehicles} is outside 1..50")
        require_not_negative(turnaround_s=self.turnaround_s, start_error_s=self.start_error_s, pad_s=self.pad_s)
        require_not_negative(pad_spacing_m=self.pad_spacing_m or 0.0)
        require_not_negative(path_error_m=self.path_error_m, clock_error_s=self.clock_error_s)
        require_positive(separation_m=self.separation_m)
        require(
            0.0 <= self.timing_error_fraction <= 0.5,
            f"timing_error_fraction: {self.timing_error_fraction} is outside 0..0.5",
        )
        require(0.0 < self.max_pad_slope_deg < 90.0, f"max_pad_slope_deg: {self.max_pad_slope_deg} is outside 0..90")

    @property
    def planned_separation_m(self) -> float:
        """Least distance between planned paths: each vehicle may be beside its own."""
        return self.separation_m + 2.0 * self.path_error_m

    @property
    def held_apart_m(self) -> float:
        """Distance below which one of two vehicles holds its position: both positions are known, and only one of them moves."""
        return self.separation_m + self.path_error_m

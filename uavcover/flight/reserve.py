"""Battery use of a flight: whether the charge lasts for the rest of the mission, or only for the return."""

import math
from dataclasses import dataclass
from enum import Enum

from uavcover.flight.tuning import RESERVE
from uavcover.model.vehicle import Vehicle


class BatteryAllows(Enum):
    """Flight that a battery allows."""

    GO_ON = "it is sufficient to continue"
    GO_HOME = "it is only sufficient for the return"


@dataclass(slots=True)
class BatteryUse:
    """Battery use of a flight. Knows no clock: times are arguments."""

    vehicle: Vehicle  # with its endurance and reserve
    planned_each_s: float  # percent that a second in the air is planned to use
    # time in the air, and the charge at the first report after the climb; none before
    first: tuple[float, float] | None = None
    percent: float = math.nan  # its latest report
    aloft_s: float = 0.0  # time in the air by then

    def take(self, percent: float, *, aloft_s: float) -> None:
        """Take the battery's report at a time after take-off."""
        if self.first is None and aloft_s >= RESERVE.climb_s:
            self.first = aloft_s, percent
        self.percent, self.aloft_s = percent, aloft_s

    @property
    def each_s(self) -> float:
        """Percent of the battery for a second in the air: planned at first, measured once it reports any use."""
        if self.first is None or self.aloft_s - self.first[0] < RESERVE.measured_s or self.percent >= self.first[1]:
            return self.planned_each_s
        return (self.first[1] - self.percent) / (self.aloft_s - self.first[0])

    @property
    def spare(self) -> float:
        """Percent above the reserve."""
        return self.percent - RESERVE.rounding_percent - 100.0 * self.vehicle.reserve_fraction

    def lasts_home(self, seconds: float) -> bool:
        """Whether the return can still be begun a moment later."""
        return self.spare > RESERVE.use_home_ratio * self.each_s * (seconds + RESERVE.to_turn_s)

    def lasts_on(self, seconds: float) -> bool:
        """Whether so much more of the mission keeps the reserve."""
        return self.spare >= RESERVE.use_on_ratio * self.each_s * seconds

    def may_wait_s(self, seconds: float) -> float:
        """Time that it may hold before a rest of the mission; infinite while the battery reports nothing."""
        if math.isnan(self.percent):
            return math.inf
        return self.spare / self.each_s - RESERVE.use_on_ratio * seconds

    def allows(self, *, rest_s: float, home_s: float) -> BatteryAllows:
        """Flight that it allows, for ``rest_s`` to the landing by the mission and ``home_s`` straight home."""
        if home_s + RESERVE.to_turn_s >= rest_s or self.lasts_home(home_s) or self.lasts_on(rest_s):
            return BatteryAllows.GO_ON
        return BatteryAllows.GO_HOME

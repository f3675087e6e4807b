"""The wind that a flight is planned for."""

from dataclasses import dataclass
from typing import ClassVar

from uavcover.model.checks import STRICT, require, require_not_negative


@dataclass(frozen=True, slots=True, kw_only=True)
class Wind:
    """One wind for the whole flight.

    Attributes:
        speed_m_s: horizontal.
        from_deg: where it comes from, clockwise from north.
    """

    __pydantic_config__: ClassVar = STRICT

    speed_m_s: float = 0.0
    from_deg: float = 0.0

    def __post_init__(self) -> None:
        require_not_negative(speed_m_s=self.speed_m_s)
        require(abs(self.from_deg) <= 360.0, f"from_deg: {self.from_deg} is outside -360..360 degrees")

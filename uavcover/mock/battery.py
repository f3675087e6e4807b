"""The battery: power by the momentum theory of rotors, remaining charge, and the voltage that shows it."""

import math
from dataclasses import dataclass
from typing import Self

from uavcover.mock.dynamics import GRAVITY_M_S2
from uavcover.model.vehicle import Vehicle

_RESERVE = 0.2
_IDLE_SHARE = 0.03
"""Share of the hovering power that the electronics draw, with motors on or off."""
_DESCENT_GAIN = 0.3
"""Share of the potential energy of a descent that the rotors recover."""
_CELLS = 4
_FULL_V, _EMPTY_V = 4.2, 3.4
_SAG_V = 0.12
"""Voltage sag of a cell at hovering current."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BatteryData:
    """A battery and the multirotor that it carries.

    Attributes:
        endurance_s: hovering time on a full charge; a day by default, so that no flight ends unexpectedly.
        hover_w: hovering power.
        hover_induced_m_s: induced velocity in hover.
        drag_1_s: the airframe's drag: acceleration per metre per second of air speed.
    """

    endurance_s: float = 86_400.0
    hover_w: float = 300.0
    hover_induced_m_s: float = 6.0
    drag_1_s: float = 0.2

    def __post_init__(self) -> None:
        for name in self.__slots__:
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name}: {getattr(self, name)} must be above 0")

    @classmethod
    def for_vehicle(cls, vehicle: Vehicle) -> Self:
        """The battery of the vehicle that a scenario plans with: its longest flight leaves a fifth of the charge."""
        if vehicle.endurance_s is None:
            return cls()
        return cls(endurance_s=vehicle.endurance_s / (1.0 - _RESERVE))


def power_share(airspeed_m_s: float, climb_m_s: float, data: BatteryData) -> float:
    """Power of level or climbing flight as a multiple of the hovering power.

    Induced power by Glauert's momentum theory of a rotor in forward flight (Leishman, Principles of Helicopter
    Aerodynamics, 2.14), drag and climb on top; all per thrust, with the rotor's losses as in hovering.
    """
    hover, half = data.hover_induced_m_s, 0.5 * airspeed_m_s**2
    induced_m_s = math.sqrt(math.sqrt(half**2 + hover**4) - half)  # v_i^4 + V^2 v_i^2 = v_h^4
    drag_m_s = data.drag_1_s * airspeed_m_s**2 / GRAVITY_M_S2
    upwards_m_s = climb_m_s if climb_m_s > 0.0 else _DESCENT_GAIN * climb_m_s
    return max(0.0, (induced_m_s + drag_m_s + upwards_m_s) / hover) * (1.0 - _IDLE_SHARE) + _IDLE_SHARE


class Battery:
    """Charge over time.

    Attributes:
        remaining: state of charge; 1 is full.
        power_w: present power.
    """

    def __init__(self, data: BatteryData, *, remaining: float = 1.0) -> None:
        if not 0.0 < remaining <= 1.0:
            raise ValueError(f"remaining: {remaining} is not above 0 and up to 1")
        self.data = data
        self.remaining = remaining
        self.capacity_wh = data.hover_w * data.endurance_s / 3600.0
        self.power_w = data.hover_w * _IDLE_SHARE

    @property
    def capacity_mah(self) -> float:
        """Capacity at nominal voltage."""
        return 1000.0 * self.capacity_wh / (_CELLS * 0.5 * (_FULL_V + _EMPTY_V))

    @property
    def voltage_v(self) -> float:
        """Terminal voltage under the present load."""
        open_v = _EMPTY_V + (_FULL_V - _EMPTY_V) * self.remaining
        return _CELLS * (open_v - _SAG_V * self.power_w / self.data.hover_w)

    @property
    def current_a(self) -> float:
        """Present current."""
        return self.power_w / self.voltage_v

    @property
    def time_left_s(self) -> float:
        """Time until it is empty at the present power."""
        return self.remaining * self.capacity_wh * 3600.0 / self.power_w

    def fly(self, seconds: float, *, airspeed_m_s: float, climb_m_s: float) -> None:
        """Draw the power of flight."""
        self._draw(seconds, power_share(airspeed_m_s, climb_m_s, self.data))

    def idle(self, seconds: float) -> None:
        """Draw the power of the electronics."""
        self._draw(seconds, _IDLE_SHARE)

    def drop_to(self, remaining: float) -> None:
        """Drop to this charge at once, as a battery with a bad cell does; a lower charge stays as it is."""
        self.remaining = min(self.remaining, remaining)

    def _draw(self, seconds: float, share: float) -> None:
        self.power_w = self.data.hover_w * share
        self.remaining = max(0.0, self.remaining - share * seconds / self.data.endurance_s)

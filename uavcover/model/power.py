"""Power model of a multirotor: the parameters of its battery use, with the origin of their defaults."""

import math
from dataclasses import dataclass
from typing import ClassVar

from uavcover.model.value_checks import STRICT, require, require_not_negative, require_positive

AIR_KG_M3 = 1.225
"""Density of the standard atmosphere at sea level."""
GRAVITY_M_S2 = 9.80665
_INDUCED_M_S = 6.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PowerModel:
    """Power model of the vehicle, relative to hovering. Hovering for ``endurance_s`` empties a full battery.

    Induced power decreases with the airspeed (Glauert; Leishman, Principles of Helicopter Aerodynamics, 2.14). The drag of
    blades, rotors and body increases with it. A climb needs additional power. The defaults suit a 2 kg quadcopter with
    10 inch rotors.

    Attributes:
        mass_kg: take-off mass at which the vehicle hovers for `endurance_s`.
        payload_kg: additional mass. The hover power increases with the mass to the power of 1.5.
        rotor_area_m2: total disc area of all rotors. Together with `mass_kg`, it determines the induced velocity.
        hover_induced_m_s: induced velocity in hover at `mass_kg`; default: computed from `mass_kg` and `rotor_area_m2`,
            or 6.
        profile_share: fraction of the hover power of the rotors that overcomes blade drag; 0.474 in Zeng et al. 2019.
        tip_speed_m_s: speed of the blade tips.
        rotor_drag_1_s: rotor drag as acceleration per metre per second of airspeed.
        body_drag_area_m2: drag coefficient times frontal area of the body; requires `mass_kg`.
        idle_share: fraction of the hover power that the electronics use.
        descent_gain: fraction of the potential energy that a descent recovers.
        uncertainty_fraction: margin for the battery use, as a fraction. Sorties are planned with this margin.
    """

    __pydantic_config__: ClassVar = STRICT

    mass_kg: float | None = None
    payload_kg: float = 0.0
    rotor_area_m2: float | None = None
    hover_induced_m_s: float | None = None
    profile_share: float = 0.0
    tip_speed_m_s: float = 120.0
    rotor_drag_1_s: float = 0.2
    body_drag_area_m2: float = 0.0
    idle_share: float = 0.03
    descent_gain: float = 0.3
    uncertainty_fraction: float = 0.05

    def __post_init__(self) -> None:
        require_positive(tip_speed_m_s=self.tip_speed_m_s)
        require_not_negative(
            payload_kg=self.payload_kg, rotor_drag_1_s=self.rotor_drag_1_s, body_drag_area_m2=self.body_drag_area_m2
        )
        for key in ("mass_kg", "rotor_area_m2", "hover_induced_m_s"):
            value = getattr(self, key)
            require(value is None or (math.isfinite(value) and value > 0.0), f"{key}: {value} must be above 0")
        require(0.0 <= self.profile_share < 1.0, f"profile_share: {self.profile_share} is outside 0..1")
        require(0.0 <= self.idle_share < 1.0, f"idle_share: {self.idle_share} is outside 0..1")
        require(0.0 <= self.descent_gain <= 1.0, f"descent_gain: {self.descent_gain} is outside 0..1")
        require(
            0.0 <= self.uncertainty_fraction <= 1.0,
            f"uncertainty_fraction: {self.uncertainty_fraction} is outside 0..1",
        )
        for key in ("payload_kg", "rotor_area_m2", "body_drag_area_m2"):
            require(not getattr(self, key) or self.mass_kg is not None, f"{key}: this key requires mass_kg")
        require(
            self.rotor_area_m2 is None or self.hover_induced_m_s is None,
            "hover_induced_m_s: rotor_area_m2 defines it already; remove one of them",
        )

    @property
    def load(self) -> float:
        """Factor on the mass that hovers for ``endurance_s``, with payload."""
        return 1.0 if self.mass_kg is None else 1.0 + self.payload_kg / self.mass_kg

    @property
    def hover_factor(self) -> float:
        """Power in hover with the payload, as a multiple of that without: thrust times induced velocity."""
        return math.pow(self.load, 1.5)

    @property
    def induced_m_s(self) -> float:
        """Induced velocity in hover with the payload, ``sqrt(weight / (2 density area))``."""
        if self.mass_kg is not None and self.rotor_area_m2 is not None:
            weight_n = self.mass_kg * self.load * GRAVITY_M_S2
            return math.sqrt(weight_n / (2.0 * AIR_KG_M3 * self.rotor_area_m2))
        return (self.hover_induced_m_s or _INDUCED_M_S) * math.sqrt(self.load)

    @property
    def body_drag_1_m(self) -> float:
        """Drag of the body as acceleration per square of the airspeed."""
        if self.mass_kg is None:
            return 0.0
        return 0.5 * AIR_KG_M3 * self.body_drag_area_m2 / (self.mass_kg * self.load)

"""What the user wants done when a flight goes wrong, and before it begins."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum

from uavcover.flight.outcome import Ending


class OnBreach(Enum):
    """What to do when the vehicle leaves its route, its fence, its height band or known ground, or has another mission."""

    TELL = "tell"
    HOLD = "hold"
    RETURN = "return"


BREACHES = frozenset(
    {
        Ending.OFF_ROUTE,
        Ending.WIND_ABOVE_LIMITS,
        Ending.FENCE_BREACHED,
        Ending.BAND_LEFT,
        Ending.GROUND_UNKNOWN,
        Ending.MISSION_CHANGED,
    }
)
"""What is acted on. A silent link cannot be, and a low battery is the vehicle's own business: holding would drain it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Precautions:
    """What the user wants.

    Attributes:
        on_breach: what to do on a breach; None is hold for a simulated vehicle, and tell for any other.
        apply_limits: whether to set the parameters that the plan needs, and to put the old values back at the end.
        agree: asked with the list of changes before any is made.
        keep: told the old values while they are changed, to have them on disk; an empty mapping when all are back.
        left_changed: old values that an earlier flight could not put back.
    """

    on_breach: OnBreach | None = None
    apply_limits: bool = False
    agree: Callable[[str], bool] = lambda _: False
    keep: Callable[[Mapping[str, float]], None] = lambda _: None
    left_changed: Mapping[str, float] = field(default_factory=dict)

    def reaction(self, *, simulated: bool) -> OnBreach:
        """What to do on a breach, with this vehicle."""
        if self.on_breach is not None:
            return self.on_breach
        return OnBreach.HOLD if simulated else OnBreach.TELL


USUAL = Precautions()
"""What is done unless the user says otherwise."""

"""Judge a hold while it lasts: its purpose, its position, when the mission may go on, when it must end."""

import math
from enum import Enum

from mission_io.wire import messages as m
from uavcover.flight.session import Session, Timer
from uavcover.flight.tuning import FOLLOWING
from uavcover.model.outcome import Ending

_TRANSIENT = frozenset(
    {Ending.BAND_LEFT, Ending.FENCE_BREACHED, Ending.OFF_ROUTE, Ending.WIND_ABOVE_LIMITS, Ending.GROUND_UNKNOWN}
)
"""Breaches that can end by themselves. A changed mission does not change back."""


class HoldState(Enum):
    """State of a hold."""

    HOLDS = "the hold continues"
    OVER = "its reason has ended: the mission may continue"
    OVERDUE = "its time limit has passed"
    LOST = "the vehicle does not hold its position"


class HoldWatch:
    """One hold.

    Args:
        session: with the vehicle.
        purpose: the breach that it is for; None for the user's pause, which ends with the user's word.
        may_go_on: whether the mission may go on by itself once the breach is over.
    """

    def __init__(self, session: Session, purpose: Ending | None, *, may_go_on: bool) -> None:
        self.purpose = purpose
        self._session = session
        self._may_go_on = may_go_on and purpose in _TRANSIENT
        self._rest = Timer(session, FOLLOWING.comes_to_rest_s)
        self._deadline = Timer(session, session.timeouts.held_s)
        self._calm: Timer | None = None
        self._place: m.GlobalPositionInt | None = None

    def begin_again(self) -> None:
        """Hold at the next position of rest: a pilot may have moved the vehicle and given it back."""
        self._place = None
        self._rest.restart()

    def look(self) -> HoldState:
        """Judge it now."""
        if self._drifts():
            return HoldState.LOST
        if self.purpose is None:
            return HoldState.HOLDS
        if self._session.watch.is_open(self.purpose):
            self._calm = None
        elif self._calm is None:
            self._calm = Timer(self._session, FOLLOWING.calm_s)
        elif self._calm.over and self._may_go_on and self._place is not None:
            return HoldState.OVER
        return HoldState.OVERDUE if self._deadline.over else HoldState.HOLDS

    @property
    def drift_m(self) -> float:
        """Distance from the held position; 0 before the vehicle has come to rest."""
        here = self._session.monitor.latest(m.GlobalPositionInt)
        if here is None or self._place is None:
            return 0.0
        north_m = (here.lat_deg - self._place.lat_deg) * 111_320.0
        east_m = (here.lon_deg - self._place.lon_deg) * 111_320.0 * math.cos(math.radians(here.lat_deg))
        return math.hypot(north_m, east_m, here.alt_amsl_m - self._place.alt_amsl_m)

    def _drifts(self) -> bool:
        watch = self._session.watch
        if self._place is None:
            if self._rest.over:
                self._place = self._session.monitor.latest(m.GlobalPositionInt)
            return False
        drift_m = self.drift_m
        watch.measure(
            Ending.HOLD_LOST, drift_m if drift_m > FOLLOWING.drift_m else None,
            f"the vehicle does not hold its position: it is {drift_m:.0f} m away from it",
            "the vehicle is back at its hold position",
        )  # fmt: skip
        return drift_m > FOLLOWING.drift_m

"""When a vehicle may start, and may or must fly home, beside others in the air."""

from collections.abc import Callable
from dataclasses import dataclass

from mission_io.model.items import Mission


@dataclass(frozen=True, slots=True, kw_only=True)
class Clearance:
    """Permission to start or fly home, asked repeatedly while the vehicle waits, holds or flies.

    Attributes:
        may_start: whether it may arm and take off now.
        may_go_home: whether it may fly these checked legs home now; raises InfeasibleError when it never may, and the vehicle is
            left holding then.
        must_go_home: why it must end its mission now and fly home along checked legs, as text, None while it may fly on;
            without such a function its own battery and endurance decide.
    """

    may_start: Callable[[], bool] = lambda: True
    may_go_home: Callable[[Mission], bool] = lambda _: True
    must_go_home: Callable[[], str | None] | None = None


ALONE = Clearance()
"""No other vehicle is near."""

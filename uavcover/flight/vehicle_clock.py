"""The vehicle's time, from the stamps of its messages: a wrong one is left out, several that agree are believed."""

import math
from itertools import pairwise

_LATE_S = 5.0
"""Messages may come late by so much; a restart sets the time back further."""
_STEP_S = 0.5
"""A stamp that is ahead by more is doubted: positions come at least five times a second."""
_LONGEST_STEP_S = 4.0
"""Where messages are rare the step is learnt, up to this: less than what counts as late, so that no error reads as a restart."""
_FASTEST = 100.0
"""Vehicle seconds per second of the link's clock, at most."""
_AGREE, _AGREE_RARE = 3, 5
"""So many stamps in a row that fit each other are believed although they do not fit what was before; more where they are rare."""


class VehicleClock:
    """Judges stamps one by one.

    Attributes:
        time_s: the latest time, seconds since the vehicle was switched on; None while nothing is known.
        restarted: whether the time has gone back: the vehicle was switched off and on.
        proven: how many stamps right before the latest one were doubted, and are believed now that it agrees with them.
    """

    def __init__(self) -> None:
        self.time_s: float | None = None
        self.restarted = False
        self.proven = 0
        self._step_s = _STEP_S
        self._doubted: list[tuple[float, float]] = []

    def begin(self) -> None:
        """Forget everything, as before a new flight."""
        self.time_s, self.restarted, self._step_s = None, False, _STEP_S
        self.proven = 0
        self._doubted.clear()

    @property
    def doubted(self) -> int:
        """How many stamps in a row wait for others that agree with them."""
        return len(self._doubted)

    def take(self, stamp_s: float, now: float) -> bool:
        """Whether a stamp that arrived at ``now`` on the link's clock is believed.

        A stamp that fits neither the time nor the doubted ones before it is left out. After a silence, and after a restart, the
        first two are doubted: the third one that agrees proves them.
        """
        self.proven = 0
        if not (math.isfinite(stamp_s) and stamp_s >= 0.0):
            return False
        if self.time_s is not None and -_LATE_S <= stamp_s - self.time_s <= self._step_s:
            self._doubted.clear()
            self.time_s = max(self.time_s, stamp_s)
            return True
        if self._doubted and not self._agrees(stamp_s, now):
            self._doubted.clear()
        self._doubted.append((stamp_s, now))
        stamps = [stamp for stamp, _ in self._doubted]
        longest_s = max((after - before for before, after in pairwise(stamps)), default=0.0)
        if len(stamps) < (_AGREE if longest_s <= _STEP_S else _AGREE_RARE) or stamp_s <= stamps[0]:
            return False
        self._step_s = min(_LONGEST_STEP_S, max(self._step_s, 1.5 * longest_s))
        self.restarted |= self.time_s is not None and stamp_s < self.time_s
        self.time_s = stamp_s
        self.proven = len(self._doubted) - 1
        self._doubted.clear()
        return True

    def _agrees(self, stamp_s: float, now: float) -> bool:
        """Whether a stamp fits the doubted ones: close to the last, or, where messages are rare, as far on as that was."""
        before_s, then = self._doubted[-1]
        gap_s = stamp_s - before_s
        if abs(gap_s) <= _STEP_S:
            return True
        if not 0.0 < gap_s <= _FASTEST * (now - then):
            return False
        return len(self._doubted) < 2 or 0.5 <= gap_s / max(before_s - self._doubted[-2][0], 1e-3) <= 2.0

"""When something that goes wrong is told: at once, when it has doubled, every half a minute, and when it is over."""

from enum import Enum

REPEAT_S = 30.0
"""No longer without a word while it lasts."""


class Told(Enum):
    """Why an alarm is told now."""

    BEGUN = "it has begun"
    DOUBLED = "it is twice as much as when that was told last"
    LASTS = "it lasts"
    ENDED = "it is over"


class Alarm:
    """One thing that can go wrong, by how much, and when that is to be told. Knows no clock: time is an argument.

    What is over for less than ``settle_s`` is not over: an amount that swings about its limit is one alarm and not a hundred.

    Args:
        settle_s: how long it has to be away before it counts as over.
        repeat_s: how often it is told while it lasts.

    Attributes:
        largest: the largest amount since it began.
    """

    def __init__(self, *, settle_s: float = 0.0, repeat_s: float = REPEAT_S) -> None:
        self._settle_s, self._repeat_s = settle_s, repeat_s
        self._told_at_s: float | None = None
        self._told_amount = 0.0
        self._away_since_s: float | None = None
        self.largest = 0.0

    @property
    def sounding(self) -> bool:
        """Whether it has begun and is not over."""
        return self._told_at_s is not None

    def measure(self, amount: float | None, now: float) -> Told | None:
        """Take what was measured at ``now`` (seconds), None for nothing wrong; returns why to tell it, None for silence."""
        if self._told_at_s is None:
            if amount is None:
                return None
            self._told_amount = self.largest = amount
            return self._tell(Told.BEGUN, now)
        if amount is None:
            if self._away_since_s is None:
                self._away_since_s = now
            if now - self._away_since_s < self._settle_s:
                return None
            self._told_at_s = self._away_since_s = None
            return Told.ENDED
        self._away_since_s = None
        self.largest = max(self.largest, amount)
        if amount >= 2.0 * self._told_amount and amount > self._told_amount:
            self._told_amount = amount
            return self._tell(Told.DOUBLED, now)
        if now - self._told_at_s >= self._repeat_s:
            return self._tell(Told.LASTS, now)
        return None

    def _tell(self, told: Told, now: float) -> Told:
        self._told_at_s, self._away_since_s = now, None
        return told

"""Time as an argument: what a clock is, and the real one."""

import time
from typing import Protocol


class Clock(Protocol):
    """Seconds from an arbitrary start that never go back."""

    def now(self) -> float:
        """The present time in seconds."""
        ...


class MonotonicClock:
    """The operating system's monotonic clock."""

    def now(self) -> float:
        """The present time in seconds; only differences mean something."""
        return time.monotonic()

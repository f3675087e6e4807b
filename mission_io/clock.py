"""Clocks: time is passed as an argument, and these are its sources."""

import time
from typing import Protocol


class Clock(Protocol):
    """Seconds from an arbitrary start that never go back."""

    def now(self) -> float:
        """The present time in seconds."""
        ...


class UnixClock(Protocol):
    """The time of day, which users may set."""

    def unix_s(self) -> float:
        """Seconds since 1970-01-01 UTC."""
        ...


class MonotonicClock:
    """The operating system's monotonic clock."""

    def now(self) -> float:
        """The present time in seconds; only differences mean something."""
        return time.monotonic()


class SystemClock:
    """The operating system's time of day."""

    def unix_s(self) -> float:
        """Seconds since 1970-01-01 UTC."""
        return time.time()

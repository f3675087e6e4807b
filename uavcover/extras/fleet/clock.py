"""The clock that all vehicles of a fleet share."""

import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol


class FleetClock(Protocol):
    """The clock that all vehicles of a fleet share, as the thread of one vehicle sees it."""

    def now(self) -> float:
        """Vehicle seconds; only differences mean something."""
        ...

    def wait(self, seconds: float) -> None:
        """Let so much time pass."""
        ...

    def taking_part(self) -> AbstractContextManager[None]:
        """As long as the calling thread follows a vehicle."""
        ...


class RealClock:
    """The computer's clock, as fast as the vehicles fly.

    Args:
        speed: vehicle seconds per second.
    """

    def __init__(self, speed: float = 1.0) -> None:
        self._speed = speed

    def now(self) -> float:
        """Vehicle seconds."""
        return time.monotonic() * self._speed

    def wait(self, seconds: float) -> None:
        """Sleep."""
        time.sleep(seconds / self._speed)

    @contextmanager
    def taking_part(self) -> Iterator[None]:
        """Nothing to do."""
        yield

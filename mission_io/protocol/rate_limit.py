"""Rate limit of answers: a flood of requests from a peer must not make this side flood the link."""

from mission_io.errors import MisuseError


class RateLimit:
    """Allows ``per_s`` answers a second on average, and as many at once after a pause.

    Args:
        per_s: Answers a second.
    """

    def __init__(self, *, per_s: float) -> None:
        if not per_s >= 1.0:
            raise MisuseError(f"per_s is {per_s}, give 1 or more")
        self._per_s = self._left = per_s
        self._at: float | None = None

    def allows(self, now: float) -> bool:
        """Whether one more answer may go out at ``now``; counts it if so."""
        if self._at is not None:
            self._left = min(self._per_s, self._left + (now - self._at) * self._per_s)
        self._at = now
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True

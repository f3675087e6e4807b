"""How far a vehicle that flies faster than real time may run ahead of the ground stations that listen to it."""

from typing import Final, Generic, TypeVar

from mission_io.messages import TimeSync

PlaceT = TypeVar("PlaceT")

_ASK_EVERY_S: Final = 0.5
"""Vehicle time between two questions."""
_AHEAD_S: Final = 5.0
"""Vehicle time of messages that may be on their way: far less than the buffer of a socket holds."""
_ASK_AGAIN_S: Final = 0.05
_PATIENCE_S: Final = 1.0
"""A ground station that has left a question unanswered for so long, in real time, is not waited for."""


class Pacing(Generic[PlaceT]):
    """Asks the time with TIMESYNC, behind all that was sent before: the answer tells how far a ground station has read.

    A real vehicle sends what a ground station can take in; at a hundred times real time a busy machine would lose messages that
    no real link loses. Ground stations that never answer are not waited for, and neither are those that have stopped.
    """

    def __init__(self) -> None:
        self._asked_s = 0.0
        self._asked_at = 0.0
        self._read_s: dict[PlaceT, float] = {}
        self._waits_since: float | None = None

    def question(self, vehicle_s: float, now: float) -> TimeSync | None:
        """What to send at a vehicle time, and at ``now`` on the link's clock; None when nothing is to be asked."""
        due = vehicle_s - self._asked_s >= _ASK_EVERY_S
        again = self._waits_since is not None and now - self._asked_at >= _ASK_AGAIN_S
        if not (due or again):
            return None
        self._asked_s, self._asked_at = vehicle_s, now
        return TimeSync(answered_ns=0, asked_ns=round(vehicle_s * 1e9))

    def take(self, place: PlaceT, answer: TimeSync) -> None:
        """Take a ground station's answer to a question of this vehicle's; its own questions are none."""
        if answer.answered_ns == 0 or not 0 < answer.asked_ns <= round(self._asked_s * 1e9):
            return
        self._read_s[place] = max(self._read_s.get(place, 0.0), answer.asked_ns / 1e9)

    def waits(self, vehicle_s: float, now: float) -> bool:
        """Whether the vehicle's time has to stand still, for a ground station that has not read what it was sent."""
        behind = [place for place, read_s in self._read_s.items() if vehicle_s - read_s > _AHEAD_S]
        if not behind:
            self._waits_since = None
            return False
        if self._waits_since is None:
            self._waits_since = now
        if now - self._waits_since <= _PATIENCE_S:
            return True
        for place in behind:
            del self._read_s[place]
        self._waits_since = None
        return False

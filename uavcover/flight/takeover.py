"""Notices that the vehicle left the mode in which it was told to fly, and finds out why."""

from collections.abc import Collection

from uavcover.flight.conversation import Conversation, Timer
from uavcover.flight.events import EventKind
from uavcover.flight.modes import Mode, custom_mode
from uavcover.flight.outcome import Ending

_SETTLE_S = 2.0
"""The heartbeat with the new mode may come before the words that say why."""
_CAUSE_WITHIN_S = 10.0


class Takeover:
    """Whether somebody else, a pilot or a failsafe, has the vehicle now.

    Args:
        conversation: with the vehicle.

    Attributes:
        cause: why; None while the vehicle does what it was told, or has changed only a moment ago.
    """

    def __init__(self, conversation: Conversation) -> None:
        self._conversation = conversation
        self._left: Timer | None = None
        self.cause: Ending | None = None

    @property
    def begun(self) -> bool:
        """Whether the vehicle is in another mode than it was told."""
        return self._left is not None

    def update(self, expected: Collection[Mode]) -> None:
        """Look at the mode; ``expected`` are those it was told."""
        conversation = self._conversation
        numbers = [custom_mode(conversation.autopilot, mode) for mode in expected]
        if self._left is not None and conversation.monitor.ground.says_landed:
            self.settle()  # PX4 goes back to the mode it was told once it has landed: that ends no takeover
        elif conversation.client.vehicle.custom_mode in numbers:
            if self.cause is not None:
                conversation.watch.close(self.cause, f"the vehicle is back in {conversation.mode_name}")
            self._left = self.cause = None
        elif self._left is None:
            self._left = Timer(conversation, _SETTLE_S)
        elif self._left.over:
            self.settle()

    def settle(self) -> None:
        """Find the cause now, if the vehicle has left its mode."""
        if self._left is None or self.cause is not None:
            return
        conversation = self._conversation
        found = conversation.watch.recent_cause(within_s=_CAUSE_WITHIN_S)
        if found is None:
            self.cause, why = Ending.PILOT_TOOK_OVER, "somebody else took over"
        else:
            self.cause, why = found
        text = f"the vehicle changed to {conversation.mode_name}: {why}"
        if conversation.watch.is_open(self.cause):
            conversation.tell(EventKind.WARNING, text)
        conversation.watch.open(self.cause, text)

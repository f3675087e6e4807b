"""Which item a vehicle flies to: setting it with confirmation, and following it; sans-IO."""

from dataclasses import dataclass, replace

from mission_io.model.enums import CommandResult, MissionState
from mission_io.model.items import Command
from mission_io.protocol.timing import TRANSFERS
from mission_io.wire import messages as m
from mission_io.wire.messages import Address


class SetCurrent:
    """Makes another item the current one, and waits until the vehicle reports it.

    DO_SET_MISSION_CURRENT is sent until it is answered; to vehicles that do not know it MISSION_SET_CURRENT, without an answer.
    MISSION_CURRENT with the wanted item settles it. An autopilot that goes on to the next waypoint at once because the wanted
    item is a command reports a later one: that counts as well, when it is another one than before.

    Attributes:
        current: The vehicle's latest report since the first command; None before that.
        refused: The MAV_RESULT of a refusal; None without one.
        accepted: Whether the vehicle has acknowledged the command.
    """

    def __init__(
        self,
        seq: int,  # the item's number on the wire
        *,
        vehicle: Address,  # the autopilot
        local: Address,  # this side
        question: m.CommandLong,  # asks for MISSION_CURRENT
        before: int | None,  # the current item as last reported; None for not known
        now: float,  # the present time in seconds
        timeout_s: float = 5.0,  # longest duration
        again_s: float = 0.5,  # a silence after which it is said again
    ) -> None:
        self.current: m.MissionCurrent | None = None
        self.refused: int | None = None
        self.accepted = self.done = self.cancelled = False
        self._seq, self._vehicle, self._local, self._before = seq, vehicle, local, before
        self._question = question
        self._until, self._again_s = now + timeout_s, again_s
        self._said_at: float | None = None
        self._tries = self._stale = 0
        self._older = self._over = False

    @property
    def finished(self) -> bool:
        """Whether it is settled, refused, cancelled, or the time is up."""
        return self.done or self.cancelled or self._over or self.refused is not None

    def cancel(self, now: float) -> None:
        """Stop; the vehicle may have received the command."""
        del now
        self.cancelled = True

    def receive(self, received: m.Received, now: float) -> None:
        """Take a message; those about anything else have no effect."""
        del now
        if self.finished or received.sender != self._vehicle:
            return
        message = received.message
        if isinstance(message, m.CommandAck):
            ours = message.target_system in (0, self._local.system_id)
            if message.command == Command.DO_SET_MISSION_CURRENT and ours:
                self._take_ack(message.result)
        elif isinstance(message, m.MissionCurrent) and self._tries > 0:
            self._take_current(message)

    def _take_ack(self, result: int) -> None:
        if result == CommandResult.ACCEPTED:
            self._said_at = self._said_at if self.accepted else None  # ask at once what it reports now
            self.accepted = True
        elif result == CommandResult.UNSUPPORTED:
            self._older, self._said_at = True, None
        elif result != CommandResult.IN_PROGRESS and not self.accepted:
            self.refused = result

    def _take_current(self, message: m.MissionCurrent) -> None:
        commanded = self.accepted or self._older
        self.current = message
        went_on = self.accepted and message.seq > self._seq and message.seq != self._before
        if commanded and (message.seq == self._seq or went_on):
            self.done = True
        elif self.accepted:
            self._stale += 1
            self._over = self._stale >= TRANSFERS.stale_tries

    def messages_to_send(self, now: float) -> list[m.Message]:
        """Messages due at ``now``."""
        self._over = self._over or now >= self._until
        if self.finished or (self._said_at is not None and now < self._said_at + self._again_s):
            return []
        self._said_at = now
        if self.accepted:
            return [self._question]
        messages: list[m.Message] = []
        if not self._older:
            params = (float(self._seq), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
            messages.append(
                m.CommandLong(
                    *self._vehicle, Command.DO_SET_MISSION_CURRENT, params, confirmation=min(self._tries, 255)
                )
            )
        self._tries += 1
        if self._older or self._tries > TRANSFERS.deaf_tries:
            self._older = True
            messages += [m.MissionSetCurrent(*self._vehicle, self._seq), self._question]
        return messages

    def next_timer(self) -> float | None:
        """When it wants to be asked again; None when it is over."""
        if self.finished:
            return None
        return self._until if self._said_at is None else min(self._until, self._said_at + self._again_s)


@dataclass(frozen=True, slots=True)
class ItemProgress:
    """Progress of a mission."""

    current: int | None = None  # the item that the vehicle flies to, by its number on the wire; None before it has said
    reached: int | None = None  # the latest item that it has reported as reached; it may repeat some and leave some out
    total: int | None = None  # how many items there are, home left out; None where the vehicle does not say
    state: int = MissionState.UNKNOWN  # A MissionState; UNKNOWN where the vehicle does not say

    @property
    def complete(self) -> bool:
        """Whether the vehicle reports that it has flown all of it."""
        return self.state == MissionState.COMPLETE

    def after(self, message: m.Message) -> "ItemProgress":
        """The progress after a message of the vehicle; the same for one about anything else."""
        if isinstance(message, m.MissionCurrent):
            return replace(self, current=message.seq, total=message.total, state=message.state)
        if isinstance(message, m.MissionItemReached):
            return replace(self, reached=message.seq)
        return self

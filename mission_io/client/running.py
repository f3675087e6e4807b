"""Runs a state machine of ``mission_io.protocol`` over a connection until it is finished."""

from collections.abc import Callable, Sequence
from typing import Protocol, TypeAlias

from mission_io.client.connection import Connection
from mission_io.model.items import MissionItem, MissionType
from mission_io.wire.messages import Message, Received

Progress: TypeAlias = Callable[[int, int], None]
"""Called with the number of items transferred and the total, whenever the first changes."""
Stop: TypeAlias = Callable[[], bool]
"""Polled during a transfer; True cancels it."""
Carry: TypeAlias = Callable[[MissionType, Sequence[MissionItem]], None]
"""Brings a list to the vehicle; raises a TransferError when it could not."""


class Machine(Protocol):
    """A sans-IO state machine."""

    @property
    def finished(self) -> bool:
        """Whether it is over."""
        ...

    def receive(self, received: Received, now: float) -> None:
        """Take a message that arrived at ``now``."""
        ...

    def messages_to_send(self, now: float) -> Sequence[Message]:
        """Messages due at ``now``."""
        ...

    def next_timer(self) -> float | None:
        """When it wants to be asked again although nothing arrives; None when it is over."""
        ...

    def cancel(self, now: float) -> None:
        """Stop."""
        ...


def run(
    connection: Connection,
    machine: Machine,
    counts: Callable[[], tuple[int, int | None]],
    *,
    progress: Progress | None = None,
    stop: Stop | None = None,
) -> None:
    """Run a machine to its end.

    Args:
        connection: With the vehicle.
        machine: The machine.
        counts: Returns what is done, and the total if known.
        progress: Called when the first changes.
        stop: Polled; True cancels the machine, which may still have something to say to the vehicle.

    Raises:
        WaitCancelledError: the connection's ``give_up`` said so.
    """
    reported = -1
    while True:
        connection.raise_if_given_up()
        now = connection.clock.now()
        for message in machine.messages_to_send(now):
            connection.send(message)
        count, total = counts()
        if count != reported and total is not None:
            reported = count
            if progress is not None:
                progress(count, total)
        wake = machine.next_timer()
        if machine.finished or wake is None:
            return
        if stop is not None and stop():
            machine.cancel(now)
            stop = None
            continue
        for received in connection.next_messages(wake):
            machine.receive(received, connection.clock.now())

"""What the mock vehicle has to say, less what a fault keeps from being heard."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

from mission_io.messages import Heartbeat, Message
from uavcover.flight.mock.faults import FaultKind

if TYPE_CHECKING:
    from uavcover.flight.mock.vehicle import MockVehicle


class Outbox:
    """Messages that wait to be sent."""

    def __init__(self, vehicle: "MockVehicle") -> None:
        self._vehicle = vehicle
        self._waiting: list[Message] = []

    def put(self, message: Message) -> None:
        """Say something, unless it cannot be heard."""
        silenced = isinstance(message, Heartbeat) and self._vehicle.faults.is_going_on(FaultKind.HEARTBEAT_LOSS)
        if not (silenced or self._vehicle.cut_off):
            self._waiting.append(message)

    def put_all(self, messages: Iterable[Message]) -> None:
        """Say several things."""
        for message in messages:
            self.put(message)

    def take(self) -> list[Message]:
        """Everything that waits; it waits no longer."""
        waiting, self._waiting = self._waiting, []
        return waiting

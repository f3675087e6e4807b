"""Interface of a client that can follow and control a vehicle."""

from collections.abc import Callable
from typing import Protocol, TypeVar

from mission_io.autopilots.mission_lists import MissionList
from mission_io.client.peers import Peers, VehicleInfo
from mission_io.client.transfer_outcome import ReadBack
from mission_io.clock import Clock
from mission_io.model.items import MissionItem, MissionType
from mission_io.wire.codec import LinkStatistics
from mission_io.wire.messages import Address, CommandAck, Message, ParamValue, Received

MessageT = TypeVar("MessageT", bound=Message)


class VehicleClient(Protocol):
    """A ground station's end of the session with one vehicle; ``mission_io.client.client.Client`` is one.

    Everything that it receives goes to the :class:`~uavcover.flight.monitor.Monitor` as messages of
    ``mission_io.wire.messages``, whichever call is waiting for it. Errors are ``mission_io.errors``.
    """

    give_up: Callable[[], bool] | None
    """Polled while a call waits, and before it sends anything again; True ends the call with a WaitCancelledError."""

    @property
    def clock(self) -> Clock:
        """The clock that silence is measured on."""
        ...

    @property
    def local(self) -> Address:
        """Our own system and component."""
        ...

    @property
    def vehicle(self) -> VehicleInfo:
        """The vehicle as of its latest heartbeat."""
        ...

    @property
    def heartbeat_age_s(self) -> float:
        """Seconds since that heartbeat."""
        ...

    @property
    def impostor(self) -> VehicleInfo | None:
        """Another vehicle that uses our vehicle's ids, as its heartbeat describes it; None while there is none."""
        ...

    @property
    def statistics(self) -> LinkStatistics:
        """Counts of the link since it was opened."""
        ...

    @property
    def peers(self) -> Peers:
        """Everybody whose messages arrive."""
        ...

    def signing_advice(self) -> str:
        """Advice when the vehicle signs and this side has no key; otherwise empty."""
        ...

    def wait_for_vehicle(self, timeout_s: float = 10.0) -> VehicleInfo:
        """Wait for an autopilot's heartbeat: of the vehicle that was found before, if one was."""
        ...

    def poll(self, timeout_s: float) -> list[Received]:
        """Listen for at most ``timeout_s``."""
        ...

    def send(self, message: Message) -> None:
        """Send one message, once."""
        ...

    def command(self, command: int, *params: float, timeout_s: float = ...) -> CommandAck:
        """Send a command until it is answered."""
        ...

    def set_mode(self, custom_mode: int, *, timeout_s: float = ...) -> None:
        """Change the flight mode and confirm it in the heartbeat."""
        ...

    def request_message_interval(self, kind: type[Message], interval_s: float, *, timeout_s: float = ...) -> CommandAck:
        """Ask for a kind of message each ``interval_s`` seconds."""
        ...

    def request_message(self, kind: type[MessageT], *, timeout_s: float = ...) -> MessageT:
        """Ask for one message of a kind and wait for it."""
        ...

    def read_parameter(self, name: str, *, timeout_s: float = ...) -> ParamValue:
        """Read a parameter by its name."""
        ...

    def set_parameter(self, name: str, value: float, *, param_type: int = ..., timeout_s: float = ...) -> ParamValue:
        """Set a parameter to a wire value and confirm it."""
        ...

    def download(self, mission_type: MissionType, *, stop: Callable[[], bool] | None = ...) -> tuple[MissionItem, ...]:
        """One of the vehicle's lists in wire order; ``stop`` is polled and cancels the transfer."""
        ...

    def upload_and_verify(self, content: MissionList, *, in_flight: bool = ...) -> ReadBack:
        """Upload, read back, compare."""
        ...

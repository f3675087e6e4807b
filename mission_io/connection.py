"""A ground station's end of a link: heartbeats out, messages in, and whether the vehicle is still there."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Self

from mission_io.autopilots import Autopilot, autopilot_for
from mission_io.clock import Clock
from mission_io.codec import Codec
from mission_io.enums import AutopilotId, VehicleClass
from mission_io.errors import MisuseError, VehicleSilentError
from mission_io.link import Link
from mission_io.messages import Heartbeat, Message, Received
from mission_io.protocol.exchange import Address

_HEARTBEAT_S = 1.0
_NOT_VEHICLES = frozenset(
    {
        VehicleClass.GROUND_STATION,
        VehicleClass.ONBOARD_CONTROLLER,
        VehicleClass.GIMBAL,
        VehicleClass.ADSB,
        VehicleClass.CAMERA,
    }
)


@dataclass(frozen=True, slots=True)
class VehicleInfo:
    """A vehicle as its latest heartbeat describes it.

    Attributes:
        system_id: Its MAVLink system.
        component_id: The component that is the autopilot.
        mav_autopilot: MAV_AUTOPILOT number.
        vehicle_type: MAV_TYPE number.
        armed: Whether its motors may turn.
        custom_mode: The autopilot's own number of its flight mode.
        system_status: MAV_STATE number.
    """

    system_id: int
    component_id: int
    mav_autopilot: int
    vehicle_type: int
    armed: bool
    custom_mode: int
    system_status: int

    @property
    def address(self) -> Address:
        """Where messages to it go."""
        return Address(self.system_id, self.component_id)

    @property
    def autopilot(self) -> Autopilot:
        """What mission_io knows of its autopilot.

        Raises:
            MisuseError: an autopilot that mission_io does not know.
        """
        return autopilot_for(self.mav_autopilot)


class Connection:
    """Sends a heartbeat each second while it waits, and keeps the latest heartbeat of the vehicle it talks to.

    Args:
        link: Carries the datagrams.
        clock: Times everything; None takes the link's own.
        system_id: This side's MAVLink system; ground stations use 255.
        component_id: This side's component; 190 is a mission planner.
        listener: Called with every message that arrives, whoever waits for it, with the time in seconds: for logs.
    """

    def __init__(
        self,
        link: Link,
        clock: Clock | None = None,
        *,
        system_id: int = 255,
        component_id: int = 190,
        listener: Callable[[Received, float], None] | None = None,
    ) -> None:
        self.link = link
        self.clock = clock if clock is not None else link.clock
        self.codec = Codec(system_id=system_id, component_id=component_id)
        self.local = Address(system_id, component_id)
        self._listener = listener
        self._vehicle: VehicleInfo | None = None
        self._heartbeat_at = -math.inf
        self._heard_at = -math.inf

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the link."""
        self.link.close()

    @property
    def vehicle(self) -> VehicleInfo:
        """The vehicle as of its latest heartbeat.

        Raises:
            MisuseError: ``wait_for_vehicle`` has not found one yet.
        """
        if self._vehicle is None:
            raise MisuseError("no vehicle yet; call wait_for_vehicle first")
        return self._vehicle

    @property
    def heartbeat_age_s(self) -> float:
        """Seconds since the vehicle's latest heartbeat; infinite when there was none."""
        return self.clock.now() - self._heard_at

    def send(self, message: Message) -> None:
        """Send one message, once."""
        self.link.send(self.codec.encode(message))

    def poll(self, timeout_s: float) -> list[Received]:
        """Wait for messages, for at most ``timeout_s`` seconds, and return all that are here; none is an empty list.

        Messages that arrived while a command or a transfer was going on are not here again: see ``listener``.
        """
        deadline = self.clock.now() + timeout_s
        messages = self._next_messages(deadline)
        while messages and (more := self._receive(0.0)):
            messages.extend(more)
        return messages

    def wait_for_vehicle(self, timeout_s: float = 10.0, *, system_id: int | None = None) -> VehicleInfo:
        """Wait for an autopilot's heartbeat, of a given system or of any, and talk to that one from here on.

        Raises:
            VehicleSilentError: no such heartbeat within ``timeout_s`` seconds.
        """
        deadline = self.clock.now() + timeout_s
        self._vehicle = None
        others: set[int] = set()
        while self.clock.now() < deadline:
            for received in self._next_messages(deadline):
                found = _vehicle_of(received)
                if found is None:
                    continue
                if system_id not in (None, found.system_id):
                    others.add(found.system_id)
                    continue
                self._vehicle, self._heard_at = found, self.clock.now()
                return found
        wanted = "no vehicle" if system_id is None else f"no vehicle with system id {system_id}"
        heard = f"; heard of {sorted(others)}" if others else ""
        raise VehicleSilentError(
            f"{wanted} sent a heartbeat within {timeout_s:g} s{heard}; is it on, and the URL right?"
        )

    def wait_until(
        self,
        done: Callable[[Received], bool],
        *,
        timeout_s: float,
        what: str,
        again: Callable[[int], None] | None = None,
        again_s: float = 0.5,
    ) -> Received:
        """Wait for a message of the vehicle that ``done`` says yes to.

        Args:
            done: Looks at each message of the vehicle.
            timeout_s: Longest time to wait.
            what: What is waited for, for the error.
            again: Called at once with 0, and with 1, 2, ... after each silence, to ask (again) for it.
            again_s: That silence, in seconds.

        Raises:
            VehicleSilentError: no such message within ``timeout_s`` seconds; it says ``what``.
        """
        vehicle = self.vehicle
        deadline = self.clock.now() + timeout_s
        attempt, ask_at = 0, self.clock.now()
        while self.clock.now() < deadline:
            if again is not None and self.clock.now() >= ask_at:
                again(attempt)
                attempt, ask_at = attempt + 1, self.clock.now() + again_s
            for received in self._next_messages(min(deadline, ask_at) if again is not None else deadline):
                if received.system_id == vehicle.system_id and done(received):
                    return received
        raise VehicleSilentError(f"vehicle {vehicle.system_id} did not send {what} within {timeout_s:g} s")

    def _next_messages(self, deadline: float) -> list[Received]:
        """Wait until a datagram brings messages; an empty list when the deadline came first."""
        while True:
            now = self.clock.now()
            if now >= self._heartbeat_at + _HEARTBEAT_S:
                self._heartbeat_at = now
                self.send(Heartbeat(AutopilotId.INVALID, VehicleClass.GROUND_STATION, system_status=4))
            wake = min(deadline, self._heartbeat_at + _HEARTBEAT_S)
            messages = self._receive(max(0.0, wake - now))
            if messages or self.clock.now() >= deadline:
                return messages

    def _receive(self, timeout_s: float) -> list[Received]:
        data = self.link.receive(timeout_s)
        if data is None:
            return []
        messages = self.codec.decode(data)
        now = self.clock.now()
        for received in messages:
            current = self._vehicle
            if current is not None and (received.system_id, received.component_id) == (
                current.system_id,
                current.component_id,
            ):
                found = _vehicle_of(received)
                if found is not None:
                    self._vehicle, self._heard_at = found, now
            if self._listener is not None:
                self._listener(received, now)
        return messages


def _vehicle_of(received: Received) -> VehicleInfo | None:
    """The vehicle that a message is the heartbeat of; None for other messages and other senders."""
    beat = received.message
    if not isinstance(beat, Heartbeat) or beat.autopilot == AutopilotId.INVALID or beat.vehicle_type in _NOT_VEHICLES:
        return None
    return VehicleInfo(
        received.system_id,
        received.component_id,
        beat.autopilot,
        beat.vehicle_type,
        beat.armed,
        beat.custom_mode,
        beat.system_status,
    )

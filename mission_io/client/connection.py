"""A ground station's end of a link: sends heartbeats, receives messages, and knows whether the vehicle is still there."""

import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol, TypeAlias

from mission_io.autopilots.autopilot import Autopilot
from mission_io.client.peers import Peers, VehicleChoice, VehicleInfo, two_in_one, vehicle_of
from mission_io.errors import MisuseError, VehicleSilentError, WaitCancelledError
from mission_io.links.datagrams import Clock, Closing, Link, PeerLink, StreamLink
from mission_io.model.enums import AutopilotId, VehicleClass
from mission_io.model.items import MissionItem, MissionType
from mission_io.protocol.timing import CALLS, RateLimit
from mission_io.wire.codec import Codec, LinkStatistics
from mission_io.wire.messages import Address, Heartbeat, Message, Received, is_for
from mission_io.wire.signing import (
    Signing,
    SigningKey,
    SystemClock,
    TimestampFile,
    TimestampStore,
    UnixClock,
    UnsavedTimestamps,
)
from mission_io.wire.telemetry_messages import TimeSync

_log = logging.getLogger(__name__)


Progress: TypeAlias = Callable[[int, int], None]
"""Called with the number of items transferred and the total, whenever the first changes."""
Stop: TypeAlias = Callable[[], bool]
"""Polled during a transfer; True cancels it."""
Carry: TypeAlias = Callable[[MissionType, Sequence[MissionItem]], None]
"""Brings a list to the vehicle; raises a TransferError when it could not."""


class Service(Protocol):
    """Answers the vehicle's questions beside all other exchanges; sans-IO."""

    def receive(self, received: Received, now: float) -> None:
        """Take a message of the vehicle that arrived at ``now``."""

    def messages_to_send(self, now: float) -> Sequence[Message]:
        """Messages to send at ``now``."""

    def next_timer(self) -> float | None:
        """Time of the next call without a message; None if it needs none."""


class Machine(Service, Protocol):
    """A sans-IO state machine, which is over when ``next_timer`` is None."""

    @property
    def finished(self) -> bool:
        """Whether it is over."""

    def cancel(self, now: float) -> None:
        """Stop."""


class Connection(Closing):
    """A connection to one vehicle: sends a heartbeat each second while it waits, and keeps the vehicle's latest one.

    Args:
        link: Carries the datagrams.
        clock: Source of time; None uses the link's own.
        system_id: This side's MAVLink system; ground stations use 255.
        component_id: This side's component; 190 is a mission planner.
        listener: Called with every message that arrives, for any recipient, and the time in seconds, for logs.

    Attributes:
        peers: Who else is on the link: vehicles, and others that use our ids.
        impostor: A different vehicle (by autopilot or type) whose heartbeats carry our vehicle's ids; None normally.
            Such heartbeats do not count as our vehicle's.
        give_up: Polled at every message and at least once a second while a call waits; True ends the call with a
            WaitCancelledError. None never does. Transfers have their own ``stop``, which also cancels them on the vehicle.
        services: Answer the vehicle's questions whenever any call waits, such as those for terrain heights.
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
        self.peers = Peers(self.local)
        self.give_up: Callable[[], bool] | None = None
        self.services: list[Service] = []
        self._for_others = 0
        self._listener = listener
        self._vehicle: VehicleInfo | None = None
        self.impostor: VehicleInfo | None = None
        self._time_answers = RateLimit(per_s=CALLS.time_answers_per_s)
        self._heartbeat_at = -math.inf
        self._heard_at = -math.inf

    def close(self) -> None:
        """Close the link."""
        self.link.close()
        if self.codec.signing is not None:
            self.codec.signing.close()

    def sign_with(
        self, key: SigningKey, *, link_id: int = 0, clock: UnixClock | None = None, store: TimestampStore | None = None
    ) -> None:
        """Sign everything sent from now on, and accept only messages signed with the same key.

        Args:
            key: The key shared by both ends.
            link_id: Tells apart the links of one sender, 0 to 255.
            clock: The time of day; None uses the operating system's.
            store: Keeps the timestamps; None uses a file beside the key's, or no store for a key without a file.

        Raises:
            LinkError: the timestamp beside the key cannot be read.
        """
        if store is None:
            store = UnsavedTimestamps() if key.path is None else TimestampFile(key.path)
        clock = clock if clock is not None else SystemClock()
        self.codec.signing = Signing(key, clock=clock, store=store, link_id=link_id)

    @property
    def statistics(self) -> LinkStatistics:
        """Counts of the link so far; ``str`` of them is one line."""
        counts = replace(self.codec.statistics, for_others=self._for_others)
        if not isinstance(self.link, StreamLink):
            return counts
        framing = self.link.framing
        return replace(
            counts,
            checksum_errors=counts.checksum_errors + framing.checksum_errors,
            truncated_frames=counts.truncated_frames + framing.truncated_frames,
            garbage_bytes=counts.garbage_bytes + framing.garbage_bytes,
        )

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
    def known_autopilot(self) -> Autopilot | None:
        """The known properties of the vehicle's autopilot; None for an unknown one.

        Raises:
            MisuseError: ``wait_for_vehicle`` has not found a vehicle yet.
        """
        vehicle = self.vehicle
        try:
            return vehicle.autopilot
        except MisuseError:
            return None

    @property
    def heartbeat_age_s(self) -> float:
        """Seconds since the vehicle's latest heartbeat; infinite when there was none."""
        return self.clock.now() - self._heard_at

    def send(self, message: Message) -> None:
        """Send one message, once."""
        self.link.send(self.codec.encode(message))

    def poll(self, timeout_s: float) -> list[Received]:
        """Wait for messages, for at most ``timeout_s`` seconds, and return all that are here; none is an empty list.

        Messages beyond what can be read in a tenth of a second are left for the next call. Messages that arrived during a
        command or a transfer are not returned again: see ``listener``.
        """
        deadline = self.clock.now() + timeout_s
        messages = self.next_messages(deadline)
        until = self.clock.now() + CALLS.catch_up_s
        while messages and self.clock.now() < until and (more := self._receive(0.0)):
            messages.extend(more)
        return messages

    def wait_for_vehicle(
        self, timeout_s: float = 10.0, *, system_id: int | None = None, component_id: int | None = None
    ) -> VehicleInfo:
        """Wait for an autopilot's heartbeat, and talk to that vehicle from now on.

        Without a system id, the call listens for another heartbeat interval in case there is a second vehicle; later calls wait
        for the same vehicle again. If several components of a system send autopilot heartbeats, component 1 is chosen. A
        vehicle first heard in MAVLink 1 gets a few heartbeats' time to change to MAVLink 2.

        Args:
            timeout_s: Longest time to wait, in seconds.
            system_id: The system to wait for; None for any.
            component_id: The component to wait for; None for the autopilot.

        Raises:
            VehicleSilentError: no such heartbeat within ``timeout_s`` seconds.
            AmbiguousVehicleError: several vehicles are heard, and none was named.
            MisuseError: the vehicle's system id is our own, or two vehicles share the same ids.
        """
        if system_id is None and component_id is None and self._vehicle is not None:
            system_id, component_id = self._vehicle.address
        elif isinstance(self.link, PeerLink):
            self.link.let_go()
        deadline = self.clock.now() + timeout_s
        choice = VehicleChoice(system_id=system_id, component_id=component_id)
        self._vehicle = self.impostor = None
        self.codec.version = 2
        latest: dict[Address, Received] = {}
        decide_at = deadline
        while self.clock.now() < decide_at:
            for received in self.next_messages(decide_at):
                found = vehicle_of(received)
                if found is not None:
                    choice.take(found, self.clock.now())
                    latest[found.address] = received
            decide_at = choice.decide_at(deadline)
        chosen = choice.chosen()
        if chosen is None:
            raise VehicleSilentError(choice.silence(timeout_s, self.statistics))
        return self._settle_on(chosen, latest[chosen.address], deadline)

    def _settle_on(self, chosen: VehicleInfo, received: Received, deadline: float) -> VehicleInfo:
        """Talk to a vehicle from now on, in the newest MAVLink version it speaks."""
        if chosen.system_id == self.local.system_id:
            raise MisuseError(
                f"the vehicle and this program both use system ID {chosen.system_id}; use another system ID for this program"
            )
        self._vehicle, self._heard_at = chosen, self.clock.now()
        if isinstance(self.link, PeerLink):
            self.link.keep_to(*chosen.address)
        self._agree_on_version(received)
        settled = received.mavlink_version >= 2 or self.codec.version == 1
        while not settled and self.clock.now() < deadline:
            for received in self.next_messages(deadline):
                if received.sender == chosen.address:
                    settled = settled or received.mavlink_version >= 2 or self.codec.version == 1
        if not settled:
            self.codec.version = 1
        return self.vehicle

    def wait_until(
        self,
        done: Callable[[Received], bool],
        *,
        timeout_s: float,
        what: str,
        again: Callable[[int], None] | None = None,
        again_s: float = 0.5,
    ) -> Received:
        """Wait for a message of the vehicle that ``done`` accepts.

        Args:
            done: Called with each message of the vehicle.
            timeout_s: Longest time to wait.
            what: Name of what is awaited, for the error.
            again: Called with 0 at once, and with 1, 2, ... after each silence, to request it (again).
            again_s: Length of that silence in seconds.

        Raises:
            VehicleSilentError: no such message within ``timeout_s`` seconds; it says ``what``.
        """
        vehicle = self.vehicle
        deadline = self.clock.now() + timeout_s
        attempt, ask_at = 0, self.clock.now()
        while self.clock.now() < deadline:
            self.raise_if_given_up()  # before anything is sent again
            if again is not None and self.clock.now() >= ask_at:
                again(attempt)
                attempt, ask_at = attempt + 1, self.clock.now() + again_s
            for received in self.next_messages(min(deadline, ask_at) if again is not None else deadline):
                if received.sender == vehicle.address and done(received):
                    return received
        raise VehicleSilentError(
            f"vehicle {vehicle.system_id} did not send {what} within {timeout_s:g} s{self.signing_advice()}"
        )

    def signing_advice(self) -> str:
        """Advice when the vehicle signs, this side has no key and gets no answer; otherwise empty."""
        signed = self.codec.statistics.signed
        if not signed:
            return ""
        return f"; the vehicle signs its messages ({signed} frames), but the client has no key: use --signing-key"

    def next_messages(self, deadline: float) -> list[Received]:
        """Wait until a datagram brings messages for us; an empty list at ``deadline``, a time of ``clock``."""
        while True:
            self.raise_if_given_up()
            now = self.clock.now()
            if now >= self._heartbeat_at + CALLS.heartbeat_s:
                self._heartbeat_at = now
                self._send_heartbeat()
            wake = min(deadline, self._heartbeat_at + CALLS.heartbeat_s, self._serve(now))
            messages = self._receive(max(0.0, wake - now))
            if messages or self.clock.now() >= deadline:
                return messages

    def run(
        self,
        machine: Machine,
        counts: Callable[[], tuple[int, int | None]],
        *,
        progress: Progress | None = None,
        stop: Stop | None = None,
    ) -> None:
        """Run a machine to its end.

        Args:
            machine: The machine.
            counts: Returns what is done, and the total if known.
            progress: Called when the first changes.
            stop: Polled; True cancels the machine, which may still have something to say to the vehicle.

        Raises:
            WaitCancelledError: the connection's ``give_up`` said so.
        """
        reported = -1
        while True:
            self.raise_if_given_up()
            now = self.clock.now()
            for message in machine.messages_to_send(now):
                self.send(message)
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
            for received in self.next_messages(wake):
                machine.receive(received, self.clock.now())

    def raise_if_given_up(self) -> None:
        """Nothing, unless ``give_up`` says that the call is to end.

        Raises:
            WaitCancelledError: it does.
        """
        if self.give_up is not None and self.give_up():
            raise WaitCancelledError("the call was cancelled; the vehicle may still have received it")

    def _serve(self, now: float) -> float:
        """Send the due messages of the services; return the time of their next call."""
        wake = math.inf
        for service in self.services:
            for message in service.messages_to_send(now):
                self.send(message)
            timer = service.next_timer()
            wake = wake if timer is None else min(wake, timer)
        return wake

    def _wait(self, seconds: float) -> None:
        """Let time pass while messages are processed as usual."""
        deadline = self.clock.now() + seconds
        while self.clock.now() < deadline:
            self.next_messages(deadline)

    def _send_heartbeat(self) -> None:
        beat = Heartbeat(AutopilotId.INVALID, VehicleClass.GROUND_STATION, system_status=4)
        self.send(beat)
        if self.codec.version == 1:  # the vehicle may have missed our MAVLink 2: let it hear some again
            self.codec.version = 2
            self.send(beat)
            self.codec.version = 1

    def _receive(self, timeout_s: float) -> list[Received]:
        """The messages for us in one datagram."""
        data = self.link.receive(timeout_s)
        if data is None:
            return []
        now = self.clock.now()
        ours: list[Received] = []
        for received in self.codec.decode(data):
            beat = self.peers.take(received)
            if self._vehicle is not None and received.sender == self._vehicle.address:
                self._agree_on_version(received)
                if beat is not None and self._vehicle.may_become(beat):
                    self._vehicle, self._heard_at = beat, now
                elif beat is not None and self.impostor is None:
                    self.impostor = beat
                    _log.warning("%s", two_in_one(self._vehicle, beat))
                elif isinstance(received.message, TimeSync) and received.message.answered_ns == 0:
                    self._answer_time(received.message)
                for service in self.services:
                    service.receive(received, now)
            if self._listener is not None:
                self._listener(received, now)
            if is_for(received.message, system_id=self.local.system_id, component_id=self.local.component_id):
                ours.append(received)
            else:
                self._for_others += 1
        return ours

    def _answer_time(self, question: TimeSync) -> None:
        """Answer a vehicle's request for our time, unless it asks too often."""
        if self._time_answers.allows(self.clock.now()):
            self.send(TimeSync(answered_ns=round(self.clock.now() * 1e9) or 1, requested_ns=question.requested_ns))

    def _agree_on_version(self, received: Received) -> None:
        """Use the newest MAVLink version the vehicle speaks."""
        if received.mavlink_version >= 2:
            self.codec.version = 2
        elif self.peers.speaks_only_1(received.sender):
            self.codec.version = 1

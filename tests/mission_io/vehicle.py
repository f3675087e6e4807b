"""A vehicle for tests: the package's mission server with heartbeats, on a simulated link or a real one."""

import random
from collections.abc import Iterable

from mission_io.autopilots.autopilot import ARDUPILOT, Autopilot
from mission_io.client.client import Client
from mission_io.links.simulated import Conditions, SimulatedLink
from mission_io.protocol.server import MissionServer
from mission_io.protocol.timing import Timing
from mission_io.wire.codec import Codec
from mission_io.wire.messages import Address, Heartbeat, Message, Received


class VehiclePeer:
    """A vehicle, component 1 of its system. ``answers`` are sent as they are; ``heard`` keeps what arrived."""

    def __init__(
        self,
        autopilot: Autopilot = ARDUPILOT,
        *,
        capacity: int | None = None,
        booted_at: float = -100.0,
        system_id: int = 1,
    ) -> None:
        self.autopilot = autopilot
        self.autopilot_number = int(autopilot.mav_autopilot)
        self.codec = Codec(system_id=system_id, component_id=1)
        self.server = MissionServer(autopilot, local=Address(system_id, 1), capacity=capacity, booted_at=booted_at)
        self.vehicle_type = 2
        self.base_mode = 0
        self.custom_mode = 0
        self.silent = False
        self.heard: list[Received] = []
        self.outbox: list[Message] = []
        self._beat_at = 0.0

    def on_message(self, received: Received, now: float) -> None:
        """For subclasses: what else the vehicle answers."""

    def instead(self, message: Message, now: float) -> Iterable[Message] | None:
        """For subclasses: what the vehicle answers in place of its server; None lets the server answer."""

    def receive_datagram(self, data: bytes, now: float) -> None:
        for received in self.codec.decode(data):
            self.heard.append(received)
            if self.silent:
                continue
            answers = self.instead(received.message, now)
            if answers is None:
                self.server.receive(received, now)
            self.outbox += answers or ()
            self.on_message(received, now)

    def datagrams_to_send(self, now: float) -> list[bytes]:
        messages = [*self.server.messages_to_send(now), *self.outbox]
        self.outbox = []
        if now >= self._beat_at:
            self._beat_at = now + 1.0
            messages.append(Heartbeat(self.autopilot_number, self.vehicle_type, self.base_mode, self.custom_mode, 3))
        return [] if self.silent else [self.codec.encode(message) for message in messages]

    def next_timer(self) -> float | None:
        timer = self.server.next_timer()
        return self._beat_at if timer is None else min(timer, self._beat_at)


def connected(
    peer: VehiclePeer, *, seed: int = 0, conditions: Conditions | None = None, timing: Timing | None = None
) -> Client:
    """A client that has found the vehicle, on a simulated link."""
    link = SimulatedLink(peer, rng=random.Random(seed), conditions=conditions)
    client = Client(link, timing=timing)
    client.wait_for_vehicle(60.0)
    return client

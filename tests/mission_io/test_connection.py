"""A link on which more comes than can be read."""

from mission_io.client.connection import Connection
from mission_io.links.simulated import ManualClock
from mission_io.wire.codec import Codec
from mission_io.wire.messages import Heartbeat

READING_S = 0.004
"""How long a busy machine takes for a datagram."""


class Flood:
    """Always has a datagram; reading one takes its time."""

    def __init__(self) -> None:
        self.clock = ManualClock()
        self.sent = 0
        self._vehicle = Codec(system_id=1, component_id=1)

    def send(self, data: bytes) -> None:
        del data
        self.sent += 1

    def receive(self, timeout_s: float) -> bytes | None:
        del timeout_s
        self.clock.advance_to(self.clock.now() + READING_S)
        return self._vehicle.encode(Heartbeat(3, 2))

    def close(self) -> None:
        """Nothing to let go of."""


def test_a_vehicle_that_sends_faster_than_we_read_does_not_keep_poll_for_ever() -> None:
    link = Flood()
    connection = Connection(link)
    connection.wait_for_vehicle()
    began_s, read = link.clock.now(), 0
    while link.clock.now() - began_s < 10.0:
        messages = connection.poll(0.0)
        assert 1 < len(messages) <= 27, "what is here for a tenth of a second"
        read += len(messages)
    assert read * READING_S > 9.9, "nothing is left lying"
    assert link.sent in (10, 11, 12), "heartbeats go out"

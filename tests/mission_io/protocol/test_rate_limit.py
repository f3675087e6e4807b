import pytest

from mission_io.errors import MisuseError
from mission_io.protocol.timing import RateLimit
from mission_io.wire.telemetry_messages import TimeSync
from tests.mission_io.vehicle import VehiclePeer, connected


def test_so_many_at_once_and_then_so_many_a_second() -> None:
    limit = RateLimit(per_s=10.0)
    assert sum(limit.allows(5.0) for _ in range(100)) == 10
    assert sum(limit.allows(5.0 + step * 0.01) for step in range(1, 301)) == 30
    assert sum(limit.allows(1000.0) for _ in range(100)) == 10
    with pytest.raises(MisuseError, match="per_s must"):
        RateLimit(per_s=0)


def test_a_flood_of_questions_for_the_time_is_answered_within_limits() -> None:
    peer = VehiclePeer()
    client = connected(peer)
    for step in range(20):
        peer.outbox = [TimeSync(0, 1 + step * 1000 + n) for n in range(500)]
        client.poll(0.1)
    client.poll(0.1)
    answers = sum(isinstance(received.message, TimeSync) for received in peer.heard)
    assert 500 <= answers <= 500 + 2.2 * 500

"""A link on which more comes than can be read."""

import random

import pytest

from mission_io.client.connection import Connection
from mission_io.links.simulated import ManualClock
from mission_io.wire.codec import Codec, LinkStatistics, SequenceCounter
from mission_io.wire.messages import Heartbeat

#


def counted(numbers: list[int]) -> tuple[int, int, int]:
    counter = SequenceCounter()
    for number in numbers:
        counter.take((1, 1), number)
    return counter.lost, counter.late, counter.duplicates


@pytest.mark.parametrize(
    ("numbers", "lost_late_duplicates"),
    [
        ([], (0, 0, 0)),
        ([200], (0, 0, 0)),
        ([7, 8, 9], (0, 0, 0)),
        ([254, 255, 0, 1], (0, 0, 0)),
        ([7, 9], (1, 0, 0)),
        ([254, 2], (3, 0, 0)),
        ([7, 9, 8, 10], (0, 1, 0)),
        ([7, 9, 8, 8, 7], (0, 1, 2)),
        ([5, 5], (0, 0, 1)),
        ([0, 128], (127, 0, 0)),
        ([0, 129], (0, 0, 1)),
        ([0, 2, 128, 1], (125, 1, 0)),
        ([0, 2, 100, 200, 40, 1, 1], (291, 1, 1)),
    ],
)
def test_sequence_numbers(numbers: list[int], lost_late_duplicates: tuple[int, int, int]) -> None:
    assert counted(numbers) == lost_late_duplicates


def test_senders_are_counted_apart() -> None:
    counter = SequenceCounter()
    for seq in range(0, 200, 2):
        counter.take((1, 1), seq // 2)
        counter.take((1, 2), seq)
    assert counter.lost == 99


def test_loss_duplicates_and_order_are_told_apart_over_many_rounds() -> None:
    rng = random.Random(8)
    kept = [number for number in range(5000) if rng.random() < 0.8]
    kept[-1] = 4999
    numbers = sorted(kept, key=lambda number: number + rng.choice([0, 0, 0, 5.5]))
    lost, late, duplicates = counted([0, *[number % 256 for number in numbers if number], 4999 % 256])
    assert lost == 5000 - len({0, *kept})
    assert late > 500
    assert duplicates == 1


def test_statistics_read_well() -> None:
    counts = LinkStatistics(frames_in=90, frames_out=12, lost=10, garbage_bytes=7, unsigned=1, replayed=2)
    assert str(counts) == "90 frames in, 12 frames out, 10 lost, 7 garbage bytes, 1 unsigned, 2 replayed"
    assert (counts.loss, counts.refused) == (0.1, 3)
    assert str(LinkStatistics()) == "nothing went over the link"
    assert LinkStatistics().loss == 0.0
    assert counts.as_json()["lost"] == 10


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

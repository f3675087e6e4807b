import random

import pytest

from mission_io.wire.codec import LinkStatistics, SequenceCounter


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
    assert str(LinkStatistics()) == "no data arrived on the link"
    assert LinkStatistics().loss == 0.0
    assert counts.as_json()["lost"] == 10

import random

import pytest

from mission_io.errors import LinkError, MisuseError
from mission_io.links.datagrams import UdpLink
from mission_io.links.simulated import Conditions, LossyLink, ManualClock, SimulatedLink


class Echo:
    """Sends back what it gets, and ``tick`` at its timers."""

    def __init__(self, timers: tuple[float, ...] = ()) -> None:
        self.timers = list(timers)
        self.waiting: list[bytes] = []

    def receive_datagram(self, data: bytes, now: float) -> None:
        assert now >= 0.0
        self.waiting.append(data)

    def datagrams_to_send(self, now: float) -> list[bytes]:
        sent, self.waiting = self.waiting, []
        while self.timers and self.timers[0] <= now:
            self.timers.pop(0)
            sent.append(b"tick")
        return sent

    def next_timer(self) -> float | None:
        return self.timers[0] if self.timers else None


def link(conditions: Conditions | None = None, timers: tuple[float, ...] = ()) -> SimulatedLink:
    return SimulatedLink(Echo(timers), rng=random.Random(5), conditions=conditions)


def test_time_passes_only_while_something_is_waited_for() -> None:
    simulated = link(Conditions(delay_s=0.5))
    simulated.send(b"a")
    assert simulated.clock.now() == 0.0
    assert simulated.receive(10.0) == b"a"
    assert simulated.clock.now() == 1.0
    assert simulated.receive(3.0) is None
    assert simulated.clock.now() == 4.0


def test_the_peer_is_asked_at_its_timers() -> None:
    simulated = link(Conditions(delay_s=0.25), timers=(2.0, 3.0))
    assert simulated.receive(10.0) == b"tick"
    assert simulated.clock.now() == 2.25
    assert simulated.receive(10.0) == b"tick"


def test_loss_duplication_and_corruption_happen_as_often_as_they_should() -> None:
    def arrivals(conditions: Conditions) -> list[bytes]:
        simulated = link(conditions)
        for number in range(1000):
            simulated.send(number.to_bytes(2, "big"))
        found = []
        while (data := simulated.receive(1.0)) is not None:
            found.append(data)
        return found

    assert 0.42 < len(arrivals(Conditions(loss=0.3))) / 1000 < 0.56
    assert 1.9 < len(arrivals(Conditions(duplication=0.4))) / 1000 < 2.05
    ordered = arrivals(Conditions())
    assert ordered == [number.to_bytes(2, "big") for number in range(1000)]
    damaged = arrivals(Conditions(corruption=0.2))
    assert 0.28 < sum(a != b for a, b in zip(ordered, damaged, strict=True)) / 1000 < 0.44
    jittered = arrivals(Conditions(jitter_s=0.1))
    assert jittered != ordered
    assert sorted(jittered) == ordered


def test_a_closed_link_is_an_error() -> None:
    simulated = link()
    simulated.close()
    with pytest.raises(LinkError):
        simulated.send(b"a")
    with pytest.raises(LinkError):
        simulated.receive(1.0)


@pytest.mark.parametrize("bad", [{"loss": 1.5}, {"duplication": -0.1}, {"delay_s": -1.0}, {"jitter_s": float("nan")}])
def test_impossible_conditions_are_refused(bad: dict[str, float]) -> None:
    with pytest.raises(MisuseError):
        Conditions(**bad)


def test_a_clock_does_not_go_back() -> None:
    clock = ManualClock(5.0)
    clock.advance_to(3.0)
    assert clock.now() == 5.0


def test_a_real_link_can_be_spoiled() -> None:
    with UdpLink.listening() as ground, UdpLink.connecting("127.0.0.1", ground.local_port) as inner:
        lossy = LossyLink(inner, rng=random.Random(1), conditions=Conditions(loss=1.0))
        lossy.send(b"gone")
        assert ground.receive(0.0) is None
        twice = LossyLink(inner, rng=random.Random(1), conditions=Conditions(duplication=1.0))
        twice.send(b"again")
        assert [ground.receive(5.0), ground.receive(5.0)] == [b"again"] * 2
        ground.send(b"back")
        assert [twice.receive(5.0), twice.receive(5.0), twice.receive(0.0)] == [b"back", b"back", None]
        damaged = LossyLink(inner, rng=random.Random(1), conditions=Conditions(corruption=1.0))
        damaged.send(b"")
        assert ground.receive(5.0) == b""
        assert damaged.clock is inner.clock
        damaged.close()

"""The named kinds of links, on a bad day of each: delay, jitter, loss, reordering, duplication, corruption, bandwidth."""

import random
import tracemalloc

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Autopilot
from mission_io.autopilots.mission_lists import wire_items
from mission_io.errors import MisuseError
from mission_io.links.simulated import (
    LINK_PRESETS,
    SATELLITE,
    TELEMETRY_RADIO,
    Conditions,
    LinkPreset,
    SimulatedLink,
    link_preset,
)
from mission_io.model.items import GeoPoint, Mission, MissionType
from mission_io.protocol.timing import Timing
from tests.mission_io.protocol.scripts import items
from tests.mission_io.vehicle import VehiclePeer, connected

MISSION = Mission(GeoPoint(46.5, -7.5, 500.0), items(30))
BOTH = pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)


@BOTH
@pytest.mark.parametrize("preset", LINK_PRESETS.values(), ids=lambda p: p.name)
@pytest.mark.parametrize("own_timing", [True, False], ids=["its timing", "the default timing"])
@pytest.mark.no_cover
def test_upload_read_back_and_clear(autopilot: Autopilot, preset: LinkPreset, own_timing: bool) -> None:
    timing = preset.timing if own_timing else None
    for seed in range(3):
        peer = VehiclePeer(autopilot)
        client = connected(peer, seed=seed, conditions=preset.conditions, timing=timing)
        assert client.upload_and_verify(MISSION).passed
        assert peer.server.items(MissionType.MISSION) == wire_items(MISSION, autopilot)
        client.clear(MissionType.MISSION)
        assert peer.server.items(MissionType.MISSION) == ()


def test_they_are_what_they_say() -> None:
    assert SATELLITE.conditions.delay_s == 0.3
    assert TELEMETRY_RADIO.conditions.bytes_per_s == 5760.0
    for preset in (TELEMETRY_RADIO, SATELLITE):
        conditions = preset.conditions
        assert min(conditions.loss, conditions.duplication, conditions.corruption, conditions.jitter_s) > 0.0
    assert link_preset("satellite") is SATELLITE
    with pytest.raises(MisuseError, match="use one of default, telemetry-radio, satellite"):
        link_preset("carrier-pigeon")


class Sink:
    """Notes when datagrams arrive."""

    def __init__(self) -> None:
        self.arrivals: list[float] = []

    def receive_datagram(self, _data: bytes, now: float) -> None:
        self.arrivals.append(now)

    def datagrams_to_send(self, _now: float) -> list[bytes]:
        return []

    def next_timer(self) -> float | None:
        return None


def test_bandwidth_spaces_datagrams_and_a_full_buffer_drops_them() -> None:
    sink = Sink()
    conditions = Conditions(delay_s=0.25, bytes_per_s=1000.0, queue_bytes=500.0)
    link = SimulatedLink(sink, rng=random.Random(1), conditions=conditions)
    for _ in range(20):
        link.send(bytes(100))
    link.receive(10.0)
    assert sink.arrivals == pytest.approx([0.25 + 0.1 * number for number in range(1, 7)])
    for bad in ({"bytes_per_s": 0.0}, {"queue_bytes": -1.0}):
        with pytest.raises(MisuseError, match="must be >"):
            Conditions(**bad)


@pytest.mark.no_cover  # thousands of times the same lines, three times as slow when they are traced
@BOTH
def test_time_of_a_long_mission(autopilot: Autopilot) -> None:
    """1,000 items at 20 ms there and back: the protocol's limit is a round trip an item; one item ahead halves it."""
    round_trip_s, count = 0.02, 1000
    peer = VehiclePeer(autopilot, capacity=count)
    client = connected(peer, conditions=Conditions(delay_s=round_trip_s / 2))
    began = client.clock.now()
    client.upload(MissionType.MISSION, items(count))
    assert client.clock.now() - began < 0.6 * count * round_trip_s
    began = client.clock.now()
    assert client.download(MissionType.MISSION) == items(count)
    assert client.clock.now() - began < 1.05 * count * round_trip_s
    plain = connected(VehiclePeer(autopilot, capacity=count), conditions=Conditions(delay_s=round_trip_s / 2),
                      timing=Timing(items_ahead=0))  # fmt: skip
    began = plain.clock.now()
    plain.upload(MissionType.MISSION, items(count))
    assert count * round_trip_s < plain.clock.now() - began < 1.05 * count * round_trip_s


@pytest.mark.no_cover
def test_memory_of_a_long_upload_does_not_grow() -> None:
    """What a transfer allocates between its 500th and its 2,500th item is gone again, but for the vehicle's own list."""
    peer = VehiclePeer(PX4)
    peer.heard = Forgetful()  # type: ignore[assignment]
    client = connected(peer)
    sent = items(2600)
    held: dict[int, int] = {}

    def measure(done: int, total: int) -> None:
        del total
        if done in (500, 2500):
            held[done] = sum(
                statistic.size
                for statistic in tracemalloc.take_snapshot()
                .filter_traces([tracemalloc.Filter(False, "*/protocol/server.py"), *NOT_THE_CLIENT])
                .statistics("filename")
            )

    tracemalloc.start()
    try:
        client.upload(MissionType.MISSION, sent, progress=measure)
    finally:
        tracemalloc.stop()
    assert held[2500] - held[500] < 30_000  # 15 bytes an item; an item that is kept takes 300 and more


class Forgetful(list):  # type: ignore[type-arg]
    """A list that keeps nothing."""

    def append(self, _: object) -> None:
        """Forget it."""


NOT_THE_CLIENT = [
    tracemalloc.Filter(False, f"*/{name}.py")
    for name in ("wire/mission_items", "storage", "autopilot", "codec", "items")
]

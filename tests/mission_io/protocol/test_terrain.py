import math
from collections.abc import Sequence
from random import Random

import pytest

from mission_io.errors import MisuseError
from mission_io.links.simulated import Conditions
from mission_io.protocol.terrain import ALL_PARTS, PART_COUNT, TerrainAnswers, position_in_block
from mission_io.protocol.timing import VALUES
from mission_io.wire.messages import Heartbeat, Received
from mission_io.wire.telemetry_messages import TerrainData, TerrainRequest
from tests.mission_io.vehicle import VehiclePeer, connected


def hill(positions: Sequence[tuple[float, float]]) -> list[float]:
    return [1000.0 * (lat - 46.0) + 500.0 * (lon - 8.0) for lat, lon in positions]


def heard(message: object) -> Received:
    return Received(message, 1, 1, 2)  # type: ignore[arg-type]


def request(lat: float = 46.51, lon: float = 8.27, spacing_m: int = 100, mask: int = ALL_PARTS) -> TerrainRequest:
    corner = position_in_block(lat, lon, spacing_m).block.corner_e7
    return TerrainRequest(corner[0] / 1e7, corner[1] / 1e7, spacing_m, mask)


def everything(answers: TerrainAnswers, start_s: float = 0.0, for_s: float = 60.0) -> list[TerrainData]:
    """What is sent, asked at the times it wants to be asked."""
    sent: list[TerrainData] = []
    now = start_s
    while now is not None and now <= start_s + for_s:
        sent += answers.messages_to_send(now)  # type: ignore[arg-type]
        now = answers.next_timer()  # type: ignore[assignment]
    return sent


@pytest.mark.parametrize("mask", [ALL_PARTS, 1, 1 << 55, 0b1011 << 20, (1 << 64) - 1])
def test_every_requested_part_is_sent_once(mask: int) -> None:
    answers = TerrainAnswers(hill)
    answers.receive(heard(request(mask=mask)), 0.0)
    sent = everything(answers)
    assert [data.part for data in sent] == [part for part in range(PART_COUNT) if mask >> part & 1]
    requested = request()
    assert {(data.lat_deg, data.lon_deg, data.spacing_m) for data in sent} == {
        (requested.lat_deg, requested.lon_deg, 100)
    }
    assert answers.next_timer() is None
    assert answers.counts.parts_sent == len(sent)


@pytest.mark.parametrize("rate", [5.0, 35.0, 200.0])
def test_the_rate_holds_over_every_second(rate: float) -> None:
    answers = TerrainAnswers(hill, parts_per_s=rate)
    rng = Random(3)
    times: list[float] = []
    now = 0.0
    while now < 20.0:
        answers.receive(heard(request(46.0 + rng.random(), 8.0 + rng.random())), now)
        times += [now] * len(answers.messages_to_send(now))
        now += rng.choice([0.001, 0.01, 0.3])
    assert len(times) > 15.0 * rate
    for start in range(19):
        assert (
            sum(start <= time < start + 1.0 for time in times) <= 2.0 * rate + 2.0
        )  # a pause of up to 1 s is caught up
    assert len(times) <= 21.0 * rate + 1.0


def test_a_program_that_slept_does_not_send_a_burst() -> None:
    answers = TerrainAnswers(hill, parts_per_s=10.0)
    answers.receive(heard(request()), 0.0)
    answers.messages_to_send(0.0)
    assert len(answers.messages_to_send(3600.0)) <= 12


def test_unknown_ground_is_not_sent_and_told_once() -> None:
    reported: list[str] = []
    requested = request()
    answers = TerrainAnswers(
        lambda positions: [math.nan if lon > 8.28 else 5.0 for _, lon in positions], say=reported.append
    )
    for turn in range(5):
        answers.receive(heard(requested), 100.0 * turn)
        sent = everything(answers, 100.0 * turn)
        assert 0 < len(sent) < PART_COUNT
        assert all(data.heights_amsl_m == (5,) * 16 for data in sent)
    assert len(reported) == 1
    assert f"latitude {requested.lat_deg:.5f}" in reported[0]
    assert "no elevation data for" in reported[0]
    assert answers.counts.blocks == answers.counts.blocks_incomplete == 1
    assert answers.counts.parts_sent + answers.counts.parts_unknown == 5 * PART_COUNT


def _nonsense(rng: Random) -> TerrainRequest:
    return TerrainRequest(
        rng.choice([0.0, 90.0, -90.0, 90.0000001, 214.7483647, -214.7483648, rng.uniform(-90, 90)]),
        rng.choice([0.0, 180.0, -180.0, 180.0000001, 214.7483647, -214.7483648, rng.uniform(-180, 180)]),
        rng.choice([0, 1, 65535, 100, rng.randrange(65536)]),
        rng.choice([0, (1 << 64) - 1, 1 << 63, 1 << 56, 1, rng.getrandbits(64)]),
    )


@pytest.mark.parametrize("seed", range(6))
def test_a_flood_of_nonsense_stays_within_limits(seed: int) -> None:
    rng = Random(seed)
    reported: list[str] = []
    calls = 0

    def ground(positions: Sequence[tuple[float, float]]) -> list[float]:
        nonlocal calls
        calls += 1
        assert all(abs(lat) <= 90.0 and -180.0 <= lon <= 180.0 for lat, lon in positions)
        return [rng.choice([math.nan, 1e9, -1e9, 400.0, 401.4]) for _ in positions]

    answers = TerrainAnswers(ground, say=reported.append)
    sent, now = 0, 0.0
    for _ in range(3000):
        answers.receive(heard(_nonsense(rng)), now)
        out = answers.messages_to_send(now)
        assert all(isinstance(data, TerrainData) and 0 <= data.part < PART_COUNT for data in out)
        sent += len(out)
        now += 0.002
    counts = answers.counts
    assert counts.requests == 3000
    assert counts.refused > 100
    assert sent <= 35.0 * (now + 1.0)
    assert calls <= 35.0 * (now + 1.0)  # blocks are reckoned as seldom as parts are sent
    assert len(reported) <= 10
    assert len(everything(answers, now, 1e6)) <= VALUES.max_waiting * PART_COUNT


@pytest.mark.parametrize("rate", [0.0, -1.0, math.inf, math.nan])
def test_a_rate_that_is_none_is_misuse(rate: float) -> None:
    with pytest.raises(MisuseError, match="parts_per_s"):
        TerrainAnswers(hill, parts_per_s=rate)


def test_other_messages_are_not_answered() -> None:
    answers = TerrainAnswers(hill)
    answers.receive(heard(Heartbeat(3, 2)), 0.0)
    assert answers.next_timer() is None
    assert answers.counts.requests == 0


class WantsTerrain(VehiclePeer):
    """Requests a block every two seconds until it is whole."""

    def __init__(self) -> None:
        super().__init__()
        self.parts: dict[int, tuple[int, ...]] = {}
        self._ask_at = 0.0

    def on_message(self, received: Received, *_: object) -> None:
        if isinstance(received.message, TerrainData):
            self.parts[received.message.part] = received.message.heights_amsl_m

    def datagrams_to_send(self, now: float) -> list[bytes]:
        if now >= self._ask_at and len(self.parts) < PART_COUNT:
            self._ask_at = now + 2.0
            self.outbox.append(request(mask=ALL_PARTS & ~sum(1 << part for part in self.parts)))
        return super().datagrams_to_send(now)


@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_a_connection_answers_whatever_call_waits(loss: float) -> None:
    peer = WantsTerrain()
    client = connected(peer, seed=2, conditions=Conditions(loss=loss))
    client.services.append(TerrainAnswers(hill))
    for _ in range(200):
        client.poll(0.2)
    assert len(peer.parts) == PART_COUNT
    # Nothing of it is answered for another vehicle, nor when nobody serves.
    peer.parts.clear()
    client.services.clear()
    client.poll(5.0)
    assert peer.parts == {}


def test_only_the_vehicle_that_is_meant_is_answered() -> None:
    peer = WantsTerrain()
    client = connected(peer)
    answers = TerrainAnswers(hill)
    client.services.append(answers)
    peer.codec.component_id = 191  # a companion computer of the same system
    client.poll(3.0)
    assert answers.counts.requests == 0

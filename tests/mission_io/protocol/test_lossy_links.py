"""Whole transfers over bad links, on a simulated clock, by seed: always right, or an error that says what is held."""

import random
import statistics
from dataclasses import replace

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Autopilot, wire_items
from mission_io.autopilots.comparison import compare_items
from mission_io.client.client import Client
from mission_io.links.simulated import Conditions, SimulatedLink
from mission_io.model.items import Frame, GeoPoint, Mission, MissionType, waypoint
from mission_io.wire.messages import MissionRequestInt, MissionRequestList, Received
from tests.mission_io.vehicle import VehiclePeer, connected

# Downloads from PX4 ask for one item early, as long as nothing is lost and beginning anew would be cheap.

ITEMS = tuple(waypoint(46.0 + n * 1e-3, -7.0 - n * 2e-3, 50.0 + n, frame=Frame.ABOVE_HOME) for n in range(100))


class DropsRequest(VehiclePeer):
    """A PX4 that does not hear the nth request for an item."""

    lost = -1

    def receive_datagram(self, data: bytes, now: float) -> None:
        if any(isinstance(r.message, MissionRequestInt) for r in self.codec.decode(data)):
            self.lost -= 1
            if self.lost == 0:
                return
        super().receive_datagram(data, now)


def download(peer: VehiclePeer, delay_s: float) -> float:
    peer.server.set_items(MissionType.MISSION, ITEMS)
    client = Client(SimulatedLink(peer, rng=random.Random(1), conditions=Conditions(delay_s=delay_s)))
    client.wait_for_vehicle(60.0)
    start = client.clock.now()
    assert client.download(MissionType.MISSION) == tuple(peer.server.items(MissionType.MISSION))
    return client.clock.now() - start


def requests(peer: VehiclePeer, kind: type) -> list[Received]:
    return [received for received in peer.heard if isinstance(received.message, kind)]


@pytest.mark.parametrize(("delay_s", "round_trips"), [(0.001, 56), (0.05, 103)], ids=["short", "long"])
def test_a_short_link_takes_half_of_the_round_trips(delay_s: float, round_trips: int) -> None:
    peer = VehiclePeer(PX4)
    taken_s = download(peer, delay_s)
    assert 0.9 * round_trips < taken_s / (2 * delay_s) < 1.05 * round_trips
    assert len(requests(peer, MissionRequestList)) == 1
    assert len(requests(peer, MissionRequestInt)) == 100


@pytest.mark.parametrize("lost", [5, 40, 100])
def test_a_lost_request_begins_anew_at_once_and_nothing_is_asked_early_again(lost: int) -> None:
    peer = DropsRequest(PX4)
    peer.lost = lost
    assert download(peer, 0.001) < 0.5
    assert len(requests(peer, MissionRequestList)) == 1 + (
        lost == 40
    )  # nothing follows the last one, and it is asked for again


SEEDS = 20
MISSION = Mission(
    GeoPoint(46.5, -7.5, 500.0),
    tuple(waypoint(46.5 + i * 1e-4, -7.5 - i * 2e-4, 100.0 + i, frame=Frame.ABOVE_HOME) for i in range(40)),
)
BAD = Conditions(duplication=0.1, corruption=0.02, delay_s=0.005, jitter_s=0.05)


@pytest.mark.parametrize("loss", [0.0, 0.1, 0.3])
@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
@pytest.mark.no_cover
def test_upload_and_download_are_right(autopilot: Autopilot, loss: float) -> None:
    times = []
    items = wire_items(MISSION, autopilot)
    for seed in range(SEEDS):
        peer = VehiclePeer(autopilot)
        client = connected(peer, seed=seed, conditions=replace(BAD, loss=loss) if loss else Conditions())
        start = client.clock.now()
        client.upload(MissionType.MISSION, items)
        times.append(client.clock.now() - start)
        received = client.download(MissionType.MISSION)
        assert received == peer.server.items(MissionType.MISSION)
        assert all(d.acceptable for d in compare_items(items, received, autopilot))
        client.clear(MissionType.MISSION)
        assert peer.server.items(MissionType.MISSION) == ()
    assert statistics.median(times) < {0.0: 0.2, 0.1: 6.0, 0.3: 15.0}[loss]


@pytest.mark.no_cover
def test_at_40_percent_loss_nothing_wrong_goes_unnoticed() -> None:
    for seed in range(SEEDS):
        peer = VehiclePeer(ARDUPILOT)
        client = connected(peer, seed=seed, conditions=replace(BAD, loss=0.4))
        assert client.upload_and_verify(MISSION).passed


def test_a_slow_satellite_link() -> None:
    peer = VehiclePeer(PX4)
    client = connected(peer, conditions=Conditions(delay_s=0.3, jitter_s=0.1, loss=0.05))
    assert client.upload_and_verify(replace(MISSION, items=MISSION.items[:10])).passed


def test_equal_seed_equal_conversation() -> None:
    def heard(seed: int) -> list[object]:
        peer = VehiclePeer(PX4)
        connected(peer, seed=seed, conditions=replace(BAD, loss=0.2)).upload(MissionType.MISSION, MISSION.items)
        return list(peer.heard)

    assert heard(3) == heard(3)
    assert heard(3) != heard(4)

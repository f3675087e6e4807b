"""Downloads from PX4 ask for one item early, as long as nothing is lost and beginning anew would be cheap."""

import random

import pytest

from mission_io.autopilots.autopilot import PX4
from mission_io.client.client import Client
from mission_io.links.simulated import Conditions, SimulatedLink
from mission_io.model.items import Frame, MissionType, waypoint
from mission_io.wire.messages import MissionRequestInt, MissionRequestList, Received
from tests.mission_io.vehicle import VehiclePeer

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
    )  # nothing follows the last one, and it is requested again

"""Whole transfers over bad links, by seed: always right, or an error that says what is held; early requests; random walks."""

import random
import statistics
from dataclasses import replace

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Autopilot
from mission_io.autopilots.comparison import compare_items
from mission_io.autopilots.mission_lists import wire_items
from mission_io.client.client import Client
from mission_io.links.simulated import Conditions, SimulatedLink
from mission_io.model.items import Frame, GeoPoint, Mission, MissionType, waypoint
from mission_io.protocol.download import Download
from mission_io.protocol.exchange import Clear
from mission_io.protocol.server import MissionServer
from mission_io.protocol.upload import Upload
from mission_io.wire.messages import MissionRequestInt, MissionRequestList, Received
from tests.mission_io.protocol.scripts import GROUND, VEHICLE, items, play
from tests.mission_io.vehicle import VehiclePeer, connected

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


RESULTS = ("ACCEPTED", "ERROR", "NO_SPACE", "INVALID", "INVALID_SEQUENCE", "DENIED", "OPERATION_CANCELLED")
STEPS = (
    *(f"ack {result}" for result in RESULTS),
    *(f"{kind} {number}" for kind in ("req", "oldreq", "item", "count") for number in (0, 1, 2, 3, 11)),
    *("list", "clear", "clear /all", "list /rally", "list /unknown", "count 2 /rally", "count 2 @9", "item 1 bad"),
    *("wait 0.06", "wait 0.3", "wait 1.1", "wait 6", "wait 17"),
)
CLIENT = {"mission_type": MissionType.MISSION, "local": GROUND, "vehicle": VEHICLE, "now": 0.0}


@pytest.mark.parametrize("kind", ["upload", "empty upload", "download", "clear"])
def test_client(kind: str) -> None:
    rng = random.Random(kind)
    for _ in range(150):
        machine: Upload | Download | Clear
        if kind == "clear":
            machine = Clear(**CLIENT)
        else:
            machine = Download(**CLIENT) if kind == "download" else Upload(items(0 if "empty" in kind else 3), **CLIENT)
        steps = (*STEPS, *([] if kind == "clear" else ["cancel"]))
        play(machine, ", ".join(rng.choices(steps, k=30)), sender=VEHICLE, to=GROUND)
        assert machine.finished == (machine.next_timer() is None)


@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
def test_server(autopilot: Autopilot) -> None:
    rng = random.Random(autopilot.name)
    for _ in range(150):
        server = MissionServer(autopilot, local=VEHICLE, capacity=10)
        play(server, ", ".join(rng.choices(STEPS, k=30)), sender=GROUND, to=VEHICLE)
        assert all(len(server.items(mission_type)) <= 10 for mission_type in MissionType)


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

"""Whole transfers over bad links, on a simulated clock, by seed: always right, or an error that says what is held."""

import statistics
from dataclasses import replace

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Autopilot
from mission_io.autopilots.comparison import compare_items
from mission_io.autopilots.mission_lists import wire_items
from mission_io.links.simulated import Conditions
from mission_io.model.items import Frame, GeoPoint, Mission, MissionType, waypoint
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

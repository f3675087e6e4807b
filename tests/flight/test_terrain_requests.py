"""A mission above terrain needs somebody who answers the vehicle's questions for the ground."""

from collections.abc import Sequence
from dataclasses import replace

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT
from mission_io.client.client import answer_terrain_requests
from mission_io.model.items import Command, Frame, Mission
from mission_io.protocol.terrain import TerrainAnswers
from mission_io.wire.messages import TerrainRequest
from tests.flight.scene import HOME, make_scene, mission
from uavcover.mock.behaviour import GroundSource, quick
from uavcover.model.outcome import Ending, FlightFailedError


def level(places: Sequence[tuple[float, float]]) -> list[float]:
    return [HOME.alt_amsl_m] * len(places)


def above_terrain(plain: Mission) -> Mission:
    items = [
        replace(item, frame=Frame.ABOVE_TERRAIN) if item.command == Command.NAV_WAYPOINT else item
        for item in plain.items
    ]
    return Mission(plain.home, tuple(items))


WANTED = above_terrain(mission())


def scene_that_asks():
    scene = make_scene(ARDUPILOT, behaviour=replace(quick(), terrain=GroundSource.GROUND_STATION))
    scene.upload(WANTED)
    return scene


def test_it_flies_when_it_is_answered() -> None:
    scene = scene_that_asks()
    answer_terrain_requests(scene.client, TerrainAnswers(level, parts_per_s=200.0))
    outcome = scene.fly(WANTED)
    assert outcome.ending is Ending.LANDED
    assert scene.vehicle.terrain is not None
    assert scene.vehicle.terrain.pending == 0


def test_it_arms_when_the_heights_take_a_slow_link_longer_than_arming_may_take() -> None:
    scene = scene_that_asks()
    answer_terrain_requests(scene.client, TerrainAnswers(level, parts_per_s=2.0))
    outcome = scene.fly(WANTED)
    assert outcome.ending is Ending.LANDED
    assert len(scene.monitor.terrain_asked) > 3


def test_it_does_not_arm_when_nobody_answers() -> None:
    scene = scene_that_asks()
    scene.client.request_message_interval(TerrainRequest, 0.5)
    with pytest.raises(FlightFailedError, match="waiting for terrain data"):
        scene.fly(WANTED)
    assert scene.monitor.counts[TerrainRequest] > 3

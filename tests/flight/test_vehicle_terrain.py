"""Heights of the ground for vehicles: as files, and as answers to their questions."""

import math
import shutil
import struct
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from random import Random

import numpy as np
import pytest

from mission_io.autopilots.autopilot import ARDUPILOT
from mission_io.client.client import answer_terrain_requests
from mission_io.model.items import Command, Frame, Mission
from mission_io.protocol.terrain import TerrainAnswers, position_in_block, wrapped_deg
from mission_io.wire.telemetry_messages import TerrainRequest
from tests.flight.scene import HOME, make_scene, mission
from uavcover.errors import InputError
from uavcover.extras.vehicle_files.terrain_heights import write_terrain_files
from uavcover.flight.connect import heights_of_files, heights_of_site
from uavcover.mock.behaviour import GroundSource, quick
from uavcover.model.track import Ending, FlightFailedError
from uavcover.run.user import Unattended
from uavcover.scenario.site import load_site
from uavcover.terrain import elevation_file
from uavcover.terrain.elevation_file import read_heights_amsl_m
from uavcover.terrain.terrain_source import FILES, TerrainSource

DEM = Path("uavcover/data/jacksboro.tif")


@pytest.mark.parametrize("most_pixels", [1, 50, 5_000])
def test_places_far_apart_are_read_without_all_that_is_between_them(
    most_pixels: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = Random(most_pixels)
    lat = np.array([rng.uniform(36.3, 36.9) for _ in range(200)])
    lon = np.array([rng.uniform(-84.6, -84.0) for _ in range(200)])
    source = TerrainSource((DEM,))
    at_once = read_heights_amsl_m(source, "EGM96", lat, lon)
    windows: list[float] = []
    read = elevation_file._Raster.read

    def counted(self, window):
        windows.append(window.width * window.height)
        return read(self, window)

    monkeypatch.setattr(elevation_file, "FILES", replace(FILES, most_pixels=most_pixels))
    monkeypatch.setattr(elevation_file._Raster, "read", counted)
    np.testing.assert_allclose(read_heights_amsl_m(source, "EGM96", lat, lon), at_once, rtol=0.0, atol=1e-6)
    assert 0 < np.isnan(at_once).sum() < 200
    assert max(windows) <= max(9, most_pixels)


def test_files_that_vanish_are_said_and_their_ground_is_unknown(tmp_path: Path) -> None:
    file = Path(shutil.copy(DEM, tmp_path))
    reported: list[str] = []
    heights = heights_of_files(TerrainSource((file,)), "EGM96", reported.append)
    assert math.isfinite(heights([(36.48, -84.22)])[0])
    file.unlink()
    assert all(math.isnan(height) for height in heights([(36.48, -84.22), (36.49, -84.22)]))
    assert len(reported) == 1
    assert str(file) in reported[0]


def test_a_scenario_without_a_place_on_earth_answers_nothing() -> None:
    assert heights_of_site(load_site("paper-planar"), lambda _: None) is None


@pytest.mark.parametrize("seed", range(10))
def test_the_terrain_files_have_the_block_of_every_place(seed: int, tmp_path: Path) -> None:
    rng = Random(seed)
    spacing = rng.choice([50, 100, 300])
    west, south = (
        rng.choice([-180.0, 179.97, -0.02, rng.uniform(-180, 180)]),
        rng.choice([-0.02, rng.uniform(-84, 84), 46.99]),
    )
    around = (west, south, west + rng.uniform(0.001, 0.15), south + rng.uniform(0.001, 0.1))

    def level(positions):
        return [17.0] * len(positions)

    written = write_terrain_files(level, around, tmp_path, spacing_m=spacing, force=False, user=Unattended())
    filled: set[tuple[int, ...]] = set()
    for name in written:
        data = (tmp_path / name).read_bytes()
        filled |= {tuple(data[at + 8 : at + 16]) for at in range(0, len(data), 2048) if any(data[at : at + 2048])}
    assert sum(written.values()) == len(filled)
    for _ in range(300):
        lat, lon = rng.uniform(around[1], around[3]), rng.uniform(around[0], around[2])
        lat_e7, lon_e7 = position_in_block(lat, wrapped_deg(lon), spacing).block.corner_e7
        assert tuple(struct.pack("<ii", lat_e7, lon_e7)) in filled


def test_an_area_with_too_many_blocks_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="larger --spacing"):
        write_terrain_files(
            lambda at: [0.0] * len(at), (0.0, 0.0, 9.0, 9.0), tmp_path, spacing_m=30, force=False, user=Unattended()
        )


def level(positions: Sequence[tuple[float, float]]) -> list[float]:
    return [HOME.alt_amsl_m] * len(positions)


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
    assert len(scene.monitor.terrain_requested) > 3


def test_it_does_not_arm_when_nobody_answers() -> None:
    scene = scene_that_asks()
    scene.client.request_message_interval(TerrainRequest, 0.5)
    with pytest.raises(FlightFailedError, match="waiting for terrain data"):
        scene.fly(WANTED)
    assert scene.monitor.counts[TerrainRequest] > 3

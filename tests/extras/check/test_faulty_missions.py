"""A few of the missions and faults of scripts/attack/faulty_missions.py; docs/results/safety.md has all."""

from pathlib import Path

import numpy as np
import pytest

from mission_io.formats.files import read_mission
from scripts.attack.faulty_missions import judged, touches
from tests.extras.check.made_faults import with_fault
from tests.extras.check.made_missions import KINDS, Case, good_mission, terrains
from tests.naive.mission_check import Plane, path
from uavcover.extras.check.flown_path import flown_path
from uavcover.extras.check.world import Aircraft, World
from uavcover.terrain.elevation_file import read_ground
from uavcover.terrain.frames import LocalFrame


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> list[Case]:
    grounds = terrains(tmp_path_factory.mktemp("terrains"))
    found: list[Case] = []
    for number in range(60):
        case = good_mission(grounds[number % len(grounds)], np.random.default_rng([3, number]))
        found += [] if case is None else [case]
        if len(found) == 7:
            break
    return found


def test_good_missions_raise_no_alarm(good: list[Case], tmp_path: Path) -> None:
    assert len({case.terrain.name for case in good}) >= 5
    for case in good[:3]:
        code, findings = judged(case, tmp_path)
        assert (code, [one for one in findings if one["weight"] != "look"]) == (0, [])


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_of_fault_is_found(good: list[Case], tmp_path: Path, kind: str) -> None:
    tries = (with_fault(good[k % len(good)], kind, np.random.default_rng([4, k])) for k in range(60))
    faulty = next(case for case in tries if case is not None)
    code, findings = judged(faulty, tmp_path)
    assert code == 1
    there = [one for one in findings if one["weight"] == "breaks" and one["kind"] in faulty.expected]
    assert any(touches(one["items"], faulty.items) for one in there), findings


def test_the_path_and_its_heights_are_those_of_the_naive_judge(good: list[Case], tmp_path: Path) -> None:
    for case in good:
        case.write(tmp_path)
        mission = read_mission(tmp_path / ("m.plan" if case.px4 else "m.waypoints"))
        assert mission.home is not None
        frame = LocalFrame(mission.home.lat_deg, mission.home.lon_deg, mission.home.alt_amsl_m)
        bounds = (-900.0, -900.0, 900.0, 900.0)
        world = World(frame, read_ground(case.terrain.file, "EGM96", frame=frame, bounds_m=bounds, grid_step_m=None))
        aircraft = Aircraft(autopilot="px4" if case.px4 else "ardupilot", return_height_m=case.return_m)
        flown = [segment for segment in flown_path(mission, world, aircraft).segments if segment.phase == "route"]
        plane = Plane(*case.home)
        naive = [
            each
            for each in path(case.rows, plane, mission.home.alt_amsl_m, case.return_m, px4=case.px4)
            if each[2] == "route"
        ]
        # PX4 also flies to the place of its take-off, which is home; who is above his landing place need not go there.
        naive_pairs = [(begin, end) for begin, end, *_ in naive]
        flown = [segment for segment in flown if segment.items in naive_pairs]
        assert len(flown) >= len(naive) - 1
        worst = {pair: [] for pair in naive_pairs}
        for begin, end, _, points in naive:
            above = points[:, 2] - case.terrain.ground.height_m(*plane.back(points[:, 0], points[:, 1]))
            worst[begin, end].append(above.min())
        for segment in flown:
            lowest = world.ground.leg_height_ranges_m(segment.enu_m)[:, 0].min()
            assert min(abs(lowest - each) for each in worst[segment.items]) < 0.6, segment.items

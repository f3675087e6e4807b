"""MIS_RESTART=1: entering AUTO begins the mission anew, so the item is set after that, and verified."""

import dataclasses
import itertools

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4
from mission_io.model.enums import CommandResult
from tests.flight.scene import Scene, make_scene, mission, plan_for, presses, way_home
from uavcover.flight.resume import Continuation, take_over
from uavcover.mock.flight_control import FlightControl
from uavcover.model.outcome import Ending, FlightFailedError

BOTH = pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)


def held_in_the_air(autopilot) -> Scene:
    """On its way to the second waypoint, holding."""
    scene = restarting(autopilot)
    assert scene.fly(stop=presses(scene, 35.0, 35.1)).ending is Ending.LEFT_HOLDING
    return scene


def restarting(autopilot=ARDUPILOT) -> Scene:
    scene = make_scene(autopilot)
    scene.upload(mission())
    if autopilot is ARDUPILOT:
        scene.vehicle.parameters.put("MIS_RESTART", 1.0)
    return scene


def items_flown(scene: Scene, monkeypatch) -> list[tuple[float, int]]:
    """Each item that the vehicle begins to fly to, with the vehicle's time."""
    begun: list[tuple[float, int]] = []
    go_on = scene.vehicle.control.mission.go_on

    def listen(now: float) -> None:
        go_on(now)
        if not begun or begun[-1][1] != scene.vehicle.current_seq:
            begun.append((now, scene.vehicle.current_seq))

    monkeypatch.setattr(scene.vehicle.control.mission, "go_on", listen)
    return begun


def longest_stay_s(begun: list[tuple[float, int]], seqs: set[int], after_s: float) -> float:
    return max(
        (end - start for (start, seq), (end, _) in itertools.pairwise(begun) if seq in seqs and start > after_s),
        default=0.0,
    )


@BOTH
def test_after_a_pause_it_goes_on_with_the_item_it_was_flying_to(autopilot, monkeypatch):
    scene = restarting(autopilot)
    begun = items_flown(scene, monkeypatch)
    outcome = scene.fly(pause=lambda: 30.0 < (scene.monitor.time_s or 0.0) < 50.0)
    assert outcome.ending is Ending.LANDED, outcome.incidents
    first = begun[0][1]
    assert longest_stay_s(begun, {first, first + 1, first + 2}, 40.0) < 1.0


@BOTH
def test_the_way_home_is_flown_from_its_first_item(autopilot):
    scene = restarting(autopilot)
    assert scene.fly(stop=presses(scene, 35.0)).ending is Ending.RETURNED


@BOTH
def test_a_vehicle_in_the_air_goes_on_with_the_item_that_it_is_told(autopilot, monkeypatch):
    scene = held_in_the_air(autopilot)
    begun = items_flown(scene, monkeypatch)
    plan = dataclasses.replace(plan_for(mission()), first_waypoint_item=5, waypoint_count=2)
    outcome = take_over(
        scene.client, scene.monitor, lambda *_: Continuation(plan, upload=False, first_item=5),
        scene.orders(), plan_return=way_home,
    )  # fmt: skip
    assert outcome.ending is Ending.LANDED
    begun_s = begun[0][0]
    assert longest_stay_s(begun, {1, 2, 3}, begun_s) < 1.0


def test_a_vehicle_that_flies_another_item_whatever_it_is_told_is_held(monkeypatch):
    scene = restarting()
    monkeypatch.setattr(FlightControl, "set_current", lambda *_: CommandResult.ACCEPTED)
    with pytest.raises(
        FlightFailedError, match="flies to item 3 instead of flying to item 5; it was commanded to hold; set"
    ) as failed:
        scene.fly(pause=lambda: 35.0 < (scene.monitor.time_s or 0.0) < 50.0)
    assert failed.value.outcome.ending is Ending.FAILED
    assert not scene.vehicle.armed

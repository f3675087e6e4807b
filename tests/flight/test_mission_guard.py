"""The mission that is flown is the planned one: changes by another station are told at once or within a minute."""

from collections import defaultdict
from dataclasses import replace
from itertools import pairwise

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Mode
from mission_io.errors import TransferError
from mission_io.links.simulated import Conditions
from mission_io.model.items import Command, Mission, MissionType
from tests.flight.scene import ROUTE_ENU_M, Scene, make_scene, mission, plan_for, return_mission
from uavcover.flight.fly import fly
from uavcover.flight.orders import OnBreach, Orders, Precautions
from uavcover.mock.faults import parse_fault
from uavcover.model.track import Ending, EventKind, FlightEvent, FlightFailedError, FlightOutcome

AUTOPILOTS = pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
LISTS = 3
"""Mission, fence and rally points are read back."""
LONG_M = [
    (x, 60.0 + 250.0 * ((i % 4) in (1, 2)), 60.0)
    for i, x in enumerate((0.0, 0.0, 60.0, 60.0, 120.0, 120.0, 180.0, 180.0))
]


def scene_of(autopilot, *faults: str, wanted: Mission | None = None, **options) -> Scene:
    scene = make_scene(autopilot, faults=[parse_fault(fault) for fault in faults], **options)
    scene.upload(mission() if wanted is None else wanted)
    return scene


def failed(scene: Scene, wanted: Mission | None = None, **options) -> tuple[FlightOutcome, str]:
    with pytest.raises(FlightFailedError) as caught:
        scene.fly(wanted, **options)
    return caught.value.outcome, str(caught.value)


def lowered_in_silence(scene: Scene, by_m: float, at_waypoint: int = 1):
    """What puts lower waypoints into the vehicle, of which it says nothing and which it does not fly."""

    def listen(event: FlightEvent) -> None:
        scene.events.append(event)
        if event.waypoint != at_waypoint:
            return
        items = scene.vehicle.mission_items
        scene.vehicle.missions.replace(
            MissionType.MISSION,
            tuple(
                replace(i, alt_m=i.alt_m - by_m) if n and i.command == Command.NAV_WAYPOINT else i
                for n, i in enumerate(items)
            ),
        )

    return listen


@AUTOPILOTS
@pytest.mark.parametrize("loss", [0.0, 0.1])
def test_a_mission_that_another_station_lowers_is_told_at_once(autopilot, loss):
    scene = scene_of(autopilot, "mission-lowered:12.5@20s", conditions=Conditions(loss=loss, delay_s=0.01))
    outcome, text = failed(scene)
    assert outcome.ending is Ending.MISSION_CHANGED
    assert ": 12.50 m lower, the largest of 6 differences" in text
    [changed] = [i for i in outcome.incidents if i.kind is Ending.MISSION_CHANGED]
    changed_s = scene.vehicle.took_off_at_s + 20.0
    assert 0.0 < changed.begin_s - changed_s < (1.5 if loss == 0.0 else 10.0)
    [first, *_] = [e for e in scene.events if e.alarm]
    assert first.text == changed.text


def test_a_change_of_which_nothing_is_said_is_found_within_a_minute():
    wanted = mission(LONG_M)
    scene = scene_of(ARDUPILOT, wanted=wanted)
    outcome, text = failed(scene, wanted, on_event=lowered_in_silence(scene, 25.0))
    assert outcome.ending is Ending.MISSION_CHANGED
    assert " m lower, the largest of 10 differences" in text
    at_s = next(e.time_s for e in scene.events if e.waypoint == 1)
    [changed] = outcome.incidents
    assert changed.begin_s - at_s <= 61.0


@AUTOPILOTS
def test_a_change_of_the_last_minute_is_found_after_the_landing(autopilot):
    scene = scene_of(autopilot)

    def listen(event: FlightEvent) -> None:
        scene.events.append(event)
        if event.text == "on the ground":
            lowered_in_silence(scene, 25.0, at_waypoint=-1)(replace(event, waypoint=-1))

    outcome, text = failed(scene, on_event=listen)
    assert outcome.ending is Ending.MISSION_CHANGED
    assert "m lower" in text


def test_another_mission_id_is_a_sign_of_its_own():
    scene = scene_of(PX4)
    outcome, text = failed(scene, on_event=lowered_in_silence(scene, 3.0))
    assert outcome.ending is Ending.MISSION_CHANGED
    assert ": 3.00 m lower" in text
    at_s = next(e.time_s for e in scene.events if e.waypoint == 1)
    assert outcome.incidents[0].begin_s - at_s < 2.0


@AUTOPILOTS
def test_reading_back_every_minute_costs_no_position_and_no_ending(autopilot):
    wanted = mission(LONG_M)
    scene = scene_of(autopilot, wanted=wanted, conditions=Conditions(delay_s=0.05, jitter_s=0.02))
    requested = count_downloads(scene)
    outcome = scene.fly(wanted)
    assert outcome.ending is Ending.LANDED
    assert outcome.waypoints_reached == len(LONG_M)
    assert outcome.incidents == ()
    assert 3 <= len(requested) <= LISTS * (2 + outcome.duration_s / 60.0)
    steps_s = [b.time_s - a.time_s for a, b in pairwise(scene.samples)]
    assert max(steps_s) <= 0.4


@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.long) for seed in (2, 3))])
def test_a_bad_link_is_asked_patiently(seed):
    """By seed 0 five heartbeats in a row are lost after arming, and the flight rightly does not begin."""
    wanted = mission(LONG_M)
    scene = make_scene(ARDUPILOT, seed=seed, conditions=Conditions(loss=0.25, delay_s=0.1, jitter_s=0.1))
    scene.upload(wanted)
    requested = count_downloads(scene)
    outcome = scene.fly(wanted)
    assert outcome.ending is Ending.LANDED
    assert len(requested) <= LISTS * (2 + outcome.duration_s / 60.0)
    steps_s = [b.time_s - a.time_s for a, b in pairwise(scene.samples)]
    assert max(steps_s) <= 2.0


def test_a_mission_that_cannot_be_read_is_told_once_and_tried_again_ever_later():
    wanted = mission(LONG_M)
    scene = scene_of(ARDUPILOT, wanted=wanted)
    download, tries = scene.client.download, defaultdict(list)

    def refuse(mission_type, **options):
        if scene.vehicle.flying:
            tries[mission_type].append(scene.link.clock.now())
            raise TransferError("busy", vehicle_holds="unchanged")
        return download(mission_type, **options)

    scene.client.download = refuse
    assert scene.fly(wanted).ending is Ending.LANDED
    reported = [t for t in scene.reported(EventKind.WARNING) if "in flight: busy; uavcover keeps trying" in t]
    assert len(reported) == len(set(reported)) == len(tries) == LISTS
    for times_s in tries.values():
        waits_s = [b - a for a, b in pairwise(times_s)]
        assert waits_s == sorted(waits_s)
        assert waits_s[0] >= 5.0
        assert len(times_s) < 8


def test_a_word_for_a_change_that_was_none_is_no_incident():
    scene = scene_of(ARDUPILOT)

    def listen(event: FlightEvent) -> None:
        scene.events.append(event)
        if event.waypoint is not None:
            for _ in range(12):
                scene.vehicle.say(2, "Auto mission changed, restarted command")

    requested = count_downloads(scene)
    outcome = scene.fly(on_event=listen)
    assert (outcome.ending, outcome.incidents) == (Ending.LANDED, ())
    assert 2 <= len(requested) <= 1 + 3 * len(ROUTE_ENU_M)


def test_a_mission_one_step_of_the_wire_off_is_flown():
    scene = make_scene(ARDUPILOT)
    wanted = mission()
    moved = replace(
        wanted, items=tuple(replace(i, lat_deg=i.lat_deg - 1e-7) if i.has_position else i for i in wanted.items)
    )
    scene.upload(moved)
    assert scene.fly(wanted).ending is Ending.LANDED


def count_downloads(scene: Scene) -> list[float]:
    """When the mission is read, as it grows."""
    download, requested = scene.client.download, []

    def noted(mission_type, **options):
        requested.append(scene.link.clock.now())
        return download(mission_type, **options)

    scene.client.download = noted
    return requested


def test_a_vehicle_that_goes_back_to_its_mission_mode_on_the_ground_was_still_taken_over():
    """As PX4 does: after a return of its own it is in mission mode again once it has landed."""
    scene = make_scene(PX4)
    scene.upload(mission())

    def interfere(event: FlightEvent) -> None:
        scene.events.append(event)
        if event.kind is EventKind.WAYPOINT and event.waypoint == 1:
            scene.vehicle.control.set_mode(Mode.RETURN)
        if event.text == "Disarming motors":
            scene.vehicle.control.set_mode(Mode.MISSION)

    with pytest.raises(FlightFailedError) as failed:
        fly(
            scene.client,
            scene.monitor,
            plan_for(mission()),
            Orders(
                on_sample=scene.samples.append, on_event=interfere, precautions=Precautions(on_breach=OnBreach.TELL)
            ),
            plan_return=return_mission,
        )
    outcome = failed.value.outcome
    [taken] = outcome.incidents
    assert (taken.kind, taken.end_s) == (Ending.PILOT_TOOK_OVER, None), "nothing gave the vehicle back"
    assert outcome.ending is Ending.PILOT_TOOK_OVER

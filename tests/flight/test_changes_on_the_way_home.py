"""What was checked before arming is watched on our own way home, too: a second station changes it while that is flown."""

from collections.abc import Callable

import pytest

from mission_io.autopilots.autopilot import PX4
from mission_io.model.items import Frame, MissionType, items_from_fence, land, waypoint
from tests.flight.scene import HOME, Scene, above_home, presses
from tests.flight.test_limits import the_plan
from tests.flight.test_preconditions import BOTH, home_at, scene_of, second_station, square
from uavcover.flight.orders import OnBreach, Precautions
from uavcover.model.track import Ending, EventKind, FlightFailedError, FlightOutcome

STOPS_AT_S = 35.0
Change = Callable[[Scene], None]


def stopped(scene: Scene, change: Change, *, on_breach: OnBreach | None = None) -> tuple[FlightOutcome, str]:
    """The user stops the flight; once our way home is flown, something is changed."""
    begun = False

    def listen(event) -> None:
        nonlocal begun
        scene.events.append(event)
        if event.text.startswith("returning along checked legs") and not begun:
            begun = True
            now = scene.vehicle.powered_s
            go_on = scene.vehicle.control.mission.go_on

            def later(time_s: float) -> None:
                go_on(time_s)
                if scene.vehicle.powered_s > now + 8.0:
                    scene.vehicle.control.mission.go_on = go_on
                    change(scene)

            scene.vehicle.control.mission.go_on = later

    orders = {"precautions": Precautions(on_breach=on_breach), "on_event": listen, "stop": presses(scene, STOPS_AT_S)}
    try:
        return scene.fly(plan=the_plan(), **orders), ""
    except FlightFailedError as error:
        return error.outcome, str(error)


def incident_texts(outcome: FlightOutcome, kind: Ending) -> list[str]:
    return [incident.text for incident in outcome.incidents if incident.kind is kind]


def heights_on_return(scene: Scene) -> list[float]:
    """Above the planned home, far from it, after the climb with which the way home begins."""
    begun = next(e.time_s for e in scene.events if e.text.startswith("returning along checked legs"))
    return [
        s.alt_amsl_m - HOME.alt_amsl_m
        for s in scene.samples
        if begun is not None and s.time_s > begun + 25.0 and abs(s.lat_deg - HOME.lat_deg) > 2e-5
    ]


def set_mission(scene: Scene, *positions: tuple[float, float, float]) -> None:
    """A second station uploads another mission."""
    items = [waypoint(*above_home(position), frame=Frame.ABOVE_HOME) for position in positions]
    items.append(land(*above_home(positions[-1])[:2], 0.0, frame=Frame.ABOVE_HOME))
    if scene.vehicle.autopilot.home_in_item_0:
        items.insert(0, waypoint(HOME.lat_deg, HOME.lon_deg, HOME.alt_amsl_m, frame=Frame.AMSL))
    scene.vehicle.missions.replace(MissionType.MISSION, tuple(items))
    scene.vehicle.control.mission_changed()


@BOTH
def test_an_undisturbed_way_home_has_no_word_of_it(autopilot):
    scene = scene_of(autopilot)
    outcome, _ = stopped(scene, lambda _: None)
    assert (outcome.ending, outcome.incidents) == (Ending.RETURNED, ())
    assert not [text for text in scene.reported(EventKind.WARNING) if "in flight" in text]


@BOTH
def test_home_moved_lower_has_the_way_home_sent_again_with_its_planned_heights(autopilot):
    scene = scene_of(autopilot)
    outcome, _ = stopped(scene, lambda scene: second_station(scene, home_at(up=-25.0)))
    [text] = incident_texts(outcome, Ending.HOME_MOVED)
    since = "immediately" if autopilot is PX4 else "from the next item onwards"
    assert (
        f"moved 25.0 m lower in flight: {since}, the vehicle flies the remaining return 25.0 m lower than planned"
        in text
    )
    assert "its clearance above the ground changes from " in text
    assert "is required" not in text, "the band is that of the route"
    reported = scene.reported(EventKind.STOP)
    assert any("home was moved by -25.0 m: the return is uploaded with corrected heights" in one for one in reported)
    assert outcome.ending is Ending.RETURNED
    over_home = [s.alt_amsl_m for s in scene.samples if abs(s.lat_deg - HOME.lat_deg) < 1e-5 and s.time_s > 60.0]
    assert max(over_home) == pytest.approx(HOME.alt_amsl_m + 30.0, abs=2.0)


@BOTH
def test_home_moved_is_only_an_alarm_where_the_user_says_so(autopilot):
    scene = scene_of(autopilot)
    outcome, text = stopped(scene, lambda scene: second_station(scene, home_at(up=-5.0)), on_breach=OnBreach.TELL)
    assert outcome.ending is Ending.HOME_MOVED
    assert "the vehicle returned, landed and disarmed" in text
    assert scene.reported(EventKind.STOP).count("uploading the return") == 1


def test_home_moved_twice_is_made_up_for_twice():
    scene = scene_of()

    def twice(scene: Scene) -> None:
        second_station(scene, home_at(up=-25.0))
        again = len(scene.events)

        def listen(now: float) -> None:
            go_on(now)
            if any(e.text.startswith("returning") for e in scene.events[again:]):
                scene.vehicle.control.mission.go_on = go_on
                second_station(scene, home_at(up=10.0))

        go_on, scene.vehicle.control.mission.go_on = scene.vehicle.control.mission.go_on, listen

    outcome, _ = stopped(scene, twice)
    assert outcome.ending is Ending.RETURNED
    assert len(incident_texts(outcome, Ending.HOME_MOVED)) == 2
    assert any("home was moved by +10.0 m" in text for text in scene.reported(EventKind.STOP))
    assert max(heights_on_return(scene)) < 62.0


def test_home_moved_aside_does_not_change_our_way_home():
    scene = scene_of()
    outcome, _ = stopped(scene, lambda scene: second_station(scene, home_at(north=60.0)))
    assert outcome.ending is Ending.RETURNED
    assert [text for text in scene.reported(EventKind.WARNING) if "this does not affect the return" in text]
    assert scene.reported(EventKind.STOP).count("uploading the return") == 1
    assert scene.samples[-1].lat_deg == pytest.approx(HOME.lat_deg, abs=1e-5)


@BOTH
def test_another_mission_on_the_way_home_is_replaced_by_a_new_way_home(autopilot):
    scene = scene_of(autopilot)
    outcome, _ = stopped(scene, lambda scene: set_mission(scene, (150.0, -150.0, 30.0), (150.0, -60.0, 30.0)))
    [text] = incident_texts(outcome, Ending.MISSION_CHANGED)
    assert "another station changed the mission" in text
    assert any("planning the return again" in one for one in scene.reported(EventKind.STOP))
    assert outcome.ending is Ending.RETURNED
    assert scene.samples[-1].lat_deg == pytest.approx(HOME.lat_deg, abs=1e-5)


def test_a_station_that_sends_its_mission_again_and_again_ends_in_a_hold():
    scene = scene_of()
    vehicle, sent = scene.vehicle, 0

    def meddle(scene: Scene) -> None:
        go_on = vehicle.control.mission.go_on

        def listen(now: float) -> None:
            nonlocal sent
            go_on(now)
            paths = scene.reported(EventKind.STOP).count("returning along checked legs")
            if paths > sent:
                sent = paths
                set_mission(scene, (150.0, -150.0, 30.0), (150.0, -60.0, 30.0))

        vehicle.control.mission.go_on = listen

    outcome, _ = stopped(scene, meddle)
    assert outcome.ending is Ending.LEFT_HOLDING
    assert "the return was interrupted 3 times, most recently because " in scene.reported(EventKind.STOP)[-1]


@pytest.mark.parametrize(
    ("parameter", "value", "kind", "said"),
    [
        ("MIS_RESTART", 1, None, "MIS_RESTART was changed in flight from 0 to 1"),
        ("FENCE_ALT_MAX", 25, Ending.SETTINGS_CHANGED, "the vehicle would interrupt it"),
        ("FENCE_MARGIN", 3, None, "this does not affect the return"),
    ],
)
def test_a_parameter_that_is_changed_on_the_way_home_is_judged_by_it(parameter, value, kind, said):
    scene = scene_of(RTL_ALT=6000, FENCE_ENABLE=1, FENCE_ACTION=0, FENCE_ALT_MAX=120, FENCE_RADIUS=400)

    def change(scene: Scene) -> None:
        if kind is not None:
            scene.vehicle.parameters.put("FENCE_ACTION", 1)
            scene.vehicle.send(scene.vehicle.parameters.message("FENCE_ACTION"))
            scene.vehicle.parameters.put("FENCE_ACTION", 0)  # it is said to act, and here it does not
        scene.vehicle.parameters.put(parameter, value)
        scene.vehicle.send(scene.vehicle.parameters.message(parameter))

    outcome, text = stopped(scene, change, on_breach=OnBreach.TELL)
    reported = " | ".join(
        [*scene.reported(EventKind.WARNING), text, *(incident.text for incident in outcome.incidents)]
    )
    assert said in reported
    assert outcome.ending is (Ending.RETURNED if kind is None else kind)


def test_a_fence_that_is_made_smaller_on_the_way_home_is_judged_by_it():
    scene = scene_of()
    assert scene.client.upload_and_verify(square(300.0)).passed

    def change(scene: Scene) -> None:
        scene.vehicle.missions.replace(MissionType.FENCE, items_from_fence(square(20.0)))
        scene.monitor.lists_taken[MissionType.FENCE] += 1  # as when another station is thanked for an upload

    outcome, text = stopped(scene, change, on_breach=OnBreach.TELL)
    assert outcome.ending is Ending.FENCE_CHANGED
    assert "the remaining return leads " in text


def test_a_hold_on_the_way_home_ends_with_the_way_home():
    scene = scene_of()
    assert scene.client.upload_and_verify(square(300.0)).passed

    def change(scene: Scene) -> None:
        scene.vehicle.missions.replace(MissionType.FENCE, items_from_fence(square(20.0)))
        scene.monitor.lists_taken[MissionType.FENCE] += 1

    outcome, text = stopped(scene, change, on_breach=OnBreach.HOLD)
    reported = scene.reported(EventKind.STOP)
    assert any(
        "then uavcover plans the return again: press Ctrl-C to keep the vehicle holding" in one for one in reported
    )
    assert any("planning the return again: another station changed the vehicle's fence" in one for one in reported)
    assert not scene.vehicle.armed
    assert outcome.ending is Ending.RETURNED, text
    [changed] = [incident for incident in outcome.incidents if incident.kind is Ending.FENCE_CHANGED]
    assert changed.end_s is None, "it is still changed"

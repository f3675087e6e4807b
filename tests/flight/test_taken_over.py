"""Whatever has the vehicle keeps it, at every stage, and the record goes on; what cannot be known is said."""

import numpy as np
import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Mode
from mission_io.model.enums import CommandResult
from mission_io.model.items import Command
from mission_io.wire import messages as m
from tests.flight.scene import FRAME, Scene, geodetic, make_scene, mission, plan_for, presses, return_mission
from tests.flight.test_blackouts import BAND, Witness, dark_scene
from uavcover.flight import follower
from uavcover.flight.monitor import Monitor
from uavcover.flight.orders import FlightTimeouts, OnBreach, OperatingVolume, Precautions
from uavcover.flight.progress import MissionProgress
from uavcover.flight.session import Session
from uavcover.mock.dynamics import BatteryData
from uavcover.mock.flight_control import FlightControl
from uavcover.model.track import Ending, EventKind, FlightEvent, FlightFailedError

AUTOPILOTS = pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)


def scene_and_witness(autopilot=ARDUPILOT) -> tuple[Scene, Witness]:
    scene = make_scene(autopilot, battery=BatteryData(endurance_s=900.0))
    witness = Witness(scene)
    scene.upload(mission())
    return scene, witness


def flown(scene: Scene, **options):
    options.setdefault("precautions", Precautions(on_breach=OnBreach.HOLD))
    options.setdefault("timeouts", FlightTimeouts(link_lost_s=90.0))
    options.setdefault("plan", plan_for(mission(), volume=BAND))
    try:
        return scene.fly(**options), ""
    except FlightFailedError as error:
        return error.outcome, str(error)


def taken_at_once(scene: Scene, mode: Mode = Mode.RETURN) -> None:
    """A failsafe or a pilot takes the vehicle, and that is heard."""
    scene.vehicle.control.set_mode(mode)
    until_s = scene.client.clock.now() + 2.5
    while scene.client.clock.now() < until_s:
        scene.client.poll(0.1)


def lose(monkeypatch, scene: Scene, kind: type[m.Message], *, while_s: tuple[float, float]) -> None:
    """Lose all messages of one kind for some seconds of the vehicle's time."""
    hear = Monitor.__call__

    def hear_less(monitor: Monitor, received: m.Received, now: float) -> None:
        if not (isinstance(received.message, kind) and while_s[0] <= scene.vehicle.powered_s <= while_s[1]):
            hear(monitor, received, now)

    monkeypatch.setattr(Monitor, "__call__", hear_less)


def at_waypoint(scene: Scene, number: int, act) -> object:
    done: list[float] = []

    def listen(event: FlightEvent) -> None:
        scene.events.append(event)
        if event.kind is EventKind.WAYPOINT and event.waypoint == number and not done:
            done.append(scene.vehicle.powered_s)
            act()

    return listen


@AUTOPILOTS
def test_a_vehicle_that_is_heard_and_not_known_is_an_alarm_that_says_what_is_missing(autopilot, monkeypatch):
    scene, _ = scene_and_witness(autopilot)
    lose(monkeypatch, scene, m.ExtendedSysState, while_s=(25.0, 60.0))
    outcome, text = flown(scene, on_event=at_waypoint(scene, 1, lambda: scene.link.go_dark(2.5)))
    unknown = [i for i in outcome.incidents if i.kind is Ending.STATE_UNKNOWN]
    assert len(unknown) == 1, text
    assert "waiting for EXTENDED_SYS_STATE before sending any command" in unknown[0].text
    assert unknown[0].end_s is not None
    assert outcome.ending is Ending.LANDED, text
    assert sum("state is known again" in reported for reported in scene.reported(EventKind.WARNING)) == 1


def test_a_command_for_a_vehicle_that_stays_unknown_is_withheld_and_following_goes_on(monkeypatch):
    scene, witness = scene_and_witness()
    lose(monkeypatch, scene, m.ExtendedSysState, while_s=(25.0, 300.0))
    outcome, text = flown(
        scene,
        on_event=at_waypoint(scene, 1, lambda: scene.link.go_dark(2.5)),
        stop=presses(scene, 45.0, 60.0),
        timeouts=FlightTimeouts(),
    )
    assert outcome.ending is Ending.STATE_UNKNOWN, text
    assert [row for row in witness.steered if row[0] > 40.0] == []


@AUTOPILOTS
def test_a_failsafe_at_the_end_of_a_hold_ends_no_record(autopilot, monkeypatch):
    scene, witness = scene_and_witness(autopilot)
    goes_on = follower.continue_mission

    def late(session) -> None:
        taken_at_once(scene)
        goes_on(session)

    monkeypatch.setattr(follower, "continue_mission", late)
    outside = OperatingVolume(
        ground_up_m=BAND.ground_up_m, outside_fence_m=lambda _e, _n: 5.0 if 30.0 < scene.vehicle.powered_s < 33.0 else 0.0,
        min_height_agl_m=45.0, max_height_agl_m=80.0,
    )  # fmt: skip
    outcome, text = flown(scene, plan=plan_for(mission(), volume=outside))
    assert not scene.vehicle.armed, text
    assert outcome.ending in (Ending.PILOT_TOOK_OVER, Ending.TAKEN_OVER, Ending.FENCE_BREACHED)
    assert witness.against == []


@AUTOPILOTS
def test_a_failsafe_while_the_way_home_is_planned_keeps_the_vehicle_and_the_record(autopilot):
    scene, witness = scene_and_witness(autopilot)

    def plan_return(*position: float):
        taken_at_once(scene)
        return return_mission(*position)

    outcome, text = flown(scene, stop=presses(scene, 35.0), plan_return=plan_return)
    assert witness.against == []
    assert not scene.vehicle.armed, text
    assert outcome.ending is Ending.PILOT_TOOK_OVER
    assert "the vehicle landed and disarmed" in text


def test_a_pilot_between_arming_and_the_mission_keeps_the_vehicle():
    scene, witness = scene_and_witness()

    def listen(event: FlightEvent) -> None:
        scene.events.append(event)
        if event.text == "armed":
            witness.steered.clear()
            taken_at_once(scene, Mode.MANUAL)

    outcome, text = flown(scene, on_event=listen, stop=presses(scene, 60.0, 70.0))
    assert [row for row in witness.steered if row[1] in (Command.DO_SET_MODE, Command.MISSION_START)] == [], text
    assert outcome.ending in (Ending.PILOT_TOOK_OVER, Ending.ENDED_EARLY)


@AUTOPILOTS
def test_the_incident_of_a_link_failsafe_lasts_when_the_link_is_back(autopilot):
    scene, _ = dark_scene(autopilot, battery=BatteryData(endurance_s=900.0))
    outcome, text = flown(scene, on_event=at_waypoint(scene, 1, lambda: scene.link.go_dark(25.0)))
    assert outcome.ending is Ending.LINK_LOST
    silent, taken = [i for i in outcome.incidents if i.kind is Ending.LINK_LOST]
    assert silent.end_s is not None
    assert taken.end_s is None
    assert "the link was silent for" in taken.text
    assert taken.evidence
    assert "changed to return mode" in text
    assert sum("receiving messages from" in reported for reported in scene.reported(EventKind.WARNING)) == 1


@AUTOPILOTS
def test_a_mode_that_changed_in_a_short_gap_is_nobodys_by_proof(autopilot):
    scene, witness = scene_and_witness(autopilot)

    def taken() -> None:
        scene.link.go_dark(3.2)
        scene.vehicle.control.set_mode(Mode.LAND)

    outcome, _ = flown(scene, on_event=at_waypoint(scene, 1, taken))
    assert outcome.ending is Ending.TAKEN_OVER
    assert witness.against == []


def test_a_flight_that_ended_in_the_dark_says_that_it_is_not_known_how():
    scene, _ = dark_scene(PX4, battery=BatteryData(endurance_s=900.0))

    def pause() -> bool:
        if not scene.vehicle.armed and scene.vehicle.powered_s > 60.0:
            scene.vehicle.control.set_mode(Mode.MISSION)  # as PX4 is after a landing by its own
        return False

    outcome, text = flown(scene, on_event=at_waypoint(scene, 0, lambda: scene.link.go_dark(80.0)), pause=pause)
    assert outcome.ending is Ending.ENDED_EARLY
    assert "events during the preceding 80 s without messages are unknown" in text


def test_a_pause_of_this_process_alone_is_no_lost_link():
    scene, _ = scene_and_witness()
    paused: list[float] = []

    def listen(event: FlightEvent) -> None:
        scene.events.append(event)
        if event.kind is EventKind.TEXT and scene.vehicle.powered_s > 30.0 and scene.vehicle.armed and not paused:
            paused.append(scene.vehicle.powered_s)
            scene.link.clock.advance_to(scene.link.clock.now() + 40.0)

    outcome, text = flown(scene, on_event=listen, timeouts=FlightTimeouts())
    assert paused
    assert outcome.ending is Ending.LANDED, text


def test_a_pause_that_is_refused_ends_no_flight(monkeypatch):
    scene, _ = scene_and_witness()
    original = FlightControl.set_mode

    def refuses_guided_in_the_air(control, mode, **options):
        in_air = mode is Mode.GUIDED and not control.state.body.on_ground
        return CommandResult.DENIED if in_air else original(control, mode, **options)

    monkeypatch.setattr(FlightControl, "set_mode", refuses_guided_in_the_air)
    outcome, text = flown(scene, pause=lambda: (scene.monitor.time_s or 0.0) > 35.0)
    assert outcome.ending is Ending.LANDED, text
    assert sum("refused the command to hold" in reported for reported in scene.reported(EventKind.WARNING)) == 1


def test_a_vehicle_that_does_not_come_to_rest_is_flown_home_all_the_same():
    scene, _ = scene_and_witness()
    outcome, text = flown(scene, stop=presses(scene, 35.0), timeouts=FlightTimeouts(halt_s=0.5))
    assert outcome.ending is Ending.RETURNED, text
    assert not scene.vehicle.armed


@AUTOPILOTS
def test_a_vehicle_that_a_failsafe_landed_is_not_told_to_disarm(autopilot, monkeypatch):
    scene, witness = scene_and_witness(autopilot)
    monkeypatch.setattr(FlightControl, "disarm", lambda *_, **__: CommandResult.DENIED)

    def land() -> None:
        witness.steered.clear()
        scene.vehicle.say(4, "Fence Breached")
        scene.vehicle.control.set_mode(Mode.LAND)

    outcome, text = flown(scene, on_event=at_waypoint(scene, 1, land))
    assert witness.steered == []
    assert outcome.ending is Ending.FENCE_BREACHED
    assert "on the ground and still armed; the pilot or station that controls it" in text


def test_a_pilot_on_the_ground_after_the_start_is_no_failed_start(monkeypatch):
    scene, witness = scene_and_witness()

    def start(control: FlightControl) -> CommandResult:
        control.set_mode(Mode.MANUAL)
        return CommandResult.ACCEPTED

    monkeypatch.setattr(FlightControl, "start_mission", start)
    monkeypatch.setattr(FlightControl, "disarm", lambda *_, **__: CommandResult.DENIED)
    outcome, text = flown(scene)
    assert outcome.ending is Ending.PILOT_TOOK_OVER, text
    assert [row for row in witness.steered if row[2] is Mode.MANUAL and row[0] > 12.0] == []


@AUTOPILOTS
def test_a_stop_that_the_vehicle_does_not_hear_ends_no_record(autopilot):
    """Only the way to the vehicle is lost: what it does is heard, and it flies its mission to the end."""
    scene, _ = scene_and_witness(autopilot)
    send, lost_from_s = scene.link.send, 34.0
    scene.link.send = lambda data: None if scene.vehicle.powered_s > lost_from_s else send(data)
    outcome, text = flown(scene, stop=presses(scene, 35.0), timeouts=FlightTimeouts())
    assert not scene.vehicle.armed, text
    assert outcome.ending is Ending.FAILED
    assert "uavcover followed the vehicle until it landed and disarmed" in text
    assert any("uavcover still records the flight" in reported for reported in scene.reported(EventKind.WARNING))


@AUTOPILOTS
def test_a_vehicle_that_a_pilot_gives_back_in_its_hold_holds_its_new_place(autopilot):
    scene, _ = scene_and_witness(autopilot)
    holds = Mode.HOLD if autopilot is PX4 else Mode.GUIDED
    done: set[str] = set()

    def pause() -> bool:
        now = scene.vehicle.powered_s
        if now > 50.0 and "taken" not in done:
            done.add("taken")
            scene.vehicle.control.set_mode(Mode.MANUAL)
        if now > 60.0 and "given" not in done:
            done.add("given")
            x, y, z = scene.vehicle.body.point.position_m
            scene.vehicle.body.point.position_m = (x + 40.0, y, z)
            scene.vehicle.body.believed.step()
            scene.vehicle.control.set_mode(holds)
        return 32.0 < now < 85.0

    outcome, text = flown(scene, pause=pause)
    kinds = [i.kind for i in outcome.incidents]
    assert Ending.PILOT_TOOK_OVER in kinds
    assert Ending.HOLD_LOST not in kinds
    assert outcome.ending is Ending.LANDED, text


def test_a_vehicle_that_is_switched_off_after_a_landing_in_a_gap_is_no_lost_link():
    scene, _ = scene_and_witness()
    done: list[float] = []
    receive = scene.link.receive

    def until_it_is_off(timeout_s: float) -> bytes | None:
        if not done and scene.vehicle.body.on_ground and scene.vehicle.powered_s > 60.0:
            done.append(scene.vehicle.powered_s)
            scene.link.go_dark(4.0)
        if done and not scene.client.vehicle.armed:
            scene.link.go_dark(1000.0)
        return receive(timeout_s)

    scene.link.receive = until_it_is_off  # type: ignore[method-assign]
    outcome, text = flown(scene, timeouts=FlightTimeouts())
    assert done
    assert outcome.ending is Ending.LANDED, text


def test_px4_climbs_first_when_its_mission_is_continued_and_that_is_judged(monkeypatch):
    """Flown by PX4 1.17 (its mission mode climbs to the next item's height before it flies there): 102 m above the band."""
    scene, _ = scene_and_witness(PX4)
    ground = BAND.ground_up_m(0.0, 0.0)
    east_of = 30.0  # the ground falls away where the vehicle is held, and the band is kept along the planned leg alone
    around = OperatingVolume(
        ground_up_m=lambda east, _n: ground - 20.0 if east < east_of else ground, outside_fence_m=lambda _e, _n: 0.0,
        min_height_agl_m=30.0, max_height_agl_m=85.0,
    )  # fmt: skip
    session = Session(
        scene.client, scene.monitor, timeouts=FlightTimeouts(), on_event=scene.events.append, stop=lambda: 0
    )
    progress = MissionProgress(session, plan_for(mission(), volume=around))
    monkeypatch.setattr(MissionProgress, "position_m", np.array([*FRAME.enu_from_geodetic(*_point())[0]]))
    monkeypatch.setattr(MissionProgress, "_index", 4)
    progress.heading_for = 1
    assert "climbs in place before it flies to waypoint 1: up to 90 m" in (progress.line_problem() or "")


def _point() -> tuple[float, float, float]:
    position = geodetic((0.0, 60.0, 60.0))
    return position.lat_deg, position.lon_deg, position.alt_amsl_m

"""After a dark link, a process that stood still or late datagrams nothing is commanded before the mode is known."""

from collections.abc import Callable

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Mode
from mission_io.links.simulated import Conditions
from mission_io.model.items import Command
from mission_io.wire import messages as m
from mission_io.wire.codec import Codec
from tests.flight.scene import FRAME, HOME, Scene, make_scene, mission, plan_for
from uavcover.flight.orders import FlightTimeouts, OnBreach, OperatingVolume, Precautions
from uavcover.mock.dynamics import BatteryData
from uavcover.model.track import Ending, EventKind, FlightEvent, FlightFailedError

AUTOPILOTS = pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
HOME_UP_M = float(FRAME.enu_from_geodetic(HOME.lat_deg, HOME.lon_deg, HOME.alt_amsl_m)[0][2])
BAND = OperatingVolume(
    ground_up_m=lambda _e, _n: HOME_UP_M,
    outside_fence_m=lambda _e, _n: 0.0,
    min_height_agl_m=45.0,
    max_height_agl_m=80.0,
)
STEERING = frozenset(
    {Command.DO_SET_MODE, Command.MISSION_START, Command.DO_SET_MISSION_CURRENT, Command.COMPONENT_ARM_DISARM}
)


class Witness:
    """Reads every datagram of ours, and notes the commands that steer, with the vehicle's true mode at that moment."""

    def __init__(self, scene: Scene) -> None:
        self._scene, self._codec = scene, Codec(system_id=1, component_id=1)
        self.steered: list[tuple[float, int, Mode]] = []
        self._send = scene.link.send
        scene.link.send = self._listen  # type: ignore[method-assign]

    def _listen(self, data: bytes) -> None:
        self._read(data)
        self._send(data)

    def _read(self, data: bytes) -> None:
        for received in self._codec.decode(data):
            message = received.message
            command = message.command if isinstance(message, m.CommandLong) else None
            if isinstance(message, m.MissionSetCurrent | m.SetMode | m.MissionCount | m.MissionItemInt):
                command = -1
            if command in STEERING or command == -1:
                self.steered.append((self._scene.vehicle.powered_s, command or -1, self._scene.vehicle.mode))

    @property
    def against(self) -> list[tuple[float, int, Mode]]:
        """The commands that were sent while a failsafe had the vehicle."""
        return [row for row in self.steered if row[2] in (Mode.RETURN, Mode.LAND)]


def dark_scene(autopilot, **options) -> tuple[Scene, Witness]:
    scene = make_scene(autopilot, **options)
    witness = Witness(scene)
    name, timeout = ("FS_GCS_ENABLE", None) if autopilot is ARDUPILOT else ("NAV_DLL_ACT", "COM_DL_LOSS_T")
    scene.vehicle.parameters.put(name, 1.0 if autopilot is ARDUPILOT else 2.0)
    if timeout:
        scene.vehicle.parameters.put(timeout, 5.0)
    scene.upload(mission())
    return scene, witness


def fly_with(
    scene: Scene, disturb: Callable[[], None], *, at_waypoint: int, on_breach: OnBreach = OnBreach.HOLD, **options
):
    done: list[float] = []

    def listen(event: FlightEvent) -> None:
        scene.events.append(event)
        if event.kind is EventKind.WAYPOINT and event.waypoint == at_waypoint and not done:
            done.append(event.time_s or 0.0)
            disturb()

    try:
        return scene.fly(
            plan=plan_for(mission(), volume=BAND),
            on_event=listen,
            timeouts=FlightTimeouts(link_lost_s=90.0),
            precautions=Precautions(on_breach=on_breach),
            **options,
        ), ""
    except FlightFailedError as error:
        return error.outcome, str(error)


@AUTOPILOTS
@pytest.mark.parametrize("seconds", [5.0, 12.0, 25.0, 60.0])
@pytest.mark.parametrize("at_waypoint", [0, 1, 3])
@pytest.mark.parametrize("on_breach", [OnBreach.HOLD, OnBreach.RETURN])
def test_a_failsafe_return_is_never_interrupted_after_a_blackout(autopilot, seconds, at_waypoint, on_breach):
    scene, witness = dark_scene(autopilot, battery=BatteryData(endurance_s=900.0))
    outcome, text = fly_with(scene, lambda: scene.link.go_dark(seconds), at_waypoint=at_waypoint, on_breach=on_breach)
    assert witness.against == []
    assert outcome.ending in (Ending.LINK_LOST, Ending.LANDED), text
    assert not scene.vehicle.armed
    if seconds > 12.0:
        assert outcome.ending is Ending.LINK_LOST


@AUTOPILOTS
@pytest.mark.parametrize("seconds", [5.0, 20.0, 60.0])
def test_a_process_that_stood_still_believes_no_old_datagram(autopilot, seconds):
    scene, witness = dark_scene(autopilot, battery=BatteryData(endurance_s=900.0))
    outcome, text = fly_with(scene, lambda: scene.link.stand_still(seconds), at_waypoint=1)
    assert witness.against == []
    assert outcome.ending in (Ending.LINK_LOST, Ending.LANDED), text


@AUTOPILOTS
@pytest.mark.parametrize("seed", range(3))
def test_late_and_reordered_datagrams_after_a_blackout(autopilot, seed):
    scene, witness = dark_scene(
        autopilot, seed=seed, conditions=Conditions(delay_s=0.1, jitter_s=0.8, loss=0.05, duplication=0.1),
        battery=BatteryData(endurance_s=900.0),
    )  # fmt: skip
    outcome, text = fly_with(scene, lambda: scene.link.go_dark(25.0), at_waypoint=1)
    assert witness.against == []
    assert outcome.ending is Ending.LINK_LOST, text


@AUTOPILOTS
def test_a_pilot_who_took_over_in_the_dark_keeps_the_vehicle(autopilot):
    scene, witness = dark_scene(autopilot, battery=BatteryData(endurance_s=900.0))
    scene.vehicle.parameters.put("FS_GCS_ENABLE" if autopilot is ARDUPILOT else "NAV_DLL_ACT", 0.0)

    def take_over() -> None:
        scene.link.go_dark(10.0)
        scene.vehicle.control.set_mode(Mode.LAND)

    outcome, _ = fly_with(scene, take_over, at_waypoint=1)
    assert witness.against == []
    assert outcome.ending in (Ending.LINK_LOST, Ending.TAKEN_OVER, Ending.PILOT_TOOK_OVER)


@AUTOPILOTS
def test_a_return_because_the_vehicle_hears_nothing_of_us_is_a_lost_link_and_no_pilot(autopilot):
    """We hear the vehicle all the time; it says nothing of a failsafe, as PX4 in flight."""
    scene, witness = dark_scene(autopilot, battery=BatteryData(endurance_s=900.0))
    name = "FS_GCS_TIMEOUT" if autopilot is ARDUPILOT else "COM_DL_LOSS_T"
    scene.vehicle.parameters.put(name, 25.0)
    scene.vehicle.say = lambda _severity, _text: None  # type: ignore[method-assign]
    send = scene.link.send

    def cut() -> None:
        scene.link.send = lambda data: None if witness.steered else send(data)  # type: ignore[method-assign]

    outcome, text = fly_with(scene, cut, at_waypoint=0)
    assert outcome.ending is Ending.LINK_LOST, text
    assert "did not answer" in text
    assert not scene.vehicle.armed


@AUTOPILOTS
@pytest.mark.parametrize(
    ("late_s", "stopped_after_s"),
    [(3.0, 5.0), *((late_s, after_s) for late_s in (6.0, 12.0, 30.0) for after_s in (0.0, 1.0, 4.0, 9.0))],
)
def test_a_link_that_falls_behind_without_a_gap_hides_no_return(autopilot, late_s, stopped_after_s):
    """Something is heard all the time, and all of it is old: the vehicle returns, and the user stops the flight."""
    scene, witness = dark_scene(autopilot, battery=BatteryData(endurance_s=900.0))
    began_s: list[float] = []
    returned_s: list[float] = []

    def fall_behind() -> None:
        scene.link.fall_behind(by_s=late_s, over_s=1.5 * late_s, until_s=4.0 * late_s)
        began_s.append(scene.link.clock.now())

    def stop() -> int:
        now = scene.link.clock.now()
        if began_s and not returned_s and now > began_s[0] + 2.0 * late_s:
            scene.vehicle.control.set_mode(Mode.RETURN)
            returned_s.append(now)
        return int(bool(returned_s) and now >= returned_s[0] + stopped_after_s)

    outcome, text = fly_with(scene, fall_behind, at_waypoint=0, stop=stop)
    assert returned_s
    assert witness.against == []
    assert outcome.ending in (Ending.TAKEN_OVER, Ending.PILOT_TOOK_OVER, Ending.LANDED), text

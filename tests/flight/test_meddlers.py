"""A companion computer that speaks with the vehicle's system id decides nothing, whatever it says."""

import random
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4
from mission_io.model.enums import LandedState
from mission_io.wire import messages as m
from mission_io.wire.codec import Codec
from sitl_tests.meddler import LIES, Lie, Meddler
from tests.flight.scene import HOME, Scene, make_scene, mission, presses
from uavcover.flight.monitor import Monitor
from uavcover.flight.orders import FlightTimeouts
from uavcover.mock.flight_control import FlightControl
from uavcover.mock.server import InMemoryPeer
from uavcover.mock.vehicle import MockVehicle
from uavcover.model.track import Ending, EventKind, FlightFailedError


class MeddledPeer(InMemoryPeer):
    """A vehicle with a companion on the same link."""

    def __init__(self, vehicle: MockVehicle, lies: list[Lie], *, speed: float) -> None:
        super().__init__(vehicle, speed=speed)
        self._meddler = Meddler(lies=lies)

    def datagrams_to_send(self, now: float) -> list[bytes]:
        return [*super().datagrams_to_send(now), *self._meddler.datagrams(now)]


def meddled(autopilot, lies: list[Lie]) -> Scene:
    scene = make_scene(autopilot, make_peer=lambda vehicle, speed: MeddledPeer(vehicle, lies, speed=speed))
    scene.upload(mission())
    return scene


@pytest.mark.parametrize("lie", LIES)
def test_a_companions_word_changes_nothing_of_a_flight(lie, monkeypatch):
    sent: list[int] = []
    original = FlightControl.disarm

    def disarm(control, **how):
        sent.append(control.state.armed and not control.state.body.on_ground)
        return original(control, **how)

    monkeypatch.setattr(FlightControl, "disarm", disarm)
    autopilot = PX4 if sum(map(ord, lie)) % 2 else ARDUPILOT
    scene = meddled(autopilot, [LIES[lie]])
    outcome = scene.fly()
    assert outcome.ending is Ending.LANDED
    assert outcome.waypoints_reached == 4
    assert outcome.incidents == ()
    assert scene.vehicle.body.on_ground
    assert not any(sent), "never told to disarm in the air"
    times = [sample.time_s for sample in scene.samples]
    assert max(b - a for a, b in pairwise(times)) <= 0.25
    east_north = [(s.east_m, s.north_m) for s in scene.samples]
    assert max(abs(v) for position in east_north for v in position) < 1000.0
    assert max(abs(s.roll_deg) + abs(s.pitch_deg) for s in scene.samples) < 60.0
    assert not scene.reported(EventKind.WARNING)


@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
def test_all_of_it_at_once_and_ctrl_c_still_comes_home(autopilot):
    scene = meddled(autopilot, list(LIES.values()))
    outcome = scene.fly(stop=presses(scene, 35.0))
    assert outcome.ending is Ending.RETURNED
    assert not scene.vehicle.body.crashed


def test_what_a_companion_says_to_the_pilot_is_shown_with_its_component():
    scene = meddled(ARDUPILOT, [lambda _: m.StatusText(2, "Crash: of the video process")])
    assert scene.fly().ending is Ending.LANDED
    assert "component 191: Crash: of the video process" in scene.reported(EventKind.TEXT)


class StutteringPeer(InMemoryPeer):
    """The autopilot itself sends a message with a wrong stamp, or a wrong landed state, now and then."""

    def __init__(self, vehicle: MockVehicle, lies: list[Lie], *, speed: float) -> None:
        super().__init__(vehicle, speed=speed)
        self._lies, self._rng, self._next_s = lies, random.Random(3), 12.0

    def datagrams_to_send(self, now: float) -> list[bytes]:
        datagrams = super().datagrams_to_send(now)
        if now >= self._next_s and self.vehicle.flying:
            self._next_s = now + self._rng.uniform(0.7, 3.0)
            datagrams.append(self._codec.encode(self._rng.choice(self._lies)(self._rng)))
        return datagrams


@pytest.mark.thinned
@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
@pytest.mark.parametrize(
    "lie",
    [
        lambda rng: m.SystemTime(0.0, rng.choice([0.0, 4294967.0, rng.uniform(0.0, 1e4)])),
        lambda rng: m.Attitude(rng.choice([0.0, 4294967.0, rng.uniform(0.0, 1e4)]), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        lambda _: m.ExtendedSysState(int(LandedState.ON_GROUND)),
    ],
    ids=["system-time", "attitude", "on-ground"],
)
def test_one_wrong_message_of_the_autopilot_itself_ends_no_flight_and_no_record(autopilot, lie):
    scene = make_scene(autopilot, make_peer=lambda vehicle, speed: StutteringPeer(vehicle, [lie], speed=speed))
    scene.upload(mission())
    outcome = scene.fly()
    assert outcome.ending is Ending.LANDED
    assert outcome.waypoints_reached == 4
    times = [sample.time_s for sample in scene.samples]
    assert max(b - a for a, b in pairwise(times)) <= 0.25


@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
def test_ctrl_c_while_the_autopilot_says_on_ground_in_the_air_disarms_nothing(autopilot, monkeypatch):
    reported: list[bool] = []
    original = FlightControl.disarm

    def disarm(control, **how):
        reported.append(control.state.body.on_ground)
        return original(control, **how)

    monkeypatch.setattr(FlightControl, "disarm", disarm)
    scene = make_scene(autopilot, make_peer=lambda v, speed: StutteringPeer(v, [LIES["on-ground"]], speed=speed))
    scene.upload(mission())
    monkeypatch.setattr(type(scene.vehicle.body), "landed_state", LandedState.ON_GROUND)
    outcome = scene.fly(stop=presses(scene, 35.0))
    assert outcome.ending in (Ending.RETURNED, Ending.LEFT_HOLDING)
    assert reported == [] or all(reported)


class Namesake(InMemoryPeer):
    """A vehicle, and messages of another one with its system ID."""

    def __init__(self, vehicle: MockVehicle, words: Callable[[float], list[m.Message]], *, speed: float) -> None:
        super().__init__(vehicle, speed=speed)
        self._words, self._codec = words, Codec(system_id=1, component_id=1)

    def datagrams_to_send(self, now: float) -> list[bytes]:
        return [*super().datagrams_to_send(now), *map(self._codec.encode, self._words(now))]


def beside_a_namesake(words: Callable[[float], list[m.Message]]) -> Scene:
    scene = make_scene(ARDUPILOT, make_peer=lambda vehicle, speed: Namesake(vehicle, words, speed=speed))
    scene.upload(mission())
    return scene


def test_one_disarmed_heartbeat_of_another_vehicle_ends_no_flight():
    """It was 'disarmed in the air', and the flight was no longer followed."""
    beats = [m.Heartbeat(3, 2)]
    scene = beside_a_namesake(lambda now: [beats.pop()] if beats and now > 40.0 else [])
    assert scene.fly().ending is Ending.LANDED
    assert not beats


def test_two_clocks_under_one_system_id_are_told():
    sent = [0.0]

    def later(now: float) -> list[m.Message]:
        if now - sent[-1] < 0.05:
            return []
        sent.append(now)
        return [m.GlobalPositionInt(500.0 + now, HOME.lat_deg, HOME.lon_deg, HOME.alt_amsl_m, 0.0, 0.0, 0.0, 0.0, None)]

    with pytest.raises(FlightFailedError, match=r"position messages with agreeing times \(two vehicles may share"):
        beside_a_namesake(later).fly(timeouts=FlightTimeouts(ready_s=15.0))


def test_latitude_and_longitude_0_are_no_position():
    """They were recorded, and a return was planned from there."""
    monitor = Monitor()
    monitor.listen_to(m.Address(1, 1))
    for now in np.arange(9.0, 10.0, 0.1).tolist():
        nowhere = m.GlobalPositionInt(now, 0.0, 0.0, 312.5, 0.0, 0.0, 0.0, 0.0, None)
        monitor(m.Received(nowhere, 1, 1), now)
    assert monitor.time_s == pytest.approx(9.9)
    assert monitor.latest(m.GlobalPositionInt) is None

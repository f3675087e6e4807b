"""A companion computer that speaks with the vehicle's system id decides nothing, whatever it says."""

import random
from collections.abc import Callable
from itertools import pairwise

import pytest

from mission_io import messages as m
from mission_io.autopilots import ARDUPILOT, PX4
from mission_io.codec import Codec
from mission_io.enums import LandedState, MissionState
from mission_io.items import Command
from tests.flight.scene import Scene, make_scene, mission, presses
from uavcover.flight.events import EventKind
from uavcover.flight.mock.peer import InMemoryPeer
from uavcover.flight.mock.vehicle import MockVehicle
from uavcover.flight.outcome import Ending

COMPANION = 191
Lie = Callable[[random.Random], m.Message]


def _anywhere(rng: random.Random) -> m.Message:
    height_m = rng.uniform(-50.0, 500.0)
    return m.GlobalPositionInt(
        rng.choice([0.0, rng.uniform(0.0, 5000.0)]), rng.uniform(-60.0, 60.0), rng.uniform(-170.0, 170.0),
        300.0 + height_m, height_m, *(rng.uniform(-30.0, 30.0) for _ in range(3)), 90.0,
    )  # fmt: skip


LIES: dict[str, Lie] = {
    "system-time-0": lambda _: m.SystemTime(1.7e9, 0.0),
    "system-time-huge": lambda _: m.SystemTime(0.0, 4294967.0),
    "on-ground": lambda _: m.ExtendedSysState(int(LandedState.ON_GROUND)),
    "landed-state": lambda rng: m.ExtendedSysState(rng.choice([int(s) for s in LandedState])),
    "attitude": lambda rng: m.Attitude(0.0, *(rng.uniform(-3.0, 3.0) for _ in range(3)), 0.0, 0.0, 0.0),
    "position": _anywhere,
    "mission-current": lambda rng: m.MissionCurrent(rng.randrange(40), rng.randrange(40), rng.choice([*MissionState])),
    "mission-complete": lambda _: m.MissionCurrent(99, 3, MissionState.COMPLETE),
    "item-reached": lambda rng: m.MissionItemReached(rng.randrange(40)),
    "onboard-controller": lambda _: m.Heartbeat(8, 18, 128, 9, 5),
    "quadrotor-without-autopilot": lambda rng: m.Heartbeat(8, 2, 0, rng.randrange(30), 3),
    "autopilot": lambda rng: m.Heartbeat(rng.choice([3, 12]), rng.choice([1, 2]), 0, rng.randrange(30), 3),
    "sys-status": lambda _: m.SysStatus(0, 0, 0, 1.0, 3.1, 99.0, 1),
    "battery": lambda _: m.BatteryStatus(0, (3.1, *(None,) * 9), 99.0, 9000, 0, 1, 3),
    "gps": lambda _: m.GpsRawInt(0.0, 0, 1.0, 2.0, 3.0, 99.0, 99.0, 0.0, None, 0),
    "ekf": lambda _: m.EkfStatusReport(0x80),
    "text": lambda rng: m.StatusText(
        2, rng.choice(["Crash: Disarming", "Battery failsafe", "Fence breached", "GPS lost"])
    ),
    "mission-ack": lambda rng: m.MissionAck(255, 190, rng.randrange(16), rng.randrange(3)),
    "command-ack": lambda rng: m.CommandAck(
        rng.choice([*Command]), rng.randrange(7), target_system=255, target_component=190
    ),
    "home": lambda _: m.HomePosition(1.0, 2.0, 3.0),
    "version": lambda _: m.AutopilotVersion(0, 0, 0),
    "parameter": lambda _: m.ParamValue("SIM_SPEEDUP", 1.0, 9, 1, 0),
    "mission-count": lambda rng: m.MissionCount(255, 190, rng.randrange(9)),
    "mission-request": lambda rng: m.MissionRequestInt(255, 190, rng.randrange(20)),
}


class MeddledPeer(InMemoryPeer):
    """A vehicle with a companion on the same link."""

    def __init__(self, vehicle: MockVehicle, lies: list[Lie], *, speed: float, component_id: int = COMPANION) -> None:
        super().__init__(vehicle, speed=speed)
        self._companion = Codec(system_id=vehicle.address.system_id, component_id=component_id)
        self._lies, self._rng, self._next_s = lies, random.Random(14), 0.0

    def datagrams_to_send(self, now: float) -> list[bytes]:
        datagrams = super().datagrams_to_send(now)
        if now >= self._next_s:
            self._next_s = now + 0.1
            datagrams += [self._companion.encode(lie(self._rng)) for lie in self._lies]
        return datagrams


def meddled(autopilot, lies: list[Lie]) -> Scene:
    scene = make_scene(autopilot, make_peer=lambda vehicle, speed: MeddledPeer(vehicle, lies, speed=speed))
    scene.upload(mission())
    return scene


@pytest.mark.parametrize("lie", LIES)
def test_a_companions_word_changes_nothing_of_a_flight(lie, monkeypatch):
    sent: list[int] = []
    original = MockVehicle.disarm

    def disarm(vehicle, **how):
        sent.append(vehicle.armed and not vehicle.body.on_ground)
        return original(vehicle, **how)

    monkeypatch.setattr(MockVehicle, "disarm", disarm)
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
    assert max(abs(v) for place in east_north for v in place) < 1000.0
    assert max(abs(s.roll_deg) + abs(s.pitch_deg) for s in scene.samples) < 60.0
    assert not scene.told(EventKind.WARNING)


@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
def test_all_of_it_at_once_and_ctrl_c_still_comes_home(autopilot):
    scene = meddled(autopilot, list(LIES.values()))
    outcome = scene.fly(stop=presses(scene, 35.0))
    assert outcome.ending is Ending.RETURNED
    assert not scene.vehicle.body.crashed


def test_what_a_companion_says_to_the_pilot_is_shown_with_its_component():
    scene = meddled(ARDUPILOT, [lambda _: m.StatusText(2, "Crash: of the video process")])
    assert scene.fly().ending is Ending.LANDED
    assert "component 191: Crash: of the video process" in scene.told(EventKind.TEXT)


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
    told: list[bool] = []
    original = MockVehicle.disarm

    def disarm(vehicle, **how):
        told.append(vehicle.body.on_ground)
        return original(vehicle, **how)

    monkeypatch.setattr(MockVehicle, "disarm", disarm)
    scene = make_scene(autopilot, make_peer=lambda v, speed: StutteringPeer(v, [LIES["on-ground"]], speed=speed))
    scene.upload(mission())
    monkeypatch.setattr(type(scene.vehicle.body), "landed_state", LandedState.ON_GROUND)
    outcome = scene.fly(stop=presses(scene, 35.0))
    assert outcome.ending in (Ending.RETURNED, Ending.LEFT_HOLDING)
    assert told == [] or all(told)

"""MAVSDK as a second client, against our mock vehicle over UDP; the wall clock is MAVSDK's, a watchdog ends what hangs."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from random import Random
from typing import Any

import numpy as np
import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Autopilot, Mode
from mission_io.autopilots.mission_lists import wire_items
from mission_io.client.client import Client
from mission_io.errors import (
    CommandRefusedError,
    MisuseError,
    TransferCancelledError,
    TransferError,
    VehicleSilentError,
    WaitCancelledError,
)
from mission_io.links.datagrams import UdpLink
from mission_io.links.simulated import Conditions, LossyLink
from mission_io.model.items import Command, Fence, FenceCircle, FencePolygon, LatLon, MissionType, RallyPoints
from mission_io.wire.messages import AutopilotVersion
from tests.flight.scene import HOME, mission, plan_for, return_mission
from tests.mission_io.protocol.scripts import items
from uavcover.extras.mavsdk.session import raw_items
from uavcover.flight.fly import fly
from uavcover.flight.monitor import Monitor
from uavcover.flight.orders import FlightTimeouts, OnBreach, Orders, Precautions
from uavcover.mock.dynamics import BatteryData
from uavcover.mock.server import BackgroundMock
from uavcover.mock.vehicle import MockConfig, MockVehicle
from uavcover.model.track import Ending

client_module = pytest.importorskip("uavcover.extras.mavsdk.client", reason="MAVSDK is not installed")
pytestmark = pytest.mark.timeout(120)

COMMAND_LONG = 76
CORNERS = tuple(LatLon(36.51 + i * i * 0.01, -84.22 + i * 0.01) for i in range(4))
FENCE = Fence((FencePolygon(CORNERS),), (FenceCircle(LatLon(36.52, -84.21), 123.0, inclusion=False),))


class WatchedVehicle(MockVehicle):
    """A mock vehicle that another thread can wait for."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._advanced = threading.Condition()

    def advance(self, now: float) -> None:
        with self._advanced:
            super().advance(now)
            self._advanced.notify_all()

    def wait_until(self, done: Callable[[], bool]) -> None:
        """Wait under a watchdog, by the wall clock."""
        with self._advanced:
            assert self._advanced.wait_for(done, 60.0), "the watchdog"


@contextmanager
def served(autopilot: Autopilot, *, speed: float = 20.0) -> Iterator[tuple[WatchedVehicle, int]]:
    """A mock vehicle on a port of its own, in a thread."""
    config = MockConfig(speed=speed, battery=BatteryData(endurance_s=1500.0))
    vehicle = WatchedVehicle(autopilot, HOME, config, rng=np.random.default_rng(1))
    with BackgroundMock(vehicle, speed=speed) as mock:
        yield vehicle, mock.port


@contextmanager
def connected(port: int, *, loss: float = 0.0) -> Iterator[tuple[Client, Monitor]]:
    """MAVSDK's client, and what it hears."""
    link = LossyLink(UdpLink.connecting("127.0.0.1", port), rng=Random(7), conditions=Conditions(loss=loss))
    monitor = Monitor()
    with client_module.MavsdkClient(link, listener=monitor) as client:
        monitor.listen_to(client.wait_for_vehicle(20.0).address)
        yield client, monitor


@pytest.fixture(params=[ARDUPILOT, PX4], ids=lambda a: a.name)
def autopilot(request: pytest.FixtureRequest) -> Autopilot:
    value = request.param
    assert isinstance(value, Autopilot)
    return value


def test_three_lists_go_across_and_are_read_back_by_both_clients(autopilot):
    with served(autopilot) as (vehicle, port), connected(port) as (client, _):
        observed: list[tuple[int, int]] = []
        wanted = mission()
        for content in (wanted, FENCE, RallyPoints(())):
            verification = client.upload_and_verify(content, progress=lambda *count: observed.append(count))
            assert verification.passed, verification.differences
        assert len(vehicle.mission_items) == len(wanted.items) + int(autopilot.home_in_item_0)
        assert observed
        assert all(isinstance(done, int) and 0 <= done <= total for done, total in observed)
        with Client(UdpLink.connecting("127.0.0.1", port), system_id=254) as native:
            native.wait_for_vehicle(20.0)
            for kind in MissionType:
                assert native.download(kind) == client.download(kind)


def test_items_get_across_at_10_percent_loss_each_way(autopilot):
    sent = items(20)
    with served(autopilot, speed=1.0) as (vehicle, port), connected(port, loss=0.1) as (client, _):
        client.upload(MissionType.MISSION, sent)
        assert [(i.command, i.lat_deg) for i in vehicle.mission_items][1:] == [(i.command, i.lat_deg) for i in sent][1:]
        assert len(client.download(MissionType.MISSION)) == len(vehicle.mission_items) == 20


def test_a_refusal_is_final_and_one_line():
    bad = [replace(item, lat_deg=91.0) if number == 1 else item for number, item in enumerate(items(3))]
    with served(ARDUPILOT) as (_, port), connected(port) as (client, _):
        client.upload(MissionType.MISSION, items(3))
        with pytest.raises(
            TransferError, match=r"^upload of the mission by MAVSDK: vehicle 1: INVALID_ARGUMENT in try [1-3] of"
        ) as caught:
            client.upload(MissionType.MISSION, bad)
        assert "\n" not in str(caught.value)
        assert caught.value.vehicle_holds == "unknown"


def test_an_upload_is_cancelled(autopilot):
    with served(autopilot) as (_, port), connected(port) as (client, _):
        observed: list[int] = []
        with pytest.raises(TransferCancelledError, match="cancelled"):
            client.upload(
                MissionType.MISSION,
                items(300),
                progress=lambda done, _: observed.append(done),
                stop=lambda: len(observed) > 20,
            )
        assert observed[-1] < 300
        client.upload(MissionType.MISSION, items(5))  # and nothing is left of it
        assert len(client.download(MissionType.MISSION)) == 5


def test_commands_are_answered_refused_and_wait(autopilot):
    with served(autopilot) as (vehicle, port), connected(port) as (client, _):
        assert isinstance(client.request_message(AutopilotVersion), AutopilotVersion)
        with pytest.raises(CommandRefusedError) as refused:
            client.command(31999)
        assert refused.value.result_name == "UNSUPPORTED"
        with pytest.raises(MisuseError, match="only finite"):
            client.command(Command.COMPONENT_ARM_DISARM, float("nan"))
        assert not vehicle.armed


def test_a_command_that_is_given_up_is_not_sent_again():
    """MAVSDK sends a command again by itself; after a gap of the link that may be against a failsafe."""
    with served(ARDUPILOT) as (_, port), connected(port) as (client, _):
        client.wait_for_vehicle()
        sent: list[int] = []
        link = client.link._link
        send = link.send

        def lose_commands(data: bytes) -> None:
            number = int.from_bytes(data[7:10], "little")
            command = int.from_bytes(data[38:40], "little") if number == COMMAND_LONG else 0  # behind seven floats
            sent.append(command)
            if command != Command.DO_SET_MODE:
                send(data)

        link.send = lose_commands
        client.give_up = lambda: Command.DO_SET_MODE in sent
        with pytest.raises(WaitCancelledError):
            client.command(Command.DO_SET_MODE, 1.0, 4.0)
        client.give_up = None
        sent.clear()
        until_s = client.clock.now() + 2.0
        while client.clock.now() < until_s:
            client.poll(0.1)
        assert Command.DO_SET_MODE not in sent
        assert 0 in sent, "heartbeats go on"
        link.send = send
        until_s = client.clock.now() + 3.0
        while client.clock.now() < until_s:
            client.poll(0.1)
        assert client.command(Command.DO_SET_MODE, 1.0, 4.0).result == 0


def test_nobody_there_is_a_silent_vehicle():
    nobody = UdpLink.listening()
    link = UdpLink.connecting("127.0.0.1", nobody.local_port)
    with client_module.MavsdkClient(link) as client, pytest.raises(VehicleSilentError, match="no vehicle sent"):
        client.wait_for_vehicle(0.3)
    nobody.close()


def test_a_whole_flight_by_mavsdk(autopilot):
    wanted = mission()
    with served(autopilot) as (vehicle, port), connected(port) as (client, monitor):
        assert client.upload_and_verify(wanted).passed
        samples = []
        outcome = fly(
            client,
            monitor,
            plan_for(wanted),
            Orders(
                on_sample=samples.append,
                on_event=lambda _: None,
                stop=lambda: 0,
                confirmed=True,
                timeouts=FlightTimeouts(),
                precautions=Precautions(on_breach=OnBreach.TELL),
            ),
            plan_return=return_mission,
        )
        assert outcome.ending is Ending.LANDED
        assert not vehicle.armed
        assert not vehicle.body.crashed
        assert {sample.current_waypoint for sample in samples} >= {0, 1, 2, 3}


@contextmanager
def foreign_client(port: int) -> Iterator[tuple[Any, Any]]:
    """MAVSDK by itself, as somebody else's program: its ``action`` and its ``mission_raw``."""
    mavsdk = pytest.importorskip("mavsdk")
    from mavsdk.plugins.action import Action
    from mavsdk.plugins.mission_raw import MissionRaw

    mavsdk.log_subscribe(lambda *_: True)
    ground = mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION))
    ground.add_any_connection(f"udpout://127.0.0.1:{port}")
    system = ground.first_autopilot(30.0)
    assert system is not None
    action, raw = Action(system), MissionRaw(system)
    try:
        yield action, raw
    finally:
        for part in (raw, action, ground):
            part.destroy()


def test_mavsdks_own_start_takes_off(autopilot):
    """``arm`` and ``start_mission`` of MAVSDK, as both simulators take them."""
    with served(autopilot) as (vehicle, port), foreign_client(port) as (action, raw):
        vehicle.wait_until(lambda: vehicle.ready)
        raw.upload_mission(raw_items(wire_items(mission(), autopilot), MissionType.MISSION))
        action.arm()
        raw.start_mission()
        vehicle.wait_until(lambda: vehicle.flying and vehicle.mode is Mode.MISSION)


def test_mavsdks_start_before_arming_is_what_arducopter_makes_of_it():
    """ArduCopter 4.7 accepts the start; MAVSDK then holds in BRAKE before it arms, and ArduCopter refuses to arm in BRAKE."""
    from mavsdk.plugins.action import ActionError

    with served(ARDUPILOT) as (vehicle, port), foreign_client(port) as (action, raw):
        vehicle.wait_until(lambda: vehicle.ready)
        raw.upload_mission(raw_items(wire_items(mission(), ARDUPILOT), MissionType.MISSION))
        raw.start_mission()
        assert vehicle.mode is Mode.MISSION
        heard_s = vehicle.time_s + 3.0
        vehicle.wait_until(lambda: vehicle.time_s > heard_s)  # MAVSDK knows the mode by heartbeats
        with pytest.raises(ActionError):
            action.arm()
        assert not vehicle.armed

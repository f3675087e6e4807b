"""The mock vehicle and ground stations that others wrote: MAVSDK flies it, MAVProxy loads a mission into it."""

import contextlib
import os
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Autopilot, Mode
from mission_io.formats.wpl import write_mission
from tests.flight.scene import HOME, mission
from uavcover.mock.dynamics import BatteryData
from uavcover.mock.server import MockServer, TcpPort, UdpPort
from uavcover.mock.vehicle import MockConfig, MockVehicle

pytestmark = pytest.mark.timeout(120)

MAVPROXY = os.environ.get("UAVCOVER_MAVPROXY") or shutil.which("mavproxy.py")
SPEED = 5.0


@contextlib.contextmanager
def listening(autopilot: Autopilot, *, tcp: bool = False) -> Iterator[tuple[MockVehicle, int]]:
    """A vehicle on a port of its own, in a thread."""
    vehicle = MockVehicle(
        autopilot, HOME, MockConfig(speed=SPEED, battery=BatteryData(endurance_s=1500.0)), rng=np.random.default_rng(1)
    )
    server = MockServer(vehicle, kind=TcpPort if tcp else UdpPort, speed=SPEED)
    stop = threading.Event()
    thread = threading.Thread(target=server.serve, args=(stop.is_set,))
    thread.start()
    try:
        yield vehicle, server.port
    finally:
        stop.set()
        thread.join()
        server.close()


def wait_for(done: Callable[[], bool], what: str, seconds: float = 60.0) -> None:
    """Another process or thread has to get there: wall clock, under a watchdog."""
    end = time.monotonic() + seconds
    while not done():
        assert time.monotonic() < end, what
        threading.Event().wait(0.02)


@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
def test_mavsdk_finds_flies_and_reads_it(autopilot):
    mavsdk = pytest.importorskip("mavsdk", reason="MAVSDK is not installed")
    action_plugin = pytest.importorskip("mavsdk.plugins.action")
    telemetry_plugin = pytest.importorskip("mavsdk.plugins.telemetry")
    mavsdk.log_subscribe(lambda *_: True)
    configuration = mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION)
    ground = mavsdk.Mavsdk(configuration)
    with listening(autopilot) as (vehicle, port):
        ground.add_any_connection(f"udpout://127.0.0.1:{port}")
        system = ground.first_autopilot(30.0)
        assert system is not None
        action, telemetry = action_plugin.Action(system), telemetry_plugin.Telemetry(system)
        try:
            wait_for(lambda: vehicle.ready, "not ready")
            wait_for(lambda: abs(telemetry.home().latitude_deg - HOME.lat_deg) < 1e-6, "no home")
            action.set_takeoff_altitude(12.0)
            action.arm()
            action.takeoff()
            wait_for(lambda: telemetry.position().relative_altitude_m > 2.0, "did not take off")
            assert telemetry.armed()
            assert 0.0 < telemetry.battery().remaining_percent <= 100.0
            action.goto_location(HOME.lat_deg + 0.0003, HOME.lon_deg, HOME.alt_amsl_m + 15.0, 0.0)
            wait_for(lambda: telemetry.position().latitude_deg > HOME.lat_deg + 0.00025, "did not go there")
            action.hold()
            wait_for(lambda: vehicle.mode is Mode.HOLD, "did not hold")
            action.return_to_launch()
            wait_for(lambda: not vehicle.armed, "did not land")
            assert not vehicle.body.crashed
        finally:
            telemetry.destroy()
            action.destroy()
            ground.destroy()


@pytest.mark.skipif(MAVPROXY is None, reason="MAVProxy is not installed; set UAVCOVER_MAVPROXY to its mavproxy.py")
@pytest.mark.parametrize("tcp", [False, True], ids=["udp", "tcp"])
def test_mavproxy_without_a_screen_loads_a_mission_and_reads_parameters(tcp, tmp_path):
    file = tmp_path / "mission.waypoints"
    file.write_text(write_mission(mission()))
    with listening(ARDUPILOT, tcp=tcp) as (vehicle, port):
        master = f"tcp:127.0.0.1:{port}" if tcp else f"udpout:127.0.0.1:{port}"
        command = [str(MAVPROXY), f"--master={master}"]
        script = Path(str(MAVPROXY))
        python = script.with_name("python")
        interpreter = [str(python)] if python.exists() else [sys.executable]
        with (
            (tmp_path / "mavproxy.txt").open("w") as log,
            subprocess.Popen(
                [*interpreter, *command], cwd=tmp_path, stdin=subprocess.PIPE, stdout=log, stderr=log, text=True
            ) as process,
        ):
            assert process.stdin is not None
            try:
                wait_for(lambda: (tmp_path / "mav.parm").exists(), "MAVProxy read no parameters")
                process.stdin.write(f"wp load {file}\n")
                process.stdin.flush()
                wait_for(lambda: len(vehicle.mission_items) == 1 + len(mission().items), "MAVProxy loaded nothing")
            finally:
                process.kill()
        assert "WPNAV_SPEED" in (tmp_path / "mav.parm").read_text()
    assert vehicle.mission_items[1].command == mission().items[0].command

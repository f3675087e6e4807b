import sys
import time

import pytest

from mission_io.links.opening import UdpLink, open_link
from mission_io.links.simulated import Conditions
from mission_io.model.items import GeoPoint
from sitl_tests.errors import MissingSimulatorError, SimulatorError
from sitl_tests.relay import Relay
from sitl_tests.simulators import ardupilot, px4
from sitl_tests.simulators.process import SimulatorProcess
from sitl_tests.simulators.running import StartRequest

#

WATCHDOG_S = 10.0


def received_until(link, wanted: bytes) -> list[bytes]:
    got = []
    deadline = time.monotonic() + WATCHDOG_S
    while time.monotonic() < deadline:
        data = link.receive(0.1)
        if data is not None:
            got.append(data)
        if data == wanted:
            return got
    raise AssertionError(f"{wanted!r} did not come, only {got}")


def relayed(count: int, *, seed: int, loss: float) -> list[bytes]:
    got = []
    conditions = Conditions(loss=loss)
    with (
        UdpLink.listening() as vehicle,
        Relay(f"udpout://127.0.0.1:{vehicle.local_port}", seed=seed, conditions=conditions) as relay,
    ):
        station = open_link(relay.url)
        for n in range(count):
            station.send(b"%d" % n)
            data = vehicle.receive(0.05)
            if data is not None:
                got.append(data)
        station.close()
    return got


def test_what_is_not_lost_goes_through_both_ways():
    with UdpLink.listening() as vehicle, Relay(f"udpout://127.0.0.1:{vehicle.local_port}", seed=1) as relay:
        station = open_link(relay.url)
        station.send(b"up")
        received_until(vehicle, b"up")
        vehicle.send(b"down")
        assert received_until(station, b"down") == [b"down"]
        relay.cut_to_vehicle()
        station.send(b"lost")
        vehicle.send(b"still heard")
        received_until(station, b"still heard")
        assert vehicle.receive(0.1) is None
        station.close()


def test_about_as_much_is_lost_as_was_asked():
    got = relayed(40, seed=3, loss=0.5)
    assert 8 <= len(got) <= 32


STARTS = [
    (ardupilot.starter(ardupilot.COPTER), "UAVCOVER_ARDUCOPTER"),
    (ardupilot.starter(ardupilot.PLANE), "UAVCOVER_ARDUPLANE"),
    (ardupilot.starter(ardupilot.ROVER), "UAVCOVER_ARDUROVER"),
    (px4.start, "UAVCOVER_PX4"),
]
HOME = GeoPoint(36.5, -84.2, 300.0)


def request_in(folder):
    return StartRequest(folder, HOME, 1.0, {})


@pytest.mark.parametrize(("start", "variable"), STARTS)
def test_a_missing_simulator_says_which_variable_to_set(start, variable, tmp_path, monkeypatch):
    monkeypatch.delenv(variable, raising=False)
    with pytest.raises(MissingSimulatorError, match=f"set {variable} to the b"), start(request_in(tmp_path)):
        pass


@pytest.mark.parametrize(("start", "variable"), STARTS)
def test_a_variable_that_names_nothing_is_an_error(start, variable, tmp_path, monkeypatch):
    monkeypatch.setenv(variable, str(tmp_path / "nothing"))
    with pytest.raises(SimulatorError, match=variable), start(request_in(tmp_path)):
        pass


def test_an_arducopter_without_default_parameters_says_how_to_name_them(tmp_path, monkeypatch):
    program = tmp_path / "arducopter"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    monkeypatch.setenv("UAVCOVER_ARDUCOPTER", str(program))
    with (
        pytest.raises(SimulatorError, match="set UAVCOVER_ARDUCOPTER_DEFAULTS"),
        ardupilot.starter(ardupilot.COPTER)(request_in(tmp_path)),
    ):
        pass


def test_a_simulator_is_ended_when_it_is_left(tmp_path):
    command = [sys.executable, "-c", "import signal; print('ready', flush=True); signal.pause()"]
    with SimulatorProcess(command, tmp_path) as process:
        process.wait_for_line("ready", within_s=30.0)
        process.require_running()
    with pytest.raises(SimulatorError, match="ended with exit code -15"):
        process.require_running()


def test_a_simulator_that_ends_at_once_is_an_error_with_its_console(tmp_path):
    command = [sys.executable, "-c", "print('no such model'); raise SystemExit(3)"]
    says = r"ended with exit code 3; see .*console.txt"
    with SimulatorProcess(command, tmp_path) as process, pytest.raises(SimulatorError, match=says):
        process.wait_for_line("ready", within_s=30.0)
    assert "no such model" in (tmp_path / "console.txt").read_text()

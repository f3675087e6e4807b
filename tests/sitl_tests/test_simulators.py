import sys

import pytest

from mission_io.model.items import GeoPoint
from sitl_tests.errors import MissingSimulatorError, SimulatorError
from sitl_tests.simulators import ardupilot, px4
from sitl_tests.simulators.process import SimulatorProcess, free_udp_port
from sitl_tests.simulators.running import StartRequest

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


def test_ports_are_none_that_the_system_gives_to_other_sockets():
    """A port from the system's own range was given to another socket before a station listened on it."""
    with open("/proc/sys/net/ipv4/ip_local_port_range") as limits:
        lowest = int(limits.read().split()[0])
    assert 1024 < free_udp_port() < lowest

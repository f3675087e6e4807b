"""--system, two vehicles on one link, and vehicles that are no multirotors."""

import contextlib
import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4
from mission_io.model.enums import parse_type
from mission_io.model.items import GeoPoint, MissionType
from tests.cli.conftest import Cli
from uavcover.flight.connect import require_home
from uavcover.mock.server import MockServer
from uavcover.mock.vehicle import MockConfig, MockVehicle
from uavcover.run.documents import read_planned
from uavcover.run.folder import RunFolder

FOREIGN = ["plane", "vtol", "helicopter", "rover", "boat", "submarine", "airship"]


@contextlib.contextmanager
def speaking_to(port: int, *vehicles: MockVehicle) -> Iterator[None]:
    """Vehicles that speak to a port of this machine until the context is left."""
    ended = threading.Event()
    with contextlib.ExitStack() as stack:
        for vehicle in vehicles:
            server = stack.enter_context(MockServer(vehicle, greet=("127.0.0.1", port)))
            thread = threading.Thread(target=server.serve, args=(ended.is_set,), daemon=True)
            thread.start()
            stack.callback(thread.join)
        stack.callback(ended.set)
        yield


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        number: int = probe.getsockname()[1]
        return number


@pytest.fixture
def run(planned: Path) -> Path:
    return planned


def home_of(run: Path) -> GeoPoint:
    return require_home(read_planned(RunFolder(run))[0])


def arguments_of(name: str, run: Path, url: str) -> list[object]:
    return {
        "plan-upload": ["plan-upload", run, "--to", url],
        "fly": ["fly", run, "--to", url, "--yes"],
        "resume": ["fly", run, "--to", url, "--yes", "--resume"],
        "upload": ["upload", run / "mission.waypoints", "--to", url],
        "download": ["download", "--from", url, "-o", run / "held.waypoints"],
        "clear": ["clear", "--to", url],
    }[name]


@pytest.mark.parametrize("name", ["plan-upload", "fly", "resume", "upload", "download", "clear"])
def test_two_vehicles_and_none_named_is_bad_usage_that_lists_them(cli: Cli, run: Path, name: str) -> None:
    home, port = home_of(run), free_port()
    vehicles = [MockVehicle(ARDUPILOT, home, MockConfig(system_id=3)), MockVehicle(PX4, home, MockConfig(system_id=7))]
    with speaking_to(port, *vehicles):
        ended = cli(*arguments_of(name, run, f"udpin://127.0.0.1:{port}"), "-q")
    assert ended.code == 2
    listed = (
        "system 3, component 1 (ArduPilot, quadrotor); system 7, component 1 (PX4, quadrotor); choose one by --system"
    )
    assert listed in ended.err
    assert all(vehicle.mission_items == () for vehicle in vehicles)


def test_the_named_one_gets_the_mission_and_gives_it_back(cli: Cli, run: Path) -> None:
    home, port = home_of(run), free_port()
    vehicles = [
        MockVehicle(ARDUPILOT, home, MockConfig(system_id=3)),
        MockVehicle(ARDUPILOT, home, MockConfig(system_id=7)),
    ]
    with speaking_to(port, *vehicles):
        url = f"udpin://127.0.0.1:{port}"
        cli("plan-upload", run, "--to", url, "--system", "7", "-q", code=0)
        assert [len(vehicle.mission_items) > 5 for vehicle in vehicles] == [False, True]
        cli(*arguments_of("download", run, url), "--system", "7", "--component", "1", "-q", code=0)
        cli(*arguments_of("clear", run, url), "--system", "7", "-q", code=0)
        ended = cli(*arguments_of("clear", run, url), "--system", "9", "--timeout", "2", "-q")
    assert (ended.code, "no vehicle with system ID 9" in ended.err) == (3, True)


@pytest.mark.parametrize("kind", FOREIGN)
@pytest.mark.parametrize("name", ["plan-upload", "fly"])
def test_no_other_vehicle_than_a_multirotor_is_touched(cli: Cli, run: Path, kind: str, name: str) -> None:
    vehicle = MockVehicle(PX4 if len(kind) % 2 else ARDUPILOT, home_of(run), MockConfig(vehicle_type=parse_type(kind)))
    port = free_port()
    with speaking_to(port, vehicle):
        ended = cli(*arguments_of(name, run, f"udpin://127.0.0.1:{port}"), "-q")
    assert ended.code == 3
    assert "uavcover supports only multirotors" in ended.err
    assert f"MAV_TYPE {parse_type(kind)}" in ended.err
    assert not vehicle.armed
    assert vehicle.missions.items(MissionType.MISSION) == ()


def test_a_file_for_a_plane_is_uploaded_to_a_plane(cli: Cli, run: Path) -> None:
    vehicle = MockVehicle(ARDUPILOT, home_of(run), MockConfig(vehicle_type=parse_type("plane")))
    port = free_port()
    with speaking_to(port, vehicle):
        ended = cli(*arguments_of("upload", run, f"udpin://127.0.0.1:{port}"))
    assert ended.code == 0
    assert "ArduPilot, plane" in ended.out
    assert len(vehicle.mission_items) > 5

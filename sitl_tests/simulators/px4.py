"""PX4's software in the loop with its own simulated quadrotor, from the build folder that ``UAVCOVER_PX4`` names."""

import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sitl_tests.errors import MissingSimulatorError, SimulatorError
from sitl_tests.simulators.files import SHOWN, sha256
from sitl_tests.simulators.process import SimulatorProcess, free_udp_port, is_udp_port_free
from sitl_tests.simulators.running import RunningVehicle, StartRequest

VARIABLE = "UAVCOVER_PX4"
_MODEL = "sihsim_quadx"
_START_S = 90.0
_FIRST_OWN_INSTANCE = 20
_MOST_INSTANCES = 250
_GROUND_STATION_PORT = 18570
"""PX4's first port for ground stations; each instance has the next one."""
_COMMAND_S = 20.0
_BYTES_PER_S = "4000000"


def build_folder() -> Path:
    """The build.

    Raises:
        MissingSimulatorError: the variable is not set.
        SimulatorError: it names no build.
    """
    named = os.environ.get(VARIABLE)
    if not named:
        raise MissingSimulatorError(f"no PX4: set {VARIABLE} to the build folder of px4_sitl_default")
    path = Path(named).resolve()
    if not (path / "bin" / "px4").is_file():
        raise SimulatorError(f"{VARIABLE}: {named} has no bin/px4")
    return path


@contextmanager
def start(request: StartRequest) -> Iterator[RunningVehicle]:
    """Start it as an instance that nobody uses, with two links of its own instead of those it has by default.

    Raises:
        MissingSimulatorError: the variable is not set.
        SimulatorError: it does not start.
    """
    build, instance = build_folder(), _free_instance()
    home = request.home
    environment = {
        "PX4_SIM_MODEL": _MODEL,
        "PX4_SIM_SPEED_FACTOR": repr(request.speed),
        "PX4_HOME_LAT": repr(home.lat_deg),
        "PX4_HOME_LON": repr(home.lon_deg),
        "PX4_HOME_ALT": repr(home.alt_amsl_m),
        **{f"PX4_PARAM_{name}": f"{value:g}" for name, value in request.parameters.items()},
    }
    command = [str(build / "bin" / "px4"), "-i", str(instance), "-d", str(build / "etc")]
    with _leaving_nothing(instance), SimulatorProcess(command, request.folder, environment=environment) as process:
        process.wait_for_line("Startup script returned successfully", within_s=_START_S)
        _tell(build, instance, "mavlink", "stop-all")
        urls = []
        for _ in range(2):
            here, there = free_udp_port(), free_udp_port()
            _tell(build, instance, "mavlink", "start", "-x", "-u", str(here), "-o", str(there),
                  "-t", "127.0.0.1", "-r", _BYTES_PER_S, "-f", "-m", "minimal")  # fmt: skip
            urls.append(f"udpin://127.0.0.1:{there}")
        yield RunningVehicle(
            url=urls[0],
            second_url=urls[1],
            home=home,
            version=f"PX4, software in the loop ({_MODEL}), binary SHA-256 {sha256(Path(command[0]))[:SHOWN]}",
            log_files=lambda: tuple(sorted((request.folder / "log").glob("**/*.ulg"))),
        )


@contextmanager
def _leaving_nothing(instance: int) -> Iterator[None]:
    """Remove what an instance that was ended leaves behind, by which its number would count as taken."""
    try:
        yield
    finally:
        for path in _marks(instance):
            path.unlink(missing_ok=True)


def _marks(instance: int) -> tuple[Path, ...]:
    return Path(f"/tmp/px4-sock-{instance}"), Path(f"/tmp/px4_lock-{instance}")


def _free_instance() -> int:
    for instance in range(_FIRST_OWN_INSTANCE, _MOST_INSTANCES):
        if not any(mark.exists() for mark in _marks(instance)) and is_udp_port_free(_GROUND_STATION_PORT + instance):
            return instance
    raise SimulatorError(f"all PX4 instances up to {_MOST_INSTANCES} are in use, or have left /tmp/px4-sock-* behind")


def _tell(build: Path, instance: int, module: str, *arguments: str) -> None:
    """A command to a running instance.

    Raises:
        SimulatorError: it fails.
    """
    command = [str(build / "bin" / f"px4-{module}"), "--instance", str(instance), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=_COMMAND_S, check=False)
    if done.returncode != 0:
        raise SimulatorError(f"px4-{module} {' '.join(arguments)} ended with {done.returncode}: {done.stderr.strip()}")

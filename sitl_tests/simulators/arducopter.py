"""ArduCopter's software in the loop, from the binary that ``UAVCOVER_ARDUCOPTER`` names."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sitl_tests.errors import MissingSimulatorError, SimulatorError
from sitl_tests.simulators.files import SHOWN, sha256
from sitl_tests.simulators.process import SimulatorProcess, free_udp_port
from sitl_tests.simulators.running import RunningVehicle, StartRequest

VARIABLE = "UAVCOVER_ARDUCOPTER"
DEFAULTS_VARIABLE = "UAVCOVER_ARDUCOPTER_DEFAULTS"
_DEFAULTS = Path("Tools", "autotest", "default_params", "copter.parm")
_START_S = 60.0


def binary() -> Path:
    """The program.

    Raises:
        MissingSimulatorError: the variable is not set.
        SimulatorError: it names nothing that can be run.
    """
    named = os.environ.get(VARIABLE)
    if not named:
        raise MissingSimulatorError(
            f"no ArduCopter: set {VARIABLE} to the binary of a SITL build (build/sitl/bin/arducopter)"
        )
    path = Path(named).resolve()
    if not os.access(path, os.X_OK) or path.is_dir():
        raise SimulatorError(f"{VARIABLE}: {named} is no program")
    return path


def defaults_file() -> Path:
    """The quadcopter's default parameters: named by a variable, or where the binary's source tree has them.

    Raises:
        SimulatorError: there are none.
    """
    named = os.environ.get(DEFAULTS_VARIABLE)
    places = [Path(named)] if named else [parent / _DEFAULTS for parent in binary().parents]
    for place in places:
        if place.is_file():
            return place.resolve()
    raise SimulatorError(f"no default parameters beside {binary()}; set {DEFAULTS_VARIABLE} to a copter.parm")


@contextmanager
def start(request: StartRequest) -> Iterator[RunningVehicle]:
    """Start it on two UDP ports of its own; what is not used of its serial ports is off.

    Raises:
        MissingSimulatorError: the variable is not set.
        SimulatorError: it does not start.
    """
    program, defaults = binary(), defaults_file()
    own_parameters = request.folder / "own.parm"
    own_parameters.write_text("".join(f"{name} {value!r}\n" for name, value in request.parameters.items()))
    home, ports = request.home, (free_udp_port(), free_udp_port())
    command = [
        str(program), "--model", "quad", "--wipe", "--speedup", repr(request.speed),
        "--home", f"{home.lat_deg!r},{home.lon_deg!r},{home.alt_amsl_m!r},0",
        "--defaults", f"{defaults},{own_parameters}",
        "--serial0", f"udpclient:127.0.0.1:{ports[0]}", "--serial1", f"udpclient:127.0.0.1:{ports[1]}",
        "--serial2", "none", "--rc-in-port", str(free_udp_port()),
    ]  # fmt: skip
    with SimulatorProcess(command, request.folder) as process:
        process.wait_for_line("Home:", within_s=_START_S)
        yield RunningVehicle(
            url=f"udpin://127.0.0.1:{ports[0]}",
            second_url=f"udpin://127.0.0.1:{ports[1]}",
            home=home,
            version=f"ArduCopter, software in the loop, binary SHA-256 {sha256(program)[:SHOWN]}",
            log_files=lambda: tuple(sorted((request.folder / "logs").glob("*.BIN"))),
        )

"""ArduPilot's software in the loop: ArduCopter, ArduPlane and Rover, each from the binary that a variable names."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from sitl_tests.errors import MissingSimulatorError, SimulatorError
from sitl_tests.simulators.files import SHOWN, sha256
from sitl_tests.simulators.process import SimulatorProcess, free_udp_port
from sitl_tests.simulators.running import RunningVehicle, Start, StartRequest

_AUTOTEST = Path("Tools", "autotest")
_START_S = 60.0


@dataclass(frozen=True, slots=True)
class Program:
    """One of ArduPilot's programs.

    Attributes:
        name: for people.
        variable: names its binary; with ``_DEFAULTS`` behind it, its default parameters.
        file: its file name in a build.
        model: what it flies or drives in the simulation.
        defaults: the model's default parameters in the source tree.
    """

    name: str
    variable: str
    file: str
    model: str
    defaults: Path

    @property
    def defaults_variable(self) -> str:
        """Names the default parameters, where the binary lies outside of its source tree."""
        return f"{self.variable}_DEFAULTS"


COPTER = Program(
    "ArduCopter", "UAVCOVER_ARDUCOPTER", "arducopter", "quad", _AUTOTEST / "default_params" / "copter.parm"
)
PLANE = Program("ArduPlane", "UAVCOVER_ARDUPLANE", "arduplane", "plane", _AUTOTEST / "models" / "plane.parm")
ROVER = Program("Rover", "UAVCOVER_ARDUROVER", "ardurover", "rover", _AUTOTEST / "default_params" / "rover.parm")


def binary(program: Program) -> Path:
    """The file of a program.

    Raises:
        MissingSimulatorError: the variable is not set.
        SimulatorError: it names nothing that can be run.
    """
    named = os.environ.get(program.variable)
    if not named:
        raise MissingSimulatorError(
            f"no {program.name}: set {program.variable} to the binary of a SITL build (build/sitl/bin/{program.file})"
        )
    path = Path(named).resolve()
    if not os.access(path, os.X_OK) or path.is_dir():
        raise SimulatorError(f"{program.variable}: {named} is no program")
    return path


def defaults_file(program: Program) -> Path:
    """The model's default parameters: named by a variable, or where the binary's source tree has them.

    Raises:
        SimulatorError: there are none.
    """
    named = os.environ.get(program.defaults_variable)
    locations = [Path(named)] if named else [parent / program.defaults for parent in binary(program).parents]
    for path in locations:
        if path.is_file():
            return path.resolve()
    raise SimulatorError(
        f"no default parameters beside {binary(program)}; set {program.defaults_variable} to a {program.defaults.name}"
    )


def starter(program: Program) -> Start:
    """What starts one of ArduPilot's programs."""

    @contextmanager
    def start(request: StartRequest) -> Iterator[RunningVehicle]:
        with _start(program, request) as vehicle:
            yield vehicle

    return start


@contextmanager
def _start(kind: Program, request: StartRequest) -> Iterator[RunningVehicle]:
    """Start it on two UDP ports of its own; what is not used of its serial ports is off.

    Raises:
        MissingSimulatorError: the variable is not set.
        SimulatorError: it does not start.
    """
    program, defaults = binary(kind), defaults_file(kind)
    own_parameters = request.folder / "own.parm"
    own_parameters.write_text("".join(f"{name} {value!r}\n" for name, value in request.parameters.items()))
    home, ports = request.home, (free_udp_port(), free_udp_port())
    command = [
        str(program), "--model", kind.model, "--wipe", "--speedup", repr(request.speed),
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
            version=f"{kind.name}, software in the loop, binary SHA-256 {sha256(program)[:SHOWN]}",
            log_files=lambda: tuple(sorted((request.folder / "logs").glob("*.BIN"))),
        )

"""A simulator's process: headless, in a session of its own, its console in a file, ended by its process id."""

import os
import random
import socket
import subprocess
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

from sitl_tests.errors import SimulatorError

_END_S = 10.0
_LOOK_AGAIN_S = 0.05
CONSOLE = "console.txt"
_PORTS = range(20000, 32000)
"""Below those that Linux gives to sockets that ask for any (``ip_local_port_range``): the simulator's own, for one."""


class SimulatorProcess:
    """Runs a command until it is left; a context manager.

    Args:
        command: program and arguments.
        folder: where it runs, and where ``console.txt`` takes what it says.
        environment: variables beside those of this process.

    Raises:
        SimulatorError: it cannot be started.
    """

    def __init__(self, command: Sequence[str], folder: Path, *, environment: Mapping[str, str] | None = None) -> None:
        self._console_path = folder / CONSOLE
        self._name = Path(command[0]).name
        with self._console_path.open("wb") as console:
            try:
                self._process = subprocess.Popen(
                    command,
                    cwd=folder,
                    env={**os.environ, **(environment or {})},
                    stdin=subprocess.DEVNULL,
                    stdout=console,
                    stderr=subprocess.STDOUT,
                    start_new_session=True,
                )
            except OSError as error:
                raise SimulatorError(f"cannot start {command[0]}: {error.strerror}") from None

    def wait_for_line(self, part: str, *, within_s: float) -> None:
        """Wait until the console has said something.

        Raises:
            SimulatorError: it ended, or did not say so in time.
        """
        deadline = time.monotonic() + within_s
        while part not in self._console_path.read_text(errors="replace"):
            self.require_running()
            if time.monotonic() > deadline:
                raise SimulatorError(
                    f"{self._name} did not say {part!r} within {within_s:g} s; see {self._console_path}"
                )
            time.sleep(_LOOK_AGAIN_S)

    def require_running(self) -> None:
        """Refuse to go on with a process that has ended.

        Raises:
            SimulatorError: it has.
        """
        code = self._process.poll()
        if code is not None:
            raise SimulatorError(f"{self._name} ended with exit code {code}; see {self._console_path}")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the process, gently at first."""
        self._process.terminate()
        try:
            self._process.wait(timeout=_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def free_udp_port() -> int:
    """A free UDP port that no other socket gets before a station listens there."""
    return next(port for port in random.sample(_PORTS, len(_PORTS)) if is_udp_port_free(port))


def is_udp_port_free(port: int) -> bool:
    """Whether nobody listens on a UDP port of this machine."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("", port))
        except OSError:
            return False
    return True

"""Pausing a flight: the key p on a terminal, SIGUSR1 without one."""

import contextlib
import os
import select
import signal
import sys
from types import FrameType
from typing import Any, Self

from uavcover.cli.console import Console

PAUSE_KEY = "p"


class PauseKey:
    """Whether the user wants the vehicle to wait: each p, or SIGUSR1, changes that. A context manager.

    Keys are looked for where stdin is a terminal that this process is in the foreground of; they are read one by one without
    Enter, and the terminal is as it was afterwards. Ctrl-C works as ever.

    Args:
        console: tells how it is done.
    """

    def __init__(self, console: Console) -> None:
        self._console = console
        self._wanted = False
        self._terminal: Any = None
        self._before: Any = None

    def paused(self) -> bool:
        """Whether the vehicle is to wait now."""
        if self._terminal is not None:
            with contextlib.suppress(OSError):
                while select.select([sys.stdin], [], [], 0.0)[0]:
                    keys = os.read(sys.stdin.fileno(), 64).decode(errors="replace").lower()
                    if not keys:
                        break
                    if keys.count(PAUSE_KEY) % 2:
                        self._change()
        return self._wanted

    def __enter__(self) -> Self:
        if sys.platform != "win32":
            self._before = signal.signal(signal.SIGUSR1, self._take)
            self._read_keys()
        return self

    def __exit__(self, *_: object) -> None:
        if sys.platform == "win32":
            return
        signal.signal(signal.SIGUSR1, self._before)
        if self._terminal is not None:
            import termios

            with contextlib.suppress(OSError, termios.error):
                termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._terminal)
            self._terminal = None

    def _read_keys(self) -> None:
        import termios
        import tty

        try:
            if not sys.stdin.isatty() or os.tcgetpgrp(sys.stdin.fileno()) != os.getpgrp():
                return
            before = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin)
        except (OSError, ValueError, termios.error):  # no stdin, or none that is one
            return
        self._terminal = before
        self._console.say(f"{PAUSE_KEY} pauses the flight, {PAUSE_KEY} again goes on; Ctrl-C brings it home")

    def _take(self, number: int, frame: FrameType | None) -> None:
        del number, frame
        self._change()

    def _change(self) -> None:
        self._wanted = not self._wanted

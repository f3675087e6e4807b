"""The key that pauses a flight, on a real terminal."""

import fcntl
import os
import pty
import select
import signal
import subprocess
import sys
import termios

import pytest

from tests.cli.conftest import WATCHDOG_S
from uavcover.cli.console import Console, PauseKey

CHILD = """
import select, sys
from uavcover.cli.console import Console
from uavcover.cli.console import PauseKey
with PauseKey(Console(verbosity=-1)) as keys:
    print("ready", flush=True)
    for _ in range(3):
        select.select([sys.stdin], [], [])
        print(keys.paused(), flush=True)
"""


def _own_terminal() -> None:
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)


def test_p_pauses_and_p_goes_on_and_the_terminal_is_as_it_was() -> None:
    ours, theirs = pty.openpty()
    try:
        before = termios.tcgetattr(theirs)
        with subprocess.Popen(
            [sys.executable, "-c", CHILD], stdin=theirs, stdout=subprocess.PIPE, start_new_session=True,
            preexec_fn=_own_terminal, text=True,
        ) as child:  # fmt: skip
            assert child.stdout is not None
            assert child.stdout.readline() == "ready\n"
            assert not termios.tcgetattr(theirs)[3] & termios.ICANON
            said = []
            for key in (b"p", b"x", b"P"):
                os.write(ours, key)
                assert select.select([child.stdout], [], [], 20.0)[0]
                said.append(child.stdout.readline().strip())
            assert said == ["True", "True", "False"]
            assert child.wait(timeout=WATCHDOG_S) == 0
        assert termios.tcgetattr(theirs) == before
    finally:
        os.close(ours)
        os.close(theirs)


def test_without_a_terminal_a_signal_does_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", open(os.devnull))  # noqa: SIM115
    before = signal.getsignal(signal.SIGUSR1)
    with PauseKey(Console(verbosity=-1)) as keys:
        assert not keys.paused()
        os.kill(os.getpid(), signal.SIGUSR1)
        assert keys.paused()
        os.kill(os.getpid(), signal.SIGUSR1)
        assert not keys.paused()
    assert signal.getsignal(signal.SIGUSR1) is before
    sys.stdin.close()

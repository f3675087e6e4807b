"""Where the line of a flight goes: over itself on a terminal, one every 30 s elsewhere, nowhere under -q."""

import itertools
import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.conftest import WATCHDOG_S, Cli
from uavcover.cli.console import Console

LINES = ((0.0, "a"), (10.0, "b"), (30.5, "c"), (45.0, "d"), (61.0, "e"), (0.0, ""))

CHILD = '''
import sys
from uavcover.cli import console

class Drawn(console._OneLine):
    """Draws at every update: nothing waits for rich's own thread."""
    def update(self, *arguments, **values):
        super().update(*arguments, **values)
        self.refresh()

class AtOnce:
    """In place of a timer: the bar appears before the first line."""
    def __init__(self, after_s, appear):
        self.start = appear
    def cancel(self):
        pass
    join = cancel

console._OneLine, console.threading.Timer = Drawn, AtOnce
shown = console.Console(as_json="--json" in sys.argv, verbosity=-1 if "-q" in sys.argv else 0)
with shown.progress("flying", total=3) as bar:
    for k in range(6):
        bar.status(f"mission, waypoint {k} of 5, " + 30 * "long ", at_s=float(k))
        if k == 3:
            shown.say("  3.0 s an event")
    bar.status("", at_s=0.0)
shown.result({"ended": True})
'''


def on_a_terminal(*arguments: str) -> tuple[str, str]:
    """What stderr, a terminal of 80 columns, and stdout, a pipe, get."""
    ours, theirs = pty.openpty()
    environment = os.environ | {"COLUMNS": "80", "TERM": "xterm"}
    with subprocess.Popen(
        [sys.executable, "-c", CHILD, *arguments], stdout=subprocess.PIPE, stderr=theirs, text=True, env=environment
    ) as child:
        os.close(theirs)
        observed = b""
        try:
            while data := os.read(ours, 4096):
                observed += data
        except OSError:  # the terminal is closed
            pass
        out, _ = child.communicate(timeout=WATCHDOG_S)
    os.close(ours)
    return observed.decode(), out


def test_on_a_terminal_it_is_one_line_that_changes_in_place() -> None:
    observed, out = on_a_terminal("--json")
    assert "waypoint 4 of 5" in observed
    assert "\x1b[2K" in observed, "it is drawn over"
    assert 12 * "long " not in observed, "it is cut to the width"
    assert out == '{"ended": true}\n'


def test_events_stand_above_it() -> None:
    observed, _ = on_a_terminal("--json")
    assert "\x1b[2K  3.0 s an event" in observed


def test_without_a_terminal_one_every_30_s(capsys: pytest.CaptureFixture[str]) -> None:
    with Console().progress("flying") as bar:
        for at_s, line in LINES:
            bar.status(line, at_s=at_s)
    assert capsys.readouterr() == ("  30.5 s c\n  61.0 s e\n", "")


def test_quiet_is_quiet_and_json_is_clean(capsys: pytest.CaptureFixture[str]) -> None:
    for console in (Console(verbosity=-1), Console(as_json=True)):
        with console.progress("flying") as bar:
            for at_s, line in LINES:
                bar.status(line, at_s=at_s)
    assert capsys.readouterr() == ("", "  30.5 s c\n  61.0 s e\n")
    assert on_a_terminal("-q") == ("", "")


def test_a_flight_counts_from_its_take_off(cli: Cli, flown: Path) -> None:
    lines = cli("fly", flown, "--to", "mock:", "--mock-speed", 200, "--force").out.splitlines()
    (take_off,) = [line for line in lines if line.endswith(" s in the air")]
    assert float(take_off.split()[0]) < 2.0
    shown = [line.split() for line in lines if " AGL, " in line]
    seconds = [float(words[0]) for words in shown]
    assert len(seconds) >= 5
    assert all(30.0 <= after - before < 45.0 for before, after in itertools.pairwise(seconds))
    assert all("covered" in words and "home" in words and "left" in words for words in shown)
    assert "waiting until the vehicle is ready" in " ".join(lines[1].split())

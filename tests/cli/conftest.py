"""One demo for all tests, commands in this process or in another, mock vehicles that end with the test."""

import dataclasses
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.once import made_once
from uavcover.cli.main import app, run_app

EVALUATIONS = "40"
WATCHDOG_S = 300.0
"""Far longer than anything takes on a machine with other work: it ends what hangs, and measures nothing."""


@dataclass(frozen=True)
class Ended:
    """How a command ended."""

    code: int
    out: str
    err: str

    @property
    def document(self) -> dict[str, Any]:
        """The one JSON object on stdout."""
        lines = self.out.splitlines()
        assert len(lines) == 1, self.out
        document = json.loads(lines[0])
        assert isinstance(document, dict)
        return document

    @property
    def error(self) -> str:
        """The one line on stderr."""
        lines = [line for line in self.err.splitlines() if line]
        assert len(lines) == 1, self.err
        return lines[0]


Cli = Callable[..., Ended]


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "uavcover", *map(str, arguments)]


def in_process(*arguments: object, **options: Any) -> Ended:
    """A command in a process of its own."""
    done = subprocess.run(
        command(*arguments), capture_output=True, text=True, timeout=WATCHDOG_S, check=False, **options
    )
    return Ended(done.returncode, done.stdout, done.stderr)


def _heed_ctrl_c() -> None:
    """In the new process: a shell's background jobs, as tests may be, ignore Ctrl-C, and so would what they start."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@contextmanager
def started(arguments: list[str], **options: Any) -> Iterator[subprocess.Popen[str]]:
    """A process that is gone at the end, whatever happens; a watchdog ends one that hangs."""
    process = subprocess.Popen(
        arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=_heed_ctrl_c, **options
    )
    watchdog = threading.Timer(WATCHDOG_S, process.kill)
    watchdog.start()
    try:
        yield process
    finally:
        watchdog.cancel()
        if process.poll() is None:
            process.send_signal(signal.SIGCONT)
            process.kill()
        process.communicate()


def wait_for_line(process: subprocess.Popen[str], text: str) -> str:
    """Read stdout up to the line that contains a text."""
    assert process.stdout is not None
    observed = ""
    for line in process.stdout:
        observed += line
        if text in line:
            return line
    raise AssertionError(f"{text!r} never came: {observed}")


@contextmanager
def mock_vehicle(*arguments: object) -> Iterator[tuple[int, subprocess.Popen[str]]]:
    """A mock vehicle in a process of its own: its port and its process."""
    with started(command("mock-vehicle", "--listen", "udpin://127.0.0.1:0", "--json", *arguments)) as process:
        assert process.stdout is not None
        yield json.loads(process.stdout.readline())["port"], process


@pytest.fixture
def cli(capsys: pytest.CaptureFixture[str]) -> Cli:
    """A command in this process; ``code`` is how it has to end, where the test says so."""

    def run(*arguments: object, code: int | None = None) -> Ended:
        capsys.readouterr()
        before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)}
        try:
            ended_with = run_app(app, [str(argument) for argument in arguments])
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
        out, err = capsys.readouterr()
        assert code in (None, ended_with), f"exit code {ended_with}: {err}"
        return Ended(ended_with, out, err)

    return run


@dataclass(frozen=True)
class DemoRun:
    """What a demo left."""

    folder: Path
    ended: Ended


@pytest.fixture(scope="session")
def demo_run(tmp_path_factory: pytest.TempPathFactory) -> DemoRun:
    """The demo of a ninth of its area with few evaluations, made once for all workers. Not to be changed: copy it.

    tests/test_setup.py flies the whole.
    """

    def fly(folder: Path) -> None:
        scenario = corner_of_the_demo(folder)
        ended = in_process(
            "demo", "-o", folder / "run", "--scenario", scenario, "--evaluations", EVALUATIONS, "--speed", 50, "--json",
        )  # fmt: skip
        (folder / "ended.json").write_text(json.dumps(dataclasses.asdict(ended)))

    folder = made_once(tmp_path_factory, "demo", fly)
    return DemoRun(folder / "run", Ended(**json.loads((folder / "ended.json").read_text())))


@pytest.fixture
def flown(demo_run: DemoRun, tmp_path: Path) -> Path:
    """A run folder with everything in it."""
    return Path(shutil.copytree(demo_run.folder, tmp_path / "run"))


@pytest.fixture
def planned(demo_run: DemoRun, tmp_path: Path) -> Path:
    """A run folder with a plan and mission files only."""
    folder = shutil.copytree(
        demo_run.folder,
        tmp_path / "run",
        ignore=lambda _, names: [
            n for n in names if n.startswith(("upload", "track", "flight", "verification", "coverage", "report"))
        ],
    )
    document = json.loads((folder / "run.json").read_text())
    document.pop("flight")
    (folder / "run.json").write_text(json.dumps({**document, "provenance": document["provenance"][:1]}))
    return Path(folder)


@pytest.fixture(scope="session")
def nowhere_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A plan of a scenario that has no position on Earth."""
    folder = tmp_path_factory.mktemp("nowhere") / "run"
    ended = in_process("plan", "paper-planar", "--evaluations", 100, "-o", folder)
    assert ended.code == 0
    assert "no mission files" in ended.out
    return folder


def corner_of_the_demo(folder: Path) -> Path:
    """A scenario of a ninth of the demo's area, around its home: planned and flown in a fraction of the time.

    The band of heights is lower, so that it takes several lines and one that is missing leaves a gap.
    """
    text = Path("uavcover/scenarios/jacksboro.toml").read_text(encoding="utf-8")
    for before, after in (
        ("-84.22684", "-84.21938"),
        ("36.48492", "36.47891"),
        ("max_height_agl_m = 120.0", "max_height_agl_m = 75.0"),
    ):
        assert before in text
        text = text.replace(before, after)
    path = folder / "corner.toml"
    path.write_text(text, encoding="utf-8")
    return path


def limited_to(kilobytes: int) -> list[str]:
    """Put before a command: files can grow to this size only, as on a full disk."""
    return ["sh", "-c", f'ulimit -f {2 * kilobytes}; exec "$@"', "sh"]


def files(folder: Path) -> set[str]:
    return set(os.listdir(folder))

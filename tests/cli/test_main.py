import os
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest

from tests.cli.conftest import Cli, command, in_process

COMMANDS = [
    "demo", "doctor", "plan", "export", "plan-upload", "upload", "download", "fly", "mock-vehicle", "verify", "inspect",
]  # fmt: skip


@pytest.mark.parametrize("arguments", [(), ("--help",), ("-h",)])
def test_overview_fits_a_small_terminal(arguments: tuple[str, ...]) -> None:
    ended = in_process(*arguments, env={**os.environ, "COLUMNS": "80"})
    assert ended.code == 0
    lines = ended.out.splitlines()
    assert len(lines) <= 24
    assert max(map(len, lines)) < 80
    assert all(any(name in line.split()[:2] for line in lines) for name in COMMANDS)


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_help_and_the_common_options(cli: Cli, name: str) -> None:
    ended = cli(name, "--help", code=0)
    for option in ("--json", "-q, --quiet", "-v, --verbose"):
        assert option in ended.out


@pytest.mark.parametrize(
    ("arguments", "telling"),
    [
        (("bogus",), "No such command 'bogus'"),
        (("plan",), "Missing argument"),
        (("plan", "jacksboro"), "--out"),
        (("plan", "jacksboro", "-o", "x", "--evaluations", "many"), "--evaluations"),
        (("fly", "run", "--too"), "No such option"),
    ],
)
def test_bad_usage_is_one_line(cli: Cli, arguments: tuple[str, ...], telling: str) -> None:
    ended = cli(*arguments, code=2)
    assert telling in ended.error
    assert ended.error.endswith("--help")
    assert ended.out == ""


@pytest.mark.parametrize(
    ("out", "telling"),
    [
        ("", "error: -o: the name is empty; name the folder or file to write"),
        ("-", "error: -o: standard output is not supported; name the folder or file to write"),
        ("a" * 300, "a: cannot be used (File name too long); check its name and permissions"),
    ],
)
def test_a_folder_that_cannot_be_is_named(cli: Cli, out: str, telling: str) -> None:
    assert cli("plan", "paper-planar", "-o", out, "--evaluations", "50", code=2).error.endswith(telling)


def test_errors_are_objects_under_json(cli: Cli) -> None:
    ended = cli("verify", "nowhere", "--json", code=2)
    assert ended.document["exit_code"] == 2
    assert ended.error == f"error: {ended.document['error']}"


def test_debug_adds_the_trace(cli: Cli) -> None:
    assert "Traceback" in cli("--debug", "verify", "nowhere").err
    assert "Traceback" not in cli("verify", "nowhere").err


def test_a_reader_that_goes_away_is_no_error(planned: Path, tmp_path: Path) -> None:
    export = command("export", planned, "--format", "kml", "-o", tmp_path / "x.kml")
    process = subprocess.Popen(export, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    with process.stderr:
        assert process.stderr.read() == b""
    assert process.wait(60) == 0
    assert (tmp_path / "x.kml").exists()


def test_an_answer_that_cannot_be_written_is_an_error(planned: Path, tmp_path: Path) -> None:
    export = command("export", planned, "--format", "kml", "-o", tmp_path / "x.kml", "--json", "-q")
    with open("/dev/full", "w") as full:
        done = subprocess.run(export, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.splitlines() == ["error: standard output cannot be written (No space left on device)"]


def test_package_runs_as_a_module() -> None:
    assert in_process("--help").out.startswith("Usage:")
    assert sys.executable


def test_the_version_is_that_of_the_package(cli: Cli) -> None:
    ended = cli("--version")
    assert (ended.code, ended.out) == (0, f"uavcover {metadata.version('uavcover')}\n")


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_of_commands(shell: str) -> None:
    complete = {"_TYPER_COMPLETE_ARGS": "uavcover plan", "COMP_WORDS": "uavcover plan", "COMP_CWORD": "1"}
    environment = {**os.environ, **complete, "_UAVCOVER_COMPLETE": f"complete_{shell}"}
    if shell == "fish":
        environment["_TYPER_COMPLETE_FISH_ACTION"] = "get-args"
    program = Path(sys.executable).with_name("uavcover")
    done = subprocess.run([program], env=environment, capture_output=True, text=True, timeout=300, check=False)
    assert "plan-upload" in done.stdout, done.stderr

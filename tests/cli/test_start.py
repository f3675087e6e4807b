"""What happens before a command has begun, and when nobody reads what it says."""

import shlex
import subprocess
import sys
from typing import Any

import pytest
import typer

from uavcover.cli.main import _GROUPS, app

_INTERRUPTED_WHILE_IT_LOADS = """
import sys

class Interrupt:
    def find_spec(self, name, path=None, target=None):
        if name == "uavcover.cli.main":
            raise KeyboardInterrupt

sys.meta_path.insert(0, Interrupt())
from uavcover.__main__ import main
main()
"""


def test_ctrl_c_while_it_loads_is_one_line() -> None:
    done = subprocess.run(
        [sys.executable, "-c", _INTERRUPTED_WHILE_IT_LOADS], capture_output=True, text=True, timeout=300, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "interrupted\n")


@pytest.mark.skipif(sys.platform == "win32", reason="redirections of a POSIX shell")
@pytest.mark.parametrize("redirection", [">&-", "2>&-", ">&- 2>&-", "| true", ">/dev/full"])
@pytest.mark.parametrize("arguments", ["--help", "--version", "bench --help", "nosuch"])
def test_nobody_reads(arguments: str, redirection: str) -> None:
    """A stream that is closed, a pipe that ends, a disk that is full: no trace."""
    command = f'"{sys.executable}" -m uavcover {arguments} {redirection}'
    done = subprocess.run(["sh", "-c", command], capture_output=True, text=True, timeout=300, check=False)
    assert "Traceback" not in done.stderr
    assert "Exception ignored" not in done.stderr


def test_help_loads_no_numbers() -> None:
    """What the overview costs: no numpy, no pymavlink, no planner."""
    code = (
        "import sys\n"
        "sys.argv = ['uavcover', '--help']\n"
        "from uavcover.__main__ import main\n"
        "try:\n    main()\n"
        "except SystemExit:\n    pass\n"
        "heavy = {'numpy', 'scipy', 'numba', 'pymavlink', 'rerun', 'rasterio', 'pydantic', 'matplotlib'} & set(sys.modules)\n"
        "sys.stderr.write(' '.join(sorted(heavy)))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300, check=True)
    assert done.stderr == ""


@pytest.mark.parametrize(
    ("name", "example"), [(n, e) for group in _GROUPS.values() for n, c in group.items() for e in c[2]]
)
def test_examples_of_the_help_texts_parse(name: str, example: str) -> None:
    program, command, *arguments = shlex.split(example)
    assert (program, command) == ("uavcover", name)
    group: Any = typer.main.get_command(app)
    with group.commands[name].make_context(name, arguments) as context:
        assert context.args == []
    assert example in group.commands[name].epilog

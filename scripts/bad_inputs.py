"""Gives every bad input of tests/cli/bad_inputs.py to `uavcover new` and writes its line of error into a table.

.venv/bin/python scripts/bad_inputs.py            # writes docs/results/bad_inputs.md
"""

import argparse
import contextlib
import io
import os
import re
import sys
import tempfile
import warnings
from pathlib import Path

from rasterio.errors import NotGeoreferencedWarning

if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parents[1])

from tests.cli import bad_inputs
from uavcover.cli.ending import run_app
from uavcover.cli.main import app

PAGE = Path(__file__).parent.parent / "docs" / "results" / "bad_inputs.md"
_LONGEST = 60
_HEAD = """# Bad inputs

What `uavcover new` says to {count} bad areas, elevation models and options: one line each, exit code 2, and no file written. Each is a test
(`tests/cli/bad_inputs.py`). Made by `.venv/bin/python scripts/bad_inputs.py`; a test compares the page with what the command says.

| what is wrong | command | error |
|---|---|---|
"""  # noqa: E501


def page() -> str:
    """The table as Markdown."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        prepared = Path(folder).resolve() / "data"
        prepared.mkdir()
        bad_inputs.prepare(prepared)
        for number, what in enumerate(bad_inputs.ALL):
            own = Path(folder).resolve() / str(number)
            own.mkdir()
            arguments, _ = bad_inputs.arguments_of(what, prepared, own)
            line = _error_of([str(argument) for argument in arguments], own)

            def plain(text: str, own: Path = own) -> str:
                shown = "".join(c if c.isprintable() else "?" for c in text)
                return shown.replace(f"{own}/", "").replace(f"{prepared}/", "").replace("|", "\\|")

            command = " ".join(plain(str(argument)) for argument in arguments)
            rows.append(f"| {what} | `{_short(command)}` | {plain(line)} |")
    return _HEAD.format(count=len(rows)) + "\n".join(rows) + "\n"


def _short(command: str) -> str:
    usual = "--dem dem.tif --camera dji-m3e --gsd 3cm"
    command = command.replace(usual, "...")
    return command if len(command) <= _LONGEST + 30 else command[:_LONGEST] + " ..."


def _error_of(arguments: list[str], folder: Path) -> str:
    err, before = io.StringIO(), Path.cwd()
    os.chdir(folder)
    try:
        with warnings.catch_warnings(), contextlib.redirect_stderr(err), contextlib.redirect_stdout(io.StringIO()):
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            code = run_app(app, ["new", *arguments])
    finally:
        os.chdir(before)
    lines = [line for line in err.getvalue().splitlines() if not line.startswith("warning: ")]
    if code != 2 or len(lines) != 1:
        raise SystemExit(f"{arguments}: exit code {code}, {lines}")
    # The program is named as it was called.
    return re.sub(r"see: .* new --help", "see: uavcover new --help", lines[0].removeprefix("error: "))


def main() -> None:
    """Write the page."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    PAGE.write_text(page(), encoding="utf-8")
    print(f"written: {PAGE.relative_to(Path.cwd())}")


if __name__ == "__main__":
    main()

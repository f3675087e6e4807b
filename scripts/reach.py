"""Test files run in forked children, and which lines of some modules each of them executes."""

import hashlib
import json
import os
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
MOST_CASES = 24
"""Of a parametrised test."""
BROKEN = 70
"""Exit code of a child that did not get to an end."""


def in_child(run: Callable[[], int], *, timeout_s: float) -> tuple[int | None, str]:
    """The exit code of ``run`` in a forked child, and what it printed; None after too long."""
    handle, name = tempfile.mkstemp(prefix="mutant.")
    log = Path(name)
    child = os.fork()
    if child == 0:
        code = BROKEN
        try:
            os.setsid()
            os.dup2(handle, 1)
            os.dup2(handle, 2)
            sys.stdout = sys.stderr = os.fdopen(1, "w")
            code = run()
        finally:
            sys.stdout.flush()
            os._exit(code)
    os.close(handle)
    began = time.monotonic()
    try:
        while True:
            done, status = os.waitpid(child, os.WNOHANG)
            if done:
                return os.waitstatus_to_exitcode(status), log.read_text(errors="replace")
            if time.monotonic() - began > timeout_s:
                os.killpg(child, signal.SIGKILL)
                os.waitpid(child, 0)
                return None, log.read_text(errors="replace")
            time.sleep(0.02)
    finally:
        log.unlink(missing_ok=True)


class FewCases:
    """A plugin of pytest: of a test with many cases some are enough to notice a mutant."""

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        """Leave cases out, evenly."""
        cases: dict[str, list[Any]] = {}
        for item in items:
            cases.setdefault(item.nodeid.partition("[")[0], []).append(item)
        items[:] = [item for found in cases.values() for item in found[:: -(-len(found) // MOST_CASES)]]


def run_tests(tests: Sequence[str]) -> int:
    """One file after the other, until one fails: what a later one imports need not be waited for."""
    import pytest

    for test in tests:
        # pytest has rewritten the asserts of its plugins in the run before.
        again = "ignore:Module already imported:pytest.PytestAssertRewriteWarning"
        code = int(pytest.main(["-q", "-x", "-p", "no:cacheprovider", "-W", again, test], plugins=[FewCases()]))
        if code:
            return code
    return 0


@dataclass(frozen=True, slots=True)
class Reach:
    """What a test file executes of the modules, as the code is.

    Attributes:
        seconds: that it takes.
        lines: of each module.
    """

    seconds: float
    lines: dict[str, set[int]]


def measured_reach(tests: Sequence[str], modules: Sequence[str], kept: Path | None) -> dict[str, Reach]:
    """Run each test file as the code is, or take what was measured when it, and the modules, were the same.

    Raises:
        SystemExit: it fails.
    """
    known = json.loads(kept.read_text()) if kept is not None and kept.exists() else {}
    found: dict[str, Reach] = {}
    for test in tests:
        if test not in known or known[test]["key"] != _sha256(test, *known[test]["lines"]):
            began = time.monotonic()
            lines = _lines_executed(test, modules)
            seconds = round(time.monotonic() - began, 1)
            known[test] = {"key": _sha256(test, *lines), "seconds": seconds, "lines": lines}
            print(f"as it is  {known[test]['seconds']:6.1f} s {test}", flush=True)
            if kept is not None:
                kept.write_text(json.dumps(known))
        entry = known[test]
        found[test] = Reach(entry["seconds"], {module: set(lines) for module, lines in entry["lines"].items()})
    return found


def _sha256(*paths: str) -> str:
    return hashlib.sha256(b"".join((ROOT / path).read_bytes() for path in paths)).hexdigest()


def _lines_executed(test: str, modules: Sequence[str]) -> dict[str, list[int]]:
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "lines.json"

        def run() -> int:
            import coverage

            trace = coverage.Coverage(
                data_file=None, config_file=False, include=[str(ROOT / module) for module in modules]
            )
            trace.start()
            code = run_tests([test])
            trace.stop()
            data = trace.get_data()
            executed = {module: sorted(data.lines(str(ROOT / module)) or []) for module in modules}
            out.write_text(json.dumps({module: lines for module, lines in executed.items() if lines}))
            return code

        how, log = in_child(run, timeout_s=3600.0)
        if how != 0:
            raise SystemExit(f"{test} fails as the code is (exit {how}):\n{log[-4000:]}")
        lines: dict[str, list[int]] = json.loads(out.read_text())
        return lines

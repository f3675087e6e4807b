"""Change the code that judges, a little at a time, and see whether a test notices.

Usage: .venv/bin/python scripts/attack/mutate_judgement.py [-o PAGE.md] [--sample 200] [--seed 0] [-j 2] [--list]

Each mutant is one change of one expression or statement: a comparison, a sign, a number, ``and`` for ``or``, ``min`` for ``max``,
a ``not`` left out, a statement left out, another value returned. It lives in a forked child that runs the test files which
execute the changed line, the quickest first, until the first failure; no file is changed. A test that fails, an error and a run
that takes far too long kill it.

Before, every test file runs as the code is: one that fails ends the script. What it executes and how long it takes is measured
then (``--reach FILE`` keeps that for the next time).

Mutants that stand in the .csv beside the page already are not tried again, and keep the reason that stands there: a survivor with
a reason is one that no test can or should notice. Exit 1 when fewer than 95 % are killed.
"""

import argparse
import ast
import csv
import datetime
import importlib.abc
import importlib.machinery
import importlib.util
import os
import re
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import astuple, dataclass, fields, replace
from pathlib import Path
from types import ModuleType

if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parents[2])

from scripts.attack.mutants import (
    ROOT,
    Mutant,
    Reach,
    drawn,
    in_child,
    measured_reach,
    mutants_of,
    mutated,
    own_lines,
    run_tests,
)
from scripts.options import file_to_write

ENOUGH = 0.95
TIMES_AS_LONG = 6.0
"""A run that takes so many times as long as its tests take as the code is does not end."""
TESTS: dict[str, list[str]] = {
    "uavcover/verification/*.py": [
        "tests/verification", "tests/sensing/test_observations.py", "tests/sensing/test_frame_camera.py",
        "tests/planner/test_gap_route.py",
    ],
    "uavcover/missions/leg_checks.py": [
        "tests/missions/test_leg_checks.py", "tests/missions/test_mission_compiler.py", "tests/missions/test_return_paths.py",
        "tests/planner/test_detours.py",
        "tests/planner/test_swaths.py", "tests/planner/test_gap_route.py",
    ],
    "uavcover/flight/arming.py": [
        "tests/flight/test_readiness.py", "tests/flight/test_fly.py",
    ],
    "uavcover/run/track_file.py": [
        "tests/run/test_track_file.py", "tests/flight/test_progress.py", "tests/verification/test_fast_logs.py",
    ],
    "mission_io/autopilots/comparison.py": [
        "tests/mission_io/test_compare.py", "tests/mission_io/test_autopilots.py", "tests/mission_io/test_mavlink_facts.py",
    ],
}  # fmt: skip
"""Modules, and the files or folders of the tests that may concern them."""

NOTES = (
    "Annotations, decorators, words for people and `strict=` are left as they are. Of a test with many cases 24 are run. "
    "Tests were written for what survived at first, and what survived was tried again with them: another seed has more "
    "survivors."
)
"""What a reader of the page has to know."""
NAMED: dict[str, tuple[str, str, str]] = {
    "obstacles in transit are not judged": (
        "uavcover/verification/safety.py", '*find.above("obstacle", ~route, lacking, 0.0, phase="transit"),', "",
    ),
    "the highest height is 5 m too high in leg checks": (
        "uavcover/missions/leg_checks.py", "high > highest_agl_m + tolerance_m", "high > highest_agl_m + tolerance_m + 5.0",
    ),
    "a home that is too low is accepted": ("uavcover/flight/arming.py", "abs(up) > most_m", "up > most_m"),
    "equal times in a track are accepted": ("uavcover/run/track_file.py", "time_s <= before_s", "time_s < before_s"),
}  # fmt: skip
"""Mutants that no test noticed once: always tried, and not counted. Module, the text of a statement, and what it becomes."""


@dataclass(frozen=True, slots=True)
class Row:
    """What became of a mutant.

    Attributes:
        module: path of its file.
        line: where.
        change: what was there and what is there now.
        nth: of the changes in that file with the same words, from 0.
        outcome: killed, timeout or survived.
        seconds: that it took.
        test: the first one that noticed it.
        reason: why no test can or should notice it.
    """

    module: str
    line: int
    change: str
    nth: int
    outcome: str
    seconds: float
    test: str = ""
    reason: str = ""

    @property
    def killed(self) -> bool:
        """Whether a test noticed it."""
        return self.outcome != "survived"


def named_mutants() -> list[tuple[Mutant, ast.Module]]:
    """Those of :data:`NAMED`, with their trees."""
    found = []
    for name, (module, old, new) in NAMED.items():
        text = (ROOT / module).read_text()
        assert text.count(old) == 1, name
        line = 1 + text[: text.index(old)].count("\n")
        statement = min(
            (
                own_lines(node)
                for node in ast.walk(ast.parse(text))
                if isinstance(node, ast.stmt) and own_lines(node)[0] <= line <= own_lines(node)[1]
            ),
            key=lambda lines: lines[1] - lines[0],
        )
        found.append((Mutant(module, line, name, 0, -1, statement), ast.parse(text.replace(old, new))))
    return found


class _Loader(importlib.abc.Loader):
    def __init__(self, tree: ast.Module, path: str) -> None:
        self._tree, self._path = tree, path
        self.loaded = False

    def exec_module(self, module: ModuleType) -> None:
        self.loaded = True
        exec(compile(self._tree, self._path, "exec"), module.__dict__)


class _Finder(importlib.abc.MetaPathFinder):
    """Finds one module mutated."""

    def __init__(self, name: str, tree: ast.Module, path: str) -> None:
        self._name, self._path, self.loader = name, path, _Loader(tree, path)

    def find_spec(self, fullname: str, *_: object) -> importlib.machinery.ModuleSpec | None:
        if fullname != self._name:
            return None
        return importlib.util.spec_from_file_location(fullname, self._path, loader=self.loader)


def tests_of(module: str) -> list[str]:
    """The test files that may concern a file."""
    for pattern, tests in TESTS.items():
        if Path(module).match(pattern):
            return [
                str(path.relative_to(ROOT))
                for test in tests
                for path in (sorted((ROOT / test).glob("test_*.py")) if (ROOT / test).is_dir() else [ROOT / test])
            ]
    raise KeyError(module)


def reaching(mutant: Mutant, reach: dict[str, Reach], most_s: float) -> list[str]:
    """The test files that execute the statement of a mutant, and take no longer than that, the quickest first."""
    first, last = mutant.lines
    wanted = set(range(first, last + 1))
    tests = [test for test in tests_of(mutant.module) if reach[test].lines.get(mutant.module, set()) & wanted]
    tests = [test for test in tests if reach[test].seconds <= most_s]
    return sorted(tests, key=lambda test: reach[test].seconds)


_UNUSED = 71


def outcome(mutant: Mutant, tree: ast.Module, tests: Sequence[str], *, timeout_s: float) -> tuple[str, float, str]:
    """Run tests in a forked child with a mutant in place: the outcome, its seconds, and the test that noticed it."""

    def run() -> int:
        name = mutant.module.removesuffix(".py").replace("/", ".")
        assert name not in sys.modules, name
        finder = _Finder(name, tree, str(ROOT / mutant.module))
        sys.meta_path.insert(0, finder)
        code = run_tests(tests)
        return code if code or finder.loader.loaded else _UNUSED

    began = time.monotonic()
    code, log = in_child(run, timeout_s=timeout_s) if tests else (0, "")
    seconds = time.monotonic() - began
    if code is None:
        return "timeout", seconds, ""
    if code == 0:
        return "survived", seconds, ""
    # 1: tests failed; 2: a test file could not be imported; below 0: a signal. Anything else says nothing of the mutant.
    if code not in (1, 2) and code >= 0:
        raise RuntimeError(f"exit {code}:\n{log[-4000:]}")
    noticed = re.search(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", log, re.MULTILINE)
    return "killed", seconds, noticed.group(1) if noticed else f"exit {code}"


def _warm_up() -> None:
    """Import what takes long, nothing that is mutated, and no plugin of pytest: it could not rewrite its asserts any more."""
    import numba  # noqa: F401
    import pyproj  # noqa: F401
    import pytest  # noqa: F401
    import rasterio  # noqa: F401
    import scipy.ndimage  # noqa: F401
    import shapely  # noqa: F401
    from pymavlink.dialects.v20 import ardupilotmega  # noqa: F401


def kept_rows(path: Path | None) -> dict[tuple[str, str, int], Row]:
    """What was tried already."""
    if path is None or not path.exists():
        return {}
    with path.open(newline="") as file:
        rows = [
            Row(
                r["module"], int(r["line"]), r["change"], int(r["nth"]), r["outcome"], float(r["seconds"]), r["test"],
                r["reason"],
            )
            for r in csv.DictReader(file)
        ]  # fmt: skip
    return {(row.module, row.change, row.nth): row for row in rows}


def write(out: Path, every: Sequence[Row], words: str) -> None:
    """The page, and the .csv beside it."""
    rows = counted(every)
    with out.with_suffix(".csv").open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerows([[field.name for field in fields(Row)], *(astuple(row) for row in every)])
    lines = ["# Mutants of the code that judges", "", words, "", NOTES, ""]
    lines += ["| module | tried | killed | of these by time | survived |", "|---|---:|---:|---:|---:|"]
    for module in dict.fromkeys(row.module for row in rows):
        lines.append(f"| {module} | {_counts([row for row in rows if row.module == module])} |")
    lines += [f"| together | {_counts(rows)} |", "", "## Survivors", ""]
    lines += [_line(r) + (f": {r.reason}" if r.reason else "") for r in rows if not r.killed] or ["None."]
    if slow := [_line(row) for row in rows if row.outcome == "timeout"]:
        lines += ["", "## Killed by time", "", *slow]
    if named := [row for row in every if row.change in NAMED]:
        lines += ["", "## Mutants that no test noticed once", ""]
        lines += [f"- {row.change}: {row.outcome}{f', by `{row.test}`' if row.test else ''}" for row in named]
    out.write_text("\n".join(lines) + "\n")


def counted(rows: Sequence[Row]) -> list[Row]:
    """Those that were drawn."""
    return [row for row in rows if row.change not in NAMED]


def _counts(rows: Sequence[Row]) -> str:
    killed = sum(row.killed for row in rows)
    late = sum(row.outcome == "timeout" for row in rows)
    return f"{len(rows)} | {killed} | {late} | {len(rows) - killed}"


def _line(row: Row) -> str:
    return f"- {row.module}:{row.line}: `{row.change}`"


def summary(rows: Sequence[Row], among: int, command: str) -> str:
    """The figures in words."""
    killed = sum(row.killed for row in rows)
    late = sum(row.outcome == "timeout" for row in rows)
    same = sum(not row.killed and row.reason.startswith("equivalent") for row in rows)
    fraction = killed / len(rows) if rows else 1.0
    real = killed / (len(rows) - same) if len(rows) > same else 1.0
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True
    ).stdout.strip()
    return (
        f"Command: `{command}`, {datetime.datetime.now(datetime.UTC):%Y-%m-%d}, commit {commit}. {len(rows)} of {among} mutants "
        f"tried, drawn by the seed: {killed} killed ({100 * fraction:.1f} %), {late} of them because their tests took more than "
        f"{TIMES_AS_LONG:g} times as long as they should. {len(rows) - killed} survived; {same} of these do the same as the "
        f"code itself ({100 * real:.1f} % of the others were killed)."
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Try them, print, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=file_to_write)
    parser.add_argument("--sample", type=int, default=200, help="so many, drawn by the seed; 0 for all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--module", action="append", default=[], help="only this file; may be repeated")
    parser.add_argument("--match", default="", help="only mutants whose line in --list has this text")
    parser.add_argument("--survivors", action="store_true", help="try the survivors of the .csv again")
    parser.add_argument("-j", "--processes", type=int, default=2)
    parser.add_argument("--timeout", type=float, default=60.0, help="seconds that the tests of a mutant always have")
    parser.add_argument("--quick", type=float, default=1e9, help="only test files that take at most so many seconds")
    parser.add_argument("--reach", type=Path, help="keep here what the test files execute")
    parser.add_argument("--list", action="store_true", help="print all mutants and try none")
    chosen = parser.parse_args(arguments)
    if chosen.survivors and (chosen.out is None or not chosen.out.with_suffix(".csv").is_file()):
        parser.error("--survivors needs -o PAGE with its .csv beside it: that has the survivors")
    modules = sorted(
        str(path.relative_to(ROOT)) for pattern in TESTS for path in ROOT.glob(pattern) if path.name != "__init__.py"
    )
    if unknown := [module for module in chosen.module if module not in modules]:
        parser.error(f"--module {unknown[0]}: no such file, or none whose tests TESTS at the top of the script names")
    every = [mutant for module in chosen.module or modules for mutant in mutants_of(module)]
    every = [mutant for mutant in every if chosen.match in f"{mutant.module}:{mutant.line}: {mutant.change}"]
    if chosen.list:
        print("\n".join(f"{m.module}:{m.line}: {m.change}" for m in every))
        return 0
    trees = dict(named_mutants()) if not chosen.module and not chosen.match else {}
    wanted = [*trees, *drawn(every, chosen.sample or len(every), chosen.seed)]
    kept = kept_rows(None if chosen.out is None else chosen.out.with_suffix(".csv"))
    os.chdir(ROOT)
    os.environ["PYTHONPATH"] = str(ROOT)
    _warm_up()
    tests = dict.fromkeys(test for module in dict.fromkeys(m.module for m in wanted) for test in tests_of(module))
    reach = measured_reach(list(tests), modules, chosen.reach)
    command = f".venv/bin/python scripts/attack/mutate_judgement.py --sample {chosen.sample} --seed {chosen.seed}"
    rows: list[Row] = []
    untried: list[Mutant] = []
    for mutant in wanted:
        row = kept.get((mutant.module, mutant.change, mutant.nth))
        if row is None or (chosen.survivors and not row.killed and not row.reason):
            untried.append(mutant)
        else:
            rows.append(replace(row, line=mutant.line))

    def reported() -> str:
        rows.sort(key=lambda row: (row.module, row.line, row.change, row.nth))
        words = summary(counted(rows), len(every), command)
        if chosen.out is not None:
            write(chosen.out, rows, words)
        return words

    def attempt(mutant: Mutant) -> None:
        tests = reaching(mutant, reach, chosen.quick)
        timeout_s = max(chosen.timeout, TIMES_AS_LONG * sum(reach[test].seconds for test in tests))
        how, seconds, test = outcome(mutant, trees.get(mutant) or mutated(mutant), tests, timeout_s=timeout_s)
        print(f"{how:9} {seconds:6.1f} s {mutant.module}:{mutant.line}: {mutant.change} {test}", flush=True)
        with lock:
            rows.append(Row(mutant.module, mutant.line, mutant.change, mutant.nth, how, round(seconds, 1), test))
            reported()

    lock = threading.Lock()
    with ThreadPoolExecutor(chosen.processes) as pool:
        list(pool.map(_said_when_failing(attempt), untried))
    print(reported())
    return 0 if sum(row.killed for row in counted(rows)) >= ENOUGH * len(counted(rows)) else 1


def _said_when_failing(attempt: Callable[[Mutant], None]) -> Callable[[Mutant], None]:
    def careful(mutant: Mutant) -> None:
        try:
            attempt(mutant)
        except Exception as error:
            raise RuntimeError(f"{mutant}: {error}") from error

    return careful


if __name__ == "__main__":
    sys.exit(main())

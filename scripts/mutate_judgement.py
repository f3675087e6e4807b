"""Change the code that judges, a little at a time, and see whether a test notices.

Usage: .venv/bin/python scripts/mutate_judgement.py [-o docs/results/mutants.md] [--sample 200] [--seed 0] [-j 2] [--list]

Each mutant is one change of one expression or statement: a comparison, a sign, a number, ``and`` for ``or``, ``min`` for ``max``,
a ``not`` left out, a statement left out, another value returned. It lives in a forked child that runs the tests of its module
until the first failure; no file is changed. A test that fails, an error and a run that takes too long kill it.

Mutants that stand in the .csv beside the page already are not tried again. Exit 1 when fewer than 95 % are killed.
"""

import argparse
import ast
import copy
import csv
import importlib.abc
import importlib.machinery
import importlib.util
import os
import random
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).resolve().parents[1]
ENOUGH = 0.95
_JUDGE = ["tests/verification", "tests/test_falsify_judged.py"]
TESTS: dict[str, list[str]] = {
    "uavcover/verification/*.py": _JUDGE,
    "uavcover/leg_checks.py": ["tests/test_leg_checks.py", "tests/test_mission_compiler.py"],
    "uavcover/flight/readiness.py": ["tests/flight/test_fly.py"],
    "uavcover/flight/track_file.py": ["tests/flight/test_track_file.py"],
    "mission_io/compare.py": ["tests/mission_io/test_compare.py", "tests/mission_io/test_diff.py"],
}
"""Modules, and the files or folders of the tests that concern them, the quickest first; what is not there is left out."""
FIRST: dict[str, list[str]] = {
    "possible_motion": ["tests/verification/test_possible_motion.py"],
    "motion_windows": ["tests/verification/test_possible_motion.py"],
    "attitude_checks": ["tests/verification/test_possible_motion.py", "tests/verification/test_attitude.py"],
    "looks": ["tests/verification/test_attitude.py"],
    "flown_coverage": ["tests/verification/test_cells.py"],
    "gaps": ["tests/verification/test_cells.py"],
}
"""Tests that are asked before the others."""

_COMPARISONS: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip
_TURNED: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt,
}  # fmt: skip
_OPERATORS: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd,
}  # fmt: skip
_NAMES = {
    "min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum", "argmin": "argmax", "argmax": "argmin",
    "any": "all", "all": "any", "nanmin": "nanmax", "nanmax": "nanmin", "nanargmin": "nanargmax",
    "floor": "ceil", "ceil": "floor",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Mutant:
    """One change.

    Attributes:
        module: path of its file.
        line: where.
        change: what was there and what is there now.
        number: of the change in the file's order.
    """

    module: str
    line: int
    change: str
    number: int


@dataclass(frozen=True, slots=True)
class Row:
    """What became of a mutant.

    Attributes:
        module: path of its file.
        number: of the change in the file's order.
        line: where.
        change: what was there and what is there now.
        outcome: killed, timeout or survived.
        seconds: that it took.
    """

    module: str
    number: int
    line: int
    change: str
    outcome: str
    seconds: float


def changes_of(node: ast.AST) -> Iterator[tuple[ast.AST, str]]:
    """The nodes that one node may be replaced by, and what changes; annotations and texts are left alone."""
    if isinstance(node, ast.Compare):
        for k, op in enumerate(node.ops):
            for table in (_COMPARISONS, _TURNED):
                if (other := table.get(type(op))) is not None:
                    ops = [*node.ops[:k], other(), *node.ops[k + 1 :]]
                    yield _like(node, ops=ops), f"{type(op).__name__} -> {other.__name__}"
    elif isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
        other_op = _OPERATORS[type(node.op)]
        yield _like(node, op=other_op()), f"{type(node.op).__name__} -> {other_op.__name__}"
    elif isinstance(node, ast.BoolOp):
        yield _like(node, op=ast.Or() if isinstance(node.op, ast.And) else ast.And()), "and <-> or"
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.Invert | ast.USub):
        yield node.operand, f"without {type(node.op).__name__}"
    elif isinstance(node, ast.Constant) and isinstance(node.value, bool):
        yield _like(node, value=not node.value), f"{node.value} -> {not node.value}"
    elif isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        value = node.value + 1 if node.value in (0, 1, -1) else 2 * node.value
        yield _like(node, value=value), f"{node.value} -> {value}"
    elif isinstance(node, ast.Attribute) and node.attr in _NAMES:
        yield _like(node, attr=_NAMES[node.attr]), f"{node.attr} -> {_NAMES[node.attr]}"
    elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load) and node.id in _NAMES:
        yield _like(node, id=_NAMES[node.id]), f"{node.id} -> {_NAMES[node.id]}"
    elif isinstance(node, ast.AugAssign) or (isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)):
        yield ast.copy_location(ast.Pass(), node), "statement left out"
    elif isinstance(node, ast.Raise | ast.Continue | ast.Break):
        yield ast.copy_location(ast.Pass(), node), f"{type(node).__name__} left out"
    elif isinstance(node, ast.IfExp):
        yield node.body, "always the first"
        yield node.orelse, "always the second"


def _like(node: ast.AST, **changes: object) -> ast.AST:
    other = copy.copy(node)
    for name, value in changes.items():
        setattr(other, name, value)
    return other


class _Changer(ast.NodeTransformer):
    """Counts the places for changes, and makes the one of a number."""

    def __init__(self, wanted: int | None = None) -> None:
        self.found: list[tuple[int, str]] = []
        self._wanted = wanted

    def visit(self, node: ast.AST) -> ast.AST:
        if isinstance(node, ast.arg | ast.AnnAssign) and node.annotation is not None:
            annotation, node.annotation = node.annotation, ast.Constant(None)
            result = self._visit(node)
            assert isinstance(result, ast.arg | ast.AnnAssign)
            result.annotation = annotation
            return result
        if isinstance(node, ast.FunctionDef):
            returns, node.returns = node.returns, None
            decorators, node.decorator_list = node.decorator_list, []
            self._visit(node)
            node.returns, node.decorator_list = returns, decorators
            return node
        if isinstance(node, ast.JoinedStr):
            return node  # words for people
        return self._visit(node)

    def _visit(self, node: ast.AST) -> ast.AST:
        chosen: ast.AST | None = None
        for other, what in changes_of(node):
            if len(self.found) == self._wanted:
                chosen = other
            self.found.append((getattr(node, "lineno", 0), f"{_shown(node)}: {what}"))
        if chosen is not None:
            return ast.copy_location(chosen, node)
        return self.generic_visit(node)


def _shown(node: ast.AST) -> str:
    return " ".join(ast.unparse(node).split())[:90]


def mutants_of(module: str) -> list[Mutant]:
    """All of a file's, in its order."""
    changer = _Changer()
    changer.visit(ast.parse((ROOT / module).read_text()))
    return [Mutant(module, line, what, number) for number, (line, what) in enumerate(changer.found)]


def mutated(mutant: Mutant) -> ast.Module:
    """The tree of a file with the change made."""
    tree = _Changer(mutant.number).visit(ast.parse((ROOT / mutant.module).read_text()))
    assert isinstance(tree, ast.Module)
    return ast.fix_missing_locations(tree)


class _Loader(importlib.abc.Loader):
    def __init__(self, tree: ast.Module, path: str) -> None:
        self._tree, self._path = tree, path

    def exec_module(self, module: ModuleType) -> None:
        exec(compile(self._tree, self._path, "exec"), module.__dict__)


class _Finder(importlib.abc.MetaPathFinder):
    """Finds one module mutated."""

    def __init__(self, name: str, tree: ast.Module, path: str) -> None:
        self._name, self._tree, self._path = name, tree, path

    def find_spec(self, fullname: str, *_: object) -> importlib.machinery.ModuleSpec | None:
        if fullname != self._name:
            return None
        return importlib.util.spec_from_file_location(fullname, self._path, loader=_Loader(self._tree, self._path))


def tests_of(module: str) -> list[str]:
    """The tests that concern a file."""
    for pattern, tests in TESTS.items():
        if Path(module).match(pattern):
            return [test for test in [*FIRST.get(Path(module).stem, []), *tests] if (ROOT / test).exists()]
    raise KeyError(module)


def outcome(module: str, tree: ast.Module | None, *, timeout_s: float) -> tuple[str, float]:
    """Run the tests of a file in a forked child, with ``tree`` in its place: the outcome, and its seconds."""
    began = time.monotonic()
    log = Path(tempfile.gettempdir()) / f"mutant.{os.getpid()}.{abs(hash((module, time.monotonic_ns())))}"
    child = os.fork()
    if child == 0:
        code = 70
        try:
            os.setsid()
            output = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
            os.dup2(output, 1)
            os.dup2(output, 2)
            code = _run_tests(module, tree)
        finally:
            os._exit(code)
    while True:
        done, status = os.waitpid(child, os.WNOHANG)
        seconds = time.monotonic() - began
        if done:
            break
        if seconds > timeout_s:
            os.killpg(child, signal.SIGKILL)
            os.waitpid(child, 0)
            log.unlink(missing_ok=True)
            return "timeout", seconds
        time.sleep(0.05)
    code = os.waitstatus_to_exitcode(status)
    if tree is None and code != 0:
        raise SystemExit(f"{module}: its tests fail as it is; see {log}")
    log.unlink(missing_ok=True)
    return ("survived" if code == 0 else "killed"), seconds


def _run_tests(module: str, tree: ast.Module | None) -> int:
    import pytest

    if tree is not None:
        name = module.removesuffix(".py").replace("/", ".")
        assert name not in sys.modules, name
        sys.meta_path.insert(0, _Finder(name, tree, str(ROOT / module)))
    return int(pytest.main(["-q", "-x", "-p", "no:cacheprovider", "-p", "no:randomly", *tests_of(module)]))


def _warm_up() -> None:
    """Import what takes long, and nothing that is mutated."""
    import hypothesis  # noqa: F401
    import numba  # noqa: F401
    import pyproj  # noqa: F401
    import pytest  # noqa: F401
    import rasterio  # noqa: F401
    import scipy.ndimage  # noqa: F401
    import shapely  # noqa: F401
    from pymavlink.dialects.v20 import ardupilotmega  # noqa: F401

    from uavcover.kernels import coverage, sight, tally  # noqa: F401


def kept_rows(path: Path | None) -> dict[tuple[str, int, str], Row]:
    """What was tried already."""
    if path is None or not path.exists():
        return {}
    with path.open(newline="") as file:
        rows = [
            Row(r["module"], int(r["number"]), int(r["line"]), r["change"], r["outcome"], float(r["seconds"]))
            for r in csv.DictReader(file)
        ]
    return {(row.module, row.number, row.change): row for row in rows}


def write(out: Path, rows: Sequence[Row], words: str) -> None:
    """The page, and the .csv beside it."""
    with out.with_suffix(".csv").open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerows([[field.name for field in fields(Row)], *(astuple(row) for row in rows)])
    lines = ["# Mutants of the code that judges", "", words, "", "| module | tried | killed |", "|---|---:|---:|"]
    for module in dict.fromkeys(row.module for row in rows):
        of_it = [row for row in rows if row.module == module]
        lines.append(f"| {module} | {len(of_it)} | {sum(row.outcome != 'survived' for row in of_it)} |")
    lines += ["", "## Survivors", ""]
    lines += [f"- {r.module}:{r.line}: `{r.change}`" for r in rows if r.outcome == "survived"] or ["None."]
    out.write_text("\n".join(lines) + "\n")


def main(arguments: Sequence[str] | None = None) -> int:
    """Try them, print, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=Path)
    parser.add_argument("--sample", type=int, default=200, help="so many, drawn by the seed; 0 for all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--module", action="append", default=[], help="only this file; may be repeated")
    parser.add_argument("-j", "--processes", type=int, default=2)
    parser.add_argument("--timeout", type=float, default=300.0, help="seconds for the tests of one mutant")
    parser.add_argument("--list", action="store_true", help="print all mutants and try none")
    chosen = parser.parse_args(arguments)
    modules = chosen.module or sorted(
        str(path.relative_to(ROOT)) for pattern in TESTS for path in ROOT.glob(pattern) if path.name != "__init__.py"
    )
    every = [mutant for module in modules for mutant in mutants_of(module)]
    if chosen.list:
        print("\n".join(f"{m.module}:{m.line}: {m.change}" for m in every))
        return 0
    count = min(chosen.sample, len(every)) if chosen.sample else len(every)
    wanted = random.Random(chosen.seed).sample(every, count)
    kept = kept_rows(None if chosen.out is None else chosen.out.with_suffix(".csv"))
    rows: list[Row] = []
    os.chdir(ROOT)
    _warm_up()

    def words() -> str:
        killed = sum(row.outcome != "survived" for row in rows)
        share = killed / len(rows) if rows else 1.0
        return (
            f"Command: `.venv/bin/python scripts/mutate_judgement.py --sample {chosen.sample} --seed {chosen.seed}`: "
            f"{len(rows)} of {len(every)} mutants tried, drawn by the seed; {killed} killed ({100 * share:.1f} %)."
        )

    def attempt(mutant: Mutant) -> None:
        row = kept.get((mutant.module, mutant.number, mutant.change))
        if row is None:
            how, seconds = outcome(mutant.module, mutated(mutant), timeout_s=chosen.timeout)
            row = Row(mutant.module, mutant.number, mutant.line, mutant.change, how, round(seconds, 1))
        rows.append(row)
        print(f"{row.outcome:9} {row.seconds:6.1f} s {row.module}:{row.line}: {row.change}", flush=True)
        if chosen.out is not None:
            write(chosen.out, sorted(rows, key=lambda r: (r.module, r.number)), words())

    with ThreadPoolExecutor(chosen.processes) as pool:
        list(pool.map(_said_when_failing(attempt), wanted))
    print(words())
    return 0 if sum(row.outcome != "survived" for row in rows) >= ENOUGH * len(rows) else 1


def _said_when_failing(attempt: Callable[[Mutant], None]) -> Callable[[Mutant], None]:
    def careful(mutant: Mutant) -> None:
        try:
            attempt(mutant)
        except Exception as error:
            raise RuntimeError(f"{mutant}: {error}") from error

    return careful


if __name__ == "__main__":
    sys.path[0] = str(ROOT)
    sys.exit(main())

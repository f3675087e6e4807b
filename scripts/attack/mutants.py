"""Every small change of a file of code, and test files run in forked children, with the lines that each of them executes."""

import ast
import copy
import hashlib
import json
import os
import random
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
MOST_CASES = 24
"""Of a parametrised test."""
BROKEN = 70
"""Exit code of a child that did not get to an end."""

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
        nth: of the changes in that file with the same words, from 0.
        number: of the change in the file's order.
        lines: of the statement, without what it contains: the first and the last.
    """

    module: str
    line: int
    change: str
    nth: int
    number: int
    lines: tuple[int, int]


def changes_of(node: ast.AST) -> Iterator[tuple[ast.AST, str]]:
    """The nodes that one node may be replaced by, and what changes; annotations, decorators and texts are left alone."""
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
        self.found: list[tuple[int, str, tuple[int, int]]] = []
        self._wanted = wanted
        self._lines = (0, 0)

    def visit(self, node: ast.AST) -> ast.AST:
        if isinstance(node, ast.arg | ast.AnnAssign) and node.annotation is not None:
            annotation, node.annotation = node.annotation, ast.Constant(None)
            result = self._visit(node)
            assert isinstance(result, ast.arg | ast.AnnAssign)
            result.annotation = annotation
            return result
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            # How a class is declared, frozen or with slots, judges nothing.
            decorators, node.decorator_list = node.decorator_list, []
            returns = getattr(node, "returns", None)
            if isinstance(node, ast.FunctionDef):
                node.returns = None
            self._visit(node)
            node.decorator_list = decorators
            if isinstance(node, ast.FunctionDef):
                node.returns = returns
            return node
        if isinstance(node, ast.JoinedStr) or (isinstance(node, ast.keyword) and node.arg == "strict"):
            return node  # words for people; and what guards against errors of the program itself
        return self._visit(node)

    def _visit(self, node: ast.AST) -> ast.AST:
        outer = self._lines
        if isinstance(node, ast.stmt):
            self._lines = own_lines(node)
        try:
            return self._changed(node)
        finally:
            self._lines = outer

    def _changed(self, node: ast.AST) -> ast.AST:
        chosen: ast.AST | None = None
        for other, what in changes_of(node):
            if len(self.found) == self._wanted:
                chosen = other
            self.found.append((getattr(node, "lineno", 0), f"{_shown(node)}: {what}", self._lines))
        if chosen is not None:
            return ast.copy_location(chosen, node)
        return self.generic_visit(node)


def own_lines(statement: ast.stmt) -> tuple[int, int]:
    """First and last line of a statement, without the statements in it."""
    body = getattr(statement, "body", None)
    end = statement.end_lineno or statement.lineno
    return statement.lineno, max(statement.lineno, body[0].lineno - 1) if body else end


def _shown(node: ast.AST) -> str:
    return " ".join(ast.unparse(node).split())[:90]


def mutants_of(module: str) -> list[Mutant]:
    """All of a file's, in its order."""
    changer = _Changer()
    changer.visit(ast.parse((ROOT / module).read_text()))
    observed: Counter[str] = Counter()
    found = []
    for number, (line, change, lines) in enumerate(changer.found):
        found.append(Mutant(module, line, change, observed[change], number, lines))
        observed[change] += 1
    return found


def drawn(mutants: Sequence[Mutant], count: int, seed: int) -> list[Mutant]:
    """Some of them, by lot; each draws its own, so that a change of the code elsewhere leaves the draw as it was."""

    def lot(mutant: Mutant) -> float:
        return random.Random(f"{seed}|{mutant.module}|{mutant.change}|{mutant.nth}").random()

    return sorted(mutants, key=lot)[:count]


def mutated(mutant: Mutant) -> ast.Module:
    """The tree of a file with the change made."""
    tree = _Changer(mutant.number).visit(ast.parse((ROOT / mutant.module).read_text()))
    assert isinstance(tree, ast.Module)
    return ast.fix_missing_locations(tree)


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

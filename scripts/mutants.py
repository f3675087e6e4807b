"""Every small change of a file of code: a comparison, a sign, a number, ``and`` for ``or``, a statement left out."""

import ast
import copy
import random
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

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
    seen: Counter[str] = Counter()
    found = []
    for number, (line, change, lines) in enumerate(changer.found):
        found.append(Mutant(module, line, change, seen[change], number, lines))
        seen[change] += 1
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

"""Counts what docs/explanation/architecture.md states: `python scripts/docs/measure_architecture.py [--root FOLDER] [--json]`.

Counted are the two packages of the product, `uavcover` and `mission_io`. A package's `__init__.py` is a module
when it holds code. Layers and rings come from the imports themselves, not from the contracts in `pyproject.toml`.
"""

import argparse
import ast
import json
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

PACKAGES = ("uavcover", "mission_io")


def modules_in(root: Path) -> dict[str, Path]:
    """Dotted name of every module to its file; a package's `__init__.py` carries the package's name."""
    found = {}
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            parts = path.relative_to(root).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imports_of(tree: ast.AST, known: set[str]) -> Iterator[str]:
    """Modules of `known` that a parsed file imports, inside functions too."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in known)
        elif isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                if inner in known:
                    yield inner
                elif node.module in known:
                    yield node.module


def rings(graph: dict[str, set[str]]) -> list[list[str]]:
    """Strongly connected components of more than one node (Tarjan)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(node: str) -> None:
        index[node] = low[node] = len(index)
        stack.append(node)
        for other in sorted(graph.get(node, ())):
            if other not in index:
                visit(other)
                low[node] = min(low[node], low[other])
            elif other in stack:
                low[node] = min(low[node], index[other])
        if low[node] == index[node]:
            members = []
            while not members or members[-1] != node:
                members.append(stack.pop())
            if len(members) > 1:
                found.append(sorted(members))

    for node in sorted(graph):
        if node not in index:
            visit(node)
    return found


def measured(root: Path) -> dict[str, object]:
    """Every figure by its name."""
    files = modules_in(root)
    trees = {name: ast.parse(path.read_text()) for name, path in files.items()}
    counted = {n for n, path in files.items() if path.name != "__init__.py" or len(trees[n].body) > 1}
    graph = {name: set(imports_of(tree, set(files))) - {name} for name, tree in trees.items()}
    importers: dict[str, set[str]] = defaultdict(set)
    for name, others in graph.items():
        for other in others:
            importers[other].add(name)

    def parts(package: str, level: int) -> dict[str, set[str]]:
        of: dict[str, set[str]] = defaultdict(set)
        for name, others in graph.items():
            if name.split(".")[0] == package and name.count(".") >= 1:
                part = ".".join(name.split(".")[: level + 1])
                of[part] |= {".".join(o.split(".")[: level + 1]) for o in others if o.startswith(package + ".")} - {
                    part
                }
        return of

    texts = {name: path.read_text(encoding="utf-8") for name, path in files.items()}
    lines = {name: len(text.splitlines()) for name, text in texts.items()}
    core = [n for n in files if not n.startswith(("uavcover.extras", "mission_io.conformance"))]
    scripts = [p for p in (root / "scripts").rglob("*") if p.suffix in (".py", ".sh")]
    pages = list((root / "docs").rglob("*.md"))
    results = [p for p in pages if p.is_relative_to(root / "docs" / "results")]
    return {
        "product lines (uavcover and mission_io)": sum(lines.values()),
        "lines of the core": sum(lines[n] for n in core),
        "modules (without package markers)": len(counted),
        "modules of the core": len(counted & set(core)),
        "modules with one importer and under 120 lines": sum(
            len(importers[n]) == 1 and lines[n] < 120 and files[n].name != "__init__.py" for n in counted
        ),
        "module-level numbers outside data/": sum(map(numbers_of, trees.values())),
        "files in scripts/": len(scripts),
        "lines in scripts/": sum(len(p.read_text(encoding="utf-8").splitlines()) for p in scripts),
        "pages in docs/results/": len(results),
        "words in docs/ without results": sum(
            len(p.read_text(encoding="utf-8").split()) for p in pages if p not in results
        ),
        "test lines": sum(len(p.read_text(encoding="utf-8").splitlines()) for p in (root / "tests").rglob("*.py")),
        "files over 450 lines": sum(count > 450 for count in lines.values()),
        "rings of packages": len(rings(parts("uavcover", 1)) + rings(parts("mission_io", 1))),
        "rings of modules": len(rings(graph)),
    }


def numbers_of(tree: ast.Module) -> int:
    """How many module-level names are set to a number."""
    return sum(
        isinstance(node, ast.Assign | ast.AnnAssign)
        and isinstance(node.value, ast.Constant | ast.UnaryOp)
        and isinstance(getattr(node.value, "operand", node.value), ast.Constant)
        and isinstance(getattr(getattr(node.value, "operand", node.value), "value", None), int | float)
        for node in tree.body
    )


def main() -> None:
    """Prints one line a figure, or JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--root", type=Path, default=Path(__file__).resolve().parents[2])
    parser.add_argument("--json", action="store_true")
    requested = parser.parse_args()
    if not (requested.root / "pyproject.toml").is_file():
        parser.error(f"--root {requested.root}: no pyproject.toml in it; name a checkout")
    figures = measured(requested.root)
    print(json.dumps(figures, indent=2) if requested.json else "\n".join(f"{v!s:>8}  {k}" for k, v in figures.items()))


if __name__ == "__main__":
    main()

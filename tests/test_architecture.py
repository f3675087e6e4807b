"""docs/explanation/architecture.md says what the tree is, and the tree does not grow beyond it."""

import ast
import json
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "explanation" / "architecture.md"
ROW = re.compile(r"^\| ([^|]+?) \| *\d* *\| *\d* *\| (\d+) \| *\d* *\|$", re.MULTILINE)


def test_no_figure_is_above_what_the_page_states() -> None:
    command = [sys.executable, str(ROOT / "scripts" / "docs" / "measure_architecture.py"), "--json"]
    shown = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300).stdout
    counted: dict[str, int] = json.loads(shown)
    stated = {name: int(today) for name, today in ROW.findall(PAGE.read_text(encoding="utf-8"))}
    assert set(stated) == set(counted)
    grown = {name: (counted[name], stated[name]) for name in counted if counted[name] > stated[name]}
    assert not grown, "counted, stated: join or delete something, or state it with its reason in the commit"


def test_every_path_that_the_map_names_is_there() -> None:
    """In backticks, under uavcover unless it begins with mission_io, docs or tests; a first cell of a table row, too."""
    text = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    below = text.index("## Where to begin")
    named = set(re.findall(r"`([a-z_]+(?:/[a-z_]+)*/?(?:\.py|\.toml)?)`", text[below:]))
    named |= {
        path
        for row in re.findall(r"^\| (`[^|]+/`[^|]*) \|", text[:below], re.MULTILINE)
        for path in re.findall(r"`([^`]+)`", row)
    }
    roots = (ROOT / "uavcover", ROOT, ROOT / "mission_io")
    paths = sorted(path for path in named if "/" in path or path.endswith((".py", ".toml")))
    assert len(paths) > 30
    assert [path for path in paths if not any((root / path).exists() for root in roots)] == []


RASTERIO = ("uavcover/terrain/elevation_file.py", "'previous exception' in str(error)")
"""rasterio tells only in its text that the reason is in the cause."""


def decisions_by_text(tree: ast.AST) -> list[str]:
    """Expressions that test the text of a caught error: ``in str(error)``, ``str(error).startswith(...)``."""
    found = []
    for handler in ast.walk(tree):
        if not isinstance(handler, ast.ExceptHandler) or handler.name is None:
            continue
        text = f"str({handler.name})"
        for node in ast.walk(handler):
            if isinstance(node, ast.Compare):
                sides = [node.left, *node.comparators]
            elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
                sides = [node.func.value] if node.func.attr in ("startswith", "endswith", "find", "count") else []
            else:
                continue
            found += [ast.unparse(node) for side in sides if ast.unparse(side) == text]
    return found


def test_no_decision_is_derived_from_the_text_of_an_error() -> None:
    sample = "try:\n    f()\nexcept E as e:\n    g('a' in str(e) or str(e).startswith('b'))"
    assert decisions_by_text(ast.parse(sample)) == ["'a' in str(e)", "str(e).startswith('b')"]
    files = [path for package in ("uavcover", "mission_io") for path in (ROOT / package).rglob("*.py")]
    found = [
        (path.relative_to(ROOT).as_posix(), decision)
        for path in files
        for decision in decisions_by_text(ast.parse(path.read_text(encoding="utf-8")))
    ]
    assert found == [RASTERIO]
